//! What a region can take at most, known before any grain is placed.

use super::regular::Points;
use super::source::{Source, usual};
use super::{Amount, Fill, Lattice, Radii, Region, full};
use crate::ball;
use crate::error::{Error, Result};

/// Whether the grains of a fill can all come into a region: an error if surely not. Inner walls are not seen.
///
/// Equal discs in a rectangle cover pi / (2 sqrt 3) of it at most (N. Oler, Acta Math. 105, 19, 1961); discs of sizes
/// that differ, in a bed that no one sorts, always less than 0.95.
///
/// # Errors
/// The fill has no meaning, or is too much; the text says how much fits.
pub fn check_deposit(region: &Region<2>, fill: &Fill<'_>) -> Result<()> {
    region.validate()?;
    let (size, largest) = (region.high - region.low, fill.radii.bounds()?.1);
    if size.min() < 2.0 * largest {
        return Err(Error::Scene(format!(
            "the region is {:.4e} m wide and {:.4e} m high: the largest grain needs {:.4e} m",
            size[0],
            size[1],
            2.0 * largest
        )));
    }
    let share = if equal(fill) { 0.9069 } else { 0.95 };
    check_volume(region, fill, share * region.volume(), usual::<2>())
}

/// The same for grains at random places, whose share of a large region in the plane ends at 0.547 for equal discs (E.
/// L. Hinrichsen, J. Feder, T. Jossang, J. Stat. Phys. 44, 793, 1986) and at 0.384 for equal spheres. What is refused
/// here is well above, of the region and half a grain around it.
///
/// # Errors
/// As [`check_deposit`].
pub fn check_random<const D: usize>(region: &Region<D>, fill: &Fill<'_>) -> Result<()> {
    region.validate()?;
    let share = match (D, equal(fill)) {
        (2, true) => 0.6,
        (2, false) => 0.65,
        (_, true) => 0.45,
        (_, false) => 0.5,
    };
    let mean = fill.radii.bounds().map(|(min, max)| min + max)?;
    let around = (region.high - region.low).add_scalar(mean).product();
    check_volume(region, fill, share * around, if D == 2 { 0.5 } else { 0.35 })
}

/// The same for a lattice, whose points are counted.
///
/// # Errors
/// As [`super::lattice`].
pub fn check_lattice<const D: usize>(
    region: &Region<D>,
    kind: Lattice,
    spacing: f64,
    fill: &Fill<'_>,
) -> Result<()> {
    let count = Points::new(region, kind, spacing, fill.radii.bounds()?.1)?.count();
    let mut source = Source::<D>::new(fill)?;
    source.expected(region)?;
    if matches!(fill.amount, Amount::Fill) || (0..=count).any(|_| source.next().is_none()) {
        return Ok(());
    }
    Err(full(count))
}

fn equal(fill: &Fill<'_>) -> bool {
    match &fill.radii {
        Radii::Constant(_) => true,
        Radii::Uniform { min, max } => min == max,
        Radii::Table { .. } => false,
        Radii::List(list) => list.iter().all(|r| *r == list[0]),
        Radii::Mixed(list) => list.iter().all(|grain| grain.0 == list[0].0),
    }
}

/// An error if the grains asked for have together more than a volume; `usual` is the share of the region that they
/// would take.
fn check_volume<const D: usize>(region: &Region<D>, fill: &Fill<'_>, most: f64, usual: f64) -> Result<()> {
    region.validate()?;
    let mut source = Source::<D>::new(fill)?;
    let asked = source.expected(region)?;
    if matches!(fill.amount, Amount::Fill) {
        return Ok(());
    }
    let mut volume = 0.0;
    while let Some(radius) = source.next() {
        volume += ball::<D>(radius);
        if volume > most * (1.0 + 1e-9) {
            let fit = usual * region.volume() / fill.radii.mean_volume::<D>();
            return Err(Error::Scene(format!(
                "the region takes about {fit:.0} grains, and {asked} are asked for: make it larger or ask for fewer"
            )));
        }
    }
    Ok(())
}
