//! Gidaspow, Multiphase Flow and Fluidization (Academic Press, 1994).

use super::{Surroundings, ergun, wen_yu};

/// Ergun for eps < 0.8; above, Wen and Yu.
pub fn drag(around: &Surroundings) -> f64 {
    if around.voidage < 0.8 { ergun::drag(around) } else { wen_yu::drag(around) }
}
