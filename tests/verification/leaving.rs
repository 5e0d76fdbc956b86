//! Grains that leave the mesh: through an open boundary they leave the run, through a wall that is an error.

use std::path::Path;
use voidage_coupling::scheme::SchemeName;
use voidage_scene::recorder::{Averages, Checkpoint, Stamp};
use voidage_scene::{Scene, Simulation};

/// Grains in a box without walls for them, all of one velocity, m/s. The top is open.
fn scene(scheme: &str, velocity: [f64; 2]) -> Scene {
    scene_with(scheme, velocity, &[])
}

fn scene_with(scheme: &str, velocity: [f64; 2], more: &[&str]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/scenes/moving-mesh.toml");
    let [x, y] = velocity;
    let mut sets = vec![
        format!("coupling.scheme={scheme:?}"),
        format!("grains[0].velocity=[{x:?},{y:?}]"),
        "fluid.mesh_motion.amplitude=[1e-4,0.0]".into(),
    ];
    sets.extend(more.iter().map(|set| (*set).to_owned()));
    Scene::read(&path, &sets).unwrap_or_else(|error| panic!("{error}"))
}

fn reading(simulation: &Simulation, name: &str) -> f64 {
    let readings = simulation.readings();
    readings.iter().find(|(column, _)| column == name).unwrap_or_else(|| panic!("no column {name}")).1
}

#[test]
fn grains_leave_through_an_open_boundary_and_are_counted() {
    for scheme in SchemeName::ALL {
        let scene = scene(scheme.name(), [0.0, 2.0]);
        let mut simulation = Simulation::new(&scene).expect("a valid scene");
        let count = simulation.coupled().grains().expect("grains").particles.len();
        let first: Vec<f64> = simulation.coupled().grains().expect("grains").particles.radius.clone();
        let mut before = count;
        for _ in 0..25 {
            let report = simulation.step().expect("a step");
            for defect in [report.momentum_exchange_defect, report.energy_exchange_defect] {
                assert!(defect < Some(1e-11), "{scheme}: {defect:?}");
            }
            let particles = &simulation.coupled().grains().expect("grains").particles;
            let now = particles.len();
            assert!(now <= before);
            before = now;
            let both = simulation.coupled().interaction().expect("both");
            assert_eq!(now as u64 + both.departed, count as u64);
            assert_eq!(reading(&simulation, "grains"), now as f64);
            assert_eq!(reading(&simulation, "grains_left"), both.departed as f64);
            // Numbers are for life.
            assert!(particles.id.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(particles.id.iter().zip(&particles.radius).all(|(id, r)| first[*id as usize] == *r));
        }
        assert!(before < count / 2, "{scheme}: {before} of {count} are left, the test sees little");
    }
}

#[test]
fn a_run_whose_grains_have_left_goes_on_from_its_checkpoint_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let scene = scene("iterated", [0.0, 2.0]);
    let mut straight = Simulation::new(&scene).expect("a valid scene");
    while reading(&straight, "grains_left") == 0.0 {
        straight.step().expect("a step");
    }
    let hash = scene.hash().expect("a hash");
    let stamp = Stamp { scene_hash: hash.clone(), step: straight.steps(), time: straight.time() };
    Checkpoint::write(&path, &stamp, &straight.state().expect("a state"), &None::<Averages>).expect("a file");
    let checkpoint = Checkpoint::read(&path, &hash).expect("a checkpoint");
    let mut again = Simulation::new(&scene).expect("a valid scene").restart(&checkpoint).expect("a restart");
    for _ in 0..4 {
        straight.step().expect("a step");
        again.step().expect("a step");
    }
    let grains = |run: &Simulation| run.coupled().grains().expect("grains").particles.clone();
    assert_eq!(grains(&straight), grains(&again));
    assert_eq!(reading(&straight, "grains_left"), reading(&again, "grains_left"));
}

#[test]
fn a_grain_that_leaves_through_a_wall_of_the_fluid_is_an_error_that_names_it() {
    let mut simulation = Simulation::new(&scene("henry", [-2.0, 0.0])).expect("a valid scene");
    let error =
        (0..25).find_map(|_| simulation.step().err()).expect("a grain goes through the wall").to_string();
    for part in ["grain ", "lies outside of the mesh", "behind its boundary \"walls\"", "[[walls]]"] {
        assert!(error.contains(part), "{part} is not in {error}");
    }
}

/// What the added mass felt of the grains was kept when the last one had left, and the next step panicked.
#[test]
fn a_run_goes_on_when_all_grains_have_left() {
    for scheme in SchemeName::ALL {
        let with: &[&str] = if scheme.knows_acceleration() { &["coupling.added_mass=0.5"] } else { &[] };
        let scene = scene_with(scheme.name(), [0.0, 2.0], with);
        let mut simulation = Simulation::new(&scene).expect("a valid scene");
        for _ in 0..60 {
            simulation.step().expect("a step");
        }
        assert_eq!(reading(&simulation, "grains"), 0.0, "{scheme}");
    }
}

/// Grains that a closed part cut were taken for whole ones when it opened: the rest of them went out at once.
#[test]
fn only_the_solid_that_moves_out_leaves_when_a_boundary_opens() {
    let text = r#"
        gravity = [0.0, 0.0]
        time = { step = 1e-3, end = 1.0 }
        materials.glass = { density = 2500.0 }
        events = [{ time = 3e-3, set = ['fluid.boundaries[1].flow="open"'] }]
        grains = [{ material = "glass", radius = 1e-3, velocity = [0.0, 0.2], placement = { lattice = { lower = [0.0, 0.018], upper = [0.02, 0.02] } } }]

        [fluid]
        density = 1.2
        viscosity = 2e-5
        mesh = { rectangle = { lower = [0.0, 0.0], upper = [0.02, 0.02], structured = { squares = [10, 10] }, sides = { left = "walls", right = "walls", bottom = "floor", top = "top" } } }
        boundaries = [
            { name = "walls", flow = "slip" },
            { name = "top", flow = { velocity = [0.0, 0.0] } },
            { name = "floor", flow = "open" },
        ]
    "#;
    let scene = Scene::parse(Path::new("scene.toml"), text, &[]).unwrap_or_else(|error| panic!("{error}"));
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    let mut step = || {
        simulation.step().expect("a step");
        reading(&simulation, "solid_inflow_m2_per_s")
    };
    let closed: Vec<f64> = (0..3).map(|_| step()).collect();
    let open: Vec<f64> = (0..3).map(|_| step()).collect();
    assert_eq!(closed, [0.0; 3]);
    assert!(open.windows(2).all(|two| two[1] < two[0] && two[0] < 0.7 * two[1]), "{open:?} m2/s");
}

/// A position that is no number is nearest to no part of the boundary, and could pass for one behind an open part.
#[test]
fn a_grain_whose_position_is_no_number_ends_the_run() {
    let mut simulation = Simulation::new(&scene("henry", [0.0, 0.0])).expect("a valid scene");
    let grains = simulation.coupled_mut().grains_mut().expect("grains");
    grains.particles.position[3].x = f64::NAN;
    let error = simulation.step().expect_err("a position is no number").to_string();
    assert!(error.contains("grain 3: its position [NaN") && error.contains("finite"), "{error}");
}
