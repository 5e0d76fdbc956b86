//! A disc, as a boiling droplet that stands still, blows vapour into hot grains: from hardly any to far more than lifts
//! them.
//!
//! There is no theory, but bounds. The drag brings a grain towards the velocity of the vapour, which is greatest at the
//! disc, and gravity towards its terminal velocity: no grain may be faster than both together. No temperature may leave
//! the range between disc and grains, what the disc blows must leave, and forces and heat must balance.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use super::bed::GAS;
use super::mesh::outflow;
use voidage_campaign::{Effort, worse};
use voidage_coupling::closure::ThermalFluid;
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, HEAT, Result, TEMPERATURE};
use voidage_dem::packing::{Amount, Fill, Lattice, Radii, Region, lattice};
use voidage_dem::{Dem, Material, Settings, Wall};
use voidage_fluid::Mesh;
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::mesh::{Hole, Rectangle, Side, Sides};
use voidage_fluid::transport::{Form, Scalar};
use voidage_verification::models::{Vec2, alike, bisect};

/// Width and height of the box, height of the bed, place and radius of the disc, in diameters of a grain.
const BOX: [f64; 2] = [24.0, 48.0];
const BED: f64 = 16.0;
const CENTRE: [f64; 2] = [12.0, 7.0];
const RADIUS: f64 = 4.0;
/// Temperatures of the disc and of all else at the start, K.
const BOILING: f64 = 373.0;
const HOT: f64 = 773.0;
/// Of the gas, J/kg/K and W/m/K, and of the grains, J/kg/K.
const CAPACITY: f64 = 1040.0;
const CONDUCTIVITY: f64 = 0.026;
const SOLID_CAPACITY: f64 = 700.0;
/// Of the contacts.
const TOLERANCE: f64 = 1e-5;
/// The voidage between grains at the disc is not below this: the vapour is not faster there than its superficial
/// velocity over it.
const LEAST_VOIDAGE: f64 = 0.4;
/// Multiple of the bound at which grains run away.
const RUNAWAY: f64 = 10.0;
/// What passes: share of the blowing that may be lost, of the range of temperatures by which they may leave it,
/// penetration over radius, and defect of what is exchanged.
const DRIFT: f64 = 1e-9;
const BEYOND: f64 = 1e-9;
const PENETRATION: f64 = 1e-2;
const BALANCED: f64 = 1e-12;

/// The axes of this file.
pub const AXES: &[Axis] = &[Axis {
    name: "vapour",
    title: "Fastest grain over what vapour and gravity can give it: a disc blows into hot 55 um grains",
    source: "bounds: velocity of the vapour and terminal velocity; temperatures of disc and grains",
    labels: ["vapour speed / fluidisation velocity", "step / relaxation time of the grain"],
    coupled: true,
    points: |effort| match effort {
        Effort::Quick => product(&[1.0, 100.0], &[1.0]),
        Effort::Full => product(&[0.1, 1.0, 3.0, 10.0, 30.0, 100.0], &[0.1, 1.0, 10.0]),
    },
    run: |[vapour, step], scheme, effort| blow(vapour, step, scheme, effort.pick(25, 100)),
    theory: |_, _| None,
}];

/// What was worst on the way.
#[derive(Default)]
struct Worst {
    /// Of a grain, m/s.
    speed: f64,
    /// Temperature of a grain and of the fluid beyond the range, as a share of it.
    beyond: [f64; 2],
    /// Share of the blowing that did not leave.
    drift: f64,
    penetration: f64,
    defect: f64,
}

fn blow(vapour: f64, step: f64, scheme: SchemeName, steps: usize) -> Result<Sample> {
    let lying = GAS.lie(None)?;
    let speed = vapour * lying.fluidisation;
    let dt = step * GAS.solid / GAS.drag(lying.fluidisation, lying.voidage);
    let bound = speed / LEAST_VOIDAGE + terminal();
    let mut system = system(speed, scheme)?;
    let (mut worst, mut tally) = (Worst::default(), Tally::default());
    for _ in 0..steps {
        let Ok(report) = system.step(dt) else {
            return Ok(Sample::new(Verdict::Unstable, f64::NAN, 1.0, tally));
        };
        tally.add(&report);
        let exchanged = [report.momentum_exchange_defect, report.energy_exchange_defect];
        worst.defect = exchanged.into_iter().flatten().fold(worst.defect, worse);
        worst.penetration =
            report.grains.map_or(0.0, |g| worse(worst.penetration, g.max_penetration_over_radius));
        let [blown, left] = [-outflow(&system, "disc"), outflow(&system, "top")];
        // Contacts let grains reach a little beyond the top, and vapour takes their place.
        let came = report.appeared.unwrap_or(0.0) / dt;
        worst.drift = worse(worst.drift, ((left - came) / blown - 1.0).abs());
        worst.look(&mut system)?;
        if worst.speed > RUNAWAY * bound {
            return Ok(Sample::new(Verdict::Unstable, worst.speed / bound, 1.0, tally));
        }
    }
    let sound = worst.penetration <= PENETRATION && worst.defect <= BALANCED;
    let right = sound
        && worst.drift <= DRIFT
        && worst.beyond.iter().all(|beyond| *beyond <= BEYOND)
        && worst.speed <= bound;
    let verdict = if right { Verdict::Passes } else { Verdict::Wrong };
    let curves = vec![
        ("temperature of a grain beyond the range", 0.0, worst.beyond[0]),
        ("temperature of the fluid beyond the range", 0.0, worst.beyond[1]),
        ("share of the vapour that does not leave", 0.0, worst.drift),
        ("largest penetration / radius", 0.0, worst.penetration),
        ("exchange defect", 0.0, worst.defect),
    ];
    Ok(Sample { curves, ..Sample::new(verdict, worst.speed / bound, 1.0, tally) })
}

