//! Grains in a droplet: they share their momentum with the water, whatever the drag, and pass its surface, whatever
//! their size and solidity and however much boils.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use super::bed::GAS;
use super::droplet::{material, place_of};
use voidage_campaign::Effort;
use voidage_campaign::worse;
use voidage_coupling::closure::{Surroundings, ThermalFluid, VoidageFunction};
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{Choices, Droplet, Inside, Material, WaterVoidage};
use voidage_coupling::remesh::{Remesh, Remesher};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, HEAT, Result, TEMPERATURE};
use voidage_dem::{Dem, Settings, Wall};
use voidage_fluid::Mesh;
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::mesh::{Hole, Rectangle, Sides};
use voidage_fluid::transport::{Form, Scalar};
use voidage_verification::models::{FluidSet, Vec2, alike, weightless};

/// Radius of the droplet, edge of the mesh at its surface, and half the box, m.
pub(super) const RADIUS: f64 = 5e-4;
const EDGE: f64 = 7e-5;
const HALF: f64 = 1.5e-3;
/// Of water and of the gas (Table 2 of Henry et al.), SI.
const WATER: f64 = 958.4;
const CAPACITY: f64 = 1040.0;
const CONDUCTIVITY: f64 = 0.026;
const LATENT: f64 = 2.257e6;
const BOILING: f64 = 373.15;
const HOT: f64 = 773.15;
/// What passes: deviation of a factor, share of the range of temperatures by which they may leave it, defects of what
/// is exchanged and of the water, penetration over radius.
const ALLOWED: f64 = 1e-3;
/// Share by which the drag of the gas on a droplet may depend on the step.
const DRAG: f64 = 3e-2;
const BEYOND: f64 = 1e-9;
const BALANCED: f64 = 1e-9;
const PENETRATION: f64 = 1e-2;
/// Multiple of its bound at which a velocity runs away.
const RUNAWAY: f64 = 10.0;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "droplet-water",
        title: "Factor by which the slip of grains in water falls in a step, over 1/(1 + A + B): no gas",
        source: "closed form: slip of two that share their momentum by implicit drag",
        labels: ["A = drag dt / mass of the water", "B = drag dt / mass of the grains"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[1e-2, 1e3], &[1e-2, 1e3]),
            Effort::Full => product(&[1e-3, 0.1, 1.0, 10.0, 1e3, 1e6], &[1e-3, 0.1, 1.0, 10.0, 1e3, 1e6]),
        },
        run: |[a, b], scheme, _| share(a, b, scheme),
        theory: |_, _| Some(true),
    },
    Axis {
        name: "droplet-bed",
        title: "Factor by which a droplet between held grains is slowed by the gas in a step, over 1/(1 + a_d)",
        source: "closed form: implicit drag of the gas",
        labels: ["a_d = drag of the gas dt / mass of the droplet", "density of the droplet / of the gas"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1, 10.0], &[1e3]),
            Effort::Full => product(&[1e-3, 0.1, 1.0, 2.0, 10.0, 1e3, 1e6], &[1e2, 1e3, 1e6]),
        },
        run: |[drag, density], scheme, _| slowed(drag, density, scheme),
        theory: |_, _| Some(true),
    },
    Axis {
        name: "droplet-grains",
        title: "Fastest droplet over what vapour and grains can give it: hot grains pass through it",
        source: "bounds: velocity of the vapour and the grains; temperatures of droplet and grains",
        labels: ["diameter of the grains / of the droplet", "solidity"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1], &[0.476, 0.714]),
            Effort::Full => product(&[0.05, 0.1, 0.2, 0.4], &[0.4, 0.476, 0.714]),
        },
        run: |[size, solidity], scheme, _| pass(Cloud { size, solidity, ..Cloud::default() }, scheme),
        theory: |_, _| None,
    },
    Axis {
        name: "droplet-vapour",
        title: "Fastest droplet over what vapour and grains can give it: it boils among hot grains",
        source: "bounds: velocity of the vapour and the grains; temperatures of droplet and grains",
        labels: ["heat of vaporisation of water / of the liquid", "step / s"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1, 10.0], &[1e-4]),
            Effort::Full => product(&[0.01, 0.1, 1.0, 3.0, 10.0], &[1e-5, 1e-4, 5e-4, 1e-3]),
        },
        run: |[boils, step], scheme, _| pass(Cloud { boils, step, ..Cloud::default() }, scheme),
        theory: |_, _| None,
    },
];

