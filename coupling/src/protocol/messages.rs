//! Frames with columns: how each is written into a payload and read from one.
//!
//! A message knows its header and length, so that the payload can be borrowed from shared memory, and then writes itself
//! there.

use super::text::{numbers_for_text, write_text};
use super::{ACCEPT, Column, FIELDS, HEAT, Header, Kind, Layout, SOLUTION, STEP, STEP_HEAT, read_text};
use crate::backend::{FluidReport, FluidStep, GrainLoad};
use crate::error::PeerError;
use std::ops::Range;
use voidage_fluid::conditions::Condition;
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::flow::{Report, State};
use voidage_fluid::mesh::Boundary;
use voidage_fluid::{Mesh, Vector};

fn wrong<T>(text: String) -> Result<T, PeerError> {
    Err(PeerError::Protocol(text))
}

impl Layout {
    fn put(&self, payload: &mut [f64], column: Column, values: &[f64]) {
        if let Some(range) = self.range(column) {
            payload[range].copy_from_slice(values);
        }
    }

    fn put_vectors<const D: usize>(&self, payload: &mut [f64], column: Column, values: &[Vector<D>]) {
        if let Some(range) = self.range(column) {
            payload[range].chunks_exact_mut(D).zip(values).for_each(|(to, v)| to.copy_from_slice(v.as_slice()));
        }
    }

    fn get(&self, payload: &[f64], column: Column, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.range(column).into_iter().flat_map(|range| &payload[range]));
    }

    fn get_vectors<const D: usize>(&self, payload: &[f64], column: Column, out: &mut Vec<Vector<D>>) {
        out.clear();
        if let Some(range) = self.range(column) {
            out.extend(payload[range].chunks_exact(D).map(Vector::from_column_slice));
        }
    }

    /// The header of a frame of these columns with so many numbers in all.
    pub fn describe(&self, kind: Kind, length: usize) -> Header {
        Header {
            rows: self.rows as u64,
            stride: self.stride as u64,
            mask: self.mask,
            length: length as u64,
            ..Header::new(kind)
        }
    }
}

fn heat_columns(columns: &'static [Column], heat: bool) -> &'static [Column] {
    if heat { columns } else { &[] }
}

// ------------------------------------------------------------------------------------------------ step

/// The grains of a step.
pub struct StepMessage<'a, const D: usize> {
    step: &'a FluidStep<'a, D>,
    layout: Layout,
    conditions: String,
}

impl<'a, const D: usize> StepMessage<'a, D> {
    /// A step; `conditions` is their text if they must travel, else empty.
    pub fn new(step: &'a FluidStep<'a, D>, conditions: String) -> Self {
        let layout = match &step.grains {
            None => Layout::new(D, 0, &[], 0),
            Some(grains) => {
                let heat = heat_columns(STEP_HEAT, grains.load.heat.is_some());
                Layout::new(D, grains.position.len(), &[STEP, heat], 0)
            }
        };
        Self { step, layout, conditions }
    }

    /// Its header; `accept` accepts the solution before, `iteration` counts the solutions of this step.
    pub fn header(&self, accept: bool, iteration: u32) -> Header {
        let length = self.layout.end() + numbers_for_text(&self.conditions);
        Header {
            flags: if accept { ACCEPT } else { 0 },
            step: self.step.number,
            iteration,
            time: self.step.time,
            dt: self.step.dt,
            text: self.conditions.len() as u64,
            ..self.layout.describe(Kind::Step, length)
        }
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        write_text(&self.conditions, payload);
        let Some(grains) = &self.step.grains else { return };
        let (layout, load) = (&self.layout, grains.load);
        layout.put_vectors(payload, Column::Position, grains.position);
        layout.put(payload, Column::Radius, grains.radius);
        layout.put(payload, Column::Volume, &load.volume);
        layout.put(payload, Column::Drag, &load.drag);
        layout.put(payload, Column::Mobility, &load.mobility);
        layout.put_vectors(payload, Column::Velocity, &load.velocity);
        if let Some(heat) = &load.heat {
            layout.put(payload, Column::HeatCoefficient, &heat.coefficient);
            layout.put(payload, Column::HeatMobility, &heat.mobility);
            layout.put(payload, Column::Temperature, &heat.temperature);
        }
    }
}

