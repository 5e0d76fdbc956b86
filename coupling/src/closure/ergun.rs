//! Ergun, Chem. Eng. Prog. 48(2), 89 (1952).

use super::Surroundings;

/// gamma / V = 150 phi eta / (eps d^2) + 1.75 rho |w| / d.
///
/// In a fixed bed eps dp/dx = phi gamma/V w, so with U = eps w this is the pressure drop that Ergun printed.
pub fn drag(around: &Surroundings) -> f64 {
    let Surroundings { slip, voidage, diameter, density, viscosity } = *around;
    150.0 * (1.0 - voidage) * viscosity / (voidage * diameter * diameter) + 1.75 * density * slip / diameter
}
