//! A droplet with grains in its water: what it must conserve, whatever the scheme, and how it ends.

use voidage_remote::launch::Host;
use voidage_scene::recorder::{Averages, Checkpoint, Stamp};
use voidage_scene::{Scene, Simulation};
use voidage_tests::{bits, droplet_scene as scene, reading};

/// What the droplet holds: mass, velocity (y), impulse and heat that it has still to get, volume that it owes, the
/// share of its vapour that the gas would get of an interstitial velocity, and pores and solid of the grains in it.
struct Books {
    mass: f64,
    velocity: f64,
    impulse: f64,
    warmth: f64,
    owed: f64,
    voidage: f64,
    pores: f64,
    solid: f64,
}

fn books(simulation: &mut Simulation) -> Books {
    simulation.refresh().expect("the grains are cut");
    let interaction = simulation.coupled().interaction().expect("both");
    let (solid, taken) = interaction.wet.as_ref().map_or((0.0, 0.0), |wet| (wet.solid(), wet.volume()));
    let fluid = simulation.coupled().fluid().expect("a fluid");
    let droplet = fluid.droplet.as_ref().expect("a droplet");
    let (state, volume) = (&droplet.state, droplet.volume());
    let lacks = (volume - state.liquid - taken).abs() / volume;
    assert!(lacks < 1e-12, "liquid and grains fill the droplet but for {lacks}");
    let (mut within, mut perimeter) = (0.0, 0.0);
    for ends in fluid.mesh.boundary("droplet").expect("a surface").facets.chunks_exact(2) {
        let [a, b] = [ends[0] as usize, ends[1] as usize];
        let length = (fluid.mesh.points[a] - fluid.mesh.points[b]).norm();
        within += length * (interaction.load.voidage[a] + interaction.load.voidage[b]) / 2.0;
        perimeter += length;
    }
    Books {
        mass: droplet.mass(),
        velocity: state.velocity.y,
        impulse: state.impulse.y,
        warmth: state.warmth,
        owed: state.volume,
        voidage: within / perimeter,
        pores: taken - solid,
        solid,
    }
}

/// Runs a droplet through grains, and checks each of its steps.
fn add_up(sets: &[&str], steps: usize) {
    const LATENT: f64 = 2.257e6;
    let mut run = Simulation::new(&scene(sets)).expect("a valid scene");
    let dt = 5e-4;
    let (mut crossed, mut arrived, mut displaced) = (0, 1.0f64, 0.0f64);
    let first = books(&mut run).solid;
    for step in 1..=steps {
        let before = books(&mut run);
        let report = run.step().unwrap_or_else(|error| panic!("{sets:?}: {error}"));
        // The shares of each grain in gas and water make a whole.
        let lost = report.solid_volume_defect.expect("grains and gas");
        assert!(lost < 1e-12, "{sets:?}, step {step}: {lost:e} of the solid is lost");
        let wet = run.coupled().interaction().and_then(|i| i.wet.as_ref()).map_or(0, |wet| wet.len());
        let now = books(&mut run);
        crossed = crossed.max(wet);
        let of = |name: &str| reading(&run, name);

        let water = of("droplet_water_defect_kg_per_m") / before.mass;
        assert!(water.abs() < 1e-13, "{sets:?}, step {step}: water {water:e}");

        let boils = of("vaporisation_kg_per_s_per_m");
        let heat = of("droplet_gas_heat_W_per_m") + of("droplet_grain_heat_W_per_m");
        let lacks = LATENT * boils - heat + (now.warmth - before.warmth) / dt;
        assert!(lacks.abs() < 1e-12 * heat.abs(), "{sets:?}, step {step}: heat {lacks:e} of {heat:e}");

        let grains = of("droplet_grain_force_y_N_per_m") + of("droplet_grain_pressure_force_y_N_per_m");
        let force = of("droplet_gas_force_y_N_per_m") + grains;
        let weight = -9.81 * before.mass;
        let lacks = before.mass * (now.velocity - before.velocity) / dt - force - weight
            + (now.impulse - before.impulse) / dt;
        assert!(lacks.abs() < 1e-12 * weight.abs(), "{sets:?}, step {step}: momentum {lacks:e}");

        let arrives = if sets.iter().any(|set| set.contains("interstitial")) { before.voidage } else { 1.0 };
        let steam = sets.iter().find_map(|set| set.strip_prefix("droplet.vapour_density="));
        let density = steam.map_or(1.204, |density| density.parse().expect("a number"));
        let vapour = boils * (arrives / density - 1.0 / 958.4);
        let owed = (now.owed - before.owed) / dt;
        let pores = (now.pores - before.pores) / dt;
        let lacks = of("flux_outflow_m2_per_s") - vapour - pores + owed;
        let scale = vapour.abs() + pores.abs();
        assert!(lacks.abs() < 1e-9 * scale, "{sets:?}, step {step}: volume {lacks:e} of {scale:e}");
        // What is owed stays what a step or two let through.
        assert!(now.owed.abs() < 2.0 * dt * scale, "{sets:?}, step {step}: owes {:e}", now.owed);

        let passed = of("droplet_solid_in_below_m2") - of("droplet_solid_out_above_m2");
        let lacks = passed - (now.solid - first);
        assert!(lacks.abs() < 1e-12 * now.solid, "{sets:?}, step {step}: solid {lacks:e} of {:e}", now.solid);
        (arrived, displaced) = (arrived.min(arrives), displaced.max(pores.abs() / vapour));
    }
    assert!(crossed > 50, "{sets:?}: only {crossed} grains were in the water");
    let of = |choice: &str| sets.iter().any(|set| set.contains(choice));
    assert!(!of("interstitial") || arrived < 0.95, "{arrived} of the vapour arrived");
    assert!(
        of("grain_share=\"disc\"") == (displaced > 1e-3),
        "{sets:?}: the pores are {displaced} of the vapour"
    );
}

