//! Contacts alone: heavy lids on light grains, friction, sizes far apart.
//!
//! A point passes when no grain penetrates another by more than a hundredth of its radius, in any step, and energy does
//! not grow. All with as many sweeps as by default. Steps whose forces are not solved say so, which the table counts:
//! with strong friction they are many.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use voidage_campaign::{Effort, largest, worse};
use voidage_coupling::{Result, StepReport};
use voidage_dem::packing::{self, Amount, Fill, Radii, Region};
use voidage_dem::{Dem, Load, Material, Particles, Settings, Wall};
use voidage_verification::models::Vec2;

const GRAVITY: f64 = 9.81;
/// Diameter of the grains, m, and step, s: free fall over a hundredth of the diameter.
const DIAMETER: f64 = 1e-3;
const STEP: f64 = 1e-3;
/// Penetration over the radius of the smaller grain that passes.
const PENETRATION: f64 = 1e-2;

/// Of the stack. Errors are judged beside the forces of the heavy lid: with 1e-4 discs of a thousandth of its mass
/// tremble by the speed that a step of free fall gives.
const TOLERANCE: f64 = 1e-6;

const MASSES: [f64; 7] = [1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6];

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "stack",
        title: "Discs under a heavy lid: largest penetration / radius",
        source: "grains do not penetrate",
        labels: ["discs below the lid", "mass of the lid / of a disc"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => product(&[10.0, 100.0], &[1.0, 1e6]),
            Effort::Full => product(&[1.0, 10.0, 30.0, 100.0], &MASSES),
        },
        run: |[count, mass], _, effort| stack(count as usize, mass, effort.pick(20, 100)),
        theory: |_, _| None,
    },
    Axis {
        name: "friction",
        title: "Grains with every fifth heavy, poured on a floor: largest penetration / radius",
        source: "grains do not penetrate",
        labels: ["friction", "mass ratio"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => vec![[0.0, 1.0], [10.0, 1.0], [10.0, 10.0], [0.0, 1e3], [0.3, 1e6], [10.0, 1e6]],
            Effort::Full => product(&[0.0, 0.1, 0.3, 1.0, 3.0, 10.0], &MASSES),
        },
        run: |[friction, mass], _, effort| {
            let count = effort.pick(100, 400);
            let mut particles = loose(vec![0.5 * DIAMETER; count], friction)?;
            particles.mass.iter_mut().step_by(5).for_each(|m| *m *= mass);
            pour(particles, friction, effort.pick(200, 800))
        },
        theory: |_, _| None,
    },
    Axis {
        name: "polydispersity",
        title: "Small grains on a floor, large ones on them, half of the solid each: largest penetration / radius",
        source: "grains do not penetrate",
        labels: ["large diameter / small diameter", "friction"],
        coupled: false,
        points: |effort| match effort {
            Effort::Quick => product(&[10.0, 100.0], &[0.3]),
            Effort::Full => product(&[1.0, 3.0, 10.0, 30.0, 100.0], &[0.1, 0.3, 1.0, 10.0]),
        },
        run: |[ratio, friction], _, effort| {
            pour(two_sizes(ratio, effort.pick(200, 2000), friction)?, friction, effort.pick(200, 800))
        },
        theory: |_, _| None,
    },
];

/// What must hold in all steps.
#[derive(Default)]
struct Watch {
    penetration: f64,
    tally: Tally,
}

impl Watch {
    fn step(&mut self, dem: &mut Dem<2>) -> bool {
        let grains = dem.step(STEP, &Load::default());
        self.tally.add(&StepReport { grains: Some(grains), ..StepReport::default() });
        self.penetration = worse(self.penetration, grains.max_penetration_over_radius);
        grains.converged
    }

    fn sample(self, bounded: bool) -> Sample {
        let verdict = match (bounded, self.penetration <= PENETRATION) {
            (false, _) => Verdict::Unstable,
            (true, true) => Verdict::Passes,
            (true, false) => Verdict::Wrong,
        };
        Sample::new(verdict, self.penetration, f64::NAN, self.tally)
    }
}

