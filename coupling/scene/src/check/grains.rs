//! Checks of materials and of groups of grains: their sizes, their amount and their heat.

use super::{Checked, coordinates, fail, known, not_negative, positive, within};
use crate::{Amount, Grains, Material, Placement, Radius, Scene};
use voidage_dem::packing::{By, Radii, SizeLaw};

pub(super) fn check(scene: &Scene) -> Checked {
    for (name, material) in &scene.materials {
        check_material(scene, &format!("materials.{name}"), material)?;
    }
    for (i, group) in scene.grains.iter().enumerate() {
        check_group(scene, &format!("grains[{i}]"), group)?;
    }
    check_use(scene)?;
    check_heat(scene)
}

/// Something uses each material: one with a misspelt name would change nothing.
fn check_use(scene: &Scene) -> Checked {
    let of_grains = scene.grains.iter().map(|group| &group.material);
    let used: Vec<&String> =
        of_grains.chain(scene.walls.iter().filter_map(|wall| wall.material.as_ref())).collect();
    match scene.materials.keys().find(|name| !used.contains(name)) {
        None => Ok(()),
        Some(name) => {
            let mut others = used;
            others.sort();
            others.dedup();
            let message = format!("nothing is made of `materials.{name}`; grains and walls use {others:?}");
            let help = "correct its name, use it, or take it away";
            fail(scene, &format!("materials.{name}"), message, help)
        }
    }
}

fn check_material(scene: &Scene, path: &str, material: &Material) -> Checked {
    positive(scene, &format!("{path}.density"), material.density)?;
    not_negative(scene, &format!("{path}.friction"), material.friction)?;
    within(scene, &format!("{path}.restitution"), material.restitution, 0.0, 1.0)?;
    within(scene, &format!("{path}.rolling"), material.rolling, 0.0, 1.0)?;
    let optional = [
        ("young", material.young),
        ("conductivity", material.conductivity),
        ("heat_capacity", material.heat_capacity),
    ];
    for (key, value) in optional {
        value.map_or(Ok(()), |value| positive(scene, &format!("{path}.{key}"), value))?;
    }
    material.poisson.map_or(Ok(()), |ratio| within(scene, &format!("{path}.poisson"), ratio, -1.0, 0.5))
}

fn check_group(scene: &Scene, path: &str, group: &Grains) -> Checked {
    known(scene, &format!("{path}.material"), &group.material, &material_names(scene), "material")?;
    if !(group.solidity > 0.0 && group.solidity <= 1.0) {
        let message = format!("`{path}.solidity = {}` is out of range", group.solidity);
        return fail(scene, &format!("{path}.solidity"), message, "give a number above 0, at most 1");
    }
    if let Some(velocity) = &group.velocity {
        coordinates(scene, &format!("{path}.velocity"), velocity)?;
    }
    if let Some(temperature) = group.temperature {
        positive(scene, &format!("{path}.temperature"), temperature)?;
    }
    check_radius(scene, path, group)?;
    match group.amount {
        Amount::Mass(mass) => positive(scene, &format!("{path}.amount.mass"), mass)?,
        Amount::Count(0) => {
            let message = format!("`{path}.amount.count = 0`: the group has no grains");
            return fail(
                scene,
                &format!("{path}.amount.count"),
                message,
                "give 1 or more, or take the group away",
            );
        }
        Amount::Count(_) | Amount::Fill => {}
    }
    let in_file = matches!(group.placement, Placement::Csv(_) | Placement::State(_));
    if in_file && group.amount != Amount::Fill {
        let message = format!("`{path}.amount` is there, but the grains come from a file");
        return fail(
            scene,
            &format!("{path}.amount"),
            message,
            "take it away: all grains of the file are used",
        );
    }
    if matches!(group.placement, Placement::State(_)) && group.velocity.is_some() {
        let (key, message) =
            (format!("{path}.velocity"), format!("`{path}.velocity` is there, but the state has velocities"));
        return fail(scene, &key, message, "take it away");
    }
    if group.fixed && group.velocity.is_some() {
        let message = format!("`{path}.velocity` is there, but `{path}.fixed = true`");
        return fail(
            scene,
            &format!("{path}.velocity"),
            message,
            "take one of them away: fixed grains never move",
        );
    }
    if group.fixed
        && matches!(group.placement, Placement::Deposit(_) | Placement::With(_) | Placement::Source(_))
    {
        let help = "place fixed grains on a lattice, at random or from a file";
        let message = format!("`{path}.fixed = true`: grains that are poured or let in cannot be fixed");
        return fail(scene, &format!("{path}.fixed"), message, help);
    }
    Ok(())
}

