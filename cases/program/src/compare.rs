//! `voidage compare`: one scene on several fluid solvers.
//!
//! First the same state: the run of the first solver is shown to the others at chosen steps. Then free runs side by
//! side, in which differences grow as the flow lets them.

use crate::plot;
use crate::run;
use crate::shipped;
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::PoisonError;
use tracing::{info, warn};
use voidage_campaign::process::start_threads;
use voidage_campaign::progress::{News, Progress};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Notice, Result, StepReport};
use voidage_remote::launch::{Host, check_ranks};
use voidage_scene::Scene;
use voidage_scene::compare::{Difference, Finding};
use voidage_scene::recorder::create_folder;
use voidage_scene::{Simulation, build, compare};

/// Steps that are compared when none are given, as far as the scene has them.
const MOMENTS: [u64; 4] = [1, 10, 100, 300];

/// Relative residual of linear systems here: what is compared is the solvers, not when they stop.
const LINEAR_TOLERANCE: f64 = 1e-13;

/// How far grains are moved to see what round-off grows to, in radii.
const NUDGE: f64 = 1e-14;

/// Options of `voidage compare`.
#[derive(Args)]
pub struct Options {
    /// Scene file (TOML), or the name of a shipped case.
    scene: PathBuf,
    /// Fluid solvers, the first is the reference: rust, serve, fenicsx, scikit-fem, python:MODULE.
    #[arg(long, value_delimiter = ',', default_value = "rust,fenicsx,scikit-fem")]
    fluids: Vec<String>,
    /// Steps that every solver solves from the same state. Default: 1, 10, 100, 300, as far as the scene goes.
    #[arg(long, value_delimiter = ',', value_name = "STEPS")]
    at: Vec<u64>,
    /// Steps of the free runs side by side; 0 for none.
    #[arg(long, default_value_t = 100)]
    steps: u64,
    /// Largest relative difference of a step from the same state that passes.
    #[arg(long, default_value_t = 1e-9)]
    tolerance: f64,
    /// Coupling scheme, instead of that of the scene: one that is shipped, or python:FILE[:CLASS].
    #[arg(long, value_parser = voidage_campaign::scheme)]
    scheme: Option<SchemeName>,
    /// Folder of results. Default: `out/` and the name of the scene, with `-compared`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Change a key of the scene (may be repeated).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Number of threads of the grains and the Rust solver. Default: one per core.
    #[arg(long)]
    threads: Option<usize>,
    #[command(flatten)]
    process: run::Process,
    /// No progress, only warnings and results.
    #[arg(long)]
    pub quiet: bool,
}

/// A solver to be compared: its name and the scene that asks for it.
struct Candidate {
    name: String,
    scene: Scene,
    /// Density of the fluid, kg/m3.
    density: f64,
    host: Host,
}

/// A line of the tables.
#[derive(Serialize)]
struct Row<'a> {
    step: u64,
    time_s: f64,
    fluid: &'a str,
    quantity: &'a str,
    relative_l2_difference: f64,
    relative_max_difference: f64,
}

/// Compares; exit code 1 if a step from the same state differs by more than the tolerance.
pub fn compare(options: &Options) -> Result<u8> {
    let folder = options.out.clone().unwrap_or_else(|| {
        let mut name = run::default_folder(&options.scene).into_os_string();
        name.push("-compared");
        name.into()
    });
    if options.fluids.len() < 2 {
        return Err(Error::input("--fluids: give at least two, separated by commas"));
    }
    if options.process.ranks.is_some() && !options.fluids.iter().any(|name| name == "fenicsx") {
        let notice =
            Notice::new("--ranks: none of the --fluids is fenicsx", "take it away, or compare with fenicsx");
        return Err(Error::input(notice));
    }
    let candidates = candidates(options, &folder)?;
    candidates
        .iter()
        .filter_map(|one| one.scene.fluid.as_ref()?.backend.as_ref())
        .try_for_each(check_ranks)?;
    start_threads(options.threads)?;
    create_folder(&folder)?;
    let findings = same_states(options, &candidates)?;
    let step = candidates[0].scene.time.step;
    write_rows(&folder.join("same-state.csv"), step, &findings)?;
    print_table("one step from the same state", &options.fluids[0], &findings);
    // Written so that what is no number fails.
    let within = |d: &Difference| d.l2 <= options.tolerance && d.max <= options.tolerance;
    let failed = findings.iter().flat_map(|f| &f.differences).filter(|d| !within(d)).count();
    println!("{failed} differences above {:e}", options.tolerance);
    if options.steps > 0 {
        let free = free_runs(options, &candidates)?;
        write_rows(&folder.join("free-runs.csv"), step, &free)?;
        plot::differences(&folder, step, &free)?;
        let last = free.iter().filter(|f| f.step == options.steps).cloned().collect::<Vec<_>>();
        print_table("free runs", &options.fluids[0], &last);
    }
    println!("{}", folder.display());
    Ok(u8::from(failed > 0))
}

fn candidates(options: &Options, folder: &Path) -> Result<Vec<Candidate>> {
    let mut candidates = Vec::new();
    for name in &options.fluids {
        let mut sets = vec![format!("fluid.solver.tolerance={LINEAR_TOLERANCE:e}")];
        sets.extend(options.scheme.map(run::scheme_setting));
        sets.extend(options.sets.iter().cloned());
        sets.extend(options.process.sets_of(name)?);
        let scene = shipped::read(&options.scene, &sets)?;
        let Some(density) = scene.fluid.as_ref().map(|fluid| fluid.density) else {
            let notice = Notice::new("the scene has no fluid", "there is nothing to compare");
            return Err(Error::input(notice.within(options.scene.display())));
        };
        let log = folder.join(format!("{}.log", name.replace([':', '/'], "-")));
        candidates.push(Candidate { name: name.clone(), scene, density, host: options.process.host(log) });
    }
    Ok(candidates)
}

