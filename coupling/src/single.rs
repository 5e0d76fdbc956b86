//! What the laws of a scene say of one grain: how it falls, and what carries a bed of its like.

use crate::Laws;
use crate::closure::Surroundings;

/// A grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Single {
    /// Diameter, m.
    pub diameter: f64,
    /// Solid volume, m3 (m2 in the plane).
    pub volume: f64,
    /// Density of the solid, kg/m3.
    pub density: f64,
}

/// The speed at which `weight(speed)`, which grows, is 1; bisection on a logarithmic scale.
fn solve(weight: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (1e-12_f64, 1e6_f64);
    for _ in 0..200 {
        let middle = (low * high).sqrt();
        if weight(middle) > 1.0 { high = middle } else { low = middle }
    }
    (low * high).sqrt()
}

impl Single {
    /// Drag coefficient over the solid volume gamma/V at a slip (m/s) and a voidage, kg/m3/s.
    pub fn drag(&self, laws: &Laws, slip: f64, voidage: f64) -> f64 {
        let around = Surroundings {
            slip,
            voidage,
            diameter: self.diameter,
            density: laws.density,
            viscosity: laws.viscosity,
        };
        let volume = laws.per.in_drag((self.volume, 1.0), self.diameter) / self.volume;
        volume * laws.drag.coefficient(&around, laws.voidage_function)
    }

    /// Speed at which it falls (or rises) alone in fluid at rest, m/s.
    pub fn terminal(&self, laws: &Laws, gravity: f64) -> f64 {
        let weight = (self.density - laws.density).abs() * gravity;
        solve(|slip| self.drag(laws, slip, 1.0) * slip / weight)
    }

    /// Superficial velocity at which drag and the pressure gradient, which acts on the grains too, carry a bed of this
    /// voidage, m/s: gamma/V w/eps is the weight, with the slip w = U/eps.
    pub fn minimum_fluidisation(&self, laws: &Laws, voidage: f64, gravity: f64) -> f64 {
        let weight = (self.density - laws.density) * gravity;
        voidage * solve(|slip| self.drag(laws, slip, voidage) * slip / voidage / weight)
    }
}
