//! The fluid of a scene: its solver, mesh and fields.

use crate::backend::{FluidBackend, FluidStep, Immersed, Solution};
use crate::droplet::surface::Surface;
use crate::droplet::wet::Taken;
use crate::droplet::{Droplet, DropletState};
use crate::error::{Error, Result};
use crate::exchange::OnMesh;
use crate::motion::{MeshMover, at};
use crate::remesh::Remesher;
use crate::{Notice, StepReport, TEMPERATURE};
use std::borrow::Cow;
use voidage_fluid::conditions::{Condition, FlowCondition};
use voidage_fluid::flow::State;
use voidage_fluid::mesh::Periodic;
use voidage_fluid::{Mesh, MeshMotion, Vector};

/// Time and number of steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clock {
    /// Time, s.
    pub time: f64,
    /// Steps done.
    pub steps: u64,
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
    /// Rows of time (s) and factor on the prescribed velocity, linear between rows, by condition; none for a factor of
    /// one.
    pub schedules: Vec<Vec<[f64; 2]>>,
    /// Integral of each shape function, m3 (m2 in the plane); zero at the images of nodes of periodic sides.
    pub nodal_volume: Vec<f64>,
    /// What moves the mesh; absent if it stands still.
    pub motion: Option<Box<dyn MeshMover<D>>>,
    /// The droplet in it, which moves the mesh too; absent without.
    pub droplet: Option<Box<Droplet<D>>>,
    /// When the domain is remeshed; absent if it never is.
    pub remesher: Option<Remesher<D>>,
    /// Time and steps of the accepted fields.
    pub clock: Clock,
    /// Which mesh the solver has.
    generation: u32,
    /// Whether the nodes have left the places that they had when the solver got them.
    pub moved: bool,
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
            schedules: vec![],
            motion: None,
            droplet: None,
            remesher: None,
            clock: Clock::default(),
            generation: 0,
            moved: true,
        };
        fluid.start()?;
        Ok(fluid)
    }

    /// Gives the solver the mesh where it is, and the accepted fields: nothing of earlier steps influences what
    /// follows.
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

    /// One solution from the accepted fields over `dt`, with what is immersed.
    ///
    /// # Errors
    /// The solver failed.
    pub fn solve(
        &mut self,
        dt: f64,
        immersed: Option<Immersed<'_, D>>,
        report: &mut StepReport,
    ) -> Result<()> {
        if let Some(droplet) = alive(&mut self.droplet) {
            droplet.go_free();
        }
        loop {
            self.solve_once(dt, immersed, report)?;
            let stopped = alive(&mut self.droplet).is_some_and(|droplet| droplet.stop(&self.mesh, dt));
            if !stopped {
                return Ok(());
            }
        }
    }

    fn solve_once(
        &mut self,
        dt: f64,
        immersed: Option<Immersed<'_, D>>,
        report: &mut StepReport,
    ) -> Result<()> {
        let mut conditions = scheduled(&self.conditions, (self.ramp, &self.schedules), self.clock.time + dt);
        let mut velocity = self.motion.as_ref().map(|motion| motion.velocity());
        let mut part = None;
        if let Some(droplet) = alive(&mut self.droplet) {
            let clear = immersed.is_none().then(|| vec![1.0; self.mesh.points.len()]);
            let voidage = immersed.map_or(clear.as_deref(), |immersed| Some(immersed.voidage));
            let hot = self.scalars.first().is_some_and(|name| name == TEMPERATURE);
            let body = droplet.body(&self.mesh, voidage.unwrap_or_default(), dt, hot)?;
            part = self.conditions.iter().position(|condition| condition.boundary == droplet.boundary);
            if let Some(part) = part {
                conditions.to_mut()[part].flow = FlowCondition::Body(body);
            }
            velocity = Some(droplet.mesh_velocity());
        }
        let motion = velocity.map(|velocity| MeshMotion { points: &self.mesh.points, velocity });
        let Clock { time, steps } = self.clock;
        let step = FluidStep { number: steps + 1, time, dt, immersed, conditions: &conditions, motion };
        self.moved |= step.motion.is_some();
        self.backend.solve(&step, &mut self.solution)?;
        let Solution { report: solver, transport_s, .. } = &self.solution;
        if let Some(droplet) = alive(&mut self.droplet) {
            let balance = part.and_then(|part| self.solution.balances.get(part));
            droplet.receive(self.solution.bodies.first(), balance)?;
        }
        report.phases.energy += solver.scalars_s;
        report.phases.flow += solver.flow_s;
        report.phases.transport += transport_s;
        report.fluid = Some(*solver);
        Ok(())
    }

    /// Makes the last solution, which was over `dt`, the accepted fields. A droplet moves, and the mesh with it.
    ///
    /// # Errors
    /// The droplet moves so far that a cell of the mesh would turn over.
    pub fn accept(&mut self, dt: f64) -> Result<()> {
        self.accept_around(dt, |_, _, _| Taken::default())
    }

    /// The same where grains may be in the droplet: `grains` says what they take of it within a surface.
    ///
    /// # Errors
    /// The droplet moves so far that a cell of the mesh would turn over.
    pub fn accept_around(
        &mut self,
        dt: f64,
        grains: impl Fn(&Surface<D>, &Vector<D>, f64) -> Taken,
    ) -> Result<()> {
        if let Some(place) = self.turns_over(dt, &grains)? {
            return Err(self.too_far(dt, &place));
        }
        self.backend.accept();
        std::mem::swap(&mut self.accepted, &mut self.solution.fields);
        self.clock.time += dt;
        if let Some(droplet) = alive(&mut self.droplet) {
            droplet.accept(dt, &mut self.mesh, grains)?;
            self.nodal_volume = self.mesh.nodal_volume();
        }
        Ok(())
    }

    /// A place where a cell of the mesh would turn over if the last solution, which was over `dt`, were accepted, if
    /// there is one; `grains` as in [`Self::accept_around`].
    ///
    /// # Errors
    /// No radius of the droplet fits the volumes.
    pub fn turns_over(
        &mut self,
        dt: f64,
        grains: impl Fn(&Surface<D>, &Vector<D>, f64) -> Taken,
    ) -> Result<Option<Vector<D>>> {
        match alive(&mut self.droplet) {
            Some(droplet) => droplet.turns_over(dt, &mut self.mesh, grains),
            None => Ok(None),
        }
    }

    /// The error of a droplet that would turn a cell over at a place.
    pub(crate) fn too_far(&self, dt: f64, place: &Vector<D>) -> Error {
        let way = self.droplet.as_ref().map_or(0.0, |droplet| droplet.travel(dt));
        Error::run(Notice::new(
            format!(
                "the droplet moves {way:.3e} m in {dt:.3e} s: the cell of the mesh at {} would turn over, also of a \
                 new mesh",
                at(place)
            ),
            "give a smaller time.step, or cut such steps: coupling.cut = {}; shorter edges cannot follow so far either",
        ))
    }

    /// Puts another solver around the one that there is, which has its mesh.
    pub fn wrap_backend(&mut self, wrap: impl FnOnce(Box<dyn FluidBackend<D>>) -> Box<dyn FluidBackend<D>>) {
        self.backend = wrap(std::mem::replace(&mut self.backend, Box::new(Vacant)));
    }

    /// The droplet, if there is one and it has not vanished.
    pub fn live_droplet(&mut self) -> Option<&mut Droplet<D>> {
        alive(&mut self.droplet)
    }

    /// Puts the droplet where it was, at a restart.
    pub fn restore_droplet(&mut self, state: DropletState<D>) {
        let Some(droplet) = &mut self.droplet else { return };
        droplet.state = state;
        droplet.recall();
        if droplet.state.gone {
            self.conditions.retain(|condition| condition.boundary != droplet.boundary);
        }
    }

    /// Velocity of the nodes in the step in hand, m/s; absent while the mesh stands still.
    pub fn mesh_velocity(&self) -> Option<&[Vector<D>]> {
        match self.droplet.as_deref().filter(|droplet| !droplet.state.gone) {
            Some(droplet) => Some(droplet.mesh_velocity()),
            None => self.motion.as_ref().map(|motion| motion.velocity()),
        }
    }

    /// The accepted fields on the mesh.
    pub fn on_mesh(&self) -> OnMesh<'_, D> {
        OnMesh { mesh: &self.mesh, fields: &self.accepted }
    }
}

