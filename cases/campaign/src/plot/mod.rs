//! Pictures of tables.

pub mod bars;
pub mod canvas;
pub mod panels;
