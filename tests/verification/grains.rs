//! The grains: the quick forms of `voidage verify`, and behaviour that is no number of theirs. The value expected is
//! derived or cited at each test.

mod heat;
mod identity;
mod known;
mod rest;
mod rolling;

use approx::assert_relative_eq;
use voidage_dem::{Dem, Halo, Load, Material, Motion, Particles, Period, Settings, Vector, Wall};
use voidage_tests::verify_quickly;

type V = Vector<2>;
const G: f64 = 9.81;

fn v(x: f64, y: f64) -> V {
    V::new(x, y)
}

fn rubbing(friction: f64) -> Material {
    Material { friction, ..Material::default() }
}

fn floor(friction: f64) -> Wall<2> {
    Wall { friction, ..Wall::new("floor", v(-100.0, 0.0), v(100.0, 0.0)) }
}

/// Discs at the given places, all of one radius and one material.
fn discs(position: Vec<V>, radius: f64, material: &Material) -> Particles<2> {
    let n = position.len();
    Particles::new(position, vec![radius; n], vec![0; n], std::slice::from_ref(material)).unwrap()
}

fn precise() -> Settings<2> {
    Settings { tolerance: 1e-24, max_sweeps: 100_000, ..Settings::default() }
}

fn stack(n: usize, settings: Settings<2>) -> Dem<2> {
    let material = Material::default();
    let x = (0..n).map(|k| v(0.0, 0.5 + k as f64)).collect();
    Dem::new(discs(x, 0.5, &material), vec![floor(0.0)], vec![material], settings).unwrap()
}

#[test]
fn the_grains_of_the_suite() {
    verify_quickly("grains");
}

#[test]
fn warm_starts_need_no_sweeps_at_rest() {
    let mut dem = stack(50, precise());
    dem.step(1e-3, &Load::default());
    let settled = Settings { tolerance: 1e-8, ..precise() };
    let mut warm =
        Dem::new(dem.particles.clone(), dem.walls().to_vec(), dem.materials().to_vec(), settled).unwrap();
    warm.restore(dem.state()).unwrap();
    let report = warm.step(0.5e-3, &Load::default());
    assert_eq!((report.sweeps, report.converged), (0, true));
}

/// Sub-steps were not enough to hold the free fall of such a step down, so that the search made everyone a contact of
/// everyone else; a bed of 126 grains then did not converge, and a grain flew out of its box.
#[test]
fn grains_at_rest_look_at_their_neighbours_only_in_any_step() {
    let mut dem = stack(8, precise());
    let drag: Vec<f64> = dem.particles.mass.iter().map(|m| 100.0 * m).collect();
    for _ in 0..3 {
        let report = dem.step(1e6, &Load { drag: &drag, ..Load::default() });
        assert_eq!((report.candidates, report.converged), (8, true));
        assert!(report.max_penetration_over_radius < 1e-2);
    }
}

/// Momentum and, with restitution e, the relative velocity of an oblique impact follow Newton's law exactly:
/// v_n' = -e v_n along the normal where the two touch, the centre of mass undisturbed.
#[test]
fn impacts_follow_newton() {
    for e in [0.0, 0.3, 1.0] {
        let material = Material { restitution: e, ..Material::default() };
        let mut grains = discs(vec![v(0.0, 0.0), v(1.02, 0.3)], 0.5, &material);
        grains.radius[1] = 0.55;
        grains.mass[1] *= 3.0;
        grains.velocity = vec![v(2.0, 0.1), v(-1.0, 0.0)];
        let momentum = grains.velocity[0] * grains.mass[0] + grains.velocity[1] * grains.mass[1];
        let (arm, way) = (grains.position[1] - grains.position[0], grains.velocity[1] - grains.velocity[0]);
        // (arm + way t)^2 = 1.05^2.
        let (a, b, c) = (way.norm_squared(), arm.dot(&way), arm.norm_squared() - 1.05 * 1.05);
        let n = (arm + way * ((-b - (b * b - a * c).sqrt()) / a)).normalize();
        let before = way.dot(&n);
        let settings = Settings { gravity: V::zeros(), ..precise() };
        let mut dem = Dem::new(grains, vec![], vec![material], settings).unwrap();
        dem.step(0.02, &Load::default());
        dem.step(0.02, &Load::default());
        let p = &dem.particles;
        let after = (p.velocity[1] - p.velocity[0]).dot(&n);
        // Without bounce the first step closes the gap exactly and the second one stops it.
        assert_relative_eq!(after, -e * before, epsilon = if e == 0.0 { 0.02 } else { 1e-12 });
        let now = p.velocity[0] * p.mass[0] + p.velocity[1] * p.mass[1];
        assert_relative_eq!(now, momentum, max_relative = 1e-14);
    }
}

