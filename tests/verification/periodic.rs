//! Periodic sides, for grains and for the fluid: nothing depends on where the sides are, and closed forms hold.

use rand::{Rng, SeedableRng};
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use voidage_coupling::closure::{Drag, Surroundings, VoidageFunction};
use voidage_dem::{Conduction, Dem, Load, Material, Motion, Particles, Period, Settings, Vector, Wall};
use voidage_remote::launch::Host;
use voidage_scene::recorder::{Averages, Checkpoint, Stamp};
use voidage_scene::{Scene, Simulation};

type V = Vector<2>;

/// Length of the period of the grains alone, m.
const LENGTH: f64 = 0.02;

/// Radii from 0.4 to 0.6 mm at random places of a periodic strip, without overlap; and velocities.
fn strip(count: usize, height: f64, seed: u64) -> (Vec<V>, Vec<f64>, Vec<V>) {
    let period = Period::new([Some([0.0, LENGTH]), None]).unwrap();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let (mut places, mut radii) = (Vec::<V>::new(), Vec::<f64>::new());
    while places.len() < count {
        let r = rng.random_range(4e-4..6e-4);
        let x = V::new(rng.random_range(0.0..LENGTH), rng.random_range(r..height - r));
        let free = |(y, s): (&V, &f64)| period.nearest(x - y).norm() > r + s;
        if places.iter().zip(&radii).all(free) {
            places.push(x);
            radii.push(r);
        }
    }
    let velocities = places.iter().map(|x| V::new(0.2 * (x.y / height - 0.5), rng.random_range(-0.05..0.05)));
    let velocities = velocities.collect();
    (places, radii, velocities)
}

/// Grains in shear between two walls that move, warm from 300 to 400 K, with the places of the sides moved by a part of
/// the period; both walls turn into each other's direction.
fn sheared(shift: f64, height: f64, friction: f64, seed: u64) -> Dem<2> {
    let (mut places, radii, velocities) = strip(150, height, seed);
    places.iter_mut().for_each(|x| x.x += shift);
    let count = places.len();
    let material = Material {
        density: 2500.0,
        friction,
        young: 6e10,
        poisson: 0.22,
        conductivity: 1.4,
        heat_capacity: 840.0,
        ..Material::default()
    };
    let materials = vec![material];
    let mut grains = Particles::new(places, radii, vec![0; count], &materials).unwrap().rotating();
    grains = grains.heated(300.0, &materials).unwrap();
    if let Some(heat) = &mut grains.heat {
        heat.temperature.iter_mut().enumerate().for_each(|(i, t)| *t += (i % 11) as f64 * 10.0);
    }
    grains.velocity = velocities;
    let wall = |name: &str, y: f64, speed: f64| Wall {
        motion: Motion::Translation { velocity: V::new(speed, 0.0) },
        friction,
        ..Wall::new(name, V::new(0.0, y), V::new(LENGTH, y))
    };
    let walls = vec![wall("floor", 0.0, -0.1), wall("lid", height, 0.1)];
    let settings = Settings {
        gravity: V::zeros(),
        conduction: Some(Conduction::Line),
        tolerance: 1e-24,
        max_sweeps: 100_000,
        period: Period::new([Some([0.0, LENGTH]), None]).unwrap(),
        ..Settings::default()
    };
    Dem::new(grains, walls, materials, settings).unwrap()
}

fn momentum(dem: &Dem<2>) -> V {
    dem.particles.mass.iter().zip(&dem.particles.velocity).map(|(m, v)| v * *m).sum()
}

/// Grains that flew side by side conducted heat if rounding pressed them together: in most of these beds they were up to
/// 0.09 K apart.
#[test]
fn grains_in_shear_do_not_depend_on_where_the_sides_are() {
    (5..9).for_each(in_shear_they_do_not_depend_on_where_the_sides_are);
}

