//! From a scene to its fluid: mesh, motion, conditions, droplet and solver.

use crate as scene;
use crate::Scene;
use voidage_coupling::backend::{FluidBackend, Model, RustFluid};
use voidage_coupling::closure::ThermalFluid;
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{self, Choices, Droplet};
use voidage_coupling::error::{Error, Result};
use voidage_coupling::motion::{Follow, MeshMover, Oscillation};
use voidage_coupling::remesh::Remesher;
use voidage_coupling::{Fluid, TEMPERATURE};
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

/// The fluid of a scene at time zero.
pub(super) fn fluid(scene: &Scene, described: &scene::Fluid, host: &Host) -> Result<Fluid<2>> {
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
pub(super) fn schedules(fluid: &scene::Fluid) -> Vec<Vec<[f64; 2]>> {
    match fluid.boundaries.iter().all(|boundary| boundary.schedule.is_empty()) {
        true => vec![],
        false => fluid.boundaries.iter().map(|boundary| boundary.schedule.clone()).collect(),
    }
}

/// The conditions of the boundaries, and behind them that of the droplet, whose body is filled in by each step.
pub(super) fn conditions(scene: &Scene, fluid: &scene::Fluid) -> Vec<Condition<2>> {
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
            per: coupling.per,
        },
        temperature: described.temperature,
        latent_heat: described.latent_heat,
        vapour_density: described.vapour_density.unwrap_or(fluid.density),
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

/// Velocity of the fluid at the start, m/s.
pub(super) fn initial_velocity(fluid: &scene::Fluid) -> Vector<2> {
    fluid.initial_velocity.as_ref().map_or_else(Vector::zeros, |v| v.vector())
}
