//! A scene in motion: made from its description, stepped, looked at, stopped and restarted.

mod fluid;
mod grains;

use crate::recorder::{Checkpoint, FluidView, GrainView, Reading, View};
use crate::{Coupled, Error, Interaction, Laws, Phases, Result, Scene, StepReport, closure::ThermalFluid};
use serde::{Deserialize, Serialize};
use voidage_dem::Dem;
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::flow;

/// A scene in motion.
pub struct Simulation {
    coupled: Coupled<2>,
    step: f64,
    tolerance: f64,
    /// Nodal fields as last asked for; absent without a fluid.
    fields: Option<flow::State<2>>,
    report: StepReport,
    totals: Totals,
    bed_weight_per_area: Option<f64>,
}

/// Sums and extremes over the steps of a run.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Totals {
    /// Wall time by phase, s, of this process.
    #[serde(skip)]
    pub phases: Phases,
    /// Largest penetration over radius; absent without grains.
    pub max_penetration_over_radius: Option<f64>,
    /// Steps in which contacts or fluid stopped before their tolerance.
    pub unconverged_steps: u64,
    /// Largest relative defect of the momentum exchanged; absent unless grains and fluid are there.
    pub momentum_exchange_defect: Option<f64>,
    /// The same for heat; absent unless both have temperatures.
    pub energy_exchange_defect: Option<f64>,
    /// Largest relative defect of the solid volume on the mesh.
    pub solid_volume_defect: Option<f64>,
}

/// All that a checkpoint holds of a simulation.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    time: f64,
    steps: u64,
    grains: Option<voidage_dem::State<2>>,
    fluid: Option<flow::State<2>>,
    at: Option<AtBodies<2>>,
    totals: Totals,
}

impl Simulation {
    /// A scene at time 0.
    ///
    /// # Errors
    /// The parts of the scene do not fit together: the error points into the scene.
    pub fn new(scene: &Scene) -> Result<Self> {
        let mut grains = grains::build(scene)?;
        if let Some(grains) = &mut grains {
            grains::hold(scene, &mut grains.particles);
        }
        let fluid = fluid::build(scene)?;
        let interaction = match (&grains, &fluid) {
            (Some(grains), Some(fluid)) => Some(interaction(scene, grains, fluid)?),
            _ => None,
        };
        let bed_weight_per_area = bed_weight_per_area(scene, grains.as_ref(), fluid.as_ref());
        let scheme = scene.coupling.as_ref().map(|coupling| coupling.scheme).unwrap_or_default().build();
        let mut simulation = Simulation {
            coupled: Coupled::new(grains, fluid, interaction, scheme),
            step: scene.time.step,
            tolerance: scene.fluid.as_ref().map_or(0.0, |fluid| fluid.solver.tolerance),
            fields: None,
            report: StepReport::default(),
            totals: Totals::default(),
            bed_weight_per_area,
        };
        simulation.refresh()?;
        Ok(simulation)
    }

    /// A scene at the time of a checkpoint; it goes on bit for bit as if it had not stopped.
    ///
    /// # Errors
    /// The checkpoint does not fit the scene.
    pub fn restart(scene: &Scene, checkpoint: &Checkpoint) -> Result<Self> {
        let mut simulation = Simulation::new(scene)?;
        let state: State = checkpoint.state()?;
        let coupled = &mut simulation.coupled;
        coupled.set_time(state.time, state.steps);
        if let (Some(grains), Some(state)) = (&mut coupled.grains, state.grains) {
            grains.restore(state)?;
        }
        if let (Some(fluid), Some(state)) = (&mut coupled.fluid, state.fluid) {
            fluid.backend.start(&fluid.mesh, &state)?;
        }
        if let (Some(interaction), Some(at)) = (&mut coupled.interaction, state.at) {
            interaction.at = at;
        }
        simulation.totals = state.totals;
        simulation.refresh()?;
        Ok(simulation)
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.coupled.time()
    }

    /// Steps done.
    pub fn steps(&self) -> u64 {
        self.coupled.steps()
    }

