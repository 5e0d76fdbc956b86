//! A scene in motion: what the program, the tests and the recorder drive.

use crate::build;
use crate::compare::{Findings, SideBySide};
use crate::network::{self, Network, Since};
use crate::placing::Placing;
use crate::probes;
use crate::recorder::{Checkpoint, FluidView, GrainView, Reading, Summary, View, column_name};
use crate::totals::{Overlap, Totals};
use crate::{Output, Scene};
use serde::{Deserialize, Serialize};
use voidage_coupling::backend::FluidBackend;
use voidage_coupling::droplet::{Droplet, DropletState};
use voidage_coupling::error::{Error, Notice, Result};
use voidage_coupling::exchange::AtGrains;
use voidage_coupling::remesh::RemeshState;
use voidage_coupling::{Agreement, Appearing, Carried, Coupled, Fluid, StepReport, System, TEMPERATURE};
use voidage_dem::{Motion, PassageState, Passed, Rounded};
use voidage_fluid::Vector;
use voidage_fluid::balance::Balance;
use voidage_fluid::flow;
use voidage_remote::launch::Host;

/// The coupled system of a plane scene, its step, and what has added up over the steps.
pub struct Simulation {
    coupled: Coupled<2>,
    dt: f64,
    last: StepReport,
    totals: Totals,
    bed_weight_per_area: Option<f64>,
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

/// All that a run needs to go on as if it had never stopped.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct State {
    time: f64,
    steps: u64,
    pub(crate) grains: Option<voidage_dem::State<2>>,
    fluid: Option<flow::State<2>>,
    remeshed: Option<RemeshState<2>>,
    droplet: Option<DropletState<2>>,
    at: Option<AtGrains<2>>,
    carried: Option<Carried<2>>,
    departed: (u64, f64),
    appearing: Option<Appearing<2>>,
    passed: Option<PassageState>,
    /// Of the grains at time zero.
    bed_weight_per_area: Option<f64>,
    surface: f64,
    since: Since,
}

impl State {
    /// The state in a checkpoint.
    ///
    /// # Errors
    /// What cannot be decoded, columns of other lengths than the number of grains or nodes, values that are not finite.
    pub(crate) fn of(checkpoint: &Checkpoint) -> Result<Self> {
        let state: Self = checkpoint.state()?;
        let stamp = &checkpoint.stamp;
        // The sum of the steps drifts in its last digits.
        let stamped = stamp.step == state.steps && (stamp.time - state.time).abs() <= 1e-6 * stamp.time.abs();
        let wrong = (!stamped).then(|| "its time is not that of its head".to_owned());
        match wrong.or_else(|| state.wrong()) {
            Some(what) => Err(checkpoint.refused(&what)),
            None => Ok(state),
        }
    }

    /// What cannot be of a run, in words.
    fn wrong(&self) -> Option<String> {
        if let Some(Err(error)) = self.grains.as_ref().map(voidage_dem::State::validate) {
            return Some(error.to_string());
        }
        let grains = self.grains.as_ref().map_or(0, |grains| grains.particles.len());
        let finite = |columns: &[&[f64]]| columns.iter().all(|column| column.iter().all(|x| x.is_finite()));
        let vectors = |columns: &[&[Vector<2>]]| {
            columns.iter().all(|column| column.iter().flatten().all(|x| x.is_finite()))
        };
        // Before the first step there are none.
        let lengths = |columns: &[usize]| columns.iter().all(|length| [0, grains].contains(length));
        let fluid = self.fluid.as_ref().is_none_or(|fields| {
            let nodes = fields.pressure.len();
            fields.velocity.len() == nodes
                && vectors(&[&fields.velocity])
                && finite(&[&fields.pressure])
                && fields.scalars.iter().all(|values| values.len() == nodes && finite(&[values]))
        });
        let at = self.at.as_ref().is_none_or(|at| {
            lengths(&[at.velocity.len(), at.pressure_gradient.len(), at.temperature.len()])
                && vectors(&[&at.velocity, &at.pressure_gradient])
                && finite(&[&at.temperature])
        });
        let carried = self.carried.as_ref().is_none_or(|carried| {
            lengths(&[carried.impulse.len(), carried.displacement.len(), carried.heat.len()])
                && vectors(&[&carried.impulse, &carried.displacement])
                && finite(&[&carried.heat])
        });
        let time = self.time.is_finite() && self.time >= 0.0;
        let heights = [self.surface, self.departed.1, self.bed_weight_per_area.unwrap_or(0.0)];
        [
            ("time", time),
            ("fields of the fluid", fluid),
            ("values of the fluid at the grains", at),
            ("values of the coupling at the grains", carried),
            ("height or weight of the bed", finite(&[&heights])),
        ]
        .iter()
        .find(|(_, good)| !good)
        .map(|(name, _)| format!("wrong {name}"))
    }
}

