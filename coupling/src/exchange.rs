//! Between grains and nodal fields: the pieces in which the mesh cuts the grains, the fluid at the grains, and the
//! point terms that the fluid solver gets.
//!
//! A grain has a drag, a volume and one law of its velocity; the fluid solver gets them piece by piece, each piece with
//! its share s: volume s V, drag s gamma, mobility a/s, so that the law of a piece is `b + a (gamma u - V grad p)` with
//! the fluid at its own place, and the equations stay local.
//!
//! **Rigid grains.** A piece with more forcing f = gamma u - V grad p than the others would give way by a times the
//! difference, though a grain is rigid. Where the solid flux has a law of its own, its constant part at a piece is
//! therefore
//!
//! ```text
//!     b - c a (f - f_mean),     f_mean = sum (s c f) / sum (s c) over the pieces of the grain,
//! ```
//!
//! with f of the last accepted state of the fluid. The mean over the pieces is b, and where c = 1 and the forcing
//! stays as it was, no piece moves otherwise than the grain.
//!
//! c is 1 but where grains leave the fluid little room. A piece with more forcing gives way, which takes X times the
//! difference of forcing from it, X = a (gamma/eps + rho V/dt) (1 - eps)/eps; from step to step the difference d goes
//! by d' = d_rigid - X (d' - c d), with the factor c X/(1 + X) to d_rigid/(1 + X (1 - c)). In elements full of grain, X
//! without bound, that takes for ever, and the mobility at the pieces is all that couples the pressures of the nodes.
//! So c = 1/(1 + X/[`LASTING`]).

use crate::load::{GrainLoad, Law};
use crate::scheme::anchored::velocity_offset;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use voidage_fluid::flow::State;
use voidage_fluid::points::{PointScalar, Points};
use voidage_fluid::{Mesh, Vector};

/// X above which a difference of forcing within a grain, which takes some X steps to be as in a rigid one, is rather
/// let be.
pub const LASTING: f64 = 100.0;

/// Voidage of an element full of grain as a weight, so that a grain all in such elements has a mean.
const LEAST: f64 = 1e-12;

/// Grains per unit of parallel work.
const CHUNK: usize = 256;

/// The pieces in which the mesh cuts grains: grain i owns pieces `first[i]..first[i + 1]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pieces<const D: usize> {
    /// First piece of each grain, and the number of pieces; grains + 1 entries.
    pub first: Vec<u32>,
    /// Cell of each piece.
    pub cell: Vec<u32>,
    /// Barycentric coordinates 1..=D of the centroid of each piece; coordinate 0 is 1 less their sum.
    pub coordinate: Vec<Vector<D>>,
    /// Share of the grain's volume inside the mesh, V_q / V_i: positive, sums to 1 per grain.
    pub share: Vec<f64>,
}

impl<const D: usize> Pieces<D> {
    /// Number of grains.
    pub fn grains(&self) -> usize {
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

    /// The pieces of one grain, in the order of their cells.
    pub fn of(&self, grain: usize) -> std::ops::Range<usize> {
        self.first[grain] as usize..self.first[grain + 1] as usize
    }
}

/// The fluid at each grain: means over its pieces, weighted by their volume.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AtGrains<const D: usize> {
    /// Velocity u, m/s.
    pub velocity: Vec<Vector<D>>,
    /// Pressure gradient, Pa/m.
    pub pressure_gradient: Vec<Vector<D>>,
    /// Temperature, K; empty without heat.
    pub temperature: Vec<f64>,
}

/// Nodal fields on a mesh, to be read at the pieces of grains.
#[derive(Clone, Copy, Debug)]
pub struct OnMesh<'a, const D: usize> {
    /// The mesh.
    pub mesh: &'a Mesh<D>,
    /// The fields.
    pub fields: &'a State<D>,
}

impl<const D: usize> OnMesh<'_, D> {
    pub(crate) fn velocity(&self, cell: u32, coordinate: &Vector<D>) -> Vector<D> {
        self.vector(&self.fields.velocity, cell, coordinate)
    }

    /// Value of a nodal vector field at a point of a cell.
    pub(crate) fn vector(&self, field: &[Vector<D>], cell: u32, coordinate: &Vector<D>) -> Vector<D> {
        let nodes = self.mesh.cell(cell as usize);
        let value = |k: usize| field[nodes[k] as usize];
        (0..D).fold(value(0) * (1.0 - coordinate.sum()), |sum, k| sum + value(k + 1) * coordinate[k])
    }

    fn pressure_gradient(&self, cell: u32) -> Vector<D> {
        self.mesh.gradient(cell as usize, |node| self.fields.pressure[node])
    }
}

