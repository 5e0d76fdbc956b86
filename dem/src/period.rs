//! Periodic sides: what leaves the domain at one side comes in at the other.

use crate::error::{Error, Result, Rounded};
use crate::space::Vector;
use crate::{Motion, Wall};

/// Largest diameters of a grain that a period must hold at least: two grains then never touch on both sides.
const LEAST_DIAMETERS: f64 = 3.0;

/// The sides of a periodic domain, axis by axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period<const D: usize> {
    sides: [Option<[f64; 2]>; D],
}

impl<const D: usize> Default for Period<D> {
    /// No periodic sides.
    fn default() -> Self {
        Self { sides: [None; D] }
    }
}

impl<const D: usize> Period<D> {
    /// The places of the lower and the upper side along each axis, m; none where the domain is not periodic.
    ///
    /// # Errors
    /// Places that are not finite or in the wrong order.
    pub fn new(sides: [Option<[f64; 2]>; D]) -> Result<Self> {
        for (axis, [low, high]) in sides.iter().enumerate().filter_map(|(axis, side)| Some((axis, (*side)?)))
        {
            if !(low.is_finite() && high.is_finite() && low < high) {
                return Err(Error::Scene(format!(
                    "the periodic sides along axis {axis} are at {low} and {high} m: the second must be beyond the \
                     first"
                )));
            }
        }
        Ok(Self { sides })
    }

    /// The places of both sides along each axis, m.
    pub fn sides(&self) -> &[Option<[f64; 2]>; D] {
        &self.sides
    }

    /// Whether there are no periodic sides.
    #[inline]
    pub fn is_none(&self) -> bool {
        self.sides.iter().all(Option::is_none)
    }

    /// Length of the period along an axis, m.
    #[inline]
    pub fn length(&self, axis: usize) -> Option<f64> {
        self.sides[axis].map(|[low, high]| high - low)
    }

    /// The shortest of a way and its images.
    #[inline]
    pub fn nearest(&self, mut way: Vector<D>) -> Vector<D> {
        for axis in 0..D {
            if let Some(length) = self.length(axis)
                && way[axis].abs() > 0.5 * length
            {
                way[axis] -= length * (way[axis] / length).round();
            }
        }
        way
    }

    /// Whether the shortest image of a way is another one.
    #[inline]
    pub fn crosses(&self, way: &Vector<D>) -> bool {
        (0..D).any(|axis| self.length(axis).is_some_and(|length| way[axis].abs() > 0.5 * length))
    }

    /// The image of a point that is nearest to a place along the periodic axes.
    #[inline]
    pub fn image(&self, mut x: Vector<D>, place: &Vector<D>) -> Vector<D> {
        for axis in 0..D {
            if let Some(length) = self.length(axis) {
                let away = x[axis] - place[axis];
                if away.abs() > 0.5 * length {
                    x[axis] -= length * (away / length).round();
                }
            }
        }
        x
    }

    /// The image of a point that lies in the domain: at or beyond the lower side, and before the upper one.
    #[inline]
    pub fn wrap(&self, mut x: Vector<D>) -> Vector<D> {
        for axis in 0..D {
            if let Some([low, high]) = self.sides[axis] {
                let length = high - low;
                if x[axis] < low || x[axis] >= high {
                    x[axis] -= length * ((x[axis] - low) / length).floor();
                }
                // A point that rounding has put on the upper side is on the lower one.
                if x[axis] >= high || x[axis] < low {
                    x[axis] = low;
                }
            }
        }
        x
    }

    /// Where a segment is to be shown: one that leads from side to side between these, another one with its middle in
    /// the domain.
    pub fn place(&self, [a, b]: [Vector<D>; 2]) -> [Vector<D>; 2] {
        let middle = (a + b) * 0.5;
        let mut shift = self.wrap(middle) - middle;
        for axis in 0..D {
            if let Some([low, high]) = self.sides[axis]
                && ((b[axis] - a[axis]).abs() - (high - low)).abs() <= 1e-9 * (high - low)
            {
                shift[axis] = low - a[axis].min(b[axis]);
            }
        }
        [a + shift, b + shift]
    }

    /// Whether a segment leads from one side to the other.
    pub(crate) fn spans(&self, [a, b]: &[Vector<D>; 2]) -> bool {
        (0..D).any(|axis| {
            self.length(axis)
                .is_some_and(|length| ((b[axis] - a[axis]).abs() - length).abs() <= 1e-9 * length)
        })
    }

    /// Whether grains of this largest radius (m), and these walls, fit in the period.
    ///
    /// # Errors
    /// A grain too large for its period; a wall that neither spans it nor leaves room beside it.
    pub fn check(&self, largest: f64, walls: &[Wall<D>]) -> Result<()> {
        for axis in 0..D {
            let Some(length) = self.length(axis) else { continue };
            if length < LEAST_DIAMETERS * 2.0 * largest {
                return Err(Error::Scene(format!(
                    "the period along axis {axis} is {} m long: the largest grain, of diameter {} m, needs {} m",
                    Rounded(length),
                    Rounded(2.0 * largest),
                    Rounded(LEAST_DIAMETERS * 2.0 * largest)
                )));
            }
            walls.iter().try_for_each(|wall| self.check_wall(axis, length, 4.0 * largest, wall))?;
        }
        Ok(())
    }

