//! How far grains have come into each other and into walls: what contacts should have prevented.

use crate::dem::Partner;
use crate::period::Period;
use crate::walls::Placed;
use crate::{Particles, Vector};

/// The deepest overlap of a sub-step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Penetration {
    /// Overlap as a share of the radius of the smaller grain; 0 without.
    pub depth: f64,
    /// The grain, and what it overlaps.
    pub between: Option<(u32, Partner)>,
}

/// Grains and walls after a sub-step of length `h`, in which the velocities have carried them on straight lines.
pub(crate) struct Moved<'a, const D: usize> {
    pub particles: &'a Particles<D>,
    /// The walls where they were at the start.
    pub walls: &'a [Placed<D>],
    pub h: f64,
    pub period: Period<D>,
}

impl<const D: usize> Moved<'_, D> {
    /// The deepest overlap among these pairs.
    pub fn deepest(&self, pairs: impl Iterator<Item = (u32, Partner)>) -> Penetration {
        pairs.fold(Penetration::default(), |deepest, (grain, partner)| {
            let depth = match partner {
                Partner::Grain(other) => self.of_grains(grain as usize, other as usize),
                Partner::Wall(wall) => self.with_wall(grain as usize, &self.walls[wall as usize]),
            };
            let between = Some((grain, partner));
            if depth > deepest.depth { Penetration { depth, between } } else { deepest }
        })
    }

    /// The same between all grains that move and all walls, for where the search cannot vouch for who met whom.
    pub fn deepest_in_walls(&self) -> Penetration {
        let grains = (0..self.particles.len() as u32).filter(|&i| !self.particles.held(i as usize));
        let standing = || (0_u32..).zip(self.walls).filter(|(_, wall)| !wall.gone).map(|(wall, _)| wall);
        self.deepest(grains.flat_map(|i| standing().map(move |wall| (i, Partner::Wall(wall)))))
    }

    /// Where the centres were nearest to each other on their way: grains that have passed through each other are
    /// apart at its end.
    fn of_grains(&self, i: usize, j: usize) -> f64 {
        let p = self.particles;
        let arm = self.period.nearest(p.position[j] - p.position[i]);
        let way = (p.velocity[j] - p.velocity[i]) * self.h;
        // How long ago they were nearest, as a share of the way; who has only gone apart is judged by the end.
        let back = arm.dot(&way) / way.norm_squared();
        let nearest = if back > 0.0 && back < 1.0 { (arm - way * back).norm() } else { arm.norm() };
        (p.radius[i] + p.radius[j] - nearest) / p.radius[i].min(p.radius[j])
    }

    /// Measured from the side of the wall that the centre was on at the start: a centre that has crossed the wall is a
    /// radius and more deep, however far it has gone.
    fn with_wall(&self, i: usize, wall: &Placed<D>) -> f64 {
        let moved = wall.after(self.h);
        let (radius, end) =
            (self.particles.radius[i], self.period.image(self.particles.position[i], &moved.point(0.5)));
        let start = end - self.particles.velocity[i] * self.h;
        let distance = (moved.point(moved.nearest(&end)) - end).norm();
        let endless = self.period.spans(&wall.points);
        let signed = if crossed((wall, &start), (&moved, &end), endless) { -distance } else { distance };
        (radius - signed) / radius
    }
}

/// The least length of an arm that changes evenly by a way.
pub(crate) fn nearest_on_way<const D: usize>(arm: &Vector<D>, way: &Vector<D>) -> f64 {
    let square = way.norm_squared();
    let share = if square > 0.0 { (-arm.dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
    (arm + way * share).norm()
}

/// Whether a point that goes straight from a place beside a wall to a place beside where the wall is then passes
/// through it; an endless wall leads from one periodic side to the other.
pub(crate) fn crossed<const D: usize>(
    (wall, start): (&Placed<D>, &Vector<D>),
    (moved, end): (&Placed<D>, &Vector<D>),
    endless: bool,
) -> bool {
    let ((before, from), (after, to)) = (beside(wall, start), beside(moved, end));
    before.dot(&after) < 0.0 && {
        let way = before.norm() / (before.norm() + after.norm());
        endless || (0.0..=1.0).contains(&(from + way * (to - from)))
    }
}

/// The vector from the line of a wall to a point, and the point's share of the way from the first to the second end,
/// beyond them too.
fn beside<const D: usize>(wall: &Placed<D>, x: &Vector<D>) -> (Vector<D>, f64) {
    let along = wall.points[1] - wall.points[0];
    let share = (x - wall.points[0]).dot(&along) / along.norm_squared();
    (x - wall.point(share), share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, Wall};

    const RADIUS: f64 = 1e-3;

    /// What is said of grains that end at these places (in radii) after moving by these ways, beside a floor from 0
    /// to 10 that has risen by `risen`.
    fn depth(grains: &[([f64; 2], [f64; 2])], risen: f64, pair: (u32, Partner)) -> f64 {
        let vector = |[x, y]: [f64; 2]| Vector::<2>::new(x, y) * RADIUS;
        let material = Material { density: 1.0, ..Material::default() };
        let places = grains.iter().map(|(end, _)| vector(*end)).collect();
        let count = grains.len();
        let mut particles =
            Particles::<2>::new(places, vec![RADIUS; count], vec![0; count], &[material]).unwrap();
        let h = 0.1;
        particles.velocity = grains.iter().map(|(_, way)| vector(*way) / h).collect();
        let mut floor = Wall::new("floor", vector([0.0, 0.0]), vector([10.0, 0.0]));
        floor.motion = crate::Motion::Translation { velocity: vector([0.0, risen]) / h };
        let walls = [Placed::new(&floor, 0.0, h)];
        Moved { particles: &particles, walls: &walls, h, period: Period::default() }
            .deepest([pair].into_iter())
            .depth
    }

    const FLOOR: (u32, Partner) = (0, Partner::Wall(0));
    const OTHER: (u32, Partner) = (0, Partner::Grain(1));

    #[test]
    fn a_grain_whose_centre_has_passed_a_wall_is_deep_in_it_however_far_it_has_gone() {
        for (end, way, risen, expected) in [
            ([5.0, 0.7], [0.0, -0.2], 0.0, 0.3),
            ([5.0, -0.2], [0.0, -0.8], 0.0, 1.2),
            ([5.0, -3.0], [1.0, -3.5], 0.0, 4.0),
            // The wall passes the grain.
            ([5.0, 0.5], [0.0, 0.0], 2.5, 3.0),
            // On the same side all the time, and beside the end of the wall.
            ([5.0, -0.7], [0.0, 0.1], 0.0, 0.3),
            ([11.0, -2.0], [0.0, -4.0], 0.0, 0.0),
        ] {
            let found = depth(&[(end, way)], risen, FLOOR);
            assert!((found - expected).abs() < 1e-9, "{end:?} after {way:?}: {found}, not {expected}");
        }
    }

    #[test]
    fn grains_that_have_passed_through_each_other_overlap() {
        for (end, way, expected) in [
            ([1.8, 0.0], [-0.1, 0.0], 0.2),
            ([1.8, 0.0], [0.1, 0.0], 0.2),
            // Through the centre to the other side, and past at the distance of one radius.
            ([-3.0, 0.0], [-6.0, 0.0], 2.0),
            ([-3.0, 1.0], [-6.0, 0.0], 1.0),
        ] {
            let found = depth(&[([0.0, 5.0], [0.0, 0.0]), ([end[0], end[1] + 5.0], way)], 0.0, OTHER);
            assert!((found - expected).abs() < 1e-9, "{end:?} after {way:?}: {found}, not {expected}");
        }
    }
}
