//! What a step of whole scenes costs, by phase: the flow on meshes of 10, 35 and 140 thousand nodes, two beds, a collapse in a
//! liquid, a suspension, and 90,000 discs in gas.
//!
//! `cargo bench -p voidage --bench steps -- [--only NAME,..] [--threads 1,2] [--rounds 3] [--out DIR]` runs the program on every scene
//! to the end of a warm-up, then, so many times, from its checkpoint through the steps that count, and writes `steps.csv` (medians
//! of the rounds, and the parts of the contacts in the last one, with the name of the machine), `steps.png` and `flow.png`. What the table in DIR has of this machine and version is
//! not run again. Reading the scene and writing pictures are not counted.

mod table;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use table::{Table, numbers, option};
use voidage_campaign::plot::bars::{self, Bar};
use voidage_campaign::plot::panels::{Curve, Panel, grid};

/// A scene, and what is measured of it.
struct Case {
    name: &'static str,
    scene: &'static str,
    sets: &'static [&'static str],
    /// Length of a step, s; steps of the warm-up, and those that count.
    step: f64,
    warm: usize,
    steps: usize,
}

const fn flow(name: &'static str, squares: &'static [&'static str]) -> Case {
    Case { name, scene: "cavity/scene.toml", sets: squares, step: 0.05, warm: 20, steps: 20 }
}

const fn scene(name: &'static str, scene: &'static str, step: f64, warm: usize, steps: usize) -> Case {
    Case { name, scene, sets: &[], step, warm, steps }
}

const CASES: [Case; 8] = [
    flow("flow-10k", &["fluid.mesh.rectangle.structured.squares=[100, 100]"]),
    flow("flow-35k", &["fluid.mesh.rectangle.structured.squares=[186, 186]"]),
    flow("flow-140k", &["fluid.mesh.rectangle.structured.squares=[373, 373]"]),
    scene("quick-bed", "bubbling-bed/scene-quick.toml", 1e-3, 300, 100),
    scene("migflow-bed", "bubbling-bed/scene-migflow.toml", 1e-3, 300, 100),
    scene("collapse", "program/benches/scenes/collapse.toml", 1e-3, 10, 10),
    scene("suspension", "program/benches/scenes/suspension.toml", 8e-3, 5, 10),
    scene("tall-gas", "program/benches/scenes/tall-gas.toml", 5e-4, 160, 20),
];

/// Parts of the phase of contacts, as `summary.json` names them.
const PARTS: [&str; 4] = ["search_s", "sweeps_s", "measures_s", "corrections_s"];

/// Phases of a step, as `summary.json` names them.
const PHASES: [&str; 7] = ["flow", "energy", "transport", "contacts", "overlap", "exchange", "closure"];

const HEADER: [&str; 22] = [
    "case",
    "threads",
    "grains",
    "nodes",
    "steps",
    "solutions_per_step",
    "parts_per_step",
    "sweeps_per_step",
    "unsolved_steps",
    "total_ms",
    "flow_ms",
    "energy_ms",
    "transport_ms",
    "contacts_ms",
    "overlap_ms",
    "exchange_ms",
    "closure_ms",
    "search_ms",
    "sweeps_ms",
    "measures_ms",
    "corrections_ms",
    "asleep",
];
const TOTAL: usize = 9;
/// Machine and version stand before the rest of a row.
const BEFORE: usize = 2;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// One run of the program; its summary.
fn run(case: &Case, threads: &str, out: &Path, steps: usize, more: &[&str]) -> Outcome<Value> {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut program = Command::new(env!("CARGO_BIN_EXE_voidage"));
    program.arg("run").arg(cases.join(case.scene)).args(["--quiet", "--threads", threads, "--out"]).arg(out);
    let times = [
        format!("time.step={}", case.step),
        format!("time.end={}", case.step * steps as f64),
        format!("output.series_interval={}", case.step),
        format!("output.checkpoint_interval={}", case.step * case.warm as f64),
    ];
    for set in times.iter().map(String::as_str).chain(case.sets.iter().copied()) {
        program.args(["--set", set]);
    }
    let told = program.args(more).output()?;
    if !told.status.success() {
        return Err(format!("{}: {}", case.name, String::from_utf8_lossy(&told.stderr)).into());
    }
    Ok(serde_json::from_reader(std::fs::File::open(out.join("summary.json"))?)?)
}

/// Mean of a column of `series.csv` over its last `steps` rows; 0 where the scene has none of it.
fn mean(out: &Path, column: &str, steps: usize) -> Outcome<f64> {
    let mut reader = csv::Reader::from_path(out.join("series.csv"))?;
    let Some(place) = reader.headers()?.iter().position(|name| name == column) else { return Ok(0.0) };
    let mut values = vec![];
    for row in reader.records() {
        values.push(row?[place].parse::<f64>()?);
    }
    let last = values.get(values.len().saturating_sub(steps)..).unwrap_or_default();
    Ok(last.iter().sum::<f64>() / last.len() as f64)
}

/// The median; 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// A row of the table.
fn measure(case: &Case, threads: &str, rounds: usize) -> Outcome<Vec<String>> {
    let folder = tempfile::tempdir()?;
    let (out, warmed) = (folder.path().join("out"), folder.path().join("warm.voidage"));
    run(case, threads, &out, case.warm, &[])?;
    std::fs::copy(out.join("checkpoint.voidage"), &warmed)?;
    let restart = ["--restart".to_string(), warmed.to_string_lossy().into_owned()];
    let restart: Vec<&str> = restart.iter().map(String::as_str).collect();
    let (mut times, mut last) = (vec![vec![]; PHASES.len()], Value::Null);
    for _ in 0..rounds {
        last = run(case, threads, &out, case.warm + case.steps, &restart)?;
        for (times, phase) in times.iter_mut().zip(PHASES) {
            let seconds = last["phases_s"][phase].as_f64().ok_or(format!("no phase {phase}"))?;
            times.push(1e3 * seconds / case.steps as f64);
        }
    }
    let of_contacts = |name: &str| last["contacts"][name].as_f64().unwrap_or_default();
    let parts = PARTS.map(|part| format!("{:.2}", 1e3 * of_contacts(part) / case.steps as f64));
    let all = of_contacts("relaxations") + of_contacts("asleep");
    let asleep = if all > 0.0 { of_contacts("asleep") / all } else { 0.0 };
    let whole = (0..rounds).map(|round| times.iter().map(|phase| phase[round]).sum()).collect();
    let count = |name: &str| last[name].as_u64().unwrap_or_default().to_string();
    let mut row =
        vec![case.name.into(), threads.into(), count("grains"), count("nodes"), case.steps.to_string()];
    for column in ["fluid_solves", "step_parts", "contact_sweeps"] {
        row.push(format!("{:.2}", mean(&out, column, case.steps)?));
    }
    row.push(count("unconverged_steps"));
    row.push(format!("{:.2}", median(whole)));
    row.extend(times.into_iter().map(|phase| format!("{:.2}", median(phase))));
    row.extend(parts);
    row.push(format!("{asleep:.2}"));
    Ok(row)
}

fn main() -> Outcome<()> {
    let rounds = numbers("--rounds", "3")[0].max(1);
    let only = option("--only", "");
    if let Some(name) = only.iter().find(|name| CASES.iter().all(|case| case.name != **name)) {
        return Err(format!("--only: there is no case {name}").into());
    }
    let out = PathBuf::from(option("--out", "../../target/steps").remove(0));
    std::fs::create_dir_all(&out)?;
    let mut table = Table::open(out.join("steps.csv"), &HEADER)?;
    let threads: Vec<String> = numbers("--threads", "1,2").iter().map(usize::to_string).collect();
    for case in CASES.iter().filter(|case| only.is_empty() || only.iter().any(|name| name == case.name)) {
        for threads in &threads {
            if !table.has(&[case.name, threads]) {
                table.add(&measure(case, threads, rounds)?, |row| {
                    let place = CASES.iter().position(|case| case.name == row[0]);
                    vec![place.unwrap_or(CASES.len()), row[1].parse().unwrap_or_default()]
                })?;
            }
        }
    }
    draw(&out, &table.rows)
}

/// Shares of the phases of every scene on one thread, and the time of the flow over the nodes of the mesh.
fn draw(out: &Path, rows: &[Vec<String>]) -> Outcome<()> {
    let (mut scenes, mut curves): (Vec<Bar>, Vec<Curve>) = (vec![], vec![]);
    for row in rows.iter().map(|row| &row[BEFORE..]) {
        let milliseconds = |place: usize| row[place].parse::<f64>();
        let (name, threads) = (&row[0], &row[1]);
        if name.starts_with("flow") {
            let name = format!("{threads} thread{}", if threads == "1" { "" } else { "s" });
            let point = (row[3].parse()?, 1e-3 * milliseconds(TOTAL)?);
            match curves.iter_mut().find(|curve| curve.name == name) {
                Some(curve) => curve.points.push(point),
                None => curves.push(Curve::joined(name, vec![point])),
            }
        } else if threads == "1" {
            let part =
                |(k, phase): (usize, &&str)| Ok((phase.to_string(), 1e-3 * milliseconds(TOTAL + 1 + k)?));
            let parts = PHASES.iter().enumerate().map(part).collect::<Outcome<_>>()?;
            scenes.push(Bar { name: name.clone(), parts });
        }
    }
    bars::draw(&out.join("steps.png"), "A step of whole scenes by phase, one thread", &scenes)?;
    let panel = Panel { curves, ..Panel::log_log("A step of the flow", "nodes", "time of a step (s)") };
    Ok(grid(&out.join("flow.png"), 1, &[panel])?)
}
