//! Beds that the program pours before the first step: reported, kept and reused, and given up when interrupted.

use assert_cmd::Command;
use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const SCENE: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 2e-3 }

[materials.glass]
density = 2500.0
friction = 0.3

[[grains]]
material = "glass"
radius = { uniform = [4e-4, 5e-4] }
amount = { count = 200 }
placement = { deposit = { lower = [0.0, 0.0], upper = [0.01, 0.05] } }

[[walls]]
name = "slope"
from = [0.0, 4e-3]
to = [4e-3, 0.0]
"#;

/// Runs a scene, and returns what it says.
fn run(folder: &Path, scene: &str, options: &[&str]) -> String {
    fs::write(folder.join("scene.toml"), scene).unwrap();
    let arguments = [&["run", "scene.toml", "--out", "out", "--overwrite"], options].concat();
    let output = Command::new(env!("CARGO_BIN_EXE_voidage")).current_dir(folder).args(arguments).unwrap();
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_bed_is_reported_and_kept_until_something_about_it_changes() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("out/packing-0.csv");
    let said = run(folder.path(), SCENE, &[]);
    assert!(said.contains("grains[0]: 200 deposited, solid fraction 0.7"), "{said}");
    assert!(said.contains("at rest after") && !said.contains("kept"), "{said}");
    let first = fs::read(&table).unwrap();
    let end = fs::read(folder.path().join("out/checkpoint.voidage")).ok();
    // Nothing about the bed changes.
    for options in [&[] as &[&str], &["--set", "time.step=5e-4"], &["--set", "title=again"]] {
        let said = run(folder.path(), SCENE, options);
        assert!(said.contains("(kept in out/packing-0.csv)") && said.contains("at rest after"), "{said}");
        assert_eq!(fs::read(&table).unwrap(), first);
    }
    run(folder.path(), SCENE, &[]);
    assert_eq!(fs::read(folder.path().join("out/checkpoint.voidage")).ok(), end);
    // Something does, or the table was spoilt.
    for set in [
        "walls.slope.friction=0.1",
        "materials.glass.friction=0.2",
        "grains[0].placement.deposit.seed=2",
        "periodic={ x = [0.0, 0.01] }",
    ] {
        let said = run(folder.path(), SCENE, &["--set", set]);
        assert!(!said.contains("kept"), "{set}: {said}");
    }
    run(folder.path(), SCENE, &[]);
    assert_eq!(fs::read(&table).unwrap(), first);
    fs::write(&table, "x,y,r\n0.005,0.005,0.0005\n").unwrap();
    assert!(!run(folder.path(), SCENE, &[]).contains("kept"));
    assert_eq!(fs::read(&table).unwrap(), first);
}

/// A kept bed has its grains by the numbers of their groups. With another group between them they were taken for grains
/// of that one.
#[test]
fn a_bed_is_not_kept_when_its_groups_have_other_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let (before, walls) = SCENE.split_at(SCENE.find("[[walls]]").unwrap());
    let mixed = "[[grains]]\nmaterial = \"glass\"\nradius = { constant = 3e-4 }\namount = { count = 50 }\n\
                 placement = { with = 0 }\n\n";
    let fixed = "[[grains]]\nmaterial = \"glass\"\nradius = { constant = 3e-4 }\nfixed = true\n\
                 placement = { lattice = { lower = [0.02, 0.0], upper = [0.021, 0.001] } }\n\n";
    let said = run(folder.path(), &format!("{before}{mixed}{walls}"), &[]);
    assert!(said.contains("250 deposited"), "{said}");
    assert!(run(folder.path(), &format!("{before}{mixed}{walls}"), &[]).contains("kept"));
    let said = run(folder.path(), &format!("{before}{fixed}{mixed}{walls}"), &[]);
    assert!(said.contains("250 deposited") && !said.contains("kept"), "{said}");
}

#[test]
fn beds_are_built_as_the_scene_says() {
    let folder = tempfile::tempdir().unwrap();
    let key = |name: &str| format!("grains[0].placement.deposit.{name}");
    let fraction = |options: &[String]| {
        let sets: Vec<&str> = options.iter().flat_map(|option| ["--set", option.as_str()]).collect();
        let said = run(folder.path(), SCENE, &sets);
        let (_, rest) = said.split_once("solid fraction ").unwrap_or_else(|| panic!("{said}"));
        (rest[..5].parse::<f64>().unwrap(), said)
    };
    let (built, said) = fraction(&[key("settle=false")]);
    assert!(said.contains("as built, not settled"), "{said}");
    let (dense, _) = fraction(&[key("settle=false"), key("method=dense")]);
    let (smooth, _) = fraction(&[key("friction=0")]);
    assert!(dense > built && smooth > built, "{built}, dense {dense}, without friction {smooth}");
}

/// The exit code and the messages of a process that must end soon.
fn ended(mut process: Child, soon: Duration) -> (Option<i32>, String) {
    let start = Instant::now();
    while process.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < soon, "it goes on");
        std::thread::sleep(Duration::from_millis(10));
    }
    let output = process.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn an_interrupt_while_grains_are_placed_ends_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let many = SCENE.replace("[4e-4, 5e-4]", "[4e-6, 5e-6]");
    let [placing, settling] = [
        // Five million grains one by one, then a few thousand in motion.
        many.replace("count = 200", "count = 5000000").replace("[0.01, 0.05]", "[0.01, 0.1]"),
        SCENE.replace("count = 200", "count = 3000").replace("[0.01, 0.05]", "[0.01, 0.5]"),
    ];
    for (scene, signal) in [(placing, "-INT"), (settling, "-TERM")] {
        fs::write(folder.path().join("scene.toml"), scene).unwrap();
        let process = std::process::Command::new(env!("CARGO_BIN_EXE_voidage"))
            .current_dir(folder.path())
            .args(["run", "scene.toml", "--set", "grains[0].placement.deposit.friction=0"])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(700));
        let id = process.id().to_string();
        assert!(std::process::Command::new("kill").args([signal, &id]).status().unwrap().success());
        let (code, said) = ended(process, Duration::from_secs(5));
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("interrupted while grains were placed"), "{said}");
    }
}
