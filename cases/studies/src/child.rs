//! Runs as processes: started one after the other, repeated, timed.

use super::file::Clock;
use super::measure::{Answer, Measured, Task};
use nix::sys::resource::UsageWho;
use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;
use std::io::{Read, Write};
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tracing::warn;
use voidage_campaign::clock::{Cost, cpu, median};
use voidage_coupling::{Error, Result};
use voidage_remote::launch::this_program;

/// A run and its repetitions; times are medians.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timed {
    /// What it gave.
    pub measured: Measured,
    /// From the start to the last step, s.
    pub wall_s: f64,
    /// Of all processes on all cores, start and end of the programs included, s.
    pub cpu_s: f64,
    /// Largest less smallest of the repetitions over the median, in the time that errors are drawn against.
    pub spread: f64,
    /// Repetitions.
    pub repeats: usize,
}

/// How a run ended.
pub enum Ended {
    /// It went to its end.
    Done(Box<Timed>),
    /// It failed: why.
    Failed(String),
    /// A quantity of the study is not there: number, message and help.
    Wrong(usize, String, String),
    /// Somebody wants this to stop.
    Interrupted,
}

/// Runs a task so many times.
///
/// # Errors
/// The process cannot be started.
pub fn run(task: &Task, repeats: usize, clock: Clock, interrupted: &AtomicBool) -> Result<Ended> {
    let mut all: Vec<(Measured, f64)> = Vec::new();
    for _ in 0..repeats {
        let before = cpu(UsageWho::RUSAGE_CHILDREN);
        let answer = once(task, interrupted)?;
        let spent = cpu(UsageWho::RUSAGE_CHILDREN) - before;
        match answer {
            None => return Ok(Ended::Interrupted),
            Some(Answer::Failed(why)) => return Ok(Ended::Failed(why)),
            Some(Answer::Wrong { quantity, message, help }) => {
                return Ok(Ended::Wrong(quantity, message, help));
            }
            Some(Answer::Done(measured)) => all.push((measured, spent)),
        }
    }
    if all.iter().any(|(measured, _)| measured.values != all[0].0.values) {
        warn!("a repetition gave other values: the solver is not the same every time");
    }
    let of = |value: &dyn Fn(&(Measured, f64)) -> f64| all.iter().map(value).collect::<Vec<f64>>();
    let each = |value: &dyn Fn(&Cost) -> f64| of(&|(measured, _)| value(&measured.cost));
    let wall = each(&|cost| cost.setup_s + cost.steps_s);
    let steps = each(&|cost| cost.steps_s);
    let steps_cpu = each(&|cost| cost.steps_cpu_s);
    let drawn = match clock {
        Clock::Wall => &wall,
        Clock::Steps => &steps,
        Clock::Cpu => &steps_cpu,
    };
    let (low, high) = drawn.iter().fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), v| (l.min(*v), h.max(*v)));
    let phase = |name: &String| median(&each(&|cost| cost.phases.get(name).copied().unwrap_or(0.0)));
    let mut measured = all[0].0.clone();
    let cost = &mut measured.cost;
    cost.phases = cost.phases.keys().map(|name| (name.clone(), phase(name))).collect();
    cost.setup_s = median(&each(&|cost| cost.setup_s));
    (cost.steps_s, cost.steps_cpu_s) = (median(&steps), median(&steps_cpu));
    Ok(Ended::Done(Box::new(Timed {
        measured,
        wall_s: median(&wall),
        cpu_s: median(&of(&|(_, spent)| *spent)),
        spread: (high - low) / median(drawn).max(1e-300),
        repeats,
    })))
}

/// One process; none if it was interrupted.
fn once(task: &Task, interrupted: &AtomicBool) -> Result<Option<Answer>> {
    let cannot =
        |error: &dyn std::fmt::Display| Error::run(format!("cannot run a process of this program: {error}"));
    let mut command = this_program().map_err(|error| cannot(&error))?;
    command.arg("measure").stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // Ctrl-C is for the study, which then ends the run.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn().map_err(|error| cannot(&error))?;
    let text = serde_json::to_string(task).map_err(|error| cannot(&error))?;
    // Kept open until the run has ended: a run whose study is gone ends too. One that has ended says why on its own.
    let mut pipe = child.stdin.take();
    let _ = pipe.as_mut().map(|pipe| writeln!(pipe, "{text}").and_then(|()| pipe.flush()));
    let (answer, said) = (drain(child.stdout.take()), drain(child.stderr.take()));
    while child.try_wait().map_err(|error| cannot(&error))?.is_none() {
        if interrupted.load(Ordering::Relaxed) {
            end(&mut child);
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let (answer, said) = (answer.join().unwrap_or_default(), said.join().unwrap_or_default());
    Ok(Some(serde_json::from_str(&answer).unwrap_or_else(|_| {
        let status = child.wait().map_or("no status".into(), |status| status.to_string());
        let last = said.lines().last().unwrap_or("it said nothing").to_owned();
        Answer::Failed(format!("the process ended ({status}): {last}"))
    })))
}

/// All that comes through a pipe, read beside so that the process never waits.
fn drain<R: Read + Send + 'static>(pipe: Option<R>) -> std::thread::JoinHandle<String> {
    std::thread::spawn(move || {
        let mut text = String::new();
        // What cannot be read is missing from the answer, which then says so.
        let _ = pipe.map(|mut pipe| pipe.read_to_string(&mut text));
        text
    })
}

/// Ends a run with all that it started in its group. Both only fail if it has ended after all.
fn end(child: &mut Child) {
    let _ = killpg(Pid::from_raw(child.id() as i32), Signal::SIGKILL);
    let _ = child.wait();
}
