//! From a scene to the system that it describes.

use crate as scene;
use crate::Scene;
use crate::placing::{self, Placed, Placing};
use voidage_coupling::backend::{FluidBackend, Model, RustFluid};
use voidage_coupling::closure::ThermalFluid;
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{self, Choices, Droplet};
use voidage_coupling::error::{Error, Result};
use voidage_coupling::exchange::AtGrains;
use voidage_coupling::motion::{Follow, MeshMover, Oscillation};
use voidage_coupling::remesh::Remesher;
use voidage_coupling::unsteady::Unsteady;
use voidage_coupling::{Clock, Coupled, Fluid, Interaction, Laws, Mixture, System, TEMPERATURE};
use voidage_dem::packing::Radii;
use voidage_dem::{
    ContactForce, Dem, Material, Motion, Mouth, Pair, Particles, Partner, Passage, Rate, Settings, Side,
    Sink, Source, Wall,
};
use voidage_fluid::body::{Blowing, Body, BodyMotion};
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::{Numerics, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::linear::{Method, Options};
use voidage_fluid::mesh::{Hole, Rectangle};
use voidage_fluid::transport::{Scalar, ThinCell};
use voidage_fluid::{Mesh, Vector};
use voidage_remote::launch::{self, Host};
use voidage_remote::protocol::Setup;

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
    let fluid = scene.fluid.as_ref().map(|fluid| self::fluid(scene, fluid, host)).transpose()?;
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
    let mut coupled = Coupled::new(system, coupling.scheme.build(&coupling.iteration, coupling.cut));
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
        velocity: vec![initial_velocity(described); count],
        pressure_gradient: vec![Vector::zeros(); count],
        temperature: match (&laws.thermal, &described.heat) {
            (Some(_), Some(heat)) => vec![heat.initial_temperature; count],
            _ => Vec::new(),
        },
    };
    let interaction = Interaction::new(laws, &fluid.mesh, grains, at)?;
    let sticks_below = sticks_below(coupling, fluid)?;
    Ok(Interaction { heat_tolerance: described.solver.tolerance, sticks_below, ..interaction })
}

/// The laws of the exchange.
fn laws(coupling: &scene::Coupling, grains: &Dem<2>, described: &scene::Fluid) -> Laws {
    let heat = described.heat.as_ref().filter(|_| grains.particles.heat.is_some());
    Laws {
        drag: coupling.drag,
        voidage_function: coupling.voidage_function,
        heat: coupling.heat.unwrap_or_default(),
        unsteady: Unsteady { added_mass: coupling.added_mass, lift: coupling.lift },
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
        format!("{:?} {:?} {:?}", coupling.scheme, coupling.iteration, coupling.cut)
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
    }
    if let (Some(fluid), Some(described)) = (coupled.fluid_mut(), &scene.fluid) {
        fluid.conditions = conditions(scene, described);
        fluid.schedules = schedules(described);
        if let Some(droplet) = &mut fluid.droplet {
            let water = &mut droplet.material.water;
            water.drag = coupling.drag;
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
        coupled.set_scheme(coupling.scheme.build(&coupling.iteration, coupling.cut));
    }
    Ok(())
}

/// The materials of the groups.
fn materials(scene: &Scene) -> Vec<Material> {
    scene.grains.iter().map(|group| material(&scene.materials[&group.material], group.solidity)).collect()
}

fn initial_velocity(fluid: &scene::Fluid) -> Vector<2> {
    fluid.initial_velocity.as_ref().map_or_else(Vector::zeros, |v| v.vector())
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
            }
        }
        all.append(placed);
    }
    if scene.grains_have_heat() {
        all.heat = Some(heat);
    }
    scene.check_apart(&all)?;
    if contacts.rotation {
        all = all.rotating();
        if let Some(rotation) = &mut all.rotation {
            (rotation.spin, rotation.angle) = (turning.spin, turning.angle);
        }
    }
    forces.extend(placing::contacts_of_states(scene, &numbers)?);
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
        cohesion: contacts.cohesion,
        pairs: pairs(scene, contacts),
        period: scene.period(),
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

// ----------------------------------------------------------------------------------------------- fluid

