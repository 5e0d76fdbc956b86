//! Checks of materials, grains, walls and contacts.

use super::{Checked, coordinates, corners, fail, known, not_negative, positive, tolerance, within};
use crate::totals::DEEP;
use crate::{
    Amount, Deposit, Grains, Lattice, Material, MeshSource, Placement, Radius, RandomBox, Scene, Wall,
};
use std::path::Path;
use voidage_coupling::Error;
use voidage_dem::packing::{By, Radii, SizeLaw, read_table};
use voidage_dem::{Particles, Period, Rounded, Vector};

pub(super) fn check(scene: &Scene) -> Checked {
    for (name, material) in &scene.materials {
        check_material(scene, &format!("materials.{name}"), material)?;
    }
    for (i, group) in scene.grains.iter().enumerate() {
        check_group(scene, &format!("grains[{i}]"), group)?;
    }
    check_use(scene)?;
    check_heat(scene)?;
    check_contacts(scene)?;
    check_places(scene)
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

/// Resistance to rolling needs grains that spin, and sweeps.
fn check_rolling(scene: &Scene, contacts: &crate::Contacts) -> Checked {
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

/// Pairs name materials, each pair once, and say something.
fn check_pairs(scene: &Scene, contacts: &crate::Contacts) -> Checked {
    let sorted = |pair: &crate::Pair| {
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

/// A group that is poured with another one: that one is poured, and both say how many they are.
fn check_with(scene: &Scene, path: &str, group: usize, other: usize) -> Checked {
    let key = format!("{path}.with");
    let poured = |k: usize| matches!(scene.grains[k].placement, Placement::Deposit(_));
    if other >= group || !poured(other) {
        let earlier: Vec<usize> = (0..group).filter(|k| poured(*k)).collect();
        let message = format!("`{key} = {other}` is no earlier group that is poured");
        let help = match earlier.is_empty() {
            true => "put a group with `placement.deposit` before this one".to_owned(),
            false => format!("there are: {earlier:?}"),
        };
        return fail(scene, &key, message, help);
    }
    for k in [other, group] {
        if scene.grains[k].amount == Amount::Fill {
            let path = format!("grains[{k}].amount");
            let message = format!("`{path} = \"fill\"`, but the group is part of a mixture");
            return fail(scene, &path, message, "give a count or a mass");
        }
    }
    Ok(())
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

fn check_contacts(scene: &Scene) -> Checked {
    let Some(contacts) = &scene.contacts else { return Ok(()) };
    tolerance(scene, "contacts.tolerance", contacts.tolerance, 0.1)?;
    within(scene, "contacts.max_penetration", contacts.max_penetration, DEEP, 1.0)?;
    positive(scene, "contacts.max_sweeps", contacts.max_sweeps as f64)?;
    positive(scene, "contacts.max_substeps", contacts.max_substeps as f64)?;
    positive(scene, "contacts.max_travel", contacts.max_travel)?;
    if contacts.conduction == Some(crate::Conduction::Hertz) && scene.dimension() == 2 {
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
            not_negative(scene, "contacts.cohesion.age", cohesion.age)
        }
        None => Ok(()),
    }
}

pub(super) fn material_names(scene: &Scene) -> Vec<&str> {
    scene.materials.keys().map(String::as_str).collect()
}

/// Grains start inside the mesh, off the walls, and apart from each other.
fn check_places(scene: &Scene) -> Checked {
    // Before the first group of a mixture is asked whether all of it fits.
    for (i, group) in scene.grains.iter().enumerate() {
        if let Placement::With(other) = group.placement {
            check_with(scene, &format!("grains[{i}].placement"), i, other)?;
        }
    }
    for (i, group) in scene.grains.iter().enumerate() {
        let path = format!("grains[{i}].placement");
        match &group.placement {
            Placement::Deposit(place) => {
                check_box(scene, &format!("{path}.deposit"), &place.lower.0, &place.upper.0)?;
                let key = format!("{path}.deposit.friction");
                place.friction.map_or(Ok(()), |friction| not_negative(scene, &key, friction))?;
            }
            Placement::With(_) => {}
            Placement::State(state) => {
                if !state.file.is_file() {
                    let key = format!("{path}.state.file");
                    let message = format!("`{key}`: there is no file {}", state.file.display());
                    let help =
                        "run the scene that leaves it first; paths are relative to the folder of the scene";
                    return fail(scene, &key, message, help);
                }
            }
            Placement::Source(place) => {
                check_box(scene, &format!("{path}.source"), &place.lower.0, &place.upper.0)?
            }
            Placement::Random(place) => {
                check_box(scene, &format!("{path}.random"), &place.lower.0, &place.upper.0)?
            }
            Placement::Lattice(place) => {
                check_box(scene, &format!("{path}.lattice"), &place.lower.0, &place.upper.0)?;
                check_lattice(scene, &format!("{path}.lattice"), place, group)?;
            }
            Placement::Csv(file) => {
                let key = format!("{path}.csv.file");
                if !file.file.is_file() {
                    let message = format!("`{key}`: there is no file {}", file.file.display());
                    return fail(scene, &key, message, "give a path relative to the folder of the scene");
                }
                if let Err(message) = check_file(scene, &file.file) {
                    return fail(scene, &key, message, "correct the file, or name another one");
                }
            }
        }
        check_room(scene, i)?;
    }
    Ok(())
}

/// Most grains of a group: a hundred times what a machine of today computes in a day, and what its memory holds.
const MOST_GRAINS: f64 = 1e8;

/// A group has not more grains than memory, whatever is asked for.
fn check_number(scene: &Scene, k: usize) -> Checked {
    let group = &scene.grains[k];
    let Some(radius) = &group.radius else { return Ok(()) };
    let (each, solid) = (radius.mean_area(), scene.materials[&group.material].density * group.solidity);
    let room = match &group.placement {
        Placement::Deposit(Deposit { lower, upper, .. })
        | Placement::Random(RandomBox { lower, upper, .. })
        | Placement::Lattice(Lattice { lower, upper, .. }) => {
            (0..2).map(|axis| upper.0[axis] - lower.0[axis]).product::<f64>() / each
        }
        Placement::Csv(_) | Placement::With(_) | Placement::State(_) | Placement::Source(_) => 0.0,
    };
    let (count, key) = match group.amount {
        Amount::Count(count) => (count as f64, "amount.count"),
        Amount::Mass(mass) => (mass / (solid * each), "amount.mass"),
        Amount::Fill => (room, "radius"),
    };
    if count <= MOST_GRAINS {
        return Ok(());
    }
    let path = format!("grains[{k}].{key}");
    let number = match group.amount {
        Amount::Count(count) => count.to_string(),
        Amount::Mass(_) | Amount::Fill => format!("about {count:.0e}"),
    };
    let message = format!("`{path}` makes {number} grains");
    fail(scene, &path, message, format!("{MOST_GRAINS:.0e} at most: give larger grains, or fewer"))
}

/// The grains of a group may all fit in their box.
fn check_room(scene: &Scene, group: usize) -> Checked {
    check_number(scene, group)?;
    match crate::placing::check(scene, group) {
        Err(Error::Scene(error)) => Err(error),
        Err(error) => fail(scene, &format!("grains[{group}].placement"), error.to_string(), "change the box"),
        Ok(()) => Ok(()),
    }
}

fn check_box(scene: &Scene, path: &str, lower: &[f64], upper: &[f64]) -> Checked {
    for (key, corner) in [("lower", lower), ("upper", upper)] {
        coordinates(scene, &format!("{path}.{key}"), &crate::Coordinates(corner.to_vec()))?;
    }
    corners(scene, path, lower, upper)?;
    let Some((inner, outer)) = bounds(scene) else { return Ok(()) };
    let slack = 1e-9 * (outer[0] - inner[0]);
    for (key, corner) in [("lower", lower), ("upper", upper)] {
        if (0..2).any(|axis| corner[axis] < inner[axis] - slack || corner[axis] > outer[axis] + slack) {
            let message =
                format!("`{path}.{key} = {corner:?}` is outside of the fluid: grains would start outside");
            let help = format!("stay within `fluid.mesh`, from {inner:?} to {outer:?}");
            return fail(scene, &format!("{path}.{key}"), message, help);
        }
    }
    Ok(())
}

fn check_lattice(scene: &Scene, path: &str, lattice: &Lattice, group: &Grains) -> Checked {
    let key = format!("{path}.spacing");
    if lattice.spacing < 1.0 {
        let message = format!("`{key} = {}` makes neighbours overlap", lattice.spacing);
        return fail(scene, &key, message, "give 1 or more: it counts in largest diameters");
    }
    let diameter = 2.0 * group.radius.as_ref().map_or(0.0, Radius::largest);
    let narrow = (0..2).find(|&axis| lattice.upper.0[axis] - lattice.lower.0[axis] < diameter * (1.0 - 1e-9));
    match narrow {
        None => Ok(()),
        Some(axis) => {
            let message = format!("`{path}.upper = {:?}`: the box holds no whole grain", lattice.upper.0);
            let help = format!("make it at least {} m wide along axis {axis}", Rounded(diameter));
            fail(scene, &format!("{path}.upper"), message, help)
        }
    }
}

/// The corners of the fluid, if it is a rectangle.
fn bounds(scene: &Scene) -> Option<([f64; 2], [f64; 2])> {
    match &scene.fluid.as_ref()?.mesh {
        MeshSource::Rectangle(rectangle) => Some((rectangle.lower, rectangle.upper)),
        MeshSource::File(_) => None,
    }
}

/// Largest coordinate of a grain of a file, m.
const FAR: f64 = 1e6;

/// Share of the smaller radius by which grains of a file may overlap: what rounding in the file does, and a little
/// more.
const OVERLAP: f64 = 0.02;

/// Share of the radius by which a grain may overlap a wall or a grain of another group once all are placed: settling
/// leaves small penetrations, a wrong box much more.
const LEFT_BY_SETTLING: f64 = 0.25;

/// Grains of a file lie inside the fluid, off the walls, and apart. Lines of the file: the header is the first.
fn check_file(scene: &Scene, file: &Path) -> Result<(), String> {
    let material = voidage_dem::Material::default();
    let grains = read_table::<2>(file, 0, &[material]).map_err(|error| error.to_string())?;
    let (file, period) = (file.display(), scene.period());
    for (i, (at, velocity)) in grains.position.iter().zip(&grains.velocity).enumerate() {
        for (what, vector, most) in [("place", at, FAR), ("velocity", velocity, super::FAST)] {
            if vector.amax() > most {
                let (x, y) = (vector.x, vector.y);
                return Err(format!(
                    "{file}, line {}: the {what} ({x:e}, {y:e}) is out of range, at most {most:e}",
                    i + 2
                ));
            }
        }
    }
    for (i, (at, radius)) in grains.position.iter().zip(&grains.radius).enumerate() {
        let outside = bounds(scene).is_some_and(|(lower, upper)| {
            let reach = radius * (1.0 - OVERLAP);
            // Grains may lie across periodic sides.
            let reach = |axis: usize| if period.sides()[axis].is_some() { 0.0 } else { reach };
            (0..2).any(|axis| at[axis] - reach(axis) < lower[axis] || at[axis] + reach(axis) > upper[axis])
        });
        let cut =
            scene.walls.iter().find(|wall| distance_to_wall(wall, &period, at) < radius * (1.0 - OVERLAP));
        let what = match (outside, cut) {
            (true, _) => "is outside of the fluid".to_owned(),
            (false, Some(wall)) => format!("overlaps the wall \"{}\"", wall.name),
            (false, None) => continue,
        };
        return Err(format!(
            "{file}, line {}: the grain at ({}, {}) of radius {radius} {what}",
            i + 2,
            at.x,
            at.y
        ));
    }
    match overlapping((&grains.position, &grains.radius), &period, OVERLAP, |_, _| false) {
        None => Ok(()),
        Some((a, b, overlap)) => Err(format!(
            "{file}, line {}: the grain overlaps that of line {} by {overlap:.3e} m",
            b + 2,
            a + 2
        )),
    }
}

/// Two grains that overlap by more than a share of the smaller radius, the first before the second, and by how much;
/// pairs that are excused do not count. A sweep along x, in a periodic domain also over the images beyond its upper
/// sides.
fn overlapping(
    (positions, radii): (&[Vector<2>], &[f64]),
    period: &Period<2>,
    share: f64,
    excused: impl Fn(usize, usize) -> bool,
) -> Option<(usize, usize, f64)> {
    let reach = radii.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<(usize, Vector<2>)> = positions.iter().map(|x| period.wrap(*x)).enumerate().collect();
    for axis in 0..2 {
        let Some([low, high]) = period.sides()[axis] else { continue };
        let mut image = Vector::<2>::zeros();
        image[axis] = high - low;
        let beyond = |place: &Vector<2>| place[axis] - low < 2.0 * reach;
        let images: Vec<_> =
            order.iter().filter(|(_, x)| beyond(x)).map(|(grain, x)| (*grain, x + image)).collect();
        order.extend(images);
    }
    order.sort_by(|a, b| a.1.x.total_cmp(&b.1.x));
    for (k, &(a, place)) in order.iter().enumerate() {
        for &(b, other) in &order[k + 1..] {
            let between = other - place;
            if between.x > radii[a] + reach {
                break;
            }
            let overlap = radii[a] + radii[b] - between.norm();
            if a != b && overlap > share * radii[a].min(radii[b]) && !excused(a, b) {
                return Some((a.min(b), a.max(b), overlap));
            }
        }
    }
    None
}

fn distance_to_wall(wall: &Wall, period: &Period<2>, place: &Vector<2>) -> f64 {
    let [ax, ay] = [wall.from.0[0], wall.from.0[1]];
    let [bx, by] = [wall.to.0[0] - ax, wall.to.0[1] - ay];
    let image = period.image(*place, &Vector::<2>::new(ax + 0.5 * bx, ay + 0.5 * by));
    let [x, y] = [image.x, image.y];
    let along = ((x - ax) * bx + (y - ay) * by) / (bx * bx + by * by);
    let along = along.clamp(0.0, 1.0);
    (x - ax - along * bx).hypot(y - ay - along * by)
}

impl Scene {
    /// Checks that grains of different groups do not overlap once all have been placed, and that no wall cuts one
    /// (placement keeps the grains of a group apart). The error points at the group.
    pub(crate) fn check_apart(&self, grains: &Particles<2>) -> Result<(), Error> {
        let path = |grain: usize| format!("grains[{}].placement", grains.material[grain]);
        let number =
            |grain: usize| format!("at ({:.6}, {:.6})", grains.position[grain].x, grains.position[grain].y);
        let one_group = |a: usize, b: usize| grains.material[a] == grains.material[b];
        if let Some((a, b, overlap)) =
            overlapping((&grains.position, &grains.radius), &self.period(), LEFT_BY_SETTLING, one_group)
        {
            let message = format!(
                "`{}`: the grain {} overlaps that {} of `{}` by {overlap:.3e} m",
                path(b),
                number(b),
                number(a),
                path(a)
            );
            return Err(self.error(&path(b), message, "keep groups of grains apart"));
        }
        for (i, (at, radius)) in grains.position.iter().zip(&grains.radius).enumerate() {
            let cuts =
                |wall: &&Wall| distance_to_wall(wall, &self.period(), at) < radius * (1.0 - LEFT_BY_SETTLING);
            if let Some(wall) = self.walls.iter().find(cuts) {
                let message =
                    format!("`{}`: the grain {} overlaps the wall \"{}\"", path(i), number(i), wall.name);
                return Err(self.error(&path(i), message, "place grains off the walls"));
            }
        }
        Ok(())
    }
}
