//! Steps in parts, around any scheme.
//!
//! A step in which a grain or a droplet moves far, or that ends in disagreement of grains and fluid, is put back and
//! done in halves, these in halves of their own, until a part is good, which is accepted. The next part is twice as
//! long again where that is not known to be too far and the whole step stays a multiple of it. The mesh moves with the
//! parts. What the grains, the walls and the boundary get in the step are the means over its parts. With a droplet no
//! part is more than twice as long as the one before, also across steps.
//!
//! Where a droplet moves so far that a cell of the mesh would turn over, the domain is remeshed first.

use super::Scheme;
pub use crate::parts::Part;
use crate::{Agreement, Mixture, StepReport, error::Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// When a step is done in parts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cutting {
    /// How far a grain may move in a part of a step, in its diameters. On the whole way the fluid acts on it as at the
    /// place where it was at the start of the part. Above 0. Default 0.25.
    pub travel: f64,
    /// With a droplet: how large the absorption number x (column `droplet_absorption_number`) may become in a part of a
    /// step. Heat that is taken in with grains boils water in the next part. This makes 1 - x times as much of a deviation of the velocity, which grows
    /// above 2. Above 0. Default 1.
    pub absorption: f64,
}

impl Default for Cutting {
    fn default() -> Self {
        Self { travel: 0.25, absorption: 1.0 }
    }
}

/// How often a step may be halved.
const HALVINGS: u32 = 6;

/// A scheme whose answer can be judged before it is accepted.
pub trait Trial<const D: usize>: Send {
    /// Solves fluid and grains for a part of a step. The grains stand at its end, and the fluid is not accepted.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh.
    fn solve(&mut self, mixture: &mut Mixture<D>, part: Part, report: &mut StepReport) -> Result<Agreement>;

    /// Whether a part that ends in disagreement is done in halves: not with a scheme that takes its only answer.
    fn repeats(&self) -> bool {
        false
    }

    /// Books what the grains got from an answer that is about to be accepted.
    fn settle(&mut self, _: &mut Mixture<D>, _: Part, agreement: Agreement) -> Agreement {
        agreement
    }
}

/// A scheme, with steps in parts where that is asked for.
pub struct Cut<T> {
    scheme: T,
    cutting: Option<Cutting>,
}

impl<T> Cut<T> {
    /// A scheme that does steps in parts by `cutting`, or whole.
    pub fn new(scheme: T, cutting: Option<Cutting>) -> Self {
        Self { scheme, cutting }
    }
}

impl<T: Trial<D>, const D: usize> Scheme<D> for Cut<T> {
    fn step(&mut self, mixture: &mut Mixture<D>, dt: f64) -> Result<StepReport> {
        let mut report = StepReport::default();
        // Counted in parts of the shortest length that there may be.
        let (most, travel, absorption) = self
            .cutting
            .map_or((1, f64::INFINITY, f64::INFINITY), |cut| (1 << HALVINGS, cut.travel, cut.absorption));
        let first = mixture
            .fluid
            .live_droplet()
            .map_or(most, |droplet| ((droplet.state.next * f64::from(most)) as u32).clamp(1, most));
        let (mut done, mut length, mut spent) = (0, first, 0);
        let (mut sum, mut grains) = (None::<Agreement>, None);
        let mut renewed = false;
        while done < most {
            let part = Part { dt: dt * f64::from(length) / f64::from(most), whole: dt };
            let droplet = mixture.fluid.live_droplet();
            let moves_mesh = droplet.is_some();
            if let Some(droplet) = droplet {
                droplet.part = part.dt / dt;
            }
            if length < most {
                mixture.begin_part(part.dt);
            }
            if length > 1 || moves_mesh {
                mixture.grains.save();
            }
            let accepted = mixture.interaction.at.clone();
            let mut agreement = match self.scheme.solve(mixture, part, &mut report) {
                Ok(agreement) => agreement,
                Err(error) => {
                    mixture.interaction.at = accepted;
                    return Err(error);
                }
            };
            // Grains of which one runs away have not moved.
            let runs_away = report.grains.is_some_and(|grains| grains.runaway.is_some());
            let (moved, absorbed) = mixture.droplet_reach(part.dt);
            agreement.travel = agreement.travel.max(moved);
            // How much of what a part may do this one has done.
            let used = (agreement.travel / travel).max(absorbed / absorption);
            let turned = mixture.turns_over(part.dt);
            let fits = matches!(turned, Ok(None));
            // Before a cell turns over the domain is remeshed, once, and the part done again.
            let renews = matches!(turned, Ok(Some(_))) && !renewed;
            let agrees = !runs_away && (agreement.converged || !self.scheme.repeats());
            let halves = length > 1 && !(agrees && used <= 1.0 && fits);
            if renews || halves {
                mixture.rewind_grains();
                mixture.move_mesh(|motion, time, points| motion.place(time, points));
                // The halves start from the last accepted fluid, not from an answer that was none.
                mixture.interaction.at = accepted;
                spent += agreement.solves;
                if renews {
                    mixture.renew(&mut report)?;
                    renewed = true;
                } else {
                    length /= 2;
                }
                continue;
            }
            if runs_away || !fits {
                // Nothing of this part is accepted.
                mixture.interaction.at = accepted;
                if moves_mesh {
                    mixture.rewind_grains();
                }
                return match turned {
                    Ok(None) => Ok(report),
                    Ok(Some(place)) => Err(mixture.fluid.too_far(part.dt, &place)),
                    Err(error) => Err(error),
                };
            }
            renewed = false;
            let agreement = self.scheme.settle(mixture, part, agreement);
            sum = Some(agreement.after(sum.as_ref(), std::mem::take(&mut spent)));
            // Parts that were not accepted do not count.
            grains = report.grains.map(|now| now.after(grains.as_ref()));
            mixture.accept_part(part, &mut report)?;
            done += length;
            // As long again as the parts that are left allow, unless that is known to be too far. A droplet boils over
            // the next part what it took in over this one, and is thrown if that has another length: so no part is more
            // than twice as long as the one before, nor as that takes more than half of what absorption allows.
            let mut next = 2.0 * used.max(2.0 * absorbed / absorption);
            let longest = if moves_mesh { (2 * length).min(most) } else { most };
            while length < longest && done % (2 * length) == 0 && next <= 1.0 {
                (length, next) = (2 * length, 2.0 * next);
            }
        }
        if let Some(droplet) = mixture.fluid.live_droplet() {
            droplet.state.next = f64::from(length) / f64::from(most);
        }
        (report.agreement, report.grains) = (sum, grains);
        mixture.end_step(&mut report);
        Ok(report)
    }
}
