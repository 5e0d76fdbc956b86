//! What a run of sweeps changes of the velocities, and the units in which it computes.

use super::{Problem, relative};
use crate::bodies::{Bodies, Shared};
use crate::contact::Law;
use crate::space::Vector;
use std::array::from_fn;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// No contact, no place.
pub(super) const NONE: u32 = u32::MAX;

/// Units in which sweeps compute, powers of two: what a typical contact has, so that squares of changes stay within the
/// range of single precision.
#[derive(Clone, Copy)]
pub(super) struct Units {
    pub mass: f64,
    pub speed: f64,
}

/// The power of two below a number; 1 for what has none.
fn power_of_two(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff << 52;
    let power = f64::from_bits(x.to_bits() & EXPONENT);
    if power.is_normal() { power } else { 1.0 }
}

impl Units {
    /// Of some contacts.
    pub fn of<L: Law, const D: usize>(problem: &Problem<D>) -> Self {
        let (mut masses, mut squares) = (0.0, 0.0);
        for c in &problem.contacts {
            masses += 1.0 / c.mass_n;
            let closing = relative::<L, D>(&problem.bodies, c).dot(&c.normal) + c.bias;
            squares += closing * closing;
        }
        let count = problem.contacts.len() as f64;
        Self { mass: power_of_two(count / masses), speed: power_of_two((squares / count).sqrt()) }
    }

    pub fn impulse(&self) -> f64 {
        self.mass * self.speed
    }
}

/// What a run has changed of the velocity of a body and of its surface speed, which stands behind; several threads may
/// hold it as they may a [`Shared`].
#[derive(Default)]
pub(super) struct Increment([AtomicU64; 2]);

impl Increment {
    #[inline(always)]
    pub fn get(&self) -> [f32; 4] {
        let [a, b] = from_fn(|k| self.0[k].load(Relaxed));
        [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32].map(f32::from_bits)
    }

    pub fn update(&self, f: impl FnOnce(&mut [f32; 4])) {
        let mut w = self.get();
        f(&mut w);
        self.set(&w);
    }

    #[inline(always)]
    pub fn set(&self, x: &[f32; 4]) {
        let bits = x.map(|x| u64::from(x.to_bits()));
        self.0[0].store(bits[0] | bits[1] << 32, Relaxed);
        self.0[1].store(bits[2] | bits[3] << 32, Relaxed);
    }
}

/// What all tiles share.
#[derive(Default)]
pub(super) struct Increments {
    /// None before the first sweep.
    pub units: Option<Units>,
    pub now: Vec<Increment>,
    /// Before the last sweep.
    pub last: Vec<Increment>,
    /// What the last sweep of each tile has added up.
    pub sums: Vec<[Shared; 2]>,
    /// Number of the run, and of the last one in which a tile had a body.
    pub run: u32,
    pub runs: Vec<AtomicU32>,
    /// Scratch: the place of a body in the list of a tile.
    pub places: Vec<AtomicU32>,
}

impl Increments {
    /// Of another problem with so many bodies. Nothing has been changed of their velocities: a run leaves no changes.
    pub fn forget(&mut self, bodies: usize, tiles: usize) {
        self.units = None;
        crate::reserve(&mut self.sums, tiles);
        self.sums.resize_with(tiles, Default::default);
        for all in [&mut self.now, &mut self.last] {
            crate::reserve(all, bodies);
            all.resize_with(bodies, Increment::default);
        }
        crate::reserve(&mut self.places, bodies);
        self.places.resize_with(bodies, || AtomicU32::new(NONE));
        crate::reserve(&mut self.runs, bodies);
        self.runs.resize_with(bodies, AtomicU32::default);
    }

    /// Begins a run.
    pub fn next_run(&mut self) {
        self.run = self.run.wrapping_add(1);
    }

    /// In which sweeps compute.
    pub fn units(&self) -> Units {
        self.units.expect("units are chosen before the first sweep")
    }

    /// Velocity of a body as it is, m/s.
    pub fn velocity<const D: usize>(&self, bodies: &Bodies<D>, i: usize) -> Vector<D> {
        let w = self.now[i].get();
        bodies.velocity(i) + Vector::from_fn(|a, _| f64::from(w[a]) * self.units().speed)
    }
}