fn fluid(scene: &Scene, described: &scene::Fluid, host: &Host) -> Result<Fluid<2>> {
    let mut mesh = mesh(scene, described)?;
    let droplet = scene.droplet.as_ref().map(|droplet| self::droplet(scene, described, droplet, &mut mesh));
    let droplet = droplet.transpose()?;
    let nodes = mesh.points.len();
    let temperature = described.heat.iter().map(|heat| heat.initial_temperature);
    let initial = temperature.chain(described.scalars.iter().map(|scalar| scalar.initial));
    let start = State {
        velocity: vec![initial_velocity(described); nodes],
        pressure: vec![0.0; nodes],
        scalars: initial.map(|value| vec![value; nodes]).collect(),
    };
    let names = scalars(described).into_iter().map(|scalar| scalar.name).collect();
    let mut fluid = Fluid::new(backend(scene, host)?, mesh, start, names, conditions(scene, described))?;
    fluid.ramp = described.ramp;
    fluid.schedules = schedules(described);
    if let (Some(droplet), Some(of)) = (droplet, &scene.droplet) {
        fluid.droplet = Some(Box::new(droplet));
        fluid.remesher =
            Some(Remesher::around_droplet(&fluid.mesh, without(described, &of.boundary), of.remesh));
    }
    if let Some(motion) = &described.mesh_motion {
        fluid.motion = Some(mover(scene, motion, &fluid.mesh)?);
        fluid.remesher = motion.remesh.map(|when| Remesher::new(&fluid.mesh, when));
    }
    Ok(fluid)
}

/// What moves the mesh.
fn mover(scene: &Scene, motion: &scene::MeshMotion, mesh: &Mesh<2>) -> Result<Box<dyn MeshMover<2>>> {
    let wrong = |error: voidage_fluid::Error, remedy: &str| {
        scene.error("fluid.mesh_motion", format!("`fluid.mesh_motion`: {error}"), remedy)
    };
    let boundary = motion.boundary.as_deref();
    if let (Some(table), Some(boundary)) = (&motion.table, boundary) {
        let follow = Follow::new(mesh, table.centre.vector(), table.rows.clone(), boundary, &motion.sliding);
        let remedy = "name parts of the boundary of the mesh; those that slide are straight and parallel to the motion";
        return Ok(Box::new(follow.map_err(|error| wrong(error, remedy))?));
    }
    let (amplitude, frequency) = (motion.amplitude.vector(), motion.frequency.unwrap_or(0.0));
    let oscillation = Oscillation::new(mesh, amplitude, frequency, boundary);
    let followed = oscillation.and_then(|oscillation| match motion.remesh {
        Some(_) => Ok(oscillation),
        None => oscillation.check(mesh).map(|()| oscillation),
    });
    let remedy = "give a smaller amplitude, a boundary of the mesh, or `remesh = {}`";
    Ok(Box::new(followed.map_err(|error| wrong(error, remedy))?))
}

/// All that the fluid solver of a scene is told once; `None` without fluid.
pub fn setup(scene: &Scene) -> Option<Setup<2>> {
    scene.fluid.as_ref().map(|fluid| {
        Setup::new(Model {
            properties: properties(scene, fluid),
            scalars: scalars(fluid),
            numerics: numerics(fluid),
            conditions: conditions(scene, fluid),
        })
    })
}

/// The fluid solver that a scene asks for; it waits for its mesh.
///
/// # Errors
/// The scene has no fluid, the solver does not start.
pub fn backend(scene: &Scene, host: &Host) -> Result<Box<dyn FluidBackend<2>>> {
    let (Some(fluid), Some(setup)) = (&scene.fluid, setup(scene)) else {
        return Err(Error::input("the scene has no fluid"));
    };
    match &fluid.backend {
        Some(backend) if backend.solver != scene::Solver::Rust => {
            Ok(Box::new(launch::remote(backend, host, &setup)?))
        }
        _ => Ok(Box::new(RustFluid::<2, 3>::new(setup.model))),
    }
}

fn mesh(scene: &Scene, described: &scene::Fluid) -> Result<Mesh<2>> {
    let (made, path) = match &described.mesh {
        scene::MeshSource::Rectangle(rectangle) => (Mesh::rectangle(rectangle), "fluid.mesh.rectangle"),
        scene::MeshSource::File(file) => (Mesh::read_msh(file), "fluid.mesh.file"),
    };
    let mesh = made.map_err(|error| {
        scene.error(path, format!("`{path}`: {error}"), "give a mesh of triangles with named boundaries")
    })?;
    let mesh = match &scene.periodic {
        None => mesh,
        Some(periodic) => periodic.join(scene, mesh)?,
    };
    let names: Vec<&str> = mesh.boundaries.iter().map(|boundary| boundary.name.as_str()).collect();
    scene.check_boundary_names(&names)?;
    Ok(mesh)
}

