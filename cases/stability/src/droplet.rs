//! A droplet alone in its gas: as light as one likes, moving across many cells a step, boiling in a gas as hot as one
//! likes.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use std::f64::consts::PI;
use voidage_campaign::{Effort, largest, worse};
use voidage_coupling::closure::{Drag, HeatTransfer, Per, ThermalFluid, VoidageFunction};
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{Choices, Droplet, Material};
use voidage_coupling::remesh::{Remesh, Remesher};
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Coupled, HEAT, Result, System, TEMPERATURE};
use voidage_fluid::Mesh;
use voidage_fluid::body::{Blowing, Body, BodyMotion};
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::State;
use voidage_fluid::mesh::{Hole, Rectangle, Side, Sides};
use voidage_fluid::transport::{Form, Scalar};
use voidage_verification::models::{FluidSet, Vec2, annulus};

/// Edge of the mesh at a droplet of radius 1.
const EDGE: f64 = 0.2;
/// Of the gas, W/m/K and J/m3/K, of the droplet, K, and radius of the ring around one of radius 1.
const CONDUCTIVITY: f64 = 0.02;
const CAPACITY: f64 = 1.5;
const BOILING: f64 = 373.15;
const RING: f64 = 4.0;
/// Share by which a rate of vaporisation, and a velocity that should stay, may be off.
const RATE: f64 = 2e-2;
const UNIFORM: f64 = 1e-8;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "droplet-density",
        title: "Largest growth of the velocity of a droplet in a step: it moves in gas at rest, in a box",
        source: "the gas takes energy from it: below 1",
        labels: ["density of the droplet / of the gas", "step / time of diffusion over its radius"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => product(&[1e-2, 1e3], &[1e-2, 1e2]),
            Effort::Full => {
                product(&[1e-2, 0.1, 1.0, 10.0, 1e3, 1e6], &[1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3])
            }
        },
        run: |[density, step], _, _| slows(density, step),
        theory: |_, _| None,
    },
    Axis {
        name: "droplet-travel",
        title: "Unevenness of a stream that a droplet rides along with, over its velocity",
        source: "the stream stays uniform",
        labels: ["way of the droplet per step / edge at its surface", "steps between two meshes"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1, 5.0], &[5.0]),
            Effort::Full => product(&[0.01, 0.1, 0.3, 1.0, 3.0, 5.0], &[1.0, 5.0, 25.0]),
        },
        run: |[travel, remesh], _, effort| ride(travel, remesh, effort.pick(12, 40)),
        theory: |_, _| None,
    },
    Axis {
        name: "droplet-gap",
        title: "Least gap between a wall and a droplet that is thrown at it, over that at the start",
        source: "it comes no nearer than 2 % of its radius, or than it was",
        labels: ["gap / edge at its surface", "way per step / gap"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => vec![[0.5, 1.0], [5.0, 0.2]],
            Effort::Full => {
                let mut points = product(&[0.1, 0.3, 1.0, 3.0, 10.0], &[0.03, 0.1, 0.3, 1.0, 3.0]);
                // Ways of one edge in a step at most.
                points.retain(|[gap, way]| gap * way <= 1.0);
                points
            }
        },
        run: |[gap, way], _, _| thrown(gap, way),
        theory: |_, _| None,
    },
    Axis {
        name: "droplet-radius",
        title: "Liquid that is missing when a droplet has boiled down, or grown, to a radius, as a share",
        source: "no liquid is lost",
        labels: ["radius at the end / at the start", "liquid that boils in the first step / liquid"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => product(&[0.2, 1.2], &[0.02]),
            // One that has less liquid left than boils in two steps vanishes before.
            Effort::Full => {
                let mut points = product(&[0.1, 0.2, 0.5, 1.2, 1.5], &[3e-3, 0.01, 0.03, 0.1]);
                points.retain(|[radius, share]| *radius > 1.0 || radius * radius > 2.0 * share);
                points
            }
        },
        run: |[radius, share], _, _| change_size(radius, share),
        theory: |_, _| None,
    },
    Axis {
        name: "droplet-boiling",
        title: "Rate of vaporisation of a droplet at rest over that of the steady state, after 40 steps",
        source: "2 pi k/c ln(1 + B)/ln(R/r)",
        labels: ["B = c (T - T_d) / L", "step / time of diffusion over its radius"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => product(&[1e-2, 1.0], &[1.0, 1e2]),
            Effort::Full => product(&[1e-2, 0.1, 0.3, 1.0, 2.0, 3.0], &[1.0, 10.0, 1e2, 1e3]),
        },
        run: |[number, step], _, _| boil(number, step),
        theory: |_, _| None,
    },
];

