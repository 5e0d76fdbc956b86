//! Fluid solvers in other processes.
//!
//! [`protocol`] says what is exchanged, [`transport`] how it gets there: shared memory (iceoryx2, named in this crate
//! only) or TCP. [`remote`] is a solver as the grains see it, [`peer`] the run as a solver sees it. [`launch`] starts
//! solvers, [`serve`] is the Rust solver as a process of its own, and [`c`] writes the header for solvers in C.

pub mod c;
pub mod launch;
pub mod peer;
pub mod protocol;
pub mod remote;
pub mod serve;
pub mod solver;
pub mod token;
pub mod transport;
