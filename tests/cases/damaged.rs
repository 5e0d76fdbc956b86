//! Tables that were damaged or cut off are refused with file, line and value, by whatever reads them again: pictures,
//! restarts, studies and stability maps.

use assert_cmd::Command;
use std::fs;
use std::path::Path;

const BED: &str = include_str!("bed.toml");

const STUDY: &str = r#"
title = "Slip"
case = { problem = "slip-box" }
reference = "exact"

[[quantities]]
name = "slip"
of = { error = "slip" }

[[sweeps]]
refine = "dt"

[sweeps.vary]
dt = [0.5, 0.1]
scheme = ["explicit", "henry"]
"#;

/// What is done to a table: the number of a line, a text of it, and what stands there instead.
type Damage<'a> = (usize, &'a str, &'a str);

/// Exit code of a command in a folder, and what it said.
fn said(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    let output = command.current_dir(folder).args(arguments).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

fn good(folder: &Path, arguments: &[&str]) -> String {
    let (code, said) = said(folder, arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {said}");
    said
}

/// A text with another one in place of a part of a line, which is numbered from 1.
fn damaged(text: &str, (line, from, to): Damage) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    assert!(lines[line - 1].contains(from), "`{from}` is not in `{}`", lines[line - 1]);
    lines[line - 1] = lines[line - 1].replacen(from, to, 1);
    lines.join("\n") + "\n"
}

/// A value of a table by its line, from 1, and its column.
fn value<'a>(text: &'a str, line: usize, column: &str) -> &'a str {
    let at = text.lines().next().unwrap().split(',').position(|name| name == column);
    text.lines().nth(line - 1).unwrap().split(',').nth(at.unwrap()).unwrap()
}

/// Damages a table, checks that a command refuses it with this line and these words and leaves it alone, and puts it
/// right again.
fn refused(folder: &Path, table: &str, damage: Damage, arguments: &[&str], says: &[&str]) {
    let path = folder.join(table);
    let before = fs::read_to_string(&path).unwrap();
    let after = damaged(&before, damage);
    fs::write(&path, &after).unwrap();
    let (code, said) = said(folder, arguments);
    assert_eq!(code, Some(2), "{table} {damage:?}: {said}");
    let name = Path::new(table).file_name().unwrap().to_string_lossy();
    let place = format!("{name}:{}: ", damage.0);
    for part in says.iter().copied().chain([place.as_str()]) {
        assert!(said.contains(part), "{table} {damage:?}: `{part}` is not in\n{said}");
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), after, "{table}: what is refused is left alone");
    fs::write(&path, before).unwrap();
}

fn pictures(folder: &Path) -> usize {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|end| end == "png")).count()
}

