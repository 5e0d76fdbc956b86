//! The solver's end of the exchange with a run in another process.

use crate::arrays::{Column as Copied, integers};
use crate::mesh::Mesh;
use crate::solver::{Expected, field_arrays, motion_arrays, point_dictionary};
use crate::views;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::ops::Range;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use voidage_coupling::PeerError;
use voidage_coupling::backend::Solution;
use voidage_fluid::MeshMotion;
use voidage_remote::protocol::{
    Kind, MotionLayout, POINT_SCALAR, POINTS, Setup, SolutionMessage, TableLayout, dimension, read_mesh,
    read_state, read_step,
};
use voidage_remote::token::Token;
use voidage_remote::transport::{self, Address, LOOK};

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
    inner: Mutex<voidage_remote::peer::Peer>,
    setup: String,
    expected: Expected,
    cells: usize,
    solution: Solution<2>,
}

#[pymethods]
impl Peer {
    /// Connects to the run at `address` (`shm:NAME` or `tcp:HOST:PORT`), waiting at most `wait` seconds for it to be
    /// there. `solver` is the name to present oneself with, `token` what the run asks for; without one it is that of
    /// the environment, VOIDAGE_TOKEN.
    #[new]
    #[pyo3(signature = (address, solver, *, wait=60.0, token=None))]
    fn new(
        py: Python<'_>,
        address: &str,
        solver: String,
        wait: f64,
        token: Option<String>,
    ) -> PyResult<Self> {
        let address: Address = address.parse().map_err(PyValueError::new_err)?;
        let wait = seconds(wait, "wait")?;
        let token = token.map_or_else(Token::of_environment, |word| Token::new(Some(word)));
        let (sender, receiver) = channel();
        // In a thread of its own, so that signals are seen meanwhile; one that is left behind ends with its wait.
        std::thread::spawn(move || {
            let connected = voidage_remote::peer::Peer::connect(&address, &solver, &token, wait);
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
                        2 => {
                            let expected = Expected::new(&Setup::parse(&setup).map_err(exception)?);
                            Ok(Self { inner, setup, expected, cells: 0, solution: Solution::default() })
                        }
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

    /// Answers a step with a solution, an object like `voidage.Solution`.
    fn send(&mut self, py: Python<'_>, solution: &Bound<'_, PyAny>) -> PyResult<()> {
        self.expected.read(solution, &mut self.solution)?;
        let Self { inner, solution, .. } = self;
        let inner = inner.get_mut().unwrap_or_else(PoisonError::into_inner);
        py.detach(|| {
            let message = SolutionMessage::new(solution);
            let header = message.header();
            let mut payload = inner.loan(header.length as usize)?;
            message.write(payload.payload_mut());
            inner.answer(&header, payload)
        })
        .map_err(exception)
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
    fn inner(&mut self) -> &mut voidage_remote::peer::Peer {
        self.inner.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    fn understand(&mut self, frame: transport::Frame) -> PyResult<Frame> {
        if frame.kind() == Kind::Mesh {
            self.expected.nodes = frame.header().rows as usize;
            self.cells = frame.header().cells as usize;
        }
        let (mut points, mut source, mut motion) = (None, None, None);
        if frame.kind() == Kind::Step {
            let step = read_step::<2>(frame.header(), frame.payload()).map_err(exception)?;
            (points, source, motion) = (step.points, step.source, step.motion);
            if let Some(conditions) = step.conditions {
                self.expected.follow(&conditions);
            }
        }
        let Expected { nodes, scalars, .. } = self.expected;
        Ok(Frame { frame, points, source, motion, nodes, scalars, cells: self.cells })
    }
}

/// A request as it was received. Columns of numbers are read-only views of where they lie in shared memory; the
/// views keep the memory. Not more than three frames can be kept at a time.
#[pyclass(frozen, module = "voidage")]
pub struct Frame {
    frame: transport::Frame,
    points: Option<(TableLayout, Range<usize>)>,
    source: Option<Range<usize>>,
    motion: Option<MotionLayout>,
    nodes: usize,
    scalars: usize,
    cells: usize,
}

#[pymethods]
impl Frame {
    /// `mesh`, `state`, `step` or `bye`.
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

    /// Copies of the accepted fields of a request of the kind `mesh` or `state`: `velocity`, `pressure` and the list
    /// `scalars`.
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (header, payload) = (self.frame.header(), self.frame.payload());
        let fields = match self.frame.kind() {
            Kind::Mesh => read_mesh::<2>(header, payload).map(|(_, fields)| fields),
            _ => read_state::<2>(header, payload, self.nodes),
        };
        field_arrays(py, &fields.map_err(exception)?)
    }

    /// The points of a step by name: columns as in `voidage.Points`, with a list `scalars` of (coefficient, mobility,
    /// value) or None; None without grains.
    fn points<'py>(this: Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let (py, frame) = (this.py(), this.get());
        let Some((place, _)) = &frame.points else { return Ok(None) };
        let mask = frame.frame.header().scalars;
        let columns = place.ranges((&POINTS, &POINT_SCALAR), mask, 2).into_iter().map(|(column, range)| {
            let array = match column.name {
                "cell" => frame.cells_of(py, range)?,
                _ => views::read_only(&this, range, column.width(2)),
            };
            Ok((column.name, array))
        });
        point_dictionary(py, columns.collect::<PyResult<Vec<_>>>()?, mask, frame.scalars).map(Some)
    }

    /// A copy of the nodal voidage of a step (n,); None without grains.
    fn voidage<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.nodal(py, self.points.as_ref().map(|(_, voidage)| voidage), "voidage")
    }

    /// A copy of the nodal source of the equation of mass of a step, 1/s, (n,); None where no solid volume comes in.
    fn source<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.nodal(py, self.source.as_ref(), "a source")
    }

    /// Copies of the places of the nodes at the end of a step and of their velocities, (n, 2) each; None if the mesh
    /// stands still.
    fn motion<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyTuple>>> {
        let Some(places) = &self.motion else { return Ok(None) };
        let [points, velocity] = places.read::<2>(self.payload());
        motion_arrays(py, &MeshMotion { points: &points, velocity: &velocity }).map(Some)
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

    /// A copy of a nodal column of a step.
    fn nodal<'py>(
        &self,
        py: Python<'py>,
        range: Option<&Range<usize>>,
        name: &str,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(range) = range else { return Ok(None) };
        let numbers = self.payload()[range.clone()].to_vec();
        if numbers.len() != self.nodes {
            let text = format!("the step has {name} at {} of {} nodes", numbers.len(), self.nodes);
            return Err(PyRuntimeError::new_err(text));
        }
        Copied { numbers, width: 1 }.into_array(py).map(Some)
    }

    /// Whole numbers that must be cells of the mesh.
    fn cells_of<'py>(&self, py: Python<'py>, range: Range<usize>) -> PyResult<Bound<'py, PyAny>> {
        let cell = |number: &f64| {
            let cell = *number as u32;
            let there = f64::from(cell) == *number && (cell as usize) < self.cells;
            there.then_some(cell).ok_or_else(|| {
                PyRuntimeError::new_err(format!("a point lies in cell {number}, there are {}", self.cells))
            })
        };
        let cells = self.payload()[range].iter().map(cell).collect::<PyResult<Vec<_>>>()?;
        integers(py, &cells, 1)
    }
}
