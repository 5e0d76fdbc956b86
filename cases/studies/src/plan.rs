//! What a study runs: its sweeps written out, checked, identified and put in the order of estimated cost.

use super::cost;
use super::file::{Case, Of, Quantity, Reference, Study, Sweep, leaves, number};
use super::problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use toml::{Table, Value};
use voidage_campaign::shipped;
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::scheme::own::Own;
use voidage_coupling::{Error, Result};
use voidage_scene::{Location, Scene};

/// Keys with their values.
pub type Settings = BTreeMap<String, Value>;
/// The key that is none of the scene: how many threads a run has.
pub const THREADS: &str = "threads";

/// One run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Run {
    /// What tells it from all others: a hash of what it is, how it is set, what is looked at, and the version of the
    /// program.
    pub id: String,
    /// Its settings.
    pub settings: Settings,
    /// The scene file, or the problem.
    pub case: Case,
    /// What is looked at.
    pub quantities: Vec<Quantity>,
    /// Estimated cost, in units of its own.
    pub cost: f64,
}

/// Runs that differ in one key.
#[derive(Clone, Debug)]
pub struct Curve {
    /// What tells it from the others.
    pub name: String,
    /// The key that is refined; none of a table.
    pub refine: Option<String>,
    /// What its axis says.
    pub label: String,
    /// Value of that key, or the number of the point, and number of the run; from cheap to dear where a key is refined.
    pub points: Vec<(f64, usize)>,
}

/// All that a study runs.
#[derive(Debug)]
pub struct Plan {
    /// The runs, from cheap to dear.
    pub runs: Vec<Run>,
    /// The curves.
    pub curves: Vec<Curve>,
    /// The run that the others are compared with; none where values are known.
    pub reference: Option<usize>,
}

/// A combination of settings, before it is checked.
struct Choice {
    settings: Settings,
    /// Where in the study a key is: sweep, if any.
    sweep: Option<usize>,
}

/// How a study is changed from the command line.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changes {
    /// The quick form.
    pub quick: bool,
    /// Threads of each run, unless they are varied.
    pub threads: Option<usize>,
}

impl Plan {
    /// Writes a study out.
    ///
    /// # Errors
    /// A setting that the case does not take.
    pub fn new(study: &Study, changes: Changes) -> Result<Self> {
        let mut plan = Plan { runs: Vec::new(), curves: Vec::new(), reference: None };
        for (k, sweep) in study.sweeps.iter().enumerate() {
            for (name, combinations) in combinations(sweep) {
                let mut points = Vec::new();
                for (i, varied) in combinations.into_iter().enumerate() {
                    let x = match &sweep.refine {
                        Some(key) => varied.get(key).and_then(number).unwrap_or(f64::NAN),
                        None => i as f64,
                    };
                    let tables = [&study.set, &sweep.set];
                    let settings = settings(study, &tables, varied, changes);
                    points.push((x, run(study, Choice { settings, sweep: Some(k) })?));
                }
                if sweep.refine.is_some() || changes.quick {
                    points.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
                }
                if changes.quick {
                    points.truncate(study.quick.runs);
                }
                let points = points.into_iter().map(|(x, run)| (x, plan.add(run))).collect();
                let label = sweep.label.clone().or_else(|| sweep.refine.clone()).unwrap_or_default();
                plan.curves.push(Curve { name, refine: sweep.refine.clone(), label, points });
            }
        }
        match &study.reference {
            Reference::Exact | Reference::None => {}
            Reference::Finest => plan.reference = Some(plan.finest(study)?),
            Reference::Run(own) => {
                let settings = settings(study, &[&study.set, own], Settings::new(), changes);
                plan.reference = Some(plan.add(run(study, Choice { settings, sweep: None })?));
            }
        }
        Ok(plan.sorted())
    }

    /// The number of the run that is estimated to take longest.
    ///
    /// # Errors
    /// There are several.
    fn finest(&self, study: &Study) -> Result<usize> {
        let most = self.runs.iter().fold(0.0, |most: f64, run| most.max(run.cost));
        let dearest = (0..self.runs.len()).filter(|k| self.runs[*k].cost >= most * (1.0 - 1e-9));
        let dearest: Vec<usize> = dearest.collect();
        match dearest.as_slice() {
            [one] => Ok(*one),
            several => {
                let all = several.iter().map(|k| short(&self.runs[*k].settings)).collect::<Vec<_>>();
                let what = format!("{} runs are estimated to take as long: {}", all.len(), all.join("; "));
                let help =
                    "say which is the reference: `reference = { run = { .. } }`, with settings of its own";
                Err(study.error("reference", what, help))
            }
        }
    }

    /// The number of a run, which is added unless it is there.
    fn add(&mut self, run: Run) -> usize {
        self.runs.iter().position(|other| other.id == run.id).unwrap_or_else(|| {
            self.runs.push(run);
            self.runs.len() - 1
        })
    }

