//! How good the cells of a plane mesh are.

use super::Mesh;
use crate::Vector;

/// Angles and lengths of a plane mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Smallest angle of any cell, degrees.
    pub smallest_angle: f64,
    /// Largest angle of any cell, degrees.
    pub largest_angle: f64,
    /// Shortest edge, m.
    pub shortest_edge: f64,
    /// Longest edge, m.
    pub longest_edge: f64,
    /// Mean length over the edges (each counted once per cell), m.
    pub mean_edge: f64,
}

impl Mesh<2> {
    /// Generated unstructured meshes have no angle below this, degrees.
    pub const SMALLEST_ANGLE: f64 = 25.0;

    /// Smallest and largest angles and edges.
    pub fn quality(&self) -> Quality {
        let mut out = Quality {
            smallest_angle: f64::INFINITY,
            largest_angle: 0.0,
            shortest_edge: f64::INFINITY,
            longest_edge: 0.0,
            mean_edge: 0.0,
        };
        for nodes in self.cells.chunks_exact(3) {
            let p = [0, 1, 2].map(|k| self.points[nodes[k] as usize]);
            for k in 0..3 {
                let angle = angle(p, k);
                let length = (p[(k + 1) % 3] - p[k]).norm();
                out.smallest_angle = out.smallest_angle.min(angle);
                out.largest_angle = out.largest_angle.max(angle);
                out.shortest_edge = out.shortest_edge.min(length);
                out.longest_edge = out.longest_edge.max(length);
                out.mean_edge += length;
            }
        }
        out.mean_edge /= self.cells.len() as f64;
        out
    }
}

/// The angle at corner `k` in degrees, negative in a triangle of negative orientation.
fn angle(p: [Vector<2>; 3], k: usize) -> f64 {
    let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
    a.perp(&b).atan2(a.dot(&b)).to_degrees()
}

/// Smallest angle of a triangle, degrees.
pub(super) fn smallest_angle_of(p: [Vector<2>; 3]) -> f64 {
    angle(p, 0).min(angle(p, 1)).min(angle(p, 2))
}

/// Smallest angle of all triangles, degrees.
pub(super) fn smallest_angle(points: &[Vector<2>], cells: &[u32]) -> f64 {
    let corners = |nodes: &[u32]| [0, 1, 2].map(|k| points[nodes[k] as usize]);
    cells.chunks_exact(3).map(|nodes| smallest_angle_of(corners(nodes))).fold(f64::INFINITY, f64::min)
}
