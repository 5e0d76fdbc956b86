//! The solver's end of the exchange with a run in another process.

use crate::arrays::Column as Copied;
use crate::mesh::Mesh;
use crate::solver::{field_arrays, motion_arrays, piece_arrays, read_report};
use crate::views::{self, Memory};
use pyo3::exceptions::{PyBufferError, PyKeyError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use voidage_coupling::PeerError;
use voidage_coupling::backend::FluidReport;
use voidage_coupling::protocol::{
    COLUMNS, Column, FIELDS, HEAT, Header, Kind, Layout, MotionPlaces, PiecePlaces, SOLUTION, dimension,
    read_fields, read_mesh, read_step,
};
use voidage_coupling::transport::{self, Address, LOOK};
use voidage_fluid::MeshMotion;

fn exception(error: PeerError) -> PyErr {
    PyRuntimeError::new_err(match error {
        PeerError::Gone => "the run is gone".to_owned(),
        other => other.to_string(),
    })
}

fn seconds(value: f64, name: &str) -> PyResult<Duration> {
    Duration::try_from_secs_f64(value)
        .map_err(|error| PyValueError::new_err(format!("{name}={value}: {error}")))
}

/// The connection of a fluid solver to its run. The run asks, the solver answers each request once; while it works on
/// one, signs of life go out by themselves.
#[pyclass(module = "voidage")]
pub struct Peer {
    /// Never contended: it makes of what may be sent to another thread something that may be shared.
    inner: Mutex<voidage_coupling::peer::Peer>,
    setup: String,
    nodes: usize,
    cells: usize,
}

#[pymethods]
impl Peer {
    /// Connects to the run at `address` (`shm:NAME` or `tcp:HOST:PORT`), waiting at most `wait` seconds for it to be
    /// there. `solver` is the name to present oneself with.
    #[new]
    #[pyo3(signature = (address, solver, *, wait=60.0))]
    fn new(py: Python<'_>, address: &str, solver: String, wait: f64) -> PyResult<Self> {
        let address: Address = address.parse().map_err(PyValueError::new_err)?;
        let wait = seconds(wait, "wait")?;
        let (sender, receiver) = channel();
        // In a thread of its own, so that signals are seen meanwhile; one that is left behind ends with its wait.
        std::thread::spawn(move || {
            let connected = voidage_coupling::peer::Peer::connect(&address, &solver, wait);
            // After an interrupt nobody waits for it any more.
            let _ = sender.send(connected.map(|(peer, setup)| (Mutex::new(peer), setup)));
        });
        let receiver = Mutex::new(receiver);
        loop {
            py.check_signals()?;
            let waited =
                py.detach(|| receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK));
            match waited {
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(PyRuntimeError::new_err("the connection failed"));
                }
                Ok(connected) => {
                    let (inner, setup) = connected.map_err(exception)?;
                    return match dimension(&setup).map_err(exception)? {
                        2 => Ok(Self { inner, setup, nodes: 0, cells: 0 }),
                        other => Err(PyRuntimeError::new_err(format!(
                            "the run has {other} dimensions, grains are cut by the mesh in the plane only"
                        ))),
                    };
                }
            }
        }
    }

    /// What the run tells once: properties, numerics and boundary conditions, as JSON.
    #[getter]
    fn setup(&self) -> &str {
        &self.setup
    }

    /// From now on this process ends, with exit code 1, when the run is gone while a request is being answered.
    fn end_with_run(&mut self) {
        self.inner().end_with_run();
    }

    /// Waits for a request, at most `timeout` seconds; None if there is none yet. Other threads go on meanwhile, and
    /// signals are seen.
    fn receive(&mut self, py: Python<'_>, timeout: f64) -> PyResult<Option<Frame>> {
        let (start, timeout) = (Instant::now(), seconds(timeout, "timeout")?);
        loop {
            let wait = timeout.saturating_sub(start.elapsed()).min(LOOK);
            let inner = self.inner();
            let frame = py.detach(|| inner.receive(wait)).map_err(exception)?;
            py.check_signals()?;
            match frame {
                Some(frame) => return self.understand(frame).map(Some),
                None if start.elapsed() >= timeout => return Ok(None),
                None => {}
            }
        }
    }

    /// Memory for the answer to a step: columns `velocity`, `pressure_gradient` and, with `heat`, `temperature` of so
    /// many grains.
    fn solution(&mut self, py: Python<'_>, grains: usize, heat: bool) -> PyResult<Answer> {
        let layout = Layout::new(2, grains, &[SOLUTION, if heat { HEAT } else { &[] }], 0);
        let header = layout.describe(Kind::Solution, layout.end() + FluidReport::<2>::NUMBERS);
        self.answer(py, header, layout)
    }

    /// Memory for the answer to a request for fields: columns `velocity`, `pressure` and, with `heat`, `temperature`
    /// at the nodes.
    fn fields(&mut self, py: Python<'_>, heat: bool) -> PyResult<Answer> {
        let layout = Layout::new(2, self.nodes, &[FIELDS, if heat { HEAT } else { &[] }], 0);
        self.answer(py, layout.describe(Kind::Fields, layout.end()), layout)
    }

    /// Sends an answer. Raises BufferError while a view of it is in use: what is sent belongs to the run.
    fn send(&mut self, py: Python<'_>, answer: &mut Answer) -> PyResult<()> {
        if let Some(column) = answer.unwritten.first() {
            return Err(PyValueError::new_err(format!("`{}` of the answer was not written", column.name())));
        }
        if answer.unreported {
            return Err(PyValueError::new_err("the report of the answer was not written"));
        }
        let memory = answer.memory()?;
        if views::in_use(memory.bind(py)) {
            return Err(PyBufferError::new_err("views of the answer are still in use: delete them before"));
        }
        let loan = memory.get().take();
        answer.memory = None;
        let (header, inner) = (answer.header, self.inner());
        match loan {
            Some(loan) => py.detach(|| inner.answer(&header, loan)).map_err(exception),
            None => Err(sent()),
        }
    }

    /// Answers that a mesh or a state has been taken.
    fn done(&mut self, py: Python<'_>) -> PyResult<()> {
        let inner = self.inner();
        py.detach(|| inner.done()).map_err(exception)
    }

    /// Answers that the request cannot be fulfilled; the user will read `text`.
    fn fail(&mut self, py: Python<'_>, text: &str) -> PyResult<()> {
        let inner = self.inner();
        py.detach(|| inner.fail(text)).map_err(exception)
    }
}

