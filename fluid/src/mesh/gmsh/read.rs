//! Reading.

use super::{SIMPLEX, binary};
use crate::mesh::Mesh;
use crate::{Error, Result, Vector};
use std::collections::HashMap;
use std::path::Path;
use std::str::{FromStr, Lines, SplitWhitespace};

impl<const D: usize> Mesh<D> {
    /// Reads a mesh of triangles (2D, z constant) or tetrahedra (3D) from a .msh file of format 4.1 or 2.2, as text or
    /// binary.
    ///
    /// Boundaries are named by physical groups of curves (2D) or surfaces (3D), a group without name by its number.
    /// Every boundary facet must belong to exactly one group; groups inside the mesh are passed over, and so are nodes
    /// that no cell uses. Nodes and cells keep the order of the file.
    pub fn read_msh(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let bytes = std::fs::read(path).map_err(|error| Error::Mesh(format!("{name}: {error}")))?;
        Self::parse_msh(&binary::as_text(&bytes, &name)?, &name)
    }

    /// Reads a mesh from the text of a .msh file; `name` is the name of the file in errors.
    pub fn parse_msh(text: &str, name: &str) -> Result<Self> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut file = Source { name, lines: text.lines(), number: 0 };
        let mut contents = Contents::default();
        contents.read::<D>(&mut file)?;
        contents.into_mesh(name)
    }
}

/// The lines of a file and where we are in it.
struct Source<'a> {
    name: &'a str,
    lines: Lines<'a>,
    number: usize,
}

impl<'a> Source<'a> {
    fn error(&self, text: impl std::fmt::Display) -> Error {
        Error::Mesh(format!("{}:{}: {text}", self.name, self.number))
    }

    fn maybe_line(&mut self) -> Option<&'a str> {
        self.number += 1;
        self.lines.next()
    }

    fn line(&mut self, what: &str) -> Result<&'a str> {
        self.maybe_line().ok_or_else(|| self.error(format!("the file ends where {what} should be")))
    }

    fn row(&mut self, what: &'static str) -> Result<Row<'a>> {
        let words = self.line(what)?.split_whitespace();
        Ok(Row { place: format!("{}:{}", self.name, self.number), what, words })
    }
}

/// The words of a line.
struct Row<'a> {
    place: String,
    what: &'static str,
    words: SplitWhitespace<'a>,
}

impl Row<'_> {
    fn next<T: FromStr>(&mut self) -> Result<T> {
        let word = self.words.next();
        word.and_then(|word| word.parse().ok()).ok_or_else(|| {
            let found = word.map_or("the end of the line".into(), |word| format!("\"{word}\""));
            Error::Mesh(format!("{}: {found} where a number of {} should be", self.place, self.what))
        })
    }

    fn skip(&mut self, count: usize) -> Result<()> {
        (0..count).try_for_each(|_| self.next::<f64>().map(|_| ()))
    }
}

#[derive(Default)]
struct Contents {
    /// Names of the physical groups of facets by number.
    names: HashMap<i64, String>,
    /// The physical groups of each entity that carries facets, and the line that says so.
    groups: HashMap<i64, Vec<i64>>,
    nodes: HashMap<u64, u32>,
    points: Vec<[f64; 3]>,
    cells: Vec<u32>,
    /// Nodes of each facet and its entity.
    facets: Vec<(Vec<u32>, i64)>,
    /// Whether the format is 2.2, in which elements carry their groups themselves.
    old: bool,
    seen: Vec<&'static str>,
}

