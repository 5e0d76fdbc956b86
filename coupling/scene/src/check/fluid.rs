//! Checks of the fluid, its mesh and its boundaries.

use super::walls::check_table;
use super::{Checked, coordinates, fail, known, not_negative, positive, tolerance, within};
use crate::{
    Backend, Boundary, Droplet, Flow, Fluid, FluidHeat, HeatBoundary, Liquid, MeshMotion, MeshSource,
    ScalarBoundary, Scene, Solver,
};
use std::f64::consts::{PI, TAU};
use voidage_coupling::TEMPERATURE;
use voidage_fluid::mesh::{Place, Rectangle, Sides};
use voidage_remote::transport::Address;

/// Most triangles of a mesh: ten times what a step of a minute takes, and what memory holds.
const MOST_CELLS: f64 = 2e7;
/// Cells of a rectangle that take so long to make that it is said before.
const MANY_CELLS: f64 = 4e5;

/// How the mesh moves; whether the mesh can follow is seen when it is there.
fn check_motion(scene: &Scene, fluid: &Fluid, motion: &MeshMotion) -> Checked {
    let names: Vec<&str> = fluid.boundaries.iter().map(|boundary| boundary.name.as_str()).collect();
    let part = "boundary of the mesh";
    if let Some(name) = &motion.boundary {
        known(scene, "fluid.mesh_motion.boundary", name, &names, part)?;
    }
    for (k, name) in motion.sliding.iter().enumerate() {
        let path = format!("fluid.mesh_motion.sliding[{k}]");
        known(scene, &path, name, &names, part)?;
        let holds = |boundary: &Boundary| boundary.name == *name && matches!(boundary.flow, Flow::NoSlip);
        if fluid.boundaries.iter().any(holds) {
            let message =
                format!("`{path}`: the nodes of {name:?} slide, and a no-slip wall would go with them");
            return fail(
                scene,
                &path,
                message,
                "give that part `flow = { velocity = [0.0, 0.0] }` or \"slip\"",
            );
        }
    }
    if let Some(remesh) = &motion.remesh {
        positive(scene, "fluid.mesh_motion.remesh.every", remesh.every as f64)?;
        within(scene, "fluid.mesh_motion.remesh.angle", remesh.angle, 0.0, 25.0)?;
    }
    let Some(table) = &motion.table else {
        if !motion.sliding.is_empty() {
            let message = "`fluid.mesh_motion.sliding` is there, but no `table`";
            return fail(scene, "fluid.mesh_motion.sliding", message, "take it away, or give a `table`");
        }
        coordinates(scene, "fluid.mesh_motion.amplitude", &motion.amplitude)?;
        return positive(scene, "fluid.mesh_motion.frequency", motion.frequency.unwrap_or(0.0));
    };
    let path = "fluid.mesh_motion.table";
    if motion.frequency.is_some() || !motion.amplitude.is_empty() {
        let message = format!("`{path}` is there beside `amplitude` or `frequency`");
        return fail(scene, path, message, "the mesh oscillates, or follows a table");
    }
    if motion.boundary.is_none() {
        let message = format!("`{path}` is there, but no `fluid.mesh_motion.boundary`");
        return fail(scene, path, message, "name the part of the boundary that moves");
    }
    check_table(scene, path, table)?;
    let begins = table.rows.first().is_some_and(|row| row[1..] == [0.0; 3] && row[0] >= 0.0);
    if !begins {
        let message = format!("`{path}` does not begin where the mesh is");
        return fail(scene, path, message, "begin with a row [t, 0.0, 0.0, 0.0], with t not below 0");
    }
    let turns = table.rows.iter().any(|row| row[3] != 0.0);
    if turns && !fluid.boundaries.iter().any(|boundary| matches!(boundary.flow, Flow::Open { .. })) {
        // Nodes go along chords, so that a step that turns displaces a little volume: 2 A (1 - cos angle).
        let message = format!("`{path}` has angles, but no boundary of the fluid is open");
        return fail(scene, path, message, "open one, or let the body go round without turning");
    }
    if turns && table.centre.is_empty() {
        let message = format!("`{path}` has angles, but no `centre`");
        return fail(scene, path, message, "give the centre of the rotation");
    }
    Ok(())
}