/// A box with a droplet in its middle.
pub(super) fn box_around(sides: Sides) -> Result<Mesh<2>> {
    Ok(Mesh::rectangle(&Rectangle {
        lower: [-HALF; 2],
        upper: [HALF; 2],
        size: Some(4e-4),
        sides,
        holes: vec![Hole {
            name: "droplet".into(),
            centre: [0.0; 2],
            radius: RADIUS,
            size: EDGE,
            growth: 0.2,
        }],
        refine: vec![],
        structured: None,
    })?)
}

/// Places of a square lattice within half the extents.
pub(super) fn lattice(extent: [f64; 2], spacing: f64) -> Vec<Vec2> {
    let [columns, rows] = extent.map(|half| (half / spacing) as i32);
    let row = |k: i32| (-columns..=columns).map(move |i| Vec2::new(f64::from(i), f64::from(k)) * spacing);
    (-rows..=rows).flat_map(row).collect()
}

/// Gas around a droplet, and grains.
pub(super) fn system(
    set: &FluidSet,
    mut mesh: Mesh<2>,
    of: Material<2>,
    grains: Dem<2>,
    thermal: Option<ThermalFluid>,
    scheme: SchemeName,
) -> Result<Coupled<2>> {
    let place = (Vec2::zeros(), RADIUS);
    let droplet = Droplet::new(&mut mesh, "droplet", place, (Vec2::zeros(), 0.2), of)?;
    let start = set.rest(&mesh, HOT);
    let mut fluid = set.build(mesh, start)?;
    fluid.droplet = Some(Box::new(droplet));
    let when = Remesh { every: 5, ..Remesh::default() };
    fluid.remesher = Some(Remesher::around_droplet(&fluid.mesh, None, when));
    let mut system = set.with_grains(fluid, grains, set.laws(thermal), scheme)?;
    if let (Some(interaction), true) = (system.interaction_mut(), thermal.is_some()) {
        interaction.at.temperature.fill(HOT);
    }
    Ok(system)
}

/// The droplet, if there is still one.
pub(super) fn live(system: &mut Coupled<2>) -> Option<Droplet<2>> {
    system.fluid_mut().and_then(|fluid| fluid.live_droplet().cloned())
}

/// Grains in the middle of the water, with a velocity so small that their drag is in proportion to it.
fn share(a: f64, b: f64, scheme: SchemeName) -> Result<Sample> {
    let (dt, creep, radius, viscosity) = (1.0, 1e-14, 4e-5, 1e9);
    let solid = voidage_dem::Material { density: 1.0, ..Default::default() };
    let places = lattice([1.5e-4; 2], 1.2e-4);
    let count = places.len() as f64;
    let mut particles = alike(places, radius, &solid)?;
    let around = Surroundings { slip: creep, voidage: 1.0, diameter: 2.0 * radius, density: 1.0, viscosity };
    let mut set = FluidSet::new(1e-12, 1e-12);
    let drag = particles.volume[0] * set.laws(None).drag.coefficient(&around, VoidageFunction::None);
    particles.mass.fill(dt * drag / b);
    particles.velocity.fill(Vec2::new(0.6, 0.8) * creep);
    let liquid = std::f64::consts::PI * RADIUS * RADIUS - count * particles.volume[0];
    set.conditions = vec![
        place_of("droplet", vec![]),
        Condition { boundary: "around".into(), flow: FlowCondition::Open { pressure: 0.0 }, scalars: vec![] },
    ];
    let of = material(dt * count * drag / a / liquid, 1e-12, 1.0);
    let alone = Choices { inside: Inside { voidage: WaterVoidage::One }, ..Choices::default() };
    let of = Material { water: Water { viscosity, ..of.water }, choices: alone, ..of };
    let grains = Dem::new(particles, vec![], vec![solid], weightless())?;
    let mut system = system(&set, box_around(Sides::all("around"))?, of, grains, None, scheme)?;
    let mut tally = Tally::default();
    let slip = |system: &mut Coupled<2>| {
        let water = live(system).map_or_else(Vec2::zeros, |droplet| droplet.state.velocity);
        let grain = system.grains().map_or_else(Vec2::zeros, |grains| grains.particles.velocity[0]);
        (grain - water).dot(&Vec2::new(0.6, 0.8))
    };
    let factor = 1.0 / (1.0 + a + b);
    let (mut last, mut worst) = (slip(&mut system), 0.0f64);
    let first = last;
    for _ in 0..4 {
        tally.add(&system.step(dt)?);
        let now = slip(&mut system);
        worst = worse(worst, ((now - factor * last) / last.abs().max(now.abs())).abs());
        last = now;
        if last.abs() < 1e-6 * first || !last.is_finite() || last.abs() > 1e6 * first {
            break;
        }
    }
    let bounded = last.abs() <= first;
    Ok(Sample::judge(bounded, 1.0 + worst, 1.0, ALLOWED, tally))
}

