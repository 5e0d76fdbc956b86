//! `voidage run`: the loop around the steps.

use crate::again;
use crate::ending::{Ending, Saved};
use crate::placing;
use crate::plot;
use crate::shipped;
use clap::Args;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tracing::{info, warn};
use voidage_campaign::process::{catch_interrupts, host, start_threads};
use voidage_campaign::progress::{News, Progress, duration};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Notice, Result};
use voidage_dem::Rounded;
use voidage_remote::launch::{Host, check_door, check_ranks};
use voidage_remote::token::{TOKEN_VARIABLE, Token};
use voidage_scene::Simulation;
use voidage_scene::probes::check_probes;
use voidage_scene::recorder::{
    CHECKPOINT, Checkpoint, Earlier, OutputFolder, Recording, Stamp, Summary, readings,
};
use voidage_scene::{Change, Scene, Solver, Watch};

/// Options of `voidage run`.
#[derive(Args)]
pub struct Options {
    /// Scene file (TOML), or the name of a shipped case.
    pub scene: PathBuf,
    /// Folder of results. Default: `out/` and the name of the scene; for a restart, the folder of its checkpoint.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Change a key of the scene: `fluid.boundaries.inflow.flow.superficial_velocity=[0,1.2]` (may be repeated).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Go on from a checkpoint of this scene. With other laws, boundary conditions or other keys that the run can go on
    /// with, into another folder (--out).
    #[arg(long, value_name = "FILE")]
    restart: Option<PathBuf>,
    /// Replace the results of an earlier run in the folder.
    #[arg(long)]
    overwrite: bool,
    /// End at this time, s, with a checkpoint to go on from; `time.end` and what depends on it stay.
    #[arg(long, value_name = "S")]
    until: Option<f64>,
    /// Number of threads; results do not depend on it. Default: one per core.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Coupling scheme, instead of that of the scene: one that is shipped, or python:FILE[:CLASS].
    #[arg(long, value_parser = voidage_campaign::scheme)]
    pub scheme: Option<SchemeName>,
    /// Fluid solver, instead of that of the scene: rust; in a process of its own serve (the same), fenicsx, scikit-fem
    /// or python:MODULE; or one that is started by hand, attach:ADDRESS (shm:NAME or tcp:HOST:PORT).
    #[arg(long)]
    pub fluid: Option<String>,
    #[command(flatten)]
    pub process: Process,
    /// No progress, only warnings and results.
    #[arg(long)]
    pub quiet: bool,
}

/// Options of fluid solvers in processes of their own.
#[derive(Args)]
pub struct Process {
    /// How frames reach the process of a fluid solver.
    #[arg(long, value_parser = ["shm", "tcp"])]
    pub transport: Option<String>,
    /// Longest time without a sign of life from the process of a fluid solver, s.
    #[arg(long, value_name = "S")]
    pub timeout: Option<f64>,
    /// Number of processes among which mpirun divides the fluid solver fenicsx.
    #[arg(long, value_name = "N")]
    pub ranks: Option<usize>,
    /// What a fluid solver that is started by hand (attach:tcp:..) must greet with; other processes of this machine see
    /// arguments, but not the variable.
    #[arg(long, env = TOKEN_VARIABLE, hide_env_values = true, value_name = "WORD")]
    token: Option<String>,
}

impl Process {
    /// Where solvers are started from, with their output in a log.
    pub fn host(&self, log: PathBuf) -> Host {
        Host { token: Token::new(self.token.clone()), ..host(log) }
    }

    /// The options as changes of the scene, with the choice of a fluid solver.
    pub fn sets(&self, fluid: Option<&str>) -> Result<Vec<String>> {
        let solver = fluid.map(str::parse::<Solver>).transpose();
        let solver = solver.map_err(|error| Error::input(error.within("--fluid")))?;
        let mut sets: Vec<String> = solver.iter().map(Solver::setting).collect();
        sets.extend(self.transport.iter().map(|transport| format!("fluid.backend.transport={transport:?}")));
        sets.extend(self.timeout.map(|seconds| format!("fluid.backend.timeout={seconds:?}")));
        sets.extend(self.ranks.map(|ranks| format!("fluid.backend.ranks={ranks}")));
        Ok(sets)
    }

