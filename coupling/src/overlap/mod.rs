//! Grains cut by the elements of the fluid mesh (Eqs. A.14, A.15 of the paper), and the voidage that follows.
//!
//! Each grain is followed from step to step: its last cell is where the search for its centre starts. From the cell of
//! the centre the grain spreads over every facet it reaches, and in each cell its part is computed exactly.

mod disc;
#[cfg(test)]
mod tests;
mod voidage;

pub use voidage::{LEAST_VOIDAGE, density, spread, voidage};

use crate::exchange::Pieces;
use disc::Point;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use voidage_fluid::mesh::{Locator, Neighbours};
use voidage_fluid::{Error, Mesh, Result, Vector};

/// Grains per unit of parallel work: fixed, so that results do not depend on the number of threads.
const CHUNK: usize = 64;
/// Parts below this share of the grain are round-off and no pieces.
const LEAST_SHARE: f64 = 1e-14;
/// No cell known yet.
const UNKNOWN: u32 = u32::MAX;

/// Area of a disc of radius `radius` around the origin inside an anticlockwise triangle, exactly: m2 for lengths in m.
pub fn disc_in_triangle(triangle: [[f64; 2]; 3], radius: f64) -> f64 {
    disc::cut(triangle, radius).area
}

/// Cuts grains by the cells of a mesh. Keeps its memory from call to call.
#[derive(Debug, Default)]
pub struct Overlap<const D: usize> {
    locator: Locator<D>,
    /// Width over which grains are spread, in their diameters; up to 1 it is the grain itself. A wider disc around the
    /// same centre is cut into pieces then, and the shares of the grain are those of this disc; how much of the grain
    /// lies in the mesh is still told by the grain itself.
    pub kernel: f64,
    /// The cell of each grain's centre when last seen. It makes the search short and changes no result.
    hints: Vec<u32>,
    chunks: Vec<Chunk<D>>,
    /// Grains that were outside of the mesh in the last cut.
    outside: Vec<u32>,
    /// One per thread.
    scratch: Vec<Mutex<Scratch>>,
}

/// What a cut of all grains came to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CutReport {
    /// Number of pieces.
    pub pieces: usize,
    /// Largest share of a grain that the boundary of the mesh cuts off (no unit).
    pub cut_off: f64,
    /// Largest relative difference between the sum of the parts and the whole, over grains that the boundary does not
    /// touch: the round-off of the cut.
    pub defect: f64,
}

#[derive(Debug, Default)]
struct Chunk<const D: usize> {
    pieces: Pieces<D>,
    /// Share of each grain that lies in the mesh.
    inside: Vec<f64>,
    report: CutReport,
    /// Grains outside of the mesh.
    outside: Vec<u32>,
}

/// The state of one spreading.
#[derive(Debug, Default)]
struct Scratch {
    /// When a cell was last visited, counted in grains.
    visited: Vec<u32>,
    now: u32,
    to_visit: Vec<u32>,
    parts: Vec<CellPart>,
}

/// The part of a grain in a cell.
#[derive(Clone, Copy, Debug)]
struct CellPart {
    cell: u32,
    area: f64,
    coordinate: [f64; 2],
}

impl<const D: usize> Overlap<D> {
    /// Prepares the search in a mesh.
    pub fn new(mesh: &Mesh<D>) -> Result<Self> {
        if D != 2 {
            return Err(Error::Mesh("grains can be cut by the mesh only in the plane so far (D = 2)".into()));
        }
        let locator = Locator::new(mesh)?;
        Ok(Self { locator, ..Self::default() })
    }

    /// Tells that the nodes of the mesh have moved; the cells must be the same. A new mesh needs a new `Overlap`.
    pub fn moved(&mut self, mesh: &Mesh<D>) {
        self.locator.moved(mesh);
    }

    /// The search for cells.
    pub fn locator(&self) -> &Locator<D> {
        &self.locator
    }

