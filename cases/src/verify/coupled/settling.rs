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

/// Water and glass, grains of 1 mm (SI).
const FLUID: f64 = 1000.0;
const SOLID: f64 = 2500.0;
const VISCOSITY: f64 = 1e-3;
const DIAMETER: f64 = 1e-3;
const GRAVITY: f64 = 9.81;
/// Width of the column, m: grains that can move aside do so, and the heavier side sinks.
const WIDTH: f64 = 1.001 * DIAMETER;

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

/// Squares of the column, and those that the suspension fills at first.
const SQUARES: usize = 24;
const FILLED: usize = 20;
/// Grains to a square.
const EACH: usize = 4;

/// Distance between grains that makes a share of solid, m.
fn spacing(share: f64) -> f64 {
    0.25 * PI * DIAMETER * DIAMETER / (share * WIDTH)
}

/// Height of the front against time, and the laws. The grains fall in single file: a suspension that is free to overturn does so before its front has gone far.
fn fall(function: VoidageFunction, share: f64, steps: usize) -> Result<(Vec<(f64, f64)>, Laws)> {
    let apart = spacing(share);
    let mut set = FluidSet::new(FLUID, VISCOSITY)
        .flow("top", FlowCondition::Open { pressure: 0.0 })
        .flow("left", FlowCondition::Slip)
        .flow("right", FlowCondition::Slip);
    set.properties.gravity = Vec2::new(0.0, -GRAVITY);
    let mesh = column([WIDTH, EACH as f64 * apart * SQUARES as f64], SQUARES)?;
    let laws = Laws { voidage_function: function, ..set.laws(None) };
    let speed = exact(&laws, 1.0 - share);
    let rise = Vec2::new(0.0, share / (1.0 - share) * speed);
    let mut start = set.rest(&mesh, 0.0);
    let top = (EACH * FILLED) as f64 * apart;
    for (u, x) in start.velocity.iter_mut().zip(&mesh.points) {
        *u = if x.y > 0.0 && x.y < top { rise } else { Vec2::zeros() };
    }
    let heights: Vec<f64> = (0..EACH * FILLED).map(|k| (k as f64 + 0.5) * apart).collect();
    let material = Material { density: SOLID, ..Material::default() };
    let mut grains = pile(&heights, 0.5 * DIAMETER, WIDTH, material, Settings::default())?;
    grains.particles.velocity.fill(Vec2::new(0.0, -speed));
    // Without the contact forces of the sediment, which are not needed for what is measured.
    let mut system = set.with_grains(set.build(mesh, start)?, grains, laws, SchemeName::HenryFree)?;
    if let Some(interaction) = &mut system.interaction {
        interaction.at.velocity.fill(rise);
    }
    let dt = drop(share) / speed / steps as f64;
    let mut front = Vec::new();
    for step in 0..=steps {
        let grains = system.grains.as_ref().ok_or_else(|| Error::Run("no grains".into()))?;
        front.push((step as f64 * dt, level(&grains.particles.position, share)));
        if step < steps {
            system.step(dt)?;
        }
    }
    Ok((front, laws))
}

/// Height of the front, m: that of a suspension of the full share of solid which holds as much above a level in its middle as
/// there is. The grains on top see the clear liquid of the cell above them, fall faster, and gather to a cap as tall as
/// a cell or two; what it holds is counted, where it is does not matter.
fn level(position: &[Vec2], share: f64) -> f64 {
    let middle = 0.5 * (EACH * FILLED) as f64 * spacing(share);
    let below = position.partition_point(|x| x.y < middle);
    let (Some(low), Some(high)) = (position[..below].last().map(|x| x.y), position.get(below).map(|x| x.y))
    else {
        return f64::NAN;
    };
    let above = (position.len() - below) as f64 - 0.5 + (high - middle) / (high - low);
    middle + above * spacing(share)
}

/// How far the front is to fall, m: by one square. Grains and liquid start at the speeds of a uniform suspension. Further
/// down, waves of density have grown from the grain by grain passage through the mesh, and the speed scatters by some per
/// cent: a suspension without a pressure of its own is unstable to them. With grains of 0.1 mm, and time steps above
/// their relaxation time, they have grown at once; there the pressure stabilisation, which does not know the drag, lets more
/// liquid through a residual than the suspension does.
fn drop(share: f64) -> f64 {
    EACH as f64 * spacing(share)
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
    let steps = effort.pick(400, 2000);
    let mut outcome = Outcome::default();
    let mut panel = Panel::new("Front of a settling suspension", "t v / fall", "height / fall");
    for (function, share) in
        [(VoidageFunction::Henry, 0.3), (VoidageFunction::Henry, 0.1), (VoidageFunction::None, 0.15)]
    {
        let (front, laws) = fall(function, share, steps)?;
        let speed = exact(&laws, 1.0 - share);
        let measured = -slope(&front);
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
