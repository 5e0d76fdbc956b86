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

/// Where the laws are per disc, drag does not depend on how much of a grain is solid, and weight does: with
/// gamma = eta/2 (0.63 sqrt(Re) + 4.8)^2.
#[test]
fn a_grain_falls_through_water_with_the_drag_of_its_disc() {
    for solidity in [0.476, 1.0] {
        let solid = format!("grains[0].solidity={solidity}");
        let still = ["droplet.held=true", "time.step=1e-3", "coupling.per=\"disc\"", &solid];
        let lone = ["droplet.inside.voidage=\"one\"", "coupling.voidage_function=\"none\""];
        let mut run = run(&[&COLD, &ONE[..3], &still, &lone, &["droplet.buoyancy=\"hydrostatic\""]]);
        steps(&mut run, 60);
        let falls = -run.coupled().grains().expect("grains").particles.velocity[0].y;
        let weight = solidity * std::f64::consts::PI * 2.75e-5f64.powi(2) * (3200.0 - 958.4) * 9.81;
        let root = 0.63 * (958.4 * 5.5e-5 * falls / 2.82e-4).sqrt() + 4.8;
        let drag = 2.82e-4 / 2.0 * root * root * falls;
        assert!((drag / weight - 1.0).abs() < 1e-8, "{drag} N/m of {weight} N/m at {falls} m/s");
    }
}

/// The number is the vapour through a chimney as wide as the droplet over the speed of a grain that falls in the gas.
#[test]
fn the_chimney_number_is_that_of_the_mean_grain() {
    // Also where an event changes the law.
    let event = "events=[{time=5e-4,set=[\"coupling.per='disc'\"]}]";
    for per in ["coupling.per=\"solid\"", "coupling.per=\"disc\"", event] {
        let steam = "droplet.vapour_density=0.8";
        let mut run = run(&[&[per, steam, "grains[0].radius=5e-5"]]);
        steps(&mut run, 2);
        let of = |name: &str| reading(&run, name);
        let width = 2.0 * of("droplet_radius_m");
        let falls = of("vaporisation_kg_per_s_per_m") / (width * 0.8 * of("droplet_chimney_number"));
        // 47.6 % of a disc of 0.1 mm is solid, or all of the volume that spheres have with the cross-section.
        let solid = 0.476 * std::f64::consts::PI * 25e-10;
        let volume = if per.contains("disc") { 2.0 / 3.0 * 1e-8 } else { solid };
        let around =
            Surroundings { slip: falls, voidage: 1.0, diameter: 1e-4, density: 1.204, viscosity: 2e-5 };
        let drag = volume * Drag::Dallavalle.coefficient(&around, VoidageFunction::Henry) * falls;
        let weight = solid * (3200.0 - 1.204) * 9.81;
        assert!((drag / weight - 1.0).abs() < 1e-9, "{per}: {drag} N/m of {weight} N/m at {falls} m/s");
    }
}

/// A grain hangs on one that is held beside the droplet while its weight is below the share of the adhesive force that is
/// left there: 1 - exp(-(s^2 - r^2)/(l r)^2), s from the centre to where they touch.
#[test]
fn cohesion_falls_off_round_the_droplet() {
    let (radius, size) = (5e-5, 1e-3_f64);
    let (x, y) = (0.0045_f64, 0.00845_f64);
    let square = (x - 0.003).powi(2) + (y - 0.00825).powi(2);
    let share = 1.0 - (-(square - size * size) / (1.5 * size).powi(2)).exp();
    let weight = 0.476 * std::f64::consts::PI * radius * radius * (3200.0 - 1.204) * 9.81;
    let falls = |force: f64| {
        let force = format!("contacts.cohesion={{force={force}}}");
        let [low, high] = [-1.0, 1.0].map(|side| [x + side * 1.01 * radius, y + side * 2.01 * radius]);
        let pair = format!("grains[0].placement={{lattice={{lower={low:?},upper={high:?},spacing=1.0}}}}");
        let sets = ["droplet.held=true", "coupling.cohesion_below={}", "coupling.cohesion_halo=1.5", &force];
        let still = ["grains[0].radius=5e-5", "grains[0].velocity=[0.0,0.0]", &pair];
        let mut run = run(&[&COLD, &sets, &still]);
        let grains = run.coupled_mut().grains_mut().expect("grains");
        assert!(
            grains.particles.len() == 2 && grains.particles.position[0].y < grains.particles.position[1].y
        );
        grains.particles.mass[1] = f64::INFINITY;
        // It hits the one that is held in the first step, and hangs on it then.
        grains.particles.velocity[0].y = 0.1;
        steps(&mut run, 10);
        -run.coupled().grains().expect("grains").particles.velocity[0].y
    };
    assert!(falls(1.01 * weight / share).abs() < 1e-8, "{} m/s", falls(1.01 * weight / share));
    let speed = falls(0.99 * weight / share);
    assert!(speed > 1e-3, "{speed} m/s");
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
