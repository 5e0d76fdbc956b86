//! Multifrontal LU: dense factors along the tree of a nested dissection.
//!
//! A front F collects what is left of the matrix for its pivots and the later nodes coupled to them,
//! from the matrix and from the update matrices of its children. With pivots first,
//!
//! ```text
//! F = [A B; C D],    P A = L U,    B <- L^-1 P B,    C <- C U^-1,    D <- D - C B,
//! ```
//!
//! and D is the update matrix for the parent. Rows are exchanged only among the pivots: the
//! matrices here are positive-real after the sign of the pressure rows is changed, for which an
//! elimination in any order of nodes is stable; a pivot that vanishes anyway is replaced by a small number and
//! left to GMRES.

use super::dense::{Backward, Forward, Scalar, factor_panel, product, solve_upper_rows};
use super::gmres::Preconditioner;
use super::matrix::BlockMatrix;
use super::scaling::Scaling;
use super::symbolic::{Front, Symbolic, Totals};
use pulp::Arch;
use rayon::prelude::*;
use std::sync::Arc;

/// Factors in the precision `T` of matrices of `B` x `B` blocks.
pub(crate) struct Multifrontal<T, const B: usize> {
    symbolic: Arc<Symbolic>,
    /// Per subtree: its children's, then its own panel [A; C].
    panels: Vec<T>,
    /// Per subtree: its own rows B, then those of its children from the last to the first. So the backward substitution
    /// finds them, as the forward one finds the panels, in the order of the memory, which is what its prefetching is
    /// made for.
    uppers: Vec<T>,
    swaps: Vec<u32>,
    work: Vec<T>,
    /// Factors of rows and columns in the order of elimination.
    scale: Vec<[f64; B]>,
    /// Right-hand side and solution in the order of elimination.
    x: Vec<T>,
    /// What each front sends to, or gets from, the nodes of its ancestors.
    y: Vec<T>,
}

/// The parts of a subtree's memory.
struct Memory<'a, T> {
    panels: &'a mut [T],
    uppers: &'a mut [T],
    swaps: &'a mut [u32],
    work: &'a mut [T],
}

impl<T: Scalar, const B: usize> Multifrontal<T, B> {
    /// Reserves the memory of the factors.
    pub fn new(symbolic: Arc<Symbolic>) -> Self {
        let Totals { pivots, rows, panels, uppers, work, .. } = symbolic.fronts[symbolic.root()].subtree;
        Self {
            symbolic,
            panels: vec![T::default(); panels],
            uppers: vec![T::default(); uppers],
            swaps: vec![0; pivots],
            work: vec![T::default(); work],
            scale: Vec::new(),
            x: vec![T::default(); pivots],
            y: vec![T::default(); rows],
        }
    }

    /// Factors a matrix.
    pub fn factor(&mut self, matrix: &BlockMatrix<B>, scaling: &Scaling) {
        scaling.permuted(&self.symbolic.order, &mut self.scale);
        let task = Factorisation { symbolic: &self.symbolic, matrix, scale: &self.scale };
        let memory = Memory {
            panels: &mut self.panels,
            uppers: &mut self.uppers,
            swaps: &mut self.swaps,
            work: &mut self.work,
        };
        task.subtree(self.symbolic.root(), memory);
    }
}

/// A factorisation on its way.
struct Factorisation<'a, const B: usize> {
    symbolic: &'a Symbolic,
    matrix: &'a BlockMatrix<B>,
    scale: &'a [[f64; B]],
}

