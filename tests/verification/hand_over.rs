//! States that start other scenes, walls that vanish, and keys that change while a run goes on.

use std::path::{Path, PathBuf};
use voidage_dem::Vector;
use voidage_remote::launch::Host;
use voidage_scene::recorder::{Checkpoint, Kept, Stamp};
use voidage_scene::{Scene, Simulation};

const IN_LIQUID: &str = include_str!("../python/scenes/passage.toml");

/// A bed of two groups that lies on its floor between two walls.
const BED: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 1.0 }
materials.glass = { density = 2500.0, friction = 0.4, heat_capacity = 840.0 }
materials.steel = { density = 7800.0, friction = 0.2, heat_capacity = 500.0 }
contacts = { cohesion = { force = 1e-3, age = 0.0 } }
walls = [
    { name = "left", from = [0.0, 0.0], to = [0.0, 0.06] },
    { name = "floor", from = [0.0, 0.0], to = [0.03, 0.0], friction = 0.4 },
    { name = "right", from = [0.03, 0.0], to = [0.03, 0.06] },
]

[[grains]]
material = "glass"
radius = { uniform = [8e-4, 1e-3] }
amount = { count = 120 }
placement = { deposit = { lower = [0.0, 0.0], upper = [0.03, 0.06] } }
temperature = 300.0

[[grains]]
material = "steel"
radius = 1e-3
amount = { count = 40 }
placement = { with = 0 }
temperature = 320.0
"#;

/// The same bed from a state, with the walls in another order.
const AGAIN: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 1.0 }
materials.glass = { density = 2500.0, friction = 0.4, heat_capacity = 840.0 }
materials.steel = { density = 7800.0, friction = 0.2, heat_capacity = 500.0 }
contacts = { cohesion = { force = 1e-3, age = 0.0 } }
walls = [
    { name = "floor", from = [0.0, 0.0], to = [0.03, 0.0], friction = 0.4 },
    { name = "left", from = [0.0, 0.0], to = [0.0, 0.06] },
    { name = "right", from = [0.03, 0.0], to = [0.03, 0.06] },
]

[[grains]]
material = "glass"
placement = { state = { file = "FILE", group = 0 } }
temperature = 350.0

[[grains]]
material = "steel"
placement = { state = { file = "FILE", group = 1 } }
temperature = 350.0
"#;

fn scene(text: &str, sets: &[&str]) -> Scene {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scene::parse(Path::new("scene.toml"), text, &sets).unwrap_or_else(|error| panic!("{error}"))
}

fn keep(scene: &Scene, simulation: &mut Simulation, file: &Path) {
    let (step, time) = (simulation.steps(), simulation.time());
    let stamp = Stamp { scene_hash: scene.hash().expect("a hash"), step, time };
    let kept = Kept::of(scene).expect("a course");
    Checkpoint::write(file, &stamp, &simulation.state().expect("a state"), &kept).expect("a file");
}

/// The state of the bed after some steps with a kick, in a file.
fn left_behind(folder: &Path, steps: usize) -> (PathBuf, Simulation) {
    let scene = scene(BED, &[]);
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    let grains = simulation.coupled_mut().grains_mut().expect("grains");
    grains.particles.velocity.iter_mut().step_by(3).for_each(|velocity| velocity.x += 0.2);
    for _ in 0..steps {
        simulation.step().expect("a step");
    }
    let file = folder.join("left.voidage");
    keep(&scene, &mut simulation, &file);
    (file, simulation)
}

fn again(file: &Path, sets: &[&str]) -> Scene {
    scene(&AGAIN.replace("FILE", &file.display().to_string()), sets)
}

