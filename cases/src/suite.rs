//! The options that commands with many runs share.

use clap::Args;
use std::path::PathBuf;

/// How much is run, where results go, and what is said.
#[derive(Args)]
pub struct Suite {
    /// The short form: coarse, few points.
    #[arg(long)]
    pub quick: bool,
    /// Folder of results. Default: `out/` and the name of the command or study.
    #[arg(long)]
    out: Option<PathBuf>,
    /// List what would be run, and stop.
    #[arg(long)]
    pub list: bool,
    /// Number of threads; results do not depend on it. Default: one per core, in a study one.
    #[arg(long)]
    pub threads: Option<usize>,
    /// No progress, only warnings and results.
    #[arg(long)]
    pub quiet: bool,
}

impl Suite {
    /// The folder of results, or the default.
    pub fn folder(&self, default: &str) -> PathBuf {
        self.out.clone().unwrap_or_else(|| default.into())
    }
}
