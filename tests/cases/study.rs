//! `voidage study`: what it finds, that it goes on where it stopped, that parts make the whole, and what it says of bad
//! input.

use assert_cmd::Command;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

const BED: &str = include_str!("bed.toml");

/// Exact values, three schemes, no files: seconds.
const SLIP: &str = r#"
title = "Slip"
case = { problem = "slip-box" }
reference = "exact"

[[quantities]]
name = "slip"
of = { error = "slip" }

[[sweeps]]
refine = "dt"

[sweeps.vary]
dt = [0.5, 0.1, 0.02]
scheme = ["explicit", "henry"]
"#;

/// A scene with all kinds of quantities.
const SMALL_BED: &str = r#"
title = "Small bed"
case = { scene = "scene.toml" }
set = { time.end = 0.016, coupling.scheme = "henry" }
reference = "finest"

[[quantities]]
name = "temperature"
of = { series = "mean_grain_temperature_K" }
at = [0.005, 0.016]
scale = 70.0

[[quantities]]
name = "field"
of = { field = "temperature" }

[[quantities]]
name = "grain"
of = { grain = { number = 3, column = "position", axis = 1 } }

[[quantities]]
name = "penetration"
of = { summary = "max_penetration_over_radius" }
exact = [0.0]
scale = 1.0

[[sweeps]]
refine = "time.step"
label = "time step (s)"

[sweeps.vary]
time.step = [4e-3, 2e-3, 1e-3]
fluid.mesh.rectangle.size = [4e-3, 3e-3]
"#;

/// A shipped case by its name, settings that change together, and no reference: values, no errors.
const TABLE: &str = r#"
title = "Two liquids"
case = { scene = "settling-grain" }
set = { time.end = 0.02 }
reference = "none"

[[quantities]]
name = "velocity"
of = { grain = { number = 0, column = "velocity", axis = 1 } }
at = [0.01, 0.02]

[[sweeps]]
points = [{ time.step = 1e-2, fluid.viscosity = 1e-3 }, { time.step = 5e-3, fluid.viscosity = 2e-3 }]
vary = { coupling.scheme = ["henry", "explicit"] }
"#;

fn voidage() -> Command {
    Command::new(env!("CARGO_BIN_EXE_voidage"))
}

/// A folder with a study and the small bed in it.
fn folder(study: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    fs::write(folder.path().join("study.toml"), study).unwrap();
    folder
}

/// What a study says, which ends well.
fn study(folder: &Path, out: &str, options: &[&str]) -> String {
    let arguments = [&["study", "study.toml", "--quiet", "--out", out], options].concat();
    let output = voidage().current_dir(folder).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    String::from_utf8(output.stdout).unwrap()
}

/// The rows of results.csv by column.
fn results(out: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(out.join("results.csv")).unwrap();
    reader.deserialize().map(|row| row.unwrap()).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} of {row:?}"))
}

/// Whether a row is of a time step and a mesh size.
fn is_at(row: &BTreeMap<String, String>, step: f64, size: f64) -> bool {
    number(row, "time.step") == step && number(row, "fluid.mesh.rectangle.size") == size
}

/// Rows of a table of runs.
fn rows(path: &Path) -> usize {
    fs::read_to_string(path).map_or(0, |text| text.lines().count().saturating_sub(1))
}

/// With the predicted velocity slip falls by 1/(1 + A + B) a step: after 1/s steps of A + B = s what is left is (1 +
/// s)^(-1/s) and should be 1/e.
#[test]
fn errors_of_the_slip_box_are_those_of_its_factors() {
    let folder = folder(SLIP);
    let said = study(folder.path(), "out", &[]);
    let rows = results(&folder.path().join("out"));
    assert_eq!(rows.len(), 6);
    for row in rows.iter().filter(|row| row["curve"] == "henry") {
        let share = number(row, "dt");
        let exact = ((1.0 + share).powf(-1.0 / share) * 1f64.exp() - 1.0).abs();
        let found = number(row, "error_of_slip");
        assert!((found / exact - 1.0).abs() < 1e-4, "{found} {exact}");
    }
    assert!(said.contains("slip: 1 % for the least time: dt = 0."), "{said}");
    for name in ["study.png", "study-phases.png"] {
        let picture = fs::read(folder.path().join("out").join(name)).unwrap();
        assert!(picture.starts_with(b"\x89PNG") && picture.len() > 5000, "{name}");
    }
}

