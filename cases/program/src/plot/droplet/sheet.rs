//! A few moments of a run with a droplet on one sheet, with the same axes and colours.

use super::super::hole::Track;
use super::super::snapshot::{Picture, View, paint};
use crate::results::Moment;
use std::path::Path;
use voidage_coupling::Result;
use voidage_scene::Scene;

/// Pictures on the sheet.
const SHEET: usize = 8;

/// Draws eight moments, evenly over the run, on one sheet.
pub fn sheet(
    path: &Path,
    scene: &Scene,
    moments: &[Moment],
    (view, track): (&View, Option<&Track>),
) -> Result<bool> {
    let shown = evenly(moments, SHEET).map(|moment| Picture::read(moment, track));
    let shown: Vec<Picture> = shown.collect::<Result<_>>()?;
    let titles: Vec<String> = shown.iter().map(Picture::title).collect();
    let Some(mut plane) = view.plane(path, &titles)? else { return Ok(false) };
    for (k, picture) in shown.iter().enumerate() {
        plane.turn_to(k);
        paint(&mut plane, scene, picture, view)?;
    }
    plane.save()?;
    Ok(true)
}

/// So many moments with equal times between them, as nearly as there are; the first and the last among them.
pub fn evenly(moments: &[Moment], most: usize) -> impl Iterator<Item = &Moment> {
    let ends = moments.first().zip(moments.last()).map_or((0.0, 0.0), |(a, b)| (a.time, b.time));
    let steps = most.min(moments.len()).saturating_sub(1).max(1);
    let wanted = (0..=steps).map(move |k| ends.0 + (ends.1 - ends.0) * k as f64 / steps as f64);
    let nearest = wanted.filter_map(|time| {
        let distance = |k: &usize| (moments[*k].time - time).abs();
        (0..moments.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    });
    let mut chosen: Vec<usize> = nearest.collect();
    chosen.dedup();
    chosen.into_iter().map(|k| &moments[k])
}
