//! Simplicial meshes with named boundary parts.

use crate::Vector;
use serde::{Deserialize, Serialize};

/// A simplicial mesh. Cells are read `D + 1` node numbers at a time, facets `D` at a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mesh<const D: usize> {
    /// Node positions, m.
    pub points: Vec<Vector<D>>,
    /// Node numbers, `D + 1` per cell, positively oriented.
    pub cells: Vec<u32>,
    /// The named parts of the boundary; every boundary facet is in exactly one.
    pub boundaries: Vec<Boundary>,
}

/// A named part of the boundary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Boundary {
    /// The name that conditions refer to.
    pub name: String,
    /// Node numbers, `D` per facet, oriented so that the normal points out of the mesh.
    pub facets: Vec<u32>,
    /// The cell behind each facet.
    pub cells: Vec<u32>,
}
