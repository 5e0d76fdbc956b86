//! Laws anchored at the response of the grains: v* = w + M (f - f_k), one for momentum and one for the solid flux.
//!
//! f = gamma u - V grad p is the forcing of the fluid on a grain: its force on the grain at rest. Under a forcing f_k
//! that is known - that of the last step, or of the last iterate - the grains are moved on trial, contacts, walls and
//! implicit drag included: w = R(f_k) is their mean velocity over the step. M stands for the slope dR/df. Whatever M,
//! where the fluid answers with f_k again the law gives R(f_k), the exact coupled solution; M decides only whether and
//! how fast that is reached.
//!
//! **Which M.** Let mu = m/dt. The contacts of Moreau's step project the velocities (frictionless: an orthogonal
//! projection in the metric of mu + gamma), so R has slopes T = tau T_0 with tau between 0 (held) and 1 (free) and
//! T_0 = 1/(mu + gamma). Take M = theta T_0, with theta_m in the law of momentum and theta_c in that of the flux, and
//! A = beta dt/(eps rho_f), B = beta dt/(phi rho_p), r = (rho_f/rho_p)(phi/eps), beta the drag per volume and slip.
//!
//! *Shear*, which no pressure opposes: the fluid follows the grains by u = A/(1 + A) v, so that one iteration
//! multiplies the error by
//!
//! ```text
//!     s (tau - theta_m) / (1 - s theta_m),     s = A B / ((1 + A) (1 + B)) in [0, 1[
//! ```
//!
//! theta_m = 1 for a held grain gives -s/(1 - s), unstable for s > 1/2: fine grains in a liquid (the instability of
//! `henry`). theta_m = 0 gives s tau: stable for all grains, exact for held ones.
//!
//! *Compression*: eps u + phi v* = 0 and the momentum of the fluid give, with X = (B phi/eps^2 + r)/(1 + B) and
//! Y = (B phi/eps)/(1 + B) < X, for theta_m = 0 the factor
//!
//! ```text
//!     (X (theta_c - tau) - Y tau) / (1 + X theta_c)
//! ```
//!
//! theta_c = 0 for a free grain gives -(X + Y): unstable for light grains or stiff drag (the instability of
//! `explicit`). theta_c = 1 gives a number between -Y/(1 + X) and X/(1 + X) for every tau: stable for all grains.
//!
//! So **theta_m = 0 with theta_c = 1 is stable whatever the contacts allow**: it treats drag as if the grain were held
//! and the flux as if it were free. One law for both cannot be: shear asks for theta <= 1/2, compression for theta >=
//! 1/2. Where more is known the laws are made exact: a grain without contacts gets theta = 1 in both (then they are
//! those of `henry-free`), a grain held in all directions by a chain of contacts that reaches a wall gets theta = 0 in
//! both. No tensor is needed.
//!
//! Who is held is known only where f is close to f_k. A bed on its floor that f will lift is held in the trial under
//! f_k all the same, and theta_c = 0 then gives the -(X + Y) of free grains: it jumps, the forcing that stopped it is
//! too small, it is held by the next trial, and jumps higher. So a grain counts as held only while little is carried of
//! it beside gamma T_0 f dt, that is, while it moved in the last step as it had in the trial before.
//!
//! **Momentum.** The grains move with implicit drag, so that a contact that opens leaves no wrong velocity; they get
//! f - gamma v where the fluid expected f - gamma v*. The difference gamma (v* - v) dt is carried, and each step gives
//! the share eta of what is carried to the fluid, so nothing is lost over time. The solid flux does not contain it.
//! With theta_m = 0 shear then has the roots of
//!
//! ```text
//!     z^2 - (1 - eta) z = s tau ((1 + eta) z - 1)
//! ```
//!
//! With eta = 1 the fluid sees w extrapolated, R(2 f_k - f_(k-1)). All roots are within the unit circle, but one of
//! compression comes to -1 where tau = 1, B is large and eps = 1/2 ((2 eps - 1)^2/eps^2 is what is left), and in a
//! model of a rigid bed that leaves its floor and returns, so that tau alternates, it never settles for B of 3 to 10.
//! Hence eta = 1/2. In a part of a step that is cut it is less, the share of the part: what is carried is given back in
//! the time of whole steps, else what a long step may leave would push hard in a short one.
//!
//! **Volume.** The equation of mass has the grains elsewhere by (v* - v) dt. In one step that is little; but where it
//! is to the same side in every step, as in a bed that hovers, the fluid passes grains that are not where it made room
//! for them, and the pressure drop is that of another flow. So this distance is carried too, and v* of the flux is less
//! by the share e of it. With it compression (theta_m = 0, theta_c = 1) has the roots of
//!
//! ```text
//!     z + X (tau z + (1 - tau) (z - 1)^2 / (z - 1 + e)) + Y tau ((1 + eta) z - 1) / (z - 1 + eta) = 0
//! ```
//!
//! For held grains, tau = 0, that is (1 + X) z^2 - (1 + 2 X - e) z + X = 0. Where the fluid can go nowhere, in elements
//! full of grain, X grows without bound, and with any fixed e both roots come to 1: a flux that cannot be made up for
//! is asked for again and again, and the pressure climbs. With e = eta/(1 + X) their modulus is, from X = 1 on, the
//! root of X/(1 + X), which is the factor of the law alone. For other tau a test goes through the steps.
//!
//! **Pieces.** The fluid applies the law at each piece into which its mesh cuts a grain, so that its equations stay
//! local. A piece with more forcing than the others would give way by M times the difference, though a grain is rigid,
//! and the result would be the same whatever M only as far as the forcing is the same within a grain: beds in water
//! carried up to 2.6 % less than their drag law where most steps iterate, and came to rest looser by 3 % or not, by the
//! step. So what the law of the flux gave a piece beyond its grain in the last step is taken from it
//! ([`crate::exchange`]). The law of momentum has M = 0 where contacts act; without contacts and with one law for both
//! nothing is taken, as in `henry`.
//!
//! **Heat.** The same with temperatures: f becomes hA T, the response is that of the grains conducting through their
//! contacts. Here the slope is the inverse of a symmetric matrix with the diagonal C/dt + hA + sum H, and M is one over
//! that diagonal. It does not exceed the true diagonal of the inverse, so T* is a mean of temperatures with positive
//! weights and stays within their bounds (what is carried, bounded by the tolerance, comes on top); the iteration
//! always contracts.

