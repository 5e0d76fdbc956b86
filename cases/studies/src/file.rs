//! The file of a study: its keys, and what is wrong with them.

use super::problems::ProblemName;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use voidage_campaign::shipped;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Origin;
use voidage_scene::document::{self, Document};

/// A tree of keys, as the schema shows it.
type Keys = BTreeMap<String, serde_json::Value>;

/// A whole study.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// What the study shows, one line. Default: empty.
    #[serde(default)]
    pub title: String,
    /// What is run: `{scene = "FILE"}`, path relative to the study, or the name of a shipped case; or
    /// `{problem = "NAME"}`.
    pub case: Case,
    /// Settings of all runs: keys of the scene or of the problem, and `threads` (default 1). Default: none.
    #[serde(default)]
    #[schemars(with = "Keys")]
    pub set: Table,
    /// What results are compared with: `"exact"` (or `"manufactured"`), the known values; `"finest"`, the run that is
    /// estimated to take longest; `{run = {KEY = VALUE, ..}}`, a run with these settings over those of the study; or
    /// `"none"`: the study is a table of the values of its runs.
    pub reference: Reference,
    /// What is compared. At least one.
    pub quantities: Vec<Quantity>,
    /// What is varied. At least one.
    pub sweeps: Vec<Sweep>,
    /// The time that errors are drawn against: `"wall"`, from the start to the last step; `"steps"`, wall time of the
    /// steps; or `"cpu"`, processor time of the steps on all cores, for machines that others use too. Default `"wall"`.
    #[serde(default)]
    pub time: Clock,
    /// How often each run is repeated; times are medians. At least 1. Default 1.
    #[serde(default = "once")]
    pub repeats: usize,
    /// The error, as a share, for which the cheapest settings are sought. Above 0. Default 0.01.
    #[serde(default = "one_percent")]
    pub target: f64,
    /// What `--quick` changes. Default: the defaults of its keys.
    #[serde(default)]
    pub quick: Quick,
    /// Where the study was read from: errors point into it.
    #[serde(skip)]
    #[schemars(skip)]
    pub origin: Origin,
}

fn once() -> usize {
    1
}

fn one_percent() -> f64 {
    0.01
}

/// What is run.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Case {
    /// A scene file (TOML), path relative to the study, or the name of a shipped case.
    Scene(PathBuf),
    /// A problem with a known answer.
    Problem(ProblemName),
}

/// What results are compared with.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Reference {
    /// The known values: those of the quantities, or what the problem knows.
    #[serde(alias = "manufactured")]
    Exact,
    /// The run of the sweeps that is estimated to take longest.
    Finest,
    /// Nothing: values, no errors.
    None,
    /// A run of its own.
    Run(#[schemars(with = "Keys")] Table),
}

/// A quantity whose error is measured.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Quantity {
    /// Name in tables and plots.
    pub name: String,
    /// Which value it is: `{series = "COLUMN"}` of series.csv; `{summary = "KEY"}` of summary.json;
    /// `{grain = {number = 0, column = "velocity", axis = 1}}`; `{field = "temperature"}`, nodal, at the end, in L2;
    /// or, of a problem, `{error = "NAME"}`.
    pub of: Of,
    /// Times at which it is looked at, s; between steps it is interpolated. Default: the end of the run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub at: Vec<f64>,
    /// Known values, one per time, used instead of the reference of the study. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exact: Option<Vec<f64>>,
    /// What the error is divided by, in the unit of the quantity. Above 0. Default: the size of the reference (root
    /// mean square over the times, or the norm of the field).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
}

/// What a quantity is.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Of {
    /// A column of series.csv.
    Series(String),
    /// A number of summary.json.
    Summary(String),
    /// A value of one grain.
    Grain(OfGrain),
    /// A nodal field at the end, in L2.
    Field(FieldName),
    /// A relative error that the problem knows.
    Error(String),
}

/// A value of one grain.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OfGrain {
    /// Number of the grain, from 0.
    pub number: usize,
    /// `"position"` (m), `"velocity"` (m/s) or `"temperature"` (K).
    pub column: GrainColumn,
    /// Component: 0 along x, 1 along y. Default 0.
    #[serde(default)]
    pub axis: usize,
}

