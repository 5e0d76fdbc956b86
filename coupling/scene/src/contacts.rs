//! The table of contacts.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_dem::{Cohesion, Conduction, Settings};

/// How contacts are solved.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contacts {
    /// How large the error of a sub-step may be: the kinetic energy of the error of the velocities, as a share of the
    /// kinetic energy of the changes that the sub-step makes to them. In a bed at rest, where velocities hardly change,
    /// it is a share of 0.5 % of the energy that the forces would give the grains in the step. It also decides when a
    /// grain counts as resting and stays where it is: with the default, below 1e-3 of the speed that the forces would
    /// give it in a step. Above 0 and at most 0.1, because with more, unsolved contacts would count as solved. Default
    /// 0.02.
    pub tolerance: f64,
    /// Largest number of sweeps of the contact solver in a sub-step. A step in which they are not enough is counted as
    /// not converged. Default 1000.
    pub max_sweeps: usize,
    /// Whether contacts that the sweeps leave unsolved are solved by an interior-point method. It is for grains whose
    /// masses lie far apart and for friction above one, up to 10,000 grains, and is not allowed with resistance to
    /// rolling. Default false.
    pub interior: bool,
    /// Share of its radius that a grain may cross in one sub-step. Default 0.5.
    pub max_travel: f64,
    /// Largest number of sub-steps in a step. Where more would be needed, the last sub-step takes the rest of the step;
    /// grains that fly far in it may pass into others, and the step then counts as not converged. Default 1000.
    pub max_substeps: usize,
    /// Overlap of two grains, or of a grain and a wall, at which the run fails, as a share of the radius of the smaller
    /// grain. From 0.05 to 1; at 1 the centre of a grain is on the wall. A run reports the step in which the overlap
    /// first exceeds 0.05. Default 0.5.
    pub max_penetration: f64,
    /// Whether grains rotate. Default true.
    pub rotation: bool,
    /// Law of heat conduction through contacts: `"henry"`, `"henry-printed"`, `"line"` (plane) or `"hertz"` (space).
    /// Default: contacts conduct no heat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conduction: Option<Conduction>,
    /// Whether the mechanical energy that contacts take by impacts, friction, resistance to rolling and cohesion warms the
    /// grains: half of it each of the two that touch; at a wall all of it the grain, or half of it if the wall has a
    /// temperature. Default false.
    pub dissipation_heats: bool,
    /// Cohesion of grains that touch. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cohesion: Option<Cohesion>,
    /// Coefficients of pairs of materials, used instead of the smaller one of both. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<Pair>,
}

/// Coefficients between two materials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Names of the two materials, of grains or walls; the same name twice for grains of one material among themselves.
    /// Where a wall has its own `friction`, `rolling` or `restitution`, that of the wall is used.
    pub materials: [String; 2],
    /// Coulomb friction coefficient. Default: the smaller one of the two, and at a wall that of the wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of resistance to rolling, 0 to 1. Default: the smaller one of the two, and at a wall that of the
    /// wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rolling: Option<f64>,
    /// Coefficient of normal restitution, 0 to 1. Default: the smaller one of the two, and at a wall that of the wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

impl Default for Contacts {
    fn default() -> Self {
        Contacts {
            tolerance: Settings::<2>::default().tolerance,
            max_sweeps: 1000,
            interior: false,
            max_travel: 0.5,
            max_substeps: 1000,
            max_penetration: 0.5,
            rotation: true,
            conduction: None,
            dissipation_heats: false,
            cohesion: None,
            pairs: vec![],
        }
    }
}
