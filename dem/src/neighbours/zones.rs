//! Zones of velocities: their numbers, those near a segment, and those next to each other.

use super::{Grid, each_cell};
use crate::space::Vector;

impl<const D: usize> Grid<D> {
    /// Number of zones of velocities: the cells of tiles, and each wide grain.
    pub fn zones(&self) -> usize {
        self.level_dims(self.base).iter().product::<i64>() as usize + self.wide.len()
    }

    /// The zone of a grain, by its slot and place.
    pub fn zone_of(&self, slot: usize, x: &Vector<D>) -> usize {
        match slot.checked_sub(self.first_wide()) {
            Some(wide) => self.zones() - self.wide.len() + wide,
            None => self.zone(&self.locate(x).map(|q| q >> self.base)),
        }
    }

    /// The zone of a cell of tiles.
    pub(super) fn zone(&self, q: &[i64; D]) -> usize {
        let dims = self.level_dims(self.base);
        (0..D).rev().fold(0, |index, a| index * dims[a] + q[a]) as usize
    }

    /// Zones with grains that a segment may meet: those whose distance from it is at most `radii` radii of the
    /// grain and `range`; some more than once where the domain is periodic.
    pub fn near_segment(&self, points: &[Vector<D>; 2], radii: f64, range: f64, mut f: impl FnMut(usize)) {
        if self.period.is_none() {
            return self.near_image(points, radii, range, &mut f);
        }
        let middle = 0.5 * (points[0] + points[1]);
        let along = points[1] - points[0];
        let beyond = 0.5 * along.norm() + radii * self.widest() + range;
        self.images(&self.period.wrap(middle), beyond, |image| {
            self.near_image(&[image - along * 0.5, image + along * 0.5], radii, range, &mut f);
        });
    }

    /// The largest radius of all, m.
    fn widest(&self) -> f64 {
        self.wide.iter().fold(self.largest, |most, wide| most.max(wide.radius))
    }

    fn near_image(&self, points: &[Vector<D>; 2], radii: f64, range: f64, f: &mut impl FnMut(usize)) {
        let width = self.width();
        let along = points[1] - points[0];
        let distance = |x: &Vector<D>| {
            let share = ((x - points[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (x - points[0] - along * share).norm()
        };
        let grow = radii * self.largest + range;
        let [low, high] = [
            points[0].inf(&points[1]) - Vector::<D>::repeat(grow),
            points[0].sup(&points[1]) + Vector::<D>::repeat(grow),
        ];
        let dims = self.level_dims(self.base);
        let low = self.locate(&low).map(|q| q >> self.base);
        let high = self.locate(&high).map(|q| (q >> self.base) + 1);
        let far = grow + 0.5 * width * (D as f64).sqrt();
        each_cell(&low, &high, |q| {
            // Border cells hold whatever lies beyond them too.
            let border = (0..D).any(|a| q[a] == 0 || q[a] == dims[a] - 1);
            let centre = Vector::<D>::from_fn(|a, _| self.origin[a] + (q[a] as f64 + 0.5) * width);
            if border || distance(&centre) <= far {
                f(self.zone(q));
            }
        });
        let first = self.zones() - self.wide.len();
        for (k, wide) in self.wide.iter().enumerate() {
            if distance(&wide.position) <= radii * wide.radius + range {
                f(first + k);
            }
        }
    }

    /// For each zone the union of what the zones have whose grains may meet its own, itself among them.
    pub fn spread<T: Copy>(&self, own: &[T], into: &mut Vec<T>, union: impl Fn(&mut T, &T)) {
        into.clear();
        into.extend_from_slice(own);
        let first = self.zones() - self.wide.len();
        // Neighbours along one axis after the other are all of them.
        let mut stride = 1;
        for cells in self.level_dims(self.base).map(|cells| cells as usize) {
            let lines = (0..first).step_by(stride * cells).flat_map(|plane| plane..plane + stride);
            for start in lines {
                let mut before = None;
                for zone in (start..start + cells * stride).step_by(stride) {
                    let here = into[zone];
                    if let Some(before) = before.replace(here) {
                        union(&mut into[zone], &before);
                    }
                    if zone + stride < start + cells * stride {
                        let next = into[zone + stride];
                        union(&mut into[zone], &next);
                    }
                }
            }
            stride *= cells;
        }
        let mut meet = |a: usize, b: usize| {
            union(&mut into[a], &own[b]);
            union(&mut into[b], &own[a]);
        };
        for (k, wide) in self.wide.iter().enumerate() {
            wide.cells.iter().for_each(|q| meet(first + k, self.zone(q)));
        }
        self.wide_pairs.iter().for_each(|[a, b]| meet(first + *a as usize, first + *b as usize));
        self.across.iter().for_each(|pair| meet(pair.zones[0] as usize, pair.zones[1] as usize));
    }
}
