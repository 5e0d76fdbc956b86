//! Grains without a fluid.

mod bouncing;
mod chain;
mod column;
mod cylinders;
mod falling;
mod gas;
mod hopper;
mod impact;
mod network;
mod packing;
mod rest;
mod rolling;
pub(crate) mod scene;
mod slope;
pub mod stack;

use super::Case;

/// The cases of this group.
pub const CASES: &[Case] = &[
    falling::CASE,
    bouncing::CASE,
    rolling::CASE,
    slope::CASE,
    impact::CASE,
    stack::CASE,
    rest::CASE,
    cylinders::CASE,
    chain::CASE,
    network::CASE,
    packing::CASE,
    gas::CASE,
    column::CASE,
    hopper::CASE,
    hopper::ROLLING,
];
