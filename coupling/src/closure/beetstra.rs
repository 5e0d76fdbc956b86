//! Beetstra, van der Hoef and Kuipers, AIChE J. 53, 489 (2007).

use super::Surroundings;

/// gamma / V = 18 eta eps F / d^2, F = 10 phi/eps^2 + eps^2 (1 + 1.5 sqrt(phi)) +
/// 0.413 Re_s / (24 eps^2) (1/eps + 3 phi eps + 8.4 Re_s^-0.343) / (1 + 10^(3 phi) Re_s^(-(1 + 4 phi)/2)).
pub fn drag(around: &Surroundings) -> f64 {
    let (eps, reynolds) = (around.voidage, around.superficial_reynolds());
    around.normalised(viscous(eps) + inertial(eps, reynolds))
}

/// The part of vanishing Reynolds number: Carman's for dense beds, Stokes' for single spheres.
pub fn viscous(eps: f64) -> f64 {
    let phi = 1.0 - eps;
    10.0 * phi / (eps * eps) + eps * eps * (1.0 + 1.5 * phi.sqrt())
}

fn inertial(eps: f64, reynolds: f64) -> f64 {
    if reynolds == 0.0 {
        return 0.0;
    }
    let phi = 1.0 - eps;
    let above = 1.0 / eps + 3.0 * phi * eps + 8.4 * reynolds.powf(-0.343);
    let below = 1.0 + 10f64.powf(3.0 * phi) * reynolds.powf(-0.5 * (1.0 + 4.0 * phi));
    0.413 * reynolds / (24.0 * eps * eps) * above / below
}
