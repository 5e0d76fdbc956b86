//! Binary files, brought into the form of text.

use super::SIMPLEX;
use crate::{Error, Result};
use std::fmt::Write;

/// The text of a file: as it is, or, of a binary one, with its numbers written out so that they read back to the same
/// bits. `name` is the name of the file in errors.
pub(super) fn as_text(bytes: &[u8], name: &str) -> Result<String> {
    let mut source = Bytes { name, bytes, at: 0, swapped: false };
    match source.binary_version() {
        Some(version) => source.convert(&version),
        None => Ok(String::from_utf8_lossy(bytes).into_owned()),
    }
}

/// A binary file and where we are in it.
struct Bytes<'a> {
    name: &'a str,
    bytes: &'a [u8],
    at: usize,
    /// Whether numbers have the order of bytes of a machine that writes the highest first.
    swapped: bool,
}

impl<'a> Bytes<'a> {
    fn error(&self, text: impl std::fmt::Display) -> Error {
        Error::Mesh(format!("{}, byte {}: {text}", self.name, self.at))
    }

    fn line(&mut self) -> Option<&'a str> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
        self.at += length + 1;
        std::str::from_utf8(&rest[..length]).ok().map(str::trim_end)
    }

    /// The version of a binary file, after its second line; none of a text.
    fn binary_version(&mut self) -> Option<String> {
        let (first, format) = (self.line()?, self.line()?);
        let mut words = format.split_whitespace();
        let version = words.next()?;
        (first == "$MeshFormat" && words.next() == Some("1")).then(|| version.to_owned())
    }

    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let found = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>());
        let mut bytes = *found.ok_or_else(|| self.error(format!("the file ends where {what} should be")))?;
        self.at += N;
        if self.swapped {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn int(&mut self, what: &str) -> Result<i32> {
        self.take(what).map(i32::from_le_bytes)
    }

    fn size(&mut self, what: &str) -> Result<u64> {
        self.take(what).map(u64::from_le_bytes)
    }

    /// A count of things that take so many bytes each, at least.
    fn count(&mut self, what: &str, bytes: usize) -> Result<usize> {
        let count = self.size(what)?;
        self.check_count(count, what, bytes)
    }

    fn check_count(&self, count: u64, what: &str, bytes: usize) -> Result<usize> {
        let left = self.bytes.len().saturating_sub(self.at) / bytes;
        match usize::try_from(count) {
            Ok(count) if count <= left => Ok(count),
            _ => Err(self.error(format!("{count} {what} where the file has room for {left}"))),
        }
    }

    fn coordinates(&mut self, count: usize, out: &mut String) -> Result<()> {
        for _ in 0..count {
            let x = f64::from_le_bytes(self.take("coordinates")?);
            put(out, format_args!(" {x:?}"));
        }
        Ok(())
    }

    fn ints(&mut self, count: usize, what: &str, out: &mut String) -> Result<()> {
        for _ in 0..count {
            let number = self.int(what)?;
            put(out, format_args!(" {number}"));
        }
        Ok(())
    }

    fn convert(&mut self, version: &str) -> Result<String> {
        let one: [u8; 4] = self.take("the number one")?;
        self.swapped = match (i32::from_le_bytes(one), i32::from_be_bytes(one)) {
            (1, _) => false,
            (_, 1) => true,
            (other, _) => return Err(self.error(format!("{other} where the number one should be"))),
        };
        self.at += 1;
        let mut out = format!("$MeshFormat\n{version} 0 8\n");
        while let Some(line) = self.line() {
            put(&mut out, format_args!("{line}\n"));
            match (line, version) {
                ("$Entities", "4.1") => self.entities(&mut out)?,
                ("$Nodes", "4.1") => self.nodes(&mut out)?,
                ("$Elements", "4.1") => self.elements(&mut out)?,
                ("$Nodes", "2.2") => self.old_nodes(&mut out)?,
                ("$Elements", "2.2") => self.old_elements(&mut out)?,
                ("$PhysicalNames" | "$Comments" | "", _) => continue,
                // What is not read is passed over, and what the reader refuses, it refuses by its name.
                (section, _) if section.starts_with('$') && !section.starts_with("$End") => {
                    let end = format!("\n$End{}", &section[1..]);
                    let rest = self.bytes.get(self.at..).unwrap_or_default();
                    let length = rest.windows(end.len()).position(|window| window == end.as_bytes());
                    self.at += length.ok_or_else(|| self.error(format!("there is no {}", end.trim())))?;
                }
                _ => continue,
            }
            // A line ends what was binary.
            self.at += 1;
        }
        Ok(out)
    }

    fn entities(&mut self, out: &mut String) -> Result<()> {
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = self.count("entities", 4)?;
            put(out, format_args!("{count} "));
        }
        out.push('\n');
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                self.ints(1, "an entity", out)?;
                self.coordinates(if dimension == 0 { 3 } else { 6 }, out)?;
                for what in ["physical groups", "entities of a boundary"].iter().take(1 + dimension.min(1)) {
                    let count = self.count(what, 4)?;
                    put(out, format_args!(" {count}"));
                    self.ints(count, what, out)?;
                }
                out.push('\n');
            }
        }
        Ok(())
    }

    /// Numbers of blocks and of all in them, and the smallest and the largest tag; returns the first.
    fn blocks(&mut self, what: &str, out: &mut String) -> Result<usize> {
        let count = self.count(what, 20)?;
        let rest = [self.size(what)?, self.size(what)?, self.size(what)?];
        put(out, format_args!("{count} {} {} {}\n", rest[0], rest[1], rest[2]));
        Ok(count)
    }

    fn nodes(&mut self, out: &mut String) -> Result<()> {
        for _ in 0..self.blocks("blocks of nodes", out)? {
            let [dimension, entity, parametric] = [(); 3].map(|()| self.int("a block of nodes"));
            let (dimension, parametric) = (dimension?, parametric?);
            let count = self.count("nodes", 32)?;
            put(out, format_args!("{dimension} {} {parametric} {count}\n", entity?));
            for _ in 0..count {
                let tag = self.size("a node")?;
                put(out, format_args!("{tag}\n"));
            }
            let more = if parametric != 0 { dimension.clamp(0, 3) as usize } else { 0 };
            for _ in 0..count {
                self.coordinates(3 + more, out)?;
                out.push('\n');
            }
        }
        Ok(())
    }

    fn elements(&mut self, out: &mut String) -> Result<()> {
        for _ in 0..self.blocks("blocks of elements", out)? {
            let [dimension, entity, kind] = [(); 3].map(|()| self.int("a block of elements"));
            let (dimension, entity, kind) = (dimension?, entity?, kind?);
            let nodes = self.nodes_of(kind)?;
            let count = self.count("elements", 8 * (1 + nodes))?;
            put(out, format_args!("{dimension} {entity} {kind} {count}\n"));
            for _ in 0..count {
                for _ in 0..=nodes {
                    let number = self.size("an element")?;
                    put(out, format_args!(" {number}"));
                }
                out.push('\n');
            }
        }
        Ok(())
    }

    /// How many nodes an element of a type has.
    fn nodes_of(&self, kind: i32) -> Result<usize> {
        let simplex = SIMPLEX.iter().position(|simplex| i64::from(*simplex) == i64::from(kind));
        simplex.map(|dimension| dimension + 1).ok_or_else(|| {
            self.error(format!(
                "elements of type {kind}, allowed are points, lines, triangles and tetrahedra of first order"
            ))
        })
    }

    /// The line with a number before what is binary, in format 2.2.
    fn old_count(&mut self, what: &str, bytes: usize, out: &mut String) -> Result<usize> {
        let count = self.line().and_then(|line| line.trim().parse().ok());
        let count = count.ok_or_else(|| self.error(format!("no number of {what}")))?;
        put(out, format_args!("{count}\n"));
        self.check_count(count, what, bytes)
    }

    fn old_nodes(&mut self, out: &mut String) -> Result<()> {
        for _ in 0..self.old_count("nodes", 28, out)? {
            self.ints(1, "a node", out)?;
            self.coordinates(3, out)?;
            out.push('\n');
        }
        Ok(())
    }

    fn old_elements(&mut self, out: &mut String) -> Result<()> {
        let mut left = self.old_count("elements", 4, out)?;
        while left > 0 {
            let [kind, count, tags] = [(); 3].map(|()| self.int("a block of elements"));
            let (kind, count, tags) = (kind?, count?, tags?);
            let nodes = self.nodes_of(kind)?;
            let (Ok(count), Ok(tags)) = (usize::try_from(count), usize::try_from(tags)) else {
                return Err(self.error(format!("{count} elements with {tags} tags")));
            };
            if count == 0 || count > left {
                return Err(self.error(format!("{count} elements where up to {left} should be")));
            }
            for _ in 0..count {
                self.ints(1, "an element", out)?;
                put(out, format_args!(" {kind} {tags}"));
                self.ints(tags + nodes, "an element", out)?;
                out.push('\n');
            }
            left -= count;
        }
        Ok(())
    }
}

/// A String takes any text.
fn put(out: &mut String, text: std::fmt::Arguments) {
    let _ = out.write_fmt(text);
}
