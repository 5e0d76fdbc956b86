//! Fluid and grains solved in turn until they agree, with the law of [`super::anchored`].
//!
//! A step: the grains respond to the push of the last step, on trial; the fluid is solved with the law around that
//! response; the grains move under the new push. If they end up where the fluid expected them, that is the step: one solution of
//! the fluid. Else the law is anchored anew, with the push improved by a [relaxation](super::relaxation), and so on.
//! `anchored` stops after the first solution.
//!
//! **Agreement** is measured by what the difference of velocity is worth to the fluid, (gamma + rho_f V/dt) |v - v*|, over all
//! grains against their weight and force ([`crate::Agreement`]); of heat by hA |T - T*| against hA times the range of temperatures.

use super::Scheme;
use super::anchored::{Anchor, Push};
use super::relaxation::{Relaxation, Relaxer};
use crate::agreement::Comparison;
use crate::{Agreement, Coupled, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_dem::{Dem, Vector};

/// When and how to iterate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Iteration {
    /// Disagreement of grains and fluid at which a step counts as solved, as a share of the weight and the forces of all
    /// grains (of the range of temperatures, for heat). Above 0. Default 1e-2.
    pub tolerance: f64,
    /// Solutions of the fluid per step at most. At least 1. Default 20.
    pub most: usize,
    /// How the next push is made of the last ones: `"aitken"`, `"iqn-ils"` or `{ constant = 0.5 }`. Default `"iqn-ils"`.
    pub relaxation: Relaxation,
    /// Whether a step that does not reach the tolerance is done again in halves, quarters and so on down to 1/64. Default `false`.
    pub auto: bool,
}

impl Default for Iteration {
    fn default() -> Self {
        Self { tolerance: 1e-2, most: 20, relaxation: Relaxation::default(), auto: false }
    }
}

impl Iteration {
    /// One solution per step, whatever the disagreement.
    pub const ONCE: Self =
        Self { tolerance: f64::INFINITY, most: 1, relaxation: Relaxation::IqnIls, auto: false };
}

/// How often a step may be halved.
const HALVINGS: u32 = 6;

/// Ratio of disagreements from one solution to the next above which the mobilities are taken to be wrong.
const SLOW: f64 = 0.7;

/// The scheme.
pub struct Iterated<const D: usize> {
    iteration: Iteration,
    push: Push<D>,
    answer: Push<D>,
    anchor: Anchor,
    relaxer: Relaxer,
}

impl<const D: usize> Scheme<D> for Iterated<D> {
    fn step(&mut self, coupled: &mut Coupled<D>, dt: f64) -> Result<StepReport> {
        let mut report = StepReport::default();
        if coupled.interaction.is_none() {
            coupled.solve_fluid(dt, &mut report)?;
            coupled.move_grains(dt, &mut report);
            coupled.accept_part(dt);
        } else {
            self.advance(coupled, dt, HALVINGS, &mut report)?;
        }
        coupled.end_step();
        Ok(report)
    }
}

impl<const D: usize> Iterated<D> {
    /// The scheme with these settings.
    pub fn new(iteration: Iteration) -> Self {
        let relaxer = Relaxer::new(iteration.relaxation);
        let (push, answer) = (Push::default(), Push::default());
        Self { iteration, push, answer, anchor: Anchor::default(), relaxer }
    }

    /// Advances by `dt`, in halves if need be and allowed, and accepts the parts.
    fn advance(
        &mut self,
        coupled: &mut Coupled<D>,
        dt: f64,
        halvings: u32,
        report: &mut StepReport,
    ) -> Result<()> {
        let may_halve = self.iteration.auto && halvings > 0;
        let accepted = coupled.interaction.as_ref().filter(|_| may_halve).map(|both| both.at.clone());
        let agreement = self.solve(coupled, dt, report)?;
        if let (false, Some(accepted)) = (agreement.converged, accepted) {
            coupled.grains.iter_mut().for_each(Dem::rewind);
            // The halves start from the last accepted fluid, not from an answer that was none.
            coupled.interaction.iter_mut().for_each(|both| both.at.clone_from(&accepted));
            let spent = agreement.solves;
            self.advance(coupled, 0.5 * dt, halvings - 1, report)?;
            let first = report.agreement.take();
            self.advance(coupled, 0.5 * dt, halvings - 1, report)?;
            report.agreement = report.agreement.take().map(|last| last.after(first.as_ref(), spent));
            return Ok(());
        }
        report.agreement = Some(self.settle(coupled, dt, agreement));
        coupled.accept_part(dt);
        Ok(())
    }

