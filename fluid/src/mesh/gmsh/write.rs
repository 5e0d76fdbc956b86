//! Writing.

use super::SIMPLEX;
use crate::mesh::Mesh;
use crate::{Error, Result, Vector};
use std::fmt::Write;
use std::path::Path;

impl<const D: usize> Mesh<D> {
    /// Writes the mesh as .msh 4.1 in text form. Reading it again gives the same points and cells, to the last bit.
    pub fn write_msh(&self, path: &Path) -> Result<()> {
        let text = self.to_msh()?;
        std::fs::write(path, text).map_err(|error| Error::Mesh(format!("{}: {error}", path.display())))
    }

    /// The text of a .msh 4.1 file: a physical group and an entity for each boundary, and one for the cells.
    pub fn to_msh(&self) -> Result<String> {
        if let Some(part) = self.boundaries.iter().find(|part| part.name.contains(['"', '\n', '\r'])) {
            let text = format!(
                "the boundary name {:?} has quotes or line breaks, which .msh cannot hold",
                part.name
            );
            return Err(Error::Mesh(text));
        }
        let mut out = String::with_capacity(100 * self.points.len());
        // A String takes any text: the error of `fmt::Write` cannot occur, but it need not be unwrapped either.
        self.sections(&mut out).map_err(|error| Error::Mesh(error.to_string()))?;
        Ok(out)
    }

    fn sections(&self, out: &mut String) -> std::fmt::Result {
        let parts = self.boundaries.len();
        writeln!(out, "$MeshFormat\n4.1 0 8\n$EndMeshFormat")?;
        writeln!(out, "$PhysicalNames\n{}", parts + 1)?;
        for (i, part) in self.boundaries.iter().enumerate() {
            writeln!(out, "{} {} \"{}\"", D - 1, i + 1, part.name)?;
        }
        writeln!(out, "{D} {} \"cells\"\n$EndPhysicalNames", parts + 1)?;

        let mut counts = [0; 4];
        (counts[D - 1], counts[D]) = (parts, 1);
        let [a, b, c, d] = counts;
        writeln!(out, "$Entities\n{a} {b} {c} {d}")?;
        let (lower, upper) = self.bounds();
        let bounds = format!("{} {}", three(&lower), three(&upper));
        for i in 1..=parts {
            writeln!(out, "{i} {bounds} 1 {i} 0")?;
        }
        writeln!(out, "1 {bounds} 1 {} 0\n$EndEntities", parts + 1)?;

        let nodes = self.points.len();
        writeln!(out, "$Nodes\n1 {nodes} 1 {nodes}\n{D} 1 0 {nodes}")?;
        (1..=nodes).try_for_each(|node| writeln!(out, "{node}"))?;
        self.points.iter().try_for_each(|p| writeln!(out, "{}", three(p)))?;

        let facets: usize = self.boundaries.iter().map(|part| part.cells.len()).sum();
        let elements = facets + self.cell_count();
        writeln!(out, "$EndNodes\n$Elements\n{} {elements} 1 {elements}", parts + 1)?;
        let mut tag = 0;
        for (i, part) in self.boundaries.iter().enumerate() {
            writeln!(out, "{} {} {} {}", D - 1, i + 1, SIMPLEX[D - 1], part.cells.len())?;
            elements_of(out, &mut tag, part.facets.chunks_exact(D))?;
        }
        writeln!(out, "{D} 1 {} {}", SIMPLEX[D], self.cell_count())?;
        elements_of(out, &mut tag, self.cells.chunks_exact(D + 1))?;
        writeln!(out, "$EndElements")
    }
}

fn elements_of<'a>(
    out: &mut String,
    tag: &mut usize,
    elements: impl Iterator<Item = &'a [u32]>,
) -> std::fmt::Result {
    for nodes in elements {
        *tag += 1;
        write!(out, "{tag}")?;
        nodes.iter().try_for_each(|node| write!(out, " {}", node + 1))?;
        writeln!(out)?;
    }
    Ok(())
}

/// Three coordinates, in the shortest form that is read back to the same number.
fn three<const D: usize>(p: &Vector<D>) -> String {
    let z = if D == 3 { p[D - 1] } else { 0.0 };
    format!("{:?} {:?} {z:?}", p[0], p[1])
}