/// Gaps close exactly: a grain that falls on the floor touches it at the end of the step, whatever its speed.
#[test]
fn gaps_close_without_overlap() {
    let material = Material::default();
    for speed in [0.1, 3.0, 50.0] {
        let mut grains = discs(vec![v(0.0, 0.6)], 0.5, &material);
        grains.velocity[0] = v(0.0, -speed);
        let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material.clone()], precise()).unwrap();
        for _ in 0..40 {
            let report = dem.step(0.01, &Load::default());
            assert!(report.converged && report.max_penetration_over_radius < 1e-12, "{report:?}");
        }
        assert_relative_eq!(dem.particles.position[0][1], 0.5, epsilon = 1e-12);
    }
}

/// Two discs on their way through each other, each faster than its sub-steps allow for: with enough of them they meet,
/// and with too few the step says so. (It went by in silence.)
#[test]
fn a_step_that_lacks_sub_steps_says_so() {
    let material = Material::default();
    let mut grains = discs(vec![v(0.0, 0.0), v(30.0, 0.0)], 0.5, &material);
    grains.velocity = vec![v(40.0, 0.0), v(-40.0, 0.0)];
    for (max_substeps, enough) in [(1000, true), (10, false)] {
        let settings = Settings { gravity: V::zeros(), max_substeps, ..precise() };
        let mut dem = Dem::new(grains.clone(), vec![], vec![material.clone()], settings).unwrap();
        let report = dem.step(1.0, &Load::default());
        assert_eq!(report.converged, enough, "{report:?}");
        assert!(report.substeps <= max_substeps, "{report:?}");
        if enough {
            let apart = dem.particles.position[1][0] - dem.particles.position[0][0];
            assert!((apart - 1.0).abs() < 1e-9, "they end {apart} m apart");
        }
    }
}

/// A grain pressed on the floor by its weight under strong implicit drag: the floor carries the weight, not more.
#[test]
fn contacts_see_the_implicit_drag() {
    let material = Material::default();
    let grains = discs(vec![v(0.0, 0.5)], 0.5, &material);
    let weight = grains.mass[0] * G;
    let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material], precise()).unwrap();
    dem.step(1e-3, &Load { drag: &[1e9], ..Load::default() });
    assert_relative_eq!(dem.contact_force()[0][1], weight, max_relative = 1e-9);
    assert!(dem.particles.velocity[0][1].abs() < 1e-18);
}

/// An oscillating floor carries a grain along: the grain is where the floor is.
#[test]
fn moving_walls_carry_grains() {
    let material = rubbing(0.5);
    let motion = Motion::Oscillation { amplitude: v(0.0, 0.01), frequency: 1.0, phase: 0.0 };
    let floor = Wall { motion, ..floor(0.5) };
    let belt = Wall {
        motion: Motion::Translation { velocity: v(0.2, 0.0) },
        ..Wall { friction: 0.5, ..Wall::new("belt", v(-100.0, -10.0), v(100.0, -10.0)) }
    };
    let grains = discs(vec![v(0.0, 0.5), v(0.0, -9.5)], 0.5, &material);
    let mut dem = Dem::new(grains, vec![floor.clone(), belt], vec![material], precise()).unwrap();
    for _ in 0..100 {
        dem.step(0.01, &Load::default());
        let top = floor.at(dem.time())[0][1];
        assert_relative_eq!(dem.particles.position[0][1], 0.5 + top, epsilon = 1e-10);
    }
    assert_relative_eq!(dem.particles.velocity[1], v(0.2, 0.0), epsilon = 1e-12);
}

