//! What adds up over the steps of a run, and what has to be said of it in the end.

use voidage_coupling::{Phases, StepReport};
use voidage_dem::{Cost, Partner};

/// Overlap, as a share of the radius, above which a step is worth a warning: contacts that are solved keep a tenth of
/// it.
pub const DEEP: f64 = 0.05;

/// Energy of missed rebounds over the most kinetic energy above which it is said.
const MISSED: f64 = 0.01;

/// Sums and extremes over the steps of this process; what the scene does not have is `None`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Totals {
    /// Steps of this process.
    pub steps: u64,
    /// Wall time by phase.
    pub phases: Phases,
    /// What contacts have cost; with grains only.
    pub contacts: Option<Cost>,
    /// Largest overlap of grains with each other and with walls, as a share of the radius.
    pub max_penetration_over_radius: Option<f64>,
    /// What overlaps so, and in which step.
    pub deepest: Option<(Overlap, u64)>,
    /// Steps with an overlap above [`DEEP`]; the overlap.
    pub penetrating: Tally,
    /// Steps whose contacts did not reach the tolerance; their residual.
    pub unconverged: Tally,
    /// Solutions of the fluid; with grains and fluid only.
    pub fluid_solves: Option<u64>,
    /// Remeshings on the way.
    pub remeshings: u64,
    /// Steps in which grains and fluid did not agree within the tolerance; their disagreement. With both only.
    pub disagreeing: Option<Tally>,
    /// Steps in which grains that were due found no place; the most of one source.
    pub waiting: Tally,
    /// The source of most of them, by number.
    pub slowest: usize,
    /// Energy that rebounds would have left to grains and that they lost, because they hit a second body within a
    /// sub-step, J per metre of depth; the most kinetic energy in such a step.
    pub missed_rebounds: (f64, f64),
    /// Largest [`StepReport::momentum_exchange_defect`].
    pub momentum_exchange_defect: Option<f64>,
    /// Largest [`StepReport::energy_exchange_defect`].
    pub energy_exchange_defect: Option<f64>,
    /// Largest [`StepReport::solid_volume_defect`].
    pub solid_volume_defect: Option<f64>,
}

/// Steps that fell short of something.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// How many.
    pub steps: u64,
    /// The first of them.
    pub first: u64,
    /// By how much the worst of them did.
    pub worst: f64,
}

impl Tally {
    fn add(&mut self, step: u64, amount: f64) {
        self.first = if self.steps == 0 { step } else { self.first };
        self.steps += 1;
        self.worst = self.worst.max(amount);
    }
}

/// A grain that is in another one or in a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// By how much, as a share of the radius of the smaller grain.
    pub depth: f64,
    /// The grain, by number.
    pub grain: u32,
    /// What it is in.
    pub partner: Partner,
}

impl Overlap {
    /// The deepest overlap of a step, if there is any.
    pub fn deepest(report: &StepReport) -> Option<Self> {
        let grains = report.grains?;
        let (grain, partner) = grains.deepest?;
        Some(Self { depth: grains.max_penetration_over_radius, grain, partner })
    }

    /// The two by name: `grain 17 and wall "lid"`; `wall` gives the name of a wall.
    pub fn names<'a>(&self, wall: impl Fn(u32) -> &'a str) -> String {
        match self.partner {
            Partner::Grain(other) => format!("grains {} and {other}", self.grain),
            Partner::Wall(number) => format!("grain {} and wall {:?}", self.grain, wall(number)),
        }
    }
}

