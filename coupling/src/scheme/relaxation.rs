//! How the next forcing is made of the last ones and of the answers of the fluid.
//!
//! With x the forcing that the law is anchored at, g(x) the answer of the fluid and r = g(x) - x, the solution has r =
//! 0. Components are weighed by the mobility of the free grain, so that heavy and light grains, forces and heats count
//! alike.

use super::anchored::Forcing;
use crate::Mixture;
use nalgebra::{DMatrix, DVector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Relaxation by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Relaxation {
    /// x + omega r with this fixed omega, above 0 and at most 1; with 1 the answer is the next guess.
    Constant(f64),
    /// x + omega r with Aitken's omega, which follows from the last two residuals.
    Aitken,
    /// Interface quasi-Newton with an inverse Jacobian from a least-squares model (Degroote, Bathe and Vierendeels
    /// 2009).
    #[default]
    IqnIls,
}

/// Largest omega of Aitken's. An iteration by the factor z needs 1/(1 - z): 1e3 where fluid and grains follow each other in
/// steps of a thousand relaxation times.
const LARGEST: f64 = 1e6;

/// Differences that the quasi-Newton model keeps.
const KEPT: usize = 8;

/// Relative size of a singular value below which a direction of the model is noise.
const NOISE: f64 = 1e-8;

/// Memory of the iterates of one step.
pub(super) struct Relaxer {
    relaxation: Relaxation,
    omega: f64,
    /// Residual and answer of the last iterate.
    last: Option<(DVector<f64>, DVector<f64>)>,
    /// Differences of residuals and of answers, the newest last.
    residuals: Vec<DVector<f64>>,
    answers: Vec<DVector<f64>>,
}

impl Relaxer {
    pub fn new(relaxation: Relaxation) -> Self {
        Self { relaxation, omega: 1.0, last: None, residuals: vec![], answers: vec![] }
    }

    /// Forgets the iterates.
    pub fn restart(&mut self) {
        (self.omega, self.last) = (1.0, None);
        self.residuals.clear();
        self.answers.clear();
    }

    /// Puts the next iterate into `forcing`. Returns whether it differs from the answer, to which the grains have
    /// already responded.
    pub fn improve<const D: usize>(
        &mut self,
        mixture: &Mixture<D>,
        dt: f64,
        forcing: &mut Forcing<D>,
        answer: &Forcing<D>,
    ) -> bool {
        let weight = weights(mixture, dt);
        let (x, g) = (gather(forcing, &weight), gather(answer, &weight));
        let r = &g - &x;
        let next = self.next(x, g, r);
        match &next {
            Some(next) => scatter(next, &weight, forcing),
            None => forcing.clone_from(answer),
        }
        next.is_some()
    }

    /// The next iterate; `None` for the answer itself.
    fn next(&mut self, x: DVector<f64>, g: DVector<f64>, r: DVector<f64>) -> Option<DVector<f64>> {
        let before = self.last.replace((r.clone(), g.clone()));
        match self.relaxation {
            Relaxation::Constant(omega) => (omega != 1.0).then(|| x + r * omega),
            Relaxation::Aitken => {
                let (old, _) = before?;
                let change = &r - &old;
                let size = change.norm_squared();
                if size > 0.0 {
                    self.omega = (-self.omega * old.dot(&change) / size).clamp(-LARGEST, LARGEST);
                }
                Some(x + r * self.omega)
            }
            Relaxation::IqnIls => {
                let (old, answer) = before?;
                self.residuals.push(&r - old);
                self.answers.push(&g - answer);
                if self.residuals.len() > KEPT {
                    self.residuals.remove(0);
                    self.answers.remove(0);
                }
                let share = least_squares(&self.residuals, &r)?;
                Some(self.answers.iter().zip(share.iter()).fold(g, |sum, (w, a)| sum - w * *a))
            }
        }
    }
}

/// The coefficients of `columns` whose sum comes nearest to `target`, from the normal equations scaled to unit columns;
/// `None` if they are no numbers. A column of zeros, where nothing but rounding is left to solve, gets zero.
fn least_squares(columns: &[DVector<f64>], target: &DVector<f64>) -> Option<DVector<f64>> {
    let norms: Vec<f64> = columns.iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    let count = columns.len();
    let gram = DMatrix::from_fn(count, count, |i, j| columns[i].dot(&columns[j]) / norms[i] / norms[j]);
    let known = DVector::from_fn(count, |i, _| columns[i].dot(target) / norms[i]);
    // The decomposition of what is no number would never end.
    if !gram.iter().chain(known.iter()).all(|number| number.is_finite()) {
        return None;
    }
    let scaled = gram.svd(true, true).solve(&known, NOISE).ok()?;
    Some(DVector::from_fn(count, |i, _| scaled[i] / norms[i]))
}

/// sqrt of 1 / (m/dt + gamma) by component of force, then of 1 / (C/dt + hA) by grain; zero for held grains.
fn weights<const D: usize>(mixture: &Mixture<D>, dt: f64) -> Vec<f64> {
    let (particles, load) = (&mixture.grains.particles, &mixture.interaction.load);
    let motion = particles.mass.iter().zip(&load.drag);
    let mut weight: Vec<f64> =
        motion.flat_map(|(mass, drag)| std::iter::repeat_n((1.0 / (mass / dt + drag)).sqrt(), D)).collect();
    if let (Some(law), Some(heat)) = (&load.heat, &particles.heat) {
        let inertia = heat.capacity.iter().zip(&law.coefficient);
        weight.extend(inertia.map(|(capacity, transfer)| (1.0 / (capacity / dt + transfer)).sqrt()));
    }
    weight
}

fn gather<const D: usize>(forcing: &Forcing<D>, weight: &[f64]) -> DVector<f64> {
    let numbers = forcing.force.iter().flat_map(|f| f.iter()).chain(&forcing.heat);
    DVector::from_iterator(weight.len(), numbers.zip(weight).map(|(x, w)| x * w))
}

fn scatter<const D: usize>(numbers: &DVector<f64>, weight: &[f64], forcing: &mut Forcing<D>) {
    let components = forcing.force.iter_mut().flat_map(|f| f.iter_mut()).chain(&mut forcing.heat);
    for ((x, number), w) in components.zip(numbers.iter()).zip(weight) {
        if *w > 0.0 {
            *x = number / w;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// g(x) = A x + b with |A| > 1: plain iteration diverges, the quasi-Newton model of two differences is exact in the
    /// plane.
    #[test]
    fn quasi_newton_solves_a_linear_problem_in_as_many_steps_as_unknowns() {
        let matrix = DMatrix::from_row_slice(2, 2, &[-3.0, 1.0, 0.5, 2.0]);
        let constant = DVector::from_row_slice(&[1.0, -2.0]);
        let mut relaxer = Relaxer::new(Relaxation::IqnIls);
        let mut x = DVector::zeros(2);
        for _ in 0..4 {
            let g = &matrix * &x + &constant;
            let r = &g - &x;
            x = relaxer.next(x, g.clone(), r).unwrap_or(g);
        }
        assert!((&matrix * &x + &constant - &x).norm() < 1e-9, "{x}");
    }

    /// Iterates that no longer differ, as where rounding is all that is left: the model held 0/0, and its decomposition
    /// never ended.
    #[test]
    fn a_model_of_equal_iterates_ends() {
        let mut relaxer = Relaxer::new(Relaxation::IqnIls);
        let numbers = |x: f64, y: f64| DVector::from_row_slice(&[x, y]);
        for _ in 0..4 {
            let next = relaxer.next(numbers(1.0, 2.0), numbers(3.0, 4.0), numbers(2.0, 2.0));
            assert!(next.is_none_or(|next| next == numbers(3.0, 4.0)));
        }
        // Nor is there a model of what is no number.
        let wrong = [numbers(f64::INFINITY, 1.0), numbers(f64::NAN, 0.0)];
        assert!(least_squares(&wrong, &numbers(1.0, 1.0)).is_none());
    }

    /// One unknown: Aitken's omega is the secant method.
    #[test]
    fn aitken_solves_one_unknown_in_two_steps() {
        let mut relaxer = Relaxer::new(Relaxation::Aitken);
        let mut x = DVector::from_element(1, 0.0);
        for _ in 0..2 {
            let g = x.map(|x| -1.7 * x + 3.0);
            let r = &g - &x;
            x = relaxer.next(x, g.clone(), r).unwrap_or(g);
        }
        assert!((x[0] - 3.0 / 2.7).abs() < 1e-12, "{x}");
    }
}
