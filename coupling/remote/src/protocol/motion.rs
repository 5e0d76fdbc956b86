//! The motion of the mesh, behind the columns and pieces of a step.

use std::ops::Range;
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