impl Peer {
    fn inner(&mut self) -> &mut voidage_coupling::peer::Peer {
        self.inner.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    fn understand(&mut self, frame: transport::Frame) -> PyResult<Frame> {
        if frame.kind() == Kind::Mesh {
            self.nodes = frame.header().rows as usize;
            self.cells = frame.header().cells as usize;
        }
        let (layout, pieces, motion) = match frame.kind() {
            Kind::Step => {
                let step = read_step::<2>(frame.header(), frame.payload()).map_err(exception)?;
                (step.layout, step.pieces, step.motion)
            }
            _ => (Layout::new(2, 0, &[], 0), None, None),
        };
        Ok(Frame { frame, layout, pieces, motion, nodes: self.nodes, cells: self.cells })
    }

    fn answer(&mut self, py: Python<'_>, header: Header, layout: Layout) -> PyResult<Answer> {
        let inner = self.inner();
        let loan = py.detach(|| inner.loan(header.length as usize)).map_err(exception)?;
        let to_write = |column: &Column| layout.range(*column).is_some_and(|range| !range.is_empty());
        let unwritten = COLUMNS.into_iter().filter(to_write).collect();
        let memory = Some(Py::new(py, Memory::new(loan))?);
        let unreported = header.kind == Kind::Solution as u32;
        Ok(Answer { header, layout, memory, unwritten, unreported })
    }
}

fn column(name: &str, layout: &Layout) -> PyResult<Column> {
    let there = |column: &Column| layout.range(*column).is_some();
    COLUMNS.into_iter().filter(there).find(|column| column.name() == name).ok_or_else(|| {
        let names: Vec<_> = COLUMNS.iter().filter(|column| there(column)).map(|c| c.name()).collect();
        PyKeyError::new_err(format!("no column `{name}` here; there are {}", names.join(", ")))
    })
}

/// A request as it was received. `frame[name]` is a read-only view of a column where it lies in shared memory; the
/// view keeps the memory. Not more than three frames can be kept at a time.
#[pyclass(frozen, module = "voidage")]
pub struct Frame {
    frame: transport::Frame,
    layout: Layout,
    pieces: Option<PiecePlaces>,
    motion: Option<MotionPlaces>,
    nodes: usize,
    cells: usize,
}

#[pymethods]
impl Frame {
    /// `mesh`, `state`, `step`, `fields` or `bye`.
    #[getter]
    fn kind(&self) -> String {
        format!("{:?}", self.frame.kind()).to_lowercase()
    }

    /// Whether the last solution is accepted, before anything else is done.
    #[getter]
    fn accepts(&self) -> bool {
        self.frame.header().accepts()
    }

    /// Number of the step; the first is 1.
    #[getter]
    fn step(&self) -> u64 {
        self.frame.header().step
    }

    /// How many solutions of this step went before.
    #[getter]
    fn iteration(&self) -> u32 {
        self.frame.header().iteration
    }

    /// Time at the start of the step, s.
    #[getter]
    fn time(&self) -> f64 {
        self.frame.header().time
    }

