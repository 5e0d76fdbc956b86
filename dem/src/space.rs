//! All that differs between the plane and space.

use nalgebra::SVector;

/// A point or vector of the plane (`D = 2`) or of space (`D = 3`); metres, metres per second, newtons (per metre of
/// depth in the plane).
pub type Vector<const D: usize> = SVector<f64, D>;

/// Area of a disc, m2, or volume of a sphere, m3.
pub fn ball<const D: usize>(radius: f64) -> f64 {
    let disc = std::f64::consts::PI * radius * radius;
    if D == 2 { disc } else { disc * radius * 4.0 / 3.0 }
}

/// Moment of inertia of a full disc (m r2 / 2) or sphere (2 m r2 / 5).
pub fn inertia<const D: usize>(mass: f64, radius: f64) -> f64 {
    let factor = if D == 2 { 0.5 } else { 0.4 };
    factor * mass * radius * radius
}

/// The normal turned by a quarter turn, counter-clockwise: the direction in which the surface of a disc
/// moves at the end of `normal` when it spins positively. Zero in space, where spin is not solved yet.
#[inline(always)]
pub(crate) fn turned<const D: usize>(normal: &Vector<D>) -> Vector<D> {
    let mut t = Vector::zeros();
    if D == 2 {
        t[0] = -normal[1];
        t[1] = normal[0];
    }
    t
}

/// One of the D - 1 unit tangents at a normal.
pub(crate) fn tangent<const D: usize>(normal: &Vector<D>, which: usize) -> Vector<D> {
    if D == 2 {
        return turned(normal);
    }
    // Two tangents without a case (Duff et al., Journal of Computer Graphics Techniques 6, 2017).
    let sign = if normal[2] < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + normal[2]);
    let b = normal[0] * normal[1] * a;
    let tangents = [
        [1.0 + sign * normal[0] * normal[0] * a, sign * b, -sign * normal[0]],
        [b, sign + normal[1] * normal[1] * a, -normal[1]],
    ];
    Vector::from_fn(|axis, _| tangents[which][axis])
}

/// The unit vector along the first axis.
pub(crate) fn first_axis<const D: usize>() -> Vector<D> {
    Vector::from_fn(|a, _| if a == 0 { 1.0 } else { 0.0 })
}

/// The vector orthogonal to `normal` cut to the length `limit`: the nearest point of the friction disc.
/// In the plane it lies on one line, which needs no square root.
#[inline(always)]
pub(crate) fn cut<const D: usize>(normal: &Vector<D>, tangential: Vector<D>, limit: f64) -> Vector<D> {
    if D == 2 {
        let t = turned(normal);
        return t * t.dot(&tangential).max(-limit).min(limit);
    }
    let square = tangential.norm_squared();
    if square > limit * limit { tangential * (limit / square.sqrt()) } else { tangential }
}

/// The cells around a cell, as offsets: 3^D of them, or only those that come later in row-major order
/// (so that each pair of cells is met once).
pub(crate) fn stencil<const D: usize>(later_only: bool) -> Vec<[i64; D]> {
    let count = 3usize.pow(D as u32);
    let first = if later_only { count / 2 + 1 } else { 0 };
    let digit = |k: usize, axis: usize| ((k / 3usize.pow(axis as u32)) % 3) as i64 - 1;
    (first..count).map(|k| std::array::from_fn(|axis| digit(k, axis))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stencils_are_halves_of_each_other() {
        assert_eq!(stencil::<2>(false).len(), 9);
        assert_eq!(stencil::<2>(true), vec![[1, 0], [-1, 1], [0, 1], [1, 1]]);
        assert_eq!(stencil::<3>(true).len(), 13);
    }

    #[test]
    fn friction_is_cut_to_the_limit_in_plane_and_space() {
        let n = Vector::<3>::new(0.0, 0.0, 1.0);
        assert_eq!(cut(&n, Vector::<3>::new(3.0, 4.0, 0.0), 2.5), Vector::<3>::new(1.5, 2.0, 0.0));
        let n = Vector::<2>::new(0.0, 1.0);
        assert_eq!(cut(&n, Vector::<2>::new(3.0, 0.0), 1.0), Vector::<2>::new(1.0, 0.0));
    }
}
