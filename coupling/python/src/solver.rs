//! Fluid solvers written in Python, in this process, and what goes to and comes from a solver in Python anywhere.

use crate::arrays::{Column, finite_numbers, integers, vectors};
use crate::errors::Raised;
use crate::mesh::Mesh;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use voidage_coupling::backend::{FluidBackend, FluidStep, Solution};
use voidage_coupling::exchange::Pieces;
use voidage_coupling::{Error, Result};
use voidage_fluid::balance::{Balance, moments};
use voidage_fluid::body::{self, BodyAnswer};
use voidage_fluid::conditions::Condition;
use voidage_fluid::flow::{Report, State};
use voidage_fluid::points::Points;
use voidage_fluid::{MeshMotion, Vector};
use voidage_remote::protocol::{Setup, Table, Values};

/// A solver in Python, behind a `voidage.adapter.Driver`.
pub struct PythonFluid {
    driver: Py<PyAny>,
    /// The conditions that the solver has.
    conditions: Vec<Condition<2>>,
    expected: Expected,
    /// What accepting the last solution raised.
    failed: Option<Error>,
    raised: Raised,
}

impl PythonFluid {
    /// A solver with the methods of `voidage.Solver`; what it raises is kept in `raised`.
    pub fn new(solver: &Bound<'_, PyAny>, setup: &Setup<2>, raised: Raised) -> PyResult<Self> {
        for method in ["set_mesh", "solve", "accept"] {
            if !solver.getattr(method).is_ok_and(|attribute| attribute.is_callable()) {
                let name = solver.get_type().name()?;
                return Err(PyTypeError::new_err(format!(
                    "`fluid` is a {name} without a method `{method}`; it must be a name or have the methods of \
                     voidage.Solver"
                )));
            }
        }
        let text = serde_json::json!(setup).to_string();
        let driver = solver.py().import("voidage.adapter")?.getattr("Driver")?.call1((solver, text))?;
        let (conditions, expected) = (setup.model.conditions.clone(), Expected::new(setup));
        Ok(Self { driver: driver.unbind(), conditions, expected, failed: None, raised })
    }

    /// Calls Python, and keeps what it raises.
    fn call<R>(&self, work: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<R>) -> Result<R> {
        Python::attach(|py| work(self.driver.bind(py)).map_err(|raised| self.raised.keep(py, raised)))
    }

    fn check(&mut self) -> Result<()> {
        self.failed.take().map_or(Ok(()), Err)
    }

    /// The conditions as JSON, if the solver does not have them yet.
    fn new_conditions(&mut self, conditions: &[Condition<2>]) -> String {
        if self.conditions == conditions {
            return String::new();
        }
        self.conditions = conditions.to_vec();
        self.expected.follow(conditions);
        serde_json::json!(conditions).to_string()
    }
}

impl FluidBackend<2> for PythonFluid {
    fn set_mesh(&mut self, mesh: &voidage_fluid::Mesh<2>, _generation: u32, fields: &State<2>) -> Result<()> {
        self.expected.nodes = mesh.points.len();
        self.failed = None;
        self.call(|driver| {
            let (mesh, fields) = (Mesh::new(driver.py(), mesh)?, field_arrays(driver.py(), fields)?);
            driver.call_method1("start", (mesh, fields)).map(drop)
        })
    }

    fn solve(&mut self, step: &FluidStep<'_, 2>, out: &mut Solution<2>) -> Result<()> {
        self.check()?;
        let conditions = self.new_conditions(step.conditions);
        self.call(|driver| {
            let py = driver.py();
            let points = step.immersed.map(|immersed| point_arrays(py, immersed.points)).transpose()?;
            let voidage = step.immersed.map(|immersed| Column::from(immersed.voidage).into_array(py));
            let motion = step.motion.as_ref().map(|motion| motion_arrays(py, motion)).transpose()?;
            let source = step.immersed.and_then(|immersed| immersed.source);
            let source = source.map(|source| Column::from(source).into_array(py)).transpose()?;
            let arguments = (step.dt, conditions, points, voidage.transpose()?, motion, source);
            self.expected.read(&driver.call_method1("solve", arguments)?, out)
        })
    }

    fn accept(&mut self) {
        if let Err(error) = self.call(|driver| driver.call_method0("accept").map(drop)) {
            self.failed = Some(error);
        }
    }
}

