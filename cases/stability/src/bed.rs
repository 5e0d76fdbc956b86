//! A bed on its floor under an inflow: the pressure drop is that of the drag law until it carries the weight, whatever
//! the step.
//!
//! The drop D of the drag law is that of the same grains held fast. The weight W is that of the grains less buoyancy,
//! over the width. Where the law differs from row to row, as it does by the nodes' share of the bed's surface, or where
//! short steps let the pressures alternate, rows rise before the bed does, and min(D, W) holds for what lies above each
//! height ([`Bed::law`]). The drop is taken from the balance of momentum: it is what the fluid carries of the grains,
//! per width, less what it gives up of its own momentum. The pressures on the nodes of the inflow are not that: with
//! steps much shorter than h^2 / nu the pressure stabilisation, which shrinks as the step does, leaves them to
//! alternate from row to row (by 1.6 % of the weight in water with dt/tau = 1e-3). `henry-free` gives
//! (D + kappa W)/(1 + kappa) with kappa = beta dt/(eps^2 phi rho_p), and `henry` is unstable when
//! A (B - 1) > 2 (1 + B): see `voidage_coupling::scheme::henry`.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use std::collections::VecDeque;
use tracing::warn;
use voidage_campaign::Effort;
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Error, Result};
use voidage_dem::packing::{Amount, Fill, Lattice, Radii, Region, lattice};
use voidage_dem::{Dem, Load, Material, Particles, Settings, Wall};
use voidage_fluid::conditions::{FlowCondition, Prescribed};
use voidage_verification::models::{FluidSet, Vec2, bisect, grid};

/// That of the picture first: a run that is stopped has it.
const RATIOS: [f64; 4] = [0.3, 0.1, 0.6, 0.9];
const STEPS: [f64; 8] = [1e-3, 1e-2, 1e-1, 1.0, 10.0, 1e2, 1e3, 1e4];
const ALLOWED: f64 = 0.01;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "bed-gas",
        title: "Pressure drop of a bed at rest over min(drag law, weight): 55 um grains in gas",
        source: "a bed at rest: the drag law, up to the weight",
        labels: ["inflow / fluidisation velocity", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| points(effort, &[1e-1, 1.0], 1.0),
        run: |point, scheme, _| GAS.at(point).run(point, scheme),
        theory: |point, scheme| GAS.theory(point, scheme),
    },
    Axis {
        name: "bed-liquid",
        title: "Pressure drop of a bed at rest over min(drag law, weight): 100 um grains in water",
        source: "a bed at rest: the drag law, up to the weight",
        labels: ["inflow / fluidisation velocity", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| points(effort, &[1e-1, 10.0], 100.0),
        run: |point, scheme, _| LIQUID.at(point).run(point, scheme),
        theory: |point, scheme| LIQUID.theory(point, scheme),
    },
];

/// Above fluidisation up to the step in which a grain of the bed rises by about a diameter: beyond, there is no bed to
/// speak of.
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
#[derive(Clone, Copy)]
pub(super) struct Bed {
    /// Height, in diameters.
    rows: usize,
    /// Height of one above fluidisation. What lies on the floor and rains on it when a bed leaves it are some grains in
    /// all: of 126 in water two are more than a hundredth. In gas, with steps of one relaxation time, the weight of
    /// some nine lies between what such grains would press on the floor with at rest, which is what is expected, and
    /// what they land on it with.
    high: usize,
    pub fluid: f64,
    viscosity: f64,
    pub solid: f64,
    pub diameter: f64,
}

pub(super) const GAS: Bed =
    Bed { rows: 9, high: 108, fluid: 1.204, viscosity: 2e-5, solid: 3200.0, diameter: 55e-6 };
pub(super) const LIQUID: Bed =
    Bed { rows: 9, high: 27, fluid: 998.0, viscosity: 1e-3, solid: 2650.0, diameter: 100e-6 };

