//! The cases that show drag laws, sizes of grains, stresses and forces on walls: each against what is known.

use assert_cmd::Command;
use std::fs;
use std::path::{Path, PathBuf};
use voidage_coupling::closure::{Drag, Surroundings, VoidageFunction};
use voidage_dem::packing::{self, Amount, By, Fill, Radii, SizeLaw};
use voidage_dem::{Dem, Load, Material, Pair, Particles, Settings, Side, Vector, Wall};
use voidage_scene::{Scene, Simulation};

fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

fn scene(name: &str, sets: &[&str]) -> Scene {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scene::read(&case(name), &sets).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn voidage() -> Command {
    Command::new(env!("CARGO_BIN_EXE_voidage"))
}

#[test]
fn the_drawn_drag_laws_are_those_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    voidage().arg("closures").arg("--out").arg(folder.path()).assert().success();
    let written = fs::read_to_string(folder.path().join("closures.csv")).unwrap();
    let kept = fs::read_to_string(case("drag-laws/closures.csv")).unwrap();
    assert!(written == kept, "cases/drag-laws is old: voidage closures --out cases/drag-laws");
    assert_eq!(written.lines().count(), 1 + Drag::ALL.len() * 300);
    let picture = fs::read(folder.path().join("closures.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 50_000);
}

/// A column of the series that a scene asks for, as of now.
fn written(scene: &Scene, simulation: &Simulation, column: &str) -> f64 {
    let (view, more) = (simulation.view(), simulation.readings());
    let readings = voidage_scene::recorder::readings(&scene.output, simulation.time(), &view, &more);
    readings.iter().find(|(name, _)| name == column).unwrap().1
}

#[test]
fn an_even_bed_has_the_pressure_drop_of_every_drag_law() {
    let mut drops = Vec::new();
    for law in Drag::ALL {
        let mut scene = scene("drag-laws/scene.toml", &[]);
        scene.coupling.as_mut().unwrap().drag = law;
        let mut simulation = Simulation::new(&scene).unwrap();
        for _ in 0..10 {
            simulation.step().unwrap();
        }
        let drop = written(&scene, &simulation, "pressure_drop_Pa");
        let phi = 0.7 * std::f64::consts::FRAC_PI_4 / (1.01 * 1.01);
        let slip = 0.5 / (1.0 - phi);
        let around =
            Surroundings { slip, voidage: 1.0 - phi, diameter: 1e-3, density: 1.204, viscosity: 2e-5 };
        let drag = law.coefficient(&around, VoidageFunction::default());
        let exact = phi / (1.0 - phi) * drag * slip * 16.16e-3;
        assert!((drop / exact - 1.0).abs() < 4e-3, "{law:?}: {drop} Pa, and {exact} Pa by the law");
        drops.push(drop);
    }
    let distinct =
        |k: usize| drops.iter().all(|other| *other == drops[k] || (other / drops[k] - 1.0).abs() > 5e-3);
    assert!((0..drops.len()).all(distinct), "the scene tells the laws apart: {drops:?}");
}

#[test]
fn a_force_drives_a_fluid_through_a_periodic_bed_at_the_velocity_of_every_drag_law() {
    for law in Drag::ALL {
        let mut scene = scene("drag-laws/scene-periodic.toml", &[]);
        scene.coupling.as_mut().unwrap().drag = law;
        let mut simulation = Simulation::new(&scene).unwrap();
        for _ in 0..50 {
            simulation.step().unwrap();
        }
        let velocity = written(&scene, &simulation, "probe_all_velocity_y_m_per_s");
        // The fluid in a cubic metre is pushed by eps rho b, and held by the drag.
        let phi = 0.7 * std::f64::consts::FRAC_PI_4 / (1.01 * 1.01);
        let around = Surroundings {
            slip: velocity,
            voidage: 1.0 - phi,
            diameter: 1e-3,
            density: 1.204,
            viscosity: 2e-5,
        };
        let drag = phi * law.coefficient(&around, VoidageFunction::default()) * velocity;
        let push = (1.0 - phi) * 1.204 * 6000.0;
        assert!((drag / push - 1.0).abs() < 1e-6, "{law:?}: {drag} against {push} N/m3 at {velocity} m/s");
    }
}

// ------------------------------------------------------------------------------------------------ sizes

/// Radii that a law draws.
fn drawn(law: &SizeLaw, by: By, bounds: [f64; 2]) -> Vec<f64> {
    let materials = [Material::default()];
    let radii = Radii::by_law::<2>(law, by, bounds).unwrap();
    let fill = Fill { radii, amount: Amount::Count(200_000), material: 0, materials: &materials, seed: 7 };
    match packing::mixed::<2>(&[fill], 1).unwrap() {
        Radii::Mixed(grains) => grains.iter().map(|grain| grain.0).collect(),
        other => panic!("{other:?}"),
    }
}

/// Largest distance between the shares below a radius, of number or of mass, and a law; and the distance that chance
/// exceeds once in a hundred samples, 1.63 over the root of the number of grains that count.
fn kolmogorov(radii: &[f64], by: By, law: impl Fn(f64) -> f64) -> [f64; 2] {
    let mut sorted = radii.to_vec();
    sorted.sort_by(f64::total_cmp);
    let weight = |r: f64| if by == By::Mass { r * r } else { 1.0 };
    let sum: f64 = sorted.iter().map(|r| weight(*r)).sum();
    let squares: f64 = sorted.iter().map(|r| weight(*r).powi(2)).sum();
    let (mut below, mut worst) = (0.0, 0.0f64);
    for r in &sorted {
        let exact = law(*r);
        worst = worst.max((below / sum - exact).abs());
        below += weight(*r);
        worst = worst.max((below / sum - exact).abs());
    }
    [worst, 1.63 / (sum * sum / squares).sqrt()]
}

/// Share of a normal distribution below x, by the series of its integral.
fn normal(x: f64) -> f64 {
    let (mut term, mut sum, mut k) = (x, x, 0.0);
    while term.abs() > 1e-17 * sum.abs() {
        k += 1.0;
        term *= x * x / (2.0 * k + 1.0);
        sum += term;
    }
    0.5 + sum * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
}

/// A law cut at both ends.
fn cut(law: impl Fn(f64) -> f64, [min, max]: [f64; 2]) -> impl Fn(f64) -> f64 {
    move |r| (law(r) - law(min)) / (law(max) - law(min))
}

#[test]
fn log_normal_radii_have_the_law_and_the_moments_by_number_and_by_mass() {
    let (median, deviation, bounds) = (5e-4f64, 0.3, [1e-4, 3e-3]);
    let law = SizeLaw::LogNormal { median, deviation };
    let exact = |median: f64| cut(move |r: f64| normal((r / median).ln() / deviation), bounds);
    for by in [By::Number, By::Mass] {
        let radii = drawn(&law, by, bounds);
        let [distance, chance] = kolmogorov(&radii, by, exact(median));
        assert!(distance < chance, "{by:?}: {distance} against {chance}");
        // By mass, the number has the same law with the median times exp(-2 deviation^2) (Hatch and Choate, 1929).
        let shifted = if by == By::Mass { median * (-2.0 * deviation * deviation).exp() } else { median };
        let [distance, chance] = kolmogorov(&radii, By::Number, exact(shifted));
        assert!(distance < chance, "{by:?}, by number: {distance} against {chance}");
        for power in [1.0, 2.0, 3.0] {
            let mean = radii.iter().map(|r| r.powf(power)).sum::<f64>() / radii.len() as f64;
            let known = shifted.powf(power) * (0.5 * (power * deviation).powi(2)).exp();
            assert!((mean / known - 1.0).abs() < 0.01, "{by:?}, moment {power}: {mean} and {known}");
        }
        // The measure fails for the other law.
        let other = if by == By::Mass { By::Number } else { By::Mass };
        let [distance, chance] = kolmogorov(&radii, other, exact(median));
        assert!(distance > 10.0 * chance, "{distance}");
    }
}

#[test]
fn rosin_rammler_radii_have_the_law_by_number_and_by_mass() {
    let (scale, spread, bounds) = (6e-4f64, 2.5, [1e-4, 2e-3]);
    let exact = cut(move |r: f64| 1.0 - (-(r / scale).powf(spread)).exp(), bounds);
    for (by, other) in [(By::Number, By::Mass), (By::Mass, By::Number)] {
        let radii = drawn(&SizeLaw::RosinRammler { scale, spread }, by, bounds);
        let [distance, chance] = kolmogorov(&radii, by, &exact);
        assert!(distance < chance, "{by:?}: {distance} against {chance}");
        let [distance, chance] = kolmogorov(&radii, other, &exact);
        assert!(distance > 10.0 * chance, "{distance}");
    }
}

#[test]
fn sieved_radii_have_the_shares_of_the_table_by_number_and_by_mass() {
    let table = vec![(1e-4, 0.0), (2e-4, 0.1), (4e-4, 0.7), (5e-4, 0.7), (1e-3, 1.0)];
    let exact = |r: f64| {
        let k = table.partition_point(|row| row.0 <= r).clamp(1, table.len() - 1);
        let (below, above) = (table[k - 1], table[k]);
        below.1 + (above.1 - below.1) * (r - below.0) / (above.0 - below.0)
    };
    for (by, other) in [(By::Number, By::Mass), (By::Mass, By::Number)] {
        let radii = drawn(&SizeLaw::Sieve(table.clone()), by, [1e-4, 1e-3]);
        let [distance, chance] = kolmogorov(&radii, by, exact);
        assert!(distance < chance, "{by:?}: {distance} against {chance}");
        let [distance, chance] = kolmogorov(&radii, other, exact);
        assert!(distance > 10.0 * chance, "{distance}");
        assert!(!radii.iter().any(|r| (4.001e-4..4.999e-4).contains(r)), "an empty class stays empty");
    }
}

#[test]
fn a_poured_mixture_has_the_mass_of_each_group_and_is_mixed() {
    let mut scene = scene("mixed-bed/scene.toml", &[]);
    for method in [voidage_scene::Method::DropAndRoll, voidage_scene::Method::Dense] {
        let voidage_scene::Placement::Deposit(deposit) = &mut scene.grains[0].placement else { panic!() };
        (deposit.settle, deposit.method) = (false, method);
        let simulation = Simulation::new(&scene).unwrap();
        let grains = &simulation.coupled().grains().unwrap().particles;
        let (mut mass, mut height, mut count) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for i in 0..grains.len() {
            let group = grains.material[i] as usize;
            mass[group] += grains.mass[i];
            height[group] += grains.mass[i] * grains.position[i].y;
            count[group] += 1.0;
            let density = grains.mass[i] / (std::f64::consts::PI * grains.radius[i].powi(2));
            assert!((density / [2500.0, 7800.0][group] - 1.0).abs() < 1e-12, "{density}");
            let heat = grains.heat.as_ref().unwrap();
            assert_eq!(heat.temperature[i], [300.0, 400.0][group]);
        }
        for group in 0..2 {
            let voidage_scene::Amount::Mass(asked) = scene.grains[group].amount else { panic!() };
            assert!((mass[group] / asked - 1.0).abs() < 0.02, "{group}: {} of {asked} kg/m", mass[group]);
        }
        let mean = [height[0] / mass[0], height[1] / mass[1]];
        assert!((mean[0] / mean[1] - 1.0).abs() < 0.1, "{method:?}: one lies above the other: {mean:?}");
    }
}

/// How far a disc of a material slides on a wall, of another one.
fn slid(pairs: Vec<Pair>, material: u8) -> f64 {
    let materials = vec![Material { friction: 0.5, ..Material::default() }; 2];
    let floor = Wall::<2> {
        friction: 0.5,
        ..Wall::new("floor", Vector::<2>::new(-1.0, 0.0), Vector::<2>::new(9.0, 0.0))
    };
    let mut grains =
        Particles::<2>::new(vec![Vector::<2>::new(0.0, 0.01)], vec![0.01], vec![material], &materials)
            .unwrap();
    grains.velocity[0].x = 1.0;
    let mut dem =
        Dem::new(grains, vec![floor], materials, Settings { pairs, ..Settings::default() }).unwrap();
    for _ in 0..1000 {
        dem.step(1e-3, &Load::default());
    }
    dem.particles.position[0].x
}

#[test]
fn pairs_of_materials_have_their_own_friction() {
    // Without spin a disc that slides stops after v^2 / (2 mu g).
    let way = |mu: f64| 1.0 / (2.0 * mu * 9.81);
    let pair =
        |other: Side| Pair { material: 1, other, friction: Some(0.2), restitution: None, rolling: None };
    for (pairs, material, mu) in [
        (vec![], 1, 0.5),
        (vec![pair(Side::Wall(0))], 1, 0.2),
        (vec![pair(Side::Wall(0))], 0, 0.5),
        (vec![pair(Side::Material(0))], 1, 0.5),
    ] {
        let x = slid(pairs.clone(), material);
        assert!((x / way(mu) - 1.0).abs() < 0.02, "{pairs:?}, material {material}: {x} m, not {} m", way(mu));
    }
    let unknown = Settings { pairs: vec![pair(Side::Wall(3))], ..Settings::default() };
    assert!(Dem::<2>::new(Particles::default(), vec![], vec![Material::default(); 2], unknown).is_err());
}

#[test]
fn two_discs_meet_with_the_friction_of_their_pair() {
    // A disc on one that is held, both without spin: it slides off unless friction holds it, tan(angle) < mu.
    for (pair, held) in [(0.1, false), (0.9, true)] {
        let materials = vec![Material { friction: 0.4, ..Material::default() }; 2];
        let angle: f64 = 0.5;
        let place = Vector::<2>::new(angle.sin(), angle.cos()) * 0.02;
        let positions = vec![Vector::<2>::zeros(), place];
        let mut grains = Particles::<2>::new(positions, vec![0.01; 2], vec![0, 1], &materials).unwrap();
        grains.mass[0] = f64::INFINITY;
        let pairs = vec![Pair {
            material: 0,
            other: Side::Material(1),
            friction: Some(pair),
            restitution: None,
            rolling: None,
        }];
        let mut dem = Dem::new(grains, vec![], materials, Settings { pairs, ..Settings::default() }).unwrap();
        for _ in 0..100 {
            dem.step(1e-3, &Load::default());
        }
        let moved = (dem.particles.position[1] - place).norm();
        assert_eq!(moved < 1e-6, held, "friction {pair}: it moved by {moved} m");
    }
}

#[test]
fn laws_of_sizes_mixtures_and_pairs_that_mean_nothing_are_refused() {
    let file = case("mixed-bed/scene.toml");
    let refused = |set: &str, words: &[&str]| {
        let error =
            Scene::read(&file, &[set.to_owned()]).err().unwrap_or_else(|| panic!("{set} is accepted"));
        let text = format!("{error:?}");
        assert!(error.is_input() && words.iter().all(|word| text.contains(word)), "{set}: {text}");
    };
    refused("grains[0].radius.log-normal.by=\"weight\"", &["mass"]);
    refused("grains[0].radius.log-normal.deviation=0.0", &["deviation", "above 0"]);
    refused("grains[0].radius.log-normal.largest=1.0", &["largest", "100 times"]);
    refused("grains[0].radius.log-normal.median=1.0", &["no grains of this law"]);
    refused("grains[1].radius.sieve.passing=[[1e-3, 0.0], [2e-3, 0.9]]", &["passing", "from 0 to 1"]);
    refused("grains[1].radius.sieve.passing=[[2e-3, 0.0], [1e-3, 1.0]]", &["comes after"]);
    refused("grains[1].placement={ with = 1 }", &["no earlier group that is poured", "[0]"]);
    refused("grains[1].amount=\"fill\"", &["part of a mixture"]);
    refused("contacts.pairs[0].materials=[\"glass\", \"wood\"]", &["wood", "no material"]);
    refused("contacts.pairs[0].friction=-0.1", &["below 0"]);
}

// ----------------------------------------------------------------------------------------------- stress

const G: f64 = 9.81;

/// A column of the readings of a simulation.
fn reading(simulation: &Simulation, name: &str) -> f64 {
    let readings = simulation.readings();
    readings.iter().find(|(column, _)| column == name).unwrap_or_else(|| panic!("no column {name}")).1
}

#[test]
fn a_stack_at_rest_has_the_stress_of_the_weight_above() {
    let (count, radius) = (12, 0.01);
    let materials = vec![Material { friction: 0.3, ..Material::default() }];
    let positions = (0..count).map(|k| Vector::<2>::new(0.0, radius * (2 * k + 1) as f64)).collect();
    let grains = Particles::<2>::new(positions, vec![radius; count], vec![0; count], &materials).unwrap();
    let weight = grains.mass[0] * G;
    let floor = Wall::<2>::new("floor", Vector::<2>::new(-1.0, 0.0), Vector::<2>::new(1.0, 0.0));
    let settings = Settings { tolerance: 1e-8, ..Settings::default() };
    let mut dem = Dem::new(grains, vec![floor], materials, settings).unwrap();
    for _ in 0..50 {
        assert!(dem.step(1e-3, &Load::default()).converged);
    }
    let stress = dem.stress();
    let mut sum = 0.0;
    for k in 0..count {
        let above = (count - 1 - k) as f64 * weight;
        // Half of the disc carries what is above, the other half itself too.
        let exact = -radius * (2.0 * above + weight);
        let found = stress.moment[k];
        assert!((found[(1, 1)] / exact - 1.0).abs() < 1e-4, "grain {k}: {} and {exact}", found[(1, 1)]);
        assert!(found[(0, 0)].abs() + found[(0, 1)].abs() + found[(1, 0)].abs() < 1e-6 * exact.abs());
        assert_eq!(stress.coordination[k], if k + 1 == count { 1 } else { 2 });
        sum += found[(1, 1)];
    }
    // All together: the moment of the weights about the floor.
    let exact: f64 = dem.particles.position.iter().map(|x| -weight * x.y).sum();
    assert!((sum / exact - 1.0).abs() < 1e-5, "{sum} and {exact}");
    assert!((stress.fabric[(1, 1)] - 1.0).abs() < 1e-12 && stress.fabric[(0, 0)] < 1e-12);
}

#[test]
fn a_bed_at_rest_has_the_mean_stress_of_its_weight_and_no_torque() {
    let scene = scene("force-chains/scene.toml", &[]);
    let mut simulation = Simulation::new(&scene).unwrap();
    // The bed gives way a little at first.
    for _ in 0..500 {
        simulation.step().unwrap();
    }
    simulation.refresh().unwrap();
    let grains = simulation.coupled().grains().unwrap();
    let particles = &grains.particles;
    let area: f64 = particles.radius.iter().map(|r| std::f64::consts::PI * r * r).sum();
    let moment: f64 = particles.mass.iter().zip(&particles.position).map(|(m, x)| m * G * x.y).sum();
    let vertical = reading(&simulation, "grain_stress_yy_Pa");
    assert!((vertical / (-moment / area) - 1.0).abs() < 2e-3, "{vertical} and {} Pa", -moment / area);
    let shear = [reading(&simulation, "grain_stress_xy_Pa"), reading(&simulation, "grain_stress_yx_Pa")];
    assert!((shear[0] - shear[1]).abs() < 2e-3 * vertical.abs(), "it is symmetric at rest: {shear:?}");
    let horizontal = reading(&simulation, "grain_stress_xx_Pa");
    assert!(horizontal < 0.3 * vertical && horizontal > 1.5 * vertical, "{horizontal} and {vertical}");
    let fabric = ["xx", "yy"].map(|part| reading(&simulation, &format!("fabric_{part}")));
    assert!((fabric[0] + fabric[1] - 1.0).abs() < 1e-12, "{fabric:?}");
    let coordination = reading(&simulation, "coordination_number");
    assert!((2.5..4.5).contains(&coordination), "{coordination}");
    // Every grain, too, is in balance of moments.
    let stress = grains.stress();
    let scale = stress.moment.iter().map(|m| m.norm()).sum::<f64>() / particles.len() as f64;
    let twist = stress.moment.iter().map(|m| (m[(0, 1)] - m[(1, 0)]).abs()).fold(0.0, f64::max);
    assert!(twist < 0.05 * scale, "{twist} of {scale}");
    // At rest the floor carries the weight, and nothing else does.
    let weight: f64 = particles.mass.iter().map(|m| m * G).sum();
    let floor = reading(&simulation, "wall_force_floor_y_N_per_m");
    assert!((floor / -weight - 1.0).abs() < 2e-3, "{floor} and {weight} N/m");
}

#[test]
fn the_stress_at_the_nodes_is_that_of_the_grains() {
    let sets = ["time.end=5e-3", "output.stress=true", "output.contacts=true"];
    let scene = scene("bubbling-bed/scene-quick.toml", &sets);
    let mut simulation = Simulation::new(&scene).unwrap();
    for _ in 0..5 {
        simulation.step().unwrap();
    }
    simulation.refresh().unwrap();
    let stress = simulation.view().network.unwrap().stress.as_ref().unwrap();
    let fluid = simulation.coupled().fluid().unwrap();
    let radius = &simulation.coupled().grains().unwrap().particles.radius;
    for (nodes, grains) in stress.at_nodes.iter().zip(&stress.of_grains) {
        let over_mesh: f64 = nodes.iter().zip(&fluid.nodal_volume).map(|(s, v)| s * v).sum();
        let over_grains: f64 = grains.iter().zip(radius).map(|(s, r)| s * std::f64::consts::PI * r * r).sum();
        let size: f64 = grains.iter().zip(radius).map(|(s, r)| (s * r * r).abs()).sum();
        assert!(
            size > 0.0 && (over_mesh - over_grains).abs() < 1e-12 * size,
            "{over_mesh} and {over_grains}"
        );
    }
}

#[test]
fn what_is_not_asked_for_is_not_built() {
    let scene = scene("hopper/scene.toml", &[]);
    let mut simulation = Simulation::new(&scene).unwrap();
    simulation.step().unwrap();
    simulation.refresh().unwrap();
    assert!(simulation.view().network.is_none());
    assert!(simulation.coupled().grains().unwrap().settings().pairs.is_empty());
    let readings = simulation.readings();
    assert!(readings.iter().all(|(name, _)| !name.contains("stress") && !name.contains("fabric")));
}

#[test]
fn a_run_records_contacts_and_draws_force_chains() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut command = voidage();
    command.arg("run").arg(case("force-chains/scene.toml")).arg("--out").arg(&out);
    command.args(["--quiet", "--threads", "1", "--set", "time.end=0.02"]).assert().success();
    let frames = voidage_scene::recorder::read_collection(&out.join("contacts.pvd")).unwrap();
    assert_eq!(frames.len(), 2);
    let frame = voidage_scene::recorder::read_frame(&frames[1].1).unwrap();
    let force = frame.column("normal_force_N_per_m").unwrap();
    assert!(force.len() > 2000 && force.len() == frame.points.len() && frame.cells.len() == force.len());
    // Contacts last as long as the bed rests; what is known at time 0 begins there.
    let age = frame.column("age_s").unwrap();
    let lasting = age.iter().filter(|age| (**age - 0.02).abs() < 1e-9).count();
    assert!(lasting * 10 > age.len() * 9, "{lasting} of {}", age.len());
    for column in ["tangential_force_N_per_m", "gap_m", "heat_W_per_m"] {
        assert!(frame.column(column).unwrap().iter().all(|value| value.is_finite()), "{column}");
    }
    let grains = voidage_scene::recorder::read_collection(&out.join("grains.pvd")).unwrap();
    let grains = voidage_scene::recorder::read_frame(&grains[1].1).unwrap();
    assert!(grains.column("stress_yy_Pa").unwrap().iter().sum::<f64>() < 0.0);
    let picture = fs::read(out.join("chains-0.020s.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 20_000);
}

// ------------------------------------------------------------------------------------------------ walls

/// Takes a step of 1 ms, and returns what the change of the momentum of the grains differs by from what walls and
/// gravity give, over the impulse of gravity.
fn momentum_defect(simulation: &mut Simulation) -> f64 {
    let momentum = |simulation: &Simulation| -> Vector<2> {
        let particles = &simulation.coupled().grains().unwrap().particles;
        particles.mass.iter().zip(&particles.velocity).map(|(m, v)| v * *m).sum()
    };
    let before = momentum(simulation);
    simulation.step().unwrap();
    let grains = simulation.coupled().grains().unwrap();
    let mass: f64 = grains.particles.mass.iter().sum();
    let walls: Vector<2> = grains.wall_force().iter().sum();
    let force = Vector::<2>::new(0.0, -G * mass) - walls;
    (momentum(simulation) - before - force * 1e-3).norm() / (G * mass * 1e-3)
}

/// What rests is balanced up to a share that goes with the root of the tolerance.
#[test]
fn what_walls_give_is_the_change_of_the_momentum_of_the_grains() {
    let precise = scene("stirred-bed/scene.toml", &["contacts.tolerance=1e-22", "contacts.max_sweeps=50"]);
    let mut simulation = Simulation::new(&precise).unwrap();
    for _ in 0..100 {
        let defect = momentum_defect(&mut simulation);
        assert!(defect < 2e-12, "step {}: {defect}", simulation.steps());
    }
    let scene = scene("stirred-bed/scene.toml", &[]);
    let mut simulation = Simulation::new(&scene).unwrap();
    let (mut turned, mut given) = (0.0, 0.0f64);
    for _ in 0..900 {
        let defect = momentum_defect(&mut simulation);
        assert!(defect < 1e-3, "step {}: {defect}", simulation.steps());
        let torque = reading(&simulation, "wall_torque_bar_N");
        if simulation.steps() <= 500 {
            given = given.max(torque.abs());
        } else {
            turned += torque / 400.0;
        }
    }
    // The bed resists the bar that turns anticlockwise, more than it turns the bar at rest.
    assert!(turned < -2.0 * given, "{turned} N turning, {given} N at rest");
    assert!(simulation.readings().iter().all(|(name, _)| !name.contains("torque_floor")));
}

/// Angular momentum of the grains about the axis of the drum, N m s per metre, and the moment of their weights, N.
fn turning(simulation: &Simulation) -> (f64, f64) {
    let particles = &simulation.coupled().grains().unwrap().particles;
    let rotation = particles.rotation.as_ref().unwrap();
    let of = |i: usize| {
        let (x, v, m) = (particles.position[i], particles.velocity[i], particles.mass[i]);
        (m * (x.x * v.y - x.y * v.x) + rotation.inertia[i] * rotation.spin[i], -m * G * x.x)
    };
    (0..particles.len()).map(of).fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1))
}

#[test]
fn the_torque_on_a_drum_is_what_turns_its_grains_and_carries_them_aside() {
    let small = ["grains[0].amount.count=100", "grains[1].amount.count=400"];
    let mut simulation = Simulation::new(&scene("drum/scene.toml", &small)).unwrap();
    let (mut given, mut most) = (0.0, 0.0f64);
    let before = turning(&simulation).0;
    for _ in 0..600 {
        simulation.step().unwrap();
        // The moment over a step is that of the places at its end.
        let moment = turning(&simulation).1 - reading(&simulation, "wall_torque_drum_N");
        given += 1e-3 * moment;
        most += 1e-3 * turning(&simulation).1.abs();
    }
    let turned = turning(&simulation).0 - before;
    assert!((turned - given).abs() < 1e-2 * most, "{turned} against {given}, of {most}");
    assert!(most > 0.1, "{most}");
    let columns = simulation.readings();
    let drum = columns.iter().filter(|(name, _)| name.starts_with("wall_")).count();
    assert_eq!(drum, 3, "a drum is one body");
}

/// Highest grain of a heap over the width of what lies, and the mass that the source gave less what is there and what
/// the sink took, over that of the source.
fn heap(rolling: f64) -> (f64, f64) {
    let rolling = format!("materials.glass.rolling={rolling}");
    let small = [
        rolling.as_str(),
        "walls[0].from=[-0.02,0.0]",
        "walls[0].to=[0.02,0.0]",
        "grains[0].amount.count=200",
        "grains[0].placement.source.lower=[-0.005,0.03]",
        "grains[0].placement.source.upper=[0.005,0.036]",
    ];
    let mut simulation = Simulation::new(&scene("heap/scene.toml", &small)).unwrap();
    for _ in 0..1500 {
        simulation.step().unwrap();
    }
    let particles = &simulation.coupled().grains().unwrap().particles;
    let top = particles.position.iter().map(|x| x.y).fold(0.0, f64::max);
    let mass: f64 = particles.mass.iter().sum();
    let given = reading(&simulation, "source_feed_mass_kg_per_m");
    let taken = reading(&simulation, "sink_edge_mass_kg_per_m");
    (top / 0.02, (given - mass - taken) / given)
}

#[test]
fn resistance_to_rolling_makes_a_heap_steeper() {
    let (smooth, rough) = (heap(0.0), heap(0.3));
    assert!(rough.0 > smooth.0 + 0.2, "height over half of the width: {} and {}", smooth.0, rough.0);
    assert!(smooth.1.abs() < 1e-12 && rough.1.abs() < 1e-12, "{} {}", smooth.1, rough.1);
}

#[test]
fn the_torque_on_a_wall_is_the_moment_of_its_forces() {
    // A disc lies on a lever, held from turning away by a second wall: the moment is weight times arm.
    let materials = vec![Material::default()];
    let (radius, arm) = (0.01, 0.07);
    let grains =
        Particles::<2>::new(vec![Vector::<2>::new(arm, radius)], vec![radius], vec![0], &materials).unwrap();
    let weight = grains.mass[0] * G;
    let lever = Wall::new("lever", Vector::<2>::zeros(), Vector::<2>::new(0.1, 0.0));
    let motion = voidage_dem::Motion::Table { centre: Vector::zeros(), rows: vec![[0.0; 4]] };
    let mut dem = Dem::new(grains, vec![Wall { motion, ..lever }], materials, Settings::default()).unwrap();
    for _ in 0..20 {
        dem.step(1e-3, &Load::default());
    }
    assert!((dem.wall_torque()[0] / (-weight * arm) - 1.0).abs() < 1e-9, "{:?}", dem.wall_torque());
}

#[test]
fn motions_are_read_from_files_and_bad_ones_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(case("stirred-bed/scene.toml")).unwrap();
    let rows = text.find("motion.table.rows").unwrap();
    let end = text.find("[output]").unwrap();
    let with = |what: &str| format!("{}{what}\n\n{}", &text[..rows], &text[end..]);
    let read = |what: &str, table: &str| {
        fs::write(folder.path().join("way.csv"), table).unwrap();
        let file = folder.path().join("scene.toml");
        fs::write(&file, with(what)).unwrap();
        Scene::read(&file, &[]).map_err(|error| format!("{error:?}"))
    };
    let from_file = "motion.table.file = \"way.csv\"";
    let scene = read(from_file, "t,x,y,angle\n0.5,0,0,0\n2.5,0.0,0.0,6.5\n").unwrap();
    let Some(voidage_scene::Motion::Table(table)) = &scene.walls[3].motion else { panic!() };
    assert_eq!(table.rows, [[0.5, 0.0, 0.0, 0.0], [2.5, 0.0, 0.0, 6.5]]);
    assert!(table.file.is_none(), "the resolved scene has the rows");
    for (what, file, words) in [
        (from_file, "t,x,y\n0,0,0\n", ["line 1", "t,x,y,angle"]),
        (from_file, "t,x,y,angle\n0,0,0,up\n", ["line 2", "four numbers"]),
        (from_file, "t,x,y,angle\n1,0,0,0\n1,0,0,1\n", ["comes after", "increase"]),
        (from_file, "t,x,y,angle\n", ["no rows", "rows"]),
        ("motion.table.file = \"none.csv\"", "", ["none.csv", "No such file"]),
        ("motion.table.rows = [[1.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0]]", "", ["comes after", "increase"]),
    ] {
        let said = read(what, file).err().unwrap_or_else(|| panic!("{what} {file:?} is accepted"));
        assert!(words.iter().all(|word| said.contains(word)), "{what} {file:?}: {said}");
    }
}

