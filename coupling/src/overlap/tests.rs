//! Tests of the cut: against closed forms, against quadrature, and by what must be conserved.

use super::*;
use approx::{assert_abs_diff_eq, assert_relative_eq};
use proptest::prelude::*;
use std::f64::consts::PI;
use voidage_fluid::mesh::{Hole, Periodic, Rectangle, Sides};

fn square(size: f64) -> Mesh<2> {
    Mesh::rectangle(&Rectangle {
        lower: [0.0, 0.0],
        upper: [1.0, 1.0],
        size: Some(size),
        sides: Sides::all("walls"),
        holes: Vec::new(),
        refine: Vec::new(),
        structured: None,
    })
    .unwrap()
}

/// A grain that is spread has the pieces of the wider disc; near a wall all of it stays in the mesh, and where a boundary
/// cuts the grain itself, its own share does. Outside it has none.
#[test]
fn a_spread_grain_has_the_pieces_of_a_wider_disc() {
    let mesh = square(0.1);
    let places = [[0.5, 0.5], [0.07, 0.5], [0.0, 0.5], [-0.1, 0.5]].map(Vector::<2>::from);
    let cut = |kernel: f64, radius: f64| {
        let mut cutter = Overlap::new(&mesh).unwrap();
        cutter.kernel = kernel;
        let (mut pieces, mut inside) = (Pieces::default(), vec![]);
        cutter.cut(&mesh, &places, &[radius; 4], &mut pieces, &mut inside).unwrap();
        (pieces, inside, cutter.outside().to_vec())
    };
    let ((spread, inside, outside), (wide, ..)) = (cut(3.0, 0.0625), cut(1.0, 0.1875));
    for grain in 0..3 {
        assert_eq!(spread.cell[spread.of(grain)], wide.cell[wide.of(grain)]);
        assert_relative_eq!(spread.share[spread.of(grain)].iter().sum::<f64>(), 1.0, epsilon = 1e-14);
        for (a, b) in spread.of(grain).zip(wide.of(grain)) {
            assert_eq!(spread.share[a], wide.share[b]);
        }
    }
    assert_eq!(inside[..2], [1.0, 1.0]);
    assert_relative_eq!(inside[2], 0.5, epsilon = 1e-12);
    assert!(inside[3] == 0.0 && outside == [3] && spread.of(3).is_empty());
    let itself = cut(1.0, 0.0625);
    assert_eq!(cut(0.0, 0.0625).0.share, itself.0.share);
}

/// Area and moment of the part of the unit disc in a triangle by integration over x: between the kinks (corners,
/// crossings, ends of the disc) the integrand is smooth but for square roots at the ends of the disc, which the
/// substitution x = m - w cos(t) removes.
fn quadrature(p: [Point; 3]) -> (f64, Point) {
    let mut kinks = vec![-1.0, 1.0, p[0][0], p[1][0], p[2][0]];
    for k in 0..3 {
        let (a, b) = (p[k], p[(k + 1) % 3]);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        // |a + t (b - a)| = 1
        let (l2, h) = (dx * dx + dy * dy, a[0] * dx + a[1] * dy);
        let root = h * h - l2 * (a[0] * a[0] + a[1] * a[1] - 1.0);
        if root >= 0.0 {
            for sign in [-1.0, 1.0] {
                let t = (-h + sign * root.sqrt()) / l2;
                if (0.0..=1.0).contains(&t) {
                    kinks.push(a[0] + t * dx);
                }
            }
        }
    }
    kinks.retain(|x| x.abs() <= 1.0);
    kinks.sort_by(f64::total_cmp);
    let column = |x: f64| {
        let half = (1.0 - x * x).max(0.0).sqrt();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            if (a[0] - x) * (b[0] - x) <= 0.0 && a[0] != b[0] {
                let y = a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1]);
                (low, high) = (low.min(y), high.max(y));
            }
        }
        let (low, high) = (low.max(-half), high.min(half));
        if high > low { (high - low, 0.5 * (high + low) * (high - low)) } else { (0.0, 0.0) }
    };
    let (mut area, mut moment) = (0.0, [0.0; 2]);
    let n = 4000;
    for pair in kinks.windows(2) {
        let (m, w) = (0.5 * (pair[0] + pair[1]), 0.5 * (pair[1] - pair[0]));
        // Midpoint rule in t: error of order n^-2 with a factor 1e-8 here.
        for i in 0..n {
            let t = PI * (i as f64 + 0.5) / n as f64;
            let x = m - w * t.cos();
            let dx = w * t.sin() * PI / n as f64;
            let (length, mean) = column(x);
            area += length * dx;
            moment[0] += x * length * dx;
            moment[1] += mean * dx;
        }
    }
    (area, moment)
}

