//! Several runs with a droplet in the same pictures.

use super::super::hole::Track;
use super::super::snapshot::{Picture, View, paint};
use super::curves::{Run, SINGLE};
use crate::results::table::Table;
use crate::results::{FOLDER, moments, read_scene};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;
use voidage_scene::recorder::create_folder;

/// 0 degrees Celsius, K.
const CELSIUS: f64 = 273.15;

/// Begin of the name of a run that its bed tells from the others.
const BED: &str = "bed of ";

/// Room beside the coolest and the hottest bed, K.
const BESIDE: f64 = 20.0;

/// Draws the curves of runs, from the files in their folders, into a folder.
pub fn draw(folders: &[PathBuf], out: &Path) -> Result<Vec<PathBuf>> {
    let read: Vec<(Scene, Table)> = folders.iter().map(|folder| read(folder)).collect::<Result<_>>()?;
    let mut runs = Vec::new();
    for (folder, (scene, series)) in folders.iter().zip(&read) {
        let run = Run::new(scene, series).ok_or_else(|| {
            let what = format!("{}: its series.csv and scene show no droplet that falls", folder.display());
            Error::input(Notice::new(
                what,
                "several folders are compared by their droplets; give one of other runs",
            ))
        })?;
        runs.push((folder, run));
    }
    runs.sort_by(|(_, a), (_, b)| {
        let bed = |run: &Run| run.bed_temperature().unwrap_or(0.0);
        bed(a).total_cmp(&bed(b))
    });
    create_folder(out)?;
    let names = names(&runs);
    let size = runs.first().map(|(_, run)| run.size());
    let shared = size.filter(|size| runs.iter().all(|(_, run)| run.size() == *size)).unwrap_or_default();
    let mut drawn = Vec::new();
    for figure in &SINGLE {
        let curves = runs.iter().zip(&names).filter_map(|((_, run), name)| figure.curve(run, name));
        let curves: Vec<Curve> = curves.collect();
        if !curves.is_empty() {
            let path = out.join(figure.file);
            figure.draw(&path, &shared, curves)?;
            drawn.push(path);
        }
    }
    drawn.extend(depths(out, &shared, &runs)?);
    let scenes = runs.iter().map(|(folder, _)| {
        let place = folders.iter().position(|other| other == *folder);
        place.map(|place| (folder.as_path(), &read[place]))
    });
    drawn.extend(beds(out, &scenes.flatten().zip(&names).collect::<Vec<_>>())?);
    Ok(drawn)
}

/// A run in its folder, with the name that it has in legends.
type Named<'a> = ((&'a Path, &'a (Scene, Table)), &'a String);

/// The last moments of runs side by side, with the same axes and colours; none where a run has no frames.
fn beds(out: &Path, runs: &[Named]) -> Result<Option<PathBuf>> {
    let (mut shown, mut view, mut titles) = (Vec::new(), None::<View>, Vec::new());
    for ((folder, (scene, series)), name) in runs {
        let moments = moments(folder)?;
        let Some(last) = moments.last() else { return Ok(None) };
        let track = Track::new(series);
        let own = View::over(std::slice::from_ref(last), scene, track.as_ref(), 0.0)?;
        view = view.map_or(own.clone(), |view| own.map(|own| view.join(&own)));
        let picture = Picture::read(last, track.as_ref())?;
        titles.push(format!("{}, {}", name.strip_prefix(BED).unwrap_or(name), picture.title()));
        shown.push((scene, picture));
    }
    let path = out.join("droplet-beds.png");
    let Some(view) = view else { return Ok(None) };
    let Some(mut plane) = view.plane(&path, &titles)? else { return Ok(None) };
    for (k, (scene, picture)) in shown.iter().enumerate() {
        plane.turn_to(k);
        paint(&mut plane, scene, picture, &view)?;
    }
    plane.save()?;
    Ok(Some(path))
}

/// The scene and the series of a run.
fn read(folder: &Path) -> Result<(Scene, Table)> {
    let scene = read_scene(folder)?;
    let series = folder.join("series.csv");
    if !series.is_file() {
        let what = format!("{}: holds no series.csv", folder.display());
        return Err(Error::input(Notice::new(what, FOLDER)));
    }
    let series = Table::series(&series, &scene)?;
    Ok((scene, series))
}

/// Names of runs in legends: the temperature of the bed, or the folder where that does not tell them apart.
fn names(runs: &[(&PathBuf, Run)]) -> Vec<String> {
    let bed = |(_, run): &(&PathBuf, Run)| {
        run.bed_temperature().map(|bed| format!("{BED}{:.0} \u{b0}C", bed - CELSIUS))
    };
    let last = |(folder, _): &(&PathBuf, Run)| Some(folder.file_name()?.to_string_lossy().into_owned());
    let named: [Option<Vec<String>>; 2] = [runs.iter().map(bed).collect(), runs.iter().map(last).collect()];
    let different = |names: &Vec<String>| names.iter().collect::<BTreeSet<_>>().len() == runs.len();
    let whole = || runs.iter().map(|(folder, _)| folder.display().to_string()).collect();
    named.into_iter().flatten().find(different).unwrap_or_else(whole)
}

/// The greatest and the last depth against the temperature of the bed; none where runs lack them.
fn depths(out: &Path, title: &str, runs: &[(&PathBuf, Run)]) -> Result<Option<PathBuf>> {
    let (mut deepest, mut last) = (Vec::new(), Vec::new());
    for (_, run) in runs {
        let (Some(bed), Some(depth)) = (run.bed_temperature(), run.depth()) else { continue };
        let greatest = depth.iter().map(|point| point.1).reduce(f64::max);
        deepest.extend(greatest.map(|depth| (bed - CELSIUS, depth)));
        last.extend(depth.last().map(|point| (bed - CELSIUS, point.1)));
    }
    let Some(((coolest, _), (hottest, _))) = last.first().zip(last.last()).map(|(a, b)| (*a, *b)) else {
        return Ok(None);
    };
    let path = out.join("droplet-final-depth.png");
    let panel = Panel {
        down: true,
        headroom: 0.18,
        curves: vec![
            Curve::joined("at the end", last),
            Curve::known("deepest", deepest),
            Curve::dashes(
                "surface of the bed at time zero",
                vec![(coolest - BESIDE, 0.0), (hottest + BESIDE, 0.0)],
            ),
        ],
        ..Panel::new(
            title,
            "temperature of the bed at time zero (\u{b0}C)",
            "depth of the lowest point h / D",
        )
    };
    panels::large(&path, 1, &[panel])?;
    Ok(Some(path))
}
