//! The columns of a frame: which are there, how wide they are, where they lie.

use super::{Header, Kind};
use crate::error::PeerError;
use std::ops::Range;
use voidage_fluid::Vector;

/// Rows are padded to a multiple of this, so that every column starts at a cache line.
const PAD: usize = 8;

/// A column: one or `D` numbers per row, those of a row side by side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Column {
    /// Centre of the grain, m.
    Position = 0,
    /// Radius, m.
    Radius = 1,
    /// Solid volume V, m3 (m2 in the plane).
    Volume = 2,
    /// Drag coefficient gamma, kg/s.
    Drag = 3,
    /// Mobility a, s/kg.
    Mobility = 4,
    /// In a step the constant part b of the velocity law, else the velocity of the fluid, m/s.
    Velocity = 5,
    /// hA, W/K.
    HeatCoefficient = 6,
    /// aT, K/W.
    HeatMobility = 7,
    /// In a step the constant part bT of the temperature law, else the temperature of the fluid, K.
    Temperature = 8,
    /// Pressure gradient, Pa/m.
    PressureGradient = 9,
    /// Pressure, Pa.
    Pressure = 10,
    /// Mobility of the law of the solid flux, s/kg.
    ContinuityMobility = 11,
    /// Constant part of the law of the solid flux, m/s.
    ContinuityVelocity = 12,
}

/// All columns in the order in which they lie.
pub const COLUMNS: [Column; 13] = [
    Column::Position,
    Column::Radius,
    Column::Volume,
    Column::Drag,
    Column::Mobility,
    Column::Velocity,
    Column::HeatCoefficient,
    Column::HeatMobility,
    Column::Temperature,
    Column::PressureGradient,
    Column::Pressure,
    Column::ContinuityMobility,
    Column::ContinuityVelocity,
];

/// Columns of a step.
pub const STEP: &[Column] =
    &[Column::Position, Column::Radius, Column::Volume, Column::Drag, Column::Mobility, Column::Velocity];
/// Further columns of a step with heat.
pub const STEP_HEAT: &[Column] = &[Column::HeatCoefficient, Column::HeatMobility, Column::Temperature];
/// Further columns of a step whose solid flux has a law of its own.
pub const STEP_CONTINUITY: &[Column] = &[Column::ContinuityMobility, Column::ContinuityVelocity];
/// Columns of a solution.
pub const SOLUTION: &[Column] = &[Column::Velocity, Column::PressureGradient];
/// Columns of fields.
pub const FIELDS: &[Column] = &[Column::Velocity, Column::Pressure];
/// Further column of solutions and fields with heat.
pub const HEAT: &[Column] = &[Column::Temperature];

impl Column {
    /// Its bit in the mask of a header.
    pub fn bit(self) -> u32 {
        1 << self as u32
    }

    /// Numbers per row.
    pub fn width(self, dimension: usize) -> usize {
        match self {
            Column::Position | Column::Velocity | Column::PressureGradient | Column::ContinuityVelocity => {
                dimension
            }
            _ => 1,
        }
    }

    /// The name in the hello and in Python.
    pub fn name(self) -> &'static str {
        match self {
            Column::Position => "position",
            Column::Radius => "radius",
            Column::Volume => "volume",
            Column::Drag => "drag",
            Column::Mobility => "mobility",
            Column::Velocity => "velocity",
            Column::HeatCoefficient => "heat_coefficient",
            Column::HeatMobility => "heat_mobility",
            Column::Temperature => "temperature",
            Column::PressureGradient => "pressure_gradient",
            Column::Pressure => "pressure",
            Column::ContinuityMobility => "continuity_mobility",
            Column::ContinuityVelocity => "continuity_velocity",
        }
    }
}

/// Where the columns of a frame lie in its payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// 2 or 3.
    pub dimension: usize,
    /// Rows of every column.
    pub rows: usize,
    /// Distance from column to column.
    pub stride: usize,
    /// Which columns are there.
    pub mask: u32,
    /// Where the first column starts.
    pub offset: usize,
}

impl Layout {
    /// The layout of these columns from `offset` on.
    pub fn new(dimension: usize, rows: usize, sets: &[&[Column]], offset: usize) -> Self {
        let mask = sets.iter().flat_map(|set| set.iter()).fold(0, |mask, column| mask | column.bit());
        Self { dimension, rows, stride: rows.next_multiple_of(PAD), mask, offset }
    }

    /// The layout that a header describes; it must have the columns `required` and may have each of the sets
    /// `optional`, whole.
    ///
    /// # Errors
    /// Columns are missing or too many, or do not fit the payload.
    pub fn of(
        header: &Header,
        dimension: usize,
        required: &[Column],
        optional: &[&[Column]],
        offset: usize,
    ) -> Result<Self, PeerError> {
        let bits = |set: &[Column]| set.iter().fold(0, |mask, column| mask | column.bit());
        let needed = bits(required);
        let whole = optional.iter().map(|set| bits(set)).filter(|set| header.mask & set == *set);
        if header.mask != whole.fold(needed, |mask, set| mask | set) {
            return wrong(format!("columns {:#b}, expected {needed:#b}", header.mask));
        }
        let (rows, stride, limit) = (header.rows as usize, header.stride as usize, header.length as usize);
        if rows > stride || stride > limit.max(1) + PAD {
            return wrong(format!("{rows} rows, {stride} apart, in {limit} numbers"));
        }
        let layout = Self { dimension, rows, stride, mask: header.mask, offset };
        if layout.end() > limit {
            return wrong(format!("columns up to {} in {limit} numbers", layout.end()));
        }
        Ok(layout)
    }

    /// Where a column lies; `None` if it is not there.
    pub fn range(&self, column: Column) -> Option<Range<usize>> {
        if self.mask & column.bit() == 0 {
            return None;
        }
        let start = self.offset + self.stride * self.width_before(column as u32);
        Some(start..start + self.rows * column.width(self.dimension))
    }

    /// The end of the last column.
    pub fn end(&self) -> usize {
        self.offset + self.stride * self.width_before(u32::MAX)
    }

    fn width_before(&self, number: u32) -> usize {
        let there = COLUMNS.iter().filter(|c| self.mask & c.bit() != 0 && (**c as u32) < number);
        there.map(|column| column.width(self.dimension)).sum()
    }
}

/// Writing and reading columns.
impl Layout {
    pub(super) fn put(&self, payload: &mut [f64], column: Column, values: &[f64]) {
        if let Some(range) = self.range(column) {
            payload[range].copy_from_slice(values);
        }
    }

    pub(super) fn put_vectors<const D: usize>(
        &self,
        payload: &mut [f64],
        column: Column,
        values: &[Vector<D>],
    ) {
        if let Some(range) = self.range(column) {
            payload[range]
                .chunks_exact_mut(D)
                .zip(values)
                .for_each(|(to, v)| to.copy_from_slice(v.as_slice()));
        }
    }

    pub(super) fn get(&self, payload: &[f64], column: Column, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.range(column).into_iter().flat_map(|range| &payload[range]));
    }

    pub(super) fn get_vectors<const D: usize>(
        &self,
        payload: &[f64],
        column: Column,
        out: &mut Vec<Vector<D>>,
    ) {
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

/// Columns that are there on a condition only.
pub(super) fn only_if(there: bool, columns: &'static [Column]) -> &'static [Column] {
    if there { columns } else { &[] }
}

/// The answer to what is no frame of this protocol.
pub(super) fn wrong<T>(text: String) -> Result<T, PeerError> {
    Err(PeerError::Protocol(text))
}
