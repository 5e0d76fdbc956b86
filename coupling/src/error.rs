//! What can go wrong between a scene file and the last frame of its run.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fmt, io, ops::Range};

/// What is wrong, and what helps.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Notice {
    /// What is wrong, where, and what is allowed.
    pub what: String,
    /// What to do; empty where nothing is known that helps.
    pub help: String,
}

/// Between the two in a text.
const HELP: &str = "\n  help: ";

impl Notice {
    /// A notice with help.
    pub fn new(what: impl Into<String>, help: impl Into<String>) -> Self {
        Self { what: what.into(), help: help.into() }
    }

    /// A notice as another process has written it.
    pub fn read(text: &str) -> Self {
        let (what, help) = text.split_once(HELP).unwrap_or((text, ""));
        Self::new(what, help)
    }

    /// The same with where it happened before what is wrong.
    pub fn within(self, place: impl fmt::Display) -> Self {
        Self { what: format!("{place}: {}", self.what), ..self }
    }
}

impl<T: Into<String>> From<T> for Notice {
    fn from(what: T) -> Self {
        Self::new(what, "")
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.what)?;
        if self.help.is_empty() { Ok(()) } else { write!(f, "{HELP}{}", self.help) }
    }
}

/// Errors of the coupling. Non-convergence is part of a result and not an error.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene is wrong; the place in its file is known.
    #[error("{0}")]
    Scene(Box<SceneError>),
    /// Another input (a restart file, a directory, an option) is wrong; the text says what is allowed.
    #[error("{0}")]
    Input(Notice),
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
    /// After a step grains are further in each other or in walls than the scene allows; the state is that of the end of
    /// the step.
    #[error("{0}")]
    Penetration(Notice),
    /// Whoever watched asked for an end before the first step.
    #[error("interrupted while grains were placed")]
    Interrupted,
    /// The run cannot go on.
    #[error("{0}")]
    Run(Notice),
}

/// What can go wrong with a process at the other end of a channel.
#[derive(Debug, thiserror::Error)]
#[error("{}", self.notice())]
pub enum PeerError {
    /// It has ended, or was killed.
    Gone,
    /// It is there and says nothing.
    Silent {
        /// How long, s.
        seconds: f64,
    },
    /// It reports an error of its own, in its own words.
    Failed(Notice),
    /// It sent something that is no frame of this protocol.
    Protocol(Notice),
    /// The channel cannot be opened or used.
    Channel(Notice),
}

impl PeerError {
    /// Something that is no frame of this protocol.
    pub fn protocol(notice: impl Into<Notice>) -> Self {
        Self::Protocol(notice.into())
    }

    /// A channel that cannot be opened or used.
    pub fn channel(notice: impl Into<Notice>) -> Self {
        Self::Channel(notice.into())
    }

    /// What a reader is told.
    pub fn notice(&self) -> Notice {
        match self {
            Self::Gone => Notice::new("it is gone", "`voidage doctor` says whether a solver can start here"),
            Self::Silent { seconds } => Notice::new(
                format!(
                    "it has been silent for {seconds} s: it hangs, or a step takes longer than the time-out"
                ),
                "`--timeout S` allows S seconds without a sign of life",
            ),
            Self::Failed(notice) => notice.clone().within("it reports"),
            Self::Protocol(notice) => {
                notice.clone().within("it sent what this version of voidage does not understand")
            }
            Self::Channel(notice) => notice.clone(),
        }
    }
}

/// Result of the coupling.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// Whether the input is wrong (exit code 2) rather than the run (exit code 1).
    pub fn is_input(&self) -> bool {
        matches!(self, Error::Scene(_) | Error::Input(_) | Error::Grains(_))
    }

    /// A wrong input.
    pub fn input(notice: impl Into<Notice>) -> Self {
        Error::Input(notice.into())
    }

    /// A run that cannot go on.
    pub fn run(notice: impl Into<Notice>) -> Self {
        Error::Run(notice.into())
    }

    /// What a reader is told; of a scene without its place.
    pub fn notice(&self) -> Notice {
        match self {
            Error::Scene(error) => error.notice.clone(),
            Error::Input(notice) | Error::Penetration(notice) | Error::Run(notice) => notice.clone(),
            Error::Peer(error) => error.notice(),
            Error::Fluid(_) | Error::Grains(_) | Error::File { .. } | Error::Interrupted => {
                self.to_string().into()
            }
        }
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
pub enum Location {
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
    pub location: Location,
    /// What is wrong, with the key and the value, and what is allowed.
    pub notice: Notice,
}

impl std::error::Error for SceneError {}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match &self.location {
            Location::File { line, column, .. } => write!(f, "{}:{line}:{column}: ", self.file.display())?,
            Location::Set(option) => write!(f, "{}: --set {option}: ", self.file.display())?,
        }
        self.notice.fmt(f)
    }
}
