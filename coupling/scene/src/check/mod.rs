//! What a scene must satisfy beyond its types. Every error names the key, the value and what is allowed.

mod contacts;
mod fluid;
mod grains;
mod overlap;
mod passage;
mod periodic;
mod placement;
mod walls;

use super::{Coordinates, Scene, SceneError};
use crate::recorder::column_name;
pub(crate) use passage::sources;
use voidage_coupling::TEMPERATURE;
use voidage_coupling::scheme::iterated::Iteration;
use voidage_coupling::scheme::relaxation::Relaxation;

type Checked = Result<(), Box<SceneError>>;

/// Largest velocity of a grain at the start, m/s.
const FAST: f64 = 1e5;

/// A rectangle can be meshed: goes before walls along its boundary make the mesh.
pub(super) fn mesh(scene: &Scene) -> Checked {
    fluid::check_mesh(scene)
}

/// Checks that go before defaults are filled in: whether the tables fit together.
pub(super) fn structure(scene: &Scene) -> Checked {
    let dimension = scene.dimension();
    if dimension != 2 {
        let message = format!("`gravity` has {dimension} numbers");
        return fail(
            scene,
            "gravity",
            message,
            "give 2 numbers: 3 dimensions are not available in this version",
        );
    }
    if scene.coupling.is_some() && (scene.grains.is_empty() || scene.fluid.is_none()) {
        let absent = if scene.fluid.is_none() { "fluid" } else { "grains" };
        let message = format!("`[coupling]` is there, but no {absent}");
        return fail(scene, "coupling", message, format!("add the {absent}, or take `[coupling]` away"));
    }
    if scene.grains.len() > 256 {
        return fail(
            scene,
            "grains[256]",
            format!("`grains` has {} groups", scene.grains.len()),
            "give 256 at most",
        );
    }
    if scene.contacts.is_some() && scene.grains.is_empty() {
        return fail(
            scene,
            "contacts",
            "`[contacts]` is there, but no grains",
            "add `[[grains]]`, or take it away",
        );
    }
    if !scene.sinks.is_empty() && scene.grains.is_empty() {
        return fail(
            scene,
            "sinks",
            "`[[sinks]]` are there, but no grains",
            "add `[[grains]]`, or take them away",
        );
    }
    if scene.grains.is_empty() && scene.fluid.is_none() {
        return fail(
            scene,
            "",
            "the scene has neither grains nor a fluid",
            "add `[[grains]]`, `[fluid]`, or both",
        );
    }
    Ok(())
}

/// Checks of how the coupling iterates.
fn iteration(scene: &Scene, iteration: &Iteration) -> Checked {
    positive(scene, "coupling.iteration.tolerance", iteration.tolerance)?;
    positive(scene, "coupling.iteration.heat_tolerance", iteration.heat_tolerance)?;
    positive(scene, "coupling.iteration.most", iteration.most as f64)?;
    match iteration.relaxation {
        Some(Relaxation::Constant(omega)) if !(omega > 0.0 && omega <= 1.0) => {
            let message = format!("`coupling.iteration.relaxation.constant` is {omega}");
            fail(scene, "coupling.iteration.relaxation", message, "give a number above 0 and at most 1")
        }
        _ => Ok(()),
    }
}

/// Checks of the walls, before those that follow a mesh are laid.
pub(super) fn walls(scene: &Scene) -> Checked {
    walls::check(scene)
}

