//! Which tiles are swept: those with something left to do.
//!
//! Where a bed rests, impulses of the last sub-step solve its contacts to far below what may be left, and only around what
//! moves is there work. A tile wakes when a look finds more in it than its part of what may be left, and its sweeps wake those
//! around it. It stays awake until momentum starts anew: what momentum remembers of a body holds for all of its contacts.

use super::Problem;
use super::tiles::FORK_CONTACTS;
use crate::bodies::Shared;
use crate::momentum::Momentum;
use crate::space::Vector;
use rayon::prelude::*;

/// Share of the error that may be left up to which all sleeping tiles together have it.
const QUIET: f64 = 0.01;
/// Share of the speed of closing that no contact may exceed, up to which a tile sleeps: light grains among heavy ones have little
/// part in the energy, and would pass into each other over many steps.
const CLOSES: f64 = 0.05;

/// Tiles that are swept, and what momentum remembers.
#[derive(Default)]
pub(super) struct Awake<const D: usize> {
    pub tiles: Vec<bool>,
    /// Contacts of these tiles.
    pub contacts: usize,
    /// Bodies that they move, and whether a body is among them.
    bodies: Vec<u32>,
    moves: Vec<bool>,
    /// Impulses before the last sweep, and velocities and surface speeds; empty without momentum.
    pub last: Vec<Vector<D>>,
    last_velocity: Vec<[Shared; D]>,
    last_surface: Vec<Shared>,
}

impl<const D: usize> Awake<D> {
    /// Contacts of a colour above which its tiles go to several threads.
    pub fn fork(&self) -> usize {
        if self.contacts > FORK_CONTACTS { FORK_CONTACTS } else { usize::MAX }
    }
}

/// Bodies whose velocities are extrapolated by one thread.
const CHUNK: usize = 10_000;

impl<const D: usize> Problem<D> {
    /// Puts all tiles to sleep, and starts momentum anew if it is `on`.
    pub(super) fn sleep(&mut self, on: bool) -> Option<Momentum> {
        let awake = &mut self.awake;
        awake.contacts = 0;
        awake.bodies.clear();
        // Walls do not move.
        awake.bodies.reserve_exact(self.position.len());
        awake.tiles.clear();
        crate::reserve(&mut awake.tiles, self.tiles.len());
        awake.tiles.resize(self.tiles.len(), false);
        awake.moves.clear();
        awake.moves.resize(self.position.len(), false);
        let [contacts, bodies] = if on { [self.contacts.len(), self.position.len()] } else { [0, 0] };
        crate::reserve(&mut awake.last, contacts);
        awake.last.resize(contacts, Vector::zeros());
        awake.last_velocity.resize_with(bodies, || std::array::from_fn(|_| Shared::default()));
        let spinning = if self.bodies.spins() { bodies } else { 0 };
        awake.last_surface.resize_with(spinning, Shared::default);
        on.then(Momentum::default)
    }

    /// Wakes the tiles in which the last look has found more than their part of what may be left, J, or a contact that closes
    /// faster than it may, 1/s.
    pub(super) fn wake(&mut self, may_be_left: f64, closing: f64) {
        let most = QUIET * may_be_left / self.tiles.len() as f64;
        for tile in 0..self.tiles.len() {
            let found = &self.tiles.found[tile];
            let quiet = found.rough.get() <= most && found.closing.get() <= CLOSES * closing;
            if !self.awake.tiles[tile] && !quiet {
                self.wake_tile(tile);
            }
        }
    }

    pub(super) fn wake_all(&mut self) {
        for tile in 0..self.tiles.len() {
            if !self.awake.tiles[tile] {
                self.wake_tile(tile);
            }
        }
    }

    fn wake_tile(&mut self, tile: usize) {
        let (awake, bodies) = (&mut self.awake, &self.bodies);
        let range = self.tiles.contacts(tile);
        awake.tiles[tile] = true;
        awake.contacts += range.len();
        for (k, c) in range.clone().zip(&self.contacts[range]) {
            if let Some(last) = awake.last.get_mut(k) {
                *last = c.impulse;
            }
            for i in [c.i, c.j] {
                if awake.moves.get_mut(i as usize).is_some_and(|moves| !std::mem::replace(moves, true)) {
                    awake.bodies.push(i);
                    remember(bodies, i as usize, &awake.last_velocity, &awake.last_surface);
                }
            }
        }
    }

    /// v + beta (v - last v) of the bodies of awake tiles, to match the impulses p + beta (p - last p) that the next sweep
    /// starts from.
    pub(super) fn extrapolate(&mut self, beta: f64) {
        let (bodies, awake) = (&self.bodies, &self.awake);
        let (last, last_surface) = (&awake.last_velocity, &awake.last_surface);
        let extrapolate = |some: &[u32]| {
            for i in some.iter().map(|&i| i as usize) {
                let v = bodies.velocity(i);
                let before = Vector::<D>::from_fn(|a, _| last[i][a].get());
                let s = last_surface.get(i).map(|last| (bodies.surface(i), last.get()));
                remember(bodies, i, last, last_surface);
                bodies.set_velocity(i, &(v + (v - before) * beta));
                if let Some((s, before)) = s {
                    bodies.set_surface(i, s + (s - before) * beta);
                }
            }
        };
        if awake.bodies.len() > 2 * CHUNK {
            awake.bodies.par_chunks(CHUNK).for_each(extrapolate);
        } else {
            extrapolate(&awake.bodies);
        }
    }
}

/// Takes the velocity of a body as its last one, if that is remembered.
#[inline(always)]
fn remember<const D: usize>(
    bodies: &crate::bodies::Bodies<D>,
    i: usize,
    velocity: &[[Shared; D]],
    surface: &[Shared],
) {
    if let Some(last) = velocity.get(i) {
        let v = bodies.velocity(i);
        (0..D).for_each(|a| last[a].set(v[a]));
    }
    if let Some(last) = surface.get(i) {
        last.set(bodies.surface(i));
    }
}