/// The layout of a step, and its conditions if it brings some; the columns lie in the payload.
///
/// # Errors
/// Columns are missing or do not fit, the conditions cannot be read.
pub fn read_step<const D: usize>(
    header: &Header,
    payload: &[f64],
) -> Result<(Layout, Option<Vec<Condition<D>>>), PeerError> {
    let required = if header.rows == 0 && header.mask == 0 { &[] } else { STEP };
    let layout = Layout::of(header, D, required, STEP_HEAT, 0)?;
    let text = read_text(header, payload)?;
    if layout.end() + numbers_for_text(&text) > payload.len() {
        return wrong("columns and text of a step overlap".into());
    }
    if text.is_empty() {
        return Ok((layout, None));
    }
    match serde_json::from_str(&text) {
        Ok(conditions) => Ok((layout, Some(conditions))),
        Err(error) => wrong(format!("the conditions of a step: {error}")),
    }
}

impl<const D: usize> GrainLoad<D> {
    /// Copies the columns of a step; pieces and voidage stay as they are. Returns positions (m) and radii (m) beside.
    pub fn copy_columns(
        &mut self,
        layout: &Layout,
        payload: &[f64],
        position: &mut Vec<Vector<D>>,
        radius: &mut Vec<f64>,
    ) {
        layout.get_vectors(payload, Column::Position, position);
        layout.get(payload, Column::Radius, radius);
        layout.get(payload, Column::Volume, &mut self.volume);
        layout.get(payload, Column::Drag, &mut self.drag);
        layout.get(payload, Column::Mobility, &mut self.mobility);
        layout.get_vectors(payload, Column::Velocity, &mut self.velocity);
        if layout.range(Column::HeatCoefficient).is_none() {
            self.heat = None;
            return;
        }
        let heat = self.heat.get_or_insert_default();
        layout.get(payload, Column::HeatCoefficient, &mut heat.coefficient);
        layout.get(payload, Column::HeatMobility, &mut heat.mobility);
        layout.get(payload, Column::Temperature, &mut heat.temperature);
    }
}

// -------------------------------------------------------------------------------------------- solution

/// Numbers of a report without the force.
const REPORT: usize = 7;

impl<const D: usize> FluidReport<D> {
    /// Numbers that it takes, behind the columns of a solution.
    pub const NUMBERS: usize = REPORT + D;

    /// Writes it to the last numbers of a payload.
    pub fn write(&self, payload: &mut [f64]) {
        let start = payload.len() - Self::NUMBERS;
        let (report, numbers) = (&self.solver, &mut payload[start..]);
        numbers[..REPORT].copy_from_slice(&[
            report.flow_iterations as f64,
            report.heat_iterations as f64,
            report.residual,
            f64::from(report.factored),
            report.heat_s,
            report.flow_s,
            self.heat,
        ]);
        numbers[REPORT..].copy_from_slice(self.force.as_slice());
    }
}

/// The fluid at the grains.
pub struct SolutionMessage<'a, const D: usize> {
    at: &'a AtBodies<D>,
    report: &'a FluidReport<D>,
    layout: Layout,
}

impl<'a, const D: usize> SolutionMessage<'a, D> {
    /// A solution; `at` is empty without grains.
    pub fn new(at: &'a AtBodies<D>, report: &'a FluidReport<D>) -> Self {
        let rows = at.velocity.len();
        let heat = heat_columns(HEAT, !at.temperature.is_empty());
        Self { at, report, layout: Layout::new(D, rows, &[SOLUTION, heat], 0) }
    }