#[test]
fn a_state_starts_another_scene_with_all_that_grains_have() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, mut first) = left_behind(folder.path(), 4);
    let mut second = Simulation::new(&again(&file, &[])).expect("a valid scene");
    let of = |run: &Simulation| run.coupled().grains().expect("grains").state();
    let (a, b) = (of(&first), of(&second));
    // The groups of a mixture lie mixed in the file, and one after the other here.
    let order: Vec<usize> = {
        let material = &a.particles.material;
        let of_group = |group: u8| (0..material.len()).filter(move |i| material[*i] == group);
        of_group(0).chain(of_group(1)).collect()
    };
    let heat = (a.particles.heat.as_ref().unwrap(), b.particles.heat.as_ref().unwrap());
    let turn = (a.particles.rotation.as_ref().unwrap(), b.particles.rotation.as_ref().unwrap());
    for (now, &then) in order.iter().enumerate() {
        assert_eq!(b.particles.position[now], a.particles.position[then]);
        assert_eq!(b.particles.velocity[now], a.particles.velocity[then]);
        assert_eq!(b.particles.mass[now], a.particles.mass[then]);
        assert_eq!(heat.1.temperature[now], heat.0.temperature[then]);
        assert_eq!((turn.1.spin[now], turn.1.angle[now]), (turn.0.spin[then], turn.0.angle[then]));
    }
    assert!(turn.1.spin.iter().any(|spin| *spin != 0.0));
    let count =
        |state: &voidage_dem::State<2>| state.forces().filter(|force| force.force.norm() > 0.0).count();
    assert_eq!((b.particles.len(), count(&b)), (160, count(&a)));
    assert!(count(&b) > 150 && b.forces().all(|force| force.age > 0.0));
    // It goes on as the other would have.
    for _ in 0..3 {
        first.step().expect("a step");
        second.step().expect("a step");
    }
    let (a, b) = (of(&first), of(&second));
    for (now, &then) in order.iter().enumerate() {
        let apart = (b.particles.position[now] - a.particles.position[then]).norm();
        assert!(apart < 1e-3 * 1e-3, "grain {then}: {apart} m");
    }
    let still =
        Simulation::new(&again(&file, &["grains[0].placement.state.still=true"])).expect("a valid scene");
    let velocity = &of(&still).particles.velocity;
    assert!(
        velocity[..120].iter().all(|v| v.norm() == 0.0) && velocity[120..].iter().any(|v| v.norm() > 0.0)
    );
}

#[test]
fn a_state_of_grains_alone_starts_a_bed_in_a_fluid_with_any_scheme() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, bed) = left_behind(folder.path(), 400);
    assert!(bed.fastest() < 1e-3, "{} m/s: the bed has not come to rest", bed.fastest());
    let fluid = r#"
[fluid]
density = 1.2
viscosity = 2e-5
boundaries = [
    { name = "walls", flow = "slip" },
    { name = "floor", flow = { superficial_velocity = [0.0, 0.2] } },
    { name = "top", flow = "open" },
]
mesh.rectangle = { lower = [0.0, -1e-6], upper = [0.03, 0.06], size = 4e-3, sides = { left = "walls", right = "walls", bottom = "floor", top = "top" } }
"#;
    let text = AGAIN.replace("FILE", &file.display().to_string()) + fluid;
    let mut fell = vec![];
    for scheme in ["henry", "lagged", "iterated"] {
        let sets = ["grains[0].placement.state.still=true", "grains[1].placement.state.still=true"];
        let scheme = format!("coupling.scheme={scheme:?}");
        let mut simulation =
            Simulation::new(&scene(&text, &[sets[0], sets[1], &scheme])).expect("a valid scene");
        for _ in 0..200 {
            simulation.step().unwrap_or_else(|error| panic!("{scheme}: {error}"));
        }
        fell.push(simulation.fastest());
    }
    // A bed that had come to rest does so again under a weak stream, in which single grains find other holes.
    assert!(fell.iter().all(|speed| *speed < 1e-6), "{fell:?}");
}