#[test]
fn water_volume_momentum_and_heat_add_up_with_grains_crossing_the_surface() {
    // With these schemes grains hand nothing over to the droplet when it swallows them.
    add_up(&["coupling.scheme=\"explicit\""], 24);
    add_up(&["coupling.scheme=\"henry\""], 24);
}

#[test]
fn they_add_up_with_steam_that_is_lighter_than_the_gas_and_laws_per_disc() {
    add_up(&["coupling.scheme=\"henry\"", "droplet.vapour_density=0.9"], 18);
    add_up(&["coupling.scheme=\"henry\"", "coupling.per=\"disc\""], 18);
}

#[test]
fn they_add_up_however_often_the_domain_is_remeshed() {
    for every in [1, 25] {
        add_up(&["coupling.scheme=\"henry\"", &format!("droplet.remesh.every={every}")], 26);
    }
}

/// Runs a droplet through grains, and looks at the books only: what they lack, as a share of what passed, at the end of
/// every step.
fn closes(sets: &[&str], steps: u32) -> Simulation {
    let mut run = Simulation::new(&scene(sets)).expect("a valid scene");
    let (dt, first) = (5e-4, books(&mut run));
    let (mut let_out, mut boiled, mut crossed, mut parts, mut solves) = (0.0, 0.0, 0, 0, 0);
    for step in 1..=steps {
        let report = run.step().unwrap_or_else(|error| panic!("{sets:?}: {error}"));
        let of = |name: &str| reading(&run, name);
        // Grains that leave make room, which the fluid fills.
        let_out += dt * (of("flux_outflow_m2_per_s") - of("solid_inflow_m2_per_s"));
        // Rates are means over the parts of a step.
        boiled += dt * of("vaporisation_kg_per_s_per_m");
        let agreement = report.agreement.unwrap_or_default();
        (parts, solves) = (parts + agreement.parts, solves + agreement.solves);
        crossed =
            crossed.max(run.coupled().interaction().and_then(|i| i.wet.as_ref()).map_or(0, |wet| wet.len()));
        let droplet = run.coupled().fluid().and_then(|fluid| fluid.droplet.as_deref()).expect("a droplet");
        let state = &droplet.state;
        let vapour = state.boiled * (958.4 / 1.204 - 1.0);
        let weighs = droplet.material.gravity.norm() * first.mass * dt * f64::from(step);
        let lacks = [
            ("water", of("droplet_water_defect_kg_per_m") / first.mass),
            ("vapour", (first.mass - of("droplet_liquid_kg_per_m") - boiled) / first.mass),
            ("momentum x", of("droplet_momentum_defect_x_N_s_per_m") / weighs),
            ("momentum y", of("droplet_momentum_defect_y_N_s_per_m") / weighs),
            ("heat", of("droplet_heat_defect_J_per_m") / state.ledger.heat),
            ("volume", (let_out - vapour + state.volume) / vapour),
            ("momentum of the grains", of("momentum_exchange_defect")),
            ("heat of the grains", of("energy_exchange_defect")),
        ];
        for (what, lack) in lacks {
            assert!(lack.abs() < 1e-10, "{sets:?}, step {step}: {what} lacks {lack:e}");
        }
        // What is owed stays what some steps let through.
        assert!(
            state.volume.abs() < 5.0 * vapour / f64::from(step),
            "{sets:?}, step {step}: {}",
            state.volume
        );
    }
    assert!(crossed > 50, "{sets:?}: only {crossed} grains were in the water");
    let cut = sets.iter().any(|set| set.contains("cut"));
    assert!(cut == (parts > steps as usize), "{sets:?}: {parts} parts");
    let iterates = sets.iter().any(|set| set.contains("iteration"));
    assert!(!iterates || solves > steps as usize, "{sets:?}: {solves} solutions");
    run
}

