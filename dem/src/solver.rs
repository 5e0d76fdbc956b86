//! Nonlinear Gauss-Seidel over coloured tiles: sweep, residual, stopping.
//!
//! A solve is a series of runs of sweeps with momentum over the tiles that have something left to do ([`awake`]). After
//! each run the kinetic energy of the velocity error is estimated: what varies from grain to grain by the natural map,
//! what is smooth by the energy that corrections over long distances would take away ([`Coarse`]), and what neither
//! sees by how sweeps still change the velocities ([`trend`]). The problem is solved when that energy is below a share
//! of the energy of what the sub-step changes of the velocities (at rest, of a part of the energy that the contacts
//! have to do with), and no contact closes so fast that it would become an overlap that matters. Between runs the
//! corrections are made: the number of sweeps then hardly depends on the height of a stack.
//!
//! Sweeps take eight contacts at once in single precision ([`batches`]), as changes of impulses and velocities that are
//! known in double precision between the runs; a last sweep in double precision leaves single contacts exact.
//!
//! **What was compared.** Stacks of N discs, and random beds of 8,000 to 40,000 discs with friction, from a cold start.
//! The column of the bed has the energy of the velocity error, over that of a free fall, after so many sweeps:
//!
//! | method | stacks | bed of 400 rows |
//! |---|---|---|
//! | plain sweeps (`acceleration = "none"`) | cos^2(pi/(2 N)) a sweep: 24,000 for 80 discs | not reached |
//! | sweeps with momentum | N^0.9 sweeps | 0.3 after 1000 |
//! | the same, and corrections by factors that vary slowly (this one) | 354 sweeps for 1600 discs | 0.47, 0.18, 0.036, 2.5e-4 after 250, 500, 1000, 2000 |
//! | impulses handed down from grain to grain as a first guess | exact | 0.03 after 54 sweeps, but then no correction may follow, and the bed sinks 3.5 times as far as it should |
//! | sweeps on levels of rigid aggregates | exact in one cycle | stalls above 1: small blocks are floppy |
//! | semi-smooth Newton with a stiff penalty | a few steps | line search takes steps of 0.01 |
//! | interior points with a sparse Cholesky factor | 14 factors for 100 rows | more than 45 factors of a second each |
//!
//! **Sub-steps** are those of all grains, although often only some grains fly. Tried in a bed of 97,000 discs of which
//! a few hundred fly: one step of all, and sub-steps only within four contacts of those that fly. The one step costs
//! more than the four sub-steps do (350 to 1,000 sweeps, where four times 40 to 70 suffice), because what a bed in
//! motion changes of its contacts grows with the square of the step.
//!
//! All sums run over one binary tree of tiles that depends on their number only, and tiles of one colour share no
//! grain: the result is the same bit for bit on any number of threads, and without threads.

use crate::bodies::Bodies;
use crate::coarse::Coarse;
use crate::contact::{Contact, Coulomb, Frictionless, Law};
use crate::interior::{self, Free, Friction};
use crate::rolling::Rolling;
use crate::settings::Cost;
use crate::space::Vector;
use awake::Awake;
use batches::TileBatches;
pub(crate) use constants::{SCHEDULE, SOLVED};
use increments::Increments;
use runs::Measure;
use std::sync::Mutex;
pub(crate) use tiles::Tiles;
use tiles::{NOTHING, over_colours};
use trend::Trend;

mod awake;
mod batches;
mod constants;
mod increments;
mod lanes;
mod residual;
mod runs;
mod sweep;
#[cfg(test)]
mod tests;
mod tiles;
mod trend;

/// The contact problem of one sub-step.
#[derive(Default)]
pub(crate) struct Problem<const D: usize> {
    pub bodies: Bodies<D>,
    /// Centres and radii of the grains, in the order of the bodies.
    pub position: Vec<Vector<D>>,
    pub radius: Vec<f64>,
    pub contacts: Vec<Contact<D>>,
    /// Contacts whose grains overlap by more than may stay, and their gap over the smaller radius (below 0).
    pub overlaps: Vec<(u32, f64)>,
    /// Cohesion impulse of each contact, N s; empty without cohesion.
    pub cohesion: Vec<f64>,
    /// Resistance to rolling of each contact; empty without.
    pub rolling: Vec<Rolling>,
    pub tiles: Tiles,
    /// The first contact across periodic sides: those have no place between the others.
    pub first_across: usize,
    pub friction: bool,
    awake: Awake,
    /// The contacts of each tile as sweeps see them, and what sweeps have changed of the velocities.
    batches: Vec<Mutex<TileBatches<D>>>,
    increments: Increments,
    /// What has been spent since this was taken last.
    pub cost: Cost,
    trend: Trend<D>,
    /// The grains that contacts push and that do not rest, when the problem was near its solution last.
    pub moving: Vec<bool>,
    /// Impulses before the last correction over long distances.
    uncorrected: Impulses<D>,
    coarse: Coarse<D>,
}