/// Value of a nodal field at a point of a cell.
pub fn at_point<const D: usize>(mesh: &Mesh<D>, cell: u32, x: &Vector<D>, field: &[f64]) -> f64 {
    let nodes = mesh.cell(cell as usize);
    let first = (1.0 - x.sum()) * field[nodes[0] as usize];
    (0..D).fold(first, |sum, k| sum + x[k] * field[nodes[k + 1] as usize])
}

impl<const D: usize> Pieces<D> {
    /// Mean of a nodal field over the pieces of a grain.
    pub fn mean(&self, grain: usize, mesh: &Mesh<D>, field: &[f64]) -> f64 {
        self.of(grain).map(|q| self.share[q] * at_point(mesh, self.cell[q], &self.coordinate[q], field)).sum()
    }
}

impl<const D: usize> AtGrains<D> {
    /// Means of the fields over the pieces of each grain; the temperature is that scalar of the fluid, if it is wanted.
    /// A grain without pieces keeps what it had.
    pub fn sample(&mut self, pieces: &Pieces<D>, fluid: &OnMesh<'_, D>, temperature: Option<usize>) {
        let count = pieces.grains();
        self.velocity.resize(count, Vector::zeros());
        self.pressure_gradient.resize(count, Vector::zeros());
        (self.velocity.par_iter_mut(), self.pressure_gradient.par_iter_mut())
            .into_par_iter()
            .enumerate()
            .with_min_len(CHUNK)
            .for_each(|(grain, (velocity, slope))| {
                if pieces.of(grain).is_empty() {
                    return;
                }
                (*velocity, *slope) = (Vector::zeros(), Vector::zeros());
                for q in pieces.of(grain) {
                    let share = pieces.share[q];
                    *velocity += fluid.velocity(pieces.cell[q], &pieces.coordinate[q]) * share;
                    *slope += fluid.pressure_gradient(pieces.cell[q]) * share;
                }
            });
        let Some(field) = temperature.and_then(|scalar| fluid.fields.scalars.get(scalar)) else {
            self.temperature.clear();
            return;
        };
        self.temperature.resize(count, 0.0);
        let means = self.temperature.par_iter_mut().enumerate().with_min_len(CHUNK);
        means.filter(|(grain, _)| !pieces.of(*grain).is_empty()).for_each(|(grain, mean)| {
            *mean = pieces.mean(grain, fluid.mesh, field);
        });
    }
}

/// What makes the law of the solid flux that of rigid grains.
#[derive(Clone, Copy, Debug)]
pub struct Rigid<'a, const D: usize> {
    /// The last accepted state of the fluid, on the mesh of the step.
    pub fluid: OnMesh<'a, D>,
    /// Density of the fluid, kg/m3.
    pub density: f64,
    /// Length of the step, s.
    pub dt: f64,
}

impl<const D: usize> GrainLoad<D> {
    /// The point terms of this load; of heat, which is that scalar of the `scalars` of the fluid, if grains have it.
    pub fn fill_points(&self, rigid: &Rigid<'_, D>, (heat, scalars): (usize, usize), out: &mut Points<D>) {
        let (pieces, count) = (&self.pieces, self.pieces.len());
        out.cell.clone_from(&pieces.cell);
        out.coordinate.clone_from(&pieces.coordinate);
        for column in [&mut out.volume, &mut out.drag, &mut out.mobility, &mut out.flux_mobility] {
            column.resize(count, 0.0);
        }
        for column in [&mut out.velocity, &mut out.flux_velocity] {
            column.resize(count, Vector::zeros());
        }
        for grain in 0..pieces.grains() {
            for q in pieces.of(grain) {
                let share = pieces.share[q];
                out.volume[q] = share * self.volume[grain];
                out.drag[q] = share * self.drag[grain];
                out.mobility[q] = self.mobility[grain] / share;
                out.velocity[q] = self.velocity[grain] + self.known(grain) * self.mobility[grain];
            }
        }
        match &self.continuity {
            None => {
                out.flux_mobility.copy_from_slice(&out.mobility);
                out.flux_velocity.copy_from_slice(&out.velocity);
            }
            Some(law) => self.fill_flux(law, rigid, out),
        }
        // A point has no known force: in the equation of momentum a velocity stands for it that the drag turns into it.
        for (grain, known) in self.known.iter().enumerate() {
            let unfelt = velocity_offset(*known, self.drag[grain]);
            pieces.of(grain).for_each(|q| out.velocity[q] -= unfelt);
        }
        out.scalars.resize(scalars, None);
        for (scalar, columns) in out.scalars.iter_mut().enumerate() {
            match &self.heat {
                Some(law) if scalar == heat => law.fill_points(pieces, columns.get_or_insert_default()),
                _ => *columns = None,
            }
        }
    }

