//! What the cases of this group share: small scenes, steps that must converge, straight lines through points.

use crate::models::Vec2;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use voidage_coupling::{Error, Result};
use voidage_dem::{Dem, Load, Material, Settings, StepReport, Wall};

/// Acceleration of gravity, m/s2.
pub const G: f64 = 9.81;

/// A vector of the plane.
pub fn v(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y)
}

/// The default material with friction between grains.
pub fn rubbing(friction: f64) -> Material {
    Material { friction, ..Material::default() }
}

/// A long floor along the first axis.
pub fn floor(friction: f64) -> Wall<2> {
    Wall { friction, ..Wall::new("floor", v(-1e3, 0.0), v(1e3, 0.0)) }
}

/// Contacts solved as well as round-off lets them.
pub fn precise() -> Settings<2> {
    Settings { tolerance: 1e-24, max_sweeps: 100_000, ..Settings::default() }
}

/// One step; an error if its contacts are not solved.
pub fn step(dem: &mut Dem<2>, dt: f64, load: &Load<'_, 2>) -> Result<StepReport> {
    let report = dem.step(dt, load);
    if report.converged {
        return Ok(report);
    }
    Err(Error::run(format!("the contacts at t = {} s are not solved: {report:?}", dem.time())))
}

/// Steps without a load.
pub fn steps(dem: &mut Dem<2>, dt: f64, count: usize) -> Result<()> {
    (0..count).try_for_each(|_| step(dem, dt, &Load::default()).map(drop))
}

/// A named generator of random numbers.
pub fn generator(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// A vector whose components are normally distributed with variance 1 (Box and Muller).
pub fn normal(rng: &mut Pcg64) -> Vec2 {
    let size = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
    v(size * cos, size * sin)
}

/// Mean and standard deviation.
pub fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, variance.sqrt())
}

/// Intercept and slope of the straight line through points, by least squares.
pub fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let (x, _) = mean(&points.iter().map(|p| p.0).collect::<Vec<_>>());
    let (y, _) = mean(&points.iter().map(|p| p.1).collect::<Vec<_>>());
    let (top, bottom) = points
        .iter()
        .fold((0.0, 0.0), |(top, bottom), p| (top + (p.0 - x) * (p.1 - y), bottom + (p.0 - x).powi(2)));
    (y - top / bottom * x, top / bottom)
}

/// Exponent of the power law through points, by least squares of the logarithms.
pub fn exponent(points: &[(f64, f64)]) -> f64 {
    line(&points.iter().map(|p| (p.0.ln(), p.1.ln())).collect::<Vec<_>>()).1
}

/// The zero of a criterion between `low`, where it does not hold, and `high`, where it does, to within `width`.
///
/// # Errors
/// It fails, or does not change between the two.
pub fn threshold(
    [mut low, mut high]: [f64; 2],
    width: f64,
    holds: impl Fn(f64) -> Result<bool>,
) -> Result<f64> {
    if holds(low)? || !holds(high)? {
        return Err(Error::run(format!("there is no threshold between {low} and {high}")));
    }
    while high - low > width {
        let middle = 0.5 * (low + high);
        if holds(middle)? { high = middle } else { low = middle }
    }
    Ok(0.5 * (low + high))
}

/// A function at 201 places of a range: the exact curve of a plot.
pub fn curve([from, to]: [f64; 2], f: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    (0..=200).map(|k| from + (to - from) * k as f64 / 200.0).map(|x| (x, f(x))).collect()
}
