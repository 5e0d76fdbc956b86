//! Changes to a scene from the command line: `--set fluid.boundaries.inflow.flow.velocity=[0,1.2]`.

use super::origin::{Segment, join, segments};
use toml::{Table, Value};

/// A change: canonical path (names of array entries replaced by numbers) and the changed document.
pub(super) struct Edit {
    pub path: String,
    /// The document with the value put in.
    pub inserted: Table,
    /// The same with the value as the only key of its table: what choosing another variant needs.
    pub replaced: Table,
}

/// Applies `key=value` to a document. The error says what is wrong and what is allowed.
pub(super) fn edit(document: &Table, option: &str) -> Result<Edit, (String, String)> {
    let Some((key, value)) = option.split_once('=') else {
        return Err((format!("`{option}` has no `=`"), "write --set key.of.the.scene=value".into()));
    };
    let steps = segments(key.trim());
    if steps.is_empty() {
        return Err((format!("`{option}` has no key"), "write --set key.of.the.scene=value".into()));
    }
    let value = parse_value(value.trim());
    let mut inserted = document.clone();
    let path = put(&mut inserted, &steps, value.clone(), false)?;
    let mut replaced = document.clone();
    put(&mut replaced, &steps, value, true)?;
    Ok(Edit { path, inserted, replaced })
}

/// A TOML value; what is not one is taken as a string, so that `--set coupling.scheme=explicit` needs no quotes.
fn parse_value(text: &str) -> Value {
    match toml::from_str::<Table>(&format!("value = {text}")) {
        Ok(mut table) if table.len() == 1 => {
            table.remove("value").unwrap_or_else(|| Value::String(text.to_owned()))
        }
        _ => Value::String(text.to_owned()),
    }
}

fn put(
    document: &mut Table,
    steps: &[Segment],
    value: Value,
    alone: bool,
) -> Result<String, (String, String)> {
    let mut root = Value::Table(std::mem::take(document));
    let mut node = &mut root;
    let mut canonical = Vec::new();
    for (depth, step) in steps.iter().enumerate() {
        let last = depth + 1 == steps.len();
        if let Value::Array(array) = node {
            let index = array_index(array, step, &canonical)?;
            canonical.push(Segment::Index(index));
            node = &mut array[index];
            continue;
        }
        let Segment::Key(key) = step else {
            let at = join(&canonical);
            return Err((
                format!("`{at}` is not a list"),
                format!("write `{at}.key=value`, or the whole list"),
            ));
        };
        if !node.is_table() {
            *node = Value::Table(Table::new());
        }
        canonical.push(step.clone());
        let Value::Table(table) = node else { unreachable!("made a table above") };
        if last && alone {
            table.clear();
        }
        node = table.entry(key.clone()).or_insert_with(|| Value::Table(Table::new()));
    }
    *node = value;
    if let Value::Table(table) = root {
        *document = table;
    }
    Ok(join(&canonical))
}

/// The entry that a number, or the `name` of an entry, means.
fn array_index(array: &[Value], step: &Segment, at: &[Segment]) -> Result<usize, (String, String)> {
    let names: Vec<&str> = array.iter().filter_map(|entry| entry.get("name")?.as_str()).collect();
    let index = match step {
        Segment::Index(index) => Some(*index),
        Segment::Key(key) => key
            .parse()
            .ok()
            .or_else(|| array.iter().position(|e| e.get("name").and_then(Value::as_str) == Some(key))),
    };
    if let Some(index) = index.filter(|index| *index < array.len()) {
        return Ok(index);
    }
    let asked = join(std::slice::from_ref(step));
    let mut help = match array.len() {
        0 => "the list is empty".to_owned(),
        n => format!("entries are numbered from 0 to {}", n - 1),
    };
    if !names.is_empty() {
        help.push_str(&format!("; names: {}", names.join(", ")));
    }
    Err((format!("`{}` has no entry `{asked}`", join(at)), help))
}
