//! Smoothing: interior nodes move towards the centre of the cells around them.

use super::outline::{FREE, Site};
use super::quality::smallest_angle_of;
use super::shape::Shape;
use crate::Vector;
use spade::Point2;

/// Angles above this may shrink when a node moves, degrees.
const GOOD_ANGLE: f64 = 35.0;

/// One sweep over the nodes. A node goes to the weighted mean of the centroids of its cells, weight |e| / h^4: with
/// this density the centroidal arrangement has edges proportional to h (Gersho's rule in the plane: spacing ~
/// density^(-1/4)). It goes only if no angle of its cells falls below [`GOOD_ANGLE`] or below the smallest before.
pub(super) fn smooth<S: Shape>(domain: &S, sites: &mut [Site], cells: &[u32]) {
    let (first, around) = cells_around(sites.len(), cells);
    for node in 0..sites.len() {
        let star = &around[first[node] as usize..first[node + 1] as usize];
        let old = sites[node].at;
        if sites[node].hole != FREE || domain.on_side(old) || star.is_empty() {
            continue;
        }
        let corners = |sites: &[Site], cell: u32| {
            let nodes = &cells[3 * cell as usize..3 * cell as usize + 3];
            [0, 1, 2].map(|k| {
                let p = sites[nodes[k] as usize].at;
                Vector::<2>::new(p.x, p.y)
            })
        };
        let worst = |sites: &[Site]| {
            star.iter().map(|&cell| smallest_angle_of(corners(sites, cell))).fold(f64::INFINITY, f64::min)
        };
        let (mut sum, mut weights) = (Vector::<2>::zeros(), 0.0);
        for &cell in star {
            let [a, b, c] = corners(sites, cell);
            let centroid = (a + b + c) / 3.0;
            let weight = (b - a).perp(&(c - a)) / domain.size_at([centroid[0], centroid[1]]).powi(4);
            sum += weight * centroid;
            weights += weight;
        }
        let before = worst(sites);
        let new = sum / weights;
        sites[node].at = Point2::new(new[0], new[1]);
        let after = worst(sites);
        if after.is_nan() || after < before.min(GOOD_ANGLE) {
            sites[node].at = old;
        }
    }
}

/// The cells around each node: those of node n are `around[first[n]..first[n + 1]]`.
fn cells_around(nodes: usize, cells: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0u32; nodes + 2];
    cells.iter().for_each(|&node| first[node as usize + 2] += 1);
    for i in 2..first.len() {
        first[i] += first[i - 1];
    }
    let mut around = vec![0u32; cells.len()];
    for (i, &node) in cells.iter().enumerate() {
        let place = &mut first[node as usize + 1];
        around[*place as usize] = (i / 3) as u32;
        *place += 1;
    }
    first.pop();
    (first, around)
}
