//! Fluid solvers beside one another: the same state through all of them, and how far their answers are apart.

use crate::recorder::View;
use std::sync::{Arc, Mutex, PoisonError};
use voidage_coupling::backend::{FluidBackend, FluidStep, Solution};
use voidage_coupling::error::Result;
use voidage_coupling::exchange::{OnMesh, force_at, given_at};
use voidage_fluid::balance::Balance;
use voidage_fluid::body::BodyAnswer;
use voidage_fluid::flow::State;
use voidage_fluid::{Mesh, Vector};

/// A quantity that is smaller than this part of what drives it counts against that part: a fluid at rest has round-off
/// for a velocity, grains as warm as the fluid exchange round-off.
const DRIVEN: f64 = 1e-4;

/// Size and difference of a value that only one side has.
const UNKNOWN: (f64, f64) = (f64::NAN, f64::NAN);

/// How far a quantity of one solver is from the same of another.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The quantity.
    pub quantity: String,
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
    solution: Solution<D>,
}

/// A fluid solver that others look over the shoulder: at chosen steps they solve the same step from its state.
/// The run goes on with the first one's answer, as if the others were not there.
pub struct SideBySide<const D: usize> {
    first: Box<dyn FluidBackend<D>>,
    others: Vec<Other<D>>,
    density: f64,
    scalars: Vec<String>,
    steps: Vec<u64>,
    mesh: Mesh<D>,
    /// Generation of the mesh that the others had last.
    generation: u32,
    accepted: State<D>,
    /// The last solution of the first.
    solution: State<D>,
    /// Differences of the last solution, if it was compared.
    pending: Vec<Finding>,
    findings: Findings,
}

impl<const D: usize> SideBySide<D> {
    /// `first`, which has its mesh and the fields already, and the others by name, compared in the given steps (the
    /// first step is 1); `density` is that of the fluid, kg/m3, `scalars` the names of its scalars.
    pub fn new(
        first: Box<dyn FluidBackend<D>>,
        (mesh, fields): (&Mesh<D>, &State<D>),
        (density, scalars): (f64, &[String]),
        others: Vec<(String, Box<dyn FluidBackend<D>>)>,
        steps: Vec<u64>,
    ) -> Self {
        let other = |(name, backend)| Other { name, backend, solution: Solution::default() };
        Self {
            first,
            others: others.into_iter().map(other).collect(),
            density,
            scalars: scalars.to_vec(),
            steps,
            mesh: mesh.clone(),
            generation: 0,
            accepted: fields.clone(),
            solution: State::default(),
            pending: Vec::new(),
            findings: Findings::default(),
        }
    }

    /// Where the findings go.
    pub fn findings(&self) -> Findings {
        self.findings.clone()
    }

    /// Lets the others solve the step, each from the accepted state of the first.
    fn look(&mut self, step: &FluidStep<'_, D>, ours: &Solution<D>) -> Result<()> {
        self.generation += 1;
        for other in &mut self.others {
            other.backend.set_mesh(&self.mesh, self.generation, &self.accepted)?;
            other.backend.solve(step, &mut other.solution)?;
        }
        let mut moved = None;
        if let Some(motion) = &step.motion {
            moved = Some(Mesh { points: motion.points.to_vec(), ..self.mesh.clone() });
        }
        let mesh = moved.as_ref().unwrap_or(&self.mesh);
        for Other { name, solution, .. } in &self.others {
            let mut differences = nodal(self.density, &self.scalars, &ours.fields, &solution.fields);
            differences.extend(at_points(mesh, &self.scalars, step, ours, solution));
            let driven = (largest(&ours.fields.pressure) / self.density).sqrt();
            let speed = fastest(&ours.fields.velocity).max(driven);
            let (lower, upper) = mesh.bounds();
            let extent = (upper - lower).norm();
            let driver = speed * extent.powi(D as i32 - 1);
            let reach = lower.norm() + extent;
            let parts = [&ours.balances, &solution.balances];
            differences.extend(at_boundary(&self.scalars, (driver, reach), parts[0], parts[1]));
            differences.extend(of_bodies((speed, driver), &ours.bodies, &solution.bodies));
            self.pending.push(Finding { step: step.number, solver: name.clone(), differences });
        }
        Ok(())
    }
}

impl<const D: usize> FluidBackend<D> for SideBySide<D> {
    fn set_mesh(&mut self, mesh: &Mesh<D>, generation: u32, fields: &State<D>) -> Result<()> {
        self.mesh.clone_from(mesh);
        self.accepted.copy_from(fields);
        self.first.set_mesh(mesh, generation, fields)
    }

    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut Solution<D>) -> Result<()> {
        self.pending.clear();
        self.first.solve(step, out)?;
        if self.steps.contains(&step.number) {
            self.look(step, out)?;
        }
        self.solution.copy_from(&out.fields);
        Ok(())
    }

    fn accept(&mut self) {
        self.first.accept();
        std::mem::swap(&mut self.accepted, &mut self.solution);
        self.findings.lock().unwrap_or_else(PoisonError::into_inner).append(&mut self.pending);
    }
}

