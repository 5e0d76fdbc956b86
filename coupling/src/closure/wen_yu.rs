//! Wen and Yu, Chem. Eng. Prog. Symp. Ser. 62, 100 (1966).

use super::Surroundings;

/// gamma / V = 3/4 C_d rho |w| eps^-1.65 / d with C_d = 24/Re_s (1 + 0.15 Re_s^0.687), 0.44 from Re_s = 1000.
pub fn drag(around: &Surroundings) -> f64 {
    let Surroundings { slip, voidage, diameter, density, viscosity } = *around;
    let reynolds = around.superficial_reynolds();
    // C_d |w| with the Stokes part multiplied out, finite at rest.
    let resistance = if reynolds < 1000.0 {
        24.0 * viscosity / (voidage * density * diameter) * (1.0 + 0.15 * reynolds.powf(0.687))
    } else {
        0.44 * slip
    };
    0.75 * density / diameter * resistance * voidage.powf(-1.65)
}
