//! Grains from and to CSV: a header, then one line per grain.

use crate::error::{Error, Result};
use crate::{Material, Particles, Vector};
use std::path::Path;

const AXES: [&str; 3] = ["x", "y", "z"];
const SPEEDS: [&str; 3] = ["vx", "vy", "vz"];
/// Columns that may be there beside places, radii and velocities.
const MORE: [&str; 4] = ["T", "spin", "density", "material"];
/// How others call these columns: a table that has them would be read without them.
const SYNONYMS: [(&str, &str); 14] = [
    ("radius", "r"),
    ("rad", "r"),
    ("u", "vx"),
    ("v", "vy"),
    ("w", "vz"),
    ("temp", "T"),
    ("temperature", "T"),
    ("omega", "spin"),
    ("omegaz", "spin"),
    ("omega_z", "spin"),
    ("wz", "spin"),
    ("angular_velocity", "spin"),
    ("rho", "density"),
    ("mat", "material"),
];

fn fail(path: &Path, line: u64, message: String) -> Error {
    Error::Table { file: path.display().to_string(), line, message }
}

/// What grains of a table may be made of.
#[derive(Clone, Copy, Debug)]
pub struct Kinds<'a> {
    /// Number of the material of rows that name none.
    pub own: u8,
    /// All materials.
    pub materials: &'a [Material],
    /// Their names, which a column `material` has; of several with one name it means the first.
    pub names: &'a [&'a str],
}

/// A table that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Table<const D: usize> {
    /// The grains.
    pub grains: Particles<D>,
    /// The line of each in the file.
    pub lines: Vec<u64>,
    /// Columns that say nothing of grains here, and were not used.
    pub unused: Vec<String>,
}

/// Which column of the file holds what.
struct Columns {
    position: Vec<usize>,
    radius: usize,
    velocity: Option<Vec<usize>>,
    temperature: Option<usize>,
    spin: Option<usize>,
    density: Option<usize>,
    material: Option<usize>,
    unused: Vec<String>,
}

impl Columns {
    fn new<const D: usize>(header: &csv::StringRecord, path: &Path, line: u64) -> Result<Self> {
        let allowed = [&AXES[..D], &["r"], &SPEEDS[..D], &MORE[..]].concat();
        let list = allowed.join(", ");
        let names: Vec<&str> = header.iter().map(str::trim).collect();
        if names.iter().all(|name| name.is_empty() || name.parse::<f64>().is_ok()) {
            let what = format!(
                "the first line must name the columns; allowed: {list} (a line that begins with # is skipped)"
            );
            return Err(fail(path, line, what));
        }
        if let ([whole], Some(separator)) = (names.as_slice(), separator(&names)) {
            let what = format!("{whole:?} has {separator} between its columns, and commas are needed");
            return Err(fail(path, line, what));
        }
        let mut unused = vec![];
        for (k, name) in names.iter().enumerate() {
            let alike = |known: &&str| known.eq_ignore_ascii_case(name);
            let synonym = SYNONYMS.iter().find(|(other, _)| alike(other)).map(|(_, known)| known);
            let meant = allowed.iter().find(|known| alike(known)).or(synonym);
            match meant.filter(|known| allowed.contains(known)) {
                Some(_) if names[..k].contains(name) => {
                    return Err(fail(path, line, format!("column {name:?} is twice there")));
                }
                Some(known) if known == name => {}
                Some(known) => {
                    let what =
                        format!("column {name:?}: call it {known:?}, or take it away; allowed: {list}");
                    return Err(fail(path, line, what));
                }
                None if name.is_empty() => unused.push(format!("{} (without a name)", k + 1)),
                None => unused.push((*name).to_owned()),
            }
        }
        let find = |name: &str| names.iter().position(|n| *n == name);
        let need = |name: &str, all: &[&str]| {
            find(name).ok_or_else(|| {
                let (last, first) = all.split_last().unwrap_or((&"", &[]));
                let there = names.join(", ");
                let all = format!("{} and {last}", first.join(", "));
                fail(
                    path,
                    line,
                    format!("there is no column {name:?} in {there}: {all} are needed; allowed: {list}"),
                )
            })
        };
        let places = [&AXES[..D], &["r"]].concat();
        let position = AXES[..D].iter().map(|axis| need(axis, &places)).collect::<Result<_>>()?;
        let moving = SPEEDS[..D].iter().any(|axis| find(axis).is_some());
        let speeds = || SPEEDS[..D].iter().map(|axis| need(axis, &SPEEDS[..D])).collect::<Result<Vec<_>>>();
        let velocity = moving.then(speeds).transpose()?;
        let [temperature, spin, density, material] = MORE.map(find);
        let radius = need("r", &places)?;
        Ok(Self { position, radius, velocity, temperature, spin, density, material, unused })
    }
}

