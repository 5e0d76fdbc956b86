//! From a scene to the system that it describes.

mod fluid;

pub use fluid::{backend, setup};

use crate as scene;
use crate::Scene;
use crate::placing::{self, Placed, Placing};
use voidage_coupling::closure::ThermalFluid;
use voidage_coupling::error::{Error, Result};
use voidage_coupling::exchange::AtGrains;
use voidage_coupling::unsteady::Unsteady;
use voidage_coupling::{Clock, Coupled, Fluid, Interaction, Laws, Mixture, System};
use voidage_dem::packing::Radii;
use voidage_dem::{
    ContactForce, Dem, Material, Motion, Mouth, Pair, Particles, Partner, Passage, Rate, Settings, Side,
    Sink, Source, Wall,
};
use voidage_fluid::Vector;
use voidage_remote::launch::Host;

/// The system of a plane scene, at time zero; `host` starts a fluid solver in another process, if the scene has one.
///
/// # Errors
/// Input that only shows when the grains are placed or the mesh is made: a file, a region too small, a
/// boundary that the mesh lacks; a fluid solver that does not start.
pub fn coupled(scene: &Scene, host: &Host) -> Result<Coupled<2>> {
    placed(scene, host, &mut Placing::alone())
}

/// The same, with somebody who watches grains being placed, and a folder that keeps beds.
///
/// # Errors
/// Those of [`coupled`], a folder that cannot be written, and [`Error::Interrupted`].
pub fn placed(scene: &Scene, host: &Host, placing: &mut Placing<'_>) -> Result<Coupled<2>> {
    if scene.dimension() != 2 {
        let message =
            format!("`gravity` has {} numbers: scenes in space (3D) cannot run yet", scene.dimension());
        return Err(scene.error("gravity", message, "give it two numbers, as a scene in the plane"));
    }
    let grains = if scene.grains.is_empty() { None } else { Some(grains(scene, placing)?) };
    let fluid = scene.fluid.as_ref().map(|fluid| fluid::fluid(scene, fluid, host)).transpose()?;
    let coupling = scene.coupling.clone().unwrap_or_default();
    let system = match (grains, fluid, &scene.fluid) {
        (Some(grains), Some(fluid), Some(described)) => {
            let interaction = interaction(&coupling, &grains, &fluid, described)?;
            System::Mixture(Box::new(Mixture::new(grains, fluid, interaction)))
        }
        (Some(grains), ..) => System::Grains(Box::new(grains), Clock::default()),
        (None, Some(fluid), _) => System::Fluid(Box::new(fluid)),
        (None, None, _) => return Err(Error::input("the scene has neither grains nor a fluid")),
    };
    let mut coupled = Coupled::new(system, coupling.scheme.build(&coupling.options())?);
    coupled.passage = coupled.grains().and_then(|grains| passage(scene, grains)).map(Box::new);
    Ok(coupled)
}

/// The sources and sinks of a scene; none if it has none.
fn passage(scene: &Scene, grains: &Dem<2>) -> Option<Passage<2>> {
    let sources = scene.grains.iter().enumerate().filter_map(|(k, group)| {
        let scene::Placement::Source(source) = &group.placement else { return None };
        Some(Source {
            name: source.name.clone(),
            region: placing::region(&source.lower, &source.upper),
            radii: group.radius.as_ref().map_or(Radii::List(vec![]), placing::radii),
            material: k as u8,
            rate: match source.rate {
                scene::Rate::Grains(rate) => Rate::Grains(rate),
                scene::Rate::Mass(rate) => Rate::Mass(rate),
            },
            amount: placing::amount(&group.amount),
            velocity: group.velocity.as_ref().map_or_else(Vector::zeros, |v| v.vector()),
            temperature: group.temperature.unwrap_or_default(),
            during: [source.start, source.end.unwrap_or(f64::INFINITY)],
            seed: source.seed,
        })
    });
    let sinks = scene.sinks.iter().map(|sink| Sink {
        name: sink.name.clone(),
        mouth: match sink.from.is_empty() {
            true => Mouth::Region(placing::region(&sink.lower, &sink.upper)),
            false => Mouth::Line([sink.from.vector(), sink.to.vector()]),
        },
        during: [sink.start, sink.end.unwrap_or(f64::INFINITY)],
    });
    let passage = Passage::new(sources.collect(), sinks.collect(), &grains.particles);
    (!passage.is_empty()).then_some(passage)
}

