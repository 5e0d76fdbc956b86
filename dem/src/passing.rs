//! Bodies that move past each other within a sub-step do not touch.
//!
//! A contact keeps the second body in a half-space beside the first: n . (arm + u h) >= R, with the arm between the
//! centres and the sum R of the radii. Any n with n . arm >= R is safe: whoever starts in the half-space and ends there
//! has been there all the way. The direction of the arm where the sub-step starts is the nearest one, and that of bodies
//! that meet. But a body that flies by would be stopped at a plane that it reaches beside the other. So where the free
//! velocities pass that plane, and the way that they take misses the other body, n is the direction from where it is
//! nearest to it.

use crate::space::Vector;
use crate::walls::Placed;

/// A half-space that keeps the second body of a contact beside the first: its normal, and how far the body is from its
/// boundary, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Side<const D: usize> {
    pub normal: Vector<D>,
    pub gap: f64,
}

impl<const D: usize> Side<D> {
    /// This one, the nearest, or that of a way which passes its boundary and misses the other body.
    #[inline]
    pub fn unless_missed(self, way: &Vector<D>, missed: impl FnOnce() -> Option<Self>) -> Self {
        if self.gap <= 0.0 || way.dot(&self.normal) + self.gap >= 0.0 {
            return self;
        }
        missed().unwrap_or(self)
    }
}

/// The arm where a point that goes from its end by a way is nearest to its start.
fn nearest<const D: usize>(arm: &Vector<D>, way: &Vector<D>) -> Vector<D> {
    let square = way.norm_squared();
    let share = if square > 0.0 { (-arm.dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
    arm + way * share
}

/// Way of a sub-step, as a share of the sum of the radii, below which nobody flies by: a plane that is met beside a body
/// takes at most 4e-4 of the energy of the relative velocity then, and beds that settle have contacts that do not change
/// from step to step.
const FLIES: f64 = 1e-2;

/// The side from which a point, from the end of an arm, passes a ball of a radius at its start; none if it meets it, or
/// goes by less than [`FLIES`].
pub(crate) fn passed<const D: usize>(arm: &Vector<D>, way: &Vector<D>, radius: f64) -> Option<Side<D>> {
    let nearest = nearest(arm, way);
    let distance = nearest.norm();
    if way.norm_squared() < (FLIES * radius).powi(2) || distance < radius || distance == 0.0 {
        return None;
    }
    let normal = nearest / distance;
    let gap = normal.dot(arm) - radius;
    (gap >= 0.0).then_some(Side { normal, gap })
}

/// The same of a grain that a wall goes past by `way`.
pub(crate) fn passed_wall<const D: usize>(
    wall: &Placed<D>,
    centre: &Vector<D>,
    way: &Vector<D>,
    radius: f64,
) -> Option<Side<D>> {
    let along = wall.points[1] - wall.points[0];
    let arms = wall.points.map(|end| end - centre);
    let across = arms[0] - along * (arms[0].dot(&along) / along.norm_squared());
    let distance = across.norm();
    let closing = -way.dot(&across) / distance;
    if distance > radius && closing > 0.0 {
        // Where the line of the wall comes as near as the radius, the wall itself is met if it is there.
        let share = (distance - radius) / closing;
        let foot = -(arms[0] + way * share).dot(&along) / along.norm_squared();
        if share <= 1.0 && (0.0..=1.0).contains(&foot) {
            return None;
        }
    }
    let [a, b] = arms.map(|arm| nearest(&arm, way).norm());
    if a.min(b) < radius {
        return None;
    }
    let side = passed(if a <= b { &arms[0] } else { &arms[1] }, way, radius)?;
    // A half-space that holds one end alone would let the grain into the rest of the wall.
    arms.iter().all(|arm| side.normal.dot(arm) >= radius).then_some(side)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Dem, Load, Material, Motion, Particles, Settings, Wall};
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng};

    type Plane = Vector<2>;

    proptest! {
        /// Who meets the ball has the nearest side; else the half-space holds the start and the end of the way.
        #[test]
        fn sides_are_safe(x in 1.001..3.0f64, y in -3.0..3.0f64, u in -6.0..6.0f64, v in -6.0..6.0f64) {
            let (arm, way) = (Plane::new(x, y), Plane::new(u, v));
            let missed = crate::penetration::nearest_on_way(&arm, &way) >= 1.0;
            match passed(&arm, &way, 1.0) {
                None => prop_assert!(!missed || way.norm() < FLIES),
                Some(side) => {
                    prop_assert!(missed && side.gap >= 0.0);
                    let end = side.normal.dot(&(arm + way)) - 1.0;
                    prop_assert!(end >= -1e-12, "{end}");
                }
            }
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
        for step in [1e-3, 7e-4, 3e-4, 1e-4] {
            for miss in [1e-3, 1e-2, 0.05, 0.3] {
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

    /// Grains that are pushed otherwise than they would go freely came into a wall by a twentieth of their radius: the
    /// half-space at its end did not hold the rest of it.
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
            let nearest = Side { normal: arm.normalize(), gap: arm.norm() - 1.0 };
            let side = nearest.unless_missed(&way, || passed_wall(&placed, &Plane::zeros(), &way, 1.0));
            if nearest.gap <= 0.0 || side == nearest {
                continue;
            }
            tried += 1;
            // Any way of the wall that the contact allows leaves it outside of the grain.
            let excess = -(push.dot(&side.normal) + side.gap);
            let allowed = push + side.normal * excess.max(0.0);
            let after = Placed { points: placed.points.map(|end| end + allowed), ..placed };
            let distance = after.point(after.nearest(&Plane::zeros())).norm();
            assert!(distance >= 1.0 - 1e-9, "{distance}");
        }
        assert!(tried > 100, "{tried}");
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
