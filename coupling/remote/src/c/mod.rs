//! The header `voidage.h` for solvers in C and C++, made from the lists of [`crate::protocol`].
//!
//! What does not depend on the lists is in `voidage.h.in`; each `@name@` there is one of the `parts`.

use crate::peer::LONGEST_SETUP;
use crate::protocol::{
    BALANCE, BODY, Block, CLOSURE, Column, Count, Entry, FIELD_SCALAR, FIELDS, FLAGS, Greeting, HEADER_BYTES,
    Header, Kind, Listed, MAGIC, MESH, PAD, POINT_SCALAR, POINTS, REPORT, STEP, VERSION, Width,
};
use crate::token::TOKEN_VARIABLE;

const TEMPLATE: &str = include_str!("voidage.h.in");

/// Longest line.
const LINE: usize = 118;

/// The text of `voidage.h`.
pub fn header() -> String {
    parts().into_iter().fold(TEMPLATE.to_owned(), |text, (name, part)| {
        text.replace(&format!("@{name}@"), part.trim_end_matches('\n'))
    })
}

/// What takes the places of the names in the template.
fn parts() -> Vec<(&'static str, String)> {
    vec![
        ("constants", constants()),
        ("kinds", enumeration(Kind::LISTED)),
        ("flags", enumeration(FLAGS)),
        (
            "header",
            Header::FIELDS.iter().map(|f| member(c_type(f.number), f.name, &prose(f.about))).collect(),
        ),
        ("offsets", offsets()),
        ("names", names()),
        ("fields", fields()),
        ("closure", CLOSURE.map(|law| format!(" *     {}\n", law.replace(", ", ",\n *     "))).concat()),
        ("points", columns(&POINTS, "rows", "    ")),
        ("point_scalar", columns(&POINT_SCALAR, "rows", "        ")),
        ("mesh", MESH.iter().map(block_member).collect()),
        ("step", STEP.iter().map(block_member).collect()),
        ("balance", entries(&BALANCE)),
        ("balance_numbers", sum(BALANCE.iter().map(|entry| entry.width), "(dimension)", "(scalars)")),
        ("body", entries(&BODY)),
        ("body_numbers", sum(BODY.iter().map(|entry| entry.width), "(dimension)", "")),
        ("report", report()),
        ("take_fields", take_fields()),
        ("take_points", take_points()),
        ("take_mesh", MESH.iter().map(|block| take_block(block, "mesh->")).collect()),
        ("take_step", STEP.iter().map(|block| take_block(block, "step->")).collect()),
        ("nodal_flags", nodal_flags()),
        ("field_numbers", sum(FIELDS.iter().map(width), "from->dimension", "")),
        ("run_numbers", sum(FIELDS.iter().map(width), "run->dimension", "")),
        ("keep", keep()),
        ("put", put()),
    ]
}

// ---------------------------------------------------------------------------------------------- words

/// The words of a comment of Rust, without its links.
fn prose(about: &str) -> String {
    let linked = |name: &str| match name.chars().all(|c| c.is_ascii_uppercase()) {
        true => format!("VOIDAGE_{name}"),
        false => format!("voidage_{}", name.to_lowercase()),
    };
    let mut pieces = about.trim().split("[`");
    let mut text = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (name, rest) = piece.split_once("`]").unwrap_or((piece, ""));
        text.push_str(&linked(name));
        text.push_str(rest);
    }
    text.trim_end_matches('.').to_owned()
}

/// A line with a comment behind it, or below comments where there is no room.
fn line(indent: &str, code: &str, about: &str) -> String {
    let whole = format!("{indent}{code} /* {about} */");
    if whole.len() <= LINE {
        return whole + "\n";
    }
    let mut text = format!("{indent}/*");
    let mut length = text.len();
    for word in about.split(' ') {
        if length + word.len() + 4 > LINE {
            text.push_str(&format!("\n{indent} *"));
            length = indent.len() + 2;
        }
        text.push_str(&format!(" {word}"));
        length += word.len() + 1;
    }
    format!("{text} */\n{indent}{code}\n")
}