/// A droplet of liquid of a density, that nothing pulls.
pub(super) fn material(density: f64, vapour_density: f64, latent_heat: f64) -> Material<2> {
    Material {
        water: Water {
            density,
            viscosity: 1.0,
            thermal: ThermalFluid { conductivity: 1.0, prandtl: 1.0 },
            drag: Drag::Dallavalle,
            heat: HeatTransfer::RanzMarshall,
            voidage_function: VoidageFunction::None,
            per: Per::Solid,
        },
        temperature: BOILING,
        latent_heat,
        vapour_density,
        gravity: Vec2::zeros(),
        held: false,
        choices: Choices::default(),
    }
}

/// What stands for the droplet in the conditions between two steps.
pub(super) fn place_of(boundary: &str, scalars: Vec<ScalarCondition>) -> Condition<2> {
    let body = Body {
        centre: Vec2::zeros(),
        radius: 1.0,
        expansion: 0.0,
        motion: BodyMotion::Held(Vec2::zeros()),
        evaporation: None,
        blowing: Blowing::default(),
        solid: vec![],
    };
    Condition { boundary: boundary.into(), flow: FlowCondition::Body(body), scalars }
}

fn condition(boundary: &str, flow: FlowCondition<2>) -> Condition<2> {
    Condition { boundary: boundary.into(), flow, scalars: vec![] }
}

/// A box from -size to size with a droplet of radius 1 at a place, its right side apart.
fn rectangle(size: [f64; 2], place: Vec2) -> Rectangle {
    let hole = Hole { name: "droplet".into(), centre: place.into(), radius: 1.0, size: EDGE, growth: 0.2 };
    Rectangle {
        lower: size.map(|x| -x),
        upper: size,
        size: Some(1.0),
        sides: Sides {
            left: Side::named("walls"),
            right: Side::named("end"),
            bottom: Side::named("walls"),
            top: Side::named("walls"),
        },
        holes: vec![hole],
        refine: vec![],
        structured: None,
    }
}

/// The gas with a droplet that has a velocity, all of it in motion with another.
fn system(
    set: &FluidSet,
    mut mesh: Mesh<2>,
    (place, velocity, stream): (Vec2, Vec2, Vec2),
    material: Material<2>,
    when: Remesh,
) -> Result<Coupled<2>> {
    let boundary = &set.conditions[0].boundary;
    let droplet = Droplet::new(&mut mesh, boundary, (place, 1.0), (velocity, 0.2), material)?;
    let start = State { velocity: vec![stream; mesh.points.len()], ..set.rest(&mesh, BOILING) };
    let mut fluid = set.build(mesh, start)?;
    fluid.droplet = Some(Box::new(droplet));
    fluid.remesher = Some(Remesher::around_droplet(&fluid.mesh, None, when));
    let scheme = SchemeName::default().build(&Options::default())?;
    Ok(Coupled::new(System::Fluid(Box::new(fluid)), scheme))
}

fn droplet(system: &mut Coupled<2>) -> Option<Droplet<2>> {
    system.fluid_mut().and_then(|fluid| fluid.live_droplet().cloned())
}

