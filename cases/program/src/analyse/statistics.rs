//! The mean of a correlated series and its standard error, and when neither can be known.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

/// Fewest rows of which anything but the mean is said.
const FEWEST: usize = 30;
/// Fewest lengths of the memory of a series in a window that give an error.
const LENGTHS: f64 = 30.0;
/// The window of the sum of the autocorrelation over its value: three statistical inefficiencies are six integrated
/// autocorrelation times, the rule of A. Sokal, Functional Integration (1997), p. 131.
const SOKAL: f64 = 3.0;
/// Length of a batch over that of the memory.
const BATCH: f64 = 6.0;
/// Most batches.
const BATCHES: usize = 32;
/// Fewest batches that give the error of a series that oscillates.
const FEWEST_BATCHES: usize = 8;
/// Difference of the halves of a window, in its standard errors, from which on a series drifts.
const DRIFT: f64 = 3.5;
/// Autocorrelation below which a series oscillates.
const OSCILLATES: f64 = -0.1;

/// What can be said of a mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Mean and standard error.
    Good,
    /// All rows are equal.
    Constant,
    /// The two halves of the window differ: there is no mean to be known.
    NotStationary,
    /// The window holds too few lengths of the memory of the series: the error of the mean cannot be known.
    TooShort,
    /// The error from batches is greater than that from the autocorrelation: the error cannot be known.
    Uncertain,
    /// Some rows are no number.
    Gaps,
    /// No row is a number.
    NoNumber,
    /// There are too few rows.
    TooFewRows,
}

impl Verdict {
    /// As tables say it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Constant => "constant",
            Self::NotStationary => "not stationary",
            Self::TooShort => "window too short",
            Self::Uncertain => "error uncertain",
            Self::Gaps => "gaps",
            Self::NoNumber => "no number",
            Self::TooFewRows => "too few rows",
        }
    }
}

/// The mean of a series and what is known of its error. What is not known is `NaN`.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Rows that are a number.
    pub rows: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the rows.
    pub deviation: f64,
    /// Standard error of the mean.
    pub error: f64,
    /// The same from the scatter of the means of batches.
    pub batch_error: f64,
    /// Number of batches.
    pub batches: usize,
    /// Statistical inefficiency, rows: one plus twice the sum of the autocorrelation.
    pub correlation: f64,
    /// Rows over the inefficiency: as many independent values have the same error of the mean.
    pub independent: f64,
    /// Mean of the second half less that of the first, in standard errors of this difference.
    pub drift: f64,
    /// Whether the error can be trusted.
    pub verdict: Verdict,
}

/// The mean of rows at even times.
pub fn estimate(values: &[f64]) -> Estimate {
    let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let (mean, deviation) = moments(&finite);
    let nothing = Estimate {
        rows: finite.len(),
        mean,
        deviation,
        error: f64::NAN,
        batch_error: f64::NAN,
        batches: 0,
        correlation: f64::NAN,
        independent: f64::NAN,
        drift: f64::NAN,
        verdict: Verdict::NoNumber,
    };
    let largest = finite.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    if finite.is_empty() && !values.is_empty() {
        return nothing;
    }
    if finite.len() < values.len() {
        return Estimate { verdict: Verdict::Gaps, ..nothing };
    }
    if values.len() < FEWEST {
        return Estimate { verdict: Verdict::TooFewRows, ..nothing };
    }
    // They differ by nothing but rounding.
    if values.iter().all(|value| (value - values[0]).abs() <= 1e-12 * largest) {
        let verdict = Verdict::Constant;
        return Estimate { mean: values[0], deviation: 0.0, error: 0.0, drift: 0.0, verdict, ..nothing };
    }
    let known = Known::of(values);
    let drift = drift(values, deviation);
    let verdict = if drift.abs() > DRIFT {
        Verdict::NotStationary
    } else if !known.enough {
        Verdict::TooShort
    } else if known.disagree {
        Verdict::Uncertain
    } else {
        Verdict::Good
    };
    if verdict == Verdict::NotStationary {
        // A drift counts as memory: what follows from the autocorrelation means nothing.
        return Estimate { deviation: known.deviation, drift, verdict, ..nothing };
    }
    let error = if verdict == Verdict::Good { known.error } else { f64::NAN };
    let correlation = values.len() as f64 * (known.error / known.deviation).powi(2);
    Estimate {
        deviation: known.deviation,
        error,
        batch_error: known.batch_error,
        batches: known.batches,
        correlation,
        independent: values.len() as f64 / correlation,
        drift,
        verdict,
        ..nothing
    }
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (mean, (square / (count - 1.0)).sqrt())
}