fn interaction(
    coupling: &scene::Coupling,
    grains: &Dem<2>,
    fluid: &Fluid<2>,
    described: &scene::Fluid,
) -> Result<Interaction<2>> {
    let laws = laws(coupling, grains, described);
    let count = grains.particles.len();
    let at = AtGrains {
        velocity: vec![fluid::initial_velocity(described); count],
        pressure_gradient: vec![Vector::zeros(); count],
        temperature: match (&laws.thermal, &described.heat) {
            (Some(_), Some(heat)) => vec![heat.initial_temperature; count],
            _ => Vec::new(),
        },
    };
    let mut interaction = Interaction::new(laws, &fluid.mesh, grains, at)?;
    interaction.sticks_below = sticks_below(coupling, fluid)?;
    interaction.halo = coupling.cohesion_halo;
    interaction.heat_tolerance = described.solver.tolerance;
    Ok(interaction)
}

/// The laws of the exchange.
fn laws(coupling: &scene::Coupling, grains: &Dem<2>, described: &scene::Fluid) -> Laws {
    let heat = described.heat.as_ref().filter(|_| grains.particles.heat.is_some());
    Laws {
        drag: coupling.drag,
        voidage_function: coupling.voidage_function,
        heat: coupling.heat.unwrap_or_default(),
        per: coupling.per,
        unsteady: Unsteady { added_mass: coupling.added_mass, lift: coupling.lift },
        kernel: coupling.kernel,
        density: described.density,
        viscosity: described.viscosity,
        thermal: heat.map(|heat| ThermalFluid {
            conductivity: heat.conductivity,
            prandtl: heat.heat_capacity * described.viscosity / heat.conductivity,
        }),
    }
}

/// Scalars by number, and the values below which contacts may stick.
fn sticks_below(coupling: &scene::Coupling, fluid: &Fluid<2>) -> Result<Vec<(usize, f64)>> {
    let number = |name: &String| fluid.scalars.iter().position(|scalar| scalar == name);
    let sticks_below = coupling.cohesion_below.iter().map(|(name, bound)| {
        let unknown =
            || Error::input(format!("`coupling.cohesion_below.{name}`: the fluid has no such scalar"));
        Ok((number(name).ok_or_else(unknown)?, *bound))
    });
    sticks_below.collect()
}

/// Whether two scenes are coupled by schemes that differ.
pub(crate) fn other_scheme(one: &Scene, other: &Scene) -> bool {
    let of = |scene: &Scene| {
        let coupling = scene.coupling.clone().unwrap_or_default();
        (coupling.scheme, coupling.options())
    };
    of(one) != of(other)
}

/// Lets a system go on under the laws of another scene of the same parts, as after a restart; with its coupling scheme,
/// if `scheme`.
///
/// # Errors
/// Laws that do not fit the parts; the fluid solver cannot be reached.
pub(crate) fn change(coupled: &mut Coupled<2>, scene: &Scene, scheme: bool) -> Result<()> {
    let coupling = scene.coupling.clone().unwrap_or_default();
    if let Some(grains) = coupled.grains_mut() {
        let contacts = scene.contacts.clone().unwrap_or_default();
        let walls = scene.walls.iter().map(|wall| self::wall(scene, wall)).collect();
        grains.change(walls, materials(scene), settings(scene, &contacts))?;
    }
    let passed = coupled.passage.take().map(|passage| passage.state().clone());
    coupled.passage = coupled.grains().and_then(|grains| passage(scene, grains)).map(Box::new);
    if let (Some(passage), Some(passed)) = (&mut coupled.passage, passed) {
        passage.restore(passed);
    }
    if let (Some(mixture), Some(described)) = (coupled.mixture_mut(), &scene.fluid) {
        mixture.interaction.laws = laws(&coupling, &mixture.grains, described);
        mixture.interaction.sticks_below = sticks_below(&coupling, &mixture.fluid)?;
        mixture.interaction.halo = coupling.cohesion_halo;
    }
    if let (Some(fluid), Some(described)) = (coupled.fluid_mut(), &scene.fluid) {
        fluid.conditions = fluid::conditions(scene, described);
        fluid.schedules = fluid::schedules(described);
        if let Some(droplet) = &mut fluid.droplet {
            let water = &mut droplet.material.water;
            (water.drag, water.per) = (coupling.drag, coupling.per);
            (water.heat, water.voidage_function) =
                (coupling.heat.unwrap_or_default(), coupling.voidage_function);
            if droplet.state.gone {
                fluid.conditions.retain(|condition| condition.boundary != droplet.boundary);
            }
        }
        // As at a restart, nothing of earlier steps influences the solver.
        fluid.start()?;
    }
    if scheme {
        coupled.set_scheme(coupling.scheme.build(&coupling.options())?);
    }
    Ok(())
}

