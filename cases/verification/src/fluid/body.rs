//! Bodies that move in a fluid: their drag, the fluid that they take along, and how they fall.

use crate::models::{FluidSet, Vec2, annulus, held_points};
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::{Effort, largest};
use voidage_coupling::closure::{Drag, HeatTransfer, Per, ThermalFluid, VoidageFunction};
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{Choices, Droplet, Material};
use voidage_coupling::remesh::{Remesh, Remesher};
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Coupled, Result, System, TEMPERATURE};
use voidage_fluid::body::{Blowing, Body, BodyMotion, Evaporation, HeatFlux};
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::State;
use voidage_fluid::mesh::{Hole, Rectangle, Side, Sides};
use voidage_fluid::transport::Scalar;
use voidage_fluid::{Mesh, MeshMotion};

/// The case.
pub const CASE: Case = Case {
    name: "body",
    group: "fluid",
    title: "drag, added mass, fall and vapour of a disc that is solved with the fluid",
    source: "exact: Stokes between concentric circles, F = 4 pi eta U/(ln(R/a) - (R^2 - a^2)/(R^2 + a^2)); potential \
             flow there, \
             added mass rho pi a^2 (R^2 + a^2)/(R^2 - a^2); between walls Faxen's series (1946), and for half the gap \
             a converged \
             solution, 99.36",
    run,
};

/// Temperature of droplets and of the fluid around, K.
const WARM: f64 = 373.15;

/// A body of radius 1 at the origin.
pub fn disc_of(motion: BodyMotion<2>) -> Body<2> {
    let (centre, radius, expansion) = (Vec2::zeros(), 1.0, 0.0);
    let (evaporation, blowing) = (None, Blowing::default());
    Body { centre, radius, expansion, motion, evaporation, blowing, solid: vec![] }
}

fn body(motion: BodyMotion<2>) -> FlowCondition<2> {
    FlowCondition::Body(disc_of(motion))
}

/// A condition of the flow alone.
pub fn condition(boundary: &str, flow: FlowCondition<2>) -> Condition<2> {
    Condition { boundary: boundary.into(), flow, scalars: vec![] }
}

/// Force (N) on a body and its velocity (m/s) after one step from rest, its part of the boundary being the first
/// condition.
fn step(mesh: Mesh<2>, set: &FluidSet, dt: f64) -> Result<(Vec2, Vec2)> {
    let clear = vec![1.0; mesh.points.len()];
    let start = set.rest(&mesh, 0.0);
    let mut flow = set.equations(mesh, start)?;
    flow.solve(dt, &clear, None, &set.conditions)?;
    let mut balances = vec![];
    flow.balances(&clear, &set.conditions, &mut balances);
    let velocity = flow.bodies().map(|body| body.velocity).sum();
    Ok((balances[0].force, velocity))
}

/// Drag over viscosity and velocity in a ring four times as wide, creeping flow.
fn ring_drag(rings: usize) -> Result<f64> {
    let mut set = FluidSet::new(1e-3, 1.0);
    let moves = BodyMotion::Held(Vec2::new(1.0, 0.0));
    set.conditions = vec![condition("inner", body(moves)), condition("outer", FlowCondition::NoSlip)];
    Ok(-step(annulus(1.0, 4.0, rings, 4 * rings), &set, 1e6)?.0.x)
}

/// Acceleration over g of a free disc that weighs so many times the fluid in its place, from rest, without gravity on
/// the fluid.
fn start(rings: usize, weight: f64) -> Result<f64> {
    let dt = 1e-3;
    let mut set = FluidSet::new(1.0, 1e-6);
    let mass = weight * PI;
    let free = BodyMotion::free(mass / dt, Vec2::new(0.0, -mass));
    set.conditions = vec![condition("inner", body(free)), condition("outer", FlowCondition::Slip)];
    Ok(-step(annulus(1.0, 4.0, rings, 4 * rings), &set, dt)?.1.y / dt)
}

