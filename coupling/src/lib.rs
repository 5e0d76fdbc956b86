//! Everything between grains and fluid.
//!
//! [`Coupled`] holds what a scene has - grains, fluid, both - and advances it through a [`scheme`]. The seam
//! is one affine law ([`load::GrainLoad`]) that every scheme fills, and every fluid solver gets as point terms
//! ([`exchange`]).

mod agreement;
pub mod backend;
pub mod build;
pub mod closure;
pub mod compare;
pub mod error;
pub mod exchange;
pub mod launch;
pub mod load;
pub mod motion;
pub mod overlap;
pub mod peer;
pub mod placing;
pub mod protocol;
pub mod recorder;
pub mod remote;
pub mod renewal;
pub mod scene;
pub mod scheme;
pub mod serve;
pub mod simulation;
pub mod totals;
pub mod transport;

pub use agreement::{Agreement, Carried};
pub use error::{Error, PeerError, Result};
pub use scene::Scene;
pub use simulation::Simulation;

use backend::{FluidBackend, FluidStep, Immersed, Solution};
use closure::{Drag, HeatTransfer, Surroundings, ThermalFluid, VoidageFunction};
use exchange::{AtGrains, OnMesh, Rigid};
use load::{GrainLoad, HeatLoad};
use motion::Swing;
use overlap::Overlap;
use rayon::prelude::*;
use renewal::Renewal;
use scheme::Scheme;
use scheme::anchored::Push;
use std::time::Instant;
use voidage_dem::{Dem, Load};
use voidage_fluid::conditions::{Condition, FlowCondition};
use voidage_fluid::flow::{Numerics, State};
use voidage_fluid::points::Points;
use voidage_fluid::{Mesh, Vector};

/// Place of the temperature among the scalars of a fluid with heat.
pub const HEAT: usize = 0;

/// Name of the temperature among the scalars.
pub const TEMPERATURE: &str = "temperature";

/// Wall time of the phases of a step, s.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Phases {
    /// Grains cut by the mesh, nodal voidage.
    pub overlap: f64,
    /// Drag and heat-transfer laws.
    pub closure: f64,
    /// Energy equation of the fluid.
    pub energy: f64,
    /// Momentum and mass of the fluid.
    pub flow: f64,
    /// What a step of the fluid solver takes beyond its equations: sampling at the grains, sums of the exchange.
    pub exchange: f64,
    /// Frames to and from a fluid solver in another process.
    pub transport: f64,
    /// Contacts and motion of the grains.
    pub contacts: f64,
    /// Meshes made anew.
    pub remesh: f64,
}

impl Phases {
    /// The phases by name.
    pub fn named(&self) -> [(&'static str, f64); 8] {
        [
            ("overlap", self.overlap),
            ("closure", self.closure),
            ("energy", self.energy),
            ("flow", self.flow),
            ("exchange", self.exchange),
            ("transport", self.transport),
            ("contacts", self.contacts),
            ("remesh", self.remesh),
        ]
    }

    /// Adds the times of another step.
    pub fn add(&mut self, other: &Phases) {
        self.overlap += other.overlap;
        self.closure += other.closure;
        self.energy += other.energy;
        self.flow += other.flow;
        self.exchange += other.exchange;
        self.transport += other.transport;
        self.contacts += other.contacts;
        self.remesh += other.remesh;
    }
}

/// What a step of the coupled system reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepReport {
    /// Wall time by phase.
    pub phases: Phases,
    /// The grains; absent without.
    pub grains: Option<voidage_dem::StepReport>,
    /// The fluid solver; absent without.
    pub fluid: Option<voidage_fluid::flow::Report>,
    /// |impulse that the grains got - impulse that the fluid lost at its points - change of what is carried to the next step|
    /// over the sum of |impulse| of the grains; with both only. The worst part of the step.
    pub momentum_exchange_defect: Option<f64>,
    /// The same for heat; with heat in both only.
    pub energy_exchange_defect: Option<f64>,
    /// Share of the solid volume that lies outside of the mesh, so that the fluid does not meet it; with both only.
    pub solid_volume_defect: Option<f64>,
    /// How far the grains are from what the fluid expected; with both only.
    pub agreement: Option<Agreement>,
    /// Whether the mesh was made anew after the step.
    pub renewed: bool,
}

impl StepReport {
    /// Largest relative residual of the solvers.
    pub fn residual(&self) -> f64 {
        let grains = self.grains.map_or(0.0, |grains| grains.residual);
        self.fluid.map_or(grains, |fluid| grains.max(fluid.residual))
    }
}

