//! Stefan vaporisation: a still disc of boiling liquid, the vapour that its heat makes, and the temperature and the vapour around.

use crate::models::{FluidSet, Vec2, annulus};
use crate::norms::errors;
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{HEAT, Result, TEMPERATURE};
use voidage_fluid::Flow;
use voidage_fluid::body::{Body, BodyMotion, Evaporation};
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
/// Diffusivity of vapour, m2/s.
const DIFFUSIVITY: f64 = 2e-5;
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

/// Vapour, 1 at the disc and 0 at the wall: 1 - ((r/r_d)^p - 1)/((R/r_d)^p - 1), p = mdot/(2 pi rho D_v).
fn exact_vapour(x: Vec2, wall: f64) -> f64 {
    let power = exact_rate(wall) / (2.0 * PI * DENSITY * DIFFUSIVITY);
    let grown = |r: f64| (r / DISC).powf(power) - 1.0;
    1.0 - grown(x.norm()) / grown(WALL)
}

/// The steady state in a ring of n circles: mass rate and solver.
fn solve(wall: f64, rings: usize) -> Result<(f64, Flow<2, 3>)> {
    let mesh = annulus(DISC, WALL, rings, 4 * rings);
    let mut set = FluidSet::new(DENSITY, VISCOSITY);
    let heat = Scalar::new(TEMPERATURE, DENSITY * CAPACITY, CONDUCTIVITY);
    set.scalars = vec![Scalar { reference: BOILING, ..heat }, Scalar::new("vapour", 1.0, DIFFUSIVITY)];
    let disc = Body {
        centre: Vec2::zeros(),
        radius: DISC,
        expansion: 0.0,
        motion: BodyMotion::Held(Vec2::zeros()),
        evaporation: Some(Evaporation { scalar: Some(HEAT), heat: 0.0, latent: LATENT * DENSITY }),
        solid: vec![],
    };
    let held = |value: f64| ScalarCondition::Value(Prescribed::Uniform(value));
    set.conditions = vec![
        Condition {
            boundary: "inner".into(),
            flow: FlowCondition::Body(disc),
            scalars: vec![held(BOILING), held(1.0)],
        },
        Condition {
            boundary: "outer".into(),
            flow: FlowCondition::Open { pressure: 0.0 },
            scalars: vec![held(wall), held(0.0)],
        },
    ];
    let mut start = set.rest(&mesh, BOILING);
    start.scalars[1].fill(0.0);
    let clear = vec![1.0; mesh.points.len()];
    let mut flow = set.equations(mesh, start)?;
    let mut rate = 0.0;
    for _ in 0..60 {
        flow.solve(1e4, &clear, None, &set.conditions)?;
        let next = flow.bodies().map(|body| body.vapour * DENSITY).sum::<f64>();
        flow.accept();
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
        let (mut misses, mut norms, mut vapour_norms) = (Vec::new(), Vec::new(), Vec::new());
        for &rings in sizes {
            let (rate, flow) = solve(wall, rings)?;
            misses.push((rate - exact).abs());
            let warm = flow.state().scalar(HEAT);
            norms.push(errors(flow.mesh(), |a| [warm[a]], |x| [exact_temperature(x, wall)]).l2);
            let vapour = flow.state().scalar(1);
            // The gradient is of no use here.
            let exact_vapour = |x: Vec2| [(exact_vapour(x, wall), Vec2::zeros())];
            vapour_norms.push(errors(flow.mesh(), |a| [vapour[a]], exact_vapour).l2);
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
        outcome.findings.push(Finding::order(
            format!("order of the vapour in L2, wall at {wall} C"),
            1.9,
            &vapour_norms,
            2.0,
        ));
        let radii = (0..=100).map(|k| DISC + (WALL - DISC) * k as f64 / 100.0);
        let line = radii.map(|r| (1e3 * r, exact_temperature(Vec2::new(r, 0.0), wall).0)).collect();
        panel.curves.push(Curve::line(if wall == 300.0 { "exact" } else { "" }, line));
    }
    outcome.panels.push(panel);
    Ok(outcome)
}