fn properties(scene: &Scene, fluid: &scene::Fluid) -> Properties<2> {
    Properties {
        density: fluid.density,
        viscosity: fluid.viscosity,
        gravity: scene.gravity.vector(),
        body_force: fluid.body_force.as_ref().map_or_else(Vector::zeros, |b| b.vector()),
        thin_cell_drag: fluid.thin_cell.as_ref().map_or(0.0, |cell| cell.drag),
        drag_in_stabilisation: fluid.solver.drag_in_stabilisation,
    }
}

/// The scalars of a fluid, the temperature first.
fn scalars(fluid: &scene::Fluid) -> Vec<Scalar> {
    let thin_cell = fluid.thin_cell.as_ref().and_then(|cell| cell.heat.as_ref());
    let heat = fluid.heat.iter().map(|heat| Scalar {
        name: TEMPERATURE.into(),
        capacity: fluid.density * heat.heat_capacity,
        conductivity: heat.conductivity,
        thin_cell: thin_cell.map(|wall| ThinCell { coefficient: wall.coefficient, value: wall.temperature }),
        form: heat.form,
        expansion: heat.expansion,
        reference: heat.reference_temperature.unwrap_or(heat.initial_temperature),
    });
    let others = fluid.scalars.iter().map(|scalar| Scalar {
        name: scalar.name.clone(),
        capacity: 1.0,
        conductivity: scalar.diffusivity,
        thin_cell: None,
        form: scalar.form,
        expansion: scalar.expansion,
        reference: scalar.reference.unwrap_or(scalar.initial),
    });
    heat.chain(others).collect()
}

fn numerics(fluid: &scene::Fluid) -> Numerics {
    let method = match fluid.solver.linear {
        scene::LinearMethod::Auto => Method::Multifrontal,
        scene::LinearMethod::Direct => Method::MultifrontalFresh,
        scene::LinearMethod::Ilu => Method::Ilu,
    };
    let tolerance = fluid.solver.tolerance;
    let default = Numerics::default();
    Numerics {
        newton: fluid.solver.newton,
        flow: Options { method, tolerance, ..default.flow },
        scalars: Options { tolerance, ..default.scalars },
    }
}

/// The schedules of the boundaries; nothing where none has one.
fn schedules(fluid: &scene::Fluid) -> Vec<Vec<[f64; 2]>> {
    match fluid.boundaries.iter().all(|boundary| boundary.schedule.is_empty()) {
        true => vec![],
        false => fluid.boundaries.iter().map(|boundary| boundary.schedule.clone()).collect(),
    }
}

/// The conditions of the boundaries, and behind them that of the droplet, whose body is filled in by each step.
fn conditions(scene: &Scene, fluid: &scene::Fluid) -> Vec<Condition<2>> {
    let of = |boundary: &scene::Boundary| {
        let heat = fluid.heat.iter().map(|_| heat_condition(boundary.heat.as_ref()));
        let others = fluid.scalars.iter().map(|s| scalar_condition(boundary.scalars.get(&s.name)));
        Condition {
            boundary: boundary.name.clone(),
            flow: flow_condition(&boundary.flow),
            scalars: heat.chain(others).collect(),
        }
    };
    let droplet = scene.droplet.iter().map(|droplet| {
        let value = |value: f64| ScalarCondition::Value(Prescribed::Uniform(value));
        let heat = fluid.heat.iter().map(|_| value(droplet.temperature));
        let others = fluid.scalars.iter().map(|scalar| {
            droplet.scalars.get(&scalar.name).map_or(ScalarCondition::Insulated, |at| value(*at))
        });
        Condition {
            boundary: droplet.boundary.clone(),
            flow: FlowCondition::Body(Body {
                centre: Vector::zeros(),
                radius: 1.0,
                expansion: 0.0,
                motion: BodyMotion::Held(Vector::zeros()),
                evaporation: None,
                blowing: Blowing::default(),
                solid: vec![],
            }),
            scalars: heat.chain(others).collect(),
        }
    });
    fluid.boundaries.iter().map(of).chain(droplet).collect()
}

