//! Boundary integrals of the weak forms and the conditions that replace equations.

use crate::assembly::System;
use crate::conditions::{Condition, Constraint, FlowCondition, ScalarCondition, facets};
use crate::element::{facet_normal, facet_rule};
use crate::geometry::Geometry;
use crate::{Error, Mesh, Result, Vector};

/// Geometry and rule of one facet.
pub(crate) struct Facet<'a, const D: usize> {
    pub nodes: &'a [u32],
    /// Those of which each node has the values.
    masters: [u32; D],
    pub measure: f64,
    pub normal: Vector<D>,
}

impl<'a, const D: usize> Facet<'a, D> {
    pub fn new(mesh: &Mesh<D>, nodes: &'a [u32]) -> Self {
        let corner: [Vector<D>; D] = std::array::from_fn(|k| mesh.points[nodes[k] as usize]);
        let (measure, normal) = facet_normal(&corner);
        let masters = std::array::from_fn(|k| mesh.periodic.master(nodes[k]));
        Self { nodes, masters, measure, normal }
    }

    /// Calls `f(a, b, integral of w phi_a phi_b)` for all pairs of nodes (their masters), w given at the quadrature
    /// points by the shape functions there.
    fn mass(&self, weight: impl Fn(&[f64; 3]) -> f64, mut f: impl FnMut(u32, u32, f64)) {
        for a in 0..D {
            for b in 0..D {
                let sum: f64 =
                    facet_rule::<D>().iter().map(|(phi, share)| share * phi[a] * phi[b] * weight(phi)).sum();
                f(self.masters[a], self.masters[b], self.measure * sum);
            }
        }
    }

    /// Calls `f(node, integral of w phi)` for all nodes (their masters), w given as in [`Self::mass`].
    pub fn load(&self, weight: impl Fn(&[f64; 3]) -> f64, mut f: impl FnMut(u32, f64)) {
        for a in 0..D {
            let sum: f64 = facet_rule::<D>().iter().map(|(phi, share)| share * phi[a] * weight(phi)).sum();
            f(self.masters[a], self.measure * sum);
        }
    }

    /// min(wind . n, 0) at a quadrature point: what enters.
    pub fn inflow(&self, phi: &[f64; 3], wind: impl Fn(usize) -> Vector<D>) -> f64 {
        self.at(phi, |node| wind(node).dot(&self.normal)).min(0.0)
    }

    /// Value at a quadrature point of a nodal quantity.
    pub fn at(&self, phi: &[f64; 3], value: impl Fn(usize) -> f64) -> f64 {
        (0..D).map(|a| phi[a] * value(self.nodes[a] as usize)).sum()
    }
}

/// The boundary in one step.
pub struct BoundaryTerms<'a, const D: usize, const B: usize> {
    /// The mesh.
    pub geometry: &'a Geometry<D, B>,
    /// Its conditions.
    pub conditions: &'a [Condition<D>],
    /// Nodal voidage.
    pub voidage: &'a [f64],
}

/// What passes the boundary as far as it is prescribed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Through {
    /// Fluid that leaves, and solid that moves with walls, less what enters, m3/s (m2/s in the plane).
    pub net: f64,
    /// What it would be if all went outward.
    pub gross: f64,
}