fn member(number: &str, name: &str, about: &str) -> String {
    line("    ", &format!("{number} {name};"), about)
}

/// A type of a field of the header.
fn c_type(number: &str) -> &'static str {
    match number {
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        _ => "double",
    }
}

fn c_constant(name: &str) -> String {
    format!("VOIDAGE_{}", name.to_uppercase())
}

// ----------------------------------------------------------------------------------------- constants

fn constants() -> String {
    let define = |name: &str, value: String, about: &str| line("", &format!("#define {name} {value}"), about);
    [
        define(
            "VOIDAGE_MAGIC",
            format!("UINT64_C({MAGIC:#018x})"),
            "first in every frame; other bytes if the run has another byte order",
        ),
        define("VOIDAGE_VERSION", format!("{VERSION}u"), "of the protocol; both ends must have the same"),
        define("VOIDAGE_PAD", format!("{PAD}u"), "columns are as long as a multiple of it"),
        define("VOIDAGE_SCALARS", format!("{}", u32::BITS), "that a fluid can carry at most"),
        define("VOIDAGE_TOKEN", format!("{TOKEN_VARIABLE:?}"), "the environment variable with the token"),
        define(
            "VOIDAGE_LONGEST_GREETING",
            format!("{}", Greeting::LONGEST),
            "payload with which a solver presents itself, numbers",
        ),
        define("VOIDAGE_LONGEST_SETUP", format!("{LONGEST_SETUP}u"), "payload of the answer, numbers"),
    ]
    .concat()
}

fn enumeration(list: &[Listed]) -> String {
    let last = list.len() - 1;
    let entry = |(k, listed): (usize, &Listed)| {
        let comma = if k < last { "," } else { "" };
        let code = format!("{} = {}{comma}", c_constant(listed.name), listed.number);
        line("    ", &code, &prose(listed.about))
    };
    list.iter().enumerate().map(entry).collect()
}

fn names() -> String {
    let case = |kind: &Listed| {
        format!("    case {}: return \"{}\";\n", c_constant(kind.name), kind.name.to_lowercase())
    };
    Kind::LISTED.iter().map(case).collect()
}

fn offsets() -> String {
    let check = |name: &str, what: &str, is: usize| {
        format!("typedef char voidage_check_{name}[{what} == {is} ? 1 : -1];\n")
    };
    let fields = Header::FIELDS.iter();
    let of = |name: &str| format!("offsetof(voidage_header, {name})");
    let fields: String = fields.map(|field| check(field.name, &of(field.name), field.offset)).collect();
    fields + &check("size", "sizeof(voidage_header)", HEADER_BYTES)
}

fn report() -> String {
    let entry = |(k, entry): (usize, &Entry)| {
        let code = format!("VOIDAGE_REPORT_{} = {k},", entry.name.to_uppercase());
        line("    ", &code, &format!("{}{}", entry.about, unit(entry.unit)))
    };
    let all: String = REPORT.iter().enumerate().map(entry).collect();
    all + &format!("    VOIDAGE_REPORT_NUMBERS = {}\n", REPORT.len())
}

fn entries(list: &[Entry]) -> String {
    let entry = |entry: &Entry| {
        let count = numbers(entry.width, "dimension", "scalars");
        format!(" *     {} ({count}; {}): {}\n", entry.name, entry.unit, entry.about)
    };
    list.iter().map(entry).collect()
}

// -------------------------------------------------------------------------------------------- layouts

/// Numbers per row, in C.
fn numbers(width: Width, dimension: &str, scalars: &str) -> String {
    match width {
        Width::One => "1".into(),
        Width::Vector => dimension.into(),
        Width::Corners => format!("({dimension} + 1)"),
        Width::Moments => format!("{dimension} * ({dimension} - 1) / 2"),
        Width::Scalars => scalars.into(),
    }
}

