//! Coupling schemes written in Python.

use crate::arrays::{Column, finite_numbers, vectors};
use crate::columns::{Columns, Group, Owner};
use crate::errors::Raised;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError, TryLockError};
use voidage_coupling::load::Law;
use voidage_coupling::motions::{Lost, Motions};
use voidage_coupling::parts::Part;
use voidage_coupling::scheme::anchored::Forcing;
use voidage_coupling::scheme::cut::{Cut, Cutting, Trial};
use voidage_coupling::scheme::own::Own;
use voidage_coupling::scheme::{Options, Scheme, agreement};
use voidage_coupling::{Agreement, Error, Mixture, Notice, Result, StepReport};
use voidage_dem::Means;

/// How far, as a share, times of a step may differ that are sums of those of its parts.
const SAME: f64 = 1e-9;

/// A scheme that calls an object: with a method `step(system, dt)`, which does a whole step, or a method
/// `solve(system, dt)`, which does all of it but to accept, so that steps can be done in parts.
pub struct PythonScheme {
    object: Py<PyAny>,
    raised: Raised,
    /// What was not accepted yet of an answer of `solve`.
    lost: Lost<2>,
    carries: bool,
}

impl PythonScheme {
    /// The scheme of an object, with steps in parts by `cut`; what it raises is kept in `raised`.
    pub fn scheme(
        object: &Bound<'_, PyAny>,
        cut: Option<Cutting>,
        raised: Raised,
    ) -> PyResult<Box<dyn Scheme<2>>> {
        let has = |method| object.getattr(method).is_ok_and(|method| method.is_callable());
        let scheme = Self { object: object.clone().unbind(), raised, lost: Lost::default(), carries: false };
        match (has("solve"), has("step"), cut) {
            (true, _, cut) => Ok(Box::new(Cut::new(scheme, cut))),
            (false, true, None) => Ok(Box::new(scheme)),
            (false, true, Some(_)) => {
                let what =
                    "`coupling.cut` divides steps, and the scheme makes whole ones by `step(system, dt)`";
                let help = "give it `solve(system, dt)` instead, which does all of a step but `accept`, or leave \
                            `coupling.cut` out";
                Err(PyValueError::new_err(Notice::new(what, help).to_string()))
            }
            (false, false, _) => {
                let name = object.get_type().name()?;
                Err(PyTypeError::new_err(format!(
                    "`scheme` is a {name}, it must be a name or an object with a method `step(system, dt)` or \
                     `solve(system, dt)`"
                )))
            }
        }
    }

    /// Lends the mixture to a method of the object, for a part of a step; what it left.
    fn call(&self, mixture: &mut Mixture<2>, method: &str, part: Part, report: StepReport) -> Result<Held> {
        Python::attach(|py| {
            let system = System { held: Mutex::new(None), raised: self.raised.clone() };
            let system = Bound::new(py, system).map_err(|raised| self.raised.keep(py, raised))?;
            // Python may keep the system: it is lent what it works on, and gives it back.
            system.get().lend(Held::new(std::mem::take(mixture), part, (method == "step", report)));
            let outcome = self.object.bind(py).call_method1(method, (&system, part.dt));
            let mut held = system.get().give_back();
            std::mem::swap(mixture, &mut held.mixture);
            outcome.map_err(|raised| self.raised.keep(py, raised))?;
            Ok(held)
        })
    }
}

/// The error of a scheme that leaves a step otherwise than it must.
fn unfinished<T>(what: String, help: &str) -> Result<T> {
    Err(Error::run(Notice::new(what, help)))
}

/// Checks that grains and fluid went as far as the step.
fn check_times(held: &Held, mixture: &Mixture<2>, fluid: f64) -> Result<()> {
    let whole = held.part.dt;
    if (fluid - whole).abs() > SAME * whole {
        let what = format!("the scheme accepted {fluid:e} s of the fluid in a step of {whole:e} s");
        return unfinished(
            what,
            "the lengths of the solutions that are accepted are those of a step together",
        );
    }
    let moved = mixture.grains.time() - held.start;
    if (moved - whole).abs() > SAME * whole + 4.0 * f64::EPSILON * held.start.abs() {
        let what = format!("the scheme moved the grains by {moved:e} s in a step of {whole:e} s");
        return unfinished(
            what,
            "the lengths of the motions that are not taken back are those of a step together",
        );
    }
    Ok(())
}

/// Whether a grain would have gone too far, so that none has moved.
fn runs_away(report: &StepReport) -> bool {
    report.grains.is_some_and(|grains| grains.runaway.is_some())
}

