//! PVD files: the frames of a run and their times.

use super::files::write_whole;
use super::vtk_read::read_collection;
use std::path::{Path, PathBuf};
use voidage_coupling::error::Result;

/// The frames of one kind; the PVD file is written anew, whole, after each of them.
#[derive(Debug)]
pub struct Collection {
    path: PathBuf,
    /// Times, s, and files relative to the PVD file.
    entries: Vec<(f64, PathBuf)>,
}

impl Collection {
    /// A collection without frames; the file appears with the first.
    pub fn new(path: &Path) -> Self {
        Collection { path: path.to_path_buf(), entries: Vec::new() }
    }

    /// Goes on with the frames of an earlier run up to a time, s; later ones are forgotten.
    pub fn resume(path: &Path, time: f64) -> Result<Self> {
        let mut collection = Collection::new(path);
        if path.exists() {
            let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
            let earlier = read_collection(path)?.into_iter().filter(|(at, _)| *at <= time);
            let relative = |file: PathBuf| file.strip_prefix(&folder).map(Path::to_path_buf).unwrap_or(file);
            collection.entries = earlier.map(|(at, file)| (at, relative(file))).collect();
        }
        Ok(collection)
    }

    /// Whether a file of this name is one of the frames.
    pub fn has(&self, name: &str) -> bool {
        self.entries.iter().any(|(_, file)| file.file_name().is_some_and(|frame| frame == name))
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are no frames.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Time of the last frame, s.
    pub fn last_time(&self) -> Option<f64> {
        self.entries.last().map(|(time, _)| *time)
    }

    /// Adds a frame that has been written.
    pub fn push(&mut self, time: f64, file: PathBuf) -> Result<()> {
        self.entries.push((time, file));
        write_whole(&self.path, |out| {
            writeln!(out, "<?xml version=\"1.0\"?>")?;
            writeln!(
                out,
                "<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>"
            )?;
            for (time, file) in &self.entries {
                writeln!(out, "<DataSet timestep=\"{time}\" part=\"0\" file=\"{}\"/>", file.display())?;
            }
            writeln!(out, "</Collection>\n</VTKFile>")
        })
    }
}
