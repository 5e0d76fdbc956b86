//! Radii drawn one after the other until the amount is reached.

use super::sizes::quantile;
use super::{Amount, Fill, Radii, Region, full};
use crate::error::{Error, Result, check};
use crate::{Particles, Vector, ball};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Draws the radii of a fill.
pub(super) struct Source<'a, const D: usize> {
    fill: &'a Fill<'a>,
    /// Of the radii, and of places that are drawn between them.
    pub rng: Pcg64,
    drawn: usize,
    mass: f64,
}

/// Share of a region that discs, or spheres, take in a random dense bed: what fits, about.
pub(super) fn usual<const D: usize>() -> f64 {
    if D == 2 { 0.82 } else { 0.6 }
}

/// Grains at most.
const MOST: f64 = 1e8;

impl<'a, const D: usize> Source<'a, D> {
    pub fn new(fill: &'a Fill<'a>) -> Result<Self> {
        fill.radii.bounds()?;
        if fill.materials.get(fill.material as usize).is_none() {
            let (m, count) = (fill.material, fill.materials.len());
            return Err(Error::Scene(format!("material {m} does not exist: the scene has {count}")));
        }
        let mut source = Self { fill, rng: Pcg64::seed_from_u64(fill.seed), drawn: 0, mass: 0.0 };
        if let Amount::Mass(asked) = fill.amount {
            check(asked > 0.0 && asked.is_finite(), asked, "it must be positive", || {
                "mass of grains".into()
            })?;
            source.check_first(asked)?;
        }
        Ok(source)
    }

    /// An error if the mass asked for is nearer to none than to one grain.
    fn check_first(&mut self, asked: f64) -> Result<()> {
        let before = self.rng.clone();
        let Some(radius) = self.radius() else { return Ok(()) };
        self.rng = before;
        let mass = self.mass_of(radius, self.fill.material);
        if 0.5 * mass <= asked {
            return Ok(());
        }
        let unit = if D == 2 { "kg/m" } else { "kg" };
        Err(Error::Scene(format!(
            "a mass of {asked:e} {unit} is less than half of one grain: a grain of radius {radius:.4e} m has \
             {mass:.4e} {unit}"
        )))
    }

    fn radius(&mut self) -> Option<f64> {
        match &self.fill.radii {
            Radii::List(list) => list.get(self.drawn).copied(),
            Radii::Mixed(list) => list.get(self.drawn).map(|grain| grain.0),
            law => law.draw(&mut self.rng),
        }
    }

    /// Material of the grain that is drawn as this one.
    pub fn material(&self, drawn: usize) -> u8 {
        match &self.fill.radii {
            Radii::Mixed(list) => list[drawn].1,
            _ => self.fill.material,
        }
    }

    fn mass_of(&self, radius: f64, material: u8) -> f64 {
        let made_of = &self.fill.materials[material as usize];
        made_of.density * made_of.solidity * ball::<D>(radius)
    }

    /// The next radius, or none when the amount is reached.
    pub fn next(&mut self) -> Option<f64> {
        if matches!(self.fill.amount, Amount::Count(n) if self.drawn >= n) {
            return None;
        }
        let radius = self.radius()?;
        let mass = self.mass_of(radius, self.material(self.drawn));
        if matches!(self.fill.amount, Amount::Mass(m) if self.mass + 0.5 * mass > m) {
            return None;
        }
        self.drawn += 1;
        self.mass += mass;
        Some(radius)
    }

    /// How many grains are asked for, about; with [`Amount::Fill`] as many as a dense bed in the region has.
    ///
    /// # Errors
    /// More than 1e8.
    pub fn expected(&self, region: &Region<D>) -> Result<usize> {
        let volume = self.fill.radii.mean_volume::<D>();
        let made_of = &self.fill.materials[self.fill.material as usize];
        let count = match self.fill.amount {
            Amount::Count(n) => n as f64,
            Amount::Mass(m) => m / (made_of.density * made_of.solidity * volume),
            Amount::Fill => usual::<D>() * region.volume() / volume,
        };
        let count = match &self.fill.radii {
            Radii::List(list) => count.min(list.len() as f64),
            Radii::Mixed(list) => count.min(list.len() as f64),
            _ => count,
        };
        if count > MOST {
            return Err(Error::Scene(format!("{count:.0} grains are asked for: {MOST:.0e} at most")));
        }
        Ok(count.round() as usize)
    }

