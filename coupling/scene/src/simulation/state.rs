//! The state of a simulation, how a checkpoint gives it, and how a simulation takes it.

use super::Simulation;
use crate::network::Since;
use crate::recorder::Checkpoint;
use serde::{Deserialize, Serialize};
use voidage_coupling::droplet::DropletState;
use voidage_coupling::error::{Error, Notice, Result};
use voidage_coupling::exchange::AtGrains;
use voidage_coupling::remesh::RemeshState;
use voidage_coupling::{Appearing, Carried, Fluid};
use voidage_dem::{PassageState, Rounded};
use voidage_fluid::{Vector, flow};

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
    bed: [f64; 2],
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
        let heights = [self.surface, self.departed.1, self.bed[0], self.bed[1]];
        [
            ("time", time),
            ("fields of the fluid", fluid),
            ("values of the fluid at the grains", at),
            ("values of the coupling at the grains", carried),
            ("height or mass of the bed", finite(&[&heights])),
        ]
        .iter()
        .find(|(_, good)| !good)
        .map(|(name, _)| format!("wrong {name}"))
    }
}

impl Simulation {
    /// The simulation at a state.
    pub(super) fn at(mut self, state: State) -> Result<Self> {
        let dt = self.clock.step;
        let steps = (state.time / dt).round();
        if (steps * dt - state.time).abs() > 1e-3 * dt {
            let (time, step) = (Rounded(state.time), Rounded(dt));
            let what =
                format!("the checkpoint is at t = {time} s, which is no whole number of steps of {step} s");
            return Err(Error::input(Notice::new(what, "give a `time.step` that divides that time")));
        }
        (self.bed, self.surface) = (state.bed, state.surface);
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
        self.drive_from_here();
        Ok(self)
    }

    /// The state to write in a checkpoint. What the linear solver keeps between steps is dropped, here as at a
    /// restart, so that a restarted run equals this one bit for bit.
    ///
    /// # Errors
    /// The fluid solver cannot be reached.
    pub fn state(&mut self) -> Result<State> {
        let (step, time) = (self.steps() + 1, self.time());
        if let Some(fluid) = self.coupled.fluid_mut() {
            fluid.start().map_err(|error| super::in_step(step, time, error))?;
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
            bed: self.bed,
            surface: self.surface,
            since: self.since.clone(),
        }
    }
}
