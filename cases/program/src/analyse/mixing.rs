//! How well two kinds of grains are mixed.

use std::collections::BTreeMap;

/// Fewest grains of a cell in the mean.
const FEWEST: f64 = 3.0;

/// The scatter of the share of one kind over cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixing {
    /// Variance of the share of the first kind over the cells, each weighted by its grains.
    pub variance: f64,
    /// What it is in the mean where the grains are mixed at random.
    pub mixed: f64,
    /// What it is where every cell has grains of one kind only.
    pub separated: f64,
    /// Number of cells with grains.
    pub cells: usize,
    /// Number of grains.
    pub grains: usize,
}

impl Mixing {
    /// The index of P. M. C. Lacey, J. Appl. Chem. 4, 257 (1954): 0 separated, 1 in the mean of random mixtures.
    pub fn index(&self) -> f64 {
        (self.separated - self.variance) / (self.separated - self.mixed)
    }

    /// By how much the index of random mixtures scatters about 1, as a standard deviation.
    pub fn scatter(&self) -> f64 {
        self.mixed * (2.0 / (self.cells as f64 - 1.0)).sqrt() / (self.separated - self.mixed)
    }
}

/// Counts grains in square cells of this side; each grain has a place and whether it is of the first kind. None where
/// there is one kind only, where all grains are in one cell, or where cells have fewer than three grains in the mean.
pub fn lacey(grains: impl Iterator<Item = ([f64; 2], bool)>, lower: [f64; 2], cell: f64) -> Option<Mixing> {
    let mut counts: BTreeMap<[i64; 2], [usize; 2]> = BTreeMap::new();
    for (place, first) in grains {
        let square = [0, 1].map(|axis| ((place[axis] - lower[axis]) / cell).floor() as i64);
        let count = counts.entry(square).or_default();
        count[0] += usize::from(first);
        count[1] += 1;
    }
    let (first, all) = counts.values().fold((0, 0), |sum, count| (sum.0 + count[0], sum.1 + count[1]));
    let cells = counts.len();
    if first == 0 || first == all || cells < 2 || (all as f64) < FEWEST * cells as f64 {
        return None;
    }
    let share = first as f64 / all as f64;
    let scatter = |[first, all]: &[usize; 2]| *all as f64 * (*first as f64 / *all as f64 - share).powi(2);
    let variance = counts.values().map(scatter).sum::<f64>() / all as f64;
    let separated = share * (1.0 - share);
    // Grains that are drawn without being put back: the mean over all ways to fill the cells.
    let mixed = separated * (cells as f64 - 1.0) / (all as f64 - 1.0);
    Some(Mixing { variance, mixed, separated, cells, grains: all })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::seq::SliceRandom;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    /// Sixteen grains in each of 20 x 20 cells of unit side.
    fn places() -> Vec<[f64; 2]> {
        (0..80 * 80).map(|k| [0.25 * (f64::from(k % 80) + 0.5), 0.25 * (f64::from(k / 80) + 0.5)]).collect()
    }

    fn of(kind: impl Fn([f64; 2]) -> bool) -> Mixing {
        lacey(places().into_iter().map(|place| (place, kind(place))), [0.0; 2], 1.0).unwrap()
    }

    #[test]
    fn separated_grains_have_the_index_zero_and_random_ones_one() {
        let board = of(|[x, y]| (x.floor() + y.floor()) as i64 % 2 == 0);
        assert!(board.index().abs() < 1e-12, "{board:?}");
        let halves = of(|[_, y]| y < 10.0);
        assert!(halves.index().abs() < 1e-12, "{halves:?}");
        // Each cell has the share of all: better than random.
        let even = of(|[x, _]| (x * 4.0).floor() as i64 % 2 == 0);
        assert!(even.variance < 1e-12 && even.index() > 1.0, "{even:?}");
        let mut random = Pcg64::seed_from_u64(5);
        let mut kinds: Vec<bool> = (0..6400).map(|k| k < 1600).collect();
        let (mut indices, mut scatter) = (Vec::new(), 0.0);
        for _ in 0..400 {
            kinds.shuffle(&mut random);
            let found = lacey(places().into_iter().zip(kinds.iter().copied()), [0.0; 2], 1.0).unwrap();
            indices.push(found.index());
            scatter = found.scatter();
        }
        let mean = indices.iter().sum::<f64>() / 400.0;
        let spread = (indices.iter().map(|index| (index - mean).powi(2)).sum::<f64>() / 400.0).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * scatter / 20.0, "{mean}");
        assert!((spread / scatter - 1.0).abs() < 0.15, "{spread} for {scatter}");
        // Half of the grains are mixed at random, the others are apart: the shares are 1/4 and 3/4.
        let mut kind = |y: f64| if random.random::<f64>() < 0.5 { random.random() } else { y < 10.0 };
        let half: Vec<([f64; 2], bool)> = places().into_iter().map(|[x, y]| ([x, y], kind(y))).collect();
        let found = lacey(half.into_iter(), [0.0; 2], 1.0).unwrap().index();
        assert!((found - 0.75).abs() < 0.03, "{found}");
    }

    #[test]
    fn cells_that_hold_too_little_give_no_index() {
        let all = |cell: f64| lacey(places().into_iter().map(|[x, y]| ([x, y], y < 10.0)), [0.0; 2], cell);
        assert!(all(0.25).is_none() && all(100.0).is_none() && all(1.0).is_some());
        assert!(lacey(places().into_iter().map(|place| (place, true)), [0.0; 2], 1.0).is_none());
    }
}
