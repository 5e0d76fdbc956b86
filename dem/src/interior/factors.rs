//! Factors of a sparse matrix, made anew for each set of values: faer's LU with partial pivoting, on one thread, so that results do not
//! depend on how many there are.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::prelude::default;
use faer::sparse::linalg::lu::{LuRef, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par};

pub(crate) struct Factors {
    pattern: SymbolicSparseColMat<usize>,
    order: Argsort<usize>,
    symbolic: Option<SymbolicLu<usize>>,
    numeric: NumericLu<usize, f64>,
    memory: MemBuffer,
    places: Vec<[usize; 2]>,
    /// Factors of rows and columns that make the diagonal 1: masses lie far apart.
    scale: Vec<f64>,
    scaled: Vec<f64>,
}

impl Factors {
    /// Ordering and symbolic analysis of a square matrix with entries at the given rows and columns; several at one place add up.
    pub fn new(size: usize, places: &[[usize; 2]]) -> Self {
        let pairs: Vec<Pair<usize, usize>> = places.iter().map(|&[row, col]| Pair { row, col }).collect();
        let (pattern, order) =
            SymbolicSparseColMat::try_new_from_indices(size, size, &pairs).expect("places inside the matrix");
        let symbolic = factorize_symbolic_lu(pattern.as_ref(), default()).ok();
        let scratch = symbolic.as_ref().map(|symbolic| {
            let factor = symbolic.factorize_numeric_lu_scratch::<f64>(Par::Seq, default());
            factor.or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq))
        });
        let memory = MemBuffer::new(scratch.unwrap_or(faer::dyn_stack::StackReq::EMPTY));
        let numeric = NumericLu::new();
        let places = places.to_vec();
        Self { pattern, order, symbolic, numeric, memory, places, scale: vec![], scaled: vec![] }
    }

    /// Factors the matrix of these values, in the order of the places; whether that succeeded.
    pub fn factor(&mut self, values: &[f64]) -> bool {
        self.scale.clear();
        self.scale.resize(self.pattern.nrows(), 0.0);
        for (&[i, j], value) in self.places.iter().zip(values) {
            if i == j {
                self.scale[i] += value;
            }
        }
        self.scale.iter_mut().for_each(|d| *d = 1.0 / d.abs().sqrt());
        if !self.scale.iter().all(|s| s.is_finite()) {
            return false;
        }
        self.scaled.clear();
        let scale = &self.scale;
        self.scaled.extend(self.places.iter().zip(values).map(|(&[i, j], v)| v * scale[i] * scale[j]));
        let Ok(matrix) = SparseColMat::new_from_argsort(self.pattern.clone(), &self.order, &self.scaled)
        else {
            return false;
        };
        let Some(symbolic) = &self.symbolic else { return false };
        let stack = MemStack::new(&mut self.memory);
        symbolic.factorize_numeric_lu(&mut self.numeric, matrix.as_ref(), Par::Seq, stack, default()).is_ok()
    }

    /// Solves with the last factors, in place.
    pub fn solve(&mut self, x: &mut [f64]) {
        let Some(symbolic) = &self.symbolic else { return };
        x.iter_mut().zip(&self.scale).for_each(|(x, s)| *x *= s);
        let size = x.len();
        LuRef::new_unchecked(symbolic, &self.numeric).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(x, size, 1),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        x.iter_mut().zip(&self.scale).for_each(|(x, s)| *x *= s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An unsymmetric system with masses 1e12 apart.
    #[test]
    fn a_small_system_is_solved() {
        let places = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 0], [2, 1], [0, 0]];
        let values = [1.0, 1e12, 3.0, 5.0, -2.0, 4.0, 1.0];
        let mut factors = Factors::new(3, &places);
        assert!(factors.factor(&values));
        let x = [1.0, 1e-6, -2.0];
        let mut b = [2.0 * x[0] + 5.0 * x[1], -2.0 * x[0] + 1e12 * x[1], 4.0 * x[1] + 3.0 * x[2]];
        factors.solve(&mut b);
        for (b, x) in b.iter().zip(&x) {
            assert!((b - x).abs() < 1e-12 * x.abs(), "{b} {x}");
        }
    }
}
