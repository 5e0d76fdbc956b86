//! Volume-averaged Navier-Stokes with heat by stabilised P1-P1 finite elements.

pub mod error;
pub mod exchange;
pub mod linear;
pub mod mesh;

pub use error::{Error, Result};
pub use mesh::Mesh;

/// A point or vector of the plane (`D = 2`) or of space (`D = 3`).
pub type Vector<const D: usize> = nalgebra::SVector<f64, D>;
