//! Time series as CSV: one row per time, columns with their units in the names.

use super::files::write_whole;
use std::fs::{File, OpenOptions};
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};
use voidage_coupling::error::{Error, Notice, Result};

/// A time series that is being written; its first column is the time, s.
#[derive(Debug)]
pub struct Series {
    path: PathBuf,
    file: File,
    columns: Vec<String>,
    /// Bytes up to the end of the last whole row.
    length: u64,
}

impl Series {
    /// Starts a new file.
    pub fn create(path: &Path, columns: &[String]) -> Result<Self> {
        if let Some((_, twice)) = columns.iter().enumerate().find(|(k, name)| columns[..*k].contains(name)) {
            let what = format!("two columns of series.csv would be called `{twice}`");
            return Err(Error::input(Notice::new(
                what,
                "give a scalar, a wall, a part or a probe another name",
            )));
        }
        write_whole(path, |file| writeln!(file, "{}", columns.join(",")))?;
        Series::open(path, columns)
    }

    /// Goes on with the file of an earlier run: rows later than `time` are cut off. The columns must be the same, and
    /// no row before may be damaged.
    pub fn resume(path: &Path, columns: &[String], time: f64) -> Result<Self> {
        if !path.exists() {
            return Series::create(path, columns);
        }
        let text = std::fs::read_to_string(path).map_err(|error| Error::file(path, "read", error))?;
        // A row without its end may have lost digits of its last number.
        let mut lines = text[..text.rfind('\n').map_or(0, |end| end + 1)].lines();
        let header = lines.next().unwrap_or("");
        if header != columns.join(",") {
            let what = format!(
                "{}:1: holds the columns `{header}`, but this run records `{}`",
                path.display(),
                columns.join(",")
            );
            return Err(Error::input(Notice::new(what, "restart into an empty folder")));
        }
        let (mut kept, mut last) = (vec![], f64::NEG_INFINITY);
        for (line, number) in lines.zip(2..) {
            let at = read_row(line, columns, last).map_err(|what| {
                let what = format!("{}:{number}: {what}", path.display());
                let help =
                    "it was damaged or changed: repair this row, or restart into another folder with --out";
                Error::input(Notice::new(what, help))
            })?;
            if at > time {
                break;
            }
            kept.push(line);
            last = at;
        }
        write_whole(path, |file| {
            writeln!(file, "{header}")?;
            kept.iter().try_for_each(|line| writeln!(file, "{line}"))
        })?;
        Series::open(path, columns)
    }

    fn open(path: &Path, columns: &[String]) -> Result<Self> {
        let mut file =
            OpenOptions::new().append(true).open(path).map_err(|error| Error::file(path, "write", error))?;
        let length =
            file.seek(std::io::SeekFrom::End(0)).map_err(|error| Error::file(path, "write", error))?;
        Ok(Series { path: path.to_path_buf(), file, columns: columns.to_vec(), length })
    }

    /// Whether the file is as this process left it.
    ///
    /// # Errors
    /// Somebody has removed or changed it.
    pub fn check(&self) -> Result<()> {
        let length = std::fs::metadata(&self.path).map(|data| data.len());
        if length.as_ref().ok() == Some(&self.length) {
            return Ok(());
        }
        let what = if length.is_err() { "removed" } else { "changed" };
        let what = format!("{}: somebody has {what} it while the run wrote it", self.path.display());
        Err(Error::run(Notice::new(what, "run again, and leave the folder alone until it ends")))
    }

    /// Waits until the rows are on the disk, so that a checkpoint never outlives rows before it.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_data().map_err(|error| Error::file(&self.path, "write", error))
    }

    /// The columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Writes a row; numbers are written so that they read back the same. A row that does not fit on the disk is taken
    /// away again.
    pub fn row(&mut self, values: &[f64]) -> Result<()> {
        if values.len() != self.columns.len() {
            let (have, want) = (values.len(), self.columns.len());
            return Err(Error::run(format!(
                "{}: a row of {have} values for {want} columns",
                self.path.display()
            )));
        }
        let mut row = String::new();
        for (i, value) in values.iter().enumerate() {
            let comma = if i == 0 { "" } else { "," };
            row.push_str(&format!("{comma}{value}"));
        }
        row.push('\n');
        if let Err(error) = self.file.write_all(row.as_bytes()).and_then(|()| self.file.flush()) {
            // The first error counts: if cutting back fails too, the reader drops the unfinished row.
            let _ = self.file.set_len(self.length);
            return Err(Error::file(&self.path, "write", error));
        }
        self.length += row.len() as u64;
        Ok(())
    }
}

/// The time of a row that comes after one at the time `last`, s; or what is wrong with it.
fn read_row(line: &str, columns: &[String], last: f64) -> std::result::Result<f64, String> {
    let values: Vec<&str> = line.split(',').collect();
    if values.len() != columns.len() {
        return Err(format!("{} values for {} columns: `{line}`", values.len(), columns.len()));
    }
    let mut numbers = vec![];
    for (name, value) in columns.iter().zip(values) {
        let number = value.parse::<f64>();
        numbers.push(number.map_err(|_| format!("`{name}` is `{value}`, which is no number"))?);
    }
    match numbers.first() {
        Some(time) if *time > last => Ok(*time),
        time => Err(format!("`{}` is {:?} after {last}", columns[0], time.copied().unwrap_or(f64::NAN))),
    }
}
