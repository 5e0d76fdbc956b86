//! The folder of a run has one run: nothing is lost, nothing mixed, whatever ends a run; and runs that go on from a
//! checkpoint.

use assert_cmd::Command;
use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const BED: &str = include_str!("bed.toml");

/// A folder with the small bed in it.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    folder
}

/// Exit code and what was said.
fn run(folder: &Path, options: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    let arguments = [&["run", "scene.toml", "--threads", "1"], options].concat();
    let output = command.current_dir(folder).args(arguments).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

fn good(folder: &Path, options: &[&str]) -> String {
    let (code, said) = run(folder, options);
    assert_eq!(code, Some(0), "{options:?}: {said}");
    said
}

fn refused(folder: &Path, options: &[&str], says: &[&str]) {
    let (code, said) = run(folder, options);
    assert_eq!(code, Some(2), "{options:?}: {said}");
    assert!(says.iter().all(|part| said.contains(part)), "{options:?}: {says:?} is not in\n{said}");
}

fn start(folder: &Path, options: &[&str]) -> Child {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_voidage"));
    command.current_dir(folder).args(["run", "scene.toml", "--quiet", "--threads", "1"]).args(options);
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn interrupt(process: &Child) {
    let id = process.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
}

fn end(process: Child) -> (Option<i32>, String) {
    let output = process.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

/// All files below a folder with their contents, but for the lock.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if !path.ends_with("voidage.lock") {
                let name = path.strip_prefix(folder).unwrap().display().to_string();
                found.push((name, fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

fn summary(folder: &Path, out: &str) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(folder.join(out).join("summary.json")).unwrap()).unwrap()
}

fn times(folder: &Path, out: &str) -> Vec<f64> {
    let text = fs::read_to_string(folder.join(out).join("series.csv")).unwrap();
    text.lines().skip(1).map(|row| row.split(',').next().unwrap().parse().unwrap()).collect()
}

const SHORT: [&str; 4] = ["--out", "out", "--set", "time.end=0.01"];

/// A second run overwrote the first without a word, and left its checkpoint, frames and pictures as if they were its
/// own.
#[test]
fn a_second_run_is_refused_and_one_that_overwrites_leaves_nothing_of_the_first() {
    let folder = folder();
    good(folder.path(), &["--out", "out", "--set", "output.contacts=true"]);
    let out = folder.path().join("out");
    assert!(out.join("contacts.pvd").exists() && out.join("chains-0.020s.png").exists());
    fs::write(out.join("notes.txt"), "mine").unwrap();
    let before = contents(&out);
    refused(folder.path(), &SHORT, &["holds the results of an earlier run", "--overwrite", "--restart"]);
    assert!(contents(&out) == before, "a run that was refused has changed the folder");
    good(folder.path(), &[&SHORT[..], &["--overwrite"]].concat());
    good(folder.path(), &["--out", "fresh", "--set", "time.end=0.01"]);
    let names = |out: &str| -> Vec<String> {
        let all = contents(&folder.path().join(out)).into_iter().map(|(name, _)| name);
        all.filter(|name| name != "notes.txt").collect()
    };
    assert_eq!(names("out"), names("fresh"));
    assert_eq!(fs::read(out.join("notes.txt")).unwrap(), b"mine");
}

#[test]
fn files_of_others_are_refused_and_stay() {
    let folder = folder();
    fs::create_dir(folder.path().join("out")).unwrap();
    fs::write(folder.path().join("out/series.csv"), "day,rain\n1,0\n").unwrap();
    for options in [&["--out", "out"][..], &["--out", "out", "--overwrite"], &["--out", "."]] {
        refused(folder.path(), options, &["which no run of this program left there", "--out"]);
    }
    assert_eq!(fs::read_to_string(folder.path().join("out/series.csv")).unwrap(), "day,rain\n1,0\n");
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 1);
}

/// The series of one and the summary of the other were left, and both were done.
#[test]
fn two_runs_at_once_do_not_share_a_folder() {
    let folder = folder();
    let first = start(folder.path(), &["--out", "out", "--set", "time.end=1000"]);
    until("the run does not start", || folder.path().join("out/grains.pvd").exists());
    let process = format!("(process {})", first.id());
    for more in [&[][..], &["--overwrite"]] {
        refused(folder.path(), &[&SHORT[..], more].concat(), &["another run", &process, "--out"]);
    }
    interrupt(&first);
    let (code, said) = end(first);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("Ctrl-C again ends at once"), "{said}");
    // Its lock is gone with it.
    good(folder.path(), &[&SHORT[..], &["--overwrite"]].concat());
}

/// A killed run restarted from the checkpoint of another run that had been in its folder.
#[test]
fn a_checkpoint_of_an_earlier_run_is_gone_before_the_first_step() {
    let folder = folder();
    good(folder.path(), &["--out", "out"]);
    let more = ["--overwrite", "--set", "output.checkpoint_interval=500", "--set", "time.end=1000"];
    let mut run = start(folder.path(), &[&["--out", "out"], &more[..]].concat());
    until("the run does not start", || {
        times_or_none(folder.path()).is_some_and(|rows| rows.len() > 5 && rows.len() < 40)
    });
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(!folder.path().join("out/checkpoint.voidage").exists());
    assert!(!folder.path().join("out/summary.json").exists());
    refused(
        folder.path(),
        &["--out", "out", "--restart", "out/checkpoint.voidage"],
        &["cannot read the checkpoint"],
    );
}

fn times_or_none(folder: &Path) -> Option<Vec<f64>> {
    folder.join("out/series.csv").exists().then(|| {
        let text = fs::read_to_string(folder.join("out/series.csv")).unwrap_or_default();
        let first = |row: &str| row.split(',').next().and_then(|time| time.parse().ok());
        text.lines().skip(1).filter_map(first).collect()
    })
}

#[test]
fn a_series_that_somebody_removes_or_changes_fails_the_run() {
    for changes in [true, false] {
        let folder = folder();
        let run = start(folder.path(), &["--out", "out", "--set", "time.end=1000"]);
        let series = folder.path().join("out/series.csv");
        until("the run does not start", || {
            times_or_none(folder.path()).is_some_and(|times| !times.is_empty())
        });
        if changes {
            let mut text = fs::read_to_string(&series).unwrap();
            text.push_str("a line of somebody else\n");
            fs::write(&series, text).unwrap();
        } else {
            fs::remove_file(&series).unwrap();
        }
        let (code, said) = end(run);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("somebody has") && said.contains("series.csv"), "{said}");
        assert!(folder.path().join("out/failed.voidage").exists(), "{said}");
    }
}

