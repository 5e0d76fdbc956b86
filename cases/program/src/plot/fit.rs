//! The exponential that a cooling bed follows.

use serde::Serialize;
use std::path::Path;
use voidage_coupling::{Error, Result};
use voidage_scene::recorder::write_whole;

/// `limit + amplitude exp(-t / time_constant)`.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Exponential {
    /// Temperature after a long time, K: that of the surroundings, or fitted too.
    #[serde(rename = "limit_K")]
    pub limit: f64,
    /// K.
    #[serde(rename = "amplitude_K")]
    pub amplitude: f64,
    /// s.
    #[serde(rename = "time_constant_s")]
    pub time_constant: f64,
    /// Root of the mean square of the differences, K.
    #[serde(rename = "rms_difference_K")]
    pub rms: f64,
    /// Whether the limit was fitted.
    pub limit_fitted: bool,
}

impl Exponential {
    /// The value at a time, s.
    pub fn at(&self, time: f64) -> f64 {
        self.limit + self.amplitude * (-time / self.time_constant).exp()
    }

    /// Writes the fit as JSON.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| Error::run(format!("{}: {error}", path.display())))?;
        write_whole(path, |file| writeln!(file, "{text}"))
    }
}

/// Least squares over all rows. For a given time constant the rest is linear, so one search over its logarithm is
/// enough. None with too few rows, or where the values do not change.
pub fn exponential(time: &[f64], value: &[f64], limit: Option<f64>) -> Option<Exponential> {
    let end = time.last().copied().filter(|end| *end > 0.0 && time.len() >= 4)?;
    let cost = |log: f64| linear(time, value, limit, log.exp()).map_or(f64::INFINITY, |fit| fit.rms);
    // Sections of the golden ratio after a coarse scan, which finds the right valley.
    let [low, high] = [(end * 1e-3).ln(), (end * 1e3).ln()];
    let points = 120;
    let log = |k: usize| low + (high - low) * k as f64 / points as f64;
    let best = (0..=points).min_by(|a, b| cost(log(*a)).total_cmp(&cost(log(*b))))?;
    let (mut a, mut b) = (log(best.saturating_sub(1)), log((best + 1).min(points)));
    let ratio = (5f64.sqrt() - 1.0) / 2.0;
    for _ in 0..80 {
        let (c, d) = (b - ratio * (b - a), a + ratio * (b - a));
        if cost(c) < cost(d) { b = d } else { a = c }
    }
    linear(time, value, limit, (0.5 * (a + b)).exp()).filter(|fit| fit.amplitude.abs() > 1e-9)
}

/// The best amplitude (and limit) for a time constant.
fn linear(time: &[f64], value: &[f64], limit: Option<f64>, time_constant: f64) -> Option<Exponential> {
    let count = time.len() as f64;
    let basis = |t: f64| (-t / time_constant).exp();
    let (mut e, mut ee, mut y, mut ey) = (0.0, 0.0, 0.0, 0.0);
    for (t, v) in time.iter().zip(value) {
        let b = basis(*t);
        (e, ee, y, ey) = (e + b, ee + b * b, y + v, ey + b * v);
    }
    let (limit_value, amplitude) = match limit {
        Some(limit) => (limit, (ey - limit * e) / ee),
        None => {
            let determinant = count * ee - e * e;
            let amplitude = (count * ey - e * y) / determinant;
            ((y - amplitude * e) / count, amplitude)
        }
    };
    let fit =
        Exponential { limit: limit_value, amplitude, time_constant, rms: 0.0, limit_fitted: limit.is_none() };
    let square: f64 = time.iter().zip(value).map(|(t, v)| (fit.at(*t) - v).powi(2)).sum();
    let rms = (square / count).sqrt();
    rms.is_finite().then_some(Exponential { rms, ..fit })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exponential_is_found_again() {
        let time: Vec<f64> = (0..200).map(|k| k as f64 * 0.05).collect();
        let value: Vec<f64> = time.iter().map(|t| 290.0 + 73.0 * (-t / 16.0).exp()).collect();
        for limit in [Some(290.0), None] {
            let fit = exponential(&time, &value, limit).unwrap();
            assert!((fit.time_constant - 16.0).abs() < 1e-3, "{fit:?}");
            assert!((fit.amplitude - 73.0).abs() < 1e-2 && (fit.limit - 290.0).abs() < 1e-2, "{fit:?}");
        }
        assert!(exponential(&time[..2], &value[..2], None).is_none());
        assert!(exponential(&time, &vec![290.0; 200], Some(290.0)).is_none());
    }
}
