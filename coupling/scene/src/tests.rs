//! Tests of reading scenes.

use super::*;
use std::path::{Path, PathBuf};

fn cases() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases")
}

#[test]
fn every_case_is_a_valid_scene() {
    let scenes = [
        "bubbling-bed/scene.toml",
        "bubbling-bed/scene-quick.toml",
        "bubbling-bed/scene-migflow.toml",
        "settling-grain/scene.toml",
        "settling-grain/scene-still.toml",
        "column-collapse/scene.toml",
        "packed-bed/scene.toml",
        "hopper/scene.toml",
        "cavity/scene.toml",
    ];
    for name in scenes {
        let scene = Scene::read(&cases().join(name), &[]).unwrap_or_else(|error| panic!("{error}"));
        let text = scene.to_toml().unwrap();
        let again =
            Scene::parse(Path::new("resolved.toml"), &text, &[]).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(text, again.to_toml().unwrap(), "{name} changes when written and read");
        assert_eq!(scene.hash().unwrap(), again.hash().unwrap());
    }
}

const GRAIN: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 1.0 }
materials.glass = { density = 2500.0 }
grains = [{ material = "glass", radius = { constant = 1e-3 }, placement = { lattice = { lower = [0, 0], upper = [1, 1] } } }]
"#;

fn parse(sets: &[&str]) -> Result<Scene, Box<SceneError>> {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scene::parse(Path::new("grain.toml"), GRAIN, &sets)
}

#[test]
fn absent_tables_are_parts_that_are_off_and_defaults_are_filled_in() {
    let scene = parse(&[]).unwrap();
    assert!(scene.fluid.is_none() && scene.coupling.is_none() && !scene.grains_have_heat());
    assert_eq!(scene.contacts.unwrap().tolerance, 2e-2);
    assert_eq!(scene.grains[0].solidity, 1.0);
}

#[test]
fn options_set_values_by_path_number_and_variant() {
    // A material of which nothing is made is an error.
    let text = GRAIN.replace("materials.glass", "materials.steel");
    let sets = [
        "title=two words",
        "grains.0.solidity=0.5",
        "grains[0].radius.uniform=[1e-3, 2e-3]",
        "materials.steel.density=7800",
        "grains[0].material=steel",
        "contacts.rotation=false",
    ];
    let scene = Scene::parse(Path::new("grain.toml"), &text, &sets.map(String::from)).unwrap();
    assert_eq!(scene.title, "two words");
    assert_eq!(scene.grains[0].solidity, 0.5);
    assert_eq!(scene.grains[0].radius, Some(Radius::Uniform([1e-3, 2e-3])));
    assert_eq!(scene.materials["steel"].density, 7800.0);
    assert!(!scene.contacts.unwrap().rotation);
}

#[test]
fn errors_know_their_place() {
    let error = parse(&["grains[0].solidity=2"]).unwrap_err();
    assert_eq!(error.location, Location::Set("grains[0].solidity=2".to_owned()));
    let text = GRAIN.replace("1e-3 }", "-1e-3 }");
    let error = Scene::parse(Path::new("grain.toml"), &text, &[]).unwrap_err();
    let Location::File { span, line, column } = error.location.clone() else { panic!("{error}") };
    assert_eq!((&text[span], line, column), ("-1e-3", 5, 55));
    assert!(
        error.to_string().starts_with("grain.toml:5:55: `grains[0].radius.constant = -0.001`"),
        "{error}"
    );
}

#[test]
fn the_hash_follows_physics_and_not_output() {
    let hash = |sets: &[&str]| parse(sets).unwrap().hash().unwrap();
    let plain = hash(&[]);
    for same in [
        "title=other",
        "time.end=2",
        "output.frame_interval=0.1",
        "contacts.tolerance=2e-2",
        "contacts.max_penetration=0.8",
    ] {
        assert_eq!(plain, hash(&[same]), "{same}");
    }
    for other in ["time.step=1e-4", "grains[0].solidity=0.9", "contacts.tolerance=1e-6", "gravity=[0,-1.6]"] {
        assert_ne!(plain, hash(&[other]), "{other}");
    }
}

