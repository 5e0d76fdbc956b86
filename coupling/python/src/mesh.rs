//! The mesh of the fluid, and grains cut by a mesh.

use crate::arrays::{Column, finite_numbers, integers, vectors};
use crate::errors::exception;
use crate::solver::piece_arrays;
use numpy::{AllowTypeChange, PyArrayLike2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::{Mutex, PoisonError};
use voidage_coupling::exchange::Pieces;
use voidage_coupling::overlap;
use voidage_fluid::Vector;

/// A mesh of triangles. `points` (n, 2), m; `cells` (m, 3), node numbers, positively oriented; `boundaries`, nodes of
/// the facets of each named part, (k, 2); `masters`, the node whose values each has, (n), None without periodic sides.
#[pyclass(frozen, get_all, module = "voidage")]
pub struct Mesh {
    points: Py<PyAny>,
    cells: Py<PyAny>,
    boundaries: Py<PyDict>,
    masters: Py<PyAny>,
}

impl Mesh {
    /// A copy for Python.
    pub fn new<const D: usize>(py: Python<'_>, mesh: &voidage_fluid::Mesh<D>) -> PyResult<Self> {
        let boundaries = PyDict::new(py);
        for part in &mesh.boundaries {
            boundaries.set_item(&part.name, integers(py, &part.facets, D)?)?;
        }
        let masters: Vec<u32> =
            (0..mesh.points.len() as u32).map(|node| mesh.periodic.master(node)).collect();
        let masters = match mesh.periodic.is_none() {
            true => py.None(),
            false => integers(py, &masters, 1)?.unbind(),
        };
        Ok(Self {
            points: Column::from(mesh.points.as_slice()).into_array(py)?.unbind(),
            cells: integers(py, &mesh.cells, D + 1)?.unbind(),
            boundaries: boundaries.unbind(),
            masters,
        })
    }
}

#[pymethods]
impl Mesh {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (points, cells) = (self.points.bind(py).len()?, self.cells.bind(py).len()?);
        Ok(format!("<mesh of {points} nodes and {cells} cells>"))
    }
}

/// Cuts grains by the cells of a mesh: `points` (n, 2), m; `cells` (m, 3), positively oriented.
#[pyclass(frozen, module = "voidage")]
pub struct Overlap(Mutex<Cutter>);

struct Cutter {
    mesh: voidage_fluid::Mesh<2>,
    nodal_volume: Vec<f64>,
    overlap: overlap::Overlap<2>,
    pieces: Pieces<2>,
}

#[pymethods]
impl Overlap {
    #[new]
    fn new(points: &Bound<'_, PyAny>, cells: &Bound<'_, PyAny>) -> PyResult<Self> {
        let points = vectors(&finite_numbers(points, "points", None, 2)?);
        let cells = node_numbers(cells, points.len())?;
        let mesh = whole_mesh(points, cells)?;
        let overlap = overlap::Overlap::new(&mesh).map_err(|error| exception(&error.into()))?;
        let nodal_volume = mesh.nodal_volume();
        Ok(Self(Mutex::new(Cutter { mesh, nodal_volume, overlap, pieces: Pieces::default() })))
    }

    /// Cuts grains at `position` (g, 2), m, of `radius` (g,), m.
    ///
    /// Returns `(first, cell, shape, share)`: grain i owns pieces first[i] to first[i + 1]; (g + 1), (q), values of
    /// the shape functions at the centroid of each piece (q, 3), share of the grain's volume (q).
    fn cut<'py>(
        &self,
        py: Python<'py>,
        position: &Bound<'py, PyAny>,
        radius: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let position = vectors(&finite_numbers(position, "position", None, 2)?);
        let radius = finite_numbers(radius, "radius", Some(position.len()), 1)?;
        let pieces = py.detach(|| {
            let mut cutter = self.cutter();
            cutter.cut(&position, &radius).map_err(|error| exception(&error.into()))?;
            Ok::<_, PyErr>(cutter.pieces.clone())
        })?;
        piece_arrays(py, &pieces)
    }

    /// Voidage at the nodes (n,), with `volume` (g,) the solid volumes of the grains cut last, m3 (m2 in the plane).
    fn voidage<'py>(&self, py: Python<'py>, volume: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let volume = finite_numbers(volume, "volume", None, 1)?;
        let voidage = py.detach(|| {
            let cutter = self.cutter();
            let grains = cutter.pieces.grains();
            if volume.len() != grains {
                let text = format!("{} volumes, {grains} grains were cut last", volume.len());
                return Err(PyValueError::new_err(text));
            }
            let mut voidage = Vec::new();
            overlap::voidage(&cutter.mesh, &cutter.pieces, &volume, &cutter.nodal_volume, &mut voidage);
            Ok(voidage)
        })?;
        Column { numbers: voidage, width: 1 }.into_array(py)
    }
}

impl Overlap {
    fn cutter(&self) -> std::sync::MutexGuard<'_, Cutter> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Cutter {
    fn cut(&mut self, position: &[Vector<2>], radius: &[f64]) -> voidage_fluid::Result<()> {
        self.overlap.cut(&self.mesh, position, radius, &mut self.pieces, &mut Vec::new())?;
        match self.overlap.outside().first() {
            None => Ok(()),
            Some(grain) => Err(voidage_fluid::Error::Mesh(format!(
                "grain {grain} at {:?} of radius {} lies outside of the mesh",
                position[*grain as usize].as_slice(),
                radius[*grain as usize]
            ))),
        }
    }
}

/// A mesh without names on its boundary.
fn whole_mesh(points: Vec<Vector<2>>, cells: Vec<u32>) -> PyResult<voidage_fluid::Mesh<2>> {
    let wrong = |text: String| PyValueError::new_err(text);
    let mesh = voidage_fluid::Mesh::with_boundaries(points, cells.clone(), &[String::new()], |_| Ok(0))
        .and_then(|mesh| mesh.check().map(|()| mesh))
        .map_err(|error| wrong(error.to_string()))?;
    match mesh.cells.iter().zip(&cells).position(|(turned, given)| turned != given) {
        Some(k) => Err(wrong(format!("cell {} is negatively oriented", k / 3))),
        None => Ok(mesh),
    }
}

fn node_numbers(cells: &Bound<'_, PyAny>, nodes: usize) -> PyResult<Vec<u32>> {
    let cells: PyArrayLike2<'_, i64, AllowTypeChange> = cells.extract()?;
    let cells = cells.as_array();
    if cells.shape()[1] != 3 {
        return Err(PyValueError::new_err(format!(
            "`cells` has shape {:?}, it must have (m, 3): grains are cut in the plane only",
            cells.shape()
        )));
    }
    let convert = |node: &i64| match u32::try_from(*node) {
        Ok(number) if (number as usize) < nodes => Ok(number),
        _ => Err(PyValueError::new_err(format!("`cells` names node {node}, there are {nodes} points"))),
    };
    cells.iter().map(convert).collect()
}
