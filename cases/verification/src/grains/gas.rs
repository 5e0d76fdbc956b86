//! A gas of inelastic discs cools by Haff's law.

use super::scene::{generator, line, mean, normal, step, v};
use crate::models::Vec2;
use crate::{Case, Finding, Outcome};
use rayon::prelude::*;
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::packing::{Amount, Fill, Radii, Region, random, unobserved};
use voidage_dem::{Dem, Load, Material, Settings, Wall};

/// The case.
pub const CASE: Case = Case {
    name: "granular-gas",
    group: "grains",
    title: "a gas of inelastic discs between elastic walls cools as (1 + t/tau)^-2",
    source: "Haff 1983; rate (1 - e^2)/4 of the collision frequency 2 sqrt(pi) n d chi sqrt(T/m), chi by Henderson \
             1975, Sonine \
             correction by van Noije and Ernst 1998",
    run,
};

const RESTITUTION: f64 = 0.95;
const COUNT: usize = 400;
/// Area fraction of the box.
const FRACTION: f64 = 0.1;
/// Diameter, m.
const DIAMETER: f64 = 1.0;

/// Largest step, as the share of its diameter that a grain of thermal velocity crosses. Larger ones are cut into
/// sub-steps, since a few grains are fast.
const LARGEST: f64 = 0.04;

/// Side of the box, m.
fn side() -> f64 {
    (COUNT as f64 * PI * DIAMETER * DIAMETER / (4.0 * FRACTION)).sqrt()
}

/// d(T^(-1/2))/dt by theory, for T in m2/s2.
///
/// In a box the centres have the room (L - d)^2. To first order in d/L and in the density, two things differ at a
/// wall: discs gather there (the excluded area of a disc at the distance z < d that lies beyond the wall is
/// free of others: integrated over z, an excess of 2/3 n^2 d^3 per length of wall), and have no partners beyond it (of
/// the directions in which a disc at z can be met the share acos(z/d)/pi is missing: d/pi of collisions per length of
/// wall).
fn cooling() -> f64 {
    let room = side() - DIAMETER;
    let mut density = COUNT as f64 / (room * room);
    for _ in 0..50 {
        density = COUNT as f64 / (room * room + 4.0 * room * 2.0 / 3.0 * density * DIAMETER.powi(3));
    }
    let fraction = density * PI * DIAMETER * DIAMETER / 4.0;
    let chi = (1.0 - 7.0 / 16.0 * fraction) / (1.0 - fraction).powi(2);
    let (e, e2) = (RESTITUTION, RESTITUTION * RESTITUTION);
    let sonine = 16.0 * (1.0 - e) * (1.0 - 2.0 * e2) / (57.0 - 25.0 * e + 30.0 * e2 * (1.0 - e));
    let walls = density / COUNT as f64 * (room * room - 4.0 * room * DIAMETER / PI);
    (1.0 - e2) / 4.0 * 2.0 * PI.sqrt() * density * DIAMETER * chi * walls * (1.0 + 3.0 / 16.0 * sonine)
}

