//! `measured.csv`: one row per run, on disk when the run is done, so that a study that was stopped goes on behind its
//! last row. Each part of a study that runs on several machines has a file of its own, `measured-I-of-N.csv`; all are
//! read.

use super::child::Timed;
use super::measure::Measured;
use super::plan::{Run, short};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use voidage_campaign::table::{self, Table};
use voidage_coupling::{Error, Result};

/// A run as it stands in the table. The columns are the same for all studies.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// What tells the run from all others.
    pub run: String,
    /// `done`, or why it failed.
    pub outcome: String,
    /// Its settings, for reading.
    pub settings: String,
    /// Values of each quantity, one per time: `v v; v`.
    pub values: String,
    /// From the start to the last step, s.
    pub wall_s: f64,
    /// Wall time of the steps, s.
    pub steps_s: f64,
    /// Processor time of the steps, s.
    pub steps_cpu_s: f64,
    /// Of all processes on all cores, s.
    pub cpu_s: f64,
    /// Largest less smallest over the median of the repetitions.
    pub spread: f64,
    /// Repetitions.
    pub repeats: usize,
    /// Steps.
    pub steps: u64,
    /// Solutions of the fluid.
    pub fluid_solves: Option<u64>,
    /// Steps in which a solver stopped before its tolerance.
    pub unconverged_steps: u64,
    /// Wall time by phase, s: `contacts=1 flow=2`.
    pub phases: String,
    /// Version of the program.
    pub version: String,
}

const DONE: &str = "done";

impl Row {
    /// The row of a run that ended well.
    pub fn done(run: &Run, timed: &Timed) -> Self {
        let Measured { values, cost } = &timed.measured;
        let list = |values: &Vec<f64>| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let phases = cost.phases.iter().map(|(name, seconds)| format!("{name}={seconds}"));
        Self {
            outcome: DONE.into(),
            values: values.iter().map(list).collect::<Vec<_>>().join("; "),
            wall_s: timed.wall_s,
            steps_s: cost.steps_s,
            steps_cpu_s: cost.steps_cpu_s,
            cpu_s: timed.cpu_s,
            spread: timed.spread,
            repeats: timed.repeats,
            steps: cost.steps,
            fluid_solves: cost.fluid_solves,
            unconverged_steps: cost.unconverged_steps,
            phases: phases.collect::<Vec<_>>().join(" "),
            ..Self::failed(run, "")
        }
    }

    /// The row of a run that failed.
    pub fn failed(run: &Run, why: &str) -> Self {
        Self {
            run: run.id.clone(),
            outcome: why.into(),
            settings: short(&run.settings),
            values: String::new(),
            wall_s: f64::NAN,
            steps_s: f64::NAN,
            steps_cpu_s: f64::NAN,
            cpu_s: f64::NAN,
            spread: f64::NAN,
            repeats: 0,
            steps: 0,
            fluid_solves: None,
            unconverged_steps: 0,
            phases: String::new(),
            version: env!("CARGO_PKG_VERSION").into(),
        }
    }

    /// Whether the run ended well.
    pub fn is_done(&self) -> bool {
        self.outcome == DONE
    }

    /// What is wrong with a row that was read, if anything is: no program of this version writes such a row.
    fn wrong(&self) -> Option<String> {
        let version = env!("CARGO_PKG_VERSION");
        if self.version != version {
            return Some(format!("`version` is `{}`, and this program is version {version}", self.version));
        }
        let seconds = [
            ("wall_s", self.wall_s),
            ("steps_s", self.steps_s),
            ("steps_cpu_s", self.steps_cpu_s),
            ("cpu_s", self.cpu_s),
            ("spread", self.spread),
        ];
        let unknown = |(_, value): &&(&str, f64)| self.is_done() && !(value.is_finite() && *value >= 0.0);
        if let Some((name, value)) = seconds.iter().find(unknown) {
            return Some(format!("`{name}` is {value} in a run that is done"));
        }
        let no_number = |value: &&str| value.parse::<f64>().is_err();
        let value = self.values.split([';', ' ']).filter(|value| !value.is_empty()).find(no_number);
        let phase = self
            .phases
            .split_whitespace()
            .find(|pair| pair.split_once('=').is_none_or(|(_, seconds)| seconds.parse::<f64>().is_err()));
        let what = |name: &str, value: &str| format!("`{name}` holds `{value}`, which is no number");
        value.map(|value| what("values", value)).or_else(|| phase.map(|phase| what("phases", phase)))
    }

    /// Values of a quantity.
    pub fn values_of(&self, quantity: usize) -> Vec<f64> {
        let list = self.values.split(';').nth(quantity).unwrap_or("");
        list.split_whitespace().filter_map(|value| value.parse().ok()).collect()
    }

    /// Seconds by phase.
    pub fn phases(&self) -> BTreeMap<String, f64> {
        let pairs = self.phases.split_whitespace().filter_map(|pair| pair.split_once('='));
        pairs.filter_map(|(name, seconds)| Some((name.to_owned(), seconds.parse().ok()?))).collect()
    }
}

/// The rows of a study, and the file that this process writes.
pub struct Record {
    table: Table,
    rows: BTreeMap<String, Row>,
}

impl Record {
    /// The file of the given name in a folder, with the rows of all files of the study there.
    ///
    /// # Errors
    /// Another process writes the file, or a file is no table of this version of the program or was damaged.
    pub fn open(folder: &Path, name: &str) -> Result<Self> {
        let (table, mut all) = Table::open(&folder.join(name), Row::wrong)?;
        let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
            .map_err(|error| Error::file(folder, "read", error))?
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| is_part(path) && !path.ends_with(name))
            .collect();
        files.sort();
        for file in files {
            all.extend(table::read(&file, Row::wrong)?);
        }
        let mut rows = BTreeMap::new();
        for row in all {
            // A run that went well in one of the files has gone well.
            let better = rows.get(&row.run).is_none_or(|known: &Row| !known.is_done() || row.is_done());
            if better {
                rows.insert(row.run.clone(), row);
            }
        }
        Ok(Self { table, rows })
    }

    /// The row of a run, if it is there.
    pub fn row(&self, run: &Run) -> Option<&Row> {
        self.rows.get(&run.id)
    }

    /// Adds a row; it is on disk when this returns.
    pub fn add(&mut self, row: Row) -> Result<()> {
        self.table.add([&row])?;
        self.rows.insert(row.run.clone(), row);
        Ok(())
    }
}

fn is_part(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with("measured") && name.ends_with(".csv")
}