const GRAVITY: f64 = 9.81;
/// Of the contacts, at most.
const TOLERANCE: f64 = 1e-6;
/// Sub-steps: a step of 1e4 relaxation times would take thousands if nothing held the grains, but these lie on each
/// other.
const SUBSTEPS: usize = 100;
/// Speed of a grain, m/s, at which a bed counts as blown apart: the terminal velocities are below 0.3.
const RUNAWAY: f64 = 30.0;
/// Steps between looks at the pressure drop, and its relative change from look to look below which, three times, it
/// counts as steady: nothing more will happen.
const LOOK: usize = 50;
const STEADY: f64 = 1e-6;
/// Steps in which a bed comes to rest.
const SETTLING: usize = 300;
/// How often the fluidisation velocity is corrected by the drop on the mesh, and with which step over the relaxation
/// time.
const REFINED: usize = 3;
const LONG: f64 = 10.0;
/// How far a bed above fluidisation may have risen at the end, in diameters, and the fewest steps. One that rises
/// further breaks up: a slug, grains that rain from it, and what it has left behind.
const LIFTED: f64 = 0.5;
const FEWEST: f64 = 5.0;
/// Width of the box, room above the bed, and side of the squares of the mesh, in diameters.
const WIDTH: usize = 14;
const ROOM: usize = 19;
const SQUARE: usize = 1;

/// A bed as it lies, and the numbers that follow from its mean voidage.
pub(super) struct Lying {
    pub particles: Particles<2>,
    pub material: Material,
    /// Mean voidage.
    pub voidage: f64,
    /// Inflow at which the drop of the drag law is the weight, on the mesh, m/s.
    pub fluidisation: f64,
    /// W, Pa.
    pub weight: f64,
}

impl Bed {
    /// The bed with another height, in diameters.
    pub fn of_rows(self, rows: usize) -> Self {
        Self { rows, ..self }
    }

    /// Width and height of the box, in diameters.
    fn size(&self) -> [usize; 2] {
        [WIDTH, self.rows + ROOM]
    }

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

    /// Relaxation time of the grains of a bed at its fluidisation, s.
    pub fn relaxation(&self, lying: &Lying) -> f64 {
        self.solid / self.drag(lying.fluidisation, lying.voidage)
    }

    /// The fluid, with sides that slip and an open top.
    pub fn set(&self) -> FluidSet {
        let set = FluidSet::new(self.fluid, self.viscosity);
        set.flow("left", FlowCondition::Slip)
            .flow("right", FlowCondition::Slip)
            .flow("top", FlowCondition::Open { pressure: 0.0 })
    }

    /// Gravity less buoyancy, so that the pressure is that of the flow alone, m/s2.
    pub fn gravity(&self) -> f64 {
        GRAVITY * (1.0 - self.fluid / self.solid)
    }

    /// The bed at rest. With a `seed` its grains differ by a thousandth in size, enough for beds of different seeds to
    /// move in different ways.
    pub fn lie(&self, seed: Option<u64>) -> Result<Lying> {
        let material = Material { density: self.solid, friction: 0.3, solidity: 0.65, ..Material::default() };
        let (width, d) = (self.width(), self.diameter);
        // Rows that touch the side walls: no grain rattles, which would be lifted alone.
        let region = Region { low: Vec2::zeros(), high: Vec2::new(width, self.rows as f64 * d) };
        let materials = std::slice::from_ref(&material);
        let radius = 0.5 * d * (1.0 - 1e-9);
        let radii = match seed {
            None => Radii::Constant(radius),
            Some(_) => Radii::Uniform { min: radius * (1.0 - 1e-3), max: radius },
        };
        let seed = seed.unwrap_or_default();
        let fill = Fill { radii, amount: Amount::Fill, material: 0, materials, seed };
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
        let height = particles.position.iter().fold(0.0, |top: f64, x| top.max(x.y + 0.5 * d));
        let voidage = 1.0 - particles.volume.iter().sum::<f64>() / (width * height);
        let weight = particles.mass.iter().sum::<f64>() * self.gravity() / width;
        let drop =
            |speed: f64| (1.0 - voidage) * self.drag(speed, voidage) * speed / (voidage * voidage) * height;
        let fluidisation = bisect(10.0, 60, |speed| drop(speed) < weight);
        let mut lying = Lying { particles, material, voidage, fluidisation, weight };
        // The nodal voidage at the ends of the bed is above its mean, and the drop below that of the mean.
        for _ in 0..REFINED {
            let step = LONG * self.solid / self.drag(lying.fluidisation, voidage);
            self.refine(&mut lying, (step, LOOK))?;
        }
        Ok(lying)
    }

