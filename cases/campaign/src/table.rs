//! Tables that grow on disk, row by row.

use csv::StringRecord;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use tracing::warn;
use voidage_coupling::{Error, Notice, Result};

/// Name of the last column of a table that is read again: a checksum of the row and of the names of its columns.
const CHECK: &str = "check";
/// What a reader can do about a damaged row.
const DAMAGED: &str = "remove this line, and what it stands for is done again; or give another --out";
/// What a reader can do about a row that may be damaged, in a file that may be another table.
const UNKNOWN: &str =
    "it was damaged, or is of another program or version: remove the line or the file, or give another --out";
/// What a reader can do about a file that is another table.
const OTHER: &str = "it is of another program or version: remove it, or give another --out";

/// A CSV file that this process alone writes. A row that was added is on disk.
pub struct Table {
    path: PathBuf,
    file: File,
    /// Whether rows have a checksum.
    checked: bool,
    /// The names of the columns, once they are on disk.
    header: Option<StringRecord>,
}

impl Table {
    /// The table at a path with the rows that are there, to go on behind them. Of whoever was killed, half a row may be
    /// left: it is cut off, and a warning says so. `wrong` says what is wrong with a row.
    ///
    /// # Errors
    /// Another process writes the file, it holds something else, or a row was damaged.
    pub fn open<T: DeserializeOwned>(
        path: &Path,
        wrong: impl Fn(&T) -> Option<String>,
    ) -> Result<(Self, Vec<T>)> {
        let file = locked(path)?;
        let whole = whole(path)?;
        let (header, rows) = rows(path, &whole, wrong)?;
        file.set_len(whole.len() as u64).map_err(|error| Error::file(path, "write", error))?;
        Ok((Self { path: path.into(), file, checked: true, header }, rows))
    }

    /// An empty table at a path, in place of what is there. It is not read again, and its rows have no checksum.
    ///
    /// # Errors
    /// Another process writes the file.
    pub fn create(path: &Path) -> Result<Self> {
        let file = locked(path)?;
        file.set_len(0).map_err(|error| Error::file(path, "write", error))?;
        Ok(Self { path: path.into(), file, checked: false, header: None })
    }

    /// Adds rows, which are structures with named fields; they are on disk when this returns.
    ///
    /// # Errors
    /// They cannot be written, or the table has other columns.
    pub fn add<T: Serialize>(&mut self, rows: impl IntoIterator<Item = T>) -> Result<()> {
        let failed = |error: csv::Error| Error::run(format!("cannot write {}: {error}", self.path.display()));
        let mut writer = csv::Writer::from_writer(vec![]);
        for row in rows {
            let (names, mut values) = record(&row).map_err(failed)?;
            match &self.header {
                None => {
                    let mut header = names.clone();
                    if self.checked {
                        header.push_field(CHECK);
                    }
                    writer.write_record(&header).map_err(failed)?;
                    self.header = Some(names.clone());
                }
                Some(header) if *header != names => return Err(other_columns(&self.path, header)),
                Some(_) => {}
            }
            if self.checked {
                values.push_field(&checksum(&names, &values));
            }
            writer.write_record(&values).map_err(failed)?;
        }
        let text = writer.into_inner().map_err(|error| failed(error.into_error().into()))?;
        self.file.write_all(&text).map_err(|error| failed(error.into()))
    }

    /// Other rows in place of all, at once: what is on disk is whole at any time.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn replace<T: Serialize>(&mut self, rows: &[T]) -> Result<()> {
        let beside = self.path.with_extension("part");
        let mut other = Self { checked: self.checked, ..Self::create(&beside)? };
        other.add(rows)?;
        std::fs::rename(&beside, &self.path).map_err(|error| Error::file(&self.path, "write", error))?;
        (self.file, self.header) = (other.file, other.header);
        Ok(())
    }
}

/// The whole rows of a table that is there; `wrong` says what is wrong with a row.
///
/// # Errors
/// It cannot be read, it is no such table, or a row was damaged.
pub fn read<T: DeserializeOwned>(path: &Path, wrong: impl Fn(&T) -> Option<String>) -> Result<Vec<T>> {
    Ok(rows(path, &whole(path)?, wrong)?.1)
}

