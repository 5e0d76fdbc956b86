//! The fluid alone.

use super::Case;

mod body;
mod cavity;
mod convection;
mod half_plane;
mod hele_shaw;
mod immersed;
pub mod manufactured;
pub mod orders;
mod rayleigh;
mod stefan;
mod taylor;
mod taylor_green;

/// The cases of this group.
pub const CASES: &[Case] = &[
    orders::SPACE,
    orders::MESHES,
    orders::TIME,
    taylor_green::CASE,
    hele_shaw::CASE,
    cavity::CASE,
    convection::CASE,
    rayleigh::CASE,
    stefan::CASE,
    body::CASE,
    half_plane::CASE,
    taylor::CASE,
];
