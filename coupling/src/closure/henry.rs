//! Henry, Coppin, Dorbolo, Legat, Lambrechts, Eqs. 10, 11 and 13.

/// Eq. 11 as printed: eps^(-1.8 + exp(-(1.5 - log10 Re)^2 / 2)); at Re = 0 the exponential is zero.
pub fn voidage_function(voidage: f64, reynolds: f64) -> f64 {
    let x = 1.5 - reynolds.log10();
    voidage.powf(-1.8 + (-0.5 * x * x).exp())
}

/// Eq. 13: g f(Re_s) (0.18 sqrt(Re_s) + 1.39)^2 Pr^0.4 with f(x) = (x + 500) / (0.11 x^1.4 + x + 500).
pub fn nusselt(reynolds: f64, prandtl: f64, g: f64) -> f64 {
    let f = (reynolds + 500.0) / (0.11 * reynolds.powf(1.4) + reynolds + 500.0);
    let root = 0.18 * reynolds.sqrt() + 1.39;
    g * f * root * root * prandtl.powf(0.4)
}
