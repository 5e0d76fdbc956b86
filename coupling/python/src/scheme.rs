//! Coupling schemes written in Python.

use crate::arrays::{Column, finite_numbers, vectors};
use crate::columns::{Columns, Group, Owner};
use crate::errors::Raised;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError, TryLockError};
use voidage_coupling::load::Law;
use voidage_coupling::scheme::Scheme;
use voidage_coupling::scheme::anchored::Forcing;
use voidage_coupling::{Error, Mixture, Notice, Result, StepReport};

/// A scheme that calls an object with a method `step(system, dt)`.
pub struct PythonScheme {
    object: Py<PyAny>,
    raised: Raised,
}

impl PythonScheme {
    /// The scheme of an object; what it raises is kept in `raised`.
    pub fn new(object: &Bound<'_, PyAny>, raised: Raised) -> PyResult<Self> {
        if !object.getattr("step").is_ok_and(|step| step.is_callable()) {
            let name = object.get_type().name()?;
            return Err(PyTypeError::new_err(format!(
                "`scheme` is a {name}, it must be a name or an object with a method `step(system, dt)`"
            )));
        }
        Ok(Self { object: object.clone().unbind(), raised })
    }
}

impl Scheme<2> for PythonScheme {
    fn step(&mut self, mixture: &mut Mixture<2>, dt: f64) -> Result<StepReport> {
        Python::attach(|py| {
            let steps = mixture.fluid.clock.steps;
            let system = System { held: Mutex::new(None), raised: self.raised.clone() };
            let system = Bound::new(py, system).map_err(|raised| self.raised.keep(py, raised))?;
            // Python may keep the system: it is lent what it works on, and gives it back.
            system.get().lend(Held { mixture: std::mem::take(mixture), report: StepReport::default(), dt });
            let outcome = self.object.bind(py).call_method1("step", (&system, dt));
            let report = system.get().give_back(mixture);
            outcome.map_err(|raised| self.raised.keep(py, raised))?;
            match mixture.fluid.clock.steps - steps {
                1 => Ok(report),
                accepted => Err(Error::run(Notice::new(
                    format!("the scheme accepted {accepted} solutions in a step"),
                    "end `step` with one `system.accept()`",
                ))),
            }
        })
    }
}

/// What a scheme works on, during its step.
pub struct Held {
    /// Grains and fluid.
    pub mixture: Mixture<2>,
    report: StepReport,
    dt: f64,
}

/// Grains and fluid as a scheme sees them, during one call of its `step`: the phases of a step, and the columns that
/// they read and write.
#[pyclass(frozen, module = "voidage")]
pub struct System {
    held: Mutex<Option<Held>>,
    raised: Raised,
}

/// Positions, velocities, contacts and all else that makes the grains what they are at one moment.
#[pyclass(frozen, module = "voidage")]
pub struct GrainState(voidage_dem::State<2>);

impl System {
    fn lend(&self, held: Held) {
        *self.held.lock().unwrap_or_else(PoisonError::into_inner) = Some(held);
    }

    fn give_back(&self, mixture: &mut Mixture<2>) -> StepReport {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner).take();
        held.map_or_else(StepReport::default, |held| {
            *mixture = held.mixture;
            held.report
        })
    }

    /// Works on the system without the interpreter.
    pub fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Held) -> Result<R> + Send,
    ) -> PyResult<R> {
        let outcome = py.detach(|| {
            // Waiting could be for ever: the solver that a phase calls may be in Python and ask for the same system.
            let mut held = match self.held.try_lock() {
                Ok(held) => held,
                Err(TryLockError::Poisoned(held)) => held.into_inner(),
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::run("the system is in the middle of a phase"));
                }
            };
            match held.as_mut() {
                Some(held) => work(held),
                None => Err(Error::run("the system can be used inside `step` of the scheme only")),
            }
        });
        outcome.map_err(|error| self.raised.exception(py, &error))
    }
}