impl Scheme<2> for PythonScheme {
    fn step(&mut self, mixture: &mut Mixture<2>, dt: f64) -> Result<StepReport> {
        let mut held = self.call(mixture, "step", Part::whole(dt), StepReport::default())?;
        if runs_away(&held.report) {
            return Ok(held.report);
        }
        if held.accepted == 0 {
            return unfinished(
                "the scheme accepted 0 solutions in a step".into(),
                "end `step` with `system.accept()`",
            );
        }
        check_times(&held, mixture, held.done)?;
        mixture.end_step(&mut held.report);
        held.report.agreement = held.sum;
        Ok(held.report)
    }
}

impl Trial<2> for PythonScheme {
    fn solve(&mut self, mixture: &mut Mixture<2>, part: Part, report: &mut StepReport) -> Result<Agreement> {
        let held = self.call(mixture, "solve", part, *report)?;
        *report = held.report;
        if runs_away(report) {
            return Ok(Agreement { solves: held.solves, ..Agreement::default() });
        }
        if held.solves == 0 {
            return unfinished("the scheme did not solve the fluid".into(), "call `system.solve_fluid()`");
        }
        check_times(&held, mixture, held.solved)?;
        let agreement = held.agreement(mixture);
        (self.lost, self.carries) = (held.lost, held.carries);
        Ok(agreement)
    }

    fn repeats(&self) -> bool {
        // Whether its answers can be told to agree by the object alone: an attribute of its class.
        Python::attach(|py| {
            self.object.bind(py).getattr("repeats").is_ok_and(|repeats| repeats.is_truthy().unwrap_or(false))
        })
    }

    fn settle(
        &mut self,
        mixture: &mut Mixture<2>,
        Part { dt, whole }: Part,
        agreement: Agreement,
    ) -> Agreement {
        match self.carries {
            true => Agreement { carried: mixture.carry(&self.lost, dt, whole), ..agreement },
            false => agreement,
        }
    }
}

/// The scheme of a file, `python:FILE[:CLASS]`.
pub fn make(own: Own, options: &Options) -> Result<Box<dyn Scheme<2>>> {
    Python::attach(|py| {
        let raised = Raised::default();
        let object = load(py, own, &options.own)
            .and_then(|object| PythonScheme::scheme(&object, options.cut, raised.clone()));
        object.map_err(|error| {
            let told = crate::errors::told(py, &error);
            Error::input(Notice::from(told).within(format!("the scheme {}", own.name())))
        })
    })
}

/// An object of the class of a file: the one that is named, or the only one with a method of a scheme.
fn load<'py>(
    py: Python<'py>,
    own: Own,
    options: &BTreeMap<String, serde_json::Value>,
) -> PyResult<Bound<'py, PyAny>> {
    let (file, class) = own.place();
    let module = py.import("voidage.files")?.call_method1("load", (file,))?;
    let class = py.import("voidage.files")?.call_method1("scheme_class", (&module, file, class))?;
    let text = serde_json::to_string(options).map_err(|error| PyValueError::new_err(error.to_string()))?;
    let keywords = py.import("json")?.call_method1("loads", (text,))?.cast_into::<PyDict>()?;
    class.call((), Some(&keywords))
}

/// What a scheme works on, during its step.
pub struct Held {
    /// Grains and fluid.
    pub mixture: Mixture<2>,
    report: StepReport,
    /// The part of a step that it does.
    part: Part,
    /// Length of the part of it that is in hand.
    dt: f64,
    /// Time of the grains at its start, s.
    start: f64,
    /// Length of the last solution, and what the fluid lost in it.
    solved: f64,
    lost: Lost<2>,
    /// Solutions, and those since the last that was accepted.
    solves: usize,
    /// Whether the grains moved by the force of the law in the last motion.
    by_law: bool,
    /// Whether what the fluid did not lose is carried.
    carries: bool,
    /// Whether the scheme may accept, how many it has accepted, and the sum of their lengths.
    accepts: bool,
    accepted: usize,
    done: f64,
    sum: Option<Agreement>,
}

impl Held {
    fn new(mixture: Mixture<2>, part: Part, (accepts, report): (bool, StepReport)) -> Self {
        let start = mixture.grains.time();
        Self {
            mixture,
            report,
            part,
            dt: part.dt,
            start,
            solved: 0.0,
            lost: Lost::default(),
            solves: 0,
            by_law: true,
            carries: false,
            accepts,
            accepted: 0,
            done: 0.0,
            sum: None,
        }
    }

    /// How far the grains are from what the fluid expected of them in its last solution.
    fn agreement(&self, mixture: &Mixture<2>) -> Agreement {
        let agreement = match (mixture.motions.time() > 0.0, self.by_law) {
            (false, _) => Agreement { converged: true, parts: 1, ..Agreement::default() },
            (true, true) => agreement(mixture, self.solved),
            (true, false) => mixture.compare(&self.lost, self.solved),
        };
        Agreement { solves: self.solves, ..agreement }
    }

