//! A bed on its floor under an inflow: the pressure drop is that of the drag law until it carries the weight, whatever the step.
//!
//! The drop D of the drag law is that of the same grains held fast. The weight W is that of the grains less buoyancy, over
//! the width. `henry-free` gives (D + kappa W)/(1 + kappa) with kappa = beta dt/(eps^2 phi rho_p), and `henry` is unstable
//! when A (B - 1) > 2 (1 + B) (physics.md, section 5).

use super::axis::{Axis, Sample, Tally, Verdict, product};
use crate::models::{FluidSet, Vec2, grid};
use crate::verify::Effort;
use std::collections::VecDeque;
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Error, Result};
use voidage_dem::packing::{Amount, Fill, Lattice, Radii, Region, lattice};
use voidage_dem::{Dem, Load, Material, Motion, Particles, Settings, Wall};
use voidage_fluid::conditions::{FlowCondition, Prescribed};

/// That of the picture first: a run that is stopped has it.
const RATIOS: [f64; 4] = [0.3, 0.1, 0.6, 0.9];
const STEPS: [f64; 8] = [1e-3, 1e-2, 1e-1, 1.0, 10.0, 1e2, 1e3, 1e4];
const ALLOWED: f64 = 0.01;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "bed-gas",
        title: "Pressure drop of a bed at rest over min(drag law, weight): 55 um grains in gas",
        source: "physics.md, section 5",
        labels: ["inflow / fluidisation velocity", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| points(effort, &[1e-1, 1.0], 1.0),
        run: |point, scheme, _| GAS.run(point, scheme),
        theory: |point, scheme| GAS.theory(point, scheme),
    },
    Axis {
        name: "bed-liquid",
        title: "Pressure drop of a bed at rest over min(drag law, weight): 100 um grains in water",
        source: "physics.md, section 5",
        labels: ["inflow / fluidisation velocity", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| points(effort, &[1e-1, 10.0], 100.0),
        run: |point, scheme, _| LIQUID.run(point, scheme),
        theory: |point, scheme| LIQUID.theory(point, scheme),
    },
];

/// Above fluidisation up to the step in which a grain of the bed rises by about a diameter: beyond, there is no bed to speak of.
fn points(effort: Effort, few: &[f64], longest: f64) -> Vec<[f64; 2]> {
    match effort {
        Effort::Quick => product(&[0.3], few),
        Effort::Full => {
            let rising = STEPS.iter().filter(|step| **step <= longest).copied().collect::<Vec<_>>();
            [product(&RATIOS, &STEPS), product(&[1.2, 1.5], &rising)].concat()
        }
    }
}

/// Grains and fluid of a bed.
pub(super) struct Bed {
    pub fluid: f64,
    viscosity: f64,
    pub solid: f64,
    pub diameter: f64,
}

pub(super) const GAS: Bed = Bed { fluid: 1.204, viscosity: 2e-5, solid: 3200.0, diameter: 55e-6 };
pub(super) const LIQUID: Bed = Bed { fluid: 998.0, viscosity: 1e-3, solid: 2650.0, diameter: 100e-6 };

const GRAVITY: f64 = 9.81;
/// Of the contacts, at most.
const TOLERANCE: f64 = 1e-6;
/// Speed of a grain, m/s, at which a bed counts as blown apart: the terminal velocities are below 0.3.
const RUNAWAY: f64 = 30.0;
/// Steps between looks at the pressure drop, and its relative change from look to look below which, three times, it
/// counts as steady: nothing more will happen.
const LOOK: usize = 50;
const STEADY: f64 = 1e-6;
/// Steps over which the drop of a bed at rest is averaged at most.
const WINDOW: usize = 50;
/// Steps in which a bed comes to rest.
const SETTLING: usize = 300;
/// Height of the bed in diameters.
const ROWS: f64 = 9.0;
/// Width and height of the box, and side of the squares of the mesh, in diameters.
const WIDTH: usize = 14;
const HEIGHT: usize = 32;
/// Height of the floor above the inflow, in diameters: the pressure on the inflow is uniform there, whatever the mesh makes of
/// the voidage on the floor.
const FLOOR: f64 = 4.0;
const SQUARE: usize = 1;

