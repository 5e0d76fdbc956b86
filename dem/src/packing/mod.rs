//! Initial packings: lattices, random loose fills, deposits settled by gravity, and tables.

mod deposit;
mod table;

pub use deposit::{Deposit, Settled, deposit};
pub use table::{read_table, write_table};

use crate::error::{Error, Result, check};
use crate::{Material, Particles, Vector, ball};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

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
    /// These, in this order; the list also bounds the number of grains.
    List(Vec<f64>),
}

/// How many grains.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Amount {
    /// This many.
    Count(usize),
    /// As many as bring the total mass nearest to this, kg (per metre of depth in the plane).
    Mass(f64),
    /// As many as the region takes.
    Fill,
}

/// Regular arrangements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lattice {
    /// Rows above each other (a cubic lattice in space).
    Square,
    /// Rows shifted by half a spacing; the plane only.
    Triangular,
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

/// Draws radii until the amount is reached.
struct Source<'a> {
    fill: &'a Fill<'a>,
    rng: Pcg64,
    drawn: usize,
    mass: f64,
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

impl<'a> Source<'a> {
    fn new(fill: &'a Fill<'a>) -> Result<Self> {
        fill.radii.bounds()?;
        if fill.materials.get(fill.material as usize).is_none() {
            let (m, count) = (fill.material, fill.materials.len());
            return Err(Error::Scene(format!("material {m} does not exist: the scene has {count}")));
        }
        if let Amount::Mass(m) = fill.amount {
            check(m > 0.0 && m.is_finite(), m, "it must be positive", || "mass of grains".into())?;
        }
        Ok(Self { fill, rng: Pcg64::seed_from_u64(fill.seed), drawn: 0, mass: 0.0 })
    }

    /// The next radius, or none when the amount is reached.
    fn next<const D: usize>(&mut self) -> Option<f64> {
        if matches!(self.fill.amount, Amount::Count(n) if self.drawn >= n) {
            return None;
        }
        let radius = match &self.fill.radii {
            Radii::Constant(r) => *r,
            Radii::Uniform { min, max } => min + (max - min) * self.rng.random::<f64>(),
            Radii::List(list) => *list.get(self.drawn)?,
        };
        let made_of = &self.fill.materials[self.fill.material as usize];
        let mass = made_of.density * made_of.solidity * ball::<D>(radius);
        if matches!(self.fill.amount, Amount::Mass(m) if self.mass + 0.5 * mass > m) {
            return None;
        }
        self.drawn += 1;
        self.mass += mass;
        Some(radius)
    }

    /// An error if grains are still wanted: the region is full.
    fn finish<const D: usize>(&mut self) -> Result<()> {
        let endless = matches!(self.fill.amount, Amount::Fill);
        if endless || self.next::<D>().is_none() {
            return Ok(());
        }
        let placed = self.drawn - 1;
        Err(Error::Scene(format!(
            "the region is full after {placed} grains and more are asked for: make it larger or ask for fewer"
        )))
    }

    fn grains<const D: usize>(&self, position: Vec<Vector<D>>, radius: Vec<f64>) -> Result<Particles<D>> {
        let material = vec![self.fill.material; position.len()];
        Particles::new(position, radius, material, self.fill.materials)
    }
}

/// Fills a region row by row with a lattice; `spacing` is the distance of neighbours over the largest diameter, at least 1.
pub fn lattice<const D: usize>(
    region: &Region<D>,
    kind: Lattice,
    spacing: f64,
    fill: &Fill<'_>,
) -> Result<Particles<D>> {
    region.validate()?;
    check(spacing >= 1.0 && spacing.is_finite(), spacing, "it must be at least 1", || "spacing".into())?;
    if D != 2 && kind == Lattice::Triangular {
        return Err(Error::PlaneOnly("the triangular lattice"));
    }
    let mut source = Source::new(fill)?;
    let largest = fill.radii.bounds()?.1;
    let step = 2.0 * largest * spacing;
    let rise = if kind == Lattice::Triangular { step * 0.75f64.sqrt() } else { step };
    let first = region.low.add_scalar(largest);
    // A hair of tolerance, so that a region of exactly n diameters takes n grains.
    let room = (region.high - region.low).add_scalar(-2.0 * largest + 1e-9 * largest);
    let (mut position, mut radius) = (vec![], vec![]);
    let mut q = [0usize; D];
    loop {
        let shift = if kind == Lattice::Triangular && q[D - 1] % 2 == 1 { 0.5 * step } else { 0.0 };
        let offset = Vector::<D>::from_fn(|a, _| {
            let along = q[a] as f64 * if a == D - 1 { rise } else { step };
            if a == 0 { along + shift } else { along }
        });
        // The axis along which the point leaves the region; rows grow along the first axis, then the next.
        match (0..D).find(|&a| offset[a] > room[a]) {
            Some(a) if a == D - 1 => break,
            Some(a) => {
                q[a] = 0;
                q[a + 1] += 1;
                // A shifted row may be too narrow for a single grain: it is skipped, not endless.
                if room[a] < 0.0 {
                    break;
                }
            }
            None => {
                let Some(r) = source.next::<D>() else { break };
                position.push(first + offset);
                radius.push(r);
                q[0] += 1;
            }
        }
    }
    source.finish::<D>()?;
    source.grains(position, radius)
}