/// Nodal fields as a dictionary of arrays, that of the scalars a list.
pub fn field_arrays<'py, const D: usize>(py: Python<'py>, fields: &State<D>) -> PyResult<Bound<'py, PyDict>> {
    let arrays = PyDict::new(py);
    arrays.set_item("velocity", Column::from(fields.velocity.as_slice()).into_array(py)?)?;
    arrays.set_item("pressure", Column::from(fields.pressure.as_slice()).into_array(py)?)?;
    let scalars = fields.scalars.iter().map(|values| Column::from(values.as_slice()).into_array(py));
    arrays.set_item("scalars", PyList::new(py, scalars.collect::<PyResult<Vec<_>>>()?)?)?;
    Ok(arrays)
}

/// Point terms in the plane as a dictionary of arrays; `scalars` is a list of (coefficient, mobility, value) or None.
fn point_arrays<'py>(py: Python<'py>, points: &Points<2>) -> PyResult<Bound<'py, PyDict>> {
    let columns = points.columns().into_iter().map(|(column, values)| {
        let array = match values {
            Values::Whole(numbers) => integers(py, numbers, 1),
            Values::Numbers(numbers) => Column::from(numbers).into_array(py),
            Values::Vectors(vectors) => Column::from(vectors).into_array(py),
        };
        Ok((column.name, array?))
    });
    point_dictionary(py, columns.collect::<PyResult<Vec<_>>>()?, points.scalars(), points.scalars.len())
}

/// The dictionary of the columns of points, in the order in which they lie; `mask` says which of the scalars have
/// columns.
pub fn point_dictionary<'py>(
    py: Python<'py>,
    columns: Vec<(&'static str, Bound<'py, PyAny>)>,
    mask: u32,
    scalars: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    let own = voidage_remote::protocol::POINTS.len();
    let (own, more) = columns.split_at(own);
    for (name, array) in own {
        match *name {
            "coordinate" => all.set_item("shape", shape_functions(array)?)?,
            name => all.set_item(name, array)?,
        }
    }
    let mut groups = more.chunks_exact(voidage_remote::protocol::POINT_SCALAR.len());
    let list = PyList::empty(py);
    for scalar in 0..scalars {
        let group = if mask >> scalar & 1 == 1 { groups.next() } else { None };
        match group {
            Some(group) => list.append(PyTuple::new(py, group.iter().map(|(_, array)| array))?)?,
            None => list.append(py.None())?,
        }
    }
    all.set_item("scalars", list)?;
    Ok(all)
}

/// Shape functions (q, D + 1) from barycentric coordinates 1 to D.
fn shape_functions<'py>(coordinate: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let rows = crate::arrays::numbers(coordinate, "coordinate", None, 2)?;
    let numbers = rows.chunks_exact(2).flat_map(|x| [1.0 - (x[0] + x[1]), x[0], x[1]]).collect();
    Column { numbers, width: 3 }.into_array(coordinate.py())
}

/// Arrays (first, cell, shape, share) of pieces in the plane.
pub fn piece_arrays<'py>(py: Python<'py>, pieces: &Pieces<2>) -> PyResult<Bound<'py, PyTuple>> {
    let coordinate = Column::from(pieces.coordinate.as_slice()).into_array(py)?;
    let (first, cell) = (integers(py, &pieces.first, 1)?, integers(py, &pieces.cell, 1)?);
    let share = Column::from(pieces.share.as_slice());
    (first, cell, shape_functions(&coordinate)?, share.into_array(py)?).into_pyobject(py)
}

/// Arrays (points, velocity) of the motion of a mesh.
pub fn motion_arrays<'py, const D: usize>(
    py: Python<'py>,
    motion: &MeshMotion<'_, D>,
) -> PyResult<Bound<'py, PyTuple>> {
    let [points, velocity] =
        [motion.points, motion.velocity].map(|column| Column::from(column).into_array(py));
    (points?, velocity?).into_pyobject(py)
}

/// An attribute that is not None.
fn given<'py>(from: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let value = from.getattr(name)?;
    if value.is_none() {
        let class = from.get_type().name()?;
        return Err(PyTypeError::new_err(format!("the solver returned {class} with {name}=None")));
    }
    Ok(value)
}

