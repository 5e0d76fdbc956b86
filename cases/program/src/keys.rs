//! The documentation of every key as a page (Markdown), in the order of the file.

use schemars::JsonSchema;
use serde_json::Value;
use std::collections::{BTreeMap, VecDeque};
use voidage_scene::json_schema;

/// All keys of a document as Markdown: a section per table, in the order in which they are declared.
pub fn page<T: JsonSchema>() -> String {
    let root = json_schema::<T>();
    let name = root.get("title").and_then(Value::as_str).unwrap_or("document").to_lowercase();
    let mut page = Page { root: &root, text: format!("# The keys of a {name}\n"), written: BTreeMap::new() };
    page.say(
        "This page has every key with its meaning, unit and default, in the order of the file. A key that is marked as \
         needed must be given wherever its table is.",
    );
    page.say(
        "A heading is a table as TOML writes it: `[[grains]]` is one of a list of tables, and `NAME` stands for a name \
         that you choose. A table can also be written in one line, as `time = { step = 1e-3, end = 1.0 }`, or key by \
         key, as `time.step = 1e-3`.",
    );
    page.section(Section { path: String::new(), list: false, table: &root });
    page.text
}

/// Longest line of a paragraph, in characters.
const WIDTH: usize = 120;

/// A table of the document that gets a section.
struct Section<'a> {
    /// Such as `fluid.mesh.rectangle`; nothing for the whole document.
    path: String,
    /// Whether there is a list of such tables.
    list: bool,
    table: &'a Value,
}

impl Section<'_> {
    fn heading(&self) -> String {
        match (self.path.as_str(), self.list) {
            ("", _) => "Outside of tables".to_owned(),
            (path, false) => format!("[{path}]"),
            (path, true) => format!("[[{path}]]"),
        }
    }
}

struct Page<'a> {
    root: &'a Value,
    text: String,
    /// The headings of the types that have a section: a table that occurs again is not written again.
    written: BTreeMap<String, String>,
}

impl<'a> Page<'a> {
    /// A paragraph, in lines of at most [`WIDTH`] characters.
    fn say(&mut self, paragraph: &str) {
        let mut length = 0;
        for (k, word) in words(paragraph).into_iter().enumerate() {
            let size = word.chars().count();
            let fits = k > 0 && length + 1 + size <= WIDTH;
            self.text.push(if fits { ' ' } else { '\n' });
            self.text.push_str(word);
            length = if fits { length + 1 + size } else { size };
        }
        self.text.push('\n');
    }

    fn row(&mut self, cells: [&str; 3]) {
        let cells = cells.map(|cell| cell.replace('|', "\\|"));
        self.text.push_str(&format!("| {} |\n", cells.join(" | ")));
    }

    /// Writes a table and those in it.
    fn section(&mut self, section: Section<'a>) {
        self.say(&format!("## {}", code(&section.heading())));
        let about = description(section.table);
        if !about.is_empty() && !section.path.is_empty() {
            self.say(&about);
        }
        self.text.push_str("\n| key | value | meaning |\n|---|---|---|\n");
        let mut within = VecDeque::new();
        let required = section.table.get("required").and_then(Value::as_array);
        let needed = |key: &str| required.is_some_and(|keys| keys.iter().any(|name| name == key));
        for (key, schema) in properties(section.table) {
            let path = if section.path.is_empty() { key.clone() } else { format!("{}.{key}", section.path) };
            let (target, of) = self.resolve(schema);
            let value = self.value(&path, target, of, &mut within);
            let about = [description(schema), description(target)].into_iter().find(|text| !text.is_empty());
            let needed = if needed(key) { " (needed)" } else { "" };
            self.row([&format!("`{key}`{needed}"), &value, &about.unwrap_or_default()]);
            for (shown, about) in self.choices(&path, target, &mut within) {
                self.row(["", &shown, &about]);
            }
        }
        within.into_iter().for_each(|section| self.section(section));
    }

    /// Follows references, and alternatives of which one is `null`; with the name of the type, if it has one.
    fn resolve(&self, mut node: &'a Value) -> (&'a Value, Option<&'a str>) {
        let mut of = None;
        loop {
            if let Some(target) = node.get("$ref").and_then(Value::as_str) {
                of = target.rsplit('/').next();
                node = self.root.pointer(target.trim_start_matches('#')).unwrap_or(&Value::Null);
            } else if let [alone] = alternatives(node)[..] {
                node = alone;
            } else {
                return (node, of);
            }
        }
    }

