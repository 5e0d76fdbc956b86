//! Where two discs, or a disc and a wall, meet on the way that their velocities take them.
//!
//! With the arm a from the first centre to the second, the relative velocity v, the sum R of the radii and any unit
//! vector n, a contact that holds n . (a + v h) >= R keeps the discs apart over the whole sub-step if n . a >= R: both
//! ends of the way, and so all of it, lie on one side of a line that is R from the first centre. The same holds for a wall,
//! which is convex as a disc is. The contact holds u_n + gap/h >= 0 with gap = n . a - R.
//!
//! n is where the two first touch on the way that their velocities at the start of the sub-step take them, or where they
//! come nearest if they miss each other. Then all of a way that misses lies on the far side of the line, and the contact
//! does nothing; and an impact has the normal that the two have when they meet. (The line of centres at the start also
//! keeps them apart, but takes momentum from discs that would pass each other.) With velocities that forces have
//! already changed, normals would depend on those of a fluid, and a step that is done again under other forces would meet
//! other contacts.

use crate::space::Vector;
use crate::walls::Placed;

/// Gap, as a share of the smaller radius, up to which two that meet count as touching from the start: what holds
/// another keeps the line of centres, however forces pull at it. A disc that misses another by less loses a share of its
/// energy of the same size.
const TOUCHING: f64 = 1e-5;

/// How a grain and a wall meet.
#[derive(Clone, Copy)]
pub(crate) struct Meeting<const D: usize> {
    /// Unit vector from the grain to the wall.
    pub normal: Vector<D>,
    /// Gap along the normal where the sub-step starts, m.
    pub gap: f64,
    /// Where on the wall, as a share of its length from its first end.
    pub share: f64,
    /// When they touch, as a share of the sub-step; infinite if they do not.
    pub when: f64,
    /// Distance from the centre of the grain to the wall then, or where they are nearest, m.
    pub distance: f64,
}

/// Normal and gap of two discs whose centres are `arm` apart, if the second goes by `way` seen from the first. `smaller`
/// is the smaller radius, `reach` the sum of both, m.
pub(crate) fn of_discs<const D: usize>(
    arm: Vector<D>,
    way: Vector<D>,
    smaller: f64,
    reach: f64,
) -> (Vector<D>, f64) {
    let distance = arm.norm();
    let normal = if distance > 0.0 { arm / distance } else { crate::space::first_axis() };
    let gap = distance - reach;
    if gap <= TOUCHING * smaller || way.dot(&normal) + gap >= 0.0 {
        return (normal, gap);
    }
    let (share, _) = of_points(&arm, &way, reach);
    let then = arm + way * share;
    let normal = then / then.norm();
    (normal, normal.dot(&arm) - reach)
}

/// The share of its way at which a point, now at `arm` from another and farther than `reach`, comes within it, or is
/// nearest if it does not; and whether it does.
fn of_points<const D: usize>(arm: &Vector<D>, way: &Vector<D>, reach: f64) -> (f64, bool) {
    let (square, closing) = (way.norm_squared(), -arm.dot(way));
    if closing <= 0.0 {
        return (0.0, false);
    }
    let beyond = arm.norm_squared() - reach * reach;
    let root = closing * closing - square * beyond;
    let touch = beyond / (closing + root.max(0.0).sqrt());
    if root >= 0.0 && touch <= 1.0 { (touch, true) } else { ((closing / square).min(1.0), false) }
}

