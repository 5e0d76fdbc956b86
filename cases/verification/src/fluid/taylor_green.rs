//! The Taylor-Green vortex in a constant voidage.

use crate::models::{FluidSet, Vec2, grid};
use crate::norms::errors;
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{Effort, worse};
use voidage_coupling::Result;
use voidage_fluid::conditions::FlowCondition;
use voidage_fluid::flow::State;

/// The case.
pub const CASE: Case = Case {
    name: "taylor-green",
    group: "fluid",
    title: "a decaying vortex is the same in a constant voidage as without, and decays at its rate",
    source: "exact: u = (sin(pi x) cos(pi y), -cos(pi x) sin(pi y)) exp(-2 nu pi^2 t), p = eps rho (cos(2 pi x) + \
             cos(2 pi y)) / 4 exp(-4 nu pi^2 t)",
    run,
};

/// Kinematic viscosity, m2/s, and time at the end, s.
const VISCOSITY: f64 = 0.01;
const END: f64 = 1.6;

/// 1/s: kinetic energy falls as exp(-rate t).
fn rate() -> f64 {
    4.0 * VISCOSITY * PI * PI
}

fn velocity(x: Vec2) -> [(f64, Vec2); 2] {
    let ((sx, cx), (sy, cy)) = ((PI * x.x).sin_cos(), (PI * x.y).sin_cos());
    [(sx * cy, Vec2::new(cx * cy, -sx * sy) * PI), (-cx * sy, Vec2::new(sx * sy, -cx * cy) * PI)]
}

/// What is left at the end of a run.
struct Vortex {
    state: State<2>,
    /// Error of the velocity in L2.
    error: f64,
    /// Times and kinetic energies over that at the start.
    energy: Vec<(f64, f64)>,
}

fn solve(squares: usize, steps: usize, voidage: f64) -> Result<Vortex> {
    let mesh = grid([1.0, 1.0], [squares; 2])?;
    let mut set = FluidSet::new(1.0, VISCOSITY);
    set.conditions.iter_mut().for_each(|condition| condition.flow = FlowCondition::Slip);
    set.numerics.newton = 2;
    let pressure = |x: &Vec2| 0.25 * voidage * ((2.0 * PI * x.x).cos() + (2.0 * PI * x.y).cos());
    let start = State {
        velocity: mesh.points.iter().map(|x| Vec2::from(velocity(*x).map(|(value, _)| value))).collect(),
        pressure: mesh.points.iter().map(pressure).collect(),
        scalars: vec![],
    };
    let volume = mesh.nodal_volume();
    let kinetic =
        |state: &State<2>| state.velocity.iter().zip(&volume).map(|(u, v)| v * u.norm_squared()).sum::<f64>();
    let full = kinetic(&start);
    let field = vec![voidage; mesh.points.len()];
    let mut flow = set.equations(mesh, start)?;
    let dt = END / steps as f64;
    let mut energy = vec![(0.0, 1.0)];
    for step in 1..=steps {
        flow.solve(dt, &field, None, &set.conditions)?;
        flow.accept();
        energy.push((step as f64 * dt, kinetic(flow.state()) / full));
    }
    let left = (-0.5 * rate() * END).exp();
    let state = flow.state().clone();
    let exact = |x: Vec2| velocity(x).map(|(value, slope)| (value * left, slope * left));
    let off = errors(flow.mesh(), |a| [state.velocity[a].x, state.velocity[a].y], exact);
    Ok(Vortex { state, error: off.l2, energy })
}

/// Mesh halved, time step quartered: order 2.
fn run(effort: Effort) -> Result<Outcome> {
    let pairs: &[(usize, usize)] = effort.pick(&[(16, 10), (32, 40)], &[(16, 10), (32, 40), (64, 160)]);
    let mut vortices = Vec::new();
    for &(squares, steps) in pairs {
        vortices.push(solve(squares, steps, 0.4)?);
    }
    let (squares, steps) = pairs[0];
    let clear = solve(squares, steps, 1.0)?;
    let gap = |a: f64, b: f64| (a - b).abs();
    let mut worst = 0.0_f64;
    for (u, v) in vortices[0].state.velocity.iter().zip(&clear.state.velocity) {
        worst = worse(worst, (u - v).norm());
    }
    for (p, q) in vortices[0].state.pressure.iter().zip(&clear.state.pressure) {
        worst = worse(worst, gap(*p / 0.4, *q));
    }
    let rates: Vec<f64> =
        vortices.iter().map(|vortex| -vortex.energy[vortex.energy.len() - 1].1.ln() / END).collect();
    let errors: Vec<f64> = vortices.iter().map(|vortex| vortex.error).collect();
    let finest = Finding::relative(
        format!("decay rate of kinetic energy, {} squares", pairs[pairs.len() - 1].0),
        "1/s",
        rate(),
        rates[rates.len() - 1],
        effort.pick(2e-2, 1e-3),
    );
    let line = (0..=100).map(|k| END * k as f64 / 100.0).map(|t| (t, (-rate() * t).exp())).collect();
    let panel = Panel {
        curves: vec![Curve::line("exact", line), Curve::points("16 squares", vortices[0].energy.clone())],
        ..Panel::new("Taylor-Green vortex", "t (s)", "kinetic energy / initial")
    };
    Ok(Outcome {
        findings: vec![
            Finding::at_most(
                "largest difference of u, p/eps from those without voidage",
                "m/s, Pa",
                1e-10,
                worst,
            ),
            finest,
            Finding::order("order of u in L2, dt ~ h^2", 1.9, &errors, 2.0),
        ],
        panels: vec![panel],
    })
}