#[test]
fn steps_forgive_rounding() {
    for (step, end, steps) in [(1e-3, 10.0, 10_000), (0.1, 0.3, 3), (0.1, 0.31, 4), (1e-4, 0.3, 3000)] {
        assert_eq!(Time { step, end }.steps(), steps);
    }
}

/// A run to 1 s with steps of 0.3 s ended at 1.2 s.
#[test]
fn the_last_step_ends_where_the_run_does() {
    for (step, end) in [(0.3, 1.0), (3e-3, 1.0), (1e-3, 1.0005), (0.1, 0.35), (0.1, 0.3), (1e-3, 10.0)] {
        let time = Time { step, end };
        let last = time.steps();
        approx::assert_relative_eq!(time.after(last), end, max_relative = 2e-16);
        let sum: f64 = (0..last).map(|steps| time.length(steps)).sum();
        approx::assert_relative_eq!(sum, end, max_relative = 1e-12);
        assert!((0..last - 1).all(|steps| time.length(steps) == step));
        // A caller that steps on takes whole steps.
        assert_eq!(time.length(last), step);
        approx::assert_relative_eq!(time.after(last + 2), end + 2.0 * step, max_relative = 1e-15);
    }
}

/// A disc that hangs from a held one by 1.001 times its weight, in air with a tracer.
const HANGING: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 1.0 }
materials.glass = { density = 2500.0 }
contacts.cohesion = { force = 0.07712, age = 5e-4 }
coupling.cohesion_below = { vapour = 0.9 }
[[grains]]
material = "glass"
radius = 1e-3
fixed = true
placement = { lattice = { lower = [0.004, 0.006], upper = [0.006, 0.008] } }
[[grains]]
material = "glass"
radius = 1e-3
velocity = [0.0, 1e-2]
placement = { lattice = { lower = [0.004, 0.004], upper = [0.006, 0.006] } }
[fluid]
density = 1.2
viscosity = 1.8e-5
mesh.rectangle = { lower = [0, 0], upper = [0.01, 0.01], size = 2e-3, sides = { left = "walls", right = "walls", bottom = "walls", top = "top" } }
scalars = [{ name = "vapour", diffusivity = 2e-5, initial = 0.89 }]
boundaries = [{ name = "walls", flow = "slip" }, { name = "top", flow = "open", scalars = { vapour = "outflow" } }]
"#;

#[test]
fn contacts_stick_below_the_bound_of_a_scalar_only() {
    let fallen = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        let scene = Scene::parse(Path::new("hanging.toml"), HANGING, &sets).unwrap();
        let mut simulation = Simulation::new(&scene).unwrap();
        for _ in 0..20 {
            simulation.step().unwrap();
        }
        0.005 - simulation.view().grains.expect("two grains").position[1].y
    };
    // Half of the fall of 17 free steps.
    let far = 0.5 * 9.81 * 0.017_f64.powi(2) / 2.0;
    assert!(fallen(&[]) < 1e-6);
    assert!(fallen(&["fluid.scalars[0].initial=0.91"]) > far);
    assert!(fallen(&["contacts.cohesion.force=0.0765"]) > 1e-3 * far, "its weight is 0.0770 N/m");
    assert!(fallen(&["contacts.cohesion.age=1.0"]) > far, "it is too young");
    assert!(fallen(&["fluid.scalars[0].initial=0.91", "coupling.cohesion_below.vapour=0.92"]) < 1e-6);
}

#[test]
fn bounds_of_cohesion_name_a_scalar_and_need_cohesion() {
    let error = |from: &str, to: &str| {
        let text = HANGING.replace(from, to);
        Scene::parse(Path::new("hanging.toml"), &text, &[]).unwrap_err().to_string()
    };
    let said = error("{ vapour = 0.9 }", "{ steam = 0.9 }");
    assert!(said.contains("coupling.cohesion_below.steam") && said.contains("there are: vapour"), "{said}");
    let said = error("contacts.cohesion = { force = 0.07712, age = 5e-4 }", "");
    assert!(said.contains("no contact sticks"), "{said}");
}