    /// Corrects the fluidisation velocity by the drop on the mesh, to which it is nearly in proportion, after steps.
    pub fn refine(&self, lying: &mut Lying, steps: (f64, usize)) -> Result<()> {
        let [drop, _] = self.law(&lying.particles, &lying.material, lying.fluidisation, steps)?;
        lying.fluidisation *= lying.weight / drop;
        Ok(())
    }

    /// Pressure drop of the drag law, that of these grains held fast, after steps, and that of the same grains free to
    /// rise, Pa.
    ///
    /// Contacts push, so that grains above some height carry no more of the fluid's force than their weight: the rest
    /// lifts them, until the law is that. What is below keeps its law, for the flow is given. The drop is the least,
    /// over all heights from above the bed to its floor, of weight above and law below.
    pub fn law(
        &self,
        particles: &Particles<2>,
        material: &Material,
        speed: f64,
        (step, steps): (f64, usize),
    ) -> Result<[f64; 2]> {
        let mut held = self.system((particles, material), speed, SchemeName::default(), (true, TOLERANCE))?;
        let law = self.last(&mut held, step, (steps, 1))?.push;
        let forces = held.interaction().map(|both| both.force.clone()).unwrap_or_default();
        let mut downwards: Vec<(f64, f64)> = (0..forces.len())
            .map(|i| (particles.position[i].y, particles.mass[i] * self.gravity() - forces[i].y))
            .collect();
        downwards.sort_by(|a, b| b.0.total_cmp(&a.0));
        let cuts = downwards.iter().scan(law, |drop, (_, rest)| {
            *drop += rest;
            Some(*drop)
        });
        Ok([law, cuts.fold(law, f64::min)].map(|drop| drop / self.width()))
    }

    fn grains(&self, particles: Particles<2>, material: &Material, tolerance: f64) -> Result<Dem<2>> {
        let [width, height] = self.size().map(|share| share as f64 * self.diameter);
        let corner = |x: f64, y: f64| Vec2::new(x, y);
        let walls = [
            [corner(0.0, 0.0), corner(width, 0.0)],
            [corner(0.0, 0.0), corner(0.0, height)],
            [corner(width, 0.0), corner(width, height)],
        ];
        let wall = |[from, to]: [Vec2; 2]| Wall::new("box", from, to);
        let gravity = Vec2::new(0.0, -self.gravity());
        let settings = Settings { gravity, tolerance, max_substeps: SUBSTEPS, ..Settings::default() };
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
        let size = self.size();
        let mesh = grid(size.map(|share| share as f64 * d), size.map(|share| share / SQUARE))?;
        let start = set.rest(&mesh, 0.0);
        let mut particles = particles.clone();
        if held {
            particles.mass.fill(f64::INFINITY);
            particles.velocity.fill(Vec2::zeros());
        }
        let grains = self.grains(particles, material, tolerance)?;
        set.with_grains(set.build(mesh, start)?, grains, set.laws(None), scheme)
    }

    /// Mean pressure drop (Pa) over steps in which the fluid pushed the grains up by `push` (N per metre of depth) and
    /// their upward momentum grew by `gain` (N per metre of depth), and what it must be where nothing rests on the
    /// floor: the flow through the bed being given, the fluid slows down where the grains speed up.
    pub fn balance(&self, lying: &Lying, push: f64, gain: f64) -> [f64; 2] {
        let fluid = gain * self.fluid / self.solid;
        [(push - fluid) / self.width(), lying.weight + (gain - fluid) / self.width()]
    }