pub(super) fn check(scene: &Scene, fluid: &Fluid) -> Checked {
    positive(scene, "fluid.density", fluid.density)?;
    positive(scene, "fluid.viscosity", fluid.viscosity)?;
    not_negative(scene, "fluid.ramp", fluid.ramp)?;
    if let Some(velocity) = &fluid.initial_velocity {
        coordinates(scene, "fluid.initial_velocity", velocity)?;
    }
    if let Some(force) = &fluid.body_force {
        coordinates(scene, "fluid.body_force", force)?;
    }
    if let Some(motion) = &fluid.mesh_motion {
        check_motion(scene, fluid, motion)?;
    }
    if let Some(heat) = &fluid.heat {
        check_heat(scene, heat)?;
    }
    check_scalars(scene, fluid)?;
    check_thin_cell(scene, fluid)?;
    if let Some(backend) = &fluid.backend {
        check_backend(scene, backend)?;
    }
    tolerance(scene, "fluid.solver.tolerance", fluid.solver.tolerance, 1e-2)?;
    positive(scene, "fluid.solver.newton", fluid.solver.newton as f64)?;
    for (i, boundary) in fluid.boundaries.iter().enumerate() {
        check_boundary(scene, fluid, &format!("fluid.boundaries[{i}]"), boundary)?;
    }
    match &fluid.mesh {
        MeshSource::Rectangle(rectangle) => scene.check_boundary_names(&names(scene, rectangle)),
        MeshSource::File(file) if !file.is_file() => {
            let message = format!("`fluid.mesh.file`: there is no file {}", file.display());
            fail(scene, "fluid.mesh.file", message, "give a path relative to the folder of the scene")
        }
        MeshSource::File(_) => Ok(()),
    }
}

fn check_heat(scene: &Scene, heat: &FluidHeat) -> Checked {
    positive(scene, "fluid.heat.heat_capacity", heat.heat_capacity)?;
    positive(scene, "fluid.heat.conductivity", heat.conductivity)?;
    positive(scene, "fluid.heat.initial_temperature", heat.initial_temperature)?;
    let reference = heat.reference_temperature;
    reference.map_or(Ok(()), |value| positive(scene, "fluid.heat.reference_temperature", value))
}

fn check_scalars(scene: &Scene, fluid: &Fluid) -> Checked {
    for (i, scalar) in fluid.scalars.iter().enumerate() {
        let (path, name) = (format!("fluid.scalars[{i}]"), &scalar.name);
        let taken = [TEMPERATURE, "velocity", "pressure", "voidage"].contains(&name.as_str())
            || fluid.scalars[..i].iter().any(|other| other.name == *name);
        if taken {
            let message = format!("`{path}.name = {name:?}` is the name of another field");
            return fail(scene, &format!("{path}.name"), message, "give every scalar a name of its own");
        }
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
            let message = format!("`{path}.name = {name:?}` cannot stand in names of columns");
            return fail(scene, &format!("{path}.name"), message, "use letters, digits and `_`");
        }
        positive(scene, &format!("{path}.diffusivity"), scalar.diffusivity)?;
    }
    Ok(())
}

fn check_thin_cell(scene: &Scene, fluid: &Fluid) -> Checked {
    let Some(cell) = &fluid.thin_cell else { return Ok(()) };
    not_negative(scene, "fluid.thin_cell.drag", cell.drag)?;
    let Some(heat) = &cell.heat else { return Ok(()) };
    if fluid.heat.is_none() {
        let message = "`fluid.thin_cell.heat` is there, but the fluid has no temperature";
        return fail(scene, "fluid.thin_cell.heat", message, "add `[fluid.heat]`, or take it away");
    }
    not_negative(scene, "fluid.thin_cell.heat.coefficient", heat.coefficient)?;
    positive(scene, "fluid.thin_cell.heat.temperature", heat.temperature)
}

