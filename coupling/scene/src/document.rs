//! TOML documents into structs whose documentation is the help in errors: scenes, and studies of them.

use super::origin::{Origin, Segment, join};
use super::{Scene, schema};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::{Table, Value};
use voidage_coupling::error::{Notice, SceneError};

/// What the file of a kind of input is read into. Its documentation is the help in errors.
pub trait Document: DeserializeOwned + JsonSchema {
    /// The command that lists all keys.
    const KEYS: &'static str;

    /// Keys of earlier versions, and what to do about them.
    const GONE: &'static [(&'static str, &'static str)] = &[];

    /// Writes out what a person may write in short.
    fn expand(_document: &mut Table) {}
}

impl Document for Scene {
    const KEYS: &'static str = "voidage schema";

    const GONE: &'static [(&'static str, &'static str)] = &[(
        "fluid.solver.drag_in_stabilisation",
        "delete the line: the drag is always in the stabilisation, and steady pressure drops do not depend on the step",
    )];

    /// `radius = 5e-4` for `{constant = 5e-4}`; `"open"` for `{open = {}}`, of scalars `"outflow"` for `{outflow =
    /// {}}`.
    fn expand(document: &mut Table) {
        let alone = |key: &str, value: Value| Value::Table(Table::from_iter([(key.to_owned(), value)]));
        let in_short = |value: &mut Value, word: &str| {
            if value.as_str() == Some(word) {
                *value = alone(word, Value::Table(Table::new()));
            }
        };
        for group in tables(document.get_mut("grains")) {
            if let Some(radius) = group.get_mut("radius").filter(|r| r.is_float() || r.is_integer()) {
                *radius = alone("constant", radius.clone());
            }
        }
        let boundaries = document.get_mut("fluid").and_then(|fluid| fluid.get_mut("boundaries"));
        for boundary in tables(boundaries) {
            for key in ["flow", "heat"] {
                boundary.get_mut(key).into_iter().for_each(|value| in_short(value, "open"));
            }
            let scalars = boundary.get_mut("scalars").and_then(Value::as_table_mut);
            for (_, value) in scalars.into_iter().flatten() {
                in_short(value, "outflow");
            }
        }
    }
}

/// The tables of a list of tables.
fn tables(list: Option<&mut Value>) -> impl Iterator<Item = &mut Table> {
    list.and_then(Value::as_array_mut).into_iter().flatten().filter_map(Value::as_table_mut)
}

/// What is wrong in a table, and where.
#[derive(Clone, Debug)]
pub struct Fault {
    /// The key, such as `grains[1].radius`.
    pub path: String,
    /// What is wrong, with the key and the value, and what is allowed.
    pub notice: Notice,
    /// Whether there is no such key: what is wrong is the key and not its value.
    pub unknown: bool,
}

/// Reads a document from a text; `file` is named in errors.
///
/// # Errors
/// The text is no TOML, or keys or values are wrong.
pub fn read<T: Document>(file: &Path, text: &str) -> Result<(T, Origin), Box<SceneError>> {
    let (table, origin) = parse::<T>(file, text)?;
    let filled = fill(&table).map_err(|fault| origin.fault(fault))?;
    Ok((filled, origin))
}

/// A text as a table of finite numbers.
pub(super) fn parse<T: Document>(file: &Path, text: &str) -> Result<(Table, Origin), Box<SceneError>> {
    let origin = Origin { file: file.to_path_buf(), text: text.into(), sets: Vec::new() };
    let table: Table = toml::from_str(text).map_err(|error| {
        let help = format!("the file is TOML, see https://toml.io; `{}` lists all keys", T::KEYS);
        origin.error_at(error.span().unwrap_or(0..0), one_line(error.message()), help)
    })?;
    finite::<T>(&table, &origin)?;
    Ok((table, origin))
}

