//! All files of one run, written when they are due.

use super::{
    Averages, Checkpoint, Collection, Column, FluidView, GrainView, OutputFolder, Series, Stamp, View,
    create_folder, with_unit, write_grains, write_lines, write_mesh, write_whole,
};
use crate::network::{COMPONENTS, Network, StressColumns};
use crate::stop::Slow;
use crate::{Output, Scene, Time};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use voidage_coupling::error::Result;

/// Most squares of a grid of averages.
const MOST_SQUARES: f64 = 1e7;

/// Name of the checkpoint in the folder of a run.
pub const CHECKPOINT: &str = "checkpoint.voidage";

/// Name of the state that a run left which failed.
pub const FAILED: &str = "failed.voidage";

/// What a checkpoint has beside the state of the simulation.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Kept {
    /// The averages so far.
    pub averages: Option<Averages>,
    /// Since when no grain has been faster than `stop.at_rest` allows.
    pub slow: Option<Slow>,
    /// What decides the course of the run, [`Scene::course_toml`].
    pub course: String,
    /// What was due in its step, also if the run had not ended then.
    pub due: Due,
}

impl Kept {
    /// For a state that no recorder wrote.
    ///
    /// # Errors
    /// A file of the scene cannot be read.
    pub fn of(scene: &Scene) -> Result<Self> {
        Ok(Kept { averages: None, slow: None, course: scene.course_toml()?, due: Due::default() })
    }
}

/// What is due at a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Due {
    /// A row of the time series.
    pub series: bool,
    /// A ParaView frame.
    pub frame: bool,
    /// A sample of the averages.
    pub average: bool,
    /// A checkpoint.
    pub checkpoint: bool,
}

impl Due {
    /// Whether what is due shows nodal fields of the fluid.
    pub fn needs_fields(&self) -> bool {
        self.series || self.frame
    }

    /// Whether anything but a checkpoint is due, so that [`Recording::record`] needs a view.
    pub fn any(&self) -> bool {
        self.series || self.frame || self.average
    }
}

