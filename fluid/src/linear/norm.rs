//! The norm in which a system is solved; see the documentation of `linear`.

use super::gmres::dot;
use super::matrix::BlockMatrix;
use super::scaling::Scaling;

/// Part of the cancelling terms of an equation that serves as reference when its right-hand side
/// is smaller.
const TERMS: f64 = 0.01;

/// Residuals up to this multiple of the rounding errors of A x and b cannot be made smaller.
const ROUND_OFF: f64 = 16.0 * f64::EPSILON;

/// Weights S such that the 2-norm of S r, restricted to one component, is the quotient that is
/// compared with the tolerance. So the norm that GMRES minimises bounds the one that is tested.
#[derive(Clone, Debug, Default)]
pub(crate) struct Norm {
    /// S, one positive number per equation.
    pub weights: Vec<f64>,
    guess: Vec<f64>,
    scratch: Vec<f64>,
}

impl Norm {
    /// Computes the weights for a right-hand side. False if the matrix or the right-hand side has
    /// an entry that is not finite: such an entry meets every product of |A||w b|.
    pub fn update<const B: usize>(
        &mut self,
        matrix: &BlockMatrix<B>,
        scaling: &Scaling,
        rhs: &[f64],
    ) -> bool {
        self.weights.clear();
        self.weights.extend(scaling.factors.iter().map(|d| d * d));
        self.guess.clear();
        self.guess.extend(self.weights.iter().zip(rhs).map(|(w, b)| w * b));
        self.scratch.resize(rhs.len(), 0.0);
        matrix.multiply_magnitudes(&self.guess, &mut self.scratch);
        let of_rhs = component_norms::<B>(&self.weights, rhs);
        let of_terms = component_norms::<B>(&self.weights, &self.scratch);
        if of_rhs.iter().chain(&of_terms).any(|norm| !norm.is_finite()) {
            return false;
        }
        let mut references: [f64; B] = std::array::from_fn(|c| of_rhs[c].max(TERMS * of_terms[c]));
        // A component that nothing drives is judged by the largest reference, if only to avoid 0/0.
        let largest = references.iter().fold(0.0f64, |a, &b| a.max(b));
        for reference in references.iter_mut().filter(|reference| **reference == 0.0) {
            *reference = if largest > 0.0 { largest } else { 1.0 };
        }
        for weights in self.weights.as_chunks_mut::<B>().0 {
            for (weight, reference) in weights.iter_mut().zip(references) {
                *weight /= reference;
            }
        }
        true
    }

    /// The relative residual for a weighted one: the largest quotient over the components.
    pub fn relative<const B: usize>(weighted: &[f64]) -> f64 {
        let mut sums = [0.0; B];
        for r in weighted.as_chunks::<B>().0 {
            for c in 0..B {
                sums[c] += r[c] * r[c];
            }
        }
        largest(&sums.map(f64::sqrt))
    }

    /// The residual in the same measure that rounding errors leave of |A||x| + |b|.
    pub fn round_off<const B: usize>(&mut self, matrix: &BlockMatrix<B>, rhs: &[f64], x: &[f64]) -> f64 {
        self.scratch.resize(rhs.len(), 0.0);
        matrix.multiply_magnitudes(x, &mut self.scratch);
        self.scratch.iter_mut().zip(rhs).for_each(|(terms, b)| *terms += b.abs());
        ROUND_OFF * largest(&component_norms::<B>(&self.weights, &self.scratch))
    }
}

/// The largest norm; one that is no number counts as largest.
fn largest<const B: usize>(norms: &[f64; B]) -> f64 {
    norms.iter().fold(0.0, |largest, &norm| if norm <= largest || largest.is_nan() { largest } else { norm })
}

/// 2-norm of w v for each component of the blocks.
fn component_norms<const B: usize>(weights: &[f64], v: &[f64]) -> [f64; B] {
    let mut sums = [0.0; B];
    for (w, v) in weights.as_chunks::<B>().0.iter().zip(v.as_chunks::<B>().0) {
        for c in 0..B {
            sums[c] += (w[c] * v[c]) * (w[c] * v[c]);
        }
    }
    sums.map(f64::sqrt)
}

/// Whether every entry is finite.
pub(crate) fn is_finite(v: &[f64]) -> bool {
    dot(v, v).is_finite() || v.iter().all(|v| v.is_finite())
}