#[test]
fn a_scene_is_compared_with_its_finest_run_in_all_kinds_of_quantities() {
    let folder = folder(SMALL_BED);
    study(folder.path(), "out", &[]);
    let rows = results(&folder.path().join("out"));
    assert_eq!(rows.len(), 6);
    for row in &rows {
        let is_reference = row["is_reference"] == "true";
        assert_eq!(is_reference, is_at(row, 1e-3, 3e-3));
        for quantity in ["temperature", "field", "grain"] {
            let error = number(row, &format!("error_of_{quantity}"));
            assert_eq!(error < 1e-13, is_reference, "{quantity}: {error} of {row:?}");
            assert!(error < 0.2, "{quantity}: {error} of {row:?}");
        }
        assert!(number(row, "steps") == (0.016 / number(row, "time.step")).round());
        assert!(number(row, "fluid_solves") == number(row, "steps"));
        let phases: f64 = ["overlap", "closure", "energy", "flow", "exchange", "transport", "contacts"]
            .map(|phase| number(row, &format!("{phase}_s")))
            .iter()
            .sum();
        assert!(phases > 0.0 && phases <= number(row, "steps_s"), "{row:?}");
        assert!(number(row, "cpu_s") > 0.0 && number(row, "wall_s") >= number(row, "steps_s"));
    }
    // The same mesh, steps halved: the error in the temperature falls.
    let error =
        |step: f64| number(rows.iter().find(|row| is_at(row, step, 3e-3)).unwrap(), "error_of_temperature");
    assert!(error(2e-3) < 0.8 * error(4e-3), "{} {}", error(2e-3), error(4e-3));
    // What is there is not run again, and more values make no other runs.
    let measured = fs::read(folder.path().join("out/measured.csv")).unwrap();
    let more = SMALL_BED.replace("[4e-3, 2e-3, 1e-3]", "[8e-3, 4e-3, 2e-3, 1e-3]");
    fs::write(folder.path().join("study.toml"), more).unwrap();
    study(folder.path(), "out", &[]);
    let now = fs::read(folder.path().join("out/measured.csv")).unwrap();
    assert!(now.starts_with(&measured));
    assert_eq!(self::rows(&folder.path().join("out/measured.csv")), 8);
}

/// The end, the output and the solver of a scene do not decide its course, but what is measured; rows of before were
/// taken for those of now. A grain is the one of this number, not of this place, and numbers of the program are none of
/// the run.
#[test]
fn a_scene_that_measures_something_else_is_run_again() {
    let folder = folder(SMALL_BED);
    study(folder.path(), "out", &[]);
    let other = BED.replace("from = \"inflow\", to = \"outflow\"", "from = \"outflow\", to = \"inflow\"");
    fs::write(folder.path().join("scene.toml"), other).unwrap();
    study(folder.path(), "out", &[]);
    assert_eq!(rows(&folder.path().join("out/measured.csv")), 12);
    let of = "{ summary = \"threads\" }";
    let text = SMALL_BED.replacen("{ series = \"mean_grain_temperature_K\" }", of, 1);
    assert!(text.contains(of));
    fs::write(folder.path().join("study.toml"), text).unwrap();
    let arguments = ["study", "study.toml", "--quiet", "--out", "other"];
    let output = voidage().current_dir(folder.path()).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains("the summary has no such number"), "{said}");
}

/// Starts a study and ends it by a signal after its first run; its exit code.
#[cfg(unix)]
fn stopped_by(signal: &str, folder: &Path) -> Option<i32> {
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_voidage"))
        .current_dir(folder)
        .args(["study", "study.toml", "--quiet", "--out", "out"])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while rows(&folder.join("out/measured.csv")) == 0 {
        assert!(start.elapsed() < Duration::from_secs(60), "no run ends");
        std::thread::sleep(Duration::from_millis(1));
    }
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args([signal, &id]).status().unwrap().success());
    child.wait().unwrap().code()
}

