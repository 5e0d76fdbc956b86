//! The program on good input: what it leaves, and that it can be stopped, restarted and cut short.

use assert_cmd::Command;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const BED: &str = include_str!("bed.toml");

fn voidage() -> Command {
    Command::new(env!("CARGO_BIN_EXE_voidage"))
}

/// A folder with the small bed in it.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), BED).unwrap();
    folder
}

fn run(folder: &Path, out: &str, options: &[&str]) -> PathBuf {
    let arguments = [&["run", "scene.toml", "--quiet", "--out", out], options].concat();
    voidage().current_dir(folder).args(arguments).assert().success();
    folder.join(out)
}

/// Runs the program, which must refuse its input, and returns what it says.
fn refused(folder: &Path, out: &str, options: &[&str]) -> String {
    let arguments = [&["run", "scene.toml", "--quiet", "--out", out], options].concat();
    let output = voidage().current_dir(folder).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    said
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|row| row.split(',').map(|number| number.parse().unwrap()).collect()).collect()
}

#[test]
fn a_run_leaves_all_its_files() {
    let folder = folder();
    let out = run(folder.path(), "out", &["--threads", "1"]);
    let pictures = [
        "temperature.png",
        "pressure.png",
        "snapshot-0.020s.png",
        "snapshot-0.040s.png",
        "packing.png",
        "velocity.png",
    ];
    for name in pictures {
        let bytes = fs::read(out.join(name)).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 5000, "{name}");
    }
    let summary = json(&out.join("summary.json"));
    for key in [
        "steps",
        "wall_s",
        "phases_s",
        "grains",
        "nodes",
        "cells",
        "max_penetration_over_radius",
        "unconverged_steps",
        "momentum_exchange_defect",
        "energy_exchange_defect",
        "solid_volume_defect",
        "threads",
        "version",
        "scene_hash",
    ] {
        assert!(!summary[key].is_null(), "summary.json has no {key}");
    }
    for phase in ["overlap", "closure", "energy", "flow", "contacts", "output"] {
        assert!(summary["phases_s"][phase].is_f64(), "no phase {phase}");
    }
    assert_eq!((summary["steps"].as_u64(), summary["grains"].as_u64()), (Some(40), Some(40)));
    // Contacts keep a little overlap with walls: what is in them the fluid does not meet.
    let defects = [("momentum_exchange", 1e-12), ("energy_exchange", 1e-12), ("solid_volume", 1e-5)];
    for (defect, most) in defects.map(|(name, most)| (format!("{name}_defect"), most)) {
        assert!(summary[&defect].as_f64().unwrap() < most, "{defect}: {}", summary[&defect]);
    }
    let series = fs::read_to_string(out.join("series.csv")).unwrap();
    for column in ["time_s", "mean_grain_temperature_K", "pressure_drop_Pa"] {
        assert!(series.lines().next().unwrap().split(',').any(|name| name == column), "no column {column}");
    }
    assert_eq!(rows(&out.join("series.csv")).len(), 41);
    for list in ["grains.pvd", "fluid.pvd"] {
        let frames = fs::read_to_string(out.join(list)).unwrap();
        assert_eq!(frames.matches("<DataSet").count(), 5, "{frames}");
    }
    // The scene as resolved runs again, and `plot` draws the same pictures.
    voidage().current_dir(&out).args(["check", "scene.toml"]).assert().success();
    let before = fs::read(out.join("velocity.png")).unwrap();
    fs::remove_file(out.join("velocity.png")).unwrap();
    voidage().args(["plot"]).arg(&out).assert().success();
    assert_eq!(before, fs::read(out.join("velocity.png")).unwrap());
}

