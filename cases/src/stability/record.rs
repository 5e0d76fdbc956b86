//! `stability.csv`: one row per point, written as points finish; a run that stopped goes on behind its last row.
//! `curves.csv`: what pictures show of single points.

use super::axis::{Axis, Sample, Verdict};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Notice, Result};

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
}

/// A table that grows on disk.
struct Table<T> {
    path: PathBuf,
    writer: csv::Writer<File>,
    rows: Vec<T>,
}

impl<T: Serialize + DeserializeOwned> Table<T> {
    /// The table at a path, with the rows that are there.
    fn open(path: PathBuf) -> Result<Self> {
        let failed = |error: csv::Error| {
            Error::input(Notice::new(format!("{}: {error}", path.display()), "remove it"))
        };
        let rows = match path.exists() {
            true => {
                let mut reader = csv::Reader::from_path(&path).map_err(failed)?;
                reader.deserialize().collect::<std::result::Result<Vec<T>, _>>().map_err(failed)?
            }
            false => vec![],
        };
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let file = file.map_err(|error| Error::file(&path, "write", error))?;
        let writer = csv::WriterBuilder::new().has_headers(rows.is_empty()).from_writer(file);
        Ok(Self { path, writer, rows })
    }

    /// Adds a row; it is on disk when this returns.
    fn add(&mut self, row: T) -> Result<()> {
        let failed = |error: csv::Error| Error::run(format!("cannot write {}: {error}", self.path.display()));
        self.writer.serialize(&row).map_err(failed)?;
        self.writer.flush().map_err(|error| failed(error.into()))?;
        self.rows.push(row);
        Ok(())
    }

    /// Sorts the rows, in the file too; those of the same key stay as they are.
    fn sort<K: Ord>(&mut self, key: impl Fn(&T) -> K) -> Result<()> {
        if self.rows.is_sorted_by_key(&key) {
            return Ok(());
        }
        self.rows.sort_by_key(key);
        let failed = |error: csv::Error| Error::run(format!("cannot write {}: {error}", self.path.display()));
        // Beside it first: what is there is whole at any time.
        let beside = self.path.with_extension("part");
        let mut writer = csv::Writer::from_path(&beside).map_err(failed)?;
        self.rows.iter().try_for_each(|row| writer.serialize(row)).map_err(failed)?;
        writer.flush().map_err(|error| failed(error.into()))?;
        std::fs::rename(&beside, &self.path).map_err(|error| Error::file(&self.path, "write", error))?;
        self.writer = writer;
        Ok(())
    }
}

/// The tables in the making.
pub struct Record {
    points: Table<Row>,
    places: Table<Place>,
}

impl Record {
    /// The tables in a folder, with the rows that are there.
    pub fn open(folder: &Path) -> Result<Self> {
        Ok(Self {
            points: Table::open(folder.join("stability.csv"))?,
            places: Table::open(folder.join("curves.csv"))?,
        })
    }

    /// All points, those of earlier runs first.
    pub fn rows(&self) -> &[Row] {
        &self.points.rows
    }

    /// All places of curves.
    pub fn places(&self) -> &[Place] {
        &self.places.rows
    }

    /// Puts the points in the order of the axes, their parameters and the schemes, whatever the order in which they ended.
    ///
    /// # Errors
    /// The tables cannot be written.
    pub fn arrange(&mut self, axes: &[Axis]) -> Result<()> {
        let rank = |name: &str| axes.iter().position(|axis| axis.name == name);
        // The parameters are not negative: their bits are in the order of their values.
        self.points.sort(|row| (rank(&row.axis), row.x.to_bits(), row.y.to_bits(), row.scheme as usize))?;
        self.places.sort(|row| (rank(&row.axis), row.x.to_bits(), row.y.to_bits(), row.scheme as usize))
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
        for &(curve, at, value) in &sample.curves {
            self.places.add(Place {
                axis: axis.name.into(),
                scheme,
                x,
                y,
                curve: curve.into(),
                at,
                value,
            })?;
        }
        self.points.add(Row {
            axis: axis.name.into(),
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
        })
    }
}
