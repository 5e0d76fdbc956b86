//! Checks of where grains start: inside the fluid, in boxes with room for them, or as a file has them.

use super::overlap::{distance_to_wall, overlapping};
use super::{Checked, FAST, coordinates, corners, fail, not_negative};
use crate::placing::material_names;
use crate::{Amount, Coordinates, Deposit, Grains, Lattice, MeshSource, Placement, Radius, RandomBox, Scene};
use std::path::Path;
use voidage_coupling::Error;
use voidage_dem::Rounded;
use voidage_dem::packing::{Kinds, Table, read_table};

/// Grains start inside the mesh, off the walls, and apart from each other.
pub(super) fn check(scene: &Scene) -> Checked {
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
        coordinates(scene, &format!("{path}.{key}"), &Coordinates(corner.to_vec()))?;
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

/// Grains of a file lie inside the fluid, off the walls, and apart.
fn check_file(scene: &Scene, file: &Path) -> Result<(), String> {
    let materials = vec![voidage_dem::Material::default(); scene.grains.len()];
    let kinds = Kinds { own: 0, materials: &materials, names: &material_names(scene) };
    let Table { grains, lines, .. } = read_table::<2>(file, &kinds).map_err(|error| error.to_string())?;
    if grains.rotation.is_some() && scene.contacts.as_ref().is_some_and(|contacts| !contacts.rotation) {
        return Err(format!("{}: there is a column spin, but contacts.rotation = false", file.display()));
    }
    let (file, period) = (file.display(), scene.period());
    for (i, (at, velocity)) in grains.position.iter().zip(&grains.velocity).enumerate() {
        for (what, vector, most) in [("place", at, FAR), ("velocity", velocity, FAST)] {
            if vector.amax() > most {
                let (x, y) = (vector.x, vector.y);
                return Err(format!(
                    "{file}, line {}: the {what} ({x:e}, {y:e}) is out of range, at most {most:e}",
                    lines[i]
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
            lines[i], at.x, at.y
        ));
    }
    match overlapping((&grains.position, &grains.radius), &period, OVERLAP, |_, _| false) {
        None => Ok(()),
        Some((a, b, overlap)) => Err(format!(
            "{file}, line {}: the grain overlaps that of line {} by {overlap:.3e} m",
            lines[b], lines[a]
        )),
    }
}
