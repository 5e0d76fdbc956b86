//! Regular lattices.

use super::source::Source;
use super::{Fill, Region};
use crate::error::{Error, Result, check};
use crate::{Particles, Vector};
use serde::{Deserialize, Serialize};

/// Regular arrangements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lattice {
    /// Rows above each other (a cubic lattice in space).
    Square,
    /// Rows shifted by half a spacing; the plane only.
    Triangular,
}

/// The points of a lattice in a region.
pub(super) struct Points<const D: usize> {
    first: Vector<D>,
    /// Distance of neighbours in a row, and of rows, m.
    step: f64,
    rise: f64,
    shift: f64,
    /// How far grains may go from the first along each axis, m.
    room: Vector<D>,
}

impl<const D: usize> Points<D> {
    /// `spacing` is the distance of neighbours over the largest diameter.
    pub fn new(region: &Region<D>, kind: Lattice, spacing: f64, largest: f64) -> Result<Self> {
        region.validate()?;
        check(spacing >= 1.0 && spacing.is_finite(), spacing, "it must be at least 1", || "spacing".into())?;
        if D != 2 && kind == Lattice::Triangular {
            return Err(Error::PlaneOnly("the triangular lattice"));
        }
        let step = 2.0 * largest * spacing;
        let (rise, shift) = match kind {
            Lattice::Square => (step, 0.0),
            Lattice::Triangular => (step * 0.75f64.sqrt(), 0.5 * step),
        };
        // A hair of tolerance, so that a region of exactly n diameters takes n grains.
        let room = (region.high - region.low).add_scalar(-2.0 * largest + 1e-9 * largest);
        Ok(Self { first: region.low.add_scalar(largest), step, rise, shift, room })
    }

    /// Points along an axis; along the first in a row that is shifted or not.
    fn along(&self, axis: usize, shifted: bool) -> usize {
        let (step, start) =
            (if axis == D - 1 { self.rise } else { self.step }, if shifted { self.shift } else { 0.0 });
        if self.room[axis] < start { 0 } else { ((self.room[axis] - start) / step) as usize + 1 }
    }

    /// How many points there are.
    pub fn count(&self) -> usize {
        let rows = self.along(D - 1, false);
        let odd = if self.shift > 0.0 { self.along(0, true) } else { self.along(0, false) };
        let layers: usize = (1..D - 1).map(|axis| self.along(axis, false)).product();
        layers * (rows.div_ceil(2) * self.along(0, false) + rows / 2 * odd)
    }

    /// The points, rows along the first axis, from the bottom upwards.
    pub fn iter(&self) -> impl Iterator<Item = Vector<D>> + '_ {
        let rows = self.along(D - 1, false);
        let layers: usize = (1..D - 1).map(|axis| self.along(axis, false)).product();
        (0..rows * layers).flat_map(move |k| {
            let (row, layer) = (k / layers, k % layers);
            let shifted = self.shift > 0.0 && row % 2 == 1;
            (0..self.along(0, shifted)).map(move |column| {
                let shift = if shifted { self.shift } else { 0.0 };
                self.first
                    + Vector::from_fn(|a, _| match a {
                        0 => column as f64 * self.step + shift,
                        a if a == D - 1 => row as f64 * self.rise,
                        _ => layer as f64 * self.step,
                    })
            })
        })
    }
}

/// Fills a region row by row with a lattice; `spacing` is the distance of neighbours over the largest diameter, at
/// least 1.
///
/// # Errors
/// Values without meaning; more grains asked for than there are points.
pub fn lattice<const D: usize>(
    region: &Region<D>,
    kind: Lattice,
    spacing: f64,
    fill: &Fill<'_>,
) -> Result<Particles<D>> {
    let mut source = Source::<D>::new(fill)?;
    let points = Points::new(region, kind, spacing, fill.radii.bounds()?.1)?;
    let (mut position, mut radius) = (vec![], vec![]);
    for x in points.iter() {
        let Some(r) = source.next() else { break };
        position.push(x);
        radius.push(r);
    }
    source.finish()?;
    source.grains(position, radius)
}
