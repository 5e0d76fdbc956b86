//! Tables that grow on disk, row by row.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Notice, Result};

/// A CSV file that this process alone writes. A row that was added is on disk.
pub struct Table {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl Table {
    /// The table at a path with the rows that are there, to go on behind them. Of whoever was killed, half a row may be
    /// left: it is cut off.
    ///
    /// # Errors
    /// Another process writes the file, or it holds something else.
    pub fn open<T: DeserializeOwned>(path: &Path) -> Result<(Self, Vec<T>)> {
        let file = locked(path)?;
        let rows = read(path)?;
        let whole = whole(path)?;
        file.set_len(whole.len() as u64).map_err(|error| Error::file(path, "write", error))?;
        let writer = csv::WriterBuilder::new().has_headers(whole.is_empty()).from_writer(file);
        Ok((Self { path: path.into(), writer }, rows))
    }

    /// An empty table at a path, in place of what is there.
    ///
    /// # Errors
    /// Another process writes the file.
    pub fn create(path: &Path) -> Result<Self> {
        let file = locked(path)?;
        file.set_len(0).map_err(|error| Error::file(path, "write", error))?;
        Ok(Self { path: path.into(), writer: csv::Writer::from_writer(file) })
    }

    /// Adds rows; they are on disk when this returns.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn add<T: Serialize>(&mut self, rows: impl IntoIterator<Item = T>) -> Result<()> {
        let failed = |error: csv::Error| Error::run(format!("cannot write {}: {error}", self.path.display()));
        rows.into_iter().try_for_each(|row| self.writer.serialize(row)).map_err(failed)?;
        self.writer.flush().map_err(|error| failed(error.into()))
    }

    /// Other rows in place of all, at once: what is on disk is whole at any time.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn replace<T: Serialize>(&mut self, rows: &[T]) -> Result<()> {
        let beside = self.path.with_extension("part");
        let mut other = Self::create(&beside)?;
        other.add(rows)?;
        std::fs::rename(&beside, &self.path).map_err(|error| Error::file(&self.path, "write", error))?;
        self.writer = other.writer;
        Ok(())
    }
}

/// The whole rows of a table that is there.
///
/// # Errors
/// It cannot be read, or it is no such table.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>> {
    let text = whole(path)?;
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    reader.deserialize().collect::<std::result::Result<_, _>>().map_err(|error: csv::Error| {
        let what = format!("{}: {error}", path.display());
        Error::input(Notice::new(
            what,
            "it is of another program or version: remove it, or give another --out",
        ))
    })
}

/// A file that this process alone writes.
fn locked(path: &Path) -> Result<File> {
    let file = OpenOptions::new().create(true).append(true).open(path);
    let file = file.map_err(|error| Error::file(path, "write", error))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(_) => {
            let what = format!("{}: another process is at work on it", path.display());
            Err(Error::input(Notice::new(what, "wait for it, or give another --out")))
        }
    }
}

/// The text up to the end of the last whole row.
fn whole(path: &Path) -> Result<String> {
    let mut text = std::fs::read_to_string(path).map_err(|error| Error::file(path, "read", error))?;
    text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_row_is_cut_off_and_two_processes_do_not_mix() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let mut table = Table::create(&path).unwrap();
        table.add([("x", 1.0), ("y", 2.0)]).unwrap();
        assert!(Table::open::<(String, f64)>(&path).is_err(), "it is open");
        drop(table);
        std::fs::write(&path, "name,value\nx,1.0\ny,2.0\nz,3").unwrap();
        let (mut table, rows) = Table::open::<(String, f64)>(&path).unwrap();
        assert_eq!(rows, [("x".to_owned(), 1.0), ("y".to_owned(), 2.0)]);
        table.add([("z", 4.0)]).unwrap();
        table.replace(&[("w", 5.0), ("z", 4.0)]).unwrap();
        table.add([("v", 6.0)]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.ends_with("w,5.0\nz,4.0\nv,6.0\n"), "{text}");
    }
}