fn check_backend(scene: &Scene, backend: &Backend) -> Checked {
    if let Some(timeout) = backend.timeout {
        positive(scene, "fluid.backend.timeout", timeout)?;
    }
    let name = backend.solver.name();
    let (started, other) = match &backend.solver {
        Solver::Rust => (false, false),
        Solver::Attach(address) => {
            if let Err(message) = address.parse::<Address>() {
                return fail(scene, "fluid.backend.solver", message, "for example attach:shm:my-run");
            }
            (false, true)
        }
        _ => (true, true),
    };
    if backend.transport.is_some() && !started {
        let message =
            format!("`fluid.backend.transport` is there, but the solver {name} is not started here");
        let help = "take it away, or choose a solver in a process of its own, such as serve";
        return fail(scene, "fluid.backend.transport", message, help);
    }
    if backend.timeout.is_some() && !other {
        let message = format!("`fluid.backend.timeout` is there, but the solver {name} is in this process");
        let help = "take it away, or choose a solver in a process of its own, such as serve";
        return fail(scene, "fluid.backend.timeout", message, help);
    }
    match backend.ranks {
        Some(_) if backend.solver != Solver::Fenicsx => {
            let message = format!(
                "`fluid.backend.ranks` is there, but the solver {name} is not started on several ranks"
            );
            let help = "take it away, or choose the solver fenicsx";
            fail(scene, "fluid.backend.ranks", message, help)
        }
        Some(0) => {
            fail(scene, "fluid.backend.ranks", "`fluid.backend.ranks = 0`: out of range", "give 1 or more")
        }
        _ => Ok(()),
    }
}

fn check_boundary(scene: &Scene, fluid: &Fluid, path: &str, boundary: &Boundary) -> Checked {
    match &boundary.flow {
        Flow::Velocity(velocity) => coordinates(scene, &format!("{path}.flow.velocity"), velocity)?,
        Flow::SuperficialVelocity(velocity) => {
            coordinates(scene, &format!("{path}.flow.superficial_velocity"), velocity)?;
        }
        Flow::NoSlip | Flow::Slip | Flow::Open { .. } => {}
    }
    check_schedule(scene, &format!("{path}.schedule"), boundary)?;
    let names: Vec<&str> = fluid.scalars.iter().map(|scalar| scalar.name.as_str()).collect();
    for (name, condition) in &boundary.scalars {
        let path = format!("{path}.scalars.{name}");
        known(scene, &path, name, &names, "scalar of the fluid")?;
        if let ScalarBoundary::Transfer { coefficient, .. } = condition {
            not_negative(scene, &format!("{path}.transfer.coefficient"), *coefficient)?;
        }
    }
    let Some(heat) = &boundary.heat else { return Ok(()) };
    if fluid.heat.is_none() {
        let message = format!("`{path}.heat` is there, but the fluid has no temperature");
        return fail(scene, &format!("{path}.heat"), message, "add `[fluid.heat]`, or take it away");
    }
    match heat {
        HeatBoundary::Temperature(value) => positive(scene, &format!("{path}.heat.temperature"), *value),
        HeatBoundary::Open { temperature } => temperature
            .map_or(Ok(()), |value| positive(scene, &format!("{path}.heat.open.temperature"), value)),
        HeatBoundary::Newton { coefficient, temperature } => {
            not_negative(scene, &format!("{path}.heat.newton.coefficient"), *coefficient)?;
            positive(scene, &format!("{path}.heat.newton.temperature"), *temperature)
        }
        HeatBoundary::Adiabatic => Ok(()),
    }
}

fn check_schedule(scene: &Scene, path: &str, boundary: &Boundary) -> Checked {
    if boundary.schedule.is_empty() {
        return Ok(());
    }
    if !matches!(boundary.flow, Flow::Velocity(_) | Flow::SuperficialVelocity(_)) {
        let message = format!("`{path}` is there, but no velocity is prescribed");
        return fail(
            scene,
            path,
            message,
            "give the boundary a `velocity` or a `superficial_velocity`, or take it away",
        );
    }
    match boundary.schedule.windows(2).find(|rows| rows[1][0] <= rows[0][0]) {
        None => Ok(()),
        Some(rows) => {
            let message = format!("`{path}`: the time {} comes after {}", rows[1][0], rows[0][0]);
            fail(scene, path, message, "give rows `[time, factor]` whose times increase")
        }
    }
}