impl Totals {
    /// Adds a step, by number.
    pub(crate) fn add(&mut self, step: u64, report: &StepReport) {
        let raise = |worst: &mut Option<f64>, now: Option<f64>| {
            *worst = now
                .map(|now| worst.map_or(now, |worst| if worst > now || worst.is_nan() { worst } else { now }))
                .or(*worst);
        };
        self.steps += 1;
        self.phases.add(&report.phases);
        if let Some(grains) = &report.grains {
            self.contacts.get_or_insert_default().add(&grains.cost);
        }
        self.remeshings += u64::from(report.remeshed);
        if let Some(grains) = report.grains.filter(|grains| !grains.converged) {
            self.unconverged.add(step, grains.residual);
        }
        if let Some(agreement) = &report.agreement {
            *self.fluid_solves.get_or_insert(0) += agreement.solves as u64;
            let disagreeing = self.disagreeing.get_or_insert_default();
            if !agreement.converged {
                disagreeing.add(step, agreement.disagreement.max(agreement.heat_disagreement));
            }
        }
        if let Some((source, grains)) = report.waiting {
            self.slowest = if grains as f64 > self.waiting.worst { source } else { self.slowest };
            self.waiting.add(step, grains as f64);
        }
        if let Some(overlap) = Overlap::deepest(report) {
            if overlap.depth > DEEP {
                self.penetrating.add(step, overlap.depth);
            }
            if self.deepest.is_none_or(|(deepest, _)| overlap.depth > deepest.depth) {
                self.deepest = Some((overlap, step));
            }
        }
        raise(&mut self.max_penetration_over_radius, report.grains.map(|g| g.max_penetration_over_radius));
        raise(&mut self.momentum_exchange_defect, report.momentum_exchange_defect);
        raise(&mut self.energy_exchange_defect, report.energy_exchange_defect);
        raise(&mut self.solid_volume_defect, report.solid_volume_defect);
    }

    /// What the steps did not bring, a line each; nothing if all is well. `wall` gives the name of a wall, `source`
    /// that of a source.
    pub fn shortcomings<'a>(
        &self,
        wall: impl Fn(u32) -> &'a str,
        source: impl Fn(usize) -> &'a str,
    ) -> Vec<String> {
        let of = |tally: &Tally| format!("{} of {} steps", tally.steps, self.steps);
        let mut lines = Vec::new();
        if self.unconverged.steps > 0 {
            let Tally { worst, first, .. } = self.unconverged;
            lines.push(format!(
                "{} did not reach the contact tolerance (worst residual {worst:.1e}, first at step {first})",
                of(&self.unconverged)
            ));
        }
        if self.waiting.steps > 0 {
            let Tally { worst, first, .. } = self.waiting;
            lines.push(format!(
                "{}: grains that were due waited for a free place, at most {worst} of source {:?}, first at step \
                 {first}",
                of(&self.waiting),
                source(self.slowest)
            ));
        }
        if let Some(tally) = self.disagreeing.filter(|tally| tally.steps > 0) {
            let Tally { worst, first, .. } = tally;
            lines.push(format!(
                "{}: grains and fluid disagree (worst {worst:.1e} of weight and force or of the range of temperatures, \
                 first at step {first})",
                of(&tally)
            ));
        }
        let (missed, had) = self.missed_rebounds;
        if missed > MISSED * had {
            lines.push(format!(
                "rebounds that no step saw would have left {missed:.2e} J/m to grains that had {had:.2e} J/m at most: who \
                 hits a second body within a sub-step does not rebound from it; a shorter time.step or \
                 contacts.max_travel sees more of them"
            ));
        }
        if let Some((deepest, step)) = self.deepest.filter(|(deepest, _)| deepest.depth > DEEP) {
            let (depth, names) = (deepest.depth, deepest.names(wall));
            lines.push(format!(
                "largest penetration {depth:.2} of a radius, at step {step} between {names}; {} above {DEEP}",
                of(&self.penetrating)
            ));
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(depth: f64, partner: Partner, converged: bool) -> StepReport {
        let deepest = Some((17, partner));
        let grains = voidage_dem::StepReport {
            max_penetration_over_radius: depth,
            deepest,
            converged,
            residual: depth,
            ..voidage_dem::StepReport::default()
        };
        StepReport { grains: Some(grains), ..StepReport::default() }
    }

    #[test]
    fn shortcomings_are_counted_and_the_worst_is_named() {
        let mut totals = Totals::default();
        totals.add(1, &step(0.01, Partner::Grain(3), true));
        assert!(totals.shortcomings(|_| "lid", |_| "feed").is_empty());
        totals.add(2, &step(0.06, Partner::Grain(3), false));
        totals.add(3, &step(0.31, Partner::Wall(0), false));
        totals.add(4, &step(0.04, Partner::Grain(4), false));
        assert_eq!(
            totals.shortcomings(|_| "lid", |_| "feed"),
            [
                "3 of 4 steps did not reach the contact tolerance (worst residual 3.1e-1, first at step 2)",
                "largest penetration 0.31 of a radius, at step 3 between grain 17 and wall \"lid\"; 2 of 4 steps above \
                 0.05"
            ]
        );
        assert_eq!(totals.penetrating, Tally { steps: 2, first: 2, worst: 0.31 });
    }
}
