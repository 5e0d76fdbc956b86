//! Initial packings: lattices, random loose fills, beds built grain by grain and settled by gravity, and tables.

mod deposit;
mod fraction;
mod lying;
mod pour;
mod random;
mod regular;
mod rolling;
mod room;
mod sizes;
mod source;
mod table;
#[cfg(test)]
mod tests;

pub use deposit::{Deposit, Settled, deposit, loose};
pub use fraction::solid_fraction;
pub use pour::{Method, pour};
pub use random::{random, random_within};
pub use regular::{Lattice, lattice};
pub use room::{check_deposit, check_lattice, check_random};
pub use sizes::{By, SizeLaw};
pub use source::mixed;
pub use table::{Kinds, Table, read_table, write_table};

use crate::error::{Error, Result, check};
use crate::{Material, Vector, Wall};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// A box; grains lie wholly inside.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region<const D: usize> {
    /// Lower corner, m.
    pub low: Vector<D>,
    /// Upper corner, m.
    pub high: Vector<D>,
}

/// Law of the radii, m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Radii {
    /// All alike.
    Constant(f64),
    /// Uniform between two bounds.
    Uniform {
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// Shares of the number of grains up to these radii, from 0 to 1, linear between: [`Radii::by_law`].
    Table {
        /// Radii, increasing.
        radius: Vec<f64>,
        /// Share of the grains that are smaller.
        share: Vec<f64>,
    },
    /// These, drawn in this order; the list also bounds the number of grains.
    List(Vec<f64>),
    /// These, each with its material, drawn in this order: [`mixed`]. The list also bounds the number of grains.
    Mixed(Vec<(f64, u8)>),
}

/// How many grains.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Amount {
    /// This many.
    Count(usize),
    /// As many as bring the total mass nearest to this, kg (per metre of depth in the plane); at least half of that of
    /// a grain.
    Mass(f64),
    /// As many as the region takes.
    Fill,
}

/// What to fill a region with.
#[derive(Clone, Debug, PartialEq)]
pub struct Fill<'a> {
    /// Law of the radii.
    pub radii: Radii,
    /// How many.
    pub amount: Amount,
    /// Index of the material.
    pub material: u8,
    /// All materials of the scene.
    pub materials: &'a [Material],
    /// Seed of the generator (PCG XSL RR 128/64, so that every machine draws the same grains).
    pub seed: u64,
}

impl<const D: usize> Region<D> {
    fn validate(&self) -> Result<()> {
        for a in 0..D {
            let size = self.high[a] - self.low[a];
            check(size > 0.0 && size.is_finite(), size, "it must be positive", || {
                format!("region, size along axis {a}")
            })?;
        }
        Ok(())
    }

    fn volume(&self) -> f64 {
        (self.high - self.low).product()
    }
}

impl Radii {
    /// Smallest and largest radius, m; an error if one is not positive.
    pub fn bounds(&self) -> Result<(f64, f64)> {
        let (min, max) = match self {
            Self::Constant(r) => (*r, *r),
            Self::Uniform { min, max } => (*min, *max),
            Self::Table { radius, .. } => match radius.as_slice() {
                [first, .., last] => (*first, *last),
                _ => return Err(Error::Scene("a table of radii has two rows or more".into())),
            },
            Self::Mixed(list) => {
                return Self::List(list.iter().map(|grain| grain.0).collect()).bounds();
            }
            Self::List(list) if list.is_empty() => {
                return Err(Error::Scene("the list of radii is empty".into()));
            }
            // NaN must not vanish in min and max.
            Self::List(list) => match list.iter().find(|r| !r.is_finite()) {
                Some(bad) => (*bad, *bad),
                None => list.iter().fold((f64::MAX, 0.0), |(lo, hi), &r| (r.min(lo), r.max(hi))),
            },
        };
        check(min > 0.0 && min.is_finite(), min, "it must be positive", || "radius".into())?;
        check(max >= min && max.is_finite(), max, "it must be at least the smallest", || {
            "largest radius".into()
        })?;
        Ok((min, max))
    }
}

/// How far a packing is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// Grains are put in their first places.
    Placing {
        /// Grains placed.
        done: usize,
        /// Grains in all, about.
        of: usize,
    },
    /// The contact solver brings them to rest.
    Settling {
        /// Steps taken.
        step: usize,
        /// Steps at most.
        of: usize,
        /// Root mean square of the velocities, m/s.
        speed: f64,
    },
}

/// Who is told how far a packing is, many times a second, and may end it by [`ControlFlow::Break`].
pub type Observer<'a> = dyn FnMut(Progress) -> ControlFlow<()> + 'a;

/// An [`Observer`] that lets everything go on.
pub fn unobserved(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn tell(observer: &mut Observer<'_>, progress: Progress) -> Result<()> {
    match observer(progress) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    }
}

/// The region takes fewer grains than are asked for.
fn full(placed: usize) -> Error {
    Error::Scene(format!(
        "the region is full after {placed} grains and more are asked for: make it larger or ask for fewer"
    ))
}

/// Floor and sides of a region, but for those along which a wall stands already.
fn container(region: &Region<2>, walls: &[Wall<2>]) -> Vec<Wall<2>> {
    let (low, high) = (region.low, region.high);
    let corner = |x: f64, y: f64| Vector::<2>::new(x, y);
    let sides = [
        Wall::new("floor", low, corner(high[0], low[1])),
        Wall::new("left", low, corner(low[0], high[1])),
        Wall::new("right", corner(high[0], low[1]), high),
    ];
    let slack = 1e-9 * (high - low).norm();
    let stands = |side: &Wall<2>| {
        walls.iter().any(|wall| {
            let segment = lying::Segment::new(wall.at(0.0));
            side.points.iter().all(|end| segment.arm(end).norm() <= slack)
        })
    };
    sides.into_iter().filter(|side| !stands(side)).collect()
}
