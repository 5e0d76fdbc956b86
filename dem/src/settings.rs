//! What a run of grains is told, and what a step tells back.

use crate::dem::Partner;
use crate::error::{Error, Result, check};
use crate::heat::Conduction;
use crate::period::Period;
use crate::solver::SOLVED;
use crate::space::Vector;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Adhesion between grains (Henry et al., Eq. 18).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cohesion {
    /// Adhesive force F_c0 of a contact, N (N/m, per metre of depth, in the plane).
    pub force: f64,
    /// Time that a contact must have lasted before it sticks, s. Default 0: it sticks from the sub-step after that in
    /// which it formed.
    #[serde(default)]
    pub age: f64,
    /// Speed of sliding at which a contact is young again, m/s: one that slides faster at the end of a sub-step has the
    /// age 0. Above 0. Default: none, contacts grow old while they touch, sliding or not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sliding: Option<f64>,
}

/// A disc (sphere in space) around which contacts stick the less, the nearer they are to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halo<const D: usize> {
    /// Its centre, m.
    pub centre: Vector<D>,
    /// Its radius r, m.
    pub radius: f64,
    /// Length L over which adhesion recovers, m.
    pub length: f64,
}

impl<const D: usize> Halo<D> {
    /// Share of the adhesive force at a way s (m) from the centre: 1 - exp(-(s^2 - r^2)/L^2), and none within r.
    pub fn share(&self, way: &Vector<D>) -> f64 {
        let beyond = way.norm_squared() - self.radius * self.radius;
        -(-beyond.max(0.0) / (self.length * self.length)).exp_m1()
    }
}

/// How to improve on plain Gauss-Seidel sweeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Acceleration {
    /// Plain sweeps, without momentum and without corrections over long distances: on a stack of N from a cold start
    /// the error falls by cos^2(pi / (2 N)) a sweep.
    None,
    /// Momentum with restart, and corrections over long distances.
    #[default]
    Momentum,
}

/// Numerical settings and the physics common to all grains.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings<const D: usize> {
    /// Acceleration of gravity, m/s2.
    pub gravity: Vector<D>,
    /// Share of the kinetic energy of what a sub-step changes of the velocities which that of their error may have, for
    /// the contacts to count as solved. Where grains rest and velocities hardly change, it is the share of 0.5 % of the
    /// energy that the forces of the step bring and contacts take; a few sweeps more then go on towards 1e-7 of that,
    /// because errors would let the grains creep. A grain whose contacts take all that forces bring but a share of
    /// [`Self::rest`] stays where it is.
    pub tolerance: f64,
    /// Sweeps per sub-step at most; a step that needs more is reported as not converged.
    pub max_sweeps: usize,
    /// Share of its radius that a grain may cross in a sub-step.
    pub max_travel: f64,
    /// Sub-steps per step at most; a step that needs more is reported as not converged.
    pub max_substeps: usize,
    /// Acceleration of the sweeps.
    pub acceleration: Acceleration,
    /// Whether contacts must keep from closing beyond their gaps, beside the tolerance, and go to an interior-point
    /// method if `max_sweeps` do not bring that: grains whose masses lie far apart, strong friction. Impulses are not
    /// corrected over long distances then.
    pub interior: bool,
    /// Heat through contacts; none: grains exchange no heat among themselves.
    pub conduction: Option<Conduction>,
    /// Whether what contacts take of the mechanical energy warms the grains.
    pub dissipation_heats: bool,
    /// Adhesion; none: no contact pulls.
    pub cohesion: Option<Cohesion>,
    /// Coefficients of pairs, in place of the smaller one of both sides.
    pub pairs: Vec<Pair>,
    /// Periodic sides: grains that leave at one side come in at the other, and meet across them.
    pub period: Period<D>,
    /// Whether the budget of mechanical energy is kept ([`Dem::energy`](crate::Dem::energy)).
    pub energy: bool,
}

/// Coefficients between a material and another one, or a wall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Number of a material.
    pub material: u8,
    /// The other side.
    pub other: Side,
    /// Coulomb's coefficient; none: as without the pair.
    pub friction: Option<f64>,
    /// Newton's coefficient of restitution; none: as without the pair.
    pub restitution: Option<f64>,
    /// Coefficient of resistance to rolling, 0 to 1; none: as without the pair.
    pub rolling: Option<f64>,
}

/// The other side of a [`Pair`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Grains of a material, by number.
    Material(u8),
    /// A wall, by number.
    Wall(u32),
}

