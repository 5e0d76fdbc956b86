//! `voidage validate`: experiments that were measured, run again.
//!
//! A case is one file: its scenes, the measured data and the findings. The page of this folder says what was fixed before
//! the first run and what was not.

mod collapse;
mod fields;
mod measured;
mod sedimentation;

use tracing::info;
use voidage_coupling::Result;
use voidage_verification::{Case, Options, solve_all};

/// All experiments, in the order in which they run.
pub const CASES: &[Case] = &[sedimentation::CASE, collapse::LOOSE, collapse::DENSE];

/// Runs the experiments; exit code 1 if a finding is outside of what is allowed.
///
/// # Errors
/// Unknown names, files that cannot be written.
pub fn validate(options: &Options) -> Result<u8> {
    solve_all("validation", CASES, options)
}

/// Says at every tenth of a run how far it is; `step` is that which has just been done.
fn said(name: &str, step: u64, steps: u64, time: f64) {
    if steps >= 100 && step * 10 / steps > (step - 1) * 10 / steps {
        info!("{name}: step {step} of {steps}, t = {time:.4} s");
    }
}