/// The run of the first solver, shown to the others at the chosen steps.
fn same_states(options: &Options, candidates: &[Candidate]) -> Result<Vec<Finding>> {
    let [first, others @ ..] = candidates else { return Ok(Vec::new()) };
    let end = first.scene.time.steps();
    let moments = if options.at.is_empty() { &MOMENTS[..] } else { &options.at };
    let moments: Vec<u64> = moments.iter().copied().filter(|step| (1..=end).contains(step)).collect();
    let Some(&last) = moments.iter().max() else {
        return Err(Error::input(format!("--at {:?}: the scene has the steps 1 to {end}", options.at)));
    };
    let mut simulation = Simulation::hosted(&first.scene, &first.host)?;
    let mut backends = Vec::new();
    for other in others {
        backends.push((other.name.clone(), build::backend(&other.scene, &other.host)?));
    }
    let findings = simulation.beside(first.density, backends, moments.clone())?;
    info!("steps {moments:?} of {} by {}", first.name, options.fluids[1..].join(", "));
    let mut progress = Progress::new(0, last, options.quiet);
    while simulation.steps() < last {
        let report = simulation.step()?;
        if moments.contains(&simulation.steps()) {
            simulation.refresh()?;
        }
        show(&mut progress, &simulation, &report);
    }
    simulation.shortcomings().iter().for_each(|line| warn!("{}: {line}", first.name));
    let mut findings = findings.lock().unwrap_or_else(PoisonError::into_inner);
    Ok(std::mem::take(&mut *findings))
}

/// One run per solver, in step; each is compared with the first after every step. With grains there is one more of the
/// first solver, from grains that are moved by less than a rounding error of the linear systems: what round-off alone
/// grows to, however equal two solvers are.
fn free_runs(options: &Options, candidates: &[Candidate]) -> Result<Vec<Finding>> {
    let [reference, others @ ..] = candidates else { return Ok(Vec::new()) };
    let mut first = Simulation::hosted(&reference.scene, &reference.host)?;
    let mut runs = Vec::new();
    for other in others {
        runs.push((other.name.clone(), Simulation::hosted(&other.scene, &other.host)?));
    }
    if first.coupled().grains().is_some() {
        let mut nudged = Simulation::hosted(&reference.scene, &reference.host)?;
        nudge(&mut nudged);
        runs.push((format!("{} nudged", reference.name), nudged));
    }
    info!("{} steps of {} side by side", options.steps, options.fluids.join(", "));
    let mut progress = Progress::new(0, options.steps, options.quiet);
    let mut findings = Vec::new();
    for step in 1..=options.steps {
        let report = first.step()?;
        first.refresh()?;
        for (name, run) in &mut runs {
            run.step()?;
            run.refresh()?;
            let differences = compare::view_differences(reference.density, &first.view(), &run.view());
            findings.push(Finding { step, solver: name.clone(), differences });
        }
        show(&mut progress, &first, &report);
    }
    Ok(findings)
}

/// Moves every other grain to the right by [`NUDGE`] of its radius.
fn nudge(simulation: &mut Simulation) {
    if let Some(grains) = simulation.coupled_mut().grains_mut() {
        let particles = &mut grains.particles;
        for (position, radius) in particles.position.iter_mut().zip(&particles.radius).step_by(2) {
            position[0] += NUDGE * radius;
        }
    }
}

fn show(progress: &mut Progress, simulation: &Simulation, report: &StepReport) {
    progress.show(simulation.steps(), || News {
        time: simulation.time(),
        grains: simulation.view().grains.map_or(0, |grains| grains.position.len()),
        contacts: report.grains.map_or(0, |grains| grains.contacts),
        residual: report.residual(),
    });
}

fn write_rows(path: &Path, step: f64, findings: &[Finding]) -> Result<()> {
    let failed = |error: csv::Error| Error::run(format!("cannot write {}: {error}", path.display()));
    let mut file = csv::Writer::from_path(path).map_err(failed)?;
    for finding in findings {
        for difference in &finding.differences {
            let row = Row {
                step: finding.step,
                time_s: finding.step as f64 * step,
                fluid: &finding.solver,
                quantity: &difference.quantity,
                relative_l2_difference: difference.l2,
                relative_max_difference: difference.max,
            };
            file.serialize(row).map_err(failed)?;
        }
    }
    file.flush().map_err(|error| failed(error.into()))
}

fn print_table(title: &str, first: &str, findings: &[Finding]) {
    println!("{title}: differences from {first}, relative");
    let width = findings.iter().map(|finding| finding.solver.len()).max().unwrap_or(0).max(5);
    println!("{:>8}  {:<width$}  {:<18}{:>10}{:>10}", "step", "fluid", "quantity", "L2", "largest");
    for Finding { step, solver, differences } in findings {
        for Difference { quantity, l2, max } in differences {
            println!("{step:>8}  {solver:<width$}  {quantity:<18}{l2:>10.1e}{max:>10.1e}");
        }
    }
}
