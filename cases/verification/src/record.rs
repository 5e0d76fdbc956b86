//! The tables, written as cases finish: one row per finding, and `curves.csv` beside it, the points of the plots.

use super::{Case, Outcome};
use serde::Serialize;
use std::path::Path;
use voidage_campaign::table::Table;
use voidage_coupling::Result;

/// The tables in the making.
pub struct Record {
    findings: Table,
    curves: Table,
}

/// A finding as it stands in the table; values are in the unit of the row.
#[derive(Serialize)]
struct Row<'a> {
    group: &'a str,
    case: &'a str,
    quantity: &'a str,
    unit: &'a str,
    expected: f64,
    measured: f64,
    lowest_allowed: f64,
    highest_allowed: f64,
    order: Option<f64>,
    passes: bool,
    case_wall_time_s: f64,
    source: &'a str,
}

/// A point of a plot; the labels name what x and y are, with their units.
#[derive(Serialize)]
struct Point<'a> {
    case: &'a str,
    panel: &'a str,
    curve: &'a str,
    x_label: &'a str,
    y_label: &'a str,
    x: f64,
    y: f64,
}

impl Record {
    /// An empty table of findings, and one of curves: what another version found is no finding of this one.
    pub fn create(findings: &Path) -> Result<Self> {
        let curves = Table::create(&findings.with_file_name("curves.csv"))?;
        Ok(Self { findings: Table::create(findings)?, curves })
    }

    /// Adds what a case gave in `wall` seconds.
    pub fn add(&mut self, case: &Case, outcome: &Outcome, wall: f64) -> Result<()> {
        self.findings.add(outcome.findings.iter().map(|finding| Row {
            group: case.group,
            case: case.name,
            quantity: &finding.quantity,
            unit: finding.unit,
            expected: finding.expected,
            measured: finding.measured,
            lowest_allowed: finding.allowed[0],
            highest_allowed: finding.allowed[1],
            order: finding.order,
            passes: finding.passes(),
            case_wall_time_s: wall,
            source: case.source,
        }))?;
        self.curves.add(outcome.panels.iter().flat_map(|panel| {
            panel.curves.iter().flat_map(move |curve| {
                curve.points.iter().map(move |(x, y)| Point {
                    case: case.name,
                    panel: &panel.title,
                    curve: &curve.name,
                    x_label: &panel.labels[0],
                    y_label: &panel.labels[1],
                    x: *x,
                    y: *y,
                })
            })
        }))
    }
}
