//! Errors of P1 fields against exact ones.

use crate::models::Vec2;
use rayon::prelude::*;
use voidage_fluid::Mesh;
use voidage_fluid::element::Element;

/// Rule of seven points, exact to degree 5 (J. Radon, Monatsh. Math. Phys. 52, 286, 1948): barycentric coordinates
/// and share of the area.
pub fn rule() -> [([f64; 3], f64); 7] {
    let root = 15f64.sqrt();
    let (a, b) = ((6.0 - root) / 21.0, (6.0 + root) / 21.0);
    let (wa, wb) = ((155.0 - root) / 1200.0, (155.0 + root) / 1200.0);
    let third = 1.0 / 3.0;
    [
        ([third; 3], 9.0 / 40.0),
        ([1.0 - 2.0 * a, a, a], wa),
        ([a, 1.0 - 2.0 * a, a], wa),
        ([a, a, 1.0 - 2.0 * a], wa),
        ([1.0 - 2.0 * b, b, b], wb),
        ([b, 1.0 - 2.0 * b, b], wb),
        ([b, b, 1.0 - 2.0 * b], wb),
    ]
}

/// Errors of one field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Root of the integral of the squared error.
    pub l2: f64,
    /// The same of its gradient.
    pub h1: f64,
}

/// Errors of a field of `N` components given at the nodes; `exact` gives value and gradient of each component.
pub fn errors<const N: usize>(
    mesh: &Mesh<2>,
    nodal: impl Fn(usize) -> [f64; N] + Sync,
    exact: impl Fn(Vec2) -> [(f64, Vec2); N] + Sync,
) -> Errors {
    errors_in(mesh, |_| true, nodal, exact)
}

/// The same in the cells whose centroids are in a part of the mesh.
pub fn errors_in<const N: usize>(
    mesh: &Mesh<2>,
    part: impl Fn(Vec2) -> bool,
    nodal: impl Fn(usize) -> [f64; N] + Sync,
    exact: impl Fn(Vec2) -> [(f64, Vec2); N] + Sync,
) -> Errors {
    let squares = |cell: usize| {
        let nodes: [usize; 3] = std::array::from_fn(|a| mesh.cells[3 * cell + a] as usize);
        let corners = nodes.map(|node| mesh.points[node]);
        let element = Element::<2, 3>::new(corners);
        let values = nodes.map(&nodal);
        let mut sum = [0.0; 2];
        for (l, share) in rule() {
            let x = corners[0] * l[0] + corners[1] * l[1] + corners[2] * l[2];
            for (k, (value, slope)) in exact(x).into_iter().enumerate() {
                let here = (0..3).map(|a| l[a] * values[a][k]).sum::<f64>();
                let gradient = element.gradient_of(&values.map(|value| value[k]));
                sum[0] += share * element.measure * (here - value).powi(2);
                sum[1] += share * element.measure * (gradient - slope).norm_squared();
            }
        }
        sum
    };
    // Summed in the order of the cells, so that the result does not depend on the number of threads.
    let cells: Vec<usize> = (0..mesh.cell_count()).filter(|cell| part(mesh.centroid(*cell))).collect();
    let all: Vec<[f64; 2]> = cells.into_par_iter().map(squares).collect();
    let [l2, h1] = [0, 1].map(|k| all.iter().map(|sum| sum[k]).sum::<f64>().sqrt());
    Errors { l2, h1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::grid;

    /// Against zero, the norms of a linear field; of x^2 + y^2 its interpolation error, whose gradient is of order 1.
    #[test]
    fn norms_are_those_of_known_fields() {
        let norms = |n: usize, f: fn(Vec2) -> f64, exact: fn(Vec2) -> (f64, Vec2)| {
            let mesh = grid([1.0, 1.0], [n, n]).unwrap();
            errors(&mesh, |a| [f(mesh.points[a])], |x| [exact(x)])
        };
        let linear = norms(3, |x| x.x + 2.0 * x.y, |_| (0.0, Vec2::zeros()));
        // int (x + 2y)^2 over the unit square = 1/3 + 1 + 4/3.
        assert!((linear.l2 - (8.0f64 / 3.0).sqrt()).abs() < 1e-14 && (linear.h1 - 5f64.sqrt()).abs() < 1e-14);
        let square = |n| norms(n, |x| x.norm_squared(), |x| (x.norm_squared(), x * 2.0));
        let (coarse, fine) = (square(4), square(8));
        assert!(((coarse.l2 / fine.l2).log2() - 2.0).abs() < 1e-10);
        assert!(((coarse.h1 / fine.h1).log2() - 1.0).abs() < 1e-10);
    }
}
