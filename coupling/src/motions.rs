//! The motions of the grains in a step, and the books of them.
//!
//! A scheme may move the grains in several motions while the fluid takes one step, or solve the fluid several times while
//! the grains take one. What a motion gives to the grains and what the fluid loses then belong together only over the
//! whole step: each is a mean over its own time.

use crate::agreement::Comparison;
use crate::scheme::anchored::{Forcing, velocity_offset};
use crate::{Agreement, Interaction, Mixture, StepReport};
use voidage_dem::Vector;

/// What the grains got in their motions since the last part of a step was accepted: means over them.
#[derive(Clone, Debug, Default)]
pub struct Motions<const D: usize> {
    /// Time that the grains have moved, s.
    time: f64,
    /// Force of the fluid on each grain, N.
    pub force: Vec<Vector<D>>,
    /// Heat of the fluid to each grain, W; empty without heat.
    pub heat: Vec<f64>,
    /// Velocity, m/s.
    pub velocity: Vec<Vector<D>>,
    /// What drag and added mass felt of the last motion under a forcing, m/s: without added mass the mean velocity in it.
    pub felt: Vec<Vector<D>>,
    /// Mean temperature in that motion, K; empty without heat.
    pub warmed: Vec<f64>,
    /// Impulse of the last pressure on grains that moved before the fluid was solved again, N s; empty where they move
    /// after it.
    ahead: Vec<Vector<D>>,
}

/// What the fluid lost for each grain in its last solution, by the law that it was given: force (N) and heat (W).
#[derive(Clone, Debug, Default)]
pub struct Lost<const D: usize> {
    /// Force, N.
    pub force: Vec<Vector<D>>,
    /// Heat, W; empty without heat.
    pub heat: Vec<f64>,
}

impl<const D: usize> Lost<D> {
    /// Reads it, right after the fluid has been solved.
    pub fn read(&mut self, interaction: &Interaction<D>) {
        self.force.clone_from(&interaction.force);
        self.heat.clone_from(&interaction.heat);
    }
}

/// Makes a mean that of a longer time, of whose last `share` there is a new value.
fn mean<T>(of: &mut Vec<T>, new: impl Iterator<Item = T>, share: f64)
where
    T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
{
    if share == 1.0 {
        of.clear();
        of.extend(new);
    } else {
        of.iter_mut().zip(new).for_each(|(mean, new)| *mean = *mean * (1.0 - share) + new * share);
    }
}

impl<const D: usize> Motions<D> {
    /// Time that the grains have moved since the last part of a step was accepted, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// The next motion is the first.
    pub(crate) fn begin(&mut self) {
        self.time = 0.0;
        self.ahead.clear();
    }

    /// Adds a motion of `dt`; returns the share of it in all.
    fn share(&mut self, dt: f64) -> f64 {
        let share = if self.time == 0.0 { 1.0 } else { dt / (self.time + dt) };
        self.time += dt;
        share
    }
}

impl<const D: usize> Mixture<D> {
    /// Books a motion of `dt` under the force of the law; returns its share of the motions so far.
    pub(crate) fn book_moved(&mut self, dt: f64) -> f64 {
        let Self { grains, interaction, motions, .. } = self;
        let share = motions.share(dt);
        mean(&mut motions.force, interaction.force.iter().copied(), share);
        mean(&mut motions.heat, interaction.heat.iter().copied(), share);
        mean(&mut motions.velocity, grains.particles.velocity.iter().copied(), share);
        share
    }

    /// The same for one that was driven by a forcing.
    pub(crate) fn book_driven(&mut self, dt: f64, forcing: &Forcing<D>) -> f64 {
        let Self { grains, interaction, motions, .. } = self;
        let share = motions.share(dt);
        let Interaction { load, felt, .. } = interaction;
        let moved = grains.mean_velocity();
        motions.felt.clear();
        motions.felt.extend_from_slice(if felt.is_empty() { moved } else { felt });
        motions.warmed.clear();
        motions.warmed.extend_from_slice(grains.mean_temperature());
        let felt = &motions.felt;
        let left = |(i, force): (usize, &Vector<D>)| force - felt[i] * load.drag[i];
        mean(&mut motions.force, forcing.force.iter().enumerate().map(left), share);
        mean(&mut motions.velocity, moved.iter().copied(), share);
        if let Some(law) = &load.heat {
            let warmed = &motions.warmed;
            let left = |(i, heat): (usize, &f64)| heat - law.coefficient[i] * warmed[i];
            mean(&mut motions.heat, forcing.heat.iter().enumerate().map(left), share);
        }
        share
    }

