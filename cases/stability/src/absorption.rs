//! A droplet that sinks into hot grains: heat that it takes in with them boils in the next step, and the vapour lifts
//! it.
//!
//! All heat comes with the grains, each gives it off as soon as the surface cuts it, and nothing but its vapour carries
//! the droplet. What boils is then in proportion to the velocity of the last step, and the balance with the weight
//! gives the steady velocity U. A deviation of the velocity is 1 - x times as large after a step, x = g dt/U. Steps start
//! as if those before had been divided likewise: a droplet that comes in long parts is thrown up by what it took in.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use super::droplet::{material, place_of};
use super::wet::{RADIUS, box_around, lattice, live, system};
use voidage_campaign::{Effort, largest, worse};
use voidage_coupling::closure::ThermalFluid;
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{Buoyancy, Choices, Material};
use voidage_coupling::scheme::cut::Cutting;
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Coupled, Result, TEMPERATURE};
use voidage_dem::Dem;
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::mesh::{Side, Sides};
use voidage_fluid::transport::{Form, Scalar};
use voidage_verification::models::{FluidSet, Vec2, alike, weightless};

/// Diameter of the grains over that of the droplet, distance of their centres over their diameter, solidity.
const SIZE: f64 = 0.01;
const SPACING: f64 = 1.15;
const SOLIDITY: f64 = 0.5;
/// A step (s), and how far the droplet sinks in it, in diameters of a grain.
const STEP: f64 = 1e-3;
const WAY: f64 = 3.0;
/// Densities of water and gas, kg/m3, viscosity of the gas at an absorption number of one, Pa s, and temperatures of
/// the water and of all else, K.
const WATER: f64 = 1000.0;
const GAS: f64 = 1e-3;
const VISCOSITY: f64 = 1e-6;
const BOILING: f64 = 373.15;
const HOT: f64 = 773.15;
/// Conductivity of the water, W/m/K: grains in it give off nearly all of their heat within a step. That of the gas, which
/// is to give no heat.
const CONDUCTS: f64 = 100.0;
const INSULATES: f64 = 1e-9;
/// Steps, and how many of them, at the end, the absorption number of the program is a mean over.
const STEPS: usize = 14;
const MEAN: usize = 7;
/// Multiple of its steady velocity at which a droplet runs away; one that rises does so too. Share by which the
/// velocities in the last steps may differ from their mean.
const RUNAWAY: f64 = 2.0;
const SWING: f64 = 0.6;
/// Share by which the absorption number of the program may be off: it is that of the last part of a step, in which few
/// grains are taken in.
const NUMBER: f64 = 0.4;

/// The axis of this file.
pub const AXES: &[Axis] = &[Axis {
    name: "droplet-absorption",
    title: "Fastest droplet over its steady velocity: it boils the heat that it took in with grains a step before",
    source: "a deviation of the velocity is 1 - x times as large after a step",
    labels: ["absorption number x of a whole step", "number above which steps are divided"],
    coupled: true,
    points: |effort| match effort {
        Effort::Quick => vec![[1.0, 100.0], [3.0, 1.0], [3.0, 100.0]],
        Effort::Full => product(&[0.3, 1.0, 1.5, 3.0, 10.0], &[1.0, 100.0]),
    },
    run: |[number, most], scheme, _| sink(number, most, scheme),
    theory: |[number, most], _| Some(number.min(most) < 2.0),
}];

/// Steady velocity, m/s.
fn steady() -> f64 {
    WAY * 2.0 * SIZE * RADIUS / STEP
}

/// A droplet that sinks at the steady velocity into hot grains which are held, in a box that is open at the top.
struct Sinking {
    /// Absorption number of a step.
    number: f64,
    /// Share of a step that its last part was.
    part: f64,
    /// kg/m3.
    density: f64,
    /// m/s2.
    gravity: f64,
    /// Heat of vaporisation, J/kg.
    latent: f64,
}

