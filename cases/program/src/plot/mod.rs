//! Pictures of a run, drawn from the files in its folder.

mod boundary;
mod droplet;
mod film;
mod fit;
mod hole;
mod lines;
mod maps;
mod plane;
mod snapshot;

use crate::results::table::Table;
use crate::results::{FOLDER, Moment, moments, read_scene};
use droplet::Droplet;
use snapshot::{EXTREME, Picture, View};
use std::path::{Path, PathBuf};
use tracing::info;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;
use voidage_scene::compare::Finding;
use voidage_scene::recorder::{Frame, Summary};

/// Draws the pictures of one run into its folder; or those that compare runs, where there are several or another folder
/// is given, into that or the current one.
pub fn plot(folders: &[PathBuf], out: Option<&Path>, film: bool) -> Result<Vec<PathBuf>> {
    match (folders, out) {
        ([folder], None) => {
            let mut drawn = draw(folder)?;
            if film {
                drawn.extend(film_of(folder)?);
            }
            if drawn.is_empty() {
                let what = format!("{}: holds neither series.csv nor frames", folder.display());
                return Err(Error::input(Notice::new(what, FOLDER)));
            }
            Ok(drawn)
        }
        _ => droplet::compare::draw(folders, out.unwrap_or(Path::new("."))),
    }
}

/// Draws all pictures that the files in a folder allow.
pub fn draw(folder: &Path) -> Result<Vec<PathBuf>> {
    let scene = read_scene(folder)?;
    let mut drawn = Vec::new();
    let series = folder.join("series.csv");
    let series = if series.is_file() { Some(Table::series(&series, &scene)?) } else { None };
    let averages = folder.join("averages.csv");
    let averages = if averages.is_file() { Some(Table::averages(&averages)?) } else { None };
    if let Some(series) = &series {
        drawn.extend(temperature(folder, &scene, series)?);
        drawn.extend(pressure(folder, &scene, series)?);
        drawn.extend(energy(folder, series)?);
    }
    let moments = moments(folder)?;
    let droplet = Droplet::new(&scene, series.as_ref(), &moments)?;
    drawn.extend(snapshots(folder, &scene, &moments, droplet.as_ref())?);
    if let Some(droplet) = &droplet {
        drawn.extend(droplet.draw(folder, &scene, series.as_ref(), &moments)?);
    }
    if let Some(averages) = &averages {
        drawn.extend(maps::draw(folder, averages)?);
    }
    Ok(drawn)
}

/// Draws the mean fields of the fluid.
pub fn mean_fields(path: &Path, scene: &Scene, means: Frame, title: &str) -> Result<()> {
    snapshot::fields(path, scene, means, title)
}

/// Draws every moment of a run as a picture of a film.
fn film_of(folder: &Path) -> Result<Vec<PathBuf>> {
    let scene = read_scene(folder)?;
    if scene.droplet.is_some() {
        // It is among the pictures of a droplet.
        return Ok(Vec::new());
    }
    let moments = moments(folder)?;
    match View::over(&moments, &scene, None, 0.0)? {
        Some(view) => film::film(folder, &scene, &moments, (&view, None)),
        None => {
            let what = format!("{}: holds no frames, of which a film is made", folder.display());
            Err(Error::input(Notice::new(what, "give the scene `output.frame_interval`, s")))
        }
    }
}

/// Root mean square differences of runs side by side against time, one picture per fluid solver; `step` is the time
/// step, s.
pub fn differences(folder: &Path, step: f64, findings: &[Finding]) -> Result<()> {
    let mut solvers: Vec<&str> = findings.iter().map(|finding| finding.solver.as_str()).collect();
    solvers.sort_unstable();
    solvers.dedup();
    for solver in solvers {
        let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
        for finding in findings.iter().filter(|finding| finding.solver == solver) {
            for (k, difference) in finding.differences.iter().enumerate() {
                if curves.len() == k {
                    curves.push((difference.quantity.to_owned(), Vec::new()));
                }
                curves[k].1.push((finding.step as f64 * step, difference.l2));
            }
        }
        if curves.iter().all(|(_, points)| points.iter().all(|(_, difference)| *difference == 0.0)) {
            info!("{solver}: equal to the bit");
            continue;
        }
        let name = solver.replace([':', '/', ' '], "-");
        lines::differences(&folder.join(format!("free-runs-{name}.png")), curves)?;
    }
    Ok(())
}