/// The materials of the groups.
fn materials(scene: &Scene) -> Vec<Material> {
    scene.grains.iter().map(|group| material(&scene.materials[&group.material], group.solidity)).collect()
}

// ---------------------------------------------------------------------------------------------- grains

fn grains(scene: &Scene, placing: &mut Placing<'_>) -> Result<Dem<2>> {
    let names: Vec<&String> = scene.materials.keys().collect();
    let contacts = scene.contacts.clone().unwrap_or_default();
    let walls = scene.walls.iter().map(|wall| self::wall(scene, wall)).collect();
    if let Some(given) = placing.given.take() {
        return Ok(Dem::new(given, walls, materials(scene), settings(scene, &contacts))?);
    }
    let mut materials = Vec::new();
    let (mut all, mut forces) = (Particles::<2>::default(), vec![]);
    let mut heat = voidage_dem::Heat::default();
    for group in &scene.grains {
        let Some(described) = scene.materials.get(&group.material) else {
            return Err(Error::input(format!("no material `{}`; there are {names:?}", group.material)));
        };
        materials.push(material(described, group.solidity));
    }
    let (mut turning, mut numbers) = (voidage_dem::Rotation::default(), vec![]);
    for k in 0..scene.grains.len() {
        let Placed { grains: mut placed, forces: of_bed, before } = placing.place(scene, k, &materials)?;
        let first = all.len() as u32;
        numbers.push((all.len(), before));
        let count = placed.len();
        let still = || vec![0.0; count];
        let own = placed.rotation.take();
        let own =
            own.unwrap_or_else(|| voidage_dem::Rotation { spin: still(), angle: still(), inertia: still() });
        turning.spin.extend(own.spin);
        turning.angle.extend(own.angle);
        forces.extend(of_bed.into_iter().map(|f| ContactForce {
            grain: first + f.grain,
            partner: match f.partner {
                Partner::Grain(other) => Partner::Grain(first + other),
                wall => wall,
            },
            ..f
        }));
        if placed.heat.is_some() && scene.grains[k].temperature.is_none() {
            let path = format!("grains[{k}].placement");
            let message =
                format!("`{path}`: the file has temperatures (T), but the group has no `temperature`");
            let help = "give it one, and those of the file are taken, or take the column away";
            return Err(scene.error(&path, message, help));
        }
        // Columns of a file go before the values of the group.
        let at_rest = placed.velocity.iter().all(|v| v.norm() == 0.0);
        if scene.grains[k].temperature.is_some() {
            let own = match placed.heat.take() {
                Some(heat) => heat,
                None => {
                    let mut own = placed.clone().heated(0.0, &materials)?.heat.unwrap_or_default();
                    for (temperature, &of) in own.temperature.iter_mut().zip(&placed.material) {
                        *temperature = scene.grains[of as usize].temperature.unwrap_or_default();
                    }
                    own
                }
            };
            heat.temperature.extend(own.temperature);
            heat.capacity.extend(own.capacity);
        }
        // A material is that of one group; what is poured holds grains of all that are mixed.
        for i in 0..placed.len() {
            let group = &scene.grains[placed.material[i] as usize];
            if let Some(velocity) = group.velocity.as_ref().filter(|_| at_rest) {
                placed.velocity[i] = velocity.vector();
            }
            if group.fixed {
                placed.mass[i] = f64::INFINITY;
                placed.velocity[i] = Vector::zeros();
                turning.spin[first as usize + i] = 0.0;
            }
        }
        all.append(placed);
    }
    if scene.grains_have_heat() {
        all.heat = Some(heat);
    }
    scene.check_apart(&all)?;
    scene.check_kernel(&all)?;
    if contacts.rotation {
        all = all.rotating();
        if let Some(rotation) = &mut all.rotation {
            (rotation.spin, rotation.angle) = (turning.spin, turning.angle);
        }
    }
    forces.extend(placing::state::contacts_of_states(scene, &numbers)?);
    let mut dem = Dem::new(all, walls, materials, settings(scene, &contacts))?;
    if !forces.is_empty() {
        dem.start_from(&forces);
    }
    Ok(dem)
}

