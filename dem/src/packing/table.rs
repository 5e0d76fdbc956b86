//! Grains from and to CSV: a header, then one line per grain.

use crate::error::{Error, Result};
use crate::{Material, Particles, Vector};
use std::path::Path;

const AXES: [&str; 3] = ["x", "y", "z"];
const SPEEDS: [&str; 3] = ["vx", "vy", "vz"];

fn fail(path: &Path, line: u64, message: String) -> Error {
    Error::Table { file: path.display().to_string(), line, message }
}

/// Which column of the file holds what.
struct Columns {
    position: Vec<usize>,
    radius: usize,
    velocity: Option<Vec<usize>>,
    temperature: Option<usize>,
}

impl Columns {
    fn new<const D: usize>(header: &csv::StringRecord, path: &Path) -> Result<Self> {
        let allowed = [&AXES[..D], &["r"], &SPEEDS[..D], &["T"]].concat();
        let names: Vec<&str> = header.iter().map(str::trim).collect();
        for (k, name) in names.iter().enumerate() {
            if !allowed.contains(name) || names[..k].contains(name) {
                let list = allowed.join(", ");
                return Err(fail(
                    path,
                    1,
                    format!("column {name:?} is unknown or twice there; allowed: {list}"),
                ));
            }
        }
        let find = |name: &str| names.iter().position(|n| *n == name);
        let need = |name: &str| {
            find(name)
                .ok_or_else(|| fail(path, 1, format!("there is no column {name:?}: x, y and r are needed")))
        };
        let position = AXES[..D].iter().map(|a| need(a)).collect::<Result<_>>()?;
        let moving = SPEEDS[..D].iter().any(|a| find(a).is_some());
        let velocity =
            moving.then(|| SPEEDS[..D].iter().map(|a| need(a)).collect::<Result<Vec<_>>>()).transpose()?;
        Ok(Self { position, radius: need("r")?, velocity, temperature: find("T") })
    }
}

/// Reads columns x, y[, z], r and, if there, vx, vy[, vz] and T; SI units. All grains are of one material.
pub fn read_table<const D: usize>(path: &Path, material: u8, materials: &[Material]) -> Result<Particles<D>> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|e| fail(path, 1, e.to_string()))?;
    let header = reader.headers().map_err(|e| fail(path, 1, e.to_string()))?.clone();
    let columns = Columns::new::<D>(&header, path)?;
    let (mut position, mut velocity, mut radius, mut temperature) = (vec![], vec![], vec![], vec![]);
    for record in reader.records() {
        let record = record.map_err(|e| fail(path, e.position().map_or(0, |p| p.line()), e.to_string()))?;
        let line = record.position().map_or(0, |p| p.line());
        let number = |k: usize| -> Result<f64> {
            let text = record.get(k).unwrap_or("");
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(fail(path, line, format!("{} is {text:?}, not a finite number", &header[k]))),
            }
        };
        let vector = |axes: &[usize]| -> Result<Vector<D>> {
            let mut v = Vector::zeros();
            for (a, &k) in axes.iter().enumerate() {
                v[a] = number(k)?;
            }
            Ok(v)
        };
        position.push(vector(&columns.position)?);
        let r = number(columns.radius)?;
        if r <= 0.0 {
            return Err(fail(path, line, format!("r is {r}: a radius must be positive")));
        }
        radius.push(r);
        if let Some(axes) = &columns.velocity {
            velocity.push(vector(axes)?);
        }
        if let Some(k) = columns.temperature {
            let kelvin = number(k)?;
            if kelvin < 0.0 {
                return Err(fail(path, line, format!("T is {kelvin}: a temperature must be 0 K or more")));
            }
            temperature.push(kelvin);
        }
    }
    if position.is_empty() {
        return Err(fail(path, 1, "there are no grains after the header".into()));
    }
    let count = position.len();
    let mut grains = Particles::new(position, radius, vec![material; count], materials)?;
    if columns.velocity.is_some() {
        grains.velocity = velocity;
    }
    if columns.temperature.is_some() {
        grains = grains.heated(0.0, materials)?;
        if let Some(heat) = &mut grains.heat {
            heat.temperature = temperature;
        }
    }
    Ok(grains)
}

