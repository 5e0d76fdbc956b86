//! The budget of mechanical energy of the grains: where it comes from, and what takes it.
//!
//! In a sub-step a grain of mass m goes from v_0 to v and by h v. With the impulses p of its contacts and the force F of
//! all that acts besides, m (v - v_0) = h F + sum p, so that with the mean velocity v_m = (v_0 + v)/2
//!
//! ```text
//!     m/2 (v^2 - v_0^2) = h F . v  -  h/2 F . (v - v_0)  +  sum p . v_m.
//! ```
//!
//! The first term is the work of gravity and fluid over the way of the grain. The second is what the step of finite
//! length takes of it: a grain that falls freely has the speed of the end all the way. The last, with the spins, is p . u_m
//! over the contacts, u_m the mean of the relative velocities before and after, less the work of walls that move. Its normal
//! part is what impacts take, and its tangential part what friction takes.
//!
//! The sums are over all sub-steps since the budget began. They are what the kinetic energy has grown by since then, to
//! rounding.

use crate::Particles;
use crate::bodies::Bodies;
use crate::contact::Contact;
use crate::memory::WALL;
use crate::rolling::Rolling;
use crate::scene::Scene;
use crate::search::Search;
use crate::solver::Problem;
use crate::space::{Vector, turned};
use serde::{Deserialize, Serialize};

/// What grains have gained in kinetic energy since the budget began, mostly at time zero, J (per metre of depth in the
/// plane): below zero what has been taken. Grains that are held have no part in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// Kinetic energy when the budget began; none before the first step.
    pub start: Option<f64>,
    /// Work of gravity: the potential energy that was lost.
    pub gravity: f64,
    /// Work of what acts besides: drag and pressure of a fluid.
    pub fluid: f64,
    /// Work of walls that move, and of grains that are held.
    pub walls: f64,
    /// Taken along the normals of contacts: by impacts, (1 - e^2) of what they had.
    pub impacts: f64,
    /// Taken by friction.
    pub friction: f64,
    /// Taken by resistance to rolling.
    pub rolling: f64,
    /// Taken along the normals of contacts that pull.
    pub cohesion: f64,
    /// Work of taking overlaps back: as much as it lifts the grains.
    pub repair: f64,
    /// Of grains that were stopped because contacts take nearly all that forces bring.
    pub rest: f64,
    /// What steps of finite length take of the work of forces.
    pub step: f64,
    /// Kinetic energy of grains that have come, less that of grains that have left.
    pub passed: f64,
}

impl Energy {
    /// All terms by name, in the order of the struct.
    pub fn terms(&self) -> [(&'static str, f64); 11] {
        [
            ("gravity", self.gravity),
            ("fluid", self.fluid),
            ("walls", self.walls),
            ("impacts", self.impacts),
            ("friction", self.friction),
            ("rolling", self.rolling),
            ("cohesion", self.cohesion),
            ("repair", self.repair),
            ("rest", self.rest),
            ("step", self.step),
            ("passed", self.passed),
        ]
    }

    /// What is missing of the kinetic energy that grains have now, J, over the largest term: rounding.
    pub fn defect(&self, kinetic: f64) -> f64 {
        let terms = self.terms();
        let before = self.start.unwrap_or(kinetic);
        let largest = terms.iter().fold(kinetic.max(before), |most, (_, term)| most.max(term.abs()));
        let missing = kinetic - before - terms.iter().map(|(_, term)| term).sum::<f64>();
        if missing == 0.0 { 0.0 } else { missing.abs() / largest }
    }
}

impl<const D: usize> Particles<D> {
    /// Kinetic energy of the grains, with that of their spins but without that of grains that are held, J (per metre of
    /// depth in the plane).
    pub fn kinetic_energy(&self) -> f64 {
        (0..self.len()).map(|i| self.kinetic_energy_of(i)).sum()
    }

