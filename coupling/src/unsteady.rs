//! What the fluid does to a grain by its acceleration and by its turning, beside drag and pressure: added mass and lift.
//!
//! A grain that accelerates against the fluid takes some of it along: the fluid gives it
//!
//! ```text
//!     m_a (Du/Dt - dv/dt),     m_a = C rho V,
//! ```
//!
//! with C = 1/2 for a sphere (Auton, Hunt and Prud'homme, J. Fluid Mech. 197, 241, 1988: Du/Dt follows the fluid). In a
//! step this is m_a ((u - u_n)/dt + (u_n . grad) u_n - (v - v_n)/dt), u_n being the accepted velocity at the places of
//! the step. So it is linear in u - v like the drag, with the coefficient m_a/dt, and the rest is known:
//!
//! ```text
//!     gamma -> gamma + m_a/dt,     k = m_a ((v_n - u_n)/dt + (u_n . grad) u_n) + lift(u_n, v_n)
//! ```
//!
//! The forcing of the fluid is f = gamma u - V grad p + k, the law of the grain b + a f and the force on it f - gamma
//! v*, as without k: no scheme knows of it. A fluid solver gets no k. Its points have b + a k - k/gamma in place of b in
//! the equation of momentum and b + a k in that of mass, which is the same.
//!
//! In the slip box, A = beta dt/(eps rho_f), B = beta dt/(phi rho_p) and Q = C rho_f phi (1/(eps rho_f) + 1/(phi
//! rho_p)), the slip of `henry`, `lagged`, `anchored` and `iterated` decays by (1 + Q)/(1 + Q + A + B). Grains that
//! move in sub-steps carry the added mass through all of them; what drag and added mass felt of their motion is then the
//! mean of their mean velocity, weighted with gamma, and of that at the end, weighted with m_a/dt.

use crate::closure::{Lift, Surroundings};
use crate::exchange::{OnMesh, Pieces};
use voidage_fluid::Vector;

/// The accepted flow at a grain.
struct Flow<const D: usize> {
    /// Velocity u_n, m/s.
    velocity: Vector<D>,
    /// (u_n - u_mesh) . grad u_n, m/s2.
    convected: Vector<D>,
    /// (grad u)^T - grad u, with the derivative by x_j of u_i at i, j; times a vector s it is s x curl u, 1/s.
    turning: nalgebra::SMatrix<f64, D, D>,
}

impl<const D: usize> Flow<D> {
    /// Means over the pieces of a grain; of a mesh that moves by `mesh_velocity`.
    fn at(
        (pieces, grain): (&Pieces<D>, usize),
        fluid: &OnMesh<'_, D>,
        mesh_velocity: Option<&[Vector<D>]>,
    ) -> Self {
        let zero = Vector::zeros();
        let mut flow = Self { velocity: zero, convected: zero, turning: nalgebra::SMatrix::zeros() };
        for q in pieces.of(grain) {
            let (cell, place, share) = (pieces.cell[q], &pieces.coordinate[q], pieces.share[q]);
            let mut gradient = nalgebra::SMatrix::<f64, D, D>::zeros();
            for i in 0..D {
                let slope = fluid.mesh.gradient(cell as usize, |node| fluid.fields.velocity[node][i]);
                gradient.set_row(i, &slope.transpose());
            }
            let velocity = fluid.velocity(cell, place);
            let mesh = mesh_velocity.map_or(zero, |nodes| fluid.vector(nodes, cell, place));
            flow.velocity += velocity * share;
            flow.convected += gradient * (velocity - mesh) * share;
            flow.turning += (gradient.transpose() - gradient) * share;
        }
        flow
    }

    /// |curl u|, 1/s.
    fn vorticity(&self) -> f64 {
        (0.5 * self.turning.norm_squared()).sqrt()
    }
}

/// The laws of added mass and lift.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Unsteady {
    /// C: added mass over that of the fluid that the grain displaces.
    pub added_mass: f64,
    /// Law of lift; absent without.
    pub lift: Option<Lift>,
}

impl Unsteady {
    /// Whether there is neither.
    pub fn is_none(&self) -> bool {
        self.added_mass == 0.0 && self.lift.is_none()
    }

