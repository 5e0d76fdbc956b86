//! Sweeps: each contact solved by itself, one after the other.

use super::tiles::{NOTHING, Sums, over_colours};
use super::{Problem, relative};
use crate::bodies::Bodies;
use crate::contact::{Contact, Law};
use crate::momentum::Momentum;
use crate::rolling::Rolling;
use crate::space::Vector;

/// Coefficient above which friction lags behind the normal impulse, sweeps after which it does, and the share of the
/// difference that a sweep makes up.
///
/// A sweep is no contraction when friction is strong: normal impulse and the bound mu p_n of the tangential one chase
/// each other round a cycle. With the bound held, the problem is convex and sweeps converge; so the bound follows
/// slowly. The share is measured, not derived: in beds with friction 10 the steps that stay unsolved are a quarter of
/// those without. Weak friction converges without.
pub(super) const STRONG: f64 = 1.0;
pub(super) const LAGGING: usize = 200;
const FOLLOW: f64 = 0.05;

impl<const D: usize> Problem<D> {
    /// A sweep, with momentum if there is a pace.
    pub(super) fn paced_sweep<L: Law>(&mut self, pace: &mut Option<Momentum>) {
        self.trend.count(&self.bodies);
        let Some(pace) = pace else {
            self.sweep::<L, false>(0.0);
            return;
        };
        self.extrapolate(pace.beta);
        let ([change, turn, ..], _) = self.sweep::<L, true>(pace.beta);
        pace.update(change, turn);
    }

    /// One pass over the contacts of all tiles that are awake; its sums.
    fn sweep<L: Law, const MOMENTUM: bool>(&mut self, beta: f64) -> Sums {
        let (bodies, cohesion, bounds, rolling) = (&self.bodies, &self.cohesion, &self.bounds, &self.rolling);
        let (tiles, awake, fork) = (&self.tiles, &self.awake.tiles, self.awake.fork());
        let tile = |contacts: &mut [Contact<D>], last: &mut [Vector<D>], tile: usize| {
            if !awake[tile] {
                return NOTHING;
            }
            let first = tiles.contacts(tile).start;
            let (mut change, mut turn) = (0.0, 0.0);
            for (k, c) in contacts.iter_mut().enumerate() {
                let lags = L::FRICTION && c.friction > STRONG;
                let bound = if lags { bounds.get(first + k).copied() } else { None };
                let cohesion = if L::COHESION { cohesion[first + k] } else { 0.0 };
                let before = c.impulse;
                let mut start = before;
                if MOMENTUM {
                    start += (before - last[k]) * beta;
                    last[k] = before;
                }
                if L::ROLLING {
                    let rolling = &rolling[first + k];
                    let rolled = rolling.impulse.get();
                    let mut start_rolling = rolled;
                    if MOMENTUM {
                        start_rolling += (rolled - rolling.last.get()) * beta;
                        rolling.last.set(rolled);
                    }
                    let (step, turned) =
                        relax_rolling::<L, D>(bodies, c, (&start, start_rolling), cohesion, bound, rolling);
                    change += step.norm_squared() + turned * turned;
                    if MOMENTUM {
                        turn -= step.dot(&(c.impulse - before)) + turned * (rolling.impulse.get() - rolled);
                    }
                    continue;
                }
                let step = relax::<L, D>(bodies, c, &start, cohesion, bound);
                change += step.norm_squared();
                if MOMENTUM {
                    turn -= step.dot(&(c.impulse - before));
                }
            }
            ([change, turn, 0.0, 0.0, 0.0, 0.0], 0.0)
        };
        over_colours(tiles, &mut self.contacts, &mut self.awake.last, fork, tile)
    }

    /// Moves the bounds of friction towards mu (p_n + c).
    pub(super) fn follow_bounds(&mut self) {
        let cohesion = |k: usize| self.cohesion.get(k).copied().unwrap_or(0.0);
        let bound = |k: usize, c: &Contact<D>| c.friction * (c.impulse.dot(&c.normal) + cohesion(k));
        if self.bounds.is_empty() {
            crate::reserve(&mut self.bounds, self.contacts.len());
            self.bounds.extend(self.contacts.iter().enumerate().map(|(k, c)| bound(k, c)));
        } else {
            for (k, (lagging, c)) in self.bounds.iter_mut().zip(&self.contacts).enumerate() {
                *lagging += FOLLOW * (bound(k, c) - *lagging);
            }
        }
    }
}

/// Solves one contact exactly from the impulse `start`, with friction up to `bound` if that lags, moves its two bodies,
/// and returns the change.
#[inline(always)]
fn relax<L: Law, const D: usize>(
    bodies: &Bodies<D>,
    c: &mut Contact<D>,
    start: &Vector<D>,
    cohesion: f64,
    bound: Option<f64>,
) -> Vector<D> {
    let u = relative::<L, D>(bodies, c);
    c.impulse = c.solve::<L>(start, &u, cohesion, bound);
    let change = c.impulse - start;
    if change.iter().any(|x| *x != 0.0) {
        let (i, j) = (c.i as usize, c.j as usize);
        if L::SPIN {
            bodies.push_apart::<true>(i, j, &c.normal, &change);
        } else {
            bodies.push_apart::<false>(i, j, &c.normal, &change);
        }
    }
    change
}

/// The same with resistance to rolling: from its impulse too, which changes as well. Returns both changes.
#[inline(always)]
fn relax_rolling<L: Law, const D: usize>(
    bodies: &Bodies<D>,
    c: &mut Contact<D>,
    (start, rolled): (&Vector<D>, f64),
    cohesion: f64,
    bound: Option<f64>,
    rolling: &Rolling,
) -> (Vector<D>, f64) {
    let u = relative::<L, D>(bodies, c);
    let speed = rolling.speed(bodies, c.i, c.j);
    let (impulse, q) = c.solve_rolling::<L>((start, &u), cohesion, bound, rolling, [rolled, speed]);
    c.impulse = impulse;
    rolling.impulse.set(q);
    let (change, turned) = (impulse - start, q - rolled);
    if change.iter().any(|x| *x != 0.0) {
        bodies.push_apart::<true>(c.i as usize, c.j as usize, &c.normal, &change);
    }
    if turned != 0.0 {
        rolling.turn(bodies, c.i, c.j, turned);
    }
    (change, turned)
}
