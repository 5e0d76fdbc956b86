//! The part of a disc inside a triangle, exactly.
//!
//! The part is bounded by pieces of the edges (inside the circle) and by arcs (inside the triangle). Going round the
//! triangle anticlockwise, each edge has at most one piece inside the circle, from E (entry) to X (exit); where an exit
//! is not a corner of the triangle, an arc leads anticlockwise from it to the next entry. So the part is the polygon
//! of all E and X, plus one circular segment per arc. By Green's theorem, for points relative to the centre:
//!
//! - a triangle (0, a, b) has area a x b / 2 and first moment (a + b)/3 times that: the polygon is a fan of them;
//! - a segment of angle t has area r^2/2 (t - sin t);
//! - the first moment of a segment about the centre of its circle is int x dA = 2/3 r^3 sin^3(t/2) n with n the unit
//!   normal of the chord d = E - X on the side of the arc. With |d| = 2 r sin(t/2) this is |d|^2/12 (d_y, -d_x),
//!   whatever the angle: no trigonometry.

/// A point or vector relative to the centre of the disc.
pub(super) type Point = [f64; 2];

/// The part of a disc in a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Part {
    /// Area, m2.
    pub area: f64,
    /// First moment about the centre of the disc, m3.
    pub moment: Point,
    /// Bit k is set if the disc reaches across the edge opposite to corner k (or touches it).
    pub reach: u8,
}

/// The disc counts as reaching an edge up to this relative distance beyond its radius (squared): neighbours that share
/// more than round-off with the disc are then found from either side.
const TOUCH: f64 = 1.0 + 1e-9;

/// A piece of an edge inside the circle.
#[derive(Clone, Copy, Default)]
struct Chunk {
    entry: Point,
    exit: Point,
    /// The exit is a corner of the triangle inside the circle: the next piece continues there.
    joined: bool,
    /// The edge goes anticlockwise around the centre (the centre lies on its inner side).
    centre_inside: bool,
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

/// The part of the disc of radius `r` around the origin inside an anticlockwise triangle.
pub(super) fn cut(p: [Point; 3], r: f64) -> Part {
    let r2 = r * r;
    let square = p.map(|p| dot(p, p));
    let inside = square.map(|s| s <= r2);
    if inside == [true; 3] {
        let area = 0.5 * cross(minus(p[1], p[0]), minus(p[2], p[0]));
        let third = |k: usize| area * (p[0][k] + p[1][k] + p[2][k]) / 3.0;
        return Part { area, moment: [third(0), third(1)], reach: 0b111 };
    }
    let mut chunks = [Chunk::default(); 3];
    let mut count = 0;
    let mut reach = 0;
    let mut centre_inside = true;
    for k in 0..3 {
        let l = (k + 1) % 3;
        let (a, b) = (p[k], p[l]);
        // The line of the edge is f + s u with the foot of the perpendicular f = (a x u) (u_y, -u_x) / |u|^2, which
        // does not suffer when the edge is much longer than the disc. The circle is crossed at s = -+ sqrt(crossing) /
        // |u|^2.
        let u = minus(b, a);
        let (length2, foot, turn) = (dot(u, u), -dot(a, u), cross(a, u));
        centre_inside &= turn >= 0.0;
        let crossing = r2 * length2 - turn * turn;
        let between = foot > 0.0 && foot < length2;
        let ends_reach = square[k].min(square[l]) <= r2 * TOUCH;
        if ends_reach || (between && turn * turn <= r2 * length2 * TOUCH) {
            // The edge from corner k to l lies opposite to the third corner.
            reach |= 1 << (3 - k - l);
        }
        if !(inside[k] || inside[l] || (between && crossing > 0.0)) {
            continue;
        }
        let (f, s) = (turn / length2, crossing.max(0.0).sqrt() / length2);
        let at = |s: f64| [f * u[1] + s * u[0], s * u[1] - f * u[0]];
        chunks[count] = Chunk {
            entry: if inside[k] { a } else { at(-s) },
            exit: if inside[l] { b } else { at(s) },
            joined: inside[l],
            centre_inside: turn >= 0.0,
        };
        count += 1;
    }
    if count == 0 {
        let area = if centre_inside { std::f64::consts::PI * r2 } else { 0.0 };
        return Part { area, moment: [0.0; 2], reach };
    }
    let (area, moment) = enclosed(&chunks[..count], r);
    Part { area, moment, reach }
}

/// Area and first moment of the polygon of the chunks with a circular segment on each gap between them.
fn enclosed(chunks: &[Chunk], r: f64) -> (f64, Point) {
    // The fan starts at the first entry, not at the centre: small polygons keep their relative accuracy.
    let origin = chunks[0].entry;
    let (mut polygon, mut moment) = (0.0, [0.0; 2]);
    let (mut arcs, mut arc_moment) = (0.0, [0.0; 2]);
    let mut last = [0.0; 2];
    for (i, chunk) in chunks.iter().enumerate() {
        for point in [chunk.entry, chunk.exit] {
            let point = minus(point, origin);
            let twice = cross(last, point);
            polygon += 0.5 * twice;
            moment[0] += twice * (last[0] + point[0]) / 6.0;
            moment[1] += twice * (last[1] + point[1]) / 6.0;
            last = point;
        }
        if !chunk.joined {
            let next = chunks[(i + 1) % chunks.len()].entry;
            let d = minus(next, chunk.exit);
            let d2 = dot(d, d);
            arcs += segment(chunk, next, d2, chunks.len() == 1, r);
            arc_moment[0] += d2 * d[1] / 12.0;
            arc_moment[1] -= d2 * d[0] / 12.0;
        }
    }
    let moment = [0, 1].map(|k| moment[k] + polygon * origin[k] + arc_moment[k]);
    (polygon + arcs, moment)
}

/// Area of the circular segment on the arc from the exit of a chunk anticlockwise to the next entry.
fn segment(from: &Chunk, to: Point, chord2: f64, alone: bool, r: f64) -> f64 {
    let r2 = r * r;
    let (sin, cos) = (cross(from.exit, to) / r2, dot(from.exit, to) / r2);
    // A short chord spans a short arc or nearly the whole circle. Nearly the whole circle fits into a triangle only if
    // a single edge cuts off a sliver: then the side of the centre decides, otherwise the arc is short, even if
    // round-off turned it.
    let short = cos > 0.0 && if alone { !from.centre_inside } else { sin > -1e-9 };
    // sin^2 of half the angle.
    let half2 = chord2 / (4.0 * r2);
    if short && half2 < 1e-3 {
        // t - sin t as a series in s = sin(t/2), from t = 2 asin(s) and sin t = 2 s sqrt(1 - s^2);
        // what is left out is below 1e-15 of it.
        let series = 4.0 / 3.0
            + half2 * (2.0 / 5.0 + half2 * (3.0 / 14.0 + half2 * (5.0 / 36.0 + half2 * (35.0 / 352.0))));
        return 0.5 * r2 * half2 * half2.sqrt() * series;
    }
    let angle = sin.atan2(cos);
    // Where a sliver is cut off the angle is above 3/2 pi, even if round-off turned it from below 2 pi to above 0.
    let sliver = alone && from.centre_inside && cos > 0.0;
    let whole = if angle < 0.0 || sliver { std::f64::consts::TAU } else { 0.0 };
    0.5 * r2 * (angle + whole - sin)
}
