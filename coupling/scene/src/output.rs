//! The table of what a run records.

use crate::Coordinates;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the run records. Intervals are rounded to whole steps.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Time between ParaView frames, s. Default: only the first and the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_interval: Option<f64>,
    /// Time between rows of series.csv, s. Default: every step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub series_interval: Option<f64>,
    /// Time between checkpoints, s. Default: only at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checkpoint_interval: Option<f64>,
    /// Times of further ParaView frames, which `voidage plot` draws as pictures, s; those after the end are left out.
    /// Default: none, only the last is drawn.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub snapshots: Vec<f64>,
    /// Time averages of packing fraction and grain velocity on a regular grid. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub average: Option<Average>,
    /// The two boundaries between which the pressure drop is recorded. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_drop: Option<PressureDrop>,
    /// Places whose fields and grains are recorded in every row of series.csv, as `[[output.probes]]`. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub probes: Vec<Probe>,
    /// Whether frames have the contacts that carry a force (contacts.pvd): lines from grain to grain with normal and
    /// tangential force, gap, heat and age, and `voidage plot` draws the force chains. Default false.
    pub contacts: bool,
    /// Whether stress, coordination number and fabric of the grains are recorded: in series.csv, for each grain in
    /// grains.pvd, and with a fluid at the nodes in fluid.pvd. Default false.
    pub stress: bool,
    /// Whether series.csv has the budget of mechanical energy of the grains: kinetic energy, the work of gravity, fluid
    /// and walls, and what impacts, friction, resistance to rolling and cohesion take; `voidage plot` draws it. Default
    /// false.
    pub energy: bool,
}

/// A time average on a regular grid.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Average {
    /// Time at which it begins, s.
    pub from: f64,
    /// Time at which it ends, s.
    pub to: f64,
    /// Side of a square of the grid, m.
    pub cell: f64,
    /// Time between samples, s. Default: every step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<f64>,
}

/// Mean pressure on one boundary less mean pressure on another.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PressureDrop {
    /// Name of the upstream boundary.
    pub from: String,
    /// Name of the downstream boundary.
    pub to: String,
}

/// A place whose fields and grains are recorded: a point, a line or a box.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Name, which the columns have: `probe_NAME_pressure_Pa`.
    pub name: String,
    /// A point, m: the fields of the fluid there. Either this, `line` or `box`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<Coordinates>,
    /// A line: means of the fields of the fluid along it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<ProbeLine>,
    /// A box: means of the fields of the fluid in it, number of the grains with their centre in it, and solid share,
    /// velocity, granular temperature and temperature of the solid in it.
    #[serde(default, rename = "box", skip_serializing_if = "Option::is_none")]
    pub within: Option<ProbeBox>,
}

/// A straight line.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProbeLine {
    /// One end, m.
    pub from: Coordinates,
    /// The other end, m.
    pub to: Coordinates,
}

/// A box along the axes.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProbeBox {
    /// Lower left corner, m.
    pub lower: Coordinates,
    /// Upper right corner, m.
    pub upper: Coordinates,
}
