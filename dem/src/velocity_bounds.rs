//! How far apart two grains may be and still meet within one sub-step.
//!
//! Two grains meet only if their relative velocity closes their gap. Each zone of the grid (a cell, or a grain wider
//! than cells) knows the box of the velocities in it (before and after the forces act, and those of walls); `near` is
//! the union with its neighbours. As long as every final velocity lies in the `near` box of its zone, two grains of
//! neighbouring zones differ by at most the diagonal of the union of `near` around either: that times the sub-step,
//! with a skin, is the range of detection. Velocities in common (a falling bed) cost nothing. The final velocities are
//! checked; a grain thrown out of its box repeats the sub-step with the box widened, so no contact is missed.

use crate::neighbours::Grid;
use crate::space::Vector;

/// Share of its radius by which a grain may leave the box of velocities, and half of which widens every gap.
pub(crate) const SKIN: f64 = 0.02;

#[derive(Clone, Copy)]
struct VelocityBox<const D: usize> {
    low: [f32; D],
    high: [f32; D],
}

impl<const D: usize> VelocityBox<D> {
    const EMPTY: Self = Self { low: [f32::INFINITY; D], high: [f32::NEG_INFINITY; D] };

    fn add(&mut self, v: &Vector<D>) {
        for a in 0..D {
            self.low[a] = self.low[a].min(v[a] as f32);
            self.high[a] = self.high[a].max(v[a] as f32);
        }
    }

    fn merge(&mut self, other: &Self) {
        for a in 0..D {
            self.low[a] = self.low[a].min(other.low[a]);
            self.high[a] = self.high[a].max(other.high[a]);
        }
    }

    fn diagonal(&self) -> f64 {
        let square = |a: usize| (self.high[a] - self.low[a]).max(0.0) as f64;
        (0..D).map(|a| square(a) * square(a)).sum::<f64>().sqrt()
    }

    fn contains(&self, v: &Vector<D>, tolerance: f64) -> bool {
        (0..D).all(|a| v[a] >= self.low[a] as f64 - tolerance && v[a] <= self.high[a] as f64 + tolerance)
    }
}

#[derive(Default)]
pub(crate) struct VelocityBounds<const D: usize> {
    own: Vec<VelocityBox<D>>,
    near: Vec<VelocityBox<D>>,
    /// Largest relative speed of two grains of which one lies in the zone, m/s.
    speed: Vec<f32>,
}

impl<const D: usize> VelocityBounds<D> {
    pub fn clear(&mut self, zones: usize) {
        self.own.clear();
        self.own.resize(zones, VelocityBox::EMPTY);
    }

    pub fn add(&mut self, zone: usize, v: &Vector<D>) {
        self.own[zone].add(v);
    }

    /// Spreads the boxes over the neighbouring zones.
    pub fn close(&mut self, grid: &Grid<D>) {
        grid.spread(&self.own, &mut self.near, VelocityBox::merge);
        grid.spread(&self.near, &mut self.own, VelocityBox::merge);
        self.speed.clear();
        self.speed.extend(self.own.iter().map(|b| b.diagonal() as f32));
    }

    /// Largest relative speed that grains of a zone may meet, m/s.
    pub fn speed(&self, zone: usize) -> f64 {
        self.speed[zone] as f64
    }

    /// Whether a final velocity keeps within what detection assumed; `travel` is h.
    pub fn allows(&self, zone: usize, v: &Vector<D>, radius: f64, h: f64) -> bool {
        // A velocity that is not finite is nothing that a wider search could mend.
        self.near[zone].contains(v, 0.5 * SKIN * radius / h) || !v.iter().all(|x| x.is_finite())
    }
}

/// Diagonal of the box of all given velocities, m/s.
pub(crate) fn diagonal<const D: usize>(velocities: impl Iterator<Item = Vector<D>>) -> f64 {
    let mut all = VelocityBox::EMPTY;
    velocities.for_each(|v| all.add(&v));
    all.diagonal()
}
