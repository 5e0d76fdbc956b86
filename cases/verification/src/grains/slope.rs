//! Discs and blocks on a slope: Coulomb's law and rolling.

use super::scene::{G, curve, floor, precise, rubbing, steps, threshold, v};
use crate::models::alike;
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{largest, worse};
use voidage_coupling::Result;
use voidage_dem::{Dem, Settings};

/// The case.
pub const CASE: Case = Case {
    name: "slope",
    group: "grains",
    title: "on a slope a block slides iff tan > mu, a disc rolls iff tan <= 3 mu, with exact accelerations",
    source: "exact: sliding g (sin - mu cos), rolling 2/3 g sin; a slipping disc spins up by 2 mu g cos/r",
    run,
};

const FRICTION: f64 = 0.2;
const RADIUS: f64 = 0.05;
/// Step and duration, s: the acceleration is constant, which any step integrates exactly.
const STEP: f64 = 1e-3;
const STEPS: usize = 50;

/// Accelerations down the slope and of the rim, over g sin, of a disc (or a block: a disc that does not turn) on a
/// slope of the tangent `ratio` mu.
fn descend(ratio: f64, turns: bool) -> Result<[f64; 2]> {
    let (sin, cos) = (ratio * FRICTION).atan().sin_cos();
    let material = rubbing(FRICTION);
    let settings = Settings { gravity: v(G * sin, -G * cos), ..precise() };
    let grains = alike(vec![v(0.0, RADIUS)], RADIUS, &material)?;
    let grains = if turns { grains.rotating() } else { grains };
    let mut dem = Dem::new(grains, vec![floor(FRICTION)], vec![material], settings)?;
    steps(&mut dem, STEP, STEPS)?;
    let scale = G * sin * STEP * STEPS as f64;
    let rim = dem.particles.rotation.as_ref().map_or(0.0, |r| -RADIUS * r.spin[0]);
    Ok([dem.particles.velocity[0].x / scale, rim / scale])
}

/// What theory says of the same.
fn exact(ratio: f64, turns: bool) -> [f64; 2] {
    match (turns, ratio) {
        (true, ratio) if ratio <= 3.0 => [2.0 / 3.0; 2],
        (true, _) => [1.0 - 1.0 / ratio, 2.0 / ratio],
        (false, ratio) => [(1.0 - 1.0 / ratio).max(0.0), 0.0],
    }
}

fn run(effort: Effort) -> Result<Outcome> {
    let count = effort.pick(13, 49);
    let ratios: Vec<f64> = (0..count).map(|k| 0.13 + 6.0 * k as f64 / (count - 1) as f64).collect();
    let (mut worst, mut curves) = (0.0_f64, vec![]);
    for (turns, name) in [(true, "disc"), (false, "block")] {
        let mut points = vec![];
        // Beside each other where both slip.
        let shift = if turns { 0.0 } else { 0.25 };
        for ratio in ratios.iter().map(|ratio| ratio + shift) {
            let (found, known) = (descend(ratio, turns)?, exact(ratio, turns));
            worst = worse(worst, largest([found[0] - known[0], found[1] - known[1]]));
            points.push((ratio, found[0]));
        }
        curves.push(Curve::line(
            if turns { "exact" } else { "" },
            curve([0.1, 6.4], |ratio| exact(ratio, turns)[0]),
        ));
        curves.push(Curve::points(name, points));
    }
    let slips = threshold([2.0, 4.0], 1e-7, |ratio| {
        let [centre, rim] = descend(ratio, true)?;
        Ok((centre - rim).abs() > 1e-9)
    })?;
    let slides = threshold([0.5, 2.0], 1e-7, |ratio| Ok(descend(ratio, false)?[0] > 1e-9))?;
    let panel = Panel {
        curves,
        ..Panel::new("Disc and block on a slope", "tan \u{3b8} / \u{3bc}", "a / (g sin \u{3b8})")
    };
    Ok(Outcome {
        findings: vec![
            Finding::at_most("largest error of an acceleration / (g sin)", "1", 1e-9, worst),
            Finding::absolute("tan/mu at which a disc begins to slip", "1", 3.0, slips, 1e-6),
            Finding::absolute("tan/mu at which a block begins to slide", "1", 1.0, slides, 1e-6),
        ],
        panels: vec![panel],
    })
}
