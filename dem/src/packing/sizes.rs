//! Laws of sizes, as tables of the share of grains up to a radius.

use super::Radii;
use crate::error::{Error, Result, check};
use serde::{Deserialize, Serialize};

/// What a law of sizes gives the shares of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum By {
    /// The number of grains.
    Number,
    /// Their mass: r^D as much for each grain.
    Mass,
}

/// A law of sizes, before it is cut at a smallest and a largest radius.
#[derive(Clone, Debug, PartialEq)]
pub enum SizeLaw {
    /// ln r is normally distributed.
    LogNormal {
        /// Radius that half are below, m.
        median: f64,
        /// Standard deviation of ln r.
        deviation: f64,
    },
    /// The share 1 - exp(-(r / scale)^spread) is below r (P. Rosin, E. Rammler, J. Inst. Fuel 7, 29, 1933).
    RosinRammler {
        /// Radius that 63.2 % are below, m.
        scale: f64,
        /// Exponent: the larger, the narrower.
        spread: f64,
    },
    /// Radii with the share below them, from 0 to 1, both increasing; linear between.
    Sieve(Vec<(f64, f64)>),
}

/// Parts of the range of a smooth law, and of each class of a sieve: a table is within 1e-6 of the law.
const PARTS: [usize; 2] = [2000, 100];

impl SizeLaw {
    /// Share per radius, 1/m; in a class of a sieve that at its middle.
    fn density(&self, r: f64) -> f64 {
        match self {
            Self::LogNormal { median, deviation } => {
                let x = (r / median).ln() / deviation;
                (-0.5 * x * x).exp() / (r * deviation * std::f64::consts::TAU.sqrt())
            }
            Self::RosinRammler { scale, spread } => {
                let x = r / scale;
                spread / scale * x.powf(spread - 1.0) * (-x.powf(*spread)).exp()
            }
            Self::Sieve(table) => {
                let upper = table.partition_point(|row| row.0 <= r).clamp(1, table.len() - 1);
                let (below, above) = (table[upper - 1], table[upper]);
                (above.1 - below.1) / (above.0 - below.0)
            }
        }
    }

    /// Radii between which the density is smooth, with the number of parts of each piece.
    fn pieces(&self, [min, max]: [f64; 2]) -> (Vec<f64>, usize) {
        match self {
            Self::Sieve(table) => (table.iter().map(|row| row.0).collect(), PARTS[1]),
            _ => (vec![min, max], PARTS[0]),
        }
    }
}

impl Radii {
    /// Radii by a law of sizes that is cut at a smallest and a largest one, m (those of the table of a sieve are its
    /// own).
    ///
    /// # Errors
    /// Bounds that are not positive or upside down, and bounds that leave nothing of the law.
    pub fn by_law<const D: usize>(law: &SizeLaw, by: By, bounds: [f64; 2]) -> Result<Self> {
        let (ends, parts) = law.pieces(bounds);
        let stepped = matches!(law, SizeLaw::Sieve(_));
        let increasing = ends.windows(2).all(|pair| pair[0] < pair[1]);
        check(ends[0] > 0.0 && increasing, ends[0], "radii must be positive and increase", || {
            "radius".into()
        })?;
        let weight = |r: f64| match by {
            By::Number => 1.0,
            // Over the power of the smallest radius, so that nothing overflows.
            By::Mass => (r / ends[0]).powi(-(D as i32)),
        };
        let (mut radius, mut share) = (vec![ends[0]], vec![0.0]);
        let mut sum = 0.0;
        for pair in ends.windows(2) {
            let ratio = (pair[1] / pair[0]).powf(1.0 / parts as f64);
            let mut below = pair[0];
            for part in 1..=parts {
                let above = if part == parts { pair[1] } else { pair[0] * ratio.powi(part as i32) };
                let middle = 0.5 * (below + above);
                // Simpson's rule; a class has one density, its ends belong to two.
                let density = |r: f64| weight(r) * law.density(if stepped { middle } else { r });
                sum += (above - below) / 6.0 * (density(below) + 4.0 * density(middle) + density(above));
                radius.push(above);
                share.push(sum);
                below = above;
            }
        }
        if !(sum > 1e-12 && sum.is_finite()) {
            return Err(Error::Scene(
                "no grains of the law lie between the smallest and the largest radius".into(),
            ));
        }
        share.iter_mut().for_each(|s| *s /= sum);
        Ok(Self::Table { radius, share })
    }
}

/// The radius below which a share of a table lies.
pub(super) fn quantile(radius: &[f64], share: &[f64], wanted: f64) -> f64 {
    let above = share.partition_point(|s| *s <= wanted).clamp(1, share.len() - 1);
    let (low, high) = (share[above - 1], share[above]);
    let part = if high > low { (wanted - low) / (high - low) } else { 0.0 };
    radius[above - 1] + (radius[above] - radius[above - 1]) * part
}