/// Fills a document from a table.
///
/// # Errors
/// A key that does not exist or is missing, a value of the wrong kind.
pub fn fill<T: Document>(document: &Table) -> Result<T, Fault> {
    let mut track = serde_path_to_error::Track::new();
    let mut expanded = document.clone();
    T::expand(&mut expanded);
    let value = Value::Table(expanded);
    T::deserialize(serde_path_to_error::Deserializer::new(value, &mut track)).map_err(|error| {
        let mut steps: Vec<Segment> = track.path().iter().filter_map(to_segment).collect();
        let mut message = one_line(error.message());
        let keys = keys_at(document, &steps).unwrap_or_default();
        if message.starts_with(ONE_ELEMENT) && !keys.is_empty() {
            // One of them may be no choice at all.
            let wrong = keys.iter().find_map(|key| {
                let message = alone::<T>(document, &steps, key)?;
                quoted_after(&message, UNKNOWN_CHOICE).is_some_and(|found| found == *key).then_some(message)
            });
            let quoted = keys.iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
            message =
                wrong.unwrap_or_else(|| format!("holds {} keys ({quoted}), where one is chosen", keys.len()));
        }
        let choice = quoted_after(&message, UNKNOWN_CHOICE).filter(|choice| keys.contains(choice));
        if choice.is_some() {
            message = message.replace(UNKNOWN_CHOICE, UNKNOWN_FIELD);
        }
        let unknown = quoted_after(&message, UNKNOWN_FIELD);
        if let Some(key) = unknown.as_ref().filter(|key| steps.last() != Some(&Segment::Key((*key).clone())))
        {
            steps.push(Segment::Key(key.clone()));
        }
        let path = join(&steps);
        let missing = quoted_after(&message, "missing field `");
        let documented = missing.iter().map(|key| Segment::Key(key.clone()));
        let documented: Vec<Segment> = steps.iter().cloned().chain(documented).collect();
        let help = match (&unknown, schema::describe::<T>(&documented)) {
            (Some(key), _) => match T::GONE.iter().find(|(gone, _)| *gone == join(&steps)) {
                Some((_, remedy)) => (*remedy).to_owned(),
                None => remedy_of_unknown(key, &message),
            },
            (None, _) if message.contains("expected a list") && !keys.is_empty() => {
                format!("a list of tables is written `[[{}]]`", join(&steps))
            }
            (None, Some(text)) => format!("{}: {text}", join(&documented)),
            (None, None) => format!("`{}` lists all keys", T::KEYS),
        };
        let shown = match value_at(document, &steps) {
            Some(value) if unknown.is_none() && missing.is_none() => format!("`{path} = {value}`: {message}"),
            _ if path.is_empty() => message,
            _ => format!("`{path}`: {message}"),
        };
        Fault { path, notice: Notice::new(shown, help), unknown: unknown.is_some() }
    })
}

fn to_segment(segment: &serde_path_to_error::Segment) -> Option<Segment> {
    use serde_path_to_error::Segment as From;
    match segment {
        From::Seq { index } => Some(Segment::Index(*index)),
        From::Map { key } => Some(Segment::Key(key.clone())),
        From::Enum { variant } => Some(Segment::Key(variant.clone())),
        From::Unknown => None,
    }
}

/// How serde begins when a choice has been made twice.
const ONE_ELEMENT: &str = "wanted exactly 1 element";

/// How serde begins when there is no such choice, or no such key. A choice is a key in a table.
const UNKNOWN_CHOICE: &str = "unknown variant `";
const UNKNOWN_FIELD: &str = "unknown field `";

/// Says what serde says, for readers who know TOML rather than Rust. Names in quotes stay as they are.
fn one_line(message: &str) -> String {
    let words = [
        ("floating point ", "number "),
        ("expected f64", "expected a number"),
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("a sequence", "a list"),
        ("sequence", "list"),
        ("map", "table"),
        ("struct ", "a table of "),
        ("array of length", "list of length"),
    ];
    let plain =
        |text: &str| words.iter().fold(text.to_owned(), |text, (rust, plain)| text.replace(rust, plain));
    let message = message.trim().replace('\n', "; ");
    let parts = message.split('`').enumerate();
    let parts: Vec<String> =
        parts.map(|(i, part)| if i % 2 == 0 { plain(part) } else { part.to_owned() }).collect();
    parts.join("`")
}

fn quoted_after(message: &str, start: &str) -> Option<String> {
    let (_, rest) = message.split_once(start)?;
    rest.split('`').next().map(str::to_owned)
}

/// Words of other programs for keys of this one, in small letters and without `_`.
const OTHER_WORDS: &[(&str, &str)] = &[
    ("diameter", "radius"),
    ("youngsmodulus", "young"),
    ("youngmodulus", "young"),
    ("poissonsratio", "poisson"),
    ("poissonratio", "poisson"),
    ("coefficientfriction", "friction"),
    ("frictioncoefficient", "friction"),
    ("mu", "friction"),
    ("coefficientrestitution", "restitution"),
    ("restitutioncoefficient", "restitution"),
    ("coefficientrollingfriction", "rolling"),
    ("rollingfriction", "rolling"),
    ("rho", "density"),
    ("thermalconductivity", "conductivity"),
    ("specificheat", "heat_capacity"),
    ("thermalcapacity", "heat_capacity"),
    ("cp", "heat_capacity"),
    ("dt", "step"),
    ("timestep", "step"),
    ("deltat", "step"),
    ("endtime", "end"),
    ("tend", "end"),
    ("tstop", "end"),
    ("duration", "end"),
    ("writeinterval", "frame_interval"),
    ("vtkinterval", "frame_interval"),
    ("vtkdt", "frame_interval"),
    ("dumpinterval", "frame_interval"),
    ("savedt", "frame_interval"),
    ("particles", "grains"),
    ("particle", "grains"),
    ("geometry", "walls"),
    ("boundaryconditions", "boundaries"),
    ("patches", "boundaries"),
    ("kinematicviscosity", "viscosity"),
    ("nu", "viscosity"),
    ("meshsize", "size"),
    ("porosity", "voidage"),
];

