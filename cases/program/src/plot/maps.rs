//! Time averages: packing fraction, and grain velocity.

use super::plane::{Plane, Scale};
use crate::results::table::Table;
use plotters::style::colors::{BLACK, WHITE};
use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Result};

/// The averages as a grid.
struct Grid<'a> {
    x: &'a [f64],
    y: &'a [f64],
    packing: &'a [f64],
    velocity: [&'a [f64]; 2],
    /// Half the sides of a square.
    half: [f64; 2],
}

/// Draws both maps.
pub fn draw(folder: &Path, table: &Table) -> Result<Vec<PathBuf>> {
    let Some(grid) = Grid::new(table) else {
        return Err(Error::input(format!(
            "{}: is no table of averages",
            folder.join("averages.csv").display()
        )));
    };
    let packing = folder.join("packing.png");
    grid.packing(&packing)?;
    let velocity = folder.join("velocity.png");
    grid.velocity(&velocity)?;
    Ok(vec![packing, velocity])
}

impl<'a> Grid<'a> {
    fn new(table: &'a Table) -> Option<Grid<'a>> {
        let (x, y) = (table.column("x_m")?, table.column("y_m")?);
        // Squares come row by row: the first step along x, and the first along y.
        let dx = x.get(1).map_or(1.0, |second| second - x[0]);
        let dy = y.iter().find(|other| **other > y[0]).map_or(dx, |second| second - y[0]);
        Some(Grid {
            x,
            y,
            packing: table.column("packing_fraction")?,
            velocity: [table.column("grain_velocity_x_m_per_s")?, table.column("grain_velocity_y_m_per_s")?],
            half: [0.5 * dx.abs(), 0.5 * dy],
        })
    }

    fn speed(&self, square: usize) -> f64 {
        self.velocity[0][square].hypot(self.velocity[1][square])
    }

    /// The part of the box that grains reach, with a margin: the rest is empty.
    fn plane(&self) -> [f64; 4] {
        let used = self.y.iter().zip(self.packing).filter(|(_, packing)| **packing > 1e-3).map(|(y, _)| *y);
        let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = |values: &[f64]| values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (bottom, top) = (least(self.y) - self.half[1], most(self.y) + self.half[1]);
        let reached = used.fold(bottom + 0.2 * (top - bottom), f64::max);
        let top = (reached + 0.1 * (reached - bottom)).min(top);
        [least(self.x) - self.half[0], bottom, most(self.x) + self.half[0], top]
    }

    /// Fills the squares that have a value; the others stay white.
    fn fill(&self, plane: &mut Plane, scale: &Scale, value: impl Fn(usize) -> Option<f64>) {
        for (square, value) in (0..self.x.len()).filter_map(|square| Some((square, value(square)?))) {
            let lower = [self.x[square] - self.half[0], self.y[square] - self.half[1]];
            let upper = [self.x[square] + self.half[0], self.y[square] + self.half[1]];
            plane.rectangle(lower, upper, scale.colour(value));
        }
    }

    fn packing(&self, path: &Path) -> Result<()> {
        let high = self.packing.iter().copied().fold(0.0, f64::max);
        let scale = Scale {
            name: "packing fraction".to_owned(),
            gradient: colorous::VIRIDIS,
            low: 0.0,
            high: (high * 20.0).ceil() / 20.0,
            part: [0.0, 1.0],
        };
        let mut plane = Plane::new(path, self.plane(), "", std::slice::from_ref(&scale))?;
        self.fill(&mut plane, &scale, |square| Some(self.packing[square]));
        plane.save()
    }

    fn velocity(&self, path: &Path) -> Result<()> {
        let seen = |square: &usize| self.packing[*square] > 0.02;
        let high = (0..self.x.len()).filter(seen).map(|square| self.speed(square)).fold(0.0, f64::max);
        let high = if high > 0.0 { high } else { 1.0 };
        let scale = Scale {
            name: "grain speed (m/s)".to_owned(),
            gradient: colorous::VIRIDIS,
            low: 0.0,
            high,
            part: [0.0, 1.0],
        };
        let bounds = self.plane();
        let mut plane = Plane::new(path, bounds, "", std::slice::from_ref(&scale))?;
        self.fill(&mut plane, &scale, |square| seen(&square).then(|| self.speed(square)));
        // About 22 arrows across; the longest reaches its neighbour.
        let width = bounds[2] - bounds[0];
        let skip = (width / 22.0 / (2.0 * self.half[0])).round().max(1.0);
        let columns = self.y.iter().take_while(|y| **y == self.y[0]).count().max(1);
        let longest = 2.0 * self.half[0] * skip;
        let arrows = (0..self.x.len()).filter(seen).filter(|square| {
            let (column, row) = (square % columns, square / columns);
            let every = |index: usize| index % skip as usize == (skip as usize - 1) / 2;
            every(column) && every(row)
        });
        let arrows = arrows.map(|square| {
            // Length by the root of the speed, so that slow parts show their direction too.
            let speed = self.speed(square).max(1e-300);
            let length = longest * (speed / high).sqrt() / speed;
            let [u, v] = [self.velocity[0][square] * length, self.velocity[1][square] * length];
            (
                [self.x[square] - 0.5 * u, self.y[square] - 0.5 * v],
                [self.x[square] + 0.5 * u, self.y[square] + 0.5 * v],
            )
        });
        plane.arrows(arrows.collect(), WHITE, BLACK)?;
        plane.save()
    }
}
