//! Batches: the contacts of a tile as sweeps see them, eight at once.
//!
//! A run of sweeps works on what it changes. With the impulses p0 and the velocities v0 at its start, rounded to single
//! precision from the exact ones, a contact is solved for the change d of its impulse and the changes w of the velocities:
//!
//! ```text
//!     u = H w + s,    s_n = H v0 + bias, s_t = H v0,
//!     d_n = max(-b_n, a_n - u_n / w_n),                    b_n = p0_n + c,
//!     d_t = a_t - u_t / w_t,  cut so that |p0_t + d_t| <= mu (b_n + d_n),
//! ```
//!
//! a being d with its momentum. At the end of the run d is added to the impulses in double precision, one at its bound is
//! put there exactly, and the velocities follow from what the impulses have changed. So what rounding leaves is relative
//! to what a run changes, and the next run takes it away: sweeps converge as in double precision. For the same reason
//! friction is cut by the room that p0_t leaves, and not by p0_t: in the plane
//!
//! ```text
//!     -(low + mu d_n) <= d_t <= up + mu d_n,               up = mu b_n - p0_t,   low = mu b_n + p0_t.
//! ```
//!
//! (In space friction that slides has a direction too, and keeps the rounding of it.)
//!
//! Impulses are in the frame of their contact, normal first. Contacts of a batch share no body; places that stay empty
//! move a body that nobody has.

use super::constants::SCHEDULE;
use super::increments::{Increments, NONE, Units};
use super::lanes::{LANES, Lanes};
use super::relative;
use crate::bodies::Bodies;
use crate::contact::{Contact, Law};
use crate::rolling::Rolling;
use crate::space::{Vector, tangent};
use std::array::from_fn;
use std::cell::RefCell;
use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;

/// Eight contacts.
#[derive(Clone)]
#[repr(C)]
pub(super) struct Batch<const D: usize> {
    /// Both bodies of each, as places in the list of the tile.
    pub bodies: [[u32; LANES]; 2],
    pub normal: [Lanes; D],
    /// d, and its value before the last sweep.
    pub change: [Lanes; D],
    pub last: [Lanes; D],
    /// s.
    pub speed: [Lanes; D],
    /// b_n; in the plane `low`, in space p0_t.
    pub base: [Lanes; D],
    /// In the plane `up`, in space mu b_n - |p0_t|.
    pub room: Lanes,
    /// 1 / w_n and 1 / w_t.
    pub mass: [Lanes; 2],
    /// 1/m and r^2/I of both bodies.
    pub mobility: [Lanes; 2],
    pub turning: [Lanes; 2],
    pub friction: Lanes,
}

/// What eight contacts that resist rolling have beside that: the law of [`Rolling`] for changes. Names as in [`Batch`].
#[derive(Clone)]
#[repr(C)]
pub(super) struct RollingBatch {
    pub change: Lanes,
    pub last: Lanes,
    pub speed: Lanes,
    /// What the impulse leaves to its bound, up and down.
    pub room: [Lanes; 2],
    pub share: [Lanes; 2],
    pub resistance: Lanes,
    /// w_t and w_tr.
    pub rub: Lanes,
    pub coupling: Lanes,
    /// 1 / w_r; w_r, w_tr and w_t over the determinant.
    pub mass: Lanes,
    pub inverse: [Lanes; 3],
}

/// The contacts of a tile that has been swept.
#[derive(Default)]
pub(super) struct TileBatches<const D: usize> {
    /// Bodies of its contacts.
    pub bodies: Vec<u32>,
    /// Places of the bodies that no tile before this one has.
    own: Vec<u32>,
    pub batches: Vec<Batch<D>>,
    /// Empty without resistance to rolling.
    pub rolling: Vec<RollingBatch>,
    /// How much more friction may reach than mu b_n once strong friction lags, in a run; empty before.
    pub lags: Vec<Lanes>,
    /// What it may reach, contact by contact, N s.
    bounds: Vec<f64>,
    /// Contacts of each batch, as numbers within the tile; [`NONE`] in empty places.
    contacts: Vec<[u32; LANES]>,
    built: bool,
    /// Whether momentum starts anew.
    fresh: bool,
}

/// What contacts have beside themselves, in double precision.
pub(super) struct Exact<'a, const D: usize> {
    pub bodies: &'a Bodies<D>,
    pub cohesion: &'a [f64],
    pub rolling: &'a [Rolling],
}

