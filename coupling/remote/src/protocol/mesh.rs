//! The frames of meshes and nodal fields.

use super::blocks::{MESH, lay};
use super::columns::{FIELD_SCALAR, FIELDS, Table, TableLayout, wrong};
use super::text::{numbers_for_text, write_text};
use super::{Header, JOINED, Kind, read_text};
use voidage_coupling::error::PeerError;
use voidage_fluid::flow::State;
use voidage_fluid::mesh::{Boundary, Periodic};
use voidage_fluid::{Mesh, Vector};

/// Accepted nodal fields for a mesh that is there.
pub struct StateMessage<'a, const D: usize> {
    fields: &'a State<D>,
    layout: TableLayout,
}

impl<'a, const D: usize> StateMessage<'a, D> {
    /// Fields alone.
    pub fn new(fields: &'a State<D>) -> Self {
        Self { fields, layout: TableLayout::of(fields, 0) }
    }

    /// Its header.
    pub fn header(&self) -> Header {
        let header = Header { length: self.layout.end() as u64, ..Header::new(Kind::State) };
        self.layout.describe(self.fields.scalars(), header)
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        self.layout.write(self.fields, payload);
    }
}

/// The fields in a frame that has them from `offset` on.
pub(super) fn fields_at<const D: usize>(
    header: &Header,
    payload: &[f64],
    offset: usize,
    fields: &mut State<D>,
) -> Result<TableLayout, PeerError> {
    let place = TableLayout::read(header, (&FIELDS, &[FIELD_SCALAR]), D, offset)?;
    place.fill(header.scalars, 0, payload, fields)?;
    Ok(place)
}

/// Reads fields for a mesh of `nodes` nodes.
///
/// # Errors
/// Columns are missing or of another length.
pub fn read_state<const D: usize>(
    header: &Header,
    payload: &[f64],
    nodes: usize,
) -> Result<State<D>, PeerError> {
    if header.rows as usize != nodes {
        return wrong(format!("fields of {} nodes, the mesh has {nodes}", header.rows));
    }
    let mut fields = State::default();
    fields_at(header, payload, 0, &mut fields)?;
    Ok(fields)
}

/// A mesh with accepted fields. The text names the parts of the boundary with their number of facets, in order.
pub struct MeshMessage<'a, const D: usize> {
    mesh: &'a Mesh<D>,
    fields: &'a State<D>,
    parts: String,
}

impl<'a, const D: usize> MeshMessage<'a, D> {
    /// A mesh and the fields on it.
    pub fn new(mesh: &'a Mesh<D>, fields: &'a State<D>) -> Self {
        let parts: Vec<(&str, usize)> =
            mesh.boundaries.iter().map(|part| (part.name.as_str(), part.cells.len())).collect();
        Self { mesh, fields, parts: serde_json::json!(parts).to_string() }
    }

    fn counts(&self) -> Header {
        Header {
            flags: if self.mesh.periodic.is_none() { 0 } else { JOINED },
            rows: self.mesh.points.len() as u64,
            cells: self.mesh.cell_count() as u64,
            facets: self.mesh.boundaries.iter().map(|part| part.cells.len() as u64).sum(),
            ..Header::default()
        }
    }

    fn place(&self) -> TableLayout {
        let [.., masters] = lay(&MESH, &self.counts(), D, 0);
        TableLayout::of(self.fields, masters.end)
    }

    /// Its header.
    pub fn header(&self) -> Header {
        let Header { cells, facets, flags, .. } = self.counts();
        let place = self.place();
        let length = (place.end() + numbers_for_text(&self.parts)) as u64;
        let header =
            Header { cells, facets, flags, text: self.parts.len() as u64, length, ..Header::new(Kind::Mesh) };
        place.describe(self.fields.scalars(), header)
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        let [places, corners, sides, behind, period, masters] = lay(&MESH, &self.counts(), D, 0);
        let points = self.mesh.points.iter().flat_map(|point| point.iter().copied());
        payload[places].iter_mut().zip(points).for_each(|(to, from)| *to = from);
        let parts = &self.mesh.boundaries;
        put_numbers(&mut payload[corners], self.mesh.cells.iter());
        put_numbers(&mut payload[sides], parts.iter().flat_map(|part| &part.facets));
        put_numbers(&mut payload[behind], parts.iter().flat_map(|part| &part.cells));
        let periodic = &self.mesh.periodic;
        let period = payload[period].iter_mut().zip(periodic.period());
        period.for_each(|(to, length)| *to = *length);
        let nodes = 0..self.mesh.points.len() as u32;
        let masters = payload[masters].iter_mut().zip(nodes);
        masters.for_each(|(to, node)| *to = f64::from(periodic.master(node)));
        self.place().write(self.fields, payload);
        write_text(&self.parts, payload);
    }
}

/// Writes whole numbers.
pub(super) fn put_numbers<'a>(to: &mut [f64], numbers: impl Iterator<Item = &'a u32>) {
    to.iter_mut().zip(numbers).for_each(|(to, number)| *to = f64::from(*number));
}

/// Whole numbers below `count`.
pub(super) fn numbers(from: &[f64], count: u64, what: &str) -> Result<Vec<u32>, PeerError> {
    let convert = |value: &f64| {
        let number = *value as u32;
        if f64::from(number) == *value && u64::from(number) < count {
            return Ok(number);
        }
        wrong(format!("the {what} {value}, there are {count}"))
    };
    from.iter().map(convert).collect()
}

/// Reads a mesh and the fields on it.
///
/// # Errors
/// Counts that do not fit the payload, nodes or cells that are not there.
pub fn read_mesh<const D: usize>(header: &Header, payload: &[f64]) -> Result<(Mesh<D>, State<D>), PeerError> {
    let limit = payload.len() as u64;
    if header.rows > limit || header.cells > limit || header.facets > limit {
        return wrong(format!("a mesh of {} nodes in {limit} numbers", header.rows));
    }
    let [places, corners, sides, behind, period, masters] = lay(&MESH, header, D, 0);
    let mut fields = State::default();
    fields_at(header, payload, masters.end, &mut fields)?;
    let points = payload[places].chunks_exact(D).map(Vector::from_column_slice).collect();
    let cells = numbers(&payload[corners], header.rows, "node")?;
    let facets = numbers(&payload[sides], header.rows, "node")?;
    let behind = numbers(&payload[behind], header.cells, "cell")?;
    let periodic = match masters.is_empty() {
        true => Periodic::default(),
        false => {
            let period = Vector::from_column_slice(&payload[period]);
            let masters = numbers(&payload[masters], header.rows, "master")?;
            Periodic::new(period, masters).or_else(|error| wrong(error.to_string()))?
        }
    };
    let parts: Vec<(String, usize)> = serde_json::from_str(&read_text(header, payload)?)
        .or_else(|error| wrong(format!("the boundaries of a mesh: {error}")))?;
    if parts.iter().map(|(_, count)| *count as u64).fold(0, u64::saturating_add) != header.facets {
        return wrong(format!("boundaries {parts:?} of {} facets", header.facets));
    }
    let mut done = 0;
    let boundary = |(name, count): (String, usize)| {
        let range = done..done + count;
        done += count;
        Boundary {
            name,
            facets: facets[range.start * D..range.end * D].to_vec(),
            cells: behind[range].to_vec(),
        }
    };
    let boundaries = parts.into_iter().map(boundary).collect();
    Ok((Mesh { points, cells, boundaries, periodic }, fields))
}
