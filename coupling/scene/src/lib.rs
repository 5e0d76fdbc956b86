//! Scenes: what a run reads, the systems that they describe ([`build`]), and runs of them ([`Simulation`],
//! [`recorder`]). TOML, SI units (in the plane everything is per metre of depth).
//!
//! The structs below are the documentation of the file: every key says its meaning, unit and default, and
//! `voidage schema` prints them. Physics that a scene does not mention is off: no `[[grains]]`, no grains; no
//! `[fluid]`, no mesh; no `[fluid.heat]`, no temperature in the fluid.

mod along;
pub mod build;
mod changes;
mod check;
pub mod compare;
mod contacts;
pub mod document;
mod droplet;
mod edit;
mod events;
mod fluid;
mod grains;
pub mod network;
mod origin;
mod output;
mod pace;
mod periodic;
pub mod placing;
pub mod probes;
mod read;
pub mod recorder;
mod schema;
pub mod simulation;
mod stop;
#[cfg(test)]
mod tests;
pub mod totals;
mod walls;

pub use changes::Change;
pub use contacts::{Contacts, Pair};
pub use droplet::{Droplet, Liquid};
pub use fluid::{
    Boundary, Coupling, Flow, Fluid, FluidHeat, FluidScalar, FluidSolver, HeatBoundary, LinearMethod,
    MeshMotion, MeshSource, ScalarBoundary, ThinCell, ThinCellHeat,
};
pub use grains::{
    Amount, Arrangement, By, Deposit, GrainSource, Grains, GrainsFile, Lattice, LogNormal, Material, Method,
    Placement, Radius, RandomBox, Rate, RosinRammler, Sieve, Sink, StateFile,
};
pub use origin::Origin;
pub use output::{Average, Output, PressureDrop, Probe, ProbeBox, ProbeLine};
pub use periodic::Periodic;
pub use schema::json_schema;
pub use simulation::Simulation;
pub use stop::{AtRest, Reached, Stop, Watch};
pub use voidage_coupling::error::{Location, SceneError};
pub use voidage_dem::{Cohesion, Conduction};
pub use voidage_fluid::transport::Form;
pub use voidage_remote::solver::{Backend, Solver, Transport};
pub use walls::{Motion, MotionTable, Oscillation, Ring, Rotation, Wall};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A whole scene.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// What the scene shows, one line. Default: empty.
    #[serde(default)]
    pub title: String,
    /// Gravity, m/s2: two numbers, along x and y.
    pub gravity: Coordinates,
    /// Step and end of the run.
    pub time: Time,
    /// Periodic sides: what leaves the domain at one side comes in at the opposite one. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub periodic: Option<Periodic>,
    /// What ends the run before `time.end`. Default: nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<Stop>,
    /// Materials of grains and walls, by name. Default: none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub materials: BTreeMap<String, Material>,
    /// Groups of grains, in the order in which they are numbered. Default: none, and then nothing of the grains is
    /// built.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grains: Vec<Grains>,
    /// Lines and boxes that remove grains. Grains that pass an open boundary of the fluid are removed anyway. Default:
    /// none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sinks: Vec<Sink>,
    /// Walls that the grains meet (the fluid has its own boundaries). Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<Wall>,
    /// How contacts between grains are solved. Default: the defaults of its keys when there are grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contacts: Option<Contacts>,
    /// The fluid. Default: none, and then no mesh is built.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fluid: Option<Fluid>,
    /// A droplet that boils in the fluid. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub droplet: Option<Droplet>,
    /// How grains and fluid act on each other. Default: the defaults of its keys when there are grains and a fluid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coupling: Option<Coupling>,
    /// Keys that change while the run goes on. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<Event>,
    /// What the run records. Default: the defaults of its keys.
    #[serde(default)]
    pub output: Output,
    /// Where the scene was read from: errors point into it.
    #[serde(skip)]
    #[schemars(skip)]
    pub origin: Origin,
}

/// A point or a vector of the plane or of space, as a list of 2 or 3 numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Coordinates(
    /// The numbers.
    pub Vec<f64>,
);

impl Coordinates {
    /// Whether none are given.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The same as a vector of `D` numbers; numbers that are missing are zero (validation has checked the length).
    pub fn vector<const D: usize>(&self) -> nalgebra::SVector<f64, D> {
        nalgebra::SVector::from_fn(|i, _| self.0.get(i).copied().unwrap_or(0.0))
    }
}

/// Keys that change at a time, as if the run were stopped at that time and restarted with these changes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// The time, s. The first step that starts at this time or later has the changes. Above 0, and not before that of the
    /// event before.
    pub time: f64,
    /// Changes `"KEY=VALUE"`, written as for `voidage run --set`: friction, rolling, restitution, cohesion, sources
    /// and sinks, schemes, laws of drag and heat transfer, conditions at boundaries of the fluid.
    pub set: Vec<String>,
}

/// Step and end of the run.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Time step, s. Above 0.
    pub step: f64,
    /// Time at which the run ends, s. At least one step. Between two steps the last one is shorter.
    pub end: f64,
}

impl Time {
    /// The number of steps that end at or just after `end` (rounding errors of the division forgiven).
    pub fn steps(&self) -> u64 {
        (self.end / self.step * (1.0 - 1e-12)).ceil() as u64
    }

    /// Length of the step after so many, s: the last one ends at `end`.
    pub fn length(&self, steps: u64) -> f64 {
        let left = self.end - steps as f64 * self.step;
        // Ends that are whole numbers of steps but for rounding keep the length, to the bit.
        let short = steps + 1 == self.steps() && left < self.step * (1.0 - 1e-9);
        if short { left } else { self.step }
    }

    /// Time after so many steps, s, also beyond the end. It is not their sum, whose last digits drift.
    pub fn after(&self, steps: u64) -> f64 {
        let last = self.steps();
        match steps.checked_sub(last).filter(|_| self.length(last - 1) < self.step) {
            Some(beyond) => self.end + beyond as f64 * self.step,
            None => steps as f64 * self.step,
        }
    }

    /// The step that ends nearest to a time: how many go up to there.
    pub fn nearest(&self, time: f64) -> u64 {
        let steps = (time / self.step).round() as u64;
        let away = |steps: u64| (self.after(steps) - time).abs();
        if away(steps + 1) < away(steps) { steps + 1 } else { steps }
    }
}

impl Scene {
    /// Number of space dimensions: the length of `gravity`.
    pub fn dimension(&self) -> usize {
        self.gravity.0.len()
    }

    /// Whether grains have temperatures.
    pub fn grains_have_heat(&self) -> bool {
        self.grains.iter().any(|group| group.temperature.is_some())
    }

    /// Whether the fluid has a temperature.
    pub fn fluid_has_heat(&self) -> bool {
        self.fluid.as_ref().is_some_and(|fluid| fluid.heat.is_some())
    }
}
