//! `voidage analyse`: what it finds in the folder of a run, and what it refuses.

use assert_cmd::Command;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use voidage_scene::recorder::read_frame;

/// A second group of grains above the first, with a gap between them.
const ABOVE: &str = r#"
[[grains]]
material = "glass"
radius = { uniform = [5e-4, 6e-4] }
solidity = 0.9
amount = { count = 40 }
placement = { lattice = { lower = [0.0, 0.01], upper = [0.01, 0.02], arrangement = "triangular", spacing = 1.05 } }
temperature = 363.15
"#;

/// Runs the small bed with changes; the folder of its results.
fn run(folder: &Path, more: &str, sets: &[&str]) -> PathBuf {
    fs::write(folder.join("scene.toml"), format!("{}{more}", include_str!("bed.toml"))).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    command.current_dir(folder).args(["run", "scene.toml", "--quiet", "--overwrite", "--out", "out"]);
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    command.assert().success();
    folder.join("out")
}

/// Exit code, and what was said to stdout and stderr.
fn analyse(folder: &Path, options: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    let output = command.current_dir(folder).args([&["analyse"], options].concat()).output().unwrap();
    let said = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), said(output.stdout), said(output.stderr))
}

fn good(folder: &Path, options: &[&str]) -> String {
    let (code, said, complained) = analyse(folder, options);
    assert_eq!(code, Some(0), "{options:?}: {complained}");
    said
}

fn refused(folder: &Path, options: &[&str], says: &[&str]) {
    let (code, _, said) = analyse(folder, options);
    assert_eq!(code, Some(2), "{options:?}: {said}");
    assert!(says.iter().all(|part| said.contains(part)), "{options:?}: {says:?} is not in\n{said}");
}

/// The rows of a table by the names of its columns.
fn table(path: PathBuf) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let row = |line: &str| {
        names.iter().zip(line.split(',')).map(|(name, value)| (name.to_string(), value.to_owned())).collect()
    };
    text.lines().skip(1).map(row).collect()
}

fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name}: {row:?}"))
}

#[test]
fn a_run_is_analysed() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(folder.path(), ABOVE, &["output.frame_interval=1e-3"]);
    let options =
        ["out", "--spectrum", "pressure_drop_Pa", "--spectrum", "mean_grain_height_m", "--segments", "1"];
    let options =
        [&options[..], &["--from", "0", "--mixing-cell", "2.5e-3", "--smallest-bubble", "1e-9"]].concat();
    let said = good(folder.path(), &options);
    let found = out.join("analysis");
    for name in [
        "analysis.csv",
        "spectra.csv",
        "spectrum.csv",
        "spectrum.png",
        "bed.csv",
        "bed.png",
        "bubbles.csv",
        "profiles.csv",
        "profiles.png",
        "mean-fields.vtu",
        "mean-fields.png",
    ] {
        assert!(found.join(name).is_file() && said.contains(name), "{name}: {said}");
    }
    // Every column of the series has a row, whose mean is that of the window.
    let series = table(out.join("series.csv"));
    let rows = table(found.join("analysis.csv"));
    let of_series: Vec<_> = rows.iter().filter(|row| row["source"] == "series").collect();
    assert_eq!(of_series.len() + 1, series[0].len());
    let drop = of_series.iter().find(|row| row["column"] == "pressure_drop_Pa").unwrap();
    let mean = series.iter().map(|row| number(row, "pressure_drop_Pa")).sum::<f64>() / series.len() as f64;
    assert!((number(drop, "mean") / mean - 1.0).abs() < 1e-12 && number(drop, "rows") == 41.0, "{drop:?}");
    // The bed falls: none of these rows is taken for a mean with an error.
    let height = of_series.iter().find(|row| row["column"] == "mean_grain_height_m").unwrap();
    assert!(height["verdict"] != "good" && height["standard_error"] == "NaN", "{height:?}");
    assert!(said.contains("not stationary"), "{said}");
    // The two groups are apart at first, and closer at the end.
    let bed = table(found.join("bed.csv"));
    assert_eq!(bed.len(), 41);
    assert!(number(&bed[0], "lacey_index").abs() < 1e-12, "{:?}", bed[0]);
    assert!(said.contains("first group"), "{said}");
    let heights =
        |row: usize| number(&bed[row], "mean_height_m") / number(&series[row], "mean_grain_height_m");
    assert!(
        (heights(0) - 1.0).abs() < 1e-9 && (heights(40) - 1.0).abs() < 1e-9,
        "{} {}",
        heights(0),
        heights(40)
    );
    // The layers hold all of the solid, and move it as the grains do.
    let frame = read_frame(&out.join("frames/grains-00000000.vtp")).unwrap();
    assert_eq!(frame.column("group").unwrap().iter().filter(|group| **group == 1.0).count(), 40);
    let profiles = table(found.join("profiles.csv"));
    let thickness = number(&profiles[1], "height_m") - number(&profiles[0], "height_m");
    let solid: f64 =
        profiles.iter().map(|row| number(row, "solid_fraction") * number(row, "width_m") * thickness).sum();
    let radii = frame.column("radius_m").unwrap().iter().zip(frame.column("group").unwrap());
    let exact: f64 = radii
        .map(|(radius, group)| {
            std::f64::consts::PI * radius * radius * if *group == 0.0 { 0.8165 } else { 0.9 }
        })
        .sum();
    // Grains that press on the floor are a little below it.
    assert!((solid / exact - 1.0).abs() < 1e-5, "{solid} {exact}");
    // The mean fields are those of the frames.
    let means = read_frame(&found.join("mean-fields.vtu")).unwrap();
    assert!(means.column("voidage_standard_error").is_some() && means.column("velocity_m_per_s").is_some());
    let voidage = means.column("voidage").unwrap();
    assert!(voidage.iter().all(|voidage| (0.0..=1.0).contains(voidage)));
    // A new run in the folder takes the old analysis away.
    run(folder.path(), "", &[]);
    assert!(!found.join("analysis.csv").exists() && !found.join("profiles.png").exists());
}

