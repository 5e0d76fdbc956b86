//! How far grains and fluid are from each other at the end of a step, and what is carried to the next.

use crate::exchange::AtGrains;
use crate::load::{GrainLoad, HeatLoad};
use crate::{Interaction, Notice};
use serde::{Deserialize, Serialize};
use voidage_dem::{Dem, Vector};

/// What the fluid still has to make up for of the last steps, because the grains moved otherwise than it expected.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Carried<const D: usize> {
    /// gamma (v* - v) dt, N s by grain: what the grains got beyond what the fluid lost.
    pub impulse: Vec<Vector<D>>,
    /// (v* - v) dt with v* of the solid flux, m by grain: by how much the equation of mass moved the grains further
    /// than they moved.
    pub displacement: Vec<Vector<D>>,
    /// hA (T* - T) dt, J by grain; empty without heat.
    pub heat: Vec<f64>,
    /// Whether a grain moves before the fluid is solved, so that its impulse lags by that of a pressure.
    pub(crate) lags: Vec<bool>,
    /// Sums of impulse (N s) and heat (J) at the last accepted part of a step.
    accepted: (Vector<D>, f64),
}

impl<const D: usize> Carried<D> {
    /// Nothing, as yet.
    pub fn none(grains: usize, heat: bool) -> Self {
        let none = vec![Vector::zeros(); grains];
        Self {
            impulse: none.clone(),
            displacement: none,
            heat: vec![0.0; if heat { grains } else { 0 }],
            lags: vec![false; grains],
            accepted: (Vector::zeros(), 0.0),
        }
    }

    /// Takes what is carried of a grain: impulse (N s) and heat (J). Its displacement is dropped: no fluid is to make
    /// room for it.
    pub(crate) fn take(&mut self, grain: usize) -> (Vector<D>, f64) {
        self.displacement[grain] = Vector::zeros();
        let impulse = std::mem::replace(&mut self.impulse[grain], Vector::zeros());
        (impulse, self.heat.get_mut(grain).map_or(0.0, std::mem::take))
    }

    /// From now on the impulse of a grain lags by this one, N s, which is no debt of the fluid.
    pub(crate) fn lag(&mut self, grain: usize, impulse: Vector<D>) {
        if !std::mem::replace(&mut self.lags[grain], true) {
            self.impulse[grain] -= impulse;
            self.accepted.0 -= impulse;
        }
    }

    /// By how much the sums of impulse (N s) and heat (J) have grown since this was last asked.
    pub(crate) fn change(&mut self) -> (Vector<D>, f64) {
        let now = (self.impulse.iter().sum::<Vector<D>>(), self.heat.iter().sum::<f64>());
        let before = std::mem::replace(&mut self.accepted, now);
        (now.0 - before.0, now.1 - before.1)
    }
}

/// How far the grains are from what the fluid expected of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Solutions of the fluid.
    pub solves: usize,
    /// gamma |v - v*| and rho_f V/dt |v - v*|, of momentum and of the solid flux, over weight and force: root of the
    /// sums of squares over the grains.
    pub disagreement: f64,
    /// hA |T - T*|, as far as it is beyond the accuracy of the temperatures, over hA times their range, likewise; zero
    /// without heat.
    pub heat_disagreement: f64,
    /// Whether both are within the tolerances of [`crate::scheme::iterated::Iteration`]: the default ones for schemes
    /// that solve the fluid once.
    pub converged: bool,
    /// The grains that disagree most and the larger |v - v*| of each, that of momentum (the force that the fluid did
    /// not lose, over gamma) or of the solid flux, m/s; the worst first, `None` where fewer disagree.
    pub worst: [Option<(u32, f64)>; 3],
    /// How far the grain that moved furthest did so in a part of the step, in its diameters.
    pub travel: f64,
    /// Parts that the step was done in.
    pub parts: usize,
    /// |sum of the impulse that is carried to the next step| over weight and force of all grains times dt.
    pub carried: f64,
}

/// Everything that tells how far apart grains and fluid are.
pub struct Comparison<'a, const D: usize> {
    /// The grains, before or after their motion.
    pub grains: &'a Dem<D>,
    /// Coefficients of the exchange.
    pub load: &'a GrainLoad<D>,
    /// Density of the fluid, kg/m3.
    pub density: f64,
    /// Step, s.
    pub dt: f64,
    /// Force on each grain, N.
    pub force: &'a [Vector<D>],
}