/// A bed as it lies, and the numbers that follow from its mean voidage.
pub(super) struct Lying {
    pub particles: Particles<2>,
    pub material: Material,
    /// Mean voidage.
    pub voidage: f64,
    /// Fluidisation velocity, m/s.
    pub fluidisation: f64,
    /// W, Pa.
    pub weight: f64,
}

impl Bed {
    /// Width of the box, m.
    pub fn width(&self) -> f64 {
        WIDTH as f64 * self.diameter
    }

    /// gamma / V at a superficial velocity.
    pub fn drag(&self, speed: f64, voidage: f64) -> f64 {
        let around = Surroundings {
            slip: speed / voidage,
            voidage,
            diameter: self.diameter,
            density: self.fluid,
            viscosity: self.viscosity,
        };
        self.set().laws(None).drag.coefficient(&around, VoidageFunction::None)
    }

    fn set(&self) -> FluidSet {
        let mut set = FluidSet::new(self.fluid, self.viscosity);
        // Else the pressure stabilisation, and with it the drop of the drag law on this mesh, depends on the step.
        set.properties.drag_in_stabilisation = true;
        set.flow("left", FlowCondition::Slip)
            .flow("right", FlowCondition::Slip)
            .flow("top", FlowCondition::Open { pressure: 0.0 })
    }

    /// Gravity less buoyancy, so that the pressure is that of the flow alone.
    fn gravity(&self) -> f64 {
        GRAVITY * (1.0 - self.fluid / self.solid)
    }

    pub fn lie(&self) -> Result<Lying> {
        let material = Material { density: self.solid, friction: 0.3, solidity: 0.65, ..Material::default() };
        let (width, d) = (self.width(), self.diameter);
        let floor = FLOOR * d;
        // Rows that touch the side walls: no grain rattles, which would be lifted alone.
        let region = Region { low: Vec2::new(0.0, floor), high: Vec2::new(width, floor + ROWS * d) };
        let materials = std::slice::from_ref(&material);
        let radii = Radii::Constant(0.5 * d * (1.0 - 1e-9));
        let fill = Fill { radii, amount: Amount::Fill, material: 0, materials, seed: 0 };
        let loose = lattice(&region, Lattice::Triangular, 1.0, &fill)?;
        let mut dry = self.grains(loose, &material, TOLERANCE)?;
        // At rest for good: in steps of free fall over a tenth of a diameter.
        let step = (0.2 * d / self.gravity()).sqrt();
        for _ in 0..SETTLING {
            dry.step(step, &Load::default());
        }
        dry.particles.velocity.fill(Vec2::zeros());
        dry.particles.rotation.iter_mut().for_each(|rotation| rotation.spin.fill(0.0));
        let particles = dry.particles;
        let height = particles.position.iter().fold(0.0, |top: f64, x| top.max(x.y + 0.5 * d)) - floor;
        let voidage = 1.0 - particles.volume.iter().sum::<f64>() / (width * height);
        let weight = particles.mass.iter().sum::<f64>() * self.gravity() / width;
        let drop =
            |speed: f64| (1.0 - voidage) * self.drag(speed, voidage) * speed / (voidage * voidage) * height;
        let (mut low, mut high) = (0.0, 10.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if drop(middle) < weight { low = middle } else { high = middle }
        }
        Ok(Lying { particles, material, voidage, fluidisation: low, weight })
    }

    fn grains(&self, particles: Particles<2>, material: &Material, tolerance: f64) -> Result<Dem<2>> {
        let [width, floor, height] = [WIDTH as f64, FLOOR, HEIGHT as f64].map(|share| share * self.diameter);
        let corner = |x: f64, y: f64| Vec2::new(x, y);
        let walls = [
            [corner(0.0, floor), corner(width, floor)],
            [corner(0.0, floor), corner(0.0, height)],
            [corner(width, floor), corner(width, height)],
        ];
        let wall = |points| Wall {
            name: "box".into(),
            points,
            friction: 0.0,
            restitution: 0.0,
            motion: Motion::Fixed,
            temperature: None,
            conductivity: None,
        };
        let settings =
            Settings { gravity: Vec2::new(0.0, -self.gravity()), tolerance, ..Settings::default() };
        Ok(Dem::new(particles, walls.map(wall).to_vec(), vec![material.clone()], settings)?)
    }