/// Mean grain temperature against time, with an exponential.
fn temperature(folder: &Path, scene: &Scene, series: &Table) -> Result<Option<PathBuf>> {
    let (Some(time), Some(mean)) = (series.column("time_s"), series.column("mean_grain_temperature_K"))
    else {
        return Ok(None);
    };
    // Before the first grain has come there is no temperature.
    let rows = time.iter().copied().zip(mean.iter().copied()).filter(|(_, mean)| mean.is_finite());
    let (time, mean): (Vec<f64>, Vec<f64>) = rows.unzip();
    let (time, mean) = (&time[..], &mean[..]);
    if mean.is_empty() {
        return Ok(None);
    }
    let fit = fit::exponential(time, mean, outer_temperature(scene));
    if let Some(fit) = &fit {
        info!("mean grain temperature: time constant {:.3} s towards {:.2} K", fit.time_constant, fit.limit);
        fit.write(&folder.join("temperature_fit.json"))?;
    }
    let path = folder.join("temperature.png");
    lines::temperature(&path, time, mean, fit.as_ref())?;
    Ok(Some(path))
}

/// The one temperature that fluid enters with and walls have; none if they differ.
fn outer_temperature(scene: &Scene) -> Option<f64> {
    use voidage_scene::HeatBoundary;
    let fluid = scene.fluid.as_ref()?;
    let walls = fluid.thin_cell.iter().filter_map(|cell| cell.heat.as_ref()).map(|heat| heat.temperature);
    let boundaries = fluid.boundaries.iter().filter_map(|boundary| match boundary.heat.as_ref()? {
        HeatBoundary::Temperature(temperature) | HeatBoundary::Newton { temperature, .. } => {
            Some(*temperature)
        }
        HeatBoundary::Open { .. } | HeatBoundary::Adiabatic => None,
    });
    let mut all = walls.chain(boundaries);
    let first = all.next()?;
    all.all(|other| other == first).then_some(first)
}

/// Where the mechanical energy of the grains comes from and goes, against time.
fn energy(folder: &Path, series: &Table) -> Result<Option<PathBuf>> {
    let (Some(time), Some(kinetic)) = (series.column("time_s"), series.column("kinetic_energy_J_per_m"))
    else {
        return Ok(None);
    };
    let mut columns = vec![("kinetic energy", kinetic)];
    for (name, label) in [
        ("gravity", "work of gravity"),
        ("fluid", "work of the fluid"),
        ("walls", "work of walls"),
        ("impacts", "impacts"),
        ("friction", "friction"),
        ("rolling", "resistance to rolling"),
        ("cohesion", "cohesion"),
        ("repair", "overlaps taken back"),
        ("rest", "grains stopped"),
        ("step", "length of the step"),
        ("passed", "grains that came and left"),
    ] {
        columns.extend(series.column(&format!("energy_{name}_J_per_m")).map(|column| (label, column)));
    }
    let path = folder.join("energy.png");
    lines::energy(&path, time, &columns)?;
    Ok(Some(path))
}

/// Pressure drop against time, with its mean and the weight of the bed.
fn pressure(folder: &Path, scene: &Scene, series: &Table) -> Result<Option<PathBuf>> {
    let (Some(time), Some(drop)) = (series.column("time_s"), series.column("pressure_drop_Pa")) else {
        return Ok(None);
    };
    let summary = folder.join("summary.json");
    let weight = if summary.is_file() { Summary::read(&summary)?.bed_weight_per_area } else { None };
    let end = time.last().copied().unwrap_or(0.0);
    let window = match &scene.output.average {
        Some(average) if average.from < end => (average.from, average.to.min(end)),
        _ => (0.5 * end, end),
    };
    let path = folder.join("pressure.png");
    lines::pressure(&path, time, drop, window, weight)?;
    Ok(Some(path))
}

/// Pictures of the moments that the scene asks for, and of the last, all with the same axes and colours.
fn snapshots(
    folder: &Path,
    scene: &Scene,
    moments: &[Moment],
    droplet: Option<&Droplet>,
) -> Result<Vec<PathBuf>> {
    let last = moments.last().map(|moment| moment.time);
    let wanted = |moment: &&Moment| {
        let near = |at: &f64| (at - moment.time).abs() <= 0.51 * scene.time.step;
        scene.output.snapshots.iter().any(near) || last == Some(moment.time)
    };
    let wanted: Vec<&Moment> = moments.iter().filter(wanted).collect();
    let (view, track) = droplet.map_or((None, None), |it| (it.view.as_ref(), it.track.as_ref()));
    let own = match view {
        Some(_) => None,
        None => View::over(&wanted, scene, track, EXTREME)?,
    };
    let Some(view) = view.or(own.as_ref()) else { return Ok(Vec::new()) };
    let strongest = wanted.iter().map(|moment| snapshot::strongest(moment));
    let strongest = strongest.collect::<Result<Vec<_>>>()?.into_iter().fold(0.0, f64::max);
    let mut drawn = Vec::new();
    for moment in wanted {
        let path = folder.join(format!("snapshot-{:.3}s.png", moment.time));
        snapshot::draw(&path, scene, &Picture::read(moment, track)?, view)?;
        drawn.push(path);
        let path = folder.join(format!("chains-{:.3}s.png", moment.time));
        if snapshot::chains(&path, scene, moment, view, strongest)? {
            drawn.push(path);
        }
    }
    Ok(drawn)
}