impl<const D: usize> Default for Fluid<D> {
    /// No fluid: what stays behind while somebody else holds the fluid.
    fn default() -> Self {
        Self {
            backend: Box::new(Vacant),
            mesh: Mesh { points: vec![], cells: vec![], boundaries: vec![], periodic: Periodic::default() },
            accepted: State::default(),
            solution: Solution::default(),
            scalars: vec![],
            conditions: vec![],
            ramp: 0.0,
            schedules: vec![],
            nodal_volume: vec![],
            motion: None,
            droplet: None,
            remesher: None,
            clock: Clock::default(),
            generation: 0,
            moved: true,
        }
    }
}

/// The droplet, unless it has vanished.
fn alive<const D: usize>(droplet: &mut Option<Box<Droplet<D>>>) -> Option<&mut Droplet<D>> {
    droplet.as_deref_mut().filter(|droplet| !droplet.state.gone)
}

/// The place of a solver that somebody else holds.
struct Vacant;

impl<const D: usize> FluidBackend<D> for Vacant {
    fn set_mesh(&mut self, _: &Mesh<D>, _: u32, _: &State<D>) -> Result<()> {
        Err(Error::run("there is no fluid solver here"))
    }

    fn solve(&mut self, _: &FluidStep<'_, D>, _: &mut Solution<D>) -> Result<()> {
        Err(Error::run("there is no fluid solver here"))
    }

