//! Tiles of contacts, passes over them, and the sums of a pass.

use crate::contact::Contact;
use crate::space::Vector;

/// Ranges of contacts: tile k holds starts[k] .. starts[k + 1]; colour c the tiles colours[c] .. colours[c + 1].
#[derive(Default)]
pub(crate) struct Tiles {
    pub starts: Vec<u32>,
    pub colours: Vec<usize>,
}

/// Contacts of a colour above which its tiles go to several threads: a sweep takes some thirty nanoseconds for each, many times a step.
const FORK_CONTACTS: usize = 5_000;

/// What a pass over the contacts adds up, and the largest of a last number.
pub(super) type Sums = ([f64; 5], f64);

pub(super) const NOTHING: Sums = ([0.0; 5], 0.0);

#[inline(always)]
pub(super) fn add(a: Sums, b: Sums) -> Sums {
    (std::array::from_fn(|k| a.0[k] + b.0[k]), a.1.max(b.1))
}

/// Calls `f(contacts, last, first)` on each tile, halving the range of tiles, in parallel above `fork` contacts.
pub(super) fn over_tiles<const D: usize, F>(
    starts: &[u32],
    contacts: &mut [Contact<D>],
    last: &mut [Vector<D>],
    fork: usize,
    f: &F,
) -> Sums
where
    F: Fn(&mut [Contact<D>], &mut [Vector<D>], usize) -> Sums + Sync,
{
    let tiles = starts.len() - 1;
    if tiles <= 1 {
        return f(contacts, last, starts[0] as usize);
    }
    let middle = tiles / 2;
    let cut = (starts[middle] - starts[0]) as usize;
    let (left, right) = contacts.split_at_mut(cut);
    let (past, later) = last.split_at_mut(cut.min(last.len()));
    let (first, second) = (&starts[..=middle], &starts[middle..]);
    if left.len() + right.len() > fork && rayon::current_num_threads() > 1 {
        let (a, b) = rayon::join(
            || over_tiles(first, left, past, fork, f),
            || over_tiles(second, right, later, fork, f),
        );
        return add(a, b);
    }
    add(over_tiles(first, left, past, fork, f), over_tiles(second, right, later, fork, f))
}

/// Tiles colour by colour: those of one colour may run at once. `last` is empty or as long as the contacts.
pub(super) fn over_colours<const D: usize, F>(
    tiles: &Tiles,
    contacts: &mut [Contact<D>],
    last: &mut [Vector<D>],
    f: F,
) -> Sums
where
    F: Fn(&mut [Contact<D>], &mut [Vector<D>], usize) -> Sums + Sync,
{
    let mut sums = NOTHING;
    for colour in tiles.colours.windows(2).filter(|c| c[0] < c[1]) {
        let starts = &tiles.starts[colour[0]..=colour[1]];
        let range = starts[0] as usize..starts[starts.len() - 1] as usize;
        let past = if last.is_empty() { 0..0 } else { range.clone() };
        sums = add(sums, over_tiles(starts, &mut contacts[range], &mut last[past], FORK_CONTACTS, &f));
    }
    sums
}