    /// An error if grains are still wanted: the region is full.
    pub fn finish(&mut self) -> Result<()> {
        let endless = matches!(self.fill.amount, Amount::Fill);
        if endless || self.next().is_none() { Ok(()) } else { Err(full(self.drawn - 1)) }
    }

    /// The grains, in the order in which they were drawn; an error if there is none.
    pub fn grains(&self, position: Vec<Vector<D>>, radius: Vec<f64>) -> Result<Particles<D>> {
        let drawn = (0..position.len()).collect::<Vec<usize>>();
        self.grains_drawn(position, radius, &drawn)
    }

    /// The grains, in any order: `drawn` says as the how-manieth each was drawn.
    pub fn grains_drawn(
        &self,
        position: Vec<Vector<D>>,
        radius: Vec<f64>,
        drawn: &[usize],
    ) -> Result<Particles<D>> {
        if position.is_empty() {
            return Err(Error::Scene("the region holds no whole grain: make it larger".into()));
        }
        let material = drawn.iter().map(|&drawn| self.material(drawn)).collect();
        Particles::new(position, radius, material, self.fill.materials)
    }
}

impl Radii {
    /// A radius by the law, m; none of a list.
    pub(crate) fn draw(&self, rng: &mut Pcg64) -> Option<f64> {
        match self {
            Self::Constant(r) => Some(*r),
            Self::Uniform { min, max } => Some(min + (max - min) * rng.random::<f64>()),
            Self::Table { radius, share } => Some(quantile(radius, share, rng.random::<f64>())),
            Self::List(_) | Self::Mixed(_) => None,
        }
    }

    /// Mean area of the discs, m2, or volume of the spheres, m3.
    pub fn mean_volume<const D: usize>(&self) -> f64 {
        match self {
            Self::Constant(r) => ball::<D>(*r),
            // The mean of r^n over a uniform law: (b^(n+1) - a^(n+1)) / ((n + 1) (b - a)), as a sum without
            // cancellation.
            Self::Uniform { min: a, max: b } => {
                let sum: f64 = (0..=D as i32).map(|k| a.powi(k) * b.powi(D as i32 - k)).sum();
                ball::<D>(1.0) * sum / (D as f64 + 1.0)
            }
            Self::Table { radius, share } => {
                let parts = radius.windows(2).zip(share.windows(2));
                let part = |(r, s): (&[f64], &[f64])| {
                    (s[1] - s[0]) * Self::Uniform { min: r[0], max: r[1] }.mean_volume::<D>()
                };
                parts.map(part).sum()
            }
            Self::List(list) => list.iter().map(|&r| ball::<D>(r)).sum::<f64>() / list.len().max(1) as f64,
            Self::Mixed(list) => {
                list.iter().map(|grain| ball::<D>(grain.0)).sum::<f64>() / list.len().max(1) as f64
            }
        }
    }
}

/// The grains of several fills in an order at random by a seed, to be placed together; a fill draws the radii that it
/// would draw alone.
///
/// # Errors
/// Those of a fill, and one of [`Amount::Fill`]: nobody knows how much of a mixture it is.
pub fn mixed<const D: usize>(fills: &[Fill<'_>], seed: u64) -> Result<Radii> {
    let mut grains = Vec::new();
    for fill in fills {
        if matches!(fill.amount, Amount::Fill) && !matches!(fill.radii, Radii::List(_) | Radii::Mixed(_)) {
            return Err(Error::Scene("what is mixed needs a count or a mass".into()));
        }
        let mut source = Source::<D>::new(fill)?;
        while let Some(radius) = source.next() {
            if grains.len() as f64 >= MOST {
                return Err(Error::Scene(format!("more than {MOST:.0e} grains are asked for")));
            }
            grains.push((radius, source.material(source.drawn - 1)));
        }
    }
    let mut rng = Pcg64::seed_from_u64(seed ^ 0x6d69_7865_6421);
    for k in (1..grains.len()).rev() {
        let other = ((k + 1) as f64 * rng.random::<f64>()) as usize;
        grains.swap(k, other.min(k));
    }
    Ok(Radii::Mixed(grains))
}