impl Contents {
    fn read<const D: usize>(&mut self, file: &mut Source) -> Result<()> {
        while let Some(line) = file.maybe_line() {
            let section = match line.trim() {
                "" => continue,
                "$MeshFormat" => {
                    self.old = read_format(file)? == "2.2";
                    "MeshFormat"
                }
                "$PhysicalNames" => {
                    self.read_names::<D>(file)?;
                    "PhysicalNames"
                }
                "$NOD" => {
                    return Err(file.error(format!("a file of format 1{CONVERT}")));
                }
                "$ParametricNodes" => {
                    return Err(file.error("the nodes are parametric: save with Mesh.SaveParametric = 0"));
                }
                "$PartitionedEntities" => {
                    return Err(file.error(
                        "the mesh is partitioned: save it whole, with Mesh.PartitionCreateTopology = 0 or after \
                         `UnpartitionMesh;`",
                    ));
                }
                "$Entities" => {
                    self.read_entities::<D>(file)?;
                    "Entities"
                }
                "$Nodes" => {
                    if self.old {
                        self.read_old_nodes(file)?
                    } else {
                        self.read_nodes(file)?
                    }
                    "Nodes"
                }
                "$Elements" => {
                    if self.old {
                        self.read_old_elements::<D>(file)?
                    } else {
                        self.read_elements::<D>(file)?
                    }
                    "Elements"
                }
                other => {
                    let Some(section) = other.strip_prefix('$') else {
                        return Err(
                            file.error(format!("\"{other}\" where a section like $Nodes should start"))
                        );
                    };
                    let end = format!("$End{section}");
                    while file.line(&end)?.trim() != end {}
                    continue;
                }
            };
            let end = file.line("the end of the section")?.trim();
            if end.strip_prefix("$End") != Some(section) {
                return Err(file.error(format!("\"{end}\" where $End{section} should be")));
            }
            self.seen.push(section);
            if self.seen[0] != "MeshFormat" {
                return Err(file.error("the file must start with $MeshFormat"));
            }
        }
        let mut needed =
            ["MeshFormat", "Nodes", "Elements"].iter().chain(if self.old { &[][..] } else { &["Entities"] });
        match needed.find(|name| !self.seen.contains(name)) {
            Some(missing) => Err(Error::Mesh(format!("{}: there is no section ${missing}", file.name))),
            None => Ok(()),
        }
    }

    fn read_names<const D: usize>(&mut self, file: &mut Source) -> Result<()> {
        for _ in 0..file.row("names")?.next::<usize>()? {
            let line = file.line("a physical name")?;
            let mut words = line.splitn(2, '"');
            let numbers: Vec<i64> =
                words.next().unwrap_or("").split_whitespace().filter_map(|word| word.parse().ok()).collect();
            let name = words.next().and_then(|rest| rest.trim_end().strip_suffix('"'));
            let (&[dimension, group], Some(name)) = (numbers.as_slice(), name) else {
                return Err(file.error(format!("\"{line}\" where dimension, number and \"name\" should be")));
            };
            if dimension == D as i64 - 1 {
                if name.trim().is_empty() || self.names.values().any(|other| other == name) {
                    let text = format!("\"{name}\" where a name that is not empty and not used should be");
                    return Err(file.error(text));
                }
                self.names.insert(group, name.into());
            }
        }
        Ok(())
    }

