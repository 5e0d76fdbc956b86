//! Everything between grains and fluid.

pub mod overlap;
