//! From cells to the global matrix, in parallel and with the same sums for any number of threads.
//!
//! The rows are divided into contiguous chunks, one per thread; each chunk computes every cell that touches its
//! rows and adds only to them. A row receives its cells in ascending order whatever the division, so the sums
//! do not depend on it; cells on a border between chunks are computed more than once.

use crate::linear::{BlockMatrix, Pattern};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Matrix and right-hand side of one cell of `N` nodes with `K` unknowns each.
#[derive(Clone)]
pub struct Local<const N: usize, const K: usize> {
    /// `[a][b][i][j]`: row of node a and equation i, column of node b and unknown j.
    pub matrix: [[[[f64; K]; K]; N]; N],
    /// `[a][i]`.
    pub rhs: [[f64; K]; N],
}

impl<const N: usize, const K: usize> Default for Local<N, K> {
    fn default() -> Self {
        Self { matrix: [[[[0.0; K]; K]; N]; N], rhs: [[0.0; K]; N] }
    }
}

/// Where the blocks of each cell go.
#[derive(Clone, Debug)]
pub struct Assembler {
    /// Sparsity of the node graph.
    pub pattern: Arc<Pattern>,
    /// Place of each block of each cell in the matrix, N x N per cell.
    position: Vec<u32>,
    cells: Vec<u32>,
    chunks: Vec<Chunk>,
}

#[derive(Clone, Debug)]
struct Chunk {
    rows: Range<usize>,
    cells: Vec<u32>,
}

/// A linear system of `K` unknowns per node.
#[derive(Clone, Debug)]
pub struct System<const K: usize> {
    /// The matrix.
    pub matrix: BlockMatrix<K>,
    /// The right-hand side, `K` per node.
    pub rhs: Vec<f64>,
}

impl<const K: usize> System<K> {
    /// A system of zeros.
    pub fn new(pattern: Arc<Pattern>) -> Self {
        let (blocks, nodes) = (pattern.columns.len(), pattern.offsets.len() - 1);
        Self {
            matrix: BlockMatrix { pattern, values: vec![[[0.0; K]; K]; blocks] },
            rhs: vec![0.0; K * nodes],
        }
    }

    /// The block of a row and a column that share a cell.
    pub fn block(&mut self, row: u32, column: u32) -> Option<&mut [[f64; K]; K]> {
        let position = self.matrix.pattern.position(row as usize, column as usize)?;
        self.matrix.values.get_mut(position)
    }

    /// The blocks of a row, and the place of the diagonal one among them.
    pub fn row(&mut self, row: usize) -> (&mut [[[f64; K]; K]], Option<usize>) {
        let pattern = &self.matrix.pattern;
        let range = pattern.offsets[row] as usize..pattern.offsets[row + 1] as usize;
        let diagonal = pattern.position(row, row).map(|k| k - range.start);
        (&mut self.matrix.values[range], diagonal)
    }

    /// Replaces an equation by `unknown = value`, scaled like the diagonal that it had.
    pub fn prescribe(&mut self, node: usize, equation: usize, value: f64) {
        let (row, diagonal) = self.row(node);
        let Some(diagonal) = diagonal else { return };
        let old = row[diagonal][equation][equation].abs();
        let scale = if old > 0.0 { old } else { 1.0 };
        for block in row.iter_mut() {
            block[equation] = [0.0; K];
        }
        row[diagonal][equation][equation] = scale;
        self.rhs[K * node + equation] = scale * value;
    }
}

/// Equations of some nodes as they were assembled, before conditions took their places.
#[derive(Clone, Debug, Default)]
pub struct KeptRows<const K: usize> {
    nodes: Vec<usize>,
    blocks: Vec<[[f64; K]; K]>,
    rhs: Vec<f64>,
}

impl<const K: usize> KeptRows<K> {
    /// Keeps the equations of these nodes, and forgets all others.
    pub fn keep(&mut self, system: &System<K>, nodes: impl Iterator<Item = usize>) {
        self.nodes.clear();
        self.blocks.clear();
        self.rhs.clear();
        for node in nodes {
            self.nodes.push(node);
            self.blocks.extend_from_slice(&system.matrix.values[system.matrix.pattern.range(node)]);
            self.rhs.extend_from_slice(&system.rhs[K * node..K * (node + 1)]);
        }
    }

    /// Calls `f(node, A x - b)` with the equations of each node at a solution x: the reaction of what holds the node.
    pub fn reactions(&self, pattern: &Pattern, x: &[f64], f: impl FnMut(usize, [f64; K])) {
        self.rows(pattern, x, |k| std::array::from_fn(|i| -self.rhs[K * k + i]), f);
    }

    /// Calls `f(node, A x)` with the equations of each node: how the reaction grows with x.
    pub fn products(&self, pattern: &Pattern, x: &[f64], f: impl FnMut(usize, [f64; K])) {
        self.rows(pattern, x, |_| [0.0; K], f);
    }

