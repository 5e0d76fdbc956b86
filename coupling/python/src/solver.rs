//! Fluid solvers written in Python, in this process.

use crate::arrays::{Column, finite_numbers, integers, vectors};
use crate::errors::Raised;
use crate::mesh::Mesh;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::Arc;
use voidage_coupling::backend::{FluidBackend, FluidReport, FluidStep, GrainLoad};
use voidage_coupling::protocol::Setup;
use voidage_coupling::{Error, Result};
use voidage_fluid::conditions::Condition;
use voidage_fluid::exchange::{AtBodies, Pieces};
use voidage_fluid::flow::{Report, State};
use voidage_fluid::{MeshMotion, Vector};

/// A solver in Python, behind a `voidage.adapter.Driver`.
pub struct PythonFluid {
    driver: Py<PyAny>,
    /// The conditions that the solver has.
    conditions: Vec<Condition<2>>,
    nodes: usize,
    /// What accepting the last solution raised.
    failed: Option<Error>,
    raised: Raised,
}

impl PythonFluid {
    /// A solver with the methods of `voidage.Solver`; what it raises is kept in `raised`.
    pub fn new(solver: &Bound<'_, PyAny>, setup: &Setup<2>, raised: Raised) -> PyResult<Self> {
        for method in ["set_mesh", "solve", "accept", "fields"] {
            if !solver.getattr(method).is_ok_and(|attribute| attribute.is_callable()) {
                let name = solver.get_type().name()?;
                return Err(PyTypeError::new_err(format!(
                    "`fluid` is a {name} without a method `{method}`; it must be a name or have the methods of voidage.Solver"
                )));
            }
        }
        let text = serde_json::json!(setup).to_string();
        let driver = solver.py().import("voidage.adapter")?.getattr("Driver")?.call1((solver, text))?;
        let conditions = setup.conditions.clone();
        Ok(Self { driver: driver.unbind(), conditions, nodes: 0, failed: None, raised })
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
        serde_json::json!(conditions).to_string()
    }
}

impl FluidBackend<2> for PythonFluid {
    fn start(&mut self, mesh: &Arc<voidage_fluid::Mesh<2>>, fields: &State<2>) -> Result<()> {
        self.nodes = mesh.points.len();
        self.failed = None;
        self.call(|driver| {
            let (mesh, fields) = (Mesh::new(driver.py(), mesh)?, field_arrays(driver.py(), fields)?);
            driver.call_method1("start", (mesh, fields)).map(drop)
        })
    }

    fn solve(&mut self, step: &FluidStep<'_, 2>, out: &mut AtBodies<2>) -> Result<FluidReport<2>> {
        self.check()?;
        let conditions = self.new_conditions(step.conditions);
        self.call(|driver| {
            let py = driver.py();
            let grains = step.grains.as_ref();
            let columns = grains.map(|grains| load_columns(py, grains.load)).transpose()?;
            let pieces = grains.map(|grains| piece_arrays(py, &grains.load.pieces)).transpose()?;
            let voidage = grains
                .map(|grains| Column::from(grains.load.voidage.as_slice()).into_array(py))
                .transpose()?;
            let motion = step.motion.as_ref().map(|motion| motion_arrays(py, motion)).transpose()?;
            let arguments = (step.dt, conditions, columns, pieces, voidage, motion);
            let answer = driver.call_method1("solve", arguments)?;
            let (at, report): (Bound<'_, PyAny>, Bound<'_, PyAny>) = answer.extract()?;
            if let Some(grains) = grains {
                let (count, heat) = (grains.position.len(), grains.load.heat.is_some());
                read_at_grains(&at, count, heat, out)?;
            }
            read_report(&report)
        })
    }

    fn accept(&mut self) {
        if let Err(error) = self.call(|driver| driver.call_method0("accept").map(drop)) {
            self.failed = Some(error);
        }
    }

    fn fields(&mut self) -> Result<State<2>> {
        self.check()?;
        let nodes = self.nodes;
        self.call(|driver| read_fields(&driver.call_method0("fields")?, nodes))
    }
}

