//! Between the columns of Rust and numpy arrays.
//!
//! What Python gets is a copy that it owns, so that no array outlives its memory; it is read-only, so that writing to
//! it does not look like writing to the simulation.

use numpy::{AllowTypeChange, PyArray1, PyArrayLikeDyn, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use voidage_fluid::Vector;

/// A column: `width` numbers per row, those of a row side by side.
pub struct Column {
    /// The numbers.
    pub numbers: Vec<f64>,
    /// Numbers per row; 1 makes an array of one dimension.
    pub width: usize,
}

impl From<&[f64]> for Column {
    fn from(numbers: &[f64]) -> Self {
        Self { numbers: numbers.to_vec(), width: 1 }
    }
}

impl<const D: usize> From<&[Vector<D>]> for Column {
    fn from(vectors: &[Vector<D>]) -> Self {
        Self { numbers: vectors.iter().flat_map(|vector| vector.iter().copied()).collect(), width: D }
    }
}

impl Column {
    /// The read-only array.
    pub fn into_array(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        frozen(py, self.numbers, self.width)
    }
}

/// A read-only array of whole numbers, `width` per row.
pub fn integers<'py>(py: Python<'py>, numbers: &[u32], width: usize) -> PyResult<Bound<'py, PyAny>> {
    frozen(py, numbers.iter().map(|number| i64::from(*number)).collect(), width)
}

fn frozen<T: numpy::Element>(py: Python<'_>, numbers: Vec<T>, width: usize) -> PyResult<Bound<'_, PyAny>> {
    let rows = numbers.len() / width;
    let array = PyArray1::from_vec(py, numbers);
    drop(array.readwrite().make_nonwriteable());
    if width == 1 { Ok(array.into_any()) } else { Ok(array.reshape([rows, width])?.into_any()) }
}

/// The numbers of an array-like of shape `(rows, width)`, or `(rows,)` for width 1; any number of rows without `rows`.
pub fn numbers(
    value: &Bound<'_, PyAny>,
    name: &str,
    rows: Option<usize>,
    width: usize,
) -> PyResult<Vec<f64>> {
    let array: PyArrayLikeDyn<'_, f64, AllowTypeChange> = value
        .extract()
        .map_err(|error| PyValueError::new_err(format!("`{name}` is no array of numbers: {error}")))?;
    let array = array.as_array();
    let shape = array.shape();
    let fits = match *shape {
        [n] => width == 1 && rows.is_none_or(|rows| n == rows),
        [n, w] => width != 1 && w == width && rows.is_none_or(|rows| n == rows),
        _ => false,
    };
    if !fits {
        let rows = rows.map_or("n".to_owned(), |rows| rows.to_string());
        let wanted = if width == 1 { format!("({rows},)") } else { format!("({rows}, {width})") };
        return Err(PyValueError::new_err(format!("`{name}` has shape {shape:?}, it must have {wanted}")));
    }
    Ok(array.iter().copied().collect())
}

/// The same, and all of them finite.
pub fn finite_numbers(
    value: &Bound<'_, PyAny>,
    name: &str,
    rows: Option<usize>,
    width: usize,
) -> PyResult<Vec<f64>> {
    let numbers = numbers(value, name, rows, width)?;
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(k) => {
            let (row, number) = (k / width, numbers[k]);
            Err(PyValueError::new_err(format!("`{name}` is {number} in row {row}, it must be finite")))
        }
        None => Ok(numbers),
    }
}

/// The rows of numbers as vectors.
pub fn vectors<const D: usize>(numbers: &[f64]) -> Vec<Vector<D>> {
    numbers.chunks_exact(D).map(Vector::from_column_slice).collect()
}
