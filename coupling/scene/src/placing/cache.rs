//! Beds in files, taken from there by the next run when nothing has changed that determines them.

use super::{Bed, Placed, members, mixture};
use crate as scene;
use crate::build;
use crate::recorder::{create_folder, write_whole};
use crate::{Placement, Scene};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};
use voidage_coupling::error::{Error, Result};
use voidage_dem::packing::{self, Fill, Kinds};
use voidage_dem::{ContactForce, Particles, Partner, Vector, Wall};

/// What is kept beside the tables of a bed.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// Hash of all that determines the bed.
    hash: String,
    /// Hash of both tables.
    tables: String,
    /// Material of each grain, where several were mixed.
    #[serde(default)]
    mixed: Vec<u8>,
    bed: Bed,
}

/// A row of the table of forces: grains and walls by number, N per metre of depth, on the other grain or the wall.
#[derive(Serialize, Deserialize)]
struct Row {
    grain: u32,
    other_grain: Option<u32>,
    wall: Option<u32>,
    force_x: f64,
    force_y: f64,
    /// Moment that resists rolling over the effective radius, N per metre of depth.
    rolling: f64,
}

/// All that determines a bed.
#[derive(Serialize)]
struct Recipe<'a> {
    /// Of this program; a bed of another version is made anew.
    version: &'static str,
    radius: &'a Option<scene::Radius>,
    amount: &'a scene::Amount,
    solidity: f64,
    placement: &'a Placement,
    material: &'a scene::Material,
    mixed: Vec<(usize, &'a scene::Grains, &'a scene::Material)>,
    contacts: &'a Option<scene::Contacts>,
    /// Names of the materials of the group and the walls, by which contacts have laws of pairs.
    names: Vec<Option<&'a String>>,
    walls: Vec<Wall<2>>,
    periodic: &'a Option<scene::Periodic>,
    gravity: f64,
}

pub(super) fn hash(scene: &Scene, k: usize) -> Result<String> {
    let group = &scene.grains[k];
    let recipe = Recipe {
        version: env!("CARGO_PKG_VERSION"),
        radius: &group.radius,
        amount: &group.amount,
        solidity: group.solidity,
        placement: &group.placement,
        material: &scene.materials[&group.material],
        mixed: if mixture(scene, k) {
            members(scene, k).map(|(k, group)| (k, group, &scene.materials[&group.material])).collect()
        } else {
            vec![]
        },
        contacts: &scene.contacts,
        names: [Some(&group.material)]
            .into_iter()
            .chain(scene.walls.iter().map(|wall| wall.material.as_ref()))
            .collect(),
        walls: scene.walls.iter().map(|wall| build::wall(scene, wall)).collect(),
        periodic: &scene.periodic,
        gravity: scene.gravity.vector::<2>().norm(),
    };
    let text =
        serde_json::to_vec(&recipe).map_err(|error| Error::run(format!("cannot hash a bed: {error}")))?;
    Ok(blake3::hash(&text).to_hex().to_string())
}

/// The files beside the table of a bed: what says what it is of, and its forces.
fn label(table: &Path) -> PathBuf {
    table.with_extension("json")
}

fn table_of_forces(table: &Path) -> PathBuf {
    table.with_extension("forces.csv")
}

/// Hash of the tables of a bed.
fn hash_of_tables(table: &Path) -> std::io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&fs::read(table)?);
    hasher.update(&fs::read(table_of_forces(table))?);
    Ok(hasher.finalize().to_hex().to_string())
}

/// A kept bed, if it is whole and of this hash.
pub(super) fn take(table: &Path, hash: &str, fill: &Fill<'_>) -> Option<(Bed, Placed)> {
    let kept: Kept = serde_json::from_slice(&fs::read(label(table)).ok()?).ok()?;
    if kept.hash != hash || kept.tables != hash_of_tables(table).ok()? {
        return None;
    }
    let kinds = Kinds { own: fill.material, materials: fill.materials, names: &[] };
    let mut grains = packing::read_table(table, &kinds).ok()?.grains;
    if !kept.mixed.is_empty() {
        let Particles { position, radius, .. } = grains;
        grains = Particles::new(position, radius, kept.mixed, fill.materials).ok()?;
    }
    let mut reader = csv::Reader::from_path(table_of_forces(table)).ok()?;
    let force = |row: Row| {
        let partner = row.other_grain.map(Partner::Grain).or(row.wall.map(Partner::Wall))?;
        let force = Vector::<2>::new(row.force_x, row.force_y);
        Some(ContactForce { grain: row.grain, partner, force, age: 0.0, rolling: row.rolling })
    };
    let forces = reader.deserialize().map(|row| force(row.ok()?)).collect::<Option<_>>()?;
    Some((kept.bed, Placed { grains, forces, before: vec![] }))
}

/// Keeps a bed; the tables first, so that the label never speaks of another one.
pub(super) fn keep(table: &Path, hash: String, bed: &Bed, placed: &Placed) -> Result<()> {
    table.parent().map_or(Ok(()), create_folder)?;
    packing::write_table(table, &placed.grains)?;
    let forces = table_of_forces(table);
    write_forces(&forces, &placed.forces).map_err(|error| Error::file(&forces, "write", error.into()))?;
    let tables = hash_of_tables(table).map_err(|error| Error::file(table, "read", error))?;
    let of = &placed.grains.material;
    let mixed = if of.iter().all(|m| *m == of[0]) { vec![] } else { of.clone() };
    let kept = Kept { hash, tables, mixed, bed: bed.clone() };
    write_whole(&label(table), |file| serde_json::to_writer_pretty(file, &kept).map_err(Into::into))
}

fn write_forces(path: &Path, forces: &[ContactForce<2>]) -> csv::Result<()> {
    let mut writer = csv::Writer::from_path(path)?;
    for f in forces {
        let (other_grain, wall) = match f.partner {
            Partner::Grain(grain) => (Some(grain), None),
            Partner::Wall(wall) => (None, Some(wall)),
        };
        let [force_x, force_y] = f.force.into();
        writer.serialize(Row { grain: f.grain, other_grain, wall, force_x, force_y, rolling: f.rolling })?;
    }
    Ok(writer.flush()?)
}