/// The names of the columns of a table, without that of the checksum, and its rows.
fn rows<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    wrong: impl Fn(&T) -> Option<String>,
) -> Result<(Option<StringRecord>, Vec<T>)> {
    let damaged = |line: u64, what: String| {
        Error::input(Notice::new(format!("{}:{line}: {what}", path.display()), DAMAGED))
    };
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let (mut header, mut rows) = (None, vec![]);
    for (number, entry) in reader.records().enumerate() {
        let mut values = entry.map_err(|error| {
            let line = error.position().map_or(number as u64 + 1, csv::Position::line);
            damaged(line, error.to_string())
        })?;
        let line = values.position().map_or(number as u64 + 1, csv::Position::line);
        let last = values.len().saturating_sub(1);
        let check = values.get(last).unwrap_or_default().to_owned();
        let Some(names) = &header else {
            values.truncate(last);
            if check != CHECK {
                let what = format!("{}:{line}: its last column is `{check}`, not `{CHECK}`", path.display());
                return Err(Error::input(Notice::new(what, OTHER)));
            }
            header = Some(values);
            continue;
        };
        if last != names.len() {
            let what = format!(
                "{} values for {} columns: `{}`",
                last + 1,
                names.len() + 1,
                values.iter().collect::<Vec<_>>().join(",")
            );
            return Err(damaged(line, what));
        }
        values.truncate(last);
        let row: T = values.deserialize(Some(names)).map_err(|error| match error.kind() {
            csv::ErrorKind::Deserialize { err, .. } => match err.field().map(|field| field as usize) {
                Some(field) => {
                    let (name, value) = (&names[field], &values[field]);
                    damaged(line, format!("`{name}` is `{value}`: {}", err.kind()))
                }
                None => {
                    let what = format!("{}:{line}: {}", path.display(), err.kind());
                    Error::input(Notice::new(what, UNKNOWN))
                }
            },
            _ => damaged(line, error.to_string()),
        })?;
        if let Some(what) = wrong(&row) {
            return Err(damaged(line, what));
        }
        if check != checksum(names, &values) {
            let what = format!(
                "the row has changed since it was written, as its checksum `{check}` says: `{}`",
                values.iter().collect::<Vec<_>>().join(",")
            );
            return Err(damaged(line, what));
        }
        rows.push(row);
    }
    Ok((header, rows))
}

/// The names of the fields of a row, and their values.
fn record<T: Serialize>(row: &T) -> csv::Result<(StringRecord, StringRecord)> {
    let mut writer = csv::Writer::from_writer(vec![]);
    writer.serialize(row)?;
    let text = writer.into_inner().map_err(|error| error.into_error())?;
    let mut reader = csv::Reader::from_reader(text.as_slice());
    let names = reader.headers()?.clone();
    let values = reader.records().next().transpose()?.unwrap_or_default();
    Ok((names, values))
}

