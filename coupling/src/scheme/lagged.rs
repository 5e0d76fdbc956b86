//! What most codes of this kind do: drag implicit in both velocities, the solid flux from the last velocities.
//!
//! In a closed box (1 + K) v' = (1 - r - K phi/eps) v + r v_old, stable iff r < 1 + K and 2 + K - 2 r - K phi/eps > 0:
//! at small voidage no step is small enough. r = (rho_f/rho_p)(phi/eps), K = beta dt/(eps phi rho_p), beta the drag per
//! volume and slip.

use super::cut::{Part, Trial};
use super::{explicit, henry, once};
use crate::{Agreement, Mixture, StepReport, error::Result};

/// The lagged scheme.
pub struct Lagged;

impl<const D: usize> Trial<D> for Lagged {
    fn solve(
        &mut self,
        mixture: &mut Mixture<D>,
        Part { dt, .. }: Part,
        report: &mut StepReport,
    ) -> Result<Agreement> {
        once(mixture, dt, report, |grains, interaction, stream| {
            henry::predict(grains, interaction, false, dt, stream);
            let flux = interaction.load.continuity.get_or_insert_default();
            explicit::freeze(grains, &mut flux.mobility, &mut flux.velocity);
        })
    }
}
