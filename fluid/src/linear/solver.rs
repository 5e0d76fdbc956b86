//! The solver: which factors are used when, and what happens when they do not suffice.

use super::gmres::{Gmres, Limits};
use super::lu::SparseLu;
use super::matrix::{BlockMatrix, Pattern};
use super::norm::{Norm, is_finite};
use super::scaling::Scaling;
use super::{Method, Options, Report};
use crate::{Error, Result, Vector};
use std::sync::Arc;

/// Iterations allowed with double precision factors of the matrix itself: these need one or two,
/// more only when the matrix is nearly singular.
const REFINEMENTS: usize = 10;

/// Solves one system after another on one pattern.
///
/// Kept factors are a hidden state: two runs give the same bits if they solve the same systems
/// since the last [`Solver::forget`].
pub struct Solver<const B: usize> {
    pattern: Arc<Pattern>,
    options: Options,
    scaling: Scaling,
    norm: Norm,
    gmres: Gmres,
    lu: Option<SparseLu>,
    /// Whether `lu` holds factors of an earlier matrix that are good enough to start with.
    kept: bool,
}

/// One way to precondition, in the order in which they are tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Attempt {
    Kept,
    Lu,
}

impl<const B: usize> Solver<B> {
    /// A solver for matrices on a pattern whose nodes are at `points`; the points only steer the
    /// ordering and may move later.
    ///
    /// # Panics
    /// If the number of points is not the number of nodes.
    pub fn new<const D: usize>(pattern: Arc<Pattern>, points: &[Vector<D>], options: Options) -> Self {
        assert_eq!(points.len(), pattern.nodes(), "one point per node");
        Self {
            pattern,
            options,
            scaling: Scaling::default(),
            norm: Norm::default(),
            gmres: Gmres::default(),
            lu: None,
            kept: false,
        }
    }

    /// The choices made at the beginning.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Drops kept factors. A run that continues from a checkpoint equals the one that wrote it bit
    /// for bit if both call this there.
    pub fn forget(&mut self) {
        self.kept = false;
    }

    /// Solves A x = b; x holds the initial guess on entry. An error if no method reaches the
    /// tolerance (x is then the best attempt), if the matrix is singular or not finite, or if b is not finite.
    ///
    /// # Panics
    /// If the matrix is not on the pattern of the solver or the lengths do not fit.
    pub fn solve(&mut self, matrix: &BlockMatrix<B>, rhs: &[f64], x: &mut [f64]) -> Result<Report> {
        assert!(
            Arc::ptr_eq(&matrix.pattern, &self.pattern) || *matrix.pattern == *self.pattern,
            "the matrix is on another pattern than the solver"
        );
        assert_eq!(rhs.len(), matrix.unknowns(), "length of the right-hand side");
        assert_eq!(x.len(), matrix.unknowns(), "length of the solution");
        if !is_finite(rhs) {
            return Err(Error::Linear("the right-hand side is not finite".into()));
        }
        self.scaling.update(matrix)?;
        self.norm.update(matrix, &self.scaling, rhs);
        if !is_finite(x) || rhs.iter().all(|&b| b == 0.0) {
            x.fill(0.0);
        }
        let mut report =
            Report { iterations: 0, residual: 0.0, factored: false, method: self.options.method };
        for attempt in self.attempts() {
            self.attempt(attempt, matrix, rhs, x, &mut report)?;
            if report.residual <= self.options.tolerance {
                return Ok(report);
            }
        }
        let residual = report.residual;
        Err(Error::Linear(format!(
            "the linear system is singular or nearly so: no method reached a relative residual below {residual:.1e}"
        )))
    }

    fn attempts(&self) -> Vec<Attempt> {
        if self.kept { vec![Attempt::Kept, Attempt::Lu] } else { vec![Attempt::Lu] }
    }

    fn attempt(
        &mut self,
        attempt: Attempt,
        matrix: &BlockMatrix<B>,
        rhs: &[f64],
        x: &mut [f64],
        report: &mut Report,
    ) -> Result<()> {
        let lu = match &mut self.lu {
            Some(lu) => lu,
            empty => empty.insert(SparseLu::new::<B>(&self.pattern)?),
        };
        let iterations = if attempt == Attempt::Lu {
            self.kept = false;
            lu.factor(matrix, &self.scaling)?;
            report.factored = true;
            self.kept = self.options.method != Method::Lu && self.options.method != Method::MultifrontalFresh;
            REFINEMENTS
        } else {
            3 * self.options.refactor_after / 2
        };
        let before = report.iterations;
        let options = self.options;
        let limits = Limits { tolerance: options.tolerance, iterations, restart: options.restart };
        report.iterations += self.gmres.solve(matrix, &self.norm.weights, rhs, x, lu, limits);
        report.residual = self.norm.residual(matrix, rhs, x);
        if report.iterations - before > options.refactor_after {
            self.kept = false;
        }
        Ok(())
    }
}
