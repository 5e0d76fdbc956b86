//! Flow of discs out of a silo.

use super::scene::{G, curve, generator, line, mean, v};
use crate::models::Vec2;
use crate::plot::panels::{Curve, Panel};
use crate::verify::{Case, Effort, Finding, Outcome};
use rand::Rng;
use rayon::prelude::*;
use voidage_coupling::Result;
use voidage_dem::packing::{Amount, Deposit, Fill, Radii, Region, deposit};
use voidage_dem::{Dem, Load, Material, Settings, Wall};

/// The case.
pub const CASE: Case = Case {
    name: "hopper",
    group: "grains",
    title: "discs flow out of a silo through an opening W at a rate in proportion to (W - k d)^1.5",
    source: "Beverloo et al. 1961; in the plane Mankoc et al. 2007 (Granular Matter 9, 407)",
    run,
};

const FRICTION: f64 = 0.4;
/// Diameters, uniform; their mean d is 1.
const DIAMETERS: [f64; 2] = [0.9, 1.1];

/// A silo in units of d.
#[derive(Clone, Copy)]
struct Silo {
    width: f64,
    count: usize,
    /// Time over which the flow is measured, sqrt(d/g).
    duration: f64,
}

/// Grains per sqrt(d/g) that leave through an opening. What leaves is put back on the lowest place of the surface.
fn flow(silo: Silo, opening: f64, seed: u64) -> Result<f64> {
    let material = Material { friction: FRICTION, ..Material::default() };
    let materials = [material];
    let half = 0.5 * silo.width;
    let region = Region { low: v(-half, 0.0), high: v(half, 3.0 * silo.width) };
    let [min, max] = DIAMETERS.map(|d| 0.5 * d);
    let radii = Radii::Uniform { min, max };
    let fill = Fill { radii, amount: Amount::Count(silo.count), material: 0, materials: &materials, seed };
    let bed = deposit(&region, &fill, &Deposit::default())?;
    let wall = |name: &str, from, to| Wall { friction: FRICTION, ..Wall::new(name, from, to) };
    let (top, edge) = (10.0 * silo.width, 0.5 * opening);
    let walls = vec![
        wall("left", v(-half, 0.0), v(-half, top)),
        wall("right", v(half, 0.0), v(half, top)),
        wall("left floor", v(-half, 0.0), v(-edge, 0.0)),
        wall("right floor", v(edge, 0.0), v(half, 0.0)),
    ];
    let settings = Settings { tolerance: 1e-3, max_sweeps: 200, ..Settings::default() };
    let mut dem = Dem::new(bed.particles.rotating(), walls, materials.to_vec(), settings)?;
    let unit = (1.0 / G).sqrt();
    let mut rng = generator(seed);
    let (mut left, mut start) = (0, None);
    // The flow is steady when the grains first above the opening are out.
    let transient = 10.0;
    while dem.time() < (transient + silo.duration) * unit {
        dem.step(0.05 * unit, &Load::default());
        let out = refill(&mut dem, silo.width, &mut rng);
        if dem.time() > transient * unit {
            start.get_or_insert(dem.time());
            left += out;
        }
    }
    Ok(left as f64 * unit / (dem.time() - start.unwrap_or(0.0)))
}

