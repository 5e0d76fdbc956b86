//! Checks of walls: where they are, what they are made of and how they move.

use super::grains::material_names;
use super::{Checked, coordinates, distinct, fail, known, not_negative, positive, within};
use crate::{Motion, MotionTable, Ring, Scene, Wall};

/// Checks of the walls, as the file has them.
pub(super) fn check(scene: &Scene) -> Checked {
    for (i, wall) in scene.walls.iter().enumerate() {
        if scene.walls[..i].iter().any(|other| other.name == wall.name) {
            let path = format!("walls[{i}].name");
            let message = format!("`{path} = \"{}\"`: another wall has this name", wall.name);
            return fail(scene, &path, message, "give each wall a name of its own");
        }
    }
    let mut walls = scene.walls.iter().enumerate();
    walls.try_for_each(|(i, wall)| check_wall(scene, &format!("walls[{i}]"), wall))?;
    (0..scene.walls.len()).try_for_each(|i| check_body(scene, i))
}

/// The parts of a body move alike, about one centre.
fn check_body(scene: &Scene, part: usize) -> Checked {
    let (wall, path) = (&scene.walls[part], format!("walls[{part}].body"));
    let Some(first) = scene.walls[..part].iter().find(|other| other.body() == wall.body()) else {
        return Ok(());
    };
    if first.motion != wall.motion || without_centre(wall) {
        let (one, other, body) = (&first.name, &wall.name, wall.body());
        let message = format!(
            "`{path}`: the walls \"{one}\" and \"{other}\" of the body \"{body}\" do not move as one"
        );
        let help = "give all parts of a body the same `motion`, with a `centre` if it is a table";
        return fail(scene, &path, message, help);
    }
    Ok(())
}

/// Whether the parts of a wall would have a centre each, about which they rotate and their torques are.
fn without_centre(wall: &Wall) -> bool {
    matches!(&wall.motion, Some(Motion::Table(table)) if table.centre.is_empty())
}

fn check_ring(scene: &Scene, path: &str, wall: &Wall, ring: &Ring) -> Checked {
    if !(wall.from.is_empty() && wall.to.is_empty()) || wall.along.is_some() {
        let message = format!("`{path}` is there beside `from`, `to` or `along`");
        return fail(scene, path, message, "a wall is straight, or follows the mesh, or is a ring");
    }
    coordinates(scene, &format!("{path}.centre"), &ring.centre)?;
    positive(scene, &format!("{path}.radius"), ring.radius)?;
    if !(3..=10_000).contains(&ring.pieces) {
        let key = format!("{path}.pieces");
        let message = format!("`{key} = {}` is not between 3 and 10000", ring.pieces);
        return fail(scene, &key, message, "take enough for the grains to roll, such as 48");
    }
    Ok(())
}

fn check_wall(scene: &Scene, path: &str, wall: &Wall) -> Checked {
    let placed = !(wall.from.is_empty() && wall.to.is_empty());
    if without_centre(wall) && (wall.along.is_some() || wall.ring.is_some()) {
        let key = format!("{path}.motion.table");
        let message = format!("`{key}` has no `centre`, and the wall has several parts");
        return fail(
            scene,
            &key,
            message,
            "give the point about which all parts rotate and have their torque",
        );
    }
    match (&wall.along, &wall.ring) {
        (_, Some(ring)) => check_ring(scene, &format!("{path}.ring"), wall, ring)?,
        (None, None) => {
            coordinates(scene, &format!("{path}.from"), &wall.from)?;
            coordinates(scene, &format!("{path}.to"), &wall.to)?;
            distinct(scene, &format!("{path}.to"), &wall.from, &wall.to)?;
        }
        (Some(_), None) if placed => {
            let key = format!("{path}.along");
            let message = format!("`{key}` is there beside `from` or `to`");
            let help =
                "a wall `along` the mesh stands where the mesh is at the start, unless it has a `motion`";
            return fail(scene, &key, message, help);
        }
        (Some(_), None) => {}
    }
    if let Some(material) = &wall.material {
        known(scene, &format!("{path}.material"), material, &material_names(scene), "material")?;
    }
    wall.friction.map_or(Ok(()), |value| not_negative(scene, &format!("{path}.friction"), value))?;
    wall.rolling.map_or(Ok(()), |value| within(scene, &format!("{path}.rolling"), value, 0.0, 1.0))?;
    wall.restitution
        .map_or(Ok(()), |value| within(scene, &format!("{path}.restitution"), value, 0.0, 1.0))?;
    if let Some(temperature) = wall.temperature {
        let key = format!("{path}.temperature");
        positive(scene, &key, temperature)?;
        if scene.contacts.as_ref().is_none_or(|contacts| contacts.conduction.is_none()) {
            let message = format!("`{key}` is there, but contacts conduct no heat");
            return fail(scene, &key, message, "add `contacts.conduction`, or take it away");
        }
    }
    wall.until.map_or(Ok(()), |value| positive(scene, &format!("{path}.until"), value))?;
    match &wall.motion {
        None => Ok(()),
        Some(Motion::Velocity(velocity)) => coordinates(scene, &format!("{path}.motion.velocity"), velocity),
        Some(Motion::Oscillate(way)) => {
            coordinates(scene, &format!("{path}.motion.oscillate.amplitude"), &way.amplitude)?;
            positive(scene, &format!("{path}.motion.oscillate.frequency"), way.frequency)
        }
        Some(Motion::Table(table)) => check_table(scene, &format!("{path}.motion.table"), table),
        Some(Motion::Rotate(way)) => coordinates(scene, &format!("{path}.motion.rotate.centre"), &way.centre),
    }
}

/// The rows of a motion, as they are in the scene or were read from a file.
pub(super) fn check_table(scene: &Scene, path: &str, table: &MotionTable) -> Checked {
    if !table.centre.is_empty() {
        coordinates(scene, &format!("{path}.centre"), &table.centre)?;
    }
    let key = format!("{path}.rows");
    if table.rows.is_empty() {
        return fail(
            scene,
            path,
            format!("`{path}` has no rows"),
            "give `rows = [[t, x, y, angle], ..]`, or a `file`",
        );
    }
    match table.rows.windows(2).find(|rows| rows[1][0] <= rows[0][0]) {
        None => Ok(()),
        Some(rows) => {
            let message = format!("`{key}`: the time {} comes after {}", rows[1][0], rows[0][0]);
            fail(scene, &key, message, "give rows whose times increase")
        }
    }
}
