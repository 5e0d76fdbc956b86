//! Everything between grains and fluid.
//!
//! [`Coupled`] holds what a scene has - grains, fluid, or a [`Mixture`] of both - and advances it ([`step`]), a mixture
//! through a [`scheme`]. The equations are in [`model`]. The seam is one affine law ([`load::GrainLoad`]) that every
//! scheme fills, and every fluid solver gets as point terms ([`exchange`]).

mod agreement;
mod appearing;
pub mod backend;
pub mod closure;
pub mod droplet;
pub mod error;
pub mod exchange;
pub mod fluid;
pub mod interaction;
mod leaving;
pub mod load;
pub mod mixture;
pub mod model;
pub mod motion;
pub mod motions;
pub mod overlap;
pub mod parts;
pub mod remesh;
pub mod report;
pub mod scheme;
pub mod single;
pub mod step;
pub mod unsteady;

pub use agreement::{Agreement, Carried};
pub use appearing::Appearing;
pub use error::{Error, Notice, PeerError, Result};
pub use fluid::{Clock, Fluid};
pub use interaction::{Interaction, Laws};
pub use mixture::Mixture;
pub use report::{Phases, StepReport};
pub use step::{Coupled, System};

/// Place of the temperature among the scalars of a fluid with heat.
pub const HEAT: usize = 0;

/// Name of the temperature among the scalars.
pub const TEMPERATURE: &str = "temperature";
