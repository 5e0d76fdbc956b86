//! Nonlinear Gauss-Seidel over coloured tiles: sweep, residual, stopping.
//!
//! All sums run over one binary tree of tiles that depends on their number only, and tiles of one colour share no grain:
//! the result is the same bit for bit on any number of threads, and without threads.

use crate::bodies::Bodies;
use crate::contact::{Contact, Coulomb, Frictionless, Law};
use crate::interior::{self, Free, Friction};
use crate::momentum::Momentum;
use crate::space::Vector;
use rayon::prelude::*;

/// Ranges of contacts: tile k holds starts[k] .. starts[k + 1]; colour c the tiles colours[c] .. colours[c + 1].
#[derive(Default)]
pub(crate) struct Tiles {
    pub starts: Vec<u32>,
    pub colours: Vec<usize>,
}

/// The contact problem of one sub-step.
#[derive(Default)]
pub(crate) struct Problem<const D: usize> {
    pub bodies: Bodies<D>,
    pub contacts: Vec<Contact<D>>,
    /// Cohesion impulse of each contact, N s; empty without cohesion.
    pub cohesion: Vec<f64>,
    pub tiles: Tiles,
    pub friction: bool,
    /// What friction may reach at each contact once strong friction lags, N s; empty before, and where none is strong.
    bounds: Vec<f64>,
    /// Impulses before the last sweep, and velocities; empty without momentum.
    last: Vec<Vector<D>>,
    last_velocity: Vec<Vector<D>>,
    last_surface: Vec<f64>,
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopping {
    /// Relative natural map to reach.
    pub tolerance: f64,
    pub max_sweeps: usize,
    pub momentum: bool,
    /// Smallest scale of the relative natural map, the square of an impulse (kg m/s)^2.
    pub floor: f64,
    /// Speed at which a contact of the smallest grain may close beyond its gap, m/s; others in proportion to their radius.
    pub closing: f64,
    /// Whether to go on by the interior-point method where sweeps do not suffice.
    pub interior: bool,
}

/// What the problem does not hold of its grains.
pub(crate) struct Grains<'a, const D: usize> {
    /// Radius of a body over that of the smallest grain; infinite for walls.
    pub radius: &'a dyn Fn(usize) -> f64,
    /// Sets the velocities without contacts. (Taking impulses back from velocities would leave nothing of them where sweeps
    /// have diverged.)
    pub free: &'a dyn Fn(&Bodies<D>),
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcome {
    pub sweeps: usize,
    /// Relative natural map.
    pub residual: f64,
    /// Fastest closing of a contact beyond its gap, over what is allowed; 0 if below.
    pub closing: f64,
}

impl Outcome {
    /// Solved up to 1. No grain may pass through another: closing counts first.
    fn excess(&self, stopping: &Stopping) -> f64 {
        let closing = if self.closing > 1.0 { self.closing } else { 0.0 };
        self.residual.max(closing) / stopping.tolerance
    }