#[test]
fn wrong_states_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, _) = left_behind(folder.path(), 1);
    let text = AGAIN.replace("FILE", &file.display().to_string());
    let refused = |text: &str, set: &str, parts: &[&str]| {
        let read = Scene::parse(Path::new("scene.toml"), text, &[set.to_owned()]);
        let error = match read {
            Err(error) => error.to_string(),
            Ok(scene) => Simulation::new(&scene).err().expect(parts[0]).to_string(),
        };
        parts.iter().for_each(|part| assert!(error.contains(part), "{part} is not in {error}"));
    };
    refused(
        &text,
        "grains[1].placement.state.group=4",
        &["grains[1].placement.state", "has no grains", "below 2"],
    );
    refused(&text, "grains[0].radius=1e-3", &["grains[0].radius", "come from a file"]);
    refused(&text, "grains[0].amount={count=3}", &["grains[0].amount"]);
    refused(
        &text,
        "grains[0].placement.state.file=\"nowhere.voidage\"",
        &["there is no file", "nowhere.voidage"],
    );
    let other = folder.path().join("other.voidage");
    std::fs::write(&other, "grains").expect("a file");
    refused(
        &AGAIN.replace("FILE", &other.display().to_string()),
        "title=\"a\"",
        &["is no checkpoint of voidage"],
    );
}

/// A disc on a shelf that vanishes falls as by Newton, and one beside it stays.
#[test]
fn a_wall_vanishes_at_its_time_and_the_restart_knows_it() {
    let text = r#"
gravity = [0.0, -10.0]
time = { step = 1e-3, end = 1.0 }
materials.glass = { density = 2500.0 }
walls = [
    { name = "shelf", from = [0.0, 0.1], to = [0.1, 0.1], until = 0.05 },
    { name = "other", from = [0.2, 0.1], to = [0.3, 0.1] },
]

[[grains]]
material = "glass"
radius = 0.01
placement = { lattice = { lower = [0.04, 0.1], upper = [0.061, 0.1201] } }

[[grains]]
material = "glass"
radius = 0.01
placement = { lattice = { lower = [0.24, 0.1], upper = [0.261, 0.1201] } }
"#;
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(text, &[]);
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    let height = |run: &Simulation, k: usize| run.coupled().grains().unwrap().particles.position[k].y;
    let mut again = None;
    for step in 1..=150 {
        simulation.step().expect("a step");
        // Symplectic Euler: after n steps from rest n (n + 1)/2 g dt^2.
        let n = f64::from(i32::max(step - 50, 0));
        let fallen = n * (n + 1.0) / 2.0 * 10.0 * 1e-6;
        assert!(
            (height(&simulation, 0) - (0.11 - fallen)).abs() < 2e-5,
            "step {step}: {}",
            height(&simulation, 0)
        );
        assert!((height(&simulation, 1) - 0.11).abs() < 2e-5);
        if step == 80 {
            let file = folder.path().join("falling.voidage");
            keep(&scene, &mut simulation, &file);
            let checkpoint = Checkpoint::open(&file).expect("a checkpoint");
            again = Some(Simulation::restarted(&scene, &Host::default(), &checkpoint).expect("a restart"));
        }
        if let Some(again) = again.as_mut().filter(|_| step > 80) {
            again.step().expect("a step");
            assert_eq!(height(again, 0), height(&simulation, 0));
        }
    }
}

const CHANGES: [&str; 5] = [
    "materials.glass.friction=0.05",
    "fluid.boundaries[1].flow.superficial_velocity=[0.0,0.03]",
    "coupling.scheme=\"lagged\"",
    "grains[0].placement.source.rate.grains=100.0",
    "walls[1].friction=0.7",
];

fn same(a: &Simulation, b: &Simulation) {
    let grains = |run: &Simulation| run.coupled().grains().expect("grains").particles.clone();
    let fields = |run: &Simulation| run.coupled().fluid().expect("a fluid").accepted.clone();
    assert_eq!(grains(a), grains(b));
    assert_eq!(fields(a), fields(b));
}

