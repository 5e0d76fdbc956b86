//! Pictures of tables.

pub mod bars;
pub mod canvas;
mod legend;
pub mod panels;
