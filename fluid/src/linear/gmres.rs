//! Restarted flexible GMRES.

use super::matrix::BlockMatrix;
use rayon::prelude::*;

/// Entries per partial sum of an inner product. Sums are formed per piece and then added in order,
/// so they do not depend on the number of threads.
const PIECE: usize = 4096;

/// When a Gram-Schmidt pass leaves less than this part of a vector, it is repeated: the part that
/// is left carries the round-off of the part that was removed, here at most a factor of ten more.
const REPEAT_BELOW: f64 = 0.1;

/// An approximate inverse.
pub(crate) trait Preconditioner {
    /// z = M^-1 r.
    fn apply(&mut self, r: &[f64], z: &mut [f64]);
}

/// Where GMRES stops.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Largest allowed weighted 2-norm of the residual.
    pub tolerance: f64,
    /// Largest number of iterations, over all restarts.
    pub iterations: usize,
    /// Iterations after which the basis is dropped.
    pub restart: usize,
    /// Whether to stop as soon as the rate of convergence so far promises to need more iterations.
    pub foresee: bool,
}

/// Iterations before the rate of convergence is trusted.
const FORESEE_AFTER: usize = 2;

/// What is solved, and the norm of the residual in which it is.
#[derive(Clone, Copy)]
pub(crate) struct System<'a, const B: usize> {
    pub matrix: &'a BlockMatrix<B>,
    pub rhs: &'a [f64],
    /// The positive weights S of the residuals.
    pub weights: &'a [f64],
}

/// Flexible GMRES with its memory.
///
/// Minimises the weighted 2-norm |S (b - A x)| over x in x_0 + span{z_1 .. z_k}, z_j = M^-1 S^-1 v_j,
/// where v_1 .. v_k is an orthonormal basis built by S A z_j = V h_j. The z_j are stored: at the end
/// of a cycle that saves one application of M, which with exact factors costs as much as an
/// iteration, and M may be slightly non-linear (single precision).
#[derive(Clone, Debug, Default)]
pub(crate) struct Gmres {
    basis: Vec<Vec<f64>>,
    directions: Vec<Vec<f64>>,
    residual: Vec<f64>,
    /// Upper triangle of the Hessenberg matrix after the rotations, one vector per column.
    triangle: Vec<Vec<f64>>,
    rotations: Vec<(f64, f64)>,
    /// Right-hand side of the least-squares problem after the rotations.
    reduced: Vec<f64>,
}

impl Gmres {
    /// Improves x until the limits are met. Stops early when a whole cycle brings less than a
    /// factor of two, or when something is no longer finite; x is then the best known one. Returns
    /// the number of iterations.
    pub fn solve<const B: usize>(
        &mut self,
        system: System<B>,
        x: &mut [f64],
        preconditioner: &mut dyn Preconditioner,
        limits: Limits,
    ) -> usize {
        self.residual.resize(x.len(), 0.0);
        let (mut iterations, mut before) = (0, f64::INFINITY);
        let mut too_slow = false;
        loop {
            system.matrix.residual(system.rhs, x, &mut self.residual);
            scale(&mut self.residual, system.weights);
            let residual = dot(&self.residual, &self.residual).sqrt();
            let stagnant = residual > 0.5 * before || residual.is_nan();
            if residual <= limits.tolerance || iterations >= limits.iterations || stagnant || too_slow {
                return iterations;
            }
            before = residual;
            let steps = limits.restart.min(limits.iterations - iterations);
            let made =
                self.cycle(system, x, preconditioner, residual, Limits { iterations: steps, ..limits });
            iterations += made;
            too_slow = limits.foresee && made < steps && self.reduced[made].abs() > limits.tolerance;
        }
    }

    /// Weighted residual of what the last [`Gmres::solve`] left in x.
    pub fn residual(&self) -> &[f64] {
        &self.residual
    }

    /// One cycle from the weighted residual in `self.residual`, of length `norm`. Returns the number of
    /// iterations; the last entry of `self.reduced` is the residual they are believed to leave.
    fn cycle<const B: usize>(
        &mut self,
        system: System<B>,
        x: &mut [f64],
        preconditioner: &mut dyn Preconditioner,
        norm: f64,
        limits: Limits,
    ) -> usize {
        self.reserve(x.len(), limits.iterations);
        for (v, r) in self.basis[0].iter_mut().zip(&self.residual) {
            *v = r / norm;
        }
        self.rotations.clear();
        self.reduced.clear();
        self.reduced.push(norm);
        for step in 0..limits.iterations {
            for ((r, v), w) in self.residual.iter_mut().zip(&self.basis[step]).zip(system.weights) {
                *r = v / w;
            }
            preconditioner.apply(&self.residual, &mut self.directions[step]);
            let (old, new) = self.basis.split_at_mut(step + 1);
            system.matrix.multiply(&self.directions[step], &mut new[0]);
            scale(&mut new[0], system.weights);
            let below = orthonormalise(old, &mut new[0], &mut self.triangle[step]);
            if !below.is_finite() {
                self.reduced.push(self.reduced[step]);
                self.update(x, step);
                return step + 1;
            }
            self.rotate(step, below);
            let left = self.reduced[step + 1].abs();
            if left <= limits.tolerance || below == 0.0 || is_too_slow(step + 1, norm, left, limits) {
                self.update(x, step + 1);
                return step + 1;
            }
        }
        self.update(x, limits.iterations);
        limits.iterations
    }

