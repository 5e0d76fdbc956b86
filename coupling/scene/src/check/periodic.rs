//! Checks of periodic sides, and of what cannot be beside them.

use super::{Checked, fail};
use crate::{MeshSource, Placement, Radius, Scene};

pub(super) fn check(scene: &Scene) -> Checked {
    let Some(periodic) = &scene.periodic else { return Ok(()) };
    if periodic.axes().next().is_none() {
        let message = "`[periodic]` has neither `x` nor `y`";
        return fail(scene, "periodic", message, "give the places of two sides, such as `x = [0.0, 0.1]`");
    }
    for (axis, name, [low, high]) in periodic.axes() {
        let path = format!("periodic.{name}");
        if low >= high {
            let message = format!("`{path} = [{low}, {high}]` is upside down");
            return fail(scene, &path, message, "give the place of the lower side first, m");
        }
        if let Some(MeshSource::Rectangle(rectangle)) = scene.fluid.as_ref().map(|fluid| &fluid.mesh) {
            let ends = [rectangle.lower[axis], rectangle.upper[axis]];
            if [low, high] != ends {
                let message =
                    format!("`{path} = [{low}, {high}]`: the mesh ends at {} and {}", ends[0], ends[1]);
                return fail(scene, &path, message, format!("give `{name} = {ends:?}`"));
            }
        }
    }
    unsupported(scene)?;
    walls(scene)
}

/// What is not available in a periodic domain.
fn unsupported(scene: &Scene) -> Checked {
    let help = "take one of the two away: they are not available together in this version";
    if scene.droplet.is_some() {
        return fail(scene, "droplet", "`[droplet]` is there beside `[periodic]`", help);
    }
    let Some(fluid) = &scene.fluid else { return placements(scene) };
    if fluid.mesh_motion.is_some() {
        return fail(scene, "fluid.mesh_motion", "`fluid.mesh_motion` is there beside `[periodic]`", help);
    }
    placements(scene)
}

/// Beds are poured on a floor, and from one periodic side to the other.
fn placements(scene: &Scene) -> Checked {
    let Some(periodic) = &scene.periodic else { return Ok(()) };
    for (k, group) in scene.grains.iter().enumerate() {
        let Placement::Deposit(deposit) = &group.placement else { continue };
        let path = format!("grains[{k}].placement.deposit");
        if periodic.y.is_some() {
            let message = format!("`{path}`: grains are poured on a floor, and `periodic.y` has none");
            let help = "place them at random or on a lattice and let them settle in the run, or read them from a file";
            return fail(scene, &path, message, help);
        }
        let (box_x, x) = ([deposit.lower.vector::<2>().x, deposit.upper.vector::<2>().x], periodic.x);
        if x.is_some_and(|x| x != box_x) {
            let message = format!("`{path}`: its box goes from x = {} to {}", box_x[0], box_x[1]);
            let help = format!("let it go from one periodic side to the other, {:?}", x.unwrap_or_default());
            return fail(scene, &path, message, help);
        }
    }
    Ok(())
}

/// No wall stands on a periodic side, and each fits in the period beside the largest grain that is known before any is
/// placed.
fn walls(scene: &Scene) -> Checked {
    let (Some(periodic), period) = (&scene.periodic, scene.period()) else { return Ok(()) };
    let radii = scene.grains.iter().filter_map(|group| group.radius.as_ref().map(Radius::largest));
    let largest = radii.fold(0.0, f64::max);
    if let Err(error) = period.check(largest, &[]) {
        return fail(
            scene,
            "periodic",
            format!("`periodic`: {error}"),
            "give a longer period, or smaller grains",
        );
    }
    for (i, wall) in scene.walls.iter().enumerate() {
        let path = format!("walls[{i}]");
        let ends = [wall.from.vector::<2>(), wall.to.vector::<2>()];
        let on = |axis: usize, side: f64, length: f64| {
            ends.iter().all(|end| (end[axis] - side).abs() <= 1e-9 * length)
        };
        let stands = |(axis, _, [low, high]): (usize, &str, [f64; 2])| {
            on(axis, low, high - low) || on(axis, high, high - low)
        };
        if periodic.axes().any(stands) {
            let message = format!("`{path}`: the wall \"{}\" stands on a periodic side", wall.name);
            return fail(scene, &path, message, "take it away: what comes there goes on at the other side");
        }
        if let Err(error) = period.check(largest, &[crate::build::wall(scene, wall)]) {
            let help = "let it lead from one side to the other at one height, or make it shorter";
            return fail(scene, &path, format!("`{path}`: {error}"), help);
        }
    }
    Ok(())
}
