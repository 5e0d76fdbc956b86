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

/// A number for reading, with nine significant digits at most: the sum of 0.1 and 0.2 is shown as 0.3.
#[derive(Clone, Copy, Debug)]
pub struct Rounded(pub f64);

impl std::fmt::Display for Rounded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let rounded: f64 = format!("{:.8e}", self.0).parse().unwrap_or(self.0);
        write!(f, "{rounded}")
    }
}

#[cfg(test)]
mod tests {
    use super::Rounded;

    #[test]
    fn lengths_in_messages_showed_the_rounding_of_their_sums() {
        assert_eq!(Rounded(0.1 + 0.2).to_string(), "0.3");
        assert_eq!(Rounded(-0.044_000_000_000_000_004).to_string(), "-0.044");
        assert_eq!(Rounded(0.0).to_string(), "0");
        assert_eq!(Rounded(f64::NAN).to_string(), "NaN");
    }
}
