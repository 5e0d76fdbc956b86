//! Lift of a sphere in shear: Saffman, J. Fluid Mech. 22, 385 (1965) and 31, 624 (1968), with the correction for
//! finite Reynolds numbers of Mei, Int. J. Multiphase Flow 18, 145 (1992).

use super::Surroundings;
use std::f64::consts::PI;

/// Saffman's constant: a sphere of diameter d feels 1.615 d^2 sqrt(rho eta / |curl|) (u - v) x curl.
const SAFFMAN: f64 = 1.615;

/// Lift per volume over |(u - v) x curl|, kg/m3, in a fluid that turns with `vorticity` = |curl u|, 1/s: Saffman's,
///
/// ```text
///     6/pi 1.615 sqrt(rho eta / vorticity) / d
/// ```
///
/// times Mei's J with w = vorticity d / (2 |u - v|): (1 - 0.3314 sqrt(w)) exp(-Re/10) + 0.3314 sqrt(w) up to Re = 40,
/// 0.0524 sqrt(w Re) above. Mei has w from 0.005 to 0.4 and Re up to 100; beyond, the bound that is nearer stands for w.
pub fn lift(around: &Surroundings, vorticity: f64) -> f64 {
    if vorticity <= 0.0 {
        return 0.0;
    }
    let Surroundings { slip, diameter, density, viscosity, .. } = *around;
    let creeping = 6.0 / PI * SAFFMAN * (density * viscosity / vorticity).sqrt() / diameter;
    let (reynolds, turning) = (around.reynolds(), (vorticity * diameter / (2.0 * slip)).clamp(0.005, 0.4));
    let shear = 0.3314 * turning.sqrt();
    creeping
        * match reynolds <= 40.0 {
            true => (1.0 - shear) * (-reynolds / 10.0).exp() + shear,
            false => 0.0524 * (turning * reynolds).sqrt(),
        }
}
