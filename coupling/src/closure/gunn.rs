//! Gunn, Int. J. Heat Mass Transfer 21, 467 (1978).

/// (7 - 10 eps + 5 eps^2)(1 + 0.7 Re_s^0.2 Pr^1/3) + (1.33 - 2.4 eps + 1.2 eps^2) Re_s^0.7 Pr^1/3.
pub fn nusselt(voidage: f64, reynolds: f64, prandtl: f64) -> f64 {
    let root = prandtl.cbrt();
    let square = voidage * voidage;
    (7.0 - 10.0 * voidage + 5.0 * square) * (1.0 + 0.7 * reynolds.powf(0.2) * root)
        + (1.33 - 2.4 * voidage + 1.2 * square) * reynolds.powf(0.7) * root
}
