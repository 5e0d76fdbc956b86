//! Manufactured solutions: exact fields and the sources that make them solve the equations.

use super::immersed;
use crate::jet::Jet;
use crate::models::{self, FluidSet, Vec2};
use crate::norms::{Errors, errors, errors_in};
use voidage_campaign::clock;
use voidage_coupling::{HEAT, Result, TEMPERATURE};
use voidage_fluid::conditions::{FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::{Sources, State};
use voidage_fluid::transport::{Form, Scalar};
use voidage_fluid::{Flow, Mesh};

/// Density, viscosity, heat capacity and conductivity of the fluid (SI).
#[derive(Clone, Copy, Debug)]
pub struct Fluid {
    /// kg/m3.
    pub density: f64,
    /// Pa s.
    pub viscosity: f64,
    /// J/(kg K).
    pub capacity: f64,
    /// W/(m K).
    pub conductivity: f64,
}

/// That of `tests/manufactured.py`.
pub const UNIT: Fluid = Fluid { density: 1.0, viscosity: 1.0, capacity: 1.0, conductivity: 1.0 };

/// Exact values with their derivatives at one point and time.
#[derive(Clone, Copy, Debug)]
pub struct Exact {
    /// eps.
    pub voidage: Jet,
    /// u, m/s.
    pub velocity: [Jet; 2],
    /// p, Pa.
    pub pressure: Jet,
    /// T, K.
    pub temperature: Jet,
    /// Velocity v of bodies in the fluid, without flow through the boundary, m/s.
    pub bodies: [Jet; 2],
    /// Temperature T_s of the bodies, K.
    pub warmth: Jet,
}

/// How bodies and fluid act on each other, per volume of body.
#[derive(Clone, Copy, Debug)]
pub struct Bodies {
    /// gamma / V, kg/m3/s.
    pub drag: f64,
    /// a gamma: how much of the drag the predicted velocity of a body gives way to, in [0, 1[.
    pub yielding: f64,
    /// hA / V, W/m3/K.
    pub heat: f64,
    /// aT hA: the same for its temperature.
    pub warming: f64,
}

/// Fields of x, y and t on the square [-1, 1]^2.
#[derive(Clone, Copy, Debug)]
pub struct Fields {
    /// Name in findings.
    pub name: &'static str,
    /// The formulas.
    pub at: fn(Jet, Jet, Jet) -> Exact,
}

impl Fields {
    /// The fields at a point and time.
    pub fn exact(&self, x: Vec2, t: f64) -> Exact {
        (self.at)(Jet::variable(0, x.x), Jet::variable(1, x.y), Jet::variable(2, t))
    }
}

impl Exact {
    /// eps rho (u_t + (u . grad) u) + grad p - div(eps eta (grad u + grad u^T)), N/m3; with bodies also
    /// -phi grad p + phi (gamma/V) (u - v).
    pub fn momentum(&self, fluid: &Fluid, bodies: Option<&Bodies>) -> Vec2 {
        let (eps, u) = (&self.voidage, &self.velocity);
        Vec2::from_fn(|i, _| {
            let carried: f64 = (0..2).map(|j| u[j].value * u[i].slope[j]).sum();
            let inertia = eps.value * fluid.density * (u[i].slope[2] + carried);
            let stress: f64 = (0..2)
                .map(|j| {
                    eps.slope[j] * (u[i].slope[j] + u[j].slope[i])
                        + eps.value * (u[i].second(j, j) + u[j].second(i, j))
                })
                .sum();
            let push = self.pressure.slope[i];
            let taken = bodies.map_or(0.0, |bodies| {
                (1.0 - eps.value) * (bodies.drag * (u[i].value - self.bodies[i].value) - push)
            });
            inertia + push - fluid.viscosity * stress + taken
        })
    }

    /// div(eps u), 1/s: without bodies the solver has no d(eps)/dt, which is then a source; with them div(eps u + phi
    /// v).
    pub fn mass(&self, bodies: Option<&Bodies>) -> f64 {
        let divergence = |share: Jet, u: &[Jet; 2]| -> f64 {
            (0..2).map(|j| share.slope[j] * u[j].value + share.value * u[j].slope[j]).sum()
        };
        let solid = Jet::constant(1.0) - self.voidage;
        divergence(self.voidage, &self.velocity) + bodies.map_or(0.0, |_| divergence(solid, &self.bodies))
    }

    /// eps rho c (T_t + u . grad T) - div(eps k grad T), W/m3; with bodies also phi (hA/V) (T - T_s).
    pub fn heat(&self, fluid: &Fluid, bodies: Option<&Bodies>) -> f64 {
        let (eps, t) = (&self.voidage, &self.temperature);
        let carried: f64 = (0..2).map(|j| self.velocity[j].value * t.slope[j]).sum();
        let spread: f64 = (0..2).map(|j| eps.slope[j] * t.slope[j] + eps.value * t.second(j, j)).sum();
        let given =
            bodies.map_or(0.0, |bodies| (1.0 - eps.value) * bodies.heat * (t.value - self.warmth.value));
        eps.value * fluid.density * fluid.capacity * (t.slope[2] + carried) - fluid.conductivity * spread
            + given
    }
}

/// A source that adds nothing in all, as a box without flow through its walls needs: the interpolation of the exact one
/// misses that by its error.
fn balanced(mut source: Vec<f64>, volume: &[f64]) -> Vec<f64> {
    let total: f64 = source.iter().zip(volume).map(|(s, v)| s * v).sum();
    let mean = total / volume.iter().sum::<f64>();
    source.iter_mut().for_each(|s| *s -= mean);
    source
}

/// How the square is cut into triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Squares, their diagonals rising and falling in turn.
    Alternating,
    /// Squares, all diagonals rising: edges of three directions.
    Parallel,
    /// No order: edges as long as the sides of the squares would be.
    Unstructured,
}

