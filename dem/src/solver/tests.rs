//! Sweeps in single precision beside those in double, contact by contact in the same order.

use super::SCHEDULE;
use super::batches::{Exact, TileBatches};
use super::lanes::Portable;
use super::sweep::{own, relax};
use super::{Problem, relative};
use crate::Vector;
use crate::contact::{Contact, Coulomb, Frictionless, Law};
use crate::momentum::Momentum;
use crate::rolling::Rolling;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::array::from_fn;

/// A lattice of so many bodies along each axis, the lowest layer held, with random masses, velocities and gaps, some of
/// them cold and some with an impulse. Everything in it is far from 1.
fn lattice<L: Law, const D: usize>(along: usize, friction: f64) -> Problem<D> {
    let mut random = Pcg64::seed_from_u64(5);
    let (mass, speed) = (3e-9, 2e-4);
    let count = along.pow(D as u32);
    let digits = |k: usize| from_fn::<usize, D, _>(|a| k / along.pow(a as u32) % along);
    let mut problem = Problem { friction: L::FRICTION, ..Problem::default() };
    for k in 0..count {
        let place = Vector::from_fn(|a, _| digits(k)[a] as f64 + 0.2 * random.random::<f64>());
        problem.position.push(place);
        problem.radius.push(0.5);
        let mobility =
            if digits(k)[D - 1] == 0 { 0.0 } else { 1.0 / (mass * (1.0 + random.random::<f64>())) };
        problem.bodies.push(&Vector::from_fn(|_, _| speed * (random.random::<f64>() - 0.7)), mobility);
        if L::SPIN {
            problem.bodies.push_spin(speed * (random.random::<f64>() - 0.5), 2.0 * mobility);
        }
    }
    for i in 0..count {
        for axis in (0..D).filter(|axis| digits(i)[*axis] + 1 < along) {
            let j = i + along.pow(axis as u32);
            let mobility = problem.bodies.mobility(i) + problem.bodies.mobility(j);
            if mobility == 0.0 {
                continue;
            }
            let way: Vector<D> = problem.position[j] - problem.position[i];
            let normal = way.normalize();
            let spin = |i| if L::SPIN { problem.bodies.spin_mobility(i) } else { 0.0 };
            let impulse = mass * speed * (random.random::<f64>() - 0.3).max(0.0);
            problem.contacts.push(Contact {
                normal,
                impulse: normal * impulse,
                bias: speed * (random.random::<f64>() - 0.4),
                mass_n: 1.0 / mobility,
                mass_t: 1.0 / (mobility + spin(i) + spin(j)),
                friction,
                i: i as u32,
                j: j as u32,
            });
            let cohesion = if L::COHESION { 0.3 * mass * speed * random.random::<f64>() } else { 0.0 };
            problem.cohesion.push(cohesion);
            if L::ROLLING {
                let slots = [i as u32, j as u32];
                problem.rolling.push(Rolling::new(&problem.bodies, slots, [0.5; 2], 0.0, 0.1));
            }
        }
    }
    problem.tiles.starts = vec![0, problem.contacts.len() as u32];
    problem.tiles.colours = vec![0, 1];
    problem.first_across = problem.contacts.len();
    problem.apply_impulses();
    problem
}