#[test]
fn a_restarted_run_equals_the_straight_one_bit_for_bit() {
    let folder = folder();
    let straight = run(folder.path(), "straight", &["--threads", "1"]);
    let stopped = run(folder.path(), "stopped", &["--threads", "2", "--set", "time.end=0.02"]);
    run(folder.path(), "stopped", &["--threads", "2", "--restart", "stopped/checkpoint.voidage"]);
    for name in ["series.csv", "averages.csv", "checkpoint.voidage", "grains.pvd", "fluid.pvd", "scene.toml"]
    {
        assert_eq!(fs::read(straight.join(name)).unwrap(), fs::read(stopped.join(name)).unwrap(), "{name}");
    }
    for name in ["grains-00000040.vtp", "fluid-00000040.vtu"] {
        let [a, b] = [&straight, &stopped].map(|out| fs::read(out.join("frames").join(name)).unwrap());
        assert_eq!(a, b, "{name}");
    }
    // Another mesh refuses the checkpoint.
    let from = ["--restart", "straight/checkpoint.voidage"];
    let mesh = ["--set", "fluid.mesh.rectangle.size=1e-3"];
    let said = refused(folder.path(), "other", &[&mesh[..], &from].concat());
    assert!(said.contains("a run cannot go on with that") && said.contains("fluid.mesh"), "{said}");
    // Nothing is left to do.
    let said = refused(folder.path(), "straight", &from);
    assert!(said.contains("is at t = 0.04 s, and time.end = 0.04 s"), "{said}");
}

#[test]
fn a_shipped_case_runs_by_its_name_from_any_folder() {
    let folder = tempfile::tempdir().unwrap();
    let voidage = |arguments: &[&str]| voidage().current_dir(&folder).args(arguments).output().unwrap();
    let run = |scene: &str| voidage(&["run", scene, "--quiet", "--until", "0.002"]);
    let output = run("settling-grain");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let series = folder.path().join("out/settling-grain/series.csv");
    assert_eq!(rows(&series).len(), 3);
    let checkpoint = ["--restart", "out/settling-grain/checkpoint.voidage", "--until", "0.003", "--quiet"];
    assert!(voidage(&[&["run", "settling-grain"], &checkpoint[..]].concat()).status.success());
    assert_eq!(rows(&series).len(), 4);
    let checked = voidage(&["check", "settling-grain"]);
    assert!(String::from_utf8_lossy(&checked.stdout).starts_with("settling-grain: good"));
    // A file of that name goes first.
    fs::write(folder.path().join("settling-grain"), "gravity = 1").unwrap();
    let output = run("settling-grain");
    assert_eq!(output.status.code(), Some(2));
    let output = run("setling-grain");
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("no shipped case of this name") && said.contains("settling-grain"), "{said}");
}

/// The program died of an illegal instruction.
#[cfg(target_arch = "x86_64")]
#[test]
fn a_processor_without_avx2_is_named() {
    let emulated = |processor: &str| {
        let mut qemu = std::process::Command::new("qemu-x86_64-static");
        qemu.args(["-cpu", processor, env!("CARGO_BIN_EXE_voidage"), "--version"]).output()
    };
    let old = match emulated("Nehalem") {
        Ok(output) => output,
        Err(error) => return eprintln!("no emulator here (Debian's qemu-user-static): {error}"),
    };
    let said = String::from_utf8(old.stderr).unwrap();
    assert_eq!(old.status.code(), Some(1), "{said}");
    assert!(said.contains("this processor lacks AVX2") && said.contains("help:"), "{said}");
    let new = emulated("max").unwrap();
    assert!(new.status.success() && new.stdout.starts_with(b"voidage"), "{new:?}");
}

#[test]
fn options_change_the_scene() {
    let folder = folder();
    let options = [
        "--set",
        "time.end=0.002",
        "--set",
        "fluid.boundaries.inflow.flow.velocity=[0, 1.2]",
        "--scheme",
        "explicit",
    ];
    let out = run(folder.path(), "out", &options);
    let scene = fs::read_to_string(out.join("scene.toml")).unwrap();
    assert!(scene.contains("velocity = [0.0, 1.2]") && !scene.contains("superficial_velocity"), "{scene}");
    assert!(scene.contains("scheme = \"explicit\""), "{scene}");
    assert_eq!(rows(&out.join("series.csv")).len(), 3);
}