    /// Cuts the discs of the given centres and radii (m) into `pieces`, grain by grain in the order of cells. The
    /// result depends on nothing but its arguments: not on earlier calls and not on the number of threads.
    ///
    /// `inside` gets the share of each grain that lies in the mesh; the shares of its pieces are shares of that. Of a
    /// grain cut in two by a thin wall the part with the centre counts. A grain wholly outside has no pieces, and is
    /// one of [`Self::outside`]. With a [kernel](Self::kernel) the pieces are
    /// those of wider discs.
    pub fn cut(
        &mut self,
        mesh: &Mesh<D>,
        positions: &[Vector<D>],
        radii: &[f64],
        pieces: &mut Pieces<D>,
        inside: &mut Vec<f64>,
    ) -> Result<CutReport> {
        if positions.len() != radii.len() {
            let text = format!("{} positions and {} radii", positions.len(), radii.len());
            return Err(Error::Mesh(text));
        }
        self.hints.resize(positions.len(), UNKNOWN);
        self.chunks.resize_with(positions.len().div_ceil(CHUNK), Chunk::default);
        let threads = rayon::current_num_threads().max(1);
        self.scratch.resize_with(threads.max(self.scratch.len()), Mutex::default);

        let (locator, kernel, scratch) = (&self.locator, self.kernel, &self.scratch);
        let grains =
            self.hints.par_chunks_mut(CHUNK).zip(positions.par_chunks(CHUNK)).zip(radii.par_chunks(CHUNK));
        self.chunks.par_iter_mut().zip(grains).for_each(|(chunk, ((hints, positions), radii))| {
            let thread = rayon::current_thread_index().unwrap_or(0) % scratch.len();
            let mut scratch = scratch[thread].lock().unwrap_or_else(PoisonError::into_inner);
            chunk.cut(mesh, (locator, kernel), &mut scratch, hints, positions, radii);
        });
        Ok(self.gather(pieces, inside))
    }

    /// The pieces of other discs than the grains, and the share of each that lies in the mesh.
    ///
    /// # Errors
    /// Those of [`Self::cut`].
    pub fn pieces_of(
        &mut self,
        mesh: &Mesh<D>,
        positions: &[Vector<D>],
        radii: &[f64],
    ) -> Result<(Pieces<D>, Vec<f64>)> {
        let of_grains = (std::mem::take(&mut self.hints), std::mem::take(&mut self.outside));
        let (mut pieces, mut inside) = (Pieces::default(), vec![]);
        let cut = self.cut(mesh, positions, radii, &mut pieces, &mut inside);
        (self.hints, self.outside) = of_grains;
        cut.map(|_| (pieces, inside))
    }

    /// Grains that were wholly outside of the mesh in the last cut, in order.
    pub fn outside(&self) -> &[u32] {
        &self.outside
    }

    /// Takes grains from those outside that are known to be elsewhere.
    pub fn find(&mut self, elsewhere: impl Fn(usize) -> bool) {
        self.outside.retain(|grain| !elsewhere(*grain as usize));
    }

    /// Forgets where grains were: their numbers have changed.
    pub fn forget(&mut self) {
        self.hints.clear();
        self.outside.clear();
    }

    /// Strings the chunks together.
    fn gather(&mut self, pieces: &mut Pieces<D>, inside: &mut Vec<f64>) -> CutReport {
        let mut report = CutReport::default();
        inside.clear();
        self.outside.clear();
        pieces.clear();
        pieces.first.push(0);
        for (i, chunk) in self.chunks.iter().enumerate() {
            self.outside.extend(chunk.outside.iter().map(|grain| (i * CHUNK) as u32 + grain));
            let before = pieces.len() as u32;
            pieces.first.extend(chunk.pieces.first.iter().map(|end| before + end));
            pieces.cell.extend_from_slice(&chunk.pieces.cell);
            pieces.coordinate.extend_from_slice(&chunk.pieces.coordinate);
            pieces.share.extend_from_slice(&chunk.pieces.share);
            inside.extend_from_slice(&chunk.inside);
            report.cut_off = report.cut_off.max(chunk.report.cut_off);
            report.defect = report.defect.max(chunk.report.defect);
        }
        report.pieces = pieces.len();
        report
    }
}

impl<const D: usize> Chunk<D> {
    fn cut(
        &mut self,
        mesh: &Mesh<D>,
        (locator, kernel): (&Locator<D>, f64),
        scratch: &mut Scratch,
        hints: &mut [u32],
        positions: &[Vector<D>],
        radii: &[f64],
    ) {
        self.pieces.clear();
        self.inside.clear();
        self.report = CutReport::default();
        self.outside.clear();
        for (i, ((hint, centre), &radius)) in hints.iter_mut().zip(positions).zip(radii).enumerate() {
            let start =
                locator.locate(mesh, centre, Some(*hint)).or_else(|| nearest(mesh, locator, centre, radius));
            let whole = std::f64::consts::PI * radius * radius;
            let mut at_boundary = true;
            scratch.parts.clear();
            if let Some(start) = start.filter(|_| radius > 0.0 && whole.is_finite()) {
                *hint = start;
                at_boundary = scratch.spread(mesh, locator.neighbours(), start, centre, radius);
            }
            let total: f64 = scratch.parts.iter().map(|part| part.area).sum();
            let mut spread = total;
            if total <= 0.0 {
                self.outside.push(i as u32);
                scratch.parts.clear();
            } else if kernel > 1.0 {
                scratch.spread(mesh, locator.neighbours(), *hint, centre, radius * kernel);
                spread = scratch.parts.iter().map(|part| part.area).sum();
            }
            for part in &scratch.parts {
                self.pieces.cell.push(part.cell);
                self.pieces.share.push(part.area / spread);
                self.pieces.coordinate.push(Vector::from_fn(|k, _| part.coordinate[k]));
            }
            // Here the ends of the grains, from the first on: `gather` puts the zero before them.
            self.pieces.first.push(self.pieces.cell.len() as u32);
            let missing = 1.0 - total / whole;
            // Away from the boundary what is missing is the round-off of the cut.
            self.inside.push(match at_boundary {
                true if total > 0.0 => (total / whole).min(1.0),
                true => 0.0,
                false => 1.0,
            });
            if at_boundary {
                self.report.cut_off = self.report.cut_off.max(missing);
            } else {
                self.report.defect = self.report.defect.max(missing.abs());
            }
        }
    }
}

