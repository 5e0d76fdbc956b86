//! Point terms: what is immersed in the fluid, as the fluid sees it.
//!
//! A point lies in a cell and acts on the fluid there. It has a volume V, a drag coefficient gamma and the affine law
//! of the velocity that it will have, `v* = b + a (gamma u - V grad p)`, with u and grad p at its place. A scalar s of
//! the fluid that it exchanges has a coefficient h and the law `s* = c + a h s`. The fluid knows no more: which points
//! make up a body, and why its law is as it is, is the business of the caller.
//!
//! The Galerkin terms are sums over the points ([`CellExchange`]). The residual of momentum in the stabilisation takes
//! the points as fields instead ([`PointDensity`]): nodal momentum makes the nodal means of the residual vanish, but not
//! the residual of a cell where points differ from cell to cell, and what is left would drive a flow in the equation of
//! mass.

use crate::Vector;
use crate::flow::State;
use crate::geometry::Geometry;
use nalgebra::SMatrix;

/// Point terms as columns, one row per point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points<const D: usize> {
    /// Cell of each point.
    pub cell: Vec<u32>,
    /// Barycentric coordinates 1..=D in the cell; coordinate 0 is 1 less their sum.
    pub coordinate: Vec<Vector<D>>,
    /// Volume V, m3 (m2 in the plane).
    pub volume: Vec<f64>,
    /// Drag coefficient gamma, kg/s.
    pub drag: Vec<f64>,
    /// Mobility a of the law of velocity in the equation of momentum, s/kg.
    pub mobility: Vec<f64>,
    /// Constant part b of that law, m/s.
    pub velocity: Vec<Vector<D>>,
    /// Mobility of the law of velocity in the equation of mass, s/kg.
    pub flux_mobility: Vec<f64>,
    /// Constant part of that law, m/s.
    pub flux_velocity: Vec<Vector<D>>,
    /// The exchange of each scalar of the fluid, in their order; `None` for one that the points do not exchange.
    pub scalars: Vec<Option<PointScalar>>,
}

/// Columns of the exchange of a scalar: `s* = value + mobility coefficient s`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointScalar {
    /// Coefficient h, W/K for heat.
    pub coefficient: Vec<f64>,
    /// Mobility, K/W for heat.
    pub mobility: Vec<f64>,
    /// Constant part c, K for heat.
    pub value: Vec<f64>,
}

impl<const D: usize> Points<D> {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.cell.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.cell.is_empty()
    }

    /// Values of the shape functions at a point.
    pub fn shape<const B: usize>(&self, point: usize) -> [f64; B] {
        let x = &self.coordinate[point];
        std::array::from_fn(|a| if a == 0 { 1.0 - x.sum() } else { x[a - 1] })
    }
}

/// Points sorted by cell, made anew each step without allocation.
#[derive(Clone, Debug, Default)]
pub struct PointsByCell {
    first: Vec<u32>,
    point: Vec<u32>,
}

impl PointsByCell {
    /// Sorts points by the cells of a mesh of `cells` cells; inside a cell they stay in their order.
    pub fn sort(&mut self, cell_of: &[u32], cells: usize) {
        self.first.clear();
        self.first.resize(cells + 1, 0);
        for &cell in cell_of {
            self.first[cell as usize + 1] += 1;
        }
        for cell in 0..cells {
            self.first[cell + 1] += self.first[cell];
        }
        self.point.resize(cell_of.len(), 0);
        // Filled from the back, so that `first[c]` ends as the end of cell c - 1's run moved to its start.
        for (point, &cell) in cell_of.iter().enumerate().rev() {
            let end = &mut self.first[cell as usize + 1];
            *end -= 1;
            self.point[*end as usize] = point as u32;
        }
        // first[c + 1] is now the start of cell c: shift it down.
        self.first.rotate_left(1);
        self.first[cells] = cell_of.len() as u32;
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        self.first.clear();
    }

    /// The points in a cell.
    pub fn of(&self, cell: usize) -> impl Iterator<Item = usize> + '_ {
        let range = match self.first.is_empty() {
            true => 0..0,
            false => self.first[cell] as usize..self.first[cell + 1] as usize,
        };
        range.map(|k| self.point[k] as usize)
    }
}