    pub fn solved(&self, stopping: &Stopping) -> bool {
        self.excess(stopping) <= 1.0
    }
}

/// Contacts or bodies above which tiles go to several threads: a fork costs some microseconds, a contact ten nanoseconds.
const FORK: usize = 10_000;
/// Sweeps between looks at the true residual at least.
const LOOK: usize = 4;

/// Coefficient above which friction lags behind the normal impulse, sweeps after which it does, and the share of the difference that
/// a sweep makes up.
///
/// A sweep is no contraction when friction is strong: normal impulse and the bound mu p_n of the tangential one chase each
/// other round a cycle. With the bound held, the problem is convex and sweeps converge; so the bound follows slowly. The share is
/// measured, not derived: in beds with friction 10 the steps that stay unsolved are a quarter of those without. Weak friction
/// converges without.
const STRONG: f64 = 1.0;
const LAGGING: usize = 200;
const FOLLOW: f64 = 0.05;

/// Bodies up to which the interior-point method goes on where grains pass into each other, and where only forces are not solved. Its factors
/// take more than linear time: up to the second it costs about as much as the sweeps did, up to the first seconds.
const CLOSING_BODIES: usize = 10_000;
const UNSOLVED_BODIES: usize = 1000;

/// Squares of change and impulse, and the product of the change with the step of the extrapolation.
type Sums = [f64; 3];

fn add(a: Sums, b: Sums) -> Sums {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Calls `f(contacts, last, first)` on each tile, halving the range of tiles, in parallel where it pays.
fn over_tiles<const D: usize, F>(
    starts: &[u32],
    contacts: &mut [Contact<D>],
    last: &mut [Vector<D>],
    f: &F,
) -> Sums
where
    F: Fn(&mut [Contact<D>], &mut [Vector<D>], usize) -> Sums + Sync,
{
    let tiles = starts.len() - 1;
    if tiles <= 1 {
        return f(contacts, last, starts[0] as usize);
    }
    let middle = tiles / 2;
    let cut = (starts[middle] - starts[0]) as usize;
    let (left, right) = contacts.split_at_mut(cut);
    let (past, later) = last.split_at_mut(cut.min(last.len()));
    let (first, second) = (&starts[..=middle], &starts[middle..]);
    if left.len() + right.len() > FORK && rayon::current_num_threads() > 1 {
        let (a, b) = rayon::join(|| over_tiles(first, left, past, f), || over_tiles(second, right, later, f));
        return add(a, b);
    }
    add(over_tiles(first, left, past, f), over_tiles(second, right, later, f))
}

impl<const D: usize> Problem<D> {
    /// Solves with the law that the scene needs, chosen once.
    pub fn solve(&mut self, stopping: &Stopping, grains: &Grains<D>) -> Outcome {
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
        let mut judge = |problem: &mut Self| problem.look_closely::<L>(stopping, grains).excess(stopping);
        let free = Free::new(self, grains);
        let mut lacks = f64::MAX;
        for friction in [Friction::Follows, Friction::Held, Friction::Out] {
            // Forces may stay unsolved; that no grain closes may not.
            if lacks * stopping.tolerance > 1.0 && (L::FRICTION || friction == Friction::Follows) {
                lacks = interior::solve(self, &free, friction, &mut judge);
            }
        }
        let mut again = 0;
        if lacks > 1.0 {
            let impulses: Vec<Vector<D>> = self.contacts.iter().map(|c| c.impulse).collect();
            let state = self.bodies.state();
            again = self.sweeps::<L>(stopping, grains).sweeps;
            if free.judge(self, &mut judge) >= lacks {
                self.contacts.iter_mut().zip(&impulses).for_each(|(c, p)| c.impulse = *p);
                self.bodies.set_state(&state);
            }
        }
        let outcome = self.look_closely::<L>(stopping, grains);
        Outcome { sweeps: first.sweeps + again, ..outcome }
    }

    fn sweeps<L: Law>(&mut self, stopping: &Stopping, grains: &Grains<D>) -> Outcome {
        let mut outcome = self.look::<L>(stopping);
        let mut last_look = 0;
        self.bounds.clear();
        let mut strong = None;
        let mut momentum = Momentum::default();
        self.start_momentum(stopping.momentum);
        loop {
            // Who closes is looked at where all else is solved.
            if outcome.closing > 0.0
                && (outcome.residual <= stopping.tolerance || outcome.sweeps == stopping.max_sweeps)
            {
                outcome.closing = self.closing::<L>(stopping, grains);
            }
            if outcome.solved(stopping) || outcome.sweeps == stopping.max_sweeps {
                return outcome;
            }
            let mut looked = false;
            while !looked {
                if L::FRICTION && outcome.sweeps >= LAGGING {
                    let any = |contacts: &[Contact<D>]| contacts.iter().any(|c| c.friction > STRONG);
                    if *strong.get_or_insert_with(|| any(&self.contacts)) {
                        self.follow_bounds();
                    }
                }
                let [change, size, turn] = if stopping.momentum {
                    self.extrapolate(momentum.beta);
                    self.sweep::<L, true>(momentum.beta)
                } else {
                    self.sweep::<L, false>(0.0)
                };
                outcome.sweeps += 1;
                momentum.update(change, turn);
                // The change of a sweep is the natural map met on the way, contact by contact: it tells for free
                // when the true one is worth a look.
                let near = change <= (stopping.tolerance * stopping.tolerance) * size.max(stopping.floor);
                let since = outcome.sweeps - last_look;
                let end = outcome.sweeps == stopping.max_sweeps;
                looked = (near && since >= LOOK) || since >= 2 * LOOK || end;
            }
            last_look = outcome.sweeps;
            outcome = Outcome { sweeps: outcome.sweeps, ..self.look::<L>(stopping) };
        }
    }

    /// Moves the bounds of friction towards mu (p_n + c).
    fn follow_bounds(&mut self) {
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

    fn start_momentum(&mut self, on: bool) {
        self.last.clear();
        self.last_velocity.clear();
        self.last_surface.clear();
        if on {
            let bodies = &self.bodies;
            crate::reserve(&mut self.last, self.contacts.len());
            self.last.extend(self.contacts.iter().map(|c| c.impulse));
            crate::reserve(&mut self.last_velocity, bodies.len());
            self.last_velocity.extend((0..bodies.len()).map(|i| bodies.velocity(i)));
            if bodies.spins() {
                crate::reserve(&mut self.last_surface, bodies.len());
                self.last_surface.extend((0..bodies.len()).map(|i| bodies.surface(i)));
            }
        }
    }

    /// v + beta (v - last v), to match the impulses p + beta (p - last p) that the next sweep starts from.
    fn extrapolate(&mut self, beta: f64) {
        let bodies = &self.bodies;
        let extrapolate = |(k, chunk): (usize, &mut [Vector<D>])| {
            for (i, last) in (k * FORK..).zip(chunk) {
                let v = bodies.velocity(i);
                bodies.set_velocity(i, &(v + (v - *last) * beta));
                *last = v;
            }
        };
        if bodies.len() > 2 * FORK {
            self.last_velocity.par_chunks_mut(FORK).enumerate().for_each(extrapolate);
        } else {
            self.last_velocity.chunks_mut(FORK).enumerate().for_each(extrapolate);
        }
        for (i, last) in self.last_surface.iter_mut().enumerate() {
            let s = self.bodies.surface(i);
            self.bodies.set_surface(i, s + (s - *last) * beta);
            *last = s;
        }
    }

    /// One pass over all contacts; its sums.
    fn sweep<L: Law, const MOMENTUM: bool>(&mut self, beta: f64) -> Sums {
        let (bodies, cohesion, bounds) = (&self.bodies, &self.cohesion, &self.bounds);
        let tile = |contacts: &mut [Contact<D>], last: &mut [Vector<D>], first: usize| {
            let mut sums = [0.0; 3];
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
                let change = relax::<L, D>(bodies, c, &start, cohesion, bound);
                let turn = if MOMENTUM { -change.dot(&(c.impulse - before)) } else { 0.0 };
                sums = add(sums, [change.norm_squared(), c.impulse.norm_squared(), turn]);
            }
            sums
        };
        over_colours(&self.tiles, &mut self.contacts, &mut self.last, tile)
    }

    /// Relative natural map of the present impulses and velocities, and whether a contact may close. rho = 1/w_n between equals, half
    /// of the heavier mass otherwise: with 1/w_n, near the lighter mass, a heavy lid that falls freely on light grains
    /// would look solved.
    fn look<L: Law>(&mut self, stopping: &Stopping) -> Outcome {
        let (bodies, cohesion) = (&self.bodies, &self.cohesion);
        let tile = |contacts: &mut [Contact<D>], _: &mut [Vector<D>], first: usize| {
            let mut sums = [0.0; 3];
            for (k, c) in contacts.iter().enumerate() {
                let u = relative::<L, D>(bodies, c);
                let cohesion = if L::COHESION { cohesion[first + k] } else { 0.0 };
                let heavier = bodies.heavier(c.i as usize, c.j as usize);
                let [error, size] = c.natural_map::<L>(&u, c.mass_n.max(0.5 * heavier), cohesion);
                let closing = (u.dot(&c.normal) + c.bias).min(0.0).powi(4);
                sums = add(sums, [error, size, closing]);
            }
            sums
        };
        let [error, size, closing] = over_tiles(&self.tiles.starts, &mut self.contacts, &mut [], &tile);
        let size = size.max(stopping.floor).max(f64::MIN_POSITIVE);
        // The sum of fourth powers bounds the largest.
        let closing =
            if stopping.interior && closing.sqrt().sqrt() > stopping.closing { f64::INFINITY } else { 0.0 };
        Outcome { sweeps: 0, residual: if error == 0.0 { 0.0 } else { (error / size).sqrt() }, closing }
    }

    fn look_closely<L: Law>(&mut self, stopping: &Stopping, grains: &Grains<D>) -> Outcome {
        Outcome { closing: self.closing::<L>(stopping, grains), ..self.look::<L>(stopping) }
    }

    /// Fastest closing of a contact beyond its gap, over what is allowed.
    fn closing<L: Law>(&self, stopping: &Stopping, grains: &Grains<D>) -> f64 {
        self.contacts.iter().fold(0.0, |most: f64, c| {
            let smaller = (grains.radius)(c.i as usize).min((grains.radius)(c.j as usize));
            let speed = -(relative::<L, D>(&self.bodies, c).dot(&c.normal) + c.bias);
            most.max(speed / (stopping.closing * smaller))
        })
    }

    /// Adds all impulses to the velocities: the warm start, and the exact velocities at the end.
    pub fn apply_impulses(&mut self) {
        let bodies = &self.bodies;
        let tile = |contacts: &mut [Contact<D>], _: &mut [Vector<D>], _: usize| {
            for c in contacts.iter() {
                let (i, j) = (c.i as usize, c.j as usize);
                if bodies.spins() {
                    bodies.push_apart::<true>(i, j, &c.normal, &c.impulse);
                } else {
                    bodies.push_apart::<false>(i, j, &c.normal, &c.impulse);
                }
            }
            [0.0; 3]
        };
        over_colours(&self.tiles, &mut self.contacts, &mut [], tile);
    }
}

/// Tiles colour by colour: those of one colour may run at once. `last` is empty or as long as the contacts.
fn over_colours<const D: usize, F>(
    tiles: &Tiles,
    contacts: &mut [Contact<D>],
    last: &mut [Vector<D>],
    f: F,
) -> Sums
where
    F: Fn(&mut [Contact<D>], &mut [Vector<D>], usize) -> Sums + Sync,
{
    let mut sums = [0.0; 3];
    for colour in tiles.colours.windows(2).filter(|c| c[0] < c[1]) {
        let starts = &tiles.starts[colour[0]..=colour[1]];
        let range = starts[0] as usize..starts[starts.len() - 1] as usize;
        let past = if last.is_empty() { 0..0 } else { range.clone() };
        sums = add(sums, over_tiles(starts, &mut contacts[range], &mut last[past], &f));
    }
    sums
}

#[inline(always)]
fn relative<L: Law, const D: usize>(bodies: &Bodies<D>, c: &Contact<D>) -> Vector<D> {
    let (i, j) = (c.i as usize, c.j as usize);
    if L::SPIN { bodies.relative::<true>(i, j, &c.normal) } else { bodies.relative::<false>(i, j, &c.normal) }
}

/// Solves one contact exactly from the impulse `start`, with friction up to `bound` if that lags, moves its two bodies, and
/// returns the change.
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