    /// Length of the step, s.
    #[getter]
    fn dt(&self) -> f64 {
        self.frame.header().dt
    }

    /// Conditions of a step as JSON; empty if they are those of the last.
    #[getter]
    fn text(&self) -> PyResult<String> {
        self.frame.text().map_err(exception)
    }

    /// The mesh of a request of the kind `mesh`.
    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        let (mesh, _) = read_mesh::<2>(self.frame.header(), self.frame.payload()).map_err(exception)?;
        Mesh::new(py, &mesh)
    }

    /// Copies of the accepted fields of a request of the kind `mesh` or `state`, by name.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (header, payload) = (self.frame.header(), self.frame.payload());
        let fields = match self.frame.kind() {
            Kind::Mesh => read_mesh::<2>(header, payload).map(|(_, fields)| fields),
            _ => read_fields::<2>(header, payload, self.nodes),
        };
        field_arrays(py, &fields.map_err(exception)?)
    }

    /// Copies of the pieces of the grains of a step, `(first, cell, shape, share)` as [`Overlap.cut`] returns them;
    /// None without grains.
    fn pieces<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyTuple>>> {
        let Some(places) = &self.pieces else { return Ok(None) };
        let pieces = places.read(self.payload(), self.cells).map_err(exception)?;
        piece_arrays(py, &pieces).map(Some)
    }

    /// A copy of the nodal voidage of a step (n,); None without grains.
    fn voidage<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(places) = &self.pieces else { return Ok(None) };
        let numbers = self.payload()[places.voidage.clone()].to_vec();
        Copied { numbers, width: 1 }.into_array(py).map(Some)
    }

    /// Copies of the places of the nodes at the end of a step and of their velocities, (n, 2) each; None if the mesh stands
    /// still.
    fn motion<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyTuple>>> {
        let Some(places) = &self.motion else { return Ok(None) };
        let [points, velocity] = places.read::<2>(self.payload());
        motion_arrays(py, &MeshMotion { points: &points, velocity: &velocity }).map(Some)
    }

    /// Names of the columns of a step.
    fn keys(&self) -> Vec<&'static str> {
        let there = |column: &&Column| self.layout.range(**column).is_some();
        COLUMNS.iter().filter(there).map(|column| column.name()).collect()
    }

    fn __contains__(&self, name: &str) -> bool {
        self.keys().contains(&name)
    }

    fn __getitem__<'py>(this: Bound<'py, Self>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let frame = this.get();
        Ok(views::read_only(&this, &frame.layout, column(name, &frame.layout)?))
    }

    fn __repr__(&self) -> String {
        format!("<frame {} of step {}>", self.kind(), self.step())
    }
}

impl Frame {
    /// The numbers of the payload.
    pub fn payload(&self) -> &[f64] {
        self.frame.payload()
    }
}

fn sent() -> PyErr {
    PyRuntimeError::new_err("the answer has been sent")
}

/// Memory for an answer. `answer[name] = array` writes a column; `answer[name]` is a writable view of it, which must be
/// gone when the answer is sent.
#[pyclass(module = "voidage")]
pub struct Answer {
    header: Header,
    layout: Layout,
    memory: Option<Py<Memory>>,
    /// The memory comes with what was in it before: none of it must be sent.
    unwritten: Vec<Column>,
    unreported: bool,
}

#[pymethods]
impl Answer {
    fn __getitem__<'py>(&mut self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let column = column(name, &self.layout)?;
        let view = views::writable(self.memory()?.bind(py), &self.layout, column);
        if let Some(at) = self.unwritten.iter().position(|unwritten| *unwritten == column) {
            view.call_method1("fill", (f64::NAN,))?;
            self.unwritten.remove(at);
        }
        Ok(view)
    }

    fn __setitem__(&mut self, py: Python<'_>, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let column = column(name, &self.layout)?;
        let (rows, width) = (self.layout.rows, column.width(self.layout.dimension));
        let numbers = crate::arrays::finite_numbers(value, name, Some(rows), width)?;
        let view = self.__getitem__(py, name)?;
        view.set_item(py.Ellipsis(), Copied { numbers, width }.into_array(py)?)
    }

    /// Writes the report of a solution: an object like `voidage.Report`.
    fn report(&mut self, py: Python<'_>, report: &Bound<'_, PyAny>) -> PyResult<()> {
        if self.header.kind != Kind::Solution as u32 {
            return Err(PyRuntimeError::new_err("only a solution has a report"));
        }
        let report = read_report(report)?;
        views::write(self.memory()?.bind(py), |payload| report.write(payload));
        self.unreported = false;
        Ok(())
    }
}

impl Answer {
    fn memory(&self) -> PyResult<&Py<Memory>> {
        self.memory.as_ref().ok_or_else(sent)
    }
}