    fn read_entities<const D: usize>(&mut self, file: &mut Source) -> Result<()> {
        let mut row = file.row("points, curves, surfaces and volumes")?;
        let counts: [usize; 4] = [row.next()?, row.next()?, row.next()?, row.next()?];
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                let mut row = file.row("an entity")?;
                let entity: i64 = row.next()?;
                // A point has three coordinates, all others a box.
                row.skip(if dimension == 0 { 3 } else { 6 })?;
                let count: usize = row.next()?;
                let groups: Vec<i64> = (0..count).map(|_| row.next()).collect::<Result<_>>()?;
                if dimension + 1 == D {
                    // Negative numbers mean opposite orientation.
                    self.groups.insert(entity, groups.into_iter().map(i64::abs).collect());
                }
            }
        }
        Ok(())
    }

    /// A node by its number in the file, and where it is.
    fn add_node(&mut self, tag: u64, point: [f64; 3], file: &Source) -> Result<()> {
        if self.nodes.insert(tag, self.nodes.len() as u32).is_some() {
            return Err(file.error(format!("node {tag} occurs twice")));
        }
        if !point.iter().all(|x| x.is_finite()) {
            return Err(file.error(format!("{point:?} where finite coordinates should be")));
        }
        self.points.push(point);
        Ok(())
    }

    fn read_old_nodes(&mut self, file: &mut Source) -> Result<()> {
        for _ in 0..file.row("nodes")?.next::<usize>()? {
            let mut row = file.row("coordinates")?;
            let (tag, point) = (row.next()?, [row.next()?, row.next()?, row.next()?]);
            self.add_node(tag, point, file)?;
        }
        Ok(())
    }

    /// Elements with tags, the first of which is the physical group; one that is in several is there as often.
    fn read_old_elements<const D: usize>(&mut self, file: &mut Source) -> Result<()> {
        for _ in 0..file.row("elements")?.next::<usize>()? {
            let mut row = file.row("an element")?;
            row.skip(1)?;
            let (kind, tags): (u32, usize) = (row.next()?, row.next()?);
            let group: i64 = if tags == 0 { 0 } else { row.next()? };
            row.skip(tags.saturating_sub(1))?;
            let Some(dimension) = SIMPLEX.iter().position(|simplex| *simplex == kind) else {
                return Err(file.error(wrong_elements::<D>(&format!("elements of type {kind}"))));
            };
            if group != 0 && dimension + 1 == D {
                self.groups.insert(group.abs(), vec![group.abs()]);
            }
            self.add_element::<D>(dimension, group.abs(), row, file)?;
        }
        Ok(())
    }

    /// An element from the rest of its row, the nodes; `entity` says in which groups a facet is.
    fn add_element<const D: usize>(
        &mut self,
        dimension: usize,
        entity: i64,
        mut row: Row,
        file: &Source,
    ) -> Result<()> {
        if dimension + 1 < D {
            return Ok(());
        }
        let mut nodes = Vec::with_capacity(dimension + 1);
        for _ in 0..=dimension {
            let tag: u64 = row.next()?;
            let Some(&node) = self.nodes.get(&tag) else {
                return Err(file.error(format!("there is no node {tag}")));
            };
            nodes.push(node);
        }
        if dimension == D {
            self.cells.extend(nodes);
        } else {
            nodes.sort_unstable();
            self.facets.push((nodes, entity));
        }
        Ok(())
    }

    fn read_nodes(&mut self, file: &mut Source) -> Result<()> {
        for _ in 0..file.row("node blocks")?.next::<usize>()? {
            let mut row = file.row("dimension, entity, parameters and count of nodes")?;
            row.skip(3)?;
            let count: usize = row.next()?;
            let tags: Vec<u64> = (0..count).map(|_| file.row("a node")?.next()).collect::<Result<_>>()?;
            for tag in tags {
                let mut row = file.row("coordinates")?;
                self.add_node(tag, [row.next()?, row.next()?, row.next()?], file)?;
            }
        }
        Ok(())
    }

    fn read_elements<const D: usize>(&mut self, file: &mut Source) -> Result<()> {
        for _ in 0..file.row("element blocks")?.next::<usize>()? {
            let mut row = file.row("dimension, entity, type and count of elements")?;
            let (dimension, entity, kind): (usize, i64, u32) = (row.next()?, row.next()?, row.next()?);
            let count: usize = row.next()?;
            let kept = dimension + 1 >= D;
            if dimension > D || (kept && kind != SIMPLEX[dimension]) {
                let what = format!("elements of type {kind} and dimension {dimension}");
                return Err(file.error(wrong_elements::<D>(&what)));
            }
            for _ in 0..count {
                let mut row = file.row("an element")?;
                if kept {
                    row.skip(1)?;
                    self.add_element::<D>(dimension, entity, row, file)?;
                }
            }
        }
        Ok(())
    }

    fn into_mesh<const D: usize>(self, name: &str) -> Result<Mesh<D>> {
        let error = |text: String| Error::Mesh(format!("{name}: {text}"));
        if self.cells.is_empty() {
            return Err(error(format!("there are no {}", ["triangles", "tetrahedra"][D - 2])));
        }
        let (kept, cells) = self.used_points();
        if D == 2 {
            let z = kept.iter().map(|&i| self.points[i as usize][2]);
            let (low, high) = z.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
            let extent =
                kept.iter().flat_map(|&i| self.points[i as usize]).fold(0.0, |m: f64, x| m.max(x.abs()));
            if high - low > 1e-12 * extent {
                return Err(error(format!(
                    "z goes from {low} to {high}; in a plane mesh it must be constant"
                )));
            }
        }
        let at = |&i: &u32| Vector::<D>::from_fn(|k, _| self.points[i as usize][k]);
        let points: Vec<_> = kept.iter().map(at).collect();

        // Parts in the order of their numbers.
        let mut groups: Vec<i64> =
            self.groups.values().flatten().copied().chain(self.names.keys().copied()).collect();
        groups.sort_unstable();
        groups.dedup();
        let label = |group: &i64| self.names.get(group).cloned().unwrap_or(group.to_string());
        let names: Vec<String> = groups.iter().map(label).collect();
        let mut part_of: HashMap<&[u32], Vec<i64>> = HashMap::new();
        for (facet, entity) in &self.facets {
            let found = part_of.entry(facet).or_default();
            found.extend(self.groups.get(entity).into_iter().flatten());
            found.sort_unstable();
            found.dedup();
        }
        let mesh = Mesh::with_boundaries(points, cells, &names, |facet| {
            let mut nodes: Vec<u32> = facet.iter().map(|&node| kept[node as usize]).collect();
            nodes.sort_unstable();
            let place =
                || nodes.iter().map(|&i| format!("{:?}", &self.points[i as usize][..D])).collect::<Vec<_>>();
            match part_of.get(nodes.as_slice()).map(Vec::as_slice) {
                Some([group]) => Ok(groups.binary_search(group).unwrap_or(0)),
                None | Some([]) => Err(error(format!(
                    "the boundary facet between {} is in no physical group: every part of the boundary needs a name",
                    place().join(" and ")
                ))),
                Some(several) => Err(error(format!(
                    "the boundary facet between {} is in the physical groups {}; only one is allowed",
                    place().join(" and "),
                    several.iter().map(label).collect::<Vec<_>>().join(", ")
                ))),
            }
        })?;
        match mesh.check() {
            Err(Error::Mesh(text)) => Err(error(text)),
            Err(other) => Err(other),
            Ok(()) => Ok(mesh),
        }
    }

    /// The points that cells use, in the order of the file, and the cells by their new numbers.
    fn used_points(&self) -> (Vec<u32>, Vec<u32>) {
        let mut number = vec![u32::MAX; self.points.len()];
        self.cells.iter().for_each(|&node| number[node as usize] = 0);
        let kept: Vec<u32> = (0..number.len() as u32).filter(|&node| number[node as usize] == 0).collect();
        kept.iter().enumerate().for_each(|(new, &old)| number[old as usize] = new as u32);
        let cells = self.cells.iter().map(|&node| number[node as usize]).collect();
        (kept, cells)
    }
}

/// What is wrong with elements that are no simplices of the mesh or its boundary.
fn wrong_elements<const D: usize>(what: &str) -> String {
    format!(
        "{what}; allowed here are {} of type {} and {} of type {}, all of first order",
        ["lines", "triangles", "tetrahedra"][D - 1],
        SIMPLEX[D],
        ["points", "lines", "triangles"][D - 1],
        SIMPLEX[D - 1]
    )
}

/// How a file becomes one that can be read.
const CONVERT: &str = ", allowed are 4.1 and 2.2: convert it with `gmsh FILE -0 -format msh41 -o NEW`";

/// The version of the format.
fn read_format<'a>(file: &mut Source<'a>) -> Result<&'a str> {
    let line = file.line("version and file type")?;
    let version = line.split_whitespace().next().unwrap_or_default();
    if !["4.1", "2.2"].contains(&version) {
        return Err(file.error(format!("format {version}{CONVERT}")));
    }
    if line.split_whitespace().nth(1) != Some("0") {
        return Err(file.error("a binary file where text should be"));
    }
    Ok(version)
}