fn in_shear_they_do_not_depend_on_where_the_sides_are(seed: u64) {
    let shift = 0.37 * LENGTH;
    let (mut one, mut other) = (sheared(0.0, 0.01, 0.3, seed), sheared(shift, 0.01, 0.3, seed));
    let (mut across, mut wrapped, mut touching) = (0, 0, 0);
    let period = one.settings().period;
    for step in 0..150 {
        let before = one.particles.position.clone();
        let reports = [&mut one, &mut other].map(|dem| dem.step(1e-3, &Load::default()));
        assert!(reports.iter().all(|report| report.converged), "step {step}: {reports:?}");
        let apart = |a: &V, b: &V| period.nearest(b - a - V::new(shift, 0.0)).norm();
        let worst = one.particles.position.iter().zip(&other.particles.position);
        let worst = worst.fold(0.0, |most: f64, (a, b)| most.max(apart(a, b)));
        assert!(worst < 1e-9 * LENGTH, "step {step}: {worst} m apart");
        let heat = [&one, &other].map(|dem| dem.particles.heat.clone().unwrap().temperature);
        let worst = heat[0].iter().zip(&heat[1]).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        assert!(worst < 1e-6, "step {step}: {worst} K apart");
        let far = |x: &V, y: &V| (x - y).norm() > 0.5 * LENGTH;
        wrapped += before.iter().zip(&one.particles.position).filter(|(x, y)| far(x, y)).count();
        let x = &one.particles.position;
        touching += one.carriers().count();
        across += one
            .carriers()
            .filter(|(contact, _)| match contact.partner {
                voidage_dem::Partner::Grain(j) => far(&x[contact.grain as usize], &x[j as usize]),
                voidage_dem::Partner::Wall(_) => false,
            })
            .count();
        assert!(x.iter().all(|x| (0.0..LENGTH).contains(&x.x)), "a grain is outside");
    }
    assert!(
        wrapped > 20 && across > 20,
        "{wrapped} passages, {across} of {touching} contacts across the sides"
    );
}

/// In shear the momentum changes by what the walls give, and heat stays; across the sides as elsewhere.
#[test]
fn momentum_and_heat_pass_the_sides_without_loss() {
    let mut dem = sheared(0.0, 0.01, 0.3, 5);
    let heat = |dem: &Dem<2>| -> f64 {
        let heat = dem.particles.heat.as_ref().unwrap();
        heat.temperature.iter().zip(&heat.capacity).map(|(t, c)| t * c).sum()
    };
    let scale: f64 = dem.particles.mass.iter().zip(&dem.particles.velocity).map(|(m, v)| m * v.norm()).sum();
    let warm = heat(&dem);
    for step in 0..200 {
        let before = momentum(&dem);
        dem.step(1e-3, &Load::default());
        let given: V = -dem.wall_force().iter().sum::<V>() * 1e-3;
        let defect = (momentum(&dem) - before - given).norm() / scale;
        assert!(defect < 1e-14, "step {step}: {defect}");
    }
    assert!((heat(&dem) - warm).abs() < 1e-13 * warm, "{} J and {warm} J", heat(&dem));
}

/// Heat goes round a ring of touching grains as it goes along a chain: the profile has the symmetry of the ring.
#[test]
fn a_ring_of_grains_conducts_across_the_sides() {
    let count = 12;
    let radius = 0.5 * LENGTH / count as f64 * (1.0 + 1e-6);
    let glass = Material {
        density: 2500.0,
        young: 6e10,
        poisson: 0.22,
        conductivity: 1.4,
        heat_capacity: 840.0,
        ..Material::default()
    };
    let material = [glass];
    let places = (0..count).map(|k| V::new((k as f64 + 0.5) * LENGTH / count as f64, 0.0)).collect();
    let mut grains = Particles::new(places, vec![radius; count], vec![0; count], &material).unwrap();
    grains.velocity = (0..count).map(|k| V::new(if k % 2 == 0 { 1e-3 } else { -1e-3 }, 0.0)).collect();
    grains = grains.heated(300.0, &material).unwrap();
    grains.heat.as_mut().unwrap().temperature[0] = 400.0;
    let settings = Settings {
        gravity: V::zeros(),
        conduction: Some(Conduction::Line),
        tolerance: 1e-24,
        max_sweeps: 100_000,
        period: Period::new([Some([0.0, LENGTH]), None]).unwrap(),
        ..Settings::default()
    };
    let mut dem = Dem::new(grains, vec![], material.to_vec(), settings).unwrap();
    let squeeze: Vec<V> = (0..count).map(|k| V::new(if k % 2 == 0 { 1.0 } else { -1.0 }, 0.0)).collect();
    for k in 0..20 {
        // Pairs are pressed in turn, on one side and on the other.
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        let force: Vec<V> = squeeze.iter().map(|f| f * sign).collect();
        dem.step(1e-3, &Load { force: &force, ..Load::default() });
    }
    let warm = &dem.particles.heat.as_ref().unwrap().temperature;
    assert!(warm[count - 1] > 300.0 + 1e-6, "nothing passed the side: {warm:?}");
    assert!(warm[1] > 300.0 + 1e-6);
}