/// A product, in C.
fn times(rows: &str, per_row: &str) -> String {
    if per_row == "1" { rows.to_owned() } else { format!("{rows} * {per_row}") }
}

fn width(column: &Column) -> Width {
    if column.vector { Width::Vector } else { Width::One }
}

/// Numbers per row of all together, in C.
fn sum(widths: impl Iterator<Item = Width>, dimension: &str, scalars: &str) -> String {
    widths.map(|width| numbers(width, dimension, scalars)).collect::<Vec<_>>().join(" + ")
}

/// How many numbers there are, in words.
fn extent(rows: &str, width: Width) -> String {
    match numbers(width, "dimension", "scalars").as_str() {
        "1" => rows.to_owned(),
        numbers => format!("{rows} x {numbers}"),
    }
}

/// A unit behind a comma, if there is one.
fn unit(unit: &str) -> String {
    if unit == "1" { String::new() } else { format!(", {unit}") }
}

fn columns(list: &[Column], rows: &str, indent: &str) -> String {
    let column = |column: &Column| {
        let whole = if column.whole { ", whole numbers: its cell of the mesh" } else { "" };
        let about = format!("{}{}{whole}", extent(rows, width(column)), unit(column.unit));
        line(indent, &format!("double *{};", column.name), &about)
    };
    list.iter().map(column).collect()
}

fn fields() -> String {
    let scalar = format!("nodes, {} for heat, of each of them", FIELD_SCALAR.unit);
    columns(&FIELDS, "nodes", "    ") + &member("double", "*scalar[VOIDAGE_SCALARS]", &scalar)
}

/// A count of a header as the structure of a mesh or a step has it.
fn rows(count: Count) -> &'static str {
    match count {
        Count::One => "1",
        Count::Rows | Count::Nodes => "nodes",
        Count::Cells => "cells",
        Count::Facets => "facets",
    }
}

fn flag(number: u32) -> String {
    let listed = FLAGS.iter().find(|flag| flag.number == number);
    listed.map_or_else(String::new, |flag| c_constant(flag.name))
}

fn block_member(block: &Block) -> String {
    let Entry { name, unit, width, about } = block.entry;
    let whole = if block.below.is_some() { ", whole numbers" } else { "" };
    let absent = match block.flag {
        0 => String::new(),
        number => format!("; NULL without {}", flag(number)),
    };
    let about = format!("{}{}{whole}: {about}{absent}", extent(rows(block.rows), width), self::unit(unit));
    member("double", &format!("*{name}"), &about)
}

/// A count of a header, in C.
fn frame_rows(count: Count) -> &'static str {
    match count {
        Count::One => "1",
        Count::Rows => "frame->rows",
        Count::Nodes => "frame->nodes",
        Count::Cells => "frame->cells",
        Count::Facets => "frame->facets",
    }
}

/// Statements that find numbers in a payload, and check them if they must be whole numbers below a count.
fn take(
    (owner, name): (&str, &str),
    (rest, rows, width): (&str, &str, Width),
    whole: Option<(&str, &str)>,
    indent: &str,
) -> String {
    let per_row = numbers(width, "run->dimension", "");
    let place = format!("{owner}{name}");
    let mut text = format!(
        "{indent}{place} = voidage_take(run, {rest}, {rows}, {per_row}, \"{name}\");\n\
         {indent}if ({place} == NULL) return -1;\n"
    );
    if let Some((there, below)) = whole {
        let count = times(there, &per_row);
        let check = format!("voidage_check_whole(run, {place}, {count}, {below}, \"{name}\")");
        let line = format!("{indent}if ({check} < 0) return -1;\n");
        let broken = format!("{indent}if ({check} < 0)\n{indent}    return -1;\n");
        text.push_str(if line.len() <= LINE { &line } else { &broken });
    }
    text
}

