//! Dense kernels of the fronts. Matrices are column-major slices.
//!
//! Everything runs in one thread with a fixed order of operations, except for products that are
//! cut into tiles of fixed size: so no result depends on the number of threads.

use super::product::{Product, multiply, solve_unit_lower};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;
use std::ops::{Add, AddAssign, Div, MulAssign, Neg, Sub};

/// Single or double precision.
pub(crate) trait Scalar:
    Product
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + MulAssign
{
    const ONE: Self;
    /// Smallest pivot of a matrix with entries of size one: smaller ones are round-off and are
    /// replaced by this. The power 3/4 of the precision: the perturbation is then small, and the
    /// factors it leaves (up to its inverse) are too.
    const SMALLEST_PIVOT: Self;
    fn from_f64(x: f64) -> Self;
    fn to_f64(self) -> f64;
    fn size(self) -> Self;
}

impl Scalar for f32 {
    const ONE: Self = 1.0;
    const SMALLEST_PIVOT: Self = 6.4e-6;
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    fn to_f64(self) -> f64 {
        self as f64
    }
    fn size(self) -> Self {
        self.abs()
    }
}

impl Scalar for f64 {
    const ONE: Self = 1.0;
    const SMALLEST_PIVOT: Self = 1.8e-12;
    fn from_f64(x: f64) -> Self {
        x
    }
    fn to_f64(self) -> f64 {
        self
    }
    fn size(self) -> Self {
        self.abs()
    }
}

/// Columns that are factored before the rest is updated.
const PANEL: usize = 16;

/// Share of the largest entry of a column from which the diagonal is its pivot: rows are exchanged for less only.
const PIVOT: f64 = 0.1;

/// Products with more operations than this are cut into tiles of columns, which may run in
/// parallel.
const TILE_ABOVE: usize = 40_000_000;
const TILE: usize = 192;

/// LU of the first `pivots` columns of a front, [L U-part; L-part] in place, `rows` by `pivots`.
/// Pivots are sought among the first `pivots` rows only; `swaps[k]` is the row exchanged with k.
/// The diagonal holds the inverses of the pivots.
pub(crate) fn factor_panel<T: Scalar>(panel: &mut [T], rows: usize, pivots: usize, swaps: &mut [u32]) {
    for first in (0..pivots).step_by(PANEL) {
        let last = (first + PANEL).min(pivots);
        Arch::new().dispatch(FactorColumns {
            panel: &mut *panel,
            rows,
            pivots,
            first,
            last,
            swaps: &mut *swaps,
        });
        if last == pivots {
            return;
        }
        let (left, right) = panel.split_at_mut(last * rows);
        let left = MatRef::from_column_major_slice(&left[first * rows..], rows, last - first);
        let right = MatMut::from_column_major_slice_mut(right, rows, pivots - last);
        let (_, right) = right.split_at_row_mut(first);
        let (mut upper, lower) = right.split_at_row_mut(last - first);
        let (_, left) = left.split_at_row(first);
        let (diagonal, left) = left.split_at_row(last - first);
        solve_unit_lower(diagonal, upper.rb_mut());
        multiply(lower, Accum::Add, left, upper.rb());
    }
}

struct FactorColumns<'a, T> {
    panel: &'a mut [T],
    rows: usize,
    pivots: usize,
    first: usize,
    last: usize,
    swaps: &'a mut [u32],
}

impl<T: Scalar> NullaryFnOnce for FactorColumns<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { panel, rows, pivots, first, last, swaps } = self;
        for k in first..last {
            let pivot = k + pivot(&panel[k * rows..][k..pivots]);
            swaps[k] = pivot as u32;
            if pivot != k {
                for column in panel.chunks_exact_mut(rows) {
                    column.swap(k, pivot);
                }
            }
            let (left, right) = panel.split_at_mut((k + 1) * rows);
            let column = &mut left[k * rows..];
            let mut pivot = column[k];
            if pivot.size() < T::SMALLEST_PIVOT {
                pivot = if pivot < T::default() { -T::SMALLEST_PIVOT } else { T::SMALLEST_PIVOT };
            }
            let inverse = T::ONE / pivot;
            column[k] = inverse;
            let column = &mut column[k + 1..];
            column.iter_mut().for_each(|l| *l *= inverse);
            for other in right.chunks_exact_mut(rows).take(last - k - 1) {
                let factor = other[k];
                for (x, &l) in other[k + 1..].iter_mut().zip(&*column) {
                    *x -= l * factor;
                }
            }
        }
    }
}

