//! Checks of the contacts between grains: how they are solved, and the coefficients of pairs of materials.

use super::grains::material_names;
use super::{Checked, fail, known, not_negative, positive, tolerance, within};
use crate::totals::DEEP;
use crate::{Conduction, Contacts, Pair, Scene};

pub(super) fn check(scene: &Scene) -> Checked {
    let Some(contacts) = &scene.contacts else { return Ok(()) };
    tolerance(scene, "contacts.tolerance", contacts.tolerance, 0.1)?;
    within(scene, "contacts.max_penetration", contacts.max_penetration, DEEP, 1.0)?;
    positive(scene, "contacts.max_sweeps", contacts.max_sweeps as f64)?;
    positive(scene, "contacts.max_substeps", contacts.max_substeps as f64)?;
    positive(scene, "contacts.max_travel", contacts.max_travel)?;
    if contacts.conduction == Some(Conduction::Hertz) && scene.dimension() == 2 {
        let message = "`contacts.conduction = \"hertz\"` is the law of spheres";
        return fail(
            scene,
            "contacts.conduction",
            message,
            "in the plane use \"henry\", \"henry-printed\" or \"line\"",
        );
    }
    check_pairs(scene, contacts)?;
    check_rolling(scene, contacts)?;
    match &contacts.cohesion {
        Some(cohesion) => {
            not_negative(scene, "contacts.cohesion.force", cohesion.force)?;
            not_negative(scene, "contacts.cohesion.age", cohesion.age)?;
            cohesion.sliding.map_or(Ok(()), |speed| positive(scene, "contacts.cohesion.sliding", speed))
        }
        None => Ok(()),
    }
}

/// Pairs name materials, each pair once, and say something.
fn check_pairs(scene: &Scene, contacts: &Contacts) -> Checked {
    let sorted = |pair: &Pair| {
        let mut names = pair.materials.clone();
        names.sort();
        names
    };
    for (k, pair) in contacts.pairs.iter().enumerate() {
        let path = format!("contacts.pairs[{k}]");
        for (side, name) in pair.materials.iter().enumerate() {
            known(scene, &format!("{path}.materials[{side}]"), name, &material_names(scene), "material")?;
        }
        let friction = format!("{path}.friction");
        pair.friction.map_or(Ok(()), |value| not_negative(scene, &friction, value))?;
        let restitution = format!("{path}.restitution");
        pair.restitution.map_or(Ok(()), |value| within(scene, &restitution, value, 0.0, 1.0))?;
        let rolling = format!("{path}.rolling");
        pair.rolling.map_or(Ok(()), |value| within(scene, &rolling, value, 0.0, 1.0))?;
        if pair.friction.is_none() && pair.restitution.is_none() && pair.rolling.is_none() {
            let message = format!("`{path}` has none of `friction`, `restitution` and `rolling`");
            return fail(scene, &path, message, "give one of them, or take the pair away");
        }
        if contacts.pairs[..k].iter().any(|other| sorted(other) == sorted(pair)) {
            let message = format!("`{path}.materials = {:?}` is there twice", pair.materials);
            return fail(scene, &format!("{path}.materials"), message, "take one of the two away");
        }
    }
    Ok(())
}

/// Resistance to rolling needs grains that spin, and sweeps.
fn check_rolling(scene: &Scene, contacts: &Contacts) -> Checked {
    let material = scene.materials.iter().find(|(_, material)| material.rolling > 0.0);
    let wall = scene.walls.iter().position(|wall| wall.rolling.unwrap_or(0.0) > 0.0);
    let pair = contacts.pairs.iter().position(|pair| pair.rolling.unwrap_or(0.0) > 0.0);
    let key = material
        .map(|(name, _)| format!("materials.{name}.rolling"))
        .or(wall.map(|k| format!("walls[{k}].rolling")))
        .or(pair.map(|k| format!("contacts.pairs[{k}].rolling")));
    match key {
        Some(key) if !contacts.rotation => {
            let message =
                format!("`{key}` resists rolling, but `contacts.rotation = false`: grains do not spin");
            fail(scene, &key, message, "set `contacts.rotation = true`, or take the key away")
        }
        Some(key) if contacts.interior => {
            let message = format!("`{key}` resists rolling, which `contacts.interior = true` cannot solve");
            fail(scene, &key, message, "set `contacts.interior = false`, or take the key away")
        }
        _ => Ok(()),
    }
}
