//! Closures by name: drag and heat transfer between a grain and the fluid around it, one file a law.
//!
//! All laws are written per solid volume V, so that they serve discs and spheres alike: gamma / V from the
//! ratio (A/V) of a sphere, hA / V from its (S/V) (Henry et al., Eqs. 8-13).

mod dallavalle;
mod di_felice;
mod gidaspow;
mod gunn;
mod henry;
mod migflow;
mod ranz_marshall;
mod wakao;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The fluid around one grain and their relative motion.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings {
    /// |u - v|, m/s.
    pub slip: f64,
    /// Voidage eps.
    pub voidage: f64,
    /// Diameter of the grain d, m.
    pub diameter: f64,
    /// Density of the fluid rho, kg/m3.
    pub density: f64,
    /// Viscosity of the fluid eta, Pa s.
    pub viscosity: f64,
}

impl Surroundings {
    /// Re = rho d |u - v| / eta, with the interstitial velocity.
    pub fn reynolds(&self) -> f64 {
        self.density * self.diameter * self.slip / self.viscosity
    }

    /// Re_s = eps Re, with the superficial velocity.
    pub fn superficial_reynolds(&self) -> f64 {
        self.voidage * self.reynolds()
    }
}

/// Thermal properties of the fluid that heat transfer needs.
#[derive(Clone, Copy, Debug)]
pub struct ThermalFluid {
    /// Conductivity k, W/m/K.
    pub conductivity: f64,
    /// Prandtl number Pr = c eta / k.
    pub prandtl: f64,
}

/// Voidage function g(eps, Re) that corrects the laws of a single sphere for its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VoidageFunction {
    /// Henry et al., Eq. 11 as printed, with Re_s: eps^(-1.8 + exp(-(1.5 - log10 Re_s)^2 / 2)).
    #[default]
    Henry,
    /// The same with the interstitial Re.
    HenryInterstitial,
    /// Di Felice (1994): eps^(-1.7 + 0.65 exp(-(1.5 - log10 Re_s)^2 / 2)).
    DiFelice,
    /// As measured on MigFlow 1.4.0: eps^(-1.8 + 0.65 exp(-(1.5 - ln Re_s)^2 / 2)).
    Migflow,
    /// 1: neighbours change nothing.
    None,
}

impl VoidageFunction {
    /// g.
    pub fn value(self, around: &Surroundings) -> f64 {
        match self {
            Self::Henry => henry::voidage_function(around.voidage, around.superficial_reynolds()),
            Self::HenryInterstitial => henry::voidage_function(around.voidage, around.reynolds()),
            Self::DiFelice => di_felice::voidage_function(around.voidage, around.superficial_reynolds()),
            Self::Migflow => migflow::voidage_function(around.voidage, around.superficial_reynolds()),
            Self::None => 1.0,
        }
    }
}

/// Drag law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Drag {
    /// Dallavalle (1948) with the voidage function (Henry et al., Eq. 12).
    #[default]
    Dallavalle,
    /// Gidaspow (1994): Ergun below a voidage of 0.8, Wen and Yu above; uses no voidage function.
    Gidaspow,
}

impl Drag {
    /// gamma / V, kg/m3/s: force on the grain per volume and slip velocity.
    pub fn coefficient(self, around: &Surroundings, g: VoidageFunction) -> f64 {
        match self {
            Self::Dallavalle => dallavalle::drag(around, g.value(around)),
            Self::Gidaspow => gidaspow::drag(around),
        }
    }
}

/// Heat-transfer law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum HeatTransfer {
    /// Henry et al., Eq. 13, with the voidage function.
    #[default]
    Henry,
    /// Gunn (1978), for packed and fluidised beds.
    Gunn,
    /// Ranz and Marshall (1952), for a single sphere.
    RanzMarshall,
    /// Wakao, Kaguei and Funazkri (1979), for packed beds.
    Wakao,
}

impl HeatTransfer {
    /// Nusselt number h d / k.
    pub fn nusselt(self, around: &Surroundings, prandtl: f64, g: VoidageFunction) -> f64 {
        match self {
            Self::Henry => henry::nusselt(around.superficial_reynolds(), prandtl, g.value(around)),
            Self::Gunn => gunn::nusselt(around.voidage, around.superficial_reynolds(), prandtl),
            Self::RanzMarshall => ranz_marshall::nusselt(around.superficial_reynolds(), prandtl),
            Self::Wakao => wakao::nusselt(around.superficial_reynolds(), prandtl),
        }
    }

    /// hA / V, W/m3/K: Nu k/d times the surface per volume of a sphere, 6/d.
    pub fn coefficient(self, around: &Surroundings, fluid: &ThermalFluid, g: VoidageFunction) -> f64 {
        self.nusselt(around, fluid.prandtl, g) * fluid.conductivity * 6.0
            / (around.diameter * around.diameter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn around(slip: f64, voidage: f64) -> Surroundings {
        Surroundings { slip, voidage, diameter: 1e-3, density: 1.2, viscosity: 2e-5 }
    }

    #[test]
    fn a_single_grain_at_rest_has_the_finite_drag_of_the_viscous_limit() {
        // As |u - v| -> 0, C_d |u - v| -> 4.8^2 eta / (rho d): gamma / V = 3/4 23.04 eta / d^2.
        let drag = Drag::Dallavalle.coefficient(&around(0.0, 1.0), VoidageFunction::Henry);
        assert_relative_eq!(drag, 0.75 * 23.04 * 2e-5 / 1e-6, max_relative = 1e-14);
    }

    #[test]
    fn drag_is_the_printed_coefficient() {
        let x = around(0.7, 0.5);
        for (g, exponent) in [
            (VoidageFunction::Henry, -1.8 + (-(1.5 - 21f64.log10()).powi(2) / 2.0).exp()),
            (VoidageFunction::HenryInterstitial, -1.8 + (-(1.5 - 42f64.log10()).powi(2) / 2.0).exp()),
            (VoidageFunction::DiFelice, -1.7 + 0.65 * (-(1.5 - 21f64.log10()).powi(2) / 2.0).exp()),
            (VoidageFunction::Migflow, -1.8 + 0.65 * (-(1.5 - 21f64.ln()).powi(2) / 2.0).exp()),
            (VoidageFunction::None, 0.0),
        ] {
            let coefficient = 0.5f64.powf(exponent) * (0.63 + 4.8 / 21f64.sqrt()).powi(2);
            let exact = 0.5 * 1.2 * 0.7 * coefficient * 1.5 / 1e-3;
            assert_relative_eq!(Drag::Dallavalle.coefficient(&x, g), exact, max_relative = 1e-12);
        }
    }

    #[test]
    fn gidaspow_gives_the_pressure_drop_of_ergun() {
        // Steady bed of set I: eps dp/dx = phi gamma/V w, w = U/eps; Ergun (1952) for dp/dx.
        let (eps, speed) = (0.45, 0.3);
        let x = around(speed / eps, eps);
        let gradient =
            (1.0 - eps) / eps * Drag::Gidaspow.coefficient(&x, VoidageFunction::None) * speed / eps;
        let phi: f64 = 1.0 - eps;
        let ergun = 150.0 * phi * phi * 2e-5 * speed / (eps.powi(3) * 1e-6)
            + 1.75 * phi * 1.2 * speed * speed / (eps.powi(3) * 1e-3);
        assert_relative_eq!(gradient, ergun, max_relative = 1e-12);
    }
}
