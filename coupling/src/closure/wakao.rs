//! Wakao, Kaguei and Funazkri, Chem. Eng. Sci. 34, 325 (1979).

/// 2 + 1.1 Re_s^0.6 Pr^1/3.
pub fn nusselt(reynolds: f64, prandtl: f64) -> f64 {
    2.0 + 1.1 * reynolds.powf(0.6) * prandtl.cbrt()
}
