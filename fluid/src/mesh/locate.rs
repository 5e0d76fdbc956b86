//! Finding the cell that contains a point.

use super::{Mesh, Neighbours};
use crate::{Result, Vector};

/// Barycentric coordinates down to this count as inside: no point falls between two cells by round-off.
const SLACK: f64 = 1e-12;
/// Longest walk before the grid is asked instead.
const LONGEST_WALK: usize = 64;

/// Finds cells by walking over facets from a hint, or without one by a grid of boxes over the mesh.
#[derive(Clone, Debug)]
pub struct Locator<const D: usize> {
    neighbours: Neighbours<D>,
    lower: Vector<D>,
    /// Side of a box of the grid, m.
    width: f64,
    /// Number of boxes along each axis.
    boxes: [usize; D],
    /// Box b touches the cells `cells[first[b]..first[b + 1]]`.
    first: Vec<u32>,
    cells: Vec<u32>,
}

impl<const D: usize> Default for Locator<D> {
    /// The search in a mesh without cells.
    fn default() -> Self {
        Self {
            neighbours: Neighbours::default(),
            lower: Vector::zeros(),
            width: 1.0,
            boxes: [0; D],
            first: vec![0],
            cells: vec![],
        }
    }
}

impl<const D: usize> Locator<D> {
    /// Prepares the search in a mesh.
    pub fn new(mesh: &Mesh<D>) -> Result<Self> {
        mesh.check()?;
        let mut locator = Self {
            neighbours: mesh.neighbours()?,
            lower: Vector::zeros(),
            width: 1.0,
            boxes: [1; D],
            first: Vec::new(),
            cells: Vec::new(),
        };
        locator.moved(mesh);
        Ok(locator)
    }

    /// The cell across each facet.
    pub fn neighbours(&self) -> &Neighbours<D> {
        &self.neighbours
    }

    /// Tells that the nodes of the mesh have moved; the cells must be the same.
    pub fn moved(&mut self, mesh: &Mesh<D>) {
        let (lower, upper) = mesh.bounds();
        // About one box per cell: a box and a cell then touch a handful of each other.
        let extent = upper - lower;
        let space: f64 = extent.iter().product();
        self.lower = lower;
        self.width = (space / mesh.cell_count() as f64).powf(1.0 / D as f64);
        self.boxes = std::array::from_fn(|k| (extent[k] / self.width).ceil().max(1.0) as usize);
        let count: usize = self.boxes.iter().product();

        // Count, sum up, fill: a compressed list without a vector per box.
        self.first.clear();
        self.first.resize(count + 2, 0);
        let mut first = std::mem::take(&mut self.first);
        for cell in 0..mesh.cell_count() {
            self.for_boxes_of(mesh, cell, |b| first[b + 2] += 1);
        }
        for b in 2..first.len() {
            first[b] += first[b - 1];
        }
        let mut cells = std::mem::take(&mut self.cells);
        cells.resize(first[count + 1] as usize, 0);
        for cell in 0..mesh.cell_count() {
            self.for_boxes_of(mesh, cell, |b| {
                cells[first[b + 1] as usize] = cell as u32;
                first[b + 1] += 1;
            });
        }
        first.pop();
        self.first = first;
        self.cells = cells;
    }

    fn for_boxes_of(&self, mesh: &Mesh<D>, cell: usize, visit: impl FnMut(usize)) {
        let infinite = Vector::<D>::repeat(f64::INFINITY);
        let corners = mesh.cell(cell).iter().map(|&node| mesh.points[node as usize]);
        let (lower, upper) = corners.fold((infinite, -infinite), |(l, u), p| (l.inf(&p), u.sup(&p)));
        self.for_boxes(&lower, &upper, visit);
    }

    /// Visits the boxes of the grid that meet a box in space; points beyond the grid count to its outermost boxes.
    fn for_boxes(&self, lower: &Vector<D>, upper: &Vector<D>, mut visit: impl FnMut(usize)) {
        let place = |p: &Vector<D>, k: usize| {
            (((p[k] - self.lower[k]) / self.width).max(0.0) as usize).min(self.boxes[k] - 1)
        };
        let from: [usize; D] = std::array::from_fn(|k| place(lower, k));
        let to: [usize; D] = std::array::from_fn(|k| place(upper, k));
        let mut at = from;
        loop {
            visit(at.iter().zip(&self.boxes).rev().fold(0, |sum, (i, n)| sum * n + i));
            // Count up like an odometer.
            let Some(k) = (0..D).find(|&k| at[k] < to[k]) else { return };
            at[..k].copy_from_slice(&from[..k]);
            at[k] += 1;
        }
    }

    /// Visits the cells that may meet a box in space, some more than once.
    pub fn for_cells_near(&self, lower: &Vector<D>, upper: &Vector<D>, mut visit: impl FnMut(usize)) {
        self.for_boxes(lower, upper, |b| {
            let (from, to) = (self.first[b] as usize, self.first[b + 1] as usize);
            self.cells[from..to].iter().for_each(|&cell| visit(cell as usize));
        });
    }

    /// The cell that contains a point, `None` outside of the mesh. On a facet either cell is right, and which one is
    /// found may depend on the hint: the cell where the walk starts, best near the point.
    pub fn locate(&self, mesh: &Mesh<D>, p: &Vector<D>, hint: Option<u32>) -> Option<u32> {
        if !p.iter().all(|x| x.is_finite()) {
            return None;
        }
        let hint = hint.filter(|&cell| (cell as usize) < mesh.cell_count());
        hint.and_then(|cell| self.walk(mesh, p, cell)).or_else(|| self.search(mesh, p))
    }

    /// From cell to cell, across the facet that the point lies most beyond. Ends without result at the boundary: the
    /// point may still lie inside, behind a hole.
    fn walk(&self, mesh: &Mesh<D>, p: &Vector<D>, mut cell: u32) -> Option<u32> {
        for _ in 0..LONGEST_WALK {
            let coordinate = mesh.barycentric(cell as usize, p);
            let (mut k, mut least) = (0, 1.0 - coordinate.sum());
            for i in 0..D {
                if coordinate[i] < least {
                    (k, least) = (i + 1, coordinate[i]);
                }
            }
            if least >= -SLACK {
                return Some(cell);
            }
            cell = self.neighbours.of(cell as usize)[k];
            if cell == Neighbours::<D>::NONE {
                return None;
            }
        }
        None
    }

    fn search(&self, mesh: &Mesh<D>, p: &Vector<D>) -> Option<u32> {
        let mut found: Option<usize> = None;
        self.for_cells_near(p, p, |cell| {
            let coordinate = mesh.barycentric(cell, p);
            if coordinate.min().min(1.0 - coordinate.sum()) >= -SLACK {
                found = Some(found.map_or(cell, |other| other.min(cell)));
            }
        });
        found.map(|cell| cell as u32)
    }
}