    /// A wall leads from side to side, without an end that a grain could meet, or leaves room for two grains beside it.
    fn check_wall(&self, axis: usize, length: f64, room: f64, wall: &Wall<D>) -> Result<()> {
        let along = wall.points[1] - wall.points[0];
        let turns = match &wall.motion {
            Motion::Fixed | Motion::Translation { .. } | Motion::Oscillation { .. } => false,
            Motion::Rotation { rate, .. } => *rate != 0.0,
            Motion::Table { rows, .. } => rows.iter().any(|row| row[3] != 0.0),
        };
        let extent = if turns { along.norm() } else { along[axis].abs() };
        let wrong = |what: &str| {
            let name = &wall.name;
            Err(Error::Scene(format!(
                "wall \"{name}\" {what}, in a domain that is periodic along axis {axis}"
            )))
        };
        if (extent - length).abs() <= 1e-9 * length {
            let level = (0..D).all(|other| other == axis || along[other].abs() <= 1e-9 * length);
            return match level && !turns {
                true => Ok(()),
                false if turns => wrong("turns and is as long as the period"),
                false => wrong("ends at another height than it begins"),
            };
        }
        match extent + room <= length {
            true => Ok(()),
            false => wrong("neither leads from side to side nor leaves room for two grains between its ends"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn period() -> Period<2> {
        Period::new([Some([-1.0, 2.0]), None]).unwrap()
    }

    #[test]
    fn points_are_wrapped_into_the_domain_and_ways_are_the_shortest() {
        let v = |x: f64| Vector::<2>::new(x, 7.0);
        for (x, wrapped) in [(0.5, 0.5), (-1.0, -1.0), (2.0, -1.0), (2.5, -0.5), (-1.25, 1.75), (8.5, -0.5)] {
            assert_eq!(period().wrap(v(x)), v(wrapped), "{x}");
        }
        // Rounding does not leave a point on the upper side.
        assert_eq!(period().wrap(v(-1.0 - 1e-17 - f64::EPSILON)), period().wrap(v(-1.0 - f64::EPSILON)));
        assert!(period().wrap(v((-1.0_f64).next_down()))[0] < 2.0);
        assert_eq!(period().nearest(v(2.5)), v(-0.5));
        assert_eq!(period().nearest(v(-1.4)), v(-1.4));
        assert!(period().crosses(&v(1.6)) && !period().crosses(&v(1.4)));
        assert_eq!(period().image(v(1.9), &v(-0.8)), v(1.9 - 3.0));
        assert_eq!(Period::<2>::default().wrap(v(9.0)), v(9.0));
        assert_eq!(period().place([v(3.5), v(6.5)]), [v(-1.0), v(2.0)]);
        assert_eq!(period().place([v(3.5), v(4.5)]), [v(0.5), v(1.5)]);
        assert_eq!(Period::<2>::default().place([v(3.5), v(6.5)]), [v(3.5), v(6.5)]);
    }

    #[test]
    fn what_does_not_fit_in_a_period_is_refused() {
        assert!(Period::<2>::new([Some([1.0, 1.0]), None]).is_err());
        assert!(Period::<2>::new([None, Some([0.0, f64::NAN])]).is_err());
        assert!(period().check(0.5, &[]).is_ok() && period().check(0.51, &[]).is_err());
        let wall = |x: [f64; 2], y: [f64; 2]| {
            Wall::new("wall", Vector::<2>::new(x[0], y[0]), Vector::<2>::new(x[1], y[1]))
        };
        let check = |wall: Wall<2>| period().check(0.1, &[wall]);
        assert!(check(wall([-1.0, 2.0], [0.0, 0.0])).is_ok());
        assert!(check(wall([-1.0, 2.0], [0.0, 0.1])).is_err());
        assert!(check(wall([-1.0, 1.9], [0.0, 0.0])).is_err());
        assert!(check(wall([-1.0, 1.0], [0.0, 0.5])).is_ok());
        assert!(check(wall([0.0, 0.0], [0.0, 9.0])).is_ok());
        let turning = Motion::Rotation { centre: Vector::zeros(), rate: 1.0 };
        assert!(check(Wall { motion: turning, ..wall([0.0, 0.0], [0.0, 9.0]) }).is_err());
    }

    /// Contacts of which all were across periodic sides left no grid for the measure of the error, and it panicked.
    #[test]
    fn grains_that_meet_across_the_sides_alone_collide() {
        use crate::{Dem, Load, Material, Particles, Settings};
        use rand::{Rng, SeedableRng};
        let materials = [Material { friction: 0.3, ..Material::default() }];
        let place = |x, y| Vector::<2>::new(x, y);
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let mut met = 0;
        for _ in 0..300 {
            let mut speed = || 0.02 * (rng.random::<f64>() - 0.5);
            let (u, v, w) = (speed(), speed(), speed());
            let places = vec![place(-0.92, 0.0), place(1.9, 0.12), place(1.9, -0.12)];
            let mut grains = Particles::new(places, vec![0.1; 3], vec![0; 3], &materials).unwrap().rotating();
            grains.velocity = vec![place(-0.02, u), place(0.01 + v, v), place(0.02 + w, w)];
            let before: Vector<2> = grains.velocity.iter().sum();
            let period = Period::new([Some([-1.0, 2.0]), None]).unwrap();
            let settings = Settings { gravity: place(0.0, 0.0), period, ..Settings::default() };
            let mut dem = Dem::new(grains, vec![], materials.to_vec(), settings).unwrap();
            for _ in 0..20 {
                let report = dem.step(0.1, &Load::default());
                assert!(report.converged);
                met = met.max(report.contacts);
            }
            let after: Vector<2> = dem.particles.velocity.iter().sum();
            approx::assert_relative_eq!(after, before, epsilon = 1e-12);
        }
        assert!(met > 1, "they never met");
    }
}