#[test]
fn periodic_grains_are_the_same_for_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut dem = sheared(0.0, 0.01, 0.3, 5);
            for _ in 0..60 {
                dem.step(1e-3, &Load::default());
            }
            dem.particles
        })
    };
    assert_eq!(run(1), run(3));
}

// ------------------------------------------------------------------------------------------------ with a fluid

/// A suspension in shear between two walls that move.
const SUSPENSION: &str = r#"
gravity = [0.0, 0.0]
time = { step = 1e-3, end = 1.0 }
periodic = { x = [0.0, 0.016] }
materials.plastic = { density = 1050.0, friction = 0.3, heat_capacity = 1500.0 }
walls = [
    { name = "floor", from = [0.0, 0.0], to = [0.016, 0.0], motion = { velocity = [-0.05, 0.0] } },
    { name = "lid", from = [0.0, 0.008], to = [0.016, 0.008], motion = { velocity = [0.05, 0.0] } },
]
grains = [{ material = "plastic", placement = { csv = { file = "grains.csv" } }, temperature = 320.0 }]
contacts = { tolerance = 1e-12, max_sweeps = 10000 }

[fluid]
density = 1000.0
viscosity = 1e-3
heat = { heat_capacity = 4180.0, conductivity = 0.6, initial_temperature = 300.0 }
mesh = { rectangle = { lower = [0.0, 0.0], upper = [0.016, 0.008], structured = { squares = [16, 8] }, sides = { left = "left", right = "right", bottom = "floor", top = "lid" } } }
boundaries = [
    { name = "floor", flow = { velocity = [-0.05, 0.0] } },
    { name = "lid", flow = { velocity = [0.05, 0.0] } },
]
solver = { tolerance = 1e-12 }
"#;

/// A scene whose file of grains has these places and radii.
fn with_grains(text: &str, sets: &[String], grains: &[(V, f64)]) -> (TempDir, Scene) {
    let folder = tempfile::tempdir().expect("a folder");
    let rows = grains.iter().map(|(x, r)| format!("{:?},{:?},{r:?}\n", x.x, x.y));
    fs::write(folder.path().join("grains.csv"), "x,y,r\n".to_owned() + &rows.collect::<String>())
        .expect("a file");
    let scene = parsed(&folder.path().join("scene.toml"), text, sets);
    (folder, scene)
}

fn parsed(file: &Path, text: &str, sets: &[String]) -> Scene {
    Scene::parse(file, text, sets).unwrap_or_else(|error| panic!("{error}"))
}

/// Grains of the suspension, moved along x.
fn suspended(shift: f64) -> Vec<(V, f64)> {
    let period = Period::<2>::new([Some([0.0, 0.016]), None]).unwrap();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(9);
    let mut grains: Vec<(V, f64)> = vec![(V::new(0.0001, 0.004), 5e-4)];
    while grains.len() < 40 {
        let r = rng.random_range(3e-4..6e-4);
        let x = V::new(rng.random_range(0.0..0.016), rng.random_range(r..0.008 - r));
        if grains.iter().all(|(y, s)| period.nearest(x - y).norm() > r + s) {
            grains.push((x, r));
        }
    }
    grains.into_iter().map(|(x, r)| (period.wrap(x + V::new(shift, 0.0)), r)).collect()
}

