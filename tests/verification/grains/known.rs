//! Which contacts are known: between grains that come and go, of grains that are kicked farther than expected, of walls
//! that have vanished.

use super::*;
use voidage_dem::{Conduction, Partner, Period};

fn weightless() -> Settings<2> {
    Settings { gravity: V::zeros(), ..precise() }
}

fn conducting() -> Material {
    Material { young: 1e9, poisson: 0.3, conductivity: 10.0, heat_capacity: 100.0, ..Material::default() }
}

/// A grain that a heavy one kicks faster than anything moved before meets what lies on its way, also where it would end
/// beyond it. A small one went through a wall, because only the places at the end were compared.
#[test]
fn a_kicked_grain_does_not_pass_a_wall() {
    let material = Material { restitution: 0.9, ..Material::default() };
    let materials = std::slice::from_ref(&material);
    let places = vec![v(0.0, 0.0), v(-11.05, 0.0)];
    let mut grains = Particles::new(places, vec![1.0, 10.0], vec![0; 2], materials).unwrap();
    grains.velocity[1] = v(3.0, 0.0);
    let wall = Wall::new("wall", v(4.3, -50.0), v(4.3, 50.0));
    let mut dem = Dem::new(grains, vec![wall], vec![material], weightless()).unwrap();
    let report = dem.step(1.0, &Load::default());
    assert!(report.converged, "{report:?}");
    let x = dem.particles.position[0][0];
    assert!(x < 4.3 - 0.99, "the grain is at {x}, the wall at 4.3");
}

/// The same with a grain that comes towards it from two cells away, wherever the cells begin: that is at the first grain.
#[test]
fn a_kicked_grain_does_not_pass_into_one_from_afar() {
    let light = Material { restitution: 1.0, ..Material::default() };
    let heavy = Material { density: 1000.0 * light.density, ..light.clone() };
    let materials = vec![light, heavy];
    for k in 0..120 {
        let places = vec![v(-0.05 * f64::from(k), 0.0), v(3.204, 0.0), v(5.254, 0.0), v(7.92, 0.0)];
        let mut grains = Particles::new(places, vec![1.0; 4], vec![0, 1, 0, 0], &materials).unwrap();
        grains.velocity = vec![v(0.0, 0.0), v(0.3, 0.0), v(0.0, 0.0), v(-0.3, 0.0)];
        let mut dem = Dem::new(grains, vec![], materials.clone(), weightless()).unwrap();
        let report = dem.step(1.0, &Load::default());
        assert!(report.converged, "{report:?}");
        let x = &dem.particles.position;
        assert!((x[3] - x[2]).norm() > 2.0 * 0.99, "{k}: {x:?}");
    }
}

/// A wall that had vanished was put far away, and periodic sides along both axes brought it back.
#[test]
fn a_wall_that_has_vanished_stays_away_in_a_doubly_periodic_box() {
    let material = Material::default();
    let mut grains = discs(vec![v(0.01, 0.012)], 5e-4, &material);
    grains.velocity[0] = v(0.0, -0.01);
    let gate = Wall { until: Some(0.1), ..Wall::new("gate", v(0.005, 0.01), v(0.015, 0.01)) };
    let period = Period::new([Some([0.0, 0.02]); 2]).unwrap();
    let settings = Settings { period, ..weightless() };
    let mut dem = Dem::new(grains, vec![gate], vec![material], settings).unwrap();
    (0..400).for_each(|_| assert!(dem.step(1e-3, &Load::default()).converged));
    assert_relative_eq!(dem.particles.position[0], v(0.01, 0.008), max_relative = 1e-9);
}

