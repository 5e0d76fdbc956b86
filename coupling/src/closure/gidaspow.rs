//! Gidaspow, Multiphase Flow and Fluidization (Academic Press, 1994).

use super::Surroundings;

/// Ergun (1952) for eps < 0.8, gamma / V = 150 phi eta / (eps d^2) + 1.75 rho |w| / d; above, Wen and Yu (1966),
/// gamma / V = 3/4 C_d rho |w| eps^-1.65 / d with C_d = 24/Re_s (1 + 0.15 Re_s^0.687), 0.44 from Re_s = 1000.
pub fn drag(around: &Surroundings) -> f64 {
    let Surroundings { slip, voidage, diameter, density, viscosity } = *around;
    if voidage < 0.8 {
        return 150.0 * (1.0 - voidage) * viscosity / (voidage * diameter * diameter)
            + 1.75 * density * slip / diameter;
    }
    let reynolds = around.superficial_reynolds();
    // C_d |w| with the Stokes part multiplied out, finite at rest.
    let resistance = if reynolds < 1000.0 {
        24.0 * viscosity / (voidage * density * diameter) * (1.0 + 0.15 * reynolds.powf(0.687))
    } else {
        0.44 * slip
    };
    0.75 * density / diameter * resistance * voidage.powf(-1.65)
}