impl<const D: usize> Exact<'_, D> {
    /// That of some contacts, which then count from 0.
    pub fn of(&self, contacts: Range<usize>) -> Self {
        let cohesion = self.cohesion.get(contacts.clone()).unwrap_or_default();
        Self { bodies: self.bodies, cohesion, rolling: self.rolling.get(contacts).unwrap_or_default() }
    }
}

thread_local! {
    /// Scratch of [`TileBatches::build`].
    static TAKEN: RefCell<Vec<u64>> = const { RefCell::new(vec![]) };
}

impl<const D: usize> TileBatches<D> {
    /// Forgets the contacts.
    pub fn clear(&mut self) {
        self.built = false;
    }

    /// The contacts in the order in which sweeps take them.
    #[cfg(test)]
    pub fn order(&self) -> Vec<usize> {
        placed(&self.contacts).map(|(_, _, k)| k).collect()
    }

    /// Momentum starts anew.
    pub fn refresh(&mut self) {
        self.fresh = true;
    }

    /// Puts the contacts into batches, if that has not been done. Each goes to the first batch that has a place and
    /// neither of its bodies; a batch is out of reach when 64 have been begun after it.
    pub fn build(&mut self, contacts: &[Contact<D>], exact: &Exact<D>, increments: &Increments) {
        if !std::mem::replace(&mut self.built, true) {
            TAKEN.with_borrow_mut(|taken| self.fill(contacts, exact, increments, taken));
        }
    }

    /// `taken` says of each body which batches of a window of 64 have it.
    fn fill(
        &mut self,
        contacts: &[Contact<D>],
        exact: &Exact<D>,
        increments: &Increments,
        taken: &mut Vec<u64>,
    ) {
        self.fresh = true;
        self.lags.clear();
        self.bounds.clear();
        self.bodies.clear();
        self.contacts.clear();
        let mut batches = std::mem::take(&mut self.batches);
        batches.clear();
        taken.clear();
        // Batches of the window that have room, and the first one.
        let (mut open, mut first) = (0_u64, 0);
        let mut filled = [0_usize; 64];
        for (k, c) in contacts.iter().enumerate() {
            let [i, j] = [c.i, c.j].map(|body| {
                let place = &increments.places[body as usize];
                if place.load(Relaxed) == NONE {
                    place.store(self.bodies.len() as u32, Relaxed);
                    self.bodies.push(body);
                    taken.push(0);
                }
                place.load(Relaxed)
            });
            let [a, b] = [i as usize, j as usize];
            let mut free = open & !(taken[a] | taken[b]);
            if free == 0 {
                if self.contacts.len() == first + 64 {
                    first = self.contacts.len();
                    open = 0;
                    taken.fill(0);
                }
                free = 1 << (self.contacts.len() - first);
                open |= free;
                filled[free.trailing_zeros() as usize] = 0;
                self.contacts.push([NONE; LANES]);
                batches.push(Batch::empty());
            }
            let batch = free.trailing_zeros() as usize;
            let bit = 1_u64 << batch;
            (taken[a], taken[b]) = (taken[a] | bit, taken[b] | bit);
            let lane = filled[batch];
            filled[batch] += 1;
            if filled[batch] == LANES {
                open &= !bit;
            }
            self.contacts[first + batch][lane] = k as u32;
            let batch = &mut batches[first + batch];
            (batch.bodies[0][lane], batch.bodies[1][lane]) = (i, j);
            batch.fill(lane, c, exact, increments.units().mass);
        }
        // Empty places are behind the last body.
        let nobody = self.bodies.len() as u32;
        for (batch, contacts) in batches.iter_mut().zip(&self.contacts) {
            for lane in (0..LANES).filter(|lane| contacts[*lane] == NONE) {
                (batch.bodies[0][lane], batch.bodies[1][lane]) = (nobody, nobody);
            }
        }
        self.bodies.iter().for_each(|body| increments.places[*body as usize].store(NONE, Relaxed));
        self.batches = batches;
        self.rolling.clear();
        if !exact.rolling.is_empty() {
            self.rolling.resize(self.batches.len(), RollingBatch::empty());
            for (batch, lane, k) in placed(&self.contacts) {
                self.rolling[batch].fill(lane, &contacts[k], &exact.rolling[k], increments.units().mass);
            }
        }
    }

    /// Lists the bodies that no tile has had in this run.
    pub fn share_bodies(&mut self, increments: &Increments) {
        self.own.clear();
        let first = |body: u32| {
            let run = &increments.runs[body as usize];
            let first = run.load(Relaxed) != increments.run;
            run.store(increments.run, Relaxed);
            first
        };
        self.own.extend((0..).zip(&self.bodies).filter(|(_, body)| first(**body)).map(|(place, _)| place));
    }