/// Walls at their ends and joints: a disc balances on the tip of a post, slides over a joint of two collinear walls
/// without a stumble (no contact of its own at the joint), and rests in a corner on both sides of it.
#[test]
fn tips_joints_and_corners() {
    let material = Material::default();
    let at = |x: V, walls: Vec<Wall<2>>| {
        Dem::new(discs(vec![x], 0.5, &material), walls, vec![material.clone()], precise()).unwrap()
    };
    let mut tip = at(v(0.0, 0.5), vec![Wall::new("post", v(0.0, -1.0), v(0.0, 0.0))]);
    (0..20).for_each(|_| assert!(tip.step(1e-3, &Load::default()).converged));
    assert_eq!(tip.particles.position[0], v(0.0, 0.5));

    let mut joint = at(
        v(-0.2, 0.5),
        vec![Wall::new("left", v(-5.0, 0.0), v(0.0, 0.0)), Wall::new("right", v(0.0, 0.0), v(5.0, 0.0))],
    );
    joint.particles.velocity[0] = v(1.0, 0.0);
    for _ in 0..400 {
        joint.step(1e-3, &Load::default());
        let weight = joint.particles.mass[0] * G;
        assert_eq!(joint.contacts().filter(|c| c.force.norm() > 1e-9 * weight).count(), 1);
    }
    assert_relative_eq!(joint.particles.velocity[0], v(1.0, 0.0), epsilon = 1e-12);

    let mut corner = at(
        v(0.0, 2.0),
        vec![Wall::new("down", v(-3.0, 3.0), v(0.0, 0.0)), Wall::new("up", v(0.0, 0.0), v(3.0, 3.0))],
    );
    (0..2000).for_each(|_| assert!(corner.step(1e-3, &Load::default()).converged));
    assert_relative_eq!(corner.particles.position[0], v(0.0, 0.5 * 2f64.sqrt()), epsilon = 1e-9);
}

/// Spheres: the solver is the same code; a frictional, rotation-free cluster conserves momentum in free flight.
#[test]
fn spheres_conserve_momentum() {
    let material = Material { friction: 0.4, ..Material::default() };
    let x: Vec<Vector<3>> = (0..64)
        .map(|k| Vector::<3>::new((k % 4) as f64, (k / 4 % 4) as f64, (k / 16) as f64) * 0.99)
        .collect();
    let mut grains =
        Particles::<3>::new(x, vec![0.5; 64], vec![0; 64], std::slice::from_ref(&material)).unwrap();
    for (k, v) in grains.velocity.iter_mut().enumerate() {
        *v = Vector::<3>::new((k as f64).sin(), (2.0 * k as f64).cos(), (3.0 * k as f64).sin());
    }
    let momentum = |p: &Particles<3>| p.velocity.iter().zip(&p.mass).map(|(v, m)| v * *m).sum::<Vector<3>>();
    let before = momentum(&grains);
    let settings = Settings::<3> { gravity: Vector::zeros(), ..Settings::default() };
    let mut dem = Dem::new(grains, vec![], vec![material], settings).unwrap();
    for k in 0..50 {
        let report = dem.step(1e-2, &Load::default());
        assert!(report.converged && (k > 0 || report.contacts > 50), "{report:?}");
    }
    let scale: f64 = dem.particles.mass.iter().sum();
    assert!((momentum(&dem.particles) - before).norm() < 1e-12 * scale);
}

/// Whether a disc of 1 m hangs on one that is held above it, after four steps of `dt` without forces in which the contact
/// grows old, and ten under its weight; it turns with a spin (1/s). The force of the contact is a share of that weight.
fn hangs(share: f64, sliding: Option<f64>, spin: f64, dt: f64, load: &Load<2>) -> bool {
    let material = rubbing(if spin == 0.0 { 0.3 } else { 0.0 });
    let mut grains = discs(vec![v(0.0, 1.0), v(0.0, 0.0)], 0.5, &material).rotating();
    let weight = grains.mass[1] * G;
    grains.mass[0] *= 1e9; // held by its inertia
    grains.rotation.as_mut().expect("discs spin").spin[1] = spin;
    let cohesion = Some(voidage_dem::Cohesion { force: share * weight, age: 2.5 * dt, sliding });
    let period = Period::new([Some([-30.0, 30.0]), None]).expect("sides");
    let settings =
        Settings { gravity: V::zeros(), cohesion, tolerance: 1e-12, period, ..Settings::default() };
    let mut dem = Dem::new(grains, vec![], vec![material], settings).unwrap();
    (0..4).for_each(|_| assert!(dem.step(dt, &Load { halo: load.halo, ..Load::default() }).converged));
    let pull = [V::zeros(), v(0.0, -weight)];
    let load = Load { force: &pull, cohesive: load.cohesive, halo: load.halo, ..Load::default() };
    (0..10).for_each(|_| assert!(dem.step(dt, &load).converged));
    // Half of what a thousandth of the weight gives in ten steps.
    dem.particles.velocity[1][1].abs() < 0.5e-3 * G * 10.0 * dt
}

