//! Every scene file of the repository runs.

use rayon::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};
use voidage_scene::{Scene, Simulation};

/// All files `scene*.toml` in the cases, and the scenes of the tests in Python.
fn scenes() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let (mut folders, mut found) = (vec![root.join("cases"), root.join("tests/python/scenes")], vec![]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if path.is_dir() {
                folders.push(path);
            } else if name.ends_with(".toml") && (name.starts_with("scene") || folder.ends_with("scenes")) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

#[test]
fn every_scene_of_the_repository_runs_for_some_steps() {
    let scenes = scenes();
    assert!(scenes.len() >= 14, "{scenes:?}");
    scenes.par_iter().for_each(|path| {
        let mut scene = Scene::read(path, &[]).unwrap_or_else(|error| panic!("{error}"));
        // As built: bringing beds to rest takes longer than all the steps here.
        for group in &mut scene.grains {
            if let voidage_scene::Placement::Deposit(deposit) = &mut group.placement {
                deposit.settle = false;
            }
        }
        let mut simulation =
            Simulation::new(&scene).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        for _ in 0..3 {
            simulation.step().unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
        simulation.refresh().expect("the voidage");
        for (column, value) in simulation.readings() {
            assert!(value.is_finite(), "{}: {column} is {value}", path.display());
        }
    });
}
