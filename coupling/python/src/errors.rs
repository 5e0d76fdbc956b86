//! Errors of Rust as exceptions, and exceptions on their way through Rust.

use pyo3::exceptions::{PyException, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use voidage_coupling::Error;

/// The exception of an error: `ValueError` for wrong input, `RuntimeError` for a run that failed.
pub fn exception(error: &Error) -> PyErr {
    let text = error.to_string();
    if error.is_input() { PyValueError::new_err(text) } else { PyRuntimeError::new_err(text) }
}

/// An exception in words, with the place in a file of Python where it was raised.
pub fn told(py: Python<'_>, exception: &PyErr) -> String {
    let place = || -> Option<String> {
        let mut frame = exception.traceback(py)?.into_any();
        while let Some(next) = frame.getattr("tb_next").ok().filter(|next| !next.is_none()) {
            frame = next;
        }
        let line = frame.getattr("tb_lineno").ok()?;
        let file = frame.getattr("tb_frame").ok()?.getattr("f_code").ok()?.getattr("co_filename").ok()?;
        Some(format!("{file}, line {line}: "))
    };
    format!("{}{exception}", place().unwrap_or_default())
}

/// The exception that a solver or scheme in Python raised last, while its text is on the way as an error of Rust.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Keeps an exception; the error of Rust has its text.
    pub fn keep(&self, py: Python<'_>, exception: PyErr) -> Error {
        let error = Error::run(told(py, &exception));
        *self.slot() = Some(exception.clone_ref(py));
        error
    }

    /// The exception of an error that may come from Python: its cause is then what was raised there. Interrupts are
    /// raised as they are.
    pub fn exception(&self, py: Python<'_>, error: &Error) -> PyErr {
        match self.slot().take() {
            None => exception(error),
            Some(cause) if !cause.is_instance_of::<PyException>(py) => cause,
            Some(cause) => {
                let outer = exception(error);
                outer.set_cause(py, Some(cause));
                outer
            }
        }
    }

    /// Raises what was kept without an error of Rust.
    pub fn check(&self, py: Python<'_>) -> PyResult<()> {
        let kept = self.slot().as_ref().map(|raised| Error::run(raised.to_string()));
        kept.map_or(Ok(()), |error| Err(self.exception(py, &error)))
    }

    fn slot(&self) -> std::sync::MutexGuard<'_, Option<PyErr>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