    fn accept(&mut self) {}
}

/// The conditions at a time: prescribed velocities grow over the ramp, and follow their schedules.
fn scheduled<'a, const D: usize>(
    conditions: &'a [Condition<D>],
    (ramp, schedules): (f64, &[Vec<[f64; 2]>]),
    time: f64,
) -> Cow<'a, [Condition<D>]> {
    let grown = if time >= ramp { 1.0 } else { time / ramp };
    if grown == 1.0 && schedules.iter().all(Vec::is_empty) {
        return Cow::Borrowed(conditions);
    }
    let mut scaled = conditions.to_vec();
    for (k, condition) in scaled.iter_mut().enumerate() {
        let factor = grown * schedules.get(k).map_or(1.0, |rows| factor(rows, time));
        match &mut condition.flow {
            FlowCondition::Velocity(value) | FlowCondition::SuperficialVelocity(value) => value.scale(factor),
            _ => {}
        }
    }
    Cow::Owned(scaled)
}

/// The factor of a schedule at a time, that of its first row before it and of its last after it; one without rows.
fn factor(rows: &[[f64; 2]], time: f64) -> f64 {
    let after = rows.partition_point(|row| row[0] <= time);
    match (after.checked_sub(1).and_then(|before| rows.get(before)), rows.get(after)) {
        (Some([t, a]), Some([u, b])) => a + (b - a) * ((time - t) / (u - t)),
        (Some([_, only]), None) | (None, Some([_, only])) => *only,
        (None, None) => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use voidage_fluid::conditions::Prescribed;

    #[test]
    fn prescribed_velocities_follow_ramp_and_schedule() {
        let inflow = Condition {
            boundary: "floor".into(),
            flow: FlowCondition::Velocity(Prescribed::Uniform(Vector::<2>::new(0.0, 2.0))),
            scalars: vec![],
        };
        let other = Condition { boundary: "top".into(), ..inflow.clone() };
        let conditions = [inflow, other];
        let schedules = [vec![[0.1, 0.5], [0.3, 1.5], [0.4, -1.0]]];
        for (time, ramp, expected) in [
            (0.05, 0.0, [1.0, 2.0]),
            (0.2, 0.0, [2.0, 2.0]),
            (0.35, 0.0, [0.5, 2.0]),
            (9.0, 0.0, [-2.0, 2.0]),
            (0.2, 0.4, [1.0, 1.0]),
        ] {
            let now = scheduled(&conditions, (ramp, &schedules), time);
            for (condition, expected) in now.iter().zip(expected) {
                let FlowCondition::Velocity(value) = &condition.flow else { panic!("{condition:?}") };
                assert!((value.at(0)[1] - expected).abs() < 1e-14, "{time}: {condition:?}");
            }
        }
        assert!(matches!(scheduled(&conditions, (0.0, &[]), 0.0), Cow::Borrowed(_)));
    }
}