use super::cut::Part;
use crate::{Carried, Interaction, Mixture};
use voidage_dem::{Bond, Bonds, Dem};
use voidage_fluid::Vector;

/// The forcing of the fluid: the force and the heat that the grains would get at rest and at zero temperature.
#[derive(Clone, Debug, Default)]
pub struct Forcing<const D: usize> {
    /// gamma u - V grad p, N.
    pub force: Vec<Vector<D>>,
    /// hA T, W; empty without heat.
    pub heat: Vec<f64>,
}

impl<const D: usize> Forcing<D> {
    /// The forcing of the fluid at the grains, with the coefficients of the present load.
    pub fn read(&mut self, mixture: &Mixture<D>) {
        let Interaction { load, at, .. } = &mixture.interaction;
        self.force.clear();
        self.force.extend((0..load.drag.len()).map(|i| load.forcing(at, i)));
        self.heat.clear();
        if let Some(heat) = &load.heat {
            self.heat.extend(heat.coefficient.iter().zip(&at.temperature).map(|(h, t)| h * t));
        }
    }
}

/// The law of the grains around their response to a forcing.
#[derive(Clone, Debug, Default)]
pub struct Anchor {
    bonds: Bonds,
}

/// theta_c of a held grain. Not zero: in an element full of grain the mobility is what couples the pressures of its
/// nodes.
const HELD: f64 = 1e-3;

