//! What refinement and smoothing need to know of a domain.

use super::domain::Rectangle;
use super::outline::{FREE, Site, onto_circle};
use spade::Point2;

/// A domain that can be meshed.
pub(super) trait Shape {
    /// Whether edges of the boundary may be halved.
    const DIVISIBLE: bool;
    /// The wanted length of edges at a point, m.
    fn size_at(&self, p: [f64; 2]) -> f64;
    /// The smallest wanted length of edges, m.
    fn smallest_size(&self) -> f64;
    /// Whether a triangle belongs to the domain.
    fn contains(&self, corners: [&Site; 3]) -> bool;
    /// Whether a node on no hole lies on the boundary all the same.
    fn on_side(&self, p: Point2<f64>) -> bool;
    /// The point of a hole's boundary nearest to the middle of one of its edges.
    fn onto_hole(&self, hole: u32, middle: Point2<f64>) -> Point2<f64>;
}

impl Shape for Rectangle {
    const DIVISIBLE: bool = true;

    fn size_at(&self, p: [f64; 2]) -> f64 {
        self.size_at(p)
    }

    fn smallest_size(&self) -> f64 {
        self.smallest_size()
    }

    /// Triangles inside a hole have all their nodes on its circle; all others belong to the domain.
    fn contains(&self, corners: [&Site; 3]) -> bool {
        let [a, b, c] = corners.map(|site| site.hole);
        a == FREE || a != b || b != c
    }

    fn on_side(&self, p: Point2<f64>) -> bool {
        p.x == self.lower[0] || p.x == self.upper[0] || p.y == self.lower[1] || p.y == self.upper[1]
    }

    fn onto_hole(&self, hole: u32, middle: Point2<f64>) -> Point2<f64> {
        onto_circle(&self.holes[hole as usize], middle)
    }
}
