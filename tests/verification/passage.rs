//! Grains that sources let in and sinks take out, and that cross open boundaries: counts, restart, and the volume of
//! the fluid.

use std::path::Path;
use voidage_remote::launch::Host;
use voidage_scene::recorder::{Averages, Checkpoint, Stamp};
use voidage_scene::{Scene, Simulation};

/// Grains that sink in a liquid between a source and a sink; those of a second source are thrown out through the open
/// top.
const IN_LIQUID: &str = include_str!("../python/scenes/passage.toml");

fn scene(text: &str, sets: &[&str]) -> Scene {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scene::parse(Path::new("scene.toml"), text, &sets).unwrap_or_else(|error| panic!("{error}"))
}

fn reading(simulation: &Simulation, name: &str) -> f64 {
    let readings = simulation.readings();
    readings.iter().find(|(column, _)| column == name).unwrap_or_else(|| panic!("no column {name}")).1
}

fn solid_in_mesh(simulation: &Simulation) -> f64 {
    let (fluid, both) = (simulation.coupled().fluid().unwrap(), simulation.coupled().interaction().unwrap());
    both.load.voidage.iter().zip(&fluid.nodal_volume).map(|(eps, volume)| (1.0 - eps) * volume).sum()
}

fn through_boundary(simulation: &Simulation) -> f64 {
    ["walls", "floor", "top"].iter().map(|part| reading(simulation, &format!("flux_{part}_m2_per_s"))).sum()
}

/// In every step the volume that leaves through the boundary is the change of the voidage that the fluid sees, less that
/// of what it has not yet made room for.
#[test]
fn the_fluid_makes_room_for_grains_that_come_in_and_fills_that_of_those_that_go() {
    for scheme in ["explicit", "henry", "lagged", "anchored", "iterated"] {
        let scheme = format!("coupling.scheme={scheme:?}");
        let fast = "grains[1].velocity=[0.0,1.5]";
        let scene = scene(IN_LIQUID, &[&scheme, "fluid.solver.tolerance=1e-13", fast]);
        let grain = 0.8 * std::f64::consts::PI * 25e-8;
        let mut simulation = Simulation::new(&scene).expect("a valid scene");
        simulation.refresh().expect("a cut");
        let (mut solid, mut steps_of_change, mut most_pending) = (solid_in_mesh(&simulation), 0, 0.0_f64);
        let (mut taken, mut out_so_far) = (0.0, 0.0);
        for step in 0..150 {
            let report = simulation.step().unwrap_or_else(|error| panic!("{scheme}: {error}"));
            let out = through_boundary(&simulation) * scene.time.step;
            let appeared = report.appeared.expect("grains and fluid");
            assert!((out - appeared).abs() < 1e-10 * grain, "{scheme}, step {step}: {out} and {appeared}");
            out_so_far += out;
            // What sinks take after the solution is seen by the fluid in the next one.
            let now_taken = reading(&simulation, "sink_drain_grains");
            if now_taken == taken {
                let pending = simulation.coupled().interaction().unwrap().appearing.pending();
                let made = solid_in_mesh(&simulation) - pending;
                assert!(
                    (out_so_far - made).abs() < 1e-9 * grain,
                    "{scheme}, step {step}: {out_so_far} and {made} with {pending} pending"
                );
                most_pending = most_pending.max(pending.abs());
            }
            taken = now_taken;
            steps_of_change += u32::from((solid_in_mesh(&simulation) - solid).abs() > 0.1 * grain);
            solid = solid_in_mesh(&simulation);
            let momentum = report.momentum_exchange_defect.unwrap();
            assert!(momentum < 1e-11, "{scheme}, step {step}: {momentum}");
        }
        assert!(most_pending > 0.5 * grain, "{scheme}: the test sees nothing");
        assert!(steps_of_change > 40, "{scheme}: {steps_of_change} steps in which grains came and went");
        let (out, left) = (reading(&simulation, "sink_drain_grains"), reading(&simulation, "grains_left"));
        assert!(out > 1.0 && left > 5.0, "{scheme}: {out} grains taken, {left} left by the top");
        let come = reading(&simulation, "source_feed_grains") + reading(&simulation, "source_jet_grains");
        assert_eq!(come - out - left, reading(&simulation, "grains"), "{scheme}");
        assert_eq!(reading(&simulation, "source_jet_grains"), 12.0);
    }
}