fn check_part(p: [Point; 3], area: f64, moment: Point, tolerance: f64) {
    // Any corner may be the first.
    for turn in 0..3 {
        let part = disc::cut([0, 1, 2].map(|k| p[(k + turn) % 3]), 1.0);
        assert_abs_diff_eq!(part.area, area, epsilon = tolerance);
        assert_abs_diff_eq!(part.moment[0], moment[0], epsilon = tolerance);
        assert_abs_diff_eq!(part.moment[1], moment[1], epsilon = tolerance);
    }
}

#[test]
fn closed_forms() {
    let far = 1e3;
    // Half disc: centroid at 4/(3 pi); so the moment is 2/3.
    check_part([[-far, 0.0], [far, 0.0], [0.0, far]], PI / 2.0, [0.0, 2.0 / 3.0], 1e-14);
    // Quarter disc with the corner at the centre: moment 1/3 in both directions.
    check_part([[0.0, 0.0], [far, 0.0], [0.0, far]], PI / 4.0, [1.0 / 3.0; 2], 1e-14);
    // Segments beyond y = h, and what they leave: area acos(h) - h sqrt(1 - h^2), moment 2/3 (1 - h^2)^(3/2).
    for h in [-0.999999, -0.9, -0.3, 0.0, 0.3, 0.9, 0.999999] {
        let h: f64 = h;
        let area = h.acos() - h * (1.0 - h * h).sqrt();
        check_part(
            [[-far, h], [far, h], [0.0, far]],
            area,
            [0.0, 2.0 / 3.0 * (1.0 - h * h).powf(1.5)],
            1e-12,
        );
    }
    // A small segment keeps its relative accuracy: with s^2 = 1 - h^2 its area is 2/3 s^3 (1 + 3/10 s^2 + O(s^4)).
    for h in [0.9999f64, 0.999999, 0.99999999] {
        let s2 = (1.0 - h) * (1.0 + h);
        let area = 2.0 / 3.0 * s2 * s2.sqrt() * (1.0 + 0.3 * s2);
        let part = disc::cut([[-far, h], [far, h], [0.0, far]], 1.0);
        assert_relative_eq!(part.area, area, max_relative = s2 * s2 + 1e-9);
    }
    // Wholly inside, wholly outside, wholly around.
    check_part([[-9.0, -9.0], [9.0, -9.0], [0.0, 9.0]], PI, [0.0; 2], 1e-15);
    check_part([[2.0, 0.0], [9.0, 0.0], [5.0, 9.0]], 0.0, [0.0; 2], 0.0);
    check_part([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]], 0.125, [0.125 / 6.0; 2], 1e-16);
    // Inscribed: the circle through all three corners.
    let corner = |k: usize| {
        let angle = 2.0 * PI * k as f64 / 3.0 + 0.1;
        [angle.cos(), angle.sin()]
    };
    check_part([corner(0), corner(1), corner(2)], 0.75 * 3f64.sqrt(), [0.0; 2], 1e-14);
    // Tangent to all three edges from inside.
    let around = |k: usize| corner(k).map(|x| 2.0 * x);
    check_part([around(0), around(1), around(2)], PI, [0.0; 2], 1e-13);
    // Tangent from outside, along an edge and at a corner.
    check_part([[-1.0, 1.0], [1.0, 1.0], [0.0, 3.0]], 0.0, [0.0; 2], 1e-14);
    check_part([[1.0, 0.0], [3.0, -1.0], [3.0, 1.0]], 0.0, [0.0; 2], 1e-14);
    // A corner on the circle, the triangle cuts a cap of 120 degrees from two chords: known from the inscribed one.
    let cap = (PI - 0.75 * 3f64.sqrt()) / 3.0;
    let part = disc::cut([corner(0), corner(1), [corner(2)[0] * 50.0, corner(2)[1] * 50.0]], 1.0);
    assert!(part.area > 0.75 * 3f64.sqrt() && part.area < PI - cap + 1e-14);
}

