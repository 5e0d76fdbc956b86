//! `stability.csv`: one row per point, written as points finish; a run that stopped goes on behind its last row.

use super::axis::{Axis, Sample, Verdict};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Result};

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
}

/// The table in the making.
pub struct Record {
    path: PathBuf,
    writer: csv::Writer<File>,
    /// All rows, those of earlier runs first.
    pub rows: Vec<Row>,
}

impl Record {
    /// The table at a path, with the rows that are there.
    pub fn open(path: &Path) -> Result<Self> {
        let failed =
            |error: csv::Error| Error::Input(format!("{}: {error}\n  help: remove it", path.display()));
        let rows = match path.exists() {
            true => {
                let mut reader = csv::Reader::from_path(path).map_err(failed)?;
                reader.deserialize().collect::<std::result::Result<Vec<Row>, _>>().map_err(failed)?
            }
            false => vec![],
        };
        let file = OpenOptions::new().create(true).append(true).open(path);
        let file = file.map_err(|error| Error::file(path, "write", error))?;
        let writer = csv::WriterBuilder::new().has_headers(rows.is_empty()).from_writer(file);
        Ok(Self { path: path.to_path_buf(), writer, rows })
    }

    /// Whether a point is there.
    pub fn has(&self, axis: &Axis, scheme: SchemeName, [x, y]: [f64; 2]) -> bool {
        self.rows.iter().any(|row| row.axis == axis.name && row.scheme == scheme && row.x == x && row.y == y)
    }

    /// Adds a point; it is on disk when this returns.
    pub fn add(&mut self, axis: &Axis, scheme: SchemeName, point: [f64; 2], sample: &Sample) -> Result<()> {
        let row = Row {
            axis: axis.name.into(),
            scheme,
            x: point[0],
            y: point[1],
            verdict: sample.verdict,
            theory_passes: (axis.theory)(point, scheme),
            measured: sample.measured,
            expected: sample.expected,
            solves_per_step: sample.solves,
        };
        let failed = |error: csv::Error| Error::Run(format!("cannot write {}: {error}", self.path.display()));
        self.writer.serialize(&row).map_err(failed)?;
        self.writer.flush().map_err(|error| failed(error.into()))?;
        self.rows.push(row);
        Ok(())
    }
}