#[pymethods]
impl System {
    /// Cuts the grains by the mesh, and computes the nodal voidage.
    fn cut_grains(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |held| held.mixture.cut_grains(&mut held.report))
    }

    /// Fills `load["drag"]`, `load["known"]` and `load["heat_coefficient"]` by the laws of the scene, and the voidage at
    /// the grains. `known` is the part of the forcing drag u - volume grad p + known that the fluid does not change, of
    /// added mass and lift; zero without them.
    fn evaluate_closures(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |held| held.mixture.evaluate_closures(held.dt, &mut held.report))
    }

    /// Solves the fluid from its last accepted state: fills `at_grains`, `grains["force"]` and `grains["heat"]`.
    fn solve_fluid(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |held| held.mixture.solve_fluid(held.dt, &mut held.report))
    }

    /// Moves the grains by a step under `grains["force"]` and `grains["heat"]`, contacts included.
    fn move_grains(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |held| {
            held.mixture.move_grains(held.dt, &mut held.report);
            Ok(())
        })
    }

    /// Moves the grains by a step under `force` (g, D), N, and `heat` (g), W, from which the drag and the heat transfer
    /// of the grains themselves go off, `load["drag"]` v and `load["heat_coefficient"]` T, implicitly; contacts
    /// included. Returns the mean velocity over the step, (g, D), with added mass what drag and added mass felt of it, and the mean temperature, (g), if there is heat;
    /// `grains["force"]` and `grains["heat"]` are then what is left of the forcing.
    #[pyo3(signature = (force, heat=None))]
    fn drive_grains<'py>(
        &self,
        py: Python<'py>,
        force: &Bound<'py, PyAny>,
        heat: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Option<Bound<'py, PyAny>>)> {
        let (count, warm) = self.with(py, |held| {
            let interaction = &held.mixture.interaction;
            Ok((interaction.force.len(), interaction.load.heat.is_some()))
        })?;
        let force = vectors(&finite_numbers(force, "force", Some(count), 2)?);
        let heat = match (heat, warm) {
            (Some(heat), true) => finite_numbers(heat, "heat", Some(count), 1)?,
            (None, false) => vec![],
            (Some(_), false) => return Err(PyValueError::new_err("`heat` is given, the scene has none")),
            (None, true) => return Err(PyValueError::new_err("`heat` is missing, the scene has heat")),
        };
        let forcing = Forcing { force, heat };
        let (velocity, temperature) = self.with(py, |held| {
            held.mixture.drive_grains(held.dt, &forcing, &mut held.report)?;
            for i in 0..forcing.force.len() {
                let felt = held.mixture.felt()[i];
                let interaction = &mut held.mixture.interaction;
                interaction.force[i] = forcing.force[i] - felt * interaction.load.drag[i];
            }
            let Mixture { grains, interaction, .. } = &mut held.mixture;
            if let Some(law) = &interaction.load.heat {
                for (i, temperature) in grains.mean_temperature().iter().enumerate() {
                    interaction.heat[i] = forcing.heat[i] - temperature * law.coefficient[i];
                }
            }
            let temperature = warm.then(|| Column::from(grains.mean_temperature()));
            Ok((Column::from(held.mixture.felt()), temperature))
        })?;
        let temperature = temperature.map(|column| column.into_array(py)).transpose()?;
        Ok((velocity.into_array(py)?, temperature))
    }

    /// Gives the solid flux in the equation of mass a law of its own, `load["continuity_mobility"]` and
    /// `load["continuity_velocity"]`, at first that of the momentum.
    fn separate_continuity(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |held| {
            let load = &mut held.mixture.interaction.load;
            let law = Law { mobility: load.mobility.clone(), velocity: load.velocity.clone() };
            load.continuity = Some(law);
            Ok(())
        })
    }

    /// Accepts the last solution of the fluid and moves the clock; the end of a step.
    fn accept(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |held| held.mixture.accept(held.dt, &mut held.report))
    }

    /// The grains as they are now, to come back to.
    fn grain_state(&self, py: Python<'_>) -> PyResult<GrainState> {
        self.with(py, |held| Ok(GrainState(held.mixture.grains.state())))
    }

    /// Puts the grains back to a state taken before in this step. RuntimeError if grains have come or gone since.
    fn restore_grains(&self, py: Python<'_>, state: &GrainState) -> PyResult<()> {
        self.with(py, |held| {
            let grains = &mut held.mixture.grains;
            if state.0.particles.id != grains.particles.id {
                return Err(Error::run(
                    "the state is of other grains: take it in the step in which it is restored",
                ));
            }
            Ok(grains.restore(state.0.clone())?)
        })
    }

    /// Columns of the grains.
    #[getter]
    fn grains(this: Bound<'_, Self>) -> Columns {
        Columns { owner: Owner::System(this.unbind()), group: Group::Grains }
    }

    /// Columns of the load: drag and the affine laws `v* = velocity + mobility (drag u - volume grad p)` and
    /// `T* = temperature + heat_mobility heat_coefficient T`.
    #[getter]
    fn load(this: Bound<'_, Self>) -> Columns {
        Columns { owner: Owner::System(this.unbind()), group: Group::Load }
    }

    /// The fluid at the grains by the last solution.
    #[getter]
    fn at_grains(this: Bound<'_, Self>) -> Columns {
        Columns { owner: Owner::System(this.unbind()), group: Group::AtGrains }
    }

    /// Gravity, m/s2, (D).
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let gravity =
            self.with(py, |held| Ok(Column::from(held.mixture.grains.settings().gravity.as_slice())))?;
        gravity.into_array(py)
    }

    /// Time at the start of the step, s.
    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |held| Ok(held.mixture.fluid.clock.time))
    }

    /// Steps done before this one.
    #[getter]
    fn steps(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |held| Ok(held.mixture.fluid.clock.steps))
    }
}
