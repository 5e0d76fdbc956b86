//! Files that a run leaves: ParaView frames, time series, time averages, checkpoints and a summary.
//!
//! Everything is written from plain columns, so that nothing here knows how they were computed. Whole files appear at
//! once (written beside and renamed) and rows of a series are cut back when one cannot be finished: whatever ends a
//! run, what it wrote before stays readable.

mod averages;
mod checkpoint;
mod collection;
mod files;
mod folder;
mod recording;
mod series;
mod summary;
#[cfg(test)]
mod tests;
mod view;
mod vtk;
mod vtk_read;

pub use averages::Averages;
pub use checkpoint::{Checkpoint, Stamp};
pub use collection::Collection;
pub use files::{create_folder, write_whole};
pub use folder::{ANALYSES, ANALYSIS, Earlier, LOCK, OutputFolder};
pub use recording::{CHECKPOINT, Due, FAILED, Kept, Reading, Recording, check_averages, readings};
pub use series::Series;
pub use summary::Summary;
pub use view::{FluidView, GrainView, View, column_name, with_unit};
pub use vtk::{Column, Values, write_grains, write_lines, write_mesh};
pub use vtk_read::{Frame, FrameColumn, read_collection, read_frame};
