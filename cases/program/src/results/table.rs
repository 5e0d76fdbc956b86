//! Tables of numbers read from CSV.

use std::path::{Path, PathBuf};
use tracing::warn;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;

/// Columns of the series that describe a droplet in pictures.
const OF_A_DROPLET: [&str; 13] = [
    "droplet_x_m",
    "droplet_y_m",
    "droplet_radius_m",
    "droplet_depth_m",
    "droplet_velocity_y_m_per_s",
    "droplet_lifetime_s",
    "droplet_liquid_kg_per_m",
    "droplet_gas_force_x_N_per_m",
    "droplet_gas_force_y_N_per_m",
    "droplet_grain_force_y_N_per_m",
    "droplet_grain_pressure_force_y_N_per_m",
    "droplet_gas_heat_W_per_m",
    "droplet_grain_heat_W_per_m",
];
/// The column of the times.
pub const TIME: &str = "time_s";
const TEMPERATURE: &str = "mean_grain_temperature_K";
/// A mean over no grains is no number, and neither is this.
const COLDEST: &str = "min_grain_temperature_K";
/// The column of the pressure drop.
pub const DROP: &str = "pressure_drop_Pa";

/// What a reader can do about a damaged table.
const HELP: &str = "it was damaged or changed: restart the run from its checkpoint, or run it again";

/// Columns of numbers by name.
pub struct Table {
    path: PathBuf,
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    /// The line of each row in the file.
    lines: Vec<u64>,
}

impl Table {
    /// The series of a run, which has what its scene records. Half a row at the end, which a run leaves that was killed
    /// or is still at work, is left out with a warning.
    ///
    /// # Errors
    /// The file cannot be read, or a row or a column is not as a run writes it.
    pub fn series(path: &Path, scene: &Scene) -> Result<Table> {
        let table = Self::read(path)?;
        let mut needed = vec![TIME];
        needed.extend(scene.grains.iter().any(|group| group.temperature.is_some()).then_some(TEMPERATURE));
        needed.extend(scene.output.pressure_drop.is_some().then_some(DROP));
        needed.extend(scene.droplet.iter().flat_map(|_| OF_A_DROPLET));
        table.check_finite(&needed)?;
        let time = table.column(TIME).unwrap_or_default();
        if let Some(row) = (1..time.len()).find(|row| time[*row] <= time[row - 1]) {
            let (now, before) = (time[row], time[row - 1]);
            return Err(table.wrong(row, format!("`{TIME}` is {now} after {before} in the row before")));
        }
        Ok(table)
    }

    /// The averages of a run over the squares of a grid.
    ///
    /// # Errors
    /// The file cannot be read, or is not as a run writes it.
    pub fn averages(path: &Path) -> Result<Table> {
        let table = Self::read(path)?;
        table.check_finite(&[
            "x_m",
            "y_m",
            "packing_fraction",
            "grain_velocity_x_m_per_s",
            "grain_velocity_y_m_per_s",
        ])?;
        let [x, y] = ["x_m", "y_m"].map(|name| table.column(name).unwrap_or_default());
        let wide = y.iter().take_while(|other| **other == y[0]).count().max(1);
        // Row by row from the bottom, each from left to right, at the same places.
        let placed = |square: &usize| {
            let (column, row) = (square % wide, square / wide * wide);
            x[*square] == x[column] && y[*square] == y[row] && (*square < wide || y[*square] > y[row - 1])
        };
        if let Some(square) = (0..x.len()).find(|square| !placed(square)) {
            let what = format!(
                "`x_m` and `y_m` are {} and {}, off the grid of the rows before",
                x[square], y[square]
            );
            return Err(table.wrong(square, what));
        }
        if x.is_empty() || !x.len().is_multiple_of(wide) {
            let what = format!("{}: ends within a row of the grid of {wide} squares", path.display());
            return Err(Error::input(Notice::new(what, HELP)));
        }
        Ok(table)
    }

    fn read(path: &Path) -> Result<Table> {
        let at = |line: u64, what: String| {
            Error::input(Notice::new(format!("{}:{line}: {what}", path.display()), HELP))
        };
        let bytes = std::fs::read(path).map_err(|error| Error::file(path, "read", error))?;
        let end = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let (whole, rest) = bytes.split_at(end);
        let mut rows = whole.split_inclusive(|byte| *byte == b'\n').zip(1..);
        let text = |(row, line): (&[u8], u64)| match std::str::from_utf8(row) {
            Ok(text) => Ok((text.trim_end().to_owned(), line)),
            Err(_) => Err(at(line, format!("`{}` is no text", String::from_utf8_lossy(row).trim_end()))),
        };
        let header = rows.next().ok_or_else(|| at(1, "has no whole line".into()))?;
        let names: Vec<String> = text(header)?.0.split(',').map(str::to_owned).collect();
        let mut table = Table { path: path.into(), columns: vec![vec![]; names.len()], names, lines: vec![] };
        for row in rows {
            let (row, line) = text(row)?;
            let values: Vec<&str> = row.split(',').collect();
            if values.len() != table.names.len() {
                let (have, want) = (values.len(), table.names.len());
                return Err(at(line, format!("{have} values for {want} columns: `{row}`")));
            }
            for ((name, value), column) in table.names.iter().zip(values).zip(&mut table.columns) {
                let number = value.parse();
                column.push(
                    number.map_err(|_| at(line, format!("`{name}` is `{value}`, which is no number")))?,
                );
            }
            table.lines.push(line);
        }
        if !rest.is_empty() {
            let (line, rest) =
                (whole.iter().filter(|byte| **byte == b'\n').count() + 1, String::from_utf8_lossy(rest));
            warn!("{}:{line}: half a row, which is left out: `{rest}`", path.display());
        }
        Ok(table)
    }

    /// Checks that the table has these columns, and that their values are finite; the mean temperature of the grains
    /// where there are any.
    fn check_finite(&self, names: &[&str]) -> Result<()> {
        for name in names {
            let Some(values) = self.find(name) else {
                let what = format!("{}:1: has no column `{name}`", self.path.display());
                return Err(Error::input(Notice::new(what, HELP)));
            };
            let nobody = |row: usize| {
                *name == TEMPERATURE && self.find(COLDEST).is_some_and(|coldest| coldest[row].is_nan())
            };
            if let Some(row) = (0..values.len()).find(|row| !values[*row].is_finite() && !nobody(*row)) {
                return Err(self.wrong(row, format!("`{name}` is {}", values[row])));
            }
        }
        Ok(())
    }

    /// The names of the columns, in the order of the file.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// An error that names a row of the file.
    fn wrong(&self, row: usize, what: String) -> Error {
        Error::input(Notice::new(format!("{}:{}: {what}", self.path.display(), self.lines[row]), HELP))
    }

    fn find(&self, name: &str) -> Option<&[f64]> {
        let index = self.names.iter().position(|column| column == name)?;
        Some(self.columns[index].as_slice())
    }

    /// A column, if the table has it and it is not empty.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.find(name).filter(|column| !column.is_empty())
    }
}
