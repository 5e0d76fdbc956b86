//! What can go wrong in the fluid.

/// Errors of the fluid; non-convergence is part of a result and not an error.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The mesh cannot be made or read; the text says why and what is allowed.
    #[error("{0}")]
    Mesh(String),
    /// The linear system has no solution to the asked accuracy.
    #[error("{0}")]
    Linear(String),
}

/// Result of the fluid.
pub type Result<T> = std::result::Result<T, Error>;
