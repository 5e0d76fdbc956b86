//! Ranz and Marshall, Chem. Eng. Prog. 48, 141 (1952).

/// 2 + 0.6 Re^1/2 Pr^1/3.
pub fn nusselt(reynolds: f64, prandtl: f64) -> f64 {
    2.0 + 0.6 * reynolds.sqrt() * prandtl.cbrt()
}