/// The liquid made room for a grain of a source within one step: at 1, 0.25 and 0.06 ms it reached 0.3, 1.2 and 13 m/s.
#[test]
fn the_fluid_is_no_faster_beside_a_source_where_steps_are_shorter() {
    let fastest = |step: f64| {
        let sets = [format!("time.step={step:?}"), "grains[1].placement.source.start=1.0".into()];
        let scene =
            Scene::parse(Path::new("scene.toml"), IN_LIQUID, &sets).unwrap_or_else(|error| panic!("{error}"));
        let mut simulation = Simulation::new(&scene).expect("a valid scene");
        let mut fastest = 0.0_f64;
        while simulation.time() < 0.02 {
            simulation.step().expect("a step");
            let velocity = simulation.coupled().fluid().unwrap().solution.fields.velocity.iter();
            fastest = velocity.fold(fastest, |fastest, v| fastest.max(v.norm()));
        }
        fastest
    };
    let speeds = [1e-3, 2.5e-4, 6.25e-5].map(fastest);
    assert!(speeds.iter().all(|speed| *speed < 1.3 * speeds[0] && *speed > 0.0), "{speeds:?} m/s");
}

/// The same with steps in parts, where the parts are summed.
#[test]
fn steps_in_parts_give_the_same_volume() {
    let sets = ["coupling.cut={travel=0.1}", "fluid.solver.tolerance=1e-13"];
    let scene = scene(IN_LIQUID, &sets);
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    let mut parts = 0.0_f64;
    for _ in 0..60 {
        let report = simulation.step().expect("a step");
        let (out, appeared) = (through_boundary(&simulation) * scene.time.step, report.appeared.unwrap());
        assert!((out - appeared).abs() < 1e-16, "{out} and {appeared}");
        parts = parts.max(reading(&simulation, "step_parts"));
    }
    assert!(parts >= 2.0, "no step was cut, the test sees nothing");
}

#[test]
fn sources_let_in_what_their_rate_says() {
    let scene = scene(IN_LIQUID, &[]);
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    for _ in 0..100 {
        simulation.step().expect("a step");
        let time = simulation.time();
        assert_eq!(
            reading(&simulation, "source_feed_grains"),
            (300.0 * time * (1.0 + 1e-9)).floor(),
            "{time}"
        );
        let of_jet = reading(&simulation, "source_jet_mass_kg_per_m");
        let grain = 2500.0 * 0.8 * std::f64::consts::PI * 25e-8;
        let due = (0.5 * (time - 0.011)).clamp(0.0, 12.0 * grain);
        assert!(
            of_jet <= due * (1.0 + 1e-9) && due - of_jet < grain * (1.0 + 1e-9),
            "{time}: {of_jet} of {due}"
        );
    }
}

#[test]
fn a_run_with_sources_and_sinks_goes_on_from_its_checkpoint_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let scene = scene(IN_LIQUID, &[]);
    let mut straight = Simulation::new(&scene).expect("a valid scene");
    while reading(&straight, "sink_drain_grains") < 3.0 || reading(&straight, "grains_left") < 1.0 {
        straight.step().expect("a step");
    }
    let hash = scene.hash().expect("a hash");
    let stamp = Stamp { scene_hash: hash.clone(), step: straight.steps(), time: straight.time() };
    Checkpoint::write(&path, &stamp, &straight.state().expect("a state"), &None::<Averages>).expect("a file");
    let checkpoint = Checkpoint::read(&path, &hash).expect("a checkpoint");
    let mut again = Simulation::restarted(&scene, &Host::default(), &checkpoint).expect("a restart");
    for _ in 0..30 {
        straight.step().expect("a step");
        again.step().expect("a step");
        let grains = |run: &Simulation| run.coupled().grains().expect("grains").particles.clone();
        assert_eq!(grains(&straight), grains(&again));
        let fields = |run: &Simulation| run.coupled().fluid().expect("a fluid").accepted.clone();
        assert_eq!(fields(&straight), fields(&again));
        let wall = |name: &str| name.contains("_s_") && !name.contains("flow");
        let row = |run: &Simulation| -> Vec<_> {
            run.readings().into_iter().filter(|(name, value)| !wall(name) && !value.is_nan()).collect()
        };
        assert_eq!(row(&straight), row(&again));
    }
}