    /// Copies what a run has changed of the velocities of the bodies, and behind them of nobody. Those that no tile has
    /// had before start a sweep from w + beta (w - last w), to match the changes d + beta (d - last d) of the impulses.
    pub fn take(&self, increments: &Increments, beta: Option<f32>, bodies: &mut Vec<[f32; 4]>) {
        bodies.clear();
        bodies.extend(self.bodies.iter().map(|body| increments.now[*body as usize].get()));
        bodies.push([0.0; 4]);
        let Some(beta) = beta else { return };
        for place in self.own.iter().map(|place| *place as usize) {
            let last = &increments.last[self.bodies[place] as usize];
            let (w, before) = (bodies[place], last.get());
            last.set(&w);
            bodies[place] = from_fn(|a| beta.mul_add(w[a] - before[a], w[a]));
        }
    }

    /// Gives them back.
    pub fn give(&self, increments: &Increments, bodies: &[[f32; 4]]) {
        self.bodies.iter().zip(bodies).for_each(|(body, w)| increments.now[*body as usize].set(w));
    }

    /// Takes impulses and velocities as the base of a run.
    pub fn begin<L: Law>(&mut self, contacts: &[Contact<D>], exact: &Exact<D>, units: &Units) {
        let fresh = std::mem::take(&mut self.fresh);
        for (batch, lane, k) in placed(&self.contacts) {
            let (c, x) = (&contacts[k], &mut self.batches[batch]);
            let frame = frame(&c.normal);
            let mut u = relative::<L, D>(exact.bodies, c);
            u += c.normal * c.bias;
            let cohesion = if L::COHESION { exact.cohesion[k] } else { 0.0 };
            let p = frame.map(|axis| c.impulse.dot(&axis) / units.impulse());
            let pressed = p[0] + cohesion / units.impulse();
            let most = c.friction * pressed;
            for (a, axis) in frame.iter().enumerate() {
                x.speed[a].0[lane] = (u.dot(axis) / units.speed) as f32;
                x.base[a].0[lane] = p[a] as f32;
                x.change[a].0[lane] = 0.0;
                if fresh {
                    x.last[a].0[lane] = 0.0;
                }
            }
            x.base[0].0[lane] = pressed as f32;
            if D == 2 {
                x.base[1].0[lane] = (most + p[1]) as f32;
                x.room.0[lane] = (most - p[1]) as f32;
            } else {
                let rubbed = (1..D).fold(0.0, |sum, a| sum + p[a] * p[a]).sqrt();
                x.room.0[lane] = (most - rubbed) as f32;
            }
            if let Some(lags) = self.lags.get_mut(batch) {
                lags.0[lane] = (self.bounds[k] / units.impulse() - most) as f32;
            }
            if L::ROLLING {
                let (r, x) = (&exact.rolling[k], &mut self.rolling[batch]);
                x.speed.0[lane] = (r.speed(exact.bodies, c.i, c.j) / units.speed) as f32;
                let q = r.impulse.get() / units.impulse();
                let most = r.resistance * pressed;
                (x.room[0].0[lane], x.room[1].0[lane]) = ((most - q) as f32, (most + q) as f32);
                x.change.0[lane] = 0.0;
                if fresh {
                    x.last.0[lane] = 0.0;
                }
            }
        }
    }

