//! `voidage stability`: the map of what is stable, for every coupling scheme, against theory where there is one.

mod axis;
mod bed;
mod modes;

pub use axis::{Axis, Sample, Verdict};

use crate::verify::Effort;
use clap::Args;
use voidage_coupling::Result;
use voidage_coupling::scheme::SchemeName;

/// Options of `voidage stability`.
#[derive(Args)]
pub struct Options {
    /// Few points of each axis.
    #[arg(long)]
    quick: bool,
    /// Only the axis of this name (may be repeated).
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
}

/// All axes.
pub fn axes() -> Vec<Axis> {
    [modes::AXES, bed::AXES].concat()
}

/// Runs the map.
///
/// # Errors
/// Unknown names, files that cannot be written.
pub fn stability(options: &Options) -> Result<u8> {
    let effort = if options.quick { Effort::Quick } else { Effort::Full };
    for axis in axes() {
        if !options.only.is_empty() && !options.only.iter().any(|name| name == axis.name) {
            continue;
        }
        println!("{}: {}", axis.name, axis.title);
        for scheme in SchemeName::ALL {
            if std::env::var("SCHEME").is_ok_and(|name| name != format!("{scheme:?}")) { continue; }
            for point in (axis.points)(effort) {
                let theory = (axis.theory)(point, scheme);
                match (axis.run)(point, scheme, effort) {
                    Ok(s) => println!("{scheme:?} {point:?} {:?} measured {:.5e} expected {:.5e} theory {theory:?} solves {:.2}", s.verdict, s.measured, s.expected, s.solves),
                    Err(error) => println!("{scheme:?} {point:?} {error}"),
                }
            }
        }
    }
    Ok(0)
}