/// Moved by half a period, which is a whole number of squares, grains and fields are the same but for round-off, at all
/// schemes; and the fluid has the volume that the grains leave.
#[test]
fn a_suspension_in_shear_does_not_depend_on_where_the_sides_are() {
    for scheme in ["iterated", "anchored", "henry", "lagged"] {
        let sets = [format!("coupling.scheme=\"{scheme}\"")];
        let runs = [0.0, 0.008].map(|shift| with_grains(SUSPENSION, &sets, &suspended(shift)));
        let mut runs = runs.map(|(folder, scene)| (folder, Simulation::new(&scene).expect("a valid scene")));
        let period = runs[0].1.coupled().grains().unwrap().settings().period;
        for step in 0..25 {
            for (_, run) in &mut runs {
                let report = run.step().unwrap_or_else(|error| panic!("{scheme}: {error}"));
                let (volume, momentum) =
                    (report.solid_volume_defect.unwrap(), report.momentum_exchange_defect.unwrap());
                assert!(volume < 1e-14, "{scheme}, step {step}: {volume}");
                assert!(momentum < 1e-11, "{scheme}, step {step}: {momentum}");
                let energy = report.energy_exchange_defect.unwrap();
                assert!(energy < 1e-11, "{scheme}, step {step}: {energy}");
            }
        }
        let [one, other] = [0, 1].map(|k| runs[k].1.coupled());
        let [a, b] = [one, other].map(|coupled| &coupled.grains().unwrap().particles);
        for i in 0..a.len() {
            let apart = period.nearest(b.position[i] - a.position[i] - V::new(0.008, 0.0)).norm();
            let faster = (b.velocity[i] - a.velocity[i]).norm();
            assert!(apart < 1e-11 && faster < 1e-8, "{scheme}, grain {i}: {apart} m, {faster} m/s");
        }
        let (mesh, fields) = (&one.fluid().unwrap().mesh, &one.fluid().unwrap().accepted);
        let moved = &other.fluid().unwrap().accepted;
        let voidage = [one, other].map(|coupled| &coupled.interaction().unwrap().load.voidage);
        let warm = fields.scalars[0].iter().fold(0.0, |most: f64, t| most.max(t - 300.0));
        assert!(warm > 0.1, "{scheme}: the fluid stays cold");
        let mut images = 0;
        for (node, x) in mesh.points.iter().enumerate() {
            let there = period.wrap(x + V::new(0.008, 0.0));
            let other = mesh.points.iter().position(|y| (y - there).norm() < 1e-9).expect("a node");
            images += usize::from(x.x == 0.016);
            let differ = [
                (fields.velocity[node] - moved.velocity[other]).norm() / 0.05,
                (fields.pressure[node] - moved.pressure[other]).abs() / 2.5,
                (fields.scalars[0][node] - moved.scalars[0][other]).abs() / 20.0,
                (voidage[0][node] - voidage[1][other]).abs(),
            ];
            assert!(differ.iter().all(|d| *d < 1e-7), "{scheme}, node {node} at {x:?}: {differ:?}");
        }
        assert_eq!(images, 9);
        let solid: f64 =
            voidage[0].iter().zip(&one.fluid().unwrap().nodal_volume).map(|(eps, v)| (1.0 - eps) * v).sum();
        let exact: f64 = a.volume.iter().sum();
        assert!((solid - exact).abs() < 1e-13 * exact, "{scheme}: {solid} m2 of {exact}");
    }
}

/// The part of a grain beyond a side was lost, and did not appear at the other.
#[test]
fn a_probe_sees_what_lies_beyond_a_side_at_the_other() {
    let probe = |name: &str, from: f64, to: f64| {
        format!("{{name=\"{name}\",box={{lower=[{from:?},0.0],upper=[{to:?},0.008]}}}}")
    };
    let probes = [probe("all", 0.0, 0.016), probe("left", 0.0, 0.008), probe("right", 0.008, 0.016)];
    let sets = [format!("output.probes=[{}]", probes.join(","))];
    let (_folder, scene) = with_grains(SUSPENSION, &sets, &[(V::new(0.0159, 0.004), 5e-4)]);
    let mut run = Simulation::new(&scene).expect("a valid scene");
    run.refresh().expect("fields");
    let readings = run.readings();
    let reading = |name: &str| readings.iter().find(|(column, _)| column == name).expect("a column").1;
    let solid = |name: &str, area: f64| reading(&format!("probe_{name}_packing_fraction")) * area;
    let [all, left, right] =
        [("all", 2.0), ("left", 1.0), ("right", 1.0)].map(|(name, of)| solid(name, of * 6.4e-5));
    assert!((all / (std::f64::consts::PI * 2.5e-7) - 1.0).abs() < 1e-12, "{all}");
    assert!((left + right - all).abs() < 1e-12 * all && left > 0.3 * all, "{left} and {right} of {all}");
    assert_eq!(
        ["all", "left", "right"].map(|name| reading(&format!("probe_{name}_grains"))),
        [1.0, 0.0, 1.0]
    );
}