/// What lies between the columns of a header that is taken for one name, in words.
fn separator(names: &[&str]) -> Option<&'static str> {
    let all = [(';', "semicolons"), ('\t', "tabs"), ('|', "bars"), (' ', "blanks")];
    all.iter().find(|(c, _)| names.iter().any(|name| name.contains(*c))).map(|(_, name)| *name)
}

/// Reads columns x, y[, z], r and, if there, vx, vy[, vz], T, spin (rad/s), density (kg/m3) and material (a name); SI
/// units. Other columns are not used. Lines that begin with # are skipped.
///
/// # Errors
/// With file and line: columns that are missing, or that others call otherwise; values that are none.
pub fn read_table<const D: usize>(path: &Path, kinds: &Kinds<'_>) -> Result<Table<D>> {
    let text = std::fs::read(path).map_err(|e| fail(path, 1, e.to_string()))?;
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_slice());
    let header = reader.headers().map_err(|e| fail(path, 1, e.to_string()))?.clone();
    // The reader takes a row to begin with the comments before it; so lines are counted up to where it ends.
    let (mut counted, mut line) = (0, 1);
    let mut line_that_ends_at = |end: u64| {
        let end = end as usize;
        let end = if text[..end].ends_with(b"\n") { end - 1 } else { end };
        line += text[counted..end].iter().filter(|byte| **byte == b'\n').count() as u64;
        counted = end;
        line
    };
    let line = line_that_ends_at(reader.position().byte());
    let columns = Columns::new::<D>(&header, path, line)?;
    let (mut position, mut velocity, mut radius, mut temperature) = (vec![], vec![], vec![], vec![]);
    let (mut spin, mut density, mut material, mut lines) = (vec![], vec![], vec![], vec![]);
    let mut record = csv::StringRecord::new();
    while reader
        .read_record(&mut record)
        .map_err(|e| fail(path, e.position().map_or(0, |p| p.line()), e.to_string()))?
    {
        let line = line_that_ends_at(reader.position().byte());
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
        lines.push(line);
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
        if let Some(k) = columns.spin {
            spin.push(number(k)?);
        }
        if let Some(k) = columns.density {
            let rho = number(k)?;
            if rho <= 0.0 {
                return Err(fail(path, line, format!("density is {rho}: it must be positive")));
            }
            density.push(rho);
        }
        material.push(match columns.material.and_then(|k| record.get(k)) {
            None => kinds.own,
            Some(name) => match kinds.names.iter().position(|known| *known == name) {
                Some(k) => k as u8,
                None => {
                    let list = kinds.names.join(", ");
                    return Err(fail(
                        path,
                        line,
                        format!("no grains are of material {name:?}; there are: {list}"),
                    ));
                }
            },
        });
    }
    if position.is_empty() {
        return Err(fail(path, line, "there are no grains after the header".into()));
    }
    let mut grains = Particles::new(position, radius, material, kinds.materials)?;
    for (i, rho) in density.into_iter().enumerate() {
        grains.mass[i] *= rho / kinds.materials[grains.material[i] as usize].density;
    }
    if columns.velocity.is_some() {
        grains.velocity = velocity;
    }
    if columns.temperature.is_some() {
        grains = grains.heated(0.0, kinds.materials)?;
        if let Some(heat) = &mut grains.heat {
            heat.temperature = temperature;
        }
    }
    if columns.spin.is_some() {
        grains = grains.rotating();
        if let Some(rotation) = &mut grains.rotation {
            rotation.spin = spin;
        }
    }
    Ok(Table { grains, lines, unused: columns.unused })
}

