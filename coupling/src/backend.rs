//! The seam between the coupling and a fluid solver.

use crate::error::Result;
use std::sync::Arc;
use voidage_fluid::conditions::Condition;
use voidage_fluid::exchange::{AtBodies, Exchange, HeatExchange, Pieces, VelocityLaw};
use voidage_fluid::flow::{HeatProperties, Numerics, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::{Flow, Mesh, MeshMotion, Vector};

/// What the fluid solver gets each step: where the grains are, their drag and the affine law of the velocity
/// that they will have, v* = velocity + mobility (drag u - volume grad p). It never knows the scheme.
#[derive(Clone, Debug, Default)]
pub struct GrainLoad<const D: usize> {
    /// The grains cut by the mesh.
    pub pieces: Pieces<D>,
    /// Nodal voidage.
    pub voidage: Vec<f64>,
    /// Solid volume V, m3 (m2 in the plane).
    pub volume: Vec<f64>,
    /// Drag coefficient gamma, kg/s.
    pub drag: Vec<f64>,
    /// Mobility a, s/kg.
    pub mobility: Vec<f64>,
    /// Constant part b of the velocity law, m/s.
    pub velocity: Vec<Vector<D>>,
    /// The law of the solid flux in the equation of mass; absent where it is the same.
    pub continuity: Option<Law<D>>,
    /// The same for heat; absent unless grains and fluid both have a temperature.
    pub heat: Option<HeatLoad>,
}

/// A law of velocity, v* = velocity + mobility (drag u - volume grad p).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Law<const D: usize> {
    /// Mobility a, s/kg.
    pub mobility: Vec<f64>,
    /// Constant part b, m/s.
    pub velocity: Vec<Vector<D>>,
}

/// Heat columns of the load: T* = temperature + mobility (coefficient T).
#[derive(Clone, Debug, Default)]
pub struct HeatLoad {
    /// hA, W/K.
    pub coefficient: Vec<f64>,
    /// aT, K/W.
    pub mobility: Vec<f64>,
    /// bT, K.
    pub temperature: Vec<f64>,
}

impl HeatLoad {
    /// The temperature T* of grain `i` by the affine law, K.
    pub fn expected<const D: usize>(&self, at: &AtBodies<D>, i: usize) -> f64 {
        self.temperature[i] + self.mobility[i] * self.coefficient[i] * at.temperature[i]
    }

    /// What T* must be lower by for the fluid to give the heat `carried` (J) within `dt`, K.
    pub fn owed(&self, carried: f64, dt: f64, i: usize) -> f64 {
        if self.coefficient[i] > 0.0 { carried / (self.coefficient[i] * dt) } else { 0.0 }
    }

    /// hA (T* - T) of grain `i` at a mean temperature: the heat that it gets and the fluid does not lose, W.
    pub(crate) fn missed<const D: usize>(&self, at: &AtBodies<D>, temperature: f64, i: usize) -> f64 {
        self.coefficient[i] * (self.expected(at, i) - temperature)
    }

    /// Heat from the fluid to grain `i`, W: hA (T - T*) with the affine law T*.
    pub fn heat<const D: usize>(&self, at: &AtBodies<D>, i: usize) -> f64 {
        self.coefficient[i] * (at.temperature[i] - self.expected(at, i))
    }
}

/// Grains in the fluid: where they are, and their load.
#[derive(Clone, Copy, Debug)]
pub struct Immersed<'a, const D: usize> {
    /// Centres, m.
    pub position: &'a [Vector<D>],
    /// Radii, m.
    pub radius: &'a [f64],
    /// Pieces, voidage and the columns of the exchange.
    pub load: &'a GrainLoad<D>,
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
    /// The grains; absent without.
    pub grains: Option<Immersed<'a, D>>,
    /// What is prescribed on the boundary at its end.
    pub conditions: &'a [Condition<D>],
    /// Where the mesh is at its end and how it came there; absent while it stands still. The grains are cut by the mesh
    /// where it is at the end.
    pub motion: Option<MeshMotion<'a, D>>,
}

impl<const D: usize> GrainLoad<D> {
    /// What the fluid pushes grain `i` with at rest, N: f = gamma u - V grad p.
    pub fn push(&self, at: &AtBodies<D>, i: usize) -> Vector<D> {
        at.velocity[i] * self.drag[i] - at.pressure_gradient[i] * self.volume[i]
    }

    /// The velocity v* of grain `i` by the affine law of momentum, m/s.
    pub fn expected(&self, at: &AtBodies<D>, i: usize) -> Vector<D> {
        self.velocity[i] + self.push(at, i) * self.mobility[i]
    }

    /// The velocity of grain `i` by the law of the solid flux, m/s.
    pub fn expected_in_flux(&self, at: &AtBodies<D>, i: usize) -> Vector<D> {
        match &self.continuity {
            Some(law) => law.velocity[i] + self.push(at, i) * law.mobility[i],
            None => self.expected(at, i),
        }
    }

    /// Force of the fluid on grain `i`, N: -V grad p + gamma (u - v*) with the affine law v*.
    pub fn force(&self, at: &AtBodies<D>, i: usize) -> Vector<D> {
        let slip = at.velocity[i] - self.expected(at, i);
        slip * self.drag[i] - at.pressure_gradient[i] * self.volume[i]
    }

