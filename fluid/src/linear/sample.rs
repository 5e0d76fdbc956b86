//! Systems like those of the flow, for the tests and the benchmark (which includes this file): one
//! time step of Oseen flow with drag, P1-P1 with PSPG, on a grid of cubes cut into simplices.

use super::{BlockMatrix, Pattern};
use std::sync::Arc;

/// A mesh of the unit square or cube.
pub struct Grid<const D: usize> {
    pub points: Vec<[f64; D]>,
    /// `D + 1` nodes per cell.
    pub cells: Vec<u32>,
    per_side: usize,
}

impl<const D: usize> Grid<D> {
    /// `per_side`^D nodes. Each cube is cut into D! simplices along its diagonal (Kuhn): each is a
    /// path from one corner to the opposite one, an order in which the axes are walked.
    pub fn new(per_side: usize) -> Self {
        let stride: [usize; D] = std::array::from_fn(|axis| per_side.pow(axis as u32));
        let index = |node: usize| -> [usize; D] { stride.map(|s| node / s % per_side) };
        let nodes = per_side.pow(D as u32);
        let h = 1.0 / (per_side.max(2) - 1) as f64;
        let points = (0..nodes).map(|node| index(node).map(|i| i as f64 * h)).collect();
        let orders: &[&[usize]] = match D {
            2 => &[&[0, 1], &[1, 0]],
            _ => &[&[0, 1, 2], &[0, 2, 1], &[1, 0, 2], &[1, 2, 0], &[2, 0, 1], &[2, 1, 0]],
        };
        let mut cells = Vec::new();
        for corner in 0..nodes {
            if index(corner).iter().all(|&i| i + 1 < per_side) {
                for order in orders {
                    let mut node = corner;
                    cells.push(node as u32);
                    for &axis in *order {
                        node += stride[axis];
                        cells.push(node as u32);
                    }
                }
            }
        }
        Self { points, cells, per_side }
    }

    pub fn pattern(&self) -> Arc<Pattern> {
        Arc::new(Pattern::from_cells(self.points.len(), &self.cells, D + 1))
    }

    /// Volume of the simplices and gradients of their shape functions.
    fn shape(&self, cell: &[u32]) -> (f64, Vec<[f64; D]>) {
        // Column k of the map from the reference simplex is the edge from node 0 to node k + 1.
        let origin = self.points[cell[0] as usize];
        let mut map = nalgebra::SMatrix::<f64, D, D>::zeros();
        for k in 0..D {
            for d in 0..D {
                map[(d, k)] = self.points[cell[k + 1] as usize][d] - origin[d];
            }
        }
        let factorial = if D == 2 { 2.0 } else { 6.0 };
        let lu = nalgebra::DMatrix::from_fn(D, D, |i, j| map[(i, j)]).lu();
        let volume = lu.determinant().abs() / factorial;
        let inverse = lu.try_inverse().expect("a cell has a volume");
        let mut gradients = vec![[0.0; D]; D + 1];
        for k in 0..D {
            for d in 0..D {
                gradients[k + 1][d] = inverse[(k, d)];
                gradients[0][d] -= inverse[(k, d)];
            }
        }
        (volume, gradients)
    }
}

/// Velocity of the last step.
fn velocity<const D: usize>(x: [f64; D], time: f64) -> [f64; D] {
    let mut u = [0.0; D];
    u[0] = 1.0 + 0.3 * (5.0 * x[1] + time).sin();
    u[1] = 0.3 * (7.0 * x[0] - time).cos();
    u
}

/// Drag per volume, kg/(m3 s): a bed in the lower half with 0 to 1e8, of grains that move.
fn drag<const D: usize>(x: [f64; D], time: f64) -> f64 {
    let bed = 0.5 + 0.05 * (9.0 * x[0] + time).sin();
    if x[1] > bed {
        0.0
    } else {
        10f64.powf(8.0 * (0.5 + 0.5 * ((11.0 * x[0] + time).sin() * (13.0 * x[1]).cos())))
    }
}

/// The flow system at a time and its right-hand side, `B` = D + 1. Water, time step 1 ms; velocity
/// given on the sides but the last in x, which is open.
pub fn oseen<const D: usize, const B: usize>(
    grid: &Grid<D>,
    pattern: &Arc<Pattern>,
    time: f64,
) -> (BlockMatrix<B>, Vec<f64>) {
    const DENSITY: f64 = 1000.0;
    const VISCOSITY: f64 = 1e-3;
    const STEP: f64 = 1e-3;
    let mut matrix = BlockMatrix::<B>::new(pattern.clone());
    let mut rhs = vec![0.0; matrix.unknowns()];
    let nodes_per_cell = D + 1;
    for cell in grid.cells.chunks(nodes_per_cell) {
        let (volume, gradients) = grid.shape(cell);
        let mut centre = [0.0; D];
        for &node in cell {
            for (sum, x) in centre.iter_mut().zip(grid.points[node as usize]) {
                *sum += x / nodes_per_cell as f64;
            }
        }
        let (u, beta) = (velocity(centre, time), drag(centre, time));
        let h = volume.powf(1.0 / D as f64);
        let speed = u.iter().map(|u| u * u).sum::<f64>().sqrt();
        let rate =
            (2.0 / STEP).powi(2) + (2.0 * speed / h).powi(2) + (4.0 * VISCOSITY / DENSITY / (h * h)).powi(2);
        let tau = rate.powf(-0.5) / DENSITY;
        let dot = |a: [f64; D], b: [f64; D]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for (i, &node_i) in cell.iter().enumerate() {
            let shape_i = volume / nodes_per_cell as f64;
            for (j, &node_j) in cell.iter().enumerate() {
                let mass = volume * if i == j { 2.0 } else { 1.0 } / ((D + 1) * (D + 2)) as f64;
                let advection = DENSITY * dot(u, gradients[j]);
                let momentum = (DENSITY / STEP + beta) * mass
                    + shape_i * advection
                    + VISCOSITY * volume * dot(gradients[i], gradients[j]);
                let block = matrix.block_mut(node_i as usize, node_j as usize).expect("in the pattern");
                for d in 0..D {
                    block[d][d] += momentum;
                    block[d][D] -= shape_i * gradients[i][d];
                    let inertia = DENSITY / STEP / nodes_per_cell as f64 + advection;
                    block[D][d] += shape_i * gradients[j][d] + tau * volume * gradients[i][d] * inertia;
                }
                block[D][D] += tau * volume * dot(gradients[i], gradients[j]);
                let old = velocity(grid.points[node_j as usize], time);
                for d in 0..D {
                    let grains = 0.1 * beta * (3.0 * centre[0] + d as f64).sin();
                    rhs[B * node_i as usize + d] += mass * (DENSITY / STEP * old[d] + grains);
                    rhs[B * node_i as usize + D] +=
                        tau * volume * gradients[i][d] * DENSITY / STEP * old[d] / nodes_per_cell as f64;
                }
            }
        }
    }
    for (node, point) in grid.points.iter().enumerate() {
        let on_side = |d: usize| point[d] == 0.0 || (d > 0 && point[d] > 1.0 - 0.5 / grid.per_side as f64);
        if (0..D).any(on_side) {
            for (d, value) in velocity(*point, time).into_iter().enumerate() {
                matrix.set_identity_row(node, d, 1.0);
                rhs[B * node + d] = value;
            }
        }
    }
    (matrix, rhs)
}
