//! Time averages of packing fraction and grain velocity on a regular grid.

use super::files::write_whole;
use crate::Average;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};
use std::path::Path;
use voidage_coupling::error::Result;
use voidage_dem::Period;

/// Points that stand for equal shares of a disc when it is spread over the squares of the grid.
const SHARES: usize = 32;

/// Sums over the samples taken so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Averages {
    /// What was asked for: begin, end and time between samples (zero: every step), s, and side of a square, m.
    asked: [f64; 4],
    lower: [f64; 2],
    /// Sides of a square along x and y, m: the asked one, fitted to the box.
    cell: [f64; 2],
    count: [usize; 2],
    samples: u64,
    /// Solid area in each square, m2, summed over samples.
    solid: Vec<f64>,
    /// Solid area times velocity, m3/s, summed over samples.
    flux: Vec<[f64; 2]>,
}

impl Averages {
    /// A grid over a box, m, of squares with about the side that is asked for.
    pub fn new(lower: [f64; 2], upper: [f64; 2], asked: &Average) -> Self {
        let (cell, asked) = (asked.cell, Self::asked(asked));
        let count = [0, 1].map(|axis| ((upper[axis] - lower[axis]) / cell).round().max(1.0) as usize);
        let cell = [0, 1].map(|axis| (upper[axis] - lower[axis]) / count[axis] as f64);
        let squares = count[0] * count[1];
        Averages {
            asked,
            lower,
            cell,
            count,
            samples: 0,
            solid: vec![0.0; squares],
            flux: vec![[0.0; 2]; squares],
        }
    }

    /// Whether the same was asked for. The box may have moved since, with a mesh or with grains.
    pub(super) fn asked_as(&self, average: &Average) -> bool {
        self.asked == Self::asked(average)
    }

    fn asked(average: &Average) -> [f64; 4] {
        let Average { from, to, cell, interval } = *average;
        [from, to, interval.unwrap_or(0.0), cell]
    }

    /// Number of samples taken.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Takes a sample: centres, m, velocities, m/s, radii, m, and solid areas, m2, of the discs. What lies outside of
    /// the box is left out; what lies beyond a periodic side is at the other. In space: seen along the second axis,
    /// volumes for areas.
    pub fn sample<const D: usize>(
        &mut self,
        positions: &[SVector<f64, D>],
        velocities: &[SVector<f64, D>],
        radii: &[f64],
        areas: &[f64],
        period: &Period<D>,
    ) {
        let pattern = shares();
        self.samples += 1;
        for (i, centre) in positions.iter().enumerate() {
            let share = areas[i] / SHARES as f64;
            for point in &pattern {
                let mut place = *centre;
                place[0] += radii[i] * point[0];
                place[D - 1] += radii[i] * point[1];
                let place = period.wrap(place);
                let Some(square) = self.square([place[0], place[D - 1]]) else { continue };
                self.solid[square] += share;
                self.flux[square][0] += share * velocities[i][0];
                self.flux[square][1] += share * velocities[i][D - 1];
            }
        }
    }

    fn square(&self, point: [f64; 2]) -> Option<usize> {
        let index = [0, 1].map(|axis| ((point[axis] - self.lower[axis]) / self.cell[axis]).floor());
        let inside = (0..2).all(|axis| index[axis] >= 0.0 && index[axis] < self.count[axis] as f64);
        inside.then(|| index[1] as usize * self.count[0] + index[0] as usize)
    }

    /// Writes the averages, one row per square; squares that never held a grain have velocity zero.
    pub fn write(&self, path: &Path) -> Result<()> {
        let area = self.cell[0] * self.cell[1] * self.samples.max(1) as f64;
        write_whole(path, |file| {
            writeln!(file, "x_m,y_m,packing_fraction,grain_velocity_x_m_per_s,grain_velocity_y_m_per_s")?;
            for (square, (solid, flux)) in self.solid.iter().zip(&self.flux).enumerate() {
                let index = [square % self.count[0], square / self.count[0]];
                let [x, y] =
                    [0, 1].map(|axis| self.lower[axis] + (index[axis] as f64 + 0.5) * self.cell[axis]);
                let [u, v] = flux.map(|flux| if *solid > 0.0 { flux / solid } else { 0.0 });
                writeln!(file, "{x},{y},{},{u},{v}", solid / area)?;
            }
            Ok(())
        })
    }
}

/// Points of the unit disc, each at the middle of an equal share: turned by the golden angle, radius sqrt((k + 1/2)/n).
fn shares() -> [[f64; 2]; SHARES] {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    std::array::from_fn(|k| {
        let radius = ((k as f64 + 0.5) / SHARES as f64).sqrt();
        let (sin, cos) = (k as f64 * golden).sin_cos();
        [radius * cos, radius * sin]
    })
}