    /// A number of steps, or until the push of the fluid is steady: means over the last `window`, and the grains as
    /// they were before the last.
    pub fn last(&self, system: &mut Coupled<2>, dt: f64, (steps, window): (usize, usize)) -> Result<Last> {
        let mut last = Last::default();
        let mut kept = VecDeque::with_capacity(window + 1);
        let (mut steady, mut push) = (0, f64::NAN);
        for step in 1..=steps {
            let before = upward(system);
            if let Some(grains) = system.grains() {
                last.before = grains.particles.clone();
            }
            last.tally.add(&system.step(dt)?);
            let now = pushed(system);
            kept.push_back([now, before]);
            if kept.len() > window {
                kept.pop_front();
            }
            let fastest = system.grains().into_iter().flat_map(|grains| &grains.particles.velocity);
            if fastest.fold(0.0, |most: f64, v| most.max(v.norm())) > RUNAWAY {
                return Err(Error::run("the grains run away"));
            }
            if step % LOOK == 0 {
                steady = if (now - push).abs() <= STEADY * now.abs() { steady + 1 } else { 0 };
                push = now;
            }
            if steady == 3 {
                break;
            }
        }
        let count = kept.len() as f64;
        last.push = kept.iter().map(|[push, _]| push).sum::<f64>() / count;
        last.gain = (upward(system) - kept.front().map_or(0.0, |first| first[1])) / (count * dt);
        Ok(last)
    }

    /// The bed of a point of the axes.
    fn at(self, [ratio, _]: [f64; 2]) -> Self {
        if ratio > 1.0 { self.of_rows(self.high) } else { self }
    }

    fn run(&self, [ratio, step]: [f64; 2], scheme: SchemeName) -> Result<Sample> {
        let lying = self.lie(None)?;
        let speed = ratio * lying.fluidisation;
        let relaxation = self.solid / self.drag(speed, lying.voidage);
        // What the contacts leave unsolved must not carry a grain by more than a thousandth of its diameter.
        let fall = self.gravity() * relaxation * step.min(1.0) * relaxation * step;
        let tolerance = (1e-3 * self.diameter / fall).powi(2).clamp(1e-24, TOLERANCE);
        let mut free = self.system((&lying.particles, &lying.material), speed, scheme, (false, tolerance))?;
        let least = if step < 10.0 { 40.0 } else { 16.0 };
        let mut steps = (5.0 / step).ceil().clamp(least, 5000.0);
        if ratio > 1.0 {
            let rise = (speed - lying.fluidisation) * step * relaxation;
            steps = steps.min((LIFTED * self.diameter / rise).ceil().max(FEWEST));
        }
        let steps = steps as usize;
        // To even out the speeds that contacts solved to a tolerance leave, which short steps show as noise, and what
        // is carried from step to step.
        let window = steps / 5;
        let end = match self.last(&mut free, step * relaxation, (steps, window)) {
            Ok(end) => end,
            Err(error) => {
                warn!("inflow {ratio} of fluidisation, step {step:e} of relaxation, {scheme}: {error}");
                return Ok(Sample::new(Verdict::Unstable, f64::NAN, 1.0, Tally::default()));
            }
        };
        // With the same step, on which the pressure stabilisation depends where drag acts more slowly than it.
        let [law, rising] = self.law(&end.before, &lying.material, speed, (step * relaxation, steps))?;
        let [drop, moving] = self.balance(&lying, end.push, end.gain);
        // A bed in motion takes also what its momentum grows by: where nothing touches the floor this is the balance of
        // momentum, which holds for any scheme, and tells only that the bed is lifted.
        let measured = drop / (rising + moving - lying.weight);
        let sample = Sample::judge(measured.abs() < 1e3, measured, 1.0, ALLOWED, end.tally);
        let curves = vec![
            ("pressure drop / weight", 0.0, drop / lying.weight),
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
    /// Mean of [`pushed`], N per metre of depth.
    pub push: f64,
    /// Growth of the upward momentum of the grains meanwhile, N per metre of depth.
    pub gain: f64,
    pub tally: Tally,
    /// The grains before the last step, where the fluid saw them.
    pub before: Particles<2>,
}

/// Upward momentum of grains that are free, kg/s.
pub(super) fn upward(system: &Coupled<2>) -> f64 {
    let grains = system.grains().into_iter().map(|grains| &grains.particles);
    let of = |grains: &Particles<2>| {
        let free = (0..grains.mass.len()).filter(|&i| !grains.held(i));
        free.map(|i| grains.mass[i] * grains.velocity[i].y).sum::<f64>()
    };
    grains.map(of).sum()
}

/// Upward force of the fluid on the grains in the last step, N per metre of depth.
pub(super) fn pushed(system: &Coupled<2>) -> f64 {
    system.interaction().into_iter().flat_map(|both| &both.force).map(|force| force.y).sum()
}
