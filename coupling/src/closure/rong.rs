//! Rong, Dong and Yu, Chem. Eng. Sci. 99, 44 (2013).

/// eps^(2 - beta) of the drag on one sphere by Dallavalle, beta = 2.65 (eps + 1) - (5.3 - 3.5 eps) eps^2 exp(-(1.5 -
/// log10 Re_s)^2 / 2).
pub fn voidage_function(voidage: f64, reynolds: f64) -> f64 {
    let x = 1.5 - reynolds.log10();
    let hump = (5.3 - 3.5 * voidage) * voidage * voidage * (-0.5 * x * x).exp();
    voidage.powf(2.0 - 2.65 * (voidage + 1.0) + hump)
}
