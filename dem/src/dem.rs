//! The simulation: state, and one step.

use crate::energy::Energy;
use crate::error::{Error, Result};
use crate::heat::Conductor;
use crate::laws::Laws;
use crate::memory::{Beside, Memory};
use crate::parallel;
use crate::saved::Saved;
use crate::scene::Scene;
use crate::search::Search;
use crate::solver::Problem;
use crate::walls::Placed;
use crate::{Load, Material, Pair, Particles, Settings, Side, StepReport, Vector, Wall};

mod contacts;
mod forces;
mod members;
mod motion;
mod state;

use forces::Last;
pub use forces::{Contact, ContactForce, Partner};
pub use state::State;

/// The largest radius, m.
fn largest<const D: usize>(particles: &Particles<D>) -> f64 {
    particles.radius.iter().fold(0.0, |most, r| most.max(*r))
}

/// What is a mean over a step: forces and heat of contacts and walls, moments on walls, velocities, temperatures.
#[derive(Clone, Debug, Default)]
pub struct Means<const D: usize> {
    vectors: [Vec<Vector<D>>; 3],
    numbers: [Vec<f64>; 4],
}

/// Makes a mean over the last `share` of a time one over all of it, of which `old` is that over the rest; a column that
/// is empty for one of both stays as it is.
fn blend<T>(mean: &mut [T], old: &[T], share: f64)
where
    T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
{
    if mean.len() == old.len() {
        mean.iter_mut().zip(old).for_each(|(mean, old)| *mean = *old * (1.0 - share) + *mean * share);
    }
}

/// Radii that a grain may go in a step.
const RUNAWAY: f64 = 1e7;

/// Grains, walls and everything that carries over from step to step.
pub struct Dem<const D: usize> {
    /// The grains. Positions, velocities, spins and temperatures may be changed between steps; [`Dem::add`] and
    /// [`Dem::retain`] change their number.
    pub particles: Particles<D>,
    walls: Vec<Wall<D>>,
    materials: Vec<Material>,
    settings: Settings<D>,
    laws: Option<Laws>,
    time: f64,
    memory: Memory<D>,
    contact_force: Vec<Vector<D>>,
    contact_heat: Vec<f64>,
    wall_force: Vec<Vector<D>>,
    wall_heat: Vec<f64>,
    /// Of walls that turn; zero of the others.
    wall_torque: Vec<f64>,
    mean_velocity: Vec<Vector<D>>,
    mean_temperature: Vec<f64>,
    energy: Energy,
    saved: Saved<D>,
    placed: Vec<Placed<D>>,
    search: Search<D>,
    problem: Problem<D>,
    after: Vec<Vector<D>>,
    conductor: Conductor,
    /// Whether the contacts of the last sub-step are at hand: in `search`, `problem` and `conductor`, or put aside.
    known: bool,
    last: Option<Last<D>>,
}

impl<const D: usize> Default for Dem<D> {
    /// No grains, no walls.
    fn default() -> Self {
        Self {
            particles: Particles::default(),
            walls: vec![],
            materials: vec![],
            settings: Settings::default(),
            laws: None,
            time: 0.0,
            memory: Memory::default(),
            contact_force: vec![],
            contact_heat: vec![],
            wall_force: vec![],
            wall_heat: vec![],
            wall_torque: vec![],
            mean_velocity: vec![],
            mean_temperature: vec![],
            energy: Energy::default(),
            saved: Saved::default(),
            placed: vec![],
            search: Search::default(),
            problem: Problem::default(),
            after: vec![],
            conductor: Conductor::default(),
            known: false,
            last: None,
        }
    }
}

impl<const D: usize> Dem<D> {
    /// Checks everything; grains may touch walls and each other from the start.
    pub fn new(
        particles: Particles<D>,
        walls: Vec<Wall<D>>,
        materials: Vec<Material>,
        settings: Settings<D>,
    ) -> Result<Self> {
        particles.validate(&materials)?;
        settings.validate()?;
        walls.iter().try_for_each(Wall::validate)?;
        if D != 2 && particles.rotation.is_some() {
            return Err(Error::PlaneOnly("rotation of grains"));
        }
        if D != 2 && !walls.is_empty() {
            return Err(Error::PlaneOnly("a wall from one point to another"));
        }
        let known = |pair: &Pair| {
            let other = match pair.other {
                Side::Material(other) => (other as usize) < materials.len(),
                Side::Wall(wall) => (wall as usize) < walls.len(),
            };
            other && (pair.material as usize) < materials.len()
        };
        if let Some(pair) = settings.pairs.iter().find(|pair| !known(pair)) {
            return Err(Error::Scene(format!("{pair:?}: there is no such material or wall")));
        }
        settings.period.check(largest(&particles), &walls)?;
        let laws = Laws::new(&materials, &walls, &settings.pairs);
        let n = particles.len();
        let heat = particles.heat.is_some();
        if let Some(law) = settings.conduction {
            law.validate::<D>(&materials)?;
            if !heat {
                return Err(Error::Scene("conduction is on but the grains carry no heat".into()));
            }
        }
        if settings.dissipation_heats && !heat {
            return Err(Error::Scene("dissipation heats grains that carry no heat".into()));
        }
        let mut dem = Self {
            contact_force: vec![Vector::zeros(); n],
            contact_heat: vec![0.0; if heat { n } else { 0 }],
            wall_force: vec![Vector::zeros(); walls.len()],
            wall_heat: vec![0.0; if heat { walls.len() } else { 0 }],
            wall_torque: vec![0.0; walls.len()],
            particles,
            walls,
            materials,
            settings,
            laws,
            ..Self::default()
        };
        dem.check_rolling()?;
        dem.wrap();
        Ok(dem)
    }

