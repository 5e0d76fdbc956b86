//! Nonlinear Gauss-Seidel over coloured tiles: sweep, residual, stopping.
//!
//! All sums run over one binary tree of tiles that depends on their number only, and tiles of one colour share no grain:
//! the result is the same bit for bit on any number of threads, and without threads.

use crate::bodies::Bodies;
use crate::contact::{Contact, Coulomb, Frictionless, Law};
use crate::space::Vector;

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
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopping {
    /// Relative natural map to reach.
    pub tolerance: f64,
    pub max_sweeps: usize,
    /// Impulses below this share of the momentum scale are rounding, (kg m2/s2): floor of the scale.
    pub floor: f64,
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcome {
    pub sweeps: usize,
    /// Relative natural map.
    pub residual: f64,
}

/// Contacts above which tiles go to several threads; a fork costs some microseconds.
const FORK: usize = 2000;
/// Sweeps between looks at the true residual at least.
const LOOK: usize = 4;

type Sums = [f64; 2];

fn add(a: Sums, b: Sums) -> Sums {
    [a[0] + b[0], a[1] + b[1]]
}

/// Calls `f(contacts, first)` on each tile, halving the range of tiles, in parallel where it pays.
fn over_tiles<const D: usize, F>(starts: &[u32], contacts: &mut [Contact<D>], f: &F) -> Sums
where
    F: Fn(&mut [Contact<D>], usize) -> Sums + Sync,
{
    let tiles = starts.len() - 1;
    if tiles <= 1 {
        return f(contacts, starts[0] as usize);
    }
    let middle = tiles / 2;
    let (left, right) = contacts.split_at_mut((starts[middle] - starts[0]) as usize);
    let (first, second) = (&starts[..=middle], &starts[middle..]);
    if left.len() + right.len() > FORK && rayon::current_num_threads() > 1 {
        let (a, b) = rayon::join(|| over_tiles(first, left, f), || over_tiles(second, right, f));
        return add(a, b);
    }
    add(over_tiles(first, left, f), over_tiles(second, right, f))
}

impl<const D: usize> Problem<D> {
    /// Solves with the law that the scene needs, chosen once.
    pub fn solve(&mut self, stopping: &Stopping) -> Outcome {
        match (self.friction, self.bodies.spins(), !self.cohesion.is_empty()) {
            (false, _, false) => self.solve_with::<Frictionless>(stopping),
            (true, false, false) => self.solve_with::<Coulomb<false, false>>(stopping),
            (true, true, false) => self.solve_with::<Coulomb<true, false>>(stopping),
            (_, false, true) => self.solve_with::<Coulomb<false, true>>(stopping),
            (_, true, true) => self.solve_with::<Coulomb<true, true>>(stopping),
        }
    }

    fn solve_with<L: Law>(&mut self, stopping: &Stopping) -> Outcome {
        let mut outcome = Outcome { sweeps: 0, residual: self.residual::<L>(stopping.floor) };
        let mut last_look = 0;
        while outcome.residual > stopping.tolerance && outcome.sweeps < stopping.max_sweeps {
            let [change, size] = self.sweep::<L>();
            outcome.sweeps += 1;
            // The change of a sweep is the natural map met on the way, contact by contact: it tells for free
            // when the true one is worth a look.
            let near = change <= (stopping.tolerance * stopping.tolerance) * size.max(stopping.floor);
            let end = outcome.sweeps == stopping.max_sweeps;
            if (near && outcome.sweeps >= last_look + LOOK) || outcome.sweeps >= last_look + 8 * LOOK || end {
                outcome.residual = self.residual::<L>(stopping.floor);
                last_look = outcome.sweeps;
            }
        }
        outcome
    }

    /// One pass over all contacts; the squares of the change and of the impulses, weighted by w.
    fn sweep<L: Law>(&mut self) -> Sums {
        let (bodies, cohesion) = (&self.bodies, &self.cohesion);
        let tile = |contacts: &mut [Contact<D>], first: usize| {
            let mut sums = [0.0; 2];
            for (k, c) in contacts.iter_mut().enumerate() {
                let cohesion = if L::COHESION { cohesion[first + k] } else { 0.0 };
                sums = add(sums, relax::<L, D>(bodies, c, cohesion));
            }
            sums
        };
        over_colours(&self.tiles, &mut self.contacts, tile)
    }

    /// Relative natural map of the present impulses and velocities.
    fn residual<L: Law>(&mut self, floor: f64) -> f64 {
        let (bodies, cohesion) = (&self.bodies, &self.cohesion);
        let tile = |contacts: &mut [Contact<D>], first: usize| {
            let mut sums = [0.0; 2];
            for (k, c) in contacts.iter().enumerate() {
                let u = relative::<L, D>(bodies, c);
                let cohesion = if L::COHESION { cohesion[first + k] } else { 0.0 };
                sums = add(sums, c.natural_map::<L>(&u, cohesion));
            }
            sums
        };
        let [error, size] = over_tiles(&self.tiles.starts, &mut self.contacts, &tile);
        if error == 0.0 { 0.0 } else { (error / size.max(floor).max(f64::MIN_POSITIVE)).sqrt() }
    }

    /// Adds all impulses to the velocities: the warm start, and the exact velocities at the end.
    pub fn apply_impulses(&mut self) {
        let bodies = &self.bodies;
        let tile = |contacts: &mut [Contact<D>], _: usize| {
            for c in contacts.iter() {
                let (i, j) = (c.i as usize, c.j as usize);
                if bodies.spins() {
                    bodies.push_apart::<true>(i, j, &c.normal, &c.impulse);
                } else {
                    bodies.push_apart::<false>(i, j, &c.normal, &c.impulse);
                }
            }
            [0.0; 2]
        };
        over_colours(&self.tiles, &mut self.contacts, tile);
    }
}

/// Tiles colour by colour: those of one colour may run at once.
fn over_colours<const D: usize, F>(tiles: &Tiles, contacts: &mut [Contact<D>], f: F) -> Sums
where
    F: Fn(&mut [Contact<D>], usize) -> Sums + Sync,
{
    let mut sums = [0.0; 2];
    for colour in tiles.colours.windows(2).filter(|c| c[0] < c[1]) {
        let starts = &tiles.starts[colour[0]..=colour[1]];
        let range = starts[0] as usize..starts[starts.len() - 1] as usize;
        sums = add(sums, over_tiles(starts, &mut contacts[range], &f));
    }
    sums
}

#[inline(always)]
fn relative<L: Law, const D: usize>(bodies: &Bodies<D>, c: &Contact<D>) -> Vector<D> {
    let (i, j) = (c.i as usize, c.j as usize);
    if L::SPIN { bodies.relative::<true>(i, j, &c.normal) } else { bodies.relative::<false>(i, j, &c.normal) }
}

/// Solves one contact exactly and moves its two bodies.
#[inline(always)]
fn relax<L: Law, const D: usize>(bodies: &Bodies<D>, c: &mut Contact<D>, cohesion: f64) -> Sums {
    let u = relative::<L, D>(bodies, c);
    let p = c.solve::<L>(&c.impulse, &u, cohesion);
    let change = p - c.impulse;
    let square = change.norm_squared();
    if square > 0.0 {
        c.impulse = p;
        let (i, j) = (c.i as usize, c.j as usize);
        if L::SPIN {
            bodies.push_apart::<true>(i, j, &c.normal, &change);
        } else {
            bodies.push_apart::<false>(i, j, &c.normal, &change);
        }
    }
    [square / c.mass_n, p.norm_squared() / c.mass_n]
}
