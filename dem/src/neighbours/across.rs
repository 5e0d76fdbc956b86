//! Pairs of grains that may meet across periodic sides. They make a tile of their own, with a colour of its own: the
//! cells of the grid end at the sides.

use super::Grid;
use crate::space::{Vector, stencil};
use crate::velocity_bounds::SKIN;
use std::ops::Range;

/// Two grains that may meet across a side: their slots and zones.
#[derive(Clone, Copy)]
pub(super) struct Across {
    slots: [u32; 2],
    pub zones: [u32; 2],
}

impl<const D: usize> Grid<D> {
    /// Finds the pairs closer than the sum of their radii with skins + `reach` of which the one is nearest to an image
    /// of the other.
    pub(super) fn gather_across(&mut self, position: &[Vector<D>], radius: &[f64], reach: f64) {
        self.across.clear();
        if self.period.is_none() {
            return;
        }
        let mut across = std::mem::take(&mut self.across);
        let shifts = stencil::<D>(true).into_iter();
        let period = self.period;
        for shift in shifts.filter(|shift| (0..D).all(|a| shift[a] == 0 || period.length(a).is_some())) {
            self.pairs_of_shift(&shift, position, radius, reach, &mut across);
        }
        self.across = across;
    }

    /// The pairs of which the second is nearest to the image of the first by one period along each axis that is not
    /// zero.
    fn pairs_of_shift(
        &self,
        shift: &[i64; D],
        position: &[Vector<D>],
        radius: &[f64],
        reach: f64,
        out: &mut Vec<Across>,
    ) {
        let largest = radius.iter().fold(0.0, |most: f64, r| most.max(*r));
        let range = |i: usize| (radius[i] + largest) * (1.0 + SKIN) + reach;
        // Near the side that its image, or that it itself, is next to.
        let near = |i: usize, forward: bool| {
            (0..D).all(|a| {
                let Some([low, high]) = self.period.sides()[a].filter(|_| shift[a] != 0) else { return true };
                let from_low = (shift[a] > 0) == forward;
                let gap = if from_low { position[i][a] - low } else { high - position[i][a] };
                gap < range(i)
            })
        };
        let along = (0..D).find(|a| shift[*a] == 0).unwrap_or(D - 1);
        let list = |forward: bool| {
            let slots = 0..self.grain_of.len() as u32;
            let mut list: Vec<(f64, u32)> = slots
                .map(|slot| (slot, self.grain_of[slot as usize] as usize))
                .filter(|(_, i)| near(*i, forward))
                .map(|(slot, i)| (position[i][along], slot))
                .collect();
            list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            list
        };
        let (firsts, seconds) = (list(true), list(false));
        // Along a periodic axis with a shift of its own, places are no measure of distance.
        let sweeps = shift[along] == 0 && self.period.length(along).is_none();
        let widest = 2.0 * largest * (1.0 + SKIN) + reach;
        let mut start = 0;
        for (place, a) in firsts {
            let i = self.grain_of[a as usize] as usize;
            while sweeps && start < seconds.len() && seconds[start].0 < place - widest {
                start += 1;
            }
            for (other, b) in &seconds[start..] {
                if sweeps && *other > place + widest {
                    break;
                }
                let j = self.grain_of[*b as usize] as usize;
                let way = position[j] - position[i];
                let belongs = (0..D).all(|axis| match self.period.length(axis) {
                    None => true,
                    Some(length) if shift[axis] == 0 => way[axis].abs() <= 0.5 * length,
                    Some(length) => way[axis] * shift[axis] as f64 > 0.5 * length,
                });
                let most = (radius[i] + radius[j]) * (1.0 + SKIN) + reach;
                if belongs && self.period.nearest(way).norm_squared() < most * most {
                    let zones = [(a, i), (*b, j)].map(|(slot, i)| self.zone_of(slot as usize, &position[i]));
                    out.push(Across { slots: [a, *b], zones: zones.map(|zone| zone as u32) });
                }
            }
        }
    }

    /// [`Self::each_in_tile`] for the tile of the pairs across sides.
    pub(super) fn each_across(&self, mut f: impl FnMut(usize, usize, Option<Range<usize>>)) {
        for Across { slots: [a, b], zones } in &self.across {
            f(zones[0] as usize, *a as usize, Some(*b as usize..*b as usize + 1));
        }
    }

    /// Calls `f` with the images of a point that lie in the domain or no more than a distance beyond it.
    pub(super) fn images(&self, x: &Vector<D>, beyond: f64, mut f: impl FnMut(&Vector<D>)) {
        f(x);
        if self.period.is_none() {
            return;
        }
        for shift in stencil::<D>(false).into_iter().filter(|shift| shift.iter().any(|s| *s != 0)) {
            let mut image = *x;
            let inside = (0..D).all(|a| match self.period.sides()[a] {
                None => shift[a] == 0,
                Some([low, high]) => {
                    image[a] += shift[a] as f64 * (high - low);
                    image[a] >= low - beyond && image[a] <= high + beyond
                }
            });
            if inside {
                f(&image);
            }
        }
    }
}
