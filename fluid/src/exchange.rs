//! What passes between immersed bodies and the fluid.

use crate::Vector;
use std::ops::Range;

/// The pieces in which the mesh cuts immersed bodies: body `i` owns pieces `first[i]..first[i + 1]`,
/// in the order of their cells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pieces<const D: usize> {
    /// First piece of each body, and at the end the number of pieces: bodies + 1 entries.
    pub first: Vec<u32>,
    /// Cell of each piece.
    pub cell: Vec<u32>,
    /// Barycentric coordinates 1..=D of the centroid of each piece (coordinate 0 is 1 less their sum).
    pub coordinate: Vec<Vector<D>>,
    /// Share of the piece in the volume of its body, V_q / V_i: positive, with sum 1 per body to round-off
    /// (rescaled where the boundary of the domain cuts off a sliver).
    pub share: Vec<f64>,
}

impl<const D: usize> Pieces<D> {
    /// Number of pieces.
    pub fn len(&self) -> usize {
        self.cell.len()
    }

    /// Whether there is no piece.
    pub fn is_empty(&self) -> bool {
        self.cell.is_empty()
    }

    /// Number of bodies.
    pub fn bodies(&self) -> usize {
        self.first.len().saturating_sub(1)
    }

    /// The numbers of the pieces of a body.
    pub fn of(&self, body: usize) -> Range<usize> {
        self.first[body] as usize..self.first[body + 1] as usize
    }

    /// Forgets all pieces and keeps the memory.
    pub fn clear(&mut self) {
        self.first.clear();
        self.cell.clear();
        self.coordinate.clear();
        self.share.clear();
    }
}
