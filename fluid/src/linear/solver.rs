//! The solver: which factors are used when, and what happens when they do not suffice.

use super::dissection::dissect;
use super::gmres::{Gmres, Limits, Preconditioner, System};
use super::ilu::Ilu;
use super::lu::SparseLu;
use super::matrix::{BlockMatrix, Pattern};
use super::multifrontal::Multifrontal;
use super::norm::{Norm, is_finite};
use super::scaling::Scaling;
use super::symbolic::Symbolic;
use super::{Method, Options, Report};
use crate::{Error, Result, Vector};
use std::sync::Arc;

/// Iterations allowed with factors of the matrix itself: these need one or two in double and two to
/// four in single precision, more only when the matrix is nearly singular.
const REFINEMENTS: usize = 20;

/// Where terms cancel, rounding errors are large beside the right-hand side; where they leave more than this relative
/// residual, the solution is so large that the matrix must be singular or nearly so.
const NEARLY_SINGULAR: f64 = 1e-6;

/// Pieces that the dissection does not cut further, in unknowns.
const LEAF: usize = 36;

/// Solves one system after another on one pattern.
///
/// Kept factors are a hidden state: two runs give the same bits if they solve the same systems
/// since the last [`Solver::forget`].
pub struct Solver<const B: usize> {
    pattern: Arc<Pattern>,
    options: Options,
    /// Coordinates along which the dissection may cut.
    directions: Vec<Vec<f64>>,
    scaling: Scaling,
    norm: Norm,
    gmres: Gmres,
    factors: Factors<B>,
    /// Whether `factors.single` are of an earlier matrix and good enough to start with.
    kept: bool,
    staleness: Staleness,
}

/// How soon kept factors went stale: where the matrix changes too much from one system to the next, trying
/// the old ones wastes iterations, so the next tries come after 4, 16, 32, 32 .. systems.
#[derive(Clone, Copy, Debug, Default)]
struct Staleness {
    /// Systems to solve with new factors before the old ones are tried again.
    pause: u32,
    /// Length of the last pause.
    last: u32,
}

/// Longest pause between two tries of kept factors, in systems.
const LONGEST_PAUSE: u32 = 32;

/// What has been made so far; each is made when it is first needed.
#[derive(Default)]
struct Factors<const B: usize> {
    symbolic: Option<Arc<Symbolic>>,
    single: Option<Multifrontal<f32, B>>,
    double: Option<Multifrontal<f64, B>>,
    ilu: Option<Ilu<B>>,
    lu: Option<SparseLu>,
}

/// One way to precondition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Attempt {
    Kept,
    Single,
    Double,
    Ilu,
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
            directions: directions(points),
            scaling: Scaling::default(),
            norm: Norm::default(),
            gmres: Gmres::default(),
            factors: Factors { symbolic: None, single: None, double: None, ilu: None, lu: None },
            kept: false,
            staleness: Staleness::default(),
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
        self.staleness = Staleness::default();
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
        self.scaling.update(matrix)?;
        if !self.norm.update(matrix, &self.scaling, rhs) {
            return Err(Error::Linear("the matrix or the right-hand side is not finite".into()));
        }
        if !is_finite(x) || rhs.iter().all(|&b| b == 0.0) {
            x.fill(0.0);
        }
        let mut report =
            Report { iterations: 0, residual: 0.0, factored: false, method: self.options.method };
        for &attempt in self.attempts() {
            self.attempt(attempt, matrix, rhs, x, &mut report)?;
            if report.residual <= self.options.tolerance {
                return Ok(report);
            }
            let as_good_as_can_be = attempt != Attempt::Kept
                && report.residual <= NEARLY_SINGULAR
                && report.residual <= self.norm.round_off(matrix, rhs, x);
            if as_good_as_can_be {
                return Ok(report);
            }
        }
        let residual = report.residual;
        Err(Error::Linear(format!(
            "the linear system is singular or nearly so: no method reached a relative residual below {residual:.1e}"
        )))
    }

    /// What is tried, in this order.
    fn attempts(&self) -> &'static [Attempt] {
        match self.options.method {
            Method::Multifrontal if self.kept && self.staleness.pause == 0 => {
                &[Attempt::Kept, Attempt::Single, Attempt::Double, Attempt::Lu]
            }
            Method::Multifrontal => &[Attempt::Single, Attempt::Double, Attempt::Lu],
            Method::MultifrontalFresh => &[Attempt::Double, Attempt::Lu],
            Method::Ilu => &[Attempt::Ilu, Attempt::Single, Attempt::Double, Attempt::Lu],
            Method::Lu => &[Attempt::Lu],
        }
    }

    fn attempt(
        &mut self,
        attempt: Attempt,
        matrix: &BlockMatrix<B>,
        rhs: &[f64],
        x: &mut [f64],
        report: &mut Report,
    ) -> Result<()> {
        let options = self.options;
        let (method, iterations) = match attempt {
            Attempt::Kept => (Method::Multifrontal, 3 * options.refactor_after / 2),
            Attempt::Single => (Method::Multifrontal, REFINEMENTS),
            Attempt::Double => (Method::MultifrontalFresh, REFINEMENTS),
            Attempt::Ilu => (Method::Ilu, options.max_iterations),
            Attempt::Lu => (Method::Lu, REFINEMENTS),
        };
        let limits = Limits {
            tolerance: options.tolerance,
            iterations,
            restart: options.restart.max(1),
            foresee: attempt == Attempt::Kept,
        };
        let factors = self.factors.get(attempt, matrix, &self.scaling, &self.directions)?;
        let system = System { matrix, rhs, weights: &self.norm.weights };
        let iterations = self.gmres.solve(system, x, factors, limits);
        report.method = method;
        report.factored |= attempt != Attempt::Kept;
        report.iterations += iterations;
        report.residual = Norm::relative::<B>(self.gmres.residual());
        let solved = report.residual <= options.tolerance;
        self.kept = matches!(attempt, Attempt::Kept | Attempt::Single)
            && iterations <= options.refactor_after
            && solved;
        self.staleness.note(attempt, solved);
        Ok(())
    }
}