/// Sums over the points in one cell of all that momentum and mass need, with the shape functions phi at the points.
#[derive(Clone, Debug)]
pub struct CellExchange<const D: usize, const B: usize> {
    /// sum gamma phi_a (delta_ab - a gamma phi_b): the drag, summed on the diagonal, less what the law gives back.
    pub drag: [[f64; B]; B],
    /// sum V (a gamma - 1) phi_a.
    pub pressure: [f64; B],
    /// sum V a gamma phi_b, a of the equation of mass.
    pub carried: [f64; B],
    /// sum V^2 a, a of the equation of mass.
    pub diffusion: f64,
    /// sum gamma (b + H (x_a - x_q)) phi_a, H the smooth velocity gradient at the point.
    pub force: [Vector<D>; B],
    /// sum V b, b of the equation of mass.
    pub volume_flux: Vector<D>,
    /// sum V phi_a phi_b.
    pub solid: [[f64; B]; B],
}

impl<const D: usize, const B: usize> CellExchange<D, B> {
    /// The sums of one cell, with the places of its nodes and the fields there; `None` if no point is in it.
    pub fn gather(
        points: &Points<D>,
        sorted: &PointsByCell,
        cell: usize,
        places: &[Vector<D>; B],
        nodes: &[PointDensity<D>; B],
    ) -> Option<Self> {
        let mut inside = sorted.of(cell).peekable();
        inside.peek()?;
        let mut sum = Self {
            drag: [[0.0; B]; B],
            pressure: [0.0; B],
            carried: [0.0; B],
            diffusion: 0.0,
            force: [Vector::zeros(); B],
            volume_flux: Vector::zeros(),
            solid: [[0.0; B]; B],
        };
        let slopes = nodes.map(|node| node.slope);
        for q in inside {
            let phi = points.shape::<B>(q);
            let apart = apart(&slopes, places, &phi);
            let (volume, gamma, mobility) = (points.volume[q], points.drag[q], points.mobility[q]);
            let carried = volume * points.flux_mobility[q];
            let left = 1.0 - mobility * gamma;
            sum.diffusion += volume * carried;
            sum.volume_flux += points.flux_velocity[q] * volume;
            for a in 0..B {
                sum.drag[a][a] += gamma * phi[a];
                sum.pressure[a] -= volume * left * phi[a];
                sum.carried[a] += carried * gamma * phi[a];
                sum.force[a] += (points.velocity[q] + apart[a]) * (gamma * phi[a]);
                for b in 0..B {
                    sum.drag[a][b] -= gamma * mobility * gamma * phi[a] * phi[b];
                    sum.solid[a][b] += volume * phi[a] * phi[b];
                }
            }
        }
        Some(sum)
    }
}

/// What points do to momentum and mass per volume, as P1 fields: at node a the sum over the points with phi_a, over
/// int phi_a.
#[derive(Clone, Copy, Debug)]
pub struct PointDensity<const D: usize> {
    /// V: the solid fraction, not clipped.
    pub volume: f64,
    /// V (1 - a gamma): the solid on which the law leaves the pressure gradient.
    pub left_volume: f64,
    /// gamma, kg/m3/s.
    pub drag: f64,
    /// gamma (1 - a gamma): the drag that the law leaves, kg/m3/s.
    pub left_drag: f64,
    /// gamma (b + H (x_a - x_q)), H the smooth velocity gradient at the point, N/m3.
    pub force: Vector<D>,
    /// Solid flux phi v* with the law of the equation of mass at the last accepted state (A.15), m/s.
    pub flux: Vector<D>,
    /// Smooth velocity gradient H, 1/s: twice the mean gradient less its own mean, weighted likewise.
    pub slope: SMatrix<f64, D, D>,
    /// Mean of the velocity gradients at the points at the last accepted state, weighted by gamma phi_a, 1/s.
    mean_slope: SMatrix<f64, D, D>,
}

