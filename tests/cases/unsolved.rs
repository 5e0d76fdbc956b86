//! What cannot be solved is said: at the step where it happens, in the last lines of a run, and by its exit code.

use assert_cmd::Command;
use std::fs;
use std::path::Path;

const BED: &str = include_str!("bed.toml");

/// Discs in a box whose lid comes down until they have no room.
const BOX: &str = r#"
title = "A lid"
gravity = [0.0, -9.81]

[time]
step = 1e-3
end = 0.5

[materials.steel]
density = 7800.0
friction = 0.3

[[grains]]
material = "steel"
radius = { constant = 2.5e-3 }
amount = { count = 200 }
placement = { lattice = { lower = [0.0, 0.0], upper = [0.1, 0.051], spacing = 1.0 } }

[[walls]]
name = "floor"
from = [0.0, 0.0]
to = [0.1, 0.0]

[[walls]]
name = "left"
from = [0.0, 0.0]
to = [0.0, 0.2]

[[walls]]
name = "right"
from = [0.1, 0.0]
to = [0.1, 0.2]

[[walls]]
name = "lid"
from = [0.0, 0.055]
to = [0.1, 0.055]
motion = { velocity = [0.0, -0.09] }
"#;

/// m/s. With two or three of eight such lids (other speeds, friction, density) a grain is thrown before the run stops.
const LID: f64 = 0.09;
/// m.
const HEIGHT: f64 = 0.055;

/// What a run in a folder says, and its exit code.
fn run(folder: &Path, options: &[&str]) -> (String, Option<i32>) {
    let arguments = [&["run", "scene.toml", "--quiet", "--out", "out"], options].concat();
    let program = env!("CARGO_BIN_EXE_voidage");
    let output = Command::new(program).current_dir(folder).args(arguments).output().unwrap();
    (String::from_utf8(output.stderr).unwrap(), output.status.code())
}

fn folder(scene: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    folder
}

fn summary(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(folder.join("out/summary.json")).unwrap()).unwrap()
}

/// The column of the series by name.
fn column(folder: &Path, name: &str) -> Vec<f64> {
    let text = fs::read_to_string(folder.join("out/series.csv")).unwrap();
    let index = text.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
    text.lines().skip(1).map(|row| row.split(',').nth(index).unwrap().parse().unwrap()).collect()
}

/// The run stops because its grains have no room; nothing has flown by then, and all that it leaves shows the grains
/// where they are.
fn stops(folder: &Path, options: &[&str]) -> String {
    let (said, code) = run(folder, options);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("more than contacts.max_penetration = 0.5 allows"), "{said}");
    assert!(said.contains("no room"), "{said}");
    let summary = summary(folder);
    assert_eq!(summary["outcome"], "failed");
    assert!(summary["max_penetration_over_radius"].as_f64().unwrap() > 0.5, "{summary}");
    assert!(summary["penetrating_steps"].as_u64().unwrap() > 0, "{summary}");
    let fastest = column(folder, "max_grain_speed_m_per_s").into_iter().fold(0.0, f64::max);
    let bound = 10.0 * LID + (2.0 * 9.81 * HEIGHT).sqrt();
    assert!(fastest > 0.0 && fastest < bound, "a grain at {fastest} m/s, above {bound}: {said}");
    let steps = summary["steps"].as_u64().unwrap();
    let frames = fs::read_to_string(folder.join("out/grains.pvd")).unwrap();
    assert!(frames.contains(&format!("grains-{steps:08}.vtp")), "no frame of step {steps} in {frames}");
    let picture = format!("snapshot-{:.3}s.png", steps as f64 * 1e-3);
    for name in ["failed.voidage", &picture] {
        assert!(folder.join("out").join(name).exists(), "no {name}: {said}");
    }
    assert_eq!(column(folder, "time_s").len() as u64, steps + 1);
    said
}

/// They flew at kilometres per second, the last picture was empty, and the run was "done".
#[test]
fn discs_under_a_lid_that_comes_down_stop_the_run() {
    let folder = folder(BOX);
    let said = stops(folder.path(), &[]);
    assert!(said.contains("largest penetration"), "{said}");
    // A higher limit goes on from there.
    let more = ["--set", "contacts.max_penetration=1.0", "--restart", "out/failed.voidage"];
    let before = summary(folder.path())["steps"].as_u64().unwrap();
    run(folder.path(), &more);
    assert!(summary(folder.path())["steps"].as_u64().unwrap() > before);
}

/// It went through the floor.
#[test]
fn a_disc_squeezed_between_floor_and_lid_stops_the_run() {
    let one = BOX.replace("count = 200", "count = 1").replace("0.055]", "0.0055]");
    let said = stops(folder(&one).path(), &[]);
    let names = said.lines().find(|line| line.starts_with("error")).unwrap_or("");
    assert!(
        names.contains("grain 0 and wall \"lid\"") || names.contains("grain 0 and wall \"floor\""),
        "{said}"
    );
    let first =
        said.lines().position(|line| line.contains("overlap by 0.0") || line.contains("overlap by 0.1"));
    assert!(first.is_some(), "no warning of the first overlap: {said}");
}

/// Three quarters of the steps of a collapse were unsolved, and the run said nothing.
#[test]
fn a_run_says_in_its_last_lines_what_it_did_not_solve_whatever_the_scheme() {
    for scheme in ["iterated", "anchored", "henry", "henry-free", "lagged", "explicit"] {
        let folder = folder(BED);
        let options = ["--scheme", scheme, "--set", "contacts.max_sweeps=1", "--set", "time.end=0.02"];
        let (said, code) = run(folder.path(), &options);
        let unsolved = summary(folder.path())["unconverged_steps"].as_u64().unwrap();
        assert_eq!(code, Some(0), "{scheme}: {said}");
        assert!(unsolved > 0, "{scheme}: {said}");
        let line = format!("{unsolved} of 20 steps did not reach the contact tolerance");
        assert!(said.contains(&line), "{scheme}: {said}");
    }
    let (said, code) = run(folder(BED).path(), &["--set", "time.end=0.02"]);
    assert!(code == Some(0) && !said.contains("did not reach") && !said.contains("penetration"), "{said}");
}
