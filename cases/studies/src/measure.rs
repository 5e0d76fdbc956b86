//! One run, in a process of its own: `voidage measure` reads what is to be run from standard input and writes what it
//! found to standard output. A process of its own keeps times clean: nothing is warm, nothing else is in memory, and
//! the system counts what it and its fluid solver used.

use super::file::{Case, FieldName, GrainColumn, Of, Quantity};
use super::plan::{Run, THREADS, read_scene};
use super::problems;
use nix::sys::resource::UsageWho;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;
use toml::Value;
use voidage_campaign::clock::{Cost, Spent, cpu, timed};
use voidage_campaign::process::{host, start_threads};
use voidage_coupling::{Error, Notice, Result, TEMPERATURE};
use voidage_scene::Simulation;
use voidage_scene::recorder::{Summary, View, create_folder, readings};
use voidage_scene::{Output, Time};

/// What is to be run, and where files go.
#[derive(Debug, Serialize, Deserialize)]
pub struct Task {
    /// The run.
    pub run: Run,
    /// File for the nodal fields at the end, if any are looked at.
    pub fields: PathBuf,
    /// File for the output of a fluid solver in a process of its own.
    pub log: PathBuf,
}

/// What came of it.
#[derive(Debug, Serialize, Deserialize)]
pub enum Answer {
    /// It went to its end.
    Done(Measured),
    /// It failed: why.
    Failed(String),
    /// The study asks for a quantity that is not there.
    Wrong {
        /// Number of the quantity.
        quantity: usize,
        /// What is wrong.
        message: String,
        /// What is allowed.
        help: String,
    },
}

/// What a run gave.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Values of each quantity, one per time; none of a field, which is in its file.
    pub values: Vec<Vec<f64>>,
    /// What it took.
    #[serde(flatten)]
    pub cost: Cost,
}

/// Runs what standard input says.
///
/// # Errors
/// Standard input is no task. A run that fails is an answer.
pub fn measure() -> Result<u8> {
    let mut text = String::new();
    let broken = |error: &dyn std::fmt::Display| {
        Error::input(Notice::new(format!("measure: {error}"), "for `voidage study` only"))
    };
    std::io::stdin().read_line(&mut text).map_err(|error| broken(&error))?;
    let task: Task = serde_json::from_str(&text).map_err(|error| broken(&error))?;
    // The study holds the pipe as long as it lives: when it is gone, nobody waits for the answer.
    std::thread::spawn(|| {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        std::process::exit(1);
    });
    let answer = perform(&task).unwrap_or_else(|error| Answer::Failed(error.to_string()));
    let text = serde_json::to_string(&answer).map_err(|error| broken(&error))?;
    std::io::stdout().write_all(text.as_bytes()).map_err(|error| broken(&error))?;
    Ok(0)
}

fn perform(task: &Task) -> Result<Answer> {
    let run = &task.run;
    let threads = run.settings.get(THREADS).and_then(Value::as_integer);
    start_threads(threads.map(|threads| threads as usize))?;
    let answer = match &run.case {
        Case::Scene(file) => of_scene(file, task)?,
        Case::Problem(name) => {
            let problem =
                problems::build(*name, &run.settings).map_err(|fault| Error::input(fault.notice.what))?;
            let solved = problem.solve()?;
            let value = |quantity: &Quantity| match &quantity.of {
                Of::Error(name) => vec![solved.errors.get(name).copied().unwrap_or(f64::NAN)],
                _ => vec![f64::NAN],
            };
            Answer::Done(Measured { values: run.quantities.iter().map(value).collect(), cost: solved.cost })
        }
    };
    let Answer::Done(measured) = &answer else { return Ok(answer) };
    let names = run.quantities.iter().zip(&measured.values);
    let wild =
        names.filter(|(_, values)| values.iter().any(|value| !value.is_finite())).map(|(q, _)| &q.name);
    match wild.collect::<Vec<_>>().as_slice() {
        [] => Ok(answer),
        [name, ..] => Ok(Answer::Failed(format!("`{name}` is no number: the run has gone wild"))),
    }
}

/// A quantity at a step: by number, with the weight that it has in the value of a time, by number.
type Sample = (usize, usize, f64);