impl Cut {
    /// The mesh of [-1, 1]^2 with so many squares along each side, its sides called left, right, bottom and top.
    fn mesh(self, squares: usize) -> Result<Mesh<2>> {
        let mut mesh = match self {
            Self::Alternating => models::grid([2.0; 2], [squares; 2])?,
            Self::Parallel => models::parallel([2.0; 2], [squares; 2])?,
            Self::Unstructured => models::unstructured([2.0; 2], 2.0 / squares as f64)?,
        };
        mesh.points.iter_mut().for_each(|x| *x -= Vec2::new(1.0, 1.0));
        Ok(mesh)
    }
}

/// A run of a manufactured solution.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// The solution.
    pub fields: Fields,
    /// The fluid.
    pub fluid: Fluid,
    /// The kind of mesh.
    pub cut: Cut,
    /// Squares along each side.
    pub squares: usize,
    /// Time step, s.
    pub dt: f64,
    /// Steps.
    pub steps: usize,
    /// Whether heat is lumped.
    pub lumped: bool,
    /// Bodies that fill what the fluid leaves; none: a voidage without bodies.
    pub bodies: Option<Bodies>,
}

/// What a run is off by at its end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Off {
    /// Velocity.
    pub velocity: Errors,
    /// Pressure, both moved to a mean of zero.
    pub pressure: Errors,
    /// The same an eighth of the box away from the walls.
    pub pressure_inside: Errors,
    /// Temperature.
    pub temperature: Errors,
}

/// Whether a place is an eighth of the box away from its walls.
fn inside(x: Vec2) -> bool {
    x.amax() < 0.75
}

/// Time of the solver, s.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Everything, wall time.
    pub all: f64,
    /// Everything, processor time on all cores.
    pub cpu: f64,
    /// Taking the mesh.
    pub mesh: f64,
    /// Momentum and mass.
    pub flow: f64,
    /// Energy.
    pub heat: f64,
}

impl Run {
    /// What the solution at the end is off by.
    pub fn solve(&self) -> Result<Off> {
        Ok(self.off(&self.steps()?, self.steps as f64 * self.dt))
    }

    /// The solver at the end: exact values on all of the boundary, exact nodal values at the start.
    pub fn steps(&self) -> Result<Flow<2, 3>> {
        Ok(self.timed()?.0)
    }