/// A checksum of the names and the values of a row, of 64 bits.
fn checksum(names: &StringRecord, values: &StringRecord) -> String {
    let mut hasher = blake3::Hasher::new();
    for field in names.iter().chain(values) {
        // A byte that no text has parts the fields.
        hasher.update(field.as_bytes()).update(&[0xff]);
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

fn other_columns(path: &Path, header: &StringRecord) -> Error {
    let columns = header.iter().collect::<Vec<_>>().join(",");
    Error::input(Notice::new(format!("{}:1: has the columns `{columns}`", path.display()), OTHER))
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

/// The text up to the end of the last whole row. Of half a row behind it a warning says that it is not used.
fn whole(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(|error| Error::file(path, "read", error))?;
    let end = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let (whole, rest) = bytes.split_at(end);
    let line = whole.iter().filter(|byte| **byte == b'\n').count() + 1;
    if !rest.is_empty() {
        let rest = String::from_utf8_lossy(rest);
        warn!("{}:{line}: half a row, which is not used: `{rest}`", path.display());
    }
    String::from_utf8(whole.to_vec()).map_err(|error| {
        let good = error.utf8_error().valid_up_to();
        let line = whole[..good].iter().filter(|byte| **byte == b'\n').count() + 1;
        Error::input(Notice::new(format!("{}:{line}: holds what is no text", path.display()), DAMAGED))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    struct Row {
        name: String,
        value: f64,
        note: Option<u64>,
    }

    fn row(name: &str, value: f64) -> Row {
        Row { name: name.into(), value, note: None }
    }

    fn none(_: &Row) -> Option<String> {
        None
    }

    /// A table with two rows in a folder of its own.
    fn written() -> (tempfile::TempDir, PathBuf, String) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let (mut table, rows) = Table::open(&path, none).unwrap();
        assert!(rows.is_empty());
        table.add([row("x", 1.0), row("y, \"z\"\nw", -2.5e-3)]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        (folder, path, text)
    }

    #[test]
    fn half_a_row_is_cut_off_and_two_processes_do_not_mix() {
        let (_folder, path, text) = written();
        let (mut table, rows) = Table::open(&path, none).unwrap();
        assert_eq!(rows, [row("x", 1.0), row("y, \"z\"\nw", -2.5e-3)]);
        assert!(Table::open(&path, none).is_err(), "it is open");
        table.add([row("z", 4.0)]).unwrap();
        drop(table);
        let longer = std::fs::read_to_string(&path).unwrap();
        assert!(longer.starts_with(&text));
        std::fs::write(&path, &longer[..longer.len() - 1]).unwrap();
        let (mut table, rows) = Table::open(&path, none).unwrap();
        assert_eq!(rows.len(), 2, "the last row has lost its end");
        table.add([row("z", 4.0)]).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), longer);
        table.replace(&[row("w", 5.0), row("z", 4.0)]).unwrap();
        table.add([row("v", 6.0)]).unwrap();
        drop(table);
        let rows = read(&path, none).unwrap();
        assert_eq!(rows, [row("w", 5.0), row("z", 4.0), row("v", 6.0)]);
        let beside = path.with_file_name("other.csv");
        Table::create(&beside).unwrap().add([row("x", 1.0)]).unwrap();
        assert_eq!(std::fs::read_to_string(&beside).unwrap(), "name,value,note\nx,1.0,\n");
    }

    #[test]
    fn whatever_byte_of_a_row_changes_it_is_refused_with_its_line() {
        let (_folder, path, text) = written();
        let start = text.find('\n').unwrap() + 1;
        let end = start + text[start..].find('\n').unwrap();
        for at in start..end {
            for other in [b'7', b'n', b'.', b',', b'-', 0xff] {
                let mut bytes = text.clone().into_bytes();
                if bytes[at] == other {
                    continue;
                }
                bytes[at] = other;
                std::fs::write(&path, &bytes).unwrap();
                let error = read(&path, none).expect_err("a row that was changed is read").to_string();
                assert!(error.contains("table.csv:2: "), "byte {at} as {other}: {error}");
            }
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_file_line_and_value() {
        let (_folder, path, text) = written();
        let negative = |row: &Row| (row.value < 0.0).then(|| format!("`value` is {}", row.value));
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            let error = Table::open(&path, negative).err().expect("a damaged table is opened");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text, "what is refused is left alone");
            error.to_string()
        };
        let check = |text: &str, parts: &[&str]| {
            let said = said(text);
            for part in parts {
                assert!(said.contains(part), "`{part}` is not in {said}");
            }
        };
        check(&text, &["table.csv:3: ", "`value` is -0.0025"]);
        check(&text.replacen("x,1.0,", "x,one,", 1), &["table.csv:2: ", "`value` is `one`"]);
        check(&text.replacen("x,1.0,", "x,NaN,", 1), &["table.csv:2: ", "checksum", "x,NaN,"]);
        check(&text.replacen("x,1.0,", "x\nx,1.0,", 1), &["table.csv:2: ", "1 values for 4 columns: `x`"]);
        check(&text.replacen("value", "values", 1), &["table.csv:2: missing field `value`"]);
        check(&text.replacen(",check", "", 1), &["table.csv:1: ", "its last column is `note`"]);
        // A table of other columns that has no rows yet.
        std::fs::write(&path, "name,check\n").unwrap();
        let (mut table, rows) = Table::open(&path, none).unwrap();
        assert!(rows.is_empty());
        let error = table.add([row("x", 1.0)]).unwrap_err().to_string();
        assert!(error.contains("table.csv:1: has the columns `name`"), "{error}");
    }
}
