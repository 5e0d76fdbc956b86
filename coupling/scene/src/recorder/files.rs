//! Files that appear whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use voidage_coupling::error::{Error, Result};

/// What the names of unfinished files begin with.
pub(super) const TEMPORARY: &str = ".voidage-";

/// Writes a file beside its place and renames it: a reader sees the old file or the new one, never half of it,
/// even where the machine goes off.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let attempt = || {
        let mut file = BufWriter::with_capacity(
            1 << 18,
            tempfile::Builder::new().prefix(TEMPORARY).tempfile_in(folder)?,
        );
        write(&mut file)?;
        let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.as_file().sync_all()?;
        set_usual_permissions(file.path())?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    attempt().map_err(|error: io::Error| Error::file(path, "write", error))
}

/// Temporary files are made for their owner only; results are for everybody who may enter the folder.
fn set_usual_permissions(path: &Path) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(path, fs::Permissions::from_mode(0o644))?;
    }
    Ok(())
}

/// Makes a folder and those above it.
pub fn create_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).map_err(|error| Error::file(path, "make the folder", error))
}
