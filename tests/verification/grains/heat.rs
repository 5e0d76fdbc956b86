//! Heat through contacts.

use super::*;
use voidage_dem::Conduction;

/// The flux of the last step leaves the temperatures where the implicit solution has them.
fn metal() -> Material {
    Material { young: 1e9, poisson: 0.3, conductivity: 10.0, heat_capacity: 100.0, ..Material::default() }
}

/// A shaken box without heated walls keeps its energy to 1e-12, and no grain leaves the range of temperatures it
/// started in, with contacts from slow to hopelessly stiff.
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
