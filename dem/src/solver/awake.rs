//! Which tiles are swept: those with something left to do.
//!
//! Where a bed rests, impulses of the last sub-step solve its contacts to far below what may be left, and only around
//! what moves is there work. A tile wakes when a look finds more in it than its part of what may be left, and its
//! sweeps wake those around it. It stays awake until momentum starts anew: what momentum remembers of a body holds for
//! all of its contacts.

use super::residual::{natural_map, rolling_map};
use super::runs::FEW_MOVE;
use super::tiles::FORK_CONTACTS;
use super::{Problem, relative};
use crate::bodies::{Bodies, Shared};
use crate::contact::Law;
use crate::momentum::Momentum;
use crate::parallel;
use crate::space::Vector;
use rayon::prelude::*;

/// Share of the error that may be left up to which all sleeping tiles together have it.
const QUIET: f64 = 0.01;
/// Share of the speed of closing that no contact may exceed, up to which a tile sleeps: light grains among heavy ones
/// have little part in the energy, and would pass into each other over many steps.
const CLOSES: f64 = 0.05;

/// Tiles from one that moves to one that may rest.
const REACH: usize = 2;

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

    /// Wakes the tiles in which the last look has found more than their part of what may be left, J, or a contact that
    /// closes faster than it may, 1/s.
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

    /// Marks the grains that contacts push and that do not rest; `mark` tells those by their own velocities. Who
    /// touches a wall that moves does not rest. Returns the share that they have of the energy that forces bring.
    pub(super) fn mark_moving(&mut self, mark: impl Fn(&Bodies<D>, &mut Vec<bool>) -> f64) -> f64 {
        let share = mark(&self.bodies, &mut self.moving);
        let grains = self.position.len();
        let carries = |i: u32| i as usize >= grains && self.bodies.velocity(i as usize).norm_squared() > 0.0;
        if !(grains..self.bodies.len()).any(|i| carries(i as u32)) {
            return share;
        }
        let touch = self.contacts.iter().filter(|c| c.acts() && (carries(c.i) || carries(c.j)));
        touch.for_each(|c| self.moving[c.i.min(c.j) as usize] = true);
        share.max(f64::MIN_POSITIVE)
    }

    /// Marks these grains and those near them, all if there are many.
    pub(crate) fn mark_near_moving(&mut self, mark: impl Fn(&Bodies<D>, &mut Vec<bool>) -> f64) {
        let share = self.mark_moving(mark);
        if share > FEW_MOVE {
            self.moving.fill(true);
            return;
        }
        for _ in 0..if share > 0.0 { REACH } else { 0 } {
            let mut tiles = std::mem::take(&mut self.awake.tiles);
            tiles.clear();
            tiles.extend((0..self.tiles.len()).map(|tile| self.moves_in(tile)));
            self.awake.tiles = tiles;
            for tile in (0..self.tiles.len()).filter(|tile| self.awake.tiles[*tile]) {
                for c in self.contacts[self.tiles.contacts(tile)].iter().filter(|c| c.acts()) {
                    for i in [c.i, c.j] {
                        if let Some(moves) = self.moving.get_mut(i as usize) {
                            *moves = true;
                        }
                    }
                }
            }
        }
    }

    /// Wakes the tiles in which a contact acts on a grain that does not rest.
    pub(super) fn wake_moving(&mut self) {
        for tile in 0..self.tiles.len() {
            if !self.awake.tiles[tile] && self.moves_in(tile) {
                self.wake_tile(tile);
            }
        }
    }

    /// Energy that solving the contacts of moving grains one by one would take away, J.
    pub(super) fn rough_of_moving<L: Law>(&self) -> f64 {
        parallel::sum(0..self.contacts.len(), &|k| {
            let c = &self.contacts[k];
            if !self.moves(c.i) && !self.moves(c.j) {
                return 0.0;
            }
            let cohesion = if L::COHESION { self.cohesion[k] } else { 0.0 };
            let (rho, [square, _]) =
                natural_map::<L, D>(&self.bodies, c, &relative::<L, D>(&self.bodies, c), cohesion);
            let rolling = if L::ROLLING {
                let (rho, [square, _]) = rolling_map(&self.bodies, c, cohesion, &self.rolling[k]);
                0.5 * square / rho
            } else {
                0.0
            };
            0.5 * square / rho + rolling
        })
    }

    fn moves(&self, body: u32) -> bool {
        self.moving.get(body as usize).is_some_and(|moves| *moves)
    }

    /// Whether a contact of a tile acts on a grain that is marked as moving.
    fn moves_in(&self, tile: usize) -> bool {
        self.contacts[self.tiles.contacts(tile)]
            .iter()
            .any(|c| c.acts() && (self.moves(c.i) || self.moves(c.j)))
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
        if let Some(rolling) = self.rolling.get(range.clone()) {
            rolling.iter().for_each(|r| r.last.set(r.impulse.get()));
        }
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

    /// v + beta (v - last v) of the bodies of awake tiles, to match the impulses p + beta (p - last p) that the next
    /// sweep starts from.
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
fn remember<const D: usize>(bodies: &Bodies<D>, i: usize, velocity: &[[Shared; D]], surface: &[Shared]) {
    if let Some(last) = velocity.get(i) {
        let v = bodies.velocity(i);
        (0..D).for_each(|a| last[a].set(v[a]));
    }
    if let Some(last) = surface.get(i) {
        last.set(bodies.surface(i));
    }
}
