//! Closures by name: drag, lift and heat transfer between a grain and the fluid around it, one file a law.
//!
//! All laws are written per solid volume V, so that they serve discs and spheres alike: gamma / V from the
//! ratio (A/V) of a sphere, hA / V from its (S/V) (Henry et al., Eqs. 8-13).

mod beetstra;
mod dallavalle;
mod di_felice;
mod ergun;
mod gidaspow;
mod gunn;
mod henry;
mod koch_hill;
mod migflow;
mod ranz_marshall;
mod rong;
mod saffman;
mod tang;
mod wakao;
mod wen_yu;

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

    /// gamma / V, kg/m3/s, of a grain whose drag is `force` times Stokes' of a sphere in the superficial velocity, 3
    /// pi eta d eps |u - v|: 18 eta eps / d^2 times it.
    pub fn normalised(&self, force: f64) -> f64 {
        18.0 * self.viscosity * self.voidage * force / (self.diameter * self.diameter)
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
    /// Di Felice (1994): Dallavalle with his own voidage function.
    DiFelice,
    /// Rong, Dong and Yu (2013): Dallavalle with a voidage function whose exponent grows with the voidage.
    Rong,
    /// Ergun (1952), at any voidage: packed beds.
    Ergun,
    /// Wen and Yu (1966), at any voidage: dilute suspensions.
    WenYu,
    /// Gidaspow (1994): Ergun below a voidage of 0.8, Wen and Yu above.
    Gidaspow,
    /// Koch and Hill (2001): computed flow through random arrays of spheres.
    KochHill,
    /// Beetstra, van der Hoef and Kuipers (2007): the same, up to a Reynolds number of 1000.
    Beetstra,
    /// Tang et al. (2015): the same with finer grids.
    Tang,
}

impl Drag {
    /// All laws. Only `Dallavalle` uses the voidage function of the scene.
    pub const ALL: [Self; 9] = [
        Self::Dallavalle,
        Self::DiFelice,
        Self::Rong,
        Self::Ergun,
        Self::WenYu,
        Self::Gidaspow,
        Self::KochHill,
        Self::Beetstra,
        Self::Tang,
    ];

    /// gamma / V, kg/m3/s: force on the grain per volume and slip velocity.
    pub fn coefficient(self, around: &Surroundings, g: VoidageFunction) -> f64 {
        match self {
            Self::Dallavalle => dallavalle::drag(around, g.value(around)),
            Self::DiFelice => dallavalle::drag(around, VoidageFunction::DiFelice.value(around)),
            Self::Rong => {
                let g = rong::voidage_function(around.voidage, around.superficial_reynolds());
                dallavalle::drag(around, g)
            }
            Self::Ergun => ergun::drag(around),
            Self::WenYu => wen_yu::drag(around),
            Self::Gidaspow => gidaspow::drag(around),
            Self::KochHill => koch_hill::drag(around),
            Self::Beetstra => beetstra::drag(around),
            Self::Tang => tang::drag(around),
        }
    }

    /// Drag on a grain over Stokes' of a sphere in the superficial velocity, 3 pi eta d eps |u - v|.
    pub fn normalised(self, around: &Surroundings, g: VoidageFunction) -> f64 {
        self.coefficient(around, g) / around.normalised(1.0)
    }
}

/// What of a grain the laws of drag and heat transfer of a sphere of its diameter d act on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Per {
    /// Its solid volume V: A/V = 3/(2 d) and S/V = 6/d are those of spheres (Henry et al., Eqs. 8 and 13). A disc that
    /// stands for spheres with pores between them has as many of them as fill V.
    #[default]
    Solid,
    /// Its disc, whatever of it is solid: the cross-section d and the surface pi d per metre of depth, as if it were a
    /// sphere with these.
    Disc,
}

impl Per {
    /// Volume (m2 in the plane) whose spheres have the cross-section of a `share` of a disc, of which the solid `volume`
    /// (m2) is.
    pub fn in_drag(self, (volume, share): (f64, f64), diameter: f64) -> f64 {
        match self {
            Self::Solid => volume,
            Self::Disc => share * diameter * diameter * (2.0 / 3.0),
        }
    }

    /// The same for the surface.
    pub fn in_heat(self, (volume, share): (f64, f64), diameter: f64) -> f64 {
        match self {
            Self::Solid => volume,
            Self::Disc => share * diameter * diameter * (std::f64::consts::PI / 6.0),
        }
    }
}

/// Law of lift.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Lift {
    /// Saffman (1965) in shear, with Mei's correction (1992) for finite Reynolds numbers.
    SaffmanMei,
}

impl Lift {
    /// Lift per volume over |(u - v) x curl|, kg/m3, where the fluid turns with `vorticity` = |curl u|, 1/s.
    pub fn coefficient(self, around: &Surroundings, vorticity: f64) -> f64 {
        match self {
            Self::SaffmanMei => saffman::lift(around, vorticity),
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
mod tests;
