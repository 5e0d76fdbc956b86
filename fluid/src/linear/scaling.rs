//! Equilibration: row and column factors that bring all equations and unknowns to one size.

use super::matrix::BlockMatrix;
use crate::{Error, Result};

/// Passes of the iteration below. A saddle-point system with drag over eight orders of magnitude
/// is within a factor of four of equilibrium after three.
const PASSES: usize = 4;

/// Factors with which diag(row) A diag(column) has rows and columns of largest entry about one.
///
/// Ruiz' iteration: divide each row and each column by the root of its largest entry, and repeat.
/// On a node block [a g; g' c] of momentum and continuity its fixed point is row = column,
/// `column_u = a^(-1/2)`, `column_p = min(a^(1/2) / g, c^(-1/2))`: velocities and pressures meet in
/// one unit whatever the drag in `a` is. The factors are powers of two, so that scaling is exact.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scaling {
    pub row: Vec<f64>,
    pub column: Vec<f64>,
    row_largest: Vec<f64>,
    column_largest: Vec<f64>,
}

impl Scaling {
    /// Computes the factors of a matrix. An error if an entry is not finite, or if a row or a
    /// column has no entry: then the matrix is singular.
    pub fn update<const B: usize>(&mut self, matrix: &BlockMatrix<B>) -> Result<()> {
        let unknowns = matrix.unknowns();
        self.row.clear();
        self.row.resize(unknowns, 1.0);
        self.column.clear();
        self.column.resize(unknowns, 1.0);
        for pass in 0..PASSES {
            self.largest(matrix);
            if pass == 0 {
                self.check::<B>()?;
            }
            for (factor, largest) in self.row.iter_mut().zip(&self.row_largest) {
                *factor /= largest.sqrt();
            }
            for (factor, largest) in self.column.iter_mut().zip(&self.column_largest) {
                *factor /= largest.sqrt();
            }
        }
        for factor in self.row.iter_mut().chain(&mut self.column) {
            *factor = power_of_two_below(*factor);
        }
        Ok(())
    }

    /// Largest entries of the rows and columns of the scaled matrix.
    fn largest<const B: usize>(&mut self, matrix: &BlockMatrix<B>) {
        self.row_largest.clear();
        self.row_largest.resize(matrix.unknowns(), 0.0);
        self.column_largest.clear();
        self.column_largest.resize(matrix.unknowns(), 0.0);
        let (row, column) = (self.row.as_chunks::<B>().0, self.column.as_chunks::<B>().0);
        let row_largest = self.row_largest.as_chunks_mut::<B>().0;
        let column_largest = self.column_largest.as_chunks_mut::<B>().0;
        for node in 0..matrix.pattern.nodes() {
            let mut in_row = [0.0f64; B];
            for position in matrix.pattern.range(node) {
                let other = matrix.pattern.columns[position] as usize;
                for (r, entries) in matrix.values[position].iter().enumerate() {
                    for (c, entry) in entries.iter().enumerate() {
                        let size = entry.abs() * row[node][r] * column[other][c];
                        // Unlike f64::max this carries NaN on.
                        if size > in_row[r] || size.is_nan() {
                            in_row[r] = size;
                        }
                        column_largest[other][c] = column_largest[other][c].max(size);
                    }
                }
            }
            row_largest[node] = in_row;
        }
    }

    fn check<const B: usize>(&self) -> Result<()> {
        let place = |unknown: usize| format!("component {} of node {}", unknown % B, unknown / B);
        for (unknown, &largest) in self.row_largest.iter().enumerate() {
            if !largest.is_finite() {
                let place = place(unknown);
                return Err(Error::Linear(format!("the matrix is not finite in the equation of {place}")));
            }
            if largest == 0.0 {
                let place = place(unknown);
                return Err(Error::Linear(format!(
                    "the matrix is singular: no entry in the equation of {place}"
                )));
            }
        }
        match self.column_largest.iter().position(|&largest| largest == 0.0) {
            Some(unknown) => {
                let place = place(unknown);
                Err(Error::Linear(format!("the matrix is singular: no equation contains {place}")))
            }
            None => Ok(()),
        }
    }
}

/// The largest power of two that is not above a positive normal number: its mantissa cleared.
fn power_of_two_below(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & 0x7ff0_0000_0000_0000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two() {
        assert_eq!(power_of_two_below(5.9), 4.0);
        assert_eq!(power_of_two_below(0.3), 0.25);
        assert_eq!(power_of_two_below(1.0), 1.0);
    }
}