/// A rectangle can be meshed, and has not more cells than memory: nothing is made for that.
pub(super) fn check_mesh(scene: &Scene) -> Checked {
    let Some(MeshSource::Rectangle(rectangle)) = scene.fluid.as_ref().map(|fluid| &fluid.mesh) else {
        return Ok(());
    };
    let path = "fluid.mesh.rectangle";
    if let Err(error) = rectangle.validate() {
        // The message begins with the key: `sides.left[0].to = 3 must lie between ..`.
        let message = error.to_string();
        let in_key = |c: char| c.is_ascii_alphanumeric() || "_.[]".contains(c);
        let key = message.split(|c| !in_key(c)).next().unwrap_or("").trim_end_matches('.');
        let help = "`voidage schema` lists all keys of a rectangle";
        return fail(scene, &format!("{path}.{key}"), format!("`{path}`: {message}"), help);
    }
    let area = (0..2).map(|axis| rectangle.upper[axis] - rectangle.lower[axis]).product::<f64>();
    let shortest =
        (0..2).map(|axis| rectangle.upper[axis] - rectangle.lower[axis]).fold(f64::INFINITY, f64::min);
    if let Some(size) = rectangle.size.filter(|size| *size > shortest) {
        let message = format!(
            "`{path}.size = {size}` is longer than the rectangle, whose shorter side has {shortest} m"
        );
        return fail(
            scene,
            &format!("{path}.size"),
            message,
            "give the length of the edges of cells, m: some in each direction",
        );
    }
    // Half a square of this side is a triangle.
    let of = |area: f64, size: f64| 2.0 * area / size.powi(2);
    let mut parts: Vec<(String, f64)> = Vec::new();
    parts.extend(rectangle.size.map(|size| ("size".to_owned(), of(area, size))));
    parts.extend(rectangle.structured.as_ref().map(|regular| {
        (
            "structured.squares".to_owned(),
            regular.squares.iter().map(|count| *count as f64).product::<f64>() * 2.0,
        )
    }));
    for (i, hole) in rectangle.holes.iter().enumerate() {
        // A ring of one row at least.
        parts.push((format!("holes[{i}].size"), of(TAU * hole.radius * hole.size, hole.size)));
    }
    for (i, refinement) in rectangle.refine.iter().enumerate() {
        let (length, inside) = match &refinement.around {
            Place::Point(_) => (0.0, 0.0),
            Place::Segment { from, to } => ((to[0] - from[0]).hypot(to[1] - from[1]), 0.0),
            Place::Box { lower, upper } => {
                let [width, height] = [0, 1].map(|axis| upper[axis] - lower[axis]);
                (width + height, width * height)
            }
        };
        let reach = refinement.within.max(refinement.size);
        let zone = inside + 2.0 * length * reach + PI * reach.powi(2);
        parts.push((format!("refine[{i}].size"), of(zone.min(area), refinement.size)));
    }
    match parts.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, cells)| *cells > MANY_CELLS) {
        None => Ok(()),
        Some((key, cells)) if cells <= MOST_CELLS => {
            tracing::warn!(
                "`{path}.{key}` makes about {cells:.0e} triangles, which takes minutes; lengths are in metres"
            );
            Ok(())
        }
        Some((key, cells)) => {
            let message = format!("`{path}.{key}` makes about {cells:.0e} triangles");
            let help = match key.ends_with("squares") {
                true => "give fewer squares",
                false => "give a larger size; lengths are in metres",
            };
            fail(scene, &format!("{path}.{key}"), message, help)
        }
    }
}

/// The names of all parts of the boundary, in order, each once; those of periodic sides are none.
fn names<'a>(scene: &Scene, rectangle: &'a Rectangle) -> Vec<&'a str> {
    let Sides { left, right, bottom, top } = &rectangle.sides;
    let [across, up] = scene.period().sides().map(|sides| sides.is_some());
    let sides = [(left, across), (right, across), (bottom, up), (top, up)];
    let sides = sides.into_iter().filter(|(_, joined)| !joined);
    let sides = sides.flat_map(|(side, _)| side.0.iter().map(|part| &part.name));
    let mut names: Vec<&str> = Vec::new();
    for name in sides.chain(rectangle.holes.iter().map(|hole| &hole.name)) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    names
}

