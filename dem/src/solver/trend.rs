//! What is left of the error, from how the velocities still change.
//!
//! Where neither the natural map nor slow factors of the impulses see an error, such as that of a bed whose contacts
//! change from sticking to sliding while it gives way, sweeps still do. Their error falls about like a power of their
//! number k,
//! |e| = C k^-alpha, and velocities after b sweeps and after c differ by C (b^-alpha - c^-alpha). So
//!
//! ```text
//!     |e_c| = |v_c - v_b| / ((c/b)^alpha - 1)
//! ```
//!
//! in the norm of the kinetic energy. Alpha is 0.5 to 1.5 in beds that give way, and counts as 1; errors that fall
//! faster are overestimated. What has hardly begun to fall, as in a tall stack from a cold start, is what slow factors
//! see. What corrections over long distances change between b and c counts like what sweeps change.

use crate::bodies::Bodies;
use crate::parallel;
use crate::space::Vector;

/// Velocities are kept after numbers of sweeps that grow by this factor: 1, 2, 3, 5, 8, 12, ..
const GROWTH: f64 = 1.5;
/// Growth of the number of sweeps since velocities were kept from which their change tells something.
const APART: f64 = 1.2;

/// Velocities after some numbers of sweeps.
#[derive(Default)]
pub(super) struct Trend<const D: usize> {
    sweeps: usize,
    /// Sweeps after which velocities were kept, the smaller number first, and the velocities in few
    /// bytes: changes within their rounding are none.
    at: [usize; 2],
    kept: [Vec<[f32; D]>; 2],
    /// How many times they were kept, up to two.
    known: usize,
}

impl<const D: usize> Trend<D> {
    /// Begins with a problem of so many bodies that move.
    pub fn start(&mut self, bodies: usize) {
        (self.sweeps, self.known) = (0, 0);
        self.kept.iter_mut().for_each(|kept| kept.resize(bodies, [0.0; D]));
    }

    /// Counts a sweep that is about to start, and keeps the velocities, `velocity` of each body, if it is time.
    pub fn count(&mut self, velocity: impl Fn(usize) -> Vector<D>) {
        let newest = self.at[1];
        if self.known == 0 || self.sweeps as f64 >= (GROWTH * newest as f64).max(newest as f64 + 1.0) {
            self.at = [newest, self.sweeps];
            self.kept.swap(0, 1);
            for (i, kept) in self.kept[1].iter_mut().enumerate() {
                *kept = velocity(i).map(|v| v as f32).into();
            }
            self.known = (self.known + 1).min(2);
        }
        self.sweeps += 1;
    }

    /// Energy of the error of the present velocities, J; 0 before the first sweep, infinite while nothing is known.
    pub fn error(&self, bodies: &Bodies<D>) -> f64 {
        if self.sweeps == 0 {
            return 0.0;
        }
        let newest = if self.sweeps as f64 >= APART * self.at[1] as f64 { 1 } else { 0 };
        // What is not known stands before what is.
        if newest + self.known < 2 {
            return f64::INFINITY;
        }
        let changed = parallel::sum(0..self.kept[newest].len(), &|i| {
            let (mobility, v) = (bodies.mobility(i), bodies.velocity(i));
            let change = Vector::<D>::from_fn(|a, _| {
                let before = f64::from(self.kept[newest][i][a]);
                let change = v[a] - before;
                if change.abs() <= f64::from(f32::EPSILON) * before.abs() { 0.0 } else { change }
            });
            if mobility > 0.0 { 0.5 * change.norm_squared() / mobility } else { 0.0 }
        });
        // With alpha 1.
        let growth = self.sweeps as f64 / self.at[newest].max(1) as f64;
        changed / (growth - 1.0).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error of one body at a speed that goes by a law of the number of sweeps, as it is and as it is found.
    fn speeds(law: impl Fn(usize) -> f64, sweeps: usize) -> [f64; 2] {
        let mut bodies = Bodies::<1>::default();
        bodies.push(&Vector::<1>::new(law(0)), 0.5);
        let mut trend = Trend::default();
        trend.start(1);
        for k in 0..sweeps {
            trend.count(|i| bodies.velocity(i));
            bodies.set_velocity(0, &Vector::<1>::new(law(k + 1)));
        }
        [law(sweeps).powi(2), trend.error(&bodies)]
    }

    #[test]
    fn errors_that_fall_like_a_power_are_found_within_a_factor_of_ten() {
        for alpha in [0.5_f64, 1.0, 1.5] {
            for sweeps in [5, 8, 24, 54, 84, 500] {
                let [error, found] = speeds(|k| (k.max(1) as f64).powf(-alpha), sweeps);
                assert!((0.1..10.0).contains(&(found / error)), "{alpha}, {sweeps}: {found} of {error}");
            }
        }
    }

    #[test]
    fn errors_that_fall_by_a_factor_are_not_overlooked() {
        for factor in [0.3_f64, 0.8, 0.95, 0.99] {
            for sweeps in [8, 24, 54, 84] {
                let [error, found] = speeds(|k| factor.powi(k as i32), sweeps);
                // One that has hardly begun to fall is for others to see.
                assert!(error > 0.3 || found >= 0.1 * error, "{factor}, {sweeps}: {found} of {error}");
            }
        }
    }

    #[test]
    fn nothing_is_known_before_sweeps_have_changed_something() {
        assert_eq!(speeds(|_| 1.0, 0)[1], 0.0);
        assert_eq!(speeds(|k| 1.0 - 1e-3 * k as f64, 1)[1], f64::INFINITY);
        assert_eq!(speeds(|_| 1.0, 5)[1], 0.0);
    }
}
