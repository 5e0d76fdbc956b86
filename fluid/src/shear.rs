//! The shear that grains share with the fluid, cell by cell.
//!
//! Of a velocity gradient of the fluid the grains share all where they go with it, and nothing where they are held:
//!
//! ```text
//! H = s (2 - s) grad u,      s = sum_a K_v : K_u / G_a / sum_a [K_u : K_u / G_a + G_a (h^2 |grad u| / 100)^2]
//! ```
//!
//! The share s is the slope of the regression of the velocities v of the points on those u of the fluid at their places,
//! by the covariances of both with the places x in the cells around each node of the cell,
//! `K_f = sum gamma (f - f_a) (x - x_a)^T` with the means f_a and x_a and G_a = sum gamma. The last term, with the size h
//! of the cell, makes it vanish where the points lie so close together that they tell nothing of a gradient, as one point
//! alone. The share is at least 0 and at most 1. With s (2 - s) the scatter of a few grains that go with the fluid has an
//! effect of its square only. A velocity that alternates from node to node is not shared by grains that go with the mean.

use crate::Vector;
use crate::geometry::Geometry;
use nalgebra::SMatrix;

/// Square of the spread of places, over that of the size of a cell, that tells hardly anything of a gradient.
const SPREAD: f64 = 0.01;

/// Sums over the points of a cell or of all cells around a node, with the weights gamma.
#[derive(Clone, Copy)]
struct Sums<const D: usize> {
    weight: f64,
    place: Vector<D>,
    /// Of the velocities of the fluid and of the points.
    velocity: [Vector<D>; 2],
    /// Of the products of both with the places.
    both: [SMatrix<f64, D, D>; 2],
}

impl<const D: usize> Sums<D> {
    fn none() -> Self {
        let (vector, matrix) = (Vector::zeros(), SMatrix::zeros());
        Self { weight: 0.0, place: vector, velocity: [vector; 2], both: [matrix; 2] }
    }

    fn add_point(&mut self, weight: f64, place: Vector<D>, velocity: [Vector<D>; 2]) {
        self.weight += weight;
        self.place += place * weight;
        for (k, velocity) in velocity.into_iter().enumerate() {
            self.velocity[k] += velocity * weight;
            self.both[k] += velocity * (place * weight).transpose();
        }
    }

    /// Adds sums whose places are seen from `origin`.
    fn add(&mut self, other: &Self, origin: Vector<D>) {
        self.weight += other.weight;
        self.place += other.place + origin * other.weight;
        for k in 0..2 {
            self.velocity[k] += other.velocity[k];
            self.both[k] += other.both[k] + other.velocity[k] * origin.transpose();
        }
    }

    /// K_v : K_u and K_u : K_u over the weight.
    fn shared(&self) -> [f64; 2] {
        if self.weight <= 0.0 {
            return [0.0; 2];
        }
        let place = self.place.transpose() / self.weight;
        let [fluid, solid] = [0, 1].map(|k| self.both[k] - self.velocity[k] * place);
        [solid.dot(&fluid) / self.weight, fluid.dot(&fluid) / self.weight]
    }
}

/// The shared shear and what it takes off the drag at the nodes.
#[derive(Clone, Default)]
pub(crate) struct Shear<const D: usize, const B: usize> {
    in_cell: Vec<Sums<D>>,
    around_node: Vec<Sums<D>>,
    /// sum gamma phi_a (x_a - x_q), and at last H times this.
    apart: Vec<[Vector<D>; B]>,
}

impl<const D: usize, const B: usize> Shear<D, B> {
    /// Forgets all points.
    pub fn clear(&mut self, geometry: &Geometry<D, B>) {
        let (cells, nodes) = (geometry.elements.len(), geometry.nodal_volume.len());
        self.in_cell.clear();
        self.in_cell.resize(cells, Sums::none());
        self.around_node.clear();
        self.around_node.resize(nodes, Sums::none());
        self.apart.clear();
        self.apart.resize(cells, [Vector::zeros(); B]);
    }

    /// Adds a point of a cell with the drag gamma, with its shape functions there and the velocities of the fluid at its
    /// place and of itself.
    pub fn add(
        &mut self,
        geometry: &Geometry<D, B>,
        cell: usize,
        phi: &[f64; B],
        drag: f64,
        velocities: [Vector<D>; 2],
    ) {
        let places = geometry.places(cell);
        let at: Vector<D> = places.iter().zip(phi).map(|(place, phi)| place * *phi).sum();
        self.in_cell[cell].add_point(drag, at - centroid(&places), velocities);
        for a in 0..B {
            self.apart[cell][a] += (places[a] - at) * (drag * phi[a]);
        }
    }

    /// sum gamma phi_a H (x_a - x_q) at the nodes of each cell, N: what is taken off the drag there. `velocity` is that of
    /// the fluid at the nodes.
    pub fn share(&mut self, geometry: &Geometry<D, B>, velocity: &[Vector<D>]) -> &[[Vector<D>; B]] {
        let periodic = &geometry.mesh.periodic;
        let masters = |cell: usize| geometry.nodes(cell).map(|node| periodic.master(node as u32) as usize);
        let with_drag = |(cell, sums): (usize, &Sums<D>)| (sums.weight > 0.0).then_some(cell);
        let cells: Vec<usize> = self.in_cell.iter().enumerate().filter_map(with_drag).collect();
        for &cell in &cells {
            let places = geometry.places(cell);
            for (master, place) in masters(cell).into_iter().zip(places) {
                self.around_node[master].add(&self.in_cell[cell], centroid(&places) - place);
            }
        }
        for &cell in &cells {
            let element = &geometry.elements[cell];
            let gradient = element.gradient_of_vector(&geometry.nodes(cell).map(|node| velocity[node]));
            let least = (SPREAD * element.size().powi(2) * gradient.norm()).powi(2);
            let (mut both, mut fluid) = (0.0, 0.0);
            for node in masters(cell) {
                let around = &self.around_node[node];
                let [of_both, of_fluid] = around.shared();
                both += of_both;
                fluid += of_fluid + around.weight * least;
            }
            let share = if fluid > 0.0 { (both / fluid).clamp(0.0, 1.0) } else { 0.0 };
            let shear = gradient * (share * (2.0 - share));
            self.apart[cell].iter_mut().for_each(|apart| *apart = shear * *apart);
        }
        &self.apart
    }

    /// What [`Shear::share`] gave for a cell.
    pub fn apart(&self, cell: usize) -> &[Vector<D>; B] {
        &self.apart[cell]
    }
}

fn centroid<const D: usize, const B: usize>(places: &[Vector<D>; B]) -> Vector<D> {
    places.iter().sum::<Vector<D>>() / B as f64
}