/// How far a grain may have moved beside its trial, over what the forcing would move it freely, for its contacts to
/// count as holding it: a tenth of what counts as agreement of grains and fluid by default.
const CALM: f64 = 1e-2;

/// eta: the share of what is carried that the fluid gets back in a step.
pub const RETURNED: f64 = 0.5;

/// The shares theta of momentum and flux.
fn shares<const D: usize>(bond: Bond, cautious: bool) -> [f64; 2] {
    match bond.directions as usize {
        0 => [1.0, 1.0],
        held if held == D && bond.grounded && !cautious => [0.0, HELD],
        _ => [0.0, 1.0],
    }
}

/// Slope of the mean velocity over `dt` of a free grain with implicit drag, by the force, s/kg: with `count` steps of
/// h = dt/count and q = (m/h) / (m/h + gamma), the mean of (1 + q + .. + q^(k-1)) / (m/h + gamma) over the steps k.
/// Likewise the temperature by the heat, with capacity and transfer in place of mass and drag.
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

/// X: how fast a free grain would move, over the velocity of the solid flux that the fluid makes room for and pushes it
/// back with. `free` is the slope of its velocity, s/kg, `inertia` is rho_f V/dt, kg/s.
fn confinement(free: f64, drag: f64, inertia: f64, voidage: f64) -> f64 {
    free * (drag / voidage + inertia) * (1.0 - voidage) / voidage
}

/// What v* must be lower by for the fluid to give an impulse (N s) at a drag times dt of `drag` (kg):
/// f - gamma (v* - J / (gamma dt)) = f - gamma v* + J/dt.
pub fn velocity_offset<const D: usize>(impulse: Vector<D>, drag: f64) -> Vector<D> {
    if drag > 0.0 { impulse / drag } else { Vector::zeros() }
}

impl Anchor {
    /// Fills the laws of the load around the response of the grains, which have just moved under `forcing` in
    /// `substeps`. Where `cautious`, no grain counts as held. The fluid gets the share `returned` of the impulse and heat
    /// that are carried.
    pub fn fill<const D: usize>(
        &mut self,
        mixture: &mut Mixture<D>,
        forcing: &Forcing<D>,
        (part, substeps): (Part, usize),
        (cautious, returned): (bool, f64),
    ) {
        let Mixture { grains, interaction, .. } = mixture;
        grains.bonds(&mut self.bonds);
        let Part { dt, whole } = part;
        let (particles, response) = (&grains.particles, grains.mean_velocity());
        // The law of momentum is about what drag and added mass feel.
        let felt = std::mem::take(&mut interaction.felt);
        let load = &mut interaction.load;
        let none = || Carried::none(particles.len(), load.heat.is_some());
        let carried = interaction.carried.get_or_insert_with(none);
        let flux = load.continuity.get_or_insert_default();
        flux.mobility.resize(particles.len(), 0.0);
        flux.velocity.resize(particles.len(), Vector::zeros());
        let wet = interaction.wet.as_ref();
        for i in 0..particles.len() {
            let drag = load.drag[i];
            // The water of a droplet holds the grain too, and does not depend on the forcing of the gas.
            let whole_drag = drag + wet.map_or(0.0, |wet| wet.drag(i));
            let added = load.added.get(i).copied().unwrap_or(0.0);
            let free = match particles.held(i) {
                true => 0.0,
                false => slope(particles.mass[i] + added, whole_drag - added / dt, dt, substeps),
            };
            let agreed = carried.impulse[i].norm() <= CALM * free * drag * forcing.force[i].norm() * dt;
            let [momentum, mass] =
                shares::<D>(self.bonds.of(i), cautious || !agreed).map(|share| share * free);
            let around =
                |response: Vector<D>, mobility: f64| (mobility, response - forcing.force[i] * mobility);
            (flux.mobility[i], flux.velocity[i]) = around(response[i], mass);
            (load.mobility[i], load.velocity[i]) = around(*felt.get(i).unwrap_or(&response[i]), momentum);
            load.velocity[i] -= velocity_offset(carried.impulse[i] * returned, drag * whole);
            let inertia = interaction.laws.density * load.volume[i] / dt;
            let confined = confinement(free, drag, inertia, interaction.voidage[i]);
            flux.velocity[i] -= carried.displacement[i] * (RETURNED / (1.0 + confined) / whole);
        }
        interaction.felt = felt;
        self.fill_heat(grains, interaction, forcing, (part, substeps), returned);
        let Interaction { wet, load, .. } = interaction;
        if let Some(wet) = wet {
            let (velocity, temperature) = (grains.mean_velocity(), grains.mean_temperature());
            wet.set_law(|i, _, _| {
                (velocity[i], load.mobility[i], temperature.get(i).copied().unwrap_or_default())
            });
        }
    }

