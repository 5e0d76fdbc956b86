//! Coupling schemes: what the grains are expected to do while the fluid is solved.
//!
//! The fluid never knows the scheme. For each grain it gets the affine law of the velocity that the grain will
//! have, v* = b + a f with f = gamma u - V grad p; the force on the grain is f - gamma v*, and the fluid gets the
//! opposite by the same law, so momentum is conserved to round-off. Heat likewise. Schemes differ in a and b:
//!
//! | scheme | law | grains move by |
//! |---|---|---|
//! | [`explicit`] | a = 0, b = v_n | the force of the law |
//! | [`henry`] | the motion of a free grain under the last contact force, or under none | the force of the law |
//! | [`lagged`] | the same without contacts; the solid flux from v_n | the force of the law |
//! | [`anchored`] | the response of the grains, contacts included, and its slope | f and implicit drag |
//! | [`iterated`] | the same, again until grains and fluid agree | f and implicit drag |

pub mod anchored;
pub mod cut;
pub mod explicit;
pub mod henry;
pub mod iterated;
pub mod lagged;
pub mod relaxation;

use self::cut::{Cut, Cutting};
use self::iterated::{Iterated, Iteration};
use crate::agreement::{Agreement, Comparison, Temperatures};
use crate::droplet::wet::Stream;
use crate::{Interaction, Mixture, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_dem::Dem;

/// A coupling scheme: one step of grains and fluid together.
pub trait Scheme<const D: usize>: Send {
    /// Advances the mixture by `dt`, with the phases that it has; the mesh is where it is at the end of the step.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh.
    fn step(&mut self, mixture: &mut Mixture<D>, dt: f64) -> Result<StepReport>;
}

/// Schemes by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SchemeName {
    /// The drag is implicit in the velocity of the fluid and takes the last velocities of the grains (A.16).
    Explicit,
    /// The velocities of the grains are predicted with the contact forces of the last step (A.18 as printed).
    Henry,
    /// The velocities of the grains are predicted without contact forces.
    HenryFree,
    /// As `henry-free` in the equation of momentum; the equation of mass takes the last velocities of the grains.
    Lagged,
    /// The grains are moved on trial first, contacts included, and the fluid is solved once with their response.
    Anchored,
    /// As `anchored`, repeated until fluid and grains agree.
    #[default]
    Iterated,
}

impl SchemeName {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Explicit, Self::Henry, Self::HenryFree, Self::Lagged, Self::Anchored, Self::Iterated];

    /// The name in scenes and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Explicit => "explicit",
            Self::Henry => "henry",
            Self::HenryFree => "henry-free",
            Self::Lagged => "lagged",
            Self::Anchored => "anchored",
            Self::Iterated => "iterated",
        }
    }

    /// The scheme of this name; `iteration` is for [`Self::Iterated`] only. Steps are done in parts by `cutting`, or
    /// whole.
    pub fn build<const D: usize>(
        self,
        iteration: &Iteration,
        cutting: Option<Cutting>,
    ) -> Box<dyn Scheme<D>> {
        match self {
            Self::Explicit => Box::new(Cut::new(explicit::Explicit, cutting)),
            Self::Henry => Box::new(Cut::new(henry::Henry { contacts: true }, cutting)),
            Self::HenryFree => Box::new(Cut::new(henry::Henry { contacts: false }, cutting)),
            Self::Lagged => Box::new(Cut::new(lagged::Lagged, cutting)),
            Self::Anchored => Box::new(Cut::new(Iterated::new(Iteration::once()), cutting)),
            Self::Iterated => Box::new(Cut::new(Iterated::new(iteration.clone()), cutting)),
        }
    }
}

impl std::fmt::Display for SchemeName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Solves the fluid once, with the law that `predict` fills, and moves the grains by the force of the law.
fn once<const D: usize>(
    mixture: &mut Mixture<D>,
    dt: f64,
    report: &mut StepReport,
    predict: impl FnOnce(&Dem<D>, &mut Interaction<D>, Option<Stream<D>>),
) -> Result<Agreement> {
    mixture.cut_grains(report)?;
    mixture.evaluate_closures(dt, report)?;
    // A scheme before this one may have left a law of its own for the solid flux, and what it carried.
    (mixture.interaction.load.continuity, mixture.interaction.carried) = (None, None);
    let stream = mixture.fluid.droplet.as_ref().map(|droplet| droplet.stream());
    predict(&mixture.grains, &mut mixture.interaction, stream);
    mixture.solve_fluid(dt, report)?;
    mixture.move_grains(dt, report);
    Ok(agreement(mixture, dt))
}

/// How far grains that moved by the force of the law are from it.
fn agreement<const D: usize>(mixture: &Mixture<D>, dt: f64) -> Agreement {
    let (grains, Interaction { load, at, laws, force, .. }) = (&mixture.grains, &mixture.interaction);
    let velocity = &grains.particles.velocity;
    let comparison = Comparison { grains, load, density: laws.density, dt, force };
    let mut agreement = comparison.motion(|i| {
        ((load.expected(at, i) - velocity[i]) * load.drag[i], load.expected_in_flux(at, i) - velocity[i])
    });
    if let (Some(law), Some(heat)) = (&load.heat, &grains.particles.heat) {
        let temperatures = Temperatures::of(at, &heat.temperature, mixture.interaction.heat_tolerance);
        agreement.heat_disagreement =
            temperatures.disagreement(law, |i| law.missed(at, heat.temperature[i], i));
    }
    Agreement { converged: Iteration::default().accepts(&agreement), ..agreement }
}