    /// The same with the runs in the order of their cost.
    fn sorted(mut self) -> Self {
        let mut order: Vec<usize> = (0..self.runs.len()).collect();
        order.sort_by(|a, b| self.runs[*a].cost.total_cmp(&self.runs[*b].cost));
        let place = |old: usize| order.iter().position(|k| *k == old).unwrap_or(old);
        self.curves.iter_mut().flat_map(|curve| &mut curve.points).for_each(|(_, run)| *run = place(*run));
        self.reference = self.reference.map(place);
        self.runs = order.iter().map(|k| self.runs[*k].clone()).collect();
        self
    }
}

/// The curves of a sweep: names, and the settings of their points.
fn combinations(sweep: &Sweep) -> Vec<(String, Vec<Settings>)> {
    let named = |settings: Settings| {
        let short = |(key, value): (&String, &Value)| match value {
            Value::String(text) => text.clone(),
            other => format!("{} {}", key.rsplit('.').next().unwrap_or(key), shown(other)),
        };
        (settings.iter().map(short).collect::<Vec<_>>().join(" "), settings)
    };
    let mut choices: Vec<Vec<(String, Settings)>> = leaves(&sweep.vary)
        .into_iter()
        .map(|(key, list)| {
            let list = list.as_array().cloned().unwrap_or_default();
            list.into_iter().map(|value| named(Settings::from([(key.clone(), value)]))).collect()
        })
        .collect();
    if !sweep.points.is_empty() {
        choices.push(sweep.points.iter().map(|point| named(leaves(point).into_iter().collect())).collect());
    }
    let along = |list: &Vec<(String, Settings)>| {
        sweep.refine.as_ref().is_none_or(|key| list.first().is_some_and(|(_, first)| first.contains_key(key)))
    };
    let (refined, others): (Vec<_>, Vec<_>) = choices.into_iter().partition(along);
    let with = |all: Vec<(String, Settings)>, list: &Vec<(String, Settings)>| {
        let one = |(name, settings): &(String, Settings), (own, value): &(String, Settings)| {
            let several = list.len() > 1;
            let comma = if name.is_empty() || !several { "" } else { ", " };
            let settings = settings.clone().into_iter().chain(value.clone()).collect();
            (format!("{name}{comma}{}", if several { own } else { "" }), settings)
        };
        all.iter().flat_map(|have| list.iter().map(move |add| one(have, add))).collect::<Vec<_>>()
    };
    let curves = others.iter().fold(vec![(sweep.name.clone(), Settings::new())], with);
    let points = refined.iter().fold(vec![(String::new(), Settings::new())], with);
    let curve = |(name, settings): (String, Settings)| {
        let points = points.iter().map(|(_, own)| settings.clone().into_iter().chain(own.clone()).collect());
        (name, points.collect())
    };
    curves.into_iter().map(curve).collect()
}

/// All settings of a run: those of the study, of the sweep, what is varied, and what the command line changes.
fn settings(study: &Study, tables: &[&Table], varied: Settings, changes: Changes) -> Settings {
    let mut all: Settings = tables.iter().flat_map(|table| leaves(table)).collect();
    all.insert(THREADS.into(), all.get(THREADS).cloned().unwrap_or(Value::Integer(1)));
    if let Some(threads) = changes.threads {
        all.insert(THREADS.into(), Value::Integer(threads as i64));
    }
    all.extend(varied);
    if changes.quick {
        all.extend(leaves(&study.quick.set));
    }
    // A scheme of one's own is beside the study.
    for value in all.values_mut() {
        if let Some(own) = value.as_str().and_then(Own::named) {
            *value = Value::String(own.within(&study.folder()).name().to_owned());
        }
    }
    all
}

/// A run, checked.
fn run(study: &Study, choice: Choice) -> Result<Run> {
    let settings = &choice.settings;
    let threads = settings.get(THREADS).and_then(Value::as_integer).unwrap_or(0);
    if threads < 1 {
        let path = place(study, &choice, THREADS);
        let what = format!("`threads = {}`", settings[THREADS]);
        return Err(study.error(&path, what, "give a whole number, 1 or more"));
    }
    let mut hash = blake3::Hasher::new();
    let mut identify = |part: &str| {
        hash.update(part.as_bytes()).update(b"\n");
    };
    identify(env!("CARGO_PKG_VERSION"));
    settings.iter().for_each(|(key, value)| identify(&format!("{key}={value}")));
    // Not their names, known values and scales, which change no run.
    for quantity in &study.quantities {
        identify(&format!("{:?} {:?}", quantity.of, quantity.at));
    }
    let (cost, case) = match (&study.case, study.scene()) {
        (Case::Problem(name), _) => {
            let fault = |fault: voidage_scene::document::Fault| {
                study.error(&place(study, &choice, &fault.path), fault.notice.what, fault.notice.help)
            };
            let problem = problems::build(*name, settings).map_err(fault)?;
            problem.check().map_err(fault)?;
            check_errors(study, problem.errors())?;
            identify(&name.to_string());
            (problem.cost(), study.case.clone())
        }
        (case @ Case::Scene(_), None) => (0.0, case.clone()),
        (Case::Scene(_), Some(name)) => {
            let scene = read_scene(&name, settings).map_err(|error| blame(study, &choice, error))?;
            check_times(study, &scene)?;
            identify(&scene.identity_toml()?);
            if let Some(SchemeName::Own(own)) = scene.coupling.as_ref().map(|coupling| coupling.scheme) {
                identify(&std::fs::read_to_string(own.place().0).unwrap_or_default());
            }
            (cost::of_scene(&scene), Case::Scene(name))
        }
    };
    let id = hash.finalize().to_hex()[..16].to_owned();
    Ok(Run { id, settings: choice.settings, case, quantities: study.quantities.clone(), cost })
}

