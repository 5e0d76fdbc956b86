//! Fluid and grains solved in turn until they agree, with the law of [`super::anchored`].
//!
//! A step: the grains respond to the forcing of the last step, on trial; the fluid is solved with the law around that
//! response; the grains move under the new forcing. If they end up where the fluid expected them, that is the step: one solution of
//! the fluid. Else the law is anchored anew, with the forcing improved by a [relaxation](super::relaxation), and so on.
//! `anchored` stops after the first solution.
//!
//! **Agreement** is measured by what the difference of velocity is worth to the fluid, (gamma + rho_f V/dt) |v - v*|, over all
//! grains against their weight and force ([`crate::Agreement`]); of heat by hA |T - T*|, as far as it is beyond
//! the accuracy of the temperatures, against hA times their range.
//!
//! **Parts of steps.** A step that ends in disagreement, or in which a grain moves far, can be done in parts ([`Iteration::auto`]): halves
//! until one is good, which is accepted; the next one is twice as long again where that is not known to be too far and the whole step
//! stays a multiple of it. The mesh moves with the parts.

use super::Scheme;
use super::anchored::{Anchor, Forcing, Times};
use super::relaxation::{Relaxation, Relaxer};
use crate::agreement::{Comparison, Temperatures};
use crate::{Agreement, Interaction, Mixture, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_dem::Vector;

/// When and how to iterate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Iteration {
    /// Disagreement of grains and fluid at which a step counts as solved, as a share of the weight and the forces of all
    /// grains (of the range of temperatures, for heat). Above 0. Default 1e-2.
    pub tolerance: f64,
    /// Solutions of the fluid per step at most. At least 1. Default 20.
    pub most: usize,
    /// How the next forcing is made of the last ones: `"aitken"`, `"iqn-ils"` or `{ constant = 0.5 }`. Default `"iqn-ils"`.
    pub relaxation: Relaxation,
    /// Whether a step that does not reach the tolerance, or in which a grain moves further than `travel`, is done again in halves,
    /// quarters and so on down to 1/64. Default `false`.
    pub auto: bool,
    /// How far a grain may move in a step, in its diameters, before `auto` cuts the step: for a whole step it is pushed as where it was at
    /// the start. Above 0; with `auto` only. Default 0.25.
    pub travel: f64,
}

impl Default for Iteration {
    fn default() -> Self {
        Self { tolerance: 1e-2, most: 20, relaxation: Relaxation::default(), auto: false, travel: 0.25 }
    }
}

impl Iteration {
    /// One solution per step, whatever the disagreement.
    pub const ONCE: Self =
        Self { tolerance: f64::INFINITY, most: 1, relaxation: Relaxation::IqnIls, auto: false, travel: 0.25 };
}

/// How often a step may be halved.
const HALVINGS: u32 = 6;

/// Ratio of disagreements from one solution to the next above which the mobilities are taken to be wrong.
const SLOW: f64 = 0.7;

/// Force of the fluid on each grain, N, and heat, W, over a step that is done in parts.
#[derive(Default)]
struct Mean<const D: usize> {
    force: Vec<Vector<D>>,
    heat: Vec<f64>,
}

impl<const D: usize> Mean<D> {
    /// Adds a part that is a `share` of the step.
    fn add(&mut self, part: &Interaction<D>, share: f64) {
        self.force.resize(part.force.len(), Vector::zeros());
        self.heat.resize(part.heat.len(), 0.0);
        self.force.iter_mut().zip(&part.force).for_each(|(sum, force)| *sum += force * share);
        self.heat.iter_mut().zip(&part.heat).for_each(|(sum, heat)| *sum += heat * share);
    }
}

/// The scheme.
pub struct Iterated<const D: usize> {
    iteration: Iteration,
    forcing: Forcing<D>,
    answer: Forcing<D>,
    anchor: Anchor,
    relaxer: Relaxer,
}

impl<const D: usize> Scheme<D> for Iterated<D> {
    fn step(&mut self, mixture: &mut Mixture<D>, dt: f64) -> Result<StepReport> {
        let mut report = StepReport::default();
        self.advance(mixture, dt, &mut report)?;
        mixture.end_step();
        Ok(report)
    }
}

impl<const D: usize> Iterated<D> {
    /// The scheme with these settings.
    pub fn new(iteration: Iteration) -> Self {
        let relaxer = Relaxer::new(iteration.relaxation);
        let (forcing, answer) = (Forcing::default(), Forcing::default());
        Self { iteration, forcing, answer, anchor: Anchor::default(), relaxer }
    }

    /// Advances by `dt`, in parts if need be and allowed, and accepts them.
    fn advance(&mut self, mixture: &mut Mixture<D>, dt: f64, report: &mut StepReport) -> Result<()> {
        // Counted in parts of the shortest length that there may be.
        let whole = if self.iteration.auto { 1 << HALVINGS } else { 1 };
        let (mut done, mut length, mut spent) = (0, whole, 0);
        let (mut sum, mut mean, mut grains) = (None::<Agreement>, Mean::default(), None);
        while done < whole {
            let part = dt * f64::from(length) / f64::from(whole);
            if length < whole {
                mixture.move_mesh(|motion, time, points| motion.advance(time, part, points));
            }
            let accepted = (length > 1).then(|| mixture.interaction.at.clone());
            let agreement = self.solve(mixture, (part, dt), report)?;
            let near = agreement.travel <= self.iteration.travel;
            if let (false, Some(accepted)) = (agreement.converged && near, accepted) {
                mixture.grains.rewind();
                // The halves start from the last accepted fluid, not from an answer that was none.
                mixture.interaction.at = accepted;
                spent += agreement.solves;
                length /= 2;
                continue;
            }
            let agreement = self.settle(mixture, part, agreement);
            if length < whole {
                mean.add(&mixture.interaction, f64::from(length) / f64::from(whole));
            }
            sum = Some(agreement.after(sum.as_ref(), std::mem::take(&mut spent)));
            // Parts that were not accepted do not count.
            grains = report.grains.map(|now| now.after(grains.as_ref()));
            mixture.accept_part(part, report)?;
            done += length;
            // As long again as the parts that are left allow, unless that is known to be too far.
            let mut travel = 2.0 * agreement.travel;
            while length < whole && done % (2 * length) == 0 && travel <= self.iteration.travel {
                (length, travel) = (2 * length, 2.0 * travel);
            }
        }
        if !mean.force.is_empty() {
            (mixture.interaction.force, mixture.interaction.heat) = (mean.force, mean.heat);
        }
        (report.agreement, report.grains) = (sum, grains);
        Ok(())
    }

