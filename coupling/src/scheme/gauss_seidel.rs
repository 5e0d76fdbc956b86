//! Gauss-Seidel iteration with Aitken's relaxation, the plain partitioned coupling: the fluid is solved among grains that keep
//! the velocity of their last response, the grains respond to the fluid, and so on until both agree.
//!
//! It is [`super::iterated`] with laws without slope, theta = 0 in momentum and flux. One iteration multiplies the error of
//! shear by s tau and that of compression by -(X + Y) tau ([`super::anchored`] has the letters), which grows without bound for
//! light grains and long steps. Aitken's omega is the secant of the last two residuals (Irons and Tuck 1969), so that a
//! single mode of any factor is solved by the third iteration; of n modes with different factors as many more are needed, and
//! where compression and shear are far apart none may be enough. A step that agrees is that of `iterated`: both are the
//! implicit solution to their tolerance.

use super::cut::{Part, Trial};
use super::iterated::{Iterated, Iteration};
use super::relaxation::Relaxation;
use crate::{Agreement, Mixture, StepReport, error::Result};

/// The scheme.
pub struct GaussSeidel<const D: usize>(Iterated<D>);

impl<const D: usize> GaussSeidel<D> {
    /// The scheme with these settings; its relaxation is Aitken's unless another one is given.
    pub fn new(iteration: Iteration) -> Self {
        let relaxation = iteration.relaxation.or(Some(Relaxation::Aitken));
        Self(Iterated::without_slopes(Iteration { relaxation, ..iteration }))
    }
}

impl<const D: usize> Trial<D> for GaussSeidel<D> {
    fn solve(&mut self, mixture: &mut Mixture<D>, part: Part, report: &mut StepReport) -> Result<Agreement> {
        self.0.solve(mixture, part, report)
    }

    fn repeats(&self) -> bool {
        Trial::<D>::repeats(&self.0)
    }

    fn settle(&mut self, mixture: &mut Mixture<D>, part: Part, agreement: Agreement) -> Agreement {
        self.0.settle(mixture, part, agreement)
    }
}
