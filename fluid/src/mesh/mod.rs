//! Simplicial meshes with named boundary parts: made from a [description](domain), read from Gmsh, searched.

pub mod domain;
mod generate;
mod gmsh;
mod locate;
mod outline;
mod periodic;
mod quality;
mod refine;
mod remesh;
mod renumber;
mod shape;
mod smooth;
mod topology;

pub use domain::{Diagonals, Hole, Part, Place, Rectangle, Refinement, Side, Sides, Structured};
pub use locate::Locator;
pub use periodic::Periodic;
pub use quality::Quality;
pub use remesh::Remeshed;
pub use topology::Neighbours;

use crate::{Error, Result, Vector};
use serde::{Deserialize, Serialize};

/// A simplicial mesh. Cells are read `D + 1` node numbers at a time, facets `D` at a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mesh<const D: usize> {
    /// Node positions, m.
    pub points: Vec<Vector<D>>,
    /// Node numbers, `D + 1` per cell, positively oriented.
    pub cells: Vec<u32>,
    /// The named parts of the boundary; every boundary facet is in exactly one.
    pub boundaries: Vec<Boundary>,
    /// Sides that are one; they are no boundary.
    pub periodic: Periodic<D>,
}

/// A named part of the boundary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Boundary {
    /// The name that conditions refer to.
    pub name: String,
    /// Node numbers, `D` per facet, oriented so that the normal points out of the mesh
    /// (2D: the normal is the right hand of the way from the first node to the second).
    pub facets: Vec<u32>,
    /// The cell behind each facet.
    pub cells: Vec<u32>,
}

impl<const D: usize> Mesh<D> {
    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.cells.len() / (D + 1)
    }

    /// The nodes of a cell.
    pub fn cell(&self, cell: usize) -> &[u32] {
        &self.cells[cell * (D + 1)..(cell + 1) * (D + 1)]
    }

    /// [`Self::measure`] of each cell.
    pub fn measures(&self) -> Vec<f64> {
        (0..self.cell_count()).map(|cell| self.measure(cell)).collect()
    }

    /// Area (2D) or volume (3D) of a cell: det of its edges from node 0, over D!; positive when well oriented.
    pub fn measure(&self, cell: usize) -> f64 {
        let nodes = self.cell(cell);
        let origin = self.points[nodes[0] as usize];
        let edge = |k: usize| self.points[nodes[k] as usize] - origin;
        match D {
            2 => {
                let (a, b) = (edge(1), edge(2));
                0.5 * (a[0] * b[1] - a[1] * b[0])
            }
            3 => triple(&edge(1), &edge(2), &edge(3)) / 6.0,
            _ => f64::NAN,
        }
    }

    /// Mean of the nodes of a cell, m.
    pub fn centroid(&self, cell: usize) -> Vector<D> {
        let nodes = self.cell(cell);
        nodes.iter().map(|&n| self.points[n as usize]).sum::<Vector<D>>() / (D + 1) as f64
    }

    /// Barycentric coordinates 1..=D of a point in a cell; coordinate 0 is 1 less their sum.
    /// Each is the measure of the cell with its node moved to the point, over the measure of the cell.
    pub fn barycentric(&self, cell: usize, p: &Vector<D>) -> Vector<D> {
        let nodes = self.cell(cell);
        let origin = self.points[nodes[0] as usize];
        let edge = |k: usize| self.points[nodes[k] as usize] - origin;
        let q = p - origin;
        let mut out = Vector::<D>::repeat(f64::NAN);
        match D {
            2 => {
                let (a, b) = (edge(1), edge(2));
                let whole = a[0] * b[1] - a[1] * b[0];
                out[0] = (q[0] * b[1] - q[1] * b[0]) / whole;
                out[1] = (a[0] * q[1] - a[1] * q[0]) / whole;
            }
            3 => {
                let (a, b, c) = (edge(1), edge(2), edge(3));
                let whole = triple(&a, &b, &c);
                out[0] = triple(&q, &b, &c) / whole;
                out[1] = triple(&a, &q, &c) / whole;
                out[2] = triple(&a, &b, &q) / whole;
            }
            _ => {}
        }
        out
    }

    /// Gradient in a cell of the P1 field with these values at the nodes, in units of the value per m.
    pub fn gradient(&self, cell: usize, value: impl Fn(usize) -> f64) -> Vector<D> {
        let nodes = self.cell(cell);
        let (origin, first) = (self.points[nodes[0] as usize], value(nodes[0] as usize));
        let mut edges = nalgebra::SMatrix::<f64, D, D>::zeros();
        let mut rise = Vector::<D>::zeros();
        for k in 0..D {
            let node = nodes[k + 1] as usize;
            edges.set_column(k, &(self.points[node] - origin));
            rise[k] = value(node) - first;
        }
        crate::element::inverse(&edges).0.tr_mul(&rise)
    }

    /// Area (2D, m2) or volume (3D, m3) of the mesh.
    pub fn volume(&self) -> f64 {
        (0..self.cell_count()).map(|cell| self.measure(cell)).sum()
    }

    /// For each node the integral of its shape function: a share 1/(D + 1) of every cell around it. m2 or m3. That of
    /// nodes that are one is at their master, with zero at the images.
    pub fn nodal_volume(&self) -> Vec<f64> {
        let mut out = vec![0.0; self.points.len()];
        for cell in 0..self.cell_count() {
            let share = self.measure(cell) / (D + 1) as f64;
            for &node in self.cell(cell) {
                out[node as usize] += share;
            }
        }
        self.periodic.gather(&mut out);
        out
    }

    /// Lower and upper corner of the box around all nodes, m.
    pub fn bounds(&self) -> (Vector<D>, Vector<D>) {
        let lower = Vector::<D>::repeat(f64::INFINITY);
        self.points.iter().fold((lower, -lower), |(lower, upper), p| (lower.inf(p), upper.sup(p)))
    }

    /// The boundary part of a name; the error lists the names there are.
    pub fn boundary(&self, name: &str) -> Result<&Boundary> {
        self.boundaries.iter().find(|part| part.name == name).ok_or_else(|| {
            let names: Vec<_> = self.boundaries.iter().map(|part| format!("\"{}\"", part.name)).collect();
            Error::Mesh(format!("the mesh has no boundary \"{name}\"; it has {}", names.join(", ")))
        })
    }
}

/// Determinant of three vectors of space.
fn triple<const D: usize>(a: &Vector<D>, b: &Vector<D>, c: &Vector<D>) -> f64 {
    let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
    a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]
}

impl Boundary {
    /// Length (2D, m) or area (3D, m2) of the part.
    pub fn measure<const D: usize>(&self, mesh: &Mesh<D>) -> f64 {
        let point = |node: u32| mesh.points[node as usize];
        let facet = |nodes: &[u32]| {
            let a = point(nodes[1]) - point(nodes[0]);
            match D {
                2 => a.norm(),
                3 => {
                    // |a x b|^2 = |a|^2 |b|^2 - (a.b)^2
                    let b = point(nodes[2]) - point(nodes[0]);
                    0.5 * (a.norm_squared() * b.norm_squared() - a.dot(&b).powi(2)).max(0.0).sqrt()
                }
                _ => f64::NAN,
            }
        };
        self.facets.chunks_exact(D).map(facet).sum()
    }
}

#[cfg(test)]
mod domain_tests;
#[cfg(test)]
mod tests;
