//! Meshes that move, made anew when they have gone far: nodes inside are placed anew between those of the boundary, and the
//! fields interpolated.
//!
//! The step that follows solves its equations on the new mesh, so that what flows in flows out as before. What interpolation
//! loses of momentum and heat is of second order in the mesh.

use crate::motion::Swing;
use crate::overlap::Overlap;
use crate::{Clock, Coupled, Fluid, Mixture, Result, StepReport};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Instant;
use voidage_fluid::Mesh;
use voidage_fluid::flow::State;
use voidage_fluid::mesh::Renewed;

/// When a mesh is made anew.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Remesh {
    /// Steps after which it is. At least 1. Default 25.
    pub every: u64,
    /// Smallest angle of its cells below which it is at once, degrees. From 0 to 25. Default 15.
    pub angle: f64,
}

impl Default for Remesh {
    fn default() -> Self {
        Self { every: 25, angle: 15.0 }
    }
}

/// A mesh that is made anew.
#[derive(Clone, Debug)]
pub struct Renewal<const D: usize> {
    when: Remesh,
    /// Lengths that edges should have, by node, m.
    spacing: Vec<f64>,
    /// Step after which the mesh was last made.
    last: u64,
    tools: Tools<D>,
}

/// What depends on the dimension.
#[derive(Clone, Copy, Debug)]
struct Tools<const D: usize> {
    make: fn(&Mesh<D>, &[f64]) -> voidage_fluid::Result<Renewed<D>>,
    /// Smallest angle, degrees.
    angle: fn(&Mesh<D>) -> f64,
}

/// A mesh that was made anew on the way, as a checkpoint has it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Anew<const D: usize> {
    mesh: Mesh<D>,
    motion: Option<Swing<D>>,
    spacing: Vec<f64>,
    last: u64,
}

impl Renewal<2> {
    /// Makes a mesh anew, with edges as long as they are now.
    pub fn new(mesh: &Mesh<2>, when: Remesh) -> Self {
        let tools = Tools { make: Mesh::<2>::renew, angle: |mesh| mesh.quality().smallest_angle };
        Self { when, spacing: mesh.spacing(), last: 0, tools }
    }
}

impl<const D: usize> Fluid<D> {
    /// Makes the mesh anew if it is time; returns whether it was.
    fn renew_mesh(&mut self) -> Result<bool> {
        let Some(renewal) = &mut self.renewal else { return Ok(false) };
        let Renewal { when, tools, .. } = *renewal;
        let Clock { time, steps } = self.clock;
        if steps - renewal.last < when.every && (tools.angle)(&self.mesh) >= when.angle {
            return Ok(false);
        }
        let renewed = (tools.make)(&self.mesh, &renewal.spacing)?;
        let old = &self.accepted;
        let fields = State {
            velocity: renewed.carry(&old.velocity),
            pressure: renewed.carry(&old.pressure),
            scalars: old.scalars.iter().map(|old| renewed.carry(old)).collect(),
        };
        renewal.spacing = renewed.carry(&renewal.spacing);
        renewal.last = steps;
        self.motion = self.motion.as_ref().map(|motion| motion.renewed(&renewed, time));
        self.set_mesh(renewed.mesh, fields)?;
        Ok(true)
    }

    /// The mesh, if it has been made anew.
    pub(crate) fn anew(&self) -> Option<Anew<D>> {
        let Renewal { spacing, last, .. } = self.renewal.as_ref().filter(|renewal| renewal.last > 0)?;
        let (mesh, motion) = (self.mesh.clone(), self.motion.clone());
        Some(Anew { mesh, motion, spacing: spacing.clone(), last: *last })
    }

    fn take_anew(&mut self, anew: Anew<D>) {
        if let Some(renewal) = &mut self.renewal {
            (renewal.spacing, renewal.last) = (anew.spacing, anew.last);
            (self.mesh, self.motion, self.moved) = (anew.mesh, anew.motion, true);
        }
    }
}

impl<const D: usize> Mixture<D> {
    /// Grains are looked for on the mesh of now.
    fn search_anew(&mut self) -> Result<()> {
        self.interaction.overlap = Overlap::new(&self.fluid.mesh)?;
        Ok(())
    }
}

impl<const D: usize> Coupled<D> {
    /// Makes the mesh anew if it is time; the end of every step.
    ///
    /// # Errors
    /// No mesh fits into its boundary; the solver cannot be reached.
    pub fn renew_mesh(&mut self, report: &mut StepReport) -> Result<()> {
        let start = Instant::now();
        report.renewed = self.fluid_mut().map_or(Ok(false), Fluid::renew_mesh)?;
        if !report.renewed {
            return Ok(());
        }
        report.phases.remesh += start.elapsed().as_secs_f64();
        let Some(mixture) = self.mixture_mut() else { return Ok(()) };
        mixture.search_anew()?;
        mixture.cut_grains(report)
    }

    /// Takes the mesh of a checkpoint.
    ///
    /// # Errors
    /// A mesh that cannot be searched.
    pub(crate) fn take_anew(&mut self, anew: Anew<D>) -> Result<()> {
        if let Some(fluid) = self.fluid_mut() {
            fluid.take_anew(anew);
        }
        self.mixture_mut().map_or(Ok(()), Mixture::search_anew)
    }
}
