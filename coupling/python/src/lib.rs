//! The compiled part of the Python package `voidage`: simulations, schemes and solvers written in Python, the cut of
//! grains by a mesh, and the solver's end of the exchange with a run in another process.

mod arrays;
mod columns;
mod errors;
mod mesh;
mod peer;
mod report;
mod scheme;
mod simulation;
mod solver;
mod views;

use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use voidage_remote::launch::Environment;

/// The compiled part of the package `voidage`.
#[pymodule]
mod _voidage {
    #[pymodule_export]
    use crate::columns::Columns;
    #[pymodule_export]
    use crate::mesh::{Mesh, Overlap};
    #[pymodule_export]
    use crate::peer::{Frame, Peer};
    #[pymodule_export]
    use crate::scheme::{GrainState, System};
    #[pymodule_export]
    use crate::simulation::Simulation;

    #[pymodule_export]
    use crate::{environment, main};

    #[pymodule_init]
    fn init(_module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        voidage_coupling::scheme::own::Maker(crate::scheme::make).is_here();
        Ok(())
    }

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python gives the version of a package")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}

/// Says which interpreter this is, and in which folder it has this package: processes that are started from here use
/// both.
#[pyfunction]
fn environment(python: PathBuf, packages: PathBuf) {
    Environment { python, packages }.is_here();
}

/// The program `voidage` with its arguments, the first of which is its name. Returns the exit code.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| voidage_program::main(arguments))
}
