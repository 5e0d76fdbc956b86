//! Scaling that brings equations and unknowns of different units to one size.

use super::matrix::BlockMatrix;
use crate::{Error, Result};

/// Factors d with which D A D has diagonal entries of about one: d_i = |a_ii|^(-1/2).
///
/// That also bounds the rest here. Stabilisation makes the pressure entry c of a node as large as
/// elimination of the velocity would: with a ~ rho h^2/dt, g ~ h for gradient and divergence and c ~ dt/rho
/// (time step), or a ~ eta and c ~ h^2/eta (viscosity), g / (a c)^(1/2) is of size one, and drag
/// in `a` only makes it smaller. So velocities and pressures meet in one unit whatever the drag is.
/// The factors are powers of two, so that scaling is exact.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scaling {
    /// The same for the rows and the columns, one positive number per unknown.
    pub factors: Vec<f64>,
}

impl Scaling {
    /// Computes the factors of a matrix. An error if a row or a column has no entry: then the
    /// matrix is singular.
    pub fn update<const B: usize>(&mut self, matrix: &BlockMatrix<B>) -> Result<()> {
        self.factors.resize(matrix.unknowns(), 1.0);
        let mut complete = true;
        for (node, factors) in self.factors.as_chunks_mut::<B>().0.iter_mut().enumerate() {
            let block = &matrix.values[matrix.pattern.diagonal(node)];
            for (c, factor) in factors.iter_mut().enumerate() {
                let size = block[c][c].abs();
                complete &= size != 0.0;
                *factor = if size.is_normal() { power_of_two_below(1.0 / size.sqrt()) } else { 1.0 };
            }
        }
        if complete { Ok(()) } else { self.scale_by_neighbours(matrix) }
    }

    /// The factors of each node, in another order of the nodes.
    pub fn permuted<const B: usize>(&self, order: &[u32], permuted: &mut Vec<[f64; B]>) {
        let factors = self.factors.as_chunks::<B>().0;
        permuted.clear();
        permuted.extend(order.iter().map(|&node| factors[node as usize]));
    }

    /// Unknowns without diagonal entry, like a pressure without stabilisation: brings the largest entry of
    /// their row or column to one.
    fn scale_by_neighbours<const B: usize>(&mut self, matrix: &BlockMatrix<B>) -> Result<()> {
        let pattern = &matrix.pattern;
        let transposed = pattern.transposed_positions();
        let old = self.factors.clone();
        let old = old.as_chunks::<B>().0;
        for node in 0..pattern.nodes() {
            let diagonal = matrix.values[pattern.diagonal(node)];
            for c in (0..B).filter(|&c| diagonal[c][c] == 0.0) {
                let (mut in_row, mut in_column) = (0.0f64, 0.0f64);
                for position in pattern.range(node) {
                    let other = &old[pattern.columns[position] as usize];
                    let mirror = &matrix.values[transposed[position] as usize];
                    for (k, other) in other.iter().enumerate() {
                        in_row = in_row.max((matrix.values[position][c][k] * other).abs());
                        in_column = in_column.max((mirror[k][c] * other).abs());
                    }
                }
                if in_row == 0.0 || in_column == 0.0 {
                    let what = if in_row == 0.0 { "the equation" } else { "the column" };
                    return Err(Error::Linear(format!(
                        "the matrix is singular: {what} of component {c} of node {node} is empty"
                    )));
                }
                self.factors[B * node + c] = power_of_two_below(1.0 / in_row.max(in_column));
            }
        }
        Ok(())
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
