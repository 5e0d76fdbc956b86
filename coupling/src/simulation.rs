//! A scene in motion: what the program, the tests and the recorder drive.

use crate::backend::FluidBackend;
use crate::compare::{Findings, SideBySide};
use crate::error::Result;
use crate::launch::Host;
use crate::placing::Placing;
use crate::recorder::{Checkpoint, FluidView, GrainView, View};
use crate::renewal::Anew;
use crate::scene::Scene;
use crate::{Carried, Coupled, Phases, StepReport, build};
use serde::{Deserialize, Serialize};
use voidage_fluid::Vector;
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::flow;

/// The coupled system of a plane scene, its step, and what has added up over the steps.
pub struct Simulation {
    coupled: Coupled<2>,
    dt: f64,
    /// Fields of the fluid as last asked for.
    fields: Option<flow::State<2>>,
    last: StepReport,
    totals: Totals,
    bed_weight_per_area: Option<f64>,
}

/// Sums and extremes over the steps of this process; what the scene does not have is `None`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Totals {
    /// Wall time by phase.
    pub phases: Phases,
    /// Largest overlap of grains, as a share of the radius.
    pub max_penetration_over_radius: Option<f64>,
    /// Steps whose contacts did not reach the tolerance.
    pub unconverged_steps: u64,
    /// Solutions of the fluid; with grains and fluid only.
    pub fluid_solves: Option<u64>,
    /// Meshes made anew on the way.
    pub remeshings: u64,
    /// Steps in which grains and fluid did not agree within the tolerance; with both only.
    pub disagreeing_steps: Option<u64>,
    /// Largest [`StepReport::momentum_exchange_defect`].
    pub momentum_exchange_defect: Option<f64>,
    /// Largest [`StepReport::energy_exchange_defect`].
    pub energy_exchange_defect: Option<f64>,
    /// Largest [`StepReport::solid_volume_defect`].
    pub solid_volume_defect: Option<f64>,
}

/// All that a run needs to go on as if it had never stopped.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct State {
    time: f64,
    steps: u64,
    grains: Option<voidage_dem::State<2>>,
    fluid: Option<flow::State<2>>,
    anew: Option<Anew<2>>,
    at: Option<AtBodies<2>>,
    carried: Option<Carried<2>>,
}

