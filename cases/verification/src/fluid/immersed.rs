//! Bodies that fill a given solid volume and move as given: what a manufactured solution puts in place of grains.

use super::manufactured::{Bodies, Fields};
use crate::models::Vec2;
use voidage_fluid::Mesh;
use voidage_fluid::points::{PointScalar, Points};

/// Points of a cell where a rule with equal weights is exact to degree 2.
const PLACES: [[f64; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// Three bodies in every cell, so that sums over them are integrals of second order, at a time, s. The laws
/// v* = b + a (gamma u - V grad p) and T* = c + a h T give the exact velocity and temperature of a body for the exact
/// fields, and react to others.
pub fn points(mesh: &Mesh<2>, fields: &Fields, bodies: &Bodies, time: f64) -> Points<2> {
    let mut points = Points::default();
    let mut heat = PointScalar::default();
    for cell in 0..mesh.cell_count() {
        let corner = [0, 1, 2].map(|a| mesh.points[mesh.cells[3 * cell + a] as usize]);
        for l in PLACES {
            let x = corner[0] * l[0] + corner[1] * l[1] + corner[2] * l[2];
            let exact = fields.exact(x, time);
            let volume = (1.0 - exact.voidage.value) * mesh.measure(cell) / 3.0;
            let (drag, coefficient) = (bodies.drag * volume, bodies.heat * volume);
            let mobility = bodies.yielding / drag;
            let [u, v] =
                [exact.velocity, exact.bodies].map(|field| Vec2::new(field[0].value, field[1].value));
            let slope = Vec2::new(exact.pressure.slope[0], exact.pressure.slope[1]);
            points.cell.push(cell as u32);
            points.coordinate.push(Vec2::new(l[1], l[2]));
            points.volume.push(volume);
            points.drag.push(drag);
            points.mobility.push(mobility);
            points.velocity.push(v - (u * drag - slope * volume) * mobility);
            heat.coefficient.push(coefficient);
            heat.mobility.push(bodies.warming / coefficient);
            heat.value.push(exact.warmth.value - bodies.warming * exact.temperature.value);
        }
    }
    points.flux_mobility.clone_from(&points.mobility);
    points.flux_velocity.clone_from(&points.velocity);
    points.scalars = vec![Some(heat)];
    points
}