#[test]
fn a_run_with_grains_across_the_sides_goes_on_from_its_checkpoint_bit_for_bit() {
    let (folder, scene) = with_grains(SUSPENSION, &[], &suspended(0.0));
    let mut straight = Simulation::new(&scene).expect("a valid scene");
    for _ in 0..10 {
        straight.step().expect("a step");
    }
    let grains = &straight.coupled().grains().unwrap().particles;
    let across = (0..grains.len()).any(|i| {
        let (x, r) = (grains.position[i].x, grains.radius[i]);
        x < r || x > 0.016 - r
    });
    assert!(across, "no grain lies across the sides: the test sees nothing");
    let path = folder.path().join("checkpoint");
    let hash = scene.hash().expect("a hash");
    let stamp = Stamp { scene_hash: hash.clone(), step: straight.steps(), time: straight.time() };
    Checkpoint::write(&path, &stamp, &straight.state().expect("a state"), &None::<Averages>).expect("a file");
    let checkpoint = Checkpoint::read(&path, &hash).expect("a checkpoint");
    let mut again = Simulation::restarted(&scene, &Host::default(), &checkpoint).expect("a restart");
    for step in 0..15 {
        straight.step().expect("a step");
        again.step().expect("a step");
        let [one, other] = [&straight, &again].map(|run| run.coupled());
        assert_eq!(one.grains().unwrap().particles, other.grains().unwrap().particles, "step {step}");
        assert_eq!(one.fluid().unwrap().accepted, other.fluid().unwrap().accepted, "step {step}");
    }
}

/// A channel without grains, driven by a body force.
fn channel(squares: usize) -> String {
    format!(
        r#"
gravity = [0.0, -9.81]
time = {{ step = 1.0, end = 100.0 }}
periodic = {{ x = [0.0, 0.01] }}
[fluid]
density = 800.0
viscosity = 0.04
body_force = [0.02, 0.0]
mesh = {{ rectangle = {{ lower = [0.0, 0.0], upper = [0.01, 0.02], structured = {{ squares = [{squares}, {rows}] }}, sides = {{ left = "a", right = "b", bottom = "walls", top = "walls" }} }} }}
boundaries = [{{ name = "walls", flow = "no-slip" }}]
solver = {{ tolerance = 1e-12 }}
"#,
        rows = 2 * squares
    )
}

/// u = b y (H - y) / (2 nu): exact at the nodes, where gravity only adds rho g to the gradient of the pressure, and of
/// order 2 between them.
#[test]
fn a_channel_driven_by_a_body_force_has_the_exact_parabola() {
    let exact = |y: f64| 0.02 * y * (0.02 - y) / (2.0 * 0.04 / 800.0);
    let mean = 0.02 * 0.02_f64.powi(2) / (12.0 * 0.04 / 800.0);
    let errors = [4, 8, 16].map(|squares| {
        let scene = parsed(Path::new("scene.toml"), &channel(squares), &[]);
        let mut run = Simulation::new(&scene).expect("a valid scene");
        for _ in 0..100 {
            run.step().expect("a step");
        }
        let fluid = run.coupled().fluid().unwrap();
        let (points, fields) = (&fluid.mesh.points, &fluid.accepted);
        let most = exact(0.01);
        for (x, u) in points.iter().zip(&fields.velocity) {
            let error = (u - V::new(exact(x.y), 0.0)).norm() / most;
            assert!(error < 1e-6, "{squares} squares, at {x:?}: {error}");
        }
        let flux = fluid.nodal_volume.iter().zip(&fields.velocity).map(|(v, u)| v * u.x).sum::<f64>();
        // The walls take what the body force gives.
        let force =
            run.readings().into_iter().find(|(name, _)| name == "force_walls_x_N_per_m").expect("a column").1;
        assert!((force / (800.0 * 0.02 * 2e-4) - 1.0).abs() < 1e-8, "{force} N/m");
        1.0 - flux / 2e-4 / mean
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.01, "order {order} of {errors:?}");
    }
}

