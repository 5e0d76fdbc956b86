//! Grains at random places.

use super::source::Source;
use super::{Amount, Fill, Observer, Progress, Region, check_random, tell};
use crate::error::{Error, Result};
use crate::{Particles, Period, Vector};
use rand::Rng;

/// Tries at a place for each grain before the region counts as full.
const TRIES: usize = 2000;
/// Grains between two reports.
const REPORT: usize = 64;

/// Grains at random places without overlap, one after the other (random sequential addition: up to about
/// half of the region in the plane, a third in space).
///
/// # Errors
/// Values without meaning; no place for a grain that is asked for; an end asked for by the observer.
pub fn random<const D: usize>(
    region: &Region<D>,
    fill: &Fill<'_>,
    observer: &mut Observer<'_>,
) -> Result<Particles<D>> {
    random_within(region, fill, &Period::default(), observer)
}

/// The same in a periodic domain: where the region leads from side to side, grains lie across the sides too.
///
/// # Errors
/// Those of [`random`].
pub fn random_within<const D: usize>(
    region: &Region<D>,
    fill: &Fill<'_>,
    period: &Period<D>,
    observer: &mut Observer<'_>,
) -> Result<Particles<D>> {
    check_random(region, fill)?;
    let endless = std::array::from_fn(|axis| {
        let size = region.high[axis] - region.low[axis];
        period.length(axis).is_some_and(|length| (size - length).abs() <= 1e-9 * length)
    });
    let mut source = Source::<D>::new(fill)?;
    let of = source.expected(region)?;
    let mut occupied = Occupied::new(region, 2.0 * fill.radii.bounds()?.1, endless);
    let (mut position, mut radius): (Vec<Vector<D>>, Vec<f64>) = (vec![], vec![]);
    while let Some(r) = source.next() {
        if position.len().is_multiple_of(REPORT) {
            tell(observer, Progress::Placing { done: position.len(), of })?;
        }
        let size = region.high - region.low;
        let gap = Vector::<D>::from_fn(|axis, _| if endless[axis] { 0.0 } else { r });
        let room = size - gap * 2.0;
        let mut place = || {
            let share = Vector::<D>::from_fn(|_, _| source.rng.random::<f64>());
            let x = region.low + gap + room.component_mul(&share);
            occupied.is_free(&x, r, &position, &radius).then_some(x)
        };
        match if room.min() >= 0.0 { (0..TRIES).find_map(|_| place()) } else { None } {
            Some(x) => {
                occupied.insert(&x, position.len());
                position.push(x);
                radius.push(r);
            }
            None if matches!(fill.amount, Amount::Fill) => break,
            None => {
                let n = position.len();
                return Err(Error::Scene(format!(
                    "no room for grain {n} of radius {r} after {TRIES} tries: make the region larger or ask for fewer"
                )));
            }
        }
    }
    source.grains(position, radius)
}

/// Which grains lie in which cell, the cells as wide as the largest diameter.
struct Occupied<const D: usize> {
    low: Vector<D>,
    width: f64,
    dims: [usize; D],
    cells: Vec<Vec<u32>>,
    /// Length of the region along axes where its sides are one; 0 along the others.
    period: Vector<D>,
}

impl<const D: usize> Occupied<D> {
    fn new(region: &Region<D>, width: f64, endless: [bool; D]) -> Self {
        // Few large cells would be slow, many small ones large: at most some ten million.
        let width = width.max((region.volume() * 1e-7).powf(1.0 / D as f64));
        let dims: [usize; D] =
            std::array::from_fn(|a| ((region.high[a] - region.low[a]) / width).ceil().max(1.0) as usize);
        let size = |axis: usize| region.high[axis] - region.low[axis];
        let period = Vector::from_fn(|axis, _| if endless[axis] { size(axis) } else { 0.0 });
        Self { low: region.low, width, dims, cells: vec![vec![]; dims.iter().product()], period }
    }

    fn cell(&self, x: &Vector<D>) -> [usize; D] {
        std::array::from_fn(|a| (((x[a] - self.low[a]) / self.width) as usize).min(self.dims[a] - 1))
    }

    fn index(&self, q: &[usize; D]) -> usize {
        (0..D).rev().fold(0, |index, a| index * self.dims[a] + q[a])
    }

    fn insert(&mut self, x: &Vector<D>, grain: usize) {
        let index = self.index(&self.cell(x));
        self.cells[index].push(grain as u32);
    }

    fn is_free(&self, x: &Vector<D>, r: f64, position: &[Vector<D>], radius: &[f64]) -> bool {
        if self.period == Vector::<D>::zeros() {
            return self.is_image_free(x, r, position, radius);
        }
        let images = crate::space::stencil::<D>(false).into_iter();
        images
            .map(|shift| Vector::<D>::from_fn(|axis, _| shift[axis] as f64 * self.period[axis]))
            .all(|shift| self.is_image_free(&(x + shift), r, position, radius))
    }

    fn is_image_free(&self, x: &Vector<D>, r: f64, position: &[Vector<D>], radius: &[f64]) -> bool {
        let q = self.cell(x);
        crate::space::stencil::<D>(false).iter().all(|offset| {
            let p: [i64; D] = std::array::from_fn(|a| q[a] as i64 + offset[a]);
            if (0..D).any(|a| p[a] < 0 || p[a] >= self.dims[a] as i64) {
                return true;
            }
            self.cells[self.index(&p.map(|p| p as usize))].iter().all(|&k| {
                let reach = r + radius[k as usize];
                (position[k as usize] - x).norm_squared() >= reach * reach
            })
        })
    }
}