impl Scratch {
    /// Leaves in `parts` the parts of a disc in the order of cells, and tells whether it reaches the boundary.
    fn spread<const D: usize>(
        &mut self,
        mesh: &Mesh<D>,
        neighbours: &Neighbours<D>,
        start: u32,
        centre: &Vector<D>,
        radius: f64,
    ) -> bool {
        self.visited.resize(mesh.cell_count(), 0);
        self.now = self.now.wrapping_add(1);
        if self.now == 0 {
            self.visited.fill(0);
            self.now = 1;
        }
        self.parts.clear();
        self.to_visit.clear();
        self.to_visit.push(start);
        self.visited[start as usize] = self.now;
        let least = LEAST_SHARE * std::f64::consts::PI * radius * radius;
        let mut at_boundary = false;
        while let Some(cell) = self.to_visit.pop() {
            let corners = corners(mesh, cell as usize, centre);
            let part = disc::cut(corners, radius);
            if part.area > least {
                let coordinate = barycentric(corners, part.moment.map(|m| m / part.area));
                self.parts.push(CellPart { cell, area: part.area, coordinate });
            }
            for (k, &next) in neighbours.of(cell as usize).iter().enumerate() {
                if part.reach >> k & 1 == 0 {
                    continue;
                }
                if next == Neighbours::<D>::NONE {
                    at_boundary = true;
                } else if self.visited[next as usize] != self.now {
                    self.visited[next as usize] = self.now;
                    self.to_visit.push(next);
                }
            }
        }
        self.parts.sort_unstable_by_key(|part| part.cell);
        at_boundary
    }
}

/// The corners of a triangle relative to a centre; where the mesh is periodic those of the image that is nearest to it.
fn corners<const D: usize>(mesh: &Mesh<D>, cell: usize, centre: &Vector<D>) -> [Point; 3] {
    let nodes = mesh.cell(cell);
    let corners = [0, 1, 2].map(|k| {
        let p = &mesh.points[nodes[k] as usize];
        [p[0] - centre[0], p[1] - centre[1]]
    });
    if mesh.periodic.is_none() {
        return corners;
    }
    let away = Vector::from_fn(|axis, _| (0..3).map(|k| corners[k][axis]).sum::<f64>() / 3.0);
    let shift = mesh.periodic.shift(&away);
    corners.map(|p| [p[0] - shift[0], p[1] - shift[1]])
}

/// Barycentric coordinates 1 and 2 of a point of a triangle. Centroids of parts that are hardly more than round-off may
/// fall outside by round-off: they are moved in.
fn barycentric(p: [Point; 3], q: Point) -> [f64; 2] {
    let (ax, ay) = (p[1][0] - p[0][0], p[1][1] - p[0][1]);
    let (bx, by) = (p[2][0] - p[0][0], p[2][1] - p[0][1]);
    let (qx, qy) = (q[0] - p[0][0], q[1] - p[0][1]);
    let whole = ax * by - ay * bx;
    let (u, v) = (((qx * by - qy * bx) / whole).max(0.0), ((ax * qy - ay * qx) / whole).max(0.0));
    let sum = (u + v).max(1.0);
    [u / sum, v / sum]
}

/// The cell nearest to a point outside of the mesh, among those nearer than `radius`.
fn nearest<const D: usize>(
    mesh: &Mesh<D>,
    locator: &Locator<D>,
    centre: &Vector<D>,
    radius: f64,
) -> Option<u32> {
    let reach = Vector::repeat(radius);
    let mut best = (radius * radius, UNKNOWN);
    locator.for_cells_near(&(centre - reach), &(centre + reach), |cell| {
        let p = corners(mesh, cell, centre);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            let u = [b[0] - a[0], b[1] - a[1]];
            let t = (-(a[0] * u[0] + a[1] * u[1]) / (u[0] * u[0] + u[1] * u[1])).clamp(0.0, 1.0);
            let q = [a[0] + t * u[0], a[1] + t * u[1]];
            let candidate = (q[0] * q[0] + q[1] * q[1], cell as u32);
            if candidate < best {
                best = candidate;
            }
        }
    });
    (best.1 != UNKNOWN).then_some(best.1)
}
