//! What was wrong and said nothing: a small input for each, with what is right.

use assert_cmd::Command;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

const BED: &str = include_str!("bed.toml");

fn folder(scene: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    folder
}

/// Exit code, and what was printed and said.
fn voidage(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    let output = command.current_dir(folder).args(arguments).output().unwrap();
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code(), text.concat())
}

fn good(folder: &Path, arguments: &[&str]) -> String {
    let (code, said) = voidage(folder, arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {said}");
    said
}

/// A column of the series of a run.
fn column(folder: &Path, out: &str, name: &str) -> Vec<f64> {
    let mut reader = csv::Reader::from_path(folder.join(out).join("series.csv")).unwrap();
    let place = reader.headers().unwrap().iter().position(|header| header == name).unwrap();
    reader.records().map(|row| row.unwrap()[place].parse().unwrap()).collect()
}

fn summary(folder: &Path, out: &str) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(folder.join(out).join("summary.json")).unwrap()).unwrap()
}

const FEED: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 0.3 }
materials.m = { density = 2500.0, friction = 0.5 }

[[grains]]
material = "m"
radius = 2e-3
placement = { source = { name = "feed", lower = [0.0, 0.03], upper = [0.1, 0.05], rate = { grains = 400.0 } } }
"#;

/// A box without a grain and with periodic sides ended in a panic, or never.
#[test]
fn a_periodic_box_that_holds_no_grain_is_empty() {
    let floor = "walls = [{ name = \"floor\", from = [0.0, 0.0], to = [0.1, 0.0] }]\n";
    let fluid = "[fluid]\ndensity = 1.2\nviscosity = 2e-5\nboundaries = [{ name = \"floor\", flow = \"no-slip\" }, \
                 { name = \"top\", flow = \"open\" }]\nmesh.rectangle = { lower = [0.0, 0.0], upper = [0.1, 0.06], \
                 size = 8e-3, sides = { bottom = \"floor\", top = \"top\", left = \"left\", right = \"right\" } }\n";
    let x = "periodic = { x = [0.0, 0.1] }\n";
    let both = "periodic = { x = [0.0, 0.1], y = [0.0, 0.06] }\n";
    let sink = "sinks = [{ name = \"out\", from = [0.0, 0.02], to = [0.1, 0.02] }]\n";
    let cases: [(&str, String, bool); 6] = [
        ("x", format!("{x}{floor}{FEED}"), true),
        ("later", format!("{x}{floor}{}", FEED.replace("rate =", "start = 0.1, rate =")), true),
        ("never", format!("{both}{}", FEED.replace("rate =", "start = 0.9, rate =")), false),
        ("both", format!("{both}{}", FEED.replace("-9.81", "0.0")), true),
        // The last grain leaves.
        ("sink", format!("{x}{sink}{}", FEED.replace("rate =", "end = 0.05, rate =")), false),
        ("fluid", format!("{x}{floor}{FEED}{fluid}"), true),
    ];
    for (name, scene, stay) in cases {
        let folder = folder(&scene);
        good(folder.path(), &["check", "scene.toml"]);
        good(folder.path(), &["run", "scene.toml", "--out", "out"]);
        let grains = column(folder.path(), "out", "grains");
        assert_eq!(grains.last().is_some_and(|count| *count > 20.0), stay, "{name}: {grains:?}");
        if name == "x" {
            assert_eq!(grains.last(), Some(&120.0), "{grains:?}");
        }
        good(folder.path(), &["plot", "out"]);
        good(folder.path(), &["analyse", "out"]);
    }
}

const BALL: &str = r#"
gravity = [0.0, -1.0]
time = { step = 0.3, end = 1.0 }
materials.m = { density = 2500.0 }
output.snapshots = [1.0]
[[grains]]
material = "m"
radius = 1e-2
amount.count = 1
placement = { lattice = { lower = [0.0, 0.0], upper = [0.03, 0.03] } }
"#;

