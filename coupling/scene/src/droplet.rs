//! The table of a droplet.

use super::Coordinates;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use voidage_coupling::droplet::{Buoyancy, GrainShare, Inside};
use voidage_coupling::remesh::Remesh;
use voidage_fluid::body::{Blowing, HeatFlux};

/// A droplet of liquid that boils in hot gas and grains, falls, and digs (Henry et al., section 4). It is a hole of the
/// mesh, without a table in `[[fluid.boundaries]]`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Droplet {
    /// Name of the hole. Its centre and radius are those of the droplet at the start.
    pub boundary: String,
    /// Temperature of the droplet and its surface, K. Default 373.15: boiling water.
    #[serde(default = "boiling")]
    pub temperature: f64,
    /// Heat of vaporisation, J/kg. Above 0. Default 2.257e6: water at 100 C.
    #[serde(default = "latent")]
    pub latent_heat: f64,
    /// Density of the vapour that leaves it, kg/m3: how much room boiled liquid takes in the gas, whose own density stays
    /// `fluid.density`. Above 0. Default: that of the fluid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vapour_density: Option<f64>,
    /// The liquid. Default: water at 100 C.
    #[serde(default)]
    pub liquid: Liquid,
    /// Velocity at the start, m/s. Default: at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<Coordinates>,
    /// Whether it keeps this velocity, whatever forces act on it. Default false.
    #[serde(default)]
    pub held: bool,
    /// Values of other scalars of the fluid at its surface: `{vapour = 1.0}`. Default: scalars do not pass the surface.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub scalars: BTreeMap<String, f64>,
    /// How the heat that the gas gives to the droplet is computed. Default "reaction".
    #[serde(default)]
    pub heat_flux: HeatFlux,
    /// Which velocity of the vapour Eq. 15 of the paper gives. Default "superficial".
    #[serde(default)]
    pub blowing: Blowing,
    /// Which volume of the droplet a grain in it takes up. Default "solid".
    #[serde(default)]
    pub grain_share: GrainShare,
    /// The pressure gradient in the droplet. Default "surface".
    #[serde(default)]
    pub buoyancy: Buoyancy,
    /// Laws of drag and heat transfer in the droplet. Default: the defaults of its keys.
    #[serde(default)]
    pub inside: Inside,
    /// When the domain around it is remeshed. Default: the defaults of its keys.
    #[serde(default)]
    pub remesh: Remesh,
}

/// The liquid of a droplet.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Liquid {
    /// Density, kg/m3. Above 0. Default 958.4.
    pub density: f64,
    /// Dynamic viscosity, Pa s. Above 0. Default 2.82e-4.
    pub viscosity: f64,
    /// Heat capacity, J/(kg K). Above 0. Default 4216.
    pub heat_capacity: f64,
    /// Thermal conductivity, W/(m K). Above 0. Default 0.679.
    pub conductivity: f64,
}

impl Default for Liquid {
    /// Saturated water at 100 C.
    fn default() -> Self {
        Self { density: 958.4, viscosity: 2.82e-4, heat_capacity: 4216.0, conductivity: 0.679 }
    }
}

fn boiling() -> f64 {
    373.15
}

fn latent() -> f64 {
    2.257e6
}
