//! The fluid alone.

use super::Case;

mod hele_shaw;

/// The cases of this group.
pub const CASES: &[Case] = &[hele_shaw::CASE];
