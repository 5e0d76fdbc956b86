//! Rolling resistance: the third cone of a contact.
//!
//! Two discs that touch resist a relative spin w_j - w_i by a moment of at most `mu_r R p_n`, R = r_i r_j / (r_i +
//! r_j) being their effective radius (that of the grain at a wall), and they have no relative spin as long as the
//! moment stays below. This is Coulomb's law once more, for the spin instead of the slip: the rolling friction of
//! nonsmooth contact dynamics (Acary and Bourrier, European Journal of Mechanics A/Solids 85, 2021, 104046).
//!
//! The moment is held as the impulse q = m / R (N s) on the second side, and works on the rolling speed
//!
//! ```text
//!     u_r = R (w_j - w_i) = a_j s_j - a_i s_i,       a_i = R / r_i,   a_j = R / r_j,   s = r w,
//!     s_i -= a_i (r_i^2 / I_i) q,   s_j += a_j (r_j^2 / I_j) q,       |q| <= mu_r (p_n + c).
//! ```
//!
//! A moment changes no centre's velocity, so the normal part of the one-contact problem does not see it. The slip
//! does, because both turn the grains: with b = r^2 / I,
//!
//! ```text
//!     u_t += w_t p_t + w_tr q,             u_r += w_tr p_t + w_r q,
//!     w_tr = a_i b_i - a_j b_j,            w_r = a_i^2 b_i + a_j^2 b_j.
//! ```
//!
//! w_t contains the mobility of the centres beside the spins, so that w_t w_r > w_tr^2. Once p_n is known, the two
//! laws say that (p_t, q) minimises the convex quadratic form of this matrix in the box |p_t| <= mu (p_n + c), |q| <=
//! mu_r (p_n + c): [`Rolling::solve`] finds the minimum exactly, so that one contact still needs one pass. Where the
//! minimum without the box lies beyond one side of it, the line from any other point to it leads downhill into the
//! box, unless the point is on that side. So the minimum in the box is on that side, and where two sides are passed,
//! on one of the two.

use crate::bodies::{Bodies, Shared};

/// What a contact that resists rolling has beside its [`Contact`](crate::contact::Contact).
#[derive(Default)]
pub(crate) struct Rolling {
    /// q on the second side, N s.
    pub impulse: Shared,
    /// mu_r.
    pub resistance: f64,
    /// a_i and a_j; 0 for a wall.
    pub share: [f64; 2],
    /// R w of a wall that turns, m/s.
    pub drift: f64,
    /// w_tr and w_r, 1/kg.
    pub coupling: f64,
    pub mobility: f64,
}

impl Rolling {
    /// Between the bodies of two slots; `share`, `drift` and mu_r as above.
    pub fn new<const D: usize>(
        bodies: &Bodies<D>,
        slots: [u32; 2],
        share: [f64; 2],
        drift: f64,
        resistance: f64,
    ) -> Self {
        let [a, b] = share;
        let [spin_i, spin_j] = slots.map(|slot| bodies.spin_mobility(slot as usize));
        let coupling = a * spin_i - b * spin_j;
        let mobility = a * a * spin_i + b * b * spin_j;
        Self { resistance, share, drift, coupling, mobility, ..Self::default() }
    }

    /// u_r, m/s.
    #[inline(always)]
    pub fn speed<const D: usize>(&self, bodies: &Bodies<D>, i: u32, j: u32) -> f64 {
        self.share[1] * bodies.surface(j as usize) - self.share[0] * bodies.surface(i as usize) + self.drift
    }

    /// Adds an impulse to the spins of both sides.
    #[inline(always)]
    pub fn turn<const D: usize>(&self, bodies: &Bodies<D>, i: u32, j: u32, q: f64) {
        let (i, j) = (i as usize, j as usize);
        bodies.set_surface(i, bodies.surface(i) - self.share[0] * bodies.spin_mobility(i) * q);
        bodies.set_surface(j, bodies.surface(j) + self.share[1] * bodies.spin_mobility(j) * q);
    }

    /// (p_t, q) after this contact alone is solved, from `p` and the speeds `u` = (u_t, u_r) under it; `w_t` and the
    /// largest (|p_t|, |q|) are given.
    #[inline(always)]
    pub fn solve(&self, p: [f64; 2], u: [f64; 2], w_t: f64, most: [f64; 2]) -> [f64; 2] {
        let (w_tr, w_r) = (self.coupling, self.mobility);
        let cut = |x: f64, k: usize| x.max(-most[k]).min(most[k]);
        if w_r <= 0.0 {
            return [cut(p[0] - u[0] / w_t, 0), 0.0];
        }
        let det = w_t * w_r - w_tr * w_tr;
        let free = [p[0] - (w_r * u[0] - w_tr * u[1]) / det, p[1] - (w_t * u[1] - w_tr * u[0]) / det];
        let beyond = [free[0].abs() > most[0], free[1].abs() > most[1]];
        // The best q for a p_t, and the other way round.
        let rolling = |t: f64| cut(p[1] - (u[1] + w_tr * (t - p[0])) / w_r, 1);
        let rubbing = |q: f64| cut(p[0] - (u[0] + w_tr * (q - p[1])) / w_t, 0);
        let (t, q) = (cut(free[0], 0), cut(free[1], 1));
        match beyond {
            [false, false] => free,
            [true, false] => [t, rolling(t)],
            [false, true] => [rubbing(q), q],
            [true, true] => {
                let best = rolling(t);
                // The minimum is on this side of the box if friction opposes the slip there.
                let slip = u[0] + w_t * (t - p[0]) + w_tr * (best - p[1]);
                if slip * t <= 0.0 { [t, best] } else { [rubbing(q), q] }
            }
        }
    }

