//! Incomplete LU of node blocks without fill.

use super::gmres::Preconditioner;
use super::matrix::{BlockMatrix, Pattern};
use super::scaling::Scaling;

/// Smallest pivot inside a diagonal block, relative to its largest entry.
const SMALLEST_PIVOT: f32 = 1e-6;

/// A ~ L U with the pattern of A: L of the blocks left of the diagonal and unit diagonal blocks, U of the
/// others. In single precision: the factors are wrong by far more than its round-off, and half the
/// memory is half the time of a sweep.
pub(crate) struct Ilu<const B: usize> {
    /// Nodes in the order of elimination.
    order: Vec<u32>,
    /// The pattern in this order, with the position in the matrix of each block.
    offsets: Vec<u32>,
    columns: Vec<u32>,
    sources: Vec<u32>,
    diagonals: Vec<u32>,
    /// Blocks, `values[position][column][row]`; the diagonal ones are inverted.
    values: Vec<Block<B>>,
    scale: Vec<[f64; B]>,
    x: Vec<[f32; B]>,
    /// Where the row at hand has each column, or `NONE`.
    places: Vec<u32>,
}

/// A block by columns, so that block times vector adds columns.
type Block<const B: usize> = [[f32; B]; B];

const NONE: u32 = u32::MAX;

impl<const B: usize> Ilu<B> {
    /// Orders the nodes and lays out the factors.
    pub fn new(pattern: &Pattern) -> Self {
        let nodes = pattern.nodes();
        let order = reverse_cuthill_mckee(pattern);
        let mut ranks = vec![0; nodes];
        for (rank, &node) in order.iter().enumerate() {
            ranks[node as usize] = rank as u32;
        }
        let (mut offsets, mut diagonals) = (vec![0], Vec::with_capacity(nodes));
        let (mut columns, mut sources) = (Vec::new(), Vec::new());
        for (rank, &node) in order.iter().enumerate() {
            let range = pattern.range(node as usize);
            let mut row: Vec<_> = range.map(|at| (ranks[pattern.columns[at] as usize], at as u32)).collect();
            row.sort_unstable();
            let lower = row.iter().filter(|&&(column, _)| (column as usize) < rank).count();
            diagonals.push((columns.len() + lower) as u32);
            columns.extend(row.iter().map(|&(column, _)| column));
            sources.extend(row.iter().map(|&(_, source)| source));
            offsets.push(columns.len() as u32);
        }
        let values = vec![[[0.0; B]; B]; columns.len()];
        let (x, places) = (vec![[0.0; B]; nodes], vec![NONE; nodes]);
        let scale = Vec::new();
        Self { order, offsets, columns, sources, diagonals, values, scale, x, places }
    }

    /// Factors a matrix, row by row: A_ik becomes L_ik = A_ik U_kk^-1, and A_ij -= L_ik U_kj where
    /// the pattern has (i, j).
    pub fn factor(&mut self, matrix: &BlockMatrix<B>, scaling: &Scaling) {
        scaling.permuted(&self.order, &mut self.scale);
        for i in 0..self.order.len() {
            let (start, diagonal, end) = self.row_of(i);
            for at in start..end {
                let column = self.columns[at] as usize;
                let block = &matrix.values[self.sources[at] as usize];
                for (c, entries) in self.values[at].iter_mut().enumerate() {
                    for (r, entry) in entries.iter_mut().enumerate() {
                        *entry = (block[r][c] * self.scale[i][r] * self.scale[column][c]) as f32;
                    }
                }
                self.places[column] = at as u32;
            }
            for at in start..diagonal {
                let (_, pivot, pivot_end) = self.row_of(self.columns[at] as usize);
                let lower = product(&self.values[at], &self.values[pivot]);
                self.values[at] = lower;
                for of_pivot in pivot + 1..pivot_end {
                    let place = self.places[self.columns[of_pivot] as usize];
                    if place != NONE {
                        let change = product(&lower, &self.values[of_pivot]);
                        subtract(&mut self.values[place as usize], &change);
                    }
                }
            }
            self.values[diagonal] = inverse(self.values[diagonal]);
            for &column in &self.columns[start..end] {
                self.places[column as usize] = NONE;
            }
        }
    }

    /// Positions of a row: its start, its diagonal, its end.
    fn row_of(&self, row: usize) -> (usize, usize, usize) {
        (self.offsets[row] as usize, self.diagonals[row] as usize, self.offsets[row + 1] as usize)
    }
}