/// Columns of grains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GrainColumn {
    /// m.
    Position,
    /// m/s.
    Velocity,
    /// K.
    Temperature,
}

/// Nodal fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FieldName {
    /// m/s.
    Velocity,
    /// Pa.
    Pressure,
    /// K.
    Temperature,
    /// No unit.
    Voidage,
}

/// The times that errors are drawn against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// From the start of the run to its last step, s.
    #[default]
    Wall,
    /// Wall time of the steps, s.
    Steps,
    /// Processor time of the steps on all cores, s; of a fluid solver in another process all its time.
    Cpu,
}

/// Settings that are varied: every value, and every point, with every other. One curve for each choice of the keys
/// beside `refine`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Name of its curves, before the values that tell them apart. Default: none.
    #[serde(default)]
    pub name: String,
    /// The key that is refined along a curve, one of `vary` or of the `points`; its values are numbers above 0. Needed
    /// where results are compared with something. Default, where they are not: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refine: Option<String>,
    /// What the axis of `refine` says. Default: the key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// Keys with lists of values. Default: none.
    #[serde(default)]
    #[schemars(with = "Keys")]
    pub vary: Table,
    /// Settings that change together: a list of tables with the same keys. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<Keys>")]
    pub points: Vec<Table>,
    /// Settings of this sweep, over those of the study. Default: none.
    #[serde(default)]
    #[schemars(with = "Keys")]
    pub set: Table,
}

/// What `--quick` changes. Runs are not repeated.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Quick {
    /// Runs of each curve, the cheapest. At least 1. Default 3.
    pub runs: usize,
    /// Times at which quantities without known values are looked at instead of their own, s. Default: none.
    pub at: Vec<f64>,
    /// Settings over all others, those of a reference run too. Default: none.
    #[schemars(with = "Keys")]
    pub set: Table,
}

impl Default for Quick {
    fn default() -> Self {
        Self { runs: 3, at: Vec::new(), set: Table::new() }
    }
}

impl Document for Study {
    const KEYS: &'static str = "voidage schema --study";
}

/// The leaves of a tree of keys, by their dotted paths.
pub fn leaves(table: &Table) -> Vec<(String, Value)> {
    let mut found = Vec::new();
    for (key, value) in table {
        match value {
            Value::Table(inner) if !inner.is_empty() => {
                found.extend(leaves(inner).into_iter().map(|(path, value)| (format!("{key}.{path}"), value)));
            }
            leaf => found.push((key.clone(), leaf.clone())),
        }
    }
    found
}

impl Study {
    /// Reads and checks a study.
    ///
    /// # Errors
    /// The file cannot be read, or something in it is wrong.
    pub fn read(file: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(file).map_err(|error| {
            Error::input(Notice::new(
                format!("{}: cannot read the study: {error}", file.display()),
                "give the path of a study, such as cases/studies/stack.toml",
            ))
        })?;
        let (mut study, origin) = document::read::<Study>(file, &text)?;
        study.origin = origin;
        study.check()?;
        Ok(study)
    }

    /// The short form, as far as it is one of the quantities.
    pub fn shorten(&mut self) {
        let of_time =
            self.quantities.iter_mut().filter(|quantity| !quantity.at.is_empty() && quantity.exact.is_none());
        if !self.quick.at.is_empty() {
            of_time.for_each(|quantity| quantity.at.clone_from(&self.quick.at));
        }
        self.repeats = 1;
    }

    /// An error at a key of the study.
    pub fn error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> Error {
        self.origin.error(path, message, help).into()
    }

    /// The folder of the study, where paths start.
    pub fn folder(&self) -> PathBuf {
        let folder = self.origin.folder();
        std::env::current_dir().map_or_else(|_| folder.to_path_buf(), |here| here.join(folder))
    }

