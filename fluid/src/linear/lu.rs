//! The sparse LU of faer, with partial pivoting over whole columns: the fallback and the oracle.

use super::gmres::Preconditioner;
use super::matrix::{BlockMatrix, Pattern};
use super::product::little_memory;
use super::scaling::Scaling;
use crate::{Error, Result};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::prelude::default;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::lu::{LuRef, LuSymbolicParams, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par};

/// Factors of the transposed scaled matrix: the rows of ours are the columns of faer's.
pub(crate) struct SparseLu {
    symbolic: SymbolicLu<usize>,
    numeric: NumericLu<usize, f64>,
    offsets: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    scaling: Scaling,
    memory: MemBuffer,
}

impl SparseLu {
    /// Ordering and symbolic analysis.
    pub fn new<const B: usize>(pattern: &Pattern) -> Result<Self> {
        let unknowns = B * pattern.nodes();
        let mut offsets = Vec::with_capacity(unknowns + 1);
        let mut columns = Vec::with_capacity(B * B * pattern.blocks());
        offsets.push(0);
        for node in 0..pattern.nodes() {
            for _ in 0..B {
                for &other in pattern.row(node) {
                    columns.extend((0..B).map(|c| B * other as usize + c));
                }
                offsets.push(columns.len());
            }
        }
        let structure = SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &offsets, None, &columns);
        let mut parameters = LuSymbolicParams::default();
        if little_memory() {
            parameters.supernodal_flop_ratio_threshold = SupernodalThreshold::FORCE_SIMPLICIAL;
        }
        let symbolic = factorize_symbolic_lu(structure, parameters)
            .map_err(|error| Error::Linear(format!("sparse LU, symbolic: {error}")))?;
        let memory = MemBuffer::new(
            symbolic
                .factorize_numeric_lu_scratch::<f64>(Par::Seq, default())
                .or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq)),
        );
        let values = vec![0.0; columns.len()];
        let (numeric, scaling) = (NumericLu::new(), Scaling::default());
        Ok(Self { symbolic, numeric, offsets, columns, values, scaling, memory })
    }

    /// Factors a matrix.
    pub fn factor<const B: usize>(&mut self, matrix: &BlockMatrix<B>, scaling: &Scaling) -> Result<()> {
        self.scaling.clone_from(scaling);
        let mut next = 0;
        for node in 0..matrix.pattern.nodes() {
            for r in 0..B {
                let row = scaling.factors[B * node + r];
                for position in matrix.pattern.range(node) {
                    let other = matrix.pattern.columns[position] as usize;
                    for c in 0..B {
                        self.values[next] =
                            row * matrix.values[position][r][c] * scaling.factors[B * other + c];
                        next += 1;
                    }
                }
            }
        }
        let unknowns = matrix.unknowns();
        let structure =
            SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &self.offsets, None, &self.columns);
        let transposed = SparseColMatRef::new(structure, &self.values[..]);
        let stack = MemStack::new(&mut self.memory);
        self.symbolic
            .factorize_numeric_lu(&mut self.numeric, transposed, Par::Seq, stack, default())
            .map_err(|error| Error::Linear(format!("sparse LU: {error}")))?;
        Ok(())
    }
}

impl Preconditioner for SparseLu {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        for ((z, r), scale) in z.iter_mut().zip(r).zip(&self.scaling.factors) {
            *z = r * scale;
        }
        let unknowns = z.len();
        LuRef::new_unchecked(&self.symbolic, &self.numeric).solve_transpose_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(z, unknowns, 1),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        for (z, scale) in z.iter_mut().zip(&self.scaling.factors) {
            *z *= scale;
        }
    }
}