/// Sweeps in double precision over the contacts in an order.
fn in_double<L: Law, const D: usize>(problem: &mut Problem<D>, order: &[usize], sweeps: usize) {
    let (contacts, rolling) = (problem.contacts.len(), problem.rolling.len());
    let mut last: Vec<_> = problem.contacts.iter().map(|c| c.impulse).collect();
    let mut last_rolling = vec![0.0; rolling];
    let mut last_state = problem.bodies.state();
    let mut bounds: Vec<f64> = vec![];
    let mut pace = Momentum::default();
    for sweep in 0..sweeps {
        if sweep >= SCHEDULE.lagging {
            let bound = |problem: &Problem<D>, k: usize| {
                let c = &problem.contacts[k];
                c.friction * (c.impulse.dot(&c.normal) + problem.cohesion[k])
            };
            match bounds.is_empty() {
                true => bounds.extend((0..contacts).map(|k| bound(problem, k))),
                false => (0..contacts).for_each(|k| {
                    bounds[k] += f64::from(SCHEDULE.follow) * (bound(problem, k) - bounds[k]);
                }),
            }
        }
        let beta = pace.beta;
        for (i, (v, s)) in problem.bodies.state().into_iter().enumerate() {
            let (before, surface) = std::mem::replace(&mut last_state[i], (v, s));
            problem.bodies.set_velocity(i, &(v + (v - before) * beta));
            if L::SPIN {
                problem.bodies.set_surface(i, s + (s - surface) * beta);
            }
        }
        let (mut change, mut turn) = (0.0, 0.0);
        for &k in order {
            let c = problem.contacts[k];
            let start = c.impulse + (c.impulse - last[k]) * beta;
            last[k] = c.impulse;
            let u = relative::<L, D>(&problem.bodies, &c);
            let cohesion = problem.cohesion[k];
            let bound = if c.friction > SCHEDULE.strong { bounds.get(k).copied() } else { None };
            let impulse = if L::ROLLING {
                let r = &problem.rolling[k];
                let before = r.impulse.get();
                let begun = before + (before - last_rolling[k]) * beta;
                last_rolling[k] = before;
                let speed = r.speed(&problem.bodies, c.i, c.j);
                let (impulse, q) = c.solve_rolling::<L>((&start, &u), cohesion, bound, r, [begun, speed]);
                r.impulse.set(q);
                r.turn(&problem.bodies, c.i, c.j, q - begun);
                change += (q - begun).powi(2);
                turn -= (q - begun) * (q - before);
                impulse
            } else {
                c.solve::<L>(&start, &u, cohesion, bound)
            };
            let step = impulse - start;
            change += step.norm_squared();
            turn -= step.dot(&(impulse - c.impulse));
            problem.contacts[k].impulse = impulse;
            let (i, j) = (c.i as usize, c.j as usize);
            match L::SPIN {
                true => problem.bodies.push_apart::<true>(i, j, &c.normal, &step),
                false => problem.bodies.push_apart::<false>(i, j, &c.normal, &step),
            }
        }
        pace.update(change, turn);
    }
}

/// Energy of the difference of the velocities of two problems over that of what one has changed since its start.
fn apart<L: Law, const D: usize>(a: &Problem<D>, b: &Problem<D>, start: &[(Vector<D>, f64)]) -> f64 {
    let (mut error, mut changed) = (0.0, 0.0);
    for (i, before) in start.iter().enumerate().filter(|(i, _)| a.bodies.mobility(*i) > 0.0) {
        let mass = 1.0 / a.bodies.mobility(i);
        error += mass * (a.bodies.velocity(i) - b.bodies.velocity(i)).norm_squared();
        changed += mass * (a.bodies.velocity(i) - before.0).norm_squared();
        if L::SPIN {
            error += 0.5 * mass * (a.bodies.surface(i) - b.bodies.surface(i)).powi(2);
        }
    }
    error / changed
}

/// Sweeps in runs of 30 and in double precision, and how far they are apart after each number of sweeps.
fn both<L: Law, const D: usize>(along: usize, friction: f64, numbers: &[usize]) -> Vec<f64> {
    let apart_after = |sweeps: usize| {
        let [mut single, mut double] = [lattice::<L, D>(along, friction), lattice::<L, D>(along, friction)];
        let start = double.bodies.state();
        single.start_batches();
        let mut pace = single.sleep(true);
        single.wake_all();
        for run in (0..sweeps).step_by(30) {
            single.sweep::<L>(run..sweeps.min(run + 30), friction > SCHEDULE.strong, &mut pace);
        }
        in_double::<L, D>(&mut double, &own(&mut single.batches).order(), sweeps);
        apart::<L, D>(&double, &single, &start)
    };
    numbers.iter().map(|sweeps| apart_after(*sweeps)).collect()
}

fn with_law<L: Law, const D: usize>(along: usize, friction: f64) {
    let numbers = [1, 24, 54, 120, 3000];
    let found = both::<L, D>(along, friction, &numbers);
    for (sweeps, apart) in numbers.iter().zip(&found) {
        // Sweep by sweep to the rounding of single precision, and at the end to that of double. In space friction that
        // slides is turned into its direction in single precision, sweep by sweep.
        let most: f64 = if *sweeps == 3000 && D == 2 { 1e-11 } else { 1e-5 };
        assert!(*apart <= most * most, "friction {friction}, D = {D}: {found:?}");
    }
}

