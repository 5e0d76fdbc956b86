//! Fluid and grains solved in turn until they agree, with the law of [`super::anchored`].
//!
//! A step: the grains respond to the forcing of the last step, on trial; the fluid is solved with the law around that
//! response; the grains move under the new forcing. If they end up where the fluid expected them, that is the step: one
//! solution of the fluid. Else the law is anchored anew, with the forcing improved by a
//! [relaxation](super::relaxation), and so on. `anchored` stops after the first solution.
//!
//! **Agreement** is measured by what the difference of velocity is worth to the fluid, (gamma + rho_f V/dt) |v - v*|,
//! over all grains against their weight and force ([`crate::Agreement`]); of heat by hA |T - T*|, as far as it is
//! beyond the accuracy of the temperatures, against hA times their range. What is carried from earlier steps counts
//! too. The first solution gives the fluid half of it, as the stability of `anchored` asks for; further ones give it
//! all, because with less a step could not agree whose last one was further off than twice the tolerance.

use super::anchored::{Anchor, Forcing, RETURNED};
use super::cut::{Part, Trial};
use super::relaxation::{Relaxation, Relaxer};
use crate::agreement::{Comparison, Temperatures};
use crate::{Agreement, Mixture, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_dem::Vector;

/// Tolerance and relaxation of the schemes `iterated` and `gauss-seidel`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Iteration {
    /// Disagreement of grains and fluid at which a step counts as solved, as a share of the weight and the forces of
    /// all grains. What they disagree by is carried to the next step and counts there again, so that it does not add up.
    /// Above 0. Default 0.1.
    pub tolerance: f64,
    /// The same of heat, as a share of the range of temperatures. Above 0. Default 1e-2.
    pub heat_tolerance: f64,
    /// Largest number of solutions of the fluid in a step. At least 1. Default 20.
    pub most: usize,
    /// How the next guess x of the forces and heats on the grains follows from the last one and from the residual r,
    /// the answer of the fluid less the guess: `"aitken"`, `"iqn-ils"` or `{ constant = 0.5 }`. Default `"iqn-ils"`,
    /// with `gauss-seidel` `"aitken"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<Relaxation>,
}

impl Default for Iteration {
    fn default() -> Self {
        Self { tolerance: 0.1, heat_tolerance: 1e-2, most: 20, relaxation: None }
    }
}

impl Iteration {
    /// One solution per step.
    pub fn once() -> Self {
        Self { most: 1, ..Self::default() }
    }

    /// Whether grains and fluid agree.
    pub fn accepts(&self, agreement: &Agreement) -> bool {
        agreement.disagreement <= self.tolerance && agreement.heat_disagreement <= self.heat_tolerance
    }
}

/// Ratio of disagreements from one solution to the next above which the mobilities are taken to be wrong.
const SLOW: f64 = 0.7;

/// The scheme.
pub struct Iterated<const D: usize> {
    iteration: Iteration,
    forcing: Forcing<D>,
    answer: Forcing<D>,
    anchor: Anchor,
    slopes: bool,
    relaxer: Relaxer,
}

impl<const D: usize> Iterated<D> {
    /// The scheme with these settings.
    pub fn new(iteration: Iteration) -> Self {
        let relaxer = Relaxer::new(iteration.relaxation.unwrap_or_default());
        let (forcing, answer) = (Forcing::default(), Forcing::default());
        Self { iteration, forcing, answer, anchor: Anchor::default(), slopes: true, relaxer }
    }

    /// The same with laws without slope: the fluid takes the grains to keep the velocity of their response.
    pub fn without_slopes(iteration: Iteration) -> Self {
        Self { slopes: false, ..Self::new(iteration) }
    }
}

impl<const D: usize> Trial<D> for Iterated<D> {
    fn solve(&mut self, mixture: &mut Mixture<D>, part: Part, report: &mut StepReport) -> Result<Agreement> {
        let dt = part.dt;
        mixture.cut_grains(report)?;
        mixture.evaluate_closures(dt, report)?;
        mixture.grains.save();
        self.forcing.read(mixture);
        rehearse(mixture, dt, &self.forcing, report)?;
        self.relaxer.restart();
        let (mut cautious, mut last, mut solves) = (false, f64::INFINITY, 0);
        loop {
            if runs_away(report) {
                return Ok(Agreement { solves, ..Agreement::default() });
            }
            solves += 1;
            let substeps = report.grains.map_or(1, |grains| grains.substeps);
            let returned = if solves == 1 { RETURNED } else { 1.0 };
            self.anchor.fill(mixture, &self.forcing, (part, substeps), (cautious, returned));
            if !self.slopes {
                flatten(mixture, &self.forcing);
            }
            mixture.solve_fluid(dt, report)?;
            self.answer.read(mixture);
            mixture.drive_grains(dt, &self.answer, report)?;
            if runs_away(report) {
                return Ok(Agreement { solves, ..Agreement::default() });
            }
            let mut agreement = Agreement { solves, ..agreement(mixture, part) };
            agreement.converged = self.iteration.accepts(&agreement);
            if agreement.converged || solves >= self.iteration.most {
                return Ok(agreement);
            }
            mixture.rewind_grains();
            let now = agreement.disagreement.max(agreement.heat_disagreement);
            cautious |= now > SLOW * last;
            last = now;
            if self.relaxer.improve(mixture, dt, &mut self.forcing, &self.answer) {
                rehearse(mixture, dt, &self.forcing, report)?;
            }
        }
    }

