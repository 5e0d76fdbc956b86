//! The tables that travel: which columns they have, what these mean, and where they lie in a payload.
//!
//! A table lists its columns once, here; frames and Python go through the list. Columns lie one after the other, each
//! padded to the stride of the frame, the numbers of a row of a vector side by side.

use super::Header;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use voidage_coupling::error::PeerError;
use voidage_fluid::Vector;
use voidage_fluid::flow::State;
use voidage_fluid::points::{PointScalar, Points};

/// Rows are padded to a multiple of this, so that every column starts at a cache line.
pub(crate) const PAD: usize = 8;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name, in Python too.
    pub name: &'static str,
    /// Unit of its numbers.
    pub unit: &'static str,
    /// Whether a row is a vector.
    pub vector: bool,
    /// Whether its numbers are whole: those of cells of the mesh.
    pub whole: bool,
}

/// A column as the hello describes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Described {
    /// Its name.
    pub name: String,
    /// Unit of its numbers.
    pub unit: String,
    /// Numbers per row.
    pub width: usize,
}

impl Column {
    const fn number(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, vector: false, whole: false }
    }

    const fn vector(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, vector: true, whole: false }
    }

    const fn whole(name: &'static str) -> Self {
        Self { name, unit: "1", vector: false, whole: true }
    }

    /// Numbers per row.
    pub fn width(&self, dimension: usize) -> usize {
        if self.vector { dimension } else { 1 }
    }

    /// For the hello.
    pub fn described(&self, dimension: usize) -> Described {
        Described { name: self.name.into(), unit: self.unit.into(), width: self.width(dimension) }
    }
}

/// Columns of point terms.
pub const POINTS: [Column; 8] = [
    Column::whole("cell"),
    Column::vector("coordinate", "1"),
    Column::number("volume", "m^D"),
    Column::number("drag", "kg/s"),
    Column::number("mobility", "s/kg"),
    Column::vector("velocity", "m/s"),
    Column::number("flux_mobility", "s/kg"),
    Column::vector("flux_velocity", "m/s"),
];

/// Further columns of point terms for every scalar that they exchange; units are those of heat.
pub const POINT_SCALAR: [Column; 3] =
    [Column::number("coefficient", "W/K"), Column::number("mobility", "K/W"), Column::number("value", "K")];

/// Columns of nodal fields, before one for every scalar.
pub const FIELDS: [Column; 2] = [Column::vector("velocity", "m/s"), Column::number("pressure", "Pa")];

/// Column of a scalar among the nodal fields; its unit is that of heat.
pub const FIELD_SCALAR: Column = Column::number("value", "K");