/// Tries at a place for each grain before the region counts as full.
const TRIES: usize = 2000;

/// Grains at random places without overlap, one after the other (random sequential addition: up to about
/// half of the region in the plane, a third in space).
pub fn random<const D: usize>(region: &Region<D>, fill: &Fill<'_>) -> Result<Particles<D>> {
    region.validate()?;
    let mut source = Source::new(fill)?;
    let (smallest, largest) = fill.radii.bounds()?;
    let most = region.volume() / ball::<D>(smallest);
    if most > 1e8 {
        return Err(Error::Scene(format!("the region takes up to {most:.0} grains: more than 1e8")));
    }
    let mut occupied = Occupied::new(region, 2.0 * largest);
    let (mut position, mut radius) = (vec![], vec![]);
    while let Some(r) = source.next::<D>() {
        let room = (region.high - region.low).add_scalar(-2.0 * r);
        let place = (room.min() >= 0.0)
            .then(|| {
                (0..TRIES).find_map(|_| {
                    let x =
                        Vector::<D>::from_fn(|a, _| region.low[a] + r + room[a] * source.rng.random::<f64>());
                    occupied.is_free(&x, r, &position, &radius).then_some(x)
                })
            })
            .flatten();
        match place {
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
}

impl<const D: usize> Occupied<D> {
    fn new(region: &Region<D>, width: f64) -> Self {
        // Few large cells would be slow, many small ones large: at most some ten million.
        let width = width.max((region.volume() * 1e-7).powf(1.0 / D as f64));
        let dims: [usize; D] =
            std::array::from_fn(|a| ((region.high[a] - region.low[a]) / width).ceil().max(1.0) as usize);
        Self { low: region.low, width, dims, cells: vec![vec![]; dims.iter().product()] }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn unit<const D: usize>() -> Region<D> {
        Region { low: Vector::zeros(), high: Vector::repeat(1.0) }
    }

    fn fill(materials: &[Material], radii: Radii, amount: Amount) -> Fill<'_> {
        Fill { radii, amount, material: 0, materials, seed: 3 }
    }

    #[test]
    fn lattices_fill_the_region_exactly() {
        let glass = [Material::default()];
        let tenth = fill(&glass, Radii::Constant(0.05), Amount::Fill);
        assert_eq!(lattice(&unit::<2>(), Lattice::Square, 1.0, &tenth).unwrap().len(), 100);
        assert_eq!(lattice(&unit::<3>(), Lattice::Square, 1.0, &tenth).unwrap().len(), 1000);
        // Rows of 10 and 9 in turn, 1 + floor(0.9 / (0.1 sqrt(3)/2)) = 11 of them.
        assert_eq!(lattice(&unit::<2>(), Lattice::Triangular, 1.0, &tenth).unwrap().len(), 6 * 10 + 5 * 9);
        let narrow = Region { low: Vector::<2>::zeros(), high: Vector::<2>::new(0.1, 1.0) };
        assert_eq!(lattice(&narrow, Lattice::Square, 1.0, &tenth).unwrap().len(), 10);
    }

    #[test]
    fn random_grains_do_not_overlap_and_have_the_mass_asked_for() {
        let glass = [Material::default()];
        let radii = Radii::Uniform { min: 0.01, max: 0.03 };
        let some = random(&unit::<2>(), &fill(&glass, radii, Amount::Mass(1000.0))).unwrap();
        let total: f64 = some.mass.iter().sum();
        assert!((total - 1000.0).abs() < 0.5 * 2500.0 * ball::<2>(0.03), "{total}");
        for i in 0..some.len() {
            for j in 0..i {
                let d = (some.position[i] - some.position[j]).norm();
                assert!(d >= some.radius[i] + some.radius[j]);
            }
        }
    }

    #[test]
    fn too_much_is_an_error_that_says_so() {
        let glass = [Material::default()];
        let many = fill(&glass, Radii::Constant(0.05), Amount::Count(101));
        let message = lattice(&unit::<2>(), Lattice::Square, 1.0, &many).unwrap_err().to_string();
        assert!(message.contains("full after 100 grains"), "{message}");
        let bad = fill(&glass, Radii::List(vec![0.1, f64::NAN]), Amount::Fill);
        assert!(random(&unit::<2>(), &bad).is_err());
    }
}