#[test]
fn pictures_of_damaged_tables_are_not_drawn() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    good(folder.path(), &["run", "scene.toml", "--quiet", "--out", "out"]);
    let drawn = pictures(&folder.path().join("out"));
    let series = fs::read_to_string(folder.path().join("out/series.csv")).unwrap();
    let (mean, drop) =
        (value(&series, 20, "mean_grain_temperature_K"), value(&series, 20, "pressure_drop_Pa"));
    let (row, time) = (series.lines().nth(19).unwrap(), value(&series, 20, "time_s"));
    let half = &row[..row.len() / 2];
    let doubled = format!("{time},{}", row.split_once(',').unwrap().1);
    let cases: &[(Damage, &[&str])] = &[
        ((20, row, half), &[" values for ", half]),
        ((20, row, ""), &["1 values for "]),
        ((20, mean, "NaN"), &["`mean_grain_temperature_K` is NaN"]),
        ((20, drop, "inf"), &["`pressure_drop_Pa` is inf"]),
        ((20, mean, "3x2"), &["`mean_grain_temperature_K` is `3x2`, which is no number"]),
        ((21, series.lines().nth(20).unwrap(), &doubled), &["`time_s` is ", " in the row before"]),
        ((1, "pressure_drop_Pa", "pressure_drop"), &["has no column `pressure_drop_Pa`"]),
        ((1, "time_s", "time"), &["has no column `time_s`"]),
    ];
    for entry in fs::read_dir(folder.path().join("out")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|end| end == "png") {
            fs::remove_file(path).unwrap();
        }
    }
    for (damage, says) in cases {
        refused(folder.path(), "out/series.csv", *damage, &["plot", "out"], says);
    }
    let averages = fs::read_to_string(folder.path().join("out/averages.csv")).unwrap();
    let row = averages.lines().nth(7).unwrap();
    let cases: &[(Damage, &[&str])] = &[
        ((8, row, &row[..row.len() / 2]), &[" values for 5 columns"]),
        ((8, value(&averages, 8, "x_m"), "0.5"), &["off the grid"]),
        ((8, value(&averages, 8, "x_m"), "NaN"), &["`x_m` is NaN"]),
        ((1, "packing_fraction", "packing"), &["has no column `packing_fraction`"]),
    ];
    for (damage, says) in cases {
        refused(folder.path(), "out/averages.csv", *damage, &["plot", "out"], says);
    }
    let whole = averages.lines().count() - 1;
    let shorter: String = averages.lines().take(whole).map(|line| format!("{line}\n")).collect();
    fs::write(folder.path().join("out/averages.csv"), shorter).unwrap();
    let (code, text) = said(folder.path(), &["plot", "out"]);
    assert!(code == Some(2) && text.contains("ends within a row of the grid"), "{text}");
    fs::write(folder.path().join("out/averages.csv"), &averages).unwrap();
    assert_eq!(pictures(&folder.path().join("out")), 0, "pictures of damaged tables");
    // The end of a row that a run has not finished is left out, with a warning.
    fs::write(folder.path().join("out/series.csv"), format!("{series}0.041,3")).unwrap();
    let text = good(folder.path(), &["plot", "out"]);
    assert!(text.contains(&format!("series.csv:{}: half a row", series.lines().count() + 1)), "{text}");
    assert_eq!(pictures(&folder.path().join("out")), drawn);
}

#[test]
fn a_run_does_not_go_on_behind_a_damaged_series() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    good(folder.path(), &["run", "scene.toml", "--quiet", "--out", "out", "--until", "0.03"]);
    let series = fs::read_to_string(folder.path().join("out/series.csv")).unwrap();
    let (row, mean) = (series.lines().nth(9).unwrap(), value(&series, 10, "mean_grain_temperature_K"));
    let on = ["run", "scene.toml", "--quiet", "--out", "out", "--restart", "out/checkpoint.voidage"];
    refused(folder.path(), "out/series.csv", (10, row, &row[..row.len() / 2]), &on, &[" values for "]);
    refused(
        folder.path(),
        "out/series.csv",
        (10, mean, "3x2"),
        &on,
        &["`mean_grain_temperature_K` is `3x2`"],
    );
    refused(
        folder.path(),
        "out/series.csv",
        (10, value(&series, 10, "time_s"), "NaN"),
        &on,
        &["`time_s` is NaN"],
    );
    good(folder.path(), &on);
    let after = fs::read_to_string(folder.path().join("out/series.csv")).unwrap();
    assert!(after.starts_with(&series) && after.lines().count() == 42, "{}", after.lines().count());
}