/// A quantity of the time series: name with unit, and value.
pub type Reading = (Cow<'static, str>, f64);

/// The files of a run.
#[derive(Debug)]
pub struct Recording {
    folder: OutputFolder,
    output: Output,
    clock: Time,
    course: String,
    series: Series,
    grains: Collection,
    fluid: Collection,
    contacts: Collection,
    averages: Option<Averages>,
    /// What goes to [`Kept::slow`].
    pub slow: Option<Slow>,
}

impl Recording {
    /// Starts the files of a run: the scene as resolved, and what is due at time 0. Those of an earlier run are
    /// removed. From a checkpoint of a run in another folder it starts with a frame of then, and the series with the
    /// step after it.
    pub fn start<const D: usize>(
        folder: OutputFolder,
        scene: &Scene,
        view: &View<D>,
        readings: &[Reading],
        checkpoint: Option<&Checkpoint>,
    ) -> Result<Recording> {
        folder.clear()?;
        let at = |name: &str| folder.path().join(name);
        create_folder(&at("frames"))?;
        let series = Series::create(&at("series.csv"), &columns(scene, view, readings))?;
        let collections = ["grains.pvd", "fluid.pvd", "contacts.pvd"].map(|name| Collection::new(&at(name)));
        let kept: Option<Kept> = checkpoint.map(Checkpoint::recorder).transpose()?;
        let slow = kept.as_ref().and_then(|kept| kept.slow);
        let averages = averages(scene, view, kept)?;
        let mut recording = Recording::new(folder, scene, series, collections, averages)?;
        match checkpoint {
            None => drop(recording.record(0, 0.0, view, readings)?),
            Some(from) => recording.frame(from.stamp.step, from.stamp.time, view)?,
        }
        recording.slow = slow;
        Ok(recording)
    }

    /// Goes on with the files of an earlier run, cut back to the time of the checkpoint. What is there of this time only
    /// because the run ended then is taken away, so that the files are those of a run that was left alone.
    pub fn resume<const D: usize>(
        folder: OutputFolder,
        scene: &Scene,
        view: &View<D>,
        readings: &[Reading],
        checkpoint: &Checkpoint,
    ) -> Result<Recording> {
        let at = |name: &str| folder.path().join(name);
        create_folder(&at("frames"))?;
        let (time, kept) = (checkpoint.stamp.time, checkpoint.recorder::<Kept>()?);
        let (slow, was) = (kept.slow, kept.due);
        let is = due(&scene.output, &scene.time, scene.time.steps(), checkpoint.stamp.step);
        let until = |due: bool| if due { time } else { time.next_down() };
        let series = Series::resume(
            &at("series.csv"),
            &columns(scene, view, readings),
            until(was.series || is.series),
        )?;
        let frames = |name: &str| Collection::resume(&at(name), until(was.frame || is.frame));
        let (grains, fluid, contacts) =
            (frames("grains.pvd")?, frames("fluid.pvd")?, frames("contacts.pvd")?);
        folder.reopen(|frame| grains.has(frame) || fluid.has(frame) || contacts.has(frame))?;
        let averages = averages(scene, view, Some(kept))?;
        let mut recording = Recording::new(folder, scene, series, [grains, fluid, contacts], averages)?;
        recording.slow = slow;
        recording.write_averages()?;
        Ok(recording)
    }

    fn new(
        folder: OutputFolder,
        scene: &Scene,
        series: Series,
        [grains, fluid, contacts]: [Collection; 3],
        averages: Option<Averages>,
    ) -> Result<Recording> {
        let text = scene.to_toml()?;
        write_whole(&folder.path().join("scene.toml"), |file| file.write_all(text.as_bytes()))?;
        Ok(Recording {
            folder,
            output: scene.output.clone(),
            clock: scene.time.clone(),
            course: scene.course_toml()?,
            series,
            grains,
            fluid,
            contacts,
            averages,
            slow: None,
        })
    }

    /// The folder of the run.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// What is due after this many steps.
    pub fn due(&self, step: u64) -> Due {
        due(&self.output, &self.clock, self.clock.steps(), step)
    }

    /// Writes what is due after this many steps, but for the checkpoint; returns the row of the series, if one is due.
    /// The readings must be those of the start, in order.
    pub fn record<const D: usize>(
        &mut self,
        step: u64,
        time: f64,
        view: &View<D>,
        readings: &[Reading],
    ) -> Result<Vec<Reading>> {
        let due = self.due(step);
        let mut row = vec![];
        if due.series {
            row = self::readings(&self.output, time, view, readings);
            self.series.row(&row.iter().map(|(_, value)| *value).collect::<Vec<f64>>())?;
        }
        if due.average
            && let (Some(averages), Some(grains)) = (&mut self.averages, view.grains)
        {
            averages.sample(grains.position, grains.velocity, grains.radius, grains.volume, &grains.period);
        }
        if due.frame {
            self.frame(step, time, view)?;
        }
        Ok(row)
    }

    /// Writes a ParaView frame, unless this time has one.
    pub fn frame<const D: usize>(&mut self, step: u64, time: f64, view: &View<D>) -> Result<()> {
        let stress = view.network.and_then(|network| network.stress.as_ref());
        if let Some(grains) = view.grains.filter(|_| self.grains.last_time() != Some(time)) {
            let name = PathBuf::from(format!("frames/grains-{step:08}.vtp"));
            grains.write(&self.folder().join(&name), stress)?;
            self.grains.push(time, name)?;
        }
        if let Some(fluid) = view.fluid.filter(|_| self.fluid.last_time() != Some(time)) {
            let name = PathBuf::from(format!("frames/fluid-{step:08}.vtu"));
            fluid.write(&self.folder().join(&name), stress)?;
            self.fluid.push(time, name)?;
        }
        let contacts =
            view.network.filter(|_| self.output.contacts && self.contacts.last_time() != Some(time));
        if let Some(contacts) = contacts {
            let name = PathBuf::from(format!("frames/contacts-{step:08}.vtp"));
            contacts.write(&self.folder().join(&name))?;
            self.contacts.push(time, name)?;
        }
        Ok(())
    }

    /// What a checkpoint after so many steps has of this run beside the state of the simulation.
    pub fn kept(&self, step: u64) -> Kept {
        let (averages, slow, course) = (self.averages.clone(), self.slow, self.course.clone());
        Kept { averages, slow, course, due: due(&self.output, &self.clock, u64::MAX, step) }
    }

    /// Writes the checkpoint, and the averages so far.
    ///
    /// # Errors
    /// They cannot be written, or somebody else has changed the series.
    pub fn checkpoint(&self, stamp: &Stamp, state: &impl Serialize) -> Result<PathBuf> {
        self.series.check()?;
        self.series.sync()?;
        let path = self.folder().join(CHECKPOINT);
        // Before the checkpoint: a run that is killed between the two goes on from the one before, and writes them
        // again.
        self.write_averages()?;
        Checkpoint::write(&path, stamp, state, &self.kept(stamp.step))?;
        Ok(path)
    }

    /// Writes the state that a run leaves which failed; the checkpoint before it stays.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn failed(&self, stamp: &Stamp, state: &impl Serialize) -> Result<PathBuf> {
        let path = self.folder().join(FAILED);
        Checkpoint::write(&path, stamp, state, &self.kept(stamp.step))?;
        self.write_averages()?;
        Ok(path)
    }

    fn write_averages(&self) -> Result<()> {
        match self.averages.as_ref().filter(|averages| averages.samples() > 0) {
            Some(averages) => averages.write(&self.folder().join("averages.csv")),
            None => Ok(()),
        }
    }
}

