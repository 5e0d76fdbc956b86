//! Resistance to rolling: discs on slopes and floors, energy, beds at rest, and the angle of a pile.

use super::*;
use voidage_dem::Pair;
use voidage_dem::Side;

const R: f64 = 0.05;

fn resisting(friction: f64, rolling: f64) -> Material {
    Material { friction, rolling, ..Material::default() }
}

/// A disc on a floor under a gravity that leans by `tangent`, and its mass.
fn disc_on_slope(tangent: f64, friction: f64, rolling: f64) -> Dem<2> {
    let material = resisting(friction, rolling);
    let angle = tangent.atan();
    let settings = Settings { gravity: v(angle.sin(), -angle.cos()) * G, ..precise() };
    let grains = discs(vec![v(0.0, R)], R, &material).rotating();
    Dem::new(grains, vec![Wall { rolling, ..floor(friction) }], vec![material], settings).unwrap()
}

fn advance(dem: &mut Dem<2>, dt: f64, count: usize) {
    for _ in 0..count {
        let report = dem.step(dt, &Load::default());
        assert!(report.converged, "{report:?}");
    }
}

fn spin(dem: &Dem<2>, i: usize) -> f64 {
    dem.particles.rotation.as_ref().unwrap().spin[i]
}

/// On a slope of tan(angle) > mu_r a disc rolls with a (1 + I/(m r^2)) = g (sin - mu_r cos), and below it does not
/// move at all.
#[test]
fn a_disc_rolls_down_slopes_above_its_resistance_only() {
    for (tangent, rolling) in [(0.3, 0.1), (0.2, 0.19), (0.1, 0.0)] {
        let mut dem = disc_on_slope(tangent, 0.5, rolling);
        advance(&mut dem, 1e-3, 500);
        let angle: f64 = tangent.atan();
        let acceleration = G * (angle.sin() - rolling * angle.cos()) / 1.5;
        let velocity = dem.particles.velocity[0].x;
        assert_relative_eq!(velocity, acceleration * 0.5, max_relative = 1e-10);
        assert_relative_eq!(-spin(&dem, 0) * R, velocity, max_relative = 1e-10);
    }
    let mut dem = disc_on_slope(0.2, 0.5, 0.21);
    advance(&mut dem, 1e-3, 100);
    assert_eq!((dem.particles.velocity[0], spin(&dem, 0)), (V::zeros(), 0.0));
}

/// Friction of mu < tan(angle) < mu_r lets it slide without rolling, with a = g (sin - mu cos).
#[test]
fn a_disc_that_cannot_roll_slides() {
    let mut dem = disc_on_slope(0.4, 0.2, 0.3);
    advance(&mut dem, 1e-3, 500);
    let angle = 0.4_f64.atan();
    assert_relative_eq!(
        dem.particles.velocity[0].x,
        G * (angle.sin() - 0.2 * angle.cos()) * 0.5,
        max_relative = 1e-10
    );
    assert!(spin(&dem, 0).abs() * R < 1e-10);
}

/// A disc that rolls at v0 on a level floor stops after v0^2 (1 + I/(m r^2)) / (2 mu_r g); a step adds or takes half
/// of its way.
#[test]
fn a_disc_that_rolls_comes_to_rest_where_it_should() {
    let (v0, rolling) = (1.0, 0.05);
    let way = v0 * v0 * 1.5 / (2.0 * rolling * G);
    let mut errors = vec![];
    for dt in [4e-3, 2e-3, 1e-3] {
        let mut dem = disc_on_slope(0.0, 0.5, rolling);
        dem.particles.velocity[0].x = v0;
        dem.particles.rotation.as_mut().unwrap().spin[0] = -v0 / R;
        let before = dem.particles.position[0].x;
        let stops = 1.5 * v0 / (rolling * G);
        advance(&mut dem, dt, (1.1 * stops / dt) as usize);
        assert_eq!((dem.particles.velocity[0].x, spin(&dem, 0)), (0.0, 0.0));
        errors.push((dem.particles.position[0].x - before - way).abs());
        assert!(errors[errors.len() - 1] <= 0.6 * v0 * dt, "{errors:?}");
    }
    assert!(errors[2] < 0.6 * errors[0], "{errors:?}");
}