impl Staleness {
    fn note(&mut self, attempt: Attempt, solved: bool) {
        match attempt {
            Attempt::Kept if solved => self.last = 0,
            Attempt::Kept => {
                self.last = (4 * self.last).clamp(4, LONGEST_PAUSE);
                // The system at hand is solved with new factors as well.
                self.pause = self.last + 1;
            }
            _ => self.pause = self.pause.saturating_sub(1),
        }
    }
}

impl<const B: usize> Factors<B> {
    /// The factors for an attempt, made of the matrix unless kept ones are wanted.
    fn get(
        &mut self,
        attempt: Attempt,
        matrix: &BlockMatrix<B>,
        scaling: &Scaling,
        directions: &[Vec<f64>],
    ) -> Result<&mut dyn Preconditioner> {
        let pattern = &matrix.pattern;
        match attempt {
            Attempt::Kept => Ok(self.single.as_mut().expect("kept factors exist")),
            Attempt::Single => {
                let symbolic = self.symbolic(pattern, directions);
                let single = self.single.get_or_insert_with(|| Multifrontal::new(symbolic));
                single.factor(matrix, scaling);
                Ok(single)
            }
            Attempt::Double => {
                let symbolic = self.symbolic(pattern, directions);
                let double = self.double.get_or_insert_with(|| Multifrontal::new(symbolic));
                double.factor(matrix, scaling);
                Ok(double)
            }
            Attempt::Ilu => {
                let ilu = self.ilu.get_or_insert_with(|| Ilu::new(pattern));
                ilu.factor(matrix, scaling);
                Ok(ilu)
            }
            Attempt::Lu => {
                let lu = match &mut self.lu {
                    Some(lu) => lu,
                    empty => empty.insert(SparseLu::new::<B>(pattern)?),
                };
                lu.factor(matrix, scaling)?;
                Ok(lu)
            }
        }
    }

    fn symbolic(&mut self, pattern: &Pattern, directions: &[Vec<f64>]) -> Arc<Symbolic> {
        let make = || {
            let dissection = dissect(pattern, directions, LEAF.div_ceil(B));
            Arc::new(Symbolic::new(pattern, &dissection, B))
        };
        self.symbolic.get_or_insert_with(make).clone()
    }
}

/// Coordinates along which straight cuts are tried: the axes, and in the plane the diagonals, each
/// two places from the one that it is perpendicular to.
fn directions<const D: usize>(points: &[Vector<D>]) -> Vec<Vec<f64>> {
    let along = |normal: &dyn Fn(&Vector<D>) -> f64| points.iter().map(normal).collect::<Vec<_>>();
    let mut axes: Vec<_> = (0..D).map(|d| along(&|x| x[d])).collect();
    if D == 2 {
        axes.insert(1, along(&|x| x.sum()));
        axes.push(along(&|x| x[0] - x[1]));
    }
    axes
}
