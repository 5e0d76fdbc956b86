//! Stefan vaporisation: a still disc of boiling liquid, the vapour that its heat makes, and the temperature around.

use crate::models::{FluidSet, Vec2, annulus};
use crate::norms::errors;
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{HEAT, Result, TEMPERATURE};
use voidage_fluid::Flow;
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::transport::Scalar;

/// The case.
pub const CASE: Case = Case {
    name: "stefan",
    group: "fluid",
    title: "mass rate and temperature of a still boiling disc whose vapour blows off against the heat",
    source: "exact: mdot = (2 pi k/c) ln(1 + B)/ln(R/r_d), B = c (T_w - T_d)/L; T - T_d = (L/c) ((r/r_d)^(mdot c/(2 pi k)) - 1)",
    run,
};

/// Gas of Table 2 of Henry et al.: density, viscosity, heat capacity, conductivity; latent heat of water (SI).
const DENSITY: f64 = 1.204;
const VISCOSITY: f64 = 2e-5;
const CAPACITY: f64 = 1040.0;
const CONDUCTIVITY: f64 = 0.026;
const LATENT: f64 = 2.257e6;
/// Radii of the disc and of the wall, m, and temperature of the disc, C.
const DISC: f64 = 1.25e-3;
const WALL: f64 = 5e-3;
const BOILING: f64 = 100.0;

/// Mass rate per metre of depth for a wall temperature, kg/m/s.
fn exact_rate(wall: f64) -> f64 {
    let number = CAPACITY * (wall - BOILING) / LATENT;
    2.0 * PI * CONDUCTIVITY / CAPACITY * (1.0 + number).ln() / (WALL / DISC).ln()
}

/// Temperature and its gradient, C.
fn exact_temperature(x: Vec2, wall: f64) -> (f64, Vec2) {
    let power = exact_rate(wall) * CAPACITY / (2.0 * PI * CONDUCTIVITY);
    let r = x.norm();
    let rise = LATENT / CAPACITY * (r / DISC).powf(power);
    (BOILING + rise - LATENT / CAPACITY, x * (rise * power / (r * r)))
}

/// The steady state in a ring of n circles: mass rate and solver.
fn solve(wall: f64, rings: usize) -> Result<(f64, Flow<2, 3>)> {
    let mesh = annulus(DISC, WALL, rings, 4 * rings);
    let mut set = FluidSet::new(DENSITY, VISCOSITY);
    let scalar = Scalar::new(TEMPERATURE, DENSITY * CAPACITY, CONDUCTIVITY);
    set.scalars = vec![Scalar { expansion: 0.0, reference: BOILING, ..scalar }];
    let directions: Vec<Vec2> = mesh.points.iter().map(|x| x.normalize()).collect();
    let blowing = |rate: f64| {
        let speed = rate / (2.0 * PI * DISC * DENSITY);
        FlowCondition::Velocity(Prescribed::Nodal(directions.iter().map(|out| out * speed).collect()))
    };
    let held = |temperature: f64| ScalarCondition::Value(Prescribed::Uniform(temperature));
    set.conditions = vec![
        Condition { boundary: "inner".into(), flow: blowing(0.0), scalars: vec![held(BOILING)] },
        Condition {
            boundary: "outer".into(),
            flow: FlowCondition::Open { pressure: 0.0 },
            scalars: vec![held(wall)],
        },
    ];
    let start = set.rest(&mesh, BOILING);
    let clear = vec![1.0; mesh.points.len()];
    let mut flow = set.equations(mesh, start)?;
    let (mut rate, mut balances) = (0.0, vec![]);
    for _ in 0..60 {
        set.conditions[0].flow = blowing(rate);
        flow.solve(1e4, &clear, None, &set.conditions)?;
        // The heat that the disc takes is the reaction of the discrete equation.
        flow.balances(&clear, &set.conditions, &mut balances);
        flow.accept();
        let next = -balances[0].scalars[HEAT] / LATENT;
        if (next - rate).abs() < 1e-10 * next {
            break;
        }
        rate = next;
    }
    Ok((rate, flow))
}

fn run(effort: Effort) -> Result<Outcome> {
    let sizes: &[usize] = effort.pick(&[8, 16], &[8, 16, 32]);
    let finest = sizes[sizes.len() - 1];
    let mut outcome = Outcome::default();
    let mut panel = Panel::new("Vapour of a still boiling disc", "r (mm)", "temperature (C)");
    for wall in [300.0, 400.0, 500.0, 600.0] {
        let exact = exact_rate(wall);
        let (mut misses, mut norms) = (Vec::new(), Vec::new());
        for &rings in sizes {
            let (rate, flow) = solve(wall, rings)?;
            misses.push((rate - exact).abs());
            let warm = flow.state().scalar(HEAT);
            norms.push(errors(flow.mesh(), |a| [warm[a]], |x| [exact_temperature(x, wall)]).l2);
            if rings == finest {
                let order = (misses[misses.len() - 2] / misses[misses.len() - 1]).log2();
                let what = format!("mass rate, wall at {wall} C, {rings} rings");
                outcome.findings.push(
                    Finding::relative(what, "kg/m/s", exact, rate, effort.pick(1e-2, 2e-3)).with_order(order),
                );
                let name = if wall == 300.0 { "measured" } else { "" };
                let points = (0..=rings).map(|k| 4 * rings * k);
                let points = points.map(|a| (1e3 * flow.mesh().points[a].norm(), warm[a])).collect();
                panel.curves.push(Curve::points(name, points));
            }
        }
        outcome.findings.push(Finding::order(
            format!("order of T in L2, wall at {wall} C"),
            1.9,
            &norms,
            2.0,
        ));
        let radii = (0..=100).map(|k| DISC + (WALL - DISC) * k as f64 / 100.0);
        let line = radii.map(|r| (1e3 * r, exact_temperature(Vec2::new(r, 0.0), wall).0)).collect();
        panel.curves.push(Curve::line(if wall == 300.0 { "exact" } else { "" }, line));
    }
    outcome.panels.push(panel);
    Ok(outcome)
}