/// The scene of a run: a file by its whole path, or a shipped case.
///
/// # Errors
/// What is wrong with the scene.
pub fn read_scene(name: &Path, settings: &Settings) -> Result<Scene> {
    let own = settings.iter().filter(|(key, _)| *key != THREADS);
    let sets: Vec<String> = own.map(|(key, value)| format!("{key}={value}")).collect();
    let shipped = if name.is_absolute() { None } else { shipped::named(name, &sets) };
    shipped.unwrap_or_else(|| Scene::read(name, &sets))
}

/// Where in the study a setting is.
fn place(study: &Study, choice: &Choice, key: &str) -> String {
    let value = choice.settings.get(key);
    let sweep = choice.sweep.map(|k| (k, &study.sweeps[k]));
    if let Some((k, sweep)) = sweep {
        let given = sweep.values_of(key);
        let own = given.iter().find(|(_, one)| Some(one) == value).or(given.first());
        if let Some((path, _)) = own {
            return format!("sweeps[{k}].{path}");
        }
    }
    let mut tables = vec![("quick.set".to_owned(), &study.quick.set)];
    tables.extend(sweep.map(|(k, sweep)| (format!("sweeps[{k}].set"), &sweep.set)));
    if let (Reference::Run(own), None) = (&study.reference, sweep) {
        tables.push(("reference.run".into(), own));
    }
    tables.push(("set".into(), &study.set));
    let holds = |table: &Table| leaves(table).iter().any(|(one, _)| one == key);
    let found = tables.iter().find(|(_, table)| holds(table));
    found.map_or("case".into(), |(path, _)| format!("{path}.{key}"))
}

/// An error of the scene that a setting of the study made is one of the study.
fn blame(study: &Study, choice: &Choice, error: Error) -> Error {
    if let Error::Scene(scene) = &error
        && let Location::Set(option) = &scene.location
        && let Some((key, _)) = option.split_once('=')
    {
        let what = format!("{}: {option}: {}", scene.file.display(), scene.notice.what);
        return study.error(&place(study, choice, key), what, scene.notice.help.clone());
    }
    error
}

fn check_times(study: &Study, scene: &Scene) -> Result<()> {
    let end = scene.time.end;
    for (k, quantity) in study.quantities.iter().enumerate() {
        if let Some((i, late)) = quantity.at.iter().enumerate().find(|(_, time)| **time > end * (1.0 + 1e-9))
        {
            let what = format!("`{}`: the time {late} s is after the end of a run, {end} s", quantity.name);
            return Err(study.error(
                &format!("quantities[{k}].at[{i}]"),
                what,
                "change `at`, or set `time.end`",
            ));
        }
    }
    Ok(())
}

fn check_errors(study: &Study, known: &[&str]) -> Result<()> {
    for (k, quantity) in study.quantities.iter().enumerate() {
        if let Of::Error(name) = &quantity.of
            && !known.contains(&name.as_str())
        {
            let what = format!("`of.error = \"{name}\"`: the problem knows no such error");
            return Err(study.error(
                &format!("quantities[{k}].of.error"),
                what,
                format!("use one of {}", known.join(", ")),
            ));
        }
    }
    Ok(())
}

/// Settings in one line.
pub fn short(settings: &Settings) -> String {
    settings.iter().map(|(key, value)| format!("{key}={}", shown(value))).collect::<Vec<_>>().join(" ")
}

/// A value for reading.
pub fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Float(number) => plain(*number),
        other => other.to_string(),
    }
}

/// A number for reading: with a power of ten where it is small or large.
pub fn plain(number: f64) -> String {
    match number.abs() {
        size if size != 0.0 && !(1e-2..1e5).contains(&size) => format!("{number:e}"),
        _ => number.to_string(),
    }
}

/// The scene file or the problem, for messages.
pub fn name_of(case: &Case) -> String {
    match case {
        Case::Scene(file) => file.display().to_string(),
        Case::Problem(name) => name.to_string(),
    }
}