/// What is due after `step` steps in a run that ends after `last` steps.
fn due(output: &Output, clock: &Time, last: u64, step: u64) -> Due {
    let (time, dt) = (clock.after(step), clock.step);
    let steps = |interval: f64| (interval / dt).round().max(1.0) as u64;
    let every = |interval: Option<f64>| interval.is_some_and(|interval| step.is_multiple_of(steps(interval)));
    let at_the_ends = step == 0 || step == last;
    let snapshot = output.snapshots.iter().any(|at| clock.nearest(*at) == step);
    let slack = 0.5 * dt;
    let average = output.average.as_ref().is_some_and(|average| {
        let inside = time > average.from - slack && time < average.to + slack && step > 0;
        inside && step.is_multiple_of(average.interval.map_or(1, steps))
    });
    Due {
        series: at_the_ends || output.series_interval.is_none() || every(output.series_interval),
        frame: at_the_ends || snapshot || every(output.frame_interval),
        average,
        checkpoint: step == last || (step > 0 && every(output.checkpoint_interval)),
    }
}

fn columns<const D: usize>(scene: &Scene, view: &View<D>, readings: &[Reading]) -> Vec<String> {
    let row = self::readings(&scene.output, 0.0, view, readings);
    row.into_iter().map(|(name, _)| name.into_owned()).collect()
}

/// The row of the series: time, what follows from the view, and what the simulation adds.
pub fn readings<const D: usize>(
    output: &Output,
    time: f64,
    view: &View<D>,
    more: &[Reading],
) -> Vec<Reading> {
    let mut row = vec![("time_s".into(), time)];
    if let Some(grains) = &view.grains {
        row.extend(grains.readings());
    }
    if let Some(fluid) = &view.fluid {
        row.extend(fluid.readings());
        if let Some(drop) = &output.pressure_drop {
            let [from, to] = [&drop.from, &drop.to].map(|name| fluid.mean_pressure(name).unwrap_or(f64::NAN));
            row.push(("pressure_drop_Pa".into(), from - to));
        }
    }
    row.extend_from_slice(more);
    row
}

/// Checks that the grid of the averages has not more squares than memory.
///
/// # Errors
/// It has.
pub fn check_averages<const D: usize>(scene: &Scene, view: &View<D>) -> Result<()> {
    let Some(average) = &scene.output.average else { return Ok(()) };
    let extent = extent(scene, view).filter(|[lower, upper]| lower[0] < upper[0] && lower[1] < upper[1]);
    let Some([lower, upper]) = extent else {
        let message = "`output.average`: neither a fluid nor walls nor grains say where";
        return Err(scene.error("output.average", message, "enclose the grains with walls"));
    };
    let squares = [0, 1].map(|axis| (upper[axis] - lower[axis]) / average.cell).iter().product::<f64>();
    if squares <= MOST_SQUARES {
        return Ok(());
    }
    let message = format!("`output.average.cell = {}` makes {squares:.0e} squares", average.cell);
    Err(scene.error("output.average.cell", message, "give a larger side, of some grains"))
}