/// What could have been meant by a key that does not exist.
fn remedy_of_unknown(key: &str, message: &str) -> String {
    let allowed: Vec<&str> = message.split('`').skip(3).step_by(2).collect();
    let bare: String = key.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase();
    let other = OTHER_WORDS.iter().find(|(word, known)| *word == bare && allowed.contains(known));
    if let Some((_, known)) = other {
        let half = if *known == "radius" { ", half of it" } else { "" };
        let times = if bare == "nu" || bare == "kinematicviscosity" { ", times the density" } else { "" };
        return format!("here it is `{known}`{half}{times}");
    }
    match allowed.iter().min_by_key(|name| distance(key, name)) {
        Some(name) if distance(key, name) <= 1 + key.len() / 4 => format!("did you mean `{name}`?"),
        Some(_) => format!("keys allowed here: {}", allowed.join(", ")),
        None => "no keys are allowed here".to_owned(),
    }
}

/// Number of letters to change, add or take away, to make one word from the other.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// The keys of the table at a place.
fn keys_at(document: &Table, steps: &[Segment]) -> Option<Vec<String>> {
    node_at(document, steps)?.as_table().map(|table| table.keys().cloned().collect())
}

/// What is wrong if the table at a place holds one of its keys only.
fn alone<T: Document>(document: &Table, steps: &[Segment], key: &str) -> Option<String> {
    let mut document = document.clone();
    T::expand(&mut document);
    let mut value = Value::Table(document);
    let mut node = &mut value;
    for step in steps {
        node = match step {
            Segment::Key(key) => node.get_mut(key.as_str())?,
            Segment::Index(index) => node.get_mut(*index)?,
        };
    }
    node.as_table_mut()?.retain(|other, _| other == key);
    T::deserialize(value).err().map(|error| one_line(error.message()))
}

fn value_at(document: &Table, steps: &[Segment]) -> Option<String> {
    let node = node_at(document, steps)?;
    let text = node.to_string();
    (!node.is_table() && text.len() <= 60).then_some(text)
}

fn node_at<'a>(document: &'a Table, steps: &[Segment]) -> Option<&'a Value> {
    let mut steps = steps.iter();
    let Some(Segment::Key(first)) = steps.next() else { return None };
    let mut node = document.get(first)?;
    for step in steps {
        node = match step {
            Segment::Key(key) => node.get(key.as_str())?,
            Segment::Index(index) => node.get(*index)?,
        };
    }
    Some(node)
}

/// Every number of a document is finite.
pub(super) fn finite<T: Document>(document: &Table, origin: &Origin) -> Result<(), Box<SceneError>> {
    let mut path = Vec::new();
    document
        .iter()
        .try_for_each(|(key, value)| finite_at::<T>(Segment::Key(key.clone()), value, &mut path, origin))
}

fn finite_at<T: Document>(
    step: Segment,
    value: &Value,
    path: &mut Vec<Segment>,
    origin: &Origin,
) -> Result<(), Box<SceneError>> {
    path.push(step);
    match value {
        Value::Float(number) if !number.is_finite() => {
            let help = match schema::describe::<T>(path) {
                Some(text) => format!("give a finite number; {}: {text}", join(path)),
                None => "give a finite number".to_owned(),
            };
            let message = format!("`{} = {value}` is not a finite number", join(path));
            return Err(origin.error(&join(path), message, help));
        }
        Value::Array(array) => array
            .iter()
            .enumerate()
            .try_for_each(|(index, value)| finite_at::<T>(Segment::Index(index), value, path, origin))?,
        Value::Table(table) => table
            .iter()
            .try_for_each(|(key, value)| finite_at::<T>(Segment::Key(key.clone()), value, path, origin))?,
        _ => {}
    }
    path.pop();
    Ok(())
}