    /// The same for one of several solvers: what does not concern it, also in the scene, is left out.
    pub fn sets_of(&self, fluid: &str) -> Result<Vec<String>> {
        let solver: Solver = fluid.parse().map_err(|error: Notice| Error::input(error.within("--fluids")))?;
        let here = matches!(solver, Solver::Rust);
        let mut sets = if here { vec!["fluid.backend={}".to_owned()] } else { vec![] };
        let transport = self.transport.clone().filter(|_| !here && !matches!(solver, Solver::Attach(_)));
        let ranks = self.ranks.filter(|_| matches!(solver, Solver::Fenicsx));
        let own = Self { transport, timeout: self.timeout.filter(|_| !here), ranks, token: None };
        sets.extend(own.sets(Some(fluid))?);
        Ok(sets)
    }
}

/// The change of a scene that chooses a scheme.
pub fn scheme_setting(scheme: SchemeName) -> String {
    format!("coupling.scheme={:?}", scheme.name())
}

/// Runs a scene; the number is the exit code.
pub fn run(options: &Options) -> Result<u8> {
    let scene = shipped::read(&options.scene, &sets(options)?)?;
    let threads = start_threads(options.threads)?;
    let ending = Ending::watched(catch_interrupts()?);
    let run = Run::new(&scene, options, threads, ending.clone());
    if run.is_err() {
        ending.claim();
    }
    let mut run = run?;
    let outcome = run.steps(options.quiet);
    run.close(outcome)
}

/// The options as changes of the scene.
fn sets(options: &Options) -> Result<Vec<String>> {
    let mut sets = options.sets.clone();
    sets.extend(options.scheme.map(scheme_setting));
    sets.extend(options.process.sets(options.fluid.as_deref())?);
    Ok(sets)
}

/// The default folder of results: `out/bubbling-bed` for `cases/bubbling-bed/scene.toml`.
pub fn default_folder(scene: &Path) -> PathBuf {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let parent = scene.parent().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    let name = match (stem.strip_prefix("scene"), parent) {
        (Some(rest), Some(parent)) => format!("{parent}{rest}"),
        _ => stem,
    };
    Path::new("out").join(name)
}

/// How the steps of a run ended.
enum Ended {
    /// At `time.end`.
    Done,
    /// At what the scene or an option stops it by, in words.
    Stopped(String),
    /// By an interrupt.
    Interrupted,
}

/// A run in progress.
struct Run {
    simulation: Simulation,
    recording: Recording,
    stamp: Stamp,
    summary: Summary,
    /// The step of `time.end`, and the one that `--until` ends at.
    last: u64,
    until: Option<u64>,
    watch: Watch,
    ending: Ending,
    /// Checkpoints at times of the clock on the wall, for scenes that ask for none: when the last was written.
    autosave: Option<Instant>,
    /// The command line that goes on from the checkpoint.
    again: String,
    started: Instant,
    /// Wall time until the first step, s.
    setup_s: f64,
    output_s: f64,
}

/// Wall time between checkpoints where the scene does not say when to write them.
const AUTOSAVE: Duration = Duration::from_secs(60);

/// The step that ends a run with `--until`.
fn until(scene: &Scene, options: &Options, start: f64) -> Result<Option<u64>> {
    let Some(time) = options.until else { return Ok(None) };
    if time > start && time <= scene.time.end {
        return Ok(Some((time / scene.time.step * (1.0 - 1e-12)).ceil() as u64));
    }
    let what = format!("--until {time} is not between the start at {} s and time.end", Rounded(start));
    Err(Error::input(Notice::new(what, format!("give a time up to {} s", scene.time.end))))
}

/// An error of grains where the scene has put them: the input is wrong.
pub fn at_start(error: Error) -> Error {
    Error::input(error.notice())
}

