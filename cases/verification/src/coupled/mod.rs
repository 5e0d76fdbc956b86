//! Grains in a fluid.

use super::Case;

mod fluidisation;
mod plateau;
mod schumann;
mod settling;
mod steady_bed;
mod wakao;

/// The cases of this group.
pub const CASES: &[Case] =
    &[wakao::CASE, schumann::CASE, settling::CASE, steady_bed::CASE, fluidisation::CASE, plateau::CASE];
