//! The law anchored at the response of the grains: v* = w + M (f - f_k).
//!
//! f = gamma u - V grad p is what the fluid pushes a grain with. Under a push f_k that is known - that of the last step, or of
//! the last iterate - the grains are moved on trial, contacts, walls and implicit drag included: w = R(f_k) is their
//! mean velocity over the step. M stands for the slope dR/df. Whatever M, where the fluid answers with f_k again the law gives
//! R(f_k), the exact coupled solution; M decides only how fast that is reached.
//!
//! **Which M.** Let mu = m/dt. The contacts of Moreau's step project the velocities (frictionless: an orthogonal
//! projection in the metric of mu + gamma), so R has slopes T between 0 (held) and T_0 = 1/(mu + gamma) (free). The fluid
//! answers to velocities v with f = (gamma - H) v + const, where H >= 0 is the force that it resists with (drag against the
//! fluid that is not carried along, added mass). With s = (gamma - H)/(mu + gamma) < 1 and M = theta T_0, T = tau T_0, one
//! iteration multiplies the error by
//!
//! ```text
//!     s (tau - theta) / (1 - s theta)
//! ```
//!
//! - theta = tau is exact in one iteration: a free grain with theta = 1 (then the law is that of `henry-free`), a grain that
//!   is held fast with theta = 0;
//! - theta = 1 for a held grain gives -s / (1 - s): unstable for s > 1/2, fine grains that a liquid follows
//!   (this is the instability of `henry`);
//! - theta = 0 for a free grain gives s: unstable for s < -1, light grains in a liquid (the instability of `explicit`);
//! - **theta = 1/2 gives at most |s / (2 - s)| < 1 for every tau in \[0, 1\] and every fluid.** In terms of operators: R is
//!   T_0 times a firmly non-expansive map, so 2 R / T_0 - 1 is non-expansive, and H monotone makes the other factor
//!   a contraction. That is why no tensor is needed: where it is not known what the contacts allow, one half is safe.
//!
//! So a grain without contacts has theta = 1; a grain held in all directions by a chain of contacts that reaches
//! a wall has theta = 0; all others, clusters in the air (which move freely as a whole, but not inside) and grains with
//! a direction left open, have 1/2.
//!
//! **Momentum.** The grains move with implicit drag, so that a contact that opens leaves no wrong velocity; they get
//! f - gamma w' where the fluid expected f - gamma v*. The difference gamma (v* - w') dt is carried to the next
//! step and given to the fluid there, so nothing is lost over time. The solid flux in the equation of mass does not contain it:
//! that is the second law of the load ([`crate::backend::GrainLoad::continuity`]).
//!
//! **Heat.** The same with temperatures: f becomes hA T, the response is that of the grains conducting through their
//! contacts. Here the slope is the inverse of a symmetric matrix with the diagonal C/dt + hA + sum H, and M is one over
//! that diagonal. It does not exceed the true diagonal of the inverse, so T* is a mean of temperatures with positive weights
//! and stays within their bounds; the iteration always contracts (physics.md, section 5, leaves this case open).

use crate::{Coupled, Interaction};
use voidage_dem::{Bond, Bonds, Dem};
use voidage_fluid::Vector;

/// What the fluid pushes and heats the grains with, apart from what they do themselves.
#[derive(Clone, Debug, Default)]
pub struct Push<const D: usize> {
    /// gamma u - V grad p, N.
    pub force: Vec<Vector<D>>,
    /// hA T, W; empty without heat.
    pub heat: Vec<f64>,
}

impl<const D: usize> Push<D> {
    /// The push of the fluid at the grains, with the coefficients of the present load.
    pub fn read(&mut self, coupled: &Coupled<D>) {
        let Some(Interaction { load, at, .. }) = &coupled.interaction else { return };
        self.force.clear();
        self.force.extend((0..load.drag.len()).map(|i| load.push(at, i)));
        self.heat.clear();
        if let Some(heat) = &load.heat {
            self.heat.extend(heat.coefficient.iter().zip(&at.temperature).map(|(h, t)| h * t));
        }
    }
}

/// The law of the grains around their response to a push.
#[derive(Clone, Debug, Default)]
pub struct Anchor {
    bonds: Bonds,
}

/// theta where all directions are held. Not zero: in an element full of grain the mobility is what couples the pressures
/// of its nodes.
const HELD: f64 = 1e-3;

/// theta that is safe whatever the contacts allow.
const SAFE: f64 = 0.5;

