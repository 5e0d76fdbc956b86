//! Grains without a fluid.

use super::Case;

/// The cases of this group.
pub const CASES: &[Case] = &[];
