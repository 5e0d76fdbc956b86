//! What can go wrong between a scene file and the last frame of its run.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fmt, io, ops::Range};

/// Errors of the coupling. Non-convergence is part of a result and not an error.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene is wrong; the place in its file is known.
    #[error("{0}")]
    Scene(Box<SceneError>),
    /// Another input (a restart file, a directory, an option) is wrong; the text says what is allowed.
    #[error("{0}")]
    Input(String),
    /// The fluid could not be made or solved.
    #[error(transparent)]
    Fluid(#[from] voidage_fluid::Error),
    /// The grains could not be made.
    #[error(transparent)]
    Grains(#[from] voidage_dem::Error),
    /// A file could not be read or written.
    #[error("{path}: cannot {action}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What was tried: `read`, `write`, ..
        action: &'static str,
        /// What the system answered.
        source: io::Error,
    },
    /// The process at the other end of a channel.
    #[error(transparent)]
    Peer(#[from] PeerError),
    /// After a step grains are further in each other or in walls than the scene allows; the state is that of the end of the step.
    #[error("{0}")]
    Penetration(String),
    /// Whoever watched asked for an end before the first step.
    #[error("interrupted while grains were placed")]
    Interrupted,
    /// The run cannot go on.
    #[error("{0}")]
    Run(String),
}

/// What can go wrong with a process at the other end of a channel.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// It has ended, or was killed.
    #[error("it is gone\n  help: `voidage doctor` says whether a solver can start here")]
    Gone,
    /// It is there and says nothing.
    #[error(
        "it has been silent for {seconds} s: it hangs, or a step takes longer than the time-out\n  \
         help: `--timeout S` allows S seconds without a sign of life"
    )]
    Silent {
        /// How long, s.
        seconds: f64,
    },
    /// It reports an error of its own, in its own words.
    #[error("it reports: {0}")]
    Failed(String),
    /// It sent something that is no frame of this protocol.
    #[error("it sent what this version of voidage does not understand: {0}")]
    Protocol(String),
    /// The channel cannot be opened or used; the text says why and what to do.
    #[error("{0}")]
    Channel(String),
}

/// Result of the coupling.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// Whether the input is wrong (exit code 2) rather than the run (exit code 1).
    pub fn is_input(&self) -> bool {
        matches!(self, Error::Scene(_) | Error::Input(_) | Error::Grains(_))
    }

    /// An error of the file system at `path`.
    pub fn file(path: &Path, action: &'static str, source: io::Error) -> Self {
        Error::File { path: path.to_path_buf(), action, source }
    }
}

impl From<Box<SceneError>> for Error {
    fn from(error: Box<SceneError>) -> Self {
        Error::Scene(error)
    }
}

/// The place of an error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// In the file.
    File {
        /// Bytes of the text, for underlining.
        span: Range<usize>,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
    },
    /// In an option `--set`, as typed.
    Set(String),
}

/// What is wrong in a scene, where, and what to do.
#[derive(Clone, Debug)]
pub struct SceneError {
    /// The file of the scene.
    pub file: PathBuf,
    /// Its text.
    pub text: Arc<str>,
    /// Where.
    pub place: Place,
    /// What is wrong: names the key and the value.
    pub message: String,
    /// What is allowed.
    pub help: String,
}

impl std::error::Error for SceneError {}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match &self.place {
            Place::File { line, column, .. } => write!(f, "{}:{line}:{column}: ", self.file.display())?,
            Place::Set(option) => write!(f, "{}: --set {option}: ", self.file.display())?,
        }
        f.write_str(&self.message)?;
        if !self.help.is_empty() {
            write!(f, "\n  help: {}", self.help)?;
        }
        Ok(())
    }
}
