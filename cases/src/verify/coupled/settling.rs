//! The front of a settling suspension.

use crate::models::{FluidSet, Vec2, column, pile};
use crate::plot::panels::{Curve, Panel};
use crate::verify::{Case, Effort, Finding, Outcome};
use std::f64::consts::PI;
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Laws, Result};
use voidage_dem::{Material, Settings};
use voidage_fluid::conditions::FlowCondition;

/// The case.
pub const CASE: Case = Case {
    name: "settling-front",
    group: "coupled",
    title: "speed of the front between a settling suspension and the clear liquid above it",
    source: "exact for the closure: v = -eps w where (gamma/V) w = eps (rho_p - rho_f) g and eps u + phi v = 0",
    run,
};

/// Water and glass, grains of 0.1 mm (SI).
const FLUID: f64 = 1000.0;
const SOLID: f64 = 2500.0;
const VISCOSITY: f64 = 1e-3;
const DIAMETER: f64 = 1e-4;
const GRAVITY: f64 = 9.81;
/// Width of the column, m.
const WIDTH: f64 = 1.25 * DIAMETER;

/// Speed of the grains of a uniform suspension, m/s: the balance of one grain, solved by bisection.
fn exact(laws: &Laws, voidage: f64) -> f64 {
    let excess = |w: f64| {
        let around =
            Surroundings { slip: w, voidage, diameter: DIAMETER, density: FLUID, viscosity: VISCOSITY };
        laws.drag.coefficient(&around, laws.voidage_function) * w - voidage * (SOLID - FLUID) * GRAVITY
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if excess(middle) < 0.0 { low = middle } else { high = middle }
    }
    voidage * low
}

/// Squares of the column, each as tall as four grains are apart, and those that the suspension fills at first.
const SQUARES: usize = 60;
const FILLED: usize = 50;

/// Distance between grains that makes a share of solid, m.
fn spacing(share: f64) -> f64 {
    0.25 * PI * DIAMETER * DIAMETER / (share * WIDTH)
}

/// Height of the topmost grain against time, and the laws; the front falls by `SQUARES / 4` squares or so. The grains fall in
/// single file: a suspension that is free to overturn does so before its front has gone far.
fn fall(function: VoidageFunction, share: f64, steps: usize) -> Result<(Vec<(f64, f64)>, Laws)> {
    let apart = spacing(share);
    let mut set = FluidSet::new(FLUID, VISCOSITY)
        .flow("top", FlowCondition::Open { pressure: 0.0 })
        .flow("left", FlowCondition::Slip)
        .flow("right", FlowCondition::Slip);
    set.properties.gravity = Vec2::new(0.0, -GRAVITY);
    let mesh = column([WIDTH, 4.0 * apart * SQUARES as f64], SQUARES)?;
    let start = set.rest(&mesh, 0.0);
    let heights: Vec<f64> = (0..4 * FILLED).map(|k| (k as f64 + 0.5) * apart).collect();
    let material = Material { density: SOLID, ..Material::default() };
    let grains = pile(&heights, 0.5 * DIAMETER, WIDTH, material, Settings::default())?;
    let laws = Laws { voidage_function: function, ..set.laws(None) };
    // Without the contact forces of the sediment, which are not needed for what is measured.
    let mut system = set.with_grains(set.build(mesh, start)?, grains, laws, SchemeName::HenryFree)?;
    let dt = drop(share) / exact(&laws, 1.0 - share) / steps as f64;
    let mut front = Vec::new();
    for step in 0..=steps {
        let grains = system.grains.as_ref().ok_or_else(|| Error::Run("no grains".into()))?;
        let top = grains.particles.position.iter().map(|x| x.y).fold(0.0, f64::max);
        front.push((step as f64 * dt, top));
        if step < steps {
            system.step(dt)?;
        }
    }
    Ok((front, laws))
}

/// How far the front is to fall, m.
fn drop(share: f64) -> f64 {
    12.0 * 4.0 * spacing(share)
}

/// Slope of the straight line through points, by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let (mut xy, mut xx) = (0.0, 0.0);
    for (a, b) in points {
        xy += (a - x) * (b - y);
        xx += (a - x) * (a - x);
    }
    xy / xx
}

fn run(effort: Effort) -> Result<Outcome> {
    let steps = effort.pick(200, 1000);
    let mut outcome = Outcome::default();
    let mut panel = Panel::new("Front of a settling suspension", "t v / fall", "height / fall");
    for (function, share) in [(VoidageFunction::Henry, 0.3), (VoidageFunction::None, 0.15)] {
        let (front, laws) = fall(function, share, steps)?;
        let speed = exact(&laws, 1.0 - share);
        let measured = -slope(&front[front.len() / 3..]);
        let name = if function == VoidageFunction::None { "none" } else { "henry" };
        let what = format!("speed of the front, phi {share}, voidage function {name}");
        outcome.findings.push(Finding::relative(what, "m/s", speed, measured, 0.005));
        let fall = drop(share);
        let scaled = |(t, y): &(f64, f64)| (t * speed / fall, y / fall);
        let thin = front.iter().step_by(steps / 20).map(scaled).collect();
        panel.curves.push(Curve::points(format!("\u{3c6} {share}, {name}"), thin));
        let first = front[0].1 / fall;
        let line = vec![(0.0, first), (1.0, first - 1.0)];
        panel.curves.push(Curve::line(if share == 0.3 { "closure" } else { "" }, line));
    }
    outcome.panels.push(panel);
    Ok(outcome)
}
