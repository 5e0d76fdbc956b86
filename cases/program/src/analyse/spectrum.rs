//! The power spectral density of a series, and whether it has a dominant frequency.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use std::f64::consts::PI;

/// Segments that halve each other, where as many as the rows allow are not asked for otherwise.
pub const SEGMENTS: usize = 8;
/// Fewest rows of a segment.
pub const FEWEST: usize = 32;
/// Chance that a series with the same variance and memory but without a preferred frequency has a peak as high.
const CHANCE: f64 = 0.01;

/// A spectrum of a series at even times.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// Frequencies, 1/s, from 0 in even steps.
    pub frequency: Vec<f64>,
    /// One-sided power spectral density, square of the unit of the series times s; its integral is the variance.
    pub density: Vec<f64>,
    /// That of a series of the same variance whose memory fades exponentially, as fast as that of this one from row to
    /// row: red noise.
    pub noise: Vec<f64>,
    /// Segments that it is the mean of.
    pub segments: usize,
    /// Step of the frequencies, 1/s: one over the length of a segment.
    pub resolution: f64,
    /// Variance of the rows.
    pub variance: f64,
    /// Integral of the density over the frequencies.
    pub integral: f64,
    /// Where the density is greatest but for the two lowest steps, 1/s.
    pub highest: f64,
    /// Density there over that of red noise.
    pub above_noise: f64,
    /// What this may be by chance.
    pub by_chance: f64,
}

impl Spectrum {
    /// The mean of the periodograms of segments that overlap by half, each under a Hann window: P. D. Welch, IEEE
    /// Trans. Audio Electroacoust. 15, 70 (1967). `step` is the time between rows, s. None where a segment would have
    /// fewer than [`FEWEST`] rows, or where all rows are equal.
    pub fn new(values: &[f64], step: f64, segments: usize) -> Option<Spectrum> {
        let length = 2 * values.len() / segments.saturating_add(1);
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64;
        if length < FEWEST || variance <= 0.0 || !variance.is_finite() {
            return None;
        }
        let window: Vec<f64> = (0..length).map(|k| (PI * k as f64 / length as f64).sin().powi(2)).collect();
        let weight: f64 = window.iter().map(|w| w * w).sum();
        let fourier = FftPlanner::new().plan_fft_forward(length);
        let bins = length / 2 + 1;
        let mut density = vec![0.0; bins];
        for segment in 0..segments {
            // From the first row to the last, whatever the length is.
            let start = segment * (values.len() - length) / (segments - 1).max(1);
            let rows = values[start..start + length].iter().zip(&window);
            let mut buffer: Vec<Complex<f64>> =
                rows.map(|(value, window)| Complex::new((value - mean) * window, 0.0)).collect();
            fourier.process(&mut buffer);
            for (bin, density) in density.iter_mut().enumerate() {
                // Negative frequencies count with the positive ones.
                let sides = if bin == 0 || 2 * bin == length { 1.0 } else { 2.0 };
                *density += sides * buffer[bin].norm_sqr() * step / (weight * segments as f64);
            }
        }
        let resolution = 1.0 / (length as f64 * step);
        let frequency: Vec<f64> = (0..bins).map(|bin| bin as f64 * resolution).collect();
        let integral = density.iter().sum::<f64>() * resolution;
        let noise = red_noise(values, mean, variance, &frequency, step);
        // The window spreads the mean and what is slower than a segment over the two lowest steps.
        let peak = (2..bins).max_by(|a, b| density[*a].total_cmp(&density[*b]))?;
        Some(Spectrum {
            highest: frequency[peak],
            above_noise: density[peak] / noise[peak],
            by_chance: by_chance(segments, bins - 2),
            frequency,
            density,
            noise,
            segments,
            resolution,
            variance,
            integral,
        })
    }

    /// The dominant frequency, 1/s, known to [`Spectrum::resolution`]; none where chance makes peaks as high.
    pub fn dominant(&self) -> Option<f64> {
        (self.above_noise > self.by_chance).then_some(self.highest)
    }
}

