//! Heat through contacts.

use super::*;
use voidage_dem::Conduction;

/// The flux of the last step leaves the temperatures where the implicit solution has them.
fn metal() -> Material {
    Material { young: 1e9, poisson: 0.3, conductivity: 10.0, heat_capacity: 100.0, ..Material::default() }
}

/// Between grains of one material d* = d/2 and E* = E / (2 (1 - nu^2)); at a wall twice both, and k_s = 2 k against k: with
/// F the force per depth, H = 4 k_s (F d* / (2 pi E*))^(1/4).
fn conductances(force: f64, d: f64) -> (f64, f64) {
    let e = 1e9 / (1.0 - 0.09);
    let h = |k: f64, d: f64, e: f64| 4.0 * k * (force * d / (2.0 * std::f64::consts::PI * e)).powf(0.25);
    (h(10.0, d / 2.0, e / 2.0), h(20.0, d, e))
}

/// A row of N discs pressed by F against a cold wall, the last one kept hot (a huge capacity): N - 1 contacts H and one
/// H_w in series carry dT / ((N - 1) / H + 1 / H_w). Where all H are equal this is the H dT / (N + 1) of a chain between two
/// walls.
#[test]
fn a_chain_conducts_as_resistors_in_series() {
    let (n, force, r) = (10, 50.0, 0.5);
    let material = metal();
    let x = (0..n).map(|k| v(0.5 + k as f64, 0.0)).collect();
    let mut grains = discs(x, r, &material).heated(300.0, std::slice::from_ref(&material)).unwrap();
    let heat = grains.heat.as_mut().unwrap();
    heat.capacity.fill(1e-9); // steady within a step
    heat.capacity[n - 1] = 1e15;
    heat.temperature[n - 1] = 400.0;
    let wall = Wall { temperature: Some(300.0), ..Wall::new("cold", v(0.0, -2.0), v(0.0, 2.0)) };
    let settings = Settings { gravity: V::zeros(), conduction: Some(Conduction::Henry), ..precise() };
    let mut dem = Dem::new(grains, vec![wall], vec![material], settings).unwrap();
    let mut push = vec![V::zeros(); n];
    push[n - 1] = v(-force, 0.0);
    for _ in 0..5 {
        assert!(dem.step(1e-3, &Load { force: &push, ..Load::default() }).converged);
    }
    let (h, hw) = conductances(force, 2.0 * r);
    let flux = 100.0 / ((n - 1) as f64 / h + 1.0 / hw);
    assert_relative_eq!(-dem.wall_heat()[0], flux, max_relative = 1e-6);
    assert_relative_eq!(-dem.contact_heat()[n - 1], flux, max_relative = 1e-6);
    let t = &dem.particles.heat.as_ref().unwrap().temperature;
    assert_relative_eq!(t[0], 300.0 + flux / hw, max_relative = 1e-8);
    assert_relative_eq!(t[5] - t[4], flux / h, max_relative = 1e-5);
}

/// A shaken box without heated walls keeps its energy to 1e-12, and no grain leaves the range of temperatures it started in,
/// with contacts from slow to hopelessly stiff.
#[test]
fn a_closed_box_keeps_its_energy() {
    for capacity in [1e3, 1.0, 1e-6] {
        let material = Material { friction: 0.3, heat_capacity: capacity, ..metal() };
        let x: Vec<V> = (0..100)
            .map(|k| v(0.55 + 1.02 * (k % 10) as f64 + 0.3 * (k / 10 % 2) as f64, 0.5 + (k / 10) as f64))
            .collect();
        let mut grains = discs(x, 0.5, &material).heated(0.0, std::slice::from_ref(&material)).unwrap();
        let heat = grains.heat.as_mut().unwrap();
        heat.temperature.iter_mut().enumerate().for_each(|(k, t)| *t = 300.0 + (k * 37 % 100) as f64);
        let walls = vec![
            floor(0.3),
            Wall::new("left", v(0.0, 0.0), v(0.0, 20.0)),
            Wall::new("right", v(10.6, 0.0), v(10.6, 20.0)),
        ];
        let settings = Settings { conduction: Some(Conduction::Line), ..Settings::default() };
        let mut dem = Dem::new(grains, walls, vec![material], settings).unwrap();
        let energy = |dem: &Dem<2>| {
            let h = dem.particles.heat.as_ref().unwrap();
            h.temperature.iter().zip(&h.capacity).map(|(t, c)| t * c).sum::<f64>()
        };
        let before = energy(&dem);
        let mut report = dem.step(1e-2, &Load::default());
        for _ in 0..100 {
            report = dem.step(1e-2, &Load::default());
        }
        assert!(report.contacts > 100, "{report:?}");
        assert_relative_eq!(energy(&dem), before, max_relative = 1e-12);
        let t = &dem.particles.heat.as_ref().unwrap().temperature;
        assert!(t.iter().all(|t| (300.0 - 1e-6..=399.0 + 1e-6).contains(t)));
        assert_eq!(report.wall_heat, 0.0);
    }
}

/// Heat from outside arrives whole, with and without contacts.
#[test]
fn outside_heat_arrives() {
    let material = metal();
    let grains = discs(vec![v(0.0, 0.5), v(0.0, 1.5)], 0.5, &material);
    let mut grains = grains.heated(300.0, std::slice::from_ref(&material)).unwrap();
    let capacity = 0.01;
    grains.heat.as_mut().unwrap().capacity.fill(capacity);
    let settings = Settings { conduction: Some(Conduction::Henry), ..precise() };
    let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material], settings).unwrap();
    let load = Load { heat: &[7.0, 0.0], ..Load::default() };
    (0..10).for_each(|_| assert!(dem.step(0.1, &load).converged));
    let t = &dem.particles.heat.as_ref().unwrap().temperature;
    assert_relative_eq!((t[0] + t[1] - 600.0) * capacity, 7.0, max_relative = 1e-9);
    assert!(t[1] > 300.0);
}