/// The autocovariance at lags 0, 1, .. of a series: means over the pairs of rows that are so far apart.
fn autocovariance(values: &[f64]) -> Vec<f64> {
    let count = values.len();
    let (mean, _) = moments(values);
    let size = (2 * count).next_power_of_two();
    let mut planner = FftPlanner::new();
    let mut buffer: Vec<Complex<f64>> = values.iter().map(|value| Complex::new(value - mean, 0.0)).collect();
    buffer.resize(size, Complex::new(0.0, 0.0));
    planner.plan_fft_forward(size).process(&mut buffer);
    buffer.iter_mut().for_each(|value| *value = Complex::new(value.norm_sqr(), 0.0));
    planner.plan_fft_inverse(size).process(&mut buffer);
    (0..count).map(|lag| buffer[lag].re / (size as f64 * (count - lag) as f64)).collect()
}

/// The error of a mean, by the autocorrelation and by batches.
struct Known {
    error: f64,
    deviation: f64,
    batch_error: f64,
    batches: usize,
    /// Whether the window is long enough for the error to be known.
    enough: bool,
    /// Whether the error from batches is greater than the other by more than chance.
    disagree: bool,
}

impl Known {
    /// The rows must not all be equal.
    fn of(values: &[f64]) -> Known {
        let rows = values.len() as f64;
        let covariance = autocovariance(values);
        let (mut sum, mut memory, mut window, mut least) = (1.0, 1.0_f64, values.len() / 2, 1.0_f64);
        let mut squares = 1.0;
        for lag in 1..values.len() / 2 {
            let correlation = covariance[lag] / covariance[0];
            sum += 2.0 * correlation;
            squares += 2.0 * correlation * correlation;
            memory = memory.max(sum);
            least = least.min(correlation);
            if lag as f64 >= SOKAL * memory {
                window = lag;
                break;
            }
        }
        // The mean is that of the rows, which makes each lag of the autocovariance too small by the square of its
        // error: U. Wolff, Comput. Phys. Commun. 156, 143 (2004).
        let inefficiency = sum * (1.0 + (2 * window + 1) as f64 / rows) / (1.0 + sum.max(0.0) / rows);
        let deviation = (covariance[0] * (1.0 + sum.max(0.0) / rows)).sqrt();
        // No more independent values than rows.
        let by_correlation = deviation * (inefficiency.max(1.0) / rows).sqrt();
        // The greatest sum on the way, because in a short window noise takes the sum down again.
        let enough = rows / memory.max(inefficiency) >= LENGTHS;
        let noise = 4.0 * (squares / rows).sqrt();
        let oscillates = least < OSCILLATES.min(-noise);
        // What is left over at the ends of a batch is not small beside the mean of an oscillation: longer batches.
        let longer = if oscillates { 2.0 } else { 1.0 };
        let length = longer * (BATCH * memory).max(rows / BATCHES as f64);
        let batches = values.rchunks_exact(length.ceil() as usize);
        let means: Vec<f64> = batches.map(|batch| moments(batch).0).collect();
        let batch_error = moments(&means).1 / (means.len() as f64).sqrt();
        // The first lobe of the autocorrelation of an oscillation says little about the sum of all.
        if oscillates {
            let enough = enough && means.len() >= FEWEST_BATCHES;
            let (error, batches) = (batch_error, means.len());
            return Known { error, deviation, batch_error, batches, enough, disagree: false };
        }
        let spread = 0.5 / (means.len().max(2) - 1) as f64 + 0.5 * (2 * window + 1) as f64 / rows;
        let disagree = (batch_error / by_correlation).ln() > 3.0 * spread.sqrt();
        Known { error: by_correlation, deviation, batch_error, batches: means.len(), enough, disagree }
    }
}