/// Nodal fields as a dictionary of arrays.
pub fn field_arrays<'py, const D: usize>(py: Python<'py>, fields: &State<D>) -> PyResult<Bound<'py, PyDict>> {
    let arrays = PyDict::new(py);
    arrays.set_item("velocity", Column::from(fields.velocity.as_slice()).into_array(py)?)?;
    arrays.set_item("pressure", Column::from(fields.pressure.as_slice()).into_array(py)?)?;
    if let Some(temperature) = &fields.temperature {
        arrays.set_item("temperature", Column::from(temperature.as_slice()).into_array(py)?)?;
    }
    Ok(arrays)
}

/// Arrays (first, cell, shape, share) of pieces in the plane.
pub fn piece_arrays<'py>(py: Python<'py>, pieces: &Pieces<2>) -> PyResult<Bound<'py, PyTuple>> {
    let shape = (0..pieces.len()).flat_map(|piece| pieces.shape::<3>(piece)).collect();
    let shape = Column { numbers: shape, width: 3 };
    let (first, cell) = (integers(py, &pieces.first, 1)?, integers(py, &pieces.cell, 1)?);
    let share = Column::from(pieces.share.as_slice());
    (first, cell, shape.into_array(py)?, share.into_array(py)?).into_pyobject(py)
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

fn load_columns<'py>(py: Python<'py>, load: &GrainLoad<2>) -> PyResult<Bound<'py, PyDict>> {
    let columns = PyDict::new(py);
    let set = |name: &str, column: Column| columns.set_item(name, column.into_array(py)?);
    set("volume", load.volume.as_slice().into())?;
    set("drag", load.drag.as_slice().into())?;
    set("mobility", load.mobility.as_slice().into())?;
    set("velocity", load.velocity.as_slice().into())?;
    if let Some(heat) = &load.heat {
        set("heat_coefficient", heat.coefficient.as_slice().into())?;
        set("heat_mobility", heat.mobility.as_slice().into())?;
        set("temperature", heat.temperature.as_slice().into())?;
    }
    if let Some(law) = &load.continuity {
        set("continuity_mobility", law.mobility.as_slice().into())?;
        set("continuity_velocity", law.velocity.as_slice().into())?;
    }
    Ok(columns)
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

fn read_at_grains(at: &Bound<'_, PyAny>, count: usize, heat: bool, out: &mut AtBodies<2>) -> PyResult<()> {
    let column = |name, width| finite_numbers(&given(at, name)?, name, Some(count), width);
    out.velocity = vectors(&column("velocity", 2)?);
    out.pressure_gradient = vectors(&column("pressure_gradient", 2)?);
    out.temperature = if heat { column("temperature", 1)? } else { Vec::new() };
    Ok(())
}

/// The report of a solution.
pub fn read_report(report: &Bound<'_, PyAny>) -> PyResult<FluidReport<2>> {
    let number = |name| report.getattr(name)?.extract::<f64>();
    let solver = Report {
        flow_iterations: report.getattr("iterations")?.extract()?,
        residual: number("residual")?,
        heat_s: number("heat_s")?,
        flow_s: number("flow_s")?,
        ..Report::default()
    };
    Ok(FluidReport { solver, force: read_force(report)?, heat: number("heat")?, transport_s: 0.0 })
}

/// The force on all grains; empty where the solver does not sum it.
fn read_force<const D: usize>(report: &Bound<'_, PyAny>) -> PyResult<Option<Vector<D>>> {
    let force = given(report, "force")?;
    if force.len()? == 0 {
        return Ok(None);
    }
    Ok(Some(Vector::from_column_slice(&finite_numbers(&force, "force", Some(D), 1)?)))
}

fn read_fields(fields: &Bound<'_, PyAny>, nodes: usize) -> PyResult<State<2>> {
    let column = |name, width| finite_numbers(&given(fields, name)?, name, Some(nodes), width);
    let heat = !fields.getattr("temperature")?.is_none();
    Ok(State {
        velocity: vectors(&column("velocity", 2)?),
        pressure: column("pressure", 1)?,
        temperature: if heat { Some(column("temperature", 1)?) } else { None },
    })
}
