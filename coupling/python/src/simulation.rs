//! Whole simulations driven from Python.

use crate::columns::{Columns, Group, Owner};
use crate::errors::{Raised, exception};
use crate::mesh::Mesh;
use crate::report;
use crate::scheme::PythonScheme;
use crate::solver::PythonFluid;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use voidage_coupling::scheme::{Scheme, SchemeName};
use voidage_coupling::{Coupled, Notice, StepReport};
use voidage_remote::launch::Host;
use voidage_scene::recorder::{Checkpoint, Kept, Stamp};
use voidage_scene::{Scene, Solver, Time};

/// A scene in motion.
///
/// `scene` is the path of a scene file or the name of a shipped case, `set` changes keys of it, as in
/// {"fluid.solver.newton": 2} or ["fluid.solver.newton=2"]. `fluid` is the name of a solver as `voidage run --fluid`
/// has it, or a solver in this process, an object with the methods of `voidage.Solver`; without it the scene says
/// which. `scheme` is the name of a coupling scheme or an object with a method `step(system, dt)`. `restart` is a
/// checkpoint of the same scene to go on from. `threads` is the number of threads of this process; results do not
/// depend on it. `log` gets the output of a solver in a process of its own.
#[pyclass(module = "voidage")]
pub struct Simulation {
    /// Never contended: it makes of what may be sent to another thread something that may be shared.
    inner: Mutex<voidage_scene::Simulation>,
    scene: Scene,
    last: StepReport,
    raised: Raised,
}

#[pymethods]
impl Simulation {
    #[allow(clippy::too_many_arguments, reason = "in Python they are keywords")]
    #[new]
    #[pyo3(signature = (scene, set=None, *, fluid=None, scheme=None, restart=None, threads=None, log=None))]
    fn new(
        py: Python<'_>,
        scene: PathBuf,
        set: Option<Bound<'_, PyAny>>,
        fluid: Option<Bound<'_, PyAny>>,
        scheme: Option<Bound<'_, PyAny>>,
        restart: Option<PathBuf>,
        threads: Option<usize>,
        log: Option<PathBuf>,
    ) -> PyResult<Self> {
        if let Some(threads) = threads {
            start_threads(threads)?;
        }
        let (raised, mut set) = (Raised::default(), set.map_or(Ok(vec![]), |set| settings(&set))?);
        let fluid = Choice::new(fluid);
        let scheme = Choice::new(scheme);
        if let Some(name) = &fluid.name {
            let solver = name.parse::<Solver>();
            set.push(solver.map_err(|error| PyValueError::new_err(format!("fluid {error}")))?.setting());
        }
        if let Some(name) = &scheme.name {
            let scheme =
                name.parse::<SchemeName>().map_err(|error| PyValueError::new_err(error.to_string()))?;
            let scheme = std::env::current_dir().map_or(scheme, |folder| scheme.within(&folder));
            set.push(format!("coupling.scheme={:?}", scheme.name()));
        }
        let mut scene = voidage_program::shipped::read(&scene, &set).map_err(|error| exception(&error))?;
        let fluid = fluid.object.map(|object| python_fluid(&mut scene, &object, &raised)).transpose()?;
        let cut = scene.coupling.as_ref().and_then(|coupling| coupling.cut);
        let scheme =
            scheme.object.map(|object| PythonScheme::scheme(&object, cut, raised.clone())).transpose()?;
        let inner = py
            .detach(|| build(&scene, fluid, scheme, restart.as_deref(), log))
            .map_err(|error| raised.exception(py, &error))?;
        Ok(Self { inner: Mutex::new(inner), scene, last: StepReport::default(), raised })
    }

    /// One step. Returns its report: wall time of the phases, contacts, residuals, defects of the exchange.
    fn step<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.advance(py)?;
        report::dictionary(py, &self.last)
    }

    /// Steps to the end of the scene, or to time `until`, s. Returns the report of the last step.
    #[pyo3(signature = (until=None))]
    fn run<'py>(&mut self, py: Python<'py>, until: Option<f64>) -> PyResult<Bound<'py, PyDict>> {
        let end = until.unwrap_or(self.scene.time.end);
        if !end.is_finite() {
            return Err(PyValueError::new_err(format!("`until` is {end}, it must be finite")));
        }
        let last = Time { step: self.scene.time.step, end }.steps();
        while self.inner().steps() < last {
            py.check_signals()?;
            self.advance(py)?;
        }
        report::dictionary(py, &self.last)
    }

    /// Time, s.
    #[getter]
    fn time(&mut self) -> f64 {
        self.inner().time()
    }

    /// Steps done since time zero.
    #[getter]
    fn steps(&mut self) -> u64 {
        self.inner().steps()
    }

    /// Length of a step, s.
    #[getter]
    fn dt(&self) -> f64 {
        self.scene.time.step
    }

    /// Time at which the scene ends, s.
    #[getter]
    fn end(&self) -> f64 {
        self.scene.time.end
    }

    /// The title of the scene.
    #[getter]
    fn title(&self) -> &str {
        &self.scene.title
    }

    /// Report of the last step.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        report::dictionary(py, &self.last)
    }

    /// Columns of the grains: a mapping from names to arrays, rows in the order of the scene.
    #[getter]
    fn grains(this: Bound<'_, Self>) -> Columns {
        Columns { owner: Owner::Simulation(this.unbind()), group: Group::Grains }
    }

    /// Nodal fields of the fluid: a mapping from names to arrays, rows in the order of `mesh.points`.
    #[getter]
    fn fluid(this: Bound<'_, Self>) -> Columns {
        Columns { owner: Owner::Simulation(this.unbind()), group: Group::Fluid }
    }

    /// The mesh of the fluid; None without fluid.
    #[getter]
    fn mesh(&mut self, py: Python<'_>) -> PyResult<Option<Mesh>> {
        self.inner().coupled().fluid().map(|fluid| Mesh::new(py, &fluid.mesh)).transpose()
    }

    /// Writes a checkpoint to the file `path`; `Simulation(.., restart=path)` and `voidage run --restart` go on from it
    /// bit for bit as this simulation does.
    fn checkpoint(&mut self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let Self { inner, scene, raised, .. } = self;
        let inner = inner.get_mut().unwrap_or_else(PoisonError::into_inner);
        py.detach(|| {
            let stamp = Stamp { scene_hash: scene.hash()?, step: inner.steps(), time: inner.time() };
            // There are no averages over time to go on with.
            let kept = Kept::of(scene)?;
            Checkpoint::write(&path, &stamp, &inner.state()?, &kept)
        })
        .map_err(|error| raised.exception(py, &error))
    }

    fn __repr__(&mut self) -> String {
        let (title, time, steps) = (self.scene.title.clone(), self.inner().time(), self.inner().steps());
        format!("<simulation `{title}` at t = {time} s, step {steps}>")
    }
}

