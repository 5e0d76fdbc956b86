//! Dallavalle, Micromeritics (Pitman, 1948).

use super::Surroundings;

/// gamma / V = rho/2 |u - v| C_d (A/V), C_d = g (0.63 + 4.8 / sqrt(eps Re))^2, (A/V) = 3 / (2 d).
///
/// |u - v| goes inside the square, |w| (0.63 + 4.8 sqrt(eta / (eps rho d |w|)))^2 =
/// (0.63 sqrt|w| + 4.8 sqrt(eta / (eps rho d)))^2, which is finite at rest.
pub fn drag(around: &Surroundings, g: f64) -> f64 {
    let viscous = (around.viscosity / (around.voidage * around.density * around.diameter)).sqrt();
    let root = 0.63 * around.slip.sqrt() + 4.8 * viscous;
    0.75 * around.density / around.diameter * g * root * root
}