/// The fluid of a scene.
pub struct Fluid<const D: usize> {
    /// The solver.
    pub backend: Box<dyn FluidBackend<D>>,
    /// Its mesh.
    pub mesh: Mesh<D>,
    /// Nodal fields at the last accepted step.
    pub accepted: State<D>,
    /// What the solver answered last.
    pub solution: Solution<D>,
    /// Names of its scalars.
    pub scalars: Vec<String>,
    /// Conditions at full strength.
    pub conditions: Vec<Condition<D>>,
    /// Time over which prescribed velocities grow linearly from zero, s; 0 for at once.
    pub ramp: f64,
    /// Integral of each shape function, m3 (m2 in the plane).
    pub nodal_volume: Vec<f64>,
    /// How the mesh moves; absent if it stands still.
    pub motion: Option<Swing<D>>,
    /// How it is made anew; absent if it never is.
    pub renewal: Option<Renewal<D>>,
    /// Which mesh the solver has.
    generation: u32,
    /// Whether the nodes have left the places that they had when the solver got them.
    moved: bool,
}

impl<const D: usize> Fluid<D> {
    /// A fluid on a mesh that stands still, from these fields; the solver gets both.
    ///
    /// # Errors
    /// The solver cannot use them.
    pub fn new(
        backend: Box<dyn FluidBackend<D>>,
        mesh: Mesh<D>,
        fields: State<D>,
        scalars: Vec<String>,
        conditions: Vec<Condition<D>>,
    ) -> Result<Self> {
        let mut fluid = Self {
            backend,
            nodal_volume: mesh.nodal_volume(),
            mesh,
            accepted: fields,
            solution: Solution::default(),
            scalars,
            conditions,
            ramp: 0.0,
            motion: None,
            renewal: None,
            generation: 0,
            moved: true,
        };
        fluid.start()?;
        Ok(fluid)
    }

    /// Gives the solver the mesh where it is, and the accepted fields: nothing of earlier steps influences what follows.
    ///
    /// # Errors
    /// The solver cannot use them, or cannot be reached.
    pub fn start(&mut self) -> Result<()> {
        self.generation += u32::from(self.moved);
        self.moved = false;
        self.backend.set_mesh(&self.mesh, self.generation, &self.accepted)
    }

    /// Takes another mesh and the fields on it.
    ///
    /// # Errors
    /// Those of [`Self::start`].
    pub fn set_mesh(&mut self, mesh: Mesh<D>, fields: State<D>) -> Result<()> {
        self.nodal_volume = mesh.nodal_volume();
        (self.mesh, self.accepted, self.moved) = (mesh, fields, true);
        self.start()
    }

    /// Makes the last solution the accepted fields.
    pub fn accept(&mut self) {
        self.backend.accept();
        std::mem::swap(&mut self.accepted, &mut self.solution.fields);
    }

    /// The accepted fields on the mesh.
    pub fn on_mesh(&self) -> OnMesh<'_, D> {
        OnMesh { mesh: &self.mesh, fields: &self.accepted }
    }
}

/// Laws and properties of the exchange between grains and fluid.
#[derive(Clone, Copy, Debug)]
pub struct Laws {
    /// Drag law.
    pub drag: Drag,
    /// Voidage function of drag and heat transfer.
    pub voidage_function: VoidageFunction,
    /// Heat-transfer law.
    pub heat: HeatTransfer,
    /// Density of the fluid, kg/m3.
    pub density: f64,
    /// Viscosity of the fluid, Pa s.
    pub viscosity: f64,
    /// Thermal properties; absent unless grains and fluid both have a temperature.
    pub thermal: Option<ThermalFluid>,
}

/// State of the exchange between grains and fluid.
pub struct Interaction<const D: usize> {
    /// Laws by name.
    pub laws: Laws,
    /// The law of the grains.
    pub load: GrainLoad<D>,
    /// The same as the fluid solver gets it.
    pub points: Points<D>,
    /// The fluid at the grains by the last solution.
    pub at: AtGrains<D>,
    /// Voidage at each grain: mean of the nodal voidage over its pieces.
    pub voidage: Vec<f64>,
    /// Force of the fluid on each grain, mean over the last step, N.
    pub force: Vec<Vector<D>>,
    /// Heat from the fluid to each grain, mean over the last step, W; empty without heat.
    pub heat: Vec<f64>,
    /// Relative residual to which the fluid solver solves its energy equation: temperatures are known to about this share.
    pub heat_tolerance: f64,
    /// What the fluid still has to give; absent with schemes that move the grains by the force of the law.
    pub carried: Option<Carried<D>>,
    /// Force (N) and heat (W) that the fluid lost at the points in the last solution.
    pub lost: (Vector<D>, f64),
    overlap: Overlap<D>,
}

