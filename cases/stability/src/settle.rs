//! Grains that settle to the floor of a closed box of water: fine grains, voidages down to nothing, grains smaller and
//! larger than the elements.
//!
//! There is no theory, but a bound and an end: with long steps no grain may be faster (over a step) than the fastest is
//! with short ones, none may leave the box, all must come to rest, and a bed of many grains must be as high, in the
//! mean over some packings; how a handful comes to lie is chance, and so is when, since a grain may lie on two others
//! or find its way between them: all have twice the time that it takes with short steps. These are steps in which a
//! lone grain falls by a fiftieth of its diameter, with the default scheme.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use voidage_campaign::Effort;
use voidage_campaign::{largest, worse};
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Error, Result};
use voidage_dem::packing::{Amount, Fill, Radii, Region, random, unobserved};
use voidage_dem::{Dem, Material, Particles, Settings, Wall};
use voidage_verification::models::{FluidSet, Vec2, bisect, grid};

/// Water and glass (SI).
const FLUID: f64 = 998.0;
const VISCOSITY: f64 = 1e-3;
const SOLID: f64 = 2650.0;
const GRAVITY: f64 = 9.81;

const SEED: u64 = 7;
/// Step over relaxation time of a lone grain.
const STEP: [f64; 3] = [1.0, 10.0, 100.0];
/// Share by which a bed of this many grains may differ in height. Packings are chance: fewer grains scatter by the root
/// more.
const SAME: f64 = 0.02;
const MANY: f64 = 140.0;
/// How much faster the fastest grain may be than at short steps: in the mean over some clouds of many grains, since
/// they sink in plumes whose speed is chance (that of four clouds of 100 um, with short steps, is 4.2 to 6.4 terminal
/// velocities of a lone grain); and of a single cloud, or a handful, whose meetings are chance (its greatest speed
/// scatters by some ten per cent already at one relaxation time).
const FASTEST: f64 = 1.1;
const FASTEST_OF_ONE: f64 = 2.0;
/// Multiple of the terminal velocity of a lone grain at which grains run away.
const RUNAWAY: f64 = 20.0;
/// Share of the terminal velocity of a lone grain, at the end of that of the fastest, below which grains count as at
/// rest.
const REST: f64 = 2e-2;
/// Penetration of a step, as a share of the radius, and defect of the exchange that pass.
const PENETRATION: f64 = 1e-2;
const BALANCED: f64 = 1e-12;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "fine-grains",
        title: "Height of the bed that fine grains in water settle to, over that with short steps",
        source: "the default scheme with short steps",
        labels: ["diameter (um)", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => vec![[100.0, 100.0]],
            Effort::Full => product(&[20.0, 100.0], &STEP),
        },
        run: |[diameter, step], scheme, effort| {
            Suspension::fine(diameter, effort).settles(step, scheme, Aim::Height)
        },
        theory: |_, _| None,
    },
    Axis {
        name: "fine-grains-rest",
        title: "Height of a bed of fine grains in water that has settled, after 50 steps more",
        source: "a bed at rest stays at rest",
        labels: ["diameter (um)", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[100.0], &[1.0, 100.0]),
            Effort::Full => product(&[20.0, 100.0], &[0.1, 1.0, 10.0, 100.0]),
        },
        run: |[diameter, step], scheme, effort| Suspension::fine(diameter, effort).rests(step, scheme),
        theory: |_, _| None,
    },
    Axis {
        name: "element-voidage",
        title: "Fastest grain over that with short steps: grains four elements wide settle in water",
        source: "the default scheme with short steps",
        labels: [
            "voidage of an element full of grain (0 counts as 1e-8)",
            "step / relaxation time of the grain",
        ],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[1e-8], &[10.0, 100.0]),
            Effort::Full => product(&[0.9, 0.5, 0.1, 1e-2, 1e-4, 1e-8], &STEP),
        },
        run: |[voidage, step], scheme, _| Suspension::filled(voidage).settles(step, scheme, Aim::Speed),
        theory: |_, _| None,
    },
    Axis {
        name: "grain-size",
        title: "Fastest grain over that with short steps: grains of 100 um settle in water",
        source: "the default scheme with short steps",
        labels: ["grain diameter / element size", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1, 1.0, 3.0], &[100.0]),
            Effort::Full => product(&[0.1, 0.3, 1.0, 3.0, 10.0], &STEP),
        },
        run: |[size, step], scheme, _| Suspension::on_elements(size).settles(step, scheme, Aim::Speed),
        theory: |_, _| None,
    },
];

/// Grains in a box of water.
#[derive(Clone, Debug)]
pub(super) struct Suspension {
    /// Mean of the diameters, which lie within a fifth of it.
    diameter: f64,
    /// Share of a disc that is solid.
    solidity: f64,
    /// Width and height in diameters, and squares of the mesh.
    size: [f64; 2],
    squares: [usize; 2],
    grains: usize,
    /// Random clouds to start from, and the seed of the first.
    packings: u64,
    seed: u64,
}