/// A sweep had to vary key by key, needed errors, and knew no shipped case.
#[test]
fn a_study_is_a_table_of_values_over_settings_that_change_together() {
    let folder = folder(TABLE);
    let said = study(folder.path(), "out", &[]);
    let rows = results(&folder.path().join("out"));
    assert_eq!(rows.len(), 4);
    assert!(said.lines().count() >= 5 && said.contains("velocity_at_0.01_s"), "{said}");
    assert!(
        !rows[0].keys().any(|column| column.contains("error") || column == "is_reference"),
        "{:?}",
        rows[0]
    );
    let of = |rows: &[BTreeMap<String, String>], step: f64, scheme: &str| {
        let row =
            rows.iter().find(|row| number(row, "time.step") == step && row["coupling.scheme"] == scheme);
        let row = row.unwrap();
        [number(row, "fluid.viscosity"), number(row, "velocity_at_0.01_s"), number(row, "velocity_at_0.02_s")]
    };
    for scheme in ["henry", "explicit"] {
        let [thin, viscous] = [1e-2, 5e-3].map(|step| of(&rows, step, scheme));
        assert_eq!([thin[0], viscous[0]], [1e-3, 2e-3]);
        assert!(thin[2] < viscous[2] && viscous[2] < 0.0 && thin[2] < thin[1], "{thin:?} {viscous:?}");
    }
    // Along a key of the points there are curves, of the same runs, and a picture.
    let refined = TABLE.replace("points =", "refine = \"time.step\"\npoints =");
    fs::write(folder.path().join("study.toml"), refined).unwrap();
    study(folder.path(), "refined", &[]);
    let curves = results(&folder.path().join("refined"));
    assert_eq!(curves.iter().filter(|row| row["curve"] == "henry").count(), 2);
    assert_eq!(of(&curves, 5e-3, "explicit"), of(&rows, 5e-3, "explicit"));
    assert!(
        folder.path().join("refined/study.png").is_file() && !folder.path().join("out/study.png").exists()
    );
}

/// Which of two runs that take as long is the better one is not known.
#[test]
fn the_finest_of_runs_that_cost_the_same_was_any_of_them() {
    let folder = folder(&SMALL_BED.replace("coupling.scheme = \"henry\" }", "threads = 1 }"));
    let path = folder.path().join("study.toml");
    let text = fs::read_to_string(&path).unwrap();
    let schemes = "[sweeps.vary]\ncoupling.scheme = [\"henry\", \"explicit\"]";
    fs::write(&path, text.replace("[sweeps.vary]", schemes)).unwrap();
    let output = voidage().current_dir(folder.path()).args(["study", "study.toml"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    for part in ["2 runs are estimated to take as long", "scheme=explicit", "reference = { run"] {
        assert!(said.contains(part), "{said}");
    }
}

#[cfg(unix)]
#[test]
fn a_study_that_was_killed_or_interrupted_goes_on_where_it_stopped() {
    // Long enough for the signal to come before the end.
    let long = SMALL_BED.replace("time.end = 0.016", "time.end = 0.08");
    for (signal, code) in [("-KILL", None), ("-INT", Some(1))] {
        let folder = folder(&long);
        assert_eq!(stopped_by(signal, folder.path()), code);
        let table = folder.path().join("out/measured.csv");
        let before = fs::read_to_string(&table).unwrap();
        assert!((1..6).contains(&rows(&table)), "{before}");
        // Half a row, as a full disk may leave it.
        fs::write(&table, format!("{before}0123456789abcdef,do")).unwrap();
        study(folder.path(), "out", &[]);
        let after = fs::read_to_string(&table).unwrap();
        assert!(after.starts_with(&before), "what was there has changed");
        assert_eq!(rows(&table), 6, "{after}");
    }
}

#[test]
fn parts_make_the_same_table_as_one_run() {
    let folder = folder(SLIP);
    study(folder.path(), "whole", &[]);
    study(folder.path(), "parts", &["--index", "0", "--count", "2"]);
    let parts = folder.path().join("parts");
    assert!(!parts.join("results.csv").exists(), "a part writes what belongs to all");
    study(folder.path(), "parts", &["--index", "1", "--count", "2"]);
    assert_eq!([0, 1].map(|k| rows(&parts.join(format!("measured-{k}-of-2.csv")))), [3, 3]);
    study(folder.path(), "parts", &[]);
    assert_eq!(rows(&parts.join("measured.csv")), 0, "nothing is run again");
    let bare = |out: &str| {
        let mut all = results(&folder.path().join(out));
        for row in &mut all {
            row.retain(|column, _| !column.ends_with("_s") && column != "spread");
        }
        all
    };
    assert_eq!(bare("whole"), bare("parts"));
}

/// The short form of the studies that this program ships, but for those that need Python or a minute.
#[test]
fn shipped_studies_are_valid_and_run_in_their_quick_form() {
    let studies = Path::new(env!("CARGO_MANIFEST_DIR")).join("../studies");
    let mut count = 0;
    for entry in fs::read_dir(&studies).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") && !path.ends_with("Cargo.toml") {
            voidage().arg("study").arg(&path).arg("--list").assert().success();
            voidage().arg("study").arg(&path).args(["--list", "--quick"]).assert().success();
            count += 1;
        }
    }
    assert!(count >= 6, "{count}");
    let out = tempfile::tempdir().unwrap();
    for name in ["settling", "stack"] {
        let path = studies.join(format!("{name}.toml"));
        let folder = out.path().join(name);
        let arguments = [
            "study".as_ref(),
            path.as_os_str(),
            "--quick".as_ref(),
            "--quiet".as_ref(),
            "--out".as_ref(),
            folder.as_os_str(),
        ];
        voidage().args(arguments).assert().success();
        let rows = results(&folder);
        assert!(rows.len() >= 6, "{name}: {rows:?}");
        let column = rows[0].keys().find(|column| column.starts_with("error_of")).unwrap().clone();
        for pair in rows.windows(2).filter(|pair| pair[0]["curve"] == pair[1]["curve"]) {
            let [coarse, fine] = [0, 1].map(|k| number(&pair[k], &column));
            // What settles to rounding does so whatever the tolerance.
            let settled = fine == coarse && fine < 1e-6;
            assert!((fine < coarse || settled) && fine.is_finite(), "{name}: {pair:?}");
        }
    }
}

