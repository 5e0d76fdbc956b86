//! One contact: its kinematics, and the exact solution of the one-contact problem for each law.
//!
//! Grain i sees grain j (or a wall) along the unit normal n. With the surface speeds s = r w of both discs, the
//! relative velocity at the contact is u = v_j - v_i - (s_i + s_j) t, t the normal turned by a quarter turn.
//! An impulse p acts on j, -p on i:
//!
//! ```text
//!     v_j += p / m_j,  v_i -= p / m_i,  s -= (r^2 / I) (t . p)  for both,
//!     u   += W p,      W = (1/m_i + 1/m_j) 1 + (r_i^2/I_i + r_j^2/I_j) t t^T.
//! ```
//!
//! t . n = 0, so W is diagonal in (n, t): w_n = 1/m_i + 1/m_j and w_t = w_n + r_i^2/I_i + r_j^2/I_j. (For spheres the
//! same holds with every tangent.) The normal part of the one-contact problem then does not see the
//! tangential one, and Signorini's condition with the predicted gap,
//!
//! ```text
//!     0 <= p_n + c   orthogonal to   u_n + bias >= 0,     bias = gap / dt,
//! ```
//!
//! is solved by p_n = max(-c, p_n - (u_n + bias) / w_n), c the cohesion impulse; Coulomb's law for this p_n by
//! the projection of p_t - u_t / w_t on the disc of radius mu (p_n + c). Both are exact: one contact needs one pass.
//! With [resistance to rolling](crate::rolling) the tangential part has a second unknown, and is exact too.

use crate::rolling::Rolling;
use crate::space::{Vector, cut, turned};

/// A contact as the sweeps see it; 72 bytes in the plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact<const D: usize> {
    /// Unit vector from the first grain to the second.
    pub normal: Vector<D>,
    /// Impulse on the second grain, N s.
    pub impulse: Vector<D>,
    /// The contact holds u_n + bias >= 0: gap / dt, m/s.
    pub bias: f64,
    /// 1 / w_n and 1 / w_t, kg.
    pub mass_n: f64,
    pub mass_t: f64,
    pub friction: f64,
    /// Slots of the two grains; walls are bodies without mobility behind the grains.
    pub i: u32,
    pub j: u32,
}

impl<const D: usize> Default for Contact<D> {
    fn default() -> Self {
        let zero = Vector::zeros();
        Self { normal: zero, impulse: zero, bias: 0.0, mass_n: 0.0, mass_t: 0.0, friction: 0.0, i: 0, j: 0 }
    }
}

/// What a contact law is made of; the solver is compiled once for each.
pub(crate) trait Law: Copy + Send + Sync {
    const FRICTION: bool;
    const SPIN: bool;
    const COHESION: bool;
    const ROLLING: bool;
}

/// Signorini's condition alone.
#[derive(Clone, Copy)]
pub(crate) struct Frictionless;
/// Coulomb's law; with spin of the grains, with cohesion, or both; with spin also with resistance to rolling.
#[derive(Clone, Copy)]
pub(crate) struct Coulomb<const SPIN: bool, const COHESION: bool, const ROLLING: bool = false>;

impl Law for Frictionless {
    const FRICTION: bool = false;
    const SPIN: bool = false;
    const COHESION: bool = false;
    const ROLLING: bool = false;
}
impl<const SPIN: bool, const COHESION: bool, const ROLLING: bool> Law for Coulomb<SPIN, COHESION, ROLLING> {
    const FRICTION: bool = true;
    const SPIN: bool = SPIN;
    const COHESION: bool = COHESION;
    const ROLLING: bool = ROLLING;
}

impl<const D: usize> Contact<D> {
    /// Whether it carries an impulse.
    pub fn acts(&self) -> bool {
        self.impulse.iter().any(|p| *p != 0.0)
    }

    /// The impulse that solves this contact alone, for the relative velocity `u` under the impulse `p`;
    /// `cohesion` is c (N s); `bound` what friction may reach, mu (p_n + c) if none is given.
    #[inline(always)]
    pub fn solve<L: Law>(
        &self,
        p: &Vector<D>,
        u: &Vector<D>,
        cohesion: f64,
        bound: Option<f64>,
    ) -> Vector<D> {
        let n = &self.normal;
        let (un, pn) = (u.dot(n), p.dot(n));
        let floor = if L::COHESION { -cohesion } else { 0.0 };
        let qn = (pn - (un + self.bias) * self.mass_n).max(floor);
        if !L::FRICTION {
            return n * qn;
        }
        let trial = (p - n * pn) - (u - n * un) * self.mass_t;
        n * qn + cut(n, trial, bound.unwrap_or(self.friction * (qn - floor)))
    }