#[test]
fn round_off_at_corners_and_tangents() {
    // Move the disc by a few units in the last place around every special position: nothing may jump.
    let triangles = [
        [[1.0, 0.0], [3.0, -1.0], [3.0, 1.0]],
        [[0.0, 1.0], [-2.0, -1.0], [2.0, -1.0]],
        [[-2.0, -1.0], [2.0, -1.0], [0.0, 5.0]],
        [[0.6, 0.8], [0.6, -0.8], [4.0, 0.0]],
        [[0.6, 0.8], [-0.6, 0.8], [0.0, 0.0]],
        [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]],
    ];
    for p in triangles {
        let p = if disc::cut(p, 1e-9).area >= 0.0 && turn_of(p) < 0.0 { [p[0], p[2], p[1]] } else { p };
        let base = disc::cut(p, 1.0);
        for i in -3..=3 {
            for j in -3..=3 {
                for scale in [1e-16, 1e-13, 1e-10] {
                    let shift = [i as f64 * scale, j as f64 * scale];
                    let part = disc::cut(p.map(|q| [q[0] + shift[0], q[1] + shift[1]]), 1.0);
                    assert_abs_diff_eq!(part.area, base.area, epsilon = 1e-8);
                    assert_abs_diff_eq!(part.moment[0], base.moment[0], epsilon = 1e-8);
                    assert_abs_diff_eq!(part.moment[1], base.moment[1], epsilon = 1e-8);
                }
            }
        }
    }
}

fn turn_of(p: [Point; 3]) -> f64 {
    (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0])
}

/// Centre of a grain from its pieces.
fn centre(mesh: &Mesh<2>, pieces: &Pieces<2>, body: usize) -> Vector<2> {
    pieces.of(body).map(|q| pieces.share[q] * place(mesh, pieces, q)).sum()
}

/// Centroid of a piece.
fn place(mesh: &Mesh<2>, pieces: &Pieces<2>, q: usize) -> Vector<2> {
    let nodes = mesh.cell(pieces.cell[q] as usize);
    let [a, b, c] = [0, 1, 2].map(|k| mesh.points[nodes[k] as usize]);
    a + pieces.coordinate[q][0] * (b - a) + pieces.coordinate[q][1] * (c - a)
}

fn cut(mesh: &Mesh<2>, grains: &[(f64, f64, f64)]) -> (Pieces<2>, CutReport) {
    let positions: Vec<_> = grains.iter().map(|g| Vector::<2>::new(g.0, g.1)).collect();
    let radii: Vec<_> = grains.iter().map(|g| g.2).collect();
    let mut pieces = Pieces::default();
    let report = Overlap::new(mesh).unwrap().cut(mesh, &positions, &radii, &mut pieces, &mut vec![]).unwrap();
    (pieces, report)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Random triangles against integration.
    #[test]
    fn parts_agree_with_quadrature(x in prop::array::uniform6(-1.8..1.8f64)) {
        let p = [[x[0], x[1]], [x[2], x[3]], [x[4], x[5]]];
        let p = if turn_of(p) < 0.0 { [p[0], p[2], p[1]] } else { p };
        prop_assume!(turn_of(p) > 1e-3);
        let (area, moment) = quadrature(p);
        check_part(p, area, moment, 3e-6);
    }

    /// Cut a triangle in three at a point: the parts add up, for any position.
    #[test]
    fn parts_add_up(x in prop::array::uniform6(-2.0..2.0f64), w in prop::array::uniform3(0.01..1.0f64)) {
        let p = [[x[0], x[1]], [x[2], x[3]], [x[4], x[5]]];
        let p = if turn_of(p) < 0.0 { [p[0], p[2], p[1]] } else { p };
        prop_assume!(turn_of(p) > 1e-6);
        let sum = w[0] + w[1] + w[2];
        let q = [0, 1].map(|k| (w[0] * p[0][k] + w[1] * p[1][k] + w[2] * p[2][k]) / sum);
        let whole = disc::cut(p, 1.0);
        let parts = [0, 1, 2].map(|k| disc::cut([p[k], p[(k + 1) % 3], q], 1.0));
        let area: f64 = parts.iter().map(|part| part.area).sum();
        prop_assert!((area - whole.area).abs() < 1e-13, "{} {}", area, whole.area);
        for k in 0..2 {
            let moment: f64 = parts.iter().map(|part| part.moment[k]).sum();
            prop_assert!((moment - whole.moment[k]).abs() < 1e-13);
        }
    }

    /// Discs from 1/100 of the cells to many of them: nothing is lost, the centre is met.
    #[test]
    fn discs_are_whole(x in 0.0..1.0f64, y in 0.0..1.0f64, log_r in -3.0..-0.35f64) {
        let mesh = square(0.1);
        let r = 10f64.powf(log_r);
        let (x, y) = (r + x * (1.0 - 2.0 * r), r + y * (1.0 - 2.0 * r));
        let (pieces, report) = cut(&mesh, &[(x, y, r)]);
        prop_assert!(report.defect < 1e-13 && report.cut_off < 1e-9, "{report:?}");
        let sum: f64 = pieces.share.iter().sum();
        prop_assert!((sum - 1.0).abs() < 1e-14);
        prop_assert!((centre(&mesh, &pieces, 0) - Vector::<2>::new(x, y)).norm() < 1e-13);
        for (share, c) in pieces.share.iter().zip(&pieces.coordinate) {
            prop_assert!(*share > 0.0 && c.min() >= 0.0 && c.sum() <= 1.0 + 1e-15);
        }
    }
}

