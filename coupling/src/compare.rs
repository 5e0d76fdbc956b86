//! Fluid solvers beside one another: the same state through all of them, and how far their answers are apart.

use crate::backend::{FluidBackend, FluidReport, FluidStep, Immersed};
use crate::error::Result;
use crate::recorder::View;
use std::sync::{Arc, Mutex, PoisonError};
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::flow::State;
use voidage_fluid::{Mesh, Vector};

/// A quantity that is smaller than this part of what drives it counts against that part: a fluid at rest has round-off
/// for a velocity, grains as warm as the fluid exchange round-off.
const DRIVEN: f64 = 1e-4;

/// How far a quantity of one solver is from the same of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The quantity.
    pub quantity: &'static str,
    /// Root mean square of the difference over that of the quantity.
    pub l2: f64,
    /// Largest difference over the largest value.
    pub max: f64,
}

/// Differences of one step from the same state.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Number of the step.
    pub step: u64,
    /// The solver that is compared with the first.
    pub solver: String,
    /// One per quantity.
    pub differences: Vec<Difference>,
}

/// What a [`SideBySide`] has found so far.
pub type Findings = Arc<Mutex<Vec<Finding>>>;

/// Another solver with its answer to the step in hand.
struct Other<const D: usize> {
    name: String,
    backend: Box<dyn FluidBackend<D>>,
    at: AtBodies<D>,
}

/// A fluid solver that others look over the shoulder: at chosen steps they solve the same step from its state.
/// The run goes on with the first one's answer, as if the others were not there. The nodal fields are compared when
/// somebody asks for them after the step.
pub struct SideBySide<const D: usize> {
    first: Box<dyn FluidBackend<D>>,
    others: Vec<Other<D>>,
    density: f64,
    steps: Vec<u64>,
    mesh: Arc<Mesh<D>>,
    /// The step in hand if it is compared, with the differences at the grains.
    pending: Option<(u64, Vec<Vec<Difference>>)>,
    findings: Findings,
}

impl<const D: usize> SideBySide<D> {
    /// `first`, which has its mesh already, and the others by name, compared in the given steps (the first step is 1);
    /// `density` is that of the fluid, kg/m3.
    pub fn new(
        first: Box<dyn FluidBackend<D>>,
        mesh: Arc<Mesh<D>>,
        density: f64,
        others: Vec<(String, Box<dyn FluidBackend<D>>)>,
        steps: Vec<u64>,
    ) -> Self {
        let other = |(name, backend)| Other { name, backend, at: AtBodies::default() };
        Self {
            first,
            others: others.into_iter().map(other).collect(),
            density,
            steps,
            mesh,
            pending: None,
            findings: Findings::default(),
        }
    }

    /// Where the findings go.
    pub fn findings(&self) -> Findings {
        self.findings.clone()
    }

    fn look(&mut self, step: &FluidStep<'_, D>, out: &AtBodies<D>, before: &State<D>) -> Result<()> {
        let mut at_grains = Vec::new();
        for other in &mut self.others {
            other.backend.start(&self.mesh, before)?;
            other.backend.solve(step, &mut other.at)?;
            at_grains
                .push(step.grains.map_or_else(Vec::new, |grains| grain_differences(&grains, out, &other.at)));
        }
        self.pending = Some((step.number, at_grains));
        Ok(())
    }
}

impl<const D: usize> FluidBackend<D> for SideBySide<D> {
    fn start(&mut self, mesh: &Arc<Mesh<D>>, fields: &State<D>) -> Result<()> {
        self.mesh = mesh.clone();
        self.first.start(mesh, fields)
    }

    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut AtBodies<D>) -> Result<FluidReport<D>> {
        self.pending = None;
        if !self.steps.contains(&step.number) {
            return self.first.solve(step, out);
        }
        let before = self.first.fields()?;
        let report = self.first.solve(step, out)?;
        self.look(step, out, &before)?;
        Ok(report)
    }

    fn accept(&mut self) {
        self.first.accept();
        if self.pending.is_some() {
            self.others.iter_mut().for_each(|other| other.backend.accept());
        }
    }

    fn fields(&mut self) -> Result<State<D>> {
        let fields = self.first.fields()?;
        if let Some((step, at_grains)) = self.pending.take() {
            for (other, at_grains) in self.others.iter_mut().zip(at_grains) {
                let theirs = other.backend.fields()?;
                let velocity = (&fields.velocity[..], &theirs.velocity[..]);
                let temperature = fields.temperature.as_deref().zip(theirs.temperature.as_deref());
                let pressure = (&fields.pressure[..], &theirs.pressure[..]);
                let mut differences = nodal(self.density, velocity, pressure, temperature);
                differences.extend(at_grains);
                let finding = Finding { step, solver: other.name.clone(), differences };
                self.findings.lock().unwrap_or_else(PoisonError::into_inner).push(finding);
            }
        }
        Ok(fields)
    }
}

