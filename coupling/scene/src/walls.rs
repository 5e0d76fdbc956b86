//! The table of walls.

use super::Coordinates;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A straight wall: a segment in the plane.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Name, for messages and records.
    pub name: String,
    /// First end, m. A wall has either `from` and `to`, or `along`, or `ring`.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub from: Coordinates,
    /// Second end, m.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub to: Coordinates,
    /// Name of a part of the boundary of the mesh: straight walls along this part, where it is at the start; they may have
    /// a `motion`. Default: none, the ends are `from` and `to`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along: Option<String>,
    /// A ring of straight walls around grains, such as a drum. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ring: Option<Ring>,
    /// Name of the body of which the wall is a part. `series.csv` has force and torque of a body as a whole. Its parts
    /// move alike, about one centre. Default: the name of the wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<String>,
    /// Name of one of the materials, from which the wall has friction, resistance to rolling, restitution and
    /// conductivity. Default: none; the wall then conducts heat perfectly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Coulomb friction coefficient between the wall and grains. Default: that of the material, or 0 without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of resistance to rolling between the wall and grains, 0 to 1. Default: that of the material, or 0
    /// without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rolling: Option<f64>,
    /// Coefficient of normal restitution between the wall and grains. Default: that of the material, or 0 without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
    /// Temperature, K. Default: none, no heat passes between the wall and grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Time at which the wall vanishes, s, such as a gate that is taken away. Default: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<f64>,
    /// How the wall moves. Default: it stands still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
}

/// A regular polygon of straight walls.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ring {
    /// Its centre, m.
    pub centre: Coordinates,
    /// Radius of the circle through its corners, m.
    pub radius: f64,
    /// Number of straight walls, at least 3. Default 48.
    #[serde(default = "pieces_of_a_ring")]
    pub pieces: usize,
}

fn pieces_of_a_ring() -> usize {
    48
}

impl Wall {
    /// Name of the body of which the wall is a part.
    pub fn body(&self) -> &str {
        self.body.as_ref().unwrap_or(&self.name)
    }
}

/// How a wall moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// Constant velocity, m/s.
    Velocity(Coordinates),
    /// Oscillation along a line.
    Oscillate(Oscillation),
    /// Rotation about a point.
    Rotate(Rotation),
    /// A table of times and places, linear between its rows. The wall is at rest before the first row and after the
    /// last.
    Table(MotionTable),
}

/// A motion by a table: a translation, and a rotation about a centre that moves with the wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionTable {
    /// Rows `[t, x, y, angle]`: the time, s, which increases; the displacement of the centre, m; the angle, rad,
    /// anticlockwise. Given here or in a file.
    #[serde(default)]
    pub rows: Vec<[f64; 4]>,
    /// CSV file with a header and the columns `t,x,y,angle`, path relative to the scene, instead of `rows`. Default:
    /// none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Centre of the rotation before the wall moves, m. The torque in series.csv is about this centre. Needed for
    /// walls `along` a mesh, rings and bodies. Default: the middle of the wall.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub centre: Coordinates,
}

/// A displacement `amplitude sin(2 pi frequency t + phase)`, less its value at t = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Oscillation {
    /// Amplitude, m.
    pub amplitude: Coordinates,
    /// Frequency, Hz.
    pub frequency: f64,
    /// Phase, rad. Default 0.
    #[serde(default)]
    pub phase: f64,
}

/// A rotation about a point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    /// The centre of the rotation, m.
    pub centre: Coordinates,
    /// Angular velocity, rad/s, positive anticlockwise.
    pub rate: f64,
}