/// Differences of two runs: the nodal fields, and the grains that both have. Places are compared with the radius. Fields
/// on different meshes differ by what is no number.
pub fn view_differences<const D: usize>(density: f64, a: &View<'_, D>, b: &View<'_, D>) -> Vec<Difference> {
    let mut found = Vec::new();
    if let (Some(a), Some(b)) = (&a.fluid, &b.fluid) {
        found.extend(nodal(density, a.scalars, a.fields, b.fields));
    }
    if let (Some(a), Some(b)) = (&a.grains, &b.grains) {
        let both = in_both(a.id, b.id);
        let of = |quantity: &str, at: &dyn Fn(usize, usize) -> (f64, f64)| match both.is_empty() {
            // Nothing that could be equal, unless both have lost all grains.
            true => difference(quantity, a.id.len().max(b.id.len()), |_| UNKNOWN, 0.0),
            false => difference(quantity, both.len(), |k| at(both[k].0, both[k].1), 0.0),
        };
        found.push(of("grain position", &|i, j| {
            (a.radius[i], a.period.nearest(a.position[i] - b.position[j]).norm())
        }));
        found.push(of("grain velocity", &|i, j| {
            (a.velocity[i].norm(), (a.velocity[i] - b.velocity[j]).norm())
        }));
        if let Some((a, b)) = a.temperature.zip(b.temperature) {
            found.push(of("grain temperature", &|i, j| (a[i].abs(), (a[i] - b[j]).abs())));
        }
    }
    found
}

/// The places of the numbers that are in both of two lists in order.
fn in_both(a: &[u32], b: &[u32]) -> Vec<(usize, usize)> {
    let mut both = Vec::with_capacity(a.len().min(b.len()));
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        if a[i] == b[j] {
            both.push((i, j));
        }
        (i, j) = (i + usize::from(a[i] <= b[j]), j + usize::from(b[j] <= a[i]));
    }
    both
}

/// Differences of the nodal fields: relative to the first, or to what would drive them.
fn nodal<const D: usize>(density: f64, scalars: &[String], a: &State<D>, b: &State<D>) -> Vec<Difference> {
    let speed = fastest(&a.velocity);
    let mut found = vec![
        vectors("velocity", &a.velocity, &b.velocity, (largest(&a.pressure) / density).sqrt()),
        numbers("pressure", &a.pressure, &b.pressure, density * speed * speed),
    ];
    let values = a.scalars.iter().zip(&b.scalars);
    found.extend(scalars.iter().zip(values).map(|(name, (a, b))| numbers(name, a, b, 0.0)));
    found
}