    fn repeats(&self) -> bool {
        self.iteration.most > 1
    }

    /// Books what the grains got, and carries what the fluid did not lose for it and where it had them else.
    fn settle(
        &mut self,
        mixture: &mut Mixture<D>,
        Part { dt, whole }: Part,
        agreement: Agreement,
    ) -> Agreement {
        let Some(mut carried) = mixture.interaction.carried.take() else { return agreement };
        for i in 0..mixture.felt().len() {
            let (felt, moved) = (mixture.felt()[i], mixture.grains.mean_velocity()[i]);
            let interaction = &mut mixture.interaction;
            carried.impulse[i] += interaction.missed(felt, i) * dt;
            carried.displacement[i] += interaction.missed_in_flux(moved, i) * dt;
        }
        let Mixture { grains, interaction, motions, .. } = mixture;
        if let Some(law) = &interaction.load.heat {
            let warmed = grains.mean_temperature();
            for i in 0..warmed.len() {
                carried.heat[i] += law.missed(&interaction.at, warmed[i], i) * dt;
            }
        }
        let total = carried.impulse.iter().sum::<Vector<D>>().norm();
        let gravity = grains.settings().gravity.norm();
        let all = motions.force.iter().zip(&grains.particles.mass);
        let weight = |mass: f64| if mass.is_finite() { mass * gravity } else { 0.0 };
        let scale = all.map(|(force, mass)| force.norm() + weight(*mass)).sum::<f64>() * whole;
        interaction.carried = Some(carried);
        Agreement {
            carried: if total == 0.0 { 0.0 } else { total / scale.max(f64::MIN_POSITIVE) },
            ..agreement
        }
    }
}

/// Takes the slopes from the laws, which then give at the forcing what they gave.
fn flatten<const D: usize>(mixture: &mut Mixture<D>, forcing: &Forcing<D>) {
    let load = &mut mixture.interaction.load;
    let flux = load.continuity.iter_mut().map(|law| (&mut law.mobility, &mut law.velocity));
    for (mobility, velocity) in flux.chain([(&mut load.mobility, &mut load.velocity)]) {
        for (i, force) in forcing.force.iter().enumerate() {
            velocity[i] += *force * std::mem::take(&mut mobility[i]);
        }
    }
    if let Some(law) = &mut load.heat {
        for (i, heat) in forcing.heat.iter().enumerate() {
            law.temperature[i] += heat * std::mem::take(&mut law.mobility[i]);
        }
    }
}

/// Whether a grain would have gone too far, so that none has moved: there is nothing to compare then.
fn runs_away(report: &StepReport) -> bool {
    report.grains.is_some_and(|grains| grains.runaway.is_some())
}

/// Moves the grains under a forcing on trial: only the response is kept.
fn rehearse<const D: usize>(
    mixture: &mut Mixture<D>,
    dt: f64,
    forcing: &Forcing<D>,
    report: &mut StepReport,
) -> Result<()> {
    mixture.drive_grains(dt, forcing, report)?;
    mixture.rewind_grains();
    Ok(())
}

/// How far the grains, which have moved by a part of a step, are from what the fluid expected.
fn agreement<const D: usize>(mixture: &Mixture<D>, Part { dt, whole }: Part) -> Agreement {
    let Mixture { grains, interaction, .. } = mixture;
    let (load, at) = (&interaction.load, &interaction.at);
    let comparison =
        Comparison { grains, load, density: interaction.laws.density, dt, force: &interaction.force };
    let (felt, moved, carried) = (mixture.felt(), grains.mean_velocity(), interaction.carried.as_ref());
    let late = |i: usize| carried.map_or_else(Vector::zeros, |carried| carried.impulse[i] / whole);
    let mut agreement = comparison
        .motion(|i| (late(i) + interaction.missed(felt[i], i), interaction.missed_in_flux(moved[i], i)));
    if let (Some(law), Some(heat)) = (&load.heat, &grains.particles.heat) {
        let (warmed, late) =
            (grains.mean_temperature(), |i: usize| carried.map_or(0.0, |carried| carried.heat[i] / whole));
        let temperatures = Temperatures::of(at, &heat.temperature, interaction.heat_tolerance);
        agreement.heat_disagreement =
            temperatures.disagreement(law, |i| late(i) + law.missed(at, warmed[i], i));
    }
    agreement
}
