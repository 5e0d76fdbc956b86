//! Reads back the ParaView files that [`super::write_mesh`] and [`super::write_grains`] make: for plots and tests.

use std::fs;
use std::path::{Path, PathBuf};
use voidage_coupling::error::{Error, Result};

/// A file read back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Points, m.
    pub points: Vec<[f64; 3]>,
    /// Node numbers of the cells, as they were written.
    pub cells: Vec<u32>,
    /// Columns in the order of the file.
    pub columns: Vec<FrameColumn>,
}

/// A column read back.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameColumn {
    /// Name.
    pub name: String,
    /// Numbers per point: 1 or 3.
    pub components: usize,
    /// The numbers; whole numbers too.
    pub values: Vec<f64>,
}

impl Frame {
    /// The values of a column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|column| column.name == name).map(|column| column.values.as_slice())
    }
}

/// Reads a VTU or VTP file of this program.
pub fn read_frame(path: &Path) -> Result<Frame> {
    let bytes = fs::read(path).map_err(|error| Error::file(path, "read", error))?;
    parse(&bytes).ok_or_else(|| {
        Error::input(format!("{}: is no ParaView file of this program, or is cut off", path.display()))
    })
}

fn parse(bytes: &[u8]) -> Option<Frame> {
    let marker = b"<AppendedData encoding=\"raw\">\n_";
    let start = bytes.windows(marker.len()).position(|window| window == marker)?;
    let head = std::str::from_utf8(&bytes[..start]).ok()?;
    let data = &bytes[start + marker.len()..];
    let mut frame = Frame::default();
    for line in head.lines().filter(|line| line.starts_with("<DataArray ")) {
        let name = attribute(line, "Name")?;
        let offset: usize = attribute(line, "offset")?.parse().ok()?;
        let components = attribute(line, "NumberOfComponents")?.parse().ok()?;
        let size = u64::from_le_bytes(data.get(offset..offset.checked_add(8)?)?.try_into().ok()?) as usize;
        let raw = data.get(offset + 8..(offset + 8).checked_add(size)?)?;
        let values: Vec<f64> = match attribute(line, "type")? {
            "Float64" => raw.as_chunks::<8>().0.iter().map(|chunk| f64::from_le_bytes(*chunk)).collect(),
            "UInt32" => {
                raw.as_chunks::<4>().0.iter().map(|chunk| u32::from_le_bytes(*chunk).into()).collect()
            }
            _ => return None,
        };
        match name {
            "points" => frame.points = values.as_chunks::<3>().0.to_vec(),
            "connectivity" => frame.cells = values.iter().map(|value| *value as u32).collect(),
            "offsets" | "types" => {}
            _ => frame.columns.push(FrameColumn { name: name.to_owned(), components, values }),
        }
    }
    Some(frame)
}

/// The times and files of a PVD file, in order.
pub fn read_collection(path: &Path) -> Result<Vec<(f64, PathBuf)>> {
    let text = fs::read_to_string(path).map_err(|error| Error::file(path, "read", error))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let entry = |line: &str| {
        Some((attribute(line, "timestep")?.parse().ok()?, folder.join(attribute(line, "file")?)))
    };
    Ok(text.lines().filter(|line| line.starts_with("<DataSet ")).filter_map(entry).collect())
}

fn attribute<'a>(line: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = line.split_once(&format!(" {name}=\""))?;
    rest.split('"').next()
}