/// Grains and fluid, or one of them. What a scene does not have is not there.
#[derive(Default)]
pub struct Coupled<const D: usize> {
    /// The grains.
    pub grains: Option<Dem<D>>,
    /// The fluid.
    pub fluid: Option<Fluid<D>>,
    /// Their exchange; absent unless both are there.
    pub interaction: Option<Interaction<D>>,
    scheme: Option<Box<dyn Scheme<D>>>,
    time: f64,
    steps: u64,
}

impl<const D: usize> Interaction<D> {
    /// The exchange of `grains` with a fluid on `mesh`, solved to the default tolerance; `at` is the fluid at the grains in the beginning.
    ///
    /// # Errors
    /// A mesh that cannot be searched.
    pub fn new(laws: Laws, mesh: &Mesh<D>, grains: &Dem<D>, at: AtGrains<D>) -> Result<Self> {
        let count = grains.particles.position.len();
        let mut load = GrainLoad {
            volume: grains.particles.volume.clone(),
            drag: vec![0.0; count],
            mobility: vec![0.0; count],
            velocity: vec![Vector::zeros(); count],
            ..GrainLoad::default()
        };
        let mut heat = Vec::new();
        if laws.thermal.is_some() {
            let column = || vec![0.0; count];
            load.heat = Some(HeatLoad { coefficient: column(), mobility: column(), temperature: column() });
            heat = column();
        }
        let force = vec![Vector::zeros(); count];
        let overlap = Overlap::new(mesh)?;
        let heat_tolerance = Numerics::default().scalars.tolerance;
        Ok(Self {
            laws,
            load,
            points: Points::default(),
            at,
            voidage: vec![1.0; count],
            force,
            heat,
            heat_tolerance,
            carried: None,
            lost: (Vector::zeros(), 0.0),
            overlap,
        })
    }
}

