//! Grains at rest: they stay where they are at no cost, and move again as soon as their forces are not balanced.

use super::*;
use voidage_dem::packing::{Amount, Fill, Method, Radii, Region, pour, unobserved};

const STEP: f64 = 5e-4;
const WIDTH: f64 = 40e-3;

/// Discs of 1 mm that have rolled into their places between rough walls.
fn bed(count: usize) -> Dem<2> {
    let materials = vec![Material { density: 2500.0, ..rubbing(0.3) }];
    let fill = Fill {
        radii: Radii::Uniform { min: 0.44e-3, max: 0.55e-3 },
        amount: Amount::Count(count),
        material: 0,
        materials: &materials,
        seed: 1,
    };
    let region = Region { low: V::zeros(), high: v(WIDTH, 1.0) };
    let grains = pour(&region, &[], &fill, Method::DropAndRoll, &mut unobserved).unwrap().rotating();
    let wall = |name: &str, from, to| Wall { friction: 0.3, ..Wall::new(name, from, to) };
    let walls = vec![
        wall("floor", V::zeros(), v(WIDTH, 0.0)),
        wall("left", V::zeros(), v(0.0, 1.0)),
        wall("right", v(WIDTH, 0.0), v(WIDTH, 1.0)),
    ];
    Dem::new(grains, walls, materials, Settings::default()).unwrap()
}

/// The same after it has come to rest. Under arches a grain may roll for ever.
fn bed_at_rest(count: usize) -> Dem<2> {
    let mut dem = bed(count);
    (0..400).for_each(|_| {
        dem.step(STEP, &Load::default());
    });
    dem
}

/// With errors of its contacts that were small beside gravity, a bed crept for ever and took 50 sweeps in each step.
#[test]
fn a_bed_at_rest_stays_where_it_is_without_sweeps() {
    let mut dem = bed_at_rest(2000);
    let place = dem.particles.position.clone();
    for _ in 0..50 {
        let report = dem.step(STEP, &Load::default());
        assert!(report.converged && report.work < 10 * report.candidates, "{report:?}");
    }
    let stays = |i: &usize| dem.particles.position[*i] == place[*i];
    assert!((0..2000).filter(stays).count() > 1980, "it creeps");
    let share = dem.settings().rest();
    for i in (0..2000).filter(stays) {
        assert_eq!(dem.particles.velocity[i], V::zeros());
        let weight = dem.particles.mass[i] * G;
        let lacks = (dem.contact_force()[i] - v(0.0, weight)).norm() / weight;
        assert!(lacks <= share, "contacts leave {lacks} of a weight");
    }
    let weight = dem.particles.mass.iter().sum::<f64>() * G;
    let carried = -dem.wall_force().iter().map(|f| f.y).sum::<f64>();
    assert_relative_eq!(carried, weight, max_relative = share);
}

/// What contacts may close by in a step was taken back at once, which lifts the bed above: one of them always does in
/// large beds, and they never came to rest.
#[test]
fn a_small_overlap_does_not_disturb_a_bed_at_rest() {
    let mut dem = bed_at_rest(2000);
    dem.particles.radius[700] *= 1.004;
    let place = dem.particles.position.clone();
    for _ in 0..20 {
        let report = dem.step(STEP, &Load::default());
        assert!(
            report.work < 10 * report.candidates && report.max_penetration_over_radius > 3e-3,
            "{report:?}"
        );
    }
    assert!((0..2000).filter(|i| dem.particles.position[*i] == place[*i]).count() > 1980);
}

#[test]
fn a_bed_at_rest_moves_when_it_is_pushed() {
    let mut dem = bed_at_rest(2000);
    let push: Vec<V> = dem.particles.mass.iter().map(|m| v(0.5 * m * G, 0.0)).collect();
    for _ in 0..40 {
        dem.step(STEP, &Load { force: &push, ..Load::default() });
    }
    let top = (0..2000).max_by(|a, b| dem.particles.position[*a].y.total_cmp(&dem.particles.position[*b].y));
    assert!(dem.particles.velocity[top.unwrap()].x > 0.1 * 0.5 * G * 40.0 * STEP);
}

/// The floor is smooth: a disc that gets a share of its weight sideways goes as Newton has it, unless it rests by
/// definition.
#[test]
fn a_disc_moves_once_more_than_the_share_is_not_balanced() {
    let material = Material::default();
    let pushed = |share: f64| {
        let grains = discs(vec![v(0.0, 0.5)], 0.5, &material);
        let push = [v(share * grains.mass[0] * G, 0.0)];
        let mut dem =
            Dem::new(grains, vec![floor(0.0)], vec![material.clone()], Settings::default()).unwrap();
        (0..100).for_each(|_| {
            dem.step(1e-3, &Load { force: &push, ..Load::default() });
        });
        dem.particles.velocity[0].x
    };
    assert_eq!(pushed(0.9e-3), 0.0);
    assert_relative_eq!(pushed(1.1e-3), 1.1e-3 * G * 0.1, max_relative = 1e-12);
}

/// Its velocity is far below what counts as rest, but the floor would pass into the disc.
#[test]
fn a_disc_at_rest_goes_with_a_floor_that_creeps() {
    let material = Material::default();
    let creeping = 1e-6;
    let rising = Wall { motion: Motion::Translation { velocity: v(0.0, creeping) }, ..floor(0.3) };
    let grains = discs(vec![v(0.0, 0.5e-3)], 0.5e-3, &material);
    let mut dem = Dem::new(grains, vec![rising], vec![material], Settings::default()).unwrap();
    (0..2000).for_each(|_| {
        let report = dem.step(1e-3, &Load::default());
        assert!(report.max_penetration_over_radius < 1e-9);
    });
    assert_relative_eq!(dem.particles.position[0].y - 0.5e-3, 2.0 * creeping, max_relative = 1e-6);
}