/// The place of a pivot: the first one if it is large enough, else the largest.
#[inline(always)]
fn pivot<T: Scalar>(column: &[T]) -> usize {
    let larger = |a: T, b: T| if b > a { b } else { a };
    // Sixteen at a time, which compilers turn into vectors.
    let (chunks, rest) = column.as_chunks::<16>();
    let mut largest = [T::default(); 16];
    for chunk in chunks {
        largest = std::array::from_fn(|l| larger(largest[l], chunk[l].size()));
    }
    let largest = rest.iter().map(|x| x.size()).chain(largest).fold(T::default(), larger);
    if column[0].size() >= T::from_f64(PIVOT) * largest {
        return 0;
    }
    column.iter().position(|x| x.size() == largest).unwrap_or(0)
}

/// U = L^-1 P F for the columns of a front behind its pivots: `upper` is `pivots` by any number.
pub(crate) fn solve_upper_rows<T: Scalar>(
    panel: &[T],
    rows: usize,
    pivots: usize,
    swaps: &[u32],
    upper: &mut [T],
) {
    if upper.is_empty() {
        return;
    }
    let columns = upper.len() / pivots;
    let lower = MatRef::from_column_major_slice(panel, rows, pivots).split_at_row(pivots).0;
    let solve = |upper: &mut [T]| {
        if (0..).zip(swaps).any(|(k, &swap)| k != swap) {
            for column in upper.chunks_exact_mut(pivots) {
                (0..).zip(swaps).for_each(|(k, &swap): (usize, _)| column.swap(k, swap as usize));
            }
        }
        let columns = upper.len() / pivots;
        solve_unit_lower(lower, MatMut::from_column_major_slice_mut(upper, pivots, columns));
    };
    if pivots * pivots * columns > TILE_ABOVE {
        upper.par_chunks_mut(pivots * TILE).for_each(solve);
    } else {
        solve(upper);
    }
}

/// S = -L U with the last rows of a panel: `update` is square, of `rows` - `pivots`.
pub(crate) fn product<T: Scalar>(panel: &[T], rows: usize, pivots: usize, upper: &[T], update: &mut [T]) {
    let size = rows - pivots;
    if pivots == 0 {
        return update.fill(T::default());
    }
    if size == 0 {
        return;
    }
    let lower = MatRef::from_column_major_slice(panel, rows, pivots).split_at_row(pivots).1;
    let tile = |(update, upper): (&mut [T], &[T])| {
        let columns = update.len() / size;
        multiply(
            MatMut::from_column_major_slice_mut(update, size, columns),
            Accum::Replace,
            lower,
            MatRef::from_column_major_slice(upper, pivots, columns),
        );
    };
    if 2 * size * size * pivots > TILE_ABOVE {
        update.par_chunks_mut(size * TILE).zip(upper.par_chunks(pivots * TILE)).for_each(tile);
    } else {
        tile((update, upper));
    }
}

/// Forward substitution with a panel: x = L^-1 P x for the pivots, and y -= L x for the rows.
pub(crate) struct Forward<'a, T> {
    pub panel: &'a [T],
    pub swaps: &'a [u32],
    pub x: &'a mut [T],
    pub y: &'a mut [T],
}

impl<T: Scalar> NullaryFnOnce for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { panel, swaps, x, y } = self;
        let (pivots, rows) = (x.len(), x.len() + y.len());
        for (k, &swap) in swaps.iter().enumerate() {
            x.swap(k, swap as usize);
        }
        // Four columns at a time: y is read and written once for all of them.
        let mut k = 0;
        while k + 4 <= pivots {
            let columns = &panel[k * rows..(k + 4) * rows];
            let (a, columns) = columns.split_at(rows);
            let (b, columns) = columns.split_at(rows);
            let (c, d) = columns.split_at(rows);
            let xa = x[k];
            let xb = x[k + 1] - a[k + 1] * xa;
            let xc = x[k + 2] - a[k + 2] * xa - b[k + 2] * xb;
            let xd = x[k + 3] - a[k + 3] * xa - b[k + 3] * xb - c[k + 3] * xc;
            (x[k + 1], x[k + 2], x[k + 3]) = (xb, xc, xd);
            subtract_four(
                &mut x[k + 4..],
                [&a[k + 4..], &b[k + 4..], &c[k + 4..], &d[k + 4..]],
                [xa, xb, xc, xd],
            );
            subtract_four(y, [&a[pivots..], &b[pivots..], &c[pivots..], &d[pivots..]], [xa, xb, xc, xd]);
            k += 4;
        }
        while k < pivots {
            let column = &panel[k * rows..(k + 1) * rows];
            let factor = x[k];
            subtract_one(&mut x[k + 1..], &column[k + 1..], factor);
            subtract_one(y, &column[pivots..], factor);
            k += 1;
        }
    }
}