fn check_radius(scene: &Scene, path: &str, group: &Grains) -> Checked {
    let in_file = matches!(group.placement, Placement::Csv(_) | Placement::State(_));
    match &group.radius {
        Some(_) if in_file => {
            let message = format!("`{path}.radius` is there, but the grains come from a file");
            fail(scene, &format!("{path}.radius"), message, "take it away: radii are in the file")
        }
        Some(Radius::Constant(radius)) => positive(scene, &format!("{path}.radius.constant"), *radius),
        Some(Radius::Uniform([low, high])) => {
            positive(scene, &format!("{path}.radius.uniform[0]"), *low)?;
            if high < low {
                let message = format!("`{path}.radius.uniform = [{low}, {high}]` is upside down");
                return fail(scene, &format!("{path}.radius.uniform"), message, "give [smallest, largest]");
            }
            Ok(())
        }
        Some(Radius::LogNormal(law)) => {
            let path = format!("{path}.radius.log-normal");
            positive(scene, &format!("{path}.median"), law.median)?;
            positive(scene, &format!("{path}.deviation"), law.deviation)?;
            bounds_of_law(scene, &path, [law.smallest, law.largest])?;
            let law_itself = SizeLaw::LogNormal { median: law.median, deviation: law.deviation };
            some_between(scene, &path, &law_itself, [law.smallest, law.largest])
        }
        Some(Radius::RosinRammler(law)) => {
            let path = format!("{path}.radius.rosin-rammler");
            positive(scene, &format!("{path}.scale"), law.scale)?;
            positive(scene, &format!("{path}.spread"), law.spread)?;
            bounds_of_law(scene, &path, [law.smallest, law.largest])?;
            let law_itself = SizeLaw::RosinRammler { scale: law.scale, spread: law.spread };
            some_between(scene, &path, &law_itself, [law.smallest, law.largest])
        }
        Some(Radius::Sieve(sieve)) => {
            check_sieve(scene, &format!("{path}.radius.sieve.passing"), &sieve.passing)
        }
        None if in_file => Ok(()),
        None => {
            let help = "give `radius = {constant = r}` or `radius = {uniform = [smallest, largest]}`, in m";
            fail(scene, path, format!("`{path}` has no `radius`"), help)
        }
    }
}

/// Largest radius over smallest of a law of sizes.
const WIDEST: f64 = 100.0;

fn bounds_of_law(scene: &Scene, path: &str, [smallest, largest]: [f64; 2]) -> Checked {
    positive(scene, &format!("{path}.smallest"), smallest)?;
    if largest > smallest && largest <= WIDEST * smallest {
        return Ok(());
    }
    let key = format!("{path}.largest");
    let message = format!("`{key} = {largest}` is out of range");
    let most = WIDEST * smallest;
    fail(
        scene,
        &key,
        message,
        format!("give a radius above `smallest`, {smallest}, up to {WIDEST} times it, {most}"),
    )
}

/// Something of a law lies between its bounds.
fn some_between(scene: &Scene, path: &str, law: &SizeLaw, bounds: [f64; 2]) -> Checked {
    let made = [By::Number, By::Mass].map(|by| Radii::by_law::<2>(law, by, bounds));
    if made.iter().all(|radii| radii.is_ok()) {
        return Ok(());
    }
    let message = format!("`{path}`: no grains of this law lie between {} m and {} m", bounds[0], bounds[1]);
    fail(scene, path, message, "move `smallest` and `largest` to where the law has grains")
}

fn check_sieve(scene: &Scene, path: &str, passing: &[[f64; 2]]) -> Checked {
    let help = "give rows `[opening, share]`: openings in m that increase, shares that increase from 0 to 1";
    let wrong = |message: String| fail(scene, path, message, help);
    let (Some(first), Some(last)) = (passing.first(), passing.last()) else {
        return wrong(format!("`{path}` has no rows"));
    };
    if passing.len() < 2 || first[0] <= 0.0 || first[1] != 0.0 || last[1] != 1.0 {
        return wrong(format!("`{path}` goes from {first:?} to {last:?}"));
    }
    match passing.windows(2).find(|rows| rows[1][0] <= rows[0][0] || rows[1][1] < rows[0][1]) {
        Some(rows) => wrong(format!("`{path}`: {:?} comes after {:?}", rows[1], rows[0])),
        None if last[0] > WIDEST * first[0] => {
            wrong(format!("`{path}`: the largest opening is more than {WIDEST} times the smallest"))
        }
        None => Ok(()),
    }
}

/// All groups have a temperature or none has, and materials have what heat needs.
fn check_heat(scene: &Scene) -> Checked {
    let conduction = scene.contacts.as_ref().and_then(|contacts| contacts.conduction);
    if !scene.grains_have_heat() {
        if conduction.is_some() {
            let message = "`contacts.conduction` is there, but the grains have no temperature";
            let help = "give all `grains` a `temperature`, or take `contacts.conduction` away";
            return fail(scene, "contacts.conduction", message, help);
        }
        if scene.contacts.as_ref().is_some_and(|contacts| contacts.dissipation_heats) {
            let message = "`contacts.dissipation_heats` is there, but the grains have no temperature";
            let help = "give all `grains` a `temperature`, or take `contacts.dissipation_heats` away";
            return fail(scene, "contacts.dissipation_heats", message, help);
        }
        return Ok(());
    }
    for (i, group) in scene.grains.iter().enumerate() {
        let path = format!("grains[{i}]");
        if group.temperature.is_none() {
            let message = format!("`{path}` has no `temperature`, but another group has one");
            return fail(scene, &path, message, "give all groups a `temperature`, or none");
        }
        let material = &scene.materials[&group.material];
        let mut needs = vec![("heat_capacity", material.heat_capacity)];
        if conduction.is_some() {
            needs.push(("conductivity", material.conductivity));
            needs.push(("young", material.young));
            needs.push(("poisson", material.poisson));
        }
        if let Some((key, _)) = needs.iter().find(|(_, value)| value.is_none()) {
            let path = format!("materials.{}", group.material);
            let message = format!("`{path}` has no `{key}`, which the heat of the grains needs");
            return fail(scene, &path, message, format!("add `{key}` to `[{path}]`"));
        }
    }
    Ok(())
}

pub(super) fn material_names(scene: &Scene) -> Vec<&str> {
    scene.materials.keys().map(String::as_str).collect()
}