    pub(crate) fn kinetic_energy_of(&self, i: usize) -> f64 {
        let moved = if self.held(i) { 0.0 } else { 0.5 * self.mass[i] * self.velocity[i].norm_squared() };
        let turned = self.rotation.as_ref().map_or(0.0, |rotation| {
            let (inertia, spin) = (rotation.inertia[i], rotation.spin[i]);
            if inertia.is_finite() { 0.5 * inertia * spin * spin } else { 0.0 }
        });
        moved + turned
    }
}

/// Adds a sub-step. The particles are still those of its start; the bodies of the problem have its last velocities, and
/// `solved` those after the contacts, before grains that rest were stopped; `repair` is how far taking overlaps back moves
/// the grains, m, by slot.
pub(crate) fn add<const D: usize>(
    sum: &mut Energy,
    scene: &Scene<D>,
    search: &Search<D>,
    problem: &Problem<D>,
    solved: &[(Vector<D>, f64)],
    repair: &[Vector<D>],
) -> Warmth {
    let (p, h, bodies) = (scene.particles, scene.h, &problem.bodies);
    let grain_of = &search.grid.grain_of;
    let mut warmth = Warmth { grains: vec![0.0; p.len()], walls: vec![0.0; scene.walls.len()] };
    let mut pushed = vec![Vector::<D>::zeros(); grain_of.len()];
    let (first, last) = (at_start(scene, grain_of, bodies), bodies.state());
    for (k, c) in problem.contacts.iter().enumerate().filter(|(_, c)| c.acts()) {
        let [i, j] = [c.i, c.j].map(|slot| slot as usize);
        let normal = c.impulse.dot(&c.normal);
        let mut mean = Vector::zeros();
        let mut turning = 0.0;
        for state in [&first, &last] {
            mean += relative(state, c) * 0.5;
            if let Some(r) = problem.rolling.get(k) {
                turning += 0.5 * rolling_speed(state, c, r) * r.impulse.get();
                if j >= grain_of.len() {
                    sum.walls -= 0.5 * r.drift * r.impulse.get();
                }
            }
        }
        let along = normal * mean.dot(&c.normal);
        *(if normal < 0.0 { &mut sum.cohesion } else { &mut sum.impacts }) += along;
        sum.friction += c.impulse.dot(&mean) - along;
        sum.rolling += turning;
        warmth.share(-(c.impulse.dot(&mean) + turning), search.between(problem, k), scene);
        for (slot, impulse) in [(i, -c.impulse), (j, c.impulse)] {
            match pushed.get_mut(slot).filter(|_| bodies.mobility(slot) > 0.0) {
                Some(pushed) => *pushed += impulse,
                // What a body that does not yield gives to the others.
                None => sum.walls -= impulse.dot(&(0.5 * (first[slot].0 + last[slot].0))),
            }
        }
    }
    for (slot, &i) in grain_of.iter().enumerate() {
        let i = i as usize;
        let [before, solved, after] = [first[slot], solved[slot], last[slot]];
        if bodies.spins() && bodies.spin_mobility(slot) > 0.0 {
            let turning = (after.1 - solved.1) * (after.1 + before.1) * 0.5 / bodies.spin_mobility(slot);
            sum.rest += turning;
            warmth.grains[i] -= turning;
        }
        if p.held(i) {
            continue;
        }
        let mass = p.mass[i];
        let weight = scene.settings.gravity * (mass * h);
        let forces = (solved.0 - before.0) * mass - pushed[slot];
        let lifted = repair.get(slot).copied().unwrap_or_else(Vector::zeros);
        sum.gravity += weight.dot(&after.0) + weight.dot(&lifted) / h;
        sum.repair -= weight.dot(&lifted) / h;
        sum.fluid += (forces - weight).dot(&after.0);
        sum.step -= 0.5 * forces.dot(&(after.0 - before.0));
        let moving = mass * (after.0 - solved.0).dot(&(after.0 + before.0)) * 0.5;
        sum.rest += moving;
        warmth.grains[i] -= moving;
    }
    warmth
}

/// What contacts have taken of the mechanical energy in a sub-step, J, as heat: half for each of the two grains of a
/// contact; all for a grain at a wall, half if the wall has a temperature. A grain that was stopped has what it had.
pub(crate) struct Warmth {
    pub grains: Vec<f64>,
    pub walls: Vec<f64>,
}

impl Warmth {
    fn share<const D: usize>(&mut self, taken: f64, [i, j]: [u32; 2], scene: &Scene<D>) {
        let (wall, grain) = ((j & WALL != 0).then_some((j & !WALL) as usize), i as usize);
        let half = match wall {
            Some(wall) => scene.walls[wall].temperature.map(|_| &mut self.walls[wall]),
            None => self.grains.get_mut(j as usize),
        };
        let share = if half.is_some() { 0.5 } else { 1.0 };
        half.into_iter().for_each(|half| *half += 0.5 * taken);
        self.grains[grain] += share * taken;
    }
}

/// Velocities and speeds of the surfaces of all bodies where the sub-step starts: walls have the same all the way.
pub(crate) fn at_start<const D: usize>(
    scene: &Scene<D>,
    grain_of: &[u32],
    bodies: &Bodies<D>,
) -> Vec<(Vector<D>, f64)> {
    let p = scene.particles;
    let mut state = bodies.state();
    for (slot, &i) in grain_of.iter().enumerate() {
        let i = i as usize;
        let surface = p.rotation.as_ref().map_or(0.0, |rotation| rotation.spin[i] * p.radius[i]);
        state[slot] = (p.velocity[i], surface);
    }
    state
}

/// Relative velocity of the second body at a contact, m/s, from velocities and speeds of surfaces.
pub(crate) fn relative<const D: usize>(state: &[(Vector<D>, f64)], c: &Contact<D>) -> Vector<D> {
    let [a, b] = [c.i, c.j].map(|slot| state[slot as usize]);
    // Without spins the speeds are zero, and in space there are none.
    b.0 - a.0 - turned(&c.normal) * (a.1 + b.1)
}

/// Rolling speed, m/s.
pub(crate) fn rolling_speed<const D: usize>(
    state: &[(Vector<D>, f64)],
    c: &Contact<D>,
    rolling: &Rolling,
) -> f64 {
    rolling.share[1] * state[c.j as usize].1 - rolling.share[0] * state[c.i as usize].1 + rolling.drift
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cohesion, Dem, Load, Material, Motion, Settings, Wall};
    use rand::{Rng, SeedableRng};

