//! Products and triangular solves of dense matrices, by the faster of two libraries that the memory allows.
//!
//! The kernels of faer use AVX-512 where the processor has it, and reserve twice its third cache for each thread that
//! multiplies, of which they touch little. Under a limit of virtual memory (`ulimit -v`) this can be more than the whole
//! run needs: then `matrixmultiply` takes its place, which needs a few MB. The choice is made once, from the limit.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_unit_lower_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};
use nix::sys::resource::{Resource, getrlimit};
use std::ops::{Mul, SubAssign};
use std::sync::LazyLock;

/// Virtual memory that the kernels of faer may reserve for a thread, bytes: no processor has a third cache of more than
/// half of it.
const RESERVED: u64 = 2 << 30;

/// Whether the virtual memory of this process is too small for the kernels of faer.
pub(super) fn little_memory() -> bool {
    static LITTLE: LazyLock<bool> = LazyLock::new(|| {
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
        let limit = getrlimit(Resource::RLIMIT_AS).map_or(u64::MAX, |(soft, _)| soft);
        limit / (threads + 1) < RESERVED
    });
    *LITTLE
}

/// Precisions with a product that needs little memory.
pub(crate) trait Product: faer::traits::ComplexField + Copy + Mul<Output = Self> + SubAssign {
    const MINUS_ONE: Self;

    /// C <- -A B, or C - A B, in little memory.
    fn small(c: MatMut<'_, Self>, accumulate: Accum, a: MatRef<'_, Self>, b: MatRef<'_, Self>);
}

macro_rules! product {
    ($real:ty, $gemm:path) => {
        impl Product for $real {
            const MINUS_ONE: Self = -1.0;

            fn small(c: MatMut<'_, Self>, accumulate: Accum, a: MatRef<'_, Self>, b: MatRef<'_, Self>) {
                let (rows, inner, columns) = (a.nrows(), a.ncols(), b.ncols());
                assert_eq!((c.nrows(), b.nrows(), c.ncols()), (rows, inner, columns));
                let keep = if accumulate == Accum::Add { 1.0 } else { 0.0 };
                let (a, rsa, csa) = (a.as_ptr(), a.row_stride(), a.col_stride());
                let (b, rsb, csb) = (b.as_ptr(), b.row_stride(), b.col_stride());
                let (rsc, csc) = (c.row_stride(), c.col_stride());
                let c = c.as_ptr_mut();
                // SAFETY: the three views have these sizes and strides, and C, borrowed mutably, overlaps neither other.
                unsafe { $gemm(rows, inner, columns, -1.0, a, rsa, csa, b, rsb, csb, keep, c, rsc, csc) }
            }
        }
    };
}

product!(f32, matrixmultiply::sgemm);
product!(f64, matrixmultiply::dgemm);

/// C <- -A B, or C - A B.
pub(super) fn multiply<T: Product>(c: MatMut<'_, T>, accumulate: Accum, a: MatRef<'_, T>, b: MatRef<'_, T>) {
    if little_memory() {
        T::small(c, accumulate, a, b);
    } else {
        matmul(c, accumulate, a, b, T::MINUS_ONE, Par::Seq);
    }
}

/// X <- L^-1 X with a lower triangle L of unit diagonal, whatever stands on and above the diagonal.
pub(super) fn solve_unit_lower<T: Product>(lower: MatRef<'_, T>, x: MatMut<'_, T>) {
    if little_memory() {
        solve_small(lower, x);
    } else {
        solve_unit_lower_triangular_in_place(lower, x, Par::Seq);
    }
}

/// Rows up to which a triangle is solved column by column.
const SMALL: usize = 16;

/// The same by halves, so that most of the work lies in products.
fn solve_small<T: Product>(lower: MatRef<'_, T>, x: MatMut<'_, T>) {
    let rows = lower.nrows();
    if rows <= SMALL {
        return solve_columns(lower, x);
    }
    // The first half a multiple of what is solved column by column.
    let half = (rows / 2).next_multiple_of(SMALL);
    let (first, _, below, last) = lower.split_at(half, half);
    let (mut upper, mut rest) = x.split_at_row_mut(half);
    solve_small(first, upper.rb_mut());
    T::small(rest.rb_mut(), Accum::Add, below, upper.rb());
    solve_small(last, rest);
}

/// The same column by column. In arrays of full length, with zeros behind the triangle, so that the inner loop becomes
/// vector operations.
fn solve_columns<T: Product>(lower: MatRef<'_, T>, x: MatMut<'_, T>) {
    let rows = lower.nrows();
    let mut columns = [[T::zero_impl(); SMALL]; SMALL];
    for k in 0..rows {
        for i in k + 1..rows {
            columns[k][i] = lower[(i, k)];
        }
    }
    for mut x in x.col_iter_mut() {
        let mut y = [T::zero_impl(); SMALL];
        (0..rows).for_each(|i| y[i] = x[i]);
        for k in 0..SMALL {
            let factor = y[k];
            for i in 0..SMALL {
                y[i] -= columns[k][i] * factor;
            }
        }
        (0..rows).for_each(|i| x[i] = y[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;

    /// Both libraries against sums entry by entry, on views within larger matrices.
    #[test]
    fn what_needs_little_memory_gives_the_same() {
        let wave = |i: usize, j: usize| (1.3 * (7 * i + 3 * j) as f64).sin();
        for (rows, inner, columns) in [(1, 1, 1), (37, 18, 5), (64, 300, 33), (5, 0, 4)] {
            let a = Mat::from_fn(rows + 2, inner + 1, wave);
            let b = Mat::from_fn(inner + 3, columns, wave);
            let (a, b) = (a.as_ref().subrows(1, rows).subcols(1, inner), b.as_ref().subrows(2, inner));
            for accumulate in [Accum::Add, Accum::Replace] {
                let mut both = [Mat::from_fn(rows, columns, wave), Mat::from_fn(rows, columns, wave)];
                f64::small(both[0].as_mut(), accumulate, a, b);
                multiply(both[1].as_mut(), accumulate, a, b);
                for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
                    let kept = if accumulate == Accum::Add { wave(i, j) } else { 0.0 };
                    let exact = kept - (0..inner).map(|k| a[(i, k)] * b[(k, j)]).sum::<f64>();
                    assert!(
                        both.iter().all(|c| (c[(i, j)] - exact).abs() < 1e-12),
                        "{rows} {inner} {columns}"
                    );
                }
            }
        }
        let lower = Mat::from_fn(45, 45, |i, j| 0.1 * wave(i, j));
        let mut both = [Mat::from_fn(45, 7, wave), Mat::from_fn(45, 7, wave)];
        solve_small(lower.as_ref(), both[0].as_mut());
        solve_unit_lower(lower.as_ref(), both[1].as_mut());
        for (i, j) in (0..45).flat_map(|i| (0..7).map(move |j| (i, j))) {
            for x in &both {
                let sum = x[(i, j)] + (0..i).map(|k| lower[(i, k)] * x[(k, j)]).sum::<f64>();
                assert!((sum - wave(i, j)).abs() < 1e-12, "{i} {j}: {sum}");
            }
        }
    }
}