    /// Adds what a run has changed to impulses and velocities. Momentum goes on: with the last change of each impulse,
    /// from which that of the velocities is added up.
    pub fn end<L: Law>(&mut self, contacts: &mut [Contact<D>], exact: &Exact<D>, increments: &Increments) {
        let units = increments.units();
        for (batch, lane, k) in placed(&self.contacts) {
            let (c, x) = (&mut contacts[k], &mut self.batches[batch]);
            let frame = frame(&c.normal);
            let d: [f32; D] = from_fn(|a| x.change[a].0[lane]);
            let last = from_fn(|a| x.last[a].0[lane] - d[a]);
            (0..D).for_each(|a| x.last[a].0[lane] = last[a]);
            x.push_last::<L>(lane, [c.i, c.j], &frame, &last, increments);
            let mut turned = 0.0;
            if L::ROLLING {
                let rolling = &mut self.rolling[batch];
                turned = rolling.change.0[lane];
                rolling.last.0[lane] -= turned;
                rolling.push_last(lane, [c.i, c.j], &x.turning, increments);
            }
            let cohesion = if L::COHESION { exact.cohesion[k] } else { 0.0 };
            let mut bound = None;
            if let Some(lags) = self.lags.get(batch) {
                let most = c.friction * (c.impulse.dot(&c.normal) + cohesion);
                self.bounds[k] = most + f64::from(lags.0[lane]) * units.impulse();
                bound = Some(self.bounds[k]).filter(|_| c.friction > SCHEDULE.strong);
            }
            if turned == 0.0 && d.iter().all(|d| *d == 0.0) {
                continue;
            }
            let d = d.map(|d| f64::from(d) * units.impulse());
            let p: [f64; D] = from_fn(|a| c.impulse.dot(&frame[a]) + d[a]);
            let rounded = ROUNDED * d.iter().fold(0.0, |sum, d| sum + d.abs());
            let opens = x.change[0].0[lane] <= -x.base[0].0[lane] || p[0] <= -cohesion;
            let [normal, pressed] = if opens { [-cohesion, 0.0] } else { [p[0], p[0] + cohesion] };
            let mut impulse = c.normal * normal;
            if L::FRICTION {
                let rubbed = (1..D).fold(Vector::zeros(), |sum: Vector<D>, a| sum + frame[a] * p[a]);
                let bound = bound.unwrap_or(c.friction * pressed);
                impulse += at_most(rubbed, bound, rounded * c.friction.max(1.0));
            }
            push_apart::<L, D>(exact.bodies, c, &(impulse - c.impulse));
            c.impulse = impulse;
            if L::ROLLING {
                let r = &exact.rolling[k];
                let before = r.impulse.get();
                let q = before + f64::from(turned) * units.impulse();
                let rounded = rounded + ROUNDED * (q - before).abs();
                let q = at_most(Vector::<1>::new(q), r.most(pressed), rounded)[0];
                r.impulse.set(q);
                r.turn(exact.bodies, c.i, c.j, q - before);
            }
        }
    }

    /// Solves each contact exactly for the velocities that those before it have left, in double precision.
    pub fn polish<L: Law>(&self, contacts: &mut [Contact<D>], exact: &Exact<D>) {
        let bodies = exact.bodies;
        for (k, c) in contacts.iter_mut().enumerate() {
            let cohesion = if L::COHESION { exact.cohesion[k] } else { 0.0 };
            let bound = self.bounds.get(k).copied().filter(|_| L::FRICTION && c.friction > SCHEDULE.strong);
            let u = relative::<L, D>(bodies, c);
            let impulse = if L::ROLLING {
                let r = &exact.rolling[k];
                let (before, speed) = (r.impulse.get(), r.speed(bodies, c.i, c.j));
                let (impulse, q) =
                    c.solve_rolling::<L>((&c.impulse, &u), cohesion, bound, r, [before, speed]);
                r.impulse.set(q);
                r.turn(bodies, c.i, c.j, q - before);
                impulse
            } else {
                c.solve::<L>(&c.impulse, &u, cohesion, bound)
            };
            push_apart::<L, D>(bodies, c, &(impulse - c.impulse));
            c.impulse = impulse;
        }
    }

    /// Moves the bounds of strong friction by a share of the way to mu (p_n + c).
    pub fn follow_bounds(&mut self, share: f32) {
        let more = |x: &Batch<D>, l: usize| x.friction.0[l] * x.change[0].0[l];
        if self.lags.is_empty() {
            self.lags.extend(self.batches.iter().map(|x| Lanes(from_fn(|l| more(x, l)))));
            let count = placed(&self.contacts).count();
            self.bounds.resize(count, 0.0);
            return;
        }
        for (lags, x) in self.lags.iter_mut().zip(&self.batches) {
            for l in 0..LANES {
                lags.0[l] += share * (more(x, l) - lags.0[l]);
            }
        }
    }
}

/// Adds an impulse on the second body of a contact and its opposite on the first.
#[inline(always)]
fn push_apart<L: Law, const D: usize>(bodies: &Bodies<D>, c: &Contact<D>, p: &Vector<D>) {
    let (i, j) = (c.i as usize, c.j as usize);
    match L::SPIN {
        true => bodies.push_apart::<true>(i, j, &c.normal, p),
        false => bodies.push_apart::<false>(i, j, &c.normal, p),
    }
}

/// Batch, place in it, and number of each contact.
fn placed(contacts: &[[u32; LANES]]) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let numbered = contacts.iter().enumerate();
    numbered.flat_map(|(batch, of)| {
        of.iter().enumerate().filter(|(_, k)| **k != NONE).map(move |(lane, k)| (batch, lane, *k as usize))
    })
}

/// The normal, and unit tangents.
#[inline(always)]
fn frame<const D: usize>(normal: &Vector<D>) -> [Vector<D>; D] {
    from_fn(|a| if a == 0 { *normal } else { tangent(normal, a - 1) })
}