/// What the solution of a solver must have.
pub struct Expected {
    /// Nodes of its mesh.
    pub nodes: usize,
    /// Number of scalars.
    pub scalars: usize,
    /// Names of the parts of the boundary, in the order of the conditions.
    parts: Vec<String>,
    /// How many of them are bodies.
    bodies: usize,
}

impl Expected {
    /// Of a solver that is told this; the mesh comes later.
    pub fn new(setup: &Setup<2>) -> Self {
        let mut new = Self { nodes: 0, scalars: setup.model.scalars.len(), parts: Vec::new(), bodies: 0 };
        new.follow(&setup.model.conditions);
        new
    }

    /// From now on the solutions are those of steps with these conditions.
    pub fn follow(&mut self, conditions: &[Condition<2>]) {
        self.parts = conditions.iter().map(|condition| condition.boundary.clone()).collect();
        self.bodies = body::count(conditions);
    }

    /// Reads an object like `voidage.Solution`.
    pub fn read(&self, solution: &Bound<'_, PyAny>, out: &mut Solution<2>) -> PyResult<()> {
        let fields = given(solution, "fields")?;
        let column = |name, width| finite_numbers(&given(&fields, name)?, name, Some(self.nodes), width);
        out.fields.velocity = vectors(&column("velocity", 2)?);
        out.fields.pressure = column("pressure", 1)?;
        let scalars = given(&fields, "scalars")?;
        if scalars.len()? != self.scalars {
            let text = format!("the solver returned {} scalars, there are {}", scalars.len()?, self.scalars);
            return Err(PyValueError::new_err(text));
        }
        out.fields.scalars.clear();
        for values in scalars.try_iter()? {
            out.fields.scalars.push(finite_numbers(&values?, "scalars", Some(self.nodes), 1)?);
        }
        out.report = read_report(&given(solution, "report")?)?;
        out.transport_s = 0.0;
        self.read_bodies(solution, &mut out.bodies)?;
        self.read_balances(&given(solution, "balances")?, &mut out.balances)
    }

    /// The answers of all bodies, or none of any.
    fn read_bodies(&self, solution: &Bound<'_, PyAny>, out: &mut Vec<BodyAnswer<2>>) -> PyResult<()> {
        out.clear();
        let Some(bodies) = solution.getattr_opt("bodies")? else { return Ok(()) };
        let count = bodies.len()?;
        if count != 0 && count != self.bodies {
            let text = format!("the solver answers for {count} bodies, there are {}", self.bodies);
            return Err(PyValueError::new_err(text));
        }
        for body in bodies.try_iter()? {
            let body = body?;
            let velocity = finite_numbers(&given(&body, "velocity")?, "velocity of a body", Some(2), 1)?;
            let vapour: f64 = given(&body, "vapour")?.extract()?;
            if !vapour.is_finite() {
                return Err(PyValueError::new_err(format!(
                    "`vapour` of a body is {vapour}, it must be finite"
                )));
            }
            out.push(BodyAnswer { velocity: Vector::from_column_slice(&velocity), vapour });
        }
        Ok(())
    }

    /// The balances of all parts, or none of any.
    fn read_balances(&self, balances: &Bound<'_, PyAny>, out: &mut Vec<Balance<2>>) -> PyResult<()> {
        out.clear();
        if balances.len()? == 0 {
            return Ok(());
        }
        for part in &self.parts {
            let balance = balances.get_item(part)?;
            let of_scalars = |name| finite_numbers(&given(&balance, name)?, name, Some(self.scalars), 1);
            out.push(Balance {
                flux: given(&balance, "flux")?.extract()?,
                force: Vector::from_column_slice(&finite_numbers(
                    &given(&balance, "force")?,
                    "force",
                    Some(2),
                    1,
                )?),
                torque: finite_numbers(&given(&balance, "torque")?, "torque", Some(moments(2)), 1)?,
                scalars: of_scalars("scalars")?,
                convected: of_scalars("convected")?,
            });
        }
        Ok(())
    }
}

/// The report of a solution.
fn read_report(report: &Bound<'_, PyAny>) -> PyResult<Report> {
    let number = |name| report.getattr(name)?.extract::<f64>();
    Ok(Report {
        flow_iterations: report.getattr("iterations")?.extract()?,
        residual: number("residual")?,
        scalars_s: number("scalars_s")?,
        flow_s: number("flow_s")?,
        ..Report::default()
    })
}