    /// What is written after the key; tables get a section.
    fn value(
        &mut self,
        path: &str,
        node: &'a Value,
        of: Option<&str>,
        within: &mut VecDeque<Section<'a>>,
    ) -> String {
        let several = alternatives(node);
        if !several.is_empty() {
            let kinds: Vec<String> = several
                .into_iter()
                .map(|node| {
                    let (node, of) = self.resolve(node);
                    self.value(path, node, of, within)
                })
                .collect();
            return kinds.join(" or ");
        }
        if node.get("oneOf").is_some() {
            return "one of".to_owned();
        }
        if let Some(item) = node.get("items") {
            let (item, of) = self.resolve(item);
            if has_keys(item) {
                let section = Section { path: path.to_owned(), list: true, table: item };
                return self.link("list of tables", section, of, within);
            }
            let count = node.get("minItems").and_then(Value::as_u64);
            let count = count.map_or(String::new(), |count| format!("{count} "));
            let item = self.value(path, item, of, within);
            return match item.strip_prefix("list ") {
                Some(inner) => format!("list of {count}lists {inner}"),
                None => format!("list of {count}{item}s"),
            };
        }
        if has_keys(node) {
            let section = Section { path: path.to_owned(), list: false, table: node };
            return self.link("table", section, of, within);
        }
        if let Some(named) = node.get("additionalProperties").filter(|schema| schema.is_object()) {
            let (named, of) = self.resolve(named);
            let path = format!("{path}.NAME");
            if has_keys(named) {
                return self.link("tables by name", Section { path, list: false, table: named }, of, within);
            }
            return format!("`NAME =` {}", self.value(&path, named, of, within));
        }
        let kind = match node.get("type") {
            Some(Value::Array(kinds)) => kinds.iter().find(|kind| *kind != "null"),
            kind => kind,
        };
        match kind.and_then(Value::as_str) {
            Some("integer") => "whole number",
            Some("string") => "text",
            Some("boolean") => "`true` or `false`",
            Some("number") => "number",
            _ => "value",
        }
        .to_owned()
    }

    /// A link to the section of a table, which is written if its type has none yet.
    fn link(
        &mut self,
        what: &str,
        section: Section<'a>,
        of: Option<&str>,
        within: &mut VecDeque<Section<'a>>,
    ) -> String {
        let name = of.map_or_else(|| section.path.clone(), str::to_owned);
        let heading = match self.written.get(&name) {
            Some(heading) => heading.clone(),
            None => {
                let heading = section.heading();
                self.written.insert(name, heading.clone());
                within.push_back(section);
                heading
            }
        };
        let anchor: String = heading.chars().filter(|c| c.is_alphanumeric() || "_-".contains(*c)).collect();
        format!("[{what}](#{})", anchor.to_lowercase())
    }

    /// What can be chosen, with the meaning of each.
    fn choices(
        &mut self,
        path: &str,
        node: &'a Value,
        within: &mut VecDeque<Section<'a>>,
    ) -> Vec<(String, String)> {
        let mut rows = Vec::new();
        let named = node.get("additionalProperties").filter(|schema| schema.is_object());
        let node = named.map_or(node, |named| self.resolve(named).0);
        for choice in node.get("oneOf").and_then(Value::as_array).into_iter().flatten() {
            let about = description(choice);
            if let Some(word) = choice.get("const") {
                rows.push((format!("`{word}`"), about));
                continue;
            }
            for (word, content) in properties(choice) {
                let (content, of) = self.resolve(content);
                let path = format!("{path}.{word}");
                let value = self.value(&path, content, of, within);
                rows.push((format!("`{word}`: {value}"), about.clone()));
                let choices = self.choices(&path, content, within);
                rows.extend(choices.into_iter().map(|(shown, about)| (format!("`{word}`: {shown}"), about)));
            }
        }
        rows
    }
}

/// The alternatives of a node that are not `null`.
fn alternatives(node: &Value) -> Vec<&Value> {
    let all = node.get("anyOf").or_else(|| node.get("allOf")).and_then(Value::as_array);
    let null = |node: &Value| node.get("type").is_some_and(|kind| kind == "null");
    all.into_iter().flatten().filter(|node| !null(node)).collect()
}

fn properties(node: &Value) -> impl Iterator<Item = (&String, &Value)> {
    node.get("properties").and_then(Value::as_object).into_iter().flatten()
}

fn has_keys(node: &Value) -> bool {
    properties(node).next().is_some()
}

/// The documentation of a node in one line; links of rustdoc are names.
fn description(node: &Value) -> String {
    let text = node.get("description").and_then(Value::as_str).unwrap_or_default();
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").replace("[`", "`").replace("`]", "`")
}

/// The words of a text; what stands in backticks is one.
fn words(text: &str) -> Vec<&str> {
    let mut inside = false;
    text.split(|c: char| {
        inside ^= c == '`';
        c == ' ' && !inside
    })
    .collect()
}

fn code(heading: &str) -> String {
    if heading.starts_with('[') { format!("`{heading}`") } else { heading.to_owned() }
}