impl<const D: usize> Comparison<'_, D> {
    /// Weighs, by grain, the force that the fluid did not lose (N) and the difference of the solid's velocity (m/s).
    pub fn motion(&self, difference: impl Fn(usize) -> (Vector<D>, Vector<D>)) -> Agreement {
        let (particles, gravity) = (&self.grains.particles, self.grains.settings().gravity.norm());
        let mut agreement = Agreement { solves: 1, parts: 1, converged: true, ..Agreement::default() };
        let (mut sum, mut scale, mut most) = (0.0, 0.0, [0.0; 3]);
        for i in (0..particles.len()).filter(|&i| !particles.held(i)) {
            let (force, velocity) = difference(i);
            let inertia = self.density * self.load.volume[i] / self.dt;
            let worth = force.norm_squared() + (velocity * inertia).norm_squared();
            sum += worth;
            scale += (particles.mass[i] * gravity).powi(2) + self.force[i].norm_squared();
            if let Some(place) = most.iter().position(|&other| worth > other) {
                most[place..].rotate_right(1);
                agreement.worst[place..].rotate_right(1);
                let drag = self.load.drag[i];
                let slip = if drag > 0.0 { force.norm() / drag } else { 0.0 };
                (most[place], agreement.worst[place]) =
                    (worth, Some((particles.id[i], velocity.norm().max(slip))));
            }
        }
        agreement.disagreement = share(sum, scale);
        let diameters = |(v, radius): (&Vector<D>, &f64)| v.norm() * self.dt / (2.0 * radius);
        // Without implicit drag there is no mean: the velocity at the end stands for it.
        let mean = self.grains.mean_velocity();
        let moved = if mean.is_empty() { &particles.velocity[..] } else { mean };
        agreement.travel = moved.iter().zip(&particles.radius).map(diameters).fold(0.0, f64::max);
        agreement
    }
}

/// Least relative accuracy of a temperature: the mean over a thousand sub-steps adds as many rounding errors up.
const ROUND_OFF: f64 = 1e3 * f64::EPSILON;

/// Temperatures of a step, to compare differences of heat with.
#[derive(Clone, Copy, Debug)]
pub struct Temperatures {
    /// Lowest and highest temperature of grains and of the fluid at them, K.
    pub bounds: (f64, f64),
    /// Relative residual to which the energy equation of the fluid is solved.
    pub tolerance: f64,
}

impl Temperatures {
    /// Those of grains and of the fluid at them.
    pub fn of<const D: usize>(at: &AtGrains<D>, grains: &[f64], tolerance: f64) -> Self {
        let all = at.temperature.iter().chain(grains);
        let bounds = all.fold((f64::MAX, f64::MIN), |(low, high), t| (low.min(*t), high.max(*t)));
        Self { bounds, tolerance }
    }

    /// Weighs the heat that the fluid did not lose (W, by grain) against hA times the range of temperatures.
    ///
    /// It is the difference of two numbers of the size of hA T. One of them comes from an equation whose terms have the
    /// size of C T / dt and hA T and which is solved to a relative residual, so that T is known to about this share of
    /// itself, and to no less than rounding leaves. What is within that is no disagreement: where all temperatures are
    /// equal, their range consists of such errors too, and further solutions change nothing. It is taken off the
    /// difference and not put into the scale, which remains the range: with the default of 1e-8 at 300 K a disagreement
    /// of 1e-5 K counts, however small the range is.
    pub fn disagreement(&self, law: &HeatLoad, difference: impl Fn(usize) -> f64) -> f64 {
        let (low, high) = self.bounds;
        let unknown = self.tolerance.max(ROUND_OFF) * high.abs().max(low.abs());
        let (mut sum, mut scale) = (0.0, 0.0);
        for (i, coefficient) in law.coefficient.iter().enumerate() {
            let excess = difference(i).abs() - coefficient * unknown;
            // What is no number is a disagreement; a maximum would drop it.
            sum += if excess <= 0.0 { 0.0 } else { excess.powi(2) };
            scale += (coefficient * (high - low)).powi(2);
        }
        share(sum, scale)
    }
}