    type Plane = Vector<2>;

    fn dem(
        places: &[[f64; 2]],
        material: Material,
        mut walls: Vec<Wall<2>>,
        settings: Settings<2>,
    ) -> Dem<2> {
        let (restitution, friction, rolling) = (material.restitution, material.friction, material.rolling);
        for wall in &mut walls {
            (wall.restitution, wall.friction, wall.rolling) = (restitution, friction, rolling);
        }
        let materials = [material];
        let at = places.iter().map(|x| Plane::from(*x)).collect();
        let grains = Particles::new(at, vec![1e-3; places.len()], vec![0; places.len()], &materials).unwrap();
        Dem::new(grains.rotating(), walls, materials.to_vec(), Settings { energy: true, ..settings }).unwrap()
    }

    fn floor() -> Wall<2> {
        Wall::new("floor", Plane::new(-1.0, 0.0), Plane::new(1.0, 0.0))
    }

    /// Steps, in each of which the budget closes.
    fn run(dem: &mut Dem<2>, steps: usize, load: &Load<'_, 2>) {
        for step in 0..steps {
            let report = dem.step(1e-3, load);
            assert!(report.converged, "step {step}: {report:?}");
            let defect = dem.energy().defect(dem.particles.kinetic_energy());
            assert!(defect < 1e-12, "step {step}: {defect}");
        }
    }