impl Totals {
    fn add(&mut self, report: &StepReport) {
        let raise = |worst: &mut Option<f64>, now: Option<f64>| {
            *worst = now.map(|now| worst.map_or(now, |worst| worst.max(now))).or(*worst);
        };
        self.phases.add(&report.phases);
        self.remeshings += u64::from(report.renewed);
        self.unconverged_steps += u64::from(report.grains.is_some_and(|grains| !grains.converged));
        if let Some(agreement) = &report.agreement {
            *self.fluid_solves.get_or_insert(0) += agreement.solves as u64;
            *self.disagreeing_steps.get_or_insert(0) += u64::from(!agreement.converged);
        }
        raise(&mut self.max_penetration_over_radius, report.grains.map(|g| g.max_penetration_over_radius));
        raise(&mut self.momentum_exchange_defect, report.momentum_exchange_defect);
        raise(&mut self.energy_exchange_defect, report.energy_exchange_defect);
        raise(&mut self.solid_volume_defect, report.solid_volume_defect);
    }
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
        let (last, totals) = (StepReport::default(), Totals::default());
        Ok(Self { coupled, dt: scene.time.step, fields: None, last, totals, bed_weight_per_area })
    }

    /// The same at a checkpoint.
    ///
    /// # Errors
    /// A checkpoint that does not fit the scene, a fluid solver that cannot be reached.
    pub fn restart(mut self, checkpoint: &Checkpoint) -> Result<Self> {
        let state: State = checkpoint.state()?;
        let coupled = &mut self.coupled;
        coupled.set_time(state.time, state.steps);
        if let Some(anew) = state.anew {
            coupled.take_anew(anew)?;
        }
        coupled.place_mesh();
        if let (Some(grains), Some(state)) = (&mut coupled.grains, state.grains) {
            grains.restore(state)?;
        }
        if let (Some(fluid), Some(fields)) = (&mut coupled.fluid, state.fluid) {
            fluid.backend.start(&fluid.mesh, &fields)?;
        }
        if let (Some(interaction), Some(at)) = (&mut coupled.interaction, state.at) {
            interaction.at = at;
            interaction.carried = state.carried;
        }
        Ok(self)
    }

    /// Lets other fluid solvers solve the given steps from the states of this run; `density` is that of the fluid, kg/m3.
    /// They are compared in the nodal fields when [`Self::refresh`] follows the step.
    ///
    /// # Errors
    /// There is no fluid.
    pub fn beside(
        &mut self,
        density: f64,
        others: Vec<(String, Box<dyn FluidBackend<2>>)>,
        steps: Vec<u64>,
    ) -> Result<Findings> {
        let coupled = &mut self.coupled;
        let Some(mut fluid) = coupled.fluid.take() else {
            return Err(crate::Error::Input("a scene without fluid has no fluid solvers to compare".into()));
        };
        let beside = SideBySide::new(fluid.backend, fluid.mesh.clone(), density, others, steps);
        let findings = beside.findings();
        fluid.backend = Box::new(beside);
        coupled.fluid = Some(fluid);
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

    /// One step.
    ///
    /// # Errors
    /// Those of [`Coupled::step`], with step and time in front.
    pub fn step(&mut self) -> Result<StepReport> {
        let (step, time) = (self.steps() + 1, self.time());
        let report = self
            .coupled
            .step(self.dt)
            .map_err(|error| crate::Error::Run(format!("step {step}, from t = {time:.6e} s: {error}")))?;
        self.last = report;
        self.totals.add(&report);
        Ok(report)
    }

    /// Fetches the fields of the fluid and the voidage of the grains where they are now, for [`Self::view`].
    ///
    /// # Errors
    /// The fluid solver cannot be reached, a grain is outside the mesh.
    pub fn refresh(&mut self) -> Result<()> {
        if let Some(fluid) = &mut self.coupled.fluid {
            self.fields = Some(fluid.backend.fields()?);
        }
        self.coupled.cut_grains(&mut StepReport::default())
    }

    /// What the recorder writes; the fluid as of the last [`Self::refresh`].
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
            voidage: self.coupled.interaction.as_ref().map(|i| i.load.voidage.as_slice()),
            temperature: fields.temperature.as_deref(),
        });
        View { grains, fluid }
    }

    /// Columns of the series that the view does not show: how the last step went; zeros before the first, so that the columns
    /// are always the same.
    pub fn readings(&self) -> Vec<(&'static str, f64)> {
        let mut readings = Vec::new();
        let last = &self.last;
        // A solver need not sum what it gives to the grains.
        let defect = |known: Option<f64>| known.unwrap_or(if last.fluid.is_some() { f64::NAN } else { 0.0 });
        if self.coupled.grains.is_some() {
            let grains = last.grains.unwrap_or_default();
            readings.extend([
                ("contacts", grains.contacts as f64),
                ("contact_sweeps", grains.sweeps as f64),
                ("contact_residual", grains.residual),
                ("substeps", grains.substeps as f64),
            ]);
        }
        if self.coupled.fluid.is_some() {
            let fluid = last.fluid.unwrap_or_default();
            readings.push(("linear_iterations", fluid.flow_iterations as f64));
        }
        if let Some(interaction) = &self.coupled.interaction {
            let agreement = last.agreement.unwrap_or_default();
            readings.extend([
                ("fluid_solves", agreement.solves as f64),
                ("step_parts", agreement.parts as f64),
                ("coupling_disagreement", agreement.disagreement),
                ("carried_impulse_share", agreement.carried),
            ]);
            readings.push(("momentum_exchange_defect", defect(last.momentum_exchange_defect)));
            if interaction.load.heat.is_some() {
                readings.push(("fluid_to_grain_heat_W_per_m", interaction.heat.iter().sum()));
                readings.push(("energy_exchange_defect", defect(last.energy_exchange_defect)));
            }
        }
        readings
    }

    /// The state to write in a checkpoint. What the linear solver keeps between steps is dropped, here as at a
    /// restart, so that a restarted run equals this one bit for bit.
    ///
    /// # Errors
    /// The fluid solver cannot be reached.
    pub fn state(&mut self) -> Result<State> {
        let coupled = &mut self.coupled;
        let fluid = match &mut coupled.fluid {
            None => None,
            Some(fluid) => {
                let fields = fluid.backend.fields()?;
                fluid.backend.start(&fluid.mesh, &fields)?;
                Some(fields)
            }
        };
        Ok(State {
            time: coupled.time(),
            steps: coupled.steps(),
            grains: coupled.grains.as_ref().map(|grains| grains.state()),
            fluid,
            anew: coupled.anew(),
            at: coupled.interaction.as_ref().map(|interaction| interaction.at.clone()),
            carried: coupled.interaction.as_ref().and_then(|interaction| interaction.carried.clone()),
        })
    }
}

/// (m - rho_f V) g over the extent of the mesh across gravity, grains that are held excepted.
fn bed_weight_per_area(coupled: &Coupled<2>) -> Option<f64> {
    let (grains, fluid, interaction) =
        (coupled.grains.as_ref()?, coupled.fluid.as_ref()?, coupled.interaction.as_ref()?);
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
