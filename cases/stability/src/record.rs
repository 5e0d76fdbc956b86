//! `stability.csv`: one row per point, written as points finish; a run that stopped goes on behind its last row.
//! `curves.csv`: what pictures show of single points.

use super::axis::{Axis, Sample, Verdict};
use serde::{Deserialize, Serialize};
use std::path::Path;
use voidage_campaign::Effort;
use voidage_campaign::table::Table;
use voidage_coupling::Result;
use voidage_coupling::scheme::SchemeName;

/// A point as it stands in the table.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Name of the axis.
    pub axis: String,
    /// The scheme.
    pub scheme: SchemeName,
    /// The two parameters.
    pub x: f64,
    /// The second.
    pub y: f64,
    /// How it ended.
    pub verdict: Verdict,
    /// Whether theory says that it passes; empty where there is no theory.
    pub theory_passes: Option<bool>,
    /// What was measured.
    pub measured: f64,
    /// What it should be.
    pub expected: f64,
    /// Solutions of the fluid per step.
    pub solves_per_step: f64,
    /// Contact sweeps per step.
    pub sweeps_per_step: f64,
    /// Share of the steps that the program reports as not solved.
    pub unsolved_share: f64,
    /// `quick` or `full`.
    pub form: String,
    /// Version of the program.
    pub version: String,
}

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What the form of a point is called in the table.
fn form(effort: Effort) -> &'static str {
    effort.pick("quick", "full")
}

/// A place of a curve of a point, as it stands in `curves.csv`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Place {
    /// Name of the axis.
    pub axis: String,
    /// The scheme.
    pub scheme: SchemeName,
    /// The two parameters.
    pub x: f64,
    /// The second.
    pub y: f64,
    /// Name of the curve.
    pub curve: String,
    /// Where.
    pub at: f64,
    /// What is there.
    pub value: f64,
    /// `quick` or `full`.
    pub form: String,
    /// Version of the program.
    pub version: String,
}

/// The tables in the making, and their rows.
pub struct Record {
    effort: Effort,
    points: Table,
    rows: Vec<Row>,
    curves: Table,
    places: Vec<Place>,
}

impl Record {
    /// The tables in a folder, with the rows that are there.
    ///
    /// # Errors
    /// Points there are of the other form or of another version, another process is at work there.
    pub fn open(folder: &Path, effort: Effort) -> Result<Self> {
        let other = |form: &str, version: &str| {
            let other = form != self::form(effort) || version != VERSION;
            other.then(|| {
                format!("`form` and `version` are `{form}` and `{version}`: this is a point of another map")
            })
        };
        let (points, rows) =
            Table::open(&folder.join("stability.csv"), |row: &Row| other(&row.form, &row.version))?;
        let (curves, mut places) =
            Table::open(&folder.join("curves.csv"), |place: &Place| other(&place.form, &place.version))?;
        // Curves are written first: those of a point that is not there will come again.
        let written = places.len();
        places.retain(|place| {
            rows.iter().any(|row| {
                (&row.axis, row.scheme) == (&place.axis, place.scheme) && (row.x, row.y) == (place.x, place.y)
            })
        });
        let mut curves = curves;
        if places.len() < written {
            curves.replace(&places)?;
        }
        Ok(Self { effort, points, rows, curves, places })
    }

    /// All points, those of earlier runs first.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// All places of curves.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// Puts the points in the order of the axes, their parameters and the schemes, whatever the order in which they
    /// ended.
    ///
    /// # Errors
    /// The tables cannot be written.
    pub fn arrange(&mut self, axes: &[Axis]) -> Result<()> {
        let rank = |name: &str| axes.iter().position(|axis| axis.name == name);
        // The parameters are not negative: their bits are in the order of their values.
        self.rows.sort_by_key(|row| (rank(&row.axis), row.x.to_bits(), row.y.to_bits(), row.scheme));
        self.points.replace(&self.rows)?;
        self.places.sort_by_key(|row| (rank(&row.axis), row.x.to_bits(), row.y.to_bits(), row.scheme));
        self.curves.replace(&self.places)
    }

    /// Whether a point is there.
    pub fn has(&self, axis: &Axis, scheme: SchemeName, [x, y]: [f64; 2]) -> bool {
        self.rows()
            .iter()
            .any(|row| row.axis == axis.name && row.scheme == scheme && row.x == x && row.y == y)
    }

    /// Adds a point; its curves first, so that a point that is there is there with them.
    pub fn add(&mut self, axis: &Axis, scheme: SchemeName, point: [f64; 2], sample: &Sample) -> Result<()> {
        let ([x, y], tally) = (point, sample.tally);
        let axis_name = || axis.name.to_owned();
        let place = |&(curve, at, value): &(&str, f64, f64)| Place {
            axis: axis_name(),
            scheme,
            x,
            y,
            curve: curve.into(),
            at,
            value,
            form: form(self.effort).into(),
            version: VERSION.into(),
        };
        let places: Vec<Place> = sample.curves.iter().map(place).collect();
        self.curves.add(&places)?;
        self.places.extend(places);
        let row = Row {
            axis: axis_name(),
            scheme,
            x,
            y,
            verdict: sample.verdict,
            theory_passes: (axis.theory)(point, scheme),
            measured: sample.measured,
            expected: sample.expected,
            solves_per_step: tally.per_step(tally.solves),
            sweeps_per_step: tally.per_step(tally.sweeps),
            unsolved_share: tally.per_step(tally.unsolved),
            form: form(self.effort).into(),
            version: VERSION.into(),
        };
        self.points.add([&row])?;
        self.rows.push(row);
        Ok(())
    }
}
