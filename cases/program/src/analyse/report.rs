//! The tables that `voidage analyse` prints and writes.

use super::statistics::{Estimate, Verdict};
use super::window::Window;
use serde::Serialize;

/// A row of `analysis.csv`. What is not known is `NaN`.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `series` or `frames`.
    pub source: &'static str,
    /// Name of the column.
    pub column: String,
    from_s: f64,
    to_s: f64,
    interval_s: f64,
    rows: usize,
    mean: f64,
    standard_deviation: f64,
    standard_error: f64,
    batch_standard_error: f64,
    batches: usize,
    correlation_time_s: f64,
    independent_samples: f64,
    drift_in_standard_errors: f64,
    verdict: &'static str,
    #[serde(skip)]
    known: Verdict,
}

impl Row {
    /// What is known of a column whose rows are so far apart, s.
    pub fn new(
        source: &'static str,
        column: impl Into<String>,
        window: &Window,
        step: f64,
        found: &Estimate,
    ) -> Row {
        Row {
            source,
            column: column.into(),
            from_s: window.from,
            to_s: window.to,
            interval_s: step,
            rows: found.rows,
            mean: found.mean,
            standard_deviation: found.deviation,
            standard_error: found.error,
            batch_standard_error: found.batch_error,
            batches: found.batches,
            correlation_time_s: found.correlation * step,
            independent_samples: found.independent,
            drift_in_standard_errors: found.drift,
            verdict: found.verdict.name(),
            known: found.verdict,
        }
    }

    /// What stands in place of the error.
    fn said(&self) -> String {
        match self.known {
            Verdict::Good => short(self.standard_error),
            Verdict::NotStationary => format!("not stationary ({:+.1})", self.drift_in_standard_errors),
            _ => self.verdict.to_owned(),
        }
    }
}

/// Prints rows as a table, and what its words mean.
pub fn print(rows: &[Row]) {
    let width = rows.iter().map(|row| row.column.chars().count()).max().unwrap_or(0).max(6);
    println!(
        "{:<width$}  {:>10}  {:<24}{:>10}  {:>12}  {:>11}",
        "column", "mean", "standard error", "deviation", "correl. time", "independent"
    );
    for row in rows {
        let known = |value: f64| if value.is_finite() { short(value) } else { "-".to_owned() };
        let time = row.correlation_time_s;
        println!(
            "{:<width$}  {:>10}  {:<24}{:>10}  {:>12}  {:>11}",
            row.column,
            known(row.mean),
            row.said(),
            known(row.standard_deviation),
            if time.is_finite() { format!("{} s", short(time)) } else { "-".to_owned() },
            if row.independent_samples.is_finite() {
                format!("{:.0}", row.independent_samples)
            } else {
                "-".to_owned()
            },
        );
    }
    let has = |verdict: Verdict| rows.iter().any(|row| row.known == verdict);
    for (verdict, meaning) in MEANINGS {
        if has(verdict) {
            println!("{}: {meaning}", verdict.name());
        }
    }
}

const MEANINGS: [(Verdict, &str); 5] = [
    (
        Verdict::NotStationary,
        "the second half of the window differs from the first by so many standard errors, so that its mean is not that \
         of a longer run: begin later (--from)",
    ),
    (
        Verdict::TooShort,
        "the window holds fewer than 30 independent samples, or too few periods of an oscillation: the error cannot be \
         known; run longer",
    ),
    (
        Verdict::Uncertain,
        "the means of parts of the window scatter more than the autocorrelation says, and the error cannot be known: run \
         longer",
    ),
    (Verdict::Gaps, "some rows are NaN; mean and deviation are those of the others"),
    (Verdict::TooFewRows, "the window has fewer than 30 rows"),
];

/// A number with four digits.
pub fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    if (1e-3..1e5).contains(&value.abs()) {
        format!("{value:.0$}", digits.clamp(0, 6) as usize)
    } else {
        format!("{value:.3e}")
    }
}