impl<const D: usize> PointDensity<D> {
    /// Fills the fields, one value a node, point after point. Nodes that are one have one sum.
    pub(crate) fn fill<const B: usize>(
        fields: &mut Vec<Self>,
        points: &Points<D>,
        geometry: &Geometry<D, B>,
        state: &State<D>,
    ) {
        let none = SMatrix::zeros();
        let zero = Self {
            volume: 0.0,
            left_volume: 0.0,
            drag: 0.0,
            left_drag: 0.0,
            force: Vector::zeros(),
            flux: Vector::zeros(),
            slope: none,
            mean_slope: none,
        };
        fields.clear();
        fields.resize(geometry.nodal_volume.len(), zero);
        let periodic = &geometry.mesh.periodic;
        // Nodes around a point and its shares of the means around them.
        let around = |q: usize| {
            let nodes = geometry.nodes(points.cell[q] as usize);
            let masters = nodes.map(|node| periodic.master(node as u32) as usize);
            let phi = points.shape::<B>(q);
            (nodes, masters, phi, std::array::from_fn(|a| phi[a] / geometry.nodal_volume[masters[a]]))
        };
        for q in 0..points.len() {
            let (nodes, masters, phi, share): (_, _, _, [f64; B]) = around(q);
            let element = &geometry.elements[points.cell[q] as usize];
            let velocities = nodes.map(|node| state.velocity[node]);
            let pressure_slope = element.gradient_of(&nodes.map(|node| state.pressure[node]));
            let (volume, drag) = (points.volume[q], points.drag[q]);
            let left = 1.0 - points.mobility[q] * drag;
            let forcing = at(&velocities, &phi) * drag - pressure_slope * volume;
            let flux = (points.flux_velocity[q] + forcing * points.flux_mobility[q]) * volume;
            let slope = element.gradient_of_vector(&velocities) * drag;
            for (master, share) in masters.into_iter().zip(share) {
                let sum = &mut fields[master];
                sum.volume += volume * share;
                sum.left_volume += volume * left * share;
                sum.drag += drag * share;
                sum.left_drag += drag * left * share;
                sum.force += points.velocity[q] * (drag * share);
                sum.flux += flux * share;
                sum.mean_slope += slope * share;
            }
        }
        for sum in fields.iter_mut().filter(|sum| sum.drag > 0.0) {
            sum.mean_slope /= sum.drag;
            sum.slope = sum.mean_slope * 2.0;
        }
        for q in 0..points.len() {
            let (_, masters, phi, share) = around(q);
            let slope = at(&masters.map(|node| fields[node].mean_slope), &phi) * points.drag[q];
            for (master, share) in masters.into_iter().zip(share) {
                let drag = fields[master].drag;
                if drag > 0.0 {
                    fields[master].slope -= slope * (share / drag);
                }
            }
        }
        for q in 0..points.len() {
            let (nodes, masters, phi, share) = around(q);
            let places = nodes.map(|node| geometry.mesh.points[node]);
            let apart = apart(&masters.map(|node| fields[node].slope), &places, &phi);
            for (a, master) in masters.into_iter().enumerate() {
                fields[master].force += apart[a] * (points.drag[q] * share[a]);
            }
        }
        periodic.mirror(fields);
    }
}

/// H (x_a - x_q) at the nodes of a cell, with H at the point x_q.
fn apart<const D: usize, const B: usize>(
    slopes: &[SMatrix<f64, D, D>; B],
    places: &[Vector<D>; B],
    phi: &[f64; B],
) -> [Vector<D>; B] {
    let (slope, point) = (at(slopes, phi), at(places, phi));
    places.map(|place| slope * (place - point))
}

/// The value at a point of a field with these values at the nodes of its cell.
fn at<const D: usize, const E: usize, const B: usize>(
    nodes: &[SMatrix<f64, D, E>; B],
    phi: &[f64; B],
) -> SMatrix<f64, D, E> {
    nodes.iter().zip(phi).map(|(value, phi)| value * *phi).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_sorted_by_cell_in_their_order() {
        let mut sorted = PointsByCell::default();
        for _ in 0..2 {
            sorted.sort(&[3, 1, 1, 0, 3], 5);
            let all: Vec<Vec<_>> = (0..5).map(|cell| sorted.of(cell).collect()).collect();
            assert_eq!(all, [vec![3], vec![1, 2], vec![], vec![0, 4], vec![]]);
        }
    }
}