/// The bodies that the walls of a scene make up, in the order of their first walls.
fn bodies(scene: &Scene) -> Vec<(String, Vec<usize>)> {
    let mut bodies: Vec<(String, Vec<usize>)> = Vec::new();
    for (number, wall) in scene.walls.iter().enumerate() {
        let name = column_name(wall.body());
        match bodies.iter_mut().find(|(known, _)| *known == name) {
            Some((_, walls)) => walls.push(number),
            None => bodies.push((name, vec![number])),
        }
    }
    bodies
}

/// The part of the boundary of the mesh that turns about a centre, and how it moves.
fn turning(scene: &Scene) -> Option<(String, Motion<2>)> {
    let motion = scene.fluid.as_ref()?.mesh_motion.as_ref()?;
    let table = motion.table.as_ref().filter(|table| !table.centre.is_empty())?;
    let (centre, rows) = (table.centre.vector(), table.rows.clone());
    Some((motion.boundary.clone()?, Motion::Table { centre, rows }))
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
        let bed_weight_per_area = bed_weight_per_area(&coupled);
        let (last, totals, dt) = (StepReport::default(), Totals::default(), scene.time.step);
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
        let (output, since) = (scene.output.clone(), Since::new());
        let network = Network::new(&output, &coupled, &since);
        Ok(Self {
            coupled,
            dt,
            last,
            totals,
            bed_weight_per_area,
            max_penetration,
            surface,
            gas,
            output,
            bodies: bodies(scene),
            turning: turning(scene),
            since,
            network,
            events: Coming::of(scene)?,
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

    fn at(mut self, state: State) -> Result<Self> {
        let steps = (state.time / self.dt).round();
        if (steps * self.dt - state.time).abs() > 1e-3 * self.dt {
            let (time, step) = (Rounded(state.time), Rounded(self.dt));
            let what =
                format!("the checkpoint is at t = {time} s, which is no whole number of steps of {step} s");
            return Err(Error::input(Notice::new(what, "give a `time.step` that divides that time")));
        }
        (self.bed_weight_per_area, self.surface) = (state.bed_weight_per_area, state.surface);
        self.change_laws(steps as u64, |event, steps| event.after < steps)?;
        let coupled = &mut self.coupled;
        coupled.set_time(state.time, steps as u64);
        if let (Some(fluid), Some(droplet)) = (coupled.fluid_mut(), state.droplet) {
            fluid.restore_droplet(droplet);
        }
        if let Some(remeshed) = state.remeshed {
            coupled.take_remeshed(remeshed)?;
        }
        coupled.place_mesh();
        if let (Some(mixture), Some(state)) = (coupled.mixture_mut(), &state.grains) {
            mixture.keep(&state.particles.id);
        }
        if let (Some(grains), Some(state)) = (coupled.grains_mut(), state.grains) {
            grains.restore(state)?;
        }
        if let (Some(fluid), Some(fields)) = (coupled.fluid_mut(), state.fluid) {
            let counts = |fields: &flow::State<2>| (fields.pressure.len(), fields.scalars.len());
            let (here, there) = (counts(&fluid.accepted), counts(&fields));
            if here.1 != there.1 || fluid.mesh.points.len() != there.0 {
                let what = format!(
                    "the checkpoint has {} scalars at {} nodes, the scene {} at {}",
                    there.1,
                    there.0,
                    here.1,
                    fluid.mesh.points.len()
                );
                return Err(Error::input(Notice::new(
                    what,
                    "restart with the scene.toml beside the checkpoint",
                )));
            }
            fluid.accepted = fields;
            fluid.start()?;
        }
        if let (Some(interaction), Some(at)) = (coupled.interaction_mut(), state.at) {
            interaction.at = at;
            interaction.carried = state.carried;
            interaction.departed = state.departed.0;
            interaction.departed_mass = state.departed.1;
            interaction.appearing = state.appearing.unwrap_or_default();
        }
        if let (Some(passage), Some(passed)) = (&mut coupled.passage, state.passed) {
            passage.restore(passed);
        }
        self.since = state.since;
        Ok(self)
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
        // Not the sum of the steps, whose last digits drift.
        self.steps() as f64 * self.dt
    }

    /// Steps done since time zero.
    pub fn steps(&self) -> u64 {
        self.coupled.steps()
    }

    /// Sums and extremes over the steps of this process.
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// Weight of the grains less buoyancy, over the width of the mesh, Pa; with grains and fluid only.
    pub fn bed_weight_per_area(&self) -> Option<f64> {
        self.bed_weight_per_area
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
        let report = self.coupled.step(self.dt).map_err(|error| in_step(step, time, error))?;
        self.last = report;
        self.totals.add(step, &report);
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
            }
        }
        Ok(())
    }

    /// Puts what has added up over the steps into a summary.
    pub fn sum_up(&self, summary: &mut Summary) {
        let totals = &self.totals;
        summary.steps = self.steps();
        summary.time_s = self.time();
        summary.max_penetration_over_radius = totals.max_penetration_over_radius;
        summary.penetrating_steps = totals.max_penetration_over_radius.map(|_| totals.penetrating.steps);
        summary.unconverged_steps = totals.unconverged.steps;
        summary.fluid_solves = totals.fluid_solves;
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
        let unsolved = match self.last.grains.filter(|grains| !grains.converged) {
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

    /// Columns of the series that the view does not show: how the last step went, and what passed the boundary in it;
    /// zeros before the first, so that the columns are always the same.
    pub fn readings(&self) -> Vec<Reading> {
        let (mut readings, last) = (Vec::<Reading>::new(), &self.last);
        if let Some(grains) = self.coupled.grains() {
            let step = last.grains.unwrap_or_default();
            readings.extend([
                ("contacts".into(), step.contacts as f64),
                ("contact_sweeps".into(), step.sweeps as f64),
                ("contact_residual".into(), step.residual),
                ("substeps".into(), step.substeps as f64),
            ]);
            for (name, walls) in &self.bodies {
                let force: Vector<2> = walls.iter().map(|wall| grains.wall_force()[*wall]).sum();
                for (axis, force) in ["x", "y"].iter().zip(force.iter()) {
                    readings.push((format!("wall_force_{name}_{axis}_N_per_m").into(), *force));
                }
            }
            for (name, walls) in &self.bodies {
                if walls.iter().all(|wall| grains.walls()[*wall].pivot(0.0).is_some()) {
                    let torque: f64 = walls.iter().map(|wall| grains.wall_torque()[*wall]).sum();
                    readings.push((format!("wall_torque_{name}_N").into(), torque));
                }
            }
            readings.extend_from_slice(self.network.as_ref().map_or(&[], Network::readings));
        }
        self.passage_readings(&mut readings);
        if let Some(fluid) = self.coupled.fluid() {
            let report = last.fluid.unwrap_or_default();
            readings.push(("linear_iterations".into(), report.flow_iterations as f64));
            self.boundary_readings(fluid, &mut readings);
            self.remesh_readings(fluid, &mut readings);
            if let Some(droplet) = &fluid.droplet {
                droplet_readings(droplet, (self.dt, self.surface), &mut readings);
            }
        }
        if let Some(interaction) = self.coupled.interaction() {
            let agreement = last.agreement.unwrap_or_default();
            readings.extend([
                ("fluid_solves".into(), agreement.solves as f64),
                ("step_parts".into(), agreement.parts as f64),
                ("coupling_disagreement".into(), agreement.disagreement),
                ("carried_impulse_share".into(), agreement.carried),
                ("grains".into(), interaction.force.len() as f64),
                ("grains_left".into(), interaction.departed as f64),
                ("mass_left_kg_per_m".into(), interaction.departed_mass),
                ("solid_inflow_m2_per_s".into(), last.appeared.unwrap_or_default() / self.dt),
                ("solid_volume_defect".into(), last.solid_volume_defect.unwrap_or_default()),
                ("momentum_exchange_defect".into(), last.momentum_exchange_defect.unwrap_or_default()),
            ]);
            if interaction.load.heat.is_some() {
                let defect = last.energy_exchange_defect.unwrap_or_default();
                readings.push(("fluid_to_grain_heat_W_per_m".into(), interaction.heat.iter().sum()));
                readings.push(("energy_exchange_defect".into(), defect));
            }
        }
        if !self.output.probes.is_empty() {
            readings.extend(probes::readings(&self.output.probes, &self.view()));
        }
        readings
    }

    /// What passed sources and sinks.
    fn passage_readings(&self, readings: &mut Vec<Reading>) {
        let Some(passage) = &self.coupled.passage else { return };
        if let System::Grains(grains, _) = &self.coupled.system {
            readings.push(("grains".into(), grains.particles.len() as f64));
        }
        let mut add = |kind: &str, name: &str, passed: &Passed| {
            let name = column_name(name);
            readings.extend([
                (format!("{kind}_{name}_grains").into(), passed.grains as f64),
                (format!("{kind}_{name}_mass_kg_per_m").into(), passed.mass),
                (format!("{kind}_{name}_mass_flow_kg_per_s_per_m").into(), passed.last / self.dt),
            ]);
        };
        for (source, fed) in passage.sources.iter().zip(&passage.state().fed) {
            add("source", &source.name, &fed.passed);
        }
        for (sink, taken) in passage.sinks.iter().zip(&passage.state().taken) {
            add("sink", &sink.name, taken);
        }
        for (source, fed) in passage.sources.iter().zip(&passage.state().fed) {
            readings
                .push((format!("source_{}_waiting", column_name(&source.name)).into(), fed.waiting as f64));
        }
    }

    /// What interpolation to new meshes has changed since time zero, where the domain is remeshed.
    fn remesh_readings(&self, fluid: &Fluid<2>, readings: &mut Vec<Reading>) {
        let Some(remesher) = &fluid.remesher else { return };
        let (changed, (density, capacity)) = (&remesher.changed, self.gas);
        for (axis, velocity) in ["x", "y"].iter().zip(changed.velocity.iter()) {
            readings.push((format!("remesh_momentum_{axis}_N_s_per_m").into(), density * velocity));
        }
        for (k, scalar) in fluid.scalars.iter().enumerate() {
            let change = changed.scalars.get(k).copied().unwrap_or_default();
            readings.push(match scalar.as_str() {
                TEMPERATURE => ("remesh_heat_J_per_m".into(), capacity * change),
                other => (format!("remesh_{other}_m2").into(), change),
            });
        }
    }

    /// What passed each part of the boundary of the mesh in the last step; no numbers where the solver does not compute
    /// it.
    fn boundary_readings(&self, fluid: &Fluid<2>, readings: &mut Vec<Reading>) {
        let steps = self.last.fluid.is_some();
        let none = Balance {
            flux: if steps { f64::NAN } else { 0.0 },
            force: Vector::repeat(if steps { f64::NAN } else { 0.0 }),
            torque: vec![if steps { f64::NAN } else { 0.0 }],
            scalars: vec![if steps { f64::NAN } else { 0.0 }; fluid.scalars.len()],
            convected: vec![if steps { f64::NAN } else { 0.0 }; fluid.scalars.len()],
        };
        // A droplet that has vanished keeps its columns, with zeros.
        let gone = fluid.droplet.as_ref().filter(|droplet| droplet.state.gone);
        let nothing = Balance::none(fluid.scalars.len());
        let parts = fluid.conditions.iter().enumerate().map(|(part, condition)| {
            (&condition.boundary, fluid.solution.balances.get(part).unwrap_or(&none))
        });
        for (name, balance) in parts.chain(gone.map(|droplet| (&droplet.boundary, &nothing))) {
            let turning = self.turning.as_ref().filter(|(part, _)| part == name);
            let name = column_name(name);
            readings.push((format!("flux_{name}_m2_per_s").into(), balance.flux));
            for (axis, force) in ["x", "y"].iter().zip(balance.force.iter()) {
                readings.push((format!("force_{name}_{axis}_N_per_m").into(), *force));
            }
            if let Some((_, motion @ Motion::Table { centre, .. })) = turning {
                // That of the balance is about the origin.
                let (centre, force) = (motion.carry(*centre, self.time()), balance.force);
                let torque = balance.torque[0] - (centre.x * force.y - centre.y * force.x);
                readings.push((format!("torque_{name}_N").into(), torque));
            }
            for (k, scalar) in fluid.scalars.iter().enumerate() {
                let (given, convected) = match scalar.as_str() {
                    TEMPERATURE => (format!("heat_{name}_W_per_m"), format!("convected_heat_{name}_W_per_m")),
                    other => {
                        (format!("{other}_{name}_m2_per_s"), format!("convected_{other}_{name}_m2_per_s"))
                    }
                };
                readings.push((given.into(), balance.scalars[k]));
                readings.push((convected.into(), balance.convected[k]));
            }
        }
    }

    /// The state to write in a checkpoint. What the linear solver keeps between steps is dropped, here as at a
    /// restart, so that a restarted run equals this one bit for bit.
    ///
    /// # Errors
    /// The fluid solver cannot be reached.
    pub fn state(&mut self) -> Result<State> {
        let (step, time) = (self.steps() + 1, self.time());
        if let Some(fluid) = self.coupled.fluid_mut() {
            fluid.start().map_err(|error| in_step(step, time, error))?;
        }
        Ok(self.last_state())
    }

    /// The same without a word to the fluid solver: of a run that cannot go on, or that goes on as if nothing had been
    /// written. A restart from it agrees to the tolerance of the linear solver.
    pub fn last_state(&self) -> State {
        let coupled = &self.coupled;
        State {
            time: coupled.time(),
            steps: coupled.steps(),
            grains: coupled.grains().map(|grains| grains.state()),
            fluid: coupled.fluid().map(|fluid| fluid.accepted.clone()),
            remeshed: coupled.fluid().and_then(Fluid::remesh_state),
            droplet: coupled.fluid().and_then(|fluid| fluid.droplet.as_ref()).map(|d| d.state.clone()),
            at: coupled.interaction().map(|interaction| interaction.at.clone()),
            carried: coupled.interaction().and_then(|interaction| interaction.carried.clone()),
            departed: coupled.interaction().map_or((0, 0.0), |i| (i.departed, i.departed_mass)),
            appearing: coupled.interaction().map(|interaction| interaction.appearing.clone()),
            passed: coupled.passage.as_ref().map(|passage| passage.state().clone()),
            bed_weight_per_area: self.bed_weight_per_area,
            surface: self.surface,
            since: self.since.clone(),
        }
    }
}

/// Where a droplet is and what it does; `surface` is the height of the bed at time zero, m.
fn droplet_readings(droplet: &Droplet<2>, (dt, surface): (f64, f64), readings: &mut Vec<Reading>) {
    let (state, settled, material) = (&droplet.state, &droplet.settled, &droplet.material);
    let [x, y] = [state.centre[0], state.centre[1]];
    let missed = droplet.momentum_defect();
    readings.extend([
        ("droplet_x_m".into(), x),
        ("droplet_y_m".into(), y),
        ("droplet_depth_m".into(), surface - (y - state.radius)),
        ("droplet_velocity_x_m_per_s".into(), state.velocity[0]),
        ("droplet_velocity_y_m_per_s".into(), state.velocity[1]),
        ("droplet_radius_m".into(), state.radius),
        ("droplet_liquid_kg_per_m".into(), droplet.mass()),
        ("vaporisation_kg_per_s_per_m".into(), droplet.vaporisation()),
        ("droplet_gas_force_x_N_per_m".into(), state.force[0]),
        ("droplet_gas_force_y_N_per_m".into(), state.force[1]),
        ("droplet_grain_force_x_N_per_m".into(), settled.force[0]),
        ("droplet_grain_force_y_N_per_m".into(), settled.force[1]),
        ("droplet_grain_pressure_force_x_N_per_m".into(), -settled.pressed[0]),
        ("droplet_grain_pressure_force_y_N_per_m".into(), -settled.pressed[1]),
        ("droplet_gas_heat_W_per_m".into(), state.heat),
        ("droplet_grain_heat_W_per_m".into(), settled.heat),
        ("droplet_lifetime_s".into(), {
            let rate = droplet.vaporisation();
            if rate == 0.0 { 0.0 } else { droplet.mass() / rate }
        }),
        ("droplet_absorption_number".into(), droplet.absorption * dt),
        ("droplet_volume_defect_m2".into(), state.volume),
        ("droplet_water_defect_kg_per_m".into(), {
            material.water.density * (droplet.first - state.boiled - state.liquid)
        }),
        ("droplet_momentum_defect_x_N_s_per_m".into(), missed.x),
        ("droplet_momentum_defect_y_N_s_per_m".into(), missed.y),
        ("droplet_heat_defect_J_per_m".into(), droplet.heat_defect()),
    ]);
}

/// (m - rho_f V) g over the extent of the mesh across gravity, grains that are held excepted.
fn bed_weight_per_area(coupled: &Coupled<2>) -> Option<f64> {
    let (grains, fluid, interaction) = (coupled.grains()?, coupled.fluid()?, coupled.interaction()?);
    let gravity = grains.settings().gravity;
    if gravity.norm() == 0.0 {
        return None;
    }
    let across = Vector::<2>::new(-gravity[1], gravity[0]).normalize();
    let (lower, upper) = fluid.mesh.bounds();
    let width = (upper - lower).abs().dot(&across.abs());
    let particles = &grains.particles;
    let mass: f64 = particles
        .mass
        .iter()
        .zip(&particles.volume)
        .filter(|(mass, _)| mass.is_finite())
        .map(|(mass, volume)| mass - interaction.laws.density * volume)
        .sum();
    Some(mass * gravity.norm() / width)
}
