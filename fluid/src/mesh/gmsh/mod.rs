//! Meshes in Gmsh's format: .msh 4.1, and 2.2 and binary files, which are read only.
//!
//! Format: "MSH file format", Gmsh reference manual. Read are `$PhysicalNames`, `$Entities`, `$Nodes` and `$Elements`;
//! other sections are passed over.

mod binary;
mod read;
#[cfg(test)]
mod tests;
mod write;

/// Gmsh's number of an element type: 2-node line, 3-node triangle, 4-node tetrahedron.
const SIMPLEX: [u32; 4] = [15, 1, 2, 4];