#[test]
fn the_books_of_a_whole_run_close_for_each_scheme() {
    // The scheme of a scene that names none is `iterated`.
    // So light that it does not come to the floor.
    closes(&["gravity=[0.0,-1.0]", "grains[0].velocity=[0.02,-0.05]"], 200);
    // So that it has to iterate.
    closes(&["coupling.iteration.tolerance=1e-6"], 20);
    closes(&["coupling.cut={travel=0.1}"], 20);
    closes(&["coupling.cut={travel=1e3,absorption=1e-7}"], 20);
    closes(&["coupling.scheme=\"anchored\""], 60);
    closes(&["coupling.scheme=\"henry\""], 40);
}

#[test]
fn the_books_show_an_impulse_and_a_heat_that_nobody_gave() {
    let mut run = closes(&[], 4);
    let fluid = run.coupled_mut().fluid_mut().expect("a fluid");
    let droplet = fluid.live_droplet().expect("a droplet");
    let (mass, joule) = (droplet.mass(), 1e-3);
    droplet.state.velocity.x += 1e-3;
    droplet.state.warmth += joule;
    let found = reading(&run, "droplet_momentum_defect_x_N_s_per_m");
    assert!((found / (1e-3 * mass) - 1.0).abs() < 1e-9, "{found} N s/m");
    let found = reading(&run, "droplet_heat_defect_J_per_m");
    assert!((found / joule - 1.0).abs() < 1e-9, "{found} J/m");
}

#[test]
fn they_add_up_whatever_is_chosen() {
    for choice in [
        "droplet.grain_share=\"disc\"",
        "droplet.blowing=\"interstitial\"",
        "droplet.heat_flux=\"gradient\"",
        "droplet.buoyancy=\"hydrostatic\"",
        "droplet.buoyancy=\"none\"",
        "droplet.inside.voidage=\"one\"",
    ] {
        add_up(&["coupling.scheme=\"henry\"", choice], 8);
    }
}