/// Adhesion F_c0: a grain hangs under a held one while its pull stays below F_c0, falls when it exceeds it, and
/// needs the time asked for before it sticks. Independent of dt.
#[test]
fn cohesion_holds_up_to_its_force() {
    for dt in [1e-2, 1e-4] {
        let may = |sticky: bool, share: f64| {
            hangs(share, None, 0.0, dt, &Load { cohesive: &[sticky; 2], ..Load::default() })
        };
        assert!(may(true, 1.001) && !may(true, 0.999) && !may(false, 1.001));
    }
}

/// Adhesion that falls off round a disc: a grain hangs under a held one while its pull stays below the share of F_c0
/// that is left where they touch, 1 - exp(-(s^2 - r^2)/L^2), and nothing is left at the surface and within; across a
/// periodic side it is the same.
#[test]
fn cohesion_falls_off_round_a_disc() {
    // They touch at (0, 0.5): 3 m from the first three centres, one of them beyond the side, 2 and 1 m from the others.
    let left = 1.0 - (-5.0_f64 / 9.0).exp();
    for dt in [1e-2, 1e-4] {
        let beside = |centre: V, share: f64| {
            let halo = Some(Halo { centre, radius: 2.0, length: 3.0 });
            hangs(share, None, 0.0, dt, &Load { halo, ..Load::default() })
        };
        for place in [v(3.0, 0.5), v(0.0, -2.5), v(57.0, 0.5)] {
            assert!(beside(place, 1.001 / left) && !beside(place, 0.999 / left), "{place}");
        }
        assert!(!beside(v(2.0, 0.5), 1e3) && !beside(v(1.0, 0.5), 1e3));
    }
}

/// A contact that slides faster than `sliding` stays young, and does not stick; one that slides more slowly does.
#[test]
fn contacts_that_slide_do_not_grow_old() {
    for dt in [1e-2, 1e-4] {
        // The surface of the disc goes by at 0.2 m/s.
        let with = |sliding: Option<f64>| hangs(1.1, sliding, 0.4, dt, &Load::default());
        assert!(with(None) && with(Some(0.21)) && !with(Some(0.19)));
    }
}

/// Grains of 55 um under one that is held, as many as F_c0 of Henry et al. carries (Table 2): 21 of porous grains
/// and 10 of full ones, whatever the step. One more falls, with all that hang below the contact that gives way.
#[test]
fn a_chain_hangs_as_long_as_cohesion_carries_its_weight() {
    let (radius, material) = (27.5e-6, rubbing(0.3));
    let falls = |count: usize, solidity: f64, dt: f64| {
        let places = (0..=count).map(|k| v(0.0, -2.0 * radius * k as f64)).collect();
        let mut grains = discs(places, radius, &material);
        let mass = 3200.0 * solidity * std::f64::consts::PI * radius * radius;
        grains.mass.fill(mass);
        grains.mass[0] *= 1e12; // held by its inertia
        let cohesion = Some(voidage_dem::Cohesion { force: 7.5e-4, age: 2.5 * dt, sliding: None });
        let settings = Settings { gravity: V::zeros(), cohesion, tolerance: 1e-10, ..Settings::default() };
        let mut dem = Dem::new(grains, vec![], vec![material.clone()], settings).unwrap();
        let mut load = Load::default();
        (0..4).for_each(|_| assert!(dem.step(dt, &load).converged));
        let pull: Vec<V> = (0..=count).map(|k| v(0.0, if k == 0 { 0.0 } else { -mass * G })).collect();
        load.force = &pull;
        (0..10).for_each(|_| assert!(dem.step(dt, &load).converged));
        // Half of what a thousandth of the weight gives in ten steps.
        dem.particles.velocity[count][1].abs() > 0.5e-3 * G * 10.0 * dt
    };
    for (solidity, most) in [(0.476, 21), (1.0, 10)] {
        for dt in [3e-5, 16.0 * 3e-5] {
            assert!(!falls(most, solidity, dt), "{most} grains fall, dt {dt}");
            assert!(falls(most + 1, solidity, dt), "{} grains hang, dt {dt}", most + 1);
        }
    }
}

