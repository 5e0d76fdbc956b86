//! Temperature of the grains along a vertical and a horizontal line.

use super::super::hole::Track;
use super::curves::{Points, Run};
use super::sheet::evenly;
use crate::results::Moment;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_coupling::Result;
use voidage_scene::recorder::{Frame, read_frame};

/// Times at which profiles are drawn.
const TIMES: usize = 6;
/// Height of a horizontal slice and width of a part of it, in diameters of the droplet.
const SLICE: f64 = 0.5;
const PART: f64 = 0.125;

/// Share of the grains of the fullest slice below which one is left out: a few grains that fly.
const FEW: f64 = 0.1;

/// Draws both profiles; none without grains that have temperatures.
pub fn draw(folder: &Path, run: &Run, track: Option<&Track>, moments: &[Moment]) -> Result<Option<PathBuf>> {
    let Some(track) = track else { return Ok(None) };
    let (mut curves, mut heights, mut last) = (Vec::new(), Points::new(), None);
    for moment in evenly(moments, TIMES) {
        let Some(grains) = moment.grains.as_deref().map(read_frame).transpose()? else { continue };
        let slices = means(run, &grains, |[_, y]| Some(y / SLICE));
        let points: Points = slices.into_iter().map(|(slice, mean)| (mean, SLICE * slice)).collect();
        heights.extend(at_height(&points, track.centre(moment.time)[1] / run.diameter));
        curves.push(Curve::joined(format!("t = {:.3} s", moment.time), points));
        last = Some((moment.time, grains));
    }
    let Some((time, grains)) = last.filter(|_| curves.iter().any(|curve| !curve.points.is_empty())) else {
        return Ok(None);
    };
    let named = curves.len();
    curves.push(Curve::known("", heights));
    let label = "mean grain temperature (T \u{2212} T_d) / (T\u{2080} \u{2212} T_d)";
    let title = format!("horizontal slices {SLICE} D high; circles: centre of the droplet");
    let vertical =
        Panel { headroom: 0.055 * named as f64, curves, ..Panel::new(title, label, "height y / D") };
    let [x, y] = track.centre(time).map(|place| place / run.diameter);
    let inside = |[along, up]: [f64; 2]| ((up - y).abs() < 0.5 * SLICE).then_some(along / PART);
    let parts = means(run, &grains, inside).into_iter().map(|(part, mean)| (PART * part, mean)).collect();
    let radius = track.radius(time) / run.diameter;
    let edge = |name: &str, x: f64| Curve::dashes(name, vec![(x, 0.0), (x, 1.0)]);
    let horizontal = Panel {
        headroom: 0.12,
        curves: vec![
            Curve::joined("grains", parts),
            edge("edges of the droplet", x - radius),
            edge("", x + radius),
        ],
        ..Panel::new(format!("slice {SLICE} D high around the droplet, t = {time:.3} s"), "x / D", label)
    };
    let path = folder.join("droplet-profiles.png");
    panels::large(&path, 2, &[vertical, horizontal])?;
    Ok(Some(path))
}

/// The point of a vertical profile at a height, on the line between two slices.
fn at_height(points: &[(f64, f64)], height: f64) -> Option<(f64, f64)> {
    points.windows(2).find_map(|pair| {
        let [(from, low), (to, high)] = [pair[0], pair[1]];
        let share = (height - low) / (high - low);
        (0.0..=1.0).contains(&share).then_some((from + share * (to - from), height))
    })
}

/// Mean scaled temperature of the grains with the same whole number of a coordinate, over the middle of that
/// coordinate; grains count by volume. The coordinate is of the centre over D; grains without one are left out.
fn means(run: &Run, grains: &Frame, coordinate: impl Fn([f64; 2]) -> Option<f64>) -> Points {
    let (Some(radius), Some(temperature)) = (grains.column("radius_m"), grains.column("temperature_K"))
    else {
        return Points::new();
    };
    let mut sums = BTreeMap::<i64, [f64; 2]>::new();
    for ((point, radius), temperature) in grains.points.iter().zip(radius).zip(temperature) {
        let place = coordinate([point[0] / run.diameter, point[1] / run.diameter]);
        if let Some((place, value)) = place.zip(run.scaled(*temperature)) {
            let sum = sums.entry(place.floor() as i64).or_default();
            let volume = radius * radius;
            *sum = [sum[0] + volume, sum[1] + volume * value];
        }
    }
    let fullest = sums.values().map(|sum| sum[0]).fold(0.0, f64::max);
    let full = sums.into_iter().filter(|(_, [volume, _])| *volume >= FEW * fullest);
    full.map(|(slice, [volume, sum])| (slice as f64 + 0.5, sum / volume)).collect()
}
