//! The same numbers bit for bit: on any number of threads, and after a restart.

use super::*;
use voidage_dem::packing::{Amount, Fill, Lattice, Radii, Region, lattice};
use voidage_dem::{Cohesion, Conduction};

/// A warm, sticky, rolling bed that falls on a floor that shakes.
fn bed(count: usize) -> Dem<2> {
    let materials = vec![Material {
        friction: 0.3,
        restitution: 0.2,
        young: 1e9,
        poisson: 0.3,
        conductivity: 1.0,
        heat_capacity: 800.0,
        ..Material::default()
    }];
    let fill = Fill {
        radii: Radii::Uniform { min: 0.8e-3, max: 1e-3 },
        amount: Amount::Count(count),
        material: 0,
        materials: &materials,
        seed: 5,
    };
    let region = Region { low: V::zeros(), high: v(0.1, 1.0) };
    let mut grains = lattice(&region, Lattice::Triangular, 1.01, &fill).unwrap().rotating();
    grains = grains.heated(300.0, &materials).unwrap();
    for (k, x) in grains.velocity.iter_mut().enumerate() {
        *x = v(0.1 * (k as f64).sin(), 0.1 * (1.7 * k as f64).cos());
    }
    grains.heat.as_mut().unwrap().temperature.iter_mut().enumerate().for_each(|(k, t)| *t += (k % 50) as f64);
    let shaking = Motion::Oscillation { amplitude: v(1e-4, 2e-4), frequency: 30.0, phase: 0.3 };
    let walls = vec![
        Wall { motion: shaking, temperature: Some(280.0), ..floor(0.5) },
        Wall::new("left", v(0.0, 0.0), v(0.0, 1.0)),
        Wall::new("right", v(0.1, 0.0), v(0.1, 1.0)),
    ];
    let settings = Settings {
        conduction: Some(Conduction::Henry),
        cohesion: Some(Cohesion { force: 0.05, age: 5e-3, sliding: None }),
        max_sweeps: 60,
        ..Settings::default()
    };
    Dem::new(grains, walls, materials, settings).unwrap()
}

#[test]
fn threads_do_not_change_a_bit() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut dem = bed(24_000);
            let reports: Vec<_> = (0..5).map(|_| dem.step(2e-3, &Load::default())).collect();
            assert!(reports.iter().all(|r| r.candidates > 40_000));
            (reports, dem.state())
        })
    };
    let one = run(1);
    for threads in [2, 4] {
        assert!(one == run(threads), "{threads} threads differ from one");
    }
}

#[test]
fn a_restart_continues_bit_for_bit() {
    let mut straight = bed(500);
    for _ in 0..20 {
        straight.step(2e-3, &Load::default());
    }
    let half = straight.state();
    let go_on = |dem: &mut Dem<2>| {
        let reports: Vec<_> = (0..20).map(|_| dem.step(2e-3, &Load::default())).collect();
        (reports, dem.state())
    };
    let mut again = bed(500);
    again.step(1e-3, &Load::default()); // buffers full of something else
    again.restore(half).unwrap();
    assert!(go_on(&mut straight) == go_on(&mut again));
}