/// Discs of different radii: R = r1 r2 / (r1 + r2). Two discs in free flight, pressed together by a force f, spin
/// against each other and slow down by equal moments mu_r R f, so that the sum of I w stays.
#[test]
fn two_discs_resist_by_their_effective_radius() {
    let (radii, rolling, force) = ([0.02, 0.05], 0.1, 3.0);
    let material = resisting(0.0, rolling);
    let grains = Particles::new(
        vec![v(0.0, 0.0), v(0.07, 0.0)],
        radii.to_vec(),
        vec![0, 0],
        std::slice::from_ref(&material),
    );
    let mut grains = grains.unwrap().rotating();
    let rotation = grains.rotation.as_mut().unwrap();
    rotation.spin = vec![-30.0, 40.0];
    let inertia = rotation.inertia.clone();
    let settings = Settings { gravity: V::zeros(), ..precise() };
    let mut dem = Dem::new(grains, vec![], vec![material], settings).unwrap();
    let push = [v(force, 0.0), v(-force, 0.0)];
    for _ in 0..20 {
        assert!(dem.step(1e-3, &Load { force: &push, ..Load::default() }).converged);
    }
    let moment = rolling * force * 0.02 * 0.05 / 0.07;
    assert_relative_eq!(spin(&dem, 0), -30.0 + moment / inertia[0] * 0.02, max_relative = 1e-9);
    assert_relative_eq!(spin(&dem, 1), 40.0 - moment / inertia[1] * 0.02, max_relative = 1e-9);
}

/// A wall that turns takes a grain along: it is the spin relative to the wall that is resisted, and the wall feels
/// the moment.
#[test]
fn a_wall_that_turns_turns_the_disc_on_it() {
    let rate = 0.01;
    let material = resisting(0.0, 0.5);
    let grains = discs(vec![v(0.0, R)], R, &material).rotating();
    let motion = Motion::Rotation { centre: V::zeros(), rate };
    let table = Wall { rolling: 0.5, motion, ..Wall::new("table", v(-1.0, 0.0), v(1.0, 0.0)) };
    let mut dem = Dem::new(grains, vec![table], vec![material], precise()).unwrap();
    let inertia = dem.particles.rotation.as_ref().unwrap().inertia[0];
    advance(&mut dem, 1e-4, 1);
    assert_relative_eq!(spin(&dem, 0), rate, max_relative = 1e-6);
    // About its centre, the normal force at the place of the disc, zero, has no moment.
    assert_relative_eq!(dem.wall_torque()[0], -inertia * rate / 1e-4, max_relative = 1e-3);
}

/// Kinetic and potential energy of all grains, J.
fn energy(dem: &Dem<2>) -> f64 {
    let p = &dem.particles;
    let rotation = p.rotation.as_ref().unwrap();
    let of = |i: usize| {
        let moves = 0.5 * p.mass[i] * p.velocity[i].norm_squared();
        moves + 0.5 * rotation.inertia[i] * rotation.spin[i].powi(2) + p.mass[i] * G * p.position[i].y
    };
    (0..p.len()).map(of).sum()
}

/// Grains of 1 mm between rough walls, loose above their floor.
fn loose_bed(count: usize, rolling: f64, width: f64) -> Dem<2> {
    use voidage_dem::packing::{Amount, Fill, Radii, Region, loose};
    let materials = vec![resisting(0.5, rolling)];
    let fill = Fill {
        radii: Radii::Uniform { min: 0.44e-3, max: 0.55e-3 },
        amount: Amount::Count(count),
        material: 0,
        materials: &materials,
        seed: 1,
    };
    let region = Region { low: V::zeros(), high: v(width, 1.0) };
    let grains = loose(&region, &fill).unwrap().rotating();
    let wall = |name: &str, from, to| Wall { friction: 0.5, rolling, ..Wall::new(name, from, to) };
    let walls = vec![
        wall("floor", v(-1.0, 0.0), v(1.0, 0.0)),
        wall("left", V::zeros(), v(0.0, 1.0)),
        wall("right", v(width, 0.0), v(width, 1.0)),
    ];
    Dem::new(grains, walls, materials, Settings::default()).unwrap()
}

/// A bed that falls and comes to rest never gains energy, beyond that of overlaps that are taken back. With resistance
/// no more of its steps are unsolved and it needs no more sweeps than without, none at rest. It goes on bit for bit
/// from its state.
#[test]
fn beds_with_resistance_lose_energy_rest_and_go_on_from_their_state() {
    let mut sweeps = vec![];
    for rolling in [0.0, 0.2] {
        let bed = || loose_bed(300, rolling, 20e-3);
        let (mut dem, mut other) = (bed(), bed());
        let unit = dem.particles.mass.iter().sum::<f64>() * G * 1e-3;
        let (mut before, mut falling, mut unsolved) = (energy(&dem), 0, 0);
        for _ in 0..1600 {
            let report = dem.step(2.5e-4, &Load::default());
            unsolved += usize::from(!report.converged);
            let now = energy(&dem);
            assert!(now <= before + 1e-3 * unit, "{rolling}: {}", (now - before) / unit);
            (before, falling) = (now, falling + report.sweeps);
        }
        other.restore(dem.state()).unwrap();
        let mut resting = 0;
        for _ in 0..100 {
            resting += dem.step(2.5e-4, &Load::default()).sweeps;
            other.step(2.5e-4, &Load::default());
        }
        assert_eq!(dem.state(), other.state());
        // Some of it is carried by moments.
        assert_eq!(dem.state().forces().any(|f| f.rolling != 0.0), rolling > 0.0);
        sweeps.push([unsolved, falling, resting]);
    }
    println!("unsolved steps, sweeps of a falling bed and at rest, without and with resistance: {sweeps:?}");
    assert!((0..3).all(|k| sweeps[1][k] <= sweeps[0][k]) && sweeps[1][2] == 0, "{sweeps:?}");
}

