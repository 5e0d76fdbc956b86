//! The solid fraction of a bed.

use super::lying::Segment;
use crate::{Particles, Period, Wall, ball};

/// Share of the solid, from the bottom, in which the fraction is measured: the surface lies above.
const INNER: f64 = 0.9;

/// Share of a bed that discs cover, solid or not inside: away from the surface, in level strips a mean diameter high,
/// up to the height below which nine tenths of the discs' area lie. A strip reaches from its first to its last disc,
/// and on to walls (as they stand at time 0) less than a mean diameter beyond; with periodic sides left and right it
/// reaches around. Zero without grains.
pub fn solid_fraction(grains: &Particles<2>, walls: &[Wall<2>], period: &Period<2>) -> f64 {
    if grains.is_empty() {
        return 0.0;
    }
    let diameter = 2.0 * grains.radius.iter().sum::<f64>() / grains.len() as f64;
    let bottom = grains.position.iter().zip(&grains.radius).fold(f64::MAX, |low, (x, r)| low.min(x[1] - r));
    let top = inner_top(grains).max(bottom + 0.5 * diameter);
    let count = ((top - bottom) / diameter).ceil() as usize;
    let height = (top - bottom) / count as f64;
    let mut solid = 0.0;
    let mut ends = vec![[f64::MAX, f64::MIN]; count];
    for (x, &r) in grains.position.iter().zip(&grains.radius) {
        solid += below(r, top - x[1]);
        let strip = |y: f64| (((y - bottom) / height).max(0.0) as usize).min(count - 1);
        for (k, [left, right]) in ends.iter_mut().enumerate().take(strip(x[1] + r) + 1).skip(strip(x[1] - r))
        {
            // The widest chord within the strip.
            let low = bottom + k as f64 * height - x[1];
            let aside = 0.0f64.clamp(low, low + height);
            if aside.abs() < r {
                let half = (r * r - aside * aside).sqrt();
                *left = left.min(x[0] - half);
                *right = right.max(x[0] + half);
            }
        }
    }
    let segments: Vec<Segment> = walls.iter().map(|wall| Segment::new(wall.at(0.0))).collect();
    let strips = ends.iter().enumerate().filter(|(_, [left, right])| left < right);
    let area: f64 = strips
        .map(|(k, &[left, right])| {
            if let [Some([first, last]), _] = period.sides() {
                return (last - first) * height;
            }
            let crossings =
                segments.iter().filter_map(|wall| crossing(wall, bottom + (k as f64 + 0.5) * height));
            let (mut first, mut last) = (left - diameter, right + diameter);
            for x in crossings {
                first = if x <= left + 0.1 * diameter { first.max(x) } else { first };
                last = if x >= right - 0.1 * diameter { last.min(x) } else { last };
            }
            let first = if first > left - diameter { first } else { left };
            let last = if last < right + diameter { last } else { right };
            (last - first) * height
        })
        .sum();
    solid / area
}

/// The height of the centre below which the inner share of the solid lies, m.
fn inner_top(grains: &Particles<2>) -> f64 {
    let mut order: Vec<usize> = (0..grains.len()).collect();
    order.sort_by(|&a, &b| grains.position[a][1].total_cmp(&grains.position[b][1]));
    let whole: f64 = grains.radius.iter().map(|&r| ball::<2>(r)).sum();
    let mut sum = 0.0;
    for &k in &order {
        sum += ball::<2>(grains.radius[k]);
        if sum >= INNER * whole {
            return grains.position[k][1];
        }
    }
    f64::MIN
}

/// Area of a disc below a level at a height over its centre, m2.
fn below(radius: f64, height: f64) -> f64 {
    let t = (height / radius).clamp(-1.0, 1.0);
    radius * radius * (t.asin() + t * (1.0 - t * t).sqrt() + std::f64::consts::FRAC_PI_2)
}

/// Where a wall crosses a level.
fn crossing(wall: &Segment, y: f64) -> Option<f64> {
    let [from, to] = [wall.from, wall.to()];
    let share = (y - from[1]) / (to[1] - from[1]);
    (0.0..=1.0).contains(&share).then(|| from[0] + share * (to[0] - from[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packing::{Amount, Fill, Lattice, Radii, Region, container, lattice};
    use crate::{Material, Vector};

    #[test]
    fn lattices_have_their_solid_fractions() {
        let glass = [Material { solidity: 0.5, ..Material::default() }];
        let region = Region { low: Vector::<2>::new(1.0, -1.0), high: Vector::<2>::new(11.0, 9.0) };
        let fill = Fill {
            radii: Radii::Constant(0.05),
            amount: Amount::Fill,
            material: 0,
            materials: &glass,
            seed: 1,
        };
        let bed = lattice(&region, Lattice::Square, 1.0, &fill).unwrap();
        let walls = container(&region, &[]);
        let quarter = std::f64::consts::FRAC_PI_4;
        approx::assert_relative_eq!(
            solid_fraction(&bed, &walls, &Period::default()),
            quarter,
            max_relative = 3e-3
        );
        let bed = lattice(&region, Lattice::Triangular, 1.0, &fill).unwrap();
        let densest = std::f64::consts::PI / 12f64.sqrt();
        approx::assert_relative_eq!(
            solid_fraction(&bed, &walls, &Period::default()),
            densest,
            max_relative = 1e-2
        );
    }
}
