//! Volume-averaged Navier-Stokes with transported scalars by stabilised P1-P1 finite elements.
//!
//! The fluid knows nothing of grains: what is immersed in it are [`points::Points`] with a drag coefficient
//! and an affine law for their velocity and for each scalar that they exchange. A step of [`flow::Flow`]
//! solves the equations of the scalars, heat among them ([`transport`]), and then, in one monolithic system, momentum
//! and mass ([`forms`]) on a simplicial mesh ([`mesh`]), which may move ([`geometry`]), with conditions on its named
//! boundaries ([`conditions`]). What passes each of these follows from the discrete equations ([`balance`]).

pub mod assembly;
pub mod balance;
pub mod body;
pub mod boundary;
pub mod conditions;
pub mod element;
pub mod error;
pub mod flow;
pub mod forms;
pub mod geometry;
pub mod harmonic;
pub mod linear;
pub mod mesh;
pub mod points;
mod shear;
#[cfg(test)]
mod steady_tests;
pub mod transport;

pub use error::{Error, Result};
pub use flow::Flow;
pub use geometry::MeshMotion;
pub use mesh::Mesh;

/// A point or vector of the plane (`D = 2`) or of space (`D = 3`).
pub type Vector<const D: usize> = nalgebra::SVector<f64, D>;