/// A droplet that creeps between held grains.
fn slowed(drag: f64, density: f64, scheme: SchemeName) -> Result<Sample> {
    // Drag that outweighs the inertia of the gas by far, so that it is in proportion to the velocity at once.
    let (gas, creep) = (1e-9, 1e-12);
    let step = |dt: f64| -> Result<(Sample, f64)> {
        let solid = voidage_dem::Material { density: 1.0, solidity: 0.5, ..Default::default() };
        let outside = |x: &Vec2| x.norm() > RADIUS + 1.5e-4;
        let places = lattice([HALF - 1e-4; 2], 1.3e-4).into_iter().filter(outside).collect();
        let mut particles = alike(places, 6e-5, &solid)?;
        particles.mass.fill(f64::INFINITY);
        let mut set = FluidSet::new(gas, 1.0);
        let open = FlowCondition::Open { pressure: 0.0 };
        set.conditions = vec![
            place_of("droplet", vec![]),
            Condition { boundary: "around".into(), flow: open, scalars: vec![] },
        ];
        let grains = Dem::new(particles, vec![], vec![solid], weightless())?;
        let mut system = system(
            &set,
            box_around(Sides::all("around"))?,
            material(density * gas, gas, 1.0),
            grains,
            None,
            scheme,
        )?;
        if let Some(droplet) = system.fluid_mut().and_then(|fluid| fluid.live_droplet()) {
            droplet.state.velocity = Vec2::new(0.6, 0.8) * (creep / dt.max(1.0));
        }
        let before = live(&mut system).map_or_else(Vec2::zeros, |droplet| droplet.state.velocity);
        let mut tally = Tally::default();
        tally.add(&system.step(dt)?);
        let after = live(&mut system).map_or_else(Vec2::zeros, |droplet| droplet.state.velocity);
        let factor = after.dot(&before) / before.norm_squared();
        Ok((
            Sample::new(Verdict::Passes, factor, 1.0, tally),
            live(&mut system)
                .map_or(f64::NAN, |d| -d.state.force.dot(&after) / after.norm_squared() / d.mass()),
        ))
    };
    // The drag over the mass, from a step of the time that it takes, so that the gas which must get going does not
    // count.
    let (_, first) = step(1.0)?;
    let (_, rate) = step(1.0 / first)?;
    let (sample, _) = step(drag / rate)?;
    let expected = 1.0 / (1.0 + drag);
    let measured = sample.measured / expected;
    Ok(Sample::judge((0.0..=1.0).contains(&sample.measured), measured, 1.0, DRAG, sample.tally))
}

/// Hot grains that rise through a droplet.
#[derive(Clone, Copy)]
struct Cloud {
    /// Diameter of the grains over that of the droplet.
    size: f64,
    solidity: f64,
    /// Heat of vaporisation of water over that of the liquid.
    boils: f64,
    /// s.
    step: f64,
}

impl Default for Cloud {
    fn default() -> Self {
        Self { size: 0.1, solidity: 0.476, boils: 1.0, step: 2e-4 }
    }
}

