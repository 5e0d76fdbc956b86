//! From the tables of the fluid to its solver.

use crate::Result;
use crate::backend::{FluidBackend, RustFluid};
use crate::scene::{self, Flow, HeatBoundary, LinearMethod, MeshSource, Scene};
use std::sync::Arc;
use voidage_fluid::conditions::{Condition, FlowCondition, HeatCondition, Prescribed};
use voidage_fluid::flow::{HeatProperties, Numerics, State};
use voidage_fluid::forms::Properties;
use voidage_fluid::transport::{Scalar, ThinCellHeat};
use voidage_fluid::{Mesh, linear};

/// The fluid of a scene, none if it has none.
pub fn build(scene: &Scene) -> Result<Option<crate::Fluid<2>>> {
    let Some(fluid) = &scene.fluid else { return Ok(None) };
    let mesh = Arc::new(mesh(scene, fluid)?);
    let conditions: Vec<_> = fluid.boundaries.iter().map(condition).collect();
    let properties = Properties {
        density: fluid.density,
        viscosity: fluid.viscosity,
        gravity: scene.gravity.vector(),
        thin_cell_drag: fluid.thin_cell.as_ref().map_or(0.0, |cell| cell.drag),
        drag_in_stabilisation: fluid.solver.drag_in_stabilisation,
    };
    let heat = fluid.heat.as_ref().map(|heat| heat_properties(fluid, heat));
    let mut backend = RustFluid::<2, 3>::new(properties, heat, numerics(&fluid.solver), conditions.clone());
    let nodes = mesh.points.len();
    let start = State {
        velocity: vec![fluid.initial_velocity.clone().unwrap_or_default().vector::<2>(); nodes],
        pressure: vec![0.0; nodes],
        temperature: fluid.heat.as_ref().map(|heat| vec![heat.initial_temperature; nodes]),
    };
    backend.start(&mesh, &start)?;
    let nodal_volume = mesh.nodal_volume();
    Ok(Some(crate::Fluid { backend: Box::new(backend), mesh, conditions, ramp: fluid.ramp, nodal_volume }))
}

fn mesh(scene: &Scene, fluid: &scene::Fluid) -> Result<Mesh<2>> {
    let (made, key) = match &fluid.mesh {
        MeshSource::Rectangle(rectangle) => (Mesh::rectangle(rectangle), "fluid.mesh.rectangle"),
        MeshSource::File(file) => (Mesh::read_msh(file), "fluid.mesh.file"),
    };
    let mesh = made.map_err(|error| {
        scene.error(key, format!("`{key}`: {error}"), "give a mesh of triangles with named boundaries")
    })?;
    let names: Vec<&str> = mesh.boundaries.iter().map(|boundary| boundary.name.as_str()).collect();
    scene.check_boundary_names(&names)?;
    Ok(mesh)
}

fn condition(boundary: &scene::Boundary) -> Condition<2> {
    let uniform = |velocity: &scene::Coordinates| Prescribed::Uniform(velocity.vector());
    Condition {
        boundary: boundary.name.clone(),
        flow: match &boundary.flow {
            Flow::Velocity(velocity) => FlowCondition::Velocity(uniform(velocity)),
            Flow::SuperficialVelocity(velocity) => FlowCondition::SuperficialVelocity(uniform(velocity)),
            Flow::NoSlip => FlowCondition::NoSlip,
            Flow::Slip => FlowCondition::Slip,
            Flow::Open { pressure } => FlowCondition::Open { pressure: *pressure },
        },
        heat: match boundary.heat.as_ref().unwrap_or(&HeatBoundary::Adiabatic) {
            HeatBoundary::Temperature(temperature) => HeatCondition::Temperature(*temperature),
            HeatBoundary::Newton { coefficient, temperature } => {
                HeatCondition::Newton { coefficient: *coefficient, temperature: *temperature }
            }
            HeatBoundary::Adiabatic => HeatCondition::Adiabatic,
            HeatBoundary::Open { temperature } => HeatCondition::Open { temperature: *temperature },
        },
    }
}

fn heat_properties(fluid: &scene::Fluid, heat: &scene::FluidHeat) -> HeatProperties {
    let thin_cell = fluid.thin_cell.as_ref().and_then(|cell| cell.heat.as_ref());
    HeatProperties {
        scalar: Scalar {
            capacity: fluid.density * heat.heat_capacity,
            conductivity: heat.conductivity,
            thin_cell: thin_cell
                .map(|cell| ThinCellHeat { coefficient: cell.coefficient, temperature: cell.temperature }),
        },
        expansion: heat.expansion,
        reference: heat.reference_temperature.unwrap_or(heat.initial_temperature),
    }
}

fn numerics(solver: &scene::FluidSolver) -> Numerics {
    let method = match solver.linear {
        LinearMethod::Auto | LinearMethod::Kept => linear::Method::Multifrontal,
        LinearMethod::Direct => linear::Method::MultifrontalFresh,
        LinearMethod::Ilu => linear::Method::Ilu,
    };
    let flow = linear::Options { method, tolerance: solver.tolerance, ..linear::Options::default() };
    Numerics { newton: solver.newton, flow, ..Numerics::default() }
}