/// Impulses of all contacts, and those of their resistance to rolling, N s.
#[derive(Default, PartialEq)]
pub(crate) struct Impulses<const D: usize> {
    contacts: Vec<Vector<D>>,
    rolling: Vec<f64>,
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopping {
    /// Share of the energy of the changes of the velocities which that of their error may have.
    pub tolerance: f64,
    pub max_sweeps: usize,
    /// Sweeps at most that go on after that, towards velocities that settle.
    pub settling_sweeps: usize,
    /// Share of what forces bring below which a velocity counts as zero.
    pub rest: f64,
    /// Runs of sweeps before corrections over long distances begin: what is solved until then has nothing to gain.
    /// None: there are no corrections.
    pub short_runs: Option<usize>,
    pub momentum: bool,
    /// Energy of the velocities that forces give in the sub-step, J.
    pub forced: f64,
    /// Smallest scale of energies, J.
    pub floor: f64,
    /// Energy below which errors mean nothing, J.
    pub negligible: f64,
    /// Length of the sub-step, s, and whether it is the whole step.
    pub step: f64,
    pub whole: bool,
    /// Speed at which a contact may close beyond its gap over the smaller radius, 1/s.
    pub closing: f64,
    /// Whether to go on by the interior-point method where sweeps do not suffice.
    pub interior: bool,
}

/// What the problem does not hold of its grains.
pub(crate) struct Grains<'a, const D: usize> {
    /// Sets the velocities without contacts. (Taking impulses back from velocities would leave nothing of them where
    /// sweeps have diverged.)
    pub free: &'a dyn Fn(&Bodies<D>),
    /// Energy of what the contacts have changed, J.
    pub pushed: &'a dyn Fn(&Bodies<D>) -> f64,
    /// Energy of the changes of the velocities that contacts take part in since the start of the sub-step, J.
    pub changed: &'a dyn Fn(&Bodies<D>) -> f64,
    /// Marks the grains that contacts push and that do not rest; their share of the energy that forces bring.
    pub moving: &'a dyn Fn(&Bodies<D>, &mut Vec<bool>) -> f64,
}

/// What problems lack in which grains would pass into each other, beyond any error of energies.
const PASSES: f64 = 1e30;

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Outcome {
    pub sweeps: usize,
    /// Contacts relaxed; a look or a measure counts as many as are relaxed in its time.
    pub work: usize,
    /// Energy of the velocity error over that of what the contacts have to do with.
    pub error: f64,
    /// Energy of the changes of the velocities in the sub-step over the same.
    changed: f64,
    /// Energy of the error, of what is smooth of it where that was measured, what may be left of it, and what may be
    /// when it has settled, J.
    energy: f64,
    smooth: f64,
    goal: f64,
    settles: f64,
    /// Whether nearly all grains rest.
    rest: bool,
    /// Relative natural map.
    pub residual: f64,
    /// Fastest closing of a contact beyond its gap, over what is allowed.
    pub closing: f64,
}

impl Outcome {
    /// Solved up to 1. No grain may pass through another: closing counts first.
    fn excess(&self, stopping: &Stopping) -> f64 {
        if self.closing > 1.0 { PASSES * self.closing } else { self.share() / stopping.tolerance }
    }

    pub fn solved(&self, stopping: &Stopping) -> bool {
        self.excess(stopping) <= 1.0
    }
}

/// Share of the bound of friction up to which a contact sticks.
const STICKS: f64 = 1.0 - 1e-9;

/// Share of its cohesion that rounding may leave of what a contact presses with that gives way.
const ROUNDING: f64 = 1e-12;

/// Contacts or bodies above which tiles go to several threads: a fork costs some microseconds, a contact ten
/// nanoseconds.
pub(crate) const FORK: usize = 10_000;

/// Bodies up to which the interior-point method goes on where grains pass into each other, and where only forces are
/// not solved. Its factors take more than linear time: up to the second it costs about as much as the sweeps did, up
/// to the first seconds.
const CLOSING_BODIES: usize = 10_000;
const UNSOLVED_BODIES: usize = 1000;

