//! Taylor-Aris dispersion: how a flow that is not even across a channel spreads what it carries along the channel.

use crate::models::{FluidSet, Vec2, grid};
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{Result, TEMPERATURE};
use voidage_fluid::conditions::{FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::State;
use voidage_fluid::transport::Scalar;

/// The case.
pub const CASE: Case = Case {
    name: "taylor-dispersion",
    group: "fluid",
    title: "temperature and a tracer, each with a diffusivity of its own, disperse along a plane channel",
    source: "exact: D (1 + Pe^2/210), Pe = U H/D (Taylor 1953, Aris 1956; here for two plates)",
    run,
};

/// Mean speed and height of the channel, m/s and m, and its length over the height.
const SPEED: f64 = 1.0;
const HEIGHT: f64 = 1.0;
const LENGTH: f64 = 2.0;
/// Names, capacities, diffusivities, and values at the middle of the channel.
const SCALARS: [(&str, f64, f64, f64); 2] =
    [(TEMPERATURE, 1200.0, 0.1, 300.0), ("tracer", 1.0, 1.0 / 30.0, 5.0)];
/// Rise of all of them along the channel, per m.
const RISE: f64 = 1.0;

/// The flow relative to its mean, m/s: U (6 eta (1 - eta) - 1) with eta = y/H. Linear between so many nodes across it
/// would have the mean -U/n^2, which would carry more than disperses; that is taken off.
fn stream(x: &Vec2, squares: usize) -> Vec2 {
    let (eta, edge) = (x.y / HEIGHT, 1.0 / squares as f64);
    Vec2::new(SPEED * (6.0 * eta * (1.0 - eta) - 1.0 + edge * edge), 0.0)
}

/// The steady field in the frame that moves with the mean flow: s = s_0 + G (x - L/2) + g(y) with D g'' = u G.
fn exact(x: &Vec2, diffusivity: f64, middle: f64) -> f64 {
    let eta = x.y / HEIGHT;
    let across = eta.powi(3) - 0.5 * eta.powi(4) - 0.5 * eta * eta + 1.0 / 60.0;
    middle + RISE * (x.x - 0.5 * LENGTH * HEIGHT) + RISE * SPEED * HEIGHT * HEIGHT / diffusivity * across
}

/// D_eff/D of every scalar, from what passes the left end: conducted, and convected.
fn solve(squares: usize) -> Result<Vec<f64>> {
    let mesh = grid([LENGTH * HEIGHT, HEIGHT], [2 * squares, squares])?;
    let moving =
        FlowCondition::Velocity(Prescribed::Nodal(mesh.points.iter().map(|x| stream(x, squares)).collect()));
    let mut set = FluidSet::new(1.0, 0.1);
    set.scalars = SCALARS
        .map(|(name, capacity, diffusivity, _)| Scalar::new(name, capacity, capacity * diffusivity))
        .to_vec();
    let values: Vec<Vec<f64>> = SCALARS
        .iter()
        .map(|(_, _, diffusivity, middle)| {
            mesh.points.iter().map(|x| exact(x, *diffusivity, *middle)).collect()
        })
        .collect();
    for condition in &mut set.conditions {
        condition.flow = moving.clone();
        if ["left", "right"].contains(&condition.boundary.as_str()) {
            let held = values.iter().map(|values| ScalarCondition::Value(Prescribed::Nodal(values.clone())));
            condition.scalars = held.collect();
        }
    }
    let start = State {
        velocity: mesh.points.iter().map(|x| stream(x, squares)).collect(),
        pressure: vec![0.0; mesh.points.len()],
        scalars: values,
    };
    let clear = vec![1.0; mesh.points.len()];
    let mut flow = set.equations(mesh, start)?;
    let mut balances = vec![];
    for _ in 0..8 {
        flow.solve(1e4, &clear, None, &set.conditions)?;
        flow.balances(&clear, &set.conditions, &mut balances);
        flow.accept();
    }
    let left = &balances[set.conditions.iter().position(|c| c.boundary == "left").unwrap_or(0)];
    let spread = |(k, (_, capacity, diffusivity, _)): (usize, &(&str, f64, f64, f64))| {
        let into = left.scalars[k] - left.convected[k];
        -into / (capacity * diffusivity * RISE * HEIGHT)
    };
    Ok(SCALARS.iter().enumerate().map(spread).collect())
}

fn run(effort: Effort) -> Result<Outcome> {
    let sizes: &[usize] = effort.pick(&[16, 32], &[16, 32, 64, 128]);
    let solved = sizes.iter().map(|squares| solve(*squares)).collect::<Result<Vec<_>>>()?;
    let mut outcome = Outcome::default();
    let mut panel = Panel::log_log("Taylor-Aris dispersion between plates", "Pe", "D\u{2091}/D \u{2212} 1");
    let last = solved.len() - 1;
    let mut points = Vec::new();
    for (k, (name, _, diffusivity, _)) in SCALARS.iter().enumerate() {
        let peclet = SPEED * HEIGHT / diffusivity;
        let known = 1.0 + peclet * peclet / 210.0;
        let miss = |n: usize| (solved[n][k] - known).abs();
        let what = format!("dispersion of {name} / D, Pe {peclet:.0}, {} squares across", sizes[last]);
        let finding = Finding::relative(what, "1", known, solved[last][k], effort.pick(0.03, 2e-3));
        outcome.findings.push(finding.with_order((miss(last - 1) / miss(last)).log2()));
        points.push((peclet, solved[last][k] - 1.0));
    }
    let line = (0..=20).map(|k| 5.0 * 12f64.powf(k as f64 / 20.0)).map(|pe| (pe, pe * pe / 210.0)).collect();
    panel.curves = vec![Curve::line("Pe\u{b2}/210", line), Curve::points("measured", points)];
    outcome.panels.push(panel);
    Ok(outcome)
}