fn pass(Cloud { size, solidity, boils, step }: Cloud, scheme: SchemeName) -> Result<Sample> {
    let (speed, steps, radius) = (0.05, 20, size * RADIUS);
    let solid = voidage_dem::Material {
        density: 3200.0,
        heat_capacity: 290.0,
        friction: 0.3,
        solidity,
        ..Default::default()
    };
    let extent = [HALF - 4.0 * RADIUS * size, HALF - 4.0 * RADIUS * size];
    let mut particles =
        alike(lattice(extent, 2.3 * radius), radius, &solid)?.heated(HOT, std::slice::from_ref(&solid))?;
    particles.velocity.fill(Vec2::new(0.0, speed));
    let count = particles.len();
    let mut set = FluidSet::new(GAS.fluid, GAS.set().properties.viscosity);
    let heat = Scalar::new(TEMPERATURE, GAS.fluid * CAPACITY, CONDUCTIVITY);
    set.scalars = vec![Scalar { form: Form::Monotone, ..heat }];
    let outside = ScalarCondition::Outflow { outside: Some(HOT) };
    let open = FlowCondition::Open { pressure: 0.0 };
    set.conditions = vec![
        place_of("droplet", vec![ScalarCondition::Value(Prescribed::Uniform(BOILING))]),
        Condition { boundary: "around".into(), flow: open, scalars: vec![outside] },
    ];
    let of = material(WATER, GAS.fluid, LATENT / boils);
    let of = Material { water: Water { viscosity: 2.82e-4, ..of.water }, ..of };
    let corners = [[-HALF, -HALF], [HALF, -HALF], [HALF, HALF], [-HALF, HALF]].map(Vec2::from);
    let walls = (0..4).map(|k| Wall::new("box", corners[k], corners[(k + 1) % 4])).collect();
    let grains = Dem::new(particles, walls, vec![solid], Settings { ..weightless() })?;
    let thermal = ThermalFluid {
        conductivity: CONDUCTIVITY,
        prandtl: CAPACITY * set.properties.viscosity / CONDUCTIVITY,
    };
    let mut system = system(&set, box_around(Sides::all("around"))?, of, grains, Some(thermal), scheme)?;
    let (mut tally, mut fastest, mut blown) = (Tally::default(), 0.0f64, 0.0f64);
    let (mut beyond, mut defect, mut penetration) = (0.0f64, 0.0f64, 0.0f64);
    for _ in 0..steps {
        let report = system.step(step)?;
        tally.add(&report);
        let exchanged = [report.momentum_exchange_defect, report.energy_exchange_defect];
        defect = exchanged.into_iter().flatten().fold(defect, worse);
        penetration =
            report.grains.map_or(penetration, |g| worse(penetration, g.max_penetration_over_radius));
        let mut look = |temperature: &[f64]| {
            let out = temperature.iter().map(|t| (BOILING - t).max(t - HOT) / (HOT - BOILING));
            beyond = out.fold(beyond, worse);
        };
        if let Some(fluid) = system.fluid() {
            look(fluid.accepted.scalar(HEAT));
        }
        if let Some(grains) = system.grains() {
            grains.particles.heat.iter().for_each(|heat| look(&heat.temperature));
        }
        let Some(droplet) = live(&mut system) else { break };
        let state = &droplet.state;
        let around = 2.0 * std::f64::consts::PI * state.radius;
        blown = blown.max(state.vapour / around);
        fastest = if state.velocity.norm().is_finite() {
            fastest.max(state.velocity.norm())
        } else {
            f64::INFINITY
        };
        let water = (state.first - state.boiled - state.liquid).abs() / state.first;
        defect = worse(defect, water);
        if fastest > RUNAWAY * (speed + blown) {
            return Ok(Sample::new(Verdict::Unstable, fastest / (speed + blown), 1.0, tally));
        }
    }
    let lost = system.grains().is_none_or(|grains| grains.particles.len() != count);
    let right = beyond <= BEYOND && defect <= BALANCED && penetration <= PENETRATION && !lost;
    let bound = fastest / (speed + blown);
    let verdict = if right && bound <= 1.0 { Verdict::Passes } else { Verdict::Wrong };
    let curves = vec![
        ("temperature beyond the range", 0.0, beyond),
        ("defect of exchange and water", 0.0, defect),
        ("largest penetration / radius", 0.0, penetration),
    ];
    Ok(Sample { curves, ..Sample::new(verdict, bound, 1.0, tally) })
}