impl<const B: usize> Factorisation<'_, B> {
    /// Factors a subtree; its update matrix is left at the beginning of the working memory.
    fn subtree<T: Scalar>(&self, number: usize, memory: Memory<'_, T>) {
        let front = &self.symbolic.fronts[number];
        let (pivots, rows) = (B * front.pivots, B * front.rows.len());
        let (update, work) = memory.work.split_at_mut(rows * rows);
        let (panels, panel) = memory.panels.split_at_mut(memory.panels.len() - pivots * (pivots + rows));
        let (upper, uppers) = memory.uppers.split_at_mut(pivots * rows);
        let (swaps_below, swaps) = memory.swaps.split_at_mut(memory.swaps.len() - pivots);
        let memory = Memory { panels, uppers, swaps: swaps_below, work: &mut *work };
        if front.forks {
            self.children_in_parallel(front, memory)
        } else {
            self.children(front, memory)
        }

        panel.fill(T::default());
        upper.fill(T::default());
        self.add_entries(front, panel, upper);
        let size = [pivots, rows];
        self.each_update(front, work, |child, from| extend_pivots::<T, B>(child, from, size, panel, upper));
        factor_panel(panel, pivots + rows, pivots, swaps);
        solve_upper_rows(panel, pivots + rows, pivots, swaps, upper);
        product(panel, pivots + rows, pivots, upper, update);
        self.each_update(front, work, |child, from| extend_rows::<T, B>(child, from, size, update));
    }

    /// The update matrices that the children of a front have left.
    fn each_update<T>(&self, front: &Front, work: &[T], mut add: impl FnMut(&Front, &[T])) {
        let mut waiting = 0;
        for &child in &front.children {
            let child = &self.symbolic.fronts[child as usize];
            let size = B * child.rows.len();
            add(child, &work[waiting..waiting + size * size]);
            waiting += if front.forks { child.subtree.work } else { size * size };
        }
    }

    /// One child after the other; their update matrices stay in the memory one behind the other.
    fn children<T: Scalar>(&self, front: &Front, memory: Memory<'_, T>) {
        let Memory { mut panels, mut uppers, mut swaps, mut work } = memory;
        for &child in &front.children {
            let totals = self.symbolic.fronts[child as usize].subtree;
            let of_child = Memory {
                panels: panels.split_off_mut(..totals.panels).expect("room for the panels"),
                uppers: uppers.split_off_mut(uppers.len() - totals.uppers..).expect("room for the rows"),
                swaps: swaps.split_off_mut(..totals.pivots).expect("room for the exchanges"),
                work: &mut *work,
            };
            self.subtree(child as usize, of_child);
            let rows = B * self.symbolic.fronts[child as usize].rows.len();
            work = &mut work[rows * rows..];
        }
    }

    /// All children at the same time, each with its own memory.
    fn children_in_parallel<T: Scalar>(&self, front: &Front, memory: Memory<'_, T>) {
        let Memory { mut panels, mut uppers, mut swaps, mut work } = memory;
        let mut tasks = Vec::with_capacity(front.children.len());
        for &child in &front.children {
            let totals = self.symbolic.fronts[child as usize].subtree;
            let memory = Memory {
                panels: panels.split_off_mut(..totals.panels).expect("room for the panels"),
                uppers: uppers.split_off_mut(uppers.len() - totals.uppers..).expect("room for the rows"),
                swaps: swaps.split_off_mut(..totals.pivots).expect("room for the exchanges"),
                work: work.split_off_mut(..totals.work).expect("room to work"),
            };
            tasks.push((child as usize, memory));
        }
        tasks.into_par_iter().for_each(|(child, memory)| self.subtree(child, memory));
    }

    /// Adds the blocks of the matrix that belong to a front, scaled.
    fn add_entries<T: Scalar>(&self, front: &Front, panel: &mut [T], upper: &mut [T]) {
        let (pivots, size) = (B * front.pivots, B * (front.pivots + front.rows.len()));
        let rank = |place: u32| {
            let place = place as usize;
            if place < front.pivots { front.start + place } else { front.rows[place - front.pivots] as usize }
        };
        for entry in &front.entries {
            let block = &self.matrix.values[entry.position as usize];
            let (row, column) = (&self.scale[rank(entry.row)], &self.scale[rank(entry.column)]);
            let (to, height, first) = if (entry.column as usize) < front.pivots {
                (&mut *panel, size, B * entry.column as usize)
            } else {
                (&mut *upper, pivots, B * entry.column as usize - pivots)
            };
            for c in 0..B {
                let at = (first + c) * height + B * entry.row as usize;
                for (r, to) in to[at..at + B].iter_mut().enumerate() {
                    *to = T::from_f64(block[r][c] * row[r] * column[c]);
                }
            }
        }
    }
}

/// Adds what the update matrix of a child has in the rows and columns of the pivots of its parent.
fn extend_pivots<T: Scalar, const B: usize>(
    child: &Front,
    from: &[T],
    [pivots, rows]: [usize; 2],
    panel: &mut [T],
    upper: &mut [T],
) {
    each_run::<T, B>(child, from, |column, row, from| {
        if column < pivots {
            add(&mut panel[column * (pivots + rows) + row..], from);
        } else if row < pivots {
            add(&mut upper[(column - pivots) * pivots + row..], from);
        }
    });
}