#[test]
fn every_scheme_takes_a_droplet_through_grains() {
    for scheme in ["henry-free", "lagged", "anchored", "iterated"] {
        let scene = scene(&[&format!("coupling.scheme={scheme:?}"), "coupling.cut={}"]);
        let mut run = Simulation::new(&scene).expect("a valid scene");
        for _ in 0..10 {
            let report = run.step().unwrap_or_else(|error| panic!("{scheme}: {error}"));
            for defect in [report.momentum_exchange_defect, report.energy_exchange_defect] {
                assert!(defect.is_some_and(|defect| defect < 1e-9), "{scheme}: {defect:?}");
            }
            books(&mut run);
        }
        let view = run.view();
        let temperature = view.fluid.expect("a fluid").fields.scalar(0);
        assert!(temperature.iter().all(|t| (373.15 - 1e-6..673.15 + 1e-6).contains(t)), "{scheme}");
        let grains = view.grains.expect("grains").temperature.expect("heat");
        assert!(grains.iter().all(|t| (373.15 - 1e-6..673.15 + 1e-6).contains(t)), "{scheme}");
    }
}

#[test]
fn a_droplet_is_the_same_for_one_two_and_four_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let mut run = Simulation::new(&scene(&[])).expect("a valid scene");
            (0..8).for_each(|_| _ = run.step().expect("a step"));
            bits(&mut run)
        })
    };
    let one = run(1);
    for threads in [2, 4] {
        assert!(one == run(threads), "{threads} threads give other bits");
    }
}

/// Steps before and after a checkpoint, straight on and from the checkpoint: both the same.
fn goes_on_as_if_nothing_had_been(scene: &Scene, before: usize, after: usize) -> Simulation {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let mut straight = Simulation::new(scene).expect("a valid scene");
    (0..before).for_each(|_| _ = straight.step().expect("a step"));
    let hash = scene.hash().expect("a hash");
    let stamp = Stamp { scene_hash: hash.clone(), step: straight.steps(), time: straight.time() };
    Checkpoint::write(&path, &stamp, &straight.state().expect("a state"), &None::<Averages>).expect("a file");
    let checkpoint = Checkpoint::read(&path, &hash).expect("a checkpoint");
    let mut again = Simulation::restarted(scene, &Host::default(), &checkpoint).expect("a restart");
    for _ in 0..after {
        straight.step().expect("a step");
        again.step().expect("a step");
    }
    assert!(bits(&mut straight) == bits(&mut again), "the restarted run is another");
    // What was missing of its water jumped, because grains of the checkpoint were taken for those of time zero.
    for name in [
        "droplet_y_m",
        "droplet_radius_m",
        "vaporisation_kg_per_s_per_m",
        "droplet_liquid_kg_per_m",
        "droplet_water_defect_kg_per_m",
    ] {
        assert_eq!(reading(&straight, name), reading(&again, name), "{name}");
    }
    straight
}

#[test]
fn a_droplet_goes_on_from_its_checkpoint_bit_for_bit_before_and_across_a_remeshing() {
    goes_on_as_if_nothing_had_been(&scene(&[]), 3, 1);
    goes_on_as_if_nothing_had_been(&scene(&[]), 7, 5);
}

/// The parts of a step begin with the length that those of the step before ended with.
#[test]
fn a_droplet_in_steps_in_parts_goes_on_bit_for_bit() {
    let run = goes_on_as_if_nothing_had_been(&scene(&["coupling.cut={travel=1e3,absorption=1e-7}"]), 16, 3);
    let fluid = run.coupled().fluid().expect("a fluid");
    assert!(fluid.droplet.as_ref().is_some_and(|droplet| droplet.state.next < 1.0), "no step was in parts");
}

#[test]
fn a_droplet_that_boils_away_leaves_gas_in_its_place() {
    // Small, and with so little heat of vaporisation that it is gone within some steps.
    let scene = scene(&[
        "fluid.mesh.rectangle.holes=[{name=\"droplet\",centre=[0.003,0.00825],radius=2e-4,size=5.5e-5}]",
        "grains[0].placement={lattice={lower=[0.0015,0.001],upper=[0.0045,0.002],spacing=1.8}}",
        "droplet.latent_heat=1.5e5",
        "droplet.held=true",
        "coupling.scheme=\"henry\"",
    ]);
    let mut run = Simulation::new(&scene).expect("a valid scene");
    let columns = run.readings().len();
    let mut steps = 0;
    let gone = |run: &Simulation| {
        run.coupled()
            .fluid()
            .and_then(|fluid| fluid.droplet.as_ref())
            .is_some_and(|droplet| droplet.state.gone)
    };
    while !gone(&run) {
        steps += 1;
        assert!(steps < 1000, "{} kg/m are left", reading(&run, "droplet_liquid_kg_per_m"));
        run.step().unwrap_or_else(|error| panic!("{error}"));
    }
    let straight = goes_on_as_if_nothing_had_been(&scene, steps + 1, 3);
    let fluid = straight.coupled().fluid().expect("a fluid");
    assert!((fluid.mesh.volume() / (0.006 * 0.012) - 1.0).abs() < 1e-12, "the hole is filled");
    assert!(fluid.conditions.iter().all(|condition| condition.boundary != "droplet"));
    assert_eq!(straight.readings().len(), columns);
    assert!(reading(&straight, "droplet_water_defect_kg_per_m").abs() < 1e-15);
    for (column, value) in straight.readings() {
        assert!(value.is_finite(), "{column} is {value}");
    }
}

