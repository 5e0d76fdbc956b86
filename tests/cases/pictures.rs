//! The pictures that `voidage plot` draws of runs with and without a droplet.

use assert_cmd::Command;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Curves that runs are compared by.
const COMPARED: [&str; 4] =
    ["droplet-depth.png", "droplet-velocity.png", "grain-temperature.png", "droplet-lifetime.png"];

fn voidage(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_voidage"));
    command.current_dir(folder);
    command
}

/// Runs the quick droplet, made smaller: a coarse mesh, few grains, and eight steps in which it falls into them.
fn droplet(folder: &Path, out: &str, temperature: f64) -> PathBuf {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../droplet-digging/scene-quick.toml");
    let mut command = voidage(folder);
    command.arg("run").arg(scene).args(["--quiet", "--threads", "1", "--out", out]);
    let holes =
        r#"[{ name = "droplet", centre = [0.003, 0.0016], radius = 1e-3, size = 2e-4, growth = 0.2 }]"#;
    let sets = [
        "time.end=4e-3".to_owned(),
        "grains[0].amount.count=300".to_owned(),
        format!("grains[0].temperature={temperature}"),
        "fluid.mesh.rectangle.size=1e-3".to_owned(),
        format!("fluid.mesh.rectangle.holes={holes}"),
        "droplet.velocity=[0.0, -0.1]".to_owned(),
        "output.series_interval=5e-4".to_owned(),
        "output.frame_interval=1e-3".to_owned(),
        "output.snapshots=[2e-3]".to_owned(),
    ];
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    command.assert().success();
    folder.join(out)
}

/// Names of the pictures in a folder, each of which is a whole one.
fn pictures(folder: &Path) -> BTreeSet<String> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let pictures = files.filter(|path| path.extension().is_some_and(|kind| kind == "png"));
    pictures
        .map(|path| {
            let bytes = fs::read(&path).unwrap();
            assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 5000, "{}", path.display());
            path.file_name().unwrap().to_string_lossy().into_owned()
        })
        .collect()
}

fn set(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// What a command that is refused says.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = voidage(folder).args(arguments).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    said
}

#[test]
fn a_run_with_a_droplet_leaves_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let out = droplet(folder.path(), "out", 673.15);
    let all = [
        &COMPARED[..],
        &["temperature.png", "snapshot-0.002s.png", "snapshot-0.004s.png", "digging.png"],
        &["droplet-forces.png", "droplet-heat.png", "droplet-profiles.png"],
    ];
    assert_eq!(pictures(&out), set(&all.concat()));
    let frames: Vec<String> = (1..=5).map(|number| format!("frame-{number:05}.png")).collect();
    assert_eq!(pictures(&out.join("film")), frames.iter().cloned().collect());
    // All frames of the film have the same size, which stands at a fixed place of the file.
    let size = |name: &str| fs::read(out.join("film").join(name)).unwrap()[16..24].to_vec();
    assert!(frames.iter().all(|name| size(name) == size(&frames[0])));
    // Drawn again, the pictures are the same, and what an earlier, longer run left is gone from the film.
    let before = fs::read(out.join("digging.png")).unwrap();
    fs::copy(out.join("film/frame-00001.png"), out.join("film/frame-00006.png")).unwrap();
    voidage(folder.path()).args(["plot", "out"]).assert().success();
    assert_eq!(before, fs::read(out.join("digging.png")).unwrap());
    assert_eq!(pictures(&out.join("film")).len(), 5);
    // A column that is not there is not taken for one that has nothing to show.
    let text = fs::read_to_string(out.join("series.csv")).unwrap();
    fs::write(out.join("series.csv"), text.replace("droplet_depth_m", "other")).unwrap();
    all.concat().iter().for_each(|name| fs::remove_file(out.join(name)).unwrap());
    let said = refused(folder.path(), &["plot", "out"]);
    assert!(said.contains("series.csv:1: has no column `droplet_depth_m`"), "{said}");
    assert_eq!(pictures(&out), BTreeSet::new());
}

#[test]
fn runs_with_a_droplet_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let cold = droplet(folder.path(), "cold", 573.15);
    droplet(folder.path(), "hot", 873.15);
    voidage(folder.path()).args(["plot", "hot", "cold", "--out", "both"]).assert().success();
    let both = pictures(&folder.path().join("both"));
    assert_eq!(both, set(&[&COMPARED[..], &["droplet-final-depth.png", "droplet-beds.png"]].concat()));
    voidage(&cold).args(["plot", ".", "../hot"]).assert().success();
    assert!(cold.join("droplet-final-depth.png").is_file());
    voidage(folder.path()).args(["plot", "hot", "--out", "one"]).assert().success();
    assert_eq!(pictures(&folder.path().join("one")), both);
    // Wrong input is refused, and makes nothing.
    let said = refused(folder.path(), &["plot", "hot", "nowhere", "--out", "none"]);
    assert!(said.contains("nowhere: holds no scene.toml"), "{said}");
    fs::remove_file(cold.join("series.csv")).unwrap();
    let said = refused(folder.path(), &["plot", "hot", "cold", "--out", "none"]);
    assert!(said.contains("cold: holds no series.csv"), "{said}");
    assert!(!folder.path().join("none").exists());
}

#[test]
fn a_run_without_a_droplet_has_neither_film_nor_droplet() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), include_str!("bed.toml")).unwrap();
    let arguments = ["run", "scene.toml", "--quiet", "--out", "out"];
    voidage(folder.path()).args(arguments).assert().success();
    let out = folder.path().join("out");
    let snapshots = ["snapshot-0.020s.png", "snapshot-0.040s.png"];
    let others = ["temperature.png", "pressure.png", "packing.png", "velocity.png"];
    assert_eq!(pictures(&out), set(&[&snapshots[..], &others].concat()));
    assert!(!out.join("film").exists());
    // A film is made when it is asked for: of all frames, in one size.
    voidage(folder.path()).args(["plot", "out", "--film"]).assert().success();
    let frames = pictures(&out.join("film"));
    assert_eq!(frames.len(), 5, "{frames:?}");
    assert!(frames.contains("frame-00001.png") && frames.contains("frame-00005.png"), "{frames:?}");
    let sizes: BTreeSet<Vec<u8>> =
        frames.iter().map(|name| fs::read(out.join("film").join(name)).unwrap()[16..24].to_vec()).collect();
    assert_eq!(sizes.len(), 1);
    fs::remove_file(out.join("grains.pvd")).unwrap();
    fs::remove_file(out.join("fluid.pvd")).unwrap();
    let said = refused(folder.path(), &["plot", "out", "--film"]);
    assert!(said.contains("no frames") && said.contains("output.frame_interval"), "{said}");
    let said = refused(folder.path(), &["plot", "out", "out"]);
    assert!(said.contains("droplet"), "{said}");
    refused(folder.path(), &["plot"]);
}