    /// What a ball has lost in its impacts is (1 - e^2) of what it had, and what a free fall lacks is the step's.
    #[test]
    fn a_ball_loses_by_impacts_what_newton_says() {
        let material = Material { restitution: 0.5, ..Material::default() };
        let mut ball = dem(&[[0.0, 0.05]], material, vec![floor()], Settings::default());
        run(&mut ball, 50, &Load::default());
        let (falling, mass) = (*ball.energy(), ball.particles.mass[0]);
        let lacks = -0.5 * mass * (9.81e-3_f64).powi(2) * 50.0;
        approx::assert_relative_eq!(falling.step, lacks, max_relative = 1e-12);
        assert_eq!((falling.impacts, falling.friction, falling.fluid.abs() < 1e-18), (0.0, 0.0, true));
        // Up to the rebound.
        let mut before = ball.particles.kinetic_energy();
        while ball.particles.velocity[0][1] < 0.0 {
            before = ball.particles.kinetic_energy();
            run(&mut ball, 1, &Load::default());
        }
        let taken = ball.energy().impacts + ball.energy().step - falling.step;
        approx::assert_relative_eq!(taken, -0.75 * before, max_relative = 0.05);
        run(&mut ball, 2000, &Load::default());
        let energy = *ball.energy();
        let lost = energy.impacts + energy.step + energy.rest;
        approx::assert_relative_eq!(energy.gravity, mass * 9.81 * 0.049, max_relative = 2e-3);
        approx::assert_relative_eq!(lost, -energy.gravity, max_relative = 1e-9);
    }

    /// A disc that slides and cannot turn loses all to friction; one that rolls against resistance, to that.
    #[test]
    fn friction_and_rolling_take_what_they_stop() {
        let material = Material { friction: 0.4, rolling: 0.2, ..Material::default() };
        let mut disc = dem(&[[0.0, 1e-3]], material, vec![floor()], Settings::default());
        disc.particles.velocity[0] = Plane::new(0.3, 0.0);
        run(&mut disc, 600, &Load::default());
        let energy = *disc.energy();
        assert!(energy.friction < 0.0 && energy.rolling < 0.0, "{energy:?}");
        assert_eq!(disc.particles.kinetic_energy(), 0.0);
        let taken = energy.friction + energy.rolling + energy.impacts + energy.step + energy.rest;
        approx::assert_relative_eq!(taken, -energy.start.unwrap(), max_relative = 1e-9);
    }

    /// All kinds of contacts at once: a mill with a moving wall, cohesion, sinks and sources, a field of forces with drag,
    /// overlaps at the start, a grain that is held, and periodic sides.
    #[test]
    fn the_budget_closes_in_every_step() {
        // One in ten thousand steps of such mills is not solved; with this seed all are.
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        for case in 0..12 {
            let friction = [0.0, 0.4][case % 2];
            let material = Material {
                friction,
                rolling: if case % 3 == 0 && friction > 0.0 { 0.1 } else { 0.0 },
                restitution: [0.0, 0.6, 1.0][case % 3],
                ..Material::default()
            };
            let places: Vec<[f64; 2]> = (0..60)
                .map(|k| {
                    [1.99e-3 * f64::from(k % 8) + 1e-4 * rng.random::<f64>(), 1e-3 + 2e-3 * f64::from(k / 8)]
                })
                .collect();
            // It swings through the bed far from what stands fast, so that nothing is jammed.
            let paddle = Wall {
                motion: Motion::Rotation { centre: Plane::new(0.004, 0.012), rate: 6.0 },
                ..Wall::new("paddle", Plane::new(0.004, 0.004), Plane::new(0.004, 0.009))
            };
            let left = Wall::new("left", Plane::new(-0.008, 0.1), Plane::new(-0.008, 0.0));
            let right = Wall::new("right", Plane::new(0.02, 0.0), Plane::new(0.02, 0.1));
            let cohesion = (case % 4 == 1).then_some(Cohesion { force: 0.05, age: 0.0, sliding: None });
            let settings = Settings { cohesion, ..Settings::default() };
            let mut mill = dem(&places, material, vec![floor(), left, right, paddle], settings);
            mill.particles.mass[7] = f64::INFINITY;
            mill.particles.velocity.iter_mut().for_each(|v| v[0] = 0.1 * (rng.random::<f64>() - 0.5));
            mill.particles.velocity[7] = Plane::zeros();
            run(&mut mill, 60, &Load::default());
            let mut keep = vec![true; 60];
            (keep[3], keep[41]) = (false, false);
            mill.retain(&keep);
            run(&mut mill, 20, &Load::default());
            let (force, drag) = (vec![Plane::new(1e-2, 3e-2); 58], vec![0.02; 58]);
            run(&mut mill, 40, &Load { force: &force, drag: &drag, ..Load::default() });
            let energy = *mill.energy();
            assert!(energy.impacts <= 0.0 && energy.walls != 0.0 && energy.fluid != 0.0, "{energy:?}");
            assert!(
                energy.passed < 0.0
                    && energy.friction <= 1e-12
                    && (friction > 0.0) == (energy.friction < 1e-3 * energy.impacts),
                "{energy:?}"
            );
        }
    }