    /// A length of a solution or a motion, by default that of the part.
    fn length(&self, dt: Option<f64>) -> Result<f64> {
        let dt = dt.unwrap_or(self.dt);
        match dt > 0.0 && dt <= self.part.dt * (1.0 + SAME) {
            true => Ok(dt),
            false => {
                let what = format!("a length of {dt:e} s in a step of {:e} s", self.part.dt);
                Err(Error::input(Notice::new(what, "give one above 0 and at most that of the step")))
            }
        }
    }

    fn accept(&mut self) -> Result<()> {
        if !self.accepts {
            return Err(Error::run(Notice::new(
                "`solve(system, dt)` called `accept`",
                "leave it out: the step is accepted after `solve`; or call the method `step`",
            )));
        }
        // A solution that is missing is told by the mixture.
        if self.solves > 0 {
            let agreement = self.agreement(&self.mixture);
            let carried = match self.carries {
                true => self.mixture.carry(&self.lost, self.solved, self.part.dt),
                false => 0.0,
            };
            self.sum = Some(Agreement { carried, ..agreement }.after(self.sum.as_ref(), 0));
        }
        let part = Part { dt: self.solved, whole: self.part.dt };
        self.mixture.accept_part(part, &mut self.report)?;
        self.done += self.solved;
        self.accepted += 1;
        (self.solves, self.by_law) = (0, true);
        Ok(())
    }
}

/// Grains and fluid as a scheme sees them, during one call of its method: the phases of a step, and the columns that
/// they read and write.
#[pyclass(frozen, module = "voidage")]
pub struct System {
    held: Mutex<Option<Held>>,
    raised: Raised,
}

/// Positions, velocities, contacts and all else that makes the grains what they are at one moment.
#[pyclass(frozen, module = "voidage")]
pub struct GrainState {
    state: voidage_dem::State<2>,
    motions: Motions<2>,
    means: Means<2>,
}

impl System {
    fn lend(&self, held: Held) {
        *self.held.lock().unwrap_or_else(PoisonError::into_inner) = Some(held);
    }