    /// The parts.
    pub fn coupled(&self) -> &Coupled<2> {
        &self.coupled
    }

    /// Sums and extremes of the steps so far.
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// Weight of the grains less their buoyancy over the width of the fluid, Pa; absent unless grains and fluid are there.
    pub fn bed_weight_per_area(&self) -> Option<f64> {
        self.bed_weight_per_area
    }

    /// One step.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh.
    pub fn step(&mut self) -> Result<StepReport> {
        let report = self.coupled.step(self.step).map_err(|error| {
            let (step, time) = (self.coupled.steps() + 1, self.coupled.time());
            Error::Run(format!("step {step} at t = {time} s: {error}"))
        })?;
        self.totals.take(&report, self.tolerance, &self.coupled);
        self.report = report;
        Ok(report)
    }

    /// Fetches the nodal fields and cuts the grains at their present places, for [`Simulation::view`].
    ///
    /// # Errors
    /// The solver cannot be reached, or a grain left the mesh.
    pub fn refresh(&mut self) -> Result<()> {
        // What this cut takes and finds belongs to no step.
        self.coupled.cut_grains(&mut StepReport::default())?;
        if let Some(fluid) = &mut self.coupled.fluid {
            self.fields = Some(fluid.backend.fields()?);
        }
        Ok(())
    }

    /// What a recorder sees: grains as they are, fields as last refreshed.
    pub fn view(&self) -> View<'_, 2> {
        let grains = self.coupled.grains.as_ref().map(|grains| {
            let particles = &grains.particles;
            GrainView {
                position: &particles.position,
                velocity: &particles.velocity,
                radius: &particles.radius,
                mass: &particles.mass,
                volume: &particles.volume,
                spin: particles.rotation.as_ref().map(|rotation| rotation.spin.as_slice()),
                temperature: particles.heat.as_ref().map(|heat| heat.temperature.as_slice()),
            }
        });
        let fluid = self.coupled.fluid.as_ref().zip(self.fields.as_ref()).map(|(fluid, fields)| FluidView {
            mesh: &fluid.mesh,
            velocity: &fields.velocity,
            pressure: &fields.pressure,
            voidage: self.coupled.interaction.as_ref().map(|interaction| interaction.load.voidage.as_slice()),
            temperature: fields.temperature.as_deref(),
        });
        View { grains, fluid }
    }

    /// Quantities of the last step for the time series; zeros before the first.
    pub fn readings(&self) -> Vec<Reading> {
        let mut readings = Vec::new();
        let report = &self.report;
        if let Some(grains) = &self.coupled.grains {
            let step = report.grains.unwrap_or_default();
            readings.push(("contacts", step.contacts as f64));
            readings.push(("contact_sweeps", step.sweeps as f64));
            readings.push(("contact_residual", step.residual));
            readings.push(("max_penetration_over_radius", step.max_penetration_over_radius));
            if grains.walls().iter().any(|wall| wall.temperature.is_some()) && grains.particles.heat.is_some()
            {
                readings.push(("heat_from_walls_to_grains_W_per_m", step.wall_heat));
            }
        }
        if self.coupled.fluid.is_some() {
            let step = report.fluid.unwrap_or_default();
            readings.push(("flow_iterations", step.flow_iterations as f64));
            readings.push(("flow_residual", step.residual));
        }
        if let Some(interaction) = &self.coupled.interaction {
            readings.push((
                "vertical_force_on_grains_N_per_m",
                interaction.force.iter().map(|force| force.y).sum(),
            ));
            readings.push(("momentum_exchange_defect", report.momentum_exchange_defect));
            readings.push(("solid_volume_defect", report.solid_volume_defect));
            if interaction.load.heat.is_some() {
                readings.push(("heat_from_fluid_to_grains_W_per_m", interaction.heat.iter().sum()));
                readings.push(("energy_exchange_defect", report.energy_exchange_defect));
            }
        }
        readings
    }

    /// What a checkpoint needs. The solver forgets what it kept between steps, as it will have after a restart: the
    /// run that goes on and the one that is restarted are the same bit for bit.
    ///
    /// # Errors
    /// The solver cannot be reached.
    pub fn state(&mut self) -> Result<impl Serialize + use<>> {
        let fluid = match &mut self.coupled.fluid {
            Some(fluid) => {
                let fields = fluid.backend.fields()?;
                fluid.backend.start(&fluid.mesh, &fields)?;
                Some(fields)
            }
            None => None,
        };
        Ok(State {
            time: self.coupled.time(),
            steps: self.coupled.steps(),
            grains: self.coupled.grains.as_ref().map(Dem::state),
            fluid,
            at: self.coupled.interaction.as_ref().map(|interaction| interaction.at.clone()),
            totals: self.totals,
        })
    }
}