fn slows(density: f64, step: f64) -> Result<Sample> {
    let (viscosity, mut set) = (0.1, FluidSet::new(1.0, 0.1));
    set.conditions = vec![
        place_of("droplet", vec![]),
        condition("walls", FlowCondition::NoSlip),
        condition("end", FlowCondition::Open { pressure: 0.0 }),
    ];
    let dt = step / viscosity;
    // So slow that it stays where it is, and that convection does not count.
    let start = Vec2::new(-0.6, 0.8) * (1e-6 / dt);
    let mesh = Mesh::rectangle(&rectangle([3.0, 3.0], Vec2::zeros()))?;
    let place = (Vec2::zeros(), start, Vec2::zeros());
    let mut system = system(&set, mesh, place, material(density, 1.0, 1.0), Remesh::default())?;
    let (mut tally, mut worst, mut last) = (Tally::default(), 0.0f64, start.norm());
    for _ in 0..12 {
        tally.add(&system.step(dt)?);
        let now = droplet(&mut system).map_or(f64::NAN, |droplet| droplet.state.velocity.norm());
        // What is left when it has stopped is rounding.
        if last < 1e-9 * start.norm() {
            break;
        }
        worst = if now.is_finite() { worst.max(now / last) } else { f64::INFINITY };
        last = now;
    }
    let verdict = if worst <= 1.0 { Verdict::Passes } else { Verdict::Unstable };
    Ok(Sample::new(verdict, worst, 1.0, tally))
}

/// A heavy droplet above the lower wall, thrown at it.
fn thrown(gap: f64, way: f64) -> Result<Sample> {
    let mut set = FluidSet::new(1.0, 0.1);
    set.conditions = vec![
        place_of("droplet", vec![]),
        condition("walls", FlowCondition::NoSlip),
        condition("end", FlowCondition::Open { pressure: 0.0 }),
    ];
    let half = 3.0;
    let first = gap * EDGE;
    let place = Vec2::new(0.0, 1.0 + first - half);
    let dt = 1e-2;
    let velocity = Vec2::new(0.0, -way * first / dt);
    let mesh = Mesh::rectangle(&rectangle([half; 2], place))?;
    let when = Remesh { every: 5, ..Remesh::default() };
    let mut system = system(&set, mesh, (place, velocity, Vec2::zeros()), material(1e3, 1.0, 1.0), when)?;
    let (mut tally, mut least, mut fastest) = (Tally::default(), 1.0f64, 0.0f64);
    for _ in 0..20 {
        tally.add(&system.step(dt)?);
        let Some(droplet) = droplet(&mut system) else { break };
        let state = &droplet.state;
        least = least.min((state.centre.y - state.radius + half) / first);
        fastest = worse(fastest, state.velocity.norm() / velocity.norm());
    }
    // A droplet is the polygon of its nodes, whose corners lie beyond its radius.
    let allowed = (0.02 / first).min(1.0) - 1e-9;
    let verdict = match (fastest <= 1.0 + 1e-9, least > 0.0 && least >= allowed.min(0.9)) {
        (false, _) => Verdict::Unstable,
        (true, true) => Verdict::Passes,
        (true, false) => Verdict::Wrong,
    };
    Ok(Sample::new(verdict, least, allowed, tally))
}

/// A droplet at rest in a ring, which boils or grows by what condenses.
fn change_size(target: f64, share: f64) -> Result<Sample> {
    let (density, number) = (1.2, if target < 1.0 { 0.3 } else { -0.3 });
    let hot = 200.0_f64.copysign(number);
    let latent = CAPACITY / density * hot / number;
    let (system, liquid) = (ring_of_gas(hot, latent, 1e3)?, PI * 1e3);
    let mut system = system;
    let rate = 2.0 * PI * CONDUCTIVITY / (CAPACITY / density) * (1.0 + number).ln() / RING.ln();
    let dt = share * liquid / rate.abs();
    let (mut tally, mut missing, mut beyond) = (Tally::default(), 0.0f64, 0.0f64);
    let low = BOILING.min(BOILING + hot);
    let mut there = false;
    loop {
        tally.add(&system.step(dt)?);
        if let Some(fluid) = system.fluid() {
            let out = fluid.accepted.scalar(HEAT).iter().map(|t| (low - t).max(t - low - hot.abs()));
            beyond = out.fold(beyond, worse);
        }
        let Some(droplet) = droplet(&mut system) else { break };
        let state = &droplet.state;
        missing = worse(missing, (state.first - state.boiled - state.liquid).abs() / state.first);
        there = if target < 1.0 { state.radius <= target } else { state.radius >= target };
        if there || tally.steps > 2000 || !state.radius.is_finite() {
            break;
        }
    }
    let sound = there && beyond < 1e-6 * hot.abs() && tally.steps <= 2000;
    let sample = Sample::judge(missing.is_finite(), missing, 0.0, 1e-12, tally);
    let verdict = if sound { sample.verdict } else { Verdict::Wrong };
    Ok(Sample { verdict, ..sample })
}

