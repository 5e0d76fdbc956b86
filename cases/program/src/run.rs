//! `voidage run`: the loop around the steps.

use crate::placing;
use crate::plot;
use clap::Args;
use clap::builder::PossibleValuesParser;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use tracing::{info, warn};
use voidage_campaign::process::{catch_interrupts, host, start_threads};
use voidage_campaign::progress::{News, Progress, duration};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Result};
use voidage_dem::Rounded;
use voidage_scene::Simulation;
use voidage_scene::recorder::{CHECKPOINT, Checkpoint, Recording, Stamp, Summary};
use voidage_scene::{Scene, Solver};

/// Options of `voidage run`.
#[derive(Args)]
pub struct Options {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Folder of results. Default: `out/` and the name of the scene.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Change a key of the scene: `fluid.boundaries.inflow.flow.superficial_velocity=[0,1.2]` (may be repeated).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Go on from a checkpoint of this scene.
    #[arg(long, value_name = "FILE")]
    restart: Option<PathBuf>,
    /// Number of threads; results do not depend on it. Default: one per core.
    #[arg(long)]
    threads: Option<usize>,
    /// Coupling scheme, instead of that of the scene.
    #[arg(long, value_parser = schemes())]
    scheme: Option<String>,
    /// Fluid solver, instead of that of the scene: rust; in a process of its own serve (the same), fenicsx, scikit-fem
    /// or python:MODULE; or one that is started by hand, attach:ADDRESS (shm:NAME or tcp:HOST:PORT).
    #[arg(long)]
    fluid: Option<String>,
    #[command(flatten)]
    process: Process,
    /// No progress, only warnings and results.
    #[arg(long)]
    pub quiet: bool,
}

/// Options of fluid solvers in processes of their own.
#[derive(Args)]
pub struct Process {
    /// How frames reach the process of a fluid solver.
    #[arg(long, value_parser = ["shm", "tcp"])]
    transport: Option<String>,
    /// Longest time without a sign of life from the process of a fluid solver, s.
    #[arg(long, value_name = "S")]
    timeout: Option<f64>,
}

impl Process {
    /// The options as changes of the scene, with the choice of a fluid solver.
    pub fn sets(&self, fluid: Option<&str>) -> Result<Vec<String>> {
        let solver = fluid.map(str::parse::<Solver>).transpose();
        let solver = solver.map_err(|error| Error::input(error.within("--fluid")))?;
        let mut sets: Vec<String> = solver.iter().map(Solver::setting).collect();
        sets.extend(self.transport.iter().map(|transport| format!("fluid.backend.transport={transport:?}")));
        sets.extend(self.timeout.map(|seconds| format!("fluid.backend.timeout={seconds:?}")));
        Ok(sets)
    }
}

/// The names of schemes.
fn schemes() -> PossibleValuesParser {
    PossibleValuesParser::new(SchemeName::ALL.map(SchemeName::name))
}

/// Runs a scene; the number is the exit code.
pub fn run(options: &Options) -> Result<u8> {
    let scene = Scene::read(&options.scene, &sets(options)?)?;
    let threads = start_threads(options.threads)?;
    let interrupted = catch_interrupts()?;
    let mut run = Run::new(&scene, options, threads, &interrupted)?;
    let outcome = run.steps(&interrupted, options.quiet);
    run.close(outcome)
}