#[test]
fn sweeps_in_single_precision_are_those_in_double() {
    with_law::<Frictionless, 2>(9, 0.0);
    with_law::<Coulomb<false, false>, 2>(9, 0.4);
    with_law::<Coulomb<true, false>, 2>(9, 0.4);
    with_law::<Coulomb<true, true>, 2>(9, 0.4);
    with_law::<Coulomb<true, true, true>, 2>(9, 0.4);
    with_law::<Coulomb<true, false>, 2>(9, 3.0);
}

#[test]
fn they_are_so_in_space() {
    with_law::<Frictionless, 3>(4, 0.0);
    with_law::<Coulomb<false, false>, 3>(4, 0.4);
    with_law::<Coulomb<false, true>, 3>(4, 0.4);
}

#[test]
fn the_cost_tells_contacts_that_are_swept_from_those_that_sleep() {
    type L = Coulomb<true, false>;
    let mut problem = lattice::<L, 2>(9, 0.4);
    let contacts = problem.contacts.len();
    problem.start_batches();
    let mut pace = problem.sleep(true);
    problem.sweep::<L>(0..7, false, &mut pace);
    problem.wake_all();
    problem.sweep::<L>(7..30, false, &mut pace);
    let cost = &problem.cost;
    assert_eq!((cost.sweeps, cost.asleep, cost.relaxations), (30, 7 * contacts, 23 * contacts));
    assert!(cost.sweeps_s > 0.0 && cost.search_s + cost.measures_s + cost.corrections_s == 0.0);
}

/// The batches of all contacts of a lattice, at the start of a run.
fn batches<L: Law, const D: usize>(along: usize, friction: f64) -> (TileBatches<D>, usize) {
    let mut problem = lattice::<L, D>(along, friction);
    problem.start_batches();
    problem.sleep(true);
    problem.start_increments::<L>();
    let Problem { bodies, contacts, cohesion, rolling, increments, .. } = &problem;
    let exact = Exact { bodies, cohesion, rolling };
    let mut batches = TileBatches::default();
    batches.build(contacts, &exact, increments);
    batches.begin::<L>(contacts, &exact, &increments.units());
    (batches, contacts.len())
}

#[test]
fn contacts_of_a_batch_share_no_body() {
    // More batches than a window has, and fewer.
    for along in [5, 30] {
        let (batches, count) = batches::<Coulomb<true, false>, 2>(along, 0.4);
        assert_eq!(batches.batches.len() > 64, along == 30);
        let mut order = batches.order();
        for batch in &batches.batches {
            let mut bodies: Vec<u32> = batch.bodies.iter().flatten().copied().collect();
            bodies.retain(|body| (*body as usize) < batches.bodies.len());
            let count = bodies.len();
            bodies.sort_unstable();
            bodies.dedup();
            assert_eq!(bodies.len(), count);
        }
        order.sort_unstable();
        assert!(order.into_iter().eq(0..count), "each contact is in one batch");
    }
}

/// Whether vector units leave the same bits as any processor does, after some sweeps with momentum.
#[cfg(target_arch = "x86_64")]
fn same_bits<L: Law, const D: usize>(friction: f64) {
    use super::lanes::Avx;
    let Some(unit) = pulp::x86::V3::try_new() else { return };
    let [mut fast, mut slow] = [(); 2].map(|()| batches::<L, D>(5, friction).0);
    let mut bodies = [(); 2].map(|()| vec![[0.0_f32; 4]; fast.bodies.len() + 1]);
    for beta in [0.0, 0.3, 0.9, 0.95] {
        let [a, b] = &mut bodies;
        let sums = relax::<Avx, L, D, false>(unit, &mut fast, a, beta);
        assert_eq!(sums, relax::<Portable, L, D, false>((), &mut slow, b, beta));
        let bits = |w: &[[f32; 4]]| w.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(a), bits(b));
    }
    assert!(bodies[0].iter().flatten().any(|w| *w != 0.0), "nothing moves");
}

#[cfg(target_arch = "x86_64")]
#[test]
fn sweeps_have_the_same_bits_without_vector_units() {
    same_bits::<Frictionless, 2>(0.0);
    same_bits::<Coulomb<true, true>, 2>(0.4);
    same_bits::<Coulomb<true, true, true>, 2>(0.4);
    same_bits::<Coulomb<false, true>, 3>(0.4);
}