/// Adds the rest of it to the update matrix of its parent.
fn extend_rows<T: Scalar, const B: usize>(
    child: &Front,
    from: &[T],
    [pivots, rows]: [usize; 2],
    update: &mut [T],
) {
    each_run::<T, B>(child, from, |column, row, from| {
        if column >= pivots && row >= pivots {
            add(&mut update[(column - pivots) * rows + row - pivots..], from);
        }
    });
}

fn add<T: Scalar>(to: &mut [T], from: &[T]) {
    to.iter_mut().zip(from).for_each(|(to, &from)| *to += from);
}

/// Pieces of the columns of the update matrix of a child, with their column and first row in the parent.
fn each_run<T, const B: usize>(child: &Front, from: &[T], mut visit: impl FnMut(usize, usize, &[T])) {
    let size = B * child.rows.len();
    for columns in &child.runs {
        for k in 0..B * columns.length as usize {
            let from = &from[(B * columns.first as usize + k) * size..][..size];
            let column = B * columns.target as usize + k;
            for run in &child.runs {
                let from = &from[B * run.first as usize..][..B * run.length as usize];
                visit(column, B * run.target as usize, from);
            }
        }
    }
}

impl<T: Scalar, const B: usize> Preconditioner for Multifrontal<T, B> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        let r = r.as_chunks::<B>().0;
        let z = z.as_chunks_mut::<B>().0;
        let order = &self.symbolic.order;
        // Scaled to largest entry one, so that single precision neither overflows nor underflows.
        let mut largest = 0.0f64;
        for (&node, row) in order.iter().zip(&self.scale) {
            for (r, row) in r[node as usize].iter().zip(row) {
                largest = largest.max((r * row).abs());
            }
        }
        if largest == 0.0 {
            return z.as_flattened_mut().fill(0.0);
        }
        for ((x, &node), row) in self.x.as_chunks_mut::<B>().0.iter_mut().zip(order).zip(&self.scale) {
            for ((x, r), row) in x.iter_mut().zip(&r[node as usize]).zip(row) {
                *x = T::from_f64(r * row / largest);
            }
        }
        let solution = Substitution {
            symbolic: &self.symbolic,
            panels: &self.panels,
            uppers: &self.uppers,
            swaps: &self.swaps,
        };
        let root = self.symbolic.root();
        solution.forward::<B>(root, At::default(), &mut self.x, &mut self.y);
        solution.backward::<B>(root, At::default(), &mut self.x, &mut self.y);
        for ((x, &node), column) in self.x.as_chunks::<B>().0.iter().zip(order).zip(&self.scale) {
            for ((z, x), column) in z[node as usize].iter_mut().zip(x).zip(column) {
                *z = x.to_f64() * column * largest;
            }
        }
    }
}

/// Forward and backward substitution over the tree.
struct Substitution<'a, T> {
    symbolic: &'a Symbolic,
    panels: &'a [T],
    uppers: &'a [T],
    swaps: &'a [u32],
}

/// Where the factors and exchanges of a subtree begin.
#[derive(Clone, Copy, Default)]
struct At {
    panels: usize,
    uppers: usize,
    swaps: usize,
}

/// What is done with a child: its number, where its factors begin, its parts of x and y.
type Visit<'a, T> = dyn Fn(usize, At, &mut [T], &mut [T]) + Sync + 'a;