/// A run to 1 s with steps of 0.3 s went on to 1.2 s.
#[test]
fn a_run_ends_when_it_says() {
    let folder = folder(BALL);
    let said = good(folder.path(), &["check", "scene.toml"]);
    assert!(said.contains("3 of 0.3 s and one of 0.1 s to 1 s"), "{said}");
    for (step, end) in [("0.3", 1.0), ("3e-3", 1.0), ("1e-3", 1.0005), ("0.1", 0.35), ("0.1", 0.3)] {
        let sets = ["--set", &format!("time.step={step}"), "--set", &format!("time.end={end}")];
        good(folder.path(), &[&["run", "scene.toml", "--out", "out", "--overwrite"], &sets[..]].concat());
        let times = column(folder.path(), "out", "time_s");
        let last = [*times.last().unwrap(), summary(folder.path(), "out")["time_s"].as_f64().unwrap()];
        assert!(last.iter().all(|time| (time - end).abs() < 1e-15), "{step}: {last:?}");
        assert!(folder.path().join(format!("out/snapshot-{end:.3}s.png")).exists());
    }
    // The time of the end is no whole number of steps to go on from; with another step it is.
    good(folder.path(), &["run", "scene.toml", "--out", "ball"]);
    let on = ["run", "scene.toml", "--restart", "ball/checkpoint.voidage", "--set", "time.end=2"];
    let (code, said) = voidage(folder.path(), &on);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("t = 1 s") && said.contains("time.step"), "{said}");
    good(folder.path(), &[&on[..], &["--set", "time.step=0.25", "--out", "on"]].concat());
    assert_eq!(summary(folder.path(), "on")["time_s"], 2.0);
}

/// The program's own advice after a stop split a run over two folders.
#[test]
fn what_the_program_says_to_go_on_with_goes_on_in_the_same_folder() {
    let folder = folder(BED);
    let program = env!("CARGO_BIN_EXE_voidage");
    for out in ["results", "my 'own' results"] {
        let sets = [
            "--set",
            "time.end=0.03",
            "--set",
            "fluid.boundaries.inflow.flow.superficial_velocity=[0.0, 0.7]",
        ];
        let start = ["run", "scene.toml", "--out", out, "--until", "0.015"];
        let said = good(folder.path(), &[&start[..], &sets].concat());
        let command = said.lines().find(|line| line.trim_start().starts_with("voidage run")).unwrap();
        let typed = command.replacen("voidage", program, 1);
        let done = std::process::Command::new("sh").args(["-c", &typed]).current_dir(folder.path()).output();
        let done = done.unwrap();
        assert!(done.status.success(), "{command}: {}", String::from_utf8_lossy(&done.stderr));
        let times = column(folder.path(), out, "time_s");
        assert_eq!((times.len(), times.last()), (31, Some(&0.03)), "{command}");
        assert!(!folder.path().join("out").exists());
    }
    // Without a folder it is that of the checkpoint.
    good(folder.path(), &["run", "scene.toml", "--out", "plain", "--until", "0.015"]);
    good(folder.path(), &["run", "scene.toml", "--restart", "plain/checkpoint.voidage", "--until", "0.02"]);
    assert_eq!(column(folder.path(), "plain", "time_s").last(), Some(&0.02));
    assert!(!folder.path().join("out").exists());
}

/// What batch systems send some time before they kill a job killed it, with nothing saved.
#[test]
fn signals_of_batch_systems_end_a_run_with_all_it_has() {
    let folder = folder(BED);
    for signal in ["USR1", "USR2", "XCPU", "ALRM", "XFSZ", "VTALRM", "PROF", "TERM", "HUP"] {
        let mut run = std::process::Command::new(env!("CARGO_BIN_EXE_voidage"))
            .current_dir(folder.path())
            .args(["run", "scene.toml", "--threads", "1", "--set", "time.end=1000", "--out", signal])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while !folder.path().join(signal).join("grains.pvd").exists() {
            assert!(start.elapsed() < Duration::from_secs(60), "the run does not start");
            std::thread::sleep(Duration::from_millis(5));
        }
        let id = run.id().to_string();
        let sent = std::process::Command::new("kill").args([&format!("-{signal}"), &id]).status();
        assert!(sent.unwrap().success());
        let said = std::io::read_to_string(run.stderr.take().unwrap()).unwrap();
        assert_eq!(run.wait().unwrap().code(), Some(1), "{signal}: {said}");
        assert!(said.contains(&format!("interrupted by SIG{signal}")), "{said}");
        assert!(folder.path().join(signal).join("checkpoint.voidage").exists());
        assert_eq!(summary(folder.path(), signal)["outcome"], "interrupted");
    }
}