/// An event is a restart with other keys, bit for bit, and a run goes on from a checkpoint before, at and after it.
#[test]
fn an_event_does_what_a_restart_with_its_changes_does() {
    let folder = tempfile::tempdir().expect("a folder");
    let event = format!("events=[{{time=0.04,set={CHANGES:?}}}]");
    let with = scene(IN_LIQUID, &[&event]);
    let without = scene(IN_LIQUID, &[]);
    let mut straight = Simulation::new(&with).expect("a valid scene");
    let mut stopped = Simulation::new(&without).expect("a valid scene");
    let mut files = vec![];
    for step in 1..=20 {
        straight.step().expect("a step");
        stopped.step().expect("a step");
        if step == 20 {
            // What a checkpoint drops of the linear solver, both drop.
            let file = folder.path().join(format!("{step}"));
            keep(&with, &mut straight, &file);
            files.push((step, file));
        }
    }
    let file = folder.path().join("stopped");
    keep(&without, &mut stopped, &file);
    let changed = scene(IN_LIQUID, &CHANGES);
    let checkpoint = Checkpoint::open(&file).expect("a checkpoint");
    assert_eq!(changed.changes_since(&checkpoint).expect("allowed changes").len(), CHANGES.len());
    let mut gone_on = Simulation::restarted(&changed, &Host::default(), &checkpoint).expect("a restart");
    for step in 21..=40 {
        straight.step().expect("a step");
        gone_on.step().expect("a step");
        same(&straight, &gone_on);
        if step == 30 {
            let file = folder.path().join(format!("{step}"));
            keep(&with, &mut straight, &file);
            gone_on.state().expect("a state");
            files.push((step, file));
        }
    }
    let friction = straight.coupled().grains().unwrap().materials()[0].friction;
    assert_eq!(friction, 0.05);
    // A run of the scene without events is another one.
    let plain = Checkpoint::open(&file).expect("a checkpoint");
    let mut plain = Simulation::restarted(&without, &Host::default(), &plain).expect("a restart");
    (0..20).for_each(|_| assert!(plain.step().is_ok()));
    let velocity = |run: &Simulation| run.coupled().fluid().unwrap().accepted.velocity.clone();
    assert!(velocity(&plain) != velocity(&straight));
    for (from, file) in files {
        let checkpoint = Checkpoint::open(&file).expect("a checkpoint");
        let mut again = Simulation::restarted(&with, &Host::default(), &checkpoint).expect("a restart");
        let mut beside = Simulation::restarted(&with, &Host::default(), &checkpoint).expect("a restart");
        for _ in from..40 {
            again.step().expect("a step");
            beside.step().expect("a step");
        }
        same(&again, &beside);
        if from == 30 {
            same(&again, &straight);
        }
    }
}

/// Grains that are held went on with the velocities of their file.
#[test]
fn fixed_grains_of_a_file_stay_where_they_are() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("floor.csv"), "x,y,r,vx,vy\n0.0,0.0,1e-3,0.1,0.2\n").expect("a file");
    let text = r#"
        gravity = [0.0, -9.81]
        time = { step = 1e-3, end = 1.0 }
        materials.glass = { density = 2500.0 }
        grains = [{ material = "glass", fixed = true, placement = { csv = { file = "floor.csv" } } }]
    "#;
    let read = |sets: &[String]| Scene::parse(&folder.path().join("scene.toml"), text, sets);
    let mut run = Simulation::new(&read(&[]).expect("a valid scene")).expect("a valid scene");
    (0..3).for_each(|_| assert!(run.step().is_ok()));
    assert_eq!(run.coupled().grains().expect("grains").particles.position[0], Vector::<2>::zeros());
    let error = read(&["grains[0].velocity=[0.1,0.0]".into()]).expect_err("both").to_string();
    assert!(error.contains("grains[0].velocity") && error.contains("never move"), "{error}");
}