impl<const D: usize> Interaction<D> {
    /// gamma (v* - v) of grain `i` that moves at `velocity` (mean over the step): what it gets and the fluid does not
    /// lose, N.
    pub(crate) fn missed(&self, velocity: Vector<D>, i: usize) -> Vector<D> {
        (self.load.expected(&self.at, i) - velocity) * self.load.drag[i]
    }

    /// v* - v with v* of the solid flux: how much faster the equation of mass had it, m/s.
    pub(crate) fn missed_in_flux(&self, velocity: Vector<D>, i: usize) -> Vector<D> {
        self.load.expected_in_flux(&self.at, i) - velocity
    }
}

/// Root of a ratio; zero over zero counts as none.
fn share(sum: f64, scale: f64) -> f64 {
    if sum == 0.0 { 0.0 } else { (sum / scale.max(f64::MIN_POSITIVE)).sqrt() }
}

impl Agreement {
    /// What to tell the user of a step that did not converge, and which option helps.
    pub fn complaint(&self) -> Option<Notice> {
        let heat = match self.heat_disagreement > self.disagreement {
            true => format!("; temperatures by {:.1e} of their range", self.heat_disagreement),
            false => String::new(),
        };
        let worst: Vec<_> = self
            .worst
            .iter()
            .flatten()
            .map(|(grain, speed)| format!("{grain} (by {speed:.1e} m/s)"))
            .collect();
        let grains = match worst.is_empty() {
            true => String::new(),
            false => format!(", most at grain {}", worst.join(", ")),
        };
        let help = match (self.solves > self.parts, self.parts > 1) {
            (false, _) => "use the scheme \"iterated\" with coupling.iteration.most above 1,",
            (true, true) => "the step was cut as far as coupling.cut does: set more coupling.iteration.most,",
            (true, false) => {
                "set coupling.cut = {} (steps in halves where needed), more coupling.iteration.most,"
            }
        };
        let solutions = if self.solves == 1 { "solution" } else { "solutions" };
        let what = format!(
            "grains and fluid disagree by {:.1e} of weight and force after {} {solutions}{grains}{heat}",
            self.disagreement, self.solves
        );
        let help = format!("{help} or a smaller time.step");
        (!self.converged).then(|| Notice::new(what, help))
    }

    /// This part of a step after another one, with solutions spent on attempts beside: the worse of both.
    pub fn after(self, first: Option<&Self>, spent: usize) -> Self {
        let Some(first) = first else { return Self { solves: self.solves + spent, ..self } };
        let worse = if first.disagreement > self.disagreement { first } else { &self };
        Self {
            solves: first.solves + self.solves + spent,
            heat_disagreement: first.heat_disagreement.max(self.heat_disagreement),
            converged: first.converged && self.converged,
            travel: first.travel.max(self.travel),
            parts: first.parts + self.parts,
            carried: self.carried,
            ..*worse
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten grains whose temperatures differ from what the fluid expected by so much, K, in a bed at 300 K with a range
    /// of `range`, K.
    fn disagreement(difference: f64, range: f64) -> f64 {
        let coefficient: Vec<f64> = (1..=10).map(f64::from).collect();
        let none = vec![0.0; 10];
        let law = HeatLoad { coefficient, mobility: none.clone(), temperature: none };
        let temperatures = Temperatures { bounds: (300.0, 300.0 + range), tolerance: 1e-8 };
        temperatures.disagreement(&law, |i| law.coefficient[i] * difference)
    }

    #[test]
    fn rounding_errors_of_equal_temperatures_do_not_disagree() {
        for range in [0.0, 6e-14, 1e-12, 1e-6] {
            assert_eq!(disagreement(1e-12, range), 0.0, "range {range}");
        }
    }

    #[test]
    fn a_small_range_of_temperatures_is_still_what_differences_are_compared_with() {
        for (difference, range) in [(5e-5, 1e-3), (1.0, 20.0), (1e-3, 1e-3)] {
            let share = difference / range;
            let found = disagreement(difference, range);
            assert!(found > 0.9 * share && found <= share, "{difference} K of {range} K: {found}");
        }
    }
}