fn fastest<const D: usize>(velocity: &[Vector<D>]) -> f64 {
    velocity.iter().fold(0.0, |most: f64, u| most.max(u.norm()))
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

/// Differences of what the fluid gives at the points.
fn at_points<const D: usize>(
    mesh: &Mesh<D>,
    scalars: &[String],
    step: &FluidStep<'_, D>,
    a: &Solution<D>,
    b: &Solution<D>,
) -> Vec<Difference> {
    let Some(points) = step.immersed.map(|immersed| immersed.points) else { return Vec::new() };
    let [a, b] = [a, b].map(|solution| OnMesh { mesh, fields: &solution.fields });
    let force = |fluid| (0..points.len()).map(|q| force_at(points, &fluid, q)).collect::<Vec<_>>();
    let mut found = vec![vectors("force on grains", &force(a), &force(b), 0.0)];
    for (k, name) in scalars.iter().enumerate() {
        let Some(columns) = points.scalars.get(k).and_then(Option::as_ref) else { continue };
        let given = |fluid| (0..points.len()).map(|q| given_at(points, &fluid, k, q)).collect::<Vec<_>>();
        let driver = largest(&columns.coefficient) * largest(&a.fields.scalars[k]);
        found.push(numbers(&format!("{name} given to grains"), &given(a), &given(b), driver));
    }
    found
}

/// Differences of what passes the parts of the boundary; none where a solver does not compute it. `driver` is the flux
/// across the mesh of the largest velocity, or of that which the pressure would drive: nothing but rounding passes the
/// walls of a closed box. A force at the distance `reach` drives moments, which may be zero by symmetry.
fn at_boundary<const D: usize>(
    scalars: &[String],
    (driver, reach): (f64, f64),
    a: &[Balance<D>],
    b: &[Balance<D>],
) -> Vec<Difference> {
    if a.len() != b.len() || a.is_empty() {
        return Vec::new();
    }
    let column = |of: &dyn Fn(&Balance<D>) -> f64| [a, b].map(|all| all.iter().map(of).collect::<Vec<_>>());
    let forces = [a, b].map(|all| all.iter().map(|balance| balance.force).collect::<Vec<_>>());
    let [ours, theirs] = column(&|balance| balance.flux);
    let torques = [a, b].map(|all| all.iter().flat_map(|balance| balance.torque.clone()).collect::<Vec<_>>());
    let mut found = vec![
        numbers("boundary flux", &ours, &theirs, driver),
        vectors("boundary force", &forces[0], &forces[1], 0.0),
        numbers("boundary torque", &torques[0], &torques[1], fastest(&forces[0]) * reach),
    ];
    for (k, name) in scalars.iter().enumerate() {
        let [ours, theirs] = column(&|balance| balance.scalars[k]);
        let [convected, others] = column(&|balance| balance.convected[k]);
        // Where all temperatures are equal, what passes is the round-off of what is convected.
        found.push(numbers(&format!("{name} at the boundary"), &ours, &theirs, largest(&convected)));
        found.push(numbers(&format!("{name} convected out"), &convected, &others, 0.0));
    }
    found
}

/// Differences of what the bodies do; NaN where a solver does not say it. The drivers are those of velocity and flux.
fn of_bodies<const D: usize>(
    (speed, flux): (f64, f64),
    a: &[BodyAnswer<D>],
    b: &[BodyAnswer<D>],
) -> Vec<Difference> {
    if a.is_empty() {
        return Vec::new();
    }
    let unknown = BodyAnswer { velocity: Vector::repeat(f64::NAN), vapour: f64::NAN };
    let b: Vec<_> = (0..a.len()).map(|i| b.get(i).copied().unwrap_or(unknown)).collect();
    let velocity = [a, &b].map(|all| all.iter().map(|body| body.velocity).collect::<Vec<_>>());
    let vapour = [a, &b].map(|all| all.iter().map(|body| body.vapour).collect::<Vec<_>>());
    vec![
        vectors("body velocity", &velocity[0], &velocity[1], speed),
        numbers("vapour of bodies", &vapour[0], &vapour[1], flux),
    ]
}

fn vectors<const D: usize>(quantity: &str, a: &[Vector<D>], b: &[Vector<D>], driver: f64) -> Difference {
    values(quantity, a, b, |a, b| (a.norm(), (a - b).norm()), driver)
}

fn numbers(quantity: &str, a: &[f64], b: &[f64], driver: f64) -> Difference {
    values(quantity, a, b, |a, b| (a.abs(), (a - b).abs()), driver)
}

/// `of` gives the size of a value and of its difference from that of the other side.
fn values<T>(quantity: &str, a: &[T], b: &[T], of: impl Fn(&T, &T) -> (f64, f64), driver: f64) -> Difference {
    let at = |i| a.get(i).zip(b.get(i)).map_or(UNKNOWN, |(a, b)| of(a, b));
    difference(quantity, a.len().max(b.len()), at, driver)
}

/// `at(i)` is the size of value i and of its difference.
fn difference(quantity: &str, count: usize, at: impl Fn(usize) -> (f64, f64), driver: f64) -> Difference {
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
        quantity: quantity.to_owned(),
        l2: relative(squares[1].sqrt() / mean, squares[0].sqrt() / mean),
        max: relative(most[1], most[0]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grain that had left in one of two runs made the comparison panic, or pair grains that were not the same.
    #[test]
    fn grains_are_compared_by_their_numbers() {
        assert_eq!(in_both(&[0, 1, 3, 4, 7], &[1, 2, 3, 7, 9]), [(1, 0), (2, 2), (4, 3)]);
        assert!(in_both(&[], &[1]).is_empty());
    }

    #[test]
    fn differences_are_relative_to_the_quantity() {
        let found = numbers("p", &[3.0, -4.0], &[3.0, -4.5], 0.0);
        assert!((found.l2 - 0.1).abs() < 1e-15 && (found.max - 0.125).abs() < 1e-15);
    }

    #[test]
    fn round_off_counts_against_the_driver() {
        let found = numbers("u", &[0.0, 1e-16], &[1e-16, 0.0], 1.0);
        assert!(found.max < 1.1e-12 && found.max > 0.0);
        assert_eq!(numbers("u", &[0.0], &[0.0], 0.0).max, 0.0);
    }

    #[test]
    fn a_solver_that_says_nothing_of_bodies_does_not_pass() {
        let body = BodyAnswer { velocity: Vector::<2>::zeros(), vapour: 1.0 };
        assert!(of_bodies((1.0, 1.0), &[body], &[body]).iter().all(|found| found.max == 0.0));
        assert!(of_bodies((1.0, 1.0), &[body], &[]).iter().all(|found| found.max.is_nan()));
        assert!(of_bodies::<2>((1.0, 1.0), &[], &[]).is_empty());
    }

    #[test]
    fn what_is_no_number_does_not_pass() {
        let found = numbers("u", &[1.0, 1.0, 1.0], &[1.0, f64::NAN, 1.0], 0.0);
        assert!(found.max.is_nan() && found.l2.is_nan());
    }

    /// Values that one side lacks were left out, so that a run that had lost all grains was equal to any other.
    #[test]
    fn what_one_side_lacks_does_not_pass() {
        let found = numbers("u", &[1.0, 1.0], &[1.0], 0.0);
        assert!(found.max.is_nan() && found.l2.is_nan());
        let found = vectors::<2>("u", &[], &[Vector::zeros()], 0.0);
        assert!(found.max.is_nan() && found.l2.is_nan());
        assert_eq!(numbers("u", &[], &[], 0.0).max, 0.0);
    }
}