    /// A bed that is stirred: what its contacts take is what its grains, and a wall that has a temperature, gain as heat.
    #[test]
    fn what_contacts_take_warms_grains_and_walls() {
        for (temperature, rolling) in [(None, 0.0), (None, 0.2), (Some(300.0), 0.2)] {
            let material = Material {
                friction: 0.5,
                rolling,
                restitution: 0.4,
                heat_capacity: 800.0,
                ..Material::default()
            };
            let places: Vec<[f64; 2]> =
                (0..40).map(|k| [2.1e-3 * f64::from(k % 8), 1.2e-3 + 2.2e-3 * f64::from(k / 8)]).collect();
            let walls = vec![
                Wall { temperature, ..floor() },
                Wall::new("left", Plane::new(-0.002, 0.1), Plane::new(-0.002, 0.0)),
                Wall {
                    motion: Motion::Translation { velocity: Plane::new(-0.03, 0.0) },
                    ..Wall::new("right", Plane::new(0.018, 0.0), Plane::new(0.018, 0.1))
                },
            ];
            let settings = Settings {
                cohesion: Some(Cohesion { force: 0.05, age: 0.0, sliding: None }),
                dissipation_heats: true,
                energy: true,
                ..Settings::default()
            };
            let at = places.iter().map(|x| Plane::from(*x)).collect();
            let materials = vec![material];
            let grains = Particles::new(at, vec![1e-3; 40], vec![0; 40], &materials).unwrap().rotating();
            let grains = grains.heated(0.0, &materials).unwrap();
            let mut dem = Dem::new(grains, walls, materials, settings).unwrap();
            let mut from_walls = 0.0;
            for _ in 0..300 {
                dem.step(1e-3, &Load::default());
                from_walls += dem.wall_heat().iter().sum::<f64>() * 1e-3;
            }
            let energy = dem.energy();
            let taken = energy.impacts + energy.friction + energy.rolling + energy.cohesion + energy.rest;
            let heat = dem.particles.heat.as_ref().unwrap();
            let gained: f64 = heat.temperature.iter().zip(&heat.capacity).map(|(t, c)| t * c).sum();
            assert!(
                taken < 0.0 && gained > 0.0 && (temperature.is_some() == (from_walls < 0.0)),
                "{energy:?}"
            );
            approx::assert_relative_eq!(gained - from_walls, -taken, max_relative = 1e-12);
            assert!(heat.temperature.iter().all(|t| *t > 0.0), "{:?}", heat.temperature);
        }
    }

    /// The measure fails where something takes energy that no term counts.
    #[test]
    fn a_velocity_that_is_changed_from_outside_shows() {
        let mut ball = dem(&[[0.0, 0.05]], Material::default(), vec![floor()], Settings::default());
        run(&mut ball, 10, &Load::default());
        ball.particles.velocity[0] *= 0.99;
        assert!(ball.energy().defect(ball.particles.kinetic_energy()) > 1e-3);
    }
}
