//! Bodies that fill a given solid volume and move as given: what a manufactured solution puts in place of grains.

use super::manufactured::{Bodies, Fields};
use crate::models::Vec2;
use voidage_fluid::Mesh;
use voidage_fluid::exchange::{Exchange, HeatExchange, Pieces};

/// Points of a cell where a rule with equal weights is exact to degree 2.
const PLACES: [[f64; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// Three bodies in every cell, so that sums over them are integrals of second order.
pub struct Immersed {
    pieces: Pieces<2>,
    volume: Vec<f64>,
    drag: Vec<f64>,
    mobility: Vec<f64>,
    velocity: Vec<Vec2>,
    coefficient: Vec<f64>,
    heat_mobility: Vec<f64>,
    temperature: Vec<f64>,
}

impl Immersed {
    /// The bodies at a time, s. The laws v* = b + a (gamma u - V grad p) and T* = bT + aT hA T give the exact velocity and
    /// temperature of a body for the exact fields, and react to others.
    pub fn new(mesh: &Mesh<2>, fields: &Fields, bodies: &Bodies, time: f64) -> Self {
        let count = 3 * mesh.cell_count();
        let mut all = Self {
            pieces: Pieces {
                first: (0..=count as u32).collect(),
                cell: (0..count as u32).map(|piece| piece / 3).collect(),
                coordinate: (0..count)
                    .map(|piece| Vec2::new(PLACES[piece % 3][1], PLACES[piece % 3][2]))
                    .collect(),
                share: vec![1.0; count],
            },
            volume: Vec::new(),
            drag: Vec::new(),
            mobility: Vec::new(),
            velocity: Vec::new(),
            coefficient: Vec::new(),
            heat_mobility: Vec::new(),
            temperature: Vec::new(),
        };
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
                all.volume.push(volume);
                all.drag.push(drag);
                all.mobility.push(mobility);
                all.velocity.push(v - (u * drag - slope * volume) * mobility);
                all.coefficient.push(coefficient);
                all.heat_mobility.push(bodies.warming / coefficient);
                all.temperature.push(exact.warmth.value - bodies.warming * exact.temperature.value);
            }
        }
        all
    }

    /// As the fluid takes them.
    pub fn exchange(&self) -> Exchange<'_, 2> {
        Exchange {
            pieces: &self.pieces,
            volume: &self.volume,
            drag: &self.drag,
            mobility: &self.mobility,
            velocity: &self.velocity,
            continuity: None,
            heat: Some(HeatExchange {
                coefficient: &self.coefficient,
                mobility: &self.heat_mobility,
                temperature: &self.temperature,
            }),
        }
    }
}
