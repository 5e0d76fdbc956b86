//! Di Felice, Int. J. Multiphase Flow 20, 153 (1994).

/// eps^(2 - chi) of the drag on one particle, written for the interstitial slip of set I:
/// eps^(-1.7 + 0.65 exp(-(1.5 - log10 Re_s)^2 / 2)).
pub fn voidage_function(voidage: f64, reynolds: f64) -> f64 {
    let x = 1.5 - reynolds.log10();
    voidage.powf(-1.7 + 0.65 * (-0.5 * x * x).exp())
}