    /// The scene file as this process finds it, or the name of a shipped case as it is.
    pub fn scene(&self) -> Option<PathBuf> {
        let Case::Scene(scene) = &self.case else { return None };
        let file = self.origin.folder().join(scene);
        Some(if file.is_file() { std::fs::canonicalize(&file).unwrap_or(file) } else { scene.clone() })
    }

    fn check(&self) -> Result<()> {
        let positive = |path: &str, value: f64| match value > 0.0 {
            true => Ok(()),
            false => {
                Err(self.error(path, format!("`{path} = {value}` must be above 0"), "give a number above 0"))
            }
        };
        positive("target", self.target)?;
        positive("repeats", self.repeats as f64)?;
        positive("quick.runs", self.quick.runs as f64)?;
        for (list, empty) in [("quantities", self.quantities.is_empty()), ("sweeps", self.sweeps.is_empty())]
        {
            if empty {
                let what = format!("there are no {list}");
                return Err(self.error(list, what, format!("give at least one [[{list}]]")));
            }
        }
        let unknown = |scene: &PathBuf| scene.is_relative() && shipped::named(scene, &[]).is_none();
        if let Some(scene) = self.scene().filter(unknown) {
            let file = self.origin.folder().join(scene);
            let what = format!(
                "`case.scene`: there is no file {}, and no shipped case of this name",
                file.display()
            );
            let help = format!("give the path of a scene, relative to the study, or {}", shipped::one_of());
            return Err(self.error("case.scene", what, help));
        }
        self.quantities.iter().enumerate().try_for_each(|(k, quantity)| {
            quantity.scale.map_or(Ok(()), |scale| positive(&format!("quantities[{k}].scale"), scale))?;
            self.check_quantity(k, quantity)
        })?;
        self.sweeps.iter().enumerate().try_for_each(|(k, sweep)| self.check_sweep(k, sweep))
    }

    fn check_quantity(&self, k: usize, quantity: &Quantity) -> Result<()> {
        let at = |key: &str| format!("quantities[{k}]{key}");
        let name = &quantity.name;
        if self.quantities[..k].iter().any(|other| other.name == *name) {
            return Err(self.error(
                &at(".name"),
                format!("`{name}`: a second quantity of this name"),
                "names differ",
            ));
        }
        let problem = matches!(self.case, Case::Problem(_));
        if problem != matches!(quantity.of, Of::Error(_)) {
            let help = if problem {
                "a problem knows its errors: `of = {error = \"NAME\"}`"
            } else {
                "a scene has series, summary, grain and field"
            };
            return Err(self.error(&at(".of"), format!("`{name}`: the case has no such quantity"), help));
        }
        let times = quantity.at.len().max(1);
        if matches!(quantity.of, Of::Field(_) | Of::Error(_)) && (times > 1 || quantity.exact.is_some()) {
            let what = format!("`{name}` is looked at once, at the end, and compared as a whole");
            return Err(self.error(&at(".of"), what, "leave out `at` and `exact`"));
        }
        if let Some(time) = quantity.at.iter().find(|time| **time < 0.0) {
            return Err(self.error(
                &at(".at"),
                format!("`{name}`: the time {time} is below 0"),
                "times start at 0",
            ));
        }
        match (&quantity.exact, &self.reference) {
            (Some(exact), _) if exact.len() != times => {
                let what = format!("`{name}`: {} known values for {times} times", exact.len());
                Err(self.error(&at(".exact"), what, "give one value per time of `at`"))
            }
            (Some(exact), _) if quantity.scale.is_none() && exact.iter().all(|value| *value == 0.0) => {
                let what = format!("`{name}`: an error cannot be divided by a known value of 0");
                Err(self.error(&at(".exact"), what, "give `scale`, what it is divided by"))
            }
            (None, Reference::Exact) if !problem => {
                let what = format!("`{name}` has no known values, and the reference is `exact`");
                Err(self.error(&at(".name"), what, "give `exact = [..]`, or another `reference`"))
            }
            (Some(_), Reference::None) => {
                let what = format!("`{name}` has known values, and results are compared with nothing");
                Err(self.error(&at(".exact"), what, "leave out `exact`, or give `reference = \"exact\"`"))
            }
            (None, Reference::None) if matches!(quantity.of, Of::Field(_)) => {
                let what = format!("`{name}`: a field is no number of a table");
                Err(self.error(&at(".of"), what, "a table has series, summary and grain"))
            }
            (None, Reference::Finest | Reference::Run(_) | Reference::None) if problem => {
                let what = "a problem knows its errors";
                Err(self.error("reference", what, "use `reference = \"exact\"`"))
            }
            _ => Ok(()),
        }
    }

