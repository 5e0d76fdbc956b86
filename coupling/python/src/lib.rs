//! The compiled part of the Python package `voidage`: simulations, schemes and solvers written in Python, the cut of
//! grains by a mesh.

mod arrays;
mod columns;
mod errors;
mod mesh;
mod report;
mod scheme;
mod simulation;

use pyo3::prelude::*;

/// The compiled part of the package `voidage`.
#[pymodule]
mod _voidage {
    #[pymodule_export]
    use crate::columns::Columns;
    #[pymodule_export]
    use crate::mesh::{Mesh, Overlap};
    #[pymodule_export]
    use crate::scheme::{GrainState, System};
    #[pymodule_export]
    use crate::simulation::Simulation;

    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