/// A run that dies wrote nothing to go on from unless it had asked for checkpoints.
#[test]
fn a_run_that_fails_leaves_its_last_state_and_its_pictures() {
    let folder = folder();
    fs::write(
        folder.path().join("dies.py"),
        "import numpy as np\nfrom voidage import Fields, Solution, Solver\n\n\nclass Dies(Solver):\n    def set_mesh(self, problem):\n        \
         self.fields = problem.fields\n        self.done = 0\n\n    def solve(self, step):\n        if self.done >= 7:\n            \
         raise RuntimeError('no more')\n        return Solution(self.fields)\n\n    def accept(self):\n        self.done += 1\n",
    )
    .unwrap();
    let none = ["--set", "output.checkpoint_interval=500", "--set", "output.average.from=0.0"];
    let (code, said) =
        run(folder.path(), &[&["--out", "out", "--fluid", "python:dies.py"], &none[..]].concat());
    if said.contains("voidage doctor") && !said.contains("no more") {
        eprintln!("the Python package is not installed here: {said}");
        return;
    }
    assert_eq!(code, Some(1), "{said}");
    let out = folder.path().join("out");
    for name in ["failed.voidage", "summary.json", "averages.csv", "temperature.png", "snapshot-0.007s.png"] {
        assert!(out.join(name).exists(), "no {name}: {said}");
    }
    let summary = summary(folder.path(), "out");
    assert!(
        summary["outcome"] == "failed" && summary["reason"].as_str().unwrap().contains("no more"),
        "{summary}"
    );
    good(folder.path(), &[&["--out", "out", "--restart", "out/failed.voidage"], &none[..]].concat());
    assert_eq!(times(folder.path(), "out").len(), 41);
}

/// Steps took minutes, and an interrupt was not heard before their end.
#[test]
fn an_interrupt_within_a_long_step_ends_the_run_and_leaves_a_checkpoint() {
    let folder = folder();
    // Half a million triangles: one step takes far longer than the patience of the program.
    let long = ["--set", "fluid.mesh.rectangle.size=5e-5", "--set", "fluid.solver.linear=ilu"];
    let process = start(folder.path(), &[&["--out", "out"], &long[..]].concat());
    until("the run does not start", || folder.path().join("out/grains.pvd").exists());
    std::thread::sleep(Duration::from_millis(300));
    let asked = Instant::now();
    interrupt(&process);
    let (code, said) = end(process);
    assert_eq!(code, Some(1), "{said}");
    assert!(asked.elapsed() < Duration::from_secs(20), "{:?}", asked.elapsed());
    assert!(said.contains("interrupted") && said.contains("--restart out/checkpoint.voidage"), "{said}");
    assert_eq!(summary(folder.path(), "out")["outcome"], "interrupted");
}

