//! One contact of the interior-point method: its rows, a point inside, and its part of a Newton step.

use super::Friction;
use crate::bodies::Bodies;
use crate::contact::Contact;
use crate::space::{Vector, tangent, turned};

/// Body without unknowns: a wall, a held grain.
pub const FIXED: usize = usize::MAX;

/// A point inside, at one contact; and a step from it. Index 0 of the pairs stays empty: tangents begin at 1.
#[derive(Clone, Copy)]
pub(super) struct Point<const D: usize> {
    /// q, then p_t, N s.
    pub p: [f64; D],
    /// w, m/s.
    pub w: f64,
    /// a and b, N s.
    pub room: [[f64; 2]; D],
    /// y and z, m/s.
    pub slip: [[f64; 2]; D],
}

impl<const D: usize> Point<D> {
    /// Calls `f` with the two factors of each product of `self`, and of `other`.
    pub fn pairs(&self, other: &Self, rubs: bool, mut f: impl FnMut([f64; 2], [f64; 2])) {
        f([self.p[0], self.w], [other.p[0], other.w]);
        for k in 1..if rubs { D } else { 1 } {
            for s in 0..2 {
                f([self.room[k][s], self.slip[k][s]], [other.room[k][s], other.slip[k][s]]);
            }
        }
    }

    pub fn add(&mut self, step: &Self, share: f64) {
        self.w += share * step.w;
        for k in 0..D {
            self.p[k] += share * step.p[k];
            for s in 0..2 {
                self.room[k][s] += share * step.room[k][s];
                self.slip[k][s] += share * step.slip[k][s];
            }
        }
    }
}

/// What the products of a contact shall become.
#[derive(Clone, Copy)]
pub(super) struct Target<const D: usize> {
    pub normal: f64,
    pub tangent: [[f64; 2]; D],
}

/// A contact, with its rows.
pub(super) struct Row<const D: usize> {
    /// Normal, then tangents; and what spin adds to each.
    pub along: [Vector<D>; D],
    pub arm: [f64; D],
    /// First unknown of the two bodies.
    pub place: [usize; 2],
    /// Relative velocity from bodies without unknowns; the bias in the first.
    pub base: [f64; D],
    /// Friction reaches mu q + bound: all of it follows q, or none.
    pub friction: f64,
    pub bound: f64,
    pub cohesion: f64,
}

/// The linear parts of a Newton step at a contact.
pub(super) struct Slopes<const D: usize> {
    pub normal: f64,
    /// 1 / E and (y/a - z/b) mu / E.
    pub tangent: [[f64; 2]; D],
}

impl<const D: usize> Row<D> {
    pub fn new(bodies: &Bodies<D>, c: &Contact<D>, cohesion: f64, unknown: &[usize], law: Friction) -> Self {
        let along: [Vector<D>; D] =
            std::array::from_fn(|k| if k == 0 { c.normal } else { tangent(&c.normal, k - 1) });
        let arm = std::array::from_fn(|k| turned(&c.normal).dot(&along[k]));
        let slots = [c.i as usize, c.j as usize];
        let place = slots.map(|s| unknown[s]);
        let mut base = [0.0; D];
        // Overlaps may lock grains in such a way that nothing takes all of them back.
        base[0] = if law == Friction::Follows { c.bias } else { c.bias.max(0.0) };
        for (side, &slot) in slots.iter().enumerate().filter(|(side, _)| place[*side] == FIXED) {
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let surface = if bodies.spins() { bodies.surface(slot) } else { 0.0 };
            for k in 0..D {
                base[k] += sign * along[k].dot(&bodies.velocity(slot)) - arm[k] * surface;
            }
        }
        // The square in the disc of friction; in the plane both are one segment.
        let friction = c.friction / ((D - 1) as f64).sqrt();
        let bound = friction * (c.impulse.dot(&c.normal) + cohesion);
        let (friction, bound) = match law {
            Friction::Follows => (friction, 0.0),
            Friction::Held => (0.0, bound),
            Friction::Out => (0.0, 0.0),
        };
        Self { along, arm, place, base, friction, bound, cohesion }
    }

    pub fn rubs(&self) -> bool {
        self.reach(1.0) > 0.0
    }

