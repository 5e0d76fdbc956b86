//! From a file to a checked scene, and back.

use super::edit::edit;
use super::origin::{Origin, Place, SceneError, Segment, join};
use super::{Contacts, Coupling, MeshSource, Placement, Scene, check, schema};
use crate::closure::HeatTransfer;
use crate::error::{Error, Result};
use serde::Deserialize;
use std::fs;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

impl Scene {
    /// Reads a scene, changes it by options `key=value`, fills in the defaults, and checks it.
    pub fn read(file: &Path, sets: &[String]) -> Result<Scene> {
        let text = fs::read_to_string(file).map_err(|error| {
            Error::Input(format!(
                "{}: cannot read the scene: {error}\n  help: give the path of a scene file, such as \
                 cases/bubbling-bed/scene.toml",
                file.display()
            ))
        })?;
        Ok(Scene::parse(file, &text, sets)?)
    }

    /// The same from a text; `file` is named in errors, and its folder is where paths start.
    pub fn parse(file: &Path, text: &str, sets: &[String]) -> std::result::Result<Scene, Box<SceneError>> {
        let mut origin = Origin { file: file.to_path_buf(), text: text.into(), sets: Vec::new() };
        let mut document: Table = toml::from_str(text)
            .map_err(|error| origin.error_at(error.span().unwrap_or(0..0), one_line(error.message())))?;
        finite(&Value::Table(document.clone()), &mut Vec::new(), &origin)?;
        let mut scene =
            deserialize(&document).map_err(|fault| origin.error(&fault.path, fault.message, fault.help))?;
        for option in sets {
            let place = Place::Set(option.clone());
            let edit =
                edit(&document, option).map_err(|(message, help)| origin.at(place.clone(), message, help))?;
            (scene, document) = match (deserialize(&edit.inserted), deserialize(&edit.replaced)) {
                (Ok(scene), _) => (scene, edit.inserted),
                (Err(_), Ok(scene)) => (scene, edit.replaced),
                (Err(fault), Err(_)) => return Err(origin.at(place, fault.message, fault.help)),
            };
            origin.sets.push((edit.path, option.clone()));
            finite(&Value::Table(document.clone()), &mut Vec::new(), &origin)?;
        }
        scene.origin = origin;
        check::structure(&scene)?;
        scene.resolve();
        check::values(&scene)?;
        Ok(scene)
    }

    /// Fills in what follows from the rest of the scene, and makes paths independent of the folder.
    fn resolve(&mut self) {
        let heat = self.grains_have_heat() && self.fluid_has_heat();
        if !self.grains.is_empty() {
            self.contacts.get_or_insert_with(Contacts::default);
            if self.fluid.is_some() {
                let coupling = self.coupling.get_or_insert_with(Coupling::default);
                if heat {
                    coupling.heat.get_or_insert(HeatTransfer::Henry);
                }
            }
        }
        let folder = fs::canonicalize(self.origin.folder()).unwrap_or_else(|_| PathBuf::from("."));
        let folder = if self.origin.folder().as_os_str().is_empty() {
            std::env::current_dir().unwrap_or(folder)
        } else {
            folder
        };
        for file in self.files_mut() {
            *file = folder.join(&*file);
        }
        if let Some(heat) = self.fluid.as_mut().and_then(|fluid| fluid.heat.as_mut()) {
            heat.reference_temperature.get_or_insert(heat.initial_temperature);
        }
    }

    fn files_mut(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let mesh = self.fluid.as_mut().and_then(|fluid| match &mut fluid.mesh {
            MeshSource::File(file) => Some(file),
            MeshSource::Rectangle(_) => None,
        });
        let grains = self.grains.iter_mut().filter_map(|group| match &mut group.placement {
            Placement::Csv(csv) => Some(&mut csv.file),
            _ => None,
        });
        grains.chain(mesh)
    }