#[test]
fn the_mesh_is_made_anew_before_a_cell_turns_over() {
    // Nothing else remeshes, and the droplet sinks by two of its radii.
    let sets =
        ["droplet.remesh={every=1000000,angle=0.0}", "droplet.held=true", "droplet.velocity=[0.0,-0.2]"];
    for scheme in ["henry", "iterated"] {
        let scheme = format!("coupling.scheme={scheme:?}");
        let mut run = Simulation::new(&scene(&[&sets[..], &[&scheme]].concat())).expect("a valid scene");
        let (mut made, mut changed) = (0, 0.0);
        for _ in 0..20 {
            let report = run.step().unwrap_or_else(|error| panic!("{scheme}: {error}"));
            books(&mut run);
            let heat = reading(&run, "remesh_heat_J_per_m");
            assert!(report.remeshed || heat == changed, "{scheme}: {heat} J/m without a new mesh");
            made += u32::from(report.remeshed);
            changed = heat;
        }
        assert!((1..10).contains(&made), "{scheme}: {made} new meshes");
        let momentum = ["x", "y"].map(|axis| reading(&run, &format!("remesh_momentum_{axis}_N_s_per_m")));
        // Of the whole box at the speed of the droplet, and of its heat.
        let moved = 1.204 * 0.2 * 0.006 * 0.012;
        assert!(momentum.iter().all(|change| *change != 0.0 && change.abs() < 0.1 * moved), "{momentum:?}");
        let all = 1.204 * 1040.0 * 673.15 * 0.006 * 0.012;
        assert!(changed != 0.0 && changed.abs() < 1e-3 * all, "{scheme}: {changed} of {all} J/m");
    }
}

#[test]
fn where_no_mesh_can_follow_the_droplet_an_error_says_when_where_and_what_to_do() {
    let flies = ["droplet.held=true", "droplet.velocity=[0.0,-10.0]"];
    for scheme in ["henry", "iterated"] {
        let scheme = format!("coupling.scheme={scheme:?}");
        let mut run = Simulation::new(&scene(&[&flies[..], &[&scheme]].concat())).expect("a valid scene");
        let before = reading(&run, "droplet_y_m");
        let error = run.step().expect_err("5 mm in a step").to_string();
        for says in
            ["step 1, from t = 0", "5.000e-3 m in 5.000e-4 s", "at (", "turn over", "smaller time.step"]
        {
            assert!(error.contains(says), "{scheme}: `{says}` is not in: {error}");
        }
        assert_eq!((run.time(), reading(&run, "droplet_y_m")), (0.0, before), "{scheme}");
    }
}