    /// The same with resistance to rolling, from its impulse `q` and the rolling speed `u_r`, in the plane: the
    /// impulse, and q.
    #[inline(always)]
    pub fn solve_rolling<L: Law>(
        &self,
        (p, u): (&Vector<D>, &Vector<D>),
        cohesion: f64,
        bound: Option<f64>,
        rolling: &Rolling,
        [q, u_r]: [f64; 2],
    ) -> (Vector<D>, f64) {
        let (n, t) = (&self.normal, turned(&self.normal));
        let floor = if L::COHESION { -cohesion } else { 0.0 };
        let qn = (p.dot(n) - (u.dot(n) + self.bias) * self.mass_n).max(floor);
        let most = [bound.unwrap_or(self.friction * (qn - floor)), rolling.most(qn - floor)];
        let [tangential, q] = rolling.solve([p.dot(&t), q], [u.dot(&t), u_r], 1.0 / self.mass_t, most);
        (n * qn + t * tangential, q)
    }

    /// The natural map r - P_K(r - rho (u + mu ||u_t|| n)) of FCLIB, an impulse: zero exactly at a solution, for any
    /// rho > 0. Returns its square and that of the impulse.
    ///
    /// The projection on Coulomb's cone K couples normal and tangent; the term mu ||u_t|| (De Saxce) makes the
    /// law associated: its zeros are those of Signorini's and Coulomb's conditions.
    #[inline(always)]
    pub fn natural_map<L: Law>(&self, u: &Vector<D>, rho: f64, cohesion: f64) -> [f64; 2] {
        let n = &self.normal;
        let c = if L::COHESION { cohesion } else { 0.0 };
        let r = self.impulse + n * c;
        let un = u.dot(n) + self.bias;
        let ut = u - n * u.dot(n);
        let mu = if L::FRICTION { self.friction } else { 0.0 };
        let rn = r.dot(n);
        let a = rn - rho * (un + mu * ut.norm());
        let b = (r - n * rn) - ut * if L::FRICTION { rho } else { 0.0 };
        let projected = project_cone(n, a, b, mu);
        [(r - projected).norm_squared(), self.impulse.norm_squared()]
    }
}

/// Projection of a n + b (b orthogonal to n) on the cone ||b|| <= mu a.
#[inline(always)]
fn project_cone<const D: usize>(n: &Vector<D>, a: f64, b: Vector<D>, mu: f64) -> Vector<D> {
    let size = b.norm();
    if mu * size + a <= 0.0 {
        Vector::zeros()
    } else if size <= mu * a {
        n * a + b
    } else {
        // Nearest point on the edge of the cone, along its generator (1, mu) / sqrt(1 + mu^2).
        let s = (a + mu * size) / (1.0 + mu * mu);
        n * s + b * (mu * s / size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn contact(bias: f64, friction: f64) -> Contact<2> {
        let normal = Vector::<2>::new(0.6, 0.8);
        Contact { normal, impulse: Vector::zeros(), bias, mass_n: 0.5, mass_t: 0.2, friction, i: 0, j: 1 }
    }

    proptest! {
        /// After one local solve the natural map of the contact vanishes, whatever the free velocity.
        #[test]
        fn one_pass_solves_one_contact(
            ux in -3.0..3.0f64, uy in -3.0..3.0f64, bias in -1.0..1.0f64, mu in 0.0..2.0f64, c in 0.0..0.5f64,
        ) {
            let free = Vector::<2>::new(ux, uy);
            let mut k = contact(bias, mu);
            k.impulse = k.solve::<Coulomb<true, true>>(&Vector::zeros(), &free, c, None);
            let pn = k.impulse.dot(&k.normal);
            let u = free + k.normal * (pn / k.mass_n) + (k.impulse - k.normal * pn) / k.mass_t;
            let [error, _] = k.natural_map::<Coulomb<true, true>>(&u, k.mass_n, c);
            prop_assert!(error < 1e-28, "{error}");
        }

        /// An open contact is a solution whatever its speed of separation, also without friction.
        #[test]
        fn open_contacts_are_solved(speed in 0.0..1.0f64, slip in -1.0..1.0f64, mu in 0.0..1.0f64) {
            let k = contact(0.0, mu);
            let u = k.normal * speed + turned(&k.normal) * slip;
            let u = if u.dot(&k.normal) < 0.0 { k.normal * speed } else { u };
            prop_assert_eq!(k.natural_map::<Coulomb<true, false>>(&u, k.mass_n, 0.0)[0], 0.0);
            prop_assert_eq!(k.natural_map::<Frictionless>(&u, k.mass_n, 0.0)[0], 0.0);
        }
    }
}