    fn give_back(&self) -> Held {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner).take();
        // It is there: nothing else takes it.
        held.unwrap_or_else(|| {
            Held::new(Mixture::default(), Part::whole(0.0), (false, StepReport::default()))
        })
    }

    /// Number of grains, and whether grains and fluid exchange heat.
    fn counts(&self, py: Python<'_>) -> PyResult<(usize, bool)> {
        self.with(py, |held| {
            let interaction = &held.mixture.interaction;
            Ok((interaction.force.len(), interaction.load.heat.is_some()))
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
                None => Err(Error::run("the system can be used inside `step` or `solve` of the scheme only")),
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

    /// Begins a part of the step, of `dt` s: the mesh goes to where it is at its end, and the phases take this length where
    /// none is given. Without, the step is one part.
    fn begin(&self, py: Python<'_>, dt: f64) -> PyResult<()> {
        self.with(py, |held| {
            held.dt = held.length(Some(dt))?;
            held.mixture.begin_part(dt);
            Ok(())
        })
    }

    /// Fills `load["drag"]`, `load["known"]` and `load["heat_coefficient"]` by the laws of the scene, and the voidage at
    /// the grains, for a solution or a motion of `dt` s. `known` is the part of the forcing drag u - volume grad p +
    /// known that the fluid does not change, of added mass and lift; zero without them.
    #[pyo3(signature = (dt=None))]
    fn evaluate_closures(&self, py: Python<'_>, dt: Option<f64>) -> PyResult<()> {
        self.with(py, |held| held.mixture.evaluate_closures(held.length(dt)?, &mut held.report))
    }

    /// Solves the fluid over `dt` s from its last accepted state: fills `at_grains`, `grains["force"]` and
    /// `grains["heat"]`.
    #[pyo3(signature = (dt=None))]
    fn solve_fluid(&self, py: Python<'_>, dt: Option<f64>) -> PyResult<()> {
        self.with(py, |held| {
            held.solved = held.length(dt)?;
            held.mixture.solve_fluid(held.solved, &mut held.report)?;
            held.solves += 1;
            held.lost.read(&held.mixture.interaction);
            Ok(())
        })
    }

    /// Moves the grains by `dt` s under `force` (g, D), N, and `heat` (g), W, contacts included; without, under those of the
    /// last solution, `grains["force"]` and `grains["heat"]`.
    #[pyo3(signature = (dt=None, force=None, heat=None))]
    fn move_grains(
        &self,
        py: Python<'_>,
        dt: Option<f64>,
        force: Option<&Bound<'_, PyAny>>,
        heat: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (count, warm) = self.counts(py)?;
        let force = force.map(|force| finite_numbers(force, "force", Some(count), 2)).transpose()?;
        let heat = match (heat, warm) {
            (Some(heat), true) => Some(finite_numbers(heat, "heat", Some(count), 1)?),
            (Some(_), false) => return Err(PyValueError::new_err("`heat` is given, the scene has none")),
            (None, _) => None,
        };
        self.with(py, |held| {
            let interaction = &mut held.mixture.interaction;
            if let Some(force) = force {
                interaction.force = vectors(&force);
            }
            if let Some(heat) = heat {
                interaction.heat = heat;
            }
            held.mixture.move_grains(held.length(dt)?, &mut held.report);
            held.by_law = true;
            Ok(())
        })
    }

    /// Moves the grains by `dt` s under `force` (g, D), N, and `heat` (g), W, from which the drag and the heat transfer of
    /// the grains themselves go off, `load["drag"]` v and `load["heat_coefficient"]` T, implicitly; contacts included.
    /// Returns the mean velocity in the motion, (g, D), with added mass what drag and added mass felt of it, and the
    /// mean temperature, (g), if there is heat; `grains["force"]` and `grains["heat"]` are then what is left of the
    /// forcing.
    #[pyo3(signature = (force, heat=None, dt=None))]
    fn drive_grains<'py>(
        &self,
        py: Python<'py>,
        force: &Bound<'py, PyAny>,
        heat: Option<&Bound<'py, PyAny>>,
        dt: Option<f64>,
    ) -> PyResult<(Bound<'py, PyAny>, Option<Bound<'py, PyAny>>)> {
        let (count, warm) = self.counts(py)?;
        let force = vectors(&finite_numbers(force, "force", Some(count), 2)?);
        let heat = match (heat, warm) {
            (Some(heat), true) => finite_numbers(heat, "heat", Some(count), 1)?,
            (None, false) => vec![],
            (Some(_), false) => return Err(PyValueError::new_err("`heat` is given, the scene has none")),
            (None, true) => return Err(PyValueError::new_err("`heat` is missing, the scene has heat")),
        };
        let forcing = Forcing { force, heat };
        let (velocity, temperature) = self.with(py, |held| {
            let dt = held.length(dt)?;
            held.mixture.drive_grains(dt, &forcing, &mut held.report)?;
            held.by_law = false;
            let Mixture { interaction, motions, .. } = &mut held.mixture;
            for (i, felt) in motions.felt.iter().enumerate() {
                interaction.force[i] = forcing.force[i] - felt * interaction.load.drag[i];
            }
            if let Some(law) = &interaction.load.heat {
                for (i, temperature) in motions.warmed.iter().enumerate() {
                    interaction.heat[i] = forcing.heat[i] - temperature * law.coefficient[i];
                }
            }
            let temperature = warm.then(|| Column::from(&motions.warmed[..]));
            Ok((Column::from(&motions.felt[..]), temperature))
        })?;
        let temperature = temperature.map(|column| column.into_array(py)).transpose()?;
        Ok((velocity.into_array(py)?, temperature))
    }

    /// Lowers the laws of `load["velocity"]` and `load["temperature"]`, once they are filled, so that the fluid gets
    /// `share` of the impulse and heat that are carried of earlier steps. From then on what grains get beyond what the
    /// fluid loses is carried, so that momentum and heat are kept over the steps.
    #[pyo3(signature = (share=0.5))]
    fn give_back_carried(&self, py: Python<'_>, share: f64) -> PyResult<()> {
        self.with(py, |held| {
            if !(share > 0.0 && share <= 1.0) {
                let what = format!("a share of {share} to give back");
                return Err(Error::input(Notice::new(what, "give one above 0 and at most 1")));
            }
            held.carries = true;
            held.mixture.give_back(share, held.part.whole);
            Ok(())
        })
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

    /// Accepts the last solution of the fluid and moves the clock by its length: the end of a step, or of a part of it. The
    /// lengths of all that are accepted, and of all motions of the grains, are that of the step together.
    fn accept(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, Held::accept)
    }

    /// The grains as they are now, to come back to.
    fn grain_state(&self, py: Python<'_>) -> PyResult<GrainState> {
        self.with(py, |held| {
            let Mixture { grains, motions, .. } = &held.mixture;
            Ok(GrainState { state: grains.state(), motions: motions.clone(), means: grains.means() })
        })
    }

    /// Puts the grains back to a state taken before in this step. RuntimeError if grains have come or gone since.
    fn restore_grains(&self, py: Python<'_>, state: &GrainState) -> PyResult<()> {
        self.with(py, |held| {
            let Mixture { grains, motions, .. } = &mut held.mixture;
            if state.state.particles.id != grains.particles.id {
                return Err(Error::run(
                    "the state is of other grains: take it in the step in which it is restored",
                ));
            }
            grains.restore(state.state.clone())?;
            grains.set_means(state.means.clone());
            motions.clone_from(&state.motions);
            Ok(())
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

    /// Time of the fluid, s: that at the start of the step, and of the last part that was accepted.
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