/// A material of the scene, for grains of a solidity.
pub(crate) fn material(described: &scene::Material, solidity: f64) -> Material {
    Material {
        density: described.density,
        solidity,
        friction: described.friction,
        rolling: described.rolling,
        restitution: described.restitution,
        young: described.young.unwrap_or(0.0),
        poisson: described.poisson.unwrap_or(0.0),
        conductivity: described.conductivity.unwrap_or(0.0),
        heat_capacity: described.heat_capacity.unwrap_or(0.0),
    }
}

/// A wall of the scene, at time 0 and by its law of motion.
pub fn wall(scene: &Scene, described: &scene::Wall) -> Wall<2> {
    let material = described.material.as_ref().and_then(|name| scene.materials.get(name));
    let motion = match &described.motion {
        None => Motion::Fixed,
        Some(scene::Motion::Velocity(v)) => Motion::Translation { velocity: v.vector() },
        Some(scene::Motion::Oscillate(o)) => {
            Motion::Oscillation { amplitude: o.amplitude.vector(), frequency: o.frequency, phase: o.phase }
        }
        Some(scene::Motion::Table(table)) => {
            let middle = 0.5 * (described.from.vector::<2>() + described.to.vector::<2>());
            let centre = if table.centre.is_empty() { middle } else { table.centre.vector() };
            Motion::Table { centre, rows: table.rows.clone() }
        }
        Some(scene::Motion::Rotate(r)) => Motion::Rotation { centre: r.centre.vector(), rate: r.rate },
    };
    let wall = Wall::new(described.name.clone(), described.from.vector(), described.to.vector());
    Wall {
        friction: described.friction.or(material.map(|m| m.friction)).unwrap_or(0.0),
        rolling: described.rolling.or(material.map(|m| m.rolling)).unwrap_or(0.0),
        restitution: described.restitution.or(material.map(|m| m.restitution)).unwrap_or(0.0),
        conductivity: material.and_then(|m| m.conductivity),
        temperature: described.temperature,
        until: described.until,
        motion,
        ..wall
    }
}

/// How contacts of the scene are solved.
pub(crate) fn settings(scene: &Scene, contacts: &scene::Contacts) -> Settings<2> {
    Settings {
        gravity: scene.gravity.vector(),
        tolerance: contacts.tolerance,
        max_sweeps: contacts.max_sweeps,
        interior: contacts.interior,
        max_travel: contacts.max_travel,
        max_substeps: contacts.max_substeps,
        conduction: contacts.conduction,
        dissipation_heats: contacts.dissipation_heats,
        cohesion: contacts.cohesion,
        pairs: pairs(scene, contacts),
        period: scene.period(),
        energy: scene.output.energy,
        ..Settings::default()
    }
}

/// Pairs of materials as the contacts know them: a material for each group, and walls by number.
fn pairs(scene: &Scene, contacts: &scene::Contacts) -> Vec<Pair> {
    let groups = |name: &str| -> Vec<u8> {
        let all = scene.grains.iter().enumerate();
        all.filter(|(_, group)| group.material == name).map(|(k, _)| k as u8).collect()
    };
    let mut pairs = Vec::new();
    for described in &contacts.pairs {
        let [a, b] = &described.materials;
        let scene::Pair { friction, restitution, rolling, .. } = *described;
        for material in groups(a) {
            let others = groups(b).into_iter().map(Side::Material);
            pairs.extend(others.map(|other| Pair { material, other, friction, restitution, rolling }));
        }
        for (of_wall, of_grains) in [(a, b), (b, a)] {
            let walls = scene.walls.iter().enumerate();
            for (k, wall) in walls.filter(|(_, wall)| wall.material.as_ref() == Some(of_wall)) {
                let friction = friction.filter(|_| wall.friction.is_none());
                let restitution = restitution.filter(|_| wall.restitution.is_none());
                let rolling = rolling.filter(|_| wall.rolling.is_none());
                let other = Side::Wall(k as u32);
                pairs.extend(groups(of_grains).into_iter().map(|material| Pair {
                    material,
                    other,
                    friction,
                    restitution,
                    rolling,
                }));
            }
        }
    }
    pairs
}