/// Checks of the values, with defaults filled in.
pub(super) fn values(scene: &Scene) -> Checked {
    time(scene)?;
    magnitudes(scene)?;
    periodic::check(scene)?;
    // Before the fluid: a hole that no droplet claims would there be a boundary without conditions.
    scene.droplet.as_ref().map_or(Ok(()), |droplet| fluid::droplet(scene, droplet))?;
    if let Some(fluid) = &scene.fluid {
        fluid::check(scene, fluid)?;
    }
    if let Some(coupling) = &scene.coupling {
        iteration(scene, &coupling.iteration)?;
        within(scene, "coupling.kernel", coupling.kernel, 1.0, 20.0)?;
        within(scene, "coupling.added_mass", coupling.added_mass, 0.0, 100.0)?;
        within(scene, "coupling.sub_cycling.steps", coupling.sub_cycling.steps as f64, 1.0, 1e4)?;
        if coupling.added_mass > 0.0 && !coupling.scheme.knows_acceleration() {
            let message = format!(
                "`coupling.added_mass` is there, and the scheme \"{}\" knows no acceleration of the grains",
                coupling.scheme
            );
            return fail(scene, "coupling.added_mass", message, "take another scheme, or `added_mass` away");
        }
        if scene.droplet.is_some() && coupling.scheme.splits() {
            let message = format!(
                "`coupling.scheme` is \"{}\" beside `[droplet]`, whose water expects one step of the grains in it",
                coupling.scheme
            );
            return fail(scene, "coupling.scheme", message, "take another scheme");
        }
        if let Err(error) = coupling.scheme.require() {
            let voidage_coupling::Notice { what, help } = error.notice();
            return fail(scene, "coupling.scheme", what, help);
        }
        if scene.droplet.is_some() && (coupling.added_mass > 0.0 || coupling.lift.is_some()) {
            let key = if coupling.lift.is_some() { "coupling.lift" } else { "coupling.added_mass" };
            let message = format!("`{key}` is there beside `[droplet]`");
            let help = "take one of them away: how the mesh around a droplet moves is known after the fluid is solved";
            return fail(scene, key, message, help);
        }
        if let Some(cut) = coupling.cut {
            positive(scene, "coupling.cut.travel", cut.travel)?;
            positive(scene, "coupling.cut.absorption", cut.absorption)?;
        }
    }
    columns(scene)?;
    grains::check(scene)?;
    contacts::check(scene)?;
    placement::check(scene)?;
    passage::check(scene)?;
    cohesion_below(scene)?;
    if scene.coupling.as_ref().is_some_and(|coupling| coupling.heat.is_some()) {
        let sides = [("grains", scene.grains_have_heat()), ("fluid", scene.fluid_has_heat())];
        if let Some((side, _)) = sides.iter().find(|(_, heat)| !heat) {
            let message = format!("`coupling.heat` is there, but the {side} has no temperature");
            let help = "give all `grains` a `temperature` and the fluid a `[fluid.heat]`, or take `coupling.heat` away";
            return fail(scene, "coupling.heat", message, help);
        }
    }
    stop(scene)?;
    output(scene)
}

/// Walls, or parts of the boundary, whose names differ have columns that do.
fn columns(scene: &Scene) -> Checked {
    let walls = scene.walls.iter().enumerate().map(|(i, wall)| (format!("walls[{i}].name"), wall.body()));
    let parts = scene.fluid.iter().flat_map(|fluid| fluid.boundaries.iter().enumerate());
    let parts = parts.map(|(i, part)| (format!("fluid.boundaries[{i}].name"), part.name.as_str()));
    for names in [walls.collect::<Vec<_>>(), parts.collect()] {
        let mut known: Vec<(String, &str)> = vec![];
        for (path, name) in names {
            let column = column_name(name);
            match known.iter().find(|(other, _)| *other == column) {
                None => known.push((column, name)),
                Some((_, other)) if *other != name => {
                    let message = format!(
                        "`{path}`: \"{name}\" and \"{other}\" are the same in the columns of series.csv"
                    );
                    return fail(scene, &path, message, "give one of them another name");
                }
                Some(_) => {}
            }
        }
    }
    Ok(())
}

/// Checks of what ends the run early.
fn stop(scene: &Scene) -> Checked {
    let Some(stop) = &scene.stop else { return Ok(()) };
    if let Some(rest) = &stop.at_rest {
        positive(scene, "stop.at_rest.speed", rest.speed)?;
        positive(scene, "stop.at_rest.during", rest.during)?;
        if scene.grains.is_empty() {
            let message = "`stop.at_rest` is there, but no grains";
            return fail(scene, "stop.at_rest", message, "add `[[grains]]`, or take it away");
        }
    }
    stop.wall_time.map_or(Ok(()), |seconds| positive(scene, "stop.wall_time", seconds))?;
    match &stop.value {
        Some(value) if value.above.is_none() && value.below.is_none() => {
            let message = "`stop.value` has no bound";
            fail(scene, "stop.value", message, "add `above` or `below`")
        }
        _ => Ok(()),
    }
}

/// Bounds of cohesion belong to scalars that are there, its halo to a droplet, and both to contacts that stick.
fn cohesion_below(scene: &Scene) -> Checked {
    let (Some(coupling), Some(fluid)) = (&scene.coupling, &scene.fluid) else { return Ok(()) };
    let sticks = scene.contacts.as_ref().is_some_and(|contacts| contacts.cohesion.is_some());
    let needs = "add `contacts.cohesion = { force = .. }`, or take it away";
    if let Some(halo) = coupling.cohesion_halo {
        let path = "coupling.cohesion_halo";
        positive(scene, path, halo)?;
        if scene.droplet.is_none() {
            let message = "`coupling.cohesion_halo` is there without `[droplet]`";
            return fail(scene, path, message, "add a droplet, or take it away");
        }
        if !sticks {
            return fail(scene, path, "`coupling.cohesion_halo` is there, but no contact sticks", needs);
        }
    }
    let mut names: Vec<&str> = fluid.scalars.iter().map(|scalar| scalar.name.as_str()).collect();
    names.extend(fluid.heat.as_ref().map(|_| TEMPERATURE));
    for name in coupling.cohesion_below.keys() {
        let path = format!("coupling.cohesion_below.{name}");
        known(scene, &path, name, &names, "scalar of the fluid")?;
        if !sticks {
            return fail(scene, &path, "`coupling.cohesion_below` is there, but no contact sticks", needs);
        }
    }
    Ok(())
}

