//! A scene in motion: what the program, the tests and the recorder drive.

mod chimney;
mod readings;
mod state;
mod wild;

pub use state::State;

use crate::build;
use crate::compare::{Findings, SideBySide};
use crate::network::{self, Network, Since};
use crate::placing::Placing;
use crate::recorder::{Checkpoint, FluidView, GrainView, Summary, View};
use crate::totals::{Overlap, Totals};
use crate::{Output, Scene, Time};
use readings::{bodies, turning};
use voidage_coupling::backend::FluidBackend;
use voidage_coupling::error::{Error, Notice, Result};
use voidage_coupling::{Agreement, Coupled, StepReport};
use voidage_dem::Motion;
use voidage_fluid::Vector;
use voidage_remote::launch::Host;
use wild::Drive;

/// The coupled system of a plane scene, its step, and what has added up over the steps.
pub struct Simulation {
    coupled: Coupled<2>,
    clock: Time,
    last: StepReport,
    totals: Totals,
    /// Mass (kg per metre of depth) and volume (m2) of the grains at time zero; those that are held excepted.
    bed: [f64; 2],
    /// Overlap of grains, as a share of the radius, that ends the run.
    max_penetration: f64,
    /// Height of the highest grain at time zero, m; zero without grains.
    surface: f64,
    /// Density, kg/m3, and heat capacity, J/m3/K, of the fluid; zero without.
    gas: (f64, f64),
    /// What is recorded.
    output: Output,
    /// Bodies that walls make up: how their columns are called, and the walls by number.
    bodies: Vec<(String, Vec<usize>)>,
    /// The part of the boundary of the mesh that turns, and how it moves.
    turning: Option<(String, Motion<2>)>,
    /// Times since which contacts carry a force; empty unless contacts are recorded.
    since: Since,
    network: Option<Network>,
    /// Events that have not taken place yet, the last first.
    events: Vec<Coming>,
    /// What drives the fluid.
    drive: Option<Drive>,
}

/// An event of the scene.
struct Coming {
    /// Steps that go before it.
    after: u64,
    /// The scene from then on.
    scene: Scene,
    /// Whether the coupling scheme is another one.
    scheme: bool,
}

impl Coming {
    /// The events of a scene, the last first.
    fn of(scene: &Scene) -> Result<Vec<Self>> {
        let mut events = vec![];
        let mut before = scene.before_step(0)?;
        for event in &scene.events {
            let after = scene.step_of(event);
            let now = scene.before_step(after)?;
            events.push(Self { after, scheme: build::other_scheme(&before, &now), scene: now.clone() });
            before = now;
        }
        events.reverse();
        Ok(events)
    }
}

/// An error on the way to the end of a step, with the number of the step and the time at its start, s.
fn in_step(step: u64, time: f64, error: Error) -> Error {
    Error::run(error.notice().within(format_args!("step {step}, from t = {time:.6e} s")))
}

impl Simulation {
    /// The scene at time zero.
    ///
    /// # Errors
    /// Those of [`build::coupled`].
    pub fn new(scene: &Scene) -> Result<Self> {
        Self::hosted(scene, &Host::default())
    }

    /// The scene at time zero, with a fluid solver in another process started by `host`, if the scene has one.
    ///
    /// # Errors
    /// Those of [`build::coupled`].
    pub fn hosted(scene: &Scene, host: &Host) -> Result<Self> {
        Self::placed(scene, host, &mut Placing::alone())
    }

    /// The same, with somebody who watches grains being placed, and a folder that keeps beds.
    ///
    /// # Errors
    /// Those of [`build::placed`].
    pub fn placed(scene: &Scene, host: &Host, placing: &mut Placing<'_>) -> Result<Self> {
        let coupled = build::placed(scene, host, placing)?;
        let bed = bed(&coupled);
        let (last, totals, clock) = (StepReport::default(), Totals::default(), scene.time.clone());
        let max_penetration = scene.contacts.clone().unwrap_or_default().max_penetration;
        let surface = coupled.grains().map_or(0.0, |grains| {
            let tops = grains.particles.position.iter().zip(&grains.particles.radius);
            // Without grains yet it is at zero.
            tops.map(|(x, radius)| x[1] + radius).reduce(f64::max).unwrap_or(0.0)
        });
        let gas = scene.fluid.as_ref().map_or((0.0, 0.0), |fluid| {
            let capacity = fluid.heat.as_ref().map_or(0.0, |heat| heat.heat_capacity);
            (fluid.density, fluid.density * capacity)
        });
        let drive = Drive::of(scene, coupled.fluid().map(|fluid| &fluid.mesh));
        let (output, since) = (scene.output.clone(), Since::new());
        let network = Network::new(&output, &coupled, &since);
        Ok(Self {
            coupled,
            clock,
            last,
            totals,
            bed,
            max_penetration,
            surface,
            gas,
            output,
            bodies: bodies(scene),
            turning: turning(scene),
            since,
            network,
            events: Coming::of(scene)?,
            drive,
        })
    }