/// Each: a text of the good study and what it is replaced by, how the line at fault begins, and what is said.
const MISTAKES: &[([&str; 2], &str, &[&str])] = &[
    (["refine =", "refin ="], "refin", &["sweeps[0].refin", "did you mean `refine`?"]),
    (["reference = \"exact\"\n", ""], "", &["missing field `reference`", "What results are compared with"]),
    (["\"exact\"", "\"exakt\""], "reference =", &["exakt", "finest"]),
    (["\"exact\"", "\"finest\""], "reference =", &["a problem knows its errors", "reference = \"exact\""]),
    (["\"slip-box\"", "\"slip\""], "case =", &["case.problem", "slip-box"]),
    (
        ["problem = \"slip-box\"", "scene = \"nowhere.toml\""],
        "case =",
        &["nowhere.toml", "relative to the study"],
    ),
    (["error = \"slip\"", "error = \"slipp\""], "of =", &["slipp", "use one of slip"]),
    (["error = \"slip\"", "series = \"time_s\""], "of =", &["no such quantity", "error"]),
    (["\"dt\"", "\"step\""], "refine =", &["`sweeps[0].refine = \"step\"` is not varied", "dt, scheme"]),
    (["0.02]", "\"fine\"]"], "dt =", &["dt = \"fine\"", "above 0"]),
    (["[0.5, 0.1, 0.02]", "[]"], "dt =", &["sweeps[0].vary.dt", "give a list"]),
    (["dt = [", "dtt = [0.1]\ndt = ["], "dtt =", &["dtt", "did you mean `dt`?"]),
    (["\"henry\"]", "\"henri\"]"], "scheme =", &["henri", "Coupling scheme"]),
    (["0.02]", "2.0]"], "", &["`end = 1`", "at least one step"]),
    (["reference =", "repeats = 0\nreference ="], "repeats =", &["repeats = 0", "above 0"]),
    (["reference =", "target = -1\nreference ="], "target =", &["target = -1", "above 0"]),
    (["reference =", "set = { threads = 0 }\nreference ="], "set =", &["threads = 0", "1 or more"]),
    (["reference =", "target = nan\nreference ="], "target =", &["finite"]),
];

