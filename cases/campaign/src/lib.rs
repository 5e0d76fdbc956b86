//! What commands with many runs share.
//!
//! A campaign is a list of points. [`points::run`] does those that are not in its [`table::Table`] yet, one after the
//! other or as many at once as there are threads; each is on disk when it ends, so that a campaign that was stopped
//! goes on behind its last point. `voidage verify`, `voidage stability` and `voidage study` are campaigns; they differ
//! in what a point is and what is made of the table.

pub mod clock;
pub mod plot;
pub mod points;
pub mod process;
pub mod progress;
pub mod shipped;
pub mod suite;
pub mod table;

pub use suite::{Effort, Suite};

use voidage_coupling::Notice;
use voidage_coupling::scheme::SchemeName;

/// The larger of two values, or what is no number: `f64::max` drops it, and a finding that should fail passes.
pub fn worse(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// The largest size of some values; no number if one is none.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().map(f64::abs).fold(0.0, worse)
}

/// A coupling scheme by its name on a command line; a file of one's own is beside the current folder.
///
/// # Errors
/// There is no such scheme.
pub fn scheme(name: &str) -> std::result::Result<SchemeName, String> {
    let scheme: SchemeName = name.parse().map_err(|notice: Notice| notice.to_string())?;
    Ok(std::env::current_dir().map_or(scheme, |folder| scheme.within(&folder)))
}

#[cfg(test)]
mod tests {
    use super::largest;

    #[test]
    fn what_is_no_number_is_not_dropped() {
        assert_eq!(largest([1.0, -3.0, 2.0]), 3.0);
        assert_eq!(largest([]), 0.0);
        for values in [[f64::NAN, 1.0, 2.0], [1.0, f64::NAN, 2.0], [1.0, 2.0, f64::NAN]] {
            assert!(largest(values).is_nan());
        }
    }
}
