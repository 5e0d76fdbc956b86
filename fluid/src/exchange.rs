//! Bodies immersed in the fluid, as the fluid sees them: pieces cut by the mesh, and for each body a drag
//! coefficient and the affine law of the velocity and temperature that it will have.

use crate::{Mesh, Vector};
use rayon::prelude::*;

/// The pieces in which the mesh cuts immersed bodies: body i owns pieces `first[i]..first[i + 1]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pieces<const D: usize> {
    /// First piece of each body, and the number of pieces; bodies + 1 entries.
    pub first: Vec<u32>,
    /// Cell of each piece.
    pub cell: Vec<u32>,
    /// Barycentric coordinates 1..=D of the centroid of each piece; coordinate 0 is 1 less their sum.
    pub coordinate: Vec<Vector<D>>,
    /// Share of the body's volume, V_q / V_i: positive, sums to 1 per body.
    pub share: Vec<f64>,
}

impl<const D: usize> Pieces<D> {
    /// Number of bodies.
    pub fn bodies(&self) -> usize {
        self.first.len().saturating_sub(1)
    }

    /// Number of pieces.
    pub fn len(&self) -> usize {
        self.cell.len()
    }

    /// Whether there is no piece.
    pub fn is_empty(&self) -> bool {
        self.cell.is_empty()
    }

    /// Forgets all pieces and keeps the memory.
    pub fn clear(&mut self) {
        self.first.clear();
        self.cell.clear();
        self.coordinate.clear();
        self.share.clear();
    }

    /// The pieces of one body, in the order of their cells.
    pub fn of(&self, body: usize) -> std::ops::Range<usize> {
        self.first[body] as usize..self.first[body + 1] as usize
    }

    /// Values of the shape functions at the centroid of a piece.
    pub fn shape<const B: usize>(&self, piece: usize) -> [f64; B] {
        let x = &self.coordinate[piece];
        std::array::from_fn(|a| if a == 0 { 1.0 - x.sum() } else { x[a - 1] })
    }
}

/// Columns of the bodies for one step: `v* = velocity + mobility (drag u - volume grad p)`.
#[derive(Clone, Copy, Debug)]
pub struct Exchange<'a, const D: usize> {
    /// Where the bodies are on the mesh.
    pub pieces: &'a Pieces<D>,
    /// Volume V, m3 (m2 in the plane).
    pub volume: &'a [f64],
    /// Drag coefficient gamma, kg/s.
    pub drag: &'a [f64],
    /// Mobility a, s/kg.
    pub mobility: &'a [f64],
    /// Constant part b of the velocity law, m/s.
    pub velocity: &'a [Vector<D>],
    /// The law of the solid flux in the equation of mass, where it is not that of momentum.
    pub continuity: Option<VelocityLaw<'a, D>>,
    /// The same for heat, with a fluid temperature only.
    pub heat: Option<HeatExchange<'a>>,
}

/// X above which a difference of push within a body, which takes some X steps to be as in a rigid one, is rather let be.
pub const LASTING: f64 = 100.0;

/// A law `v* = velocity + mobility (drag u - volume grad p)` of all bodies.
///
/// Each piece of a body follows it with the push f at its own place, so that the equations stay local. But a body is rigid. So as the law of
/// the solid flux it has, at each piece, the constant part
///
/// ```text
///     b - c a (f - f_mean),     f_mean = sum (s c f) / sum (s c) over the pieces of the body,
/// ```
///
/// with the shares s of the pieces and f of the last accepted state of the fluid. The mean over the pieces is b, and where c = 1 and the push
/// stays as it was, no piece moves otherwise than the body.
///
/// c is 1 but where bodies leave the fluid little room. A piece with more push gives way, which takes X times the difference of push from
/// it, X = a (gamma/eps + rho V/dt) (1 - eps)/eps; from step to step the difference d goes by d' = d_rigid - X (d' - c d), with the factor
/// c X/(1 + X) to d_rigid/(1 + X (1 - c)). In elements full of body, X without bound, that takes for ever, and the mobility at the pieces is all that
/// couples the pressures of the nodes. So c = 1/(1 + X/[`LASTING`]).
#[derive(Clone, Copy, Debug)]
pub struct VelocityLaw<'a, const D: usize> {
    /// Mobility a, s/kg.
    pub mobility: &'a [f64],
    /// Constant part b, m/s.
    pub velocity: &'a [Vector<D>],
}

