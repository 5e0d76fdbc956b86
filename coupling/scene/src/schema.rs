//! The documentation of every key, as JSON schema and as help in errors.

use super::origin::Segment;
use schemars::JsonSchema;
use serde_json::Value;

/// The JSON schema of a document, with the meaning, unit and default of every key.
pub fn json_schema<T: JsonSchema>() -> Value {
    schemars::schema_for!(T).to_value()
}

/// The documentation of a key, if the path leads to one.
pub(super) fn describe<T: JsonSchema>(path: &[Segment]) -> Option<String> {
    let root = json_schema::<T>();
    let mut nodes = vec![&root];
    for step in path {
        nodes = nodes.into_iter().flat_map(|node| children(&root, node, step)).collect();
    }
    let text = nodes.iter().find_map(|node| node.get("description")?.as_str())?;
    Some(text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// The schemas that a step leads to, through references and alternatives.
fn children<'a>(root: &'a Value, node: &'a Value, step: &Segment) -> Vec<&'a Value> {
    let mut found = Vec::new();
    if let Some(target) = node.get("$ref").and_then(Value::as_str) {
        let target = root.pointer(target.trim_start_matches('#'));
        found.extend(target.into_iter().flat_map(|target| children(root, target, step)));
    }
    for choice in ["anyOf", "oneOf", "allOf"] {
        let nodes = node.get(choice).and_then(Value::as_array);
        found.extend(nodes.into_iter().flatten().flat_map(|node| children(root, node, step)));
    }
    let next = match step {
        Segment::Key(key) => node
            .get("properties")
            .and_then(|properties| properties.get(key))
            .or_else(|| node.get("additionalProperties").filter(|schema| schema.is_object())),
        Segment::Index(_) => node.get("items"),
    };
    found.extend(next);
    found
}