/// Checks of a droplet.
pub(super) fn droplet(scene: &Scene, droplet: &Droplet) -> Checked {
    let Some(fluid) = &scene.fluid else {
        let message = "`[droplet]` is there, but no fluid";
        return fail(scene, "droplet", message, "add `[fluid]`, or take it away");
    };
    let Liquid { density, viscosity, heat_capacity, conductivity } = droplet.liquid;
    for (key, value) in [
        ("temperature", droplet.temperature),
        ("latent_heat", droplet.latent_heat),
        ("liquid.density", density),
        ("liquid.viscosity", viscosity),
        ("liquid.heat_capacity", heat_capacity),
        ("liquid.conductivity", conductivity),
        ("remesh.every", droplet.remesh.every as f64),
    ] {
        positive(scene, &format!("droplet.{key}"), value)?;
    }
    droplet.vapour_density.map_or(Ok(()), |value| positive(scene, "droplet.vapour_density", value))?;
    within(scene, "droplet.remesh.angle", droplet.remesh.angle, 0.0, 25.0)?;
    if let Some(velocity) = &droplet.velocity {
        coordinates(scene, "droplet.velocity", velocity)?;
    }
    let scalars: Vec<&str> = fluid.scalars.iter().map(|scalar| scalar.name.as_str()).collect();
    for name in droplet.scalars.keys() {
        known(scene, &format!("droplet.scalars.{name}"), name, &scalars, "scalar of the fluid")?;
    }
    choices(scene, droplet)?;
    let name = &droplet.boundary;
    if fluid.boundaries.iter().any(|boundary| boundary.name == *name) {
        let message = format!("`droplet.boundary = \"{name}\"` has a table in `[[fluid.boundaries]]`");
        return fail(scene, "droplet.boundary", message, "take that away: the droplet makes its conditions");
    }
    if let MeshSource::Rectangle(rectangle) = &fluid.mesh {
        let holes: Vec<&str> = rectangle.holes.iter().map(|hole| hole.name.as_str()).collect();
        known(scene, "droplet.boundary", name, &holes, "hole of the mesh")?;
    }
    if fluid.mesh_motion.is_some() {
        let message = "`fluid.mesh_motion` is there, but the mesh follows the droplet";
        return fail(scene, "fluid.mesh_motion", message, "take one of them away");
    }
    if fluid.boundaries.iter().all(|boundary| !matches!(boundary.flow, Flow::Open { .. })) {
        let message = "the vapour of the droplet has no way out";
        return fail(scene, "fluid", message, "give a boundary `flow = \"open\"`");
    }
    Ok(())
}

/// Checks of what a droplet leaves to choose: a choice that nothing depends on is a mistake.
fn choices(scene: &Scene, droplet: &Droplet) -> Checked {
    if droplet.heat_flux != Default::default()
        && scene.fluid.as_ref().is_none_or(|fluid| fluid.heat.is_none())
    {
        let message = "`droplet.heat_flux` is there, but the gas has no temperature";
        return fail(scene, "droplet.heat_flux", message, "add `[fluid.heat]`, or take it away");
    }
    if scene.grains_have_heat() && !scene.fluid_has_heat() {
        let message = "grains have a temperature, but the gas around the droplet has none";
        let help = "add `[fluid.heat]`, or take the temperatures of the grains away";
        return fail(scene, "droplet", message, help);
    }
    let of_grains = [
        ("blowing", droplet.blowing != Default::default()),
        ("grain_share", droplet.grain_share != Default::default()),
        ("buoyancy", droplet.buoyancy != Default::default()),
        ("inside", droplet.inside != Default::default()),
    ];
    match of_grains.into_iter().find(|(_, given)| *given && scene.grains.is_empty()) {
        None => Ok(()),
        Some((key, _)) => {
            let message = format!("`droplet.{key}` is there, but no grains: it changes nothing");
            fail(scene, &format!("droplet.{key}"), message, "add `[[grains]]`, or take it away")
        }
    }
}

impl Scene {
    /// Checks the conditions of `fluid.boundaries` against the names of the mesh: each condition names a boundary of
    /// the mesh, and each boundary of the mesh has a condition. To be called again once a mesh has been read from a
    /// file.
    pub fn check_boundary_names(&self, names: &[&str]) -> Checked {
        let boundaries = self.fluid.as_ref().map_or(&[][..], |fluid| &fluid.boundaries);
        for (i, boundary) in boundaries.iter().enumerate() {
            let path = format!("fluid.boundaries[{i}].name");
            known(self, &path, &boundary.name, names, "boundary of the mesh")?;
            if boundaries[..i].iter().any(|earlier| earlier.name == boundary.name) {
                let message = format!("`{path} = \"{}\"` has conditions already", boundary.name);
                return fail(self, &path, message, "give each boundary one table `[[fluid.boundaries]]`");
            }
        }
        let droplet = self.droplet.as_ref().map_or("", |droplet| droplet.boundary.as_str());
        let bare = |name: &&&str| **name != droplet && boundaries.iter().all(|b| b.name != **name);
        match names.iter().find(bare) {
            None => Ok(()),
            Some(name) => {
                let help = format!("add `[[fluid.boundaries]]` with `name = \"{name}\"` and a `flow`");
                fail(self, "fluid", format!("the boundary \"{name}\" of the mesh has no conditions"), help)
            }
        }
    }
}