impl<'a, const D: usize> Exchange<'a, D> {
    /// The law of the solid flux phi v* in the equation of mass.
    pub fn continuity(&self) -> VelocityLaw<'a, D> {
        self.continuity.unwrap_or(VelocityLaw { mobility: self.mobility, velocity: self.velocity })
    }
}

/// Heat columns: `T* = temperature + mobility (coefficient T)`.
#[derive(Clone, Copy, Debug)]
pub struct HeatExchange<'a> {
    /// Heat-transfer coefficient times area hA, W/K.
    pub coefficient: &'a [f64],
    /// aT, K/W.
    pub mobility: &'a [f64],
    /// bT, K.
    pub temperature: &'a [f64],
}

/// The fluid at each body: means over its pieces, weighted by their volume.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AtBodies<const D: usize> {
    /// Velocity u, m/s.
    pub velocity: Vec<Vector<D>>,
    /// Pressure gradient, Pa/m.
    pub pressure_gradient: Vec<Vector<D>>,
    /// Temperature, K; empty without heat.
    pub temperature: Vec<f64>,
}

/// Pieces sorted by cell, made anew each step without allocation.
#[derive(Clone, Debug, Default)]
pub struct PiecesByCell {
    first: Vec<u32>,
    piece: Vec<u32>,
    body: Vec<u32>,
}

impl PiecesByCell {
    /// Sorts the pieces of a mesh of `cells` cells; inside a cell they stay in the order of the bodies.
    pub fn sort<const D: usize>(&mut self, pieces: &Pieces<D>, cells: usize) {
        self.first.clear();
        self.first.resize(cells + 1, 0);
        for &cell in &pieces.cell {
            self.first[cell as usize + 1] += 1;
        }
        for cell in 0..cells {
            self.first[cell + 1] += self.first[cell];
        }
        self.piece.resize(pieces.cell.len(), 0);
        self.body.resize(pieces.cell.len(), 0);
        // Filled from the back, so that `first[c]` ends as the end of cell c - 1's run moved to its start.
        for body in (0..pieces.bodies()).rev() {
            for piece in pieces.of(body).rev() {
                let end = &mut self.first[pieces.cell[piece] as usize + 1];
                *end -= 1;
                self.piece[*end as usize] = piece as u32;
                self.body[*end as usize] = body as u32;
            }
        }
        // first[c + 1] is now the start of cell c: shift it down.
        self.first.rotate_left(1);
        self.first[cells] = pieces.cell.len() as u32;
    }

    /// Forgets all pieces: the mesh has no bodies.
    pub fn clear(&mut self) {
        self.first.clear();
    }

    /// `(piece, body)` of each piece in a cell.
    pub fn of(&self, cell: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let range = match self.first.is_empty() {
            true => 0..0,
            false => self.first[cell] as usize..self.first[cell + 1] as usize,
        };
        range.map(|k| (self.piece[k] as usize, self.body[k] as usize))
    }
}

/// Sums over the pieces in one cell of all that momentum and mass need, shape functions phi at the pieces,
/// s the share of the body.
#[derive(Clone, Debug)]
pub struct CellExchange<const D: usize, const B: usize> {
    /// sum s gamma (1 - a gamma) phi_a phi_b.
    pub drag: [[f64; B]; B],
    /// sum s V (a gamma - 1) phi_a.
    pub pressure: [f64; B],
    /// sum s V a gamma phi_b, a of continuity.
    pub carried: [f64; B],
    /// sum s V^2 a, a of continuity.
    pub diffusion: f64,
    /// sum s gamma b phi_a.
    pub force: [Vector<D>; B],
    /// sum s V b, b of continuity.
    pub volume_flux: Vector<D>,
    /// sum s V phi_a phi_b.
    pub solid: [[f64; B]; B],
    total_drag: f64,
}

