//! Sums and maxima over many items, and work on parts: the same bit for bit on any number of threads: the tree of
//! halves depends on their number only.

use rayon::prelude::*;
use std::ops::Range;

/// Items of a leaf of the tree.
const LEAF: usize = 4096;
/// Items above which halves go to two threads: what that costs, and allocates now and then, is little beside them.
const FORK: usize = 10_000;

/// Sum of `f` over a range.
pub(crate) fn sum(range: Range<usize>, f: &(impl Fn(usize) -> f64 + Sync)) -> f64 {
    fold(range, f, &|a, b| a + b)
}

/// The largest `f` over a range, at least 0.
pub(crate) fn largest(range: Range<usize>, f: &(impl Fn(usize) -> f64 + Sync)) -> f64 {
    fold(range, f, &f64::max)
}

/// Calls `f` with every item and its number, the first of which is given.
pub(crate) fn each<T: Send>(items: &mut [T], first: usize, f: &(impl Fn(usize, &mut T) + Sync)) {
    if items.len() <= 1 {
        return items.iter_mut().for_each(|item| f(first, item));
    }
    let middle = items.len() / 2;
    let (left, right) = items.split_at_mut(middle);
    rayon::join(|| each(left, first, f), || each(right, first + middle, f));
}

/// Calls `f` with parts of the items and the number of the first of each.
pub(crate) fn each_chunk<T: Send>(items: &mut [T], f: &(impl Fn(usize, &mut [T]) + Sync)) {
    match items.len() > FORK {
        true => items.par_chunks_mut(LEAF).enumerate().for_each(|(k, chunk)| f(k * LEAF, chunk)),
        false => f(0, items),
    }
}

fn fold(
    range: Range<usize>,
    f: &(impl Fn(usize) -> f64 + Sync),
    join: &(impl Fn(f64, f64) -> f64 + Sync),
) -> f64 {
    if range.len() <= LEAF {
        return range.map(f).fold(0.0, join);
    }
    let middle = range.start + range.len() / 2;
    let (left, right) = (range.start..middle, middle..range.end);
    let (a, b) = match range.len() > FORK {
        true => rayon::join(|| fold(left, f, join), || fold(right, f, join)),
        false => (fold(left, f, join), fold(right, f, join)),
    };
    join(a, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_items_count_once() {
        let n = 3 * LEAF + 5;
        assert_eq!(sum(0..n, &|k| k as f64), (n * (n - 1) / 2) as f64);
        assert_eq!(largest(7..n, &|k| if k == n - 2 { 9.0 } else { 1.0 }), 9.0);
        assert_eq!(largest(0..0, &|_| 1.0), 0.0);
    }
}