    fn fill_flux(&self, law: &Law<D>, rigid: &Rigid<'_, D>, out: &mut Points<D>) {
        let pieces = &self.pieces;
        for grain in 0..pieces.grains() {
            let mobility = law.mobility[grain];
            let velocity = law.velocity[grain] + self.known(grain) * mobility;
            let (drag, volume) = (self.drag[grain], self.volume[grain]);
            if mobility == 0.0 {
                for q in pieces.of(grain) {
                    (out.flux_mobility[q], out.flux_velocity[q]) = (0.0, velocity);
                }
                continue;
            }
            let inertia = rigid.density * volume / rigid.dt;
            let weight = |q: usize| {
                let (cell, place) = (pieces.cell[q], &pieces.coordinate[q]);
                let eps = at_point(rigid.fluid.mesh, cell, place, &self.voidage).max(LEAST);
                let lasting = mobility * (drag + eps * inertia) * (1.0 - eps) / LASTING;
                eps * eps / (eps * eps + lasting)
            };
            let (mut sum, mut whole) = (Vector::zeros(), 0.0);
            for q in pieces.of(grain) {
                let (cell, part) = (pieces.cell[q], weight(q) * pieces.share[q]);
                let forcing = rigid.fluid.velocity(cell, &pieces.coordinate[q]) * drag
                    - rigid.fluid.pressure_gradient(cell) * volume;
                sum += forcing * part;
                whole += part;
                out.flux_velocity[q] = forcing;
            }
            let mean = sum / whole;
            for q in pieces.of(grain) {
                let beyond = (out.flux_velocity[q] - mean) * (mobility * weight(q));
                (out.flux_mobility[q], out.flux_velocity[q]) =
                    (mobility / pieces.share[q], velocity - beyond);
            }
        }
    }
}

impl crate::load::HeatLoad {
    fn fill_points<const D: usize>(&self, pieces: &Pieces<D>, out: &mut PointScalar) {
        for column in [&mut out.coefficient, &mut out.mobility, &mut out.value] {
            column.resize(pieces.len(), 0.0);
        }
        for grain in 0..pieces.grains() {
            for q in pieces.of(grain) {
                let share = pieces.share[q];
                out.coefficient[q] = share * self.coefficient[grain];
                out.mobility[q] = self.mobility[grain] / share;
                out.value[q] = self.temperature[grain];
            }
        }
    }
}

/// Force of the fluid at a point, N: -V grad p + gamma (u - v*) with the fluid at its place.
pub fn force_at<const D: usize>(points: &Points<D>, fluid: &OnMesh<'_, D>, q: usize) -> Vector<D> {
    let forcing = fluid.velocity(points.cell[q], &points.coordinate[q]) * points.drag[q]
        - fluid.pressure_gradient(points.cell[q]) * points.volume[q];
    forcing - (points.velocity[q] + forcing * points.mobility[q]) * points.drag[q]
}

/// What the fluid gives of a scalar at a point, h (s - s*), W for heat; zero of one that the points do not exchange.
pub fn given_at<const D: usize>(points: &Points<D>, fluid: &OnMesh<'_, D>, scalar: usize, q: usize) -> f64 {
    let columns = points.scalars.get(scalar).and_then(Option::as_ref);
    columns.zip(fluid.fields.scalars.get(scalar)).map_or(0.0, |(columns, field)| {
        let value = at_point(fluid.mesh, points.cell[q], &points.coordinate[q], field);
        let given = columns.coefficient[q] * value;
        given - columns.coefficient[q] * (columns.value[q] + columns.mobility[q] * given)
    })
}

/// Force (N) and heat (W) that the fluid gives at all points together, by its own fields there; of heat, which is that
/// scalar.
pub fn lost<const D: usize>(points: &Points<D>, fluid: &OnMesh<'_, D>, heat: usize) -> (Vector<D>, f64) {
    let force = (0..points.len()).map(|q| force_at(points, fluid, q)).sum();
    (force, (0..points.len()).map(|q| given_at(points, fluid, heat, q)).sum())
}
