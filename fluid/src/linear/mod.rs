//! Linear systems of node blocks.
//!
//! A [`BlockMatrix`] couples the nodes of a mesh; a [`Solver`] is made once per mesh (ordering,
//! symbolic analysis, memory) and solves one system after another, keeping factors where that is
//! cheaper than making new ones. Each answer comes with a [`Report`].
//!
//! # When a system counts as solved
//!
//! Momentum and continuity have different units, and drag makes the momentum rows of one mesh differ by eight orders
//! of magnitude. So each residual r_i = b_i - (A x)_i is first turned into the unit of its own
//! unknown, by the product w_i of the row and the column factor that equilibrate the matrix
//! (w_i = 1/a_ii where the diagonal dominates: what one Jacobi step would change). Then each
//! component c of the node blocks (a velocity, the pressure) is judged by itself:
//!
//! ```text
//! |w r|_c <= tolerance * max(|w b|_c, |w |A||w b||_c / 100)        for every c, 2-norms over the nodes
//! ```
//!
//! Neither a node of large drag nor a large source in another equation can hide an unsolved one.
//! The second reference is for equations whose right-hand side is zero or nearly so, like
//! continuity: w b estimates the sizes of the unknowns, |A||w b| the sizes of the terms that they
//! bring; the terms of a divergence cancel to about h/L of their size even in a field that is not
//! free of divergence, hence the hundred. (A reference made of x itself, as in a backward error,
//! would accept the huge null vector of a singular matrix.) The reported residual is the largest
//! of the quotients, computed from the final x and not from the recurrence of GMRES.

mod dense;
mod dissection;
mod gmres;
mod ilu;
mod lu;
pub mod matrix;
mod multifrontal;
mod norm;
mod product;
mod scaling;
mod separator;
mod solver;
mod symbolic;

pub use matrix::{BlockMatrix, Pattern};
pub use solver::Solver;

/// How systems are solved. Whatever is chosen, what does not converge is handed on: kept factors
/// to fresh ones, single to double precision, and last to [`Method::Lu`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Multifrontal LU in single precision, kept over many systems as preconditioner of GMRES.
    Multifrontal,
    /// Multifrontal LU in double precision, made anew for every system: the safe mode.
    MultifrontalFresh,
    /// Incomplete LU of node blocks without fill, made anew for every system, with GMRES.
    Ilu,
    /// Sparse LU of faer with pivoting over whole columns: the fallback and the oracle.
    Lu,
}

/// Choices of a [`Solver`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Options {
    /// How systems are solved.
    pub method: Method,
    /// Relative residual, in the norm described in the module documentation.
    pub tolerance: f64,
    /// Largest number of GMRES iterations with one set of factors.
    pub max_iterations: usize,
    /// Iterations after which GMRES drops its basis.
    pub restart: usize,
    /// Iterations with kept factors after which new ones are made: for the next system, or at once
    /// when the rate of convergence promises more than half as many again. About the time of a
    /// factorisation in that of an iteration.
    pub refactor_after: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::Multifrontal,
            tolerance: 1e-8,
            max_iterations: 300,
            restart: 50,
            refactor_after: 10,
        }
    }
}

/// What a solution cost and how good it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// GMRES iterations, over all attempts.
    pub iterations: usize,
    /// True relative residual, in the norm described in the module documentation.
    pub residual: f64,
    /// Whether factors were made (rather than only kept ones used).
    pub factored: bool,
    /// The method that gave the answer; another one than that of the options is a fallback.
    pub method: Method,
}

#[cfg(test)]
pub(crate) mod sample;
#[cfg(test)]
mod tests;
