//! The motion of the mesh, behind the columns and pieces of a step.

use super::Header;
use super::columns::wrong;
use std::ops::Range;
use voidage_coupling::error::PeerError;
use voidage_fluid::{MeshMotion, Vector};

/// Places in the payload of a step in which the mesh moves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MotionLayout {
    /// Places of the nodes at the end of the step, m.
    pub points: Range<usize>,
    /// Their velocities, m/s.
    pub velocity: Range<usize>,
}

impl MotionLayout {
    /// From `start` on: the motion of so many nodes.
    pub fn new(dimension: usize, nodes: usize, start: usize) -> Self {
        let middle = start + nodes * dimension;
        Self { points: start..middle, velocity: middle..middle + nodes * dimension }
    }

    /// As a header says; `None` if the mesh stands still.
    ///
    /// # Errors
    /// They do not fit the payload.
    pub fn of(header: &Header, dimension: usize, start: usize) -> Result<Option<Self>, PeerError> {
        if !header.moves() {
            return Ok(None);
        }
        let (nodes, limit) = (header.nodes, header.length);
        if nodes > limit {
            return wrong(format!("the motion of {nodes} nodes in {limit} numbers"));
        }
        let places = Self::new(dimension, nodes as usize, start);
        if places.velocity.end as u64 > limit {
            return wrong(format!("the motion of the mesh up to {} in {limit} numbers", places.velocity.end));
        }
        Ok(Some(places))
    }

    /// Writes a motion.
    pub fn write<const D: usize>(&self, motion: &MeshMotion<'_, D>, payload: &mut [f64]) {
        let parts = [(&self.points, motion.points), (&self.velocity, motion.velocity)];
        for (range, vectors) in parts {
            let rows = payload[range.clone()].chunks_exact_mut(D);
            rows.zip(vectors).for_each(|(to, vector)| to.copy_from_slice(vector.as_slice()));
        }
    }

    /// Reads points (m) and velocities (m/s).
    pub fn read<const D: usize>(&self, payload: &[f64]) -> [Vec<Vector<D>>; 2] {
        [&self.points, &self.velocity]
            .map(|range| payload[range.clone()].chunks_exact(D).map(Vector::from_column_slice).collect())
    }
}
