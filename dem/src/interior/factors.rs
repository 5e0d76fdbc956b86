//! Factors of a sparse matrix of blocks whose pattern is symmetric.
//!
//! The grains are eliminated by minimum degree: of those left, the one with the fewest neighbours goes next, and its
//! neighbours become neighbours of each other. That gives the order and the pattern at once. Blocks are inverted with
//! pivoting, blocks are not exchanged: each is a mass, and what contacts add to it.

use nalgebra::SMatrix;
use std::collections::BTreeSet;

/// Refinements at most.
const REFINEMENTS: usize = 5;

type Block<const B: usize> = SMatrix<f64, B, B>;

/// What the interior-point method needs of a matrix: blocks of 2, 3 or 4 unknowns per grain.
pub(super) trait Factors {
    /// Makes factors of the sum of blocks, `value(k)` at the k-th place, row by row; whether that succeeded.
    fn factor(&mut self, values: &[f64]) -> bool;
    /// Solves with the last factors, in place.
    fn solve(&self, x: &mut [f64]);
}

/// Factors for `count` grains of `size` unknowns, with blocks at the given rows and columns; several at one place add
/// up.
pub(super) fn factors(size: usize, count: usize, places: &[[usize; 2]]) -> Box<dyn Factors> {
    match size {
        2 => Box::new(Blocks::<2>::new(count, places)),
        3 => Box::new(Blocks::<3>::new(count, places)),
        _ => Box::new(Blocks::<4>::new(count, places)),
    }
}

struct Blocks<const B: usize> {
    /// Rank in the elimination of each grain.
    rank: Vec<usize>,
    /// Ranks of the later neighbours of rank k, ascending: `later[starts[k] .. starts[k + 1]]`.
    starts: Vec<usize>,
    later: Vec<usize>,
    /// Inverse of each pivot; the blocks below it and those right of it.
    pivots: Vec<Block<B>>,
    below: Vec<Block<B>>,
    right: Vec<Block<B>>,
    /// Where each given block goes.
    targets: Vec<Target>,
    /// The matrix as given, and the size of each row, for refinement.
    places: Vec<[usize; 2]>,
    values: Vec<f64>,
    scale: Vec<f64>,
}

#[derive(Clone, Copy)]
enum Target {
    Pivot(usize),
    Below(usize),
    Right(usize),
}

impl<const B: usize> Blocks<B> {
    fn new(count: usize, places: &[[usize; 2]]) -> Self {
        let mut neighbours = vec![BTreeSet::new(); count];
        for &[i, j] in places.iter().filter(|[i, j]| i != j) {
            neighbours[i].insert(j);
            neighbours[j].insert(i);
        }
        let mut queue: BTreeSet<(usize, usize)> = (0..count).map(|i| (neighbours[i].len(), i)).collect();
        let (mut rank, mut order) = (vec![0; count], vec![]);
        while let Some((_, i)) = queue.pop_first() {
            rank[i] = order.len();
            let around = std::mem::take(&mut neighbours[i]);
            for &j in &around {
                queue.remove(&(neighbours[j].len(), j));
                neighbours[j].remove(&i);
                neighbours[j].extend(around.iter().filter(|k| **k != j));
                queue.insert((neighbours[j].len(), j));
            }
            order.push(around);
        }
        let (mut starts, mut later) = (vec![0], vec![]);
        for around in &order {
            later.extend(around.iter().map(|&j| rank[j]));
            later[starts[starts.len() - 1]..].sort_unstable();
            starts.push(later.len());
        }
        let blocks = vec![Block::zeros(); later.len()];
        let pivots = vec![Block::zeros(); count];
        let mut all = Self {
            rank,
            starts,
            later,
            pivots,
            below: blocks.clone(),
            right: blocks,
            targets: vec![],
            places: places.to_vec(),
            values: vec![],
            scale: vec![],
        };
        all.targets = places.iter().map(|&[i, j]| all.target(all.rank[i], all.rank[j])).collect();
        all
    }

    /// Where the block at two ranks lies.
    fn target(&self, row: usize, column: usize) -> Target {
        let place = |first: usize, second: usize| {
            let range = self.starts[first]..self.starts[first + 1];
            let found = self.later[range.clone()].binary_search(&second);
            range.start + found.expect("neighbours of an eliminated grain are neighbours")
        };
        match row.cmp(&column) {
            std::cmp::Ordering::Equal => Target::Pivot(row),
            std::cmp::Ordering::Greater => Target::Below(place(column, row)),
            std::cmp::Ordering::Less => Target::Right(place(row, column)),
        }
    }

    fn at(&mut self, target: Target) -> &mut Block<B> {
        match target {
            Target::Pivot(k) => &mut self.pivots[k],
            Target::Below(k) => &mut self.below[k],
            Target::Right(k) => &mut self.right[k],
        }
    }

    fn vector(x: &[f64], i: usize) -> SMatrix<f64, B, 1> {
        SMatrix::from_column_slice(&x[B * i..B * (i + 1)])
    }
}