/// Writes what [`read_table`] reads; the numbers come back bit for bit.
pub fn write_table<const D: usize>(path: &Path, grains: &Particles<D>) -> Result<()> {
    let fail = |e: csv::Error| fail(path, 0, e.to_string());
    let mut writer = csv::Writer::from_path(path).map_err(fail)?;
    let mut header = [&AXES[..D], &["r"], &SPEEDS[..D]].concat();
    if grains.heat.is_some() {
        header.push("T");
    }
    if grains.rotation.is_some() {
        header.push("spin");
    }
    writer.write_record(&header).map_err(fail)?;
    for i in 0..grains.len() {
        let row = grains.position[i].iter().chain([&grains.radius[i]]).chain(grains.velocity[i].iter());
        let row = row.chain(grains.heat.as_ref().map(|h| &h.temperature[i]));
        let row = row.chain(grains.rotation.as_ref().map(|rotation| &rotation.spin[i]));
        writer.write_record(row.map(f64::to_string)).map_err(fail)?;
    }
    writer.flush().map_err(|e| fail(e.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<Table<2>> {
        let path = std::env::temp_dir().join(format!("voidage-dem-{}-{name}.csv", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let light = Material { density: 1000.0, ..Material::default() };
        let materials = [Material { heat_capacity: 1.0, ..Material::default() }, light];
        let kinds = Kinds { own: 0, materials: &materials, names: &["glass", "wax"] };
        let table = read_table(&path, &kinds);
        std::fs::remove_file(&path).unwrap();
        table
    }

    #[test]
    fn tables_are_read_with_their_optional_columns() {
        let grains = read("good", "x,y,r,vx,vy,T\n0,1,0.5,2,3,300\n1, 1 ,0.25,0,0,301\n").unwrap().grains;
        assert_eq!(grains.len(), 2);
        assert_eq!(grains.velocity[0], Vector::<2>::new(2.0, 3.0));
        assert_eq!(grains.heat.unwrap().temperature, [300.0, 301.0]);
        assert!(read("plain", "r,x,y\n0.5,0,0\n").unwrap().grains.heat.is_none());
    }

    #[test]
    fn numbers_come_back_bit_for_bit() {
        let numbers = [1.0 / 3.0, -0.1 - 0.2, 1e-300, 5e-324, 1e9 / 7.0, 2.5e-5 + f64::EPSILON * 1e-5];
        let position = numbers.iter().map(|&x| Vector::<2>::new(x, x * 0.7)).collect();
        let radius = numbers.map(|x| x.abs().max(1e-9) / 3.0).to_vec();
        let glass = [Material::default()];
        let mut grains = Particles::new(position, radius, vec![0; 6], &glass).unwrap().rotating();
        grains.rotation.as_mut().unwrap().spin = numbers.to_vec();
        let path = std::env::temp_dir().join(format!("voidage-dem-{}-bits.csv", std::process::id()));
        write_table(&path, &grains).unwrap();
        let again = read_table(&path, &Kinds { own: 0, materials: &glass, names: &["glass"] });
        std::fs::remove_file(&path).unwrap();
        assert_eq!(again.unwrap().grains, grains);
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
        assert!(message("column", "x,y,raduis\n").contains("no column \"r\" in x, y, raduis"));
        assert!(message("none", "x,y,r\n").contains("no grains"));
        assert!(message("short", "x,y,r\n0,0\n").contains("line 2"));
        assert!(message("missing", "x,r\n0,0\n").contains("no column \"y\""));
    }

    /// Tables of spreadsheets and of other programs were refused without a word of what to do.
    #[test]
    fn tables_of_other_programs_are_read_or_say_what_to_do() {
        let text = "# made by a script\n,id,x,y,z,r,spin,density,material\n# more\n0,7,1,2,0,0.5,3,2600,glass\n\
                    1,8,3,2,0,0.5,-4,900,wax\n";
        let table = read("others", text).unwrap();
        assert_eq!(table.unused, ["1 (without a name)", "id", "z"]);
        assert_eq!(table.lines, [4, 5]);
        let Particles { position, material, mass, rotation, volume, .. } = table.grains;
        assert_eq!((position[1], material), (Vector::<2>::new(3.0, 2.0), vec![0, 1]));
        approx::assert_relative_eq!(mass[0], 2600.0 * volume[0], max_relative = 1e-15);
        approx::assert_relative_eq!(mass[1], 900.0 * volume[1], max_relative = 1e-15);
        let rotation = rotation.unwrap();
        assert_eq!(rotation.spin, [3.0, -4.0]);
        approx::assert_relative_eq!(rotation.inertia[1], 0.5 * mass[1] * 0.25, max_relative = 1e-15);
        for (name, text, said) in [
            ("semicolon", "x;y;r\n0;0;1\n", "semicolons between its columns, and commas are needed"),
            ("tab", "x\ty\tr\n0\t0\t1\n", "tabs between its columns"),
            ("blank", "x y r\n0 0 1\n", "blanks between its columns"),
            ("vx", "x,y,r,vx\n0,0,1,1\n", "no column \"vy\" in x, y, r, vx: vx and vy are needed"),
            ("names", "# x,y,r\n0,0,1\n", "line 2: the first line must name the columns"),
            ("radius", "x,y,radius\n0,0,1\n", "column \"radius\": call it \"r\""),
            ("upper", "X,y,r\n0,0,1\n", "column \"X\": call it \"x\""),
            ("omega", "x,y,r,omega\n0,0,1,1\n", "column \"omega\": call it \"spin\""),
            ("twice", "x,y,r,r\n0,0,1,1\n", "\"r\" is twice there"),
            (
                "sand",
                "x,y,r,material\n0,0,1,sand\n",
                "no grains are of material \"sand\"; there are: glass, wax",
            ),
            ("light", "x,y,r,density\n0,0,1,0\n", "density is 0"),
        ] {
            let message = read(name, text).unwrap_err().to_string();
            assert!(message.contains(said), "{message}");
        }
        // In the plane a column of the third axis is of no use, and no error.
        assert_eq!(read("vz", "x,y,r,vz\n0,0,1,1\n").unwrap().unused, ["vz"]);
    }
}
