//! The frames between grains and a fluid solver in another process.
//!
//! A frame is a [`Header`] and a payload of 8-byte numbers: whole columns one after the other ([`TableLayout`]), and a
//! UTF-8 text packed in the last numbers. The grains ask, the fluid answers ([`Kind`]):
//!
//! ```text
//! fluid   hello     its name                     grains  hello     all that does not change, as JSON (`Setup`)
//! grains  mesh      mesh, names, fields          fluid   mesh      done
//! grains  state     other fields                 fluid   state     done
//! grains  step      point terms                  fluid   solution  nodal fields, balances of the boundary, bodies, report
//! grains  bye
//! ```
//!
//! A step starts from the last accepted state, however often it is asked for; the flag [`ACCEPT`] on a step
//! accepts the solution before it, [`APPEARS`] says that it brings a source of mass. Instead of an answer there may be
//! an error with a text, and heartbeats
//! before it. Only the columns that a scene needs travel, and places and velocities of the nodes only if the mesh
//! moves. All quantities are in SI units.

mod blocks;
mod columns;
mod header;
mod mesh;
mod messages;
mod motion;
#[cfg(test)]
mod tests;
mod text;

pub use blocks::{BALANCE, BODY, Block, Count, Entry, MESH, REPORT, STEP, Width};
pub(crate) use columns::PAD;
pub use columns::{
    Column, Described, FIELD_SCALAR, FIELDS, POINT_SCALAR, POINTS, Table, TableLayout, Values, ValuesMut,
};
pub use header::{
    ACCEPT, APPEARS, FLAGS, Field, HEADER_BYTES, Header, IMMERSED, JOINED, Kind, Listed, MAGIC, MOVES,
    VERSION,
};
pub use mesh::{MeshMessage, StateMessage, read_mesh, read_state};
pub use messages::{SolutionMessage, StepLayout, StepMessage, longest_solution, read_solution, read_step};
pub use motion::MotionLayout;
pub use text::{CLOSURE, Greeting, Setup, dimension, numbers_for_text, read_text, write_text};