/// Puts grains that fell two diameters below the floor back on the surface; how many.
fn refill(dem: &mut Dem<2>, width: f64, rng: &mut rand_pcg::Pcg64) -> usize {
    let p = &mut dem.particles;
    let columns = (width / 1.3) as usize;
    let place = |column: usize| (column as f64 + 0.5) * width / columns as f64 - 0.5 * width;
    let out: Vec<usize> = (0..p.len()).filter(|i| p.position[*i].y < -2.0).collect();
    if out.is_empty() {
        return 0;
    }
    // Where a grain may lie above all others, in each column.
    let mut surface = vec![0.0_f64; columns];
    let cover = |surface: &mut Vec<f64>, x: Vec2, r: f64| {
        for (column, height) in surface.iter_mut().enumerate() {
            if (place(column) - x.x).abs() < r + 0.5 * DIAMETERS[1] {
                *height = height.max(x.y + r + 0.5 * DIAMETERS[1]);
            }
        }
    };
    for i in (0..p.len()).filter(|i| p.position[*i].y >= -2.0) {
        cover(&mut surface, p.position[i], p.radius[i]);
    }
    for &i in &out {
        let lowest = surface.iter().copied().fold(f64::MAX, f64::min);
        let low: Vec<usize> = (0..columns).filter(|column| surface[*column] < lowest + 1.0).collect();
        let column = low[rng.random_range(0..low.len())];
        p.position[i] = v(place(column), surface[column] + 0.01);
        p.velocity[i] = Vec2::zeros();
        if let Some(rotation) = &mut p.rotation {
            rotation.spin[i] = 0.0;
        }
        cover(&mut surface, p.position[i], p.radius[i]);
    }
    out.len()
}

/// The exponent n with which Q^(1/n) is nearest to a straight line of W, and k of that line.
fn fit(points: &[(f64, f64)]) -> (f64, f64) {
    let misfit = |n: f64| {
        let (at_zero, slope) = line(&points.iter().map(|(w, q)| (*w, q.powf(1.0 / n))).collect::<Vec<_>>());
        let wrong: f64 =
            points.iter().map(|(w, q)| ((at_zero + slope * w).max(0.0).powf(n) / q - 1.0).powi(2)).sum();
        (wrong, -at_zero / slope)
    };
    let candidates = (0..=2000).map(|k| 0.8 + 1.4 * k as f64 / 2000.0);
    let best = candidates.min_by(|a, b| misfit(*a).0.total_cmp(&misfit(*b).0)).unwrap_or(f64::NAN);
    (best, misfit(best).1)
}

fn run(effort: Effort) -> Result<Outcome> {
    let silo = effort.pick(
        Silo { width: 30.0, count: 800, duration: 25.0 },
        Silo { width: 50.0, count: 2500, duration: 50.0 },
    );
    let seeds = effort.pick(1, 5);
    let openings: &[f64] = effort.pick(&[5.0, 8.0, 12.0], &[5.0, 7.0, 10.0, 14.0, 18.0]);
    let runs: Vec<(f64, u64)> =
        openings.iter().flat_map(|w| (0..seeds).map(move |seed| (*w, seed))).collect();
    let flows = runs.par_iter().map(|(w, seed)| flow(silo, *w, *seed)).collect::<Result<Vec<_>>>()?;
    let points: Vec<(f64, f64)> = runs.iter().zip(&flows).map(|(run, q)| (run.0, *q)).collect();
    let of_seed = |seed: u64| -> Vec<(f64, f64)> {
        runs.iter().zip(&points).filter(|(run, _)| run.1 == seed).map(|(_, point)| *point).collect()
    };
    let exponents: Vec<f64> = (0..seeds).map(|seed| fit(&of_seed(seed)).0).collect();
    let (power, scatter) = mean(&exponents);
    let (at_zero, slope) = line(&points.iter().map(|(w, q)| (*w, q.powf(2.0 / 3.0))).collect::<Vec<_>>());
    let shift = -at_zero / slope;
    let law = |w: f64| (slope * (w - shift)).powf(1.5);
    let misfit = points.iter().fold(0.0, |worst: f64, (w, q)| worst.max((q / law(*w) - 1.0).abs()));
    let panel = Panel {
        curves: vec![
            Curve::line(
                format!("(W - {shift:.1} d)^1.5"),
                curve([4.0, openings[openings.len() - 1] + 1.0], law),
            ),
            Curve::points("one silo each", points),
        ],
        ..Panel::log_log("Flow out of a silo", "opening W / d", "discs per \u{221a}(d/g)")
    };
    Ok(Outcome {
        findings: vec![
            Finding::absolute(format!("exponent with k free, scatter {scatter:.3}"), "1", 1.5, power, 0.15),
            Finding::at_most("largest deviation from the law with 1.5", "1", 0.1, misfit),
        ],
        panels: vec![panel],
    })
}