/// The mean of the second half less that of the first, in standard errors: those of what a straight line leaves, because
/// a drift would count as memory.
fn drift(values: &[f64], deviation: f64) -> f64 {
    let middle = 0.5 * (values.len() - 1) as f64;
    let (mean, _) = moments(values);
    let (mut along, mut square) = (0.0, 0.0);
    for (row, value) in values.iter().enumerate() {
        let place = row as f64 - middle;
        along += place * (value - mean);
        square += place * place;
    }
    let rest: Vec<f64> = values
        .iter()
        .enumerate()
        .map(|(row, value)| value - mean - along / square * (row as f64 - middle))
        .collect();
    let half = values.len() / 2;
    let difference = moments(&values[values.len() - half..]).0 - moments(&values[..half]).0;
    if moments(&rest).1 <= 1e-9 * deviation {
        return f64::INFINITY.copysign(difference);
    }
    difference / (2.0 * Known::of(&rest).error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    /// A normal number, as the sum of twelve uniform ones.
    fn normal(random: &mut Pcg64) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    /// An autoregressive process of unit variance, in its stationary state.
    fn process(factor: f64, rows: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut value = normal(&mut random);
        (0..rows)
            .map(|_| {
                value = factor * value + (1.0 - factor * factor).sqrt() * normal(&mut random);
                value
            })
            .collect()
    }

    /// Exact standard error of the mean of such a process.
    fn exact(factor: f64, rows: usize) -> f64 {
        let count = rows as f64;
        let sum =
            1.0 + 2.0 * (1..rows).map(|k| (1.0 - k as f64 / count) * factor.powi(k as i32)).sum::<f64>();
        (sum / count).sqrt()
    }

    #[test]
    fn the_error_of_a_correlated_mean_is_that_of_theory_and_covers_the_truth() {
        for (factor, rows) in [(0.0, 400), (0.5, 1000), (0.9, 4000), (0.97, 10_000)] {
            let seeds = 400;
            let all: Vec<Estimate> = (0..seeds).map(|seed| estimate(&process(factor, rows, seed))).collect();
            let good: Vec<&Estimate> = all.iter().filter(|one| one.verdict == Verdict::Good).collect();
            let refused = all.len() - good.len();
            let count = good.len() as f64;
            let mean = good.iter().map(|one| one.error).sum::<f64>() / count;
            let covered = good.iter().filter(|one| one.mean.abs() < 2.0 * one.error).count() as f64 / count;
            let inefficiency = good.iter().map(|one| one.correlation).sum::<f64>() / count;
            let theory = (1.0 + factor) / (1.0 - factor);
            let of_batches = good.iter().map(|one| one.batch_error).sum::<f64>() / count;
            let exact = exact(factor, rows);
            let said = format!(
                "{factor}: error {mean} ({of_batches}) for {exact}, {covered} covered, {refused} refused, \
                 inefficiency {inefficiency} for {theory}"
            );
            println!("{said}");
            assert!((mean / exact - 1.0).abs() < 0.05, "{said}");
            assert!((of_batches / exact - 1.0).abs() < 0.1, "{said}");
            // It is at least 1, which makes it too great in the mean where it is 1.
            assert!((inefficiency / theory - 1.0).abs() < 0.1, "{said}");
            // 95.4 % of a normal distribution.
            assert!((0.92..0.98).contains(&covered), "{said}");
            assert!(refused < 20, "{said}");
        }
    }

    /// How often windows with so many independent samples give an error, and how often twice that error covers the
    /// truth: the table of the page.
    #[test]
    fn short_windows_give_no_error() {
        // Rows; most that may be called good; least share of them that cover the truth; most of all that are good and
        // do not cover it.
        let cases = [
            (100, 0.02, 0.0, 0.02),
            (300, 0.15, 0.4, 0.06),
            (600, 0.7, 0.78, 0.13),
            (1000, 1.0, 0.88, 0.11),
            (2000, 1.0, 0.9, 0.09),
            (4000, 1.0, 0.92, 0.07),
        ];
        for (rows, most, least, wrong) in cases {
            let seeds = 1000;
            let all: Vec<Estimate> = (0..seeds).map(|seed| estimate(&process(0.9, rows, seed))).collect();
            let good: Vec<&Estimate> = all.iter().filter(|one| one.verdict == Verdict::Good).collect();
            let covered = good.iter().filter(|one| one.mean.abs() < 2.0 * one.error).count() as f64;
            let drifts = all.iter().filter(|one| one.verdict == Verdict::NotStationary).count() as f64;
            let [all, good] = [all.len() as f64, good.len() as f64];
            let said = format!(
                "{:.0} independent samples: {:.1} % good, {:.1} % of them covered, {:.1} % not stationary",
                rows as f64 / 19.0,
                1e2 * good / all,
                1e2 * covered / good,
                1e2 * drifts / all
            );
            println!("{said}");
            assert!(
                good / all <= most && covered >= least * good && (good - covered) / all < wrong,
                "{said}"
            );
            assert!(rows < 1000 || drifts / all < 0.02, "{said}");
        }
    }

    #[test]
    fn a_drift_is_no_mean() {
        let drifting = |rise: f64, seed: u64| {
            let rows = 1000;
            let noise = process(0.5, rows, seed);
            let at = |(row, value): (usize, f64)| value + rise * row as f64 / rows as f64;
            estimate(&noise.into_iter().enumerate().map(at).collect::<Vec<f64>>())
        };
        for seed in 0..50 {
            let one = drifting(1.5, seed);
            assert_eq!(one.verdict, Verdict::NotStationary, "{one:?}");
            assert!(one.drift > 3.5 && one.error.is_nan());
        }
        assert!(drifting(-1.5, 1).drift < -3.5);
        let ramp: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(estimate(&ramp).verdict, Verdict::NotStationary);
        // A slow approach to a limit.
        let approach: Vec<f64> = process(0.0, 1000, 7)
            .into_iter()
            .enumerate()
            .map(|(row, value)| 10.0 * (-(row as f64) / 400.0).exp() + value)
            .collect();
        assert_eq!(estimate(&approach).verdict, Verdict::NotStationary);
    }

    #[test]
    fn white_noise_has_no_memory() {
        let one = estimate(&process(0.0, 2000, 3));
        assert!((one.correlation - 1.0).abs() < 0.2, "{one:?}");
        assert!((one.independent / 2000.0 - 1.0).abs() < 0.2 && one.drift.abs() < 3.0, "{one:?}");
    }

    /// A damped oscillation has a smaller error than its first lobe says; its batches know it.
    #[test]
    fn an_oscillation_has_the_error_of_its_batches() {
        let (damping, angle) = (0.99_f64, 0.2_f64);
        let oscillation = |seed: u64| -> Vec<f64> {
            let mut random = Pcg64::seed_from_u64(seed);
            let mut state = Complex::new(0.0, 0.0);
            let turn = Complex::from_polar(damping, angle);
            let rows = (0..8500).map(|_| {
                state = state * turn + Complex::new(normal(&mut random), normal(&mut random));
                state.re
            });
            rows.skip(500).collect()
        };
        let all: Vec<Estimate> = (0..200).map(|seed| estimate(&oscillation(seed))).collect();
        let truth = (all.iter().map(|one| one.mean * one.mean).sum::<f64>() / 200.0).sqrt();
        let good: Vec<&Estimate> = all.iter().filter(|one| one.verdict == Verdict::Good).collect();
        let mean = good.iter().map(|one| one.error).sum::<f64>() / good.len() as f64;
        let covered =
            good.iter().filter(|one| one.mean.abs() < 2.0 * one.error).count() as f64 / good.len() as f64;
        println!("{mean} for {truth}, {covered} covered, {} good", good.len());
        assert!(good.len() > 180, "{}", good.len());
        assert!(
            (0.95..1.4).contains(&(mean / truth)) && covered > 0.9,
            "{mean} for {truth}, {covered} covered"
        );
    }

    #[test]
    fn what_is_no_series_is_told_apart() {
        let verdict = |values: &[f64]| estimate(values).verdict;
        assert_eq!(verdict(&[]), Verdict::TooFewRows);
        assert_eq!(verdict(&[f64::NAN; 30]), Verdict::NoNumber);
        let mut gaps = process(0.0, 100, 1);
        gaps[50] = f64::NAN;
        let one = estimate(&gaps);
        assert_eq!(one.verdict, Verdict::Gaps);
        assert!(one.rows == 99 && one.mean.is_finite() && one.error.is_nan());
        assert_eq!(verdict(&process(0.0, 29, 1)), Verdict::TooFewRows);
        let one = estimate(&[363.15; 50]);
        assert_eq!((one.verdict, one.mean, one.error), (Verdict::Constant, 363.15, 0.0));
        assert_eq!(verdict(&[0.0; 50]), Verdict::Constant);
    }
}
