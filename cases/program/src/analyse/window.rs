//! The part of a run that means are taken over.

use std::ops::Range;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;

/// Relative difference of intervals that is no more than rounding.
const ROUNDING: f64 = 1e-6;

/// From one time to another, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// s.
    pub from: f64,
    /// s.
    pub to: f64,
}

impl Window {
    /// The window that is asked for in a run from a first to a last time: without options that of `output.average`,
    /// where the run reaches it, or the second half.
    ///
    /// # Errors
    /// It is empty, or the run has nothing in it.
    pub fn new([from, to]: [Option<f64>; 2], scene: &Scene, [first, last]: [f64; 2]) -> Result<Window> {
        let usual = match &scene.output.average {
            Some(average) if average.from < last => [average.from, average.to],
            _ => [0.5 * (first + last), last],
        };
        let window =
            Window { from: from.unwrap_or(usual[0].max(first)), to: to.unwrap_or(usual[1].min(last)) };
        // Written so that what is no number fails.
        if !(window.from < window.to && window.from <= last && window.to >= first) {
            let what = format!("--from {} --to {}: the run has no such window", window.from, window.to);
            let help = format!("the run lasts from {first} s to {last} s, and --from is before --to");
            return Err(Error::input(Notice::new(what, help)));
        }
        Ok(window)
    }

    /// Which of these increasing times are in it.
    pub fn rows(&self, times: &[f64]) -> Range<usize> {
        let slack = 1e-9 * (self.to - self.from);
        let start = times.partition_point(|time| *time < self.from - slack);
        let end = times.partition_point(|time| *time <= self.to + slack);
        start..end.max(start)
    }
}

/// Rows at even times.
#[derive(Clone, Debug, PartialEq)]
pub struct Even {
    /// The rows.
    pub rows: Range<usize>,
    /// Time between them, s; `NaN` for a single one.
    pub step: f64,
}

impl Even {
    /// The rows of a range of increasing times. The first and the last may be closer to their neighbours, because a run
    /// records its start and its end whatever its interval is: they are left out.
    ///
    /// # Errors
    /// The row before which the interval is another than in most of the range.
    pub fn new(times: &[f64], mut rows: Range<usize>) -> std::result::Result<Even, usize> {
        let gap = |row: usize| times[row] - times[row - 1];
        let mut gaps: Vec<f64> = (rows.start + 1..rows.end).map(gap).collect();
        gaps.sort_by(f64::total_cmp);
        let step = gaps.get(gaps.len() / 2).copied().unwrap_or(f64::NAN);
        let shorter = |row: usize| gap(row) < step * (1.0 - ROUNDING);
        if rows.len() > 2 && shorter(rows.end - 1) {
            rows.end -= 1;
        }
        if rows.len() > 2 && shorter(rows.start + 1) {
            rows.start += 1;
        }
        match (rows.start + 1..rows.end).find(|row| (gap(*row) - step).abs() > ROUNDING * step) {
            Some(row) => Err(row),
            None if rows.len() > 1 => {
                let length = times[rows.end - 1] - times[rows.start];
                Ok(Even { step: length / (rows.len() - 1) as f64, rows })
            }
            None => Ok(Even { rows, step }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_even_but_for_the_ends() {
        let even = |times: &[f64]| Even::new(times, 0..times.len());
        assert_eq!(even(&[0.0, 0.1, 0.2, 0.30000001]).unwrap().rows, 0..4);
        let found = even(&[0.0, 0.1, 0.2, 0.3, 0.35]).unwrap();
        assert!(found.rows == (0..4) && (found.step - 0.1).abs() < 1e-15, "{found:?}");
        assert_eq!(even(&[0.17, 0.2, 0.3, 0.4]).unwrap().rows, 1..4);
        assert_eq!(even(&[0.0, 0.1, 0.2, 0.25, 0.3, 0.4]), Err(3));
        assert_eq!(even(&[0.0, 0.1, 0.2, 0.4, 0.5]), Err(3));
        assert!(even(&[0.5]).unwrap().step.is_nan() && even(&[]).unwrap().rows.is_empty());
    }

    /// With one option alone the other end was that of the run.
    #[test]
    fn an_end_that_is_not_given_is_that_of_the_average() {
        let text = r#"
            gravity = [0.0, -9.81]
            time = { step = 1e-3, end = 10.0 }
            materials.glass = { density = 2500.0 }
            grains = [{ material = "glass", radius = 1e-3, placement = { lattice = { lower = [0.0, 0.0], upper = [0.01, 0.01] } } }]
            output.average = { from = 2.0, to = 4.0, cell = 1e-3 }
        "#;
        let scene = Scene::parse(std::path::Path::new("scene.toml"), text, &[]).unwrap();
        let window = |from: Option<f64>, to: Option<f64>| {
            let Window { from, to } = Window::new([from, to], &scene, [0.0, 10.0]).unwrap();
            [from, to]
        };
        assert_eq!(window(None, None), [2.0, 4.0]);
        assert_eq!(window(Some(3.0), None), [3.0, 4.0]);
        assert_eq!(window(None, Some(5.0)), [2.0, 5.0]);
        assert_eq!(window(Some(5.0), Some(9.0)), [5.0, 9.0]);
    }

    #[test]
    fn a_window_has_the_rows_from_its_start_to_its_end() {
        let window = Window { from: 0.3, to: 0.5 };
        let times: Vec<f64> = (0..10).map(|k| f64::from(k) * 0.1).collect();
        assert_eq!(window.rows(&times), 3..6);
        assert_eq!(Window { from: 2.0, to: 3.0 }.rows(&times), 10..10);
    }
}
