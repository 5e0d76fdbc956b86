//! Overlaps are taken back.
//!
//! Contacts that are not solved exactly close a little further than their gaps. The overlaps that this leaves are
//! taken back by velocities of their own: the same contact problem is solved once more, from the impulses that it
//! has, with the condition that deep overlaps become shallow within the sub-step, u_n + gap/h >= 0 up to what may
//! stay. What that adds to the velocities moves the grains in this sub-step and is forgotten, so that repairing a
//! penetration makes no kinetic energy, no impulse and no heat.

use crate::bodies::Bodies;
use crate::scene::Scene;
use crate::solver::{Grains, Outcome, Problem, Stopping};
use crate::space::Vector;

/// Share of the energy of the velocities that take overlaps back which their error may have.
const REPAIRED: f64 = 0.1;
/// Sweeps at most for it: what is left is taken back in the sub-steps that follow.
const REPAIR_SWEEPS: usize = 100;
/// Overlap, as a share of the smaller radius, from which overlaps are taken back, and the part of it that stays.
/// Every repair lifts what lies above, and opens and closes other contacts: if it took back what contacts may close by
/// in one sub-step, large beds, where one of them always does, would never rest.
const DEEP: f64 = 7e-3;
pub(crate) const LEFT: f64 = 3.5e-3;

/// Whether there are deep overlaps.
pub(crate) fn needed<const D: usize>(problem: &Problem<D>) -> bool {
    problem.deepest_overlap() > DEEP
}

/// Velocities that take overlaps back, beside those of the bodies, m/s by slot; none if they would not help. The
/// problem is left as it was.
pub(crate) fn repair<const D: usize>(
    problem: &mut Problem<D>,
    scene: &Scene<D>,
    grain_of: &[u32],
    stopping: &Stopping,
) -> (Vec<Vector<D>>, Outcome) {
    let state = problem.bodies.state();
    let impulses: Vec<Vector<D>> = problem.contacts.iter().map(|c| c.impulse).collect();
    let stopping = Stopping {
        tolerance: REPAIRED,
        max_sweeps: REPAIR_SWEEPS.min(stopping.max_sweeps),
        short_runs: stopping.short_runs.map(|_| 0),
        settling_sweeps: 0,
        rest: 0.0,
        forced: 0.0,
        closing: f64::INFINITY,
        interior: false,
        ..*stopping
    };
    let free = |bodies: &Bodies<D>| scene.set_free(grain_of, bodies);
    let pushed = |bodies: &Bodies<D>| {
        let added = |slot: usize| (bodies.velocity(slot) - state[slot].0).norm_squared();
        let moving = (0..grain_of.len()).filter(|slot| bodies.mobility(*slot) > 0.0);
        moving.map(|slot| 0.5 * added(slot) / bodies.mobility(slot)).sum()
    };
    let biases = problem.ask_overlaps_back(LEFT, scene.h);
    let deepest = problem.deepest(scene.h);
    let grains = Grains { free: &free, pushed: &pushed, changed: &|_| 0.0, moving: &|_, _| 1.0 };
    let outcome = problem.solve(&stopping, &grains);
    // What is not solved may push grains deeper into others, or far away: then the overlaps stay.
    let helps = problem.deepest(scene.h) <= deepest.max(DEEP);
    let repair = match helps {
        true => (0..grain_of.len()).map(|slot| problem.bodies.velocity(slot) - state[slot].0).collect(),
        false => vec![],
    };
    problem.bodies.set_state(&state);
    problem.contacts.iter_mut().zip(&impulses).for_each(|(c, p)| c.impulse = *p);
    problem
        .overlaps
        .iter()
        .zip(&biases)
        .for_each(|((k, _), bias)| problem.contacts[*k as usize].bias = *bias);
    (repair, outcome)
}