/// Differences of two runs: the nodal fields, and the grains. Places are compared with the radius.
pub fn view_differences<const D: usize>(density: f64, a: &View<'_, D>, b: &View<'_, D>) -> Vec<Difference> {
    let mut found = Vec::new();
    if let (Some(a), Some(b)) = (&a.fluid, &b.fluid) {
        let temperature = a.temperature.zip(b.temperature);
        found.extend(nodal(density, (a.velocity, b.velocity), (a.pressure, b.pressure), temperature));
    }
    if let (Some(a), Some(b)) = (&a.grains, &b.grains) {
        let place = |i: usize| (a.radius[i], (a.position[i] - b.position[i]).norm());
        found.push(difference("grain position", a.position.len(), place, 0.0));
        found.push(vectors("grain velocity", a.velocity, b.velocity, 0.0));
        if let Some((a, b)) = a.temperature.zip(b.temperature) {
            found.push(scalars("grain temperature", a, b, 0.0));
        }
    }
    found
}

/// Differences of the nodal fields: relative to the first, or to what would drive them.
fn nodal<const D: usize>(
    density: f64,
    velocity: (&[Vector<D>], &[Vector<D>]),
    pressure: (&[f64], &[f64]),
    temperature: Option<(&[f64], &[f64])>,
) -> Vec<Difference> {
    let speed = velocity.0.iter().fold(0.0, |most: f64, u| most.max(u.norm()));
    let mut found = vec![
        vectors("velocity", velocity.0, velocity.1, (largest(pressure.0) / density).sqrt()),
        scalars("pressure", pressure.0, pressure.1, density * speed * speed),
    ];
    found.extend(temperature.map(|(a, b)| scalars("temperature", a, b, 0.0)));
    found
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

/// Differences of force and heat on the grains by the affine law.
fn grain_differences<const D: usize>(
    grains: &Immersed<'_, D>,
    a: &AtBodies<D>,
    b: &AtBodies<D>,
) -> Vec<Difference> {
    let load = grains.load;
    let count = grains.position.len();
    let force = |at: &AtBodies<D>| (0..count).map(|i| load.force(at, i)).collect::<Vec<_>>();
    let mut found = vec![vectors("grain force", &force(a), &force(b), 0.0)];
    if let Some(columns) = &load.heat {
        let heat = |at: &AtBodies<D>| (0..count).map(|i| columns.heat(at, i)).collect::<Vec<_>>();
        let driver = largest(&columns.coefficient) * largest(&a.temperature);
        found.push(scalars("grain heat", &heat(a), &heat(b), driver));
    }
    found
}

fn vectors<const D: usize>(
    quantity: &'static str,
    a: &[Vector<D>],
    b: &[Vector<D>],
    driver: f64,
) -> Difference {
    difference(quantity, a.len(), |i| (a[i].norm(), (a[i] - b[i]).norm()), driver)
}

fn scalars(quantity: &'static str, a: &[f64], b: &[f64], driver: f64) -> Difference {
    difference(quantity, a.len(), |i| (a[i].abs(), (a[i] - b[i]).abs()), driver)
}

/// `at(i)` is the size of value i and of its difference.
fn difference(
    quantity: &'static str,
    count: usize,
    at: impl Fn(usize) -> (f64, f64),
    driver: f64,
) -> Difference {
    let (mut squares, mut most) = ([0.0; 2], [0.0_f64; 2]);
    for (size, gap) in (0..count).map(at) {
        squares = [squares[0] + size * size, squares[1] + gap * gap];
        // A difference that is no number must not pass; `max` would drop it.
        let worse = gap > most[1] || gap.is_nan();
        most = [most[0].max(size), if worse { gap } else { most[1] }];
    }
    let floor = DRIVEN * driver;
    let relative = |gap: f64, size: f64| if gap == 0.0 { 0.0 } else { gap / size.max(floor) };
    let mean = (count as f64).sqrt().max(1.0);
    Difference {
        quantity,
        l2: relative(squares[1].sqrt() / mean, squares[0].sqrt() / mean),
        max: relative(most[1], most[0]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_relative_to_the_quantity() {
        let found = scalars("p", &[3.0, -4.0], &[3.0, -4.5], 0.0);
        assert!((found.l2 - 0.1).abs() < 1e-15 && (found.max - 0.125).abs() < 1e-15);
    }

    #[test]
    fn round_off_counts_against_the_driver() {
        let found = scalars("u", &[0.0, 1e-16], &[1e-16, 0.0], 1.0);
        assert!(found.max < 1.1e-12 && found.max > 0.0);
        assert_eq!(scalars("u", &[0.0], &[0.0], 0.0).max, 0.0);
    }

    #[test]
    fn what_is_no_number_does_not_pass() {
        let found = scalars("u", &[1.0, 1.0, 1.0], &[1.0, f64::NAN, 1.0], 0.0);
        assert!(found.max.is_nan() && found.l2.is_nan());
    }
}