    /// What is kept of contacts beside their impulses.
    fn beside(&self) -> Beside {
        let rolling = self.scene(1.0, &Load::default()).has_rolling();
        Beside { ages: self.settings.cohesion.is_some(), rolling }
    }

    /// Resistance to rolling needs grains that spin, and a method that knows it.
    fn check_rolling(&self) -> Result<()> {
        if !self.scene(1.0, &Load::default()).has_rolling() {
            return Ok(());
        }
        if D != 2 {
            return Err(Error::PlaneOnly("resistance to rolling"));
        }
        if self.particles.rotation.is_none() && !self.particles.is_empty() {
            return Err(Error::Scene("contacts resist rolling but the grains do not spin".into()));
        }
        match self.settings.interior {
            true => Err(Error::Scene("the interior-point method knows no resistance to rolling".into())),
            false => Ok(()),
        }
    }

    /// Puts the grains that have left through a periodic side in at the other.
    fn wrap(&mut self) {
        let period = &self.settings.period;
        if !period.is_none() {
            self.particles.position.iter_mut().for_each(|x| *x = period.wrap(*x));
        }
    }

    /// Advances by `dt` seconds under a load.
    ///
    /// # Panics
    /// If a column of the load has neither no entry nor one per grain, or `dt` is not positive: both are errors of
    /// the caller.
    pub fn step(&mut self, dt: f64, load: &Load<'_, D>) -> StepReport {
        let n = self.particles.len();
        let Load { force, drag, added, heat, transfer, cohesive, halo: _ } = load;
        let scalars = [drag, added, heat, transfer].map(|column| column.len());
        for len in scalars.into_iter().chain([force.len(), cohesive.len()]) {
            assert!(len == 0 || len == n, "a column of the load has {len} entries for {n} grains");
        }
        assert!(dt > 0.0 && dt.is_finite(), "the step is {dt} s");
        self.wrap();
        self.contact_force.fill(Vector::zeros());
        self.contact_heat.fill(0.0);
        self.wall_force.fill(Vector::zeros());
        self.wall_heat.fill(0.0);
        self.wall_torque.fill(0.0);
        self.mean_velocity.clear();
        self.mean_velocity.resize(load.drag.len(), Vector::zeros());
        self.mean_temperature.clear();
        self.mean_temperature.resize(load.transfer.len(), 0.0);
        let runaway = self.runaway(dt, load);
        if runaway.is_some() {
            return StepReport { runaway, ..StepReport::default() };
        }
        if let Some(last) = self.last.take() {
            // For their buffers: all in them is made anew.
            (self.search, self.problem, self.conductor) = (last.search, last.problem, last.conductor);
        }
        if self.settings.energy && self.energy.start.is_none() {
            self.energy.start = Some(self.particles.kinetic_energy());
        }
        let mut report = StepReport { converged: true, ..StepReport::default() };
        let (start, mut left) = (self.time, dt);
        loop {
            let (wanted, most) = (self.substeps(left, load), self.settings.max_substeps - report.substeps);
            let count = wanted.min(most).max(1);
            let h = left / count as f64;
            self.substep([h, dt], load, count == 1, &mut report);
            if count < wanted {
                // Grains that their contacts hold have not gone where forces alone would have taken them.
                report.converged &= self.travel(h, |i| self.particles.velocity[i].norm_squared()) <= 1.0;
            }
            left -= h;
            self.time = start + (dt - left);
            if count == 1 {
                break;
            }
        }
        self.time = start + dt;
        self.known = true;
        self.contact_force.iter_mut().chain(&mut self.wall_force).for_each(|f| *f /= dt);
        let rates = self.contact_heat.iter_mut().chain(&mut self.wall_heat).chain(&mut self.wall_torque);
        rates.for_each(|q| *q /= dt);
        self.mean_velocity.iter_mut().for_each(|v| *v /= dt);
        self.mean_temperature.iter_mut().for_each(|t| *t /= dt);
        report.wall_heat = self.wall_heat.iter().sum();
        report.cost = std::mem::take(&mut self.problem.cost);
        report
    }

