//! The half-space that a contact keeps a body in, from the way that it would go freely in a sub-step.
//!
//! A contact keeps the second body in a half-space beside the first: n . (arm + u h) >= R, with the arm between the
//! centres and the sum R of the radii. Any n with n . arm >= R is safe: whoever starts in the half-space and ends there
//! has been there all the way. The direction of the arm at the start would stop a body that flies by at a plane which it
//! reaches beside the other, and turn one that hits it aside wrongly. So n is the direction where the bodies touch first,
//! or, if they do not, where they are nearest to each other. It changes continuously with places and velocities: who
//! grazes the other is hardly touched.

use crate::penetration::nearest_on_way;
use crate::space::Vector;
use crate::walls::Placed;

/// A half-space that keeps the second body of a contact beside the first: its normal, and how far the body is from its
/// boundary, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Side<const D: usize> {
    pub normal: Vector<D>,
    pub gap: f64,
}

/// Share of a way, from the end of an arm, after which a point that approaches a ball at the start of the arm touches it;
/// none if it does not.
fn touch<const D: usize>(arm: &Vector<D>, way: &Vector<D>, radius: f64) -> Option<f64> {
    let (square, closing) = (way.norm_squared(), -arm.dot(way));
    let apart = arm.norm_squared() - radius * radius;
    let root = closing * closing - square * apart;
    if closing <= 0.0 || root < 0.0 {
        return None;
    }
    // Not the difference of two nearly equal numbers.
    let share = apart / (closing + root.sqrt());
    (share <= 1.0).then_some(share)
}

/// The side on which a point that goes from the end of an arm meets or passes a ball of a radius at its start.
pub(crate) fn beside_ball<const D: usize>(arm: &Vector<D>, way: &Vector<D>, radius: f64) -> Side<D> {
    let meets = touch(arm, way, radius).map_or_else(|| nearest_on_way(arm, way), |share| arm + way * share);
    let normal = meets.normalize();
    Side { normal, gap: normal.dot(arm) - radius }
}

/// The same of a wall that goes past a grain by `way`.
pub(crate) fn beside_wall<const D: usize>(
    wall: &Placed<D>,
    centre: &Vector<D>,
    way: &Vector<D>,
    radius: f64,
) -> Side<D> {
    let arms = wall.points.map(|end| end - centre);
    let after = |share: f64| {
        let centre = centre - way * share;
        wall.point(wall.nearest(&centre)) - centre
    };
    let ends = arms.map(|arm| touch(&arm, way, radius));
    let first = ends.into_iter().flatten().chain(touch_line(arms, way, radius)).reduce(f64::min);
    let meets = first.map(after).unwrap_or_else(|| {
        // The distance from a wall is a convex function of the place, so it is least at an end of the way or where it
        // is least from an end of the wall.
        let nearest = arms.map(|arm| nearest_on_way(&arm, way));
        let all = [after(0.0), after(1.0), nearest[0], nearest[1]];
        all.into_iter()
            .reduce(|a, b| if b.norm_squared() < a.norm_squared() { b } else { a })
            .unwrap_or(arms[0])
    });
    let normal = meets.normalize();
    // Both ends of the wall lie in the half-space.
    let gap = arms.map(|arm| normal.dot(&arm)).into_iter().fold(f64::INFINITY, f64::min) - radius;
    Side { normal, gap }
}