    fn rows(
        &self,
        pattern: &Pattern,
        x: &[f64],
        start: impl Fn(usize) -> [f64; K],
        mut f: impl FnMut(usize, [f64; K]),
    ) {
        let mut next = 0;
        for (k, &node) in self.nodes.iter().enumerate() {
            let mut left = start(k);
            for position in pattern.range(node) {
                let column = pattern.columns[position] as usize;
                for (i, row) in self.blocks[next].iter().enumerate() {
                    left[i] += (0..K).map(|j| row[j] * x[K * column + j]).sum::<f64>();
                }
                next += 1;
            }
            f(node, left);
        }
    }
}

impl System<1> {
    /// Adds d_ij = max(a_ij, a_ji, 0) to the diagonal entries of i and j and takes it from a_ij and a_ji, for all
    /// pairs: discrete upwinding (D. Kuzmin and S. Turek, "Flux correction tools for finite elements", J. Comput. Phys.
    /// 175 (2002)). Sums of rows and columns stay. A matrix whose rows sum to no less than zero then is an M-matrix:
    /// its solution lies within the bounds of what stands on the right.
    pub fn upwind(&mut self) {
        let pattern = self.matrix.pattern.clone();
        for row in 0..pattern.nodes() {
            for position in pattern.range(row) {
                let column = pattern.columns[position] as usize;
                if column <= row {
                    continue;
                }
                let Some(mirror) = pattern.position(column, row) else { continue };
                let [a, b] = [position, mirror].map(|k| self.matrix.values[k][0][0]);
                let excess = a.max(b).max(0.0);
                if excess == 0.0 {
                    continue;
                }
                self.matrix.values[position][0][0] -= excess;
                self.matrix.values[mirror][0][0] -= excess;
                for node in [row, column] {
                    self.matrix.values[pattern.diagonal(node)][0][0] += excess;
                }
            }
        }
    }
}

impl Assembler {
    /// For `nodes` nodes and the given cells of `N` nodes; a node of no cell gets an equation without entries.
    pub fn new<const N: usize>(nodes: usize, cells: &[u32]) -> Self {
        let pattern = Arc::new(Pattern::from_cells(nodes, cells, N));
        let mut position = Vec::with_capacity(cells.len() * N);
        for cell in cells.chunks_exact(N) {
            for &a in cell {
                for &b in cell {
                    position.extend(pattern.position(a as usize, b as usize).map(|k| k as u32));
                }
            }
        }
        let threads = rayon::current_num_threads();
        let chunks =
            (0..threads).map(|k| chunk::<N>(cells, nodes * k / threads..nodes * (k + 1) / threads)).collect();
        Self { pattern, position, cells: cells.to_vec(), chunks }
    }

    /// Fills the system with the sums of `local(cell, out)` over all cells.
    pub fn assemble<const N: usize, const K: usize>(
        &self,
        system: &mut System<K>,
        local: impl Fn(usize, &mut Local<N, K>) + Sync,
    ) {
        let mut values = system.matrix.values.as_mut_slice();
        let mut rhs = system.rhs.as_mut_slice();
        let mut work = Vec::with_capacity(self.chunks.len());
        for chunk in &self.chunks {
            let blocks = self.pattern.offsets[chunk.rows.end] - self.pattern.offsets[chunk.rows.start];
            let (own_values, rest) = values.split_at_mut(blocks as usize);
            values = rest;
            let (own_rhs, rest) = rhs.split_at_mut(K * chunk.rows.len());
            rhs = rest;
            work.push((chunk, own_values, own_rhs));
        }
        work.into_par_iter().for_each(|(chunk, values, rhs)| {
            values.fill([[0.0; K]; K]);
            rhs.fill(0.0);
            let mut out = Local::default();
            for &cell in &chunk.cells {
                local(cell as usize, &mut out);
                self.scatter(chunk, cell as usize, &out, values, rhs);
            }
        });
    }

    fn scatter<const N: usize, const K: usize>(
        &self,
        chunk: &Chunk,
        cell: usize,
        local: &Local<N, K>,
        values: &mut [[[f64; K]; K]],
        rhs: &mut [f64],
    ) {
        let first = self.pattern.offsets[chunk.rows.start] as usize;
        for a in 0..N {
            let node = self.cells[N * cell + a] as usize;
            if !chunk.rows.contains(&node) {
                continue;
            }
            for i in 0..K {
                rhs[K * (node - chunk.rows.start) + i] += local.rhs[a][i];
            }
            for b in 0..N {
                let block = &mut values[self.position[N * (N * cell + a) + b] as usize - first];
                for i in 0..K {
                    for j in 0..K {
                        block[i][j] += local.matrix[a][b][i][j];
                    }
                }
            }
        }
    }
}

fn chunk<const N: usize>(cells: &[u32], rows: Range<usize>) -> Chunk {
    let touches = |cell: &[u32]| cell.iter().any(|&node| rows.contains(&(node as usize)));
    let cells =
        cells.chunks_exact(N).enumerate().filter(|(_, cell)| touches(cell)).map(|(k, _)| k as u32).collect();
    Chunk { rows, cells }
}