/// Grains alone: a box that fills up, and a line that takes who falls.
const FILLS_UP: &str = r#"
gravity = [0.0, -9.81]
time = { step = 1e-3, end = 1.0 }
materials.glass = { density = 2500.0, friction = 0.3 }
walls = [
    { name = "floor", from = [0.0, 0.0], to = [0.02, 0.0] },
    { name = "left", from = [0.0, 0.0], to = [0.0, 0.05] },
    { name = "right", from = [0.02, 0.0], to = [0.02, 0.05] },
]

[[grains]]
material = "glass"
radius = 1e-3
placement = { source = { name = "feed", lower = [0.0, 0.0], upper = [0.02, 0.02], rate = { grains = 1000.0 }, end = 0.5 } }
"#;

#[test]
fn grains_without_a_free_place_wait_and_the_run_says_so() {
    let mut simulation = Simulation::new(&scene(FILLS_UP, &[])).expect("a valid scene");
    let mut remarks = vec![];
    for _ in 0..300 {
        simulation.step().expect("a step");
        let come = reading(&simulation, "source_feed_grains");
        assert_eq!(reading(&simulation, "grains"), come);
        assert_eq!(reading(&simulation, "source_feed_waiting"), (1000.0 * simulation.time()).round() - come);
        remarks.extend(simulation.remarks().iter().map(ToString::to_string));
    }
    let waiting: Vec<&String> =
        remarks.iter().filter(|remark| remark.contains("\"feed\" finds no free place")).collect();
    assert_eq!(waiting.len(), 1, "{remarks:?}");
    let said = simulation.shortcomings().join("\n");
    assert!(said.contains("waited for a free place") && said.contains("\"feed\""), "{said}");
    // Nobody was put into another.
    assert!(simulation.totals().max_penetration_over_radius < Some(0.05));
}

#[test]
fn a_line_takes_who_crosses_it_within_its_ends_and_its_times() {
    let falling =
        FILLS_UP.replace("rate = { grains = 1000.0 }, end = 0.5", "rate = { grains = 200.0 }, end = 0.1");
    let line = |from: f64, to: f64, more: &str| {
        format!("sinks=[{{name=\"line\",from=[{from:?},0.004],to=[{to:?},0.004]{more}}}]")
    };
    let cases =
        [(line(0.0, 0.02, ""), 20.0), (line(0.03, 0.05, ""), 0.0), (line(0.0, 0.02, ",start=0.9"), 0.0)];
    for (sinks, taken) in cases {
        let raised = ["grains[0].placement.source.lower=[0.0,0.01]", &sinks];
        let mut simulation = Simulation::new(&scene(&falling, &raised)).expect("a valid scene");
        for _ in 0..400 {
            simulation.step().expect("a step");
        }
        assert_eq!(reading(&simulation, "sink_line_grains"), taken, "{sinks}");
        assert_eq!(reading(&simulation, "grains"), 20.0 - taken, "{sinks}");
        let mass = 20.0 * 2500.0 * std::f64::consts::PI * 1e-6;
        assert!((reading(&simulation, "source_feed_mass_kg_per_m") - mass).abs() < 1e-12 * mass);
    }
}

/// What was due in grains was taken for kilograms, and the source filled its box.
#[test]
fn a_source_whose_rate_changes_its_unit_goes_on_at_the_new_rate() {
    let slow = FILLS_UP.replace("rate = { grains = 1000.0 }", "rate = { grains = 200.0 }");
    for (rate, more) in [("{mass=0.1}", 1.0), ("{grains=100.0}", 10.0)] {
        let event = format!("events=[{{time=0.1,set=[\"grains.0.placement.source.rate={rate}\"]}}]");
        let mut simulation = Simulation::new(&scene(&slow, &[&event])).expect("a valid scene");
        for _ in 0..200 {
            simulation.step().expect("a step");
        }
        assert_eq!(reading(&simulation, "source_feed_grains"), 20.0 + more, "{rate}");
    }
}

