//! Tang, Peters, Kuipers, Kriebitzsch and van der Hoef, AIChE J. 61, 688 (2015).

use super::{Surroundings, beetstra};

/// gamma / V = 18 eta eps F / d^2, F = 10 phi/eps^2 + eps^2 (1 + 1.5 sqrt(phi)) +
/// Re_s (0.11 phi (1 + phi) - 0.00456/eps^4 + (0.169 eps + 0.0644/eps^4) Re_s^-0.343).
///
/// Fitted up to phi = 0.6 and Re_s = 1000. Beyond Re_s = 1000 the negative term grows; the value there is kept from
/// going down by holding the factor of Re_s at its value at 1000.
pub fn drag(around: &Surroundings) -> f64 {
    let (eps, reynolds) = (around.voidage, around.superficial_reynolds());
    let phi = 1.0 - eps;
    // Re_s Re_s^-0.343 is finite at rest, Re_s^-0.343 is not.
    let decay = 0.169 * eps + 0.0644 / eps.powi(4);
    let growth = 0.11 * phi * (1.0 + phi) - 0.00456 / eps.powi(4);
    let fitted = reynolds.min(MOST);
    let inertial = (growth * fitted + decay * fitted.powf(1.0 - 0.343)) * (reynolds / MOST).max(1.0);
    around.normalised(beetstra::viscous(eps) + inertial)
}

/// The largest Re_s that the fit has seen.
const MOST: f64 = 1000.0;
