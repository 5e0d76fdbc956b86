//! The seam between the coupling and a fluid solver.
//!
//! A solver knows a mesh, point terms and boundaries; it knows no grain and no scheme. It gets what a step needs and
//! returns nodal fields, what passed each part of the boundary, and a report.

use crate::error::Result;
use voidage_fluid::balance::Balance;
use voidage_fluid::body::BodyAnswer;
use voidage_fluid::conditions::{Condition, FlowCondition};
use voidage_fluid::flow::{Numerics, Report, Sources, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::points::Points;
use voidage_fluid::transport::Scalar;
use voidage_fluid::{Flow, Mesh, MeshMotion, Vector};

/// All that a solver is told once.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Model<const D: usize> {
    /// Density, viscosity, gravity and so on.
    pub properties: Properties<D>,
    /// The scalars that the fluid transports.
    pub scalars: Vec<Scalar>,
    /// Newton steps, tolerances.
    pub numerics: Numerics,
    /// Conditions on the boundary at full strength; a step may bring others.
    pub conditions: Vec<Condition<D>>,
}

/// What is in the fluid.
#[derive(Clone, Copy, Debug)]
pub struct Immersed<'a, const D: usize> {
    /// Point terms.
    pub points: &'a Points<D>,
    /// Nodal voidage.
    pub voidage: &'a [f64],
    /// Solid volume that comes in per volume and time, at the nodes, 1/s: a source of the equation of mass. Absent
    /// where none does.
    pub source: Option<&'a [f64]>,
}

/// A step as the fluid solver gets it.
#[derive(Clone, Copy, Debug)]
pub struct FluidStep<'a, const D: usize> {
    /// Number of the step since time zero; the first is 1.
    pub number: u64,
    /// Time at its start, s.
    pub time: f64,
    /// Its length, s.
    pub dt: f64,
    /// What is in the fluid; absent without grains.
    pub immersed: Option<Immersed<'a, D>>,
    /// What is prescribed on the boundary at its end.
    pub conditions: &'a [Condition<D>],
    /// Where the mesh is at its end and how it came there; absent while it stands still. The points lie in the mesh
    /// where it is at the end.
    pub motion: Option<MeshMotion<'a, D>>,
}

/// What a fluid solver answers to a step.
#[derive(Clone, Debug, Default)]
pub struct Solution<const D: usize> {
    /// Nodal fields at the end of the step.
    pub fields: State<D>,
    /// What passed each part of the boundary, in the order of the conditions; empty if the solver does not compute it.
    pub balances: Vec<Balance<D>>,
    /// What each body did, in the order of the conditions.
    pub bodies: Vec<BodyAnswer<D>>,
    /// Iterations, residual and time of the solver.
    pub report: Report,
    /// Wall time that frames took to and from a solver in another process, s.
    pub transport_s: f64,
}

/// A fluid solver. `solve` always starts from the last accepted state: schemes may call it many times.
pub trait FluidBackend<const D: usize>: Send {
    /// Sets the mesh and the accepted fields: at the start, at a restart, after remeshing. Nothing of earlier
    /// steps may influence what follows. The mesh is another one, or elsewhere, exactly if its generation is new. A
    /// mesh that moves is moved by the steps.
    ///
    /// # Errors
    /// A mesh or conditions that the solver cannot use.
    fn set_mesh(&mut self, mesh: &Mesh<D>, generation: u32, fields: &State<D>) -> Result<()>;

    /// Solves a step.
    ///
    /// # Errors
    /// The solver failed.
    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut Solution<D>) -> Result<()>;

    /// Accepts the last solution.
    fn accept(&mut self);
}

/// The Rust solver in this process; `B` is `D + 1`.
pub struct RustFluid<const D: usize, const B: usize> {
    model: Model<D>,
    /// The solver on its mesh, with the generation of that.
    flow: Option<(u32, Flow<D, B>)>,
    clear: Vec<f64>,
}

