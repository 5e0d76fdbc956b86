//! From the tables of grains, walls and contacts to the grains.

use crate::Result;
use crate::scene::{self, Amount, Arrangement, Contacts, Grains, Placement, Radius, Scene};
use voidage_dem::packing::{self, Fill, Region};
use voidage_dem::{Dem, Heat, Material, Motion, Particles, Settings, Vector, Wall};

/// The grains of a scene, none if it has none.
pub fn build(scene: &Scene) -> Result<Option<Dem<2>>> {
    if scene.grains.is_empty() {
        return Ok(None);
    }
    // One material per group: the share of a disc that is solid belongs to the group.
    let materials: Vec<Material> = scene.grains.iter().map(|group| material(scene, group)).collect();
    let groups = (0..scene.grains.len()).map(|i| place(scene, i, &materials));
    let groups = groups.collect::<Result<Vec<_>>>()?;
    let contacts = scene.contacts.clone().unwrap_or_default();
    let particles = join(scene, groups, &materials, contacts.rotation)?;
    scene.check_apart(&particles)?;
    let walls = scene.walls.iter().map(|wall| build_wall(scene, wall)).collect();
    Ok(Some(Dem::new(particles, walls, materials, settings(scene, &contacts))?))
}

/// Gives the grains of fixed groups an infinite mass.
pub fn hold(scene: &Scene, particles: &mut Particles<2>) {
    for i in 0..particles.len() {
        if scene.grains[particles.material[i] as usize].fixed {
            particles.mass[i] = f64::INFINITY;
            particles.velocity[i] = Vector::zeros();
            if let Some(rotation) = &mut particles.rotation {
                rotation.inertia[i] = f64::INFINITY;
            }
        }
    }
}

fn material(scene: &Scene, group: &Grains) -> Material {
    let of = &scene.materials[&group.material];
    Material {
        density: of.density,
        solidity: group.solidity,
        friction: of.friction,
        restitution: of.restitution,
        young: of.young.unwrap_or(0.0),
        poisson: of.poisson.unwrap_or(0.0),
        conductivity: of.conductivity.unwrap_or(0.0),
        heat_capacity: of.heat_capacity.unwrap_or(0.0),
    }
}

/// The grains of a group where they start.
fn place(scene: &Scene, index: usize, materials: &[Material]) -> Result<Particles<2>> {
    let group = &scene.grains[index];
    let path = format!("grains[{index}].placement");
    let fill = |seed: u64| Fill {
        radii: match group.radius {
            Some(Radius::Constant(radius)) => packing::Radii::Constant(radius),
            Some(Radius::Uniform([min, max])) => packing::Radii::Uniform { min, max },
            None => packing::Radii::List(Vec::new()), // files only, and they do not ask
        },
        amount: match group.amount {
            Amount::Count(count) => packing::Amount::Count(count),
            Amount::Mass(mass) => packing::Amount::Mass(mass),
            Amount::Fill => packing::Amount::Fill,
        },
        material: index as u8,
        materials,
        seed,
    };
    let region = |lower: &scene::Coordinates, upper: &scene::Coordinates| Region {
        low: lower.vector(),
        high: upper.vector(),
    };
    let placed = match &group.placement {
        Placement::Deposit(at) => {
            let how = packing::Deposit::default();
            packing::deposit(&region(&at.lower, &at.upper), &fill(at.seed), &how)
                .map(|settled| settled.particles)
        }
        Placement::Lattice(at) => {
            let kind = match at.arrangement {
                Arrangement::Square => packing::Lattice::Square,
                Arrangement::Triangular => packing::Lattice::Triangular,
            };
            packing::lattice(&region(&at.lower, &at.upper), kind, at.spacing, &fill(at.seed))
        }
        Placement::Random(at) => packing::random(&region(&at.lower, &at.upper), &fill(at.seed)),
        Placement::Csv(from) => packing::read_table(&from.file, index as u8, materials),
    };
    let grains = placed.map_err(|error| {
        scene.error(&path, format!("`{path}`: {error}"), "change the box, the amount or the radius")
    })?;
    match group.amount {
        Amount::Count(count) if grains.len() < count => Err(scene.error(
            &format!("grains[{index}].amount.count"),
            format!("`grains[{index}].amount.count = {count}`: only {} grains find a place", grains.len()),
            "make the box larger, or ask for fewer",
        )),
        _ => Ok(grains),
    }
}

