//! Remeshing of domains whose mesh has moved far: nodes inside get new places between those of the boundary, and the
//! fields interpolated.
//!
//! The step that follows solves its equations on the new mesh, so that what flows in flows out as before. What
//! interpolation loses of momentum and heat is of second order in the mesh.

use crate::overlap::Overlap;
use crate::{Clock, Coupled, Fluid, Mixture, Result, StepReport};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Instant;
use voidage_fluid::flow::State;
use voidage_fluid::mesh::{Rectangle, Remeshed};
use voidage_fluid::{Mesh, Vector};

/// When a domain is remeshed.
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

/// What remeshes a domain.
#[derive(Clone, Debug)]
pub struct Remesher<const D: usize> {
    when: Remesh,
    /// Lengths that edges should have, by node, m; beside a droplet they are shorter.
    spacing: Vec<f64>,
    /// The domain without its droplet, if it says how long edges should be: what is finer around a droplet then follows
    /// it exactly.
    domain: Option<Rectangle>,
    /// Step after which the mesh was last made.
    last: u64,
    /// Whether it was made on the way.
    made: bool,
    /// What the transfer of the fields has changed since time zero.
    pub changed: Changed<D>,
    tools: Tools<D>,
}

/// By how much interpolation to new meshes has changed the integrals of the fields. The volume stays, as the boundary
/// does; the gas that takes the place of a droplet that vanishes does not count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Changed<const D: usize> {
    /// Of the velocity, m3/s (m4/s in space).
    pub velocity: Vector<D>,
    /// Of each scalar, its unit times m2 (m3 in space).
    pub scalars: Vec<f64>,
}

impl<const D: usize> Changed<D> {
    fn nothing() -> Self {
        Self { velocity: Vector::zeros(), scalars: vec![] }
    }

    /// Adds the integrals of fields, times a sign.
    fn add(&mut self, sign: f64, nodal_volume: &[f64], fields: &State<D>) {
        let each = fields.velocity.iter().zip(nodal_volume);
        self.velocity += each.map(|(u, volume)| u * *volume).sum::<Vector<D>>() * sign;
        self.scalars.resize(fields.scalars.len(), 0.0);
        for (sum, values) in self.scalars.iter_mut().zip(&fields.scalars) {
            *sum += sign * values.iter().zip(nodal_volume).map(|(s, volume)| s * volume).sum::<f64>();
        }
    }
}

/// What depends on the dimension.
#[derive(Clone, Copy, Debug)]
struct Tools<const D: usize> {
    /// With a hole filled, if one is named.
    make: fn(&Mesh<D>, &[f64], Option<&str>) -> voidage_fluid::Result<Remeshed<D>>,
    /// Smallest angle, degrees.
    angle: fn(&Mesh<D>) -> f64,
}

/// The mesh of a domain that was remeshed on the way, as a checkpoint has it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RemeshState<const D: usize> {
    mesh: Mesh<D>,
    motion: Vec<f64>,
    spacing: Vec<f64>,
    last: u64,
    changed: Changed<D>,
}

impl Remesher<2> {
    /// Remeshes a domain with edges as long as they are now.
    pub fn new(mesh: &Mesh<2>, when: Remesh) -> Self {
        let tools = Tools { make: Mesh::<2>::fill, angle: |mesh| mesh.quality().smallest_angle };
        Self {
            when,
            spacing: mesh.spacing(),
            domain: None,
            last: 0,
            made: false,
            changed: Changed::nothing(),
            tools,
        }
    }

    /// The same for a domain with a droplet: `domain` says how long edges should be without it.
    pub fn around_droplet(mesh: &Mesh<2>, domain: Option<Rectangle>, when: Remesh) -> Self {
        Self { domain, ..Self::new(mesh, when) }
    }
}

impl<const D: usize> Fluid<D> {
    /// Remeshes the domain if it is time; returns whether it was.
    fn remesh(&mut self) -> Result<bool> {
        let Some(remesher) = &mut self.remesher else { return Ok(false) };
        let gone = self.droplet.as_ref().is_some_and(|droplet| droplet.state.gone);
        if gone && self.motion.is_none() {
            // Nothing moves the mesh any more.
            return Ok(false);
        }
        let Remesher { when, tools, last, .. } = remesher;
        let vanishes = self.droplet.as_ref().is_some_and(|droplet| droplet.vanishes());
        // A restart with a longer step counts fewer of them.
        let early = self.clock.steps.saturating_sub(*last) < when.every;
        if early && (tools.angle)(&self.mesh) >= when.angle && !vanishes {
            return Ok(false);
        }
        self.make_mesh(vanishes)?;
        Ok(true)
    }