/// A box that is periodic along both axes, with a grain in each square.
const BOX: &str = r#"
gravity = [0.0, 0.0]
time = { step = 0.05, end = 100.0 }
periodic = { x = [0.0, 0.02], y = [0.0, 0.02] }
materials.glass = { density = 2500.0 }
grains = [{ material = "glass", placement = { csv = { file = "grains.csv" } }, fixed = true }]
[fluid]
density = 1000.0
viscosity = 1e-3
body_force = [0.04, -0.02]
mesh = { rectangle = { lower = [0.0, 0.0], upper = [0.02, 0.02], structured = { squares = [10, 10] }, sides = { left = "a", right = "b", bottom = "c", top = "d" } } }
solver = { tolerance = 1e-12 }
"#;

/// One grain of radius 0.5 mm in each of the squares, so that all nodes have the same voidage.
fn one_in_each_square() -> Vec<(V, f64)> {
    let place = |k: usize| V::new(2e-3 * (0.3 + (k % 10) as f64), 2e-3 * (0.1 + (k / 10) as f64));
    (0..100).map(|k| (place(k), 5e-4)).collect()
}

/// A uniform array that is held: the drag takes the body force, eps rho b = beta u, with the closure at u.
#[test]
fn the_drag_in_a_periodic_box_balances_the_body_force() {
    let (_folder, scene) = with_grains(BOX, &[], &one_in_each_square());
    let mut run = Simulation::new(&scene).expect("a valid scene");
    for _ in 0..400 {
        run.step().expect("a step");
    }
    let coupled = run.coupled();
    let (fluid, both) = (coupled.fluid().unwrap(), coupled.interaction().unwrap());
    let area = std::f64::consts::PI * 25e-8;
    let voidage = 1.0 - area / 4e-6;
    assert!(both.load.voidage.iter().all(|eps| (eps - voidage).abs() < 1e-13), "{:?}", both.load.voidage);
    let force = 0.04_f64.hypot(0.02);
    // rho b (cell - grain) = gamma(u) u, by bisection.
    let drag = |speed: f64| {
        let around = Surroundings { slip: speed, voidage, diameter: 1e-3, density: 1000.0, viscosity: 1e-3 };
        area * Drag::Dallavalle.coefficient(&around, VoidageFunction::Henry) * speed
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if drag(middle) < 1000.0 * force * (4e-6 - area) { low = middle } else { high = middle }
    }
    let expected = V::new(0.04, -0.02) * (low / force);
    for u in &fluid.accepted.velocity {
        assert!((u - expected).norm() < 1e-9 * low, "{u:?} instead of {expected:?}");
    }
}

/// With free grains the momentum of both grows by what the body force gives to the fluid.
#[test]
fn in_a_periodic_box_only_the_body_force_changes_the_momentum() {
    for scheme in ["iterated", "anchored", "henry", "lagged"] {
        let sets = ["grains[0].fixed=false".to_owned(), format!("coupling.scheme=\"{scheme}\"")];
        let (_folder, scene) = with_grains(BOX, &sets, &one_in_each_square());
        let mut run = Simulation::new(&scene).expect("a valid scene");
        let total = |run: &Simulation| {
            let coupled = run.coupled();
            let (fluid, both) = (coupled.fluid().unwrap(), coupled.interaction().unwrap());
            let nodes = both.load.voidage.iter().zip(&fluid.nodal_volume).zip(&fluid.accepted.velocity);
            let of_fluid: V = nodes.map(|((eps, volume), u)| u * (1000.0 * eps * volume)).sum();
            // What grains got and the fluid is still to lose.
            let owed: V = both.carried.iter().flat_map(|carried| &carried.impulse).sum();
            of_fluid + momentum(coupled.grains().unwrap()) - owed
        };
        let given = V::new(0.04, -0.02) * (1000.0 * 0.05 * (4e-4 - 100.0 * std::f64::consts::PI * 25e-8));
        run.refresh().expect("a cut");
        let mut before = total(&run);
        for step in 0..40 {
            run.step().unwrap_or_else(|error| panic!("{scheme}: {error}"));
            let now = total(&run);
            let defect = (now - before - given).norm() / given.norm();
            assert!(defect < 1e-9, "{scheme}, step {step}: {defect}");
            before = now;
        }
    }
}