/// How a suspension ended.
struct End {
    /// Greatest speed of a grain on the way, m/s.
    fastest: f64,
    /// Mean height of the grains above the floor, m.
    height: f64,
    /// Largest penetration / radius, and defect of the exchange of momentum.
    penetration: f64,
    defect: f64,
    /// Greatest speed in the last step, m/s.
    last: f64,
    /// Time until the grains came to rest, s.
    time: f64,
    particles: Particles<2>,
    tally: Tally,
}

/// When to stop.
#[derive(Clone, Copy)]
enum Until {
    /// A time, s, but ten steps at least.
    Time(f64),
    /// The same, and up to twice that until no grain is faster than a speed, m/s.
    Settled { time: f64, speed: f64 },
    /// The grains rest.
    Rest,
}

impl Suspension {
    pub(super) fn fine(diameter: f64, effort: Effort) -> Self {
        let (size, squares, grains) = effort.pick(([10.0, 20.0], [5, 10], 50), ([20.0, 30.0], [10, 15], 140));
        let packings = effort.pick(1, 4);
        Self { diameter: diameter * 1e-6, solidity: 1.0, size, squares, grains, packings, seed: SEED }
    }

    fn filled(voidage: f64) -> Self {
        // A voidage of 1e-8 is what none at all is clipped to.
        let solidity = if voidage <= 1e-8 { 1.0 } else { 1.0 - voidage };
        let (size, squares) = ([5.0, 10.0], [20, 40]);
        Self { diameter: 1e-4, solidity, size, squares, grains: 6, packings: 1, seed: SEED }
    }

    fn on_elements(size: f64) -> Self {
        let (extent, grains) = if size < 1.0 { ([20.0, 40.0], 100) } else { ([5.0, 8.0], 6) };
        let squares = extent.map(|length: f64| (length * size).round().max(1.0) as usize);
        Self { diameter: 1e-4, solidity: 1.0, size: extent, squares, grains, packings: 1, seed: SEED }
    }

    /// gamma / V of a lone grain.
    fn drag(&self, slip: f64) -> f64 {
        let around = Surroundings {
            slip,
            voidage: 1.0,
            diameter: self.diameter,
            density: FLUID,
            viscosity: VISCOSITY,
        };
        FluidSet::new(FLUID, VISCOSITY).laws(None).drag.coefficient(&around, VoidageFunction::None)
    }

    /// Terminal velocity of a lone grain, m/s.
    fn terminal(&self) -> f64 {
        bisect(1.0, 100, |speed| self.drag(speed) * speed < (SOLID - FLUID) * GRAVITY)
    }

    pub(super) fn relaxation(&self) -> f64 {
        SOLID / self.drag(0.0)
    }

    fn material(&self) -> Material {
        Material { density: SOLID, solidity: self.solidity, ..Material::default() }
    }

    pub(super) fn loose(&self) -> Result<Particles<2>> {
        let high = Vec2::from(self.size) * self.diameter;
        let region = Region { low: Vec2::zeros(), high };
        let materials = [self.material()];
        // Sizes that do not fall into rows, and no friction that heaps them: their bed has one height.
        let radii = Radii::Uniform { min: 0.4 * self.diameter, max: 0.6 * self.diameter };
        let fill = Fill {
            radii,
            amount: Amount::Count(self.grains),
            material: 0,
            materials: &materials,
            seed: self.seed,
        };
        Ok(random(&region, &fill, &mut unobserved)?)
    }

    pub(super) fn system(&self, particles: Particles<2>, scheme: SchemeName) -> Result<Coupled<2>> {
        let [width, height] = self.size.map(|size| size * self.diameter);
        let mesh = grid([width, height], self.squares)?;
        let mut set = FluidSet::new(FLUID, VISCOSITY);
        set.properties.gravity = Vec2::new(0.0, -GRAVITY);
        let corner = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(Vec2::from);
        let side = |k: usize| Wall::new("box", corner[k], corner[(k + 1) % 4]);
        let walls = (0..4).map(side).collect();
        let grains = Dem::new(particles, walls, vec![self.material()], Settings::default())?;
        let start = set.rest(&mesh, 0.0);
        set.with_grains(set.build(mesh, start)?, grains, set.laws(None), scheme)
    }