#[test]
fn a_study_does_not_use_damaged_runs() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("study.toml"), STUDY).unwrap();
    let study = ["study", "study.toml", "--quiet", "--out", "out"];
    good(folder.path(), &study);
    let table = "out/measured.csv";
    let measured = fs::read_to_string(folder.path().join(table)).unwrap();
    let row = measured.lines().nth(2).unwrap();
    let [wall, values, version] = ["wall_s", "values", "version"].map(|name| value(&measured, 3, name));
    let digit = if values.contains('7') { ("7", "8") } else { ("1", "2") };
    let other = values.replacen(digit.0, digit.1, 1);
    let cases: &[(Damage, &[&str])] = &[
        ((3, row, &row[..row.len() / 2]), &[" values for "]),
        ((3, wall, "NaN"), &["`wall_s` is NaN"]),
        ((3, wall, "1x"), &["`wall_s` is `1x`"]),
        ((3, values, "none"), &["`values` holds `none`"]),
        ((3, values, &other), &["the row has changed since it was written", &other]),
        ((3, &format!(",{version},"), ",0.0.1,"), &["`version` is `0.0.1`"]),
        ((1, ",check", ""), &["its last column is `version`"]),
    ];
    for (damage, says) in cases {
        refused(folder.path(), table, *damage, &study, says);
    }
    fs::write(folder.path().join(table), measured.replacen("wall_s", "wall", 1)).unwrap();
    let (code, text) = said(folder.path(), &study);
    assert!(code == Some(2) && text.contains("measured.csv:2: missing field `wall_s`"), "{text}");
    // The file of a part, which another machine has written, is read as carefully.
    fs::write(folder.path().join("out/measured-0-of-2.csv"), damaged(&measured, (3, wall, "NaN"))).unwrap();
    fs::write(folder.path().join(table), &measured).unwrap();
    let (code, text) = said(folder.path(), &study);
    assert!(code == Some(2) && text.contains("measured-0-of-2.csv:3: `wall_s` is NaN"), "{text}");
    fs::remove_file(folder.path().join("out/measured-0-of-2.csv")).unwrap();
    // A row that was removed is measured again, and so is one whose end is missing, which a warning names.
    let without: String = measured.lines().take(4).map(|line| format!("{line}\n")).collect();
    for text in [without.clone(), measured[..measured.len() - 3].to_owned()] {
        fs::write(folder.path().join(table), &text).unwrap();
        let warned = good(folder.path(), &study).contains("measured.csv:5: half a row");
        assert_eq!(warned, text != without);
        let again = fs::read_to_string(folder.path().join(table)).unwrap();
        assert!(again.starts_with(&without) && again.lines().count() == 5, "{again}");
    }
}

#[test]
fn a_stability_map_does_not_go_on_behind_damaged_points() {
    let folder = tempfile::tempdir().unwrap();
    let map = ["stability", "--quick", "--only", "slip", "--scheme", "henry", "--quiet", "--out", "out"];
    good(folder.path(), &map);
    let table = "out/stability.csv";
    let points = fs::read_to_string(folder.path().join(table)).unwrap();
    let row = points.lines().nth(2).unwrap();
    let [x, measured, version, form] =
        ["x", "measured", "version", "form"].map(|name| value(&points, 3, name));
    let cases: &[(Damage, &[&str])] = &[
        ((3, row, &row[..row.len() / 2]), &[" values for "]),
        ((3, ",passes,", ",fails,"), &["unknown variant `fails`"]),
        ((3, measured, "NaN"), &["the row has changed since it was written"]),
        ((3, x, "1x"), &["`x` is `1x`"]),
        ((3, &format!(",{version},"), ",0.0.1,"), &["`form` and `version`", "0.0.1"]),
        ((3, &format!(",{form},"), ",full,"), &["`form` and `version`", "full"]),
        ((1, ",check", ""), &["its last column is `version`"]),
    ];
    for (damage, says) in cases {
        refused(folder.path(), table, *damage, &map, says);
    }
    good(folder.path(), &map);
    assert_eq!(
        fs::read_to_string(folder.path().join(table)).unwrap(),
        points,
        "points that are there are kept"
    );
    let full = ["stability", "--only", "slip", "--scheme", "henry", "--quiet", "--out", "out"];
    let (code, text) = said(folder.path(), &full);
    assert!(code == Some(2) && text.contains("stability.csv:2: "), "{code:?} {text}");
    assert!(text.contains("`form` and `version` are `quick`"), "{text}");
}

/// The tables of a verification are written anew: what stands there before is not used.
#[test]
fn a_verification_does_not_read_the_tables_that_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let verify = ["verify", "--quick", "--only", "fall-with-drag", "--quiet", "--out", "out"];
    good(folder.path(), &verify);
    let path = folder.path().join("out/verification.csv");
    let bare = |text: &str| -> Vec<String> {
        let rows = text.lines().map(|line| line.split(',').take(6).collect::<Vec<_>>().join(","));
        rows.collect()
    };
    let before = fs::read_to_string(&path).unwrap();
    fs::write(&path, damaged(&before, (2, "fall-with-drag", "fall-without-drag")) + "half a ro").unwrap();
    good(folder.path(), &verify);
    assert_eq!(bare(&fs::read_to_string(&path).unwrap()), bare(&before));
}