    /// Its header.
    pub fn header(&self) -> Header {
        self.layout.describe(Kind::Solution, self.layout.end() + FluidReport::<D>::NUMBERS)
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        let layout = &self.layout;
        layout.put_vectors(payload, Column::Velocity, &self.at.velocity);
        layout.put_vectors(payload, Column::PressureGradient, &self.at.pressure_gradient);
        layout.put(payload, Column::Temperature, &self.at.temperature);
        self.report.write(payload);
    }
}

/// Reads a solution for `grains` grains into `at`.
///
/// # Errors
/// Columns are missing, of another length, or hold what is not finite.
pub fn read_solution<const D: usize>(
    header: &Header,
    payload: &[f64],
    (grains, heat): (usize, bool),
    at: &mut AtBodies<D>,
) -> Result<FluidReport<D>, PeerError> {
    let layout = Layout::of(header, D, SOLUTION, HEAT, 0)?;
    if layout.rows != grains {
        return wrong(format!("a solution for {} grains, there are {grains}", layout.rows));
    }
    if heat && grains > 0 && layout.range(Column::Temperature).is_none() {
        return wrong("a solution without temperature".into());
    }
    let Some(numbers) = payload.get(layout.end()..layout.end() + REPORT + D) else {
        return wrong("a solution without report".into());
    };
    layout.get_vectors(payload, Column::Velocity, &mut at.velocity);
    layout.get_vectors(payload, Column::PressureGradient, &mut at.pressure_gradient);
    at.temperature.clear();
    if heat {
        layout.get(payload, Column::Temperature, &mut at.temperature);
    }
    for column in [Column::Velocity, Column::PressureGradient, Column::Temperature] {
        let values = layout.range(column).map_or(&[][..], |range| &payload[range]);
        if let Some(place) = values.iter().position(|value| !value.is_finite()) {
            let (grain, name) = (place / column.width(D), column.name());
            return wrong(format!("{name} = {} at grain {grain}: the solver diverges", values[place]));
        }
    }
    let solver = Report {
        flow_iterations: numbers[0] as usize,
        heat_iterations: numbers[1] as usize,
        residual: numbers[2],
        factored: numbers[3] != 0.0,
        heat_s: numbers[4],
        flow_s: numbers[5],
    };
    let force = Vector::from_column_slice(&numbers[REPORT..]);
    Ok(FluidReport { solver, force, heat: numbers[6] })
}

// ------------------------------------------------------------------------------------- fields and mesh

/// Nodal fields: the answer to a request, or accepted fields for a mesh that is there.
pub struct FieldsMessage<'a, const D: usize> {
    fields: &'a State<D>,
    layout: Layout,
}

impl<'a, const D: usize> FieldsMessage<'a, D> {
    /// Fields that start at this place of the payload.
    fn at(fields: &'a State<D>, offset: usize) -> Self {
        let heat = heat_columns(HEAT, fields.temperature.is_some());
        Self { fields, layout: Layout::new(D, fields.pressure.len(), &[FIELDS, heat], offset) }
    }

    /// Fields alone.
    pub fn new(fields: &'a State<D>) -> Self {
        Self::at(fields, 0)
    }

    /// Its header, [`Kind::Fields`] or [`Kind::State`].
    pub fn header(&self, kind: Kind) -> Header {
        self.layout.describe(kind, self.layout.end())
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        self.layout.put_vectors(payload, Column::Velocity, &self.fields.velocity);
        self.layout.put(payload, Column::Pressure, &self.fields.pressure);
        if let Some(temperature) = &self.fields.temperature {
            self.layout.put(payload, Column::Temperature, temperature);
        }
    }
}

fn fields_at<const D: usize>(
    header: &Header,
    payload: &[f64],
    offset: usize,
) -> Result<State<D>, PeerError> {
    let layout = Layout::of(header, D, FIELDS, HEAT, offset)?;
    let mut state = State { velocity: Vec::new(), pressure: Vec::new(), temperature: None };
    layout.get_vectors(payload, Column::Velocity, &mut state.velocity);
    layout.get(payload, Column::Pressure, &mut state.pressure);
    if layout.range(Column::Temperature).is_some() {
        layout.get(payload, Column::Temperature, state.temperature.get_or_insert_default());
    }
    Ok(state)
}