#[test]
fn wrong_sources_and_sinks_are_refused() {
    let refused = |text: &str, sets: &[&str], parts: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        let error = Scene::parse(Path::new("scene.toml"), text, &sets).expect_err(parts[0]).to_string();
        parts.iter().for_each(|part| assert!(error.contains(part), "{part} is not in {error}"));
    };
    let source = |key: &str, value: &str| format!("grains[0].placement.source.{key}={value}");
    let cases: [(String, &[&str]); 9] = [
        (source("rate", "{grains=0.0}"), &["rate.grains", "0"]),
        (source("rate", "{mass=-1.0}"), &["rate.mass", "-1"]),
        (source("upper", "[0.001,0.02]"), &["does not hold the largest grain", "upper"]),
        (source("end", "0.0"), &["is not after `start"]),
        (source("name", "\"\""), &["is empty"]),
        ("sinks=[{name=\"a\"}]".into(), &["says not where it is"]),
        ("sinks=[{name=\"a\",from=[0.0,0.0],to=[0.0,0.0]}]".into(), &["sinks[0].to"]),
        (
            "sinks=[{name=\"a b\",lower=[0.0,0.0],upper=[1.0,1.0]},{name=\"a_b\",lower=[0.0,0.0],upper=[1.0,1.0]}]".into(),
            &["sinks[1].name", "another sink"],
        ),
        ("grains[0].fixed=true".into(), &["cannot be fixed"]),
    ];
    for (set, parts) in &cases {
        refused(FILLS_UP, &[set], parts);
    }
    refused(
        IN_LIQUID,
        &["fluid.boundaries[2].flow=\"slip\"", "fluid.boundaries[1].flow=\"slip\""],
        &["no open boundary"],
    );
    refused(IN_LIQUID, &["grains[0].placement.source.upper=[0.018,0.05]"], &["outside of the fluid"]);
    // Their forces were added up in one column.
    let both = ["walls[0].name=\"a b\"", "walls[1].name=\"a_b\""];
    refused(FILLS_UP, &both, &["walls[1].name", "the columns of series.csv"]);
    let without_grains = "gravity = [0.0, -9.81]\ntime = { step = 1e-3, end = 1.0 }\nsinks = [{ name = \"a\", from = [0.0, 0.0], to = [1.0, 0.0] }]\n";
    refused(without_grains, &[], &["sinks", "no grains"]);
}

/// A hole in the mesh is not in the box around it: only when a grain appears there can it be known.
#[test]
fn a_source_whose_grains_are_not_in_the_mesh_is_an_error_that_names_it() {
    let hole = ["fluid.mesh.rectangle.holes=[{name=\"rod\",centre=[0.01,0.03],radius=0.004,size=0.002}]"];
    let text = IN_LIQUID.replace(
        "    { name = \"walls\", flow = \"slip\" },",
        "    { name = \"walls\", flow = \"slip\" },\n    { name = \"rod\", flow = \"slip\" },",
    );
    let mut simulation = Simulation::new(&scene(&text, &hole)).expect("a valid scene");
    let error = (0..100).find_map(|_| simulation.step().err()).expect("a grain in the hole").to_string();
    assert!(error.contains("source \"feed\"") && error.contains("not wholly in the mesh"), "{error}");
}

/// The case in a short form: once the flow is steady, as much comes in as goes out, but for the scatter of a few
/// grains.
#[test]
fn the_fed_hopper_reaches_a_steady_state() {
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/fed-hopper/scene.toml");
    let scene = Scene::read(&case, &[]).unwrap_or_else(|error| panic!("{error}"));
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    let count = |run: &Simulation| {
        ["source_feed_grains", "sink_outlet_grains", "grains"].map(|column| reading(run, column))
    };
    let mut marks = vec![];
    for step in 1..=1000 {
        simulation.step().expect("a step");
        if step % 250 == 0 {
            marks.push(count(&simulation));
        }
    }
    let [first, last] = [marks[1], marks[3]];
    let (came, went) = (last[0] - first[0], last[1] - first[1]);
    assert!(went > 400.0, "{went} grains in 0.5 s");
    assert_eq!(came - went, last[2] - first[2]);
    assert!((came - went).abs() < 3.0 * went.sqrt(), "{came} came and {went} went: {marks:?}");
    assert!(reading(&simulation, "source_feed_waiting") > 0.0, "the source does not hold the level");
}
