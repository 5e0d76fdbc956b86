//! ParaView files: VTU (fluid mesh) and VTP (grains) with the numbers appended raw, little-endian.
//!
//! Layout: an XML head that gives each array its offset, then `_`, then for each array its size in bytes (u64) and
//! its numbers. Vectors of the plane get a third component, which ParaView expects.

use super::files::write_whole;
use nalgebra::SVector;
use std::io::{self, Write};
use std::path::Path;
use voidage_coupling::error::Result;

/// A named column of values, one per node or grain.
#[derive(Clone, Copy, Debug)]
pub struct Column<'a, const D: usize> {
    /// Name, with the unit: `pressure_Pa`.
    pub name: &'a str,
    /// The values.
    pub values: Values<'a, D>,
}

/// Values of a column.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a, const D: usize> {
    /// One number each.
    Scalars(&'a [f64]),
    /// One vector each.
    Vectors(&'a [SVector<f64, D>]),
    /// One whole number each.
    Integers(&'a [u32]),
}

impl<'a, const D: usize> Column<'a, D> {
    /// A column of numbers.
    pub fn scalars(name: &'a str, values: &'a [f64]) -> Self {
        Column { name, values: Values::Scalars(values) }
    }

    /// A column of vectors.
    pub fn vectors(name: &'a str, values: &'a [SVector<f64, D>]) -> Self {
        Column { name, values: Values::Vectors(values) }
    }

    /// A column of whole numbers.
    pub fn integers(name: &'a str, values: &'a [u32]) -> Self {
        Column { name, values: Values::Integers(values) }
    }
}

/// Writes nodal fields on a mesh of simplices (`cells`: D + 1 node numbers each).
pub fn write_mesh<const D: usize>(
    path: &Path,
    points: &[SVector<f64, D>],
    cells: &[u32],
    columns: &[Column<D>],
) -> Result<()> {
    let count = cells.len() / (D + 1);
    let offsets: Vec<u32> = (1..=count).map(|cell| (cell * (D + 1)) as u32).collect();
    // VTK's numbers of a triangle and of a tetrahedron.
    let kinds = vec![if D == 2 { 5 } else { 10 }; count];
    let parts = Parts {
        kind: "UnstructuredGrid",
        counts: format!("NumberOfPoints=\"{}\" NumberOfCells=\"{count}\"", points.len()),
        points,
        columns,
        topology: ("Cells", vec![("connectivity", cells), ("offsets", &offsets), ("types", &kinds)]),
    };
    write_whole(path, |file| parts.write(file))
}

/// Writes grains as points.
pub fn write_grains<const D: usize>(
    path: &Path,
    positions: &[SVector<f64, D>],
    columns: &[Column<D>],
) -> Result<()> {
    let count = positions.len();
    let numbers: Vec<u32> = (0..count as u32).collect();
    let offsets: Vec<u32> = (1..=count as u32).collect();
    let parts = Parts {
        kind: "PolyData",
        counts: format!("NumberOfPoints=\"{count}\" NumberOfVerts=\"{count}\""),
        points: positions,
        columns,
        topology: ("Verts", vec![("connectivity", &numbers), ("offsets", &offsets)]),
    };
    write_whole(path, |file| parts.write(file))
}

/// Writes straight lines, two points each.
pub fn write_lines<const D: usize>(
    path: &Path,
    ends: &[SVector<f64, D>],
    columns: &[Column<D>],
) -> Result<()> {
    let count = ends.len() / 2;
    let numbers: Vec<u32> = (0..2 * count as u32).collect();
    let offsets: Vec<u32> = (1..=count as u32).map(|line| 2 * line).collect();
    let parts = Parts {
        kind: "PolyData",
        counts: format!("NumberOfPoints=\"{}\" NumberOfLines=\"{count}\"", 2 * count),
        points: ends,
        columns,
        topology: ("Lines", vec![("connectivity", &numbers), ("offsets", &offsets)]),
    };
    write_whole(path, |file| parts.write(file))
}

struct Parts<'a, const D: usize> {
    kind: &'a str,
    counts: String,
    points: &'a [SVector<f64, D>],
    columns: &'a [Column<'a, D>],
    topology: (&'a str, Vec<(&'a str, &'a [u32])>),
}

impl<const D: usize> Parts<'_, D> {
    fn write(&self, file: &mut dyn Write) -> io::Result<()> {
        let (section, topology) = &self.topology;
        let points = Column { name: "points", values: Values::Vectors(self.points) };
        let topology: Vec<Column<D>> =
            topology.iter().map(|(name, values)| Column::integers(name, values)).collect();
        let kind = self.kind;
        writeln!(file, "<?xml version=\"1.0\"?>")?;
        writeln!(
            file,
            "<VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">"
        )?;
        writeln!(file, "<{kind}>\n<Piece {}>", self.counts)?;
        let mut offset = 0;
        for (section, columns) in [("PointData", self.columns), ("Points", &[points]), (section, &topology)] {
            writeln!(file, "<{section}>")?;
            columns.iter().try_for_each(|column| column.declare(file, &mut offset))?;
            writeln!(file, "</{section}>")?;
        }
        write!(file, "</Piece>\n</{kind}>\n<AppendedData encoding=\"raw\">\n_")?;
        for column in self.columns.iter().chain([&points]).chain(&topology) {
            column.append(file)?;
        }
        writeln!(file, "\n</AppendedData>\n</VTKFile>")
    }
}

impl<const D: usize> Column<'_, D> {
    fn bytes(&self) -> usize {
        match self.values {
            Values::Scalars(values) => 8 * values.len(),
            Values::Vectors(values) => 24 * values.len(),
            Values::Integers(values) => 4 * values.len(),
        }
    }

    fn declare(&self, file: &mut dyn Write, offset: &mut usize) -> io::Result<()> {
        let (kind, components) = match self.values {
            Values::Scalars(_) => ("Float64", 1),
            Values::Vectors(_) => ("Float64", 3),
            Values::Integers(_) => ("UInt32", 1),
        };
        writeln!(
            file,
            "<DataArray type=\"{kind}\" Name=\"{}\" NumberOfComponents=\"{components}\" format=\"appended\" \
             offset=\"{offset}\"/>",
            self.name
        )?;
        *offset += 8 + self.bytes();
        Ok(())
    }

    fn append(&self, file: &mut dyn Write) -> io::Result<()> {
        file.write_all(&(self.bytes() as u64).to_le_bytes())?;
        match self.values {
            Values::Scalars(values) => {
                values.iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))
            }
            Values::Integers(values) => {
                values.iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))
            }
            Values::Vectors(values) => values.iter().try_for_each(|vector| {
                (0..3).try_for_each(|axis| {
                    let component = vector.as_slice().get(axis).copied().unwrap_or(0.0);
                    file.write_all(&component.to_le_bytes())
                })
            }),
        }
    }
}
