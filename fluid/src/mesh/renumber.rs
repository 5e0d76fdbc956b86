//! Numbering along a curve that fills the plane, so that neighbours in space are neighbours in memory.

use crate::Vector;

/// Place along the Hilbert curve of order 16 over a square, of a point with coordinates from 0 to 1.
fn hilbert(x: f64, y: f64) -> u32 {
    let grid = |x: f64| (x * 65536.0).clamp(0.0, 65535.0) as u32;
    let (mut x, mut y) = (grid(x), grid(y));
    let mut place = 0;
    for bit in (0..16).rev() {
        let (right, upper) = (x >> bit & 1, y >> bit & 1);
        // The curve visits the quarters lower left, upper left, upper right, lower right.
        place = place << 2 | ((3 * right) ^ upper);
        if upper == 0 {
            // In the two lower quarters it is turned: reflect at the diagonal, on the right at the other one.
            if right == 1 {
                (x, y) = (!x, !y);
            }
            (x, y) = (y, x);
        }
    }
    place
}

/// Numbers points and cells along the curve. Unused points are dropped.
pub(super) fn along_curve(points: Vec<Vector<2>>, cells: Vec<u32>) -> (Vec<Vector<2>>, Vec<u32>) {
    let infinite = Vector::<2>::repeat(f64::INFINITY);
    let (lower, upper) = points.iter().fold((infinite, -infinite), |(l, u), p| (l.inf(p), u.sup(p)));
    let width = (upper - lower).max();
    let place = |p: Vector<2>| hilbert((p[0] - lower[0]) / width, (p[1] - lower[1]) / width);

    let mut used = vec![false; points.len()];
    cells.iter().for_each(|&node| used[node as usize] = true);
    let mut nodes: Vec<u32> = (0..points.len() as u32).filter(|&n| used[n as usize]).collect();
    nodes.sort_by_key(|&n| (place(points[n as usize]), n));
    let mut number = vec![0u32; points.len()];
    for (new, &old) in nodes.iter().enumerate() {
        number[old as usize] = new as u32;
    }
    let mut triangles: Vec<[u32; 3]> =
        cells.chunks_exact(3).map(|c| [c[0], c[1], c[2]].map(|n| number[n as usize])).collect();
    let sorted: Vec<Vector<2>> = nodes.iter().map(|&n| points[n as usize]).collect();
    let centroid = |c: &[u32; 3]| c.iter().map(|&n| sorted[n as usize]).sum::<Vector<2>>() / 3.0;
    triangles.sort_by_cached_key(|c| (place(centroid(c)), *c));
    (sorted, triangles.into_flattened())
}