/// Contacts of grains that stay are known in a step after which others leave or come. Stress and contacts of a hopper
/// in flow were zero in nearly all pictures.
#[test]
fn contacts_stay_known_when_other_grains_leave_or_come() {
    let material = conducting();
    let places = (0..5).map(|k| v(0.0, 0.5 + f64::from(k))).collect();
    let mut grains = discs(places, 0.5, &material).heated(300.0, std::slice::from_ref(&material)).unwrap();
    let heat = grains.heat.as_mut().unwrap();
    heat.temperature.iter_mut().enumerate().for_each(|(k, t)| *t += (k * k) as f64);
    let more = grains.clone();
    let settings = Settings { conduction: Some(Conduction::Line), ..precise() };
    let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material], settings).unwrap();
    assert!(!dem.knows_contacts() && dem.carriers().count() == 0);
    dem.step(1e-3, &Load::default());
    let seen = |dem: &Dem<2>| {
        let id = |k: u32| dem.particles.id[k as usize];
        let all = dem.carriers().map(|(contact, heat)| {
            let other = if let Partner::Grain(k) = contact.partner { Some(id(k)) } else { None };
            (id(contact.grain), other, contact.force[1], heat)
        });
        all.collect::<Vec<_>>()
    };
    let before = seen(&dem);
    assert_eq!(before.len(), 5);
    dem.retain(&[true, false, true, true, true]);
    let mut expected = before.clone();
    expected.retain(|(a, b, ..)| *a != 1 && *b != Some(1));
    assert_eq!((seen(&dem), expected.len()), (expected.clone(), 3));
    assert!(dem.knows_contacts() && dem.stress().coordination.iter().sum::<u32>() == 5);
    let mut one = more.clone();
    one.retain(&[false, false, false, false, true]);
    (one.position[0], one.id[0]) = (v(3.0, 0.5), 9);
    dem.add(one).unwrap();
    assert_eq!(seen(&dem), expected);
    dem.step(1e-3, &Load::default());
    assert!(seen(&dem).iter().any(|(a, ..)| *a == 9), "the one on the floor has a contact");
    let state = dem.state();
    dem.restore(state.clone()).unwrap();
    assert!(dem.knows_contacts(), "a scheme that comes back to a state has seen the contacts of its trial");
    dem.retain(&[true, true, false, false, false]);
    dem.restore(state).unwrap();
    assert!(!dem.knows_contacts() && dem.contacts().count() == 0);
}

/// A temperature that is no number was taken for one that agrees.
#[test]
fn a_temperature_that_is_no_number_is_not_solved() {
    let material = conducting();
    let grains = discs(vec![v(0.0, 0.5), v(0.0, 1.5)], 0.5, &material);
    let grains = grains.heated(300.0, std::slice::from_ref(&material)).unwrap();
    let settings = Settings { conduction: Some(Conduction::Line), ..precise() };
    let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material], settings).unwrap();
    dem.particles.heat.as_mut().unwrap().temperature[1] = f64::NAN;
    assert!(!dem.step(1e-3, &Load::default()).converged);
}

/// Conduction that was switched off after a grain had left went on with the heats of the step before.
#[test]
fn conduction_ends_where_it_is_switched_off_after_grains_left() {
    let material = conducting();
    for leaves in [false, true] {
        let grains = discs((0..3).map(|k| v(0.0, 0.5 + f64::from(k))).collect(), 0.5, &material);
        let mut grains = grains.heated(300.0, std::slice::from_ref(&material)).unwrap();
        grains.heat.as_mut().unwrap().temperature[1] = 400.0;
        let settings = Settings { conduction: Some(Conduction::Line), ..precise() };
        let mut dem = Dem::new(grains, vec![floor(0.0)], vec![material.clone()], settings.clone()).unwrap();
        dem.step(1e-3, &Load::default());
        assert!(dem.contact_heat()[0] > 0.0, "{:?}", dem.contact_heat());
        if leaves {
            dem.retain(&[true, true, false]);
        }
        let temperature = dem.particles.heat.clone().unwrap().temperature;
        let off = Settings { conduction: None, ..settings };
        dem.change(vec![floor(0.0)], vec![material.clone()], off).unwrap();
        dem.step(1e-3, &Load::default());
        assert!(dem.contact_heat().iter().all(|q| *q == 0.0), "{:?}", dem.contact_heat());
        assert_eq!(dem.particles.heat.as_ref().unwrap().temperature, temperature);
    }
}
