//! Tables of numbers read from CSV.

use std::path::Path;
use voidage_coupling::{Error, Result};

/// Columns of numbers by name.
pub struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a CSV file with a header. An unfinished last row is left out.
    pub fn read(path: &Path) -> Result<Table> {
        let wrong = |what: String| Error::input(format!("{}: {what}", path.display()));
        let reader = csv::ReaderBuilder::new().flexible(true).from_path(path);
        let mut reader = reader.map_err(|error| wrong(error.to_string()))?;
        let names: Vec<String> =
            reader.headers().map_err(|error| wrong(error.to_string()))?.iter().map(str::to_owned).collect();
        let mut columns = vec![Vec::new(); names.len()];
        for record in reader.records() {
            let record = record.map_err(|error| wrong(error.to_string()))?;
            let row: Vec<f64> = record.iter().filter_map(|number| number.parse().ok()).collect();
            if row.len() == names.len() {
                columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
            }
        }
        Ok(Table { names, columns })
    }

    /// A column, if the table has it and it is not empty.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.names.iter().position(|column| column == name)?;
        Some(self.columns[index].as_slice()).filter(|column| !column.is_empty())
    }
}