/// What a restart would lose if the moments were not kept: the discs of a bed at rest that resist rolling carry them.
#[test]
fn the_state_keeps_the_moments() {
    let mut dem = disc_on_slope(0.15, 0.5, 0.2);
    advance(&mut dem, 1e-3, 3);
    let weight = dem.particles.mass[0] * G;
    let expected = weight * 0.15_f64.atan().sin();
    let kept: Vec<f64> = dem.state().forces().map(|f| f.rolling).collect();
    assert_eq!(kept.len(), 1);
    assert_relative_eq!(kept[0].abs(), expected, max_relative = 1e-9);
    assert_relative_eq!(dem.contacts().next().unwrap().rolling, kept[0], max_relative = 1e-12);
}

/// Where a column of 1 mm grains between two walls is let go, the angle of the pile that is left, from its second
/// moment.
fn pile(rolling: f64) -> f64 {
    let (width, count) = (20e-3, 600);
    let mut dem = loose_bed(count, rolling, width);
    (0..500).for_each(|_| {
        dem.step(5e-4, &Load::default());
    });
    let gone = |wall: &Wall<2>| wall.name == "floor";
    let walls: Vec<Wall<2>> = dem.walls().iter().filter(|wall| gone(wall)).cloned().collect();
    let mut open =
        Dem::new(dem.particles.clone(), walls, dem.materials().to_vec(), Settings::default()).unwrap();
    (0..1500).for_each(|_| {
        open.step(5e-4, &Load::default());
    });
    // A triangle of the base 2 b and the height h has the mean height h / 3 and the mean distance b / 3 from its
    // middle.
    let p = &open.particles;
    let middle = p.position.iter().map(|x| x.x).sum::<f64>() / count as f64;
    let height = p.position.iter().map(|x| x.y).sum::<f64>() / count as f64;
    let distance = p.position.iter().map(|x| (x.x - middle).abs()).sum::<f64>() / count as f64;
    (height / distance).atan().to_degrees()
}

#[test]
fn a_pile_is_steeper_with_resistance() {
    let [without, with] = [pile(0.0), pile(0.3)];
    println!("angle of a pile without and with resistance: {without:.1} and {with:.1} degrees");
    assert!(with > without + 3.0, "{without} {with}");
}

/// Two materials meet with the smaller coefficient, a pair with its own.
#[test]
fn pairs_have_coefficients_of_their_own() {
    let stops = |pairs: Vec<Pair>| {
        let material = resisting(0.5, 0.0);
        let grains = discs(vec![v(0.0, R)], R, &material).rotating();
        let settings = Settings { pairs, gravity: v(1.0, -10.0), ..precise() };
        let mut dem = Dem::new(grains, vec![floor(0.5)], vec![material], settings).unwrap();
        advance(&mut dem, 1e-3, 10);
        dem.particles.velocity[0].x == 0.0
    };
    let pair =
        Pair { material: 0, other: Side::Wall(0), friction: None, restitution: None, rolling: Some(0.2) };
    assert!(!stops(vec![]) && stops(vec![pair]));
}

/// In the plane, with grains that spin, without the interior-point method.
#[test]
fn resistance_is_refused_where_it_cannot_be_had() {
    let material = resisting(0.5, 0.1);
    let grains = discs(vec![v(0.0, R)], R, &material);
    let of =
        |grains: Particles<2>, settings| Dem::new(grains, vec![], vec![material.clone()], settings).err();
    assert!(of(grains.clone(), precise()).unwrap().to_string().contains("do not spin"));
    let interior = Settings { interior: true, ..precise() };
    assert!(of(grains.clone().rotating(), interior).unwrap().to_string().contains("interior-point"));
    assert!(of(grains.rotating(), precise()).is_none());
    let sphere =
        Particles::<3>::new(vec![Vector::zeros()], vec![R], vec![0], std::slice::from_ref(&material))
            .unwrap();
    let refused = Dem::new(sphere, vec![], vec![material], Settings::default()).err().unwrap();
    assert!(refused.to_string().contains("rolling"), "{refused}");
    let bad = Particles::<2>::new(vec![V::zeros()], vec![R], vec![0], &[resisting(0.1, 1.5)]);
    let bad = bad.map(|grains| Dem::new(grains, vec![], vec![resisting(0.1, 1.5)], precise()).err());
    assert!(bad.is_err() || bad.unwrap().is_some());
}