/// All groups one after the other, with the columns that the scene needs.
fn join(
    scene: &Scene,
    groups: Vec<Particles<2>>,
    materials: &[Material],
    rotation: bool,
) -> Result<Particles<2>> {
    let (mut position, mut radius, mut material) = (Vec::new(), Vec::new(), Vec::new());
    let (mut velocity, mut temperature) = (Vec::new(), Vec::new());
    for (group, grains) in scene.grains.iter().zip(groups) {
        let count = grains.len();
        let in_file = matches!(group.placement, Placement::Csv(_));
        match &group.velocity {
            Some(given) if !in_file || grains.velocity.iter().all(|v| v.norm() == 0.0) => {
                velocity.extend(std::iter::repeat_n(given.vector::<2>(), count));
            }
            _ => velocity.extend(grains.velocity),
        }
        match grains.heat {
            Some(heat) if in_file => temperature.extend(heat.temperature),
            _ => temperature.extend(std::iter::repeat_n(group.temperature.unwrap_or(0.0), count)),
        }
        position.extend(grains.position);
        radius.extend(grains.radius);
        material.extend(grains.material);
    }
    let mut particles = Particles::new(position, radius, material, materials)?;
    particles.velocity = velocity;
    if rotation {
        particles = particles.rotating();
    }
    if scene.grains_have_heat() {
        particles = particles.heated(0.0, materials)?;
        if let Some(Heat { temperature: column, .. }) = &mut particles.heat {
            *column = temperature;
        }
    }
    Ok(particles)
}

fn build_wall(scene: &Scene, wall: &scene::Wall) -> Wall<2> {
    let material = wall.material.as_ref().and_then(|name| scene.materials.get(name));
    Wall {
        friction: wall.friction.or(material.map(|m| m.friction)).unwrap_or(0.0),
        restitution: wall.restitution.or(material.map(|m| m.restitution)).unwrap_or(0.0),
        temperature: wall.temperature,
        conductivity: material.and_then(|m| m.conductivity),
        motion: match &wall.motion {
            None => Motion::Fixed,
            Some(scene::Motion::Velocity(velocity)) => Motion::Translation { velocity: velocity.vector() },
            Some(scene::Motion::Oscillate(way)) => Motion::Oscillation {
                amplitude: way.amplitude.vector(),
                frequency: way.frequency,
                phase: way.phase,
            },
            Some(scene::Motion::Rotate(way)) => {
                Motion::Rotation { centre: way.centre.vector(), rate: way.rate }
            }
        },
        ..Wall::new(wall.name.clone(), wall.from.vector(), wall.to.vector())
    }
}

fn settings(scene: &Scene, contacts: &Contacts) -> Settings<2> {
    Settings {
        gravity: scene.gravity.vector(),
        tolerance: contacts.tolerance,
        max_sweeps: contacts.max_sweeps,
        max_travel: contacts.max_travel,
        max_substeps: contacts.max_substeps,
        conduction: contacts.conduction.map(|law| match law {
            scene::Conduction::Henry => voidage_dem::Conduction::Henry,
            scene::Conduction::HenryPrinted => voidage_dem::Conduction::HenryPrinted,
            scene::Conduction::Line => voidage_dem::Conduction::Line,
            scene::Conduction::Hertz => voidage_dem::Conduction::Hertz,
        }),
        cohesion: contacts
            .cohesion
            .as_ref()
            .map(|cohesion| voidage_dem::Cohesion { force: cohesion.force, steps: cohesion.steps }),
        ..Settings::default()
    }
}