impl<'a, T: Scalar> Substitution<'a, T> {
    /// Eliminates the pivots of a subtree from its right-hand side `x`. The last part of `y`
    /// becomes what is to be added to the right-hand side of the rows of its root.
    fn forward<const B: usize>(&self, number: usize, at: At, x: &mut [T], y: &mut [T]) {
        let front = &self.symbolic.fronts[number];
        let (x_below, x) = x.split_at_mut(x.len() - B * front.pivots);
        let (y_below, y) = y.split_at_mut(y.len() - B * front.rows.len());
        self.each_child::<B, false>(front, at, x_below, y_below, &|child, at, x, y| {
            self.forward::<B>(child, at, x, y);
        });
        y.fill(T::default());
        let mut sent = 0;
        for &child in &front.children {
            let child = &self.symbolic.fronts[child as usize];
            sent += child.subtree.rows;
            let from = &y_below[sent - B * child.rows.len()..sent];
            for run in &child.runs {
                let from = &from[B * run.first as usize..][..B * run.length as usize];
                let target = B * run.target as usize;
                let to = if target < x.len() { &mut x[target..] } else { &mut y[target - x.len()..] };
                to.iter_mut().zip(from).for_each(|(to, &from)| *to += from);
            }
        }
        let (panel, _, swaps) = self.own::<B>(front, at);
        fetch(panel);
        Arch::new().dispatch(Forward { panel, swaps, x, y });
    }

    /// Finds the pivots of a subtree; the last part of `y` holds the solution at the rows of its
    /// root.
    fn backward<const B: usize>(&self, number: usize, at: At, x: &mut [T], y: &mut [T]) {
        let front = &self.symbolic.fronts[number];
        let (x_below, x) = x.split_at_mut(x.len() - B * front.pivots);
        let (y_below, y) = y.split_at_mut(y.len() - B * front.rows.len());
        let (panel, upper, _) = self.own::<B>(front, at);
        fetch(upper);
        Arch::new().dispatch(Backward { panel, upper, x: &mut *x, y: &*y });
        let mut sent = 0;
        for &child in &front.children {
            let child = &self.symbolic.fronts[child as usize];
            sent += child.subtree.rows;
            let to = &mut y_below[sent - B * child.rows.len()..sent];
            for run in &child.runs {
                let to = &mut to[B * run.first as usize..][..B * run.length as usize];
                let target = B * run.target as usize;
                let from = if target < x.len() { &x[target..] } else { &y[target - x.len()..] };
                to.copy_from_slice(&from[..to.len()]);
            }
        }
        self.each_child::<B, true>(front, at, x_below, y_below, &|child, at, x, y| {
            self.backward::<B>(child, at, x, y);
        });
    }

    /// Runs something on every child with its part of the vectors: in parallel where the front forks, else in the order
    /// of the panels or against it, in that of the rows behind them.
    fn each_child<const B: usize, const REVERSED: bool>(
        &self,
        front: &Front,
        mut at: At,
        mut x: &mut [T],
        mut y: &mut [T],
        run: &Visit<T>,
    ) {
        let mut tasks = Vec::with_capacity(front.children.len());
        let mut uppers = at.uppers + front.subtree.uppers;
        for &child in &front.children {
            let of = &self.symbolic.fronts[child as usize].subtree;
            let x = x.split_off_mut(..of.pivots).expect("room for the pivots");
            let y = y.split_off_mut(..of.rows).expect("room for the rows");
            uppers -= of.uppers;
            tasks.push((child as usize, At { uppers, ..at }, x, y));
            at.panels += of.panels;
            at.swaps += of.pivots;
        }
        if front.forks {
            tasks.into_par_iter().for_each(|(child, at, x, y)| run(child, at, x, y));
        } else if REVERSED {
            tasks.into_iter().rev().for_each(|(child, at, x, y)| run(child, at, x, y));
        } else {
            tasks.into_iter().for_each(|(child, at, x, y)| run(child, at, x, y));
        }
    }

    /// Panel, columns behind the pivots and exchanges of the front at the end of a subtree.
    fn own<const B: usize>(&self, front: &Front, at: At) -> (&'a [T], &'a [T], &'a [u32]) {
        let (pivots, rows) = (B * front.pivots, B * front.rows.len());
        let of = &front.subtree;
        let [panels, swaps] = [at.panels + of.panels, at.swaps + of.pivots];
        (
            &self.panels[panels - pivots * (pivots + rows)..panels],
            &self.uppers[at.uppers..at.uppers + pivots * rows],
            &self.swaps[swaps - pivots..swaps],
        )
    }
}

/// Reads one number of each line of the cache. The factors are larger than the cache; these reads wait for nothing, so
/// that many lines are on their way at a time, while those of the substitution itself wait for what they find.
fn fetch<T: Scalar>(factors: &[T]) {
    let line = 64 / size_of::<T>();
    std::hint::black_box(factors.iter().step_by(line).fold(T::default(), |sum, &factor| sum + factor));
}