/// The column that ends a run is one that it records.
pub fn check_stop(scene: &Scene, simulation: &Simulation) -> Result<()> {
    let Some(value) = scene.stop.as_ref().and_then(|stop| stop.value.as_ref()) else { return Ok(()) };
    let row = readings(&scene.output, 0.0, &simulation.view(), &simulation.readings());
    if row.iter().any(|(name, _)| *name == value.column) {
        return Ok(());
    }
    let names: Vec<&str> = row.iter().map(|(name, _)| name.as_ref()).collect();
    let what = format!("`stop.value.column = \"{}\"`: the run records no such column", value.column);
    Err(scene.error("stop.value.column", what, format!("there are: {}", names.join(", "))))
}

impl Run {
    fn new(scene: &Scene, options: &Options, threads: usize, ending: Ending) -> Result<Run> {
        let started = Instant::now();
        let hash = scene.hash()?;
        let folder = match (&options.out, &options.restart) {
            (Some(folder), _) => folder.clone(),
            (None, Some(file)) => {
                again::own_folder(file, &hash).unwrap_or_else(|| default_folder(&options.scene))
            }
            (None, None) => default_folder(&options.scene),
        };
        let host = options.process.host(folder.join("solver.log"));
        let backend = scene.fluid.as_ref().and_then(|fluid| fluid.backend.as_ref());
        backend.map_or(Ok(()), |backend| check_door(backend, &host).and_then(|()| check_ranks(backend)))?;
        let mut changes = vec![];
        let mut beds = vec![];
        let until_step;
        let (simulation, recording) = match &options.restart {
            None => {
                until_step = until(scene, options, 0.0)?;
                let earlier = if options.overwrite { Earlier::Overwrite } else { Earlier::Keep };
                let output = OutputFolder::take(&folder, earlier)?;
                let mut placing = placing::watched(Some(&folder), ending.flag(), options.quiet);
                let mut simulation = Simulation::placed(scene, &host, &mut placing)?;
                beds.append(&mut placing.beds);
                placing::unused(&placing).iter().for_each(|line| warn!("{line}"));
                simulation.refresh().map_err(at_start)?;
                let (view, readings) = (simulation.view(), simulation.readings());
                check_stop(scene, &simulation)?;
                check_probes(scene, &view)?;
                let recording = Recording::start(output, scene, &view, &readings, None)?;
                (simulation, recording)
            }
            Some(file) => {
                let checkpoint = Checkpoint::open(file)?;
                changes = scene.changes_since(&checkpoint)?;
                until_step = until(scene, options, checkpoint.stamp.time)?;
                let (output, same) = again::folder(&folder, file, &checkpoint, &changes, options.overwrite)?;
                let mut simulation = Simulation::restarted(scene, &host, &checkpoint)?;
                if simulation.steps() >= scene.time.steps() {
                    let (time, end) = (Rounded(simulation.time()), scene.time.end);
                    let what = format!("{}: is at t = {time} s, and time.end = {end} s", file.display());
                    let help = "nothing is left to do; give a later end, such as --set time.end=..";
                    return Err(Error::input(Notice::new(what, help)));
                }
                simulation.refresh()?;
                let (view, readings) = (simulation.view(), simulation.readings());
                check_stop(scene, &simulation)?;
                check_probes(scene, &view)?;
                let recording = match same {
                    true => Recording::resume(output, scene, &view, &readings, &checkpoint)?,
                    false => Recording::start(output, scene, &view, &readings, Some(&checkpoint))?,
                };
                (simulation, recording)
            }
        };
        let mut summary = Summary {
            threads,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_hash: hash.clone(),
            restarted_from: options.restart.as_ref().map(|file| file.display().to_string()),
            changes: changes.iter().map(Change::to_string).collect(),
            ..Summary::default()
        };
        simulation.sum_up(&mut summary);
        info!("{}", scene.title);
        placing::tell(&beds);
        scene.faster_than_steps().iter().for_each(|line| warn!("{line}"));
        summary.changes.iter().for_each(|change| info!("changed since the checkpoint: {change}"));
        info!(
            "{} grains, {} nodes, {} cells, {threads} threads, into {}",
            summary.grains,
            summary.nodes,
            summary.cells,
            folder.display()
        );
        let stamp = Stamp { scene_hash: hash, step: simulation.steps(), time: simulation.time() };
        let again = again::command(options, &folder);
        let autosave = scene.output.checkpoint_interval.is_none().then(Instant::now);
        let watch = Watch::new(scene.stop.as_ref(), recording.slow);
        Ok(Run {
            simulation,
            recording,
            stamp,
            summary,
            last: scene.time.steps(),
            until: until_step,
            watch,
            ending,
            autosave,
            again,
            started,
            setup_s: started.elapsed().as_secs_f64(),
            output_s: 0.0,
        })
    }