    /// The grains in the fluid, free or held; `tolerance` is that of the contacts.
    pub fn system(
        &self,
        (particles, material): (&Particles<2>, &Material),
        speed: f64,
        scheme: SchemeName,
        (held, tolerance): (bool, f64),
    ) -> Result<Coupled<2>> {
        let set = self
            .set()
            .flow("bottom", FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::new(0.0, speed))));
        let d = self.diameter;
        let (width, height) = (self.width(), HEIGHT as f64 * d);
        let mesh = grid([width, height], [WIDTH / SQUARE, HEIGHT / SQUARE])?;
        let start = set.rest(&mesh, 0.0);
        let mut particles = particles.clone();
        if held {
            particles.mass.fill(f64::INFINITY);
            particles.velocity.fill(Vec2::zeros());
        }
        let grains = self.grains(particles, material, tolerance)?;
        set.with_grains(set.build(mesh, start)?, grains, set.laws(None), scheme)
    }

    /// Pressure drop beyond the weight of the bed, Pa, by the balance of momentum, where the upward momentum of the grains grows
    /// by `gain` and their floor carries `floor` (N per metre of depth): the flow through the bed being given, the fluid
    /// slows down where the grains speed up.
    pub fn lifted(&self, gain: f64, floor: f64) -> f64 {
        (gain * (1.0 - self.fluid / self.solid) - floor) / self.width()
    }

    /// A number of steps, or until the pressure drop is steady: means over the last `window`, and the grains as they were before
    /// the last.
    pub fn last(&self, system: &mut Coupled<2>, dt: f64, (steps, window): (usize, usize)) -> Result<Last> {
        let mut last = Last::default();
        let mut kept = VecDeque::with_capacity(window + 1);
        let (mut steady, mut drop) = (0, f64::NAN);
        for step in 1..=steps {
            let mut before = 0.0;
            if let Some(grains) = &system.grains {
                before = momentum(&grains.particles);
                last.before = grains.particles.clone();
            }
            last.tally.add(&system.step(dt)?);
            let now = pressure_drop(system)?;
            let floor = system.grains.as_ref().map_or(0.0, |grains| -grains.wall_force()[0].y);
            kept.push_back([now, floor, before]);
            if kept.len() > window {
                kept.pop_front();
            }
            let fastest = system.grains.iter().flat_map(|grains| &grains.particles.velocity);
            if fastest.fold(0.0, |most: f64, v| most.max(v.norm())) > RUNAWAY {
                return Err(Error::Run("the grains run away".into()));
            }
            if step % LOOK == 0 {
                steady = if (now - drop).abs() <= STEADY * now.abs() { steady + 1 } else { 0 };
                drop = now;
            }
            if steady == 3 {
                break;
            }
        }
        let count = kept.len() as f64;
        last.drop = kept.iter().map(|[drop, ..]| drop).sum::<f64>() / count;
        let floor = kept.iter().map(|[_, floor, _]| floor).sum::<f64>() / count;
        let after = system.grains.as_ref().map_or(0.0, |grains| momentum(&grains.particles));
        let gain = (after - kept.front().map_or(0.0, |first| first[2])) / (count * dt);
        last.lifted = self.lifted(gain, floor);
        Ok(last)
    }

    fn run(&self, [ratio, step]: [f64; 2], scheme: SchemeName) -> Result<Sample> {
        let lying = self.lie()?;
        let speed = ratio * lying.fluidisation;
        let relaxation = self.solid / self.drag(speed, lying.voidage);
        // What the contacts leave unsolved must not carry a grain by more than a thousandth of its diameter.
        let fall = self.gravity() * relaxation * step.min(1.0) * relaxation * step;
        let tolerance = (1e-3 * self.diameter / fall).clamp(1e-12, TOLERANCE);
        let mut free = self.system((&lying.particles, &lying.material), speed, scheme, (false, tolerance))?;
        let least = if step < 10.0 || ratio > 1.0 { 40.0 } else { 16.0 };
        let steps = (5.0 / step).ceil().clamp(least, 5000.0) as usize;
        let lost = Sample::new(Verdict::Unstable, f64::NAN, 1.0, Tally::default());
        // Below fluidisation to even out the speeds that contacts solved to a tolerance leave, which short steps show as
        // noise; above it what is carried from step to step.
        let window = if ratio < 1.0 { WINDOW.min(steps / 4) } else { steps / 5 };
        let Ok(end) = self.last(&mut free, step * relaxation, (steps, window)) else { return Ok(lost) };
        let mut held = self.system((&end.before, &lying.material), speed, scheme, (true, tolerance))?;
        // With the same step, on which the pressure stabilisation depends where drag acts more slowly than it.
        let law = self.last(&mut held, step * relaxation, (steps, 1))?.drop;
        // A bed in motion takes its weight and what its momentum grows by, whatever the law for grains at rest.
        let carried = if ratio > 1.0 { lying.weight + end.lifted } else { law.min(lying.weight) };
        let measured = end.drop / carried;
        let sample = Sample::judge(measured.abs() < 1e3, measured, 1.0, ALLOWED, end.tally);
        let curves = vec![
            ("pressure drop / weight", 0.0, end.drop / lying.weight),
            ("drag law / weight", 0.0, law / lying.weight),
            ("voidage", 0.0, lying.voidage),
        ];
        Ok(Sample { curves, ..sample })
    }

    /// Whether a scheme should pass; none where there is no theory.
    fn theory(&self, [ratio, step]: [f64; 2], scheme: SchemeName) -> Option<bool> {
        let voidage = 0.5;
        let a = step * (1.0 - voidage) * self.solid / (voidage * self.fluid);
        match scheme {
            SchemeName::Anchored | SchemeName::Iterated => Some(true),
            SchemeName::Henry => Some(a * (step - 1.0) <= 2.0 * (1.0 + step)),
            SchemeName::HenryFree if ratio < 1.0 => {
                let kappa = step / (voidage * voidage);
                let wrong = (1.0 + kappa / ratio) / (1.0 + kappa) - 1.0;
                Some(wrong.abs() <= ALLOWED)
            }
            _ => None,
        }
    }
}