    /// Solves fluid and grains for one step of `dt`; the grains stand at its end.
    fn solve(&mut self, coupled: &mut Coupled<D>, dt: f64, report: &mut StepReport) -> Result<Agreement> {
        coupled.cut_grains(report)?;
        coupled.evaluate_closures(report);
        coupled.grains.iter_mut().for_each(Dem::mark);
        self.push.read(coupled);
        rehearse(coupled, dt, &self.push, report);
        self.relaxer.restart();
        let (mut cautious, mut last, mut solves) = (false, f64::INFINITY, 0);
        loop {
            solves += 1;
            let substeps = report.grains.map_or(1, |grains| grains.substeps);
            self.anchor.fill(coupled, &self.push, (dt, substeps), cautious);
            coupled.solve_fluid(dt, report)?;
            self.answer.read(coupled);
            coupled.push_grains(dt, &self.answer, report);
            let mut agreement = Agreement { solves, ..agreement(coupled, dt) };
            let now = agreement.disagreement.max(agreement.heat_disagreement);
            agreement.converged = now <= self.iteration.tolerance;
            if agreement.converged || solves >= self.iteration.most {
                return Ok(agreement);
            }
            coupled.grains.iter_mut().for_each(Dem::rewind);
            cautious |= now > SLOW * last;
            last = now;
            if self.relaxer.improve(coupled, dt, &mut self.push, &self.answer) {
                rehearse(coupled, dt, &self.push, report);
            }
        }
    }

    /// Books what the grains got, and carries what the fluid did not lose for it and where it had them else.
    fn settle(&mut self, coupled: &mut Coupled<D>, dt: f64, agreement: Agreement) -> Agreement {
        let (Some(grains), Some(interaction)) = (&coupled.grains, &mut coupled.interaction) else {
            return agreement;
        };
        // While it is taken out, what is pending is of this step alone.
        let Some(mut carried) = interaction.carried.take() else { return agreement };
        let (push, moved) = (&self.answer, grains.mean_velocity());
        for i in 0..moved.len() {
            carried.impulse[i] += interaction.pending(moved[i], dt, i);
            carried.displacement[i] += interaction.pending_flux(moved[i], dt, i);
            interaction.force[i] = push.force[i] - moved[i] * interaction.load.drag[i];
        }
        if let Some(law) = &interaction.load.heat {
            let warmed = grains.mean_temperature();
            for i in 0..warmed.len() {
                carried.heat[i] += interaction.pending_heat(law, warmed[i], dt, i);
                interaction.heat[i] = push.heat[i] - law.coefficient[i] * warmed[i];
            }
        }
        let total = carried.impulse.iter().sum::<Vector<D>>().norm();
        let scale = interaction.force.iter().map(|force| force.norm()).sum::<f64>() * dt;
        interaction.carried = Some(carried);
        Agreement {
            carried: if total == 0.0 { 0.0 } else { total / scale.max(f64::MIN_POSITIVE) },
            ..agreement
        }
    }
}

/// Moves the grains under a push on trial: only the response is kept.
fn rehearse<const D: usize>(coupled: &mut Coupled<D>, dt: f64, push: &Push<D>, report: &mut StepReport) {
    coupled.push_grains(dt, push, report);
    coupled.grains.iter_mut().for_each(Dem::rewind);
}

/// How far the grains, which have moved, are from what the fluid expected.
fn agreement<const D: usize>(coupled: &Coupled<D>, dt: f64) -> Agreement {
    let (Some(grains), Some(interaction)) = (&coupled.grains, &coupled.interaction) else {
        return Agreement::default();
    };
    let (load, at) = (&interaction.load, &interaction.at);
    let comparison =
        Comparison { grains, load, density: interaction.laws.density, dt, force: &interaction.force };
    let moved = grains.mean_velocity();
    let mut agreement = comparison
        .motion(|i| (interaction.pending(moved[i], dt, i) / dt, load.expected_in_flux(at, i) - moved[i]));
    if let (Some(law), Some(heat)) = (&load.heat, &grains.particles.heat) {
        let all = at.temperature.iter().chain(&heat.temperature);
        let bounds = all.fold((f64::MAX, f64::MIN), |(low, high), t| (low.min(*t), high.max(*t)));
        let warmed = grains.mean_temperature();
        agreement.heat_disagreement =
            comparison.heat(law, bounds, |i| interaction.pending_heat(law, warmed[i], dt, i) / dt);
    }
    agreement
}