/// Rounding to single precision, as a share.
const ROUNDED: f64 = 4.0 * f32::EPSILON as f64;

/// What friction transmits of an impulse: one that is nearer to its bound than rounding has been cut to it.
fn at_most<const N: usize>(impulse: Vector<N>, bound: f64, rounded: f64) -> Vector<N> {
    let size = impulse.norm();
    if size > 0.0 && size >= bound - rounded { impulse * (bound / size) } else { impulse }
}

impl<const D: usize> Batch<D> {
    fn empty() -> Self {
        let zero = [Lanes::ZERO; D];
        Self {
            bodies: [[0; LANES]; 2],
            normal: zero,
            change: zero,
            last: zero,
            speed: zero,
            base: zero,
            room: Lanes::ZERO,
            mass: [Lanes::ZERO; 2],
            mobility: [Lanes::ZERO; 2],
            turning: [Lanes::ZERO; 2],
            friction: Lanes::ZERO,
        }
    }

    /// Adds the last change of an impulse to those of the velocities.
    #[inline(always)]
    fn push_last<L: Law>(
        &self,
        lane: usize,
        bodies: [u32; 2],
        frame: &[Vector<D>; D],
        last: &[f32; D],
        increments: &Increments,
    ) {
        if last.iter().all(|last| *last == 0.0) {
            return;
        }
        let p = (0..D).fold(Vector::<D>::zeros(), |sum, a| sum + frame[a] * f64::from(last[a]));
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let mass = sign * self.mobility[side].0[lane];
            increments.last[bodies[side] as usize].update(|w| {
                (0..D).for_each(|a| w[a] += p[a] as f32 * mass);
                if L::SPIN && D == 2 {
                    w[D] -= last[1] * self.turning[side].0[lane];
                }
            });
        }
    }

    /// Takes what a contact is.
    fn fill(&mut self, lane: usize, c: &Contact<D>, exact: &Exact<D>, mass: f64) {
        (0..D).for_each(|a| self.normal[a].0[lane] = c.normal[a] as f32);
        self.mass[0].0[lane] = (c.mass_n / mass) as f32;
        self.mass[1].0[lane] = (c.mass_t / mass) as f32;
        for (side, body) in [c.i, c.j].into_iter().enumerate() {
            let body = body as usize;
            self.mobility[side].0[lane] = (exact.bodies.mobility(body) * mass) as f32;
            if exact.bodies.spins() {
                self.turning[side].0[lane] = (exact.bodies.spin_mobility(body) * mass) as f32;
            }
        }
        self.friction.0[lane] = c.friction as f32;
    }
}

impl RollingBatch {
    fn empty() -> Self {
        Self {
            change: Lanes::ZERO,
            last: Lanes::ZERO,
            speed: Lanes::ZERO,
            room: [Lanes::ZERO; 2],
            share: [Lanes::ZERO; 2],
            resistance: Lanes::ZERO,
            rub: Lanes::ZERO,
            coupling: Lanes::ZERO,
            mass: Lanes::ZERO,
            inverse: [Lanes::ZERO; 3],
        }
    }

    /// Adds the last change of an impulse to those of the spins.
    fn push_last(&self, lane: usize, bodies: [u32; 2], turning: &[Lanes; 2], increments: &Increments) {
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let change = sign * self.share[side].0[lane] * turning[side].0[lane] * self.last.0[lane];
            increments.last[bodies[side] as usize].update(|w| w[2] += change);
        }
    }

    fn fill<const D: usize>(&mut self, lane: usize, c: &Contact<D>, r: &Rolling, mass: f64) {
        let rub = mass / c.mass_t;
        let (coupling, roll) = (r.coupling * mass, r.mobility * mass);
        for side in 0..2 {
            self.share[side].0[lane] = r.share[side] as f32;
        }
        self.resistance.0[lane] = r.resistance as f32;
        self.rub.0[lane] = rub as f32;
        // Nothing rolls where both sides are held.
        let rolls = roll > 0.0;
        let determinant = rub * roll - coupling * coupling;
        let inverse = match rolls {
            true => [roll, coupling, rub].map(|x| x / determinant),
            false => [1.0 / rub, 0.0, 0.0],
        };
        self.coupling.0[lane] = if rolls { coupling as f32 } else { 0.0 };
        self.mass.0[lane] = if rolls { (1.0 / roll) as f32 } else { 0.0 };
        (0..3).for_each(|k| self.inverse[k].0[lane] = inverse[k] as f32);
    }
}