impl<const D: usize> Default for Settings<D> {
    /// Earth's gravity along the last axis, error of the energy 2e-2, at most 1000 sweeps, half a radius per sub-step,
    /// at most 1000 of them.
    fn default() -> Self {
        let mut gravity = Vector::zeros();
        gravity[D - 1] = -9.81;
        Self {
            gravity,
            tolerance: 2e-2,
            max_sweeps: 1000,
            max_travel: 0.5,
            max_substeps: 1000,
            acceleration: Acceleration::default(),
            interior: false,
            conduction: None,
            dissipation_heats: false,
            cohesion: None,
            pairs: vec![],
            period: Period::default(),
            energy: false,
        }
    }
}

/// Share of the energy that the error may have at rest, below which a velocity counts as zero.
const RESTS: f64 = 1e-2;
/// Velocity that cannot be told from its error, as a multiple of the error.
const UNTOLD: f64 = 3.0;

impl<const D: usize> Settings<D> {
    /// Share of the velocity that forces bring to a grain in a sub-step and contacts take of it, below which what is
    /// left counts as zero: the grain rests. It moves again once more than this share of the forces on it is not
    /// balanced: 1e-3 with the default tolerance. A bed at rest would creep with the error of its contacts for ever
    /// otherwise. Impulses that are not solved as well as that leave up to thirty times as much on a few grains of a
    /// bed.
    pub fn rest(&self) -> f64 {
        (RESTS * self.tolerance * SOLVED.rest).sqrt()
    }

    /// The same after a sub-step whose velocities have an error of this share of the energy that forces bring: what
    /// cannot be told from the error counts as zero too. The next sub-step is then the same problem again, and its
    /// impulses come closer to the solution; grains that went on with such velocities would change the problem in
    /// every sub-step.
    pub(crate) fn rest_within(&self, error: f64) -> f64 {
        let solved = self.tolerance * SOLVED.rest;
        self.rest().max(UNTOLD * error.min(solved).sqrt())
    }

    pub(crate) fn validate(&self) -> Result<()> {
        self.gravity
            .iter()
            .try_for_each(|&g| check(g.is_finite(), g, "it must be finite", || "gravity".into()))?;
        for (name, value) in [("tolerance", self.tolerance), ("max_travel", self.max_travel)] {
            check(value.is_finite() && value > 0.0, value, "it must be positive", || name.into())?;
        }
        if self.max_sweeps == 0 || self.max_substeps == 0 {
            return Err(Error::Scene("max_sweeps and max_substeps must be at least 1".into()));
        }
        for pair in &self.pairs {
            let friction = pair.friction.unwrap_or(0.0);
            check(friction >= 0.0 && friction.is_finite(), friction, "it must be 0 or more", || {
                "friction of a pair".into()
            })?;
            let restitution = pair.restitution.unwrap_or(0.0);
            check((0.0..=1.0).contains(&restitution), restitution, "it must lie in 0 .. 1", || {
                "restitution of a pair".into()
            })?;
            let rolling = pair.rolling.unwrap_or(0.0);
            check((0.0..=1.0).contains(&rolling), rolling, "it must lie in 0 .. 1", || {
                "rolling resistance of a pair".into()
            })?;
        }
        if let Some(c) = &self.cohesion {
            check(c.force >= 0.0 && c.force.is_finite(), c.force, "it must be 0 or more", || {
                "cohesion, force".into()
            })?;
            check(c.age >= 0.0 && c.age.is_finite(), c.age, "it must be 0 or more", || {
                "cohesion, age".into()
            })?;
        }
        Ok(())
    }
}

/// What acts on the grains during a step, besides gravity, contacts and walls. Each column has one entry per
/// grain, or none at all.
#[derive(Clone, Copy, Debug)]
pub struct Load<'a, const D: usize> {
    /// Force, N (per metre of depth).
    pub force: &'a [Vector<D>],
    /// Implicit drag coefficient gamma, kg/s: -gamma v at the new velocity. Its impulse over the
    /// step is -gamma times the displacement, exactly, however many sub-steps were taken.
    pub drag: &'a [f64],
    /// Added mass m_a, kg: inertia without weight, -m_a dv/dt.
    pub added: &'a [f64],
    /// Heat given from outside, W.
    pub heat: &'a [f64],
    /// Implicit heat transfer A, W/K: -A T at the new temperature. Its heat over the step is -A times the
    /// [mean temperature](crate::Dem::mean_temperature).
    pub transfer: &'a [f64],
    /// Whether a grain's contacts may stick (with [`Cohesion`]); a contact sticks if both grains may.
    pub cohesive: &'a [bool],
    /// Where cohesion falls off; none: nowhere.
    pub halo: Option<Halo<D>>,
}