#[test]
fn a_run_goes_on_with_another_inflow_into_another_folder_and_says_so() {
    let folder = folder();
    good(folder.path(), &["--out", "out", "--until", "0.02"]);
    assert_eq!(summary(folder.path(), "out")["outcome"], "done");
    assert_eq!(times(folder.path(), "out").last(), Some(&0.02));
    let inflow = ["--set", "fluid.boundaries.inflow.flow.superficial_velocity=[0.0, 1.2]"];
    let from = ["--restart", "out/checkpoint.voidage"];
    refused(
        folder.path(),
        &[&["--out", "out"], &inflow[..], &from].concat(),
        &["without the change", "--out"],
    );
    let said = good(folder.path(), &[&["--out", "more"], &inflow[..], &from].concat());
    let change = "fluid.boundaries.1.flow.superficial_velocity = [0.0, 1.2], was [0.0, 0.8]";
    assert!(said.contains(&format!("changed since the checkpoint: {change}")), "{said}");
    let summary = summary(folder.path(), "more");
    assert_eq!(
        (summary["changes"][0].as_str(), summary["restarted_from"].as_str()),
        (Some(change), Some(from[1]))
    );
    let rows = times(folder.path(), "more");
    assert_eq!((rows.len(), rows[0]), (20, 0.021));
    assert_ne!(
        fs::read(folder.path().join("more/checkpoint.voidage")).unwrap(),
        fs::read(folder.path().join("out/checkpoint.voidage")).unwrap()
    );
    // Half the step: steps count as if all had been so long.
    let said = good(folder.path(), &[&["--out", "fine", "--set", "time.step=5e-4"], &from[..]].concat());
    assert!(said.contains("time.step = 0.0005, was 0.001"), "{said}");
    assert_eq!(times(folder.path(), "fine").len(), 40);
    for (set, says) in [
        ("grains[0].velocity=[0.0, 1.0]", "grains.0.velocity"),
        ("materials.glass.density=2600.0", "materials.glass.density"),
        ("time.step=7e-4", "no whole number of steps"),
    ] {
        refused(folder.path(), &[&["--out", "no", "--set", set], &from[..]].concat(), &[says]);
    }
    refused(
        folder.path(),
        &[&["--out", "out", "--overwrite"], &from[..]].concat(),
        &["would remove the run"],
    );
    refused(folder.path(), &[&["--out", "no", "--until", "0.01"], &from[..]].concat(), &["--until 0.01"]);
}