impl<const B: usize> Factors for Blocks<B> {
    fn factor(&mut self, values: &[f64]) -> bool {
        for blocks in [&mut self.pivots, &mut self.below, &mut self.right] {
            blocks.fill(Block::zeros());
        }
        for k in 0..self.targets.len() {
            let block = Block::from_row_slice(&values[B * B * k..B * B * (k + 1)]);
            *self.at(self.targets[k]) += block;
        }
        self.values.clear();
        self.values.extend_from_slice(values);
        self.scale.clear();
        let rows = self.rank.iter().flat_map(|&k| (0..B).map(move |a| (k, a)));
        self.scale.extend(rows.map(|(k, a)| 1.0 / self.pivots[k][(a, a)].abs().max(f64::MIN_POSITIVE)));
        for k in 0..self.pivots.len() {
            let Some(inverse) = invert(self.pivots[k]) else { return false };
            self.pivots[k] = inverse;
            let range = self.starts[k]..self.starts[k + 1];
            self.below[range.clone()].iter_mut().for_each(|block| *block *= inverse);
            for a in range.clone() {
                let (first, below, right) = (self.later[a], self.below[a], self.right[a]);
                self.pivots[first] -= below * right;
                // Later neighbours of k are later neighbours of the first of them, in the same order.
                let mut place = self.starts[first];
                for b in a + 1..range.end {
                    while self.later[place] != self.later[b] {
                        place += 1;
                    }
                    let [along, down] = [below * self.right[b], self.below[b] * right];
                    self.right[place] -= along;
                    self.below[place] -= down;
                }
            }
        }
        true
    }

    fn solve(&self, x: &mut [f64]) {
        // Without exchange of blocks an indefinite matrix costs digits, which refinement brings back.
        let b = x.to_vec();
        self.apply(x);
        let mut last = f64::MAX;
        for _ in 0..REFINEMENTS {
            let mut rest = b.clone();
            self.subtract_product(x, &mut rest);
            let size = rest.iter().zip(&self.scale).fold(0.0, |most: f64, (r, s)| most.max((r * s).abs()));
            if size.is_nan() || size >= 0.5 * last {
                break;
            }
            last = size;
            self.apply(&mut rest);
            x.iter_mut().zip(&rest).for_each(|(x, d)| *x += d);
        }
    }
}

impl<const B: usize> Blocks<B> {
    /// rest -= A x.
    fn subtract_product(&self, x: &[f64], rest: &mut [f64]) {
        for (&[i, j], block) in self.places.iter().zip(self.values.chunks(B * B)) {
            for a in 0..B {
                rest[B * i + a] -= (0..B).map(|b| block[B * a + b] * x[B * j + b]).sum::<f64>();
            }
        }
    }

    /// Solves with the factors alone.
    fn apply(&self, x: &mut [f64]) {
        let mut y = vec![SMatrix::<f64, B, 1>::zeros(); self.rank.len()];
        for (i, &rank) in self.rank.iter().enumerate() {
            y[rank] = Self::vector(x, i);
        }
        for k in 0..y.len() {
            for a in self.starts[k]..self.starts[k + 1] {
                let change = self.below[a] * y[k];
                y[self.later[a]] -= change;
            }
        }
        for k in (0..y.len()).rev() {
            let known = (self.starts[k]..self.starts[k + 1]).map(|a| self.right[a] * y[self.later[a]]);
            y[k] = self.pivots[k] * (y[k] - known.sum::<SMatrix<f64, B, 1>>());
        }
        for (i, &rank) in self.rank.iter().enumerate() {
            x[B * i..B * (i + 1)].copy_from_slice(y[rank].as_slice());
        }
    }
}

/// Inverse by Gauss and Jordan with pivots from the column: contacts make blocks too ill-conditioned for a formula
/// with determinants.
fn invert<const B: usize>(mut block: Block<B>) -> Option<Block<B>> {
    let mut inverse: Block<B> = Block::identity();
    for k in 0..B {
        let best =
            (k..B).fold(k, |best, i| if block[(i, k)].abs() > block[(best, k)].abs() { i } else { best });
        block.swap_rows(k, best);
        inverse.swap_rows(k, best);
        let pivot = block[(k, k)];
        if pivot == 0.0 || !pivot.is_finite() {
            return None;
        }
        for i in (0..B).filter(|i| *i != k) {
            let factor = block[(i, k)] / pivot;
            for j in 0..B {
                block[(i, j)] -= factor * block[(k, j)];
                inverse[(i, j)] -= factor * inverse[(k, j)];
            }
        }
    }
    for k in 0..B {
        let pivot = block[(k, k)];
        inverse.row_mut(k).iter_mut().for_each(|x| *x /= pivot);
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// A ring with chords, unsymmetric, masses up to 1e12 apart: the solution is met whatever the order.
    #[test]
    fn a_sparse_system_is_solved() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let (size, count) = (3, 40);
        let mut places: Vec<[usize; 2]> = (0..count).map(|i| [i, i]).collect();
        for i in 0..count {
            for j in [(i + 1) % count, (i * 7 + 3) % count] {
                places.extend([[i, j], [j, i]]);
            }
        }
        let mut values: Vec<f64> = (0..9 * places.len()).map(|_| rng.random_range(-1.0..1.0)).collect();
        for i in 0..count {
            (0..size).for_each(|a| values[9 * i + 4 * a] += if i % 3 == 0 { 1e12 } else { 20.0 });
        }
        let x: Vec<f64> = (0..size * count).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut b = vec![0.0; x.len()];
        for (k, [i, j]) in places.iter().enumerate() {
            for (a, c) in (0..size * size).map(|k| (k / size, k % size)) {
                b[size * i + a] += values[9 * k + size * a + c] * x[size * j + c];
            }
        }
        let mut factors = factors(size, count, &places);
        assert!(factors.factor(&values));
        factors.solve(&mut b);
        for (b, x) in b.iter().zip(&x) {
            assert!((b - x).abs() < 1e-10, "{b} {x}");
        }
    }
}
