//! A disc that slides ends rolling.

use super::scene::{G, curve, exponent, floor, precise, rubbing, step, v};
use crate::models::alike;
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::{Dem, Load};

/// The case.
pub const CASE: Case = Case {
    name: "sliding-to-rolling",
    group: "grains",
    title: "a disc that slides on a floor ends rolling at two thirds of its speed",
    source: "exact: v = v0 - mu g t and r w = 2 mu g t until v0/(3 mu g), where v = 2/3 v0 and x = 5 v0^2/(18 mu g)",
    run,
};

const FRICTION: f64 = 0.3;
const RADIUS: f64 = 0.1;
const SPEED: f64 = 1.0;
/// End of the run, s: a bit more than twice the time of sliding.
const END: f64 = 0.25;

/// Time at which sliding ends, s.
fn sliding() -> f64 {
    SPEED / (3.0 * FRICTION * G)
}

/// One instant: time (s), velocity, speed of the rim that faces down, against the motion (m/s), place (m).
struct Instant {
    time: f64,
    velocity: f64,
    rim: f64,
    place: f64,
}

fn slide(count: usize) -> Result<Vec<Instant>> {
    let material = rubbing(FRICTION);
    let mut grains = alike(vec![v(0.0, RADIUS)], RADIUS, &material)?.rotating();
    grains.velocity[0] = v(SPEED, 0.0);
    let mut dem = Dem::new(grains, vec![floor(FRICTION)], vec![material], precise())?;
    let instant = |dem: &Dem<2>| Instant {
        time: dem.time(),
        velocity: dem.particles.velocity[0].x,
        rim: dem.particles.rotation.as_ref().map_or(0.0, |r| -RADIUS * r.spin[0]),
        place: dem.particles.position[0].x,
    };
    let mut path = vec![instant(&dem)];
    for _ in 0..count {
        step(&mut dem, END / count as f64, &Load::default())?;
        path.push(instant(&dem));
    }
    Ok(path)
}

fn run(effort: Effort) -> Result<Outcome> {
    let counts: &[usize] = effort.pick(&[100, 200, 400], &[100, 200, 400, 800, 1600, 3200]);
    let end = sliding();
    let exact = 5.0 * SPEED * SPEED / (18.0 * FRICTION * G) + 2.0 / 3.0 * SPEED * (END - end);
    let paths = counts.iter().map(|count| slide(*count)).collect::<Result<Vec<_>>>()?;
    let last = |path: &Vec<Instant>| path.last().map_or(f64::NAN, |at| at.place);
    let errors: Vec<(f64, f64)> = paths
        .iter()
        .zip(counts)
        .map(|(path, count)| (END / *count as f64, (last(path) - exact).abs()))
        .collect();
    let (path, dt) = (&paths[paths.len() - 1], errors[errors.len() - 1].0);
    let rolls = path.iter().find(|at| (at.velocity - at.rim).abs() < 1e-9 * SPEED);
    let finish = &path[path.len() - 1];
    let order = exponent(&errors);
    let findings = vec![
        Finding::relative("final speed", "m/s", 2.0 / 3.0 * SPEED, finish.velocity, 1e-10),
        Finding::relative("final speed of the rim", "m/s", 2.0 / 3.0 * SPEED, finish.rim, 1e-10),
        Finding::absolute(
            "time at which it rolls",
            "s",
            end,
            rolls.map_or(f64::NAN, |at| at.time),
            1.01 * dt,
        ),
        Finding::absolute(
            format!("place after {END} s, step {dt:.1e} s"),
            "m",
            exact,
            finish.place,
            SPEED * dt,
        )
        .with_order(order),
        Finding::at_least("order of the place", "1", 0.95, order),
    ];
    let coarse = &paths[0];
    let panel = Panel {
        curves: vec![
            Curve::line("exact", curve([0.0, END], |t| SPEED - FRICTION * G * t.min(end))),
            Curve::line("", curve([0.0, END], |t| 2.0 * FRICTION * G * t.min(end))),
            Curve::points("velocity", coarse.iter().step_by(4).map(|at| (at.time, at.velocity)).collect()),
            Curve::points("speed of the rim", coarse.iter().step_by(4).map(|at| (at.time, at.rim)).collect()),
        ],
        ..Panel::new("A sliding disc ends rolling", "t (s)", "speed (m/s)")
    };
    Ok(Outcome { findings, panels: vec![panel] })
}