    /// What is a mean over the last step.
    pub fn means(&self) -> Means<D> {
        Means {
            vectors: [&self.contact_force, &self.wall_force, &self.mean_velocity].map(Vec::clone),
            numbers: [&self.contact_heat, &self.wall_heat, &self.wall_torque, &self.mean_temperature]
                .map(Vec::clone),
        }
    }

    /// Takes means for those over the last step, as after [`Self::restore`] of a state within a step.
    pub fn set_means(&mut self, means: Means<D>) {
        [self.contact_force, self.wall_force, self.mean_velocity] = means.vectors;
        [self.contact_heat, self.wall_heat, self.wall_torque, self.mean_temperature] = means.numbers;
    }

    /// Takes the last step for the last `share` of a longer one, of whose rest these are the means.
    pub fn go_on_from(&mut self, means: &Means<D>, share: f64) {
        let vectors = [&mut self.contact_force, &mut self.wall_force, &mut self.mean_velocity];
        vectors.into_iter().zip(&means.vectors).for_each(|(mean, old)| blend(mean, old, share));
        let numbers =
            [&mut self.contact_heat, &mut self.wall_heat, &mut self.wall_torque, &mut self.mean_temperature];
        numbers.into_iter().zip(&means.numbers).for_each(|(mean, old)| blend(mean, old, share));
    }

    /// The first grain whose place or velocity, now or after the forces, is not finite, or that would go farther than
    /// [`RUNAWAY`] radii; and its speed. No search for contacts would end.
    fn runaway(&self, dt: f64, load: &Load<'_, D>) -> Option<(u32, f64)> {
        let (scene, p) = (self.scene(dt, load), &self.particles);
        let squares = |i: usize| [p.velocity[i], scene.free_velocity(i)].map(|v| v.norm_squared());
        let radii = |i: usize| {
            let spin = p.rotation.as_ref().map_or(0.0, |rotation| rotation.spin[i]);
            let [now, after] = squares(i);
            let finite = [now, after, spin].iter().chain(p.position[i].iter()).all(|x| x.is_finite());
            if finite { now.max(after).sqrt() * dt / p.radius[i] } else { f64::INFINITY }
        };
        if parallel::largest(0..p.len(), &radii) <= RUNAWAY {
            return None;
        }
        let first = (0..p.len()).find(|i| radii(*i) > RUNAWAY)?;
        let [now, after] = squares(first);
        Some((first as u32, now.max(after).sqrt()))
    }

    fn substep(&mut self, [h, step]: [f64; 2], load: &Load<'_, D>, last: bool, report: &mut StepReport) {
        self.placed.clear();
        self.placed.extend(self.walls.iter().map(|w| Placed::new(w, self.time, h)));
        let error = self.solve_contacts([h, step], load, report);
        self.exchange_heat(h, load, report);
        self.move_grains([h, step], load, (error, last), report);
    }

    /// Heat from outside and through contacts, with the forces of this sub-step.
    fn exchange_heat(&mut self, h: f64, load: &Load<'_, D>, report: &mut StepReport) {
        let Some(mut heat) = self.particles.heat.take() else { return };
        let mut conductor = std::mem::take(&mut self.conductor);
        let scene = self.scene(h, load);
        if let Some(law) = self.settings.conduction {
            conductor.link(law, &scene, self.search.forces(&self.problem, h));
            let outcome = conductor.solve(&scene, &heat);
            report.heat_iterations += outcome.iterations;
            report.converged &= outcome.converged;
        }
        for i in 0..heat.temperature.len() {
            heat.temperature[i] = scene.warmed(i, &heat, conductor.into_grain.get(i).copied().unwrap_or(0.0));
        }
        let sums = self.contact_heat.iter_mut().zip(&conductor.into_grain);
        for (sum, q) in sums.chain(self.wall_heat.iter_mut().zip(&conductor.out_of_wall)) {
            *sum += q * h;
        }
        for (mean, temperature) in self.mean_temperature.iter_mut().zip(&heat.temperature) {
            *mean += temperature * h;
        }
        self.conductor = conductor;
        self.particles.heat = Some(heat);
    }