    /// Steps to the end, to what stops the run, or until interrupted.
    fn steps(&mut self, quiet: bool) -> Result<Ended> {
        let last = self.until.unwrap_or(self.last);
        let mut progress = Progress::new(self.simulation.steps(), last, quiet);
        while self.simulation.steps() < last {
            self.keep();
            if self.ending.is_asked() {
                return Ok(Ended::Interrupted);
            }
            let report = self.simulation.step()?;
            let (time, wall) = (self.simulation.time(), self.started.elapsed().as_secs_f64());
            let stopped = self.watch.after_step(time, || self.simulation.unrest(), wall);
            self.recording.slow = self.watch.slow();
            let reached = self.record()?;
            let step = self.simulation.steps();
            for remark in self.simulation.remarks() {
                warn!("step {step}: {remark}\n  (later steps of this kind are counted in summary.json)");
            }
            progress.show(step, || News {
                time: self.simulation.time(),
                grains: self.simulation.coupled().grains().map_or(0, |grains| grains.particles.len()),
                contacts: report.grains.map_or(0, |grains| grains.contacts),
                residual: report.residual(),
            });
            if let Some(why) = stopped.or(reached).filter(|_| step < self.last) {
                return Ok(Ended::Stopped(why));
            }
        }
        match self.until {
            Some(until) if until < self.last => {
                Ok(Ended::Stopped(format!("--until {}", Rounded(self.simulation.time()))))
            }
            _ => Ok(Ended::Done),
        }
    }

    /// Keeps the state for an interrupt within the next step.
    fn keep(&mut self) {
        let Run { simulation, recording, stamp, summary, ending, again, started, .. } = self;
        ending.keep(|| {
            let stamp = Stamp { step: simulation.steps(), time: simulation.time(), ..stamp.clone() };
            let mut summary = summary.clone();
            simulation.sum_up(&mut summary);
            summary.steps_of_this_process = simulation.totals().steps;
            summary.wall_s = started.elapsed().as_secs_f64();
            let (state, kept) = (simulation.last_state(), recording.kept(stamp.step));
            let folder = recording.folder().to_path_buf();
            Saved { stamp, state, kept, summary, folder, again: again.clone() }
        });
    }

    /// Writes what is due; why the run ends, if a row of the series says so.
    fn record(&mut self) -> Result<Option<String>> {
        let start = Instant::now();
        let (step, time) = (self.simulation.steps(), self.simulation.time());
        let due = self.recording.due(step);
        let mut reached = None;
        if due.any() {
            if due.needs_fields() {
                self.simulation.refresh()?;
            }
            let row =
                self.recording.record(step, time, &self.simulation.view(), &self.simulation.readings())?;
            reached = self.watch.after_row(&row);
        }
        if due.checkpoint {
            self.checkpoint()?;
        } else if let Some(last) = self.autosave.filter(|last| last.elapsed() > AUTOSAVE) {
            self.stamp = Stamp { step, time, ..self.stamp.clone() };
            self.recording.checkpoint(&self.stamp, &self.simulation.last_state())?;
            self.ending.outdate();
            self.autosave = Some(last + last.elapsed());
        }
        self.output_s += start.elapsed().as_secs_f64();
        Ok(reached)
    }

    fn checkpoint(&mut self) -> Result<PathBuf> {
        self.stamp.step = self.simulation.steps();
        self.stamp.time = self.simulation.time();
        let state = self.simulation.state()?;
        self.ending.outdate();
        self.recording.checkpoint(&self.stamp, &state)
    }

