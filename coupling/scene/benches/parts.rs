//! What each part of a scene costs: a step of the quick bubbling bed with and without it.
//!
//! `cargo bench -p voidage-coupling --bench parts`: medians over the rounds, in which the scenes run by turns. Each
//! runs its own bed, so that contacts differ a little with what they do.

use std::path::Path;
use voidage_scene::{Scene, Simulation};

/// Steps until the bed bubbles.
const WARM: usize = 300;
/// Steps of a round, and rounds.
const STEPS: usize = 40;
const ROUNDS: usize = 9;

/// A scene by what is taken away from it.
type Change = fn(&mut Scene);

const SCENES: &[(&str, Change)] = &[
    ("all", |_| ()),
    ("no conduction through contacts", |scene| {
        scene.contacts.iter_mut().for_each(|contacts| contacts.conduction = None)
    }),
    ("no heat", cold),
    ("no heat, no rotation", |scene| {
        cold(scene);
        scene.contacts.iter_mut().for_each(|contacts| contacts.rotation = false);
    }),
    ("no heat, no rotation, no friction", |scene| {
        cold(scene);
        scene.contacts.iter_mut().for_each(|contacts| contacts.rotation = false);
        scene.materials.values_mut().for_each(|material| material.friction = 0.0);
        scene.walls.iter_mut().for_each(|wall| wall.friction = Some(0.0));
    }),
];

fn cold(scene: &mut Scene) {
    scene.grains.iter_mut().for_each(|group| group.temperature = None);
    scene.contacts.iter_mut().for_each(|contacts| contacts.conduction = None);
    if let Some(fluid) = &mut scene.fluid {
        fluid.heat = None;
        fluid.boundaries.iter_mut().for_each(|boundary| boundary.heat = None);
        fluid.thin_cell.iter_mut().for_each(|cell| cell.heat = None);
    }
    scene.coupling.iter_mut().for_each(|coupling| coupling.heat = None);
}

/// Names of the columns; all phases not named are in the last.
const COLUMNS: [&str; 4] = ["energy", "flow", "contacts", "total"];

fn main() -> Result<(), voidage_coupling::Error> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/bubbling-bed/scene-quick.toml");
    let mut beds = vec![];
    for (name, change) in SCENES {
        let mut scene = Scene::read(&path, &[])?;
        change(&mut scene);
        let mut simulation = Simulation::new(&scene)?;
        for _ in 0..WARM {
            simulation.step()?;
        }
        beds.push((name, simulation, vec![]));
    }
    for _ in 0..ROUNDS {
        for (_, simulation, rounds) in &mut beds {
            let before = times(simulation);
            for _ in 0..STEPS {
                simulation.step()?;
            }
            let after = times(simulation);
            rounds.push(std::array::from_fn(|i| 1e3 * (after[i] - before[i]) / STEPS as f64));
        }
    }
    println!("ms per step, medians of {ROUNDS} rounds of {STEPS} steps\n");
    println!("| | {} |", COLUMNS.join(" | "));
    println!("|---|---|---|---|---|");
    for (name, _, rounds) in &beds {
        let row: Vec<String> = (0..COLUMNS.len()).map(|i| format!("{:.2}", median(rounds, i))).collect();
        println!("| {name} | {} |", row.join(" | "));
    }
    Ok(())
}

/// Seconds spent so far, by column.
fn times(simulation: &Simulation) -> [f64; COLUMNS.len()] {
    let phases = simulation.totals().phases;
    let total = phases.named().into_iter().map(|(_, seconds)| seconds).sum();
    [phases.energy, phases.flow, phases.contacts, total]
}

fn median(rounds: &[[f64; COLUMNS.len()]], column: usize) -> f64 {
    let mut values: Vec<f64> = rounds.iter().map(|round| round[column]).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
