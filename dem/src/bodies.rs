//! Velocities during the sweeps.
//!
//! Tiles of one colour write disjoint grains, which the borrow checker cannot see. Relaxed atomics say so without
//! `unsafe`: on x86-64 and ARM they are plain loads and stores, and since no two threads meet, order does not matter.

use crate::space::{Vector, turned};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// An f64 that several threads may hold.
#[derive(Default)]
pub(crate) struct Shared(AtomicU64);

impl Shared {
    #[inline(always)]
    pub fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Relaxed))
    }
    #[inline(always)]
    pub fn set(&self, value: f64) {
        self.0.store(value.to_bits(), Relaxed);
    }
}

/// Velocity of a grain and its mobility 1 / (m + gamma dt), 1/kg; zero for walls.
struct Body<const D: usize> {
    velocity: [Shared; D],
    mobility: f64,
}

/// Speed r w of the surface, m/s, and r^2 / I, 1/kg.
#[derive(Default)]
struct Spin {
    surface: Shared,
    mobility: f64,
}

/// All grains in slot order, then one body for each contact with a wall.
#[derive(Default)]
pub(crate) struct Bodies<const D: usize> {
    body: Vec<Body<D>>,
    /// Empty without rotation.
    spin: Vec<Spin>,
}

impl<const D: usize> Bodies<D> {
    pub fn clear(&mut self) {
        self.body.clear();
        self.spin.clear();
    }

    pub fn len(&self) -> usize {
        self.body.len()
    }

    /// Makes room for `n` bodies, and an eighth more when it must grow: contacts with walls come and go.
    pub fn reserve(&mut self, n: usize, spinning: bool) {
        crate::reserve(&mut self.body, n);
        if spinning {
            crate::reserve(&mut self.spin, n);
        }
    }

    pub fn push(&mut self, velocity: &Vector<D>, mobility: f64) {
        let velocity = std::array::from_fn(|a| Shared(AtomicU64::new(velocity[a].to_bits())));
        self.body.push(Body { velocity, mobility });
    }

    pub fn push_spin(&mut self, surface: f64, mobility: f64) {
        self.spin.push(Spin { surface: Shared(AtomicU64::new(surface.to_bits())), mobility });
    }

    pub fn spins(&self) -> bool {
        !self.spin.is_empty()
    }

    #[inline(always)]
    pub fn velocity(&self, i: usize) -> Vector<D> {
        let body = &self.body[i];
        Vector::from_fn(|a, _| body.velocity[a].get())
    }

    #[inline(always)]
    pub fn set_velocity(&self, i: usize, v: &Vector<D>) {
        let body = &self.body[i];
        for a in 0..D {
            body.velocity[a].set(v[a]);
        }
    }

    /// Velocity and surface speed of every body.
    pub fn state(&self) -> Vec<(Vector<D>, f64)> {
        let surface = |i: usize| if self.spins() { self.surface(i) } else { 0.0 };
        (0..self.len()).map(|i| (self.velocity(i), surface(i))).collect()
    }

    pub fn set_state(&self, state: &[(Vector<D>, f64)]) {
        for (i, (velocity, surface)) in state.iter().enumerate() {
            self.set_velocity(i, velocity);
            if self.spins() {
                self.set_surface(i, *surface);
            }
        }
    }

    pub fn mobility(&self, i: usize) -> f64 {
        self.body[i].mobility
    }

    /// Mass of the heavier of two bodies, kg; walls and held grains do not count.
    #[inline(always)]
    pub fn heavier(&self, i: usize, j: usize) -> f64 {
        let (a, b) = (self.body[i].mobility, self.body[j].mobility);
        1.0 / if a > 0.0 && b > 0.0 { a.min(b) } else { a.max(b) }
    }

    #[inline(always)]
    pub fn surface(&self, i: usize) -> f64 {
        self.spin[i].surface.get()
    }

    pub fn set_surface(&self, i: usize, s: f64) {
        self.spin[i].surface.set(s);
    }

    pub fn spin_mobility(&self, i: usize) -> f64 {
        self.spin[i].mobility
    }

    /// Relative velocity u of the second body seen from the first at a contact.
    #[inline(always)]
    pub fn relative<const SPIN: bool>(&self, i: usize, j: usize, normal: &Vector<D>) -> Vector<D> {
        let u = self.velocity(j) - self.velocity(i);
        if SPIN { u - turned(normal) * (self.surface(i) + self.surface(j)) } else { u }
    }

    /// Adds an impulse p on the second body and -p on the first.
    #[inline(always)]
    pub fn push_apart<const SPIN: bool>(&self, i: usize, j: usize, normal: &Vector<D>, p: &Vector<D>) {
        let (a, b) = (&self.body[i], &self.body[j]);
        for k in 0..D {
            a.velocity[k].set(a.velocity[k].get() - p[k] * a.mobility);
            b.velocity[k].set(b.velocity[k].get() + p[k] * b.mobility);
        }
        if SPIN {
            let moment = turned(normal).dot(p);
            let (a, b) = (&self.spin[i], &self.spin[j]);
            a.surface.set(a.surface.get() - moment * a.mobility);
            b.surface.set(b.surface.get() - moment * b.mobility);
        }
    }
}
