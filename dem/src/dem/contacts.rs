//! The contacts of one sub-step: found, solved, and found again where a grain became faster than assumed.

use super::Dem;
use crate::bodies::Bodies;
use crate::parallel;
use crate::solver::{Grains, Outcome, Problem, SCHEDULE, Stopping};
use crate::{Acceleration, Load, StepReport, Vector};
use std::time::Instant;

/// Share of the radius by which a contact may close beyond its gap in a sub-step: overlaps are taken back in the next.
const CLOSING: f64 = 2e-3;
/// Attempts at a sub-step whose grains become faster than assumed.
const ATTEMPTS: usize = 5;

impl<const D: usize> Dem<D> {
    /// Finds and solves the contacts, again with a wider search if a grain became faster than the search assumed.
    /// Returns the energy of the error of the velocities over that of what forces bring; zero for a part of a step.
    pub(super) fn solve_contacts(
        &mut self,
        [h, step]: [f64; 2],
        load: &Load<'_, D>,
        report: &mut StepReport,
    ) -> f64 {
        self.after.clear();
        let mut search = std::mem::take(&mut self.search);
        let mut problem = std::mem::take(&mut self.problem);
        let stopping = self.stopping([h, step], load);
        let mut error = 0.0;
        for attempt in 1.. {
            let start = Instant::now();
            search.prepare(&self.scene(h, load), &self.memory, &self.after, &mut problem);
            problem.cost.search_s += start.elapsed().as_secs_f64();
            problem.cost.substeps += 1;
            problem.apply_impulses();
            let outcome = self.solve(&mut problem, &search.grid.grain_of, &stopping, load, h);
            report.sweeps += outcome.sweeps;
            report.work += outcome.work;
            let holds = search.holds(&self.scene(h, load), &problem);
            if holds || attempt == ATTEMPTS {
                error = if h == step { outcome.error } else { 0.0 };
                report.residual = report.residual.max(outcome.residual);
                report.error = report.error.max(outcome.share());
                report.converged &= holds && outcome.solved(&stopping);
                break;
            }
            report.repeats += 1;
            // Those of all attempts: the solution of a wider search may be slow where the one before was not, and
            // again.
            let known = self.after.len();
            self.after.resize(known + self.particles.len(), Vector::zeros());
            for (slot, &i) in search.grid.grain_of.iter().enumerate() {
                self.after[known + i as usize] = problem.bodies.velocity(slot);
            }
            self.memory.store(self.particles.len(), h, self.beside(), || search.records(&problem, 0.0));
        }
        report.substeps += 1;
        (self.search, self.problem) = (search, problem);
        error
    }

    /// For a sub-step of length `h` of a step.
    pub(super) fn stopping(&self, [h, step]: [f64; 2], load: &Load<'_, D>) -> Stopping {
        let accelerated = self.settings.acceleration == Acceleration::Momentum;
        Stopping {
            tolerance: self.settings.tolerance,
            max_sweeps: self.settings.max_sweeps,
            settling_sweeps: SCHEDULE.settling_sweeps,
            rest: self.settings.rest(),
            // Between masses far apart impulses do not vary slowly in space.
            short_runs: (accelerated && !self.settings.interior).then_some(SCHEDULE.short_runs),
            momentum: accelerated,
            // Sub-steps do not ask for more than their step would.
            forced: self.forced(step, load),
            floor: self.smallest_energy(h),
            negligible: self.rounding(),
            step: h,
            whole: h == step,
            closing: CLOSING / h,
            interior: self.settings.interior,
        }
    }

    fn solve(
        &self,
        problem: &mut Problem<D>,
        grain_of: &[u32],
        stopping: &Stopping,
        load: &Load<'_, D>,
        h: f64,
    ) -> Outcome {
        let scene = self.scene(h, load);
        let free = |bodies: &Bodies<D>| scene.set_free(grain_of, bodies);
        let pushed = |bodies: &Bodies<D>| scene.pushed(grain_of, bodies);
        let changed = |bodies: &Bodies<D>| scene.changed(grain_of, bodies);
        let moving = |bodies: &Bodies<D>, marks: &mut Vec<bool>| scene.mark_moving(grain_of, bodies, marks);
        problem.solve(stopping, &Grains { free: &free, pushed: &pushed, changed: &changed, moving: &moving })
    }

    /// Energy of the velocities that forces give in `h` seconds, J.
    fn forced(&self, h: f64, load: &Load<'_, D>) -> f64 {
        let (scene, p) = (self.scene(h, load), &self.particles);
        parallel::sum(0..p.len(), &|i| match p.held(i) {
            true => 0.0,
            false => 0.5 * (scene.free_velocity(i) - p.velocity[i]).norm_squared() / scene.mobility(i),
        })
    }

    /// Energy of the lightest grain if it goes by 1e-9 of its radius in the sub-step, J.
    fn smallest_energy(&self, h: f64) -> f64 {
        let p = &self.particles;
        let nudged = |(m, r): (&f64, &f64)| 0.5 * m * (1e-9 * r / h).powi(2);
        p.mass.iter().zip(&p.radius).map(nudged).fold(f64::MAX, f64::min)
    }

    /// Energy of what rounding leaves of all velocities, J.
    fn rounding(&self) -> f64 {
        let p = &self.particles;
        let rounding = |i: usize| 0.5 * p.mass[i] * 1e-30 * p.velocity[i].norm_squared();
        parallel::sum(0..p.len(), &|i| if p.held(i) { 0.0 } else { rounding(i) })
    }
}