    /// The same with the wall time that the solver took.
    pub fn timed(&self) -> Result<(Flow<2, 3>, Spent)> {
        let mesh = self.cut.mesh(self.squares)?;
        let mut set = FluidSet::new(self.fluid.density, self.fluid.viscosity);
        set.numerics.newton = 2;
        // In long steps what is left of the equations is amplified by up to the number of nodes.
        set.numerics.scalars.tolerance = 1e-14;
        let capacity = self.fluid.density * self.fluid.capacity;
        let form = if self.lumped { Form::Lumped } else { Form::Consistent };
        set.scalars = vec![Scalar { form, ..Scalar::new(TEMPERATURE, capacity, self.fluid.conductivity) }];
        self.prescribe(&mut set, &mesh, 0.0);
        let start = self.nodal(&mesh, 0.0);
        let (points, volume) = (mesh.points.clone(), mesh.nodal_volume());
        let mut whole = clock::Spent::default();
        let mut flow = clock::timed(&mut whole, || set.equations(mesh, start))?;
        let mut spent = Spent { mesh: whole.wall, ..Spent::default() };
        let bodies = self.bodies.as_ref();
        for step in 1..=self.steps {
            let time = step as f64 * self.dt;
            self.prescribe(&mut set, flow.mesh(), time);
            let exact: Vec<Exact> = points.iter().map(|x| self.fields.exact(*x, time)).collect();
            flow.set_sources(Some(Sources {
                momentum: exact.iter().map(|exact| exact.momentum(&self.fluid, bodies)).collect(),
                mass: balanced(exact.iter().map(|exact| exact.mass(bodies)).collect(), &volume),
                scalars: vec![exact.iter().map(|exact| exact.heat(&self.fluid, bodies)).collect()],
            }));
            let voidage: Vec<f64> = exact.iter().map(|exact| exact.voidage.value).collect();
            let immersed =
                self.bodies.map(|bodies| immersed::points(flow.mesh(), &self.fields, &bodies, time));
            let report = clock::timed(&mut whole, || {
                let report = flow.solve(self.dt, &voidage, immersed.as_ref(), &set.conditions)?;
                flow.accept();
                Ok::<_, voidage_coupling::Error>(report)
            })?;
            spent.flow += report.flow_s;
            spent.heat += report.scalars_s;
        }
        (spent.all, spent.cpu) = (whole.wall, whole.cpu);
        Ok((flow, spent))
    }

    /// Exact velocities and temperatures on all sides.
    fn prescribe(&self, set: &mut FluidSet, mesh: &Mesh<2>, time: f64) {
        let exact = self.nodal(mesh, time);
        for condition in &mut set.conditions {
            condition.flow = FlowCondition::Velocity(Prescribed::Nodal(exact.velocity.clone()));
            let temperature = exact.scalar(HEAT).to_vec();
            condition.scalars = vec![ScalarCondition::Value(Prescribed::Nodal(temperature))];
        }
    }

    fn nodal(&self, mesh: &Mesh<2>, time: f64) -> State<2> {
        let exact: Vec<Exact> = mesh.points.iter().map(|x| self.fields.exact(*x, time)).collect();
        State {
            velocity: exact
                .iter()
                .map(|exact| Vec2::new(exact.velocity[0].value, exact.velocity[1].value))
                .collect(),
            pressure: exact.iter().map(|exact| exact.pressure.value).collect(),
            scalars: vec![exact.iter().map(|exact| exact.temperature.value).collect()],
        }
    }

    /// The norms of the exact fields.
    pub fn norms(&self, flow: &Flow<2, 3>, time: f64) -> Off {
        let with_slope = |jet: Jet| (jet.value, Vec2::new(jet.slope[0], jet.slope[1]));
        let (mesh, at) = (flow.mesh(), |x: Vec2| self.fields.exact(x, time));
        Off {
            velocity: errors(mesh, |_| [0.0; 2], |x| at(x).velocity.map(with_slope)),
            pressure: errors(mesh, |_| [0.0], |x| [with_slope(at(x).pressure)]),
            pressure_inside: errors_in(mesh, inside, |_| [0.0], |x| [with_slope(at(x).pressure)]),
            temperature: errors(mesh, |_| [0.0], |x| [with_slope(at(x).temperature)]),
        }
    }

    /// What a solution at a time is off by.
    pub fn off(&self, flow: &Flow<2, 3>, time: f64) -> Off {
        let (mesh, state) = (flow.mesh(), flow.state());
        let with_slope = |jet: Jet| (jet.value, Vec2::new(jet.slope[0], jet.slope[1]));
        let at = |x: Vec2| self.fields.exact(x, time);
        let volume = mesh.nodal_volume();
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            values.zip(&volume).map(|(p, v)| p * v).sum::<f64>() / volume.iter().sum::<f64>()
        };
        let level = mean(&mut state.pressure.iter().copied())
            - mean(&mut mesh.points.iter().map(|x| at(*x).pressure.value));
        let pressure = |a: usize| [state.pressure[a] - level];
        let warm = state.scalar(HEAT);
        Off {
            velocity: errors(
                mesh,
                |a| [state.velocity[a].x, state.velocity[a].y],
                |x| at(x).velocity.map(with_slope),
            ),
            pressure: errors(mesh, pressure, |x| [with_slope(at(x).pressure)]),
            pressure_inside: errors_in(mesh, inside, pressure, |x| [with_slope(at(x).pressure)]),
            temperature: errors(mesh, |a| [warm[a]], |x| [with_slope(at(x).temperature)]),
        }
    }
}
