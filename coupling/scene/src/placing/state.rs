//! Grains and contacts as another run left them.

use super::Placed;
use crate as scene;
use crate::recorder::{self, Checkpoint};
use crate::{Placement, Scene};
use serde::Deserialize;
use std::path::Path;
use voidage_coupling::error::{Error, Notice, Result};
use voidage_dem::{ContactForce, Material, Particles, Partner, Vector};

/// The grains of a group as another run left them; their contacts are those of [`contacts_of_states`].
pub(super) fn handed_over(
    scene: &Scene,
    k: usize,
    state: &scene::StateFile,
    materials: &[Material],
) -> Result<Placed> {
    let path = format!("grains[{k}].placement.state");
    let wrong = |what: String, help: &str| scene.error(&path, format!("`{path}`: {what}"), help);
    let (there, _) = read_state(&state.file).map_err(|error| {
        let Notice { what, help } = error.notice();
        wrong(what, &help)
    })?;
    let particles = there.particles;
    let before: Vec<u32> = (0..particles.len() as u32)
        .filter(|i| state.group.is_none_or(|group| particles.material[*i as usize] == group))
        .collect();
    if before.is_empty() {
        let groups = particles.material.iter().max().map_or(0, |last| usize::from(*last) + 1);
        let group = state.group.map_or(String::new(), |group| format!("group = {group}: "));
        return Err(wrong(
            format!("{group}{} has no grains of it", state.file.display()),
            &format!("give a group below {groups}, or another file"),
        ));
    }
    let pick = |column: &[f64]| -> Vec<f64> { before.iter().map(|i| column[*i as usize]).collect() };
    let vectors =
        |column: &[Vector<2>]| -> Vec<Vector<2>> { before.iter().map(|i| column[*i as usize]).collect() };
    let material = vec![k as u8; before.len()];
    let mut grains =
        Particles::new(vectors(&particles.position), pick(&particles.radius), material, materials)?;
    if !state.still {
        grains.velocity = vectors(&particles.velocity);
    }
    if let (Some(heat), Some(_)) = (&particles.heat, scene.grains[k].temperature) {
        grains = grains.heated(0.0, materials)?;
        grains.heat.iter_mut().for_each(|own| own.temperature = pick(&heat.temperature));
    }
    if let Some(rotation) = &particles.rotation {
        grains = grains.rotating();
        if let Some(own) = &mut grains.rotation {
            own.angle = pick(&rotation.angle);
            if !state.still {
                own.spin = pick(&rotation.spin);
            }
        }
    }
    Ok(Placed { grains, forces: vec![], before })
}

/// The contacts among grains of states, and with walls of the same name; `numbers` has of each group its first grain
/// and those that its grains had before.
pub(crate) fn contacts_of_states(
    scene: &Scene,
    numbers: &[(usize, Vec<u32>)],
) -> Result<Vec<ContactForce<2>>> {
    let mut files: Vec<&Path> = vec![];
    for group in &scene.grains {
        if let Placement::State(state) = &group.placement
            && !files.contains(&state.file.as_path())
        {
            files.push(&state.file);
        }
    }
    let mut forces = vec![];
    for file in files {
        let (state, walls) = read_state(file)?;
        let mut now: Vec<Option<u32>> = vec![None; state.particles.len()];
        for (group, (first, before)) in scene.grains.iter().zip(numbers) {
            if matches!(&group.placement, Placement::State(of) if of.file == file) {
                for (k, i) in before.iter().enumerate() {
                    now[*i as usize] = Some((first + k) as u32);
                }
            }
        }
        let wall = |number: u32| {
            let name = walls.get(number as usize)?;
            scene.walls.iter().position(|wall| wall.name == *name).map(|wall| Partner::Wall(wall as u32))
        };
        forces.extend(state.forces().filter_map(|force| {
            let partner = match force.partner {
                Partner::Grain(other) => Partner::Grain(now[other as usize]?),
                Partner::Wall(number) => wall(number)?,
            };
            Some(ContactForce { grain: now[force.grain as usize]?, partner, ..force })
        }));
    }
    Ok(forces)
}

/// The state of the grains in a file, and the names of the walls that they met.
fn read_state(file: &Path) -> Result<(voidage_dem::State<2>, Vec<String>)> {
    #[derive(Deserialize)]
    struct Named {
        name: String,
    }
    #[derive(Deserialize)]
    struct Walls {
        #[serde(default)]
        walls: Vec<Named>,
    }
    let checkpoint = Checkpoint::open(file)?;
    let kept: recorder::Kept = checkpoint.recorder()?;
    let walls: Walls = toml::from_str(&kept.course).map_err(|error| {
        Error::input(format!("{}: the scene in it cannot be read: {error}", file.display()))
    })?;
    match crate::simulation::State::of(&checkpoint)?.grains {
        Some(grains) => Ok((grains, walls.walls.into_iter().map(|wall| wall.name).collect())),
        None => Err(Error::input(format!("{}: the run had no grains", file.display()))),
    }
}