/// Values of a column.
pub enum Values<'a, const D: usize> {
    /// Whole numbers.
    Whole(&'a [u32]),
    /// Numbers.
    Numbers(&'a [f64]),
    /// Vectors.
    Vectors(&'a [Vector<D>]),
}

/// Values of a column that is read.
pub enum ValuesMut<'a, const D: usize> {
    /// Whole numbers.
    Whole(&'a mut Vec<u32>),
    /// Numbers.
    Numbers(&'a mut Vec<f64>),
    /// Vectors.
    Vectors(&'a mut Vec<Vector<D>>),
}

/// A table of columns of equal length.
pub trait Table<const D: usize> {
    /// Number of rows.
    fn rows(&self) -> usize;
    /// Which scalars have columns, one bit each.
    fn scalars(&self) -> u32;
    /// All columns in the order in which they lie.
    fn columns(&self) -> Vec<(Column, Values<'_, D>)>;
    /// The same, to be read, with columns for these scalars.
    fn columns_mut(&mut self, scalars: u32) -> Vec<(Column, ValuesMut<'_, D>)>;
}

/// Whether a scalar is among those of a mask.
fn has(mask: u32, scalar: usize) -> bool {
    mask >> scalar & 1 != 0
}

/// Scalars up to the last of a mask.
fn count(mask: u32) -> usize {
    (u32::BITS - mask.leading_zeros()) as usize
}

impl<const D: usize> Table<D> for Points<D> {
    fn rows(&self) -> usize {
        self.len()
    }

    fn scalars(&self) -> u32 {
        let there = self.scalars.iter().enumerate().filter(|(_, columns)| columns.is_some());
        there.fold(0, |mask, (scalar, _)| mask | 1 << scalar)
    }

    fn columns(&self) -> Vec<(Column, Values<'_, D>)> {
        let values = [
            Values::Whole(&self.cell),
            Values::Vectors(&self.coordinate),
            Values::Numbers(&self.volume),
            Values::Numbers(&self.drag),
            Values::Numbers(&self.mobility),
            Values::Vectors(&self.velocity),
            Values::Numbers(&self.flux_mobility),
            Values::Vectors(&self.flux_velocity),
        ];
        let mut all: Vec<_> = POINTS.into_iter().zip(values).collect();
        for PointScalar { coefficient, mobility, value } in self.scalars.iter().flatten() {
            let columns = [coefficient, mobility, value].map(|column| Values::Numbers(column));
            all.extend(POINT_SCALAR.into_iter().zip(columns));
        }
        all
    }

    fn columns_mut(&mut self, scalars: u32) -> Vec<(Column, ValuesMut<'_, D>)> {
        let values = [
            ValuesMut::Whole(&mut self.cell),
            ValuesMut::Vectors(&mut self.coordinate),
            ValuesMut::Numbers(&mut self.volume),
            ValuesMut::Numbers(&mut self.drag),
            ValuesMut::Numbers(&mut self.mobility),
            ValuesMut::Vectors(&mut self.velocity),
            ValuesMut::Numbers(&mut self.flux_mobility),
            ValuesMut::Vectors(&mut self.flux_velocity),
        ];
        let mut all: Vec<_> = POINTS.into_iter().zip(values).collect();
        self.scalars.resize(count(scalars), None);
        for (scalar, columns) in self.scalars.iter_mut().enumerate() {
            if !has(scalars, scalar) {
                *columns = None;
                continue;
            }
            let PointScalar { coefficient, mobility, value } = columns.get_or_insert_default();
            let columns = [coefficient, mobility, value].map(ValuesMut::Numbers);
            all.extend(POINT_SCALAR.into_iter().zip(columns));
        }
        all
    }
}

impl<const D: usize> Table<D> for State<D> {
    fn rows(&self) -> usize {
        self.pressure.len()
    }

    fn scalars(&self) -> u32 {
        (0..self.scalars.len()).fold(0, |mask, scalar| mask | 1 << scalar)
    }

    fn columns(&self) -> Vec<(Column, Values<'_, D>)> {
        let values = [Values::Vectors(&self.velocity), Values::Numbers(&self.pressure)];
        let scalars = self.scalars.iter().map(|values| (FIELD_SCALAR, Values::Numbers(values)));
        FIELDS.into_iter().zip(values).chain(scalars).collect()
    }

    fn columns_mut(&mut self, scalars: u32) -> Vec<(Column, ValuesMut<'_, D>)> {
        self.scalars.resize(scalars.count_ones() as usize, Vec::new());
        let values = [ValuesMut::Vectors(&mut self.velocity), ValuesMut::Numbers(&mut self.pressure)];
        let scalars = self.scalars.iter_mut().map(|values| (FIELD_SCALAR, ValuesMut::Numbers(values)));
        FIELDS.into_iter().zip(values).chain(scalars).collect()
    }
}

/// Where a table lies in a payload: so many rows, columns so far apart, from `offset` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableLayout {
    /// Rows of every column.
    pub rows: usize,
    /// Distance from column to column, for columns of numbers; vectors take more.
    pub stride: usize,
    /// Where the first column starts.
    pub offset: usize,
    /// Numbers in all.
    pub length: usize,
}

impl TableLayout {
    /// Of a table of `width` numbers per row.
    pub fn new(rows: usize, width: usize, offset: usize) -> Self {
        let stride = rows.next_multiple_of(PAD);
        Self { rows, stride, offset, length: stride * width }
    }

    /// Of a table.
    pub fn of<const D: usize>(table: &impl Table<D>, offset: usize) -> Self {
        let width = table.columns().iter().map(|(column, _)| column.width(D)).sum();
        Self::new(table.rows(), width, offset)
    }

    /// The end of the last column.
    pub fn end(&self) -> usize {
        self.offset + self.length
    }

    /// Where each column lies, of a table with `own` columns and `more` for every one of these scalars.
    pub fn ranges(
        &self,
        (own, more): (&[Column], &[Column]),
        scalars: u32,
        dimension: usize,
    ) -> Vec<(Column, Range<usize>)> {
        let repeated = (0..scalars.count_ones()).flat_map(|_| more);
        let mut start = self.offset;
        let mut range = |column: &Column| {
            let width = column.width(dimension);
            let here = start..start + self.rows * width;
            start += self.stride * width;
            (*column, here)
        };
        own.iter().chain(repeated).map(&mut range).collect()
    }

    /// Notes rows, stride and scalars in a header.
    pub fn describe(&self, scalars: u32, header: Header) -> Header {
        Header { rows: self.rows as u64, stride: self.stride as u64, scalars, ..header }
    }

    /// As a header says, of a table with `own` columns and `more` for every scalar.
    ///
    /// # Errors
    /// The table does not fit the payload.
    pub fn read(
        header: &Header,
        (own, more): (&[Column], &[Column]),
        dimension: usize,
        offset: usize,
    ) -> Result<Self, PeerError> {
        let width = |columns: &[Column]| columns.iter().map(|c| c.width(dimension) as u64).sum::<u64>();
        let width = width(own) + width(more) * u64::from(header.scalars.count_ones());
        let (rows, stride, limit) = (header.rows, header.stride, header.length);
        if rows > limit || stride != rows.next_multiple_of(PAD as u64) {
            return wrong(format!("{rows} rows, {stride} apart, in {limit} numbers"));
        }
        let place = Self::new(rows as usize, width as usize, offset);
        if place.end() as u64 > limit {
            return wrong(format!("columns up to {} in {limit} numbers", place.end()));
        }
        Ok(place)
    }

    /// Writes a table.
    pub fn write<const D: usize>(&self, table: &impl Table<D>, payload: &mut [f64]) {
        let mut start = self.offset;
        for (column, values) in table.columns() {
            let to = &mut payload[start..start + self.rows * column.width(D)];
            match values {
                Values::Whole(from) => to.iter_mut().zip(from).for_each(|(to, from)| *to = f64::from(*from)),
                Values::Numbers(from) => to.copy_from_slice(from),
                Values::Vectors(from) => {
                    to.chunks_exact_mut(D)
                        .zip(from)
                        .for_each(|(to, from)| to.copy_from_slice(from.as_slice()));
                }
            }
            start += self.stride * column.width(D);
        }
    }

    /// Reads a table with columns for these scalars; whole numbers must be below `limit`.
    ///
    /// # Errors
    /// A whole number that is none, or not below the limit.
    pub fn fill<const D: usize>(
        &self,
        scalars: u32,
        limit: usize,
        payload: &[f64],
        table: &mut impl Table<D>,
    ) -> Result<(), PeerError> {
        let mut start = self.offset;
        for (column, values) in table.columns_mut(scalars) {
            let from = &payload[start..start + self.rows * column.width(D)];
            match values {
                ValuesMut::Whole(to) => *to = super::mesh::numbers(from, limit as u64, column.name)?,
                ValuesMut::Numbers(to) => {
                    to.clear();
                    to.extend_from_slice(from);
                }
                ValuesMut::Vectors(to) => {
                    to.clear();
                    to.extend(from.chunks_exact(D).map(Vector::from_column_slice));
                }
            }
            start += self.stride * column.width(D);
        }
        Ok(())
    }
}

/// The answer to what is no frame of this protocol.
pub(super) fn wrong<T>(text: String) -> Result<T, PeerError> {
    Err(PeerError::protocol(text))
}