    /// The last frame, and the checkpoint to go on from, for a run that ends between two checkpoints.
    fn leave(&mut self) -> Result<()> {
        // Grains that are no longer in the mesh have no voidage, but all else.
        let refreshed = self.simulation.refresh();
        let (step, time) = (self.simulation.steps(), self.simulation.time());
        self.recording.frame(step, time, &self.simulation.view())?;
        refreshed.and_then(|()| self.checkpoint()).map(drop)
    }

    /// Ends the run: last frame and checkpoint, summary, pictures.
    fn close(mut self, outcome: Result<Ended>) -> Result<u8> {
        self.ending.claim();
        let (ended, reason) = match &outcome {
            Ok(Ended::Done) => ("done", None),
            Ok(Ended::Stopped(why)) => ("done", Some(why.clone())),
            Ok(Ended::Interrupted) => ("interrupted", None),
            Err(error) => ("failed", Some(error.notice().what)),
        };
        let time = self.simulation.time();
        match &outcome {
            Ok(Ended::Done) => {}
            Ok(Ended::Stopped(why)) => {
                self.leave()?;
                info!("{why}; to go on from t = {} s:\n  {}", Rounded(time), self.again);
            }
            Ok(Ended::Interrupted) => {
                self.leave()?;
                warn!("interrupted at t = {} s; to go on:\n  {}", Rounded(time), self.again);
            }
            Err(error) => self.leave_failed(error),
        }
        (self.summary.outcome, self.summary.reason) = (ended.to_owned(), reason);
        self.write_summary().or_else(|error| if outcome.is_err() { Ok(()) } else { Err(error) })?;
        let folder = self.recording.folder().to_path_buf();
        let drawn = plot::draw(&folder);
        self.simulation.shortcomings().iter().for_each(|line| warn!("{line}"));
        let finished = outcome?;
        drawn?;
        let (all, here) = (self.summary.steps, self.summary.steps_of_this_process);
        let of_these = if here == all { String::new() } else { format!(", {here} of them") };
        let wall = duration(self.summary.wall_s);
        println!("{ended} after {all} steps{of_these} in {wall}: {}", folder.display());
        Ok(if matches!(finished, Ended::Interrupted) { 1 } else { 0 })
    }

    /// What a run that fails leaves: frame, picture and state of its last good step, or of the step in which grains
    /// overlap too much. That this may fail too is no news beside why the run did.
    fn leave_failed(&mut self, error: &Error) {
        let overlap = matches!(error, Error::Penetration(_));
        if overlap {
            // Where this step is due; what of it cannot be written is missing.
            let _ = self.record();
        }
        let checkpoint = self.recording.folder().join(CHECKPOINT);
        let _ = self.simulation.refresh();
        let (step, time) = (self.simulation.steps(), self.simulation.time());
        let _ = self.recording.frame(step, time, &self.simulation.view());
        self.stamp = Stamp { step, time, ..self.stamp.clone() };
        // Between the parts of a step there is nothing to go on from.
        if !self.simulation.is_between_steps() {
            if checkpoint.exists() {
                warn!("the run failed within a step; the last checkpoint is {}", checkpoint.display());
            }
            return;
        }
        if let Ok(path) = self.recording.failed(&self.stamp, &self.simulation.last_state()) {
            let larger = if overlap { "with a larger contacts.max_penetration, " } else { "" };
            let time = Rounded(time);
            warn!("the state at t = {time} s is in {}; {larger}--restart goes on from it", path.display());
        }
        if checkpoint.exists() {
            warn!("the last checkpoint is {}", checkpoint.display());
        }
    }

    fn write_summary(&mut self) -> Result<()> {
        let mut phases: BTreeMap<String, f64> = serde_json::to_value(self.simulation.totals().phases)
            .and_then(serde_json::from_value)
            .unwrap_or_default();
        phases.insert("setup".to_owned(), self.setup_s);
        phases.insert("output".to_owned(), self.output_s);
        let summary = &mut self.summary;
        self.simulation.sum_up(summary);
        summary.steps_of_this_process = self.simulation.totals().steps;
        summary.wall_s = self.started.elapsed().as_secs_f64();
        summary.phases_s = phases;
        summary.write(&self.recording.folder().join("summary.json"))
    }
}
