//! Bubbles: where the fluid of a bed has few grains.

use voidage_dem::{Period, Vector};
use voidage_scene::recorder::Frame;

/// A connected region of high voidage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bubble {
    /// m2.
    pub area: f64,
    /// Centre of the area, m.
    pub centre: [f64; 2],
}

impl Bubble {
    /// Diameter of the disc of the same area, m.
    pub fn diameter(&self) -> f64 {
        (4.0 * self.area / std::f64::consts::PI).sqrt()
    }
}

/// What counts as a bubble.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// The voidage is above this.
    pub voidage: f64,
    /// Height of the surface of the bed, m.
    pub surface: f64,
    /// Smallest equivalent diameter, m.
    pub smallest: f64,
}

/// The bubbles of a frame whose nodes have a voidage, which is linear in its triangles. A region that reaches the
/// boundary of the mesh above the surface of the bed is the freeboard, and one whose centre is above the surface is
/// between grains that fly.
pub fn find(frame: &Frame, voidage: &[f64], rule: &Rule, period: &Period<2>) -> Vec<Bubble> {
    let cells = frame.cells.as_chunks::<3>().0;
    let at = |node: usize| Vector::<2>::new(frame.points[node][0], frame.points[node][1]);
    let inside = |node: usize| voidage[node] > rule.voidage;
    let mut parts = Parts((0..frame.points.len()).collect());
    let mut sides: Vec<[u32; 2]> =
        cells.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
    for [a, b] in sides.iter().map(|side| side.map(|node| node as usize)) {
        if inside(a) && inside(b) {
            parts.join(a, b);
        }
    }
    for [a, b] in twins(frame, period) {
        if inside(a) && inside(b) {
            parts.join(a, b);
        }
    }
    sides.sort_unstable();
    let mut free = vec![false; frame.points.len()];
    for side in sides.iter().filter(|[a, b]| sides.binary_search(&[*b, *a]).is_err()) {
        let nodes = side.map(|node| node as usize);
        if joined(nodes.map(at), period) {
            continue;
        }
        for node in nodes.into_iter().filter(|node| inside(*node) && at(*node)[1] > rule.surface) {
            let root = parts.root(node);
            free[root] = true;
        }
    }
    let mut sums = vec![(0.0, Vector::<2>::zeros()); frame.points.len()];
    for cell in cells.iter().map(|cell| cell.map(|node| node as usize)) {
        let Some(node) = cell.into_iter().find(|node| inside(*node)) else { continue };
        let root = parts.root(node);
        let corners = cell.map(|node| (at(node), voidage[node] - rule.voidage));
        let (area, centre) = above(corners);
        sums[root].0 += area;
        // Beside the node that stands for the region: it may lie across a periodic side.
        sums[root].1 += area * period.nearest(centre - at(root));
    }
    let regions = sums.iter().enumerate().filter(|(root, (area, _))| *area > 0.0 && !free[*root]);
    let bubbles = regions.map(|(root, (area, moment))| {
        let centre = period.wrap(at(root) + moment / *area);
        Bubble { area: *area, centre: centre.into() }
    });
    bubbles.filter(|bubble| bubble.diameter() >= rule.smallest && bubble.centre[1] <= rule.surface).collect()
}

/// Area and centre of the part of a triangle in which a linear function with these values at its corners is positive.
fn above(corners: [(Vector<2>, f64); 3]) -> (f64, Vector<2>) {
    let mut outline = Vec::with_capacity(4);
    for k in 0..3 {
        let ((from, at_from), (to, at_to)) = (corners[k], corners[(k + 1) % 3]);
        if at_from > 0.0 {
            outline.push(from);
        }
        if (at_from > 0.0) != (at_to > 0.0) {
            outline.push(from + (to - from) * (at_from / (at_from - at_to)));
        }
    }
    let (mut area, mut moment) = (0.0, Vector::<2>::zeros());
    for pair in outline.get(1..).unwrap_or(&[]).windows(2) {
        let [u, v] = [pair[0] - outline[0], pair[1] - outline[0]];
        let part = 0.5 * (u[0] * v[1] - u[1] * v[0]).abs();
        area += part;
        moment += part * (outline[0] + pair[0] + pair[1]) / 3.0;
    }
    (area, if area > 0.0 { moment / area } else { corners[0].0 })
}

/// The axis along which a side of a triangle lies on a periodic side of the domain.
fn joined(ends: [Vector<2>; 2], period: &Period<2>) -> bool {
    period.sides().iter().enumerate().any(|(axis, sides)| {
        sides.is_some_and(|[low, high]| {
            [low, high].iter().any(|place| ends.iter().all(|end| near(end[axis], *place, high - low)))
        })
    })
}

fn near(a: f64, b: f64, length: f64) -> bool {
    (a - b).abs() <= 1e-9 * length
}