/// A channel between walls at y = -half and half with a disc of radius 1 in its middle, closed far from it.
fn channel(half: f64, length: f64, edge: f64) -> Result<Mesh<2>> {
    Ok(Mesh::rectangle(&channel_of(half, length, edge))?)
}

fn channel_of(half: f64, length: f64, edge: f64) -> Rectangle {
    let hole = Hole { name: "disc".into(), centre: [0.0; 2], radius: 1.0, size: edge, growth: 0.15 };
    Rectangle {
        lower: [-length, -half],
        upper: [length, half],
        // The gap beside the disc needs some cells too.
        size: Some((half / 6.0).min((half - 1.0) * edge)),
        sides: Sides {
            left: Side::named("walls"),
            right: Side::named("walls"),
            bottom: Side::named("walls"),
            top: Side::named("walls"),
        },
        holes: vec![hole],
        refine: vec![],
        structured: None,
    }
}

/// Conditions of the channel.
fn in_channel(disc: FlowCondition<2>) -> Vec<Condition<2>> {
    vec![condition("disc", disc), condition("walls", FlowCondition::NoSlip)]
}

/// Drag over viscosity and velocity midway between walls `half` away.
fn channel_drag(half: f64, edge: f64) -> Result<f64> {
    let mut set = FluidSet::new(1e-3, 1.0);
    set.conditions = in_channel(body(BodyMotion::Held(Vec2::new(1.0, 0.0))));
    Ok(-step(channel(half, 5.0 * half, edge)?, &set, 1e6)?.0.x)
}

/// A fluid in the channel with a droplet at `x` that nothing heats, remeshed after every step.
fn with_droplet(
    set: &FluidSet,
    mesh: Mesh<2>,
    start: [Vec2; 2],
    density: f64,
    held: bool,
) -> Result<Coupled<2>> {
    let [place, velocity] = start;
    let mut mesh = mesh;
    mesh.points.iter_mut().for_each(|x| *x += place);
    let material = Material {
        water: Water {
            density,
            viscosity: 1.0,
            thermal: ThermalFluid { conductivity: 1.0, prandtl: 1.0 },
            drag: Drag::default(),
            heat: HeatTransfer::default(),
            voidage_function: VoidageFunction::None,
            per: Per::Solid,
        },
        temperature: WARM,
        latent_heat: 1.0,
        vapour_density: set.properties.density,
        gravity: set.properties.gravity,
        held,
        choices: Choices::default(),
    };
    let droplet = Droplet::new(&mut mesh, "disc", (place, 1.0), (velocity, 0.15), material)?;
    let start = State { velocity: vec![velocity; mesh.points.len()], ..set.rest(&mesh, WARM) };
    let mut fluid = set.build(mesh, start)?;
    fluid.droplet = Some(Box::new(droplet));
    let when = Remesh { every: 1, ..Remesh::default() };
    fluid.remesher = Some(Remesher::around_droplet(&fluid.mesh, None, when));
    let scheme = SchemeName::default().build(&Options::default())?;
    Ok(Coupled::new(System::Fluid(Box::new(fluid)), scheme))
}

/// Velocity of a heavy disc that falls along the channel, from rest, after steps that each take it a quarter of its
/// radius, over that at which weight and drag are equal.
fn fall(edge: f64, steps: usize) -> Result<f64> {
    // So slowly that the disc reaches its velocity within a step.
    let (half, density, gravity) = (4.0, 1000.0, 1e-6);
    let terminal = (density - 1e-3) * PI * gravity / faxen(1.0 / half);
    let mut set = FluidSet::new(1e-3, 1.0);
    set.properties.gravity = Vec2::new(gravity, 0.0);
    set.conditions = in_channel(body(BodyMotion::Held(Vec2::zeros())));
    let start = [Vec2::new(-0.2 * half, 0.0), Vec2::zeros()];
    let mut system = with_droplet(&set, channel(half, 5.0 * half, edge)?, start, density, false)?;
    let dt = 0.25 / terminal;
    for _ in 0..steps {
        system.step(dt)?;
    }
    let droplet = system.fluid_mut().and_then(|fluid| fluid.live_droplet());
    Ok(droplet.map_or(0.0, |droplet| droplet.state.velocity.x) / terminal)
}