/// How a run ends.
#[derive(Default)]
pub(super) struct Last {
    /// Mean pressure drop, Pa.
    pub drop: f64,
    /// What the bed took beyond its weight, Pa; see [`Bed::lifted`].
    pub lifted: f64,
    pub tally: Tally,
    /// The grains before the last step, where the fluid saw them.
    pub before: Particles<2>,
}

/// Upward momentum of the grains, kg m/s.
pub(super) fn momentum(particles: &Particles<2>) -> f64 {
    particles.mass.iter().zip(&particles.velocity).map(|(mass, v)| mass * v.y).sum()
}

/// What the fluid is pushed up by at the bottom, over its width, beyond the open top, where the pressure is zero, Pa.
///
/// Tested with a velocity that is one everywhere but on the inflow, the momentum equation says that this is the mean pressure of
/// the cells there. The pressures on the nodes of the inflow are not: with steps much shorter than h^2 / nu the pressure
/// stabilisation, which grows as the step does, leaves them to alternate from row to row.
pub(super) fn pressure_drop(system: &mut Coupled<2>) -> Result<f64> {
    let Some(fluid) = &mut system.fluid else { return Ok(f64::NAN) };
    let fields = fluid.backend.fields()?;
    let mesh = &fluid.mesh;
    let (low, high) = mesh.bounds();
    let row = low.y + (high.y - low.y) * SQUARE as f64 / HEIGHT as f64;
    let (mut sum, mut area) = (0.0, 0.0);
    for cell in (0..mesh.cell_count()).filter(|&cell| mesh.centroid(cell).y < row) {
        let nodes = mesh.cell(cell);
        let mean = nodes.iter().map(|&a| fields.pressure[a as usize]).sum::<f64>() / nodes.len() as f64;
        sum += mesh.measure(cell) * mean;
        area += mesh.measure(cell);
    }
    Ok(sum / area)
}