/// Reads fields for a mesh of `nodes` nodes.
///
/// # Errors
/// Columns are missing or of another length.
pub fn read_fields<const D: usize>(
    header: &Header,
    payload: &[f64],
    nodes: usize,
) -> Result<State<D>, PeerError> {
    if header.rows as usize != nodes {
        return wrong(format!("fields of {} nodes, the mesh has {nodes}", header.rows));
    }
    fields_at(header, payload, 0)
}

/// Places in the payload of a mesh: nodes, nodes of cells, nodes of facets, cells behind facets. Numbers of nodes and
/// cells are whole numbers of 8 bytes like all others.
struct MeshPlaces {
    points: Range<usize>,
    cells: Range<usize>,
    facets: Range<usize>,
    behind: Range<usize>,
}

impl MeshPlaces {
    fn of(header: &Header, dimension: usize) -> Self {
        let points = header.rows as usize * dimension;
        let cells = points + header.cells as usize * (dimension + 1);
        let facets = cells + header.facets as usize * dimension;
        let behind = facets + header.facets as usize;
        Self { points: 0..points, cells: points..cells, facets: cells..facets, behind: facets..behind }
    }
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
            rows: self.mesh.points.len() as u64,
            cells: self.mesh.cell_count() as u64,
            facets: self.mesh.boundaries.iter().map(|part| part.cells.len() as u64).sum(),
            ..Header::default()
        }
    }

    fn fields(&self) -> FieldsMessage<'_, D> {
        FieldsMessage::at(self.fields, MeshPlaces::of(&self.counts(), D).behind.end)
    }

    /// Its header.
    pub fn header(&self) -> Header {
        let Header { cells, facets, .. } = self.counts();
        let layout = self.fields().layout;
        let length = layout.end() + numbers_for_text(&self.parts);
        Header { cells, facets, text: self.parts.len() as u64, ..layout.describe(Kind::Mesh, length) }
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        let places = MeshPlaces::of(&self.counts(), D);
        let points = self.mesh.points.iter().flat_map(|point| point.iter().copied());
        payload[places.points].iter_mut().zip(points).for_each(|(to, from)| *to = from);
        let parts = &self.mesh.boundaries;
        put_numbers(&mut payload[places.cells], self.mesh.cells.iter());
        put_numbers(&mut payload[places.facets], parts.iter().flat_map(|part| &part.facets));
        put_numbers(&mut payload[places.behind], parts.iter().flat_map(|part| &part.cells));
        self.fields().write(payload);
        write_text(&self.parts, payload);
    }
}

fn put_numbers<'a>(to: &mut [f64], numbers: impl Iterator<Item = &'a u32>) {
    to.iter_mut().zip(numbers).for_each(|(to, number)| *to = f64::from(*number));
}

/// Whole numbers below `count`.
fn numbers(from: &[f64], count: u64, what: &str) -> Result<Vec<u32>, PeerError> {
    let convert = |value: &f64| {
        let number = *value as u32;
        if f64::from(number) == *value && u64::from(number) < count {
            return Ok(number);
        }
        wrong(format!("a mesh with the {what} {value}, there are {count}"))
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
    let places = MeshPlaces::of(header, D);
    let fields = fields_at(header, payload, places.behind.end)?;
    let points = payload[places.points].chunks_exact(D).map(Vector::from_column_slice).collect();
    let cells = numbers(&payload[places.cells], header.rows, "node")?;
    let facets = numbers(&payload[places.facets], header.rows, "node")?;
    let behind = numbers(&payload[places.behind], header.cells, "cell")?;
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
    Ok((Mesh { points, cells, boundaries }, fields))
}
