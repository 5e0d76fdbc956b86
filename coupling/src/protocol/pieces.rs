//! The pieces of the grains and the voidage they make, behind the columns of a step.
//!
//! Cutting the grains takes longer than sending the cut, so it is done once, in the process of the grains.

use super::columns::wrong;
use super::mesh::{numbers, put_numbers};
use super::{Header, Layout};
use crate::error::PeerError;
use std::ops::Range;
use voidage_fluid::exchange::Pieces;

/// Places in the payload of a step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PiecePlaces {
    /// First piece of each grain, and the number of pieces.
    pub first: Range<usize>,
    /// Cell of each piece.
    pub cell: Range<usize>,
    /// Barycentric coordinates 1..=D of each piece.
    pub coordinate: Range<usize>,
    /// Share of each piece in the volume of its grain.
    pub share: Range<usize>,
    /// Nodal voidage.
    pub voidage: Range<usize>,
}

impl PiecePlaces {
    /// Behind columns: the places of so many pieces and nodes.
    pub fn new(layout: &Layout, pieces: usize, nodes: usize) -> Self {
        let first = layout.end() + layout.rows + 1;
        let cell = first + pieces;
        let coordinate = cell + pieces * layout.dimension;
        let share = coordinate + pieces;
        Self {
            first: layout.end()..first,
            cell: first..cell,
            coordinate: cell..coordinate,
            share: coordinate..share,
            voidage: share..share + nodes,
        }
    }

    /// As a header says; `None` in a step without grains.
    ///
    /// # Errors
    /// They do not fit the payload.
    pub fn of(header: &Header, layout: &Layout) -> Result<Option<Self>, PeerError> {
        if layout.mask == 0 {
            return Ok(None);
        }
        let (pieces, nodes, limit) = (header.pieces, header.nodes, header.length);
        if pieces > limit || nodes > limit {
            return wrong(format!("{pieces} pieces and {nodes} nodes in {limit} numbers"));
        }
        let places = Self::new(layout, pieces as usize, nodes as usize);
        if places.voidage.end as u64 > limit {
            return wrong(format!("pieces and voidage up to {} in {limit} numbers", places.voidage.end));
        }
        Ok(Some(places))
    }

    /// Writes pieces and voidage.
    pub fn write<const D: usize>(&self, pieces: &Pieces<D>, voidage: &[f64], payload: &mut [f64]) {
        put_numbers(&mut payload[self.first.clone()], pieces.first.iter());
        put_numbers(&mut payload[self.cell.clone()], pieces.cell.iter());
        let places = payload[self.coordinate.clone()].chunks_exact_mut(D);
        places.zip(&pieces.coordinate).for_each(|(to, x)| to.copy_from_slice(x.as_slice()));
        payload[self.share.clone()].copy_from_slice(&pieces.share);
        payload[self.voidage.clone()].copy_from_slice(voidage);
    }

    /// Reads the pieces, on a mesh of so many cells.
    ///
    /// # Errors
    /// Cells that are not there, pieces that are nobody's.
    pub fn read<const D: usize>(&self, payload: &[f64], cells: usize) -> Result<Pieces<D>, PeerError> {
        let count = self.cell.len();
        let first = numbers(&payload[self.first.clone()], count as u64 + 1, "first piece of a grain")?;
        if first.first() != Some(&0) || first.last() != Some(&(count as u32)) || !first.is_sorted() {
            return wrong(format!("{count} pieces of which some are nobody's"));
        }
        Ok(Pieces {
            first,
            cell: numbers(&payload[self.cell.clone()], cells as u64, "cell of a piece")?,
            coordinate: payload[self.coordinate.clone()]
                .chunks_exact(D)
                .map(voidage_fluid::Vector::from_column_slice)
                .collect(),
            share: payload[self.share.clone()].to_vec(),
        })
    }
}