impl Worst {
    fn look(&mut self, system: &mut Coupled<2>) -> Result<()> {
        let mut raise = |k: usize, temperature: &[f64]| {
            let beyond = temperature.iter().map(|t| (BOILING - t).max(t - HOT) / (HOT - BOILING));
            self.beyond[k] = beyond.fold(self.beyond[k], worse);
        };
        if let Some(grains) = system.grains() {
            grains.particles.heat.iter().for_each(|heat| raise(0, &heat.temperature));
            let speeds = grains.particles.velocity.iter().map(|v| v.norm());
            self.speed =
                speeds.fold(self.speed, |most, v| if v.is_finite() { most.max(v) } else { f64::INFINITY });
        }
        if let Some(fluid) = system.fluid_mut() {
            raise(1, fluid.accepted.scalar(HEAT));
        }
        Ok(())
    }
}

/// Terminal velocity of a lone grain, m/s.
fn terminal() -> f64 {
    bisect(10.0, 60, |speed| GAS.drag(speed, 1.0) * speed < GAS.solid * GAS.gravity())
}

fn system(speed: f64, scheme: SchemeName) -> Result<Coupled<2>> {
    let d = GAS.diameter;
    let [width, height] = BOX.map(|share| share * d);
    let centre = Vec2::from(CENTRE) * d;
    let mesh = Mesh::rectangle(&Rectangle {
        lower: [0.0; 2],
        upper: [width, height],
        size: Some(1.5 * d),
        sides: Sides {
            left: Side::named("sides"),
            right: Side::named("sides"),
            bottom: Side::named("bottom"),
            top: Side::named("top"),
        },
        holes: vec![Hole {
            name: "disc".into(),
            centre: centre.into(),
            radius: RADIUS * d,
            size: d,
            growth: 0.2,
        }],
        refine: vec![],
        structured: None,
    })?;
    let mut set = GAS.set();
    let heat = Scalar::new(TEMPERATURE, GAS.fluid * CAPACITY, CONDUCTIVITY);
    set.scalars = vec![Scalar { form: Form::Monotone, ..heat }];
    let out = mesh.points.iter().map(|x| (x - centre).normalize() * speed).collect();
    let of = |boundary: &str, flow, heat| Condition { boundary: boundary.into(), flow, scalars: vec![heat] };
    set.conditions = vec![
        of("sides", FlowCondition::Slip, ScalarCondition::Insulated),
        of("bottom", FlowCondition::Slip, ScalarCondition::Insulated),
        of("top", FlowCondition::Open { pressure: 0.0 }, ScalarCondition::Outflow { outside: Some(HOT) }),
        of(
            "disc",
            FlowCondition::SuperficialVelocity(Prescribed::Nodal(out)),
            ScalarCondition::Value(Prescribed::Uniform(BOILING)),
        ),
    ];
    let thermal = ThermalFluid {
        conductivity: CONDUCTIVITY,
        prandtl: CAPACITY * set.properties.viscosity / CONDUCTIVITY,
    };
    let (start, laws) = (set.rest(&mesh, HOT), set.laws(Some(thermal)));
    let grains = grains(&mesh)?;
    let mut system = set.with_grains(set.build(mesh, start)?, grains, laws, scheme)?;
    if let Some(interaction) = system.interaction_mut() {
        interaction.at.temperature.fill(HOT);
    }
    Ok(system)
}

/// Rows on the floor, without those that the disc would cover, in a closed box round the disc.
fn grains(mesh: &Mesh<2>) -> Result<Dem<2>> {
    let d = GAS.diameter;
    let material = Material {
        density: GAS.solid,
        friction: 0.3,
        solidity: 0.65,
        heat_capacity: SOLID_CAPACITY,
        ..Material::default()
    };
    let materials = std::slice::from_ref(&material);
    let fill = Fill {
        radii: Radii::Constant(0.5 * d * (1.0 - 1e-9)),
        amount: Amount::Fill,
        material: 0,
        materials,
        seed: 0,
    };
    let region = Region { low: Vec2::zeros(), high: Vec2::new(BOX[0], BED) * d };
    let rows = lattice(&region, Lattice::Triangular, 1.0, &fill)?;
    let apart = |x: &Vec2| (x - Vec2::from(CENTRE) * d).norm() >= (RADIUS + 0.5) * d;
    let places = rows.position.into_iter().filter(apart).collect();
    let particles = alike(places, 0.5 * d * (1.0 - 1e-9), &material)?.heated(HOT, materials)?;
    let walls = mesh.boundaries.iter().flat_map(|part| {
        part.facets.chunks_exact(2).map(|ends| {
            let [from, to] = [ends[0], ends[1]].map(|node| mesh.points[node as usize]);
            Wall::new(part.name.clone(), from, to)
        })
    });
    let gravity = Vec2::new(0.0, -GAS.gravity());
    let settings = Settings { gravity, tolerance: TOLERANCE, ..Settings::default() };
    Ok(Dem::new(particles, walls.collect(), vec![material.clone()], settings)?)
}