/// Numbers that no matter has, and that arithmetic does not survive.
fn magnitudes(scene: &Scene) -> Checked {
    let size = |vector: &Coordinates| vector.0.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let mut bounded = vec![("gravity".to_owned(), size(&scene.gravity), 0.0, 1e6)];
    for (name, material) in &scene.materials {
        bounded.push((format!("materials.{name}.density"), material.density, 1e-6, 1e9));
        bounded.push((format!("materials.{name}.friction"), material.friction, 0.0, 1e3));
    }
    if let Some(force) = scene.fluid.as_ref().and_then(|fluid| fluid.body_force.as_ref()) {
        bounded.push(("fluid.body_force".to_owned(), size(force), 0.0, 1e6));
    }
    for (i, group) in scene.grains.iter().enumerate() {
        let speed = group.velocity.as_ref().map_or(0.0, size);
        bounded.push((format!("grains[{i}].velocity"), speed, 0.0, FAST));
    }
    for (i, wall) in scene.walls.iter().enumerate() {
        bounded.push((format!("walls[{i}].friction"), wall.friction.unwrap_or(0.0), 0.0, 1e3));
    }
    match bounded.into_iter().find(|(_, value, low, high)| value > high || (value < low && *value > 0.0)) {
        None => Ok(()),
        Some((path, value, low, high)) => {
            let message = format!("`{path}`: a size of {value:e} is out of range");
            fail(scene, &path, message, format!("give a size from {low:e} to {high:e}, in SI units"))
        }
    }
}

fn time(scene: &Scene) -> Checked {
    positive(scene, "time.step", scene.time.step)?;
    positive(scene, "time.end", scene.time.end)?;
    let (step, end) = (scene.time.step, scene.time.end);
    if end < step * (1.0 - 1e-9) {
        let message = format!("`time.end = {end}` is before the end of the first step");
        return fail(scene, "time.end", message, format!("give at least one step of {step} s"));
    }
    if end / step > 1e12 {
        let message = format!("`time.step = {step}` makes {:.0e} steps", end / step);
        return fail(scene, "time.step", message, "give a larger step");
    }
    Ok(())
}

fn output(scene: &Scene) -> Checked {
    let output = &scene.output;
    let intervals = [
        ("output.frame_interval", output.frame_interval),
        ("output.series_interval", output.series_interval),
        ("output.checkpoint_interval", output.checkpoint_interval),
        ("output.average.interval", output.average.as_ref().and_then(|average| average.interval)),
    ];
    for (path, interval) in intervals {
        interval.map_or(Ok(()), |interval| positive(scene, path, interval))?;
    }
    for (i, time) in output.snapshots.iter().enumerate() {
        not_negative(scene, &format!("output.snapshots[{i}]"), *time)?;
    }
    for (key, asked) in [
        ("output.contacts", output.contacts),
        ("output.stress", output.stress),
        ("output.energy", output.energy),
    ] {
        if asked && scene.grains.is_empty() {
            let message = format!("`{key} = true`, but there are no grains");
            return fail(scene, key, message, "add `[[grains]]`, or take it away");
        }
    }
    if let Some(average) = &output.average {
        if scene.grains.is_empty() {
            let message = "`[output.average]` is there, but no grains";
            return fail(scene, "output.average", message, "add `[[grains]]`, or take it away");
        }
        positive(scene, "output.average.cell", average.cell)?;
        not_negative(scene, "output.average.from", average.from)?;
        if average.to <= average.from {
            let message =
                format!("`output.average.to = {}` is not after `from = {}`", average.to, average.from);
            return fail(scene, "output.average.to", message, "give a time after `from`");
        }
    }
    if let Some(drop) = &output.pressure_drop {
        let Some(fluid) = &scene.fluid else {
            let message = "`[output.pressure_drop]` is there, but no fluid";
            return fail(scene, "output.pressure_drop", message, "add `[fluid]`, or take it away");
        };
        for (path, name) in [("output.pressure_drop.from", &drop.from), ("output.pressure_drop.to", &drop.to)]
        {
            let names: Vec<&str> = fluid.boundaries.iter().map(|boundary| boundary.name.as_str()).collect();
            known(scene, path, name, &names, "boundary of the fluid")?;
        }
    }
    probes(scene)
}