impl<const D: usize> Coupled<D> {
    /// A system at time zero.
    pub fn new(
        grains: Option<Dem<D>>,
        fluid: Option<Fluid<D>>,
        interaction: Option<Interaction<D>>,
        scheme: Box<dyn Scheme<D>>,
    ) -> Self {
        Self { grains, fluid, interaction, scheme: Some(scheme), time: 0.0, steps: 0 }
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Steps done.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Advances by another scheme from now on.
    pub fn set_scheme(&mut self, scheme: Box<dyn Scheme<D>>) {
        self.scheme = Some(scheme);
    }

    /// Sets time and number of steps, at a restart.
    pub fn set_time(&mut self, time: f64, steps: u64) {
        (self.time, self.steps) = (time, steps);
    }

    /// One step of `dt` by the scheme.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh; the state is then that before the step (before the part that failed, where a scheme
    /// does a step in parts), except that the grains' hints and load columns may be those of the failed step.
    pub fn step(&mut self, dt: f64) -> Result<StepReport> {
        let Some(mut scheme) = self.scheme.take() else {
            return Err(Error::Run("a scheme called step of the system that it advances".into()));
        };
        self.move_mesh(|motion, time, points| motion.advance(time, dt, points));
        let report = scheme.step(self, dt);
        self.scheme = Some(scheme);
        let mut report = report?;
        self.renew_mesh(&mut report)?;
        Ok(report)
    }

    /// Pieces of the grains on the mesh and the voidage they make.
    ///
    /// # Errors
    /// A grain lies outside the mesh.
    pub fn cut_grains(&mut self, report: &mut StepReport) -> Result<()> {
        let (Some(grains), Some(fluid), Some(interaction)) =
            (&self.grains, &self.fluid, &mut self.interaction)
        else {
            return Ok(());
        };
        let start = Instant::now();
        let particles = &grains.particles;
        let GrainLoad { pieces, voidage, volume, .. } = &mut interaction.load;
        interaction.overlap.cut(&fluid.mesh, &particles.position, &particles.radius, pieces, volume)?;
        volume.iter_mut().zip(&particles.volume).for_each(|(inside, whole)| *inside *= whole);
        let volume = overlap::voidage(&fluid.mesh, pieces, volume, &fluid.nodal_volume, voidage);
        let exact: f64 = particles.volume.iter().sum();
        report.solid_volume_defect = Some(relative((volume - exact).abs(), exact));
        report.phases.overlap += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Drag and heat-transfer coefficients with the fluid of the last accepted step.
    pub fn evaluate_closures(&mut self, report: &mut StepReport) {
        let (Some(grains), Some(fluid), Some(interaction)) =
            (&self.grains, &self.fluid, &mut self.interaction)
        else {
            return;
        };
        let start = Instant::now();
        let (particles, laws, at) = (&grains.particles, interaction.laws, &interaction.at);
        let load = &mut interaction.load;
        let (pieces, voidage, mesh) = (&load.pieces, &load.voidage, &fluid.mesh);
        interaction.voidage.par_iter_mut().enumerate().with_min_len(256).for_each(|(i, mean)| {
            *mean = pieces.mean(i, mesh, voidage);
        });
        let voidage = &interaction.voidage;
        let around = |i: usize| Surroundings {
            slip: (at.velocity[i] - particles.velocity[i]).norm(),
            voidage: voidage[i],
            diameter: 2.0 * particles.radius[i],
            density: laws.density,
            viscosity: laws.viscosity,
        };
        let volume = &load.volume;
        load.drag.par_iter_mut().enumerate().with_min_len(256).for_each(|(i, gamma)| {
            *gamma = volume[i] * laws.drag.coefficient(&around(i), laws.voidage_function);
        });
        if let (Some(heat), Some(thermal)) = (&mut load.heat, &laws.thermal) {
            heat.coefficient.par_iter_mut().enumerate().with_min_len(256).for_each(|(i, coefficient)| {
                let law = laws.heat.coefficient(&around(i), thermal, laws.voidage_function);
                *coefficient = volume[i] * law;
            });
        }
        report.phases.closure += start.elapsed().as_secs_f64();
    }

    /// One solution of the fluid from its last accepted state.
    ///
    /// # Errors
    /// The solver failed.
    pub fn solve_fluid(&mut self, dt: f64, report: &mut StepReport) -> Result<()> {
        let Some(fluid) = &mut self.fluid else { return Ok(()) };
        let start = Instant::now();
        let immersed = match &mut self.interaction {
            Some(Interaction { load, points, laws, .. }) => {
                let rigid = Rigid { fluid: fluid.on_mesh(), density: laws.density, dt };
                load.fill_points(&rigid, (HEAT, fluid.scalars.len()), points);
                Some(Immersed { points, voidage: &load.voidage })
            }
            None => None,
        };
        let conditions = ramped(&fluid.conditions, fluid.ramp, self.time + dt);
        let motion = fluid.motion.as_ref().map(|motion| motion.of_step(&fluid.mesh.points));
        let (number, time, conditions) = (self.steps + 1, self.time, &conditions[..]);
        let step = FluidStep { number, time, dt, immersed, conditions, motion };
        fluid.moved |= step.motion.is_some();
        fluid.backend.solve(&step, &mut fluid.solution)?;
        if let Some(interaction) = &mut self.interaction {
            interaction.receive(&OnMesh { mesh: &fluid.mesh, fields: &fluid.solution.fields });
        }
        let Solution { report: solver, transport_s, .. } = &fluid.solution;
        report.phases.energy += solver.scalars_s;
        report.phases.flow += solver.flow_s;
        report.phases.transport += transport_s;
        let known = solver.scalars_s + solver.flow_s + transport_s;
        report.phases.exchange += start.elapsed().as_secs_f64() - known;
        report.fluid = Some(*solver);
        Ok(())
    }

    /// Contacts and motion of the grains under the forces and heat of the fluid.
    pub fn move_grains(&mut self, dt: f64, report: &mut StepReport) {
        let Some(grains) = &mut self.grains else { return };
        let start = Instant::now();
        let (force, heat): (&[_], &[_]) = match &self.interaction {
            Some(interaction) => (&interaction.force, &interaction.heat),
            None => (&[], &[]),
        };
        report.grains = Some(grains.step(dt, &Load { force, heat, ..Load::default() }));
        report.phases.contacts += start.elapsed().as_secs_f64();
    }

    /// The same under a push of the fluid with implicit drag and heat transfer: the force on a grain is push.force - gamma v,
    /// and its heat push.heat - hA T, with the means over the step. Contacts are solved with the mass m + gamma dt.
    pub fn push_grains(&mut self, dt: f64, push: &Push<D>, report: &mut StepReport) {
        let (Some(grains), Some(Interaction { load, .. })) = (&mut self.grains, &self.interaction) else {
            return;
        };
        let start = Instant::now();
        let transfer = load.heat.as_ref().map_or(&[][..], |heat| &heat.coefficient);
        let load =
            Load { force: &push.force, drag: &load.drag, heat: &push.heat, transfer, ..Load::default() };
        // Sweeps of trials count too.
        let before = report.grains.map_or(0, |grains| grains.sweeps);
        let moved = grains.step(dt, &load);
        report.grains = Some(voidage_dem::StepReport { sweeps: before + moved.sweeps, ..moved });
        report.phases.contacts += start.elapsed().as_secs_f64();
    }

    /// Makes the solution of the fluid the accepted one and moves the clock: the end of a step.
    pub fn accept(&mut self, dt: f64, report: &mut StepReport) {
        self.accept_part(dt, report);
        self.end_step();
    }

    /// Counts a step whose parts have all been accepted.
    pub(crate) fn end_step(&mut self) {
        self.steps += 1;
    }

    /// Makes the solution the accepted one and moves the clock by a part of a step.
    pub(crate) fn accept_part(&mut self, dt: f64, report: &mut StepReport) {
        if let Some(fluid) = &mut self.fluid {
            fluid.accept();
        }
        if let Some(interaction) = &mut self.interaction {
            interaction.balance(dt, report);
        }
        self.time += dt;
    }
}

impl<const D: usize> Interaction<D> {
    /// Takes a solution of the fluid: the fluid at the grains, force and heat on them by the affine law, and what the fluid
    /// lost.
    fn receive(&mut self, fluid: &OnMesh<'_, D>) {
        self.at.sample(&self.load.pieces, fluid, self.load.heat.as_ref().map(|_| HEAT));
        let (load, at) = (&self.load, &self.at);
        let forces = self.force.par_iter_mut().enumerate().with_min_len(256);
        forces.for_each(|(i, force)| *force = load.force(at, i));
        if let Some(columns) = &load.heat {
            let heats = self.heat.par_iter_mut().enumerate().with_min_len(256);
            heats.for_each(|(i, heat)| *heat = columns.heat(at, i));
        }
        self.lost = exchange::lost(&self.points, fluid, HEAT);
    }

    /// Compares what the grains got in a part of a step with what the fluid lost and what is carried on.
    fn balance(&mut self, dt: f64, report: &mut StepReport) {
        let worse = |worst: &mut Option<f64>, defect: f64| {
            // What is no number must not get lost in a maximum.
            *worst = Some(worst.map_or(defect, |worst| if worst > defect { worst } else { defect }));
        };
        let (mut force, mut heat) = (self.lost.0, self.lost.1);
        if let Some(carried) = &mut self.carried {
            let (impulse, warmth) = carried.change();
            (force, heat) = (force + impulse / dt, heat + warmth / dt);
        }
        let got: Vector<D> = self.force.iter().sum();
        let scale: f64 = self.force.iter().map(|f| f.norm()).sum();
        worse(&mut report.momentum_exchange_defect, relative((got - force).norm(), scale));
        if let Some(columns) = &self.load.heat {
            let got: f64 = self.heat.iter().sum();
            let scale: f64 = self.heat.iter().map(|q| q.abs()).sum();
            // Grains as warm as the fluid exchange the round-off of hA T.
            let warmth = columns.coefficient.iter().zip(&self.at.temperature);
            let through: f64 = warmth.map(|(h, t)| (h * t).abs()).sum();
            let defect = relative((got - heat).abs(), scale.max(1e-3 * through));
            worse(&mut report.energy_exchange_defect, defect);
        }
    }
}

fn relative(defect: f64, scale: f64) -> f64 {
    if scale > 0.0 { defect / scale } else { defect }
}

/// The conditions at a time: prescribed velocities grow over the ramp.
fn ramped<const D: usize>(conditions: &[Condition<D>], ramp: f64, time: f64) -> Vec<Condition<D>> {
    let mut scaled = conditions.to_vec();
    if time < ramp {
        for condition in &mut scaled {
            match &mut condition.flow {
                FlowCondition::Velocity(value) | FlowCondition::SuperficialVelocity(value) => {
                    value.scale(time / ramp);
                }
                _ => {}
            }
        }
    }
    scaled
}
