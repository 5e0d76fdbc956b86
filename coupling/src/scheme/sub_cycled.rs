//! Sub-cycling, which most codes of soft grains do: the fluid takes one step with the grains as they are, then the grains
//! take N steps in the fluid as it is then, each with the drag at their velocity in it.
//!
//! With A = beta dt/(eps rho_f), B = beta dt/(phi rho_p) and r = (rho_f/rho_p)(phi/eps), beta the drag per volume and
//! slip, a grain forgets its velocity by Q = q^N, q = 1/(1 + B/N) with implicit drag and 1 - B/N with explicit drag,
//! and its mean velocity over the step is P = (1 - Q)/B of the first and 1 - P of the one that it tends to.
//!
//! *Slip without constraint*: u' = (u + A v)/(1 + A) and v' = Q v + (1 - Q) u', so that v - u is multiplied by
//! Q/(1 + A) in a step: stable for all steps where |Q| <= 1, with explicit drag for B <= 2 N.
//!
//! *A closed box*, eps u + phi v = 0 with the v that the fluid knows: the pressure gradient holds the slip u' - v =
//! -v/eps while the grain slows down, and
//!
//! ```text
//!     v' = (Q - P (r + B phi (1 + eps)/eps^2)) v + P r v_old .
//! ```
//!
//! Long steps (P B = 1, Q = 0) give -phi (1 + eps)/eps^2 v, which grows for eps < 0.71 however many steps the grains take: what
//! fails is the flux that is late, as in [`super::lagged`], and N does not help.
//!
//! **Momentum.** The fluid loses gamma (u' - v) with the velocities before the step, the grains get gamma (u' - v_k) with
//! those in it. Codes that do this lose the difference. Here it is carried and given back by half in each step, as in
//! [`super::anchored`], unless [`SubCycling::conserve`] is off.

use super::anchored::{Forcing, RETURNED};
use super::cut::{Part, Trial};
use super::{carry, expect_frozen};
use crate::motions::Lost;
use crate::{Agreement, Interaction, Mixture, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of the schemes `sub-cycled` and `sub-cycled-explicit`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SubCycling {
    /// Steps of the grains in a step of the fluid. 1 to 10000. Default 10.
    pub steps: usize,
    /// Whether what the grains get beyond what the fluid loses in a step is given back in the next ones. Most programs
    /// that sub-cycle do not; then `momentum_exchange_defect` in the report says how much momentum is lost. Default
    /// true.
    pub conserve: bool,
}

impl Default for SubCycling {
    fn default() -> Self {
        Self { steps: 10, conserve: true }
    }
}

/// The scheme.
pub struct SubCycled<const D: usize> {
    /// Its options.
    pub cycling: SubCycling,
    /// Whether drag and heat transfer are implicit in the velocity and temperature of a grain.
    pub implicit: bool,
    forcing: Forcing<D>,
    lost: Lost<D>,
}

impl<const D: usize> SubCycled<D> {
    /// The scheme with these options.
    pub fn new(cycling: SubCycling, implicit: bool) -> Self {
        Self { cycling, implicit, forcing: Forcing::default(), lost: Lost::default() }
    }

    /// One step of the grains.
    fn advance(&mut self, mixture: &mut Mixture<D>, dt: f64, report: &mut StepReport) -> Result<()> {
        mixture.evaluate_closures(dt, report)?;
        self.forcing.read(mixture);
        if self.implicit {
            return mixture.drive_grains(dt, &self.forcing, report);
        }
        let Mixture { grains, interaction, .. } = mixture;
        let Interaction { load, force, heat, .. } = interaction;
        let particles = &grains.particles;
        for (i, force) in force.iter_mut().enumerate() {
            *force = self.forcing.force[i] - particles.velocity[i] * load.drag[i];
        }
        if let (Some(law), Some(own)) = (&load.heat, &particles.heat) {
            for (i, heat) in heat.iter_mut().enumerate() {
                *heat = self.forcing.heat[i] - law.coefficient[i] * own.temperature[i];
            }
        }
        mixture.move_grains(dt, report);
        Ok(())
    }
}

impl<const D: usize> Trial<D> for SubCycled<D> {
    fn solve(
        &mut self,
        mixture: &mut Mixture<D>,
        Part { dt, whole }: Part,
        report: &mut StepReport,
    ) -> Result<Agreement> {
        mixture.cut_grains(report)?;
        mixture.evaluate_closures(dt, report)?;
        expect_frozen(mixture, dt);
        match self.cycling.conserve {
            true => mixture.give_back(RETURNED, whole),
            false => mixture.interaction.carried = None,
        }
        mixture.solve_fluid(dt, report)?;
        self.lost.read(&mixture.interaction);
        for _ in 0..self.cycling.steps {
            self.advance(mixture, dt / self.cycling.steps as f64, report)?;
            if report.grains.is_some_and(|grains| grains.runaway.is_some()) {
                break;
            }
        }
        Ok(mixture.compare(&self.lost, dt))
    }

    fn settle(&mut self, mixture: &mut Mixture<D>, part: Part, agreement: Agreement) -> Agreement {
        carry(mixture, &self.lost, part, agreement)
    }
}
