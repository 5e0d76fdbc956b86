//! The table of what a run records.

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
    /// Whether frames have the contacts that carry a force (contacts.pvd): lines from grain to grain with normal and
    /// tangential force, gap, heat and age, and `voidage plot` draws the force chains. Default false.
    pub contacts: bool,
    /// Whether stress, coordination number and fabric of the grains are recorded: in series.csv, for each grain in
    /// grains.pvd, and with a fluid at the nodes in fluid.pvd. Default false.
    pub stress: bool,
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
