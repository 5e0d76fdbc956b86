//! A table of what benchmarks measured, with the machine and the version; what it has is not run again.

use std::path::PathBuf;

/// Entry of a file of /proc by its name.
pub fn entry(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find(|line| line.starts_with(name))?;
    Some(line.split_once(':')?.1.trim().into())
}

/// What follows an option of the command line, in parts between commas.
pub fn option(name: &str, default: &str) -> Vec<String> {
    let all: Vec<String> = std::env::args().collect();
    let given = all.iter().position(|a| a == name).and_then(|k| all.get(k + 1));
    given.map_or(default, |text| text).split(',').filter(|part| !part.is_empty()).map(String::from).collect()
}

/// The same as whole numbers.
pub fn numbers(name: &str, default: &str) -> Vec<usize> {
    let parse = |text: String| text.parse().unwrap_or_else(|_| panic!("{name}: {text} is no whole number"));
    option(name, default).into_iter().map(parse).collect()
}

/// The table and its file.
pub struct Table {
    file: PathBuf,
    header: &'static [&'static str],
    /// Rows without the header: machine, version, and what the header names.
    pub rows: Vec<Vec<String>>,
    own: [String; 2],
}

impl Table {
    /// The table in `file`, with the columns `header` after machine and version; empty where there is no file.
    pub fn open(file: PathBuf, header: &'static [&'static str]) -> csv::Result<Self> {
        let machine = entry("/proc/cpuinfo", "model name").unwrap_or_else(|| "unknown".into());
        let rows = match file.exists() {
            true => {
                let records = csv::Reader::from_path(&file)?.into_records();
                let row = |record: csv::Result<csv::StringRecord>| {
                    record.map(|record| record.iter().map(String::from).collect())
                };
                records.map(row).collect::<csv::Result<_>>()?
            }
            false => vec![],
        };
        println!("{}", header.join(","));
        Ok(Self { file, header, rows, own: [machine, env!("CARGO_PKG_VERSION").into()] })
    }

    /// Whether there is a row of this machine and version that begins with `key`.
    pub fn has(&self, key: &[&str]) -> bool {
        let wanted = self.own.iter().map(String::as_str).chain(key.iter().copied());
        let wanted: Vec<&str> = wanted.collect();
        self.rows
            .iter()
            .any(|row| row.iter().map(String::as_str).take(wanted.len()).eq(wanted.iter().copied()))
    }

    /// Prints a row of this machine and version, and writes the table with it.
    pub fn add(&mut self, row: &[String], order: impl Fn(&[String]) -> Vec<usize>) -> csv::Result<()> {
        println!("{}", row.join(","));
        self.rows.push(self.own.iter().chain(row).cloned().collect());
        self.rows.sort_by_key(|row| order(&row[self.own.len()..]));
        let mut table = csv::Writer::from_path(&self.file)?;
        table.write_record(["machine", "version"].iter().chain(self.header))?;
        self.rows.iter().try_for_each(|row| table.write_record(row))?;
        Ok(table.flush()?)
    }
}