    /// The scene at a checkpoint, with the grains that it has: none are placed. After a change of `time.step` the steps
    /// count as if all had been of the new length.
    ///
    /// # Errors
    /// Those of [`build::placed`], a checkpoint that does not fit the scene, a time that is no whole number of steps.
    pub fn restarted(scene: &Scene, host: &Host, checkpoint: &Checkpoint) -> Result<Self> {
        let state = State::of(checkpoint)?;
        let mut placing = match &state.grains {
            Some(grains) => Placing::given(grains.particles.clone()),
            None => Placing::alone(),
        };
        Self::placed(scene, host, &mut placing)?.at(state)
    }

    /// The same at a checkpoint.
    ///
    /// # Errors
    /// A checkpoint that does not fit the scene, a fluid solver that cannot be reached.
    pub fn restart(self, checkpoint: &Checkpoint) -> Result<Self> {
        self.at(State::of(checkpoint)?)
    }

    /// Lets other fluid solvers solve the given steps from the states of this run; `density` is that of the fluid,
    /// kg/m3.
    ///
    /// # Errors
    /// There is no fluid.
    pub fn beside(
        &mut self,
        density: f64,
        others: Vec<(String, Box<dyn FluidBackend<2>>)>,
        steps: Vec<u64>,
    ) -> Result<Findings> {
        let Some(fluid) = self.coupled.fluid_mut() else {
            return Err(Error::input("a scene without fluid has no fluid solvers to compare"));
        };
        let (mesh, fields, scalars) = (fluid.mesh.clone(), fluid.accepted.clone(), fluid.scalars.clone());
        let mut findings = Findings::default();
        fluid.wrap_backend(|first| {
            let beside = SideBySide::new(first, (&mesh, &fields), (density, &scalars), others, steps);
            findings = beside.findings();
            Box::new(beside)
        });
        Ok(findings)
    }

    /// The coupled system.
    pub fn coupled(&self) -> &Coupled<2> {
        &self.coupled
    }

    /// The coupled system, to change between two steps.
    pub fn coupled_mut(&mut self) -> &mut Coupled<2> {
        &mut self.coupled
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.clock.after(self.steps())
    }

    /// Steps done since time zero.
    pub fn steps(&self) -> u64 {
        self.coupled.steps()
    }

    /// Length of the last step, s; before the first, that of a step.
    fn last_length(&self) -> f64 {
        self.clock.length(self.steps().saturating_sub(1))
    }

    /// Sums and extremes over the steps of this process.
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// Whether the last step is done: not if the run failed after some of its parts.
    pub fn is_between_steps(&self) -> bool {
        (self.coupled.time() - self.time()).abs() <= 1e-3 * self.clock.step
    }

    /// Weight of the grains at time zero less buoyancy, (m - rho_f V) g over the extent of the mesh across gravity, Pa;
    /// with grains, fluid and gravity only.
    pub fn bed_weight_per_area(&self) -> Option<f64> {
        let coupled = &self.coupled;
        let (grains, fluid, interaction) = (coupled.grains()?, coupled.fluid()?, coupled.interaction()?);
        let gravity = grains.settings().gravity;
        if gravity.norm() == 0.0 {
            return None;
        }
        let across = Vector::<2>::new(-gravity[1], gravity[0]).normalize();
        let (lower, upper) = fluid.mesh.bounds();
        let width = (upper - lower).abs().dot(&across.abs());
        let [mass, volume] = self.bed;
        Some((mass - interaction.laws.density * volume) * gravity.norm() / width)
    }

