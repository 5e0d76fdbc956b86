//! Sums over the pieces of the bodies, of a state of the fluid.

use crate::Vector;
use crate::exchange::{Exchange, LASTING, VelocityLaw, at_piece};
use crate::flow::State;
use crate::geometry::Geometry;

/// Voidage of an element full of body as a weight, so that a body all in such elements has a mean.
const LEAST: f64 = 1e-12;

/// Bodies in a state of the fluid; `B` is `D + 1`.
pub(crate) struct Sums<'a, const D: usize, const B: usize> {
    pub geometry: &'a Geometry<D, B>,
    pub state: &'a State<D>,
    pub load: &'a Exchange<'a, D>,
}

impl<const D: usize, const B: usize> Sums<'_, D, B> {
    /// Velocity and pressure gradient at a piece.
    fn at(&self, piece: usize) -> (Vector<D>, Vector<D>) {
        let phi = self.load.pieces.shape::<B>(piece);
        let cell = self.load.pieces.cell[piece] as usize;
        let (mut velocity, mut slope) = (Vector::<D>::zeros(), Vector::<D>::zeros());
        for (a, node) in self.geometry.nodes(cell).into_iter().enumerate() {
            velocity += self.state.velocity[node] * phi[a];
            slope += self.geometry.gradient[cell * B + a] * self.state.pressure[node];
        }
        (velocity, slope)
    }

    fn temperature_at(&self, piece: usize) -> f64 {
        let Some(temperature) = &self.state.temperature else { return 0.0 };
        let phi = self.load.pieces.shape::<B>(piece);
        let nodes = self.geometry.nodes(self.load.pieces.cell[piece] as usize);
        (0..B).map(|a| temperature[nodes[a]] * phi[a]).sum()
    }

    /// Force (N) and heat (W) that the fluid gives to the bodies.
    pub fn exchanged(&self) -> (Vector<D>, f64) {
        let load = self.load;
        let (mut force, mut heat) = (Vector::zeros(), 0.0);
        for body in 0..load.pieces.bodies() {
            let (gamma, volume, mobility) = (load.drag[body], load.volume[body], load.mobility[body]);
            for piece in load.pieces.of(body) {
                let (velocity, slope) = self.at(piece);
                let share = load.pieces.share[piece];
                let slip =
                    velocity * (1.0 - mobility * gamma) - load.velocity[body] + slope * (mobility * volume);
                force += (slip * gamma - slope * volume) * share;
                if let Some(columns) = &load.heat {
                    let coefficient = columns.coefficient[body];
                    let slip = self.temperature_at(piece) * (1.0 - columns.mobility[body] * coefficient)
                        - columns.temperature[body];
                    heat += share * coefficient * slip;
                }
            }
        }
        (force, heat)
    }

    /// drag u - volume grad p at a piece of a body, N.
    fn push(&self, piece: usize, body: usize) -> Vector<D> {
        let (velocity, slope) = self.at(piece);
        velocity * self.load.drag[body] - slope * self.load.volume[body]
    }

    /// The constant part of a law of the solid flux at each piece, in a step of `dt` of a fluid of `density` ([`VelocityLaw`]), m/s.
    pub fn rigid(
        &self,
        law: &VelocityLaw<'_, D>,
        (voidage, density, dt): (&[f64], f64, f64),
        at_pieces: &mut Vec<Vector<D>>,
    ) {
        let load = self.load;
        at_pieces.clear();
        at_pieces.reserve_exact(load.pieces.len());
        for body in 0..load.pieces.bodies() {
            let (mobility, velocity) = (law.mobility[body], law.velocity[body]);
            let here = load.pieces.of(body);
            if mobility == 0.0 {
                at_pieces.extend(here.map(|_| velocity));
                continue;
            }
            let inertia = density * load.volume[body] / dt;
            let share = |piece| {
                let eps = at_piece(&self.geometry.mesh, load.pieces, piece, voidage).max(LEAST);
                let lasting = mobility * (load.drag[body] + eps * inertia) * (1.0 - eps) / LASTING;
                eps * eps / (eps * eps + lasting)
            };
            let (mut sum, mut weight) = (Vector::zeros(), 0.0);
            for piece in here.clone() {
                let push = self.push(piece, body);
                let part = share(piece) * load.pieces.share[piece];
                sum += push * part;
                weight += part;
                at_pieces.push(push);
            }
            let mean = sum / weight;
            for piece in here {
                at_pieces[piece] = velocity - (at_pieces[piece] - mean) * (mobility * share(piece));
            }
        }
    }

    /// Nodal projection (A.15) of the solid flux phi v, with v the law of the bodies in the equation of mass, and its constant part at the
    /// pieces where it is not that of the bodies.
    pub fn solid_flux(&self, at_pieces: Option<&[Vector<D>]>, flux: &mut [Vector<D>]) {
        let load = self.load;
        let law = load.continuity();
        for body in 0..load.pieces.bodies() {
            for piece in load.pieces.of(body) {
                let moved = at_pieces.map_or(law.velocity[body], |b| b[piece])
                    + self.push(piece, body) * law.mobility[body];
                let volume = load.pieces.share[piece] * load.volume[body];
                let phi = load.pieces.shape::<B>(piece);
                let nodes = self.geometry.nodes(load.pieces.cell[piece] as usize);
                for a in 0..B {
                    flux[nodes[a]] += moved * (volume * phi[a] / self.geometry.nodal_volume[nodes[a]]);
                }
            }
        }
    }
}