/// How far a stream of velocity 1 along the channel is from uniform in velocity, after a droplet as warm as it has
/// ridden along with it for some steps and remeshings; and what of it the droplet felt.
fn ride(edge: f64) -> Result<(f64, f64)> {
    let stream = Vec2::new(1.0, 0.0);
    let mut set = FluidSet::new(1.3, 0.01);
    set.scalars = vec![Scalar::new(TEMPERATURE, 1.5, 0.02)];
    set.conditions = vec![
        Condition {
            boundary: "disc".into(),
            flow: body(BodyMotion::Held(stream)),
            scalars: vec![ScalarCondition::Value(Prescribed::Uniform(WARM))],
        },
        condition("walls", FlowCondition::Velocity(Prescribed::Uniform(stream))),
        condition("end", FlowCondition::Open { pressure: 0.0 }),
    ];
    let mut rectangle = channel_of(3.0, 9.0, edge);
    rectangle.sides.right = Side::named("end");
    let start = [Vec2::new(-2.0, 0.0), stream];
    let mut system = with_droplet(&set, Mesh::rectangle(&rectangle)?, start, 1.0, true)?;
    for _ in 0..6 {
        system.step(0.2)?;
    }
    let Some(fluid) = system.fluid_mut() else { return Ok((f64::NAN, f64::NAN)) };
    let off = largest(fluid.accepted.velocity.iter().map(|u| (u - stream).norm()));
    let felt = fluid.live_droplet().map_or(f64::NAN, |d| d.state.force.norm() + d.state.heat.abs());
    Ok((off, felt))
}

/// A step of a boiling disc that is free to move, as it is for somebody at rest.
struct Seen {
    pressure: Vec<f64>,
    fluid: Vec<Vec2>,
    disc: Vec2,
    force: Vec2,
    vapour: f64,
}

/// What somebody sees of it who moves with a velocity.
fn seen(shift: Vec2) -> Result<Seen> {
    let mut rectangle = channel_of(3.0, 4.0, 0.2);
    rectangle.sides.right = Side::named("end");
    let mesh = Mesh::rectangle(&rectangle)?;
    let mut set = FluidSet::new(1.3, 0.05);
    set.properties.gravity = Vec2::new(0.0, -0.3);
    set.scalars = vec![Scalar { expansion: 1e-3, reference: WARM, ..Scalar::new(TEMPERATURE, 1.5, 0.2) }];
    let (dt, mass, own) = (0.05, 20.0, Vec2::new(0.3, -0.2));
    let motion = BodyMotion::free(mass / dt, (own + shift) * (mass / dt) + Vec2::new(0.0, -0.3 * mass));
    let heat_flux = HeatFlux::default();
    let evaporation = Evaporation { scalar: Some(0), heat_flux, heat: 1.0, latent: 50.0 };
    let disc = Body { expansion: -0.02, evaporation: Some(evaporation), ..disc_of(motion) };
    let warm = |value| vec![ScalarCondition::Value(Prescribed::Uniform(value))];
    set.conditions = vec![
        Condition { boundary: "disc".into(), flow: FlowCondition::Body(disc), scalars: warm(WARM) },
        Condition {
            boundary: "walls".into(),
            flow: FlowCondition::Velocity(Prescribed::Uniform(shift)),
            scalars: warm(WARM + 80.0),
        },
        Condition { boundary: "end".into(), flow: FlowCondition::Open { pressure: 0.0 }, scalars: vec![] },
    ];
    // Something that moves everywhere, and out at the end.
    let streams = |x: &Vec2| Vec2::new(0.4 + 0.1 * (x.y).cos(), 0.1 * (x.x + x.y).sin());
    let follows = |x: &Vec2| own * (-x.norm_squared()).exp() + shift;
    let mut start = set.rest(&mesh, WARM);
    start.velocity = mesh.points.iter().map(|x| streams(x) + shift).collect();
    start.scalars[0] = mesh.points.iter().map(|x| WARM + 20.0 * (x.norm() - 1.0)).collect();
    let (points, clear) = (mesh.points.clone(), vec![1.0; mesh.points.len()]);
    let velocity: Vec<Vec2> = points.iter().map(follows).collect();
    let mut flow = set.equations(mesh, start)?;
    flow.follow(Some(&MeshMotion { points: &points, velocity: &velocity }))?;
    flow.solve(dt, &clear, None, &set.conditions)?;
    let mut balances = vec![];
    flow.balances(&clear, &set.conditions, &mut balances);
    let solution = flow.solution();
    let body = flow.bodies().next();
    Ok(Seen {
        pressure: solution.pressure.clone(),
        fluid: solution.velocity.iter().map(|u| u - shift).collect(),
        disc: body.map_or_else(Vec2::zeros, |body| body.velocity - shift),
        force: balances[0].force,
        vapour: body.map_or(f64::NAN, |body| body.vapour),
    })
}