/// Beside fine grains a wide disc has tiles and bounds of velocities of its own: flying into them by three of their
/// diameters in one sub-step, it meets all that are in its way, those that lie still far from it look for nobody, and
/// momentum stays.
#[test]
fn a_wide_disc_in_flight_meets_all_fine_grains_in_its_way() {
    let material = Material::default();
    let mut places: Vec<V> = (0..7200).map(|k| v((k % 120) as f64, -((k / 120) as f64))).collect();
    places.push(v(59.7, 20.5 + 2.0));
    let mut radii = vec![0.49; places.len()];
    radii[7200] = 20.0;
    let mut grains = Particles::new(places, radii, vec![0; 7201], std::slice::from_ref(&material)).unwrap();
    grains.velocity[7200] = v(0.0, -3.0);
    let momentum = |p: &Particles<2>| p.mass.iter().zip(&p.velocity).map(|(m, v)| v * *m).sum::<V>();
    let before = momentum(&grains);
    let settings = Settings { gravity: V::zeros(), max_travel: 1e3, ..Settings::default() };
    let mut dem = Dem::new(grains, vec![], vec![material], settings).unwrap();
    let report = dem.step(1.0, &Load::default());
    assert!(report.substeps == 1 && report.converged, "{report:?}");
    assert!(report.max_penetration_over_radius < 1e-2, "{report:?}");
    // If all looked as far as the disc flies there would be 152,000.
    assert!(report.contacts > 50 && report.candidates < 80_000, "{report:?}");
    assert!((momentum(&dem.particles) - before).norm() < 1e-12 * before.norm());
}

/// A stack of 100 under a lid a million times as heavy as a grain, and a big grain on a bed of grains a hundred times
/// smaller: contacts converge, nothing is crushed, on average the floor carries the weight.
#[test]
fn extreme_masses_and_sizes_stand() {
    let material = Material::default();
    let x: Vec<V> = (0..100).map(|k| v(0.0, 0.5 + k as f64)).collect();
    let mut grains = discs(x, 0.5, &material);
    grains.mass[99] *= 1e6;
    let total: f64 = grains.mass.iter().sum::<f64>() * G;
    let settings = Settings { max_sweeps: 20_000, ..Settings::default() };
    let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material], settings).unwrap();
    let mut mean = 0.0;
    for _ in 0..200 {
        let report = dem.step(1e-3, &Load::default());
        assert!(report.converged && report.max_penetration_over_radius < 1e-3, "{report:?}");
        mean -= dem.wall_force()[0][1] / 200.0;
    }
    println!("floor: {} of the weight", mean / total);
    assert_relative_eq!(mean, total, max_relative = 0.1);

    let material = rubbing(0.3);
    let (small, n) = (0.01, 400);
    let mut x: Vec<V> =
        (0..n).map(|k| v(2.0 * small * (k % 200) as f64, small * (1 + 2 * (k / 200)) as f64)).collect();
    x.push(v(2.0, 4.0 * small + 1.0));
    let mut radius = vec![small; n];
    radius.push(1.0);
    let grains =
        Particles::new(x, radius, vec![0; n + 1], std::slice::from_ref(&material)).unwrap().rotating();
    let settings = Settings { max_sweeps: 20_000, ..Settings::default() };
    let mut dem = Dem::new(grains, vec![floor(0.5)], vec![material], settings).unwrap();
    for _ in 0..20 {
        let report = dem.step(1e-3, &Load::default());
        assert!(report.converged && report.max_penetration_over_radius < 1e-2, "{report:?}");
    }
}

/// Grains of infinite mass are held: a free disc comes to rest in the notch between two of them, which touch each
/// other and a floor, and carry it as walls would: 45 degrees each side, so a force of m g / sqrt(2) each.
#[test]
fn a_disc_rests_on_held_grains() {
    let material = Material::default();
    let places = vec![v(0.0, 0.5), v(2f64.sqrt(), 0.5), v(0.5 * 2f64.sqrt(), 0.5 + 0.5 * 2f64.sqrt() + 0.01)];
    let mut grains = discs(places.clone(), 0.5, &material);
    grains.mass[0] = f64::INFINITY;
    grains.mass[1] = f64::INFINITY;
    let weight = grains.mass[2] * 9.81;
    let mut dem = Dem::new(grains.rotating(), vec![floor(0.0)], vec![material], precise()).unwrap();
    (0..500).for_each(|_| assert!(dem.step(1e-3, &Load::default()).converged));
    assert_eq!(&dem.particles.position[..2], &places[..2]);
    assert_relative_eq!(dem.particles.velocity[2], v(0.0, 0.0), epsilon = 1e-9);
    let forces: Vec<f64> = dem.contacts().map(|c| c.force.norm()).filter(|f| *f > 0.0).collect();
    assert_eq!(forces.len(), 2);
    for force in forces {
        assert_relative_eq!(force, weight / 2f64.sqrt(), max_relative = 1e-6);
    }
}