/// A bed of discs that overlap neither each other nor matter: a jittered grid.
fn bed(n: usize, r: f64) -> Vec<(f64, f64, f64)> {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let pitch = (1.0 - 2.0 * r) / n as f64;
    let at = |i: usize, jitter: f64| r + (i as f64 + jitter) * pitch;
    (0..n * n).map(|k| (at(k % n, random()), at(k / n, random()), r * (0.8 + 0.2 * random()))).collect()
}

#[test]
fn special_positions() {
    let mesh = square(0.1);
    // Centres on nodes and edges, circles through nodes.
    let mut grains = Vec::new();
    for cell in 0..mesh.cell_count() {
        let [a, b, c] = [0, 1, 2].map(|k| mesh.points[mesh.cell(cell)[k] as usize]);
        let middle = 0.5 * (a + b);
        let inside = |p: Vector<2>, r: f64| p.min() > r && p.max() < 1.0 - r;
        for (p, r) in
            [(a, 0.05), (middle, 0.05), (middle, (a - b).norm() / 2.0), (a, (a - b).norm()), (c, 0.2)]
        {
            if inside(p, r) {
                grains.push((p[0], p[1], r));
            }
        }
    }
    let (pieces, report) = cut(&mesh, &grains);
    assert!(report.defect < 1e-13 && report.cut_off == 0.0, "{report:?}");
    for (i, grain) in grains.iter().enumerate() {
        let found = centre(&mesh, &pieces, i);
        assert!((found - Vector::<2>::new(grain.0, grain.1)).norm() < 1e-13);
        assert_abs_diff_eq!(pieces.share[pieces.of(i)].iter().sum::<f64>(), 1.0, epsilon = 1e-14);
    }
}

#[test]
fn hundred_times_the_mesh() {
    let mesh = square(0.004);
    let (pieces, report) = cut(&mesh, &[(0.5, 0.5, 0.45)]);
    assert!(pieces.len() > 50_000);
    assert!(report.defect < 1e-13, "{report:?}");
    assert!((centre(&mesh, &pieces, 0) - Vector::<2>::new(0.5, 0.5)).norm() < 1e-13);
}

#[test]
fn any_number_of_threads_any_hint() {
    let mesh = square(0.03);
    let grains = bed(40, 0.02);
    let positions: Vec<_> = grains.iter().map(|g| Vector::<2>::new(g.0, g.1)).collect();
    let radii: Vec<_> = grains.iter().map(|g| g.2).collect();
    let (fresh, _) = cut(&mesh, &grains);
    for threads in [1, 2, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut overlap = Overlap::new(&mesh).unwrap();
        let mut pieces = Pieces::default();
        pool.install(|| {
            // Hints from other positions: the grains in opposite order.
            let reversed: Vec<_> = positions.iter().rev().copied().collect();
            overlap.cut(&mesh, &reversed, &radii, &mut pieces, &mut vec![]).unwrap();
            overlap.cut(&mesh, &positions, &radii, &mut pieces, &mut vec![]).unwrap();
        });
        assert_eq!(pieces, fresh);
    }
}

