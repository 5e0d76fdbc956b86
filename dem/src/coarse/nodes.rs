//! The nodes of the factors: a regular grid over all grains, many grains wide.

use crate::space::Vector;

/// Spacing of the nodes, in mean diameters at least; and nodes along an axis at most.
const SPACING: f64 = 9.0;
const fn most_nodes(dimensions: usize) -> f64 {
    if dimensions == 2 { 32.0 } else { 8.0 }
}
/// A grain meets the nodes of two cells along an axis; nodes couple to the two on either side.
pub const NEAR: usize = 3;
pub const COUPLED: usize = 5;
/// Offsets to the coupled nodes of the same or a higher number.
pub const fn offsets(dimensions: usize) -> usize {
    COUPLED.pow(dimensions as u32) / 2 + 1
}

/// The grid.
#[derive(Default)]
pub struct Nodes<const D: usize> {
    /// Nodes along each axis, at least two.
    dims: Vec<usize>,
    origin: Vec<f64>,
    inverse: f64,
}

impl<const D: usize> Nodes<D> {
    /// Lays the grid over the contacts, of which two corners of a box are given. Grains in flight have none: they do
    /// not count.
    pub fn lay(&mut self, [low, high]: [Vector<D>; 2], radius: &[f64]) {
        self.dims.clear();
        self.origin.clear();
        let extent = high - low;
        if radius.is_empty() || !extent.iter().all(|e| *e >= 0.0) {
            return;
        }
        let volume: f64 = radius.iter().map(|r| r.powi(D as i32)).sum();
        let largest = radius.iter().fold(0.0, |a: f64, r| a.max(*r));
        let mean = 2.0 * (volume / radius.len() as f64).powf(1.0 / D as f64);
        // A grain and the gaps around it are narrower than a cell: its contacts lie in two cells along an axis at most.
        let spacing = (SPACING * mean).max(extent.max() / (most_nodes(D) - 1.0)).max(4.2 * largest);
        self.inverse = 1.0 / spacing;
        self.origin.extend(low.iter());
        self.dims.extend(extent.iter().map(|e| (e / spacing).ceil().max(1.0) as usize + 1));
    }

    /// Whether there is more than one cell.
    pub fn reach_far(&self) -> bool {
        self.dims.iter().any(|nodes| *nodes > 2)
    }

    /// Number of nodes; none where there are no contacts but across periodic sides.
    pub fn count(&self) -> usize {
        if self.dims.is_empty() { 0 } else { self.dims.iter().product() }
    }

    /// The cell of a point along each axis.
    pub fn cell(&self, x: &Vector<D>) -> [usize; D] {
        std::array::from_fn(|a| (self.along(x, a).max(0.0) as usize).min(self.dims[a] - 2))
    }

    /// Place of a point along an axis, in cells.
    fn along(&self, x: &Vector<D>, axis: usize) -> f64 {
        (x[axis] - self.origin[axis]) * self.inverse
    }

    /// Number of a node by its place along each axis.
    pub fn number(&self, q: &[usize; D]) -> usize {
        (0..D).rev().fold(0, |index, a| index * self.dims[a] + q[a])
    }

    /// Calls `f` with the nodes of the cell of a point and the values of their hat functions there.
    #[inline(always)]
    pub fn around(&self, x: &Vector<D>, mut f: impl FnMut([usize; D], f64)) {
        let cell = self.cell(x);
        let share: [f64; D] = std::array::from_fn(|a| self.along(x, a) - cell[a] as f64);
        for corner in 0..1usize << D {
            let up = |a: usize| corner >> a & 1;
            let weight = (0..D).map(|a| if up(a) == 1 { share[a] } else { 1.0 - share[a] }).product();
            f(std::array::from_fn(|a| cell[a] + up(a)), weight);
        }
    }

    fn stride(&self, axis: usize) -> usize {
        self.dims[..axis].iter().product()
    }

    /// The largest difference of the numbers of coupled nodes.
    pub fn reach(&self) -> usize {
        (0..D).map(|a| COUPLED / 2 * self.stride(a)).sum()
    }

    /// The node at an offset from another (wraps where there is none: its entries are zero).
    pub fn other(&self, node: usize, offset: usize) -> usize {
        let digit = |a: usize| (offset + offsets(D) - 1) / COUPLED.pow(a as u32) % COUPLED;
        let half = COUPLED as isize / 2;
        let shift: isize = (0..D).map(|a| (digit(a) as isize - half) * self.stride(a) as isize).sum();
        node.wrapping_add_signed(shift)
    }
}