impl<const D: usize, const B: usize> CellExchange<D, B> {
    /// The sums of one cell, with the constant part of the law of continuity at the pieces where it is not that of the bodies; `None` if no
    /// body is there.
    pub fn gather(
        load: &Exchange<'_, D>,
        sorted: &PiecesByCell,
        at_pieces: Option<&[Vector<D>]>,
        cell: usize,
    ) -> Option<Self> {
        let mut pieces = sorted.of(cell).peekable();
        pieces.peek()?;
        let mut sum = Self {
            drag: [[0.0; B]; B],
            pressure: [0.0; B],
            carried: [0.0; B],
            diffusion: 0.0,
            force: [Vector::zeros(); B],
            volume_flux: Vector::zeros(),
            solid: [[0.0; B]; B],
            total_drag: 0.0,
        };
        let law = load.continuity();
        for (piece, body) in pieces {
            let phi = load.pieces.shape::<B>(piece);
            let share = load.pieces.share[piece];
            let (volume, gamma, mobility) = (load.volume[body], load.drag[body], load.mobility[body]);
            let slip = share * gamma * (1.0 - mobility * gamma);
            sum.total_drag += share * gamma;
            sum.diffusion += share * volume * volume * law.mobility[body];
            sum.volume_flux += at_pieces.map_or(law.velocity[body], |b| b[piece]) * (share * volume);
            for a in 0..B {
                sum.pressure[a] += share * volume * (mobility * gamma - 1.0) * phi[a];
                sum.carried[a] += share * volume * law.mobility[body] * gamma * phi[a];
                sum.force[a] += load.velocity[body] * (share * gamma * phi[a]);
                for b in 0..B {
                    sum.drag[a][b] += slip * phi[a] * phi[b];
                    sum.solid[a][b] += share * volume * phi[a] * phi[b];
                }
            }
        }
        Some(sum)
    }

    /// sum s gamma, kg/s.
    pub fn total_drag(&self) -> f64 {
        self.total_drag
    }
}

/// Nodal values of the fluid, for sampling at bodies.
#[derive(Clone, Copy, Debug)]
pub struct NodalFields<'a, const D: usize> {
    /// m/s.
    pub velocity: &'a [Vector<D>],
    /// Pa.
    pub pressure: &'a [f64],
    /// K.
    pub temperature: Option<&'a [f64]>,
    /// Gradients of the shape functions of each cell, `D + 1` per cell.
    pub gradient: &'a [Vector<D>],
}

impl<const D: usize> AtBodies<D> {
    /// Means of the fields over the pieces of each body.
    pub fn sample<const B: usize>(
        &mut self,
        mesh: &Mesh<D>,
        pieces: &Pieces<D>,
        fields: &NodalFields<'_, D>,
    ) {
        let bodies = pieces.bodies();
        self.velocity.resize(bodies, Vector::zeros());
        self.pressure_gradient.resize(bodies, Vector::zeros());
        (self.velocity.par_iter_mut(), self.pressure_gradient.par_iter_mut())
            .into_par_iter()
            .enumerate()
            .with_min_len(256)
            .for_each(|(body, (velocity, slope))| {
                (*velocity, *slope) = (Vector::zeros(), Vector::zeros());
                for piece in pieces.of(body) {
                    let phi = pieces.shape::<B>(piece);
                    let cell = pieces.cell[piece] as usize * B;
                    for a in 0..B {
                        let node = mesh.cells[cell + a] as usize;
                        *velocity += fields.velocity[node] * (pieces.share[piece] * phi[a]);
                        *slope += fields.gradient[cell + a] * (pieces.share[piece] * fields.pressure[node]);
                    }
                }
            });
        self.temperature.clear();
        if let Some(temperature) = fields.temperature {
            self.temperature.resize(bodies, 0.0);
            self.temperature.par_iter_mut().enumerate().with_min_len(256).for_each(|(body, mean)| {
                *mean = pieces
                    .of(body)
                    .map(|piece| pieces.share[piece] * at_piece(mesh, pieces, piece, temperature))
                    .sum();
            });
        }
    }
}

/// Value of a nodal field at the centroid of a piece.
pub fn at_piece<const D: usize>(mesh: &Mesh<D>, pieces: &Pieces<D>, piece: usize, field: &[f64]) -> f64 {
    let nodes = mesh.cell(pieces.cell[piece] as usize);
    let x = &pieces.coordinate[piece];
    let first = (1.0 - x.sum()) * field[nodes[0] as usize];
    (0..D).fold(first, |sum, k| sum + x[k] * field[nodes[k + 1] as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_sorted_by_cell_in_the_order_of_the_bodies() {
        let pieces = Pieces::<2> {
            first: vec![0, 2, 3, 5],
            cell: vec![3, 1, 1, 0, 3],
            coordinate: vec![Vector::zeros(); 5],
            share: vec![0.5, 0.5, 1.0, 0.5, 0.5],
        };
        let mut sorted = PiecesByCell::default();
        for _ in 0..2 {
            sorted.sort(&pieces, 5);
            let all: Vec<Vec<_>> = (0..5).map(|cell| sorted.of(cell).collect()).collect();
            assert_eq!(all, [vec![(3, 2)], vec![(1, 0), (2, 1)], vec![], vec![(0, 0), (4, 2)], vec![]]);
        }
    }
}