    fn exchange(&self) -> Exchange<'_, D> {
        Exchange {
            pieces: &self.pieces,
            volume: &self.volume,
            drag: &self.drag,
            mobility: &self.mobility,
            velocity: &self.velocity,
            continuity: self
                .continuity
                .as_ref()
                .map(|law| VelocityLaw { mobility: &law.mobility, velocity: &law.velocity }),
            heat: self.heat.as_ref().map(|heat| HeatExchange {
                coefficient: &heat.coefficient,
                mobility: &heat.mobility,
                temperature: &heat.temperature,
            }),
        }
    }
}

/// What a fluid solver reports of a step.
#[derive(Clone, Copy, Debug)]
pub struct FluidReport<const D: usize> {
    /// Iterations, residual and time of the solver.
    pub solver: voidage_fluid::flow::Report,
    /// Force that the fluid lost to the grains, summed over the pieces by the fluid, N; `None` if it does not sum.
    pub force: Option<Vector<D>>,
    /// Heat that the fluid lost to the grains, summed likewise, W.
    pub heat: f64,
    /// Wall time that frames took to and from a solver in another process, s.
    pub transport_s: f64,
}

/// A fluid solver. `solve` always starts from the last accepted state: schemes may call it many times.
pub trait FluidBackend<const D: usize>: Send {
    /// Sets the mesh and the accepted fields: at the start, at a restart, after remeshing. Nothing of earlier
    /// steps may influence what follows. A mesh that moves is moved by the steps.
    ///
    /// # Errors
    /// A mesh or conditions that the solver cannot use.
    fn start(&mut self, mesh: &Arc<Mesh<D>>, fields: &State<D>) -> Result<()>;

    /// Solves a step and writes the fluid at the grains, if there are any, to `out`.
    ///
    /// # Errors
    /// The solver failed.
    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut AtBodies<D>) -> Result<FluidReport<D>>;

    /// Accepts the last solution.
    fn accept(&mut self);

    /// The accepted nodal fields; asked for by recorders and comparisons only.
    ///
    /// # Errors
    /// The solver cannot be reached.
    fn fields(&mut self) -> Result<State<D>>;
}

/// The Rust solver in this process; `B` is `D + 1`.
pub struct RustFluid<const D: usize, const B: usize> {
    properties: Properties<D>,
    heat: Option<HeatProperties>,
    numerics: Numerics,
    conditions: Vec<Condition<D>>,
    flow: Option<(Arc<Mesh<D>>, Flow<D, B>)>,
    /// Whether the nodes have left the places that they have in that mesh.
    moved: bool,
    clear: Vec<f64>,
}

impl<const D: usize, const B: usize> RustFluid<D, B> {
    /// A solver that waits for its mesh.
    pub fn new(
        properties: Properties<D>,
        heat: Option<HeatProperties>,
        numerics: Numerics,
        conditions: Vec<Condition<D>>,
    ) -> Self {
        Self { properties, heat, numerics, conditions, flow: None, moved: false, clear: Vec::new() }
    }
}

fn not_started() -> crate::Error {
    crate::Error::Run("the fluid solver was used before it got a mesh".into())
}

impl<const D: usize, const B: usize> FluidBackend<D> for RustFluid<D, B> {
    fn start(&mut self, mesh: &Arc<Mesh<D>>, fields: &State<D>) -> Result<()> {
        match &mut self.flow {
            Some((old, flow)) if Arc::ptr_eq(old, mesh) && !self.moved => {
                flow.set_state(fields.clone());
                flow.forget();
            }
            _ => {
                let flow = Flow::new(
                    (**mesh).clone(),
                    self.properties.clone(),
                    self.heat.clone(),
                    &self.conditions,
                    fields.clone(),
                    &self.numerics,
                )?;
                self.moved = false;
                self.clear = vec![1.0; mesh.points.len()];
                self.flow = Some((mesh.clone(), flow));
            }
        }
        Ok(())
    }

    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut AtBodies<D>) -> Result<FluidReport<D>> {
        let (_, flow) = self.flow.as_mut().ok_or_else(not_started)?;
        let (dt, conditions) = (step.dt, step.conditions);
        flow.follow(step.motion.as_ref())?;
        self.moved |= step.motion.is_some();
        let Some(Immersed { load, .. }) = step.grains else {
            let solver = flow.solve(dt, &self.clear, None, conditions)?;
            return Ok(FluidReport { solver, force: Some(Vector::zeros()), heat: 0.0, transport_s: 0.0 });
        };
        let exchange = load.exchange();
        let solver = flow.solve(dt, &load.voidage, Some(&exchange), conditions)?;
        flow.sample(&load.pieces, out);
        let (force, heat) = flow.exchanged(&exchange);
        Ok(FluidReport { solver, force: Some(force), heat, transport_s: 0.0 })
    }

    fn accept(&mut self) {
        if let Some((_, flow)) = &mut self.flow {
            flow.accept();
        }
    }

    fn fields(&mut self) -> Result<State<D>> {
        self.flow.as_ref().map(|(_, flow)| flow.state().clone()).ok_or_else(not_started)
    }
}
