//! Everything between grains and fluid: scenes, overlap, closures, schemes, recorders.

pub mod error;
pub mod overlap;
pub mod recorder;
pub mod scene;

pub use error::{Error, Result};
pub use scene::Scene;
