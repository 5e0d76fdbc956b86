//! Which tiles are swept: those with something left to do.
//!
//! Where a bed rests, impulses of the last sub-step solve its contacts to far below what may be left, and only around
//! what moves is there work. A tile wakes when a look finds more in it than its part of what may be left, and its
//! sweeps wake those around it. It stays awake until momentum starts anew: what momentum remembers of a body holds for
//! all of its contacts.

use super::constants::SOLVED;
use super::increments::{Increments, Units};
use super::residual::{natural_map, rolling_map};
use super::sweep::own;
use super::{Problem, relative};
use crate::bodies::Bodies;
use crate::contact::Law;
use crate::momentum::Momentum;
use crate::parallel;
use rayon::prelude::*;
use std::sync::Mutex;

/// Tiles from one that moves to one that may rest.
const REACH: usize = 2;

/// Tiles that are swept.
#[derive(Default)]
pub(super) struct Awake {
    pub tiles: Vec<bool>,
    /// Contacts of these tiles.
    pub contacts: usize,
    /// Bodies that they move, and whether a body is among them.
    bodies: Vec<u32>,
    moves: Vec<bool>,
    /// The awake tiles in the order in which a run takes them; the first of each colour, and how many it has.
    pub order: Vec<u32>,
    pub firsts: Vec<usize>,
    pub counts: Vec<usize>,
}

/// Bodies that one thread takes at once.
const CHUNK: usize = 5_000;

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
        on.then(Momentum::default)
    }

    /// Wakes the tiles in which the last look has found more than their part of what may be left, J, or a contact that
    /// closes faster than it may, 1/s.
    pub(super) fn wake(&mut self, may_be_left: f64, closing: f64) {
        let most = SOLVED.quiet * may_be_left / self.tiles.len() as f64;
        for tile in 0..self.tiles.len() {
            let found = &self.tiles.found[tile];
            let quiet = found.rough.get() <= most && found.closing.get() <= SOLVED.closes * closing;
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
        if share > SOLVED.few_move {
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
        let awake = &mut self.awake;
        let range = self.tiles.contacts(tile);
        awake.tiles[tile] = true;
        awake.contacts += range.len();
        own(&mut self.batches[tile..]).refresh();
        for i in self.contacts[range].iter().flat_map(|c| [c.i, c.j]) {
            if awake.moves.get_mut(i as usize).is_some_and(|moves| !std::mem::replace(moves, true)) {
                awake.bodies.push(i);
                self.increments.last[i as usize].set(&[0.0; 4]);
            }
        }
    }

    /// The contacts of another problem: nothing is known of them.
    pub(super) fn start_batches(&mut self) {
        crate::reserve(&mut self.batches, self.tiles.len());
        self.batches.resize_with(self.tiles.len(), Mutex::default);
        (0..self.tiles.len()).for_each(|tile| own(&mut self.batches[tile..]).clear());
        self.increments.forget(self.bodies.len(), self.tiles.len());
    }

    /// Chooses the units of this problem before the first sweep.
    pub(super) fn start_increments<L: Law>(&mut self) {
        if self.increments.units.is_none() {
            self.increments.units = Some(Units::of::<L, D>(self));
        }
    }

    /// Lists the awake tiles.
    pub(super) fn order_awake(&mut self) {
        let Awake { tiles, order, firsts, counts, .. } = &mut self.awake;
        [&mut *firsts, counts].into_iter().for_each(Vec::clear);
        order.clear();
        for colour in self.tiles.colours.windows(2) {
            firsts.push(order.len());
            order.extend((colour[0]..colour[1]).filter(|tile| tiles[*tile]).map(|tile| tile as u32));
            counts.push(order.len() - firsts[firsts.len() - 1]);
        }
    }

    /// Forgets what was changed of the velocities of the bodies of awake tiles, and what momentum remembers of them.
    pub(super) fn forget_increments(&self) {
        let Increments { now, last, .. } = &self.increments;
        self.of_awake(|i| {
            now[i].set(&[0.0; 4]);
            last[i].set(&[0.0; 4]);
        });
    }

    /// Calls `f` with the bodies of awake tiles.
    fn of_awake(&self, f: impl Fn(usize) + Sync) {
        let some = |bodies: &[u32]| bodies.iter().for_each(|i| f(*i as usize));
        if self.awake.bodies.len() > 2 * CHUNK {
            self.awake.bodies.par_chunks(CHUNK).for_each(some);
        } else {
            some(&self.awake.bodies);
        }
    }
}