/// Discs in a column and one on top of them that is heavier.
fn stack(count: usize, mass: f64, steps: usize) -> Result<Sample> {
    let radius = 0.5 * DIAMETER;
    let places = (0..=count).map(|k| Vec2::new(0.0, radius + k as f64 * DIAMETER)).collect();
    let material = Material::default();
    let mut particles = voidage_verification::models::alike(places, radius, &material)?;
    particles.mass[count] *= mass;
    let weight = particles.mass.iter().sum::<f64>() * GRAVITY;
    let floor = Wall::new("floor", Vec2::new(-1.0, 0.0), Vec2::new(1.0, 0.0));
    let settings = Settings { tolerance: TOLERANCE, interior: true, ..Settings::default() };
    let mut dem = Dem::new(particles, vec![floor], vec![material], settings)?;
    let (mut watch, mut wrong) = (Watch::default(), 0.0f64);
    for _ in 0..steps {
        if watch.step(&mut dem) {
            wrong = worse(wrong, (-dem.wall_force()[0].y / weight - 1.0).abs());
        }
    }
    let fastest = largest(dem.particles.velocity.iter().map(|v| v.norm()));
    let sample = watch.sample(fastest < GRAVITY * STEP);
    Ok(Sample { curves: vec![("largest error of the floor's force where solved", 0.0, wrong)], ..sample })
}

/// Small grains, and above them large ones with as much solid, but one at least.
fn two_sizes(ratio: f64, most: usize, friction: f64) -> Result<Particles<2>> {
    let large = ((most as f64 / (1.0 + ratio * ratio)).round() as usize).max(1);
    let small = ((large as f64 * ratio * ratio) as usize).min(most);
    let width = width(&[vec![0.5 * DIAMETER; small], vec![0.5 * DIAMETER * ratio; large]].concat());
    let (mut position, mut radii, mut floor) = (Vec::new(), Vec::new(), 0.0);
    for (count, radius) in [(small, 0.5 * DIAMETER), (large, 0.5 * DIAMETER * ratio)] {
        let columns = ((width / (2.2 * radius)) as usize).max(1);
        let cell = width / columns as f64;
        for k in 0..count {
            // Rows are shifted against each other by less than the room in a cell, so that columns do not stand.
            let shift = 0.15 * radius * (7.0 * k as f64).sin();
            let x = (k % columns) as f64 * cell
                + 0.5 * cell
                + shift.clamp(radius - 0.5 * cell, 0.5 * cell - radius);
            position.push(Vec2::new(x, floor + ((k / columns) as f64 * 2.2 + 1.1) * radius));
            radii.push(radius);
        }
        floor += count.div_ceil(columns) as f64 * 2.2 * radius;
    }
    let count = radii.len();
    Ok(Particles::new(position, radii, vec![0; count], &[Material { friction, ..Material::default() }])?
        .rotating())
}

/// Of a box for these grains, m.
fn width(radii: &[f64]) -> f64 {
    let area: f64 = radii.iter().map(|r| 4.0 * r * r).sum();
    area.sqrt().max(3.0 * radii.iter().copied().fold(0.0, f64::max))
}

/// Grains on a loose lattice with jitter, before they fall.
fn loose(radii: Vec<f64>, friction: f64) -> Result<Particles<2>> {
    let materials = [Material { friction, ..Material::default() }];
    let (count, width) = (radii.len(), width(&radii));
    let region = Region { low: Vec2::zeros(), high: Vec2::new(width, width) };
    let fill = Fill {
        radii: Radii::List(radii),
        amount: Amount::Count(count),
        material: 0,
        materials: &materials,
        seed: 3,
    };
    Ok(packing::loose(&region, &fill)?.rotating())
}

/// Pours grains in a closed box, so that one squeezed out between heavy ones flies no further than its lid; energy must
/// not grow.
fn pour(particles: Particles<2>, friction: f64, steps: usize) -> Result<Sample> {
    let material = Material { friction, ..Material::default() };
    let (width, largest) = (width(&particles.radius), particles.radius.iter().copied().fold(0.0, f64::max));
    let top = particles.position.iter().fold(0.0, |top: f64, x| top.max(x.y)) + 2.0 * largest;
    let corner = |x: f64, y: f64| Vec2::new(x, y);
    let wall = |a, b| Wall { friction, ..Wall::new("box", a, b) };
    let walls = vec![
        wall(corner(0.0, 0.0), corner(width, 0.0)),
        wall(corner(0.0, 0.0), corner(0.0, top)),
        wall(corner(width, 0.0), corner(width, top)),
        wall(corner(0.0, top), corner(width, top)),
    ];
    let settings = Settings { interior: true, ..Settings::default() };
    let mut dem = Dem::new(particles, walls, vec![material], settings)?;
    let (mut watch, start, mut bounded) = (Watch::default(), energy(&dem.particles), true);
    for _ in 0..steps {
        watch.step(&mut dem);
        bounded &= energy(&dem.particles) <= start * (1.0 + 1e-9);
    }
    Ok(watch.sample(bounded))
}

/// Kinetic and potential, J.
fn energy(particles: &Particles<2>) -> f64 {
    let each = particles.mass.iter().zip(&particles.velocity).zip(&particles.position);
    each.map(|((mass, v), x)| mass * (0.5 * v.norm_squared() + GRAVITY * x.y)).sum()
}
