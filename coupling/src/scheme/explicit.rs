//! Drag implicit in the fluid velocity only (A.16): a = 0, b = v_n.
//!
//! In a closed box, r = (rho_f/rho_p)(phi/eps) and K = beta dt/(eps phi rho_p), stable iff r < 1 and
//! K < 2 eps (1 - r); of slip without constraint, stable iff B < 2 + A with A = beta dt/(eps rho_f), B = beta dt/(phi
//! rho_p).

use super::cut::{Part, Trial};
use super::once;
use crate::droplet::wet::Stream;
use crate::{Agreement, Interaction, Mixture, StepReport, error::Result};
use voidage_dem::Dem;
use voidage_fluid::Vector;

/// The explicit scheme.
pub struct Explicit;

impl<const D: usize> Trial<D> for Explicit {
    fn solve(
        &mut self,
        mixture: &mut Mixture<D>,
        Part { dt, .. }: Part,
        report: &mut StepReport,
    ) -> Result<Agreement> {
        once(mixture, dt, report, |grains, interaction, stream| {
            expect(grains, interaction, stream, dt);
        })
    }
}

/// Fills the laws of grains that keep their velocity and temperature.
pub(super) fn expect<const D: usize>(
    grains: &Dem<D>,
    interaction: &mut Interaction<D>,
    stream: Option<Stream<D>>,
    dt: f64,
) {
    freeze(grains, &mut interaction.load.mobility, &mut interaction.load.velocity);
    freeze_heat(grains, interaction);
    expect_in_water(grains, interaction, stream, dt);
}

/// The law of grains that keep their velocity.
pub(super) fn freeze<const D: usize>(
    grains: &Dem<D>,
    mobility: &mut Vec<f64>,
    velocity: &mut Vec<Vector<D>>,
) {
    mobility.clear();
    mobility.resize(grains.particles.len(), 0.0);
    velocity.clone_from(&grains.particles.velocity);
}

/// The water of a droplet drags and heats implicitly, in the motion of the grains; what the droplet expects of them
/// follows that.
fn expect_in_water<const D: usize>(
    grains: &Dem<D>,
    interaction: &mut Interaction<D>,
    stream: Option<Stream<D>>,
    dt: f64,
) {
    let (Some(wet), Some(stream)) = (&mut interaction.wet, stream) else { return };
    let particles = &grains.particles;
    wet.set_law(|i, drag, transfer| {
        let inertia = particles.mass[i] / dt;
        let mobility = if particles.held(i) { 0.0 } else { 1.0 / (inertia + drag) };
        let moves = (stream.velocity - particles.velocity[i]) * (mobility * drag);
        let warmed = particles.heat.as_ref().map_or(0.0, |heat| {
            let inertia = heat.capacity[i] / dt;
            (inertia * heat.temperature[i] + transfer * stream.temperature) / (inertia + transfer)
        });
        (particles.velocity[i] + moves, mobility, warmed)
    });
}

fn freeze_heat<const D: usize>(grains: &Dem<D>, interaction: &mut Interaction<D>) {
    let (Some(law), Some(heat)) = (&mut interaction.load.heat, &grains.particles.heat) else { return };
    law.mobility.fill(0.0);
    law.temperature.copy_from_slice(&heat.temperature);
}