#[test]
fn the_schema_and_the_doctor_speak() {
    let output = voidage().arg("schema").output().unwrap();
    let schema: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let undocumented: Vec<_> = schema["properties"]
        .as_object()
        .unwrap()
        .iter()
        .filter(|(_, key)| key["description"].is_null())
        .collect();
    assert!(undocumented.is_empty(), "{undocumented:?}");
    let folder = tempfile::tempdir().unwrap();
    voidage().current_dir(folder.path()).arg("doctor").assert().success();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn the_doctor_looks_for_the_mpirun_of_fenicsx() {
    let folder = tempfile::tempdir().unwrap();
    let python = folder.path().join("python");
    fs::write(&python, "#!/bin/sh\nexit 0\n").unwrap();
    fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
    let ranks = || {
        let mut command = voidage();
        command.current_dir(folder.path()).env("PATH", folder.path()).env("VOIDAGE_PYTHON", &python);
        let output = command.arg("doctor").output().unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        said.lines().find(|line| line.starts_with("ranks of fenicsx")).expect(&said).to_owned()
    };
    assert!(ranks().contains("one: there is no mpirun beside"), "{}", ranks());
    let mpirun = folder.path().join("mpirun");
    fs::write(&mpirun, "").unwrap();
    assert!(ranks().ends_with(&format!("available, {}", mpirun.display())), "{}", ranks());
}

#[test]
fn the_header_of_solvers_in_c_can_be_had_without_a_clone() {
    let output = voidage().arg("header").output().unwrap();
    let shipped = include_str!("../../coupling/remote/voidage.h");
    assert_eq!(String::from_utf8(output.stdout).unwrap(), shipped);
}

#[test]
fn a_reader_that_leaves_ends_the_program_without_a_message() {
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_voidage"))
        .arg("schema")
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let end = child.wait_with_output().unwrap();
    assert_eq!(String::from_utf8(end.stderr).unwrap(), "");
    assert_eq!(
        end.status.code(),
        Some(141),
        "as of a program that the shell ends for writing to a closed pipe"
    );
}

#[test]
fn verify_leaves_its_tables_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let run = |only: &str| {
        let arguments = ["verify", "--quick", "--quiet", "--only", only, "--out", "out"];
        voidage().current_dir(folder.path()).args(arguments).output().unwrap()
    };
    let output = run("hele-shaw");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && said.contains("0 of 2 findings"), "{said}");
    let table = fs::read_to_string(folder.path().join("out/verification.csv")).unwrap();
    assert!(
        table.starts_with("group,case,quantity,unit,expected,measured,lowest_allowed,highest_allowed"),
        "{table}"
    );
    assert_eq!(table.matches("fluid,hele-shaw").count(), 2);
    let curves = fs::read_to_string(folder.path().join("out/curves.csv")).unwrap();
    assert!(curves.lines().count() > 200, "{curves}");
    let page = fs::read(folder.path().join("out/verification-fluid.png")).unwrap();
    assert!(page.starts_with(b"\x89PNG") && page.len() > 5000);
    let wrong = run("hele");
    let said = String::from_utf8(wrong.stderr).unwrap();
    assert!(
        wrong.status.code() == Some(2) && said.contains("--only hele") && said.contains("taylor-green"),
        "{said}"
    );
}

#[test]
fn check_says_what_is_on_and_off() {
    let folder = folder();
    let output = voidage().current_dir(folder.path()).args(["check", "scene.toml"]).output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    for part in ["40 of glass", "heat exchange  henry", "thin cell      off", "nodes", "cohesion       off"] {
        assert!(said.contains(part), "{part} is not in\n{said}");
    }
}