/// The steps at which quantities are looked at: a time between two steps is interpolated.
fn samples(quantities: &[Quantity], clock: &Time) -> BTreeMap<u64, Vec<Sample>> {
    let last = clock.steps();
    let mut all: BTreeMap<u64, Vec<Sample>> = BTreeMap::new();
    for (q, quantity) in quantities.iter().enumerate() {
        if quantity.at.is_empty() {
            all.entry(last).or_default().push((q, 0, 1.0));
        }
        for (t, time) in quantity.at.iter().enumerate() {
            let before = ((time / clock.step) as u64).min(last);
            let steps = before as f64 + (time - clock.after(before)) / clock.length(before);
            let steps = steps.min(last as f64);
            // A time that is a step but for rounding is that step.
            let steps = if (steps - steps.round()).abs() < 1e-6 { steps.round() } else { steps };
            let (before, share) = (steps.floor() as u64, steps.fract());
            all.entry(before).or_default().push((q, t, 1.0 - share));
            if share > 0.0 {
                all.entry(before + 1).or_default().push((q, t, share));
            }
        }
    }
    all
}

fn of_scene(file: &Path, task: &Task) -> Result<Answer> {
    let begun = Instant::now();
    let quantities = &task.run.quantities;
    let scene = read_scene(file, &task.run.settings)?;
    let mut simulation = Simulation::hosted(&scene, &host(task.log.clone()))?;
    let mut measured = Measured {
        values: quantities.iter().map(|quantity| vec![0.0; quantity.at.len().max(1)]).collect(),
        cost: Cost { setup_s: begun.elapsed().as_secs_f64(), ..Cost::default() },
    };
    let (last, mut spent) = (scene.time.steps(), Spent::default());
    let due = samples(quantities, &scene.time);
    // The first step shows whether all quantities are there, before time is spent on the others.
    for step in 0..=last {
        if step > 0 {
            timed(&mut spent, || simulation.step())?;
        }
        let samples = due.get(&step);
        if samples.is_none() && step != 1 {
            continue;
        }
        simulation.refresh()?;
        let mut summary = Summary::default();
        simulation.sum_up(&mut summary);
        let at = Moment {
            time: simulation.time(),
            output: &scene.output,
            view: simulation.view(),
            summary,
            simulation: &simulation,
        };
        let asked: BTreeSet<usize> = match step {
            1 => (0..quantities.len()).collect(),
            _ => samples.into_iter().flatten().map(|sample| sample.0).collect(),
        };
        for quantity in asked {
            let value = match at.value(&quantities[quantity].of) {
                Ok(value) => value,
                Err((message, help)) => return Ok(Answer::Wrong { quantity, message, help }),
            };
            for (_, time, weight) in samples.into_iter().flatten().filter(|sample| sample.0 == quantity) {
                measured.values[quantity][*time] += weight * value;
            }
        }
    }
    if let Some(fluid) =
        simulation.view().fluid.filter(|_| quantities.iter().any(|q| matches!(q.of, Of::Field(_))))
    {
        task.fields.parent().map_or(Ok(()), create_folder)?;
        fluid.write(&task.fields, None)?;
    }
    let totals = simulation.totals();
    let cost = &mut measured.cost;
    cost.steps = last;
    cost.fluid_solves = totals.fluid_solves.or(simulation.coupled().fluid().map(|_| last));
    cost.unconverged_steps = totals.unconverged.steps;
    cost.phases = totals.phases.named().map(|(name, seconds)| (name.to_owned(), seconds)).into();
    // A solver in another process ends with the simulation.
    drop(simulation);
    cost.steps_s = spent.wall;
    cost.steps_cpu_s = spent.cpu + cpu(UsageWho::RUSAGE_CHILDREN);
    Ok(Answer::Done(measured))
}

/// Numbers of a summary that are of the program `voidage run` and not of the simulation.
const OF_PROGRAM: [&str; 3] = ["threads", "wall_s", "steps_of_this_process"];

/// A run at a step.
struct Moment<'a> {
    time: f64,
    output: &'a Output,
    view: View<'a, 2>,
    summary: Summary,
    simulation: &'a Simulation,
}

