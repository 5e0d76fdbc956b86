//! What a payload has beside the columns of tables: blocks of numbers of the mesh and the nodes, and the few numbers
//! of each part of the boundary, of each body and of the report.
//!
//! They are listed here once; frames and `voidage.h` go through the lists.

use super::{APPEARS, Header, IMMERSED, JOINED, MOVES};
use std::ops::Range;
use voidage_fluid::balance::moments;

/// How many numbers there are per row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// One.
    One,
    /// A vector.
    Vector,
    /// The nodes of a cell.
    Corners,
    /// Moments: one in the plane, three in space.
    Moments,
    /// One for every scalar.
    Scalars,
}

impl Width {
    /// The count.
    pub fn numbers(self, dimension: usize, scalars: usize) -> usize {
        match self {
            Width::One => 1,
            Width::Vector => dimension,
            Width::Corners => dimension + 1,
            Width::Moments => moments(dimension),
            Width::Scalars => scalars,
        }
    }
}

/// Numbers that belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Their name.
    pub name: &'static str,
    /// Their unit.
    pub unit: &'static str,
    /// How many there are per row.
    pub width: Width,
    /// What they are.
    pub about: &'static str,
}

const fn entry(name: &'static str, unit: &'static str, width: Width, about: &'static str) -> Entry {
    Entry { name, unit, width, about }
}

/// Numbers per row of a list.
pub fn width(list: &[Entry], dimension: usize, scalars: usize) -> usize {
    list.iter().map(|entry| entry.width.numbers(dimension, scalars)).sum()
}

/// A count of a header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// One, whatever the header says.
    One,
    /// Its `rows`.
    Rows,
    /// Its `nodes`.
    Nodes,
    /// Its `cells`.
    Cells,
    /// Its `facets`.
    Facets,
}

impl Count {
    fn of(self, header: &Header) -> u64 {
        match self {
            Count::One => 1,
            Count::Rows => header.rows,
            Count::Nodes => header.nodes,
            Count::Cells => header.cells,
            Count::Facets => header.facets,
        }
    }
}

/// Rows of a payload that are no columns of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// What is in a row.
    pub entry: Entry,
    /// How many rows there are.
    pub rows: Count,
    /// The flag without which the block is absent; 0 for none.
    pub flag: u32,
    /// What the numbers count, if they are whole: they are below that count.
    pub below: Option<Count>,
}

const fn block(entry: Entry, rows: Count, flag: u32) -> Block {
    Block { entry, rows, flag, below: None }
}

const fn whole(entry: Entry, rows: Count, flag: u32, below: Count) -> Block {
    Block { entry, rows, flag, below: Some(below) }
}

/// A mesh, before the columns of its fields.
pub const MESH: [Block; 6] = [
    block(entry("points", "m", Width::Vector, "places of the nodes"), Count::Rows, 0),
    whole(entry("corners", "1", Width::Corners, "nodes of each cell"), Count::Cells, 0, Count::Rows),
    whole(
        entry("sides", "1", Width::Vector, "nodes of each facet of the boundary, part by part"),
        Count::Facets,
        0,
        Count::Rows,
    ),
    whole(entry("behind", "1", Width::One, "the cell behind each facet"), Count::Facets, 0, Count::Cells),
    block(
        entry("period", "m", Width::Vector, "lengths of the period; 0 along an axis without"),
        Count::One,
        JOINED,
    ),
    whole(
        entry("masters", "1", Width::One, "the node whose values each node has; mostly itself"),
        Count::Rows,
        JOINED,
        Count::Rows,
    ),
];

/// A step, behind the columns of its points.
pub const STEP: [Block; 4] = [
    block(entry("voidage", "1", Width::One, "share of fluid at the nodes"), Count::Nodes, IMMERSED),
    block(
        entry("source", "1/s", Width::One, "right-hand side of the equation of mass at the nodes"),
        Count::Nodes,
        APPEARS,
    ),
    block(
        entry("places", "m", Width::Vector, "where the nodes are at the end of the step"),
        Count::Nodes,
        MOVES,
    ),
    block(entry("motion", "m/s", Width::Vector, "velocity of the nodes in the step"), Count::Nodes, MOVES),
];

/// What passed a part of the boundary.
pub const BALANCE: [Entry; 5] = [
    entry("flux", "m^D/s", Width::One, "volume that leaves through the part"),
    entry("force", "N", Width::Vector, "force of the fluid on the part"),
    entry("torque", "N m", Width::Moments, "moment of this force about the origin"),
    entry(
        "scalars",
        "W",
        Width::Scalars,
        "what the part gives to the fluid of each scalar by conduction and transfer",
    ),
    entry("convected", "W", Width::Scalars, "what the fluid carries out through the part of each scalar"),
];

/// What a body did.
pub const BODY: [Entry; 2] = [
    entry("velocity", "m/s", Width::Vector, "its velocity at the end of the step"),
    entry("vapour", "m^D/s", Width::One, "volume of vapour that leaves it"),
];

/// How a step was solved.
pub const REPORT: [Entry; 6] = [
    entry("flow_iterations", "1", Width::One, "iterations of the flow"),
    entry("scalar_iterations", "1", Width::One, "iterations of the scalars"),
    entry("residual", "1", Width::One, "relative residual of the flow at the end"),
    entry("factored", "1", Width::One, "1 if a matrix was factored, else 0"),
    entry("scalars_s", "s", Width::One, "wall time of the scalars"),
    entry("flow_s", "s", Width::One, "wall time of the flow"),
];

/// Where blocks lie that begin at `start`; those that are absent are empty. Counts that fit in no memory end at the
/// highest number there is, which is beyond every payload.
pub fn lay<const N: usize>(
    blocks: &[Block; N],
    header: &Header,
    dimension: usize,
    start: usize,
) -> [Range<usize>; N] {
    let mut end = start;
    blocks.map(|block| {
        let there = block.flag == 0 || header.flags & block.flag != 0;
        let rows = if there { usize::try_from(block.rows.of(header)).unwrap_or(usize::MAX) } else { 0 };
        let start = end;
        end = start.saturating_add(rows.saturating_mul(block.entry.width.numbers(dimension, 0)));
        start..end
    })
}
