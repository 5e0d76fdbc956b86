//! Coupling schemes: what the grains are expected to do while the fluid is solved.
//!
//! A scheme fills the mobility and velocity columns of the load and turns the answer of the fluid into forces.
//! With v* = b + a (gamma u - V grad p) the force on a grain is F = -V grad p + gamma (u - v*); the fluid got
//! the opposite by the same law, so momentum is conserved to round-off whatever the scheme. Heat likewise.

use crate::{Coupled, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_fluid::Vector;

/// A coupling scheme: one step of grains and fluid together.
pub trait Scheme<const D: usize>: Send {
    /// Advances the coupled system by `dt`.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh.
    fn step(&mut self, coupled: &mut Coupled<D>, dt: f64) -> Result<StepReport>;
}

/// Schemes by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SchemeName {
    /// a = 0, b = v_n: drag implicit in the fluid velocity only (A.16). Unstable where the fluid is heavy or
    /// the drag stiff: stable in a closed box for r < 1 and K < 2 eps (1 - r), physics.md section 8.
    Explicit,
    /// Predicted velocity with the contact force of the last step, A.18 as printed.
    #[default]
    Henry,
    /// Predicted velocity without contact forces.
    HenryFree,
}

impl SchemeName {
    /// The scheme of this name.
    pub fn build<const D: usize>(self) -> Box<dyn Scheme<D>> {
        Box::new(SinglePass { law: self })
    }
}

/// Schemes that solve the fluid once per step.
struct SinglePass {
    law: SchemeName,
}

impl<const D: usize> Scheme<D> for SinglePass {
    fn step(&mut self, coupled: &mut Coupled<D>, dt: f64) -> Result<StepReport> {
        let mut report = StepReport::default();
        coupled.cut_grains(&mut report)?;
        coupled.evaluate_closures(&mut report);
        self.predict(coupled, dt);
        coupled.solve_fluid(dt, &mut report)?;
        coupled.move_grains(dt, &mut report);
        coupled.accept(dt);
        Ok(report)
    }
}

impl SinglePass {
    /// Fills the velocity and temperature laws of the load.
    fn predict<const D: usize>(&self, coupled: &mut Coupled<D>, dt: f64) {
        let (Some(grains), Some(interaction)) = (&coupled.grains, &mut coupled.interaction) else { return };
        let particles = &grains.particles;
        let gravity = grains.settings().gravity;
        let contact = grains.contact_force();
        let load = &mut interaction.load;
        for i in 0..particles.position.len() {
            let force = match self.law {
                SchemeName::Henry => contact[i],
                SchemeName::Explicit | SchemeName::HenryFree => Vector::zeros(),
            };
            let inertia = particles.mass[i] / dt;
            // A held grain (infinite mass) keeps its velocity whatever the fluid does.
            let free = self.law != SchemeName::Explicit && inertia.is_finite();
            (load.mobility[i], load.velocity[i]) = if free {
                let mobility = 1.0 / (inertia + load.drag[i]);
                let push = particles.velocity[i] * inertia + gravity * particles.mass[i] + force;
                (mobility, push * mobility)
            } else {
                (0.0, particles.velocity[i])
            };
        }
        let (Some(heat), Some(particle_heat)) = (&mut load.heat, &particles.heat) else { return };
        let conducted = grains.contact_heat();
        for i in 0..particles.position.len() {
            let old = particle_heat.temperature[i];
            (heat.mobility[i], heat.temperature[i]) = if self.law == SchemeName::Explicit {
                (0.0, old)
            } else {
                let inertia = particle_heat.capacity[i] / dt;
                let mobility = 1.0 / (inertia + heat.coefficient[i]);
                let conducted = conducted.get(i).copied().unwrap_or(0.0);
                (mobility, mobility * (inertia * old + conducted))
            };
        }
    }
}
