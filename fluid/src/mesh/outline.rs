//! The boundary of a domain divided into edges of the wanted size.

use super::domain::{Hole, Rectangle};
use crate::{Error, Result};
use spade::{HasPosition, Point2};

/// The hole number of a node on no hole.
pub(super) const FREE: u32 = u32::MAX;

/// A node of the triangulation.
#[derive(Clone, Debug)]
pub(super) struct Site {
    pub at: Point2<f64>,
    /// The hole on whose circle the node lies, or [`FREE`].
    pub hole: u32,
}

impl HasPosition for Site {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.at
    }
}

/// Nodes and boundary edges between them.
pub(super) struct Outline {
    pub sites: Vec<Site>,
    pub edges: Vec<[usize; 2]>,
}

/// The nearest point of a hole's circle.
pub(super) fn onto_circle(hole: &Hole, p: Point2<f64>) -> Point2<f64> {
    let (x, y) = (p.x - hole.centre[0], p.y - hole.centre[1]);
    let scale = hole.radius / x.hypot(y);
    Point2::new(hole.centre[0] + scale * x, hole.centre[1] + scale * y)
}

/// Divides the sides and the circles.
pub(super) fn divide(domain: &Rectangle) -> Result<Outline> {
    let mut outline = Outline { sites: Vec::new(), edges: Vec::new() };
    let (lower, upper) = (domain.lower, domain.upper);
    let corners = [lower, [upper[0], lower[1]], upper, [lower[0], upper[1]]];
    let ends = |i: usize| domain.named_sides()[i].1.0.iter().filter_map(|part| part.to).collect::<Vec<_>>();
    // Anticlockwise: bottom, right, top (backwards), left (backwards).
    let mut loops: Vec<[f64; 2]> = Vec::new();
    for (i, (side, along)) in [(2, 0), (1, 1), (3, 0), (0, 1)].into_iter().enumerate() {
        loops.push(corners[i]);
        let mut between = ends(side);
        between.retain(|&to| to > lower[along] && to < upper[along]);
        if i >= 2 {
            between.reverse();
        }
        loops.extend(between.into_iter().map(|to| {
            let mut p = corners[i];
            p[along] = to;
            p
        }));
    }
    for (i, &a) in loops.iter().enumerate() {
        let b = loops[(i + 1) % loops.len()];
        let at = |t: f64| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        for t in fractions(domain, length, 1, at)? {
            // Sides run along axes: the other coordinate stays exact, names of edges depend on it.
            let p = at(t);
            let exact = |k: usize| if a[k] == b[k] { a[k] } else { p[k] };
            outline.sites.push(Site { at: Point2::new(exact(0), exact(1)), hole: FREE });
        }
    }
    close(&mut outline, 0);
    for (i, hole) in domain.holes.iter().enumerate() {
        let first = outline.sites.len();
        let at = |t: f64| {
            let (sin, cos) = (std::f64::consts::TAU * t).sin_cos();
            [hole.centre[0] + hole.radius * cos, hole.centre[1] + hole.radius * sin]
        };
        for t in fractions(domain, std::f64::consts::TAU * hole.radius, 8, at)? {
            let p = at(t);
            outline.sites.push(Site { at: Point2::new(p[0], p[1]), hole: i as u32 });
        }
        close(&mut outline, first);
    }
    Ok(outline)
}

/// Joins the sites from `first` on to a closed line.
fn close(outline: &mut Outline, first: usize) {
    let last = outline.sites.len();
    outline.edges.extend((first..last).map(|i| [i, if i + 1 == last { first } else { i + 1 }]));
}

/// Where to divide a line, as fractions of its length from 0 on (without 1): n pieces with the same integral of
/// ds / size, n the rounded whole integral.
fn fractions(
    domain: &Rectangle,
    length: f64,
    fewest: usize,
    at: impl Fn(f64) -> [f64; 2],
) -> Result<Vec<f64>> {
    let finest = length / domain.smallest_size();
    if finest.is_nan() || finest >= 1e7 {
        return Err(Error::Mesh(format!("a boundary of length {length} m has no room for {finest:e} edges")));
    }
    let samples = (4.0 * finest).ceil().max(64.0) as usize;
    let mut sum = vec![0.0];
    for i in 0..samples {
        let density = length / samples as f64 / domain.size_at(at((i as f64 + 0.5) / samples as f64));
        sum.push(sum[i] + density);
    }
    let whole = sum[samples];
    let pieces = (whole.round() as usize).max(fewest);
    let mut out = Vec::with_capacity(pieces);
    let mut i = 0;
    for k in 0..pieces {
        let wanted = whole * k as f64 / pieces as f64;
        while i + 1 < samples && sum[i + 1] <= wanted {
            i += 1;
        }
        let within = ((wanted - sum[i]) / (sum[i + 1] - sum[i])).clamp(0.0, 1.0);
        out.push((i as f64 + within) / samples as f64);
    }
    Ok(out)
}