#[test]
fn a_droplet_that_falls_on_the_floor_stops_above_it() {
    let low = "fluid.mesh.rectangle.holes=[{name=\"droplet\",centre=[0.003,0.0025],radius=1e-3,size=1.1e-4}]";
    let away = "grains[0].placement={lattice={lower=[0.0015,0.01],upper=[0.0045,0.0103],spacing=1.8}}";
    let mut run = Simulation::new(&scene(&[low, away])).expect("a valid scene");
    (0..60).for_each(|_| _ = run.step().unwrap_or_else(|error| panic!("{error}")));
    let [y, radius] = ["droplet_y_m", "droplet_radius_m"].map(|name| reading(&run, name));
    assert!(y - radius > 1e-5 && y - radius < 1e-4, "the gap is {} m", y - radius);
    let speed = reading(&run, "droplet_velocity_y_m_per_s");
    assert!(speed.abs() < 5e-3, "{speed} m/s");
    // What the floor gave it is in the books; its stiffness costs them some digits.
    let lacks = reading(&run, "droplet_momentum_defect_y_N_s_per_m");
    assert!(lacks.abs() < 1e-6 * 9.81 * 3.0 * run.time(), "{lacks} N s/m");
}

#[test]
fn a_droplet_no_wider_than_the_grains_in_it_vanishes() {
    let small =
        "fluid.mesh.rectangle.holes=[{name=\"droplet\",centre=[0.003,0.00825],radius=2e-4,size=5.5e-5}]";
    let mut run = Simulation::new(&scene(&[small])).expect("a valid scene");
    (0..6).for_each(|_| _ = run.step().expect("a step"));
    let droplet = run.coupled().fluid().and_then(|fluid| fluid.droplet.clone()).expect("a droplet");
    assert!(droplet.state.gone && droplet.state.liquid > 0.5 * droplet.state.first);
}

#[test]
fn a_hot_grain_in_a_held_droplet_boils_what_its_heat_can() {
    // One grain, whole in the water; gas and walls are as warm as the droplet and give nothing.
    let cold = [
        "grains[0].placement={lattice={lower=[0.00285,0.0081],upper=[0.003,0.00825],spacing=1.0}}",
        "grains[0].velocity=[0.0,0.0]",
        "grains[0].radius=5e-5",
        "gravity=[0.0,0.0]",
        "droplet.held=true",
        "fluid.heat.initial_temperature=373.15",
        "fluid.heat.reference_temperature=373.15",
        "fluid.boundaries[0].heat={open={temperature=373.15}}",
        "fluid.boundaries[1].heat={temperature=373.15}",
    ];
    for scheme in ["henry", "iterated"] {
        let mut sets = cold.to_vec();
        let scheme = format!("coupling.scheme={scheme:?}");
        sets.push(&scheme);
        let mut run = Simulation::new(&scene(&sets)).expect("a valid scene");
        let heat = run.coupled().grains().and_then(|grains| grains.particles.heat.clone()).expect("heat");
        let warmth: f64 = heat.capacity.iter().map(|capacity| capacity * 300.0).sum();
        (0..60).for_each(|_| _ = run.step().expect("a step"));
        let droplet = run.coupled().fluid().and_then(|fluid| fluid.droplet.clone()).expect("a droplet");
        let boiled = droplet.state.boiled * 958.4 * 2.257e6;
        assert!((boiled / warmth - 1.0).abs() < 1e-9, "{scheme}: {boiled} J of {warmth} J");
    }
}

/// Grains in the water of a droplet, in a gas that is next to nothing, without weight or heat.
const IN_WATER: [&str; 11] = [
    "grains[0].placement={lattice={lower=[0.0027,0.008],upper=[0.0033,0.0085],spacing=1.5}}",
    "grains[0].radius=5e-5",
    "gravity=[0.0,0.0]",
    "fluid.density=1e-7",
    "fluid.viscosity=1e-12",
    "fluid.heat.initial_temperature=373.15",
    "fluid.heat.reference_temperature=373.15",
    "fluid.boundaries[0].heat={open={temperature=373.15}}",
    "fluid.boundaries[1].heat={temperature=373.15}",
    "grains[0].temperature=373.15",
    "coupling.scheme=\"henry\"",
];