    /// The added mass (kg) of a grain that displaces `volume`, and the known part k of its force (N) in a step of
    /// `dt`, moving at `velocity`.
    pub(crate) fn of<const D: usize>(
        &self,
        grain: (&Pieces<D>, usize),
        (fluid, mesh_velocity): (&OnMesh<'_, D>, Option<&[Vector<D>]>),
        (volume, velocity): (f64, Vector<D>),
        around: &Surroundings,
        dt: f64,
    ) -> (f64, Vector<D>) {
        let flow = Flow::at(grain, fluid, mesh_velocity);
        let slip = flow.velocity - velocity;
        let added = self.added_mass * around.density * volume;
        let mut known = (flow.convected - slip / dt) * added;
        if let Some(law) = self.lift {
            let around = Surroundings { slip: slip.norm(), ..*around };
            known += flow.turning * slip * (volume * law.coefficient(&around, flow.vorticity()));
        }
        (added, known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlap::Overlap;
    use approx::assert_relative_eq;
    use voidage_fluid::Mesh;
    use voidage_fluid::flow::State;
    use voidage_fluid::mesh::{Rectangle, Sides};

    type Vec2 = Vector<2>;

    /// What a flow does to a grain at (0.4, 0.5) with a radius of 0.2, of volume 1, that moves so, in a step of 0.1 s.
    fn known(unsteady: Unsteady, flow: impl Fn(&Vec2) -> Vec2, velocity: Vec2) -> (f64, Vec2) {
        let rectangle = Rectangle {
            lower: [0.0; 2],
            upper: [1.0; 2],
            size: Some(0.25),
            sides: Sides::all("walls"),
            holes: vec![],
            refine: vec![],
            structured: None,
        };
        let mesh = Mesh::rectangle(&rectangle).unwrap();
        let fields = State {
            velocity: mesh.points.iter().map(flow).collect(),
            pressure: vec![0.0; mesh.points.len()],
            scalars: vec![],
        };
        let (mut pieces, mut inside) = (Pieces::default(), vec![]);
        let mut cutter = Overlap::new(&mesh).unwrap();
        cutter.cut(&mesh, &[Vec2::new(0.4, 0.5)], &[0.2], &mut pieces, &mut inside).unwrap();
        let around = Surroundings { slip: 0.0, voidage: 1.0, diameter: 0.4, density: 3.0, viscosity: 0.3 };
        let fluid = OnMesh { mesh: &mesh, fields: &fields };
        unsteady.of((&pieces, 0), (&fluid, None), (1.0, velocity), &around, 0.1)
    }

    #[test]
    fn the_known_part_of_the_added_mass_is_the_inertia_of_the_flow_at_the_grain() {
        let unsteady = Unsteady { added_mass: 0.5, lift: None };
        let velocity = Vec2::new(0.3, -0.1);
        // Stagnation flow, (u . grad) u = 4 x.
        let (added, force) = known(unsteady, |x| Vec2::new(2.0 * x.x, -2.0 * x.y), velocity);
        let place = Vec2::new(0.4, 0.5);
        let exact = (place * 4.0 - (Vec2::new(0.8, -1.0) - velocity) / 0.1) * 1.5;
        assert_relative_eq!(added, 1.5);
        assert_relative_eq!(force, exact, max_relative = 1e-9);
    }

    #[test]
    fn lift_pushes_a_grain_that_lags_to_where_the_flow_is_faster() {
        let unsteady = Unsteady { added_mass: 0.0, lift: Some(Lift::SaffmanMei) };
        let shear = |x: &Vec2| Vec2::new(0.5 * x.y, 0.0);
        let (_, force) = known(unsteady, shear, Vec2::new(0.15, 0.0));
        let around = Surroundings { slip: 0.1, voidage: 1.0, diameter: 0.4, density: 3.0, viscosity: 0.3 };
        let exact = Lift::SaffmanMei.coefficient(&around, 0.5) * 0.1 * 0.5;
        assert_relative_eq!(force, Vec2::new(0.0, exact), max_relative = 1e-9);
        let (_, leads) = known(unsteady, shear, Vec2::new(0.35, 0.0));
        assert_relative_eq!(leads, -force, max_relative = 1e-9);
    }
}
