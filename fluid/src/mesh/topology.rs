//! Which cells touch which: neighbours across facets, the boundary, and the check that a mesh is one.

use super::{Boundary, Mesh, Periodic};
use crate::{Error, Result, Vector};

/// The cell across each facet: `D + 1` per cell, the `k`-th lies opposite node `k`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Neighbours<const D: usize> {
    /// Cell numbers, [`Neighbours::NONE`] where the facet lies on the boundary.
    pub across: Vec<u32>,
}

/// Largest coordinate of a node, m: the boxes of a search span the mesh.
const FAR: f64 = 1e9;

impl<const D: usize> Neighbours<D> {
    /// Beyond this facet there is no cell.
    pub const NONE: u32 = u32::MAX;

    /// The cells across the facets of a cell, in the order of the opposite nodes.
    pub fn of(&self, cell: usize) -> &[u32] {
        &self.across[cell * (D + 1)..(cell + 1) * (D + 1)]
    }
}

/// The nodes of the facet opposite node `k`, in the order that makes its normal point out of the cell.
///
/// In 2D the edges of an anticlockwise triangle, in 3D the faces of a tetrahedron of positive volume:
/// (1,2,3), (0,3,2), (0,1,3), (0,2,1), each anticlockwise seen from outside.
pub(crate) fn facet<const D: usize>(nodes: &[u32], k: usize) -> [u32; 3] {
    const OF_TETRAHEDRON: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
    match D {
        2 => [nodes[(k + 1) % 3], nodes[(k + 2) % 3], u32::MAX],
        _ => OF_TETRAHEDRON[k].map(|i| nodes[i]),
    }
}

fn key(mut facet: [u32; 3]) -> [u32; 3] {
    facet.sort_unstable();
    facet
}