#[test]
fn a_series_without_frames_is_analysed() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("out")).unwrap();
    fs::write(folder.path().join("out/scene.toml"), include_str!("bed.toml")).unwrap();
    // The columns that this scene records, and one that falls out.
    let row = |k: u32| {
        let part = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let gap = if k == 30 { "NaN".to_owned() } else { format!("{}", 0.3 * part) };
        format!("{},{},{},300,{gap}\n", f64::from(k) * 1e-3, 350.0 + 0.1 * part, 100.0 + part)
    };
    let text = |rows: &[u32]| {
        let header = "time_s,mean_grain_temperature_K,pressure_drop_Pa,min_grain_temperature_K,other\n";
        header.to_owned() + &rows.iter().map(|k| row(*k)).collect::<String>()
    };
    let write = |rows: &[u32]| fs::write(folder.path().join("out/series.csv"), text(rows)).unwrap();
    let all: Vec<u32> = (0..=400).collect();
    write(&all);
    let said = good(folder.path(), &["out", "--out", "elsewhere"]);
    assert!(said.contains("no frames") && !folder.path().join("out/analysis").exists(), "{said}");
    let rows = table(folder.path().join("elsewhere/analysis.csv"));
    let verdict = |name: &str| rows.iter().find(|row| row["column"] == name).unwrap()["verdict"].clone();
    assert_eq!(verdict("min_grain_temperature_K"), "constant");
    assert_eq!(verdict("other"), "gaps");
    // The window of the average ends at 0.04 s; 31 rows do not make a spectrum.
    assert!(said.contains("no spectrum of pressure_drop_Pa"), "{said}");
    refused(folder.path(), &["out", "--spectrum", "pressure_drop_Pa"], &["31 rows"]);
    refused(
        folder.path(),
        &["out", "--spectrum", "nothing"],
        &["no such column", "it has mean_grain_temperature_K, pressure_drop_Pa"],
    );
    refused(folder.path(), &["out", "--from", "0", "--spectrum", "other"], &["1 of its 41 rows"]);
    let constant = ["out", "--from", "0", "--spectrum", "min_grain_temperature_K"];
    refused(folder.path(), &constant, &["constant"]);
    // Rows that are missing are not filled.
    let cut: Vec<u32> = all.iter().copied().filter(|k| *k != 20).collect();
    write(&cut);
    refused(folder.path(), &["out"], &["not at even times", "0.019 s is followed by 0.021 s", "--from"]);
    let said = good(folder.path(), &["out", "--from", "0.1", "--to", "0.39"]);
    assert!(said.contains("spectrum of pressure_drop_Pa"), "{said}");
}

#[test]
fn what_is_no_run_or_no_option_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("out")).unwrap();
    refused(folder.path(), &["out"], &["holds no scene.toml", "--out"]);
    fs::write(folder.path().join("out/scene.toml"), include_str!("bed.toml")).unwrap();
    refused(folder.path(), &["out"], &["neither rows of series.csv nor frames"]);
    fs::remove_dir_all(folder.path().join("out")).unwrap();
    let out = run(folder.path(), "", &[]);
    refused(folder.path(), &["out", "--from", "0.5"], &["--from 0.5", "from 0 s to 0.04 s"]);
    refused(folder.path(), &["out", "--from", "0.03", "--to", "0.01"], &["no such window"]);
    refused(folder.path(), &["out", "--from", "NaN"], &["--from NaN"]);
    refused(folder.path(), &["out", "--bubble-voidage", "1.5"], &["between 0 and 1"]);
    refused(folder.path(), &["out", "--mixing-cell", "0"], &["above 0"]);
    refused(folder.path(), &["out", "--segments", "0"], &["at least one"]);
    // A damaged frame is told from one that shows nothing.
    let frame = out.join("frames/grains-00000020.vtp");
    let bytes = fs::read(&frame).unwrap();
    fs::write(&frame, &bytes[..bytes.len() / 2]).unwrap();
    refused(folder.path(), &["out"], &["grains-00000020.vtp"]);
    assert!(!out.join("analysis").exists());
    // A column that is no longer there.
    let position = bytes.windows(8).position(|window| window == b"radius_m").unwrap();
    let mut other = bytes.clone();
    other[position] = b'x';
    fs::write(&frame, &other).unwrap();
    refused(folder.path(), &["out"], &["grains-00000020.vtp", "no column `radius_m`"]);
}