/// Starts a run, interrupts it when its folder `out` is ready for that, and returns what it said. It ends in time.
#[cfg(unix)]
fn interrupted(folder: &Path, options: &[&str], ready: impl Fn(&Path) -> bool) -> String {
    let arguments = [&["run", "scene.toml", "--quiet", "--out", "out"], options].concat();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_voidage"))
        .current_dir(folder)
        .args(arguments)
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut wait = |what: &str, done: &dyn Fn(&mut std::process::Child) -> bool| {
        let start = Instant::now();
        while !done(&mut child) {
            if start.elapsed() > Duration::from_secs(120) {
                child.kill().unwrap();
                panic!("{what}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait("the run does not start", &|_| ready(&folder.join("out")));
    wait("there is no `kill`", &|child| {
        let id = child.id().to_string();
        std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success()
    });
    wait("the run does not end", &|child| child.try_wait().unwrap().is_some());
    let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{said}");
    assert!(said.contains("interrupted") && said.contains("--restart"), "{said}");
    assert_eq!(json(&folder.join("out/summary.json"))["outcome"], "interrupted");
    said
}

#[cfg(unix)]
#[test]
fn an_interrupt_writes_a_checkpoint_and_ends_cleanly() {
    let folder = folder();
    interrupted(folder.path(), &["--set", "time.end=1000"], |out| out.join("grains.pvd").exists());
    let out = folder.path().join("out");
    let time = json(&out.join("summary.json"))["time_s"].as_f64().unwrap();
    let end = format!("time.end={}", time + 0.002);
    run(folder.path(), "out", &["--set", &end, "--restart", "out/checkpoint.voidage"]);
    let series = rows(&out.join("series.csv"));
    assert!(series.windows(2).all(|pair| pair[1][0] > pair[0][0]), "times of the series do not grow");
}

/// Where a step takes longer than an interrupt waits for it, the last state is saved. The pictures were then drawn by
/// the threads of the run: with one thread, which is in its step, the program waited for ever.
#[cfg(unix)]
#[test]
fn an_interrupt_within_a_long_step_ends_a_run_of_one_thread() {
    let folder = tempfile::tempdir().unwrap();
    let scene = include_str!("../../cases/droplet-digging/scene-quick.toml");
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let options = "--threads 1 --set grains[0].amount.count=20 --set output.frame_interval=5e-4
        --set fluid.mesh.rectangle.size=2e-5";
    let options: Vec<&str> = options.split_whitespace().collect();
    let within = |out: &Path| {
        let frames = fs::read_dir(out.join("frames")).map_or(0, Iterator::count);
        // Soon after a step has begun to write its frame, the next one has begun.
        frames >= 4 && {
            std::thread::sleep(Duration::from_secs(1));
            true
        }
    };
    let said = interrupted(folder.path(), &options, within);
    assert!(said.contains("within a step"), "{said}");
}

/// What a run wrote before it failed can be read.
fn check_what_is_left(said: &str, code: Option<i32>, out: &Path) {
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("out/") && said.contains("cannot write"), "{said}");
    voidage().current_dir(out).args(["check", "scene.toml"]).assert().success();
    rows(&out.join("series.csv"));
    for entry in fs::read_dir(out.join("frames")).unwrap() {
        let text = fs::read(entry.unwrap().path()).unwrap();
        assert!(text.ends_with(b"</VTKFile>\n"), "half a frame is left");
    }
}

/// Writes fail in the middle of a file.
#[cfg(unix)]
#[test]
fn a_limit_on_files_ends_with_a_message_and_leaves_what_was_written() {
    let folder = folder();
    let command = format!(
        "trap '' XFSZ; ulimit -f 8; exec {} run scene.toml --quiet --out out --threads 1",
        env!("CARGO_BIN_EXE_voidage")
    );
    let output = Command::new("bash").current_dir(folder.path()).args(["-c", &command]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    check_what_is_left(&said, output.status.code(), &folder.path().join("out"));
}

/// A disk of its own, which the run fills.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_with_a_message_and_leaves_what_was_written() {
    let folder = folder();
    let script = "mkdir disk && mount -t tmpfs -o size=160k tmpfs disk || exit 77
        \"$0\" run scene.toml --quiet --out disk/out --threads 1; code=$?
        cp -r disk/out kept; exit $code";
    let arguments = ["-m", "sh", "-c", script, env!("CARGO_BIN_EXE_voidage")];
    let output = Command::new("unshare").current_dir(folder.path()).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    if said.contains("unshare:") || output.status.code() == Some(77) {
        eprintln!("no right to mount here, the limit on files has to do: {said}");
        return;
    }
    check_what_is_left(&said, output.status.code(), &folder.path().join("kept"));
}

/// Points run beside each other and end in any order; a map that was stopped goes on behind what is there.
#[test]
fn the_map_is_the_same_with_any_threads_and_after_a_stop() {
    let folder = tempfile::tempdir().unwrap();
    let map = |out: &str, threads: &str| {
        let axes = ["--only", "heat", "--only", "remesh"];
        let options = ["stability", "--quick", "--quiet", "--out", out, "--threads", threads];
        voidage().current_dir(folder.path()).args(options).args(axes).assert().success();
        let read = |name: &str| fs::read_to_string(folder.path().join(out).join(name)).unwrap();
        [read("stability.csv"), read("curves.csv")]
    };
    let whole = map("one", "1");
    assert_eq!(whole, map("two", "2"));
    // As if the first points had not ended.
    let rows: Vec<&str> = whole[0].lines().collect();
    assert!(rows.len() > 20);
    let kept = [&rows[..1], &rows[5..]].concat().join("\n") + "\n";
    fs::create_dir(folder.path().join("stopped")).unwrap();
    fs::write(folder.path().join("stopped/stability.csv"), kept).unwrap();
    assert_eq!(whole[0], map("stopped", "2")[0]);
}