/// The frame of the moment of a stop stayed among the others, so that an analysis found them uneven.
#[test]
fn a_run_that_was_stopped_between_two_frames_leaves_the_frames_of_one_left_alone() {
    let folder = folder();
    let frames = |out: &str| -> (Vec<_>, String, String, Vec<String>) {
        let out = folder.path().join(out);
        let mut names: Vec<_> =
            fs::read_dir(out.join("frames")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
        // Only the times: values are the same bits where the checkpoint was written at its interval.
        let times = read("series.csv").lines().map(|row| row.split(',').next().unwrap().to_owned()).collect();
        (names, read("grains.pvd"), read("fluid.pvd"), times)
    };
    let rows = ["--set", "output.series_interval=0.004"];
    good(folder.path(), &[&["--out", "straight"], &rows[..]].concat());
    good(folder.path(), &[&["--out", "out", "--until", "0.013"], &rows[..]].concat());
    assert!(
        frames("out").1.contains("grains-00000013"),
        "the last state of a run that ends can be looked at"
    );
    good(folder.path(), &[&["--out", "out", "--restart", "out/checkpoint.voidage"], &rows[..]].concat());
    assert_eq!(frames("out"), frames("straight"));
    // So it is where the end of the scene was another, and what was due before other intervals were asked for stays.
    let (end, every) = (["--set", "time.end=0.013"], ["--set", "output.frame_interval=0.03"]);
    good(folder.path(), &[&["--out", "end"], &end[..], &rows[..]].concat());
    good(folder.path(), &[&["--out", "end", "--restart", "end/checkpoint.voidage"], &rows[..]].concat());
    assert_eq!(frames("end"), frames("straight"));
    good(folder.path(), &[&["--out", "other", "--until", "0.02"], &rows[..]].concat());
    let restart = ["--out", "other", "--restart", "other/checkpoint.voidage"];
    good(folder.path(), &[&restart[..], &every[..], &rows[..]].concat());
    let ends = |k: &&str| frames("other").1.contains(&format!("grains-{k}"));
    assert_eq!(["00000010", "00000020", "00000030"].iter().filter(|k| ends(k)).count(), 3);
}

/// Only keys were compared where any had changed, and the weight was that of the gravity before.
#[test]
fn a_restart_sees_changed_files_and_weighs_the_bed_anew() {
    let folder = folder();
    let table = "x,y,r\n0.003,0.001,0.0005\n0.006,0.001,0.0005\n";
    fs::write(folder.path().join("grains.csv"), table).unwrap();
    let lines = BED.lines().filter(|line| !line.starts_with("radius =") && !line.starts_with("amount ="));
    let text: Vec<&str> = lines
        .map(
            |line| if line.starts_with("placement =") { "placement.csv.file = \"grains.csv\"" } else { line },
        )
        .collect();
    fs::write(folder.path().join("scene.toml"), text.join("\n")).unwrap();
    good(folder.path(), &["--out", "out", "--until", "0.02"]);
    let lighter = ["--out", "more", "--restart", "out/checkpoint.voidage", "--set", "gravity=[0.0, -4.905]"];
    good(folder.path(), &lighter);
    let weight = |out: &str| summary(folder.path(), out)["bed_weight_per_area_Pa"].as_f64().unwrap();
    assert!((weight("more") / weight("out") - 0.5).abs() < 1e-12, "{} {}", weight("more"), weight("out"));
    fs::write(folder.path().join("grains.csv"), table.replace("0.006", "0.007")).unwrap();
    refused(
        folder.path(),
        &[&["--overwrite"], &lighter[..]].concat(),
        &["grains.0.placement.csv.file", "from a checkpoint"],
    );
}

/// The samples of both windows were mixed.
#[test]
fn averages_of_another_window_begin_anew_after_a_restart() {
    let folder = folder();
    let window = ["--set", "output.average.from=0.025"];
    let averages = |out: &str| fs::read_to_string(folder.path().join(out).join("averages.csv")).unwrap();
    good(folder.path(), &["--out", "out", "--until", "0.02"]);
    good(folder.path(), &[&["--out", "more", "--restart", "out/checkpoint.voidage"], &window[..]].concat());
    good(folder.path(), &[&["--out", "straight"], &window[..]].concat());
    assert_eq!(averages("more"), averages("straight"));
    assert_ne!(averages("more"), averages("out"));
}

#[test]
fn a_run_stops_where_the_scene_says() {
    let folder = folder();
    let column = "mean_grain_temperature_K";
    let set = format!("stop.value={{ column = \"{column}\", below = 363.05 }}");
    let said = good(folder.path(), &["--out", "value", "--set", &set]);
    assert!(said.contains("stop.value: mean_grain_temperature_K = 363.0"), "{said}");
    let reached = times(folder.path(), "value");
    assert!(reached.len() > 2 && reached.len() < 41, "{reached:?}");
    assert!(summary(folder.path(), "value")["reason"].as_str().unwrap().contains(column));
    // A run that ended early goes on.
    good(folder.path(), &["--out", "value", "--restart", "value/checkpoint.voidage"]);
    assert_eq!(times(folder.path(), "value").len(), 41);
    let said =
        good(folder.path(), &["--out", "rest", "--set", "stop.at_rest={ speed = 50.0, during = 0.005 }"]);
    assert!(said.contains("stop.at_rest") && times(folder.path(), "rest").len() < 10, "{said}");
    good(folder.path(), &["--out", "wall", "--set", "stop.wall_time=1e-6"]);
    assert_eq!(times(folder.path(), "wall").len(), 2);
    for (set, says) in [
        ("stop.value={ column = \"mean_grain_temprature_K\", below = 1.0 }", "no such column"),
        ("stop.value={ column = \"time_s\" }", "add `above` or `below`"),
        ("stop.at_rest={ speed = 0.0, during = 1.0 }", "above 0"),
        ("stop.wall_time=-1.0", "above 0"),
    ] {
        refused(folder.path(), &["--out", "no", "--set", set], &["stop", says]);
    }
}
