//! The P1 simplex: every formula that differs between plane and space.
//!
//! `B` is the number of nodes of a cell, `D + 1`, which is also the number of unknowns of a node
//! (velocity and pressure). Stable Rust cannot compute `D + 1` in a type, so both are parameters.
//!
//! All volume integrals of the weak form have polynomial integrands; they are written in closed form with
//! int_e phi_0^a phi_1^b .. = |e| D! a! b! .. / (D + a + b + ..)!, which equals any rule exact to degree 4.

use crate::Vector;
use nalgebra::SMatrix;

/// Measure of a cell and gradients of its shape functions.
#[derive(Clone, Copy, Debug)]
pub struct Element<const D: usize, const B: usize> {
    /// Area (m2) or volume (m3).
    pub measure: f64,
    /// Gradient of each shape function, 1/m.
    pub gradient: [Vector<D>; B],
}

impl<const D: usize, const B: usize> Element<D, B> {
    /// The element with the given corners, positively oriented.
    ///
    /// With the edge matrix J = [x_1 - x_0, ..], the gradients of phi_1.. are the rows of J^-1 and that of
    /// phi_0 is minus their sum. A flat element has a measure of zero and infinite gradients.
    pub fn new(corner: [Vector<D>; B]) -> Self {
        let mut edges = SMatrix::<f64, D, D>::zeros();
        for k in 0..D {
            edges.set_column(k, &(corner[k + 1] - corner[0]));
        }
        let (inverse, determinant) = inverse(&edges);
        let mut gradient = [Vector::<D>::zeros(); B];
        for k in 0..D {
            gradient[k + 1] = inverse.row(k).transpose();
            gradient[0] -= gradient[k + 1];
        }
        Self { measure: determinant / factorial(D), gradient }
    }

    /// Length of the element, (D! |e|)^(1/D): the leg of a right simplex of equal measure.
    pub fn size(&self) -> f64 {
        let content = factorial(D) * self.measure;
        if D == 2 { content.sqrt() } else { content.cbrt() }
    }

    /// Gradient of the P1 field with the given nodal values.
    pub fn gradient_of(&self, value: &[f64; B]) -> Vector<D> {
        let mut sum = Vector::zeros();
        for a in 0..B {
            sum += self.gradient[a] * value[a];
        }
        sum
    }

    /// Gradient `G[(i, j)] = d u_i / d x_j` of the P1 vector field with the given nodal values.
    pub fn gradient_of_vector(&self, value: &[Vector<D>; B]) -> SMatrix<f64, D, D> {
        let mut sum = SMatrix::zeros();
        for a in 0..B {
            sum += value[a] * self.gradient[a].transpose();
        }
        sum
    }
}

fn factorial(n: usize) -> f64 {
    (1..=n).product::<usize>() as f64
}

/// Inverse (transposed cofactors over the determinant) and determinant of a 2 x 2 or 3 x 3 matrix.
pub(crate) fn inverse<const D: usize>(m: &SMatrix<f64, D, D>) -> (SMatrix<f64, D, D>, f64) {
    let mut cofactor = SMatrix::<f64, D, D>::zeros();
    if D == 2 {
        cofactor[(0, 0)] = m[(1, 1)];
        cofactor[(0, 1)] = -m[(1, 0)];
        cofactor[(1, 0)] = -m[(0, 1)];
        cofactor[(1, 1)] = m[(0, 0)];
    } else {
        for i in 0..D {
            for j in 0..D {
                let (r, s) = ((i + 1) % D, (i + 2) % D);
                let (p, q) = ((j + 1) % D, (j + 2) % D);
                cofactor[(i, j)] = m[(r, p)] * m[(s, q)] - m[(r, q)] * m[(s, p)];
            }
        }
    }
    let determinant: f64 = (0..D).map(|j| m[(0, j)] * cofactor[(0, j)]).sum();
    (cofactor.transpose() / determinant, determinant)
}

/// Weighted mass matrix int w phi_a phi_b of a simplex of dimension `N - 1` with `N` nodes, for the P1 weight
/// w with nodal values `weight`: |e| (1 + delta_ab) (sum w + w_a + w_b) / (N (N + 1) (N + 2)).
pub fn weighted_mass<const N: usize>(measure: f64, weight: &[f64; N]) -> [[f64; N]; N] {
    let sum: f64 = weight.iter().sum();
    let scale = measure / ((N * (N + 1) * (N + 2)) as f64);
    std::array::from_fn(|a| {
        std::array::from_fn(|b| {
            let double = if a == b { 2.0 } else { 1.0 };
            scale * double * (sum + weight[a] + weight[b])
        })
    })
}

/// Integrals int w phi_a for the P1 weight w: |e| (sum w + w_a) / (N (N + 1)).
pub fn weighted_load<const N: usize>(measure: f64, weight: &[f64; N]) -> [f64; N] {
    let sum: f64 = weight.iter().sum();
    let scale = measure / ((N * (N + 1)) as f64);
    std::array::from_fn(|a| scale * (sum + weight[a]))
}