    /// What has to be said of the steps of this process that fell short of something, a line each.
    pub fn shortcomings(&self) -> Vec<String> {
        self.totals.shortcomings(|wall| self.wall_name(wall), |source| self.source_name(source))
    }

    /// What to tell of the last step, where it is the first to fall short in some way.
    pub fn remarks(&self) -> Vec<Notice> {
        let (step, totals) = (self.steps(), &self.totals);
        let mut remarks = Vec::new();
        if totals.disagreeing.is_some_and(|tally| tally.first == step) {
            remarks.extend(self.last.agreement.as_ref().and_then(Agreement::complaint));
        }
        if let Some((source, grains)) = self.last.waiting.filter(|_| totals.waiting.first == step) {
            let name = self.source_name(source);
            let what = format!("source {name:?} finds no free place: {grains} grains that are due wait");
            remarks.push(Notice::new(
                what,
                "give it a larger box, a higher velocity or a lower rate, if that is not meant",
            ));
        }
        if let Some(overlap) = Overlap::deepest(&self.last).filter(|_| totals.penetrating.first == step) {
            let names = overlap.names(|wall| self.wall_name(wall));
            remarks.push(format!("{names} overlap by {:.2} of a radius", overlap.depth).into());
        }
        remarks
    }

    fn source_name(&self, number: usize) -> &str {
        let passage = self.coupled.passage.as_ref();
        passage.and_then(|passage| passage.sources.get(number)).map_or("", |source| &source.name)
    }

    fn wall_name(&self, number: u32) -> &str {
        let walls = self.coupled.grains().map_or(&[][..], |grains| grains.walls());
        walls.get(number as usize).map_or("", |wall| &wall.name)
    }

    /// One step.
    ///
    /// # Errors
    /// Those of [`Coupled::step`], with step and time in front; [`Error::Penetration`] after a step in which grains
    /// came further into each other or into walls than the scene allows: that step is done.
    pub fn step(&mut self) -> Result<StepReport> {
        let (step, time) = (self.steps() + 1, self.time());
        self.change_laws(step - 1, |event, steps| event.after <= steps)
            .map_err(|error| in_step(step, time, error))?;
        let report =
            self.coupled.step(self.clock.length(step - 1)).map_err(|error| in_step(step, time, error))?;
        self.last = report;
        self.totals.add(step, &report);
        if let (Some(missed), Some(grains)) =
            (report.grains.map(|g| g.missed_rebounds), self.coupled.grains())
            && missed > 0.0
        {
            let (all, most) = &mut self.totals.missed_rebounds;
            (*all, *most) = (*all + missed, most.max(grains.particles.kinetic_energy()));
        }
        self.check_speed().map_err(|error| in_step(step, time, error))?;
        if let Some(grains) = self.coupled.grains().filter(|_| self.output.contacts) {
            network::age(&mut self.since, grains, time);
        }
        match Overlap::deepest(&report).filter(|overlap| overlap.depth > self.max_penetration) {
            Some(overlap) => Err(Error::Penetration(self.too_deep(overlap))),
            None => Ok(report),
        }
    }

    /// Lets the events take place that are due after so many steps.
    fn change_laws(&mut self, steps: u64, due: impl Fn(&Coming, u64) -> bool) -> Result<()> {
        let mut scheme = false;
        while let Some(event) = self.events.pop_if(|event| due(event, steps)) {
            scheme |= event.scheme;
            // The last one has the changes of all.
            if self.events.last().is_none_or(|next| !due(next, steps)) {
                build::change(&mut self.coupled, &event.scene, scheme)?;
                self.drive_by(&event.scene);
            }
        }
        Ok(())
    }

    /// Puts what has added up over the steps into a summary.
    pub fn sum_up(&self, summary: &mut Summary) {
        let totals = &self.totals;
        summary.steps = self.steps();
        summary.time_s = self.time();
        let view = self.view();
        summary.grains = view.grains.map_or(0, |grains| grains.position.len());
        summary.nodes = view.fluid.map_or(0, |fluid| fluid.mesh.points.len());
        summary.cells = view.fluid.map_or(0, |fluid| fluid.mesh.cell_count());
        summary.bed_weight_per_area = self.bed_weight_per_area();
        summary.max_penetration_over_radius = totals.max_penetration_over_radius;
        summary.penetrating_steps = totals.max_penetration_over_radius.map(|_| totals.penetrating.steps);
        summary.unconverged_steps = totals.unconverged.steps;
        summary.fluid_solves = totals.fluid_solves;
        summary.contacts = totals.contacts;
        summary.disagreeing_steps = totals.disagreeing.map(|tally| tally.steps);
        summary.remeshings = (totals.remeshings > 0).then_some(totals.remeshings);
        summary.momentum_exchange_defect = totals.momentum_exchange_defect;
        summary.energy_exchange_defect = totals.energy_exchange_defect;
        summary.solid_volume_defect = totals.solid_volume_defect;
    }