/// Share of a way after which a wall between the ends of two arms touches a ball at their start elsewhere than with an
/// end.
fn touch_line<const D: usize>(arms: [Vector<D>; 2], way: &Vector<D>, radius: f64) -> Option<f64> {
    let along = arms[1] - arms[0];
    let across = arms[0] - along * (arms[0].dot(&along) / along.norm_squared());
    let distance = across.norm();
    let closing = -way.dot(&across) / distance;
    if distance < radius || closing <= 0.0 {
        return None;
    }
    let share = (distance - radius) / closing;
    let foot = -(arms[0] + way * share).dot(&along) / along.norm_squared();
    (share <= 1.0 && (0.0..=1.0).contains(&foot)).then_some(share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Dem, Load, Material, Motion, Particles, Settings, Wall};
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng};

    type Plane = Vector<2>;

    proptest! {
        /// The half-space holds the start of the way, its end if it misses the ball, and nothing of the ball.
        #[test]
        fn sides_are_safe(x in 1.001..3.0f64, y in -3.0..3.0f64, u in -6.0..6.0f64, v in -6.0..6.0f64) {
            let (arm, way) = (Plane::new(x, y), Plane::new(u, v));
            let side = beside_ball(&arm, &way, 1.0);
            prop_assert!(side.gap >= -1e-12 && (side.normal.norm() - 1.0).abs() < 1e-12);
            let end = side.normal.dot(&(arm + way)) - 1.0;
            let missed = nearest_on_way(&arm, &way).norm() >= 1.0;
            prop_assert_eq!(missed, end >= -1e-12, "{}", end);
        }

        /// A small change of the way changes the way that is left by as little, whether the other is met or not: next to
        /// a grazing way it is the square root of the change.
        #[test]
        fn who_grazes_is_hardly_touched(beside in -1e-6..1e-6f64, v in 2.5..6.0f64) {
            let (arm, way) = (Plane::new(1.0 + beside, 2.0), Plane::new(0.0, -v));
            let side = beside_ball(&arm, &way, 1.0);
            let taken = -(way.dot(&side.normal) + side.gap).min(0.0);
            prop_assert!(taken <= v * 2.0 * beside.abs().sqrt(), "{taken}");
        }
    }

    /// Velocities after a disc of a millimetre has flown down past something, one step of 1 ms after the other.
    fn flown(x: f64, others: &[(f64, f64)], walls: Vec<Wall<2>>, step: f64) -> (Plane, f64) {
        let materials = [Material { friction: 0.5, ..Material::default() }];
        let places = std::iter::once(&(x, 0.01)).chain(others).map(|(x, y)| Plane::new(*x, *y)).collect();
        let count = 1 + others.len();
        let mut grains =
            Particles::new(places, vec![1e-3; count], vec![0; count], &materials).unwrap().rotating();
        grains.velocity[0] = Plane::new(0.0, -1.0);
        grains.mass[1..].fill(f64::INFINITY);
        let settings = Settings { gravity: Plane::zeros(), ..Settings::default() };
        let mut dem = Dem::new(grains, walls, materials.to_vec(), settings).unwrap();
        let mut overlap = 0.0_f64;
        for _ in 0..(0.02 / step).round() as usize {
            overlap = overlap.max(dem.step(step, &Load::default()).max_penetration_over_radius);
        }
        (dem.particles.velocity[0], overlap)
    }

    fn wall(from: [f64; 2], to: [f64; 2]) -> Wall<2> {
        Wall { friction: 0.5, ..Wall::new("wall", Plane::from(from), Plane::from(to)) }
    }

    /// A disc that passed the end of a wall, or a disc, at a thousandth of its radius lost up to 14 % of its energy.
    #[test]
    fn a_disc_that_misses_is_not_touched() {
        let down = Plane::new(0.0, -1.0);
        for step in [1e-3, 7e-4, 3e-4, 1e-4, 9e-6] {
            for miss in [1e-5, 1e-3, 1e-2, 0.05, 0.3] {
                let beside = 1e-3 * (1.0 + miss);
                let plate = wall([-1.0, 0.0], [0.0, 0.0]);
                assert_eq!(flown(beside, &[], vec![plate.clone()], step), (down, 0.0), "{step} {miss}");
                let upright = wall([0.0, -1.0], [0.0, 0.0031]);
                assert_eq!(flown(beside, &[], vec![upright], step), (down, 0.0), "{step} {miss}");
                let disc = [(-1e-3, 0.0002)];
                assert_eq!(flown(beside, &disc, vec![], step), (down, 0.0), "{step} {miss}");
                // Between two discs, and past a wall that rises.
                let gate = [(-1e-3, 0.0002), (1e-3 + 2.0 * beside, 0.0013)];
                assert_eq!(flown(beside, &gate, vec![], step), (down, 0.0), "{step} {miss}");
                let motion = Motion::Translation { velocity: Plane::new(0.0, 0.7) };
                let rising = Wall { motion, ..plate };
                assert_eq!(flown(beside, &[], vec![rising], step), (down, 0.0), "{step} {miss}");
            }
        }
    }

    /// Grains that are pushed otherwise than they would go freely come into no wall.
    #[test]
    fn a_half_space_holds_the_whole_wall() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
        let mut tried = 0;
        for _ in 0..20_000 {
            let mut any = || Plane::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5);
            let placed =
                Placed { points: [any() * 4.0, any() * 4.0], velocity: [Plane::zeros(); 2], gone: false };
            let (way, push) = (any() * 8.0, any() * 8.0);
            let arm = placed.point(placed.nearest(&Plane::zeros()));
            if arm.norm() < 1.0 {
                continue;
            }
            let side = beside_wall(&placed, &Plane::zeros(), &way, 1.0);
            tried += 1;
            // Any way of the wall that the contact allows leaves it outside of the grain.
            let excess = -(push.dot(&side.normal) + side.gap);
            let allowed = push + side.normal * excess.max(0.0);
            let after = Placed { points: placed.points.map(|end| end + allowed), ..placed };
            let distance = after.point(after.nearest(&Plane::zeros())).norm();
            assert!(distance >= 1.0 - 1e-9, "{distance}");
        }
        assert!(tried > 5000, "{tried}");
    }

    /// One that hits is stopped, whatever the step, and passes into nothing.
    #[test]
    fn a_disc_that_hits_is_stopped() {
        for step in [1e-3, 7e-4, 3e-4, 1e-4] {
            let floor = wall([-1.0, 0.0], [1.0, 0.0]);
            let (velocity, overlap) = flown(0.0, &[], vec![floor], step);
            assert!(velocity.norm() < 1e-12 && overlap < 1e-9, "{velocity} {overlap}");
            // Beside the end of a wall it is turned aside.
            for x in [0.1, 0.5, 0.9] {
                let (velocity, overlap) = flown(1e-3 * x, &[], vec![wall([-1.0, 0.0], [0.0, 0.0])], step);
                assert!(
                    overlap < 1e-3 && velocity[0] > 0.0 && velocity.norm() < 1.0,
                    "{step} {x} {velocity}"
                );
            }
        }
    }
}