/// Nodes at the same place of opposite periodic sides.
fn twins(frame: &Frame, period: &Period<2>) -> Vec<[usize; 2]> {
    let mut found = Vec::new();
    for (axis, sides) in period.sides().iter().enumerate() {
        let Some([low, high]) = *sides else { continue };
        let on = |place: f64| {
            let all = (0..frame.points.len()).filter(|k| near(frame.points[*k][axis], place, high - low));
            let mut nodes: Vec<usize> = all.collect();
            nodes.sort_by(|a, b| frame.points[*a][1 - axis].total_cmp(&frame.points[*b][1 - axis]));
            nodes
        };
        let pairs = on(low).into_iter().zip(on(high));
        found.extend(pairs.map(|(a, b)| [a, b]));
    }
    found
}

/// Nodes in disjoint parts, each with a node that stands for it.
struct Parts(Vec<usize>);

impl Parts {
    fn root(&mut self, mut node: usize) -> usize {
        while self.0[node] != node {
            self.0[node] = self.0[self.0[node]];
            node = self.0[node];
        }
        node
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A box of right triangles.
    pub fn mesh(lower: [f64; 2], upper: [f64; 2], count: [usize; 2]) -> Frame {
        let mut frame = Frame::default();
        let at =
            |axis: usize, k: usize| lower[axis] + (upper[axis] - lower[axis]) * k as f64 / count[axis] as f64;
        for j in 0..=count[1] {
            for i in 0..=count[0] {
                frame.points.push([at(0, i), at(1, j), 0.0]);
            }
        }
        let node = |i: usize, j: usize| (j * (count[0] + 1) + i) as u32;
        for j in 0..count[1] {
            for i in 0..count[0] {
                frame.cells.extend([node(i, j), node(i + 1, j), node(i + 1, j + 1)]);
                frame.cells.extend([node(i, j), node(i + 1, j + 1), node(i, j + 1)]);
            }
        }
        frame
    }

    fn voidages(frame: &Frame, of: impl Fn([f64; 2]) -> f64) -> Vec<f64> {
        frame.points.iter().map(|[x, y, _]| of([*x, *y])).collect()
    }

    const RULE: Rule = Rule { voidage: 0.7, surface: 2.0, smallest: 0.1 };

    #[test]
    fn a_disc_is_found_with_its_area_and_the_freeboard_is_none() {
        let frame = mesh([0.0, 0.0], [1.0, 3.0], [100, 300]);
        // Voidage 0.7 at a distance of 0.2; the freeboard; a pocket of 0.03 that is too small; one above the surface.
        let disc = |[x, y]: [f64; 2], centre: [f64; 2], radius: f64| {
            0.7 + 0.5 * (radius - (x - centre[0]).hypot(y - centre[1]))
        };
        let voidage = voidages(&frame, |point| {
            let all = [
                disc(point, [0.4, 1.0], 0.2),
                disc(point, [0.8, 0.5], 0.03),
                disc(point, [0.5, 2.2], 0.15),
                0.4,
                if point[1] > 2.45 { 1.0 } else { 0.0 },
            ];
            all.into_iter().fold(0.0, f64::max)
        });
        let found = find(&frame, &voidage, &RULE, &Period::default());
        assert_eq!(found.len(), 1, "{found:?}");
        let exact = std::f64::consts::PI * 0.04;
        assert!((found[0].area / exact - 1.0).abs() < 0.01, "{found:?}");
        assert!((found[0].diameter() / 0.4 - 1.0).abs() < 0.005, "{found:?}");
        assert!(
            (found[0].centre[0] - 0.4).abs() < 1e-3 && (found[0].centre[1] - 1.0).abs() < 1e-3,
            "{found:?}"
        );
        // With another bound the pocket is one.
        let small = find(&frame, &voidage, &Rule { smallest: 0.0, ..RULE }, &Period::default());
        assert_eq!(small.len(), 2, "{small:?}");
        // A bubble that breaks through the surface is part of the freeboard.
        let open =
            voidages(&frame, |[x, y]| if y > 2.1 || (x - 0.5).abs() < 0.2 && y > 1.0 { 0.9 } else { 0.4 });
        assert!(find(&frame, &open, &RULE, &Period::default()).is_empty());
        // One at a side wall below the surface is a bubble.
        let wall = voidages(&frame, |point| disc(point, [0.0, 1.0], 0.2).max(0.4));
        let found = find(&frame, &wall, &RULE, &Period::default());
        assert!(found.len() == 1 && (found[0].area / exact - 0.5).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn a_bubble_across_a_periodic_side_is_one() {
        let frame = mesh([0.0, 0.0], [1.0, 3.0], [100, 300]);
        let period = Period::new([Some([0.0, 1.0]), None]).unwrap();
        let voidage = voidages(&frame, |[x, y]| {
            let across = (x - 0.05).abs().min(1.0 - (x - 0.05).abs());
            (0.7 + 0.5 * (0.2 - across.hypot(y - 1.0))).max(0.4)
        });
        let found = find(&frame, &voidage, &RULE, &period);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].area / (std::f64::consts::PI * 0.04) - 1.0).abs() < 0.01, "{found:?}");
        assert!((found[0].centre[0] - 0.05).abs() < 1e-3, "{found:?}");
        assert_eq!(find(&frame, &voidage, &RULE, &Period::default()).len(), 2);
    }
}
