//! What the equations of a droplet leave to choose. The defaults are what this program holds for right; the others
//! are what else the paper may mean, to study what depends on it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_fluid::body::{Blowing, HeatFlux};

/// The choices of a droplet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Choices {
    /// What the heat of the gas is.
    pub heat_flux: HeatFlux,
    /// What the velocity of the vapour is.
    pub blowing: Blowing,
    /// How much of the droplet a grain in it takes.
    pub grain_share: GrainShare,
    /// Pressure gradient in the water.
    pub buoyancy: Buoyancy,
    /// Laws in the water.
    pub inside: Inside,
}

/// How much of the droplet a grain in it takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GrainShare {
    /// Its solid volume: water is where gas was between the spheres that a disc of a solidity below one stands for.
    #[default]
    Solid,
    /// Its disc: as if no water came between them. The water then sees a packing as dense as that of the discs,
    /// drags, heats and presses on these volumes, and the gas in the pores of a grain that it takes in goes out
    /// through the surface.
    Disc,
}

/// The pressure gradient G in the water, which presses on the grains there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Buoyancy {
    /// -F/V, the mean over the droplet of what the gas presses on its surface with: rho_w g in a droplet that the gas
    /// carries, nothing in one that falls freely.
    #[default]
    Surface,
    /// rho_w g, as in water at rest.
    Hydrostatic,
    /// None.
    None,
}

/// Laws in the water.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Inside {
    /// Voidage for the laws of drag and heat transfer in the water. Default "mean".
    pub voidage: WaterVoidage,
}

/// Voidage in the water.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WaterVoidage {
    /// Share of liquid in the droplet, not below 0.05: grains in it are evenly distributed.
    #[default]
    Mean,
    /// 1: each grain is alone in the water.
    One,
}

impl Inside {
    /// The voidage of a droplet that is liquid to this share.
    pub fn of(self, liquid: f64) -> f64 {
        match self.voidage {
            WaterVoidage::Mean => liquid,
            WaterVoidage::One => 1.0,
        }
    }
}