fn take_block(block: &Block, owner: &str) -> String {
    let Entry { name, width, .. } = block.entry;
    let rows = frame_rows(block.rows);
    let whole = block.below.map(|below| (rows, frame_rows(below)));
    let find = |indent| take((owner, name), ("&rest", rows, width), whole, indent);
    match block.flag {
        0 => find("    "),
        number => format!("    if ((frame->flags & {}) != 0) {{\n{}    }}\n", flag(number), find("        ")),
    }
}

fn nodal_flags() -> String {
    let nodal = STEP.iter().filter(|block| block.rows == Count::Nodes);
    let mut flags: Vec<String> = nodal.map(|block| flag(block.flag)).collect();
    flags.dedup();
    flags.join(" | ")
}

fn take_column(owner: &str, column: &Column, indent: &str) -> String {
    let whole = column.whole.then_some(("frame->rows", "run->cells"));
    take((owner, column.name), ("rest", "frame->stride", width(column)), whole, indent)
}

fn take_fields() -> String {
    let own: String = FIELDS.iter().map(|column| take_column("fields->", column, "    ")).collect();
    let scalar = Column { name: "scalar[k]", ..FIELD_SCALAR };
    let scalar = take_column("fields->", &scalar, "        ");
    format!("{own}    for (k = 0; k < run->scalars; k++) {{\n{scalar}    }}\n")
}

fn take_points() -> String {
    let own: String = POINTS.iter().map(|column| take_column("points->", column, "    ")).collect();
    let more = POINT_SCALAR.iter().map(|column| take_column("points->scalar[k].", column, "        "));
    let more: String = more.collect();
    format!(
        "{own}    for (k = 0; k < run->scalars; k++) {{\n        \
         if ((frame->scalars >> k & 1) == 0) continue;\n{more}    }}\n"
    )
}

fn keep() -> String {
    let own = FIELDS.iter().map(|column| {
        let (name, per_row) = (column.name, numbers(width(column), "from->dimension", ""));
        let numbers = times("nodes", &per_row);
        format!("    to->{name} = at;\n    voidage_put(&at, from->{name}, {numbers}, {numbers});\n")
    });
    let own: String = own.collect();
    format!(
        "{own}    for (k = 0; k < from->scalars; k++) {{\n        to->scalar[k] = at;\n        \
         voidage_put(&at, from->scalar[k], nodes, nodes);\n    }}\n"
    )
}

fn put() -> String {
    let own = FIELDS.iter().map(|column| {
        let (name, per_row) = (column.name, numbers(width(column), "run->dimension", ""));
        let (numbers, room) = (times("run->nodes", &per_row), times("frame.stride", &per_row));
        format!(
            "    if (fields->{name} == NULL) return voidage_wrong(run, \"a solution without {name}\");\n    \
             voidage_put(&to, fields->{name}, {numbers}, {room});\n"
        )
    });
    let own: String = own.collect();
    format!(
        "{own}    for (k = 0; k < run->scalars; k++) {{\n        \
         if (fields->scalar[k] == NULL) return voidage_wrong(run, \"a solution without a scalar\");\n        \
         voidage_put(&to, fields->scalar[k], run->nodes, frame.stride);\n    }}\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_of_the_template_has_its_part_and_every_part_its_name() {
        for (name, part) in parts() {
            assert!(TEMPLATE.contains(&format!("@{name}@")), "{name}");
            assert!(!part.trim().is_empty(), "{name}");
        }
        let header = header();
        assert!(!header.contains('@'), "{:?}", header.lines().find(|line| line.contains('@')));
        let long = header.lines().find(|line| line.chars().count() > 120);
        assert_eq!(long, None);
    }

    #[test]
    fn links_of_rust_are_names_of_c() {
        assert_eq!(prose(" [`ACCEPT`] or a [`Kind`]."), "VOIDAGE_ACCEPT or a voidage_kind");
    }
}
