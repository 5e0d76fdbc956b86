//! A grain that falls through a medium with implicit drag.

use super::scene::{G, curve, precise, step};
use crate::models::{Vec2, grains};
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::largest;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::{Load, Material};

/// The case.
pub const CASE: Case = Case {
    name: "fall-with-drag",
    group: "grains",
    title: "a grain under gravity and implicit drag approaches its terminal velocity, with any step",
    source: "exact: v = -g tau (1 - exp(-t/tau)), tau = m/gamma; a step gives v' = (v - g dt)/(1 + dt/tau)",
    run,
};

/// Relaxation time m/gamma, s.
const TAU: f64 = 0.1;
/// Radius, m: so large that no step is cut into sub-steps.
const RADIUS: f64 = 1e7;

/// Downward velocity over g tau at the end of each step.
fn fall(dt: f64, count: usize) -> Result<Vec<f64>> {
    let mut dem = grains(vec![Vec2::zeros()], RADIUS, Material::default(), precise())?;
    let drag = [dem.particles.mass[0] / TAU];
    let load = Load { drag: &drag, ..Load::default() };
    let mut speeds = vec![0.0];
    for _ in 0..count {
        step(&mut dem, dt, &load)?;
        speeds.push(-dem.particles.velocity[0].y / (G * TAU));
    }
    Ok(speeds)
}

fn run(effort: Effort) -> Result<Outcome> {
    let counts: &[usize] = effort.pick(&[40, 80, 160], &[40, 80, 160, 320, 640, 1280]);
    let (end, exact) = (4.0 * TAU, |t: f64| 1.0 - (-t / TAU).exp());
    let (mut errors, mut curves) = (vec![], vec![Curve::line("exact", curve([0.0, end], exact))]);
    for (k, &count) in counts.iter().enumerate() {
        let dt = end / count as f64;
        let path: Vec<(f64, f64)> =
            fall(dt, count)?.into_iter().enumerate().map(|(k, u)| (k as f64 * dt, u)).collect();
        errors.push(largest(path.iter().map(|(t, u)| u - exact(*t))));
        if k == 0 {
            curves.push(Curve::points("step \u{3c4}/10", path));
        }
    }
    let steps = fall(TAU, 10)?;
    let recursion = |k: usize| 1.0 - 0.5f64.powi(k as i32);
    let worst = largest((0..=10).map(|k| steps[k] - recursion(k)));
    let stiff = fall(1e6 * TAU, 1)?[1];
    let panel = Panel { curves, ..Panel::new("Fall with implicit drag", "t (s)", "-v / (g \u{3c4})") };
    Ok(Outcome {
        findings: vec![
            Finding::at_most(
                format!("largest error of v/(g tau), step tau/{}", counts[counts.len() - 1] / 4),
                "1",
                effort.pick(6e-3, 8e-4),
                errors[errors.len() - 1],
            ),
            Finding::order("order of the velocity", 0.95, &errors, 2.0),
            Finding::at_most("distance to the exact recursion, step tau", "1", 1e-13, worst),
            Finding::relative("v/(g tau) after one step of 10^6 tau", "1", 1.0, stiff, 2e-6),
        ],
        panels: vec![panel],
    })
}