fn probes(scene: &Scene) -> Checked {
    for (i, probe) in scene.output.probes.iter().enumerate() {
        let path = format!("output.probes[{i}]");
        if probe.name.is_empty() {
            let message = format!("`{path}.name` is empty");
            return fail(scene, &format!("{path}.name"), message, "give each probe a name of its own");
        }
        let places = [probe.at.is_some(), probe.line.is_some(), probe.within.is_some()];
        if places.into_iter().filter(|given| *given).count() != 1 {
            let message = format!("`{path}` has not one of `at`, `line` and `box`");
            return fail(scene, &path, message, "give a point, a line or a box");
        }
        if let Some(at) = &probe.at {
            coordinates(scene, &format!("{path}.at"), at)?;
        }
        if let Some(line) = &probe.line {
            coordinates(scene, &format!("{path}.line.from"), &line.from)?;
            coordinates(scene, &format!("{path}.line.to"), &line.to)?;
            if line.from == line.to {
                let message = format!("`{path}.line` has no length");
                return fail(scene, &format!("{path}.line"), message, "give two different ends, or `at`");
            }
        }
        if let Some(within) = &probe.within {
            coordinates(scene, &format!("{path}.box.lower"), &within.lower)?;
            coordinates(scene, &format!("{path}.box.upper"), &within.upper)?;
            corners(scene, &format!("{path}.box"), &within.lower.0, &within.upper.0)?;
        } else if scene.fluid.is_none() {
            let message = format!("`{path}` asks for the fields of a fluid, but there is none");
            return fail(scene, &path, message, "give a `box`, whose grains are recorded, or add `[fluid]`");
        }
    }
    Ok(())
}

fn fail(scene: &Scene, path: &str, message: impl Into<String>, help: impl Into<String>) -> Checked {
    Err(scene.origin.error(path, message, help))
}

fn positive(scene: &Scene, path: &str, value: f64) -> Checked {
    if value > 0.0 {
        return Ok(());
    }
    fail(scene, path, format!("`{path} = {value}` is not above 0"), "give a number above 0")
}

fn not_negative(scene: &Scene, path: &str, value: f64) -> Checked {
    if value >= 0.0 {
        return Ok(());
    }
    fail(scene, path, format!("`{path} = {value}` is below 0"), "give 0 or more")
}

fn within(scene: &Scene, path: &str, value: f64, low: f64, high: f64) -> Checked {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let message = format!("`{path} = {value}` is out of range");
    fail(scene, path, message, format!("give a number from {low} to {high}"))
}

/// A relative tolerance: a residual of 1 is what no solution at all has, so that a tolerance near it solves nothing.
fn tolerance(scene: &Scene, path: &str, value: f64, most: f64) -> Checked {
    if value > 0.0 && value <= most {
        return Ok(());
    }
    let message = format!("`{path} = {value:?}` is out of range");
    fail(scene, path, message, format!("give a number above 0, at most {most}"))
}

fn known(scene: &Scene, path: &str, name: &str, names: &[&str], what: &str) -> Checked {
    if names.contains(&name) {
        return Ok(());
    }
    let help = if names.is_empty() {
        "there are none".to_owned()
    } else {
        format!("there are: {}", names.join(", "))
    };
    fail(scene, path, format!("`{path} = \"{name}\"` is no {what}"), help)
}

fn coordinates(scene: &Scene, path: &str, value: &Coordinates) -> Checked {
    let (have, want) = (value.0.len(), scene.dimension());
    if have == want {
        return Ok(());
    }
    let message = format!("`{path} = {:?}` has {have} numbers", value.0);
    fail(scene, path, message, format!("give {want} numbers, as many as `gravity` has"))
}

/// Two corners in the right order.
fn corners(scene: &Scene, path: &str, lower: &[f64], upper: &[f64]) -> Checked {
    match lower.iter().zip(upper).position(|(low, high)| low >= high) {
        None => Ok(()),
        Some(axis) => {
            let message =
                format!("`{path}.upper = {upper:?}` is not above `lower = {lower:?}` along axis {axis}");
            fail(
                scene,
                &format!("{path}.upper"),
                message,
                "give an upper corner above and right of the lower one",
            )
        }
    }
}

/// A wall or side is no point.
fn distinct(scene: &Scene, path: &str, from: &Coordinates, to: &Coordinates) -> Checked {
    if from != to {
        return Ok(());
    }
    fail(scene, path, format!("`{path} = {:?}` is also the first end", to.0), "give two different points")
}
