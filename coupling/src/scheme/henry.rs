//! Predicted velocity of Henry et al. (A.18, A.19): a = 1 / (m/dt + gamma), b = a (m/dt v_n + m g + F_c), with the
//! contact force F_c of the last step as printed, or without (`henry-free`).
//!
//! Both are exact for free grains. For a bed at rest on its floor, D the true pressure gradient, W its weight and
//! kappa = beta dt / (eps^2 phi rho_p), `henry-free` gives (D + kappa W) / (1 + kappa). `henry` gives D, but damps
//! shear in the held bed explicitly, by (1 + B - A B) / (1 + A + B): unstable when A (B - 1) > 2 (1 + B), which fine
//! grains in a liquid reach. There A = beta dt/(eps rho_f), B = beta dt/(phi rho_p), beta the drag per volume and slip.

use super::cut::{Part, Trial};
use super::once;
use crate::droplet::wet::Stream;
use crate::{Agreement, Interaction, Mixture, StepReport, error::Result};
use voidage_dem::Dem;
use voidage_fluid::Vector;

/// The predicted velocity.
pub struct Henry {
    /// Whether the contact force of the last step is part of it.
    pub contacts: bool,
}

impl<const D: usize> Trial<D> for Henry {
    fn solve(
        &mut self,
        mixture: &mut Mixture<D>,
        Part { dt, .. }: Part,
        report: &mut StepReport,
    ) -> Result<Agreement> {
        once(mixture, dt, report, |grains, interaction, stream| {
            predict(grains, interaction, self.contacts, dt, stream);
        })
    }
}

/// Fills the laws of velocity and temperature with the motion of free grains.
pub(super) fn predict<const D: usize>(
    grains: &Dem<D>,
    interaction: &mut Interaction<D>,
    contacts: bool,
    dt: f64,
    stream: Option<Stream<D>>,
) {
    let (particles, gravity) = (&grains.particles, grains.settings().gravity);
    let Interaction { load, wet, at, .. } = interaction;
    let water = wet.as_ref().zip(stream.as_ref());
    for i in 0..particles.len() {
        // A held grain (infinite mass) keeps its velocity whatever the fluid does.
        (load.mobility[i], load.velocity[i]) = if particles.held(i) {
            (0.0, particles.velocity[i])
        } else {
            let inertia = particles.mass[i] / dt;
            let (in_water, push) =
                water.map_or((0.0, Vector::zeros()), |(wet, stream)| (wet.drag(i), wet.push(i, stream)));
            let mobility = 1.0 / (inertia + load.drag[i] + in_water);
            let force = if contacts { grains.contact_force()[i] } else { Vector::zeros() };
            let total = particles.velocity[i] * inertia + gravity * particles.mass[i] + force + push;
            (mobility, total * mobility)
        };
    }
    if let (Some(law), Some(heat)) = (&mut load.heat, &particles.heat) {
        for i in 0..particles.len() {
            let inertia = heat.capacity[i] / dt;
            let conducted = grains.contact_heat().get(i).copied().unwrap_or(0.0);
            let (in_water, warmth) = water
                .map_or((0.0, 0.0), |(wet, stream)| (wet.transfer(i), wet.transfer(i) * stream.temperature));
            law.mobility[i] = 1.0 / (inertia + law.coefficient[i] + in_water);
            law.temperature[i] = law.mobility[i] * (inertia * heat.temperature[i] + conducted + warmth);
        }
    }
    if let Some(wet) = wet {
        let temperature = |i| load.heat.as_ref().map_or(0.0, |law| law.expected(at, i));
        wet.set_law(|i, _, _| (load.expected(at, i), load.mobility[i], temperature(i)));
    }
}
