//! The voidage function of MigFlow 1.4.0, measured as a black box; the logarithm is natural.

/// eps^(-1.8 + 0.65 exp(-(1.5 - ln Re_s)^2 / 2)).
pub fn voidage_function(voidage: f64, reynolds: f64) -> f64 {
    let x = 1.5 - reynolds.ln();
    voidage.powf(-1.8 + 0.65 * (-0.5 * x * x).exp())
}