impl<const B: usize> Preconditioner for Ilu<B> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        let r = r.as_chunks::<B>().0;
        let z = z.as_chunks_mut::<B>().0;
        let scaled = |i: usize, node: u32| -> [f64; B] {
            std::array::from_fn(|c| r[node as usize][c] * self.scale[i][c])
        };
        // Scaled to largest entry one, so that single precision neither overflows nor underflows.
        let mut largest = 0.0f64;
        for (i, &node) in self.order.iter().enumerate() {
            largest = scaled(i, node).iter().fold(largest, |largest, x| largest.max(x.abs()));
        }
        if largest == 0.0 {
            return z.fill([0.0; B]);
        }
        for (i, &node) in self.order.iter().enumerate() {
            let mut sum = scaled(i, node).map(|x| (x / largest) as f32);
            for at in self.offsets[i] as usize..self.diagonals[i] as usize {
                subtract_times(&mut sum, &self.values[at], &self.x[self.columns[at] as usize]);
            }
            self.x[i] = sum;
        }
        for (i, &node) in self.order.iter().enumerate().rev() {
            let (_, diagonal, end) = self.row_of(i);
            let mut sum = self.x[i];
            for at in diagonal + 1..end {
                subtract_times(&mut sum, &self.values[at], &self.x[self.columns[at] as usize]);
            }
            let mut x = [0.0; B];
            subtract_times(&mut x, &self.values[diagonal], &sum.map(|x| -x));
            self.x[i] = x;
            z[node as usize] = std::array::from_fn(|c| x[c] as f64 * self.scale[i][c] * largest);
        }
    }
}

/// sum -= block x. The product is formed by itself: the next block need not wait for it.
#[inline(always)]
fn subtract_times<const B: usize>(sum: &mut [f32; B], block: &Block<B>, x: &[f32; B]) {
    let mut product = [0.0; B];
    for (column, x) in block.iter().zip(x) {
        for (product, a) in product.iter_mut().zip(column) {
            *product += a * x;
        }
    }
    for (sum, product) in sum.iter_mut().zip(product) {
        *sum -= product;
    }
}

fn product<const B: usize>(a: &Block<B>, b: &Block<B>) -> Block<B> {
    let mut product = [[0.0; B]; B];
    for (out, b) in product.iter_mut().zip(b) {
        for (a, b) in a.iter().zip(b) {
            for (out, a) in out.iter_mut().zip(a) {
                *out += a * b;
            }
        }
    }
    product
}

fn subtract<const B: usize>(a: &mut Block<B>, b: &Block<B>) {
    for (a, b) in a.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
        *a -= b;
    }
}

/// Inverse by Gauss-Jordan elimination with exchange of columns (of the stored arrays, which only
/// transposes the problem); pivots that vanish are replaced by small ones.
fn inverse<const B: usize>(mut a: Block<B>) -> Block<B> {
    let size = a.as_flattened().iter().fold(f32::MIN_POSITIVE, |largest, x| largest.max(x.abs()));
    let mut inverse = [[0.0; B]; B];
    for (k, row) in inverse.iter_mut().enumerate() {
        row[k] = 1.0;
    }
    for k in 0..B {
        let pivot = (k..B).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap_or(k);
        a.swap(k, pivot);
        inverse.swap(k, pivot);
        let smallest = (SMALLEST_PIVOT * size).copysign(a[k][k]);
        let factor = 1.0 / if a[k][k].abs() < smallest.abs() { smallest } else { a[k][k] };
        a[k] = a[k].map(|x| x * factor);
        inverse[k] = inverse[k].map(|x| x * factor);
        for i in (0..B).filter(|&i| i != k) {
            let factor = a[i][k];
            for j in 0..B {
                a[i][j] -= factor * a[k][j];
                inverse[i][j] -= factor * inverse[k][j];
            }
        }
    }
    inverse
}

/// An order of small bandwidth: breadth first from a node at the rim, nodes of few neighbours
/// first, all reversed. Neglected fill then lies near the diagonal.
fn reverse_cuthill_mckee(pattern: &Pattern) -> Vec<u32> {
    let nodes = pattern.nodes();
    let degree = |node: u32| pattern.row(node as usize).len();
    let mut order: Vec<u32> = Vec::with_capacity(nodes);
    let mut seen = vec![false; nodes];
    // From `start` outwards; returns the last node reached, one of those furthest away.
    let breadth_first = |start: u32, seen: &mut [bool], order: &mut Vec<u32>| {
        let mut next = order.len();
        seen[start as usize] = true;
        order.push(start);
        while next < order.len() {
            let first_new = order.len();
            for &other in pattern.row(order[next] as usize) {
                if !seen[other as usize] {
                    seen[other as usize] = true;
                    order.push(other);
                }
            }
            order[first_new..].sort_by_key(|&node| (degree(node), node));
            next += 1;
        }
        order[order.len() - 1]
    };
    for seed in 0..nodes as u32 {
        if seen[seed as usize] {
            continue;
        }
        let component = order.len();
        let rim = breadth_first(seed, &mut seen, &mut order);
        order.drain(component..).for_each(|node| seen[node as usize] = false);
        breadth_first(rim, &mut seen, &mut order);
    }
    order.reverse();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_inverse() {
        let a = [[0.0, 2.0, 1.0], [3.0, 0.5, 0.0], [1.0, 1.0, 4.0]];
        let unit = product(&a, &inverse(a));
        for (i, row) in unit.iter().enumerate() {
            for (j, &x) in row.iter().enumerate() {
                assert!((x - (i == j) as u8 as f32).abs() < 1e-6);
            }
        }
    }
}