impl Totals {
    fn take(&mut self, report: &StepReport, tolerance: f64, coupled: &Coupled<2>) {
        self.phases.add(&report.phases);
        let raise = |largest: &mut Option<f64>, value: f64| {
            *largest = Some(largest.map_or(value, |old| old.max(value)))
        };
        if let Some(grains) = &report.grains {
            raise(&mut self.max_penetration_over_radius, grains.max_penetration_over_radius);
        }
        let contacts = report.grains.is_none_or(|grains| grains.converged);
        // A residual that is not a number is no convergence either.
        let flow = report.fluid.is_none_or(|fluid| fluid.residual <= tolerance * 1.001);
        self.unconverged_steps += u64::from(!(contacts && flow));
        if let Some(interaction) = &coupled.interaction {
            raise(&mut self.momentum_exchange_defect, report.momentum_exchange_defect);
            raise(&mut self.solid_volume_defect, report.solid_volume_defect);
            if interaction.load.heat.is_some() {
                raise(&mut self.energy_exchange_defect, report.energy_exchange_defect);
            }
        }
    }
}

/// The exchange between grains and fluid, with the fluid as it is at the start.
fn interaction(scene: &Scene, grains: &Dem<2>, parts: &crate::Fluid<2>) -> Result<Interaction<2>> {
    let (Some(fluid), coupling) = (&scene.fluid, scene.coupling.clone().unwrap_or_default()) else {
        return Err(Error::Run("an exchange without a fluid".into()));
    };
    let laws = Laws {
        drag: coupling.drag,
        voidage_function: coupling.voidage_function,
        heat: coupling.heat.unwrap_or_default(),
        density: fluid.density,
        viscosity: fluid.viscosity,
        thermal: fluid.heat.as_ref().filter(|_| coupling.heat.is_some()).map(|heat| ThermalFluid {
            conductivity: heat.conductivity,
            prandtl: heat.heat_capacity * fluid.viscosity / heat.conductivity,
        }),
    };
    let count = grains.particles.len();
    let velocity = fluid.initial_velocity.clone().unwrap_or_default().vector();
    let at = AtBodies {
        velocity: vec![velocity; count],
        pressure_gradient: vec![voidage_fluid::Vector::zeros(); count],
        temperature: fluid.heat.as_ref().map_or(Vec::new(), |heat| vec![heat.initial_temperature; count]),
    };
    Interaction::new(laws, &parts.mesh, grains, at)
}

fn bed_weight_per_area(
    scene: &Scene,
    grains: Option<&Dem<2>>,
    fluid: Option<&crate::Fluid<2>>,
) -> Option<f64> {
    let (grains, parts, fluid) = (grains?, fluid?, scene.fluid.as_ref()?);
    let (lower, upper) = parts.mesh.bounds();
    let particles = &grains.particles;
    let free = particles.mass.iter().zip(&particles.volume).filter(|(mass, _)| mass.is_finite());
    let weight: f64 = free.map(|(mass, volume)| mass - fluid.density * volume).sum();
    let weight = weight * scene.gravity.vector::<2>().norm() / (upper.x - lower.x);
    (weight > 0.0).then_some(weight)
}
