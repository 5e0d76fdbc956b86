//! `verification.csv`: one row per finding, written as cases finish.

use super::{Case, Finding};
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Result};

/// The table in the making.
pub struct Record {
    path: PathBuf,
    writer: csv::Writer<File>,
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

impl Record {
    /// An empty table.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|error| Error::file(path, "write", error))?;
        Ok(Self { path: path.to_path_buf(), writer: csv::Writer::from_writer(file) })
    }

    /// Adds the findings of a case that took `wall` seconds; they are on disk when this returns.
    pub fn add(&mut self, case: &Case, findings: &[Finding], wall: f64) -> Result<()> {
        let failed = |error: csv::Error| Error::Run(format!("cannot write {}: {error}", self.path.display()));
        for finding in findings {
            let row = Row {
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
            };
            self.writer.serialize(row).map_err(failed)?;
        }
        self.writer.flush().map_err(|error| failed(error.into()))
    }
}