/// Writes what [`read_table`] reads; the numbers come back bit for bit.
pub fn write_table<const D: usize>(path: &Path, grains: &Particles<D>) -> Result<()> {
    let fail = |e: csv::Error| fail(path, 0, e.to_string());
    let mut writer = csv::Writer::from_path(path).map_err(fail)?;
    let mut header = [&AXES[..D], &["r"], &SPEEDS[..D]].concat();
    if grains.heat.is_some() {
        header.push("T");
    }
    writer.write_record(&header).map_err(fail)?;
    for i in 0..grains.len() {
        let row = grains.position[i].iter().chain([&grains.radius[i]]).chain(grains.velocity[i].iter());
        let row = row.chain(grains.heat.as_ref().map(|h| &h.temperature[i]));
        writer.write_record(row.map(f64::to_string)).map_err(fail)?;
    }
    writer.flush().map_err(|e| fail(e.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<Particles<2>> {
        let path = std::env::temp_dir().join(format!("voidage-dem-{}-{name}.csv", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let grains = read_table(&path, 0, &[Material { heat_capacity: 1.0, ..Material::default() }]);
        std::fs::remove_file(&path).unwrap();
        grains
    }

    #[test]
    fn tables_are_read_with_their_optional_columns() {
        let grains = read("good", "x,y,r,vx,vy,T\n0,1,0.5,2,3,300\n1, 1 ,0.25,0,0,301\n").unwrap();
        assert_eq!(grains.len(), 2);
        assert_eq!(grains.velocity[0], Vector::<2>::new(2.0, 3.0));
        assert_eq!(grains.heat.unwrap().temperature, [300.0, 301.0]);
        assert!(read("plain", "r,x,y\n0.5,0,0\n").unwrap().heat.is_none());
    }

    #[test]
    fn numbers_come_back_bit_for_bit() {
        let numbers = [1.0 / 3.0, -0.1 - 0.2, 1e-300, 5e-324, 1e9 / 7.0, 2.5e-5 + f64::EPSILON * 1e-5];
        let position = numbers.iter().map(|&x| Vector::<2>::new(x, x * 0.7)).collect();
        let radius = numbers.map(|x| x.abs().max(1e-9) / 3.0).to_vec();
        let glass = [Material::default()];
        let grains = Particles::new(position, radius, vec![0; 6], &glass).unwrap();
        let path = std::env::temp_dir().join(format!("voidage-dem-{}-bits.csv", std::process::id()));
        write_table(&path, &grains).unwrap();
        let again = read_table(&path, 0, &glass);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(again.unwrap(), grains);
    }

    #[test]
    fn errors_name_line_value_and_what_is_allowed() {
        let message = |name: &str, text: &str| read(name, text).unwrap_err().to_string();
        assert!(
            message("cold", "x,y,r,T\n0,0,1,300\n3,0,1,-5\n")
                .ends_with("line 3: T is -5: a temperature must be 0 K or more")
        );
        assert!(
            message("word", "x,y,r\n0,0,1\n0,abc,1\n").ends_with("line 3: y is \"abc\", not a finite number")
        );
        assert!(message("minus", "x,y,r\n0,0,-1\n").ends_with("line 2: r is -1: a radius must be positive"));
        assert!(message("column", "x,y,raduis\n").contains("\"raduis\" is unknown"));
        assert!(message("none", "x,y,r\n").contains("no grains"));
        assert!(message("short", "x,y,r\n0,0\n").contains("line 2"));
        assert!(message("missing", "x,r\n0,0\n").contains("no column \"y\""));
    }
}
