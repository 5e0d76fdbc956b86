//! The mesh of a flow where it is now: its elements, and how its nodes move.

use crate::element::Element;
use crate::{Error, Mesh, Result, Vector};

/// Where the nodes of a moving mesh are at the end of a step, and how they came there.
#[derive(Clone, Copy, Debug)]
pub struct MeshMotion<'a, const D: usize> {
    /// Places of the nodes at the end of the step, m: the equations are solved there.
    pub points: &'a [Vector<D>],
    /// Velocity u_mesh of the nodes, m/s: the way from their places at the start of the step, over its length.
    pub velocity: &'a [Vector<D>],
}

/// A mesh with all that follows from the places of its nodes; `B` is `D + 1`.
pub struct Geometry<const D: usize, const B: usize> {
    /// The mesh.
    pub mesh: Mesh<D>,
    /// Its cells.
    pub elements: Vec<Element<D, B>>,
    /// Integral of each shape function, m3 (m2 in the plane).
    pub nodal_volume: Vec<f64>,
    /// Velocity of the nodes, m/s; empty while they stand still.
    velocity: Vec<Vector<D>>,
}

impl<const D: usize, const B: usize> Geometry<D, B> {
    /// A mesh that stands still.
    ///
    /// # Errors
    /// Flat or inverted cells.
    pub fn new(mesh: Mesh<D>) -> Result<Self> {
        const { assert!(B == D + 1) };
        let (elements, velocity) = (Vec::new(), Vec::new());
        let mut geometry = Self { mesh, elements, nodal_volume: Vec::new(), velocity };
        geometry.measure()?;
        Ok(geometry)
    }

    /// Takes the motion of a step; without one the mesh stands still where it is.
    ///
    /// # Errors
    /// Places or velocities of another number of nodes, cells that become flat or inverted.
    pub fn follow(&mut self, motion: Option<&MeshMotion<'_, D>>) -> Result<()> {
        self.velocity.clear();
        let Some(MeshMotion { points, velocity }) = motion else { return Ok(()) };
        let nodes = self.mesh.points.len();
        if points.len() != nodes || velocity.len() != nodes {
            let (places, velocities) = (points.len(), velocity.len());
            return Err(Error::Mesh(format!(
                "{places} places and {velocities} velocities for the {nodes} nodes of the mesh"
            )));
        }
        self.mesh.points.copy_from_slice(points);
        self.velocity.extend_from_slice(velocity);
        self.measure()
    }

    fn measure(&mut self) -> Result<()> {
        let mesh = &self.mesh;
        self.elements.clear();
        self.elements.extend(
            mesh.cells
                .chunks_exact(B)
                .map(|cell| Element::new(std::array::from_fn(|a| mesh.points[cell[a] as usize]))),
        );
        let flat = |element: &Element<D, B>| element.measure <= 0.0 || !element.measure.is_finite();
        if let Some(flat) = self.elements.iter().position(flat) {
            return Err(Error::Mesh(format!("cell {flat} of the mesh is flat or inverted")));
        }
        self.nodal_volume = mesh.nodal_volume();
        Ok(())
    }

    /// Velocity of the nodes, m/s; `None` while they stand still.
    pub fn motion(&self) -> Option<&[Vector<D>]> {
        (!self.velocity.is_empty()).then_some(&self.velocity[..])
    }

    /// Velocity of a node, m/s.
    pub fn velocity_of(&self, node: usize) -> Vector<D> {
        self.velocity.get(node).copied().unwrap_or_else(Vector::zeros)
    }

    /// The nodes of a cell.
    pub fn nodes(&self, cell: usize) -> [usize; B] {
        std::array::from_fn(|a| self.mesh.cells[B * cell + a] as usize)
    }

    /// Where the nodes of a cell are, m.
    pub fn places(&self, cell: usize) -> [Vector<D>; B] {
        self.nodes(cell).map(|node| self.mesh.points[node])
    }

    /// Volume of the mesh, m3 (m2 in the plane).
    pub fn volume(&self) -> f64 {
        self.nodal_volume.iter().sum()
    }
}