    /// Sub-steps in which no grain crosses more than the allowed share of its radius, judged by its
    /// velocity now and after the forces.
    fn substeps(&self, dt: f64, load: &Load<'_, D>) -> usize {
        let (scene, p) = (self.scene(dt, load), &self.particles);
        let squared = |i: usize| p.velocity[i].norm_squared().max(scene.free_velocity(i).norm_squared());
        self.travel(dt, squared).ceil().max(1.0) as usize
    }

    /// The farthest that a grain goes in `dt` at a speed given by its square, over what it may in a sub-step.
    fn travel(&self, dt: f64, squared: impl Fn(usize) -> f64 + Sync) -> f64 {
        let radius = &self.particles.radius;
        let farthest = parallel::largest(0..radius.len(), &|i| squared(i).sqrt() / radius[i]);
        farthest * dt / self.settings.max_travel
    }

    fn scene<'a>(&'a self, h: f64, load: &'a Load<'a, D>) -> Scene<'a, D> {
        Scene {
            particles: &self.particles,
            materials: &self.materials,
            walls: &self.walls,
            placed: &self.placed,
            settings: &self.settings,
            laws: self.laws.as_ref(),
            load,
            h,
            rest: self.settings.rest(),
        }
    }

    /// Mean velocity of each grain over the last step, m/s; empty without implicit drag ([`Load::drag`]).
    pub fn mean_velocity(&self) -> &[Vector<D>] {
        &self.mean_velocity
    }

    /// Mean over the last step of the temperatures at the ends of its sub-steps, K; empty without implicit transfer
    /// ([`Load::transfer`]).
    pub fn mean_temperature(&self) -> &[f64] {
        &self.mean_temperature
    }

    /// Conductance of all contacts of each grain in the last sub-step, W/K: sum of H. Empty without conduction.
    pub fn conductance(&self) -> impl Iterator<Item = f64> + '_ {
        self.conductor.conductance()
    }

    /// The budget of mechanical energy; zeros unless [`Settings::energy`] asks for it.
    pub fn energy(&self) -> &Energy {
        &self.energy
    }

    /// Saves the state of the grains, to come back to by [`Self::rewind`] after a step on trial.
    pub fn save(&mut self) {
        let aged = self.settings.cohesion.is_some();
        self.saved.save(self.time, &self.particles, aged.then_some(&self.memory));
        self.saved.contact_force.clone_from(&self.contact_force);
        self.saved.contact_heat.clone_from(&self.contact_heat);
        self.saved.energy = self.energy;
    }

    /// Back to the last [`Self::save`]. The impulses stay those of the step on trial: the next one starts warm from
    /// them.
    pub fn rewind(&mut self) {
        self.time = self.saved.restore(&mut self.particles, &mut self.memory);
        self.contact_force.clone_from(&self.saved.contact_force);
        self.contact_heat.clone_from(&self.saved.contact_heat);
        self.energy = self.saved.energy;
    }

    /// Puts the means over several steps, that together were one, in the place of [`Self::wall_force`] (N),
    /// [`Self::wall_heat`] (W) and [`Self::wall_torque`] (N m) of the last.
    ///
    /// # Panics
    /// There are more or fewer than walls.
    pub fn set_walls(&mut self, force: Vec<Vector<D>>, heat: Vec<f64>, torque: Vec<f64>) {
        let counts = (self.wall_force.len(), self.wall_heat.len(), self.wall_torque.len());
        assert_eq!((force.len(), heat.len(), torque.len()), counts, "one per wall");
        (self.wall_force, self.wall_heat, self.wall_torque) = (force, heat, torque);
    }

    /// Mean contact force on each grain over the last step, walls included, N (per metre of depth).
    pub fn contact_force(&self) -> &[Vector<D>] {
        &self.contact_force
    }

    /// Mean heat that each grain received through contacts over the last step, W; empty without heat.
    pub fn contact_heat(&self) -> &[f64] {
        &self.contact_heat
    }

    /// Mean force of the grains on each wall over the last step, N (per metre of depth).
    pub fn wall_force(&self) -> &[Vector<D>] {
        &self.wall_force
    }

    /// Mean heat from each wall to the grains over the last step, W; empty without heat.
    pub fn wall_heat(&self) -> &[f64] {
        &self.wall_heat
    }

    /// Mean moment of the forces of the grains on each wall that turns, about its pivot, over the last step, N m (per
    /// metre of depth), counter-clockwise; zero of the others.
    pub fn wall_torque(&self) -> &[f64] {
        &self.wall_torque
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// The walls as given; [`Wall::at`] says where they are.
    pub fn walls(&self) -> &[Wall<D>] {
        &self.walls
    }

    /// The materials.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// The settings.
    pub fn settings(&self) -> &Settings<D> {
        &self.settings
    }
}