    /// Lowers the law of the grains, so that the fluid gets a `share` of what is carried of earlier steps in the time of a
    /// step of `whole` s. From now on what grains get beyond what the fluid loses is to be [carried](Self::carry).
    ///
    /// Grains that have moved in this step before the fluid is solved got the pressure of the last solution once more,
    /// and will get that of this one so much less: what is carried lags by this force over their time, from the first step
    /// of a grain on. It is no debt of the fluid, and is left out of what is given back.
    pub fn give_back(&mut self, share: f64, whole: f64) {
        let Self { grains, interaction, motions, .. } = self;
        let (count, moved) = (grains.particles.len(), motions.time);
        let Interaction { load, at, carried, .. } = interaction;
        let carried = carried.get_or_insert_with(|| crate::Carried::none(count, load.heat.is_some()));
        motions.ahead.clear();
        if moved > 0.0 {
            let pressure = |i: usize| load.forcing(at, i) - at.velocity[i] * load.drag[i];
            motions.ahead.extend((0..count).map(|i| pressure(i) * moved));
        }
        for i in 0..count {
            let lag = if carried.lags[i] { motions.ahead.get(i).copied() } else { None };
            let impulse = carried.impulse[i] + lag.unwrap_or(Vector::zeros());
            load.velocity[i] -= velocity_offset(impulse * share, load.drag[i] * whole);
        }
        if let Some(law) = &mut load.heat {
            for i in 0..count {
                law.temperature[i] -= law.temperature_offset(carried.heat[i] * share, whole, i);
            }
        }
    }

    /// Carries what the grains got in their motions beyond what the fluid lost in a solution over `dt`. The impulse that is
    /// carried, over weight and force of all grains in a step of `whole` s.
    pub fn carry(&mut self, lost: &Lost<D>, dt: f64, whole: f64) -> f64 {
        let Self { grains, interaction, motions, .. } = self;
        let Some(carried) = &mut interaction.carried else { return 0.0 };
        let moved = motions.time;
        for (i, ahead) in motions.ahead.iter().enumerate() {
            carried.lag(i, *ahead);
        }
        for (i, impulse) in carried.impulse.iter_mut().enumerate() {
            *impulse += motions.force[i] * moved - lost.force[i] * dt;
        }
        for (i, heat) in carried.heat.iter_mut().enumerate() {
            *heat += motions.heat[i] * moved - lost.heat[i] * dt;
        }
        let total = carried.impulse.iter().sum::<Vector<D>>().norm();
        let gravity = grains.settings().gravity.norm();
        let weight = |mass: f64| if mass.is_finite() { mass * gravity } else { 0.0 };
        let all = motions.force.iter().zip(&grains.particles.mass);
        let scale = all.map(|(force, mass)| force.norm() + weight(*mass)).sum::<f64>() * whole;
        if total == 0.0 { 0.0 } else { total / scale.max(f64::MIN_POSITIVE) }
    }

    /// How far the grains are from what the fluid expected of them in its last solution, which was over `dt`: by the force
    /// that they got beyond what the fluid lost, and by the velocity of the solid flux.
    pub fn compare(&self, lost: &Lost<D>, dt: f64) -> Agreement {
        let Self { grains, interaction, motions, .. } = self;
        let (load, at) = (&interaction.load, &interaction.at);
        let comparison =
            Comparison { grains, load, density: interaction.laws.density, dt, force: &motions.force };
        let mut agreement = comparison.motion(|i| {
            (motions.force[i] - lost.force[i], load.expected_in_flux(at, i) - motions.velocity[i])
        });
        if let (Some(law), Some(heat)) = (&load.heat, &grains.particles.heat) {
            let temperatures =
                crate::agreement::Temperatures::of(at, &heat.temperature, interaction.heat_tolerance);
            agreement.heat_disagreement = temperatures.disagreement(law, |i| motions.heat[i] - lost.heat[i]);
        }
        let converged = crate::scheme::iterated::Iteration::default().accepts(&agreement);
        Agreement { converged, solves: 1, ..agreement }
    }

    /// Takes back all motions of the step, before the first of which the grains were saved.
    pub(crate) fn rewind_grains(&mut self) {
        self.grains.rewind();
        self.motions.begin();
    }

    /// Adds a motion that began at `start` to the report. Those that it goes on from count, and the sweeps of trials too.
    pub(crate) fn report_motion(
        &self,
        now: voidage_dem::StepReport,
        start: std::time::Instant,
        report: &mut StepReport,
    ) {
        let before = report.grains.filter(|_| self.motions.time > 0.0);
        let (sweeps, substeps) = (report.grains.map_or(0, |g| g.sweeps), before.map_or(0, |g| g.substeps));
        let now = now.after(before.as_ref());
        let mut cost = report.grains.map_or_else(Default::default, |g| g.cost);
        cost.add(&now.cost);
        report.grains = Some(voidage_dem::StepReport {
            sweeps: sweeps + now.sweeps,
            substeps: substeps + now.substeps,
            cost,
            ..now
        });
        report.phases.contacts += start.elapsed().as_secs_f64();
    }
}
