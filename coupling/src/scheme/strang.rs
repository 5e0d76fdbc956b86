//! Strang's splitting: the grains take half a step in the last fluid, the fluid a whole one among grains that keep their
//! velocity, the grains the other half in the new fluid (Strang 1968). Drag is implicit in the velocity of the grains in
//! each half, and in that of the fluid.
//!
//! With A = beta dt/(eps rho_f), B = beta dt/(phi rho_p), r = (rho_f/rho_p)(phi/eps) and q = 1/(1 + B/2), beta the drag
//! per volume and slip:
//!
//! *Slip without constraint*: v_h = q v + (1 - q) u, u' = (u + A v_h)/(1 + A) and v' = q v_h + (1 - q) u', so that v - u
//! is multiplied by q^2/(1 + A): stable for all steps.
//!
//! *A closed box*: with the forcing f = gamma u - V grad p in the units of gamma,
//!
//! ```text
//!     v_h = q v + (1 - q) f,   u' = -(phi/eps) v_h,   f' = -(r/B)(v_h - v_h_old) - (phi/eps^2)(1 + eps) v_h,
//!     v'  = q v_h + (1 - q) f'.
//! ```
//!
//! Between two solutions the grains take two halves under the same f', so that v_h' = q^2 v_h + (1 - q^2) f': the mode of
//! [`super::sub_cycled`] with two steps of the grains, which grows where that one does. The splitting gives a second order in
//! time where both halves have it. The fluid and the drag here are of first order.
//!
//! **Momentum.** What the grains get in their halves beyond what the fluid loses is carried, and given back by half in each
//! step as in [`super::anchored`], but for the pressure: the fluid of one solution drives the second half of its step and the
//! first half of the next one, so that each pressure acts for a whole step. Its halves given back one by one, through a drag
//! that is small in a short step, would grow where the fluid is not much lighter than the grains.
//!
//! **The first step** of the first grains begins with a solution that is not accepted: the first half has a pressure then,
//! without which a grain in a liquid would fall half a step without buoyancy.

use super::anchored::{Forcing, RETURNED};
use super::cut::{Part, Trial};
use super::{carry, expect_frozen};
use crate::motions::Lost;
use crate::{Agreement, Mixture, StepReport, error::Result};

/// The scheme.
#[derive(Default)]
pub struct Strang<const D: usize> {
    forcing: Forcing<D>,
    lost: Lost<D>,
}

impl<const D: usize> Strang<D> {
    /// Half a step of the grains in the fluid as it is.
    fn advance(&mut self, mixture: &mut Mixture<D>, dt: f64, report: &mut StepReport) -> Result<()> {
        mixture.evaluate_closures(dt, report)?;
        self.forcing.read(mixture);
        mixture.drive_grains(dt, &self.forcing, report)
    }
}

impl<const D: usize> Trial<D> for Strang<D> {
    fn solve(
        &mut self,
        mixture: &mut Mixture<D>,
        Part { dt, whole }: Part,
        report: &mut StepReport,
    ) -> Result<Agreement> {
        mixture.cut_grains(report)?;
        let begun = |carried: &crate::Carried<D>| carried.lags.is_empty() || carried.lags.contains(&true);
        if !mixture.interaction.carried.as_ref().is_some_and(begun) {
            mixture.evaluate_closures(dt, report)?;
            expect_frozen(mixture, dt);
            mixture.solve_fluid(dt, report)?;
        }
        self.advance(mixture, 0.5 * dt, report)?;
        if report.grains.is_some_and(|grains| grains.runaway.is_some()) {
            return Ok(Agreement::default());
        }
        mixture.cut_grains(report)?;
        mixture.evaluate_closures(dt, report)?;
        expect_frozen(mixture, dt);
        mixture.give_back(RETURNED, whole);
        mixture.solve_fluid(dt, report)?;
        self.lost.read(&mixture.interaction);
        self.advance(mixture, 0.5 * dt, report)?;
        Ok(mixture.compare(&self.lost, dt))
    }

    fn settle(&mut self, mixture: &mut Mixture<D>, part: Part, agreement: Agreement) -> Agreement {
        carry(mixture, &self.lost, part, agreement)
    }
}