fn ride(travel: f64, remesh: f64, steps: usize) -> Result<Sample> {
    let stream = Vec2::new(1.0, 0.0);
    let mut set = FluidSet::new(1.3, 0.01);
    set.conditions = vec![
        place_of("droplet", vec![]),
        condition("walls", FlowCondition::Velocity(Prescribed::Uniform(stream))),
        condition("end", FlowCondition::Open { pressure: 0.0 }),
    ];
    let dt = travel * EDGE;
    let way = dt * steps as f64;
    let half = 4.0 + way / 2.0;
    let start = Vec2::new(-way / 2.0, 0.0);
    let when = Remesh { every: remesh as u64, ..Remesh::default() };
    let mesh = Mesh::rectangle(&rectangle([half, 3.0], start))?;
    let of = Material { held: true, ..material(1e3, 1.3, 1.0) };
    let mut system = system(&set, mesh, (start, stream, stream), of, when)?;
    let mut tally = Tally::default();
    for _ in 0..steps {
        tally.add(&system.step(dt)?);
    }
    let off = system
        .fluid()
        .map_or(f64::NAN, |fluid| largest(fluid.accepted.velocity.iter().map(|u| (u - stream).norm())));
    Ok(Sample::judge(off.is_finite(), off, 0.0, UNIFORM, tally))
}

/// A droplet of liquid of a density, at rest, in a ring of gas whose outer wall is so much hotter, with the
/// temperature of conduction between.
fn ring_of_gas(hot: f64, latent: f64, density: f64) -> Result<Coupled<2>> {
    let mesh = annulus(1.0, RING, 8, 32);
    let mut set = FluidSet::new(1.2, 1e-3);
    let heat = Scalar::new(TEMPERATURE, CAPACITY, CONDUCTIVITY);
    set.scalars = vec![Scalar { form: Form::Monotone, ..heat }];
    let held = |value: f64| vec![ScalarCondition::Value(Prescribed::Uniform(value))];
    let outside = FlowCondition::Open { pressure: 0.0 };
    set.conditions = vec![
        place_of("inner", held(BOILING)),
        Condition { boundary: "outer".into(), flow: outside, scalars: held(BOILING + hot) },
    ];
    let of = Material { held: true, ..material(density, 1.2, latent) };
    let still = (Vec2::zeros(), Vec2::zeros(), Vec2::zeros());
    let mut system = system(&set, mesh, still, of, Remesh { every: 25, ..Remesh::default() })?;
    if let Some(fluid) = system.fluid_mut() {
        let profile: Vec<f64> = fluid
            .mesh
            .points
            .iter()
            .map(|x| BOILING + hot * (x.norm().ln() / RING.ln()).clamp(0.0, 1.0))
            .collect();
        fluid.accepted.scalars[HEAT] = profile;
        fluid.start()?;
    }
    Ok(system)
}

fn boil(number: f64, step: f64) -> Result<Sample> {
    let (density, hot) = (1.2, 300.0);
    let diffusion = CAPACITY / CONDUCTIVITY;
    // c (T - T_d) / L, with the capacity by mass. So dense that it hardly shrinks.
    let mut system = ring_of_gas(hot, CAPACITY / density * hot / number, 1e12)?;
    let mut tally = Tally::default();
    let steps = (40.0 / step).ceil().max(40.0) as usize;
    for _ in 0..steps {
        match system.step(step * diffusion) {
            Ok(report) => tally.add(&report),
            Err(_) => return Ok(Sample::new(Verdict::Unstable, f64::NAN, 1.0, tally)),
        }
    }
    let exact = 2.0 * PI * CONDUCTIVITY / (CAPACITY / density) * (1.0 + number).ln() / RING.ln();
    let rate = droplet(&mut system).map_or(f64::NAN, |droplet| droplet.vaporisation()) / exact;
    Ok(Sample::judge(rate.abs() < 10.0, rate, 1.0, RATE, tally))
}
