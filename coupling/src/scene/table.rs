//! Grains read from a CSV file.

use std::path::Path;

/// A grain of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GrainRow {
    /// Line of the file, from 1.
    pub line: u64,
    /// Centre, m.
    pub position: Vec<f64>,
    /// Radius, m, if the file has one.
    pub radius: Option<f64>,
    /// Velocity, m/s, if the file has one.
    pub velocity: Option<Vec<f64>>,
    /// Temperature, K, if the file has one.
    pub temperature: Option<f64>,
}

const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];
const VELOCITY: [&str; 3] = ["vx_m_per_s", "vy_m_per_s", "vz_m_per_s"];

/// Reads grains in `dimension` dimensions. The error names the file, the line, the value and what is allowed.
pub fn read_grains(file: &Path, dimension: usize) -> Result<Vec<GrainRow>, String> {
    let name = file.display();
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(file).map_err(|e| format!("{name}: {e}"))?;
    let header = reader.headers().map_err(|error| format!("{name}: {error}"))?.clone();
    let column = |wanted: &str| header.iter().position(|column| column == wanted);
    let known = [&POSITION[..dimension], &VELOCITY[..dimension], &["radius_m", "temperature_K"]].concat();
    if let Some(other) = header.iter().find(|column| !known.contains(column)) {
        return Err(format!("{name}:1: unknown column `{other}`; allowed: {}", known.join(", ")));
    }
    let position: Option<Vec<usize>> = POSITION[..dimension].iter().map(|name| column(name)).collect();
    let Some(position) = position else {
        return Err(format!("{name}:1: the header needs the columns {}", POSITION[..dimension].join(", ")));
    };
    let velocity: Option<Vec<usize>> = VELOCITY[..dimension].iter().map(|name| column(name)).collect();
    let (radius, temperature) = (column("radius_m"), column("temperature_K"));
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| format!("{name}: {error}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| {
            let text = record.get(column).unwrap_or("");
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| {
                format!("{name}:{line}: `{text}` in column {} is not a finite number", &header[column])
            })
        };
        let numbers = |columns: &[usize]| columns.iter().map(|column| number(*column)).collect();
        rows.push(GrainRow {
            line,
            position: numbers(&position)?,
            radius: radius.map(number).transpose()?,
            velocity: velocity.as_deref().map(numbers).transpose()?,
            temperature: temperature.map(number).transpose()?,
        });
    }
    if rows.is_empty() {
        return Err(format!("{name}: holds no grains"));
    }
    Ok(rows)
}
