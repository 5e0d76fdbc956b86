//! What the tests share.

use rayon::prelude::*;
use std::path::Path;
use voidage_campaign::Effort;
use voidage_scene::{Scene, Simulation};
use voidage_verification::{Case, cases, solve};

/// Solves the quick form of all cases of a group of the verification suite.
///
/// # Panics
/// If a finding is outside of what is allowed.
pub fn verify_quickly(group: &str) {
    solve_quickly(&cases().into_iter().filter(|case| case.group == group).collect::<Vec<_>>());
}

/// Solves the quick form of cases.
///
/// # Panics
/// If there are none, or a finding is outside of what is allowed.
pub fn solve_quickly(chosen: &[Case]) {
    assert!(!chosen.is_empty(), "there is no case to solve");
    let missed = |case: &Case| {
        let outcome = solve(case, Effort::Quick);
        assert!(!outcome.findings.is_empty(), "{} finds nothing", case.name);
        let outside = outcome.findings.into_iter().filter(|finding| !finding.passes());
        outside.map(|finding| format!("{}: {finding:?}", case.name)).collect::<Vec<_>>()
    };
    let missed: Vec<String> = chosen.par_iter().flat_map_iter(missed).collect();
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

/// Grains and fields of a run with both and with heat, as bits.
///
/// # Panics
/// If one of them is missing.
pub fn bits(run: &mut Simulation) -> Vec<u64> {
    run.refresh().expect("fields");
    let view = run.view();
    let (grains, fluid) = (view.grains.expect("grains"), view.fluid.expect("fluid"));
    let vectors = grains.position.iter().chain(grains.velocity).chain(&fluid.fields.velocity);
    let scalars = grains.temperature.expect("heat").iter().chain(&fluid.fields.pressure);
    let all = vectors.flat_map(|v| [v.x, v.y]).chain(scalars.copied());
    all.map(f64::to_bits).collect()
}

/// The quick case of the droplet with keys changed, and grains on a lattice in place of the bed: a cloud of hot
/// grains around the droplet, that falls through it, unless the keys say otherwise.
///
/// # Panics
/// If the scene is not valid.
pub fn droplet_scene(sets: &[&str]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/droplet-digging/scene-quick.toml");
    let mut all = vec![
        "grains[0].placement={lattice={lower=[0.0015,0.0065],upper=[0.0045,0.0093],spacing=1.8}}".to_string(),
        "grains[0].velocity=[0.02,-0.15]".into(),
        "droplet.remesh.every=5".into(),
        "fluid.solver.tolerance=1e-12".into(),
        "fluid.mesh.rectangle.size=8e-4".into(),
    ];
    all.extend(sets.iter().map(|set| set.to_string()));
    let text = std::fs::read_to_string(&path).expect("the scene");
    // The lattice says how many grains there are.
    let text = text.replace("amount = { count = 3900 }\n", "");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, text).expect("a file");
    Scene::read(&file, &all).unwrap_or_else(|error| panic!("{error}"))
}

/// What a run has in a column.
///
/// # Panics
/// If there is no such column.
pub fn reading(run: &Simulation, name: &str) -> f64 {
    let readings = run.readings();
    readings.iter().find(|(column, _)| column == name).unwrap_or_else(|| panic!("no column {name}")).1
}
