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
use crate::shear::Shear;

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
    /// sum gamma (b + H (x_a - x_q)) phi_a, H the shear that the points share with the fluid.
    pub force: [Vector<D>; B],
    /// sum V b, b of the equation of mass.
    pub volume_flux: Vector<D>,
    /// sum V phi_a phi_b.
    pub solid: [[f64; B]; B],
}

impl<const D: usize, const B: usize> CellExchange<D, B> {
    /// The sums of one cell, of which the shared shear is known; `None` if no point is in it.
    pub(crate) fn gather(
        points: &Points<D>,
        sorted: &PointsByCell,
        cell: usize,
        shear: &Shear<D, B>,
    ) -> Option<Self> {
        let mut inside = sorted.of(cell).peekable();
        inside.peek()?;
        let mut sum = Self {
            drag: [[0.0; B]; B],
            pressure: [0.0; B],
            carried: [0.0; B],
            diffusion: 0.0,
            force: *shear.apart(cell),
            volume_flux: Vector::zeros(),
            solid: [[0.0; B]; B],
        };
        for q in inside {
            let phi = points.shape::<B>(q);
            let (volume, gamma, mobility) = (points.volume[q], points.drag[q], points.mobility[q]);
            let carried = volume * points.flux_mobility[q];
            let left = 1.0 - mobility * gamma;
            sum.diffusion += volume * carried;
            sum.volume_flux += points.flux_velocity[q] * volume;
            for a in 0..B {
                sum.drag[a][a] += gamma * phi[a];
                sum.pressure[a] -= volume * left * phi[a];
                sum.carried[a] += carried * gamma * phi[a];
                sum.force[a] += points.velocity[q] * (gamma * phi[a]);
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
    /// gamma (b + H (x_a - x_q)), H the shared shear, N/m3.
    pub force: Vector<D>,
    /// Solid flux phi v* with the law of the equation of mass at the last accepted state (A.15), m/s.
    pub flux: Vector<D>,
}

impl<const D: usize> PointDensity<D> {
    /// Fills the fields, one value a node, and the shear that the points share. Nodes that are one have one sum.
    pub(crate) fn fill<const B: usize>(
        fields: &mut Vec<Self>,
        shear: &mut Shear<D, B>,
        points: &Points<D>,
        geometry: &Geometry<D, B>,
        state: &State<D>,
    ) {
        let none = Vector::zeros();
        let zero = Self { volume: 0.0, left_volume: 0.0, drag: 0.0, left_drag: 0.0, force: none, flux: none };
        fields.clear();
        fields.resize(geometry.nodal_volume.len(), zero);
        shear.clear(geometry);
        let periodic = &geometry.mesh.periodic;
        for q in 0..points.len() {
            let (cell, phi) = (points.cell[q] as usize, points.shape::<B>(q));
            let nodes = geometry.nodes(cell);
            let (mut fluid, mut slope) = (Vector::<D>::zeros(), Vector::<D>::zeros());
            for (a, &node) in nodes.iter().enumerate() {
                fluid += state.velocity[node] * phi[a];
                slope += geometry.elements[cell].gradient[a] * state.pressure[node];
            }
            let (volume, drag) = (points.volume[q], points.drag[q]);
            let left = 1.0 - points.mobility[q] * drag;
            let forcing = fluid * drag - slope * volume;
            let solid = points.flux_velocity[q] + forcing * points.flux_mobility[q];
            for (a, &node) in nodes.iter().enumerate() {
                let master = periodic.master(node as u32) as usize;
                let (share, sum) = (phi[a] / geometry.nodal_volume[master], &mut fields[master]);
                sum.volume += volume * share;
                sum.left_volume += volume * left * share;
                sum.drag += drag * share;
                sum.left_drag += drag * left * share;
                sum.force += points.velocity[q] * (drag * share);
                sum.flux += solid * (volume * share);
            }
            shear.add(geometry, cell, &phi, drag, [fluid, solid]);
        }
        for (cell, apart) in shear.share(geometry, &state.velocity).iter().enumerate() {
            for (node, apart) in geometry.nodes(cell).into_iter().zip(apart) {
                let master = periodic.master(node as u32) as usize;
                fields[master].force += apart / geometry.nodal_volume[master];
            }
        }
        periodic.mirror(fields);
    }
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
