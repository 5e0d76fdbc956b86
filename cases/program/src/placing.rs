//! What a run shows and does while its grains are placed.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use tracing::{info, warn};
use voidage_campaign::progress::Progress;
use voidage_dem::packing;
use voidage_scene::placing::{Bed, Placing};

/// Shows how far the grains are, ends when interrupted, and keeps beds in the folder of the run, if there is one.
pub fn watched<'a>(folder: Option<&Path>, interrupted: &'a AtomicBool, quiet: bool) -> Placing<'a> {
    let mut shown: Option<(usize, bool, Progress)> = None;
    Placing::new(folder, move |group, progress| {
        if interrupted.load(Ordering::Relaxed) {
            return ControlFlow::Break(());
        }
        let (settles, done, of) = match progress {
            packing::Progress::Placing { done, of } => (false, done, of),
            packing::Progress::Settling { step, of, .. } => (true, step, of),
        };
        if shown.as_ref().is_none_or(|(last, was, _)| (*last, *was) != (group, settles)) {
            // The bar before goes first.
            drop(shown.take());
            let unit = if settles { "settling, step" } else { "placing grains," };
            shown = Some((group, settles, Progress::open(unit, of as u64, quiet)));
        }
        if let Some((.., bar)) = &mut shown {
            bar.tell_at_times(done as u64, || match progress {
                packing::Progress::Placing { .. } => format!("grains[{group}]"),
                packing::Progress::Settling { speed, .. } => {
                    format!("grains[{group}], root mean square speed {speed:.1e} m/s")
                }
            });
        }
        ControlFlow::Continue(())
    })
}

/// What a table of grains has that is not used, a line each.
pub fn unused(placing: &Placing<'_>) -> Vec<String> {
    let tables = placing.unused.iter();
    tables
        .map(|(file, columns)| format!("{}: columns not used: {}", file.display(), columns.join(", ")))
        .collect()
}

/// Says how the beds came out.
pub fn tell(beds: &[Bed]) {
    for bed in beds {
        match bed.at_rest {
            Some(false) => warn!("{bed}"),
            _ => info!("{bed}"),
        }
    }
}