/// At a limit of the size of files the system killed a run; one of virtual memory ended it for gigabytes that it did not
/// use; output to a full disk was a panic; a hundred thousand threads never ended.
#[test]
fn limits_of_the_system_are_errors() {
    let folder = folder(BED);
    let program = env!("CARGO_BIN_EXE_voidage");
    let shell = |line: &str| {
        let line = line.replace("voidage", program);
        let done = std::process::Command::new("sh").args(["-c", &line]).current_dir(folder.path()).output();
        let done = done.unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    let (code, said) = shell("ulimit -f 40; voidage run scene.toml --out small --threads 1");
    assert!(code == Some(1) && said.contains("File too large"), "{code:?} {said}");
    let (code, said) = shell("ulimit -v 700000; voidage run scene.toml --out little --set time.end=1e-3");
    assert!(code == Some(0), "{code:?} {said}");
    let (code, said) = shell("voidage check scene.toml > /dev/full");
    assert!(code == Some(1) && said.starts_with("error: cannot write the output"), "{code:?} {said}");
    let (code, said) = shell("voidage run scene.toml --out none --threads 100000");
    assert!(code == Some(2) && said.contains("--threads 100000: there must be 1 to 1024"), "{said}");
}

/// A plate that shakes at 1 kHz with steps of 1 ms stood still.
#[test]
fn a_motion_faster_than_the_step_is_said() {
    let plate = "walls = [{ name = \"plate\", from = [-1.0, -0.01], to = [1.0, -0.01], motion = { oscillate = { amplitude = \
                 [0.0, 1e-3], frequency = 1000.0 } } }]\n";
    let scene = format!("{plate}{}", BALL.replace("step = 0.3, end = 1.0", "step = 1e-3, end = 0.01"));
    let folder = folder(&scene);
    let said = "at 1000 Hz a period takes 0.001 s, 1 steps of 0.001 s";
    assert!(good(folder.path(), &["check", "scene.toml"]).contains(said));
    assert!(good(folder.path(), &["run", "scene.toml", "--out", "out"]).contains(said));
    let slow = ["check", "scene.toml", "--set", "walls.plate.motion.oscillate.frequency=50.0"];
    assert!(!good(folder.path(), &slow).contains("a period takes"));
}

/// Units of other programs passed without a word.
#[test]
fn units_of_others_are_unusual() {
    let folder = folder(BED);
    for (sets, says) in [
        (&["fluid.density=1000.0", "fluid.viscosity=1.0"][..], "1 Pa s beside 1000 kg/m3"),
        (&["fluid.density=1000.0", "fluid.viscosity=1e-6"], "1 mPa s or 1 cP"),
        (&["materials.glass.heat_capacity=0.84"], "0.84 J/kg/K: glass has 840"),
        (&["fluid.heat.heat_capacity=1.0"], "1 J/kg/K: glass has 840, air 1005"),
        (
            &["walls.left.motion={rotate={centre=[0.0,0.0],rate=60.0}}", "walls.left.body='drum'"],
            "60 rad/s are 573 turns a minute",
        ),
        (
            &["gravity=[0.0,0.0]", "grains[0].placement={deposit={lower=[0.0,0.0],upper=[0.01,0.02]}}"],
            "without gravity",
        ),
        (
            &["walls.bottom.from=[0.002,0.01]", "walls.bottom.to=[0.008,0.01]", "grains[0].amount.count=8"],
            "inside the mesh",
        ),
    ] {
        let mut arguments = vec!["check", "scene.toml"];
        sets.iter().for_each(|set| arguments.extend(["--set", set]));
        let said = good(folder.path(), &arguments);
        assert!(said.contains(says), "{sets:?}: {says:?} is not in\n{said}");
    }
    // Water is as it is.
    let water = ["check", "scene.toml", "--set", "fluid.density=1000.0", "--set", "fluid.viscosity=1e-3"];
    assert!(!good(folder.path(), &water).contains("Pa s beside"));
}

/// A box of metres for grains of millimetres was meshed for minutes before anything was said.
#[test]
fn a_box_of_metres_is_refused_at_once() {
    let along = BED.replacen("from = [0.0, 0.0]\nto = [0.01, 0.0]", "along = \"inflow\"", 1);
    let folder = folder(&along);
    let start = Instant::now();
    let (code, said) =
        voidage(folder.path(), &["check", "scene.toml", "--set", "fluid.mesh.rectangle.upper=[60.0,240.0]"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("makes about 7e9 triangles") && said.contains("metres"), "{said}");
    assert!(start.elapsed() < Duration::from_secs(5));
}

/// Columns that are not used were an error that named no way out.
#[test]
fn tables_of_other_programs_are_read_and_what_is_not_used_is_said() {
    let placement = "placement = { lattice = { lower = [0.0, 0.0], upper = [0.03, 0.03] } }";
    let scene = BALL
        .replace(placement, "placement.csv.file = \"g.csv\"")
        .replace("radius = 1e-2\namount.count = 1\n", "");
    let folder = folder(&scene);
    let table = "# made by a script\nid,x,y,z,r,vx,vy,spin,density\n7,0,0,0,0.01,1,0,3,1200\n";
    fs::write(folder.path().join("g.csv"), table).unwrap();
    assert!(good(folder.path(), &["check", "scene.toml"]).contains("g.csv: columns not used: id, z"));
    let said = good(folder.path(), &["run", "scene.toml", "--out", "out"]);
    assert!(said.contains("g.csv: columns not used: id, z"), "{said}");
    let (code, said) = voidage(folder.path(), &["check", "scene.toml", "--set", "contacts.rotation=false"]);
    assert!(code == Some(2) && said.contains("there is a column spin"), "{said}");
    fs::write(folder.path().join("g.csv"), "# one\n# two\nx,y,r\n0,0,0.01\n# three\n0,0.019,0.01\n").unwrap();
    let (_, said) = voidage(folder.path(), &["check", "scene.toml"]);
    assert!(said.contains("line 6: the grain overlaps that of line 4"), "{said}");
}

/// Where the energy of grains went was not known.
#[test]
fn the_budget_of_energy_closes_and_is_drawn() {
    let folder = folder(BED);
    for (out, sets) in [
        ("bed", &["materials.glass.restitution=0.5"][..]),
        (
            "iterated",
            &[
                "coupling.scheme='iterated'",
                "fluid.density=1000.0",
                "fluid.viscosity=1e-3",
                "coupling.cut={}",
            ],
        ),
        ("gone", &["sinks=[{name='out',lower=[0.0,0.0],upper=[0.01,0.005]}]"]),
    ] {
        let mut arguments = vec!["run", "scene.toml", "--out", out, "--set", "output.energy=true"];
        sets.iter().for_each(|set| arguments.extend(["--set", set]));
        good(folder.path(), &arguments);
        let worst = column(folder.path(), out, "energy_defect").into_iter().fold(0.0, f64::max);
        assert!(worst < 1e-12, "{out}: {worst}");
        let last = |name: &str| *column(folder.path(), out, name).last().unwrap();
        assert!(last("energy_impacts_J_per_m") < 0.0 && last("energy_fluid_J_per_m") != 0.0, "{out}");
        assert_eq!(last("energy_passed_J_per_m") != 0.0, out == "gone");
        assert!(folder.path().join(out).join("energy.png").exists());
    }
    // A run that was stopped has the same budget.
    let whole = column(folder.path(), "bed", "energy_friction_J_per_m");
    let same = ["--set", "output.energy=true", "--set", "materials.glass.restitution=0.5", "--out", "parts"];
    good(folder.path(), &[&["run", "scene.toml", "--until", "0.02"], &same[..]].concat());
    good(
        folder.path(),
        &[&["run", "scene.toml", "--restart", "parts/checkpoint.voidage"], &same[..]].concat(),
    );
    assert_eq!(column(folder.path(), "parts", "energy_friction_J_per_m"), whole);
}

/// Names of commands and options had to be typed in full.
#[test]
fn shells_can_complete_commands() {
    let folder = folder(BALL);
    for shell in ["bash", "zsh", "fish"] {
        let said = good(folder.path(), &["completions", shell]);
        assert!(said.contains("validate") && said.contains("restart"), "{shell}");
    }
}