#[test]
fn walls_holes_and_outside() {
    let mesh = square(0.1);
    // Half and a quarter outside, a sliver outside, hardly inside: centre beyond the wall.
    let (pieces, report) =
        cut(&mesh, &[(0.0, 0.5, 0.1), (1.0, 1.0, 0.1), (0.5, 0.0499, 0.05), (0.5, -0.09, 0.1)]);
    assert!(report.cut_off > 0.9);
    for i in 0..4 {
        assert_abs_diff_eq!(pieces.share[pieces.of(i)].iter().sum::<f64>(), 1.0, epsilon = 1e-14);
    }
    assert_abs_diff_eq!(centre(&mesh, &pieces, 0)[0], 0.1 * 4.0 / (3.0 * PI), epsilon = 1e-14);

    let outside = |grain: (f64, f64, f64)| {
        let positions = vec![Vector::<2>::new(0.5, 0.5), Vector::<2>::new(grain.0, grain.1)];
        let mut overlap = Overlap::new(&mesh).unwrap();
        let (mut pieces, mut inside) = (Pieces::default(), vec![]);
        overlap.cut(&mesh, &positions, &[0.1, grain.2], &mut pieces, &mut inside).unwrap();
        assert!(pieces.of(1).is_empty() && inside[1] == 0.0, "{grain:?}");
        assert_eq!(overlap.outside(), [1], "{grain:?}");
    };
    outside((1.2, 0.5, 0.1));
    outside((f64::NAN, 0.5, 0.1));
    outside((0.5, 0.5, f64::NAN));
    outside((0.5, 0.5, -1.0));
    assert!(
        Overlap::<3>::new(&Mesh {
            points: vec![],
            cells: vec![],
            boundaries: vec![],
            periodic: Periodic::default()
        })
        .is_err()
    );

    let hole = Hole { name: "hole".into(), centre: [0.5, 0.5], radius: 0.2, size: 0.03, growth: 0.3 };
    let domain = Rectangle {
        lower: [0.0, 0.0],
        upper: [1.0, 1.0],
        size: Some(0.1),
        sides: Sides::all("walls"),
        holes: vec![hole],
        refine: Vec::new(),
        structured: None,
    };
    let mesh = Mesh::rectangle(&domain).unwrap();
    // The centre is in the hole.
    let (pieces, report) = cut(&mesh, &[(0.31, 0.5, 0.03)]);
    assert!(report.cut_off > 0.5 && report.cut_off < 1.0);
    assert_abs_diff_eq!(pieces.share.iter().sum::<f64>(), 1.0, epsilon = 1e-14);
    // A grain around the hole loses 4/9.
    let (pieces, report) = cut(&mesh, &[(0.5, 0.5, 0.3)]);
    assert_relative_eq!(report.cut_off, 1.0 / 9.0 * 4.0, max_relative = 0.01);
    assert_abs_diff_eq!(centre(&mesh, &pieces, 0)[0], 0.5, epsilon = 1e-3);
}

#[test]
fn a_moving_mesh() {
    let mut mesh = square(0.05);
    let mut overlap = Overlap::new(&mesh).unwrap();
    let mut pieces = Pieces::default();
    for p in &mut mesh.points {
        *p = 2.0 * *p + Vector::<2>::new(3.0, 4.0);
    }
    overlap.moved(&mesh);
    let report = overlap.cut(&mesh, &[Vector::<2>::new(4.5, 5.5)], &[0.1], &mut pieces, &mut vec![]).unwrap();
    assert!(report.defect < 1e-13);
    assert!((centre(&mesh, &pieces, 0) - Vector::<2>::new(4.5, 5.5)).norm() < 1e-13);
}

#[test]
fn voidage_holds_the_grains() {
    let mesh = square(0.03);
    let grains = bed(30, 0.012);
    let (pieces, _) = cut(&mesh, &grains);
    let volume: Vec<_> = grains.iter().map(|g| 0.8 * PI * g.2 * g.2).collect();
    let nodal = mesh.nodal_volume();
    let mut eps = Vec::new();
    voidage(&mesh, &pieces, &volume, &nodal, &mut eps);
    assert!(eps.iter().all(|&eps| eps > 0.0 && eps <= 1.0));
    let solid: f64 = eps.iter().zip(&nodal).map(|(eps, nodal)| (1.0 - eps) * nodal).sum();
    assert_relative_eq!(solid, volume.iter().sum::<f64>(), max_relative = 1e-12);

    // Linear fields are met exactly: sum of V_q f(x_q) is f at the centre times the volume.
    for (i, grain) in grains.iter().enumerate() {
        let f = |p: Vector<2>| 1.0 + 2.0 * p[0] - 3.0 * p[1];
        let mean: f64 = pieces.of(i).map(|q| pieces.share[q] * f(place(&mesh, &pieces, q))).sum();
        assert_abs_diff_eq!(mean, f(Vector::<2>::new(grain.0, grain.1)), epsilon = 1e-13);
    }

    // Full of grain: clipped.
    voidage(&mesh, &pieces, &volume.iter().map(|v| 1e3 * v).collect::<Vec<_>>(), &nodal, &mut eps);
    assert!(eps.contains(&LEAST_VOIDAGE));
    assert!(eps.iter().all(|&eps| eps >= LEAST_VOIDAGE));
}