    /// The natural map q - P(q - rho u_r), P being the cut to mu_r (p_n + c) for `pressed` = p_n + c: zero exactly
    /// where the law of rolling holds. Returns rho, kg, and the squares of the map and of q.
    ///
    /// rho is 1 / w_r, or half of the larger inertia, for the same reason as between masses that differ.
    #[inline(always)]
    pub fn natural_map<const D: usize>(
        &self,
        bodies: &Bodies<D>,
        i: u32,
        j: u32,
        pressed: f64,
    ) -> (f64, [f64; 2]) {
        if self.mobility <= 0.0 {
            return (1.0, [0.0; 2]);
        }
        let part = |slot: u32, share: f64| share * share * bodies.spin_mobility(slot as usize);
        let (a, b) = (part(i, self.share[0]), part(j, self.share[1]));
        let slower = if a > 0.0 && b > 0.0 { a.min(b) } else { self.mobility };
        let rho = (1.0 / self.mobility).max(0.5 / slower);
        let (q, most) = (self.impulse.get(), self.most(pressed));
        let map = q - (q - rho * self.speed(bodies, i, j)).max(-most).min(most);
        (rho, [map * map, q * q])
    }

    /// What q may reach.
    #[inline(always)]
    pub fn most(&self, pressed: f64) -> f64 {
        self.resistance * pressed.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use proptest::prelude::*;

    /// Two discs of these masses and radii, at these speeds of their surfaces; and their contact along the first
    /// axis.
    fn pair(
        mass: [f64; 2],
        radius: [f64; 2],
        surface: [f64; 2],
        resistance: f64,
    ) -> (Bodies<2>, Rolling, f64) {
        let mut bodies = Bodies::default();
        for k in 0..2 {
            bodies.push(&Vector::<2>::zeros(), 1.0 / mass[k]);
            bodies.push_spin(surface[k], 2.0 / mass[k]);
        }
        let sum = radius[0] + radius[1];
        let rolling = Rolling::new(&bodies, [0, 1], [radius[1] / sum, radius[0] / sum], 0.0, resistance);
        (bodies, rolling, 3.0 / mass[0] + 3.0 / mass[1])
    }

    proptest! {
        /// The solution of one contact obeys both laws: within its bound no slip and no rolling speed, at its bound
        /// against them.
        #[test]
        fn one_pass_obeys_both_laws(
            masses in prop::array::uniform2(0.01..10.0f64), radii in prop::array::uniform2(0.01..1.0f64),
            start in prop::array::uniform2(-1.0..1.0f64), speeds in prop::array::uniform2(-3.0..3.0f64),
            most in prop::array::uniform2(0.0..1.0f64),
        ) {
            let (_, rolling, w_t) = pair(masses, radii, [0.0; 2], 0.1);
            let found = rolling.solve(start, speeds, w_t, most);
            let change = [found[0] - start[0], found[1] - start[1]];
            let after = [
                speeds[0] + w_t * change[0] + rolling.coupling * change[1],
                speeds[1] + rolling.coupling * change[0] + rolling.mobility * change[1],
            ];
            for k in 0..2 {
                let small = 1e-9 * (1.0 + speeds[0].abs() + speeds[1].abs() + w_t + rolling.mobility);
                prop_assert!(found[k].abs() <= most[k] * (1.0 + 1e-12));
                let at = |sign: f64| (found[k] - sign * most[k]).abs() <= 1e-12 * most[k] && after[k] * sign <= small;
                prop_assert!(after[k].abs() <= small || at(1.0) || at(-1.0), "{found:?} {after:?} {most:?}");
            }
        }
    }

    #[test]
    fn the_natural_map_sees_what_is_not_solved() {
        let (bodies, rolling, _) = pair([1.0, 1.0], [0.5, 0.5], [0.2, -0.2], 0.1);
        // Not pressed, nothing resists; pressed, the discs roll on each other without a moment.
        assert_eq!(rolling.natural_map(&bodies, 0, 1, 0.0).1[0], 0.0);
        let (rho, [square, _]) = rolling.natural_map(&bodies, 0, 1, 10.0);
        approx::assert_relative_eq!(square.sqrt(), rho * 0.2, max_relative = 1e-12);
        let q = rolling.solve([0.0; 2], [0.0, -0.2], 6.0, [0.0, 1.0])[1];
        rolling.impulse.set(q);
        rolling.turn(&bodies, 0, 1, q);
        assert!(rolling.natural_map(&bodies, 0, 1, 10.0).1[0] < 1e-30);
    }
}