impl<const D: usize, const B: usize> RustFluid<D, B> {
    /// A solver that waits for its mesh.
    pub fn new(model: Model<D>) -> Self {
        Self { model, flow: None, clear: Vec::new() }
    }
}

impl<const D: usize, const B: usize> FluidBackend<D> for RustFluid<D, B> {
    fn set_mesh(&mut self, mesh: &Mesh<D>, generation: u32, fields: &State<D>) -> Result<()> {
        if let Some((_, flow)) = self.flow.as_mut().filter(|(known, _)| *known == generation) {
            flow.set_state(fields)?;
            flow.forget();
            return Ok(());
        }
        let Model { properties, scalars, numerics, conditions } = &self.model;
        // A body may have vanished; the conditions of the steps then lack it too.
        let there = |condition: &&Condition<D>| {
            !matches!(condition.flow, FlowCondition::Body(_)) || mesh.boundary(&condition.boundary).is_ok()
        };
        let conditions: Vec<_> = conditions.iter().filter(there).cloned().collect();
        let flow =
            Flow::new(mesh.clone(), properties.clone(), scalars, &conditions, fields.clone(), numerics)?;
        self.clear = vec![1.0; mesh.points.len()];
        self.flow = Some((generation, flow));
        Ok(())
    }

    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut Solution<D>) -> Result<()> {
        let Some((_, flow)) = &mut self.flow else {
            return Err(crate::Error::run("the fluid solver was used before it got a mesh"));
        };
        flow.follow(step.motion.as_ref())?;
        let voidage = step.immersed.map_or(&self.clear[..], |immersed| immersed.voidage);
        let points = step.immersed.map(|immersed| immersed.points);
        let source = step.immersed.and_then(|immersed| immersed.source);
        flow.set_sources(source.map(|mass| Sources {
            momentum: vec![Vector::zeros(); mass.len()],
            mass: mass.to_vec(),
            scalars: vec![vec![0.0; mass.len()]; self.model.scalars.len()],
        }));
        out.report = flow.solve(step.dt, voidage, points, step.conditions)?;
        out.transport_s = 0.0;
        out.fields.copy_from(flow.solution());
        out.bodies.clear();
        out.bodies.extend(flow.bodies());
        flow.balances(voidage, step.conditions, &mut out.balances);
        Ok(())
    }

    fn accept(&mut self) {
        if let Some((_, flow)) = &mut self.flow {
            flow.accept();
        }
    }
}

impl<const D: usize> Solution<D> {
    /// The place of the first value that is not finite, in words: `velocity at node 3`.
    pub fn not_finite(&self, scalars: &[Scalar]) -> Option<String> {
        let vector = |v: &Vector<D>| v.iter().all(|x| x.is_finite());
        let fields = &self.fields;
        if let Some(node) = fields.velocity.iter().position(|u| !vector(u)) {
            return Some(format!("velocity at node {node}"));
        }
        if let Some(node) = fields.pressure.iter().position(|p| !p.is_finite()) {
            return Some(format!("pressure at node {node}"));
        }
        let values = fields.scalars.iter().zip(scalars);
        let wrong = values.filter_map(|(values, scalar)| {
            let node = values.iter().position(|value| !value.is_finite())?;
            Some(format!("{} at node {node}", scalar.name))
        });
        let in_balance = |balance: &Balance<D>| {
            let Balance { flux, force, torque, scalars, convected } = balance;
            let numbers = force.iter().chain(torque).chain(scalars).chain(convected);
            numbers.chain([flux]).all(|x| x.is_finite())
        };
        let part = self.balances.iter().position(|balance| !in_balance(balance));
        let in_body =
            |body: &BodyAnswer<D>| body.velocity.iter().chain([&body.vapour]).all(|x| x.is_finite());
        let body = self.bodies.iter().position(|body| !in_body(body));
        let parts = part.map(|part| format!("the balance of part {part} of the boundary"));
        let bodies = body.map(|body| format!("the motion of body {body}"));
        wrong.into_iter().next().or(parts).or(bodies)
    }
}