/// Largest change of pressure, velocities, force and vapour of a boiling disc by a velocity of all that moves, as a
/// share of the largest of each.
fn shifted() -> Result<f64> {
    let (still, moves) = (seen(Vec2::zeros())?, seen(Vec2::new(1.7, -2.9))?);
    let of = |a: &[f64], b: &[f64]| largest(a.iter().zip(b).map(|(a, b)| a - b)) / largest(a.iter().copied());
    let flat = |all: &[Vec2]| all.iter().flat_map(|v| [v.x, v.y]).collect::<Vec<f64>>();
    let changes = [
        of(&still.pressure, &moves.pressure),
        of(&flat(&still.fluid), &flat(&moves.fluid)),
        of(&flat(&[still.disc]), &flat(&[moves.disc])),
        of(&flat(&[still.force]), &flat(&[moves.force])),
        of(&[still.vapour], &[moves.vapour]),
    ];
    Ok(largest(changes))
}

/// How far a free disc and its fluid are from the same disc held at the velocity that was found, as a share of the
/// largest of pressures and velocities; and what its equation of motion then lacks, as a share of its weight. Together
/// these are the rows of the system in which fluid and disc are tied.
fn tied() -> Result<(f64, f64)> {
    let mesh = || channel(3.0, 4.0, 0.2);
    let (dt, mass, gravity) = (0.05, 20.0, Vec2::new(0.1, -0.3));
    let mut set = FluidSet::new(1.3, 0.05);
    let mut solve = |motion| {
        set.conditions = in_channel(body(motion));
        let mesh = mesh()?;
        let mut start = set.rest(&mesh, 0.0);
        start.velocity =
            mesh.points.iter().map(|x| Vec2::new(0.1 * x.y.cos(), 0.1 * (x.x + x.y).sin())).collect();
        let clear = vec![1.0; mesh.points.len()];
        let mut flow = set.equations(mesh, start)?;
        flow.solve(dt, &clear, None, &set.conditions)?;
        let mut balances = vec![];
        flow.balances(&clear, &set.conditions, &mut balances);
        let velocity: Vec2 = flow.bodies().map(|body| body.velocity).sum();
        let State { velocity: u, pressure, .. } = flow.solution().clone();
        Ok::<_, voidage_coupling::Error>((velocity, balances[0].force, u, pressure))
    };
    let (found, _, u, p) = solve(BodyMotion::free(mass / dt, gravity * mass))?;
    let (_, force, held_u, held_p) = solve(BodyMotion::Held(found))?;
    let (fast, high) = (largest(u.iter().map(|u| u.norm())), largest(p.iter().copied()));
    let off_u = largest(u.iter().zip(&held_u).map(|(a, b)| (a - b).norm()));
    let off_p = largest(p.iter().zip(&held_p).map(|(a, b)| a - b));
    let lacks = found * (mass / dt) - gravity * mass - force;
    Ok((largest([off_u / fast, off_p / high]), lacks.norm() / (gravity.norm() * mass)))
}

