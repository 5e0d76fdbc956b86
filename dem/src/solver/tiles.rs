//! Tiles of contacts, passes over them, and the sums of a pass.

use super::batches::TileBatches;
use crate::bodies::Shared;
use crate::contact::Contact;
use std::ops::Range;
use std::sync::Mutex;

/// Ranges of contacts: tile k holds starts[k] .. starts[k + 1]; colour c the tiles colours[c] .. colours[c + 1].
#[derive(Default)]
pub(crate) struct Tiles {
    pub starts: Vec<u32>,
    pub colours: Vec<usize>,
    /// What the last look has found in each tile.
    pub(super) found: Vec<Found>,
}

/// What a look finds in a tile.
#[derive(Default)]
pub(super) struct Found {
    /// The part of the error that varies from grain to grain, J.
    pub rough: Shared,
    /// Fastest closing of a contact beyond its gap over its smaller radius, 1/s.
    pub closing: Shared,
}

impl Tiles {
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Numbers of the contacts of a tile.
    pub(super) fn contacts(&self, tile: usize) -> Range<usize> {
        self.starts[tile] as usize..self.starts[tile + 1] as usize
    }
}

/// What a pass over the contacts adds up, and the largest of a last number.
pub(super) type Sums = ([f64; 6], f64);

pub(super) const NOTHING: Sums = ([0.0; 6], 0.0);

#[inline(always)]
pub(super) fn add(a: Sums, b: Sums) -> Sums {
    (std::array::from_fn(|k| a.0[k] + b.0[k]), a.1.max(b.1))
}

/// Calls `f(contacts, batches, tile)` on each tile of a range, halving it, in parallel above `fork` contacts. Either may be
/// empty; `f` then gets none.
pub(super) fn over_tiles<const D: usize, F>(
    range: Range<usize>,
    starts: &[u32],
    contacts: &mut [Contact<D>],
    batches: &mut [Mutex<TileBatches<D>>],
    fork: usize,
    f: &F,
) -> Sums
where
    F: Fn(&mut [Contact<D>], &mut [Mutex<TileBatches<D>>], usize) -> Sums + Sync,
{
    if range.len() <= 1 {
        return f(contacts, batches, range.start);
    }
    let middle = range.start + range.len() / 2;
    let [begin, cut, end] = [range.start, middle, range.end].map(|tile| starts[tile] as usize);
    let (left, right) = contacts.split_at_mut((cut - begin).min(contacts.len()));
    let (earlier, later) = batches.split_at_mut((middle - range.start).min(batches.len()));
    let many = end - begin > fork;
    let (first, second) = (range.start..middle, middle..range.end);
    if many && rayon::current_num_threads() > 1 {
        let (a, b) = rayon::join(
            || over_tiles(first, starts, left, earlier, fork, f),
            || over_tiles(second, starts, right, later, fork, f),
        );
        return add(a, b);
    }
    add(over_tiles(first, starts, left, earlier, fork, f), over_tiles(second, starts, right, later, fork, f))
}

/// Tiles colour by colour: those of one colour may run at once.
pub(super) fn over_colours<const D: usize, F>(
    tiles: &Tiles,
    contacts: &mut [Contact<D>],
    batches: &mut [Mutex<TileBatches<D>>],
    fork: usize,
    f: F,
) -> Sums
where
    F: Fn(&mut [Contact<D>], &mut [Mutex<TileBatches<D>>], usize) -> Sums + Sync,
{
    let mut sums = NOTHING;
    for colour in tiles.colours.windows(2).filter(|c| c[0] < c[1]) {
        let contacts_of = |all: &[Contact<D>]| match all.is_empty() {
            true => 0..0,
            false => tiles.starts[colour[0]] as usize..tiles.starts[colour[1]] as usize,
        };
        let tiles_of = colour[0]..colour[1];
        let batches_of = if batches.is_empty() { 0..0 } else { tiles_of.clone() };
        let contacts_of = contacts_of(contacts);
        let (some, batches) = (&mut contacts[contacts_of], &mut batches[batches_of]);
        sums = add(sums, over_tiles(tiles_of, &tiles.starts, some, batches, fork, &f));
    }
    sums
}