/// The averages that a checkpoint has, if they are those that are asked for, or a new grid.
fn averages<const D: usize>(scene: &Scene, view: &View<D>, kept: Option<Kept>) -> Result<Option<Averages>> {
    let Some(average) = &scene.output.average else { return Ok(None) };
    let kept = kept.and_then(|kept| kept.averages).filter(|kept| kept.asked_as(average));
    if kept.is_some() {
        return Ok(kept);
    }
    check_averages(scene, view)?;
    Ok(extent(scene, view).map(|[lower, upper]| Averages::new(lower, upper, average)))
}

/// The corners of the fluid, or of all walls, or of all grains; along a periodic axis the sides.
fn extent<const D: usize>(scene: &Scene, view: &View<D>) -> Option<[[f64; 2]; 2]> {
    let plane = |point: &nalgebra::SVector<f64, D>| [point[0], point[D - 1]];
    let points: Vec<[f64; 2]> = match (&view.fluid, &view.grains) {
        (Some(fluid), _) => fluid.mesh.points.iter().map(plane).collect(),
        (None, _) if scene.walls.len() > 1 => scene
            .walls
            .iter()
            .flat_map(|wall| [plane(&wall.from.vector()), plane(&wall.to.vector())])
            .collect(),
        (None, Some(grains)) => grains.position.iter().map(plane).collect(),
        (None, None) => return None,
    };
    let bound = |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|point| point[axis]).reduce(pick);
    let mut lower = [bound(0, f64::min)?, bound(1, f64::min)?];
    let mut upper = [bound(0, f64::max)?, bound(1, f64::max)?];
    for (axis, _, [low, high]) in scene.periodic.iter().flat_map(|periodic| periodic.axes()) {
        (lower[axis], upper[axis]) = (low, high);
    }
    Some([lower, upper])
}

impl<const D: usize> GrainView<'_, D> {
    /// Writes a VTP file.
    pub fn write(&self, path: &Path, stress: Option<&StressColumns>) -> Result<()> {
        let mut columns = vec![
            Column::integers("id", self.id),
            Column::scalars("radius_m", self.radius),
            Column::vectors("velocity_m_per_s", self.velocity),
        ];
        let group: Option<Vec<u32>> = self.group.map(|group| group.iter().map(|k| u32::from(*k)).collect());
        columns.extend(group.iter().map(|group| Column::integers("group", group)));
        columns.extend(self.spin.map(|spin| Column::scalars("spin_rad_per_s", spin)));
        columns.extend(self.temperature.map(|temperature| Column::scalars("temperature_K", temperature)));
        let names = COMPONENTS.map(|name| format!("stress_{name}_Pa"));
        if let Some(stress) = stress {
            columns.extend(
                names.iter().zip(&stress.of_grains).map(|(name, values)| Column::scalars(name, values)),
            );
            columns.push(Column::scalars("coordination", &stress.coordination));
        }
        write_grains(path, self.position, &columns)
    }
}

impl<const D: usize> FluidView<'_, D> {
    /// Writes a VTU file.
    pub fn write(&self, path: &Path, stress: Option<&StressColumns>) -> Result<()> {
        let mut columns = vec![
            Column::vectors("velocity_m_per_s", &self.fields.velocity),
            Column::scalars("pressure_Pa", &self.fields.pressure),
        ];
        columns.extend(self.voidage.map(|voidage| Column::scalars("voidage", voidage)));
        let names: Vec<String> = self.scalars.iter().map(|name| with_unit(name)).collect();
        let scalars = names.iter().zip(&self.fields.scalars);
        columns.extend(scalars.map(|(name, values)| Column::scalars(name, values)));
        let components = COMPONENTS.map(|name| format!("grain_stress_{name}_Pa"));
        let at_nodes = stress.iter().flat_map(|stress| &stress.at_nodes).filter(|values| !values.is_empty());
        columns.extend(components.iter().zip(at_nodes).map(|(name, values)| Column::scalars(name, values)));
        write_mesh(path, &self.mesh.points, &self.mesh.cells, &columns)
    }
}

impl Network {
    /// Writes a VTP file of lines.
    fn write(&self, path: &Path) -> Result<()> {
        let columns = [
            Column::scalars("normal_force_N_per_m", &self.normal_force),
            Column::scalars("tangential_force_N_per_m", &self.tangential_force),
            Column::scalars("gap_m", &self.gap),
            Column::scalars("heat_W_per_m", &self.heat),
            Column::scalars("age_s", &self.age),
        ];
        write_lines::<2>(path, &self.ends, &columns)
    }
}