/// The spectrum of an autoregressive process with the variance and the correlation of neighbours of a series.
fn red_noise(values: &[f64], mean: f64, variance: f64, frequency: &[f64], step: f64) -> Vec<f64> {
    let products = values.windows(2).map(|pair| (pair[0] - mean) * (pair[1] - mean)).sum::<f64>();
    let factor = (products / (variance * values.len() as f64)).clamp(-0.9999, 0.9999);
    let at = |frequency: &f64| {
        let turn = (2.0 * PI * frequency * step).cos();
        2.0 * variance * step * (1.0 - factor * factor) / (1.0 + factor * factor - 2.0 * factor * turn)
    };
    frequency.iter().map(at).collect()
}

/// How far the greatest of so many densities lies above the true ones with the chance [`CHANCE`], where each is the
/// mean of segments that overlap by half.
fn by_chance(segments: usize, bins: usize) -> f64 {
    // Degrees of freedom of such a mean under a Hann window: D. B. Percival and A. T. Walden, Spectral Analysis for
    // Physical Applications (1993).
    let count = segments as f64;
    let freedom = 36.0 * count * count / (19.0 * count - 1.0);
    // Neighbours under the window are not independent: half of the bins are.
    let tail = CHANCE / (0.5 * bins as f64).max(1.0);
    // The normal deviate of this tail, Abramowitz and Stegun 26.2.23, and the chi-square of Wilson and Hilferty.
    let t = (-2.0 * tail.ln()).sqrt();
    let above = 2.515517 + t * (0.802853 + t * 0.010328);
    let below = 1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308));
    let deviate = t - above / below;
    let part = 2.0 / (9.0 * freedom);
    (1.0 - part + deviate * part.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    const STEP: f64 = 0.01;

    fn noise(factor: f64, rows: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut value = 0.0;
        (0..rows)
            .map(|_| {
                let kick = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
                value = factor * value + kick;
                value
            })
            .collect()
    }

    #[test]
    fn the_integral_is_the_variance_and_the_peak_is_the_sine() {
        let (frequency, amplitude) = (7.3, 1.5);
        let sine = |(row, noise): (usize, f64)| {
            300.0 + noise + amplitude * (2.0 * PI * frequency * STEP * row as f64).sin()
        };
        let values: Vec<f64> = noise(0.0, 4000, 1).into_iter().enumerate().map(sine).collect();
        for segments in [1, 8, 31] {
            let found = Spectrum::new(&values, STEP, segments).unwrap();
            let known = 1.0 + 0.5 * amplitude * amplitude;
            assert!((found.integral / known - 1.0).abs() < 0.08, "{segments}: {} {known}", found.integral);
            assert!((found.integral / found.variance - 1.0).abs() < 0.05, "{segments}");
            let dominant = found.dominant().unwrap();
            assert!((dominant - frequency).abs() <= 0.5 * found.resolution, "{segments}: {dominant}");
            // White noise of unit variance fills the frequencies up to 50 1/s evenly.
            let high: Vec<f64> = found.density.iter().rev().take(found.density.len() / 2).copied().collect();
            let mean = high.iter().sum::<f64>() / high.len() as f64;
            assert!((mean / (2.0 * STEP) - 1.0).abs() < 0.1, "{segments}: {mean}");
        }
    }

    #[test]
    fn noise_has_no_dominant_frequency() {
        for factor in [0.0, 0.6, 0.95] {
            let peaks = (0..300)
                .filter_map(|seed| Spectrum::new(&noise(factor, 2000, seed), STEP, SEGMENTS))
                .filter(|found| found.dominant().is_some())
                .count();
            println!("{factor}: {peaks}");
            assert!(peaks <= 12, "{factor}: {peaks} of 300");
        }
    }

    #[test]
    fn what_is_too_short_or_constant_has_no_spectrum() {
        assert!(Spectrum::new(&noise(0.0, 100, 1), STEP, SEGMENTS).is_none());
        assert!(Spectrum::new(&[5.0; 1000], STEP, SEGMENTS).is_none());
    }
}