impl<const D: usize> Mesh<D> {
    /// The cell across each facet, also across periodic sides. An error if a facet belongs to more than two cells.
    pub fn neighbours(&self) -> Result<Neighbours<D>> {
        let mut sides: Vec<([u32; 3], u32)> = Vec::with_capacity(self.cells.len());
        for (cell, nodes) in self.cells.chunks_exact(D + 1).enumerate() {
            let one = |node: u32| if node == u32::MAX { node } else { self.periodic.master(node) };
            let facet = |k: usize| key(facet::<D>(nodes, k).map(one));
            sides.extend((0..=D).map(|k| (facet(k), (cell * (D + 1) + k) as u32)));
        }
        sides.sort_unstable();
        let mut across = vec![Neighbours::<D>::NONE; self.cells.len()];
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            match group {
                [_] => {}
                [(_, a), (_, b)] => {
                    across[*a as usize] = b / (D + 1) as u32;
                    across[*b as usize] = a / (D + 1) as u32;
                }
                _ => {
                    let nodes = &group[0].0[..D];
                    let text = format!("the facet of nodes {nodes:?} belongs to {} cells", group.len());
                    return Err(Error::Mesh(text));
                }
            }
        }
        Ok(Neighbours { across })
    }

    /// A mesh of points and cells; `part_of` says for the nodes of each boundary facet which of the names it has.
    /// Cells of negative orientation are turned; boundaries without facets are left out.
    pub fn with_boundaries(
        points: Vec<Vector<D>>,
        cells: Vec<u32>,
        names: &[String],
        mut part_of: impl FnMut(&[u32]) -> Result<usize>,
    ) -> Result<Self> {
        let mut mesh = Self { points, cells, boundaries: Vec::new(), periodic: Periodic::default() };
        mesh.check_cells()?;
        for cell in 0..mesh.cell_count() {
            if mesh.measure(cell) < 0.0 {
                mesh.cells.swap(cell * (D + 1) + D - 1, cell * (D + 1) + D);
            }
        }
        let empty = |name: &String| Boundary { name: name.clone(), facets: Vec::new(), cells: Vec::new() };
        let mut parts: Vec<Boundary> = names.iter().map(empty).collect();
        for (i, _) in mesh.boundary_facets()? {
            let (cell, k) = (i / (D + 1), i % (D + 1));
            let nodes = facet::<D>(mesh.cell(cell), k);
            let part = &mut parts[part_of(&nodes[..D])?];
            part.facets.extend_from_slice(&nodes[..D]);
            part.cells.push(cell as u32);
        }
        mesh.boundaries = parts.into_iter().filter(|part| !part.cells.is_empty()).collect();
        Ok(mesh)
    }

    /// The facets without a neighbour: place in `cells` of the opposite node, and the sorted nodes.
    fn boundary_facets(&self) -> Result<Vec<(usize, [u32; 3])>> {
        let across = self.neighbours()?.across;
        let alone = across.iter().enumerate().filter(|&(_, &cell)| cell == Neighbours::<D>::NONE);
        let with_nodes = |(i, _)| (i, key(facet::<D>(self.cell(i / (D + 1)), i % (D + 1))));
        Ok(alone.map(with_nodes).collect())
    }

    /// Whether the mesh is whole: nodes exist and are finite, cells have positive measure and do not fold over each
    /// other, every boundary facet is in exactly one part, points outwards and names its cell, and every node is used.
    pub fn check(&self) -> Result<()> {
        self.check_cells()?;
        if let Some(cell) = (0..self.cell_count()).find(|&cell| self.measure(cell) <= 0.0) {
            let text = format!("cell {cell} has measure {:e}; it must be positive", self.measure(cell));
            return Err(Error::Mesh(text));
        }
        let mut used = vec![false; self.points.len()];
        self.cells.iter().for_each(|&node| used[node as usize] = true);
        if let Some(node) = used.iter().position(|used| !used) {
            return Err(Error::Mesh(format!("node {node} belongs to no cell")));
        }
        self.check_folds()?;
        self.check_boundaries()
    }

    /// Whether cells that share a facet lie on its two sides.
    fn check_folds(&self) -> Result<()> {
        let across = self.neighbours()?.across;
        for (i, &other) in across.iter().enumerate().filter(|(_, other)| **other != Neighbours::<D>::NONE) {
            let (cell, other) = (i / (D + 1), other as usize);
            let of = |cell: usize, k: usize| {
                let nodes = facet::<D>(self.cell(cell), k);
                std::array::from_fn::<u32, D, _>(|i| self.periodic.master(nodes[i]))
            };
            let nodes = of(cell, i % (D + 1));
            if (0..=D).any(|k| same_turn::<D>(&nodes, &of(other, k))) {
                let place = self.points[nodes[0] as usize];
                return Err(Error::Mesh(format!(
                    "the mesh is folded: its cells {cell} and {other} lie on the same side of the facet that they \
                     share, at {:?}",
                    place.as_slice()
                )));
            }
        }
        Ok(())
    }

    fn check_cells(&self) -> Result<()> {
        if !(2..=3).contains(&D) {
            return Err(Error::Mesh(format!("a mesh has 2 or 3 dimensions, not {D}")));
        }
        let too_long = self.cells.len() >= u32::MAX as usize;
        if self.cells.is_empty() || !self.cells.len().is_multiple_of(D + 1) || too_long {
            let text = format!("{} node numbers are no list of cells of {}", self.cells.len(), D + 1);
            return Err(Error::Mesh(text));
        }
        if let Some(node) = self.points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(Error::Mesh(format!("node {node} is not finite")));
        }
        if let Some(node) = self.points.iter().position(|p| p.amax() > FAR) {
            let place = self.points[node].as_slice();
            return Err(Error::Mesh(format!(
                "node {node} lies at {place:?}: coordinates are in m, {FAR:e} at most"
            )));
        }
        let count = self.points.len();
        if let Some(i) = self.cells.iter().position(|&node| node as usize >= count) {
            let text = format!("cell {} names node {}; there are {count}", i / (D + 1), self.cells[i]);
            return Err(Error::Mesh(text));
        }
        Ok(())
    }

    fn check_boundaries(&self) -> Result<()> {
        let mut tagged = Vec::new();
        for (i, part) in self.boundaries.iter().enumerate() {
            if part.facets.len() != part.cells.len() * D {
                return Err(Error::Mesh(format!(
                    "boundary \"{}\": facets and cells differ in number",
                    part.name
                )));
            }
            if self.boundaries[..i].iter().any(|other| other.name == part.name) {
                return Err(Error::Mesh(format!("boundary \"{}\" occurs twice", part.name)));
            }
            for (nodes, &cell) in part.facets.chunks_exact(D).zip(&part.cells) {
                let outwards = (cell as usize) < self.cell_count()
                    && (0..=D).any(|k| same_turn::<D>(nodes, &facet::<D>(self.cell(cell as usize), k)[..D]));
                if !outwards {
                    let name = &part.name;
                    let text =
                        format!("boundary \"{name}\": facet {nodes:?} is no outward facet of cell {cell}");
                    return Err(Error::Mesh(text));
                }
                let mut padded = [u32::MAX; 3];
                padded[..D].copy_from_slice(nodes);
                tagged.push(key(padded));
            }
        }
        tagged.sort_unstable();
        let mut alone: Vec<_> = self.boundary_facets()?.into_iter().map(|(_, nodes)| nodes).collect();
        alone.sort_unstable();
        if tagged != alone {
            let differs = tagged.iter().zip(&alone).find(|(a, b)| a != b).map(|(a, b)| a.min(b));
            let text = match differs.or(alone.last()) {
                Some(nodes) => format!(
                    "the boundary parts hold {} facets, the mesh has {}; first difference at nodes {:?}",
                    tagged.len(),
                    alone.len(),
                    &nodes[..D]
                ),
                None => "boundary parts of a mesh without boundary".into(),
            };
            return Err(Error::Mesh(text));
        }
        Ok(())
    }
}

/// Whether two facets are the same nodes in the same cyclic order.
fn same_turn<const D: usize>(a: &[u32], b: &[u32]) -> bool {
    let shifts = if D == 2 { 1 } else { 3 };
    (0..shifts).any(|shift| (0..D).all(|i| a[i] == b[(i + shift) % D]))
}