/// Time and temperature (mean of v^2/2) until it has fallen to `last` of the first, in steps in which a grain of
/// thermal velocity crosses the share `travel` of its diameter: as it cools, steps grow, and the error of the steps
/// stays.
fn cool(seed: u64, travel: f64, last: f64) -> Result<Vec<(f64, f64)>> {
    let material = Material { restitution: RESTITUTION, ..Material::default() };
    let materials = [material];
    let region = Region { low: Vec2::zeros(), high: Vec2::repeat(side()) };
    let radii = Radii::Constant(0.5 * DIAMETER);
    let fill = Fill { radii, amount: Amount::Count(COUNT), material: 0, materials: &materials, seed };
    let mut grains = random(&region, &fill, &mut unobserved)?;
    let mut rng = generator(seed);
    grains.velocity.iter_mut().for_each(|velocity| *velocity = normal(&mut rng));
    let corners = [v(0.0, 0.0), v(side(), 0.0), v(side(), side()), v(0.0, side())];
    let walls = (0..4)
        .map(|k| Wall {
            restitution: 1.0,
            ..Wall::new(format!("wall {k}"), corners[k], corners[(k + 1) % 4])
        })
        .collect();
    let settings = Settings { gravity: Vec2::zeros(), tolerance: 1e-14, ..Settings::default() };
    let mut dem = Dem::new(grains, walls, materials.to_vec(), settings)?;
    let temperature = |dem: &Dem<2>| {
        dem.particles.velocity.iter().map(|v| v.norm_squared()).sum::<f64>() / (2 * COUNT) as f64
    };
    let first = temperature(&dem);
    let mut path = vec![(0.0, first)];
    loop {
        let now = temperature(&dem);
        if now < last * first {
            return Ok(path);
        }
        step(&mut dem, travel * DIAMETER / now.sqrt(), &Load::default())?;
        path.push((dem.time(), temperature(&dem)));
    }
}

/// Measured over theoretical rate.
///
/// A Moreau-Jean step reverses two discs that would meet within it at its start, up to h |u_n| before they touch. So
/// they go less far between their impacts: the gas cools too fast by an amount of first order in the step.
fn ratio(path: &[(f64, f64)]) -> f64 {
    line(&path.iter().map(|(t, temperature)| (*t, temperature.powf(-0.5))).collect::<Vec<_>>()).1 / cooling()
}

fn run(effort: Effort) -> Result<Outcome> {
    let (levels, seeds) = effort.pick((2, 3), (4, 5));
    let last = effort.pick(0.2, 0.05);
    let runs: Vec<(f64, u64)> =
        (0..levels).flat_map(|k| (0..seeds).map(move |seed| (LARGEST / 2f64.powi(k), seed))).collect();
    let paths =
        runs.par_iter().map(|(travel, seed)| cool(*seed, *travel, last)).collect::<Result<Vec<_>>>()?;
    let ratios: Vec<(f64, f64)> =
        runs.iter().zip(&paths).map(|((travel, _), path)| (*travel, ratio(path))).collect();
    let (limit, slope) = line(&ratios);
    let finest: Vec<f64> = ratios[ratios.len() - seeds as usize..].iter().map(|r| r.1).collect();
    let (_, scatter) = mean(&finest);
    let path = &paths[paths.len() - 1];
    let (rate, first) = (cooling(), path[0].1);
    let law = |t: f64| (1.0 + rate * first.sqrt() * t).powi(-2);
    let scaled = |(t, temperature): &(f64, f64)| (1.0 + rate * first.sqrt() * t, temperature / first);
    let stride = path.len().div_ceil(30);
    let decay = Panel {
        curves: vec![
            Curve::line(
                "Haff's law",
                path.iter().map(|(t, _)| (1.0 + rate * first.sqrt() * t, law(*t))).collect(),
            ),
            Curve::points("measured", path.iter().step_by(stride).map(scaled).collect()),
        ],
        ..Panel::log_log("Cooling of a granular gas", "1 + t/\u{3c4}", "T / T\u{2080}")
    };
    let steps = Panel {
        curves: vec![
            Curve::line("theory", vec![(0.0, 1.0), (LARGEST, 1.0)]),
            Curve::dashes("fit", vec![(0.0, limit), (LARGEST, limit + LARGEST * slope)]),
            Curve::points("one gas each", ratios),
        ],
        ..Panel::new("Rate of cooling and step", "thermal velocity times step / diameter", "rate / theory")
    };
    Ok(Outcome {
        findings: vec![Finding::absolute(
            format!("rate of cooling / theory, steps to 0, scatter {scatter:.3}"),
            "1",
            1.0,
            limit,
            effort.pick(0.05, 0.02),
        )],
        panels: vec![decay, steps],
    })
}