/// It changed one piece of the ring, or another wall behind it.
#[test]
fn an_event_changes_all_pieces_of_a_ring() {
    let text = r#"
        gravity = [0.0, -9.81]
        time = { step = 1e-3, end = 1.0 }
        materials.glass = { density = 2500.0, friction = 0.3 }
        grains = [{ material = "glass", radius = 1e-3, placement = { lattice = { lower = [-0.01, -0.01], upper = [0.01, 0.01] } } }]
        walls = [
            { name = "drum", friction = 0.3, ring = { centre = [0.0, 0.0], radius = 0.02, pieces = 12 } },
            { name = "shelf", friction = 0.3, from = [-0.005, -0.015], to = [0.005, -0.015] },
        ]
        events = [{ time = 2e-3, set = ["walls.0.friction=0.5", "walls.shelf.friction=0.7"] }]
    "#;
    let mut run = Simulation::new(&scene(text, &[])).expect("a valid scene");
    (0..4).for_each(|_| assert!(run.step().is_ok()));
    let friction: Vec<f64> =
        run.coupled().grains().expect("grains").walls().iter().map(|w| w.friction).collect();
    assert_eq!(friction, [[0.5; 12].as_slice(), &[0.7]].concat());
}

#[test]
fn wrong_events_are_refused() {
    let refused = |events: &str, parts: &[&str]| {
        let set = format!("events={events}");
        let error = Scene::parse(Path::new("scene.toml"), IN_LIQUID, &[set]).expect_err(parts[0]).to_string();
        parts.iter().for_each(|part| assert!(error.contains(part), "{part} is not in {error}"));
    };
    refused(
        "[{time=0.1,set=[\"fluid.density=2.0\"]}]",
        &["events[0].set[0]", "fluid.density", "cannot change while"],
    );
    refused("[{time=0.1,set=[\"grains[0].radius=1e-3\"]}]", &["events[0].set[0]", "cannot change while"]);
    refused(
        "[{time=0.1,set=[\"materials.glass.friction=-1.0\"]}]",
        &["events[0].set[0]", "materials.glass.friction"],
    );
    refused("[{time=0.1,set=[\"materials.glas.friction=1.0\"]}]", &["events[0].set[0]", "glas"]);
    refused("[{time=0.1,set=[\"materials.glass.friction=0.3\"]}]", &["events[0].set[0]", "changes nothing"]);
    refused("[{time=0.1,set=[]}]", &["events[0].set", "empty"]);
    // Their columns came and went, and the series failed with the step of the event.
    refused("[{time=0.1,set=[\"sinks=[]\"]}]", &["events[0].set[0]", "sources or sinks come, go", "`start`"]);
    refused("[{time=0.0,set=[\"materials.glass.friction=0.1\"]}]", &["events[0].time"]);
    refused(
        "[{time=0.2,set=[\"materials.glass.friction=0.1\"]},{time=0.1,set=[\"materials.glass.friction=0.2\"]}]",
        &["events[1].time", "increase"],
    );
}

/// The flux through the floor follows its table, in every step.
#[test]
fn an_inflow_follows_its_schedule() {
    let schedule = "fluid.boundaries[1].schedule=[[0.01,1.0],[0.03,3.0],[0.05,-1.0]]";
    let scene = scene(IN_LIQUID, &[schedule]);
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    for step in 1..=40 {
        simulation.step().expect("a step");
        let time = 2e-3 * f64::from(step);
        let factor = match time {
            t if t < 0.01 => 1.0,
            t if t < 0.03 => 1.0 + (t - 0.01) * 100.0,
            t if t < 0.05 => 3.0 - (t - 0.03) * 200.0,
            _ => -1.0,
        };
        let flux = simulation.readings().iter().find(|(name, _)| name == "flux_floor_m2_per_s").unwrap().1;
        let expected = -0.01 * 0.02 * factor;
        assert!((flux - expected).abs() < 1e-9, "{time}: {flux} and {expected}");
    }
    let wrong = |set: &str, part: &str| {
        let error =
            Scene::parse(Path::new("scene.toml"), IN_LIQUID, &[set.to_owned()]).expect_err(part).to_string();
        assert!(error.contains(part), "{part} is not in {error}");
    };
    wrong("fluid.boundaries[1].schedule=[[0.2,1.0],[0.1,1.0]]", "comes after");
    wrong("fluid.boundaries[0].schedule=[[0.2,1.0]]", "no velocity is prescribed");
}