    /// What friction reaches with q.
    pub fn reach(&self, q: f64) -> f64 {
        self.friction * q + self.bound
    }

    /// Coefficients of one of the two bodies in row k: velocity, then spin.
    pub fn coefficient(&self, side: usize, k: usize, unknown: usize) -> f64 {
        let sign = if side == 0 { -1.0 } else { 1.0 };
        if unknown < D { sign * self.along[k][unknown] } else { -self.arm[k] }
    }

    pub fn sides(&self) -> impl Iterator<Item = (usize, usize)> + use<D> {
        self.place.into_iter().enumerate().filter(|(_, place)| *place != FIXED)
    }

    /// h x, for `size` unknowns per body.
    pub fn relative(&self, x: &[f64], size: usize) -> [f64; D] {
        std::array::from_fn(|k| {
            let each = |(side, place): (usize, usize)| {
                (0..size).map(|a| self.coefficient(side, k, a) * x[place + a]).sum::<f64>()
            };
            self.sides().map(each).sum()
        })
    }

    /// out += h^T p.
    pub fn push(&self, p: &[f64; D], out: &mut [f64], size: usize) {
        for (side, place) in self.sides() {
            for a in 0..size {
                out[place + a] += (0..D).map(|k| self.coefficient(side, k, a) * p[k]).sum::<f64>();
            }
        }
    }

    pub fn slopes(&self, x: &Point<D>, follow: f64) -> Slopes<D> {
        let mut slopes = Slopes { normal: x.p[0] / x.w, tangent: [[0.0; 2]; D] };
        if self.rubs() {
            for k in 1..D {
                let [y, z] = [x.slip[k][0] / x.room[k][0], x.slip[k][1] / x.room[k][1]];
                slopes.tangent[k] = [1.0 / (y + z), follow * (y - z) * self.friction / (y + z)];
            }
        }
        slopes
    }

    /// The constants of a Newton step: q, p_t without what follows q, and y, z without what follows the room.
    pub fn constants(&self, x: &Point<D>, u: &[f64; D], target: &Target<D>) -> Point<D> {
        let mut c = Point { p: [0.0; D], w: u[0] - x.w, room: [[0.0; 2]; D], slip: [[0.0; 2]; D] };
        c.p[0] = (target.normal - x.p[0] * u[0]) / x.w;
        if !self.rubs() {
            return c;
        }
        for k in 1..D {
            let mut rate = 0.0;
            for s in 0..2 {
                let sign = if s == 0 { -1.0 } else { 1.0 };
                let [room, slip] = [x.room[k][s], x.slip[k][s]];
                c.room[k][s] = self.reach(x.p[0]) + sign * x.p[k] - room;
                c.slip[k][s] = (target.tangent[k][s] - slip * (room + c.room[k][s])) / room;
                rate += slip / room;
            }
            c.p[k] = -(u[k] + x.slip[k][0] - x.slip[k][1] + c.slip[k][0] - c.slip[k][1]) / rate;
        }
        c
    }

    /// The step of a contact for the change `du` of its relative velocity.
    pub fn step(&self, x: &Point<D>, c: &Point<D>, du: &[f64; D], follow: f64) -> Point<D> {
        let slopes = self.slopes(x, follow);
        let mut step = *c;
        step.p[0] -= slopes.normal * du[0];
        step.w += du[0];
        if self.rubs() {
            for k in 1..D {
                let [stick, drag] = slopes.tangent[k];
                step.p[k] += drag * step.p[0] - stick * du[k];
                for s in 0..2 {
                    let sign = if s == 0 { -1.0 } else { 1.0 };
                    let change = follow * self.friction * step.p[0] + sign * step.p[k];
                    step.room[k][s] += change;
                    step.slip[k][s] -= x.slip[k][s] / x.room[k][s] * change;
                }
            }
        }
        step
    }

    /// The impulse of a point, cut to the law.
    pub fn impulse(&self, x: &Point<D>) -> Vector<D> {
        let bound = self.reach(x.p[0]);
        let tangential = (1..D).map(|k| self.along[k] * x.p[k].max(-bound).min(bound)).sum::<Vector<D>>();
        self.along[0] * (x.p[0] - self.cohesion) + tangential
    }
}