/// The droplet of a scene, in the hole of the mesh that it has.
fn droplet(
    scene: &Scene,
    fluid: &scene::Fluid,
    described: &scene::Droplet,
    mesh: &mut Mesh<2>,
) -> Result<Droplet<2>> {
    let hole = match &fluid.mesh {
        scene::MeshSource::Rectangle(rectangle) => {
            rectangle.holes.iter().find(|hole| hole.name == described.boundary)
        }
        scene::MeshSource::File(_) => None,
    };
    let (place, growth) = match hole {
        Some(hole) => ((Vector::from(hole.centre), hole.radius), hole.growth),
        None => (round(mesh, &described.boundary)?, Hole::default_growth()),
    };
    let liquid = &described.liquid;
    let coupling = scene.coupling.clone().unwrap_or_default();
    let material = droplet::Material {
        water: Water {
            density: liquid.density,
            viscosity: liquid.viscosity,
            thermal: ThermalFluid {
                conductivity: liquid.conductivity,
                prandtl: liquid.heat_capacity * liquid.viscosity / liquid.conductivity,
            },
            drag: coupling.drag,
            heat: coupling.heat.unwrap_or_default(),
            voidage_function: coupling.voidage_function,
        },
        temperature: described.temperature,
        latent_heat: described.latent_heat,
        vapour_density: fluid.density,
        gravity: scene.gravity.vector(),
        held: described.held,
        choices: Choices {
            heat_flux: described.heat_flux,
            blowing: described.blowing,
            grain_share: described.grain_share,
            buoyancy: described.buoyancy,
            inside: described.inside,
        },
    };
    let velocity = described.velocity.as_ref().map_or_else(Vector::zeros, |v| v.vector());
    Droplet::new(mesh, &described.boundary, place, (velocity, growth), material).map_err(|error| {
        let message = format!("`droplet.boundary`: {error}");
        scene.error("droplet.boundary", message, "give the name of a round hole of the mesh")
    })
}

/// Centre and radius (m) of the hole that a part of the boundary is.
fn round(mesh: &Mesh<2>, name: &str) -> Result<(Vector<2>, f64)> {
    let part = mesh.boundary(name)?;
    let (mut area, mut moment) = (0.0, Vector::<2>::zeros());
    for facet in part.facets.chunks_exact(2) {
        let [b, a] = [0, 1].map(|k| mesh.points[facet[k] as usize]);
        let twice = a[0] * b[1] - a[1] * b[0];
        area += twice / 2.0;
        moment += (a + b) * (twice / 6.0);
    }
    Ok((moment / area, (area.abs() / std::f64::consts::PI).sqrt()))
}

/// The rectangle of a mesh without the hole of a droplet: how long edges should be far from it.
fn without(fluid: &scene::Fluid, hole: &str) -> Option<Rectangle> {
    let scene::MeshSource::Rectangle(rectangle) = &fluid.mesh else { return None };
    let mut rest = rectangle.clone();
    rest.holes.retain(|other| other.name != hole);
    Some(rest)
}

fn flow_condition(flow: &scene::Flow) -> FlowCondition<2> {
    let uniform = |v: &scene::Coordinates| Prescribed::Uniform(v.vector());
    match flow {
        scene::Flow::Velocity(v) => FlowCondition::Velocity(uniform(v)),
        scene::Flow::SuperficialVelocity(v) => FlowCondition::SuperficialVelocity(uniform(v)),
        scene::Flow::NoSlip => FlowCondition::NoSlip,
        scene::Flow::Slip => FlowCondition::Slip,
        scene::Flow::Open { pressure } => FlowCondition::Open { pressure: *pressure },
    }
}

fn heat_condition(heat: Option<&scene::HeatBoundary>) -> ScalarCondition {
    match heat {
        None | Some(scene::HeatBoundary::Adiabatic) => ScalarCondition::Insulated,
        Some(scene::HeatBoundary::Temperature(value)) => ScalarCondition::Value(Prescribed::Uniform(*value)),
        Some(scene::HeatBoundary::Newton { coefficient, temperature }) => {
            ScalarCondition::Transfer { coefficient: *coefficient, outside: *temperature }
        }
        Some(scene::HeatBoundary::Open { temperature }) => ScalarCondition::Outflow { outside: *temperature },
    }
}

fn scalar_condition(scalar: Option<&scene::ScalarBoundary>) -> ScalarCondition {
    match scalar {
        None | Some(scene::ScalarBoundary::Insulated) => ScalarCondition::Insulated,
        Some(scene::ScalarBoundary::Value(value)) => ScalarCondition::Value(Prescribed::Uniform(*value)),
        Some(scene::ScalarBoundary::Transfer { coefficient, outside }) => {
            ScalarCondition::Transfer { coefficient: *coefficient, outside: *outside }
        }
        Some(scene::ScalarBoundary::Outflow { outside }) => ScalarCondition::Outflow { outside: *outside },
    }
}
