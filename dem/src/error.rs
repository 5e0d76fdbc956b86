//! What can go wrong with grains.

/// Errors of the grains. A step that does not converge is no error: it is part of [`StepReport`](crate::StepReport).
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A value that has no meaning; the text names it and what is allowed.
    #[error("{what}: {value} is not allowed, {allowed}")]
    Value {
        /// Which quantity, with its index.
        what: String,
        /// The value found.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// Something does not fit together: lengths of columns, unknown materials, a region too small.
    #[error("{0}")]
    Scene(String),
    /// A table of grains that cannot be read.
    #[error("{file}, line {line}: {message}")]
    Table {
        /// Path as given.
        file: String,
        /// Line, counted from 1.
        line: u64,
        /// What was found and what is allowed.
        message: String,
    },
    /// A part that exists in the plane only.
    #[error("{0} exists in two dimensions only")]
    PlaneOnly(&'static str),
    /// Whoever watched asked for an end.
    #[error("interrupted while grains were placed")]
    Interrupted,
}

/// Result of the grains.
pub type Result<T> = std::result::Result<T, Error>;

/// `value`, or an error that says what is allowed.
pub(crate) fn check(
    good: bool,
    value: f64,
    allowed: &'static str,
    what: impl FnOnce() -> String,
) -> Result<()> {
    if good { Ok(()) } else { Err(Error::Value { what: what(), value, allowed }) }
}
