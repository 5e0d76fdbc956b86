//! Grains wider than the cells of tiles.

use super::{Grid, each_cell};
use crate::space::Vector;
use crate::velocity_bounds::SKIN;
use std::ops::Range;

/// A grain wider than the cells of tiles.
pub(super) struct Wide<const D: usize> {
    pub position: Vector<D>,
    pub radius: f64,
    /// Cells of the base in which it may meet a grain.
    pub cells: Vec<[i64; D]>,
}

impl<const D: usize> Default for Wide<D> {
    fn default() -> Self {
        Self { position: Vector::zeros(), radius: 0.0, cells: vec![] }
    }
}

impl<const D: usize> Grid<D> {
    /// The grains above the base, where they reach and whom.
    pub(super) fn gather_wide(&mut self, position: &[Vector<D>], radius: &[f64], reach: f64) {
        let first = self.first_wide();
        let mut wide = std::mem::take(&mut self.wide);
        wide.resize_with(self.grain_of.len() - first, Wide::default);
        let width = (1u64 << self.base) as f64 / self.inverse;
        let dims = self.level_dims(self.base);
        for (grain, &i) in wide.iter_mut().zip(&self.grain_of[first..]) {
            (grain.position, grain.radius) = (position[i as usize], radius[i as usize]);
            let Wide { position, radius, cells } = grain;
            cells.clear();
            // A grain of the base is at most half a cell wide beside its centre, which lies anywhere in its cell.
            let far = *radius * (1.0 + SKIN) + reach + width;
            let [low, high] = [-far, far].map(|far| self.locate(&(*position + Vector::<D>::repeat(far))));
            each_cell(&low.map(|q| q >> self.base), &high.map(|q| (q >> self.base) + 1), |q| {
                let centre = Vector::<D>::from_fn(|a, _| self.origin[a] + (q[a] as f64 + 0.5) * width);
                // Border cells hold whatever lies beyond them too.
                let border = (0..D).any(|a| q[a] == 0 || q[a] == dims[a] - 1);
                if border || (centre - *position).norm() <= far + 0.5 * width * (D as f64).sqrt() {
                    cells.push(*q);
                }
            });
        }
        let mut pairs = std::mem::take(&mut self.wide_pairs);
        pairs.clear();
        self.each_wide(|a, others| {
            for b in others {
                pairs.push([a, b].map(|slot| (slot - first) as u32));
            }
        });
        let near = |[a, b]: &[u32; 2]| {
            let (a, b) = (&wide[*a as usize], &wide[*b as usize]);
            (a.position - b.position).norm() < (a.radius + b.radius) * (1.0 + SKIN) + reach
        };
        pairs.retain(near);
        (self.wide, self.wide_pairs) = (wide, pairs);
    }

    /// [`Self::each_in_tile`] for the tile of the wide grains.
    pub(super) fn each_of_wide(&self, mut f: impl FnMut(usize, usize, Option<Range<usize>>)) {
        let (slot, zone) = (self.first_wide(), self.zones() - self.wide.len());
        for (k, wide) in self.wide.iter().enumerate() {
            f(zone + k, slot + k, None);
            for q in &wide.cells {
                for level in 0..=self.base {
                    let s = self.base - level;
                    each_cell(&q.map(|q| q << s), &q.map(|q| (q + 1) << s), |q| {
                        f(zone + k, slot + k, Some(self.slots(self.cell(level, q))));
                    });
                }
            }
        }
        for [a, b] in self.wide_pairs.iter().map(|pair| pair.map(|k| k as usize)) {
            f(zone + a, slot + a, Some(slot + b..slot + b + 1));
        }
    }

    /// Calls `f` for the slots of wide grains with other ones on their level and coarser ones.
    fn each_wide(&self, mut f: impl FnMut(usize, Range<usize>)) {
        for level in self.base + 1..self.levels {
            each_cell(&[0; D], &self.level_dims(level), |q| {
                self.each_pair(level, q, self.levels - 1, &mut f)
            });
        }
    }
}
