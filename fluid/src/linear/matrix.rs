//! Block-sparse matrices on the graph of the nodes.

use rayon::prelude::*;
use std::sync::Arc;

/// Rows handed to one task of a parallel loop. The rows are independent, so the number has no
/// influence on the result.
const ROWS_PER_TASK: usize = 512;

/// Sparsity of a square matrix of node blocks: sorted rows, structurally symmetric, diagonal
/// present. Row `i` couples to the nodes `columns[offsets[i]..offsets[i + 1]]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    /// Where each row begins in `columns`; one more entry than there are rows.
    pub offsets: Vec<u32>,
    /// Column numbers, ascending in each row.
    pub columns: Vec<u32>,
}

impl Pattern {
    /// The pattern of a mesh: two nodes couple when a cell has both. `cells` holds
    /// `nodes_per_cell` node numbers per cell. A node of no cell couples to itself only.
    pub fn from_cells(nodes: usize, cells: &[u32], nodes_per_cell: usize) -> Self {
        let mut first_cell = vec![0u32; nodes + 1];
        for &node in cells {
            first_cell[node as usize + 1] += 1;
        }
        for node in 0..nodes {
            first_cell[node + 1] += first_cell[node];
        }
        let mut next = first_cell.clone();
        let mut cells_of_node = vec![0u32; cells.len()];
        for (slot, &node) in cells.iter().enumerate() {
            cells_of_node[next[node as usize] as usize] = (slot / nodes_per_cell) as u32;
            next[node as usize] += 1;
        }

        let mut offsets = Vec::with_capacity(nodes + 1);
        let mut columns = Vec::new();
        let mut row = Vec::new();
        offsets.push(0);
        for node in 0..nodes {
            row.clear();
            row.push(node as u32);
            for &cell in &cells_of_node[first_cell[node] as usize..first_cell[node + 1] as usize] {
                let start = cell as usize * nodes_per_cell;
                row.extend_from_slice(&cells[start..start + nodes_per_cell]);
            }
            row.sort_unstable();
            row.dedup();
            columns.extend_from_slice(&row);
            offsets.push(columns.len() as u32);
        }
        Self { offsets, columns }
    }

    /// Number of nodes, that is of block rows.
    pub fn nodes(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.columns.len()
    }

    /// Range of positions of a row.
    pub fn range(&self, row: usize) -> std::ops::Range<usize> {
        self.offsets[row] as usize..self.offsets[row + 1] as usize
    }

    /// Columns of a row, ascending.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.columns[self.range(row)]
    }

    /// Where the block (`row`, `column`) is stored, if the pattern has it.
    pub fn position(&self, row: usize, column: usize) -> Option<usize> {
        let range = self.range(row);
        let found = self.columns[range.clone()].binary_search(&(column as u32));
        found.ok().map(|place| range.start + place)
    }

    /// Where the diagonal block of a row is stored.
    ///
    /// # Panics
    /// If the row has no diagonal block, which breaks the promise of the type.
    pub fn diagonal(&self, row: usize) -> usize {
        self.position(row, row).expect("a pattern has its diagonal")
    }

    /// For every position (i, j) the position of (j, i).
    ///
    /// # Panics
    /// If the pattern is not structurally symmetric, which breaks the promise of the type.
    pub fn transposed_positions(&self) -> Vec<u32> {
        // Rows are visited in ascending order, so the entries of column j are met in the order in
        // which row j stores their mirror images: one cursor per row finds them all.
        let mut next: Vec<u32> = self.offsets[..self.nodes()].to_vec();
        let mut transposed = vec![0; self.blocks()];
        for row in 0..self.nodes() {
            for position in self.range(row) {
                let mirror = &mut next[self.columns[position] as usize];
                assert_eq!(self.columns[*mirror as usize], row as u32, "the pattern is not symmetric");
                transposed[position] = *mirror;
                *mirror += 1;
            }
        }
        transposed
    }
}

/// A matrix of dense `B` x `B` blocks on a [`Pattern`]. Unknown `component` of `node` is entry
/// `B * node + component` of a vector.
#[derive(Clone, Debug)]
pub struct BlockMatrix<const B: usize> {
    /// Which blocks there are.
    pub pattern: Arc<Pattern>,
    /// The blocks in the order of `pattern.columns`, `values[position][row][column]`.
    pub values: Vec<[[f64; B]; B]>,
}

impl<const B: usize> BlockMatrix<B> {
    /// The zero matrix.
    pub fn new(pattern: Arc<Pattern>) -> Self {
        let values = vec![[[0.0; B]; B]; pattern.blocks()];
        Self { pattern, values }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        B * self.pattern.nodes()
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.values.fill([[0.0; B]; B]);
    }

    /// The block (`row`, `column`), if the pattern has it.
    pub fn block(&self, row: usize, column: usize) -> Option<&[[f64; B]; B]> {
        self.pattern.position(row, column).map(|position| &self.values[position])
    }

    /// The block (`row`, `column`) for writing, if the pattern has it.
    pub fn block_mut(&mut self, row: usize, column: usize) -> Option<&mut [[f64; B]; B]> {
        self.pattern.position(row, column).map(|position| &mut self.values[position])
    }

    /// Makes one scalar row the equation `diagonal * unknown = ..`, as a Dirichlet value needs it.
    pub fn set_identity_row(&mut self, node: usize, component: usize, diagonal: f64) {
        for position in self.pattern.range(node) {
            self.values[position][component] = [0.0; B];
        }
        self.values[self.pattern.diagonal(node)][component][component] = diagonal;
    }

    /// y = A x, in parallel; every row is summed in the order of its columns.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        self.each_row(y, |node, out| *out = self.row_product(node, x));
    }

    /// r = b - A x, in parallel; every row is summed in the order of its columns.
    pub fn residual(&self, b: &[f64], x: &[f64], r: &mut [f64]) {
        let b = b.as_chunks::<B>().0;
        self.each_row(r, |node, out| {
            let product = self.row_product(node, x);
            for ((out, b), product) in out.iter_mut().zip(&b[node]).zip(product) {
                *out = b - product;
            }
        });
    }

    /// t = |A| |x|, the size of the terms that cancel in A x: what round-off is measured against.
    pub fn multiply_magnitudes(&self, x: &[f64], t: &mut [f64]) {
        let x = x.as_chunks::<B>().0;
        self.each_row(t, |node, out| {
            *out = [0.0; B];
            for position in self.pattern.range(node) {
                let x = &x[self.pattern.columns[position] as usize];
                for (sum, row) in out.iter_mut().zip(&self.values[position]) {
                    *sum += row.iter().zip(x).map(|(a, x)| (a * x).abs()).sum::<f64>();
                }
            }
        });
    }

    fn row_product(&self, node: usize, x: &[f64]) -> [f64; B] {
        let x = x.as_chunks::<B>().0;
        let range = self.pattern.range(node);
        let mut sum = [0.0; B];
        for (block, &column) in self.values[range.clone()].iter().zip(&self.pattern.columns[range]) {
            let x = &x[column as usize];
            for (sum, row) in sum.iter_mut().zip(block) {
                // By itself first: the next block need not wait for these additions.
                *sum += row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
            }
        }
        sum
    }

    fn each_row(&self, y: &mut [f64], write: impl Fn(usize, &mut [f64; B]) + Sync) {
        let y = y.as_chunks_mut::<B>().0;
        y.par_chunks_mut(ROWS_PER_TASK).enumerate().for_each(|(task, rows)| {
            for (row, out) in rows.iter_mut().enumerate() {
                write(task * ROWS_PER_TASK + row, out);
            }
        });
    }
}
