//! Errors, orders, and the cheapest settings: what follows from the runs that are there.

use super::fields;
use super::file::{Clock, Of, Quantity, Study};
use super::plan::{Curve, Plan};
use super::record::{Record, Row};
use std::path::{Path, PathBuf};
use voidage_coupling::Result;

/// Error below which the rounding of the computation is seen, not the method.
const ROUNDING: f64 = 1e-12;

/// A run with its errors.
#[derive(Clone, Debug)]
pub struct Point {
    /// Value of what is refined, or the number of the point.
    pub x: f64,
    /// Number of the run.
    pub run: usize,
    /// What was measured.
    pub row: Row,
    /// Relative error of each quantity; not a number where there is none.
    pub errors: Vec<f64>,
    /// The time that errors are drawn against, s.
    pub time: f64,
    /// Whether this is what the others are compared with.
    pub is_reference: bool,
}

/// A curve with the points that are there, from cheap to dear.
#[derive(Clone, Debug)]
pub struct Line {
    /// Its name.
    pub name: String,
    /// Key that is refined; none of a table.
    pub refine: Option<String>,
    /// What its axis says.
    pub label: String,
    /// The points.
    pub points: Vec<Point>,
}

/// File of the nodal fields of a run.
pub fn fields_of(folder: &Path, run: &str) -> PathBuf {
    folder.join("fields").join(format!("{run}.vtu"))
}

/// The curves of a study with the errors of their runs; those that failed or are not there yet are left out.
///
/// # Errors
/// Files of fields that cannot be read.
pub fn lines(study: &Study, plan: &Plan, record: &Record, folder: &Path) -> Result<Vec<Line>> {
    let row = |run: usize| record.row(&plan.runs[run]).filter(|row| row.is_done());
    let reference = plan.reference.and_then(row);
    let point = |&(x, run): &(f64, usize)| {
        let Some(row) = row(run) else { return Ok(None) };
        let each = study.quantities.iter().enumerate();
        let errors = each.map(|(k, quantity)| error(k, quantity, row, reference, folder));
        let errors = errors.collect::<Result<Vec<f64>>>()?;
        let time = match study.time {
            Clock::Wall => row.wall_s,
            Clock::Steps => row.steps_s,
            Clock::Cpu => row.steps_cpu_s,
        };
        Ok(Some(Point { x, run, row: row.clone(), errors, time, is_reference: plan.reference == Some(run) }))
    };
    let line = |curve: &Curve| {
        let points = curve.points.iter().map(point).collect::<Result<Vec<_>>>()?;
        let Curve { name, refine, label, .. } = curve.clone();
        Ok(Line { name, refine, label, points: points.into_iter().flatten().collect() })
    };
    plan.curves.iter().map(line).collect()
}

/// Relative error of a quantity.
fn error(k: usize, quantity: &Quantity, row: &Row, reference: Option<&Row>, folder: &Path) -> Result<f64> {
    let values = row.values_of(k);
    match (&quantity.of, &quantity.exact, reference) {
        (Of::Error(_), ..) => Ok(values.first().copied().unwrap_or(f64::NAN)),
        (Of::Field(name), _, Some(reference)) => {
            let [file, known] = [&row.run, &reference.run].map(|run| fields_of(folder, run));
            let (off, size) = fields::distance(&file, &known, *name)?;
            Ok(off / quantity.scale.unwrap_or(size))
        }
        (_, Some(known), _) => Ok(apart(&values, known, quantity.scale)),
        (_, None, Some(reference)) => Ok(apart(&values, &reference.values_of(k), quantity.scale)),
        (_, None, None) => Ok(f64::NAN),
    }
}

/// Root mean square of the differences over the scale, or over that of the known values.
fn apart(values: &[f64], known: &[f64], scale: Option<f64>) -> f64 {
    if values.len() != known.len() {
        return f64::NAN;
    }
    let size = |sum: f64| (sum / known.len() as f64).sqrt();
    let off = size(values.iter().zip(known).map(|(a, b)| (a - b).powi(2)).sum());
    off / scale.unwrap_or_else(|| size(known.iter().map(|b| b * b).sum()))
}

impl Line {
    /// Points with an error above rounding, as (x, time, error), from cheap to dear.
    fn usable(&self, quantity: usize) -> Vec<(f64, f64, f64)> {
        let all = self.points.iter().filter(|point| !point.is_reference);
        let all = all.map(|point| (point.x, point.time, point.errors[quantity]));
        all.filter(|(x, time, error)| *x > 0.0 && *time > 0.0 && *error > ROUNDING).collect()
    }

    /// Order at which the error of a quantity falls with what is refined, from the two finest runs.
    pub fn order(&self, quantity: usize) -> Option<f64> {
        match self.usable(quantity).as_slice() {
            [.., a, b] => Some(slope((a.0, a.2), (b.0, b.2)).abs().copysign(a.2 - b.2)),
            _ => None,
        }
    }

    /// Power of the time at which the error falls, by least squares over all runs.
    pub fn power(&self, quantity: usize) -> Option<f64> {
        let points: Vec<(f64, f64)> =
            self.usable(quantity).iter().map(|(_, time, error)| (time.ln(), error.ln())).collect();
        let count = points.len() as f64;
        let mean = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0 / count, sum.1 + p.1 / count));
        let (top, bottom) = points.iter().fold((0.0, 0.0), |(top, bottom), p| {
            (top + (p.0 - mean.0) * (p.1 - mean.1), bottom + (p.0 - mean.0).powi(2))
        });
        (points.len() > 1 && bottom > 0.0).then_some(top / bottom)
    }
}

fn slope(a: (f64, f64), b: (f64, f64)) -> f64 {
    (b.1 / a.1).ln() / (b.0 / a.0).ln()
}

/// The point of least time among those whose error of a quantity is at most the target, with its curve.
pub fn cheapest(lines: &[Line], quantity: usize, target: f64) -> Option<(&Line, &Point)> {
    let all = lines.iter().flat_map(|line| line.points.iter().map(move |point| (line, point)));
    let good = all.filter(|(_, point)| !point.is_reference && point.errors[quantity] <= target);
    good.min_by(|a, b| a.1.time.total_cmp(&b.1.time))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_relative_to_the_scale_or_to_what_is_known() {
        assert_eq!(apart(&[1.1, 2.0], &[1.0, 2.0], Some(0.1 / 2f64.sqrt())), 1.0000000000000009);
        assert!((apart(&[3.0, 4.5], &[3.0, 4.0], None) - 0.1).abs() < 1e-15);
        assert!(apart(&[1.0], &[1.0, 2.0], None).is_nan());
    }
}