impl Moment<'_> {
    /// The value of a quantity; a field is only looked for. The error says what is wrong and what is there.
    fn value(&self, of: &Of) -> Result<f64, (String, String)> {
        match of {
            Of::Series(column) => {
                let row = readings(self.output, self.time, &self.view, &self.simulation.readings());
                let found = row.iter().find(|(name, _)| name == column).map(|(_, value)| *value);
                found.ok_or_else(|| {
                    let known: Vec<&str> = row.iter().map(|(name, _)| name.as_ref()).collect();
                    (
                        format!("`of.series = \"{column}\"`: the run has no such column"),
                        format!("use one of {}", known.join(", ")),
                    )
                })
            }
            Of::Summary(key) => {
                let all = serde_json::to_value(&self.summary).unwrap_or_default();
                let known = all
                    .as_object()
                    .into_iter()
                    .flatten()
                    .filter(|(key, value)| value.is_number() && !OF_PROGRAM.contains(&key.as_str()));
                let known: Vec<&str> = known.map(|(key, _)| key.as_str()).collect();
                let found = known.contains(&key.as_str()).then(|| all[key].as_f64()).flatten();
                found.ok_or_else(|| {
                    (
                        format!("`of.summary = \"{key}\"`: the summary has no such number"),
                        format!("use one of {}", known.join(", ")),
                    )
                })
            }
            Of::Grain(grain) => self.of_grain(grain.number, grain.column, grain.axis),
            Of::Field(field) => {
                let fluid = self.view.fluid;
                let there = fluid.is_some_and(|fluid| match field {
                    FieldName::Velocity | FieldName::Pressure => true,
                    FieldName::Temperature => fluid.scalar(TEMPERATURE).is_some(),
                    FieldName::Voidage => fluid.voidage.is_some(),
                });
                let what = format!("`of.field`: the scene has no {}", format!("{field:?}").to_lowercase());
                there.then_some(0.0).ok_or_else(|| (what, "use a field that the scene has".into()))
            }
            Of::Error(_) => Ok(f64::NAN),
        }
    }

    fn of_grain(&self, number: usize, column: GrainColumn, axis: usize) -> Result<f64, (String, String)> {
        let wrong = |what: String, help: &str| Err((format!("`of.grain`: {what}"), help.to_owned()));
        let place = |id: &[u32]| id.iter().position(|id| *id as usize == number);
        let Some((grains, k)) = self.view.grains.and_then(|grains| Some((grains, place(grains.id)?))) else {
            let count = self.view.grains.map_or(0, |grains| grains.position.len());
            return wrong(
                format!("there is no grain {number}"),
                &format!("there are {count}, numbered from 0; those that have left are gone"),
            );
        };
        let vector = match column {
            GrainColumn::Position => &grains.position[k],
            GrainColumn::Velocity => &grains.velocity[k],
            GrainColumn::Temperature => {
                let found = grains.temperature.map(|all| all[k]);
                return found.map_or_else(
                    || wrong("grains have no temperature".into(), "use position or velocity"),
                    Ok,
                );
            }
        };
        vector
            .get(axis)
            .map_or_else(|| wrong(format!("there is no axis {axis}"), "use 0 or 1"), |value| Ok(*value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A time between two steps has both with their shares, a step but for rounding only itself, no time the last step.
    #[test]
    fn values_are_interpolated_between_steps() {
        let quantity = |at: &[f64]| Quantity {
            name: String::new(),
            of: Of::Series(String::new()),
            at: at.to_vec(),
            exact: None,
            scale: None,
        };
        let due = samples(&[quantity(&[0.025, 0.3]), quantity(&[])], &Time { step: 0.1, end: 0.4 });
        assert_eq!(due.keys().copied().collect::<Vec<_>>(), [0, 1, 3, 4]);
        let weight = |step: u64| due[&step].iter().map(|sample| sample.2).sum::<f64>();
        assert!((weight(0) - 0.75).abs() < 1e-12 && (weight(1) - 0.25).abs() < 1e-12);
        assert_eq!(
            (due[&3].as_slice(), due[&4].as_slice()),
            ([(0, 1, 1.0)].as_slice(), [(1, 0, 1.0)].as_slice())
        );
    }
}
