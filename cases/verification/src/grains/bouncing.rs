//! A ball that bounces by Newton's law of restitution.

use super::scene::{G, exponent, floor, precise, step, v};
use crate::models::alike;
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::{Dem, Load, Material, Wall};

/// The case.
pub const CASE: Case = Case {
    name: "bouncing-ball",
    group: "grains",
    title: "a ball rises to e^2 of its last height and lies still after a finite time",
    source: "exact: Newton's law of restitution; n-th height e^(2 n) h, at rest after sqrt(2 h/g) (1 + e)/(1 - e)",
    run,
};

const RESTITUTION: f64 = 0.8;
const RADIUS: f64 = 0.05;
const BOUNCES: usize = 4;

/// Time of the k-th impact after a fall from a height, s; the first is k = 0.
fn impact(height: f64, k: usize) -> f64 {
    let fall = (2.0 * height / G).sqrt();
    fall * (1.0 + 2.0 * (1..=k).map(|n| RESTITUTION.powi(n as i32)).sum::<f64>())
}

/// Height above the floor at a time, m.
fn exact(height: f64, time: f64) -> f64 {
    let fall = (2.0 * height / G).sqrt();
    if time < fall {
        return height - 0.5 * G * time * time;
    }
    let k = (0..1000).take_while(|k| impact(height, *k) <= time).count() - 1;
    let since = time - impact(height, k);
    let speed = RESTITUTION.powi(k as i32 + 1) * G * fall;
    (speed * since - 0.5 * G * since * since).max(0.0)
}

/// Height above the floor after each step, m.
fn drop_from(height: f64, dt: f64, end: f64) -> Result<Vec<(f64, f64)>> {
    let material = Material { restitution: RESTITUTION, ..Material::default() };
    let ground = Wall { restitution: RESTITUTION, ..floor(0.0) };
    let grains = alike(vec![v(0.0, RADIUS + height)], RADIUS, &material)?;
    let mut dem = Dem::new(grains, vec![ground], vec![material], precise())?;
    let mut path = vec![(0.0, height)];
    while dem.time() < end {
        step(&mut dem, dt, &Load::default())?;
        path.push((dem.time(), dem.particles.position[0].y - RADIUS));
    }
    Ok(path)
}

/// Relative errors of the first heights of rise, root mean square over drops from `drops` heights: where in its step an
/// impact falls is a matter of chance.
fn error(dt: f64, drops: usize) -> Result<f64> {
    let mut sum = 0.0;
    for k in 0..drops {
        let height = 0.8 + 0.4 * (k as f64 + 0.5) / drops as f64;
        let path = drop_from(height, dt, impact(height, BOUNCES))?;
        for n in 1..=BOUNCES {
            let between = impact(height, n - 1)..impact(height, n);
            let top = path.iter().filter(|p| between.contains(&p.0)).fold(0.0, |top: f64, p| top.max(p.1));
            sum += (top / (RESTITUTION.powi(2 * n as i32) * height) - 1.0).powi(2);
        }
    }
    Ok((sum / (drops * BOUNCES) as f64).sqrt())
}

fn run(effort: Effort) -> Result<Outcome> {
    let (levels, drops) = effort.pick((4, 12), (7, 64));
    let sizes: Vec<f64> = (0..levels).map(|k| 4e-3 / 2f64.powi(k)).collect();
    let errors = sizes.iter().map(|dt| Ok((*dt, error(*dt, drops)?))).collect::<Result<Vec<_>>>()?;
    let (finest, order) = (errors[errors.len() - 1], exponent(&errors));
    let rest = (2.0 / G).sqrt() * (1.0 + RESTITUTION) / (1.0 - RESTITUTION);
    let (dt, stride) = (1e-4, 400);
    let path = drop_from(1.0, dt, 1.1 * rest)?;
    let lies = path.iter().rev().take_while(|p| p.1 < 1e-9).last().map_or(f64::NAN, |p| p.0);
    let line = (0..2000).map(|k| k as f64 / 2000.0 * 1.1 * rest).map(|t| (t, exact(1.0, t))).collect();
    let path = Panel {
        curves: vec![
            Curve::line("exact", line),
            Curve::points("step 0.1 ms", path.into_iter().step_by(stride).collect()),
        ],
        ..Panel::new("A bouncing ball, e = 0.8", "t (s)", "height (m)")
    };
    let slope = errors.iter().map(|p| (p.0, errors[0].1 * p.0 / errors[0].0)).collect();
    let convergence = Panel {
        curves: vec![Curve::dashes("first order", slope), Curve::joined("heights of rise", errors)],
        ..Panel::log_log("Error of the heights of a bouncing ball", "step (s)", "relative error")
    };
    Ok(Outcome {
        findings: vec![
            Finding::at_most(
                format!("error of {BOUNCES} heights, root mean square, step {:.1e} s", finest.0),
                "1",
                effort.pick(4e-3, 5e-4),
                finest.1,
            )
            .with_order(order),
            Finding::at_least("order of the heights", "1", 0.9, order),
            Finding::relative("time after which it lies still", "s", rest, lies, 0.01),
        ],
        panels: vec![path, convergence],
    })
}