    fn follow(&self, mut system: Coupled<2>, dt: f64, until: Until) -> Result<End> {
        let terminal = self.terminal();
        let crossing = self.size[1] * self.diameter / terminal;
        let mut end = End {
            fastest: 0.0,
            height: 0.0,
            penetration: 0.0,
            defect: 0.0,
            last: 0.0,
            time: 0.0,
            particles: Particles::default(),
            tally: Tally::default(),
        };
        let places = |system: &Coupled<2>| {
            system.grains().map_or_else(Vec::new, |grains| grains.particles.position.clone())
        };
        let (mut moved, mut before) = (0.0, places(&system));
        loop {
            let report = system.step(dt)?;
            end.tally.add(&report);
            end.time += dt;
            end.defect = worse(end.defect, report.momentum_exchange_defect.unwrap_or(0.0));
            end.penetration =
                report.grains.map_or(0.0, |g| worse(end.penetration, g.max_penetration_over_radius));
            let now = places(&system);
            end.last = largest(now.iter().zip(&before).map(|(x, old)| (x - old).norm() / dt));
            before = now;
            let now = end.last;
            end.fastest = worse(end.fastest, now);
            if now > RUNAWAY * terminal {
                return Err(Error::run("the grains run away"));
            }
            if now > REST * terminal {
                moved = end.time;
            }
            let after = |time: f64| end.time >= time && end.tally.steps >= 10;
            let done = match until {
                Until::Time(time) => after(time),
                Until::Settled { time, speed } => after(time) && (now <= speed || end.time >= 2.0 * time),
                // At rest for as long as a lone grain takes through the box; or never.
                Until::Rest => end.time > moved + crossing || end.time > 100.0 * crossing,
            };
            if done {
                break;
            }
        }
        let grains = system.grains().ok_or_else(|| Error::run("no grains"))?;
        end.particles = grains.particles.clone();
        let places = &end.particles.position;
        end.height = places.iter().map(|x| x.y).sum::<f64>() / places.len() as f64;
        Ok(end)
    }

    /// With short steps until all rest; once for all points that ask.
    fn with_short_steps(&self) -> Result<Arc<End>> {
        static KNOWN: Mutex<BTreeMap<String, Arc<End>>> = Mutex::new(BTreeMap::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let name = format!("{self:?}");
        if let Some(end) = known.get(&name) {
            return Ok(end.clone());
        }
        let dt = 0.02 * self.diameter / self.terminal();
        let system = self.system(self.loose()?, SchemeName::default())?;
        let end = Arc::new(self.follow(system, dt, Until::Rest)?);
        known.insert(name, end.clone());
        Ok(end)
    }

    /// The suspensions that differ from this by the cloud they start from.
    fn each(&self) -> impl Iterator<Item = Self> {
        (0..self.packings).map(|k| Self { seed: self.seed + k, ..self.clone() })
    }

    fn settles(&self, step: f64, scheme: SchemeName, aim: Aim) -> Result<Sample> {
        let mut ends = vec![];
        for one in self.each() {
            let short = one.with_short_steps()?;
            let system = one.system(one.loose()?, scheme)?;
            let until = Until::Settled { time: short.time, speed: REST * short.fastest };
            ends.push((one.follow(system, step * one.relaxation(), until), short));
        }
        Ok(judge(ends, aim))
    }

    fn rests(&self, step: f64, scheme: SchemeName) -> Result<Sample> {
        let mut ends = vec![];
        for one in self.each() {
            let short = one.with_short_steps()?;
            let mut particles = short.particles.clone();
            particles.velocity.fill(Vec2::zeros());
            let dt = step * one.relaxation();
            ends.push((one.follow(one.system(particles, scheme)?, dt, Until::Time(50.0 * dt)), short));
        }
        Ok(judge(ends, Aim::Height))
    }
}

/// No grain faster than allowed, all at rest, forces and contacts sound, the bed as high. Runs that end early are
/// unstable.
fn judge(ends: Vec<(Result<End>, Arc<End>)>, aim: Aim) -> Sample {
    let (mut height, mut mean_speed) = (0.0, 0.0);
    let (mut speed, mut last, mut penetration, mut defect) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    let (mut tally, packings) = (Tally::default(), ends.len() as f64);
    let grains = ends.first().map_or(0, |(_, short)| short.particles.len()) as f64;
    for (end, short) in ends {
        let Ok(end) = end else { return Sample::new(Verdict::Unstable, f64::NAN, 1.0, Tally::default()) };
        height += end.height / short.height / packings;
        mean_speed += end.fastest / short.fastest / packings;
        speed = worse(speed, end.fastest / short.fastest);
        last = worse(last, end.last / short.fastest);
        penetration = worse(penetration, end.penetration);
        defect = worse(defect, end.defect);
        tally.join(&end.tally);
    }
    let sound = penetration <= PENETRATION && defect <= BALANCED;
    let (measured, same) = match aim {
        Aim::Height => {
            (height, (height - 1.0).abs() <= SAME * (MANY / grains).sqrt().max(1.0) && mean_speed <= FASTEST)
        }
        Aim::Speed => (speed, true),
    };
    let right = same && speed <= FASTEST_OF_ONE && sound && last <= REST;
    let verdict = if right { Verdict::Passes } else { Verdict::Wrong };
    let curves = vec![
        ("fastest grain / with short steps", 0.0, speed),
        ("the same, mean over the clouds", 0.0, mean_speed),
        ("height / with short steps", 0.0, height),
        ("fastest in the last step / with short steps", 0.0, last),
        ("largest penetration / radius", 0.0, penetration),
        ("momentum exchange defect", 0.0, defect),
    ];
    Sample { curves, ..Sample::new(verdict, measured, 1.0, tally) }
}

/// What a point measures.
#[derive(Clone, Copy)]
enum Aim {
    /// Mean height of the grains at the end.
    Height,
    /// Greatest speed on the way.
    Speed,
}