#[test]
fn grains_that_are_held_slow_a_droplet_as_implicit_drag_does() {
    let moves = ["grains[0].velocity=[0.0,0.0]", "droplet.velocity=[0.0,0.001]"];
    let mut run = Simulation::new(&scene(&[&IN_WATER[..], &moves].concat())).expect("a valid scene");
    run.coupled_mut().grains_mut().expect("grains").particles.mass.fill(f64::INFINITY);
    for _ in 0..3 {
        let before = books(&mut run);
        run.step().expect("a step");
        let wet = run.coupled().interaction().and_then(|i| i.wet.as_ref()).expect("water");
        let grains = run.coupled().grains().expect("grains").particles.len();
        let drag: f64 = (0..grains).map(|i| wet.drag(i)).sum();
        let a = 5e-4 * drag / before.mass;
        let droplet = run.coupled().fluid().and_then(|fluid| fluid.droplet.clone()).expect("a droplet");
        let ratio = droplet.state.velocity.y / before.velocity;
        assert!((ratio * (1.0 + a) - 1.0).abs() < 1e-4 && a > 1e-3, "{ratio} where A = {a}");
    }
}

#[test]
fn water_and_grains_in_it_share_their_momentum_as_implicit_drag_does() {
    // Grains with a velocity in a droplet at rest: the slip falls by 1/(1 + A + B) in a step.
    let sets = [&IN_WATER[..], &["grains[0].velocity=[0.0,0.001]"]].concat();
    let mut run = Simulation::new(&scene(&sets)).expect("a valid scene");
    for _ in 0..3 {
        let before = books(&mut run);
        let wet = run.coupled().interaction().and_then(|i| i.wet.clone()).expect("water");
        let grains = run.coupled().grains().expect("grains").particles.clone();
        let slip = grains.velocity[0].y - before.velocity;
        run.step().expect("a step");
        let (dt, now) = (5e-4, run.coupled().grains().expect("grains").particles.velocity[0].y);
        let wet = run.coupled().interaction().and_then(|i| i.wet.as_ref()).unwrap_or(&wet);
        let drag: f64 = (0..grains.len()).map(|i| wet.drag(i)).sum();
        let (a, b) = (dt * drag / before.mass, dt * wet.drag(0) / grains.mass[0]);
        let droplet = run.coupled().fluid().and_then(|fluid| fluid.droplet.clone()).expect("a droplet");
        let ratio = (now - droplet.state.velocity.y) / slip;
        assert!((ratio * (1.0 + a + b) - 1.0).abs() < 1e-4, "{ratio} where A = {a}, B = {b}");
        assert!(a > 1e-3 && b > 0.05, "A = {a}, B = {b}: the test sees little");
    }
}

/// The page of verification says which test has what is known of a droplet: they are all there.
#[test]
fn the_page_names_tests_that_there_are() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let page = std::fs::read_to_string(root.join("cases/verification/README.md")).expect("the page");
    let (_, part) = page.split_once("## The droplet").expect("a part on the droplet");
    let part = part.split("\n## ").next().expect("text");
    let numbered = |line: &&str| {
        line.strip_prefix("| ").is_some_and(|row| row.starts_with(|c: char| c.is_ascii_digit()))
    };
    let rows: Vec<&str> = part.lines().filter(numbered).collect();
    assert_eq!(rows.len(), 26, "{rows:?}");
    let places = [
        "tests/verification/droplet.rs",
        "tests/verification/droplet_choices.rs",
        "tests/verification/grains.rs",
        "tests/cost/unneeded.rs",
        "tests/stability/map.rs",
        "cases/stability/src/absorption.rs",
        "coupling/scene/src/tests.rs",
        "coupling/src/droplet/surface.rs",
        "tests/python/test_compare.py",
        "cases/verification/src/fluid/body.rs",
        "cases/verification/src/fluid/stefan.rs",
        "cases/verification/src/fluid/half_plane.rs",
    ];
    let sources = places.map(|place| std::fs::read_to_string(root.join(place)).expect("a source"));
    for row in rows {
        let cell = row.trim_matches('|').rsplit('|').next().expect("a cell");
        let names: Vec<&str> = cell.split('`').skip(1).step_by(2).collect();
        assert!(!names.is_empty(), "no test in: {row}");
        for name in names {
            let there = |start: &str| sources.iter().any(|source| source.contains(&format!("{start}{name}")));
            assert!(there("fn ") || there("def ") || there("name: \""), "there is no `{name}`: {row}");
        }
    }
}