/// In the table of values.
const MISTAKES_IN_TABLES: &[([&str; 2], &str, &[&str])] = &[
    (["\"settling-grain\"", "\"settling\""], "case =", &["no shipped case", "settling-grain-light"]),
    (["\"none\"", "\"exact\""], "name =", &["has no known values"]),
    (["\"none\"", "\"finest\""], "[[sweeps]]", &["has no `refine`", "coupling.scheme, fluid.viscosity"]),
    (["at = [0.01, 0.02]", "exact = [0.1]"], "exact =", &["compared with nothing", "leave out `exact`"]),
    (["5e-3, fluid.viscosity = 2e-3", "5e-3"], "points =", &["points[1]", "same keys"]),
    (["vary = {", "vary = { time.step = [1e-3],"], "points =", &["time.step", "in `vary` too"]),
    (["5e-3, fluid.viscosity = 2e-3", "5e-3, fluid.viscosity = -1.0"], "points =", &["viscosity", "-1"]),
];

const MISTAKES_WITH_SCENES: &[([&str; 2], &str, &[&str])] = &[
    (
        ["time.step = [", "time.stepp = [1e-3]\ntime.step = ["],
        "time.stepp",
        &["time.stepp", "did you mean `step`?"],
    ),
    (["[4e-3, 2e-3, 1e-3]", "[4e-3, 2e-3, 1e3]"], "set =", &["time.end = 0.016", "1000 s"]),
    (["\"henry\" }", "\"henri\" }"], "set =", &["coupling.scheme", "henri", "iterated"]),
    (["at = [0.005, 0.016]", "at = [0.005, 0.6]"], "at =", &["0.6 s is after the end", "time.end"]),
    (
        ["\"mean_grain_temperature_K\"", "\"mean_temperature\""],
        "of = { series",
        &["mean_temperature", "mean_grain_temperature_K"],
    ),
    (
        ["max_penetration_over_radius", "penetration"],
        "of = { summary",
        &["no such number", "max_penetration_over_radius"],
    ),
    (["number = 3", "number = 3000"], "of = { grain", &["no grain 3000", "from 0"]),
    (["axis = 1", "axis = 2"], "of = { grain", &["no axis 2"]),
    (["\"finest\"", "\"exact\""], "name = \"temperature\"", &["no known values", "exact = [..]"]),
    (["scale = 1.0", ""], "exact =", &["divided by a known value of 0", "scale"]),
    (["exact = [0.0]", "exact = [0.0, 1.0]"], "exact =", &["2 known values for 1 times"]),
    (["name = \"grain\"", "name = \"field\""], "name = \"field\"", &["second quantity"]),
];

#[test]
fn mistakes_are_named_with_file_line_value_and_remedy() {
    let with =
        |text| move |mistake: &([&'static str; 2], &'static str, &'static [&'static str])| (text, *mistake);
    let all = MISTAKES.iter().map(with(SLIP)).chain(MISTAKES_WITH_SCENES.iter().map(with(SMALL_BED)));
    let all = all.chain(MISTAKES_IN_TABLES.iter().map(with(TABLE)));
    for (good, ([from, to], line, says)) in all {
        assert!(good.contains(from), "{from} is not in the study");
        let text = good.replacen(from, to, 1);
        let folder = folder(&text);
        let arguments = ["study", "study.toml", "--quiet", "--out", "out"];
        let output = voidage().current_dir(folder.path()).args(arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{to}: {said}");
        let lines: Vec<&str> = text.lines().collect();
        let number = lines.iter().rposition(|text| !line.is_empty() && text.starts_with(line)).map(|k| k + 1);
        let place = number.map_or("study.toml:".to_owned(), |number| format!("study.toml:{number}:"));
        for part in says.iter().copied().chain([place.as_str()]) {
            assert!(said.contains(part), "{to}: `{part}` is not in\n{said}");
        }
    }
}

#[test]
fn wrong_options_are_named() {
    let folder = folder(SLIP);
    let run = |options: &[&str]| {
        let output = voidage().current_dir(folder.path()).args(options).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, said) = run(&["study", "study.toml", "--index", "2", "--count", "2"]);
    assert!(code == Some(2) && said.contains("--index 2 --count 2") && said.contains("from 0"), "{said}");
    assert_eq!(run(&["study", "study.toml", "--index", "2"]).0, Some(2));
    let (code, said) = run(&["study", "nowhere.toml"]);
    assert!(code == Some(2) && said.contains("nowhere.toml"), "{said}");
}