impl<const D: usize, const B: usize> BoundaryTerms<'_, D, B> {
    /// Adds to the flow equations <<eps u . n, q>> of every facet, and of open ones
    /// <<p_out n, v>> - <<eps rho min((u_n - u_mesh) . n, 0) u, v>>.
    ///
    /// Through all others passes what the scene says, facet by facet, and goes to the right: the velocity of the
    /// condition of the facet, not those of its nodes, which at the end of a part belong to a neighbour. So the flux
    /// through a part depends neither on the mesh nor on the order of the conditions, no fluid is lost through a wall,
    /// and the equations of mass in a closed domain add up to what is prescribed. Of a moving wall the whole mixture
    /// moves on, <<u_mesh . n, q>>, the solid as well as the fluid.
    pub fn add_flow(&self, density: f64, velocity: &[Vector<D>], system: &mut System<B>) -> Through {
        let mut through = Through::default();
        for condition in self.conditions {
            for nodes in facets(&self.geometry.mesh, &condition.boundary) {
                let facet = Facet::new(&self.geometry.mesh, nodes);
                let voidage = |phi: &[f64; 3]| facet.at(phi, |node| self.voidage[node]);
                let mut add = |share: &dyn Fn(&[f64; 3]) -> f64, value: &dyn Fn(usize) -> Vector<D>| {
                    add_known(&facet, share, value, &mut through, system);
                };
                match &condition.flow {
                    FlowCondition::Open { pressure } => {
                        self.add_open(&facet, *pressure, density, velocity, system);
                    }
                    FlowCondition::Velocity(value) => add(&voidage, &|node| value.at(node)),
                    FlowCondition::SuperficialVelocity(value) => add(&|_| 1.0, &|node| value.at(node)),
                    FlowCondition::NoSlip | FlowCondition::Slip => {
                        if let Some(moving) = self.geometry.motion() {
                            add(&|_| 1.0, &|node| moving[node]);
                        }
                    }
                    // [`crate::body`] adds what passes bodies.
                    FlowCondition::Body(_) => {}
                }
            }
        }
        through
    }

    fn add_open(
        &self,
        facet: &Facet<'_, D>,
        pressure: f64,
        density: f64,
        velocity: &[Vector<D>],
        system: &mut System<B>,
    ) {
        for &node in &facet.masters {
            for i in 0..D {
                system.rhs[B * node as usize + i] -= pressure * facet.normal[i] * facet.measure / D as f64;
            }
        }
        let voidage = |phi: &[f64; 3]| facet.at(phi, |node| self.voidage[node]);
        facet.mass(voidage, |row, column, integral| {
            if let Some(block) = system.block(row, column) {
                for j in 0..D {
                    block[D][j] += integral * facet.normal[j];
                }
            }
        });
        let wind = |node: usize| velocity[node] - self.geometry.velocity_of(node);
        let taken = |phi: &[f64; 3]| -density * facet.inflow(phi, wind) * voidage(phi);
        facet.mass(taken, |row, column, integral| {
            if let Some(block) = system.block(row, column) {
                for (i, line) in block.iter_mut().enumerate().take(D) {
                    line[i] += integral;
                }
            }
        });
    }
}

/// Takes <<share value . n, q>> of a facet to the right of the equations of mass.
fn add_known<const D: usize, const B: usize>(
    facet: &Facet<'_, D>,
    share: &dyn Fn(&[f64; 3]) -> f64,
    value: &dyn Fn(usize) -> Vector<D>,
    through: &mut Through,
    system: &mut System<B>,
) {
    facet.mass(share, |row, column, integral| {
        let flux = value(column as usize) * integral;
        system.rhs[B * row as usize + D] -= flux.dot(&facet.normal);
        through.net += flux.dot(&facet.normal);
        through.gross += flux.norm();
    });
}

/// Puts the velocity conditions into the momentum equations: rows of fixed nodes become u = value; where only
/// normals n are held, the rows are projected on the tangents and n n^T u = n n^T u_wall is added.
pub fn apply_constraints<const D: usize, const B: usize>(
    constraints: &[Option<Constraint<D>>],
    system: &mut System<B>,
) {
    for (node, constraint) in constraints.iter().enumerate() {
        match constraint {
            None => {}
            Some(Constraint::Fixed(value)) => (0..D).for_each(|i| system.prescribe(node, i, value[i])),
            Some(Constraint::Normal { normals, wall }) => constrain_normals(normals, wall, node, system),
        }
    }
}

fn constrain_normals<const D: usize, const B: usize>(
    normals: &[Vector<D>],
    wall: &Vector<D>,
    node: usize,
    system: &mut System<B>,
) {
    let (row, diagonal) = system.row(node);
    let Some(diagonal) = diagonal else { return };
    let scale = (0..D).map(|i| row[diagonal][i][i].abs()).fold(f64::MIN_POSITIVE, f64::max);
    for normal in normals {
        for block in row.iter_mut() {
            for j in 0..B {
                let along: f64 = (0..D).map(|i| normal[i] * block[i][j]).sum();
                (0..D).for_each(|i| block[i][j] -= normal[i] * along);
            }
        }
    }
    for normal in normals {
        for i in 0..D {
            for j in 0..D {
                row[diagonal][i][j] += scale * normal[i] * normal[j];
            }
        }
    }
    let rhs = &mut system.rhs[B * node..B * node + D];
    for normal in normals {
        let along: f64 = (0..D).map(|i| normal[i] * rhs[i]).sum();
        (0..D).for_each(|i| rhs[i] -= normal[i] * along);
    }
    for normal in normals {
        let along = scale * normal.dot(wall);
        (0..D).for_each(|i| rhs[i] += normal[i] * along);
    }
}

