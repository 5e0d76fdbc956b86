//! Three cylinders: two on the ground carry a third.

use super::scene::{G, floor, precise, rubbing, steps, threshold, v};
use crate::models::alike;
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::Dem;

/// The case.
pub const CASE: Case = Case {
    name: "three-cylinders",
    group: "grains",
    title: "two cylinders on the ground carry a third iff friction suffices in both places",
    source: "exact: mu >= tan 15 = 0.267949 between them, >= a third of it, 0.0893164, on the ground (3/2 m g each \
             there)",
    run,
};

const STEP: f64 = 2e-3;
const STEPS: usize = 20;

/// Downward acceleration of the third cylinder over g.
fn sinks(between: f64, ground: f64) -> Result<f64> {
    let material = rubbing(between);
    let places = vec![v(-0.5, 0.5), v(0.5, 0.5), v(0.0, 0.5 + 0.75f64.sqrt())];
    let grains = alike(places, 0.5, &material)?.rotating();
    let mut dem = Dem::new(grains, vec![floor(ground)], vec![material], precise())?;
    steps(&mut dem, STEP, STEPS)?;
    Ok(-dem.particles.velocity[2].y / (G * STEP * STEPS as f64))
}

fn run(effort: Effort) -> Result<Outcome> {
    let critical = f64::tan(15f64.to_radians());
    let stands = |between: f64, ground: f64| Ok(sinks(between, ground)? < 1e-9);
    let between = threshold([0.2, 0.3], 1e-8, |mu| stands(mu, 1.0))?;
    let ground = threshold([0.05, 0.15], 1e-8, |mu| stands(1.0, mu))?;
    let count = effort.pick(12, 36);
    let sweep = |low: f64, high: f64| (0..=count).map(move |k| low + (high - low) * k as f64 / count as f64);
    let first = sweep(0.0, 0.4).map(|mu| Ok((mu, sinks(mu, 1.0)?))).collect::<Result<Vec<_>>>()?;
    let second = sweep(0.0, 0.4).map(|mu| Ok((mu, sinks(1.0, mu)?))).collect::<Result<Vec<_>>>()?;
    let top = first.iter().chain(&second).fold(0.0, |top: f64, p| top.max(p.1));
    let panel = Panel {
        curves: vec![
            Curve::line("critical values", vec![(critical, 0.0), (critical, top)]),
            Curve::line("", vec![(critical / 3.0, 0.0), (critical / 3.0, top)]),
            Curve::points("friction between them, rough ground", first),
            Curve::points("friction on the ground, rough cylinders", second),
        ],
        ..Panel::new("Three cylinders", "coefficient of friction", "acceleration of the third / g")
    };
    Ok(Outcome {
        findings: vec![
            Finding::absolute("critical friction between the cylinders", "1", critical, between, 1e-6),
            Finding::absolute("critical friction on the ground", "1", critical / 3.0, ground, 1e-6),
        ],
        panels: vec![panel],
    })
}