    fn fill_heat<const D: usize>(
        &self,
        grains: &Dem<D>,
        interaction: &mut Interaction<D>,
        forcing: &Forcing<D>,
        (Part { dt, whole }, substeps): (Part, usize),
        returned: f64,
    ) {
        let Interaction { load, carried, wet, .. } = interaction;
        let (Some(law), Some(heat)) = (&mut load.heat, &grains.particles.heat) else { return };
        let Some(carried) = carried else { return };
        let response = grains.mean_temperature();
        let mut conductance = grains.conductance();
        for i in 0..response.len() {
            let in_water = wet.as_ref().map_or(0.0, |wet| wet.transfer(i));
            let (capacity, transfer) = (heat.capacity[i], law.coefficient[i] + in_water);
            let inertia = capacity * substeps as f64 / dt + transfer;
            let contacts = conductance.next().unwrap_or(0.0);
            let mobility = inertia / (inertia + contacts) * slope(capacity, transfer, dt, substeps);
            let offset = law.temperature_offset(carried.heat[i] * returned, whole, i);
            (law.mobility[i], law.temperature[i]) =
                (mobility, response[i] - mobility * forcing.heat[i] - offset);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn compression_dies_out_whatever_the_contacts_allow() {
        compress(1.0);
    }

    #[test]
    fn compression_dies_out_in_parts_of_steps_too() {
        compress(0.125);
    }

    /// Steps of a mixture that is compressed, as in the derivation above, each a `part` of those in whose time what is
    /// carried is given back: f' = -X v*_c - Y v*_m in units of T_0.
    fn compress(part: f64) {
        let returned = RETURNED * part;
        for (voidage, density) in product(&[0.03, 0.1, 0.35, 0.5, 0.8, 0.99], &[1e-3, 0.1, 0.9, 2.0]) {
            for (b, tau) in product(&[1e-2, 1.0, 3.0, 10.0, 1e2, 1e5], &[0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0]) {
                let x = confinement(1.0 / (1.0 + b), b, density, voidage);
                let y = b * (1.0 - voidage) / voidage / (1.0 + b);
                let (mut forcing, mut impulse, mut distance) = (1.0, 1.0, 1.0);
                for _ in 0..(60.0 * (1.0 + x) / part) as usize {
                    let momentum = tau * forcing - returned * impulse;
                    let around = (tau - 1.0) * forcing - returned / (1.0 + x) * distance;
                    let answer = -(x * around + y * momentum) / (1.0 + x);
                    impulse += momentum - tau * answer;
                    distance += around + answer - tau * answer;
                    forcing = answer;
                }
                let left = forcing.abs() + impulse.abs() + distance.abs();
                assert!(
                    left < 1e-9 * (1.0 + x),
                    "voidage {voidage}, density {density}, B {b}, tau {tau}: {left}"
                );
            }
        }
    }

    fn product(a: &[f64], b: &[f64]) -> Vec<(f64, f64)> {
        a.iter().flat_map(|&a| b.iter().map(move |&b| (a, b))).collect()
    }

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