    fn reserve(&mut self, unknowns: usize, steps: usize) {
        for vectors in [&mut self.basis, &mut self.directions] {
            if vectors.len() < steps + 1 {
                vectors.resize(steps + 1, Vec::new());
            }
            for vector in &mut vectors[..steps + 1] {
                vector.resize(unknowns, 0.0);
            }
        }
        if self.triangle.len() < steps {
            self.triangle.resize(steps, Vec::new());
        }
    }

    /// Applies the old rotations to the new column of the Hessenberg matrix and adds the one that
    /// removes the entry below the diagonal.
    fn rotate(&mut self, step: usize, below: f64) {
        let column = &mut self.triangle[step];
        for (i, &(c, s)) in self.rotations.iter().enumerate() {
            let (upper, lower) = (column[i], column[i + 1]);
            column[i] = c * upper + s * lower;
            column[i + 1] = c * lower - s * upper;
        }
        let length = column[step].hypot(below);
        let (c, s) = if length == 0.0 { (1.0, 0.0) } else { (column[step] / length, below / length) };
        column[step] = length;
        let last = self.reduced[step];
        self.reduced[step] = c * last;
        self.reduced.push(-s * last);
        self.rotations.push((c, s));
    }

    /// x += sum_j y_j z_j with the triangle times y equal to the reduced right-hand side. A zero on
    /// the diagonal (singular matrix) leaves its direction out.
    fn update(&mut self, x: &mut [f64], steps: usize) {
        for j in (0..steps).rev() {
            let pivot = self.triangle[j][j];
            let y = if pivot == 0.0 { 0.0 } else { self.reduced[j] / pivot };
            self.reduced[j] = y;
            for i in 0..j {
                self.reduced[i] -= self.triangle[j][i] * y;
            }
        }
        for (y, z) in self.reduced[..steps].iter().zip(&self.directions) {
            for (x, z) in x.iter_mut().zip(z) {
                *x += y * z;
            }
        }
    }
}

/// Whether a residual that fell from `norm` to `left` in some iterations will, at this rate, not
/// reach the tolerance in the allowed ones.
fn is_too_slow(iterations: usize, norm: f64, left: f64, limits: Limits) -> bool {
    let gained = (norm / left).ln() / iterations as f64;
    let wanted = (norm / limits.tolerance).ln() / limits.iterations as f64;
    limits.foresee && iterations >= FORESEE_AFTER && gained < wanted
}

/// Removes from `new` its parts along the orthonormal `old` ones, writes these parts to `column`,
/// scales what is left to length one and returns the length it had.
fn orthonormalise(old: &[Vec<f64>], new: &mut [f64], column: &mut Vec<f64>) -> f64 {
    column.clear();
    column.resize(old.len() + 1, 0.0);
    let mut length = dot(new, new).sqrt();
    for _ in 0..2 {
        let before = length;
        let parts: Vec<f64> = old.iter().map(|v| dot(v, new)).collect();
        subtract(old, &parts, new);
        for (sum, part) in column.iter_mut().zip(&parts) {
            *sum += part;
        }
        length = dot(new, new).sqrt();
        if length > REPEAT_BELOW * before {
            break;
        }
    }
    if length > 0.0 {
        new.iter_mut().for_each(|v| *v /= length);
    }
    length
}

/// new -= sum_j parts_j old_j.
fn subtract(old: &[Vec<f64>], parts: &[f64], new: &mut [f64]) {
    new.par_chunks_mut(PIECE).enumerate().for_each(|(piece, new)| {
        let range = piece * PIECE..piece * PIECE + new.len();
        for (v, part) in old.iter().zip(parts) {
            for (new, v) in new.iter_mut().zip(&v[range.clone()]) {
                *new -= part * v;
            }
        }
    });
}

/// Inner product, summed by pieces of fixed size.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (a, b) in a.chunks(PIECE).zip(b.chunks(PIECE)) {
        let mut lanes = [0.0; 8];
        let (a8, b8) = (a.as_chunks::<8>(), b.as_chunks::<8>());
        for (a, b) in a8.0.iter().zip(b8.0) {
            for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
                *lane += a * b;
            }
        }
        let rest: f64 = a8.1.iter().zip(b8.1).map(|(a, b)| a * b).sum();
        sum += lanes.iter().sum::<f64>() + rest;
    }
    sum
}

fn scale(v: &mut [f64], weights: &[f64]) {
    for (v, w) in v.iter_mut().zip(weights) {
        *v *= w;
    }
}
