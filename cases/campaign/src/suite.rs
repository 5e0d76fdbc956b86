//! The options that commands with many runs share.

use clap::Args;
use std::path::PathBuf;

/// How much time a point may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Seconds: coarse meshes, few points; what is allowed is that of coarse meshes.
    Quick,
    /// Minutes: what is claimed.
    Full,
}

impl Effort {
    /// The first of two choices when quick, else the second.
    pub fn pick<T>(self, quick: T, full: T) -> T {
        match self {
            Self::Quick => quick,
            Self::Full => full,
        }
    }
}

/// How much is run, where results go, and what is said.
#[derive(Args)]
pub struct Suite {
    /// The short form: coarse, few points.
    #[arg(long)]
    pub quick: bool,
    /// Folder of results. Default: `out/` and the name of the command or study, with `-quick` in the short form.
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
    /// The form that is run.
    pub fn effort(&self) -> Effort {
        if self.quick { Effort::Quick } else { Effort::Full }
    }

    /// The folder of results, or the default; the short form, which has other points, has another one.
    pub fn folder(&self, default: &str) -> PathBuf {
        let form = if self.quick { "-quick" } else { "" };
        self.out.clone().unwrap_or_else(|| format!("{default}{form}").into())
    }
}
