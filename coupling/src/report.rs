//! What a step reports: wall time by phase, and how far each part fell short.

use crate::Agreement;

/// Wall time of the phases of a step, s.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Phases {
    /// Grains cut by the mesh, nodal voidage.
    pub overlap: f64,
    /// Drag and heat-transfer laws.
    pub closure: f64,
    /// Energy equation of the fluid.
    pub energy: f64,
    /// Momentum and mass of the fluid.
    pub flow: f64,
    /// What a step of the fluid solver takes beyond its equations: sampling at the grains, sums of the exchange.
    pub exchange: f64,
    /// Frames to and from a fluid solver in another process.
    pub transport: f64,
    /// Contacts and motion of the grains.
    pub contacts: f64,
    /// Remeshing.
    pub remesh: f64,
}

impl Phases {
    /// The phases by name.
    pub fn named(&self) -> [(&'static str, f64); 8] {
        [
            ("overlap", self.overlap),
            ("closure", self.closure),
            ("energy", self.energy),
            ("flow", self.flow),
            ("exchange", self.exchange),
            ("transport", self.transport),
            ("contacts", self.contacts),
            ("remesh", self.remesh),
        ]
    }

    /// What the fluid solver took beyond these times of before.
    pub(crate) fn of_solver_since(&self, before: &Phases) -> f64 {
        (self.energy - before.energy) + (self.flow - before.flow) + (self.transport - before.transport)
    }

    /// Adds the times of another step.
    pub fn add(&mut self, other: &Phases) {
        self.overlap += other.overlap;
        self.closure += other.closure;
        self.energy += other.energy;
        self.flow += other.flow;
        self.exchange += other.exchange;
        self.transport += other.transport;
        self.contacts += other.contacts;
        self.remesh += other.remesh;
    }
}

/// What a step of the coupled system reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepReport {
    /// Wall time by phase.
    pub phases: Phases,
    /// The grains; absent without.
    pub grains: Option<voidage_dem::StepReport>,
    /// The fluid solver; absent without.
    pub fluid: Option<voidage_fluid::flow::Report>,
    /// |impulse that the grains got - impulse that the fluid lost at its points - change of what is carried to the next
    /// step| over the sum of |impulse| of the grains, or a thousandth of the sum of |gamma u| + |gamma v| if that is
    /// more; with both only. The worst part of the step.
    pub momentum_exchange_defect: Option<f64>,
    /// The same for heat; with heat in both only.
    pub energy_exchange_defect: Option<f64>,
    /// Share of the solid volume that lies outside of the mesh, so that the fluid does not meet it; with both only.
    pub solid_volume_defect: Option<f64>,
    /// Solid volume that came into the mesh in the step otherwise than by moving within it, less what went, m3 (m2 in
    /// the plane); with both only.
    pub appeared: Option<f64>,
    /// The source that had no place for most grains that were due, by number, and how many.
    pub waiting: Option<(usize, u64)>,
    /// How far the grains are from what the fluid expected; with both only.
    pub agreement: Option<Agreement>,
    /// Whether the domain was remeshed after the step.
    pub remeshed: bool,
}

impl StepReport {
    /// Largest relative residual of the solvers.
    pub fn residual(&self) -> f64 {
        let grains = self.grains.map_or(0.0, |grains| grains.residual);
        self.fluid.map_or(grains, |fluid| grains.max(fluid.residual))
    }
}