/// What leaves an open end over what a disc in the channel grows by, which its polygon says, 1/s for 1/s.
fn grows(expansion: f64) -> Result<f64> {
    let mut rectangle = channel_of(3.0, 4.0, 0.2);
    rectangle.sides.right = Side::named("end");
    let mesh = Mesh::rectangle(&rectangle)?;
    let mut set = FluidSet::new(1.3, 0.05);
    let disc = Body { expansion, ..disc_of(BodyMotion::Held(Vec2::zeros())) };
    set.conditions = vec![
        condition("disc", FlowCondition::Body(disc)),
        condition("walls", FlowCondition::NoSlip),
        condition("end", FlowCondition::Open { pressure: 0.0 }),
    ];
    // The area of the polygon grows by twice itself over the radius of its corners.
    let part = mesh.boundary("disc")?;
    let corner = |node: u32| mesh.points[node as usize];
    let area =
        part.facets.chunks_exact(2).map(|ends| corner(ends[0]).perp(&corner(ends[1])) / 2.0).sum::<f64>();
    let growth = 2.0 * area.abs() * expansion / corner(part.facets[0]).norm();
    let points = mesh.points.clone();
    let mut velocity = vec![Vec2::zeros(); points.len()];
    for node in part.facets.iter().map(|node| *node as usize) {
        velocity[node] = points[node].normalize() * expansion;
    }
    let (start, clear) = (set.rest(&mesh, 0.0), vec![1.0; points.len()]);
    let mut flow = set.equations(mesh, start)?;
    flow.follow(Some(&MeshMotion { points: &points, velocity: &velocity }))?;
    flow.solve(0.05, &clear, None, &set.conditions)?;
    let mut balances = vec![];
    flow.balances(&clear, &set.conditions, &mut balances);
    Ok(balances[2].flux / growth)
}

/// Pressure at a disc that blows evenly into a bed of held points four times as wide, over kappa j r ln(R/r), kappa the
/// drag per volume over the square of the voidage.
fn bed_pressure(rings: usize) -> Result<f64> {
    let (mesh, voidage, drag, blowing) = (annulus(1.0, 4.0, rings, 4 * rings), 0.6, 50.0, 1e-3);
    let perimeter: f64 = mesh.boundary("inner")?.measure(&mesh);
    let points = held_points(&mesh, voidage, drag);
    let mut set = FluidSet::new(1e-6, 1e-6);
    let heat_flux = HeatFlux::default();
    let evaporation = Evaporation { scalar: None, heat_flux, heat: blowing * perimeter, latent: 1.0 };
    let disc = Body { evaporation: Some(evaporation), ..disc_of(BodyMotion::Held(Vec2::zeros())) };
    set.conditions = vec![
        condition("inner", FlowCondition::Body(disc)),
        condition("outer", FlowCondition::Open { pressure: 0.0 }),
    ];
    let start = set.rest(&mesh, 0.0);
    let nodes = mesh.points.len();
    let mut flow = set.equations(mesh, start)?;
    flow.solve(1e3, &vec![voidage; nodes], Some(&points), &set.conditions)?;
    let pressure = &flow.solution().pressure[..4 * rings];
    let mean = pressure.iter().sum::<f64>() / pressure.len() as f64;
    Ok(mean / (drag / (voidage * voidage) * blowing * 4.0_f64.ln()))
}

