//! What a run was and how it went, as JSON.

use super::files::write_whole;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use voidage_coupling::error::{Error, Result};
use voidage_dem::Cost;

/// What a run was and how it went. Quantities of parts that the scene does not have are absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// How it ended: `done`, `interrupted` or `failed`.
    pub outcome: String,
    /// What ended it before `time.end`, if it is done; what failed, if it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The checkpoint that it went on from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restarted_from: Option<String>,
    /// Keys of the scene that had other values when that checkpoint was written.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
    /// Steps done, those before a restart included.
    pub steps: u64,
    /// Steps done by this process.
    pub steps_of_this_process: u64,
    /// Time reached, s.
    pub time_s: f64,
    /// Wall time of this process, s.
    pub wall_s: f64,
    /// Wall time by phase of this process, s: overlap, closure, energy, flow, contacts, output, ..
    pub phases_s: BTreeMap<String, f64>,
    /// What contacts have cost this process, in the phase `contacts`; with grains only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contacts: Option<Cost>,
    /// Number of grains, at the end, as are the other numbers.
    pub grains: usize,
    /// Number of nodes of the fluid mesh.
    pub nodes: usize,
    /// Number of cells of the fluid mesh.
    pub cells: usize,
    /// Largest overlap of grains with each other and with walls over the radius, of all steps of this process, as are
    /// all counts and defects that follow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_penetration_over_radius: Option<f64>,
    /// Steps with an overlap above 5 % of a radius.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub penetrating_steps: Option<u64>,
    /// Steps in which a solver stopped before its tolerance.
    pub unconverged_steps: u64,
    /// Solutions of the fluid of this process; with grains and fluid only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fluid_solves: Option<u64>,
    /// Steps in which grains and fluid did not agree within the tolerance of the coupling.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disagreeing_steps: Option<u64>,
    /// Remeshings on the way, if there were any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remeshings: Option<u64>,
    /// Largest relative difference of all steps between the momentum that the grains gave and the fluid took.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub momentum_exchange_defect: Option<f64>,
    /// The same for heat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_exchange_defect: Option<f64>,
    /// Largest relative difference of all steps between the solid volume on the mesh and that of the grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solid_volume_defect: Option<f64>,
    /// Weight of the grains less their buoyancy, over the width of the fluid, Pa: what a fluidised bed needs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "bed_weight_per_area_Pa")]
    pub bed_weight_per_area: Option<f64>,
    /// Threads.
    pub threads: usize,
    /// Version of the program.
    pub version: String,
    /// Hash of the scene.
    pub scene_hash: String,
}

impl Summary {
    /// Writes the summary.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| Error::run(format!("{}: cannot encode the summary: {error}", path.display())))?;
        write_whole(path, |file| writeln!(file, "{text}"))
    }

    /// Reads a summary.
    pub fn read(path: &Path) -> Result<Summary> {
        let text = std::fs::read_to_string(path).map_err(|error| Error::file(path, "read", error))?;
        serde_json::from_str(&text).map_err(|error| Error::input(format!("{}: {error}", path.display())))
    }
}