/// Share theta of the mobility of a free grain.
fn share<const D: usize>(bond: Bond, cautious: bool) -> f64 {
    match bond.directions as usize {
        0 => 1.0,
        held if held == D && bond.grounded && !cautious => HELD,
        _ => SAFE,
    }
}

/// Slope of the mean velocity over `dt` of a free grain with implicit drag, by the force, s/kg: with `count` steps of
/// h = dt/count and q = (m/h) / (m/h + gamma), the mean of (1 + q + .. + q^(k-1)) / (m/h + gamma) over the steps k. Likewise the
/// temperature by the heat, with capacity and transfer in place of mass and drag.
pub fn slope(mass: f64, drag: f64, dt: f64, count: usize) -> f64 {
    let inertia = mass * count as f64 / dt;
    let ratio = inertia / (inertia + drag);
    let (mut power, mut sum) = (1.0, 0.0);
    for k in 0..count {
        sum += (count - k) as f64 * power;
        power *= ratio;
    }
    sum / (count as f64 * (inertia + drag))
}

impl Anchor {
    /// Fills the laws of the load around the response of the grains, which have just moved under `push` in `substeps`. Where
    /// `cautious`, no grain counts as held.
    pub fn fill<const D: usize>(
        &mut self,
        coupled: &mut Coupled<D>,
        push: &Push<D>,
        (dt, substeps): (f64, usize),
        cautious: bool,
    ) {
        let (Some(grains), Some(interaction)) = (&coupled.grains, &mut coupled.interaction) else { return };
        grains.bonds(&mut self.bonds);
        let (particles, response) = (&grains.particles, grains.mean_velocity());
        let carried = interaction.carried.get_or_insert_with(|| crate::Carried::none(particles.len()));
        let load = &mut interaction.load;
        let flux = load.continuity.get_or_insert_default();
        flux.mobility.resize(particles.len(), 0.0);
        flux.velocity.resize(particles.len(), Vector::zeros());
        for i in 0..particles.len() {
            let drag = load.drag[i];
            let mobility = match particles.held(i) {
                true => 0.0,
                false => {
                    share::<D>(self.bonds.of(i), cautious) * slope(particles.mass[i], drag, dt, substeps)
                }
            };
            let velocity = response[i] - push.force[i] * mobility;
            (flux.mobility[i], flux.velocity[i]) = (mobility, velocity);
            // f - gamma (v* - c / (gamma dt)): the fluid makes up for the impulse c.
            let owed = if drag > 0.0 { carried.impulse[i] / (drag * dt) } else { Vector::zeros() };
            (load.mobility[i], load.velocity[i]) = (mobility, velocity - owed);
        }
        self.fill_heat(grains, interaction, push, (dt, substeps));
    }

    fn fill_heat<const D: usize>(
        &self,
        grains: &Dem<D>,
        interaction: &mut Interaction<D>,
        push: &Push<D>,
        (dt, substeps): (f64, usize),
    ) {
        let (Some(law), Some(heat)) = (&mut interaction.load.heat, &grains.particles.heat) else { return };
        let Some(carried) = &interaction.carried else { return };
        let response = grains.mean_temperature();
        let mut conductance = grains.conductance();
        for i in 0..response.len() {
            let (capacity, transfer) = (heat.capacity[i], law.coefficient[i]);
            let inertia = capacity * substeps as f64 / dt + transfer;
            let contacts = conductance.next().unwrap_or(0.0);
            let mobility = inertia / (inertia + contacts) * slope(capacity, transfer, dt, substeps);
            let owed = law.owed(carried.heat[i], dt, i);
            (law.mobility[i], law.temperature[i]) = (mobility, response[i] - mobility * push.heat[i] - owed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Against the recursion v_k = (m/h v_(k-1) + F) / (m/h + gamma) itself.
    #[test]
    fn slope_is_that_of_the_recursion() {
        for (mass, drag, dt, count) in
            [(2.0, 3.0, 0.1, 1), (2.0, 3.0, 0.7, 5), (1.0, 0.0, 0.5, 4), (1e-9, 1.0, 1.0, 7)]
        {
            let h = dt / count as f64;
            let (mut v, mut sum) = (0.0, 0.0);
            for _ in 0..count {
                v = (mass / h * v + 1.0) / (mass / h + drag);
                sum += v;
            }
            assert_relative_eq!(slope(mass, drag, dt, count), sum / count as f64, max_relative = 1e-14);
        }
    }
}
