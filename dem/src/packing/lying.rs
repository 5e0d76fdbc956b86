//! Discs that lie still, found by place, between straight walls.

use crate::Vector;

type Point = Vector<2>;

/// End of a chain of discs.
const NONE: u32 = u32::MAX;

/// Discs of one class of size: at most `largest` in radius, and above half of that but for the last class.
#[derive(Default)]
struct SizeClass {
    largest: f64,
    /// First disc of each cell, row by row; rows are added as discs lie higher.
    first: Vec<u32>,
}

/// Discs that lie still. Cells are as wide as the largest diameter of a class of size, so that small discs among large
/// ones are found as fast as equal ones.
pub(super) struct Lying {
    pub position: Vec<Point>,
    pub radius: Vec<f64>,
    /// The highest point of all discs, m.
    pub top: f64,
    low: Point,
    width: f64,
    classes: Vec<SizeClass>,
    /// The next disc of the same cell.
    next: Vec<u32>,
}

/// Classes of size at most; all smaller discs are of the last.
const MOST_CLASSES: usize = 12;

impl Lying {
    /// No disc yet, in a region from `low` on that is `width` wide; radii from `smallest` to `largest`, m.
    pub fn new(low: Point, width: f64, (smallest, largest): (f64, f64)) -> Self {
        let count = ((largest / smallest).log2().floor() as usize + 1).min(MOST_CLASSES);
        let classes =
            (0..count).map(|k| SizeClass { largest: largest / f64::from(1 << k), first: vec![] }).collect();
        Self { position: vec![], radius: vec![], top: low[1], low, width, classes, next: vec![] }
    }

    /// Largest radius that discs may have, m.
    pub fn largest(&self) -> f64 {
        self.classes[0].largest
    }

    /// Number of columns of cells of a class.
    fn columns(&self, class: &SizeClass) -> usize {
        (self.width / (2.0 * class.largest)).floor().clamp(1.0, 1e6) as usize
    }

    /// Column and row of a place; places outside of the region belong to its nearest cell.
    fn cell(&self, class: &SizeClass, x: f64, y: f64) -> [usize; 2] {
        let columns = self.columns(class);
        let along = (x - self.low[0]) / self.width * columns as f64;
        let up = (y - self.low[1]) / (2.0 * class.largest);
        [(along.max(0.0) as usize).min(columns - 1), up.max(0.0) as usize]
    }

    /// Adds a disc.
    pub fn push(&mut self, position: Point, radius: f64) {
        let k = self.classes.iter().rposition(|class| radius <= class.largest).unwrap_or(0);
        let [column, row] = self.cell(&self.classes[k], position[0], position[1]);
        let columns = self.columns(&self.classes[k]);
        let first = &mut self.classes[k].first;
        if first.len() < (row + 1) * columns {
            first.resize((row + 1) * columns, NONE);
        }
        self.next.push(first[row * columns + column]);
        first[row * columns + column] = self.position.len() as u32;
        self.position.push(position);
        self.radius.push(radius);
        self.top = self.top.max(position[1] + radius);
    }

    /// Visits all discs that may largest into a box, and some that do not.
    pub fn near(&self, low: Point, high: Point, mut visit: impl FnMut(usize)) {
        for class in &self.classes {
            let columns = self.columns(class);
            let [left, bottom] = self.cell(class, low[0] - class.largest, low[1] - class.largest);
            let [right, top] = self.cell(class, high[0] + class.largest, high[1] + class.largest);
            let rows = class.first.len() / columns;
            for row in bottom..(top + 1).min(rows) {
                for &first in &class.first[row * columns + left..=row * columns + right] {
                    let mut disc = first;
                    while disc != NONE {
                        visit(disc as usize);
                        disc = self.next[disc as usize];
                    }
                }
            }
        }
    }
}

/// A straight wall that stands still.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub from: Point,
    /// Unit vector from the first end to the second.
    pub along: Point,
    pub length: f64,
}

impl Segment {
    pub fn new([from, to]: [Point; 2]) -> Self {
        let length = (to - from).norm();
        Self { from, along: (to - from) / length, length }
    }

    pub fn to(&self) -> Point {
        self.from + self.along * self.length
    }

    /// A unit vector orthogonal to the wall.
    pub fn side(&self) -> Point {
        Point::new(-self.along[1], self.along[0])
    }

    /// How far along the wall its point nearest to `x` is, m.
    pub fn nearest(&self, x: &Point) -> f64 {
        (x - self.from).dot(&self.along).clamp(0.0, self.length)
    }

    /// Vector from the nearest point of the wall to `x`.
    pub fn arm(&self, x: &Point) -> Point {
        x - (self.from + self.along * self.nearest(x))
    }

    /// Whether the box that holds the wall meets another one.
    pub fn meets(&self, low: &Point, high: &Point) -> bool {
        let to = self.to();
        (0..2).all(|a| self.from[a].min(to[a]) <= high[a] && self.from[a].max(to[a]) >= low[a])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    #[test]
    fn every_disc_that_reaches_into_a_box_is_found() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let low = Point::new(-1.0, 2.0);
        let mut lying = Lying::new(low, 3.0, (1e-3, 0.1));
        for _ in 0..400 {
            let x = low + Point::new(3.0 * rng.random::<f64>(), 2.0 * rng.random::<f64>());
            lying.push(x, 1e-3 + 0.099 * rng.random::<f64>().powi(3));
        }
        for _ in 0..50 {
            let a = low + Point::new(3.0 * rng.random::<f64>(), 2.0 * rng.random::<f64>());
            let b = a + Point::new(0.3 * rng.random::<f64>(), 0.3 * rng.random::<f64>());
            let mut found = vec![false; 400];
            lying.near(a, b, |k| found[k] = true);
            for (k, (x, r)) in lying.position.iter().zip(&lying.radius).enumerate() {
                let inside = (0..2).all(|i| x[i] + r >= a[i] && x[i] - r <= b[i]);
                assert!(found[k] || !inside, "disc {k}");
            }
        }
    }
}
