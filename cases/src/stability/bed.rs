//! A bed on its floor under an inflow: the pressure drop is that of the drag law until it carries the weight, whatever the step.
//!
//! The drop D of the drag law is that of the same grains held fast. The weight W is that of the grains less buoyancy, over
//! the width. `henry-free` gives (D + kappa W)/(1 + kappa) with kappa = beta dt/(eps^2 phi rho_p), and `henry` is unstable
//! when A (B - 1) > 2 (1 + B) (physics.md, section 5).

use super::axis::{Axis, Sample, Verdict, product};
use crate::models::{FluidSet, Vec2, grid};
use crate::verify::Effort;
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Error, Result};
use voidage_dem::packing::{Amount, Fill, Lattice, Radii, Region, lattice};
use voidage_dem::{Dem, Load, Material, Motion, Particles, Settings, Wall};
use voidage_fluid::conditions::{FlowCondition, Prescribed};

const RATIOS: [f64; 4] = [0.1, 0.3, 0.6, 0.9];
const STEPS: [f64; 8] = [1e-3, 1e-2, 1e-1, 1.0, 10.0, 1e2, 1e3, 1e4];
const ALLOWED: f64 = 0.01;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "bed-gas",
        title: "Pressure drop of a bed at rest over min(drag law, weight): 55 um grains in gas",
        source: "physics.md, section 5",
        labels: ["inflow / fluidisation velocity", "step / relaxation time of the grain"],
        points: |effort| points(effort, &[1e-1, 1.0], 1.0),
        run: |point, scheme, _| GAS.run(point, scheme),
        theory: |point, scheme| GAS.theory(point, scheme),
    },
    Axis {
        name: "bed-liquid",
        title: "Pressure drop of a bed at rest over min(drag law, weight): 100 um grains in water",
        source: "physics.md, section 5",
        labels: ["inflow / fluidisation velocity", "step / relaxation time of the grain"],
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
struct Bed {
    fluid: f64,
    viscosity: f64,
    solid: f64,
    diameter: f64,
}

const GAS: Bed = Bed { fluid: 1.204, viscosity: 2e-5, solid: 3200.0, diameter: 55e-6 };
const LIQUID: Bed = Bed { fluid: 998.0, viscosity: 1e-3, solid: 2650.0, diameter: 100e-6 };

const GRAVITY: f64 = 9.81;
/// Of the contacts, at most.
const TOLERANCE: f64 = 1e-6;
/// Speed of a grain, m/s, at which a bed counts as blown apart: the terminal velocities are below 0.3.
const RUNAWAY: f64 = 30.0;
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
struct Lying {
    particles: Particles<2>,
    material: Material,
    /// Mean voidage.
    voidage: f64,
    /// Fluidisation velocity, m/s.
    fluidisation: f64,
    /// W, Pa.
    weight: f64,
}

impl Bed {
    /// gamma / V at a superficial velocity.
    fn drag(&self, speed: f64, voidage: f64) -> f64 {
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

    fn lie(&self) -> Result<Lying> {
        let material = Material { density: self.solid, friction: 0.3, solidity: 0.65, ..Material::default() };
        let (width, d) = (WIDTH as f64 * self.diameter, self.diameter);
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
    fn system(
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
        let (width, height) = (WIDTH as f64 * d, HEIGHT as f64 * d);
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

    /// A number of steps: means over the last fifth of them, and the grains as they were before the last.
    fn end(&self, system: &mut Coupled<2>, dt: f64, steps: usize) -> Result<End> {
        let mut end = End::default();
        let window = steps.div_ceil(5);
        let mut momentum_before = 0.0;
        for step in 1..=steps {
            let averaged = step + window > steps;
            if let Some(grains) = &system.grains {
                if step + window == steps + 1 {
                    momentum_before = momentum(&grains.particles);
                }
                if step == steps {
                    end.before = grains.particles.clone();
                }
            }
            let report = system.step(dt)?;
            end.solves += report.agreement.map_or(1, |agreement| agreement.solves) as f64 / steps as f64;
            if averaged {
                end.drop += pressure_drop(system)? / window as f64;
            }
            let Some(grains) = &system.grains else { continue };
            if averaged {
                end.floor -= grains.wall_force()[0].y / window as f64;
            }
            if grains.particles.velocity.iter().any(|v| v.norm() > RUNAWAY) {
                return Err(Error::Run("the grains run away".into()));
            }
        }
        let momentum = system.grains.as_ref().map_or(0.0, |grains| momentum(&grains.particles));
        end.gain = (momentum - momentum_before) / (window as f64 * dt);
        Ok(end)
    }

    fn run(&self, [ratio, step]: [f64; 2], scheme: SchemeName) -> Result<Sample> {
        let lying = self.lie()?;
        let speed = ratio * lying.fluidisation;
        let relaxation = self.solid / self.drag(speed, lying.voidage);
        // What the contacts leave unsolved must not carry a grain by more than a thousandth of its diameter.
        let fall = self.gravity() * relaxation * step.min(1.0) * relaxation * step;
        let tolerance = (1e-3 * self.diameter / fall).clamp(1e-12, TOLERANCE);
        let mut free = self.system((&lying.particles, &lying.material), speed, scheme, (false, tolerance))?;
        let least = if ratio > 1.0 { 40.0 } else { 10.0 };
        let steps = (5.0 / step).ceil().clamp(least, 5000.0) as usize;
        let lost = Sample { verdict: Verdict::Unstable, measured: f64::NAN, expected: 1.0, solves: 1.0 };
        let Ok(end) = self.end(&mut free, step * relaxation, steps) else { return Ok(lost) };
        let width = WIDTH as f64 * self.diameter;
        let carried = match ratio > 1.0 {
            // A bed in motion takes its weight and what its momentum and that of the fluid grow by; the flow through it
            // being given, the fluid slows down where the grains speed up.
            true => lying.weight + (end.gain * (1.0 - self.fluid / self.solid) - end.floor) / width,
            false => {
                let grains = (&end.before, &lying.material);
                let mut held = self.system(grains, speed, scheme, (true, tolerance))?;
                self.end(&mut held, step * relaxation, steps)?.drop.min(lying.weight)
            }
        };
        let measured = end.drop / carried;
        Ok(Sample::judge(measured.abs() < 1e3, measured, 1.0, ALLOWED, end.solves))
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
struct End {
    /// Pressure drop, Pa.
    drop: f64,
    /// Growth of the grains' upward momentum per time, N/m.
    gain: f64,
    /// Force on the floor, N/m.
    floor: f64,
    /// Solutions of the fluid per step.
    solves: f64,
    /// The grains before the last step, where the fluid saw them.
    before: Particles<2>,
}

/// Upward momentum of the grains, kg m/s.
fn momentum(particles: &Particles<2>) -> f64 {
    particles.mass.iter().zip(&particles.velocity).map(|(mass, v)| mass * v.y).sum()
}

/// Mean pressure on the bottom less that on the top, Pa.
fn pressure_drop(system: &mut Coupled<2>) -> Result<f64> {
    let Some(fluid) = &mut system.fluid else { return Ok(f64::NAN) };
    let fields = fluid.backend.fields()?;
    let (low, high) = fluid.mesh.bounds();
    let mean = |y: f64| {
        let at = fluid.mesh.points.iter().zip(&fields.pressure);
        let row: Vec<f64> =
            at.filter(|(x, _)| (x.y - y).abs() < 1e-9 * (high.y - low.y)).map(|(_, p)| *p).collect();
        row.iter().sum::<f64>() / row.len() as f64
    };
    Ok(mean(low.y) - mean(high.y))
}