    /// Remeshes the domain before a cell turns over, with the fields that are accepted.
    pub(crate) fn renew(&mut self, report: &mut StepReport) -> Result<()> {
        if self.remesher.is_none() {
            return Ok(());
        }
        let start = Instant::now();
        self.make_mesh(false)?;
        report.remeshed = true;
        report.phases.remesh += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Remeshes the domain, without a droplet that vanishes.
    fn make_mesh(&mut self, vanishes: bool) -> Result<()> {
        let Some(remesher) = &mut self.remesher else { return Ok(()) };
        let (tools, Clock { time, steps }) = (remesher.tools, self.clock);
        if let Some(droplet) = &self.droplet {
            let wanted = self.mesh.points.iter().zip(&mut remesher.spacing);
            wanted.for_each(|(x, spacing)| {
                let far = remesher.domain.as_ref().map_or(*spacing, |domain| domain.size_at([x[0], x[1]]));
                *spacing = if droplet.state.gone { far } else { far.min(droplet.spacing(x)) };
            });
        }
        let hole = self.droplet.as_ref().filter(|_| vanishes).map(|droplet| droplet.boundary.as_str());
        let remeshed = (tools.make)(&self.mesh, &remesher.spacing, hole)?;
        let old = &self.accepted;
        let fields = State {
            velocity: remeshed.carry(&old.velocity),
            pressure: remeshed.carry(&old.pressure),
            scalars: old.scalars.iter().map(|old| remeshed.carry(old)).collect(),
        };
        remesher.spacing = remeshed.carry(&remesher.spacing);
        (remesher.last, remesher.made) = (steps, true);
        if !vanishes {
            remesher.changed.add(-1.0, &self.nodal_volume, old);
            remesher.changed.add(1.0, &remeshed.mesh.nodal_volume(), &fields);
        }
        if let Some(motion) = &mut self.motion {
            motion.remeshed(&remeshed, time);
        }
        match &mut self.droplet {
            Some(droplet) if vanishes => {
                droplet.vanish();
                self.conditions.retain(|condition| condition.boundary != droplet.boundary);
            }
            Some(droplet) if !droplet.state.gone => droplet.remeshed(&remeshed.mesh)?,
            _ => {}
        }
        self.set_mesh(remeshed.mesh, fields)
    }

    /// The mesh, if the domain has been remeshed or has a droplet, which moves as the run goes.
    pub fn remesh_state(&self) -> Option<RemeshState<D>> {
        let remesher = self.remesher.as_ref();
        let Remesher { spacing, last, changed, .. } =
            remesher.filter(|remesher| remesher.made || self.droplet.is_some())?;
        let motion = match (&self.motion, &self.droplet) {
            (Some(motion), _) => motion.state(),
            (None, Some(droplet)) if !droplet.state.gone => droplet.motion(),
            _ => Vec::new(),
        };
        Some(RemeshState {
            mesh: self.mesh.clone(),
            motion,
            spacing: spacing.clone(),
            last: *last,
            changed: changed.clone(),
        })
    }

    fn take_remeshed(&mut self, state: RemeshState<D>) -> Result<()> {
        if let Some(remesher) = &mut self.remesher {
            (remesher.spacing, remesher.last, remesher.made) = (state.spacing, state.last, true);
            remesher.changed = state.changed;
            (self.mesh, self.moved) = (state.mesh, true);
            if let Some(motion) = &mut self.motion {
                motion.restore(&state.motion);
            }
            if let Some(droplet) = self.droplet.as_mut().filter(|droplet| !droplet.state.gone) {
                droplet.restore(&self.mesh, &state.motion)?;
            }
            self.nodal_volume = self.mesh.nodal_volume();
        }
        Ok(())
    }
}

impl<const D: usize> Mixture<D> {
    /// Remeshes the domain before a cell turns over.
    pub(crate) fn renew(&mut self, report: &mut StepReport) -> Result<()> {
        let done = self.fluid.renew(report);
        // Also where the solver fails to take the mesh: it is that of the fluid now.
        self.search_again()?;
        done
    }

    /// Grains are looked for on the mesh of now.
    fn search_again(&mut self) -> Result<()> {
        self.interaction.overlap = Overlap::new(&self.fluid.mesh)?;
        Ok(())
    }
}

impl<const D: usize> Coupled<D> {
    /// Remeshes the domain if it is time; the end of every step.
    ///
    /// # Errors
    /// No mesh fits into its boundary; the solver cannot be reached.
    pub fn remesh(&mut self, report: &mut StepReport) -> Result<()> {
        let start = Instant::now();
        let done = self.fluid_mut().map_or(Ok(false), Fluid::remesh);
        if let Ok(false) = done {
            return Ok(());
        }
        // Also where the solver fails to take the mesh: it is that of the fluid now.
        if let Some(mixture) = self.mixture_mut() {
            mixture.search_again()?;
        }
        done?;
        report.remeshed = true;
        report.phases.remesh += start.elapsed().as_secs_f64();
        self.mixture_mut().map_or(Ok(()), |mixture| mixture.cut_grains(report))
    }

    /// Takes the mesh of a checkpoint.
    ///
    /// # Errors
    /// A mesh that cannot be searched.
    pub fn take_remeshed(&mut self, state: RemeshState<D>) -> Result<()> {
        if let Some(fluid) = self.fluid_mut() {
            fluid.take_remeshed(state)?;
        }
        self.mixture_mut().map_or(Ok(()), Mixture::search_again)
    }
}
