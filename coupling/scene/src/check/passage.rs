//! Checks of sources and sinks of grains.

use super::{Checked, coordinates, corners, distinct, fail, not_negative, positive};
use crate::recorder::column_name;
use crate::{Flow, GrainSource, Grains, Placement, Radius, Rate, Scene, Sink};
use voidage_dem::Rounded;

/// The sources of a scene, each with the number of its group.
pub(crate) fn sources(scene: &Scene) -> impl Iterator<Item = (usize, &Grains, &GrainSource)> {
    scene.grains.iter().enumerate().filter_map(|(k, group)| match &group.placement {
        Placement::Source(source) => Some((k, group, source)),
        _ => None,
    })
}

/// Checks of all but where a source is, which is checked with the other places.
pub(super) fn check(scene: &Scene) -> Checked {
    let mut names: Vec<(String, &str)> = vec![];
    let mut once = |path: &str, name: &str, kind: &'static str| -> Checked {
        let key = format!("{path}.name");
        if name.is_empty() {
            return fail(
                scene,
                &key,
                format!("`{key}` is empty"),
                "give a name: columns of series.csv have it",
            );
        }
        let column = (column_name(name), kind);
        if names.contains(&column) {
            let message = format!(
                "`{key} = \"{name}\"`: another {kind} has this name, or one that is the same in series.csv"
            );
            return fail(scene, &key, message, format!("give each {kind} a name of its own"));
        }
        names.push(column);
        Ok(())
    };
    for (k, group, source) in sources(scene) {
        let path = format!("grains[{k}].placement.source");
        once(&path, &source.name, "source")?;
        check_source(scene, &path, group, source)?;
    }
    for (k, sink) in scene.sinks.iter().enumerate() {
        let path = format!("sinks[{k}]");
        once(&path, &sink.name, "sink")?;
        check_sink(scene, &path, sink)?;
    }
    check_open(scene)
}

fn check_source(scene: &Scene, path: &str, group: &Grains, source: &GrainSource) -> Checked {
    match source.rate {
        Rate::Grains(rate) => positive(scene, &format!("{path}.rate.grains"), rate)?,
        Rate::Mass(rate) => positive(scene, &format!("{path}.rate.mass"), rate)?,
    }
    check_times(scene, path, source.start, source.end)?;
    coordinates(scene, &format!("{path}.lower"), &source.lower)?;
    coordinates(scene, &format!("{path}.upper"), &source.upper)?;
    let diameter = 2.0 * group.radius.as_ref().map_or(0.0, Radius::largest);
    let narrow = (0..2).find(|&axis| source.upper.0[axis] - source.lower.0[axis] < diameter);
    match narrow {
        None => Ok(()),
        Some(axis) => {
            let key = format!("{path}.upper");
            let message = format!("`{key} = {:?}`: the box does not hold the largest grain", source.upper.0);
            let help = format!("make it at least {} m wide along axis {axis}", Rounded(diameter));
            fail(scene, &key, message, help)
        }
    }
}

fn check_sink(scene: &Scene, path: &str, sink: &Sink) -> Checked {
    check_times(scene, path, sink.start, sink.end)?;
    let line = !(sink.from.is_empty() && sink.to.is_empty());
    let region = !(sink.lower.is_empty() && sink.upper.is_empty());
    match (line, region) {
        (true, false) => {
            coordinates(scene, &format!("{path}.from"), &sink.from)?;
            coordinates(scene, &format!("{path}.to"), &sink.to)?;
            distinct(scene, &format!("{path}.to"), &sink.from, &sink.to)
        }
        (false, true) => {
            coordinates(scene, &format!("{path}.lower"), &sink.lower)?;
            coordinates(scene, &format!("{path}.upper"), &sink.upper)?;
            corners(scene, path, &sink.lower.0, &sink.upper.0)
        }
        _ => {
            let what = if line { "has both a line and a box" } else { "says not where it is" };
            let help =
                "give `from` and `to`, the ends of a line, or `lower` and `upper`, the corners of a box";
            fail(scene, path, format!("`{path}` {what}"), help)
        }
    }
}

fn check_times(scene: &Scene, path: &str, start: f64, end: Option<f64>) -> Checked {
    not_negative(scene, &format!("{path}.start"), start)?;
    match end.filter(|end| *end <= start) {
        None => Ok(()),
        Some(end) => {
            let key = format!("{path}.end");
            let message = format!("`{key} = {end}` is not after `start = {start}`");
            fail(scene, &key, message, "give a later end, or take it away")
        }
    }
}

/// A fluid makes room for grains that come in, and takes that of those that go, through an open boundary.
fn check_open(scene: &Scene) -> Checked {
    let Some(fluid) = &scene.fluid else { return Ok(()) };
    let source = sources(scene).next().map(|(k, ..)| format!("grains[{k}].placement.source"));
    let Some(path) = source.or_else(|| (!scene.sinks.is_empty()).then(|| "sinks[0]".to_owned())) else {
        return Ok(());
    };
    if fluid.boundaries.iter().any(|boundary| matches!(boundary.flow, Flow::Open { .. })) {
        return Ok(());
    }
    let message = format!("`{path}`: the fluid has no open boundary, through which it could make room");
    fail(scene, &path, message, "give a boundary of the fluid `flow = \"open\"`")
}