impl<const D: usize> Problem<D> {
    /// Solves with the law that the scene needs, chosen once.
    pub fn solve(&mut self, stopping: &Stopping, grains: &Grains<D>) -> Outcome {
        if !self.rolling.is_empty() {
            return match self.cohesion.is_empty() {
                true => self.solve_with::<Coulomb<true, false, true>>(stopping, grains),
                false => self.solve_with::<Coulomb<true, true, true>>(stopping, grains),
            };
        }
        match (self.friction, self.bodies.spins(), !self.cohesion.is_empty()) {
            (false, _, false) => self.solve_with::<Frictionless>(stopping, grains),
            (true, false, false) => self.solve_with::<Coulomb<false, false>>(stopping, grains),
            (true, true, false) => self.solve_with::<Coulomb<true, false>>(stopping, grains),
            (_, false, true) => self.solve_with::<Coulomb<false, true>>(stopping, grains),
            (_, true, true) => self.solve_with::<Coulomb<true, true>>(stopping, grains),
        }
    }

    /// Sweeps; what they leave goes to the interior-point method, and what that leaves to sweeps again.
    fn solve_with<L: Law>(&mut self, stopping: &Stopping, grains: &Grains<D>) -> Outcome {
        let first = self.sweeps::<L>(stopping, grains);
        let most = if first.closing > 1.0 { CLOSING_BODIES } else { UNSOLVED_BODIES };
        if first.solved(stopping) || !stopping.interior || self.bodies.len() > most {
            return first;
        }
        let mut judge =
            |problem: &mut Self| problem.judge::<L>(stopping, grains, Measure::Always, 0.0).excess(stopping);
        let free = Free::new(self, grains);
        let [mut swept, mut best] = [Impulses::default(), Impulses::default()];
        self.keep_impulses(&mut swept);
        // The judge does not see how much sweeps still change, which those of the sweeps lack too.
        let mut lacks = first.excess(stopping);
        for friction in [Friction::Follows, Friction::Held, Friction::Out] {
            // Forces may stay unsolved; that no grain closes may not.
            if friction == Friction::Follows || L::FRICTION && lacks > PASSES {
                lacks = interior::solve(self, &free, friction, lacks, &mut judge);
            }
        }
        self.keep_impulses(&mut best);
        let (mut outcome, mut again) = (if best == swept { Some(first) } else { None }, 0);
        if lacks > 1.0 {
            let state = self.bodies.state();
            let second = self.sweeps::<L>(stopping, grains);
            again = second.sweeps;
            if free.judge(self, &mut judge) >= lacks {
                self.put_impulses(&best);
                self.bodies.set_state(&state);
            } else {
                outcome = Some(second);
            }
        }
        let outcome = outcome.unwrap_or_else(|| self.judge::<L>(stopping, grains, Measure::Always, 0.0));
        Outcome { sweeps: first.sweeps + again, work: first.work, ..outcome }
    }

    /// The largest share of its smaller radius by which a contact closes beyond its gap in a sub-step.
    pub fn deepest(&self, h: f64) -> f64 {
        self.contacts.iter().fold(0.0, |most: f64, c| {
            let u = self.bodies.velocity(c.j as usize) - self.bodies.velocity(c.i as usize);
            most.max(-(u.dot(&c.normal) + c.bias) * h / smaller(&self.radius, c))
        })
    }

    /// Makes the overlaps beyond `left`, a share of the smaller radius, part of the problem: within `h` seconds they
    /// must be gone. Returns the biases that their contacts had.
    pub fn ask_overlaps_back(&mut self, left: f64, h: f64) -> Vec<f64> {
        let before = self.overlaps.iter().map(|(k, _)| self.contacts[*k as usize].bias).collect();
        for k in 0..self.overlaps.len() {
            let (contact, gap) = self.overlaps[k];
            let speed = (gap + left) * smaller(&self.radius, &self.contacts[contact as usize]) / h;
            let bias = &mut self.contacts[contact as usize].bias;
            *bias = bias.min(speed);
        }
        before
    }

    /// Copies all impulses.
    pub fn keep_impulses(&self, kept: &mut Impulses<D>) {
        kept.contacts.clear();
        crate::reserve(&mut kept.contacts, self.contacts.len());
        kept.contacts.extend(self.contacts.iter().map(|c| c.impulse));
        kept.rolling.clear();
        crate::reserve(&mut kept.rolling, self.rolling.len());
        kept.rolling.extend(self.rolling.iter().map(|r| r.impulse.get()));
    }