    /// The scene as it runs, with all defaults, as TOML.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|error| Error::Run(format!("cannot write the scene as TOML: {error}")))
    }

    /// A hash (blake3, hexadecimal) of all that decides the course of the run: the scene without its title, its end,
    /// its output and the program that solves the fluid, and the content of the files it names. Equal hashes: a checkpoint of one restarts the other.
    pub fn hash(&self) -> Result<String> {
        let mut bare = self.clone();
        bare.title = String::new();
        bare.time.end = 0.0;
        bare.output = super::Output::default();
        bare.fluid.iter_mut().for_each(|fluid| fluid.backend = None);
        let mut hasher = blake3::Hasher::new();
        for file in bare.files_mut() {
            hasher.update(&fs::read(&*file).map_err(|error| Error::file(file, "read", error))?);
            *file = PathBuf::new();
        }
        hasher.update(bare.to_toml()?.as_bytes());
        Ok(hasher.finalize().to_hex().to_string())
    }

    /// An error that points at a key of the scene, such as `fluid.boundaries[0].name`; for checks that need more than
    /// the scene (a mesh, say).
    pub fn error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> Error {
        self.origin.error(path, message, help).into()
    }
}

/// What is wrong in a document, and where.
struct Fault {
    path: String,
    message: String,
    help: String,
}

fn deserialize(document: &Table) -> std::result::Result<Scene, Fault> {
    let mut track = serde_path_to_error::Track::new();
    let value = Value::Table(document.clone());
    Scene::deserialize(serde_path_to_error::Deserializer::new(value, &mut track)).map_err(|error| {
        let mut steps: Vec<Segment> = track.path().iter().filter_map(to_segment).collect();
        let message = one_line(error.message());
        let unknown = quoted_after(&message, "unknown field `");
        if let Some(key) = unknown.as_ref().filter(|key| steps.last() != Some(&Segment::Key((*key).clone())))
        {
            steps.push(Segment::Key(key.clone()));
        }
        let path = join(&steps);
        let missing = quoted_after(&message, "missing field `");
        let documented = missing.iter().map(|key| Segment::Key(key.clone()));
        let documented: Vec<Segment> = steps.iter().cloned().chain(documented).collect();
        let help = match (&unknown, schema::describe(&documented)) {
            (Some(key), _) => remedy_of_unknown(key, &message),
            (None, Some(text)) => format!("{}: {text}", join(&documented)),
            (None, None) => "`voidage schema` lists all keys".to_owned(),
        };
        let shown = match value_at(document, &steps) {
            Some(value) if unknown.is_none() && missing.is_none() => format!("`{path} = {value}`: {message}"),
            _ if path.is_empty() => message,
            _ => format!("`{path}`: {message}"),
        };
        Fault { path, message: shown, help }
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

/// Says what serde says, for readers who know TOML rather than Rust.
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
    let message = message.trim().replace('\n', "; ");
    words.iter().fold(message, |message, (rust, plain)| message.replace(rust, plain))
}

fn quoted_after(message: &str, start: &str) -> Option<String> {
    let (_, rest) = message.split_once(start)?;
    rest.split('`').next().map(str::to_owned)
}

/// What could have been meant by a key that does not exist.
fn remedy_of_unknown(key: &str, message: &str) -> String {
    let allowed: Vec<&str> = message.split('`').skip(3).step_by(2).collect();
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

fn value_at(document: &Table, steps: &[Segment]) -> Option<String> {
    let mut steps = steps.iter();
    let Some(Segment::Key(first)) = steps.next() else { return None };
    let mut node = document.get(first)?;
    for step in steps {
        node = match step {
            Segment::Key(key) => node.get(key.as_str())?,
            Segment::Index(index) => node.get(*index)?,
        };
    }
    let text = node.to_string();
    (!node.is_table() && text.len() <= 60).then_some(text)
}

/// Every number of a scene is finite.
fn finite(
    value: &Value,
    path: &mut Vec<Segment>,
    origin: &Origin,
) -> std::result::Result<(), Box<SceneError>> {
    match value {
        Value::Float(number) if !number.is_finite() => {
            let help = match schema::describe(path) {
                Some(text) => format!("give a finite number; {}: {text}", join(path)),
                None => "give a finite number".to_owned(),
            };
            Err(origin.error(&join(path), format!("`{} = {value}` is not a finite number", join(path)), help))
        }
        Value::Array(array) => array.iter().enumerate().try_for_each(|(index, value)| {
            path.push(Segment::Index(index));
            finite(value, path, origin)?;
            path.pop();
            Ok(())
        }),
        Value::Table(table) => table.iter().try_for_each(|(key, value)| {
            path.push(Segment::Key(key.clone()));
            finite(value, path, origin)?;
            path.pop();
            Ok(())
        }),
        _ => Ok(()),
    }
}