/// Drag over viscosity and velocity midway between walls, radius over half the gap k: to 1e-4 up to k = 1/4.
fn faxen(k: f64) -> f64 {
    let series = 1.7244 * k.powi(2) - 1.7302 * k.powi(4) + 2.4056 * k.powi(6) - 4.5913 * k.powi(8);
    4.0 * PI / ((1.0 / k).ln() - 0.9157 + series)
}

fn run(effort: Effort) -> Result<Outcome> {
    let mut outcome = Outcome::default();
    let sizes: &[usize] = effort.pick(&[8, 16], &[8, 16, 32]);
    let finest = sizes[sizes.len() - 1];
    let (inner, outer): (f64, f64) = (1.0, 16.0);
    let ring = 4.0 * PI / (4.0_f64.ln() - (outer - inner) / (outer + inner));
    let drags = sizes.iter().map(|rings| ring_drag(*rings)).collect::<Result<Vec<_>>>()?;
    let misses: Vec<f64> = drags.iter().map(|drag| (drag - ring).abs()).collect();
    let order = (misses[misses.len() - 2] / misses[misses.len() - 1]).log2();
    let what = format!("drag in a ring four times as wide, {finest} rings");
    let drag = drags[drags.len() - 1];
    let allowed = effort.pick(1.2e-2, 3e-3);
    outcome.findings.push(Finding::relative(what, "eta U", ring, drag, allowed).with_order(order));
    outcome.findings.push(Finding::order("order of this drag", 1.9, &misses, 2.0));

    for (k, exact) in [(0.1, faxen(0.1)), (0.25, faxen(0.25)), (0.5, 99.36)] {
        let drag = channel_drag(1.0 / k, effort.pick(0.1, 0.05))?;
        let what = format!("drag between walls, radius {k} of half the gap");
        outcome.findings.push(Finding::relative(what, "eta U", exact, drag, effort.pick(2e-2, 1e-2)));
    }

    for weight in [1000.0, 1.5, 0.5, 0.01] {
        let exact = weight / (weight + 17.0 / 15.0);
        let what = format!("acceleration of a disc {weight} times as heavy as the fluid");
        // The fluid sticks to the disc over the width of a cell, which is more to take along: an error of first order.
        let allowed = effort.pick(7e-2, 3.5e-2);
        outcome.findings.push(Finding::relative(what, "g", exact, start(finest, weight)?, allowed));
    }

    let speed = fall(effort.pick(0.1, 0.05), effort.pick(6, 12))?;
    outcome.findings.push(Finding::relative(
        "fall between walls, remeshed in each step",
        "U",
        1.0,
        speed,
        2e-2,
    ));

    let (off, felt) = ride(0.15)?;
    let what = "unevenness of a stream that a droplet rides along with";
    outcome.findings.push(Finding::at_most(what, "U", 1e-11, off));
    outcome.findings.push(Finding::at_most(
        "force and heat that the droplet feels there",
        "N/m, W/m",
        1e-11,
        felt,
    ));

    let what = "change of a boiling disc and the fluid around it by a velocity of all that moves";
    outcome.findings.push(Finding::at_most(what, "1", 1e-10, shifted()?));

    let (off, lacks) = tied()?;
    let what = "a free disc and its fluid beside those of a disc held at its velocity";
    outcome.findings.push(Finding::at_most(what, "1", 1e-12, off));
    outcome.findings.push(Finding::at_most(
        "what the motion of the free disc lacks",
        "its weight",
        1e-12,
        lacks,
    ));

    for expansion in [0.02, -0.02] {
        let what = format!("outflow by a disc that grows by {expansion} in radius");
        outcome.findings.push(Finding::relative(what, "its area", 1.0, grows(expansion)?, 1e-12));
    }

    let pressure = bed_pressure(finest)?;
    let what = "pressure at a disc that blows into a bed four times as wide";
    outcome.findings.push(Finding::relative(
        what,
        "kappa j r ln 4",
        1.0,
        pressure,
        effort.pick(1.5e-2, 5e-3),
    ));
    Ok(outcome)
}