/// A quadrature point of a facet: barycentric coordinates (the first `D` count) and share of the measure.
pub type FacetPoint = ([f64; 3], f64);

/// The rule of the facets, exact to degree 4 at least: three Gauss points on a segment, the six-point rule
/// on a triangle (D. A. Dunavant, Int. J. Numer. Meth. Eng. 21, 1129, 1985). The upwind term of an open
/// boundary is not polynomial, so independent programs must use these points.
pub fn facet_rule<const D: usize>() -> &'static [FacetPoint] {
    // Gauss-Legendre: nodes (1 +- sqrt(3/5)) / 2 and 1/2, weights 5/18, 8/18, 5/18.
    const LOW: f64 = 0.112_701_665_379_258_31;
    const SEGMENT: [FacetPoint; 3] = [
        ([1.0 - LOW, LOW, 0.0], 5.0 / 18.0),
        ([0.5, 0.5, 0.0], 8.0 / 18.0),
        ([LOW, 1.0 - LOW, 0.0], 5.0 / 18.0),
    ];
    const P: f64 = 0.445_948_490_915_964_9;
    const Q: f64 = 0.091_576_213_509_770_74;
    const WP: f64 = 0.223_381_589_678_011_47;
    const WQ: f64 = 0.109_951_743_655_321_88;
    const TRIANGLE: [FacetPoint; 6] = [
        ([P, P, 1.0 - 2.0 * P], WP),
        ([P, 1.0 - 2.0 * P, P], WP),
        ([1.0 - 2.0 * P, P, P], WP),
        ([Q, Q, 1.0 - 2.0 * Q], WQ),
        ([Q, 1.0 - 2.0 * Q, Q], WQ),
        ([1.0 - 2.0 * Q, Q, Q], WQ),
    ];
    if D == 2 { &SEGMENT } else { &TRIANGLE }
}

/// Measure and outward unit normal of a facet whose nodes are oriented as `Boundary::facets` says:
/// in the plane the tangent turned clockwise, in space the cross product of two edges.
pub fn facet_normal<const D: usize>(corner: &[Vector<D>]) -> (f64, Vector<D>) {
    let mut area = Vector::<D>::zeros();
    let edge = corner[1] - corner[0];
    if D == 2 {
        area[0] = edge[1];
        area[1] = -edge[0];
    } else {
        let other = corner[2] - corner[0];
        for i in 0..D {
            let (j, k) = ((i + 1) % D, (i + 2) % D);
            area[i] = 0.5 * (edge[j] * other[k] - edge[k] * other[j]);
        }
    }
    let measure = area.norm();
    (measure, area / measure)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn gradients_of_a_tetrahedron_reproduce_a_linear_field() {
        let corner: [Vector<3>; 4] =
            [[0.1, 0.0, 0.2], [1.0, 0.1, 0.0], [0.2, 1.3, 0.1], [0.0, 0.2, 0.9]].map(Vector::from);
        let element = Element::<3, 4>::new(corner);
        let slope = Vector::<3>::new(2.0, -1.0, 0.5);
        let value = corner.map(|x| slope.dot(&x) + 3.0);
        assert_relative_eq!(element.gradient_of(&value), slope, epsilon = 1e-13);
        let edges = SMatrix::<f64, 3, 3>::from_columns(&[
            corner[1] - corner[0],
            corner[2] - corner[0],
            corner[3] - corner[0],
        ]);
        assert_relative_eq!(element.measure, edges.determinant() / 6.0, epsilon = 1e-14);
    }

    #[test]
    fn weighted_integrals_match_their_sums() {
        // Shape functions sum to one: summing the mass over b gives the load, summing that gives int w.
        let weight = [0.3, 0.9, 0.5];
        let mass = weighted_mass(0.7, &weight);
        let load = weighted_load(0.7, &weight);
        for a in 0..3 {
            assert_relative_eq!(mass[a].iter().sum::<f64>(), load[a], epsilon = 1e-15);
        }
        assert_relative_eq!(load.iter().sum::<f64>(), 0.7 * (0.3 + 0.9 + 0.5) / 3.0, epsilon = 1e-15);
        // int x^3 over the unit right triangle is 1/20: weight x, test x, trial x.
        let cubic = weighted_mass(0.5, &[0.0, 1.0, 0.0])[1][1];
        assert_relative_eq!(cubic, 1.0 / 20.0, epsilon = 1e-15);
    }

    #[test]
    fn facet_rules_integrate_degree_four() {
        // int l0^4 over a segment 1/5, over a triangle 4! 2! / 6! = 1/15 of the measure.
        for (sum, exact) in [(moment::<2>(), 1.0 / 5.0), (moment::<3>(), 1.0 / 15.0)] {
            assert_relative_eq!(sum, exact, epsilon = 1e-14);
        }
    }

    fn moment<const D: usize>() -> f64 {
        facet_rule::<D>().iter().map(|(l, w)| w * l[0].powi(4)).sum()
    }
}