    /// Solves fluid and grains for `dt`, a part of a step of `whole`; the grains stand at its end.
    fn solve(
        &mut self,
        mixture: &mut Mixture<D>,
        (dt, whole): (f64, f64),
        report: &mut StepReport,
    ) -> Result<Agreement> {
        mixture.cut_grains(report)?;
        mixture.evaluate_closures(report)?;
        mixture.grains.save();
        self.forcing.read(mixture);
        rehearse(mixture, dt, &self.forcing, report)?;
        self.relaxer.restart();
        let (mut cautious, mut last, mut solves) = (false, f64::INFINITY, 0);
        loop {
            solves += 1;
            let substeps = report.grains.map_or(1, |grains| grains.substeps);
            self.anchor.fill(mixture, &self.forcing, Times { dt, whole, substeps }, cautious);
            mixture.solve_fluid(dt, report)?;
            self.answer.read(mixture);
            mixture.drive_grains(dt, &self.answer, report)?;
            let mut agreement = Agreement { solves, ..agreement(mixture, dt, whole) };
            let now = agreement.disagreement.max(agreement.heat_disagreement);
            agreement.converged = now <= self.iteration.tolerance;
            if agreement.converged || solves >= self.iteration.most {
                return Ok(agreement);
            }
            mixture.grains.rewind();
            cautious |= now > SLOW * last;
            last = now;
            if self.relaxer.improve(mixture, dt, &mut self.forcing, &self.answer) {
                rehearse(mixture, dt, &self.forcing, report)?;
            }
        }
    }

    /// Books what the grains got, and carries what the fluid did not lose for it and where it had them else.
    fn settle(&mut self, mixture: &mut Mixture<D>, dt: f64, agreement: Agreement) -> Agreement {
        let Mixture { grains, interaction, .. } = mixture;
        let Some(mut carried) = interaction.carried.take() else { return agreement };
        let (forcing, moved) = (&self.answer, grains.mean_velocity());
        for i in 0..moved.len() {
            carried.impulse[i] += interaction.missed(moved[i], i) * dt;
            carried.displacement[i] += interaction.missed_in_flux(moved[i], i) * dt;
            interaction.force[i] = forcing.force[i] - moved[i] * interaction.load.drag[i];
        }
        if let Some(law) = &interaction.load.heat {
            let warmed = grains.mean_temperature();
            for i in 0..warmed.len() {
                carried.heat[i] += law.missed(&interaction.at, warmed[i], i) * dt;
                interaction.heat[i] = forcing.heat[i] - law.coefficient[i] * warmed[i];
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

/// Moves the grains under a forcing on trial: only the response is kept.
fn rehearse<const D: usize>(
    mixture: &mut Mixture<D>,
    dt: f64,
    forcing: &Forcing<D>,
    report: &mut StepReport,
) -> Result<()> {
    mixture.drive_grains(dt, forcing, report)?;
    mixture.grains.rewind();
    Ok(())
}

/// How far the grains, which have moved by `dt` in a step of `whole`, are from what the fluid expected.
fn agreement<const D: usize>(mixture: &Mixture<D>, dt: f64, whole: f64) -> Agreement {
    let Mixture { grains, interaction, .. } = mixture;
    let (load, at) = (&interaction.load, &interaction.at);
    let comparison =
        Comparison { grains, load, density: interaction.laws.density, dt, force: &interaction.force };
    let (moved, carried) = (grains.mean_velocity(), interaction.carried.as_ref());
    let late = |i: usize| carried.map_or_else(Vector::zeros, |carried| carried.impulse[i] / whole);
    let mut agreement = comparison
        .motion(|i| (late(i) + interaction.missed(moved[i], i), interaction.missed_in_flux(moved[i], i)));
    let diameters = |(v, radius): (&Vector<D>, &f64)| v.norm() * dt / (2.0 * radius);
    agreement.travel = moved.iter().zip(&grains.particles.radius).map(diameters).fold(0.0, f64::max);
    if let (Some(law), Some(heat)) = (&load.heat, &grains.particles.heat) {
        let all = at.temperature.iter().chain(&heat.temperature);
        let bounds = all.fold((f64::MAX, f64::MIN), |(low, high), t| (low.min(*t), high.max(*t)));
        let (warmed, late) =
            (grains.mean_temperature(), |i: usize| carried.map_or(0.0, |carried| carried.heat[i] / whole));
        let temperatures = Temperatures { bounds, tolerance: interaction.heat_tolerance };
        agreement.heat_disagreement =
            temperatures.disagreement(law, |i| late(i) + law.missed(at, warmed[i], i));
    }
    agreement
}