/// Backward substitution: x = U^-1 (x - F y) with F the columns behind the pivots.
pub(crate) struct Backward<'a, T> {
    pub panel: &'a [T],
    pub upper: &'a [T],
    pub x: &'a mut [T],
    pub y: &'a [T],
}

impl<T: Scalar> NullaryFnOnce for Backward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { panel, upper, x, y } = self;
        let (pivots, rows) = (x.len(), x.len() + y.len());
        if pivots == 0 {
            return;
        }
        let (fours, rest) = y.as_chunks::<4>();
        let mut columns = upper.chunks_exact(4 * pivots);
        for (factors, columns) in fours.iter().zip(&mut columns) {
            let (a, columns) = columns.split_at(pivots);
            let (b, columns) = columns.split_at(pivots);
            let (c, d) = columns.split_at(pivots);
            subtract_four(x, [a, b, c, d], *factors);
        }
        for (factor, column) in rest.iter().zip(columns.remainder().chunks_exact(pivots)) {
            subtract_one(x, column, *factor);
        }
        for k in (0..pivots).rev() {
            let column = &panel[k * rows..k * rows + k + 1];
            let value = x[k] * column[k];
            x[k] = value;
            subtract_one(&mut x[..k], &column[..k], value);
        }
    }
}

#[inline(always)]
fn subtract_four<T: Scalar>(y: &mut [T], columns: [&[T]; 4], factors: [T; 4]) {
    let [a, b, c, d] = columns;
    let [fa, fb, fc, fd] = factors;
    for ((((y, &a), &b), &c), &d) in y.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *y -= (a * fa + b * fb) + (c * fc + d * fd);
    }
}

#[inline(always)]
fn subtract_one<T: Scalar>(y: &mut [T], column: &[T], factor: T) {
    for (y, &a) in y.iter_mut().zip(column) {
        *y -= a * factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Factors of one front, and the product of them with its rows in their first order.
    fn of_its_factors(front: &[f64], rows: usize, pivots: usize) -> (Vec<u32>, Vec<f64>) {
        let (mut panel, mut swaps) = (front.to_vec(), vec![0; pivots]);
        factor_panel(&mut panel, rows, pivots, &mut swaps);
        let at = |i: usize, j: usize| panel[j * rows + i];
        let upper = |i: usize, j: usize| if i == j { 1.0 / at(i, i) } else { at(i, j) };
        let lower = |i: usize, j: usize| if i == j { 1.0 } else { at(i, j) };
        let mut product = vec![0.0; front.len()];
        for j in 0..pivots {
            for i in 0..rows {
                product[j * rows + i] = (0..=i.min(j)).map(|k| lower(i, k) * upper(k, j)).sum();
            }
            for (k, &swap) in swaps.iter().enumerate().rev() {
                product[j * rows..].swap(k, swap as usize);
            }
        }
        (swaps, product)
    }

    #[test]
    fn a_small_diagonal_is_exchanged_and_one_that_is_large_enough_is_not() {
        let (rows, pivots) = (57, 41);
        for diagonal in [1e-9, 0.5] {
            let entry = |k: usize| match (k / rows, k % rows) {
                (j, i) if i == j => diagonal,
                (j, i) => (1.7 * (i * rows + 3 * j) as f64).sin() * if diagonal < 0.1 { 1.0 } else { 0.02 },
            };
            let front: Vec<f64> = (0..rows * pivots).map(entry).collect();
            let (swaps, product) = of_its_factors(&front, rows, pivots);
            let exchanged = (0..).zip(&swaps).filter(|(k, swap)| *k != **swap).count();
            assert_eq!(exchanged > 0, diagonal < 0.1, "{exchanged} of {pivots} rows");
            let wrong = front.iter().zip(&product).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(wrong < 1e-12, "{wrong:e}");
        }
    }
}