    /// Puts copied impulses back.
    pub fn put_impulses(&mut self, kept: &Impulses<D>) {
        self.contacts.iter_mut().zip(&kept.contacts).for_each(|(c, p)| c.impulse = *p);
        self.rolling.iter().zip(&kept.rolling).for_each(|(r, q)| r.impulse.set(*q));
    }

    /// The deepest overlap at the start of the sub-step as a share of the smaller radius.
    pub fn deepest_overlap(&self) -> f64 {
        self.overlaps.iter().fold(0.0, |most, (_, gap)| most.max(-gap))
    }

    /// Whether friction is at its limit.
    #[inline(always)]
    pub fn slides<L: Law>(&self, k: usize, c: &Contact<D>) -> bool {
        L::FRICTION && {
            let rubbed = c.impulse - c.normal * c.impulse.dot(&c.normal);
            rubbed.norm() >= STICKS * c.friction * self.pressed(k, c)
        }
    }

    /// Whether resistance to rolling is at its limit.
    #[inline(always)]
    pub fn gives_way(&self, k: usize, c: &Contact<D>) -> bool {
        let r = &self.rolling[k];
        r.impulse.get().abs() >= STICKS * r.most(self.pressed(k, c))
    }

    /// What a contact presses with, cohesion included, N s; 0 for one that gives way, which pulls with its cohesion but
    /// for rounding.
    #[inline(always)]
    pub fn pressed(&self, k: usize, c: &Contact<D>) -> f64 {
        let cohesion = self.cohesion.get(k).copied().unwrap_or(0.0);
        let pressed = c.impulse.dot(&c.normal) + cohesion;
        if pressed > ROUNDING * cohesion { pressed } else { 0.0 }
    }

    /// Whether corrections over long distances take a contact: one that presses, and lies between its grains. One
    /// across periodic sides keeps its impulse.
    #[inline(always)]
    pub fn is_corrected(&self, k: usize, c: &Contact<D>) -> bool {
        k < self.first_across && self.pressed(k, c) > 0.0
    }

    /// Where the surface of the first grain is at a contact.
    #[inline(always)]
    pub fn point(&self, c: &Contact<D>) -> Vector<D> {
        self.position[c.i as usize] + c.normal * self.radius[c.i as usize]
    }

    /// The corners of the box around all contacts.
    fn corners(&self) -> [Vector<D>; 2] {
        let none = [Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY)];
        let placed = &self.contacts[..self.first_across.min(self.contacts.len())];
        placed.iter().map(|c| self.point(c)).fold(none, |[low, high], x| [low.inf(&x), high.sup(&x)])
    }

    /// Relative velocity at a contact, m/s.
    #[inline(always)]
    pub fn relative_at<L: Law>(&self, c: &Contact<D>) -> Vector<D> {
        relative::<L, D>(&self.bodies, c)
    }

    /// Adds all impulses to the velocities: the warm start, and the exact velocities at the end.
    pub fn apply_impulses(&mut self) {
        let (bodies, tiles, rolling) = (&self.bodies, &self.tiles, &self.rolling);
        let tile = |contacts: &mut [Contact<D>], _: &mut [Mutex<TileBatches<D>>], tile: usize| {
            if !rolling.is_empty() {
                for (c, r) in contacts.iter().zip(&rolling[tiles.contacts(tile)]) {
                    r.turn(bodies, c.i, c.j, r.impulse.get());
                }
            }
            for c in contacts.iter() {
                let (i, j) = (c.i as usize, c.j as usize);
                if bodies.spins() {
                    bodies.push_apart::<true>(i, j, &c.normal, &c.impulse);
                } else {
                    bodies.push_apart::<false>(i, j, &c.normal, &c.impulse);
                }
            }
            NOTHING
        };
        over_colours(&self.tiles, &mut self.contacts, &mut [], SCHEDULE.passes, tile);
    }
}

/// The smaller radius of a contact, m; walls have none.
#[inline(always)]
pub(crate) fn smaller<const D: usize>(radius: &[f64], c: &Contact<D>) -> f64 {
    let of = |slot: u32| radius.get(slot as usize).copied().unwrap_or(f64::INFINITY);
    of(c.i).min(of(c.j))
}

#[inline(always)]
fn relative<L: Law, const D: usize>(bodies: &Bodies<D>, c: &Contact<D>) -> Vector<D> {
    let (i, j) = (c.i as usize, c.j as usize);
    if L::SPIN { bodies.relative::<true>(i, j, &c.normal) } else { bodies.relative::<false>(i, j, &c.normal) }
}