    fn check_sweep(&self, k: usize, sweep: &Sweep) -> Result<()> {
        let at = |key: &str| format!("sweeps[{k}].{key}");
        let varied = leaves(&sweep.vary);
        for (key, values) in &varied {
            if values.as_array().is_none_or(|values| values.is_empty()) {
                let path = at(&format!("vary.{key}"));
                let what = format!("`{path} = {values}` is no list of values");
                return Err(self.error(&path, what, "give a list: `key = [1, 2, 4]`"));
            }
        }
        let keys = |table: &Table| leaves(table).into_iter().map(|(key, _)| key).collect::<Vec<_>>();
        let together = sweep.points.first().map(keys).unwrap_or_default();
        for (i, point) in sweep.points.iter().enumerate() {
            let path = at(&format!("points[{i}]"));
            if keys(point) != together || together.is_empty() {
                let what = format!("`{path}` has the keys {}", keys(point).join(", "));
                let help = format!("all points of a sweep have the same keys, here {}", together.join(", "));
                return Err(self.error(&path, what, help));
            }
            if let Some(key) = together.iter().find(|key| varied.iter().any(|(other, _)| other == *key)) {
                let what = format!("`{path}.{key}` is in `vary` too");
                return Err(self.error(&format!("{path}.{key}"), what, "a key is in one of them"));
            }
        }
        let known =
            || varied.iter().map(|(key, _)| key).chain(&together).map(String::as_str).collect::<Vec<_>>();
        if known().is_empty() {
            let what = format!("`sweeps[{k}]` varies nothing");
            return Err(self.error(&format!("sweeps[{k}]"), what, "give `vary` or `points`"));
        }
        let Some(refine) = &sweep.refine else {
            if matches!(self.reference, Reference::None) {
                return Ok(());
            }
            let what = format!("`sweeps[{k}]` has no `refine`");
            let help = format!("say along which key an error is drawn, one of {}", known().join(", "));
            return Err(self.error(&format!("sweeps[{k}]"), what, help));
        };
        if !known().contains(&refine.as_str()) {
            let what = format!("`{} = \"{refine}\"` is not varied", at("refine"));
            let help = format!("use one of {}", known().join(", "));
            return Err(self.error(&at("refine"), what, help));
        }
        for (path, value) in sweep.values_of(refine) {
            if number(&value).is_none_or(|number| number <= 0.0) {
                let what = format!("`{refine} = {value}`: what is refined has numbers above 0");
                return Err(self.error(&at(&path), what, "give a number above 0, or refine another key"));
            }
        }
        Ok(())
    }
}

impl Sweep {
    /// The values that a key is given, with their places in the sweep.
    pub fn values_of(&self, key: &str) -> Vec<(String, Value)> {
        let varied = leaves(&self.vary).into_iter().filter(|(one, _)| one == key).flat_map(|(_, list)| {
            let list = list.as_array().cloned().unwrap_or_default();
            list.into_iter().enumerate().map(|(i, value)| (format!("vary.{key}[{i}]"), value))
        });
        let points = self.points.iter().enumerate().flat_map(|(i, point)| {
            let own = leaves(point).into_iter().filter(|(one, _)| one == key);
            own.map(move |(_, value)| (format!("points[{i}].{key}"), value))
        });
        varied.chain(points).collect()
    }
}

/// A value as a number; of a list, such as that of the squares along x and y, the first.
pub fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(whole) => Some(*whole as f64),
        Value::Float(number) => Some(*number),
        Value::Array(list) => list.first().and_then(number),
        _ => None,
    }
}
