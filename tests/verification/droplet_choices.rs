//! What a droplet does by itself or with a grain in it, against what is known exactly, and what its choices change.

use voidage_coupling::closure::{Drag, Surroundings, VoidageFunction};
use voidage_coupling::droplet::Droplet;
use voidage_scene::Simulation;
use voidage_tests::{droplet_scene, reading};

/// Gas, walls and grains as warm as the droplet: nothing boils.
const COLD: [&str; 5] = [
    "fluid.heat.initial_temperature=373.15",
    "fluid.heat.reference_temperature=373.15",
    "fluid.boundaries[0].heat={open={temperature=373.15}}",
    "fluid.boundaries[1].heat={temperature=373.15}",
    "grains[0].temperature=373.15",
];

/// One grain of 55 um at rest in the middle of the droplet, full of solid.
const ONE: [&str; 4] = [
    "grains[0].placement={lattice={lower=[0.00294,0.00819],upper=[0.003,0.00825],spacing=1.0}}",
    "grains[0].velocity=[0.0,0.0]",
    "grains[0].radius=2.75e-5",
    "grains[0].solidity=1.0",
];

fn run(sets: &[&[&str]]) -> Simulation {
    let run = Simulation::new(&droplet_scene(&sets.concat())).expect("a valid scene");
    let grains = run.coupled().grains().expect("grains").particles.len();
    assert!(!sets.contains(&&ONE[..]) || grains == 1, "{grains} grains");
    run
}

fn steps(run: &mut Simulation, count: usize) {
    (0..count).for_each(|step| _ = run.step().unwrap_or_else(|error| panic!("step {step}: {error}")));
}

fn droplet(run: &Simulation) -> &Droplet<2> {
    run.coupled().fluid().and_then(|fluid| fluid.droplet.as_deref()).expect("a droplet")
}

