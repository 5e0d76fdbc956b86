//! What commands with many runs share.
//!
//! A campaign is a list of points. [`points::run`] does those that are not in its [`table::Table`] yet, one after the
//! other or as many at once as there are threads; each is on disk when it ends, so that a campaign that was stopped
//! goes on behind its last point. `voidage verify`, `voidage stability` and `voidage study` are campaigns; they differ
//! in what a point is and what is made of the table.

pub mod clock;
pub mod plot;
pub mod points;
pub mod process;
pub mod progress;
pub mod suite;
pub mod table;

pub use suite::{Effort, Suite};