impl<const D: usize> Default for Load<'_, D> {
    /// Nothing acts.
    fn default() -> Self {
        Self { force: &[], drag: &[], added: &[], heat: &[], transfer: &[], cohesive: &[], halo: None }
    }
}

/// How a step went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// Sub-steps taken.
    pub substeps: usize,
    /// Contacts that carry an impulse, in the last sub-step.
    pub contacts: usize,
    /// Contacts looked at, in the last sub-step: all those whose gap could close.
    pub candidates: usize,
    /// Sweeps, all sub-steps together.
    pub sweeps: usize,
    /// Contacts relaxed in all sub-steps, and those that could be in the time of measures: the work done.
    pub work: usize,
    /// What its contacts have cost.
    pub cost: Cost,
    /// Largest energy of the velocity error of the sub-steps, as the share that [`Settings::tolerance`] bounds.
    pub error: f64,
    /// Largest relative natural map of the sub-steps.
    pub residual: f64,
    /// Largest overlap of grains with each other and with walls after a sub-step, as a share of the radius of the
    /// smaller grain; more than 1 for a grain whose centre has passed a wall.
    pub max_penetration_over_radius: f64,
    /// The grain that overlaps so, and what it overlaps; `None` where nothing overlaps.
    pub deepest: Option<(u32, Partner)>,
    /// Whether every sub-step reached the tolerance, in momentum and in heat, and there were as many as grains so fast
    /// need.
    pub converged: bool,
    /// Sub-steps repeated because a grain became faster than the search for its contacts had assumed.
    pub repeats: usize,
    /// Energy that rebounds would have left to grains which hit a second body within a sub-step, and that they lost, J:
    /// an impact is seen where a body approaches at the start of the sub-step.
    pub missed_rebounds: f64,
    /// Mean heat from the walls to the grains, W.
    pub wall_heat: f64,
    /// Iterations of the implicit heat equation, all sub-steps together.
    pub heat_iterations: usize,
    /// A grain that forces would throw out of all proportion, and its speed, m/s: then no grain has moved.
    pub runaway: Option<(u32, f64)>,
}

/// What contacts cost.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Cost {
    /// Sub-steps, those of repeats and of trials of a coupling scheme included.
    pub substeps: usize,
    /// Sweeps of all these sub-steps.
    pub sweeps: usize,
    /// Contacts relaxed in the sweeps.
    pub relaxations: usize,
    /// Contacts that the sweeps left out because all rests where they lie.
    pub asleep: usize,
    /// Wall time of the search for contacts, s.
    pub search_s: f64,
    /// Wall time of the sweeps, s.
    pub sweeps_s: f64,
    /// Wall time of looks at how far the contacts are from their solution, s.
    pub measures_s: f64,
    /// Wall time of corrections over long distances, s.
    pub corrections_s: f64,
}

/// Wall times do not count.
impl PartialEq for Cost {
    fn eq(&self, other: &Self) -> bool {
        let counts = |cost: &Self| [cost.substeps, cost.sweeps, cost.relaxations, cost.asleep];
        counts(self) == counts(other)
    }
}

impl Cost {
    /// Adds that of another step.
    pub fn add(&mut self, other: &Self) {
        self.substeps += other.substeps;
        self.sweeps += other.sweeps;
        self.relaxations += other.relaxations;
        self.asleep += other.asleep;
        self.search_s += other.search_s;
        self.sweeps_s += other.sweeps_s;
        self.measures_s += other.measures_s;
        self.corrections_s += other.corrections_s;
    }
}

impl StepReport {
    /// This part of a step after another one: the worse of both in what contacts should bring, the rest as of this
    /// part.
    pub fn after(self, first: Option<&Self>) -> Self {
        let Some(first) = first else { return self };
        let deeper = first.max_penetration_over_radius > self.max_penetration_over_radius;
        let deepest = if deeper { first } else { &self };
        Self {
            residual: first.residual.max(self.residual),
            converged: first.converged && self.converged,
            max_penetration_over_radius: deepest.max_penetration_over_radius,
            deepest: deepest.deepest,
            runaway: first.runaway.or(self.runaway),
            missed_rebounds: first.missed_rebounds + self.missed_rebounds,
            ..self
        }
    }
}
