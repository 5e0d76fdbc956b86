//! Columns of discs collapse and spread.

use super::scene::{G, curve, exponent, floor, mean, v};
use crate::{Case, Finding, Outcome};
use rayon::prelude::*;
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::packing::{Amount, Deposit, Fill, Radii, Region, deposit, unobserved};
use voidage_dem::{Dem, Load, Material, Particles, Settings};

/// The case.
pub const CASE: Case = Case {
    name: "column-collapse",
    group: "grains",
    title: "columns of discs of aspect ratio a run out by 2.5 a of their half width when low, by 3.25 a^0.7 when tall",
    source: "Staron and Hinch 2005 (J. Fluid Mech. 545, 1), contact dynamics of discs: 2.5 a, 3.25 a^0.7; experiments \
             between \
             plates, Lube et al. 2005 (Phys. Rev. E 72, 041301): 1.2 a, 1.9 a^(2/3)",
    run,
};

const FRICTION: f64 = 1.0;
const RESTITUTION: f64 = 0.5;
/// Diameters, uniform.
const DIAMETERS: [f64; 2] = [0.8, 1.2];

/// A column at rest between walls, about x = 0, its half width and its aspect ratio height/half width; the height is
/// twice that of the centre of mass.
fn column(count: usize, aspect: f64, seed: u64) -> Result<(Particles<2>, f64, f64)> {
    let materials = [material()];
    let [min, max] = DIAMETERS.map(|d| 0.5 * d);
    let solid = count as f64 * PI * (min * min + min * max + max * max) / 3.0;
    let half = (solid / (0.82 * 2.0 * aspect)).sqrt();
    let region = Region { low: v(-half, 0.0), high: v(half, 2.0 * aspect * half) };
    let radii = Radii::Uniform { min, max };
    let fill = Fill { radii, amount: Amount::Count(count), material: 0, materials: &materials, seed };
    let settled =
        deposit(&region, &fill, &Deposit { friction: Some(0.3), ..Deposit::default() }, &mut unobserved)?;
    let mass: f64 = settled.particles.mass.iter().sum();
    let p = &settled.particles;
    let centre = (0..p.len()).map(|i| p.mass[i] * p.position[i].y).sum::<f64>() / mass;
    Ok((settled.particles, half, 2.0 * centre / half))
}

fn material() -> Material {
    Material { friction: FRICTION, restitution: RESTITUTION, ..Material::default() }
}

/// What is left of a column.
struct Heap {
    /// (R - R0)/R0, the mean of both sides.
    runout: f64,
    aspect: f64,
}

fn collapse(count: usize, aspect: f64, seed: u64) -> Result<Heap> {
    let (grains, half, aspect) = column(count, aspect, seed)?;
    let settings = Settings { max_sweeps: 300, ..Settings::default() };
    let mut dem = Dem::new(grains.rotating(), vec![floor(FRICTION)], vec![material()], settings)?;
    let unit = (1.0 / G).sqrt();
    let fall = (2.0 * aspect * half / G).sqrt();
    let end = 3.0 * fall + 3.0 * (aspect.min(2.0) * half).sqrt() * unit;
    while dem.time() < end {
        dem.step(0.05 * unit, &Load::default());
    }
    let [left, right] = fronts(&dem);
    Ok(Heap { runout: 0.5 * (right - left) / half - 1.0, aspect })
}

/// Ends of the heap: going outwards from the middle, the first place where the ground is bare for a diameter. Single
/// discs that roll on, as discs on a flat floor do, lie beyond.
fn fronts(dem: &Dem<2>) -> [f64; 2] {
    let p = &dem.particles;
    [-1.0, 1.0].map(|side: f64| {
        let mut ends: Vec<[f64; 2]> = (0..p.len())
            .map(|i| [side * p.position[i].x - p.radius[i], side * p.position[i].x + p.radius[i]])
            .filter(|[_, far]| *far > 0.0)
            .collect();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut front = 0.0_f64;
        for [near, far] in ends {
            if near > front + 1.0 {
                break;
            }
            front = front.max(far);
        }
        side * front
    })
}

/// A value of the simulations of Staron and Hinch; what passes lies between the experiments and these.
fn between(quantity: &str, expected: f64, measured: f64, allowed: [f64; 2]) -> Finding {
    Finding { allowed, ..Finding::absolute(quantity, "1", expected, measured, 0.0) }
}

fn run(effort: Effort) -> Result<Outcome> {
    let (count, seeds) = effort.pick((400, 4), (1500, 5));
    let low: &[f64] = effort.pick(&[1.0], &[0.7, 1.4]);
    let tall: &[f64] = effort.pick(&[3.0, 9.0], &[3.0, 6.0, 12.0]);
    let runs: Vec<(f64, u64)> =
        low.iter().chain(tall).flat_map(|a| (0..seeds).map(move |seed| (*a, seed))).collect();
    let heaps = runs.par_iter().map(|(a, seed)| collapse(count, *a, *seed)).collect::<Result<Vec<_>>>()?;
    let points: Vec<(f64, f64)> = heaps.iter().map(|heap| (heap.aspect, heap.runout)).collect();
    let of_seed = |seed: u64, aspects: &[f64]| -> Vec<(f64, f64)> {
        let chosen = runs.iter().zip(&points).filter(|(run, _)| run.1 == seed && aspects.contains(&run.0));
        chosen.map(|(_, point)| *point).collect()
    };
    let exponents: Vec<f64> = (0..seeds).map(|seed| exponent(&of_seed(seed, tall))).collect();
    let slopes: Vec<f64> =
        (0..seeds).flat_map(|seed| of_seed(seed, low)).map(|(a, runout)| runout / a).collect();
    let factors: Vec<f64> =
        (0..seeds).flat_map(|seed| of_seed(seed, tall)).map(|(a, runout)| runout / a.powf(0.7)).collect();
    let ((power, scatter), (slope, _), (factor, _)) = (mean(&exponents), mean(&slopes), mean(&factors));
    let law = |a: f64| if a < 2.0 { 2.5 * a } else { 3.25 * a.powf(0.7) };
    let experiment = |a: f64| if a < 2.3 { 1.2 * a } else { 1.9 * a.powf(2.0 / 3.0) };
    let panel = Panel {
        curves: vec![
            Curve::line("Staron and Hinch", curve([0.4, 16.0], law)),
            Curve::dashes("Lube et al., experiments", curve([0.4, 16.0], experiment)),
            Curve::points(format!("columns of {count} discs"), points),
        ],
        ..Panel::log_log("Run-out of a collapsing column", "height / half width", "run-out / half width")
    };
    Ok(Outcome {
        findings: vec![
            Finding::absolute(
                format!("exponent of tall columns, scatter {scatter:.3}"),
                "1",
                0.7,
                power,
                0.1,
            ),
            between("run-out / (half width a^0.7) of tall columns", 3.25, factor, [1.9, 3.25]),
            between("run-out / (half width a) of low columns", 2.5, slope, [1.2, 2.5]),
        ],
        panels: vec![panel],
    })
}
