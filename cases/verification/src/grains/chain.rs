//! A chain of discs between two that are kept hot and cold.

use super::scene::{curve, precise, step, v};
use crate::models::{Vec2, alike};
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{Effort, largest, worse};
use voidage_coupling::Result;
use voidage_dem::{Conduction, Dem, Load, Material, Settings};

/// The case.
pub const CASE: Case = Case {
    name: "heat-chain",
    group: "grains",
    title: "N discs between a hot and a cold one carry H dT/(N + 1), and relax to it as exponentials",
    source: "exact: resistors in series; slowest mode sin(pi i/(N + 1)), rate 2 (H/C)(1 - cos(pi/(N + 1))), H by Henry \
             et al. B.3",
    run,
};

/// Discs between the two ends, their diameter (m), the force that presses them (N/m).
const COUNT: usize = 9;
const DIAMETER: f64 = 1.0;
const FORCE: f64 = 50.0;
/// J/K: so small that the steps, which the force limits, resolve the transient.
const CAPACITY: f64 = 1e-4;

pub fn metal() -> Material {
    Material { young: 1e9, poisson: 0.3, conductivity: 10.0, heat_capacity: 100.0, ..Material::default() }
}

/// Conductance of a contact of two grains of [`metal`] of one diameter under a force, W/K: H = 4 k (F d*/(2 pi
/// E*))^(1/4) with d* = d/2 and E* = E/(2 (1 - nu^2)).
pub fn conductance(force: f64, diameter: f64) -> f64 {
    let m = metal();
    let stiffness = m.young / (2.0 * (1.0 - m.poisson * m.poisson));
    4.0 * m.conductivity * (force * 0.5 * diameter / (2.0 * PI * stiffness)).powf(0.25)
}

/// The chain at the given temperatures, its ends among them: the first held, the last pressing, both of huge capacity.
fn chain(temperature: Vec<f64>, capacity: f64) -> Result<Dem<2>> {
    let n = temperature.len();
    let places = (0..n).map(|k| v(k as f64 * DIAMETER, 0.0)).collect();
    let mut grains = alike(places, 0.5 * DIAMETER, &metal())?.heated(0.0, &[metal()])?;
    grains.mass[0] = f64::INFINITY;
    if let Some(heat) = &mut grains.heat {
        heat.capacity = vec![capacity; n];
        (heat.capacity[0], heat.capacity[n - 1]) = (1e15, 1e15);
        heat.temperature = temperature;
    }
    let settings = Settings { gravity: Vec2::zeros(), conduction: Some(Conduction::Henry), ..precise() };
    Ok(Dem::new(grains, vec![], vec![metal()], settings)?)
}

fn push() -> Vec<Vec2> {
    let mut push = vec![Vec2::zeros(); COUNT + 2];
    push[COUNT + 1] = v(-FORCE, 0.0);
    push
}

fn temperatures(dem: &Dem<2>) -> &[f64] {
    dem.particles.heat.as_ref().map_or(&[], |heat| &heat.temperature)
}

/// Flux (W) through N discs between 400 K and 300 K.
fn flux() -> Result<f64> {
    let mut start = vec![300.0; COUNT + 2];
    start[COUNT + 1] = 400.0;
    let mut dem = chain(start, 1e-9)?;
    let push = push();
    for _ in 0..3 {
        step(&mut dem, 1e-3, &Load { force: &push, ..Load::default() })?;
    }
    Ok(dem.contact_heat()[0])
}

/// Amplitude of the slowest mode after each step.
fn decay(dt: f64, count: usize) -> Result<Vec<f64>> {
    let mode = |i: usize| (PI * i as f64 / (COUNT + 1) as f64).sin();
    let mut start: Vec<f64> = (0..COUNT + 2).map(|i| 300.0 + mode(i)).collect();
    start[COUNT + 1] = 300.0;
    let mut dem = chain(start, CAPACITY)?;
    let push = push();
    let mut path = vec![1.0];
    for _ in 0..count {
        step(&mut dem, dt, &Load { force: &push, ..Load::default() })?;
        path.push(temperatures(&dem)[COUNT.div_ceil(2)] - 300.0);
    }
    Ok(path)
}

fn run(effort: Effort) -> Result<Outcome> {
    let h = conductance(FORCE, DIAMETER);
    let rate = 2.0 * h / CAPACITY * (1.0 - (PI / (COUNT + 1) as f64).cos());
    let (end, counts) = (2.0 / rate, effort.pick::<&[usize]>(&[20, 40, 80], &[20, 40, 80, 160, 320, 640]));
    let (mut errors, mut recursion) = (vec![], 0.0_f64);
    let mut curves = vec![Curve::line("exact", curve([0.0, 2.0], |t| (-t).exp()))];
    for (k, &count) in counts.iter().enumerate() {
        let dt = end / count as f64;
        let path = decay(dt, count)?;
        let error = |(k, a): (usize, &f64)| (a - (-rate * dt * k as f64).exp()).abs();
        errors.push(largest(path.iter().enumerate().map(error)));
        let implicit = |(k, a): (usize, &f64)| (a * (1.0 + rate * dt).powi(k as i32) - 1.0).abs();
        recursion = path.iter().enumerate().map(implicit).fold(recursion, worse);
        if k == 0 {
            let points = path.iter().enumerate().map(|(k, a)| (rate * dt * k as f64, *a));
            curves.push(Curve::points(format!("{count} steps"), points.collect()));
        }
    }
    let order = Finding::order("order in time of the transient", 0.95, &errors, 2.0);
    let panel = Panel {
        curves,
        ..Panel::new(format!("Slowest mode of a chain of {COUNT}"), "\u{3bb} t", "amplitude (K)")
    };
    Ok(Outcome {
        findings: vec![
            Finding::relative("flux / (H dT)", "1", 1.0 / (COUNT + 1) as f64, flux()? / (h * 100.0), 1e-6),
            Finding::at_most(
                format!("largest error of the slowest mode, {} steps", counts[counts.len() - 1]),
                "K",
                effort.pick(1e-2, 1.5e-3),
                errors[errors.len() - 1],
            ),
            order,
            Finding::at_most("distance to 1/(1 + rate dt) per step, relative", "1", 1e-6, recursion),
        ],
        panels: vec![panel],
    })
}
