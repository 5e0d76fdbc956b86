//! What an axis of the map is, and what a point of it gives.

use serde::{Deserialize, Serialize};
use voidage_campaign::Effort;
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Result, StepReport};

/// Two parameters swept together, with every scheme.
#[derive(Clone, Copy)]
pub struct Axis {
    /// Name for `--only`.
    pub name: &'static str,
    /// What is swept, in one sentence.
    pub title: &'static str,
    /// Where the expected values come from.
    pub source: &'static str,
    /// The two parameters, with their units.
    pub labels: [&'static str; 2],
    /// Whether fluid takes part. Grains alone know no scheme: they run once.
    pub coupled: bool,
    /// The points.
    pub points: fn(Effort) -> Vec<[f64; 2]>,
    /// Runs one point.
    pub run: fn([f64; 2], SchemeName, Effort) -> Result<Sample>,
    /// Whether theory says that a scheme is stable at a point; none where there is no theory.
    pub theory: fn([f64; 2], SchemeName) -> Option<bool>,
}

impl Axis {
    /// Whether a scheme can run the axis: those in which the grains take steps of their own know no droplets.
    pub fn takes(&self, scheme: SchemeName) -> bool {
        !(scheme.splits() && self.name.starts_with("droplet"))
    }
}

/// How a point ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing grows, and what is measured is what theory says.
    Passes,
    /// Nothing grows, but what is measured is not what theory says.
    Wrong,
    /// Something grows without bound.
    Unstable,
    /// The run ended with an error.
    Failed,
}

/// What a point gives.
#[derive(Clone, Debug)]
pub struct Sample {
    /// How it ended.
    pub verdict: Verdict,
    /// What was measured: an amplification factor, a ratio of pressures.
    pub measured: f64,
    /// What it should be; not a number where there is no theory.
    pub expected: f64,
    /// What it took.
    pub tally: Tally,
    /// What a picture shows of it: name of a curve, place, value.
    pub curves: Vec<(&'static str, f64, f64)>,
}

/// What steps took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Steps.
    pub steps: usize,
    /// Solutions of the fluid.
    pub solves: usize,
    /// Contact sweeps.
    pub sweeps: usize,
    /// Steps that the program reports as not solved: contacts, or the agreement of grains and fluid.
    pub unsolved: usize,
}

impl Tally {
    /// Counts a step.
    pub fn add(&mut self, report: &StepReport) {
        self.steps += 1;
        self.solves += report.agreement.map_or(usize::from(report.fluid.is_some()), |both| both.solves);
        self.sweeps += report.grains.map_or(0, |grains| grains.sweeps);
        let solved = report.agreement.is_none_or(|both| both.converged)
            && report.grains.is_none_or(|grains| grains.converged);
        self.unsolved += usize::from(!solved);
    }

    /// Counts the steps of another run too.
    pub fn join(&mut self, other: &Self) {
        self.steps += other.steps;
        self.solves += other.solves;
        self.sweeps += other.sweeps;
        self.unsolved += other.unsolved;
    }

    /// One of the counts per step.
    pub fn per_step(&self, count: usize) -> f64 {
        count as f64 / self.steps as f64
    }
}

impl Sample {
    /// A sample without curves.
    pub fn new(verdict: Verdict, measured: f64, expected: f64, tally: Tally) -> Self {
        Self { verdict, measured, expected, tally, curves: vec![] }
    }

    /// A sample that passes if nothing grew and the measured value is within `tolerance` of the expected one.
    pub fn judge(bounded: bool, measured: f64, expected: f64, tolerance: f64, tally: Tally) -> Self {
        let verdict = match (bounded && measured.is_finite(), (measured - expected).abs() <= tolerance) {
            (false, _) => Verdict::Unstable,
            (true, true) => Verdict::Passes,
            (true, false) => Verdict::Wrong,
        };
        Self::new(verdict, measured, expected, tally)
    }
}

/// The product of two lists.
pub fn product(x: &[f64], y: &[f64]) -> Vec<[f64; 2]> {
    x.iter().flat_map(|&x| y.iter().map(move |&y| [x, y])).collect()
}