/// How a disc and a wall meet if the centre goes by `way` seen from the wall; an endless wall leads from one periodic side
/// to the other.
pub(crate) fn with_wall<const D: usize>(
    wall: &Placed<D>,
    (centre, radius): (&Vector<D>, f64),
    way: &Vector<D>,
    endless: bool,
) -> Meeting<D> {
    let share = wall.nearest(centre);
    let arm = wall.point(share) - centre;
    let distance = arm.norm();
    let normal = if distance > 1e-12 * radius { arm / distance } else { wall.side() };
    let gap = distance - radius;
    if gap <= TOUCHING * radius || gap >= way.dot(&normal) {
        let when = if gap <= TOUCHING * radius { 0.0 } else { f64::INFINITY };
        return Meeting { normal, gap, share, when, distance };
    }
    let along = wall.points[1] - wall.points[0];
    let share_of = |x: &Vector<D>| (x - wall.points[0]).dot(&along) / along.norm_squared();
    let nearest = |x: &Vector<D>| if endless { share_of(x) } else { wall.nearest(x) };
    let side = wall.point(share_of(centre)) - centre;
    let height = side.norm();
    let face = Some((height - radius) * height / side.dot(way)).filter(|when| {
        let inside = (0.0..=1.0).contains(&share_of(&(centre + way * *when)));
        height > radius && (0.0..=1.0).contains(when) && (endless || inside)
    });
    let ends = wall.points.map(|end| of_points(&(end - centre), &-way, radius));
    let touches = ends.iter().filter(|(_, touches)| *touches).map(|(when, _)| *when).chain(face);
    let touch = touches.fold(f64::INFINITY, f64::min);
    // The distance is a convex function of the way: where it does not end nearest, that is beside an end of the wall.
    let far = |when: &f64| {
        let x = centre + way * *when;
        (wall.point(nearest(&x)) - x).norm()
    };
    let beside = ends.iter().map(|(when, _)| *when).fold(1.0, |a, b| if far(&b) < far(&a) { b } else { a });
    let then = centre + way * if touch.is_finite() { touch } else { beside };
    let share = nearest(&then);
    let point = wall.point(share);
    let distance = (point - then).norm();
    let normal = (point - then) / distance;
    Meeting { normal, gap: (point - centre).dot(&normal) - radius, share, when: touch, distance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Dem, Load, Material, Motion, Particles, Settings, Wall};
    use approx::assert_relative_eq;

    type Plane = Vector<2>;

    const RADIUS: f64 = 1e-3;
    const STEPS: [f64; 5] = [1e-3, 7e-4, 3e-4, 1e-4, 1e-5];

    /// Discs at these places (in radii) with these velocities, m/s, after 20 ms without gravity; and the deepest overlap.
    fn fly(
        grains: &[([f64; 2], [f64; 2])],
        material: &Material,
        walls: &[Wall<2>],
        step: f64,
    ) -> (Dem<2>, f64) {
        let places = grains.iter().map(|([x, y], _)| Plane::new(*x, *y) * RADIUS).collect();
        let count = grains.len();
        let mut particles =
            Particles::new(places, vec![RADIUS; count], vec![0; count], std::slice::from_ref(material))
                .unwrap()
                .rotating();
        particles.velocity = grains.iter().map(|(_, v)| Plane::from(*v)).collect();
        // A disc may go by two radii in a step of 1 ms.
        let settings =
            Settings { gravity: Plane::zeros(), max_travel: 2.0, tolerance: 1e-10, ..Settings::default() };
        let walls = walls.iter().map(|wall| Wall { friction: material.friction, ..wall.clone() }).collect();
        let mut dem = Dem::new(particles, walls, vec![material.clone()], settings).unwrap();
        let mut deepest = 0.0_f64;
        for _ in 0..(0.02 / step).round() as usize {
            deepest = deepest.max(dem.step(step, &Load::default()).max_penetration_over_radius);
        }
        (dem, deepest)
    }

    fn wall(from: [f64; 2], to: [f64; 2]) -> Wall<2> {
        Wall::new("wall", Plane::from(from) * RADIUS, Plane::from(to) * RADIUS)
    }

    fn rough() -> Material {
        Material { friction: 0.5, ..Material::default() }
    }

    /// A disc that passed the end of a wall at a thousandth of its radius lost 14 % of its energy.
    #[test]
    fn discs_that_pass_touch_nothing() {
        let ledge = wall([-1000.0, 0.0], [0.0, 0.0]);
        let corner = [ledge.clone(), wall([0.0, 0.0], [0.0, -1000.0])];
        let rising = Motion::Translation { velocity: Plane::new(0.0, 0.7) };
        let swinging = Motion::Oscillation { amplitude: Plane::new(0.0, 3e-3), frequency: 50.0, phase: 0.3 };
        for (miss, most) in [(1e-9, 1e-2), (1e-4, 1e-12), (1e-3, 1e-12), (0.05, 1e-12), (0.3, 1e-12)] {
            for step in STEPS {
                let clear = |grains: &[([f64; 2], [f64; 2])], walls: &[Wall<2>], what: &str| {
                    let (dem, deepest) = fly(grains, &rough(), walls, step);
                    for (velocity, (_, before)) in dem.particles.velocity.iter().zip(grains) {
                        let moved = (velocity - Plane::from(*before)).norm();
                        assert!(moved < most, "{what} at {miss} radii, step {step}: {velocity:?}");
                    }
                    assert!(deepest < 1e-12, "{what} at {miss} radii, step {step}: {deepest}");
                };
                let past = 1.0 + miss;
                clear(&[([past, 10.3], [0.0, -1.0])], std::slice::from_ref(&ledge), "the end of a wall");
                clear(&[([past, 10.3], [0.0, -1.0])], &corner, "a corner");
                clear(&[([-10.3, past], [1.0, 0.0])], &corner, "over an edge");
                let moving = |motion: &Motion<2>| Wall { motion: motion.clone(), ..ledge.clone() };
                clear(&[([past, 10.3], [0.0, -1.0])], &[moving(&rising)], "a wall that rises");
                clear(&[([past, 2.3], [0.0, 0.1])], &[moving(&swinging)], "a wall that swings");
                let other = ([0.0, -6.1], [0.0, 0.4]);
                clear(&[([1.0 + past, 7.7], [0.0, -1.0]), other], &[], "another disc");
            }
        }
    }

    /// An impact has the normal that the two have when they touch, however far they go in a step.
    #[test]
    fn elastic_impacts_do_not_depend_on_the_step() {
        let elastic = Material { restitution: 1.0, ..Material::default() };
        for offset in [0.0, 0.3, 1.2, 1.9, 1.999] {
            let normal = Plane::new(-offset / 2.0, -(1.0 - offset * offset / 4.0_f64).sqrt());
            let before = Plane::new(0.0, -1.0);
            let after = before - normal * before.dot(&normal);
            for step in STEPS {
                let (dem, deepest) =
                    fly(&[([offset, 9.3], [0.0, -1.0]), ([0.0, 0.0], [0.0, 0.0])], &elastic, &[], step);
                assert_relative_eq!(dem.particles.velocity[0], after, epsilon = 1e-3);
                assert_relative_eq!(dem.particles.velocity[1], before - after, epsilon = 1e-3);
                assert!(deepest < 1e-9, "{offset} {step}: {deepest}");
            }
        }
        // At the end of a wall: a disc beside its end is turned about the point that it hits.
        let ledge = Wall { restitution: 1.0, ..wall([-1000.0, 0.0], [0.0, 0.0]) };
        for offset in [-3.0, 0.1, 0.6, 0.95] {
            let beside = f64::max(offset, 0.0);
            let normal = Plane::new(beside, (1.0 - beside * beside).sqrt());
            for step in STEPS {
                let (dem, _) =
                    fly(&[([offset, 9.3], [0.0, -1.0])], &elastic, std::slice::from_ref(&ledge), step);
                let after = Plane::new(0.0, -1.0) + normal * (2.0 * normal[1]);
                assert_relative_eq!(dem.particles.velocity[0], after, epsilon = 1e-9);
            }
        }
    }

    /// What slides over the joint of two walls in a line does not feel it; from either side, and beside a third wall.
    #[test]
    fn joints_are_not_felt() {
        let floor = [wall([-100.0, 0.0], [0.0, 0.0]), wall([0.0, 0.0], [100.0, 0.0])];
        let with_post = [floor[0].clone(), floor[1].clone(), wall([0.0, 0.0], [0.0, -50.0])];
        for walls in [&floor[..], &with_post[..]] {
            for (height, step) in
                [1.0, 1.0 + 1e-6, 1.01, 1.3].into_iter().flat_map(|y| STEPS.map(|step| (y, step)))
            {
                for way in [1.0, -1.0] {
                    let grain = ([-way * 5.3, height], [way, 0.0]);
                    let (dem, deepest) = fly(&[grain], &Material::default(), walls, step);
                    assert_relative_eq!(dem.particles.velocity[0], Plane::new(way, 0.0), epsilon = 1e-12);
                    assert!(deepest < 1e-12);
                    // And falls on it: the floor takes what goes into it, wherever it is met.
                    let falls = ([-way * 5.3, 1.0 + height], [way, -0.3]);
                    let (dem, deepest) = fly(&[falls], &Material::default(), walls, step);
                    assert_relative_eq!(dem.particles.velocity[0], Plane::new(way, 0.0), epsilon = 1e-12);
                    assert!(deepest < 1e-12, "{height} {step}: {deepest}");
                }
            }
        }
    }

    /// Whatever contacts do to the ways, what met with these normals does not overlap.
    #[test]
    fn crowds_that_fly_into_each_other_do_not_overlap() {
        let mut seed = 7u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as f64 / 2f64.powi(31) * 2.0 - 1.0
        };
        for material in [Material::default(), rough(), Material { restitution: 0.7, ..rough() }] {
            let grains: Vec<_> = (0..64)
                .map(|k| {
                    let place =
                        [3.0 * f64::from(k % 8) + 0.4 * random(), 3.0 * f64::from(k / 8) + 0.4 * random()];
                    (place, [random(), random()])
                })
                .collect();
            let walls = [wall([5.0, -9.0], [9.0, -2.0]), wall([-3.0, 30.0], [30.0, 28.0])];
            let (dem, deepest) = fly(&grains, &material, &walls, 5e-4);
            assert!(deepest < 1e-3, "{deepest}");
            assert!(dem.particles.velocity.iter().all(|v| v.norm() < 3.0));
        }
    }
}