    /// What ends a run whose grains overlap too much.
    fn too_deep(&self, overlap: Overlap) -> Notice {
        let (step, time, allowed) = (self.steps(), self.time(), self.max_penetration);
        let names = overlap.names(|wall| self.wall_name(wall));
        let tolerance = self.coupled.grains().map_or(0.0, |grains| grains.settings().tolerance);
        let unsolved = match self.last.grains.filter(|grains| grains.error > tolerance) {
            Some(grains) => {
                let residual = grains.residual;
                format!(
                    "; the contacts of this step are unsolved (residual {residual:.1e}): raise contacts.max_sweeps"
                )
            }
            None => String::new(),
        };
        Notice::new(
            format!(
                "step {step}, t = {time:.6} s: {names} overlap by {:.2} of a radius, more than \
                 contacts.max_penetration = {allowed} allows",
                overlap.depth
            ),
            format!(
                "walls may leave the grains no room, or time.step be too long for grains so fast{unsolved}"
            ),
        )
    }

    /// Computes the voidage of the grains where they are now, and what is recorded of their contacts, for
    /// [`Self::view`].
    ///
    /// # Errors
    /// A grain is outside the mesh.
    pub fn refresh(&mut self) -> Result<()> {
        if let Some(mixture) = self.coupled.mixture_mut() {
            mixture.cut_grains(&mut StepReport::default())?;
        }
        self.network = Network::new(&self.output, &self.coupled, &self.since);
        Ok(())
    }

    /// Speed of the fastest grain, m/s; zero without grains.
    pub fn fastest(&self) -> f64 {
        let grains = self.coupled.grains().map_or(&[][..], |grains| &grains.particles.velocity);
        grains.iter().map(|velocity| velocity.norm()).fold(0.0, f64::max)
    }

    /// The same for whether grains are at rest: no number while a source has yet to begin.
    pub fn unrest(&self) -> f64 {
        let sources = self.coupled.passage.iter().flat_map(|passage| &passage.sources);
        let waits = sources.map(|source| source.during[0]).any(|start| start >= self.time());
        if waits { f64::NAN } else { self.fastest() }
    }

    /// What the recorder writes; the voidage as of the last [`Self::refresh`].
    pub fn view(&self) -> View<'_, 2> {
        let grains = self.coupled.grains().map(|grains| {
            let particles = &grains.particles;
            GrainView {
                id: &particles.id,
                group: (grains.materials().len() > 1).then_some(particles.material.as_slice()),
                position: &particles.position,
                velocity: &particles.velocity,
                radius: &particles.radius,
                mass: &particles.mass,
                volume: &particles.volume,
                spin: particles.rotation.as_ref().map(|rotation| rotation.spin.as_slice()),
                temperature: particles.heat.as_ref().map(|heat| heat.temperature.as_slice()),
                period: grains.settings().period,
            }
        });
        let fluid = self.coupled.fluid().map(|fluid| FluidView {
            mesh: &fluid.mesh,
            fields: &fluid.accepted,
            voidage: self.coupled.interaction().map(|i| i.load.voidage.as_slice()),
            scalars: &fluid.scalars,
        });
        View { grains, fluid, network: self.network.as_ref() }
    }
}

/// Mass and volume of the grains that are not held.
fn bed(coupled: &Coupled<2>) -> [f64; 2] {
    let Some(grains) = coupled.grains() else { return [0.0; 2] };
    let all = grains.particles.mass.iter().zip(&grains.particles.volume);
    let free = all.filter(|(mass, _)| mass.is_finite());
    free.fold([0.0; 2], |[mass, volume], (m, v)| [mass + m, volume + v])
}