/// In a closed domain nothing sets the level of the pressure, and the equations of mass add up to a condition on what
/// is prescribed: what passes `through` the boundary, and sources. What the right-hand sides lack of it, round-off and
/// the error of sums for integrals, is spread evenly over the domain as by a Lagrange multiplier of the mean pressure.
/// The equation of the first node then follows from the others, and its pressure can be held in its place (the caller
/// moves the mean to zero).
///
/// # Errors
/// The velocities prescribed do not balance.
pub fn close<const D: usize, const B: usize>(
    through: &Through,
    geometry: &Geometry<D, B>,
    system: &mut System<B>,
) -> Result<()> {
    let Through { net, gross } = *through;
    if net.abs() > 1e-9 * gross {
        return Err(Error::Mesh(format!(
            "no boundary is open, but the prescribed velocities let {net:.3e} more fluid out than in; open one"
        )));
    }
    spread(geometry, &mut system.rhs);
    system.prescribe(0, D, 0.0);
    Ok(())
}

/// Makes the right-hand sides of the equations of mass add up to zero, and holds the pressure of the first node there.
pub(crate) fn spread<const D: usize, const B: usize>(geometry: &Geometry<D, B>, rhs: &mut [f64]) {
    let excess = rhs.iter().skip(D).step_by(B).sum::<f64>() / geometry.volume();
    for (node, volume) in geometry.nodal_volume.iter().enumerate() {
        rhs[B * node + D] -= excess * volume;
    }
    rhs[D] = 0.0;
}

/// Adds to the equation of scalar `k` what its boundaries exchange, <<h s, S>> = <<h s_out, S>>, and the inflow term of
/// boundaries through which fluid may enter, -<<eps C min(wind . n, 0) (s - s_out), S>>; `wind` is u_n - u_mesh at a
/// node.
pub fn add_scalar<const D: usize>(
    mesh: &Mesh<D>,
    conditions: &[Condition<D>],
    (k, capacity): (usize, f64),
    voidage: &[f64],
    wind: impl Fn(usize) -> Vector<D>,
    system: &mut System<1>,
) {
    for condition in conditions {
        for nodes in facets(mesh, &condition.boundary) {
            let facet = Facet::new(mesh, nodes);
            let mut add = |outside: f64, weight: &dyn Fn(&[f64; 3]) -> f64| {
                facet.mass(weight, |row, column, integral| {
                    system.rhs[row as usize] += integral * outside;
                    if let Some(block) = system.block(row, column) {
                        block[0][0] += integral;
                    }
                });
            };
            match condition.scalar(k) {
                ScalarCondition::Transfer { coefficient, outside } => add(*outside, &|_| *coefficient),
                ScalarCondition::Outflow { outside: Some(outside) } => add(*outside, &|phi| {
                    -capacity * facet.inflow(phi, &wind) * facet.at(phi, |node| voidage[node])
                }),
                _ => {}
            }
        }
    }
}

/// Gives the images of nodes, which no cell adds to, equations of their own: their unknowns are zero until they get the
/// values of their masters.
pub fn hold_images<const D: usize, const K: usize>(mesh: &Mesh<D>, system: &mut System<K>) {
    for [image, _] in mesh.periodic.images() {
        (0..K).for_each(|equation| system.prescribe(*image as usize, equation, 0.0));
    }
}

/// Puts prescribed values into the equation of scalar `k`, in the order of the scene.
pub fn apply_values<const D: usize>(
    mesh: &Mesh<D>,
    conditions: &[Condition<D>],
    k: usize,
    system: &mut System<1>,
) {
    for condition in conditions {
        if let ScalarCondition::Value(value) = condition.scalar(k) {
            for nodes in facets(mesh, &condition.boundary) {
                let masters = nodes.iter().map(|&node| mesh.periodic.master(node) as usize);
                masters.for_each(|node| system.prescribe(node, 0, value.at(node)));
            }
        }
    }
}
