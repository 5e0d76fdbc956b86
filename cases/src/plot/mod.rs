//! Pictures of a run.

use std::path::{Path, PathBuf};
use voidage_coupling::Result;

/// Draws all pictures that the files in a folder allow.
pub fn draw(_folder: &Path) -> Result<Vec<PathBuf>> {
    Ok(Vec::new())
}
