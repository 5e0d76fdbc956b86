//! Where a scene came from, and errors that point into it.

use super::document::Fault;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::de::{DeTable, DeValue};
use voidage_coupling::error::{Location, Notice, SceneError};

/// The text that a scene was read from and the changes made to it by `--set`.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The file.
    pub(super) file: PathBuf,
    /// Its text.
    pub(super) text: Arc<str>,
    /// Changes: canonical path, and the option as typed.
    pub(super) sets: Vec<(String, String)>,
}

impl Origin {
    /// The file of the scene.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The folder that paths in the scene start from.
    pub fn folder(&self) -> &Path {
        self.file.parent().unwrap_or(Path::new(""))
    }

    /// An error at a key such as `grains[1].radius.uniform[0]`; a key that the file does not have (a default) leads
    /// to the nearest table around it.
    pub fn error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> Box<SceneError> {
        let set = self.sets.iter().rev().find(|(set, _)| {
            path.strip_prefix(set.as_str())
                .is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
        });
        match set {
            Some((_, option)) => self.at(Location::Set(option.clone()), message, help),
            None => self.at(self.location(locate(&self.text, &segments(path), false)), message, help),
        }
    }

    /// What is wrong in the table of the text: at the value, or at a key that there is not.
    pub(super) fn fault(&self, fault: Fault) -> Box<SceneError> {
        let span = locate(&self.text, &segments(&fault.path), fault.unknown);
        self.error_at(span, fault.notice.what, fault.notice.help)
    }

    /// An error at some bytes of the text.
    pub(super) fn error_at(
        &self,
        span: Range<usize>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> Box<SceneError> {
        self.at(self.location(span), message, help)
    }

    /// An error at a known place.
    pub(super) fn at(
        &self,
        location: Location,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> Box<SceneError> {
        let (file, text) = (self.file.clone(), self.text.clone());
        Box::new(SceneError { file, text, location, notice: Notice::new(message, help) })
    }

    fn location(&self, span: Range<usize>) -> Location {
        let before = &self.text[..span.start.min(self.text.len())];
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
        Location::File { span, line, column }
    }
}

/// A step of a path through a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Segment {
    Key(String),
    Index(usize),
}

/// Splits `grains[1].radius` into its steps.
pub(super) fn segments(path: &str) -> Vec<Segment> {
    let mut steps = Vec::new();
    for part in path.split('.').filter(|part| !part.is_empty()) {
        let mut pieces = part.split('[');
        if let Some(key) = pieces.next().filter(|key| !key.is_empty()) {
            steps.push(Segment::Key(key.to_owned()));
        }
        for piece in pieces {
            match piece.trim_end_matches(']').parse() {
                Ok(index) => steps.push(Segment::Index(index)),
                Err(_) => steps.push(Segment::Key(piece.trim_end_matches(']').to_owned())),
            }
        }
    }
    steps
}

/// Writes steps as `grains[1].radius`.
pub(super) fn join(steps: &[Segment]) -> String {
    let mut path = String::new();
    for step in steps {
        match step {
            Segment::Index(index) => path.push_str(&format!("[{index}]")),
            Segment::Key(key) if path.is_empty() => path.push_str(key),
            Segment::Key(key) => path.push_str(&format!(".{key}")),
        }
    }
    path
}

/// The bytes of the deepest step of the path that the text has: the value, or the key where that is asked for or its
/// value is a table. Always inside one line.
fn locate(text: &str, path: &[Segment], of_key: bool) -> Range<usize> {
    let Ok(document) = DeTable::parse(text) else { return 0..0 };
    let mut span = 0..0;
    let mut node = DeValue::Table(document.into_inner());
    for (depth, step) in path.iter().enumerate() {
        let last = depth + 1 == path.len();
        let next = match (step, node) {
            (Segment::Key(key), DeValue::Table(mut table)) => {
                table.remove_entry(key.as_str()).map(|(key, value)| (Some(key.span()), value))
            }
            (Segment::Index(index), DeValue::Array(array)) => {
                array.into_iter().nth(*index).map(|value| (None, value))
            }
            _ => None,
        };
        let Some((key, value)) = next else { break };
        let value_span = value.span();
        span = match key {
            Some(key) if !last || of_key || value.get_ref().is_table() => key,
            _ => value_span,
        };
        node = value.into_inner();
    }
    let end = text[span.clone()].find('\n').map_or(span.end, |length| span.start + length);
    span.start..end
}
