//! The end of a sub-step: velocities from impulses, and the grains moved.

use super::Dem;
use crate::energy::{self, Warmth};
use crate::memory::WALL;
use crate::penetration::Moved;
use crate::rebound;
use crate::repair;
use crate::scene::Scene;
use crate::search::Search;
use crate::solver::Problem;
use crate::{Load, StepReport};

impl<const D: usize> Dem<D> {
    /// Sets the velocities from the impulses (so that they balance to round-off), moves the grains, and keeps the
    /// impulses.
    pub(super) fn move_grains(
        &mut self,
        [h, step]: [f64; 2],
        load: &Load<'_, D>,
        (error, last): (f64, bool),
        report: &mut StepReport,
    ) {
        let n = self.particles.len();
        let mut problem = std::mem::take(&mut self.problem);
        let search = std::mem::take(&mut self.search);
        self.turn_walls(&search, &problem);
        let scene = self.scene(h, load);
        scene.set_free(&search.grid.grain_of, &problem.bodies);
        problem.apply_impulses();
        rebound::limit(&mut problem, &scene, &search.grid.grain_of);
        report.missed_rebounds += rebound::missed(&problem, &scene, |k| search.between(&problem, k));
        let (mut repair, outcome) = match repair::needed(&problem) {
            true => {
                repair::repair(&mut problem, &scene, &search.grid.grain_of, &self.stopping([h, step], load))
            }
            false => Default::default(),
        };
        let scene = Scene { rest: self.settings.rest_within(error), ..scene };
        problem.mark_near_moving(|bodies, moving| scene.mark_moving(&search.grid.grain_of, bodies, moving));
        let counted = self.settings.energy || self.settings.dissipation_heats;
        let solved = if counted { problem.bodies.state() } else { vec![] };
        scene.stop_resting(&search.grid.grain_of, &problem.bodies, &problem.moving);
        for (slot, repair) in repair.iter_mut().enumerate() {
            let i = search.grid.grain_of[slot] as usize;
            *repair = (*repair * h).cap_magnitude(self.settings.max_travel * self.particles.radius[i]);
        }
        if counted {
            let mut sum = self.energy;
            let warmth = energy::add(&mut sum, &scene, &search, &problem, &solved, &repair);
            self.energy = sum;
            if self.settings.dissipation_heats {
                self.warm(&warmth);
            }
        }
        report.sweeps += outcome.sweeps;
        report.work += outcome.work;
        for (slot, &i) in search.grid.grain_of.iter().enumerate() {
            let i = i as usize;
            let v = problem.bodies.velocity(slot);
            self.particles.velocity[i] = v;
            self.particles.position[i] += v * h;
            if let Some(repair) = repair.get(slot) {
                self.particles.position[i] += repair;
            }
            if let Some(mean) = self.mean_velocity.get_mut(i) {
                *mean += v * h;
            }
            if let Some(rotation) = &mut self.particles.rotation {
                rotation.spin[i] = problem.bodies.surface(slot) / self.particles.radius[i];
                rotation.angle[i] += rotation.spin[i] * h;
            }
        }
        for r in search.records(&problem, 0.0) {
            self.contact_force[r.i as usize] -= r.impulse;
            if r.j & WALL == 0 {
                self.contact_force[r.j as usize] += r.impulse;
            } else {
                self.wall_force[(r.j & !WALL) as usize] += r.impulse;
            }
        }
        self.memory.store(n, h, self.beside(), || search.records(&problem, h));
        if last {
            report.candidates = problem.contacts.len();
            report.contacts = problem.contacts.iter().filter(|c| c.acts()).count();
        }
        (self.search, self.problem) = (search, problem);
        self.measure_penetration(h, report);
        self.wrap();
    }

    /// Gives the heat of dissipation of a sub-step to grains and walls.
    fn warm(&mut self, warmth: &Warmth) {
        let Some(heat) = &mut self.particles.heat else { return };
        let grains = heat.temperature.iter_mut().zip(&heat.capacity).zip(&mut self.contact_heat);
        for (joules, ((temperature, capacity), sum)) in warmth.grains.iter().zip(grains) {
            *temperature += joules / capacity;
            *sum += joules;
        }
        // Walls count what they give.
        self.wall_heat.iter_mut().zip(&warmth.walls).for_each(|(sum, joules)| *sum -= joules);
    }

    /// Adds the moments of the impulses on walls that turn, about their pivots, with grains and walls where the
    /// sub-step starts.
    fn turn_walls(&mut self, search: &Search<D>, problem: &Problem<D>) {
        if !self.walls.iter().any(|wall| wall.pivot(self.time).is_some()) {
            return;
        }
        let n = search.grid.grain_of.len();
        let contacts = problem.contacts.iter().enumerate();
        for (k, c) in contacts.filter(|(_, c)| c.j as usize >= n && c.acts()) {
            let wall = search.touches[c.j as usize - n].wall as usize;
            let Some(pivot) = self.walls[wall].pivot(self.time) else { continue };
            let grain = &self.particles.position[search.grid.grain_of[c.i as usize] as usize];
            let placed = &self.placed[wall];
            let grain = self.settings.period.image(*grain, &placed.point(0.5));
            let arm = placed.point(placed.nearest(&grain)) - pivot;
            self.wall_torque[wall] += arm[0] * c.impulse[1] - arm[1] * c.impulse[0];
            if let Some(rolling) = problem.rolling.get(k) {
                let i = search.grid.grain_of[c.i as usize] as usize;
                self.wall_torque[wall] += rolling.impulse.get() * self.particles.radius[i];
            }
        }
    }

    /// Keeps the deepest overlap so far of the step.
    fn measure_penetration(&self, h: f64, report: &mut StepReport) {
        let period = self.settings.period;
        let moved = Moved { particles: &self.particles, walls: &self.placed, h, period };
        let mut deepest = moved.deepest(self.contacts().map(|c| (c.grain, c.partner)));
        if !report.converged {
            // Contacts may have been missed.
            let walls = moved.deepest_in_walls();
            deepest = if walls.depth > deepest.depth { walls } else { deepest };
        }
        if deepest.depth > report.max_penetration_over_radius {
            (report.max_penetration_over_radius, report.deepest) = (deepest.depth, deepest.between);
        }
    }
}