/// The options as changes of the scene.
fn sets(options: &Options) -> Result<Vec<String>> {
    let mut sets = options.sets.clone();
    sets.extend(options.scheme.iter().map(|scheme| format!("coupling.scheme={scheme:?}")));
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

/// A run in progress.
struct Run {
    simulation: Simulation,
    recording: Recording,
    stamp: Stamp,
    summary: Summary,
    last: u64,
    started: Instant,
    /// Wall time until the first step, s.
    setup_s: f64,
    output_s: f64,
}

impl Run {
    fn new(scene: &Scene, options: &Options, threads: usize, interrupted: &AtomicBool) -> Result<Run> {
        let started = Instant::now();
        let folder = options.out.clone().unwrap_or_else(|| default_folder(&options.scene));
        let hash = scene.hash()?;
        let host = host(folder.join("solver.log"));
        let mut placing = placing::watched(&folder, interrupted, options.quiet);
        let (simulation, recording) = match &options.restart {
            None => {
                let mut simulation = Simulation::placed(scene, &host, &mut placing)?;
                simulation.refresh()?;
                let recording = Recording::start(&folder, scene, &simulation.view(), &simulation.readings())?;
                (simulation, recording)
            }
            Some(file) => {
                let checkpoint = Checkpoint::read(file, &hash)?;
                let mut simulation = Simulation::placed(scene, &host, &mut placing)?.restart(&checkpoint)?;
                simulation.refresh()?;
                let (view, readings) = (simulation.view(), simulation.readings());
                let recording = Recording::resume(&folder, scene, &view, &readings, &checkpoint)?;
                (simulation, recording)
            }
        };
        let view = simulation.view();
        let summary = Summary {
            grains: view.grains.map_or(0, |grains| grains.position.len()),
            nodes: view.fluid.map_or(0, |fluid| fluid.mesh.points.len()),
            cells: view.fluid.map_or(0, |fluid| fluid.mesh.cell_count()),
            bed_weight_per_area: simulation.bed_weight_per_area(),
            threads,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_hash: hash.clone(),
            ..Summary::default()
        };
        info!("{}", scene.title);
        placing::tell(&placing.beds);
        info!(
            "{} grains, {} nodes, {} cells, {threads} threads, into {}",
            summary.grains,
            summary.nodes,
            summary.cells,
            folder.display()
        );
        let stamp = Stamp { scene_hash: hash, step: simulation.steps(), time: simulation.time() };
        Ok(Run {
            simulation,
            recording,
            stamp,
            summary,
            last: scene.time.steps(),
            started,
            setup_s: started.elapsed().as_secs_f64(),
            output_s: 0.0,
        })
    }

    /// Steps to the end, or until interrupted (`false`).
    fn steps(&mut self, interrupted: &AtomicBool, quiet: bool) -> Result<bool> {
        let mut progress = Progress::new(self.simulation.steps(), self.last, quiet);
        while self.simulation.steps() < self.last {
            if interrupted.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let report = self.simulation.step()?;
            self.record()?;
            let step = self.simulation.steps();
            for remark in self.simulation.remarks() {
                warn!("step {step}: {remark}\n  (later steps of this kind are counted in summary.json)");
            }
            progress.show(step, || News {
                time: self.simulation.time(),
                grains: self.summary.grains,
                contacts: report.grains.map_or(0, |grains| grains.contacts),
                residual: report.residual(),
            });
        }
        Ok(true)
    }

    /// Writes what is due.
    fn record(&mut self) -> Result<()> {
        let start = Instant::now();
        let (step, time) = (self.simulation.steps(), self.simulation.time());
        let due = self.recording.due(step);
        if due.any() {
            if due.needs_fields() {
                self.simulation.refresh()?;
            }
            self.recording.record(step, time, &self.simulation.view(), &self.simulation.readings())?;
        }
        if due.checkpoint {
            self.checkpoint()?;
        }
        self.output_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn checkpoint(&mut self) -> Result<PathBuf> {
        self.stamp.step = self.simulation.steps();
        self.stamp.time = self.simulation.time();
        let state = self.simulation.state()?;
        self.recording.checkpoint(&self.stamp, &state)
    }

    /// The last frame, and the checkpoint to go on from, for a run that ends between two checkpoints.
    fn leave(&mut self) -> Result<PathBuf> {
        // Grains that are no longer in the mesh have no voidage, but all else.
        let refreshed = self.simulation.refresh();
        let (step, time) = (self.simulation.steps(), self.simulation.time());
        self.recording.frame(step, time, &self.simulation.view())?;
        refreshed.and_then(|()| self.checkpoint())
    }

    /// Ends the run: last frame and checkpoint, summary, pictures.
    fn close(mut self, outcome: Result<bool>) -> Result<u8> {
        let ended = match &outcome {
            Ok(true) => "done",
            Ok(false) => "interrupted",
            Err(_) => "failed",
        };
        let time = self.simulation.time();
        match &outcome {
            Ok(true) => {}
            Ok(false) => {
                let path = self.leave()?;
                warn!("interrupted at t = {} s; go on with --restart {}", Rounded(time), path.display());
            }
            Err(error) => self.leave_failed(error),
        }
        self.summary.outcome = ended.to_owned();
        self.write_summary().or_else(|error| if outcome.is_err() { Ok(()) } else { Err(error) })?;
        let folder = self.recording.folder().to_path_buf();
        let drawn = plot::draw(&folder);
        self.simulation.shortcomings().iter().for_each(|line| warn!("{line}"));
        let finished = outcome?;
        drawn?;
        println!(
            "{ended} after {} steps in {}: {}",
            self.summary.steps,
            duration(self.summary.wall_s),
            folder.display()
        );
        Ok(if finished { 0 } else { 1 })
    }

    /// What a run that fails leaves; that this may fail too is no news beside why the run did.
    fn leave_failed(&mut self, error: &Error) {
        let checkpoint = self.recording.folder().join(CHECKPOINT);
        let left = matches!(error, Error::Penetration(_)).then(|| {
            // Where this step is due; what of it cannot be written is missing.
            let _ = self.record();
            self.leave()
        });
        match left {
            Some(Ok(path)) => warn!(
                "the state of that step is in {}; with a larger contacts.max_penetration, --restart goes on from it",
                path.display()
            ),
            _ if checkpoint.exists() => warn!("the last checkpoint is {}", checkpoint.display()),
            _ => {}
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