fn sinking(
    Sinking { number, part, density, gravity, latent }: Sinking,
    scheme: SchemeName,
) -> Result<Coupled<2>> {
    let solid = voidage_dem::Material {
        density: 3200.0,
        heat_capacity: 290.0,
        solidity: SOLIDITY,
        ..Default::default()
    };
    let radius = SIZE * RADIUS;
    // Without those that it has cut before the last part of a step, which are cold.
    let last = Vec2::new(0.0, steady() * STEP * part);
    let outside = |x: &Vec2| (x - last).norm() > RADIUS + radius;
    let places = lattice([1.45e-3; 2], 2.0 * SPACING * radius).into_iter().filter(outside).collect();
    let mut particles = alike(places, radius, &solid)?.heated(HOT, std::slice::from_ref(&solid))?;
    particles.mass.fill(f64::INFINITY);
    let mut set = FluidSet::new(GAS, VISCOSITY * number);
    set.scalars = vec![Scalar { form: Form::Monotone, ..Scalar::new(TEMPERATURE, GAS, INSULATES) }];
    let of = |boundary: &str, flow, heat| Condition { boundary: boundary.into(), flow, scalars: vec![heat] };
    let open = FlowCondition::Open { pressure: 0.0 };
    set.conditions = vec![
        place_of("droplet", vec![ScalarCondition::Value(Prescribed::Uniform(BOILING))]),
        of("closed", FlowCondition::Slip, ScalarCondition::Insulated),
        of("top", open, ScalarCondition::Outflow { outside: Some(HOT) }),
    ];
    let of = material(density, GAS, latent);
    let of = Material {
        gravity: Vec2::new(0.0, -gravity),
        water: Water {
            viscosity: 1e-9,
            thermal: ThermalFluid { conductivity: CONDUCTS, prandtl: 1.0 },
            ..of.water
        },
        choices: Choices { buoyancy: Buoyancy::None, ..of.choices },
        ..of
    };
    let closed = || Side::named("closed");
    let sides = Sides { left: closed(), right: closed(), bottom: closed(), top: Side::named("top") };
    let grains = Dem::new(particles, vec![], vec![solid], weightless())?;
    let thermal = ThermalFluid { conductivity: INSULATES, prandtl: 1.0 };
    let mut system = system(&set, box_around(sides)?, of, grains, Some(thermal), scheme)?;
    if let Some(droplet) = system.fluid_mut().and_then(|fluid| fluid.live_droplet()) {
        droplet.state.velocity = Vec2::new(0.0, -steady());
        (droplet.state.way, droplet.state.next) = (-last, part);
    }
    Ok(system)
}

/// Heat of vaporisation (J/kg) at which vapour carries a droplet that sinks at the steady velocity, in this gravity: it
/// is in proportion to the force on one so heavy that nothing slows it.
fn carries(number: f64, gravity: f64) -> Result<f64> {
    let latent = 1e9;
    let heavy = Sinking { number, part: 1.0, density: 1e6 * WATER, gravity: 0.0, latent };
    let mut system = sinking(heavy, SchemeName::Henry)?;
    let mut force = 0.0;
    for step in 0..STEPS {
        system.step(STEP)?;
        if step >= STEPS - MEAN {
            force += live(&mut system).map_or(f64::NAN, |droplet| droplet.state.force.y) / MEAN as f64;
        }
    }
    Ok(latent * force / (WATER * std::f64::consts::PI * RADIUS * RADIUS * gravity))
}

fn sink(number: f64, most: f64, scheme: SchemeName) -> Result<Sample> {
    let gravity = number * steady() / STEP;
    let part = (most / number).min(1.0).log2().floor().exp2();
    let latent = carries(number, gravity)?;
    let mut system = sinking(Sinking { number, part, density: WATER, gravity, latent }, scheme)?;
    let cutting = Cutting { travel: f64::INFINITY, absorption: most };
    system.set_scheme(scheme.build(&Options { cut: Some(cutting), ..Options::default() })?);
    let (mut tally, mut fastest, mut numbers, mut last) = (Tally::default(), 0.0f64, 0.0f64, vec![]);
    for step in 0..STEPS {
        tally.add(&system.step(STEP)?);
        let Some(droplet) = live(&mut system) else { break };
        let sinks = -droplet.state.velocity.y / steady();
        fastest = worse(fastest, sinks.abs());
        if !(0.0..=RUNAWAY).contains(&sinks) {
            return Ok(Sample::new(Verdict::Unstable, fastest, 1.0, tally));
        }
        if step >= STEPS - MEAN {
            // Slower droplets have larger numbers.
            numbers += droplet.absorption * STEP / number * sinks / MEAN as f64;
            last.push(sinks);
        }
    }
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    let swing = largest(last.iter().map(|sinks| sinks / mean - 1.0));
    let verdict = match (swing <= SWING, (numbers - 1.0).abs() <= NUMBER) {
        (false, _) => Verdict::Unstable,
        (true, true) => Verdict::Passes,
        (true, false) => Verdict::Wrong,
    };
    let curves = vec![("absorption number of the program / x", 0.0, numbers), ("swing / mean", 0.0, swing)];
    Ok(Sample { curves, ..Sample::new(verdict, fastest, 1.0, tally) })
}