/// Velocity of a grain of 55 um and density 3200 in water at which its drag is the weight of a density, m/s.
fn terminal(density: f64) -> f64 {
    let drag = |slip: f64| {
        let around =
            Surroundings { slip, voidage: 1.0, diameter: 5.5e-5, density: 958.4, viscosity: 2.82e-4 };
        Drag::Dallavalle.coefficient(&around, VoidageFunction::None) * slip
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..100 {
        let middle = (low + high) / 2.0;
        if drag(middle) < 9.81 * density { low = middle } else { high = middle }
    }
    low
}

#[test]
fn a_grain_falls_through_a_droplet_at_rest_as_through_water() {
    let still = ["droplet.held=true", "time.step=1e-3"];
    let lone = ["droplet.inside.voidage=\"one\"", "coupling.voidage_function=\"none\""];
    let fall = |more: &[&str]| {
        let mut run = run(&[&COLD, &ONE, &still, more]);
        steps(&mut run, 60);
        -run.coupled().grains().expect("grains").particles.velocity[0].y
    };
    let exact = terminal(3200.0 - 958.4);
    assert!((exact / 9.837e-3 - 1.0).abs() < 1e-4, "{exact} m/s");
    let alone = fall(&[&["droplet.buoyancy=\"hydrostatic\""], &lone[..]].concat());
    assert!((alone / exact - 1.0).abs() < 1e-9, "{alone} m/s where {exact} is exact");
    // The droplet is liquid to 0.9992.
    let among = fall(&["droplet.buoyancy=\"hydrostatic\""]);
    assert!((among / exact - 1.0).abs() < 3e-3 && among != alone, "{among} m/s where {exact} is exact");
    let weighs_all = fall(&[&["droplet.buoyancy=\"none\""], &lone[..]].concat());
    let exact = terminal(3200.0);
    assert!((weighs_all / exact - 1.0).abs() < 1e-9, "{weighs_all} m/s where {exact} is exact");
}

#[test]
fn a_grain_as_heavy_as_the_water_rests_in_a_droplet_that_the_gas_carries() {
    // In a gas so thick that the droplet is at its terminal velocity at once.
    let thick = ["fluid.viscosity=1e4", "materials.glass.density=958.4"];
    let mut carried = run(&[&COLD, &ONE, &thick]);
    steps(&mut carried, 60);
    let grains = &carried.coupled().grains().expect("grains").particles;
    let weight = 9.81 * 958.4 * grains.volume[0];
    let pressed = droplet(&carried).settled.pressed.y;
    assert!((pressed / weight - 1.0).abs() < 1e-10, "{pressed} N/m of {weight} N/m");
    let slip = (grains.velocity[0] - droplet(&carried).state.velocity).norm();
    assert!(slip < 1e-10 * terminal(958.4), "{slip} m/s");
    // And in one that falls freely nothing presses on it.
    let mut falls = run(&[&COLD, &ONE]);
    steps(&mut falls, 1);
    let pressed = droplet(&falls).settled.pressed.y;
    assert!(pressed.abs() < 1e-2 * weight && pressed != 0.0, "{pressed} N/m of {weight} N/m");
}

#[test]
fn a_droplet_falls_freely_in_gas() {
    let hole = "{name=\"droplet\",centre=[0.005,0.02525],radius=1.25e-3,size=2e-4,growth=0.3}";
    let sets = [
        "fluid.mesh.rectangle.upper=[0.01,0.03]",
        &format!("fluid.mesh.rectangle.holes=[{hole}]"),
        "fluid.mesh.rectangle.size=1.5e-3",
        "grains[0].placement={lattice={lower=[0.001,0.0001],upper=[0.0012,0.0003]}}",
        "grains[0].velocity=[0.0,0.0]",
    ];
    let mut run = run(&[&COLD, &sets]);
    let (dt, count) = (5e-4, 35);
    steps(&mut run, count);
    let n = count as f64;
    let (way, speed) = (9.81 * dt * dt * n * (n + 1.0) / 2.0, 9.81 * n * dt);
    let fell = 0.02525 - reading(&run, "droplet_y_m");
    let falls = -reading(&run, "droplet_velocity_y_m_per_s");
    assert!(fell < way && (fell / way - 1.0).abs() < 5e-3, "{fell} m, in a vacuum {way} m");
    assert!(falls < speed && (falls / speed - 1.0).abs() < 8e-3, "{falls} m/s, in a vacuum {speed} m/s");
    // 1.5 mm take 17.49 ms, and the droplet has 0.1716 m/s then.
    assert!((way / 1.5e-3 - 1.03).abs() < 2e-3 && (speed / 0.1716 - 1.0).abs() < 1e-3);
}

#[test]
fn how_far_a_droplet_sinks_between_held_grains_is_of_first_order_in_the_step() {
    let sets = [
        "fluid.mesh.rectangle.holes=[{name=\"droplet\",centre=[0.003,0.006],radius=5e-4,size=5.5e-5,growth=0.2}]",
        "grains[0].placement={lattice={lower=[0.0018,0.0045],upper=[0.0042,0.0075],spacing=1.2}}",
        "grains[0].velocity=[0.0,0.0]",
        "droplet.remesh={every=1000000,angle=0.0}",
        // So thin that the stabilisation of the pressure, and with it the error of the mesh, does not depend on the
        // step.
        "fluid.density=1e-2",
    ];
    let sinks = |halvings: i32| {
        let (dt, count) = (1e-3 / 2f64.powi(halvings), 10 * (1 << halvings));
        let mut run = run(&[&COLD, &sets, &[&format!("time.step={dt}")]]);
        run.coupled_mut().grains_mut().expect("grains").particles.mass.fill(f64::INFINITY);
        steps(&mut run, count);
        0.006 - reading(&run, "droplet_y_m")
    };
    let ways: Vec<f64> = (2..5).map(sinks).collect();
    let order = ((ways[1] - ways[0]) / (ways[2] - ways[1])).log2();
    assert!((0.9..1.1).contains(&order), "order {order}, ways {ways:?}");
    assert!(ways[2] > 1e-5, "{ways:?}");
}

/// What stuck when the bound was taken away stuck for ever, and a run that was stopped there went on otherwise.
#[test]
fn contacts_stick_everywhere_when_an_event_takes_the_bound_away() {
    let event = "events=[{time=1e-3,set=[\"coupling.cohesion_below={}\"]}]";
    let mut run = run(&[&[event]]);
    let cohesive = |run: &Simulation| run.coupled().interaction().expect("both").cohesive.clone();
    steps(&mut run, 1);
    assert!(!cohesive(&run).is_empty());
    steps(&mut run, 4);
    assert!(run.time() > 1e-3 && cohesive(&run).is_empty());
}

#[test]
fn a_disc_takes_more_of_the_droplet_than_its_solid() {
    let hollow = [&ONE[..3], &["grains[0].solidity=0.476"]].concat();
    for (share, takes) in [("solid", 0.476), ("disc", 1.0)] {
        let share = format!("droplet.grain_share={share:?}");
        let run = run(&[&COLD, &hollow, &[&share]]);
        let disc = std::f64::consts::PI * 2.75e-5f64.powi(2);
        let taken = (std::f64::consts::PI * 1e-6 - droplet(&run).state.liquid) / disc;
        assert!((taken - takes).abs() < 1e-9, "{share}: {taken} of the disc");
    }
}

#[test]
fn the_water_drags_by_its_voidage_or_as_if_a_grain_were_alone() {
    let many = ["grains[0].velocity=[0.0,0.01]", "grains[0].placement.lattice.spacing=1.3"];
    for voidage in ["mean", "one"] {
        let inside = format!("droplet.inside.voidage={voidage:?}");
        let mut run = run(&[&COLD, &many, &[&inside]]);
        let before = droplet(&run).clone();
        let velocity = run.coupled().grains().expect("grains").particles.velocity.clone();
        steps(&mut run, 1);
        let share = if voidage == "mean" { before.state.liquid / before.volume() } else { 1.0 };
        let grains = &run.coupled().grains().expect("grains").particles;
        let wet = run.coupled().interaction().and_then(|both| both.wet.as_ref()).expect("water");
        let whole = (0..grains.len()).find(|i| wet.swallows(*i)).expect("a grain in the water");
        let around = Surroundings {
            slip: velocity[whole].norm(),
            voidage: share,
            diameter: 2.0 * grains.radius[whole],
            density: 958.4,
            viscosity: 2.82e-4,
        };
        let law = grains.volume[whole] * Drag::Dallavalle.coefficient(&around, VoidageFunction::Henry);
        assert!((wet.drag(whole) / law - 1.0).abs() < 1e-12, "{voidage}: {} and {law}", wet.drag(whole));
        assert!(voidage == "one" || share < 0.9, "the grains take too little of the water: {share}");
    }
}