impl Simulation {
    fn inner(&mut self) -> &mut voidage_scene::Simulation {
        self.inner.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    fn advance(&mut self, py: Python<'_>) -> PyResult<()> {
        let raised = self.raised.clone();
        let inner = self.inner();
        let report = py.detach(|| inner.step()).map_err(|error| raised.exception(py, &error))?;
        self.last = report;
        // Accepting a solution cannot fail in Rust; in Python it can.
        raised.check(py)
    }

    /// Works on the coupled system between two steps, without the interpreter.
    pub fn with<R: Send>(
        this: &Bound<'_, Self>,
        work: impl FnOnce(&mut Coupled<2>) -> voidage_coupling::Result<R> + Send,
    ) -> PyResult<R> {
        let mut simulation = this.try_borrow_mut().map_err(|_| {
            let what = "the simulation is in the middle of a step";
            let notice = Notice::new(what, "a scheme works on the `system` that it is given");
            PyRuntimeError::new_err(notice.to_string())
        })?;
        let raised = simulation.raised.clone();
        let inner = simulation.inner();
        this.py().detach(|| work(inner.coupled_mut())).map_err(|error| raised.exception(this.py(), &error))
    }
}

/// A choice by name, or by an object to use.
struct Choice<'py> {
    name: Option<String>,
    object: Option<Bound<'py, PyAny>>,
}

impl<'py> Choice<'py> {
    fn new(value: Option<Bound<'py, PyAny>>) -> Self {
        match value.as_ref().map(|value| value.extract::<String>()) {
            Some(Ok(name)) => Self { name: Some(name), object: None },
            _ => Self { name: None, object: value },
        }
    }
}

/// Changes of keys as texts `key=value`, from such texts or a dictionary.
fn settings(set: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    let Ok(pairs) = set.cast::<PyDict>() else { return set.extract() };
    // Numbers, words and lists are written in JSON as in TOML.
    let written = set.py().import("json")?.getattr("dumps")?;
    let text = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        Ok(format!("{}={}", key.extract::<String>()?, written.call1((value,))?.extract::<String>()?))
    };
    pairs.iter().map(text).collect()
}

/// The solver of an object, in the place of that of the scene.
fn python_fluid(scene: &mut Scene, object: &Bound<'_, PyAny>, raised: &Raised) -> PyResult<PythonFluid> {
    let Some(setup) = voidage_scene::build::setup(scene) else {
        return Err(PyValueError::new_err("`fluid` is given, but the scene has no fluid"));
    };
    scene.fluid.iter_mut().for_each(|fluid| fluid.backend = None);
    PythonFluid::new(object, &setup, raised.clone())
}

fn build(
    scene: &Scene,
    fluid: Option<PythonFluid>,
    scheme: Option<Box<dyn Scheme<2>>>,
    restart: Option<&Path>,
    log: Option<PathBuf>,
) -> voidage_coupling::Result<voidage_scene::Simulation> {
    let host = Host::default();
    let host = Host { log: log.unwrap_or(host.log), ..host };
    if scheme.is_some() {
        scene.check_own_scheme()?;
    }
    let checkpoint = restart.map(|file| Checkpoint::read(file, &scene.hash()?)).transpose()?;
    let mut simulation = match &checkpoint {
        None => voidage_scene::Simulation::hosted(scene, &host)?,
        Some(checkpoint) => voidage_scene::Simulation::restarted(scene, &host, checkpoint)?,
    };
    let coupled = simulation.coupled_mut();
    if let Some(scheme) = scheme {
        coupled.set_scheme(scheme);
    }
    if let (Some(solver), Some(fluid)) = (fluid, coupled.fluid_mut()) {
        fluid.backend = Box::new(solver);
        fluid.start()?;
    }
    Ok(simulation)
}

/// The threads of this process; they can be started once.
fn start_threads(threads: usize) -> PyResult<()> {
    let wrong = |what: &str, help| PyValueError::new_err(Notice::new(what, help).to_string());
    if threads == 0 {
        return Err(wrong("threads=0: there must be a thread", "give 1 or more"));
    }
    let started = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    let running = rayon::current_num_threads();
    match started {
        Err(_) if running != threads => {
            let what = format!("threads={threads}: this process has started {running} threads before");
            Err(wrong(&what, "give `threads` to the first simulation, or set RAYON_NUM_THREADS"))
        }
        _ => Ok(()),
    }
}
