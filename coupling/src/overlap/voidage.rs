//! The voidage at the nodes.

use crate::exchange::Pieces;
use voidage_fluid::{Mesh, Vector};

/// Voidage is clipped below at this (no unit): equations stay regular where grains fill everything.
pub const LEAST_VOIDAGE: f64 = 1e-8;

/// Voidage at the nodes (Eq. A.14): 1 - eps_a = sum_q V_q phi_a(x_q) / integral(phi_a), clipped below at
/// [`LEAST_VOIDAGE`].
///
/// `volume` is the solid volume of each body and `nodal_volume` the integral of each shape function
/// ([`Mesh::nodal_volume`]), both in m2 (2D, per metre of depth) or m3. Returns the solid volume that the
/// nodes got, before clipping. Nodes that are one over periodic sides get what all of them are given.
pub fn voidage<const D: usize>(
    mesh: &Mesh<D>,
    pieces: &Pieces<D>,
    volume: &[f64],
    nodal_volume: &[f64],
    out: &mut Vec<f64>,
) -> f64 {
    spread(mesh, pieces, volume, out);
    let total = out.iter().sum();
    for (eps, nodal) in out.iter_mut().zip(nodal_volume) {
        *eps = (1.0 - *eps / nodal).max(LEAST_VOIDAGE);
    }
    mesh.periodic.mirror(out);
    total
}

/// What bodies have, per volume at the nodes, averaged as the voidage is: sum_q A_q phi_a(x_q) / integral(phi_a), A_q
/// the share of a piece in the `amount` of its body.
pub fn density<const D: usize>(
    mesh: &Mesh<D>,
    pieces: &Pieces<D>,
    amount: &[f64],
    nodal_volume: &[f64],
    out: &mut Vec<f64>,
) {
    spread(mesh, pieces, amount, out);
    out.iter_mut().zip(nodal_volume).for_each(|(value, nodal)| *value /= nodal);
    mesh.periodic.mirror(out);
}

/// Gives each node its part of what bodies have, piece by piece; of nodes that are one the master has it all.
pub fn spread<const D: usize>(mesh: &Mesh<D>, pieces: &Pieces<D>, amount: &[f64], out: &mut Vec<f64>) {
    out.clear();
    out.resize(mesh.points.len(), 0.0);
    for (body, &amount) in amount.iter().enumerate() {
        for q in pieces.of(body) {
            let nodes = mesh.cell(pieces.cell[q] as usize);
            let x: &Vector<D> = &pieces.coordinate[q];
            let piece = amount * pieces.share[q];
            out[nodes[0] as usize] += piece * (1.0 - x.sum());
            for k in 0..D {
                out[nodes[k + 1] as usize] += piece * x[k];
            }
        }
    }
    mesh.periodic.gather(out);
}