/// Hollow and with its added mass: (rho_p + rho_f/2) dv/dt = (rho_f - rho_p) g - drag, by a Runge-Kutta method of order
/// four.
#[test]
fn a_light_sphere_rises_with_its_added_mass() {
    let mut run = Simulation::new(&scene("settling-grain/scene-light.toml", &[])).unwrap();
    for (time, exact) in [(0.005, 0.0688485), (0.01, 0.1214991), (0.05, 0.2029291)] {
        while run.time() < time - 1e-9 {
            run.step().unwrap();
        }
        let speed = run.view().grains.unwrap().velocity[0].y;
        assert!((speed / exact - 1.0).abs() < 1e-3, "{speed} m/s at {time} s");
    }
}

/// Grains that lag behind the liquid go to where it is faster, grains that lead to where it is slower.
#[test]
fn lift_takes_heavy_grains_to_the_middle_of_a_rise_and_to_the_walls_of_a_fall() {
    let aside = |sets: &[&str], lift: bool| {
        let mut scene = scene("lift/scene.toml", sets);
        if !lift {
            scene.coupling.as_mut().unwrap().lift = None;
        }
        let mut run = Simulation::new(&scene).unwrap();
        for _ in 0..400 {
            run.step().unwrap();
        }
        let places = &run.view().grains.unwrap().position;
        places.iter().map(|x| (x.x - 0.005).abs()).sum::<f64>() / places.len() as f64
    };
    let down = ["fluid.body_force=[0.0,3.11]"];
    assert!(aside(&[], true) < 2e-4);
    assert!(aside(&down, true) > 4e-3);
    for sets in [&[][..], &down[..]] {
        assert!((aside(sets, false) - 2.49e-3).abs() < 1e-4);
    }
}
