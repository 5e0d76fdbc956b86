//! The fluidisation curve: the inflow goes up through fluidisation and down again, and the pressure drop must be the
//! smaller of drag law and weight whatever the step.
//!
//! The drag law is that of the same grains held fast where they are, on the same mesh. A bed that was lifted comes to
//! rest again, looser, and carries its weight only at a higher inflow; how loose depends on how far it was lifted at
//! once. Hence the small changes of the inflow about fluidisation, and the time to come to rest after each. And hence
//! [`Cutting`]: in a step of one relaxation time in gas the fluid passes five diameters, and a grain is pushed all the
//! way as where it was; not cut, such steps throw grains up that hover in shorter ones, and leave a looser bed.
//!
//! Below fluidisation the drop is the mean over the last fifth of the steps, in which what is carried from step to step
//! evens out, and is judged. Above it, it is drawn. Where nothing moves any more it stands beside the same law, which
//! is a bound there: parts of the bed that rest on little hover, and held fast they would take more than what lifts
//! them. In a bed that goes on moving it is the mean over the second half, beside the weight and what the momentum of
//! the bed grows by: grains that rest on the floor or rain on it are missing from it. They are some grains whatever the
//! height, in gas more than in water, so there the bed has 27 rows. The axes of [`super::bed`] judge that part of the
//! curve.
//!
//! How loose a bed is left is chance, too: every point is of several beds whose grains differ by a thousandth in size,
//! and the picture shows their mean.

use super::axis::{Axis, Sample, Tally, Verdict};
use super::bed::{Bed, GAS, LIQUID, Lying, pushed, upward};
use rayon::prelude::*;
use voidage_campaign::Effort;
use voidage_coupling::scheme::cut::Cutting;
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Coupled, Error, Result};
use voidage_dem::Particles;
use voidage_fluid::conditions::{FlowCondition, Prescribed};
use voidage_verification::models::Vec2;

/// Name of the curve that those on the way up and down are measured against.
pub const LAW: &str = "min(drag law, weight)";

/// Inflows over the fluidisation velocity on the way up; the way down is the same.
const INFLOWS: [f64; 13] = [0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.25, 1.3];
const FEW: [f64; 4] = [0.3, 0.6, 0.9, 1.2];
/// Beds per point.
const BEDS: u64 = 4;
/// What the fluid passes in a step, in diameters, above which there is no steady bed above fluidisation but in parts of
/// steps, and the curve would be that of short ones: it ends below it, nothing moves, and one bed of equal grains tells
/// all.
const FARTHEST: f64 = 30.0;
/// How often longer than below fluidisation the inflow stays at or above it.
const PATIENCE: usize = 4;
/// Speed of the fastest grain, over that of the inflow, below which a bed is at rest.
const REST: f64 = 1e-3;
/// What is allowed of the drop, as a share of what it should be.
const ALLOWED: f64 = 0.01;
const TOLERANCE: f64 = 1e-6;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "fluidisation-gas",
        title: "Pressure drop over min(drag law, weight), inflow up and down: 55 um grains in gas (worst at rest)",
        source: "the drag law at rest, up to the weight",
        labels: ["grain density / fluid density", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| points(&GAS, effort.pick(&[1.0], &[1e-2, 1e-1, 1.0, 10.0])),
        run: |[_, step], scheme, effort| curves(&GAS.of_rows(effort.pick(9, 27)), step, scheme, effort),
        theory: |_, _| None,
    },
    Axis {
        name: "fluidisation-liquid",
        title: "Pressure drop over min(drag law, weight), inflow up and down: 100 um grains in water (worst at rest)",
        source: "the drag law at rest, up to the weight",
        labels: ["grain density / fluid density", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| points(&LIQUID, effort.pick(&[30.0], &[1.0, 10.0, 100.0])),
        run: |[_, step], scheme, effort| curves(&LIQUID, step, scheme, effort),
        theory: |_, _| None,
    },
];

fn points(bed: &Bed, steps: &[f64]) -> Vec<[f64; 2]> {
    steps.iter().map(|step| [bed.solid / bed.fluid, *step]).collect()
}

/// The curves of some beds with one step; the worst inflow below fluidisation of them all counts.
fn curves(bed: &Bed, step: f64, scheme: SchemeName, effort: Effort) -> Result<Sample> {
    let even = bed.lie(None)?;
    let moves = even.fluidisation * step * bed.relaxation(&even) < FARTHEST * bed.diameter;
    let beds = if moves { (0..effort.pick(1, BEDS)).map(Some).collect() } else { vec![None] };
    let all: Vec<Sample> = beds
        .into_par_iter()
        .map(|seed| curve(bed, bed.lie(seed)?, (step, moves), scheme, effort))
        .collect::<Result<_>>()?;
    let tally = all.iter().fold(Tally::default(), |mut sum, sample| {
        sum.join(&sample.tally);
        sum
    });
    let off = |sample: &Sample| (sample.measured - sample.expected).abs();
    // One that is unstable has no number, which is above all numbers.
    let worst = all.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    let worst = worst.map_or(f64::NAN, |sample| sample.measured);
    let curves = all.into_iter().flat_map(|sample| sample.curves).collect();
    Ok(Sample { curves, ..Sample::judge(worst.abs() < 1e3, worst, 1.0, ALLOWED, tally) })
}

/// The curve of one, below fluidisation only unless it `moves`.
fn curve(
    bed: &Bed,
    mut lying: Lying,
    (step, moves): (f64, bool),
    scheme: SchemeName,
    effort: Effort,
) -> Result<Sample> {
    let relaxation = bed.relaxation(&lying);
    let dt = step * relaxation;
    // Relative speeds are a share of the inflow: what a bed of ten diameters takes to change by one of them.
    let passing = bed.diameter / lying.fluidisation;
    let time = (5.0 * relaxation).max(5.0 * passing);
    let steps = (time / dt).ceil().max(20.0) as usize;
    // The pressure stabilisation depends on the step, and with it the law on this mesh.
    bed.refine(&mut lying, (dt, steps))?;
    let up = match effort {
        Effort::Quick => FEW.to_vec(),
        Effort::Full => INFLOWS.to_vec(),
    };
    let up: Vec<f64> = up.into_iter().filter(|inflow| *inflow < 1.0 || moves).collect();
    let down = up.iter().rev().skip(1);
    let mut system = bed.system((&lying.particles, &lying.material), 0.0, scheme, (false, TOLERANCE))?;
    system.set_scheme(scheme.build(&Options { cut: Some(Cutting::default()), ..Options::default() })?);
    let (mut tally, mut worst, mut curves) = (Tally::default(), 1.0f64, vec![]);
    for (k, &inflow) in up.iter().chain(down).enumerate() {
        let speed = inflow * lying.fluidisation;
        let steps = if inflow < 1.0 { steps } else { PATIENCE * steps };
        let Ok(stay) = stay(&mut system, speed, (dt, steps), &mut tally) else {
            return Ok(Sample { curves, ..Sample::new(Verdict::Unstable, f64::NAN, 1.0, tally) });
        };
        let rests = inflow < 1.0 || stay.fastest < REST * speed;
        let [drop, mut expected] = stay.mean(bed, &lying, dt, if rests { steps / 5 } else { steps / 2 });
        if rests {
            [_, expected] = bed.law(&stay.before, &lying.material, speed, (dt, steps))?;
        }
        if inflow < 1.0 && (drop / expected - 1.0).abs() > (worst - 1.0).abs() {
            worst = drop / expected;
        }
        let [drop, expected] = [drop, expected].map(|drop| drop / lying.weight);
        curves.push((if k < up.len() { "up" } else { "down" }, inflow, drop));
        curves.push((LAW, inflow, expected));
    }
    Ok(Sample { curves, ..Sample::judge(worst.abs() < 1e3, worst, 1.0, ALLOWED, tally) })
}

/// Steps at one inflow.
#[derive(Default)]
struct Stay {
    /// Of each step the upward force of the fluid on the grains (N per metre of depth), and their upward momentum
    /// before it.
    course: Vec<[f64; 2]>,
    /// Upward momentum after the last, kg/s.
    upward: f64,
    /// The grains before the last step, where the fluid saw them.
    before: Particles<2>,
    /// Speed of the fastest after it, m/s.
    fastest: f64,
}

impl Stay {
    /// Mean pressure drop over the last steps, and what it must be meanwhile where nothing rests on the floor
    /// ([`Bed::balance`]), Pa.
    fn mean(&self, bed: &Bed, lying: &Lying, dt: f64, steps: usize) -> [f64; 2] {
        let last = &self.course[self.course.len() - steps..];
        let push = last.iter().map(|[push, _]| push).sum::<f64>() / steps as f64;
        bed.balance(lying, push, (self.upward - last[0][1]) / (steps as f64 * dt))
    }
}

fn stay(system: &mut Coupled<2>, speed: f64, (dt, steps): (f64, usize), tally: &mut Tally) -> Result<Stay> {
    if let Some(fluid) = system.fluid_mut() {
        for condition in fluid.conditions.iter_mut().filter(|condition| condition.boundary == "bottom") {
            condition.flow = FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::new(0.0, speed)));
        }
    }
    let mut stay = Stay::default();
    for step in 1..=steps {
        let before = upward(system);
        if let (Some(grains), true) = (system.grains(), step == steps) {
            stay.before = grains.particles.clone();
        }
        tally.add(&system.step(dt)?);
        let velocities = system.grains().into_iter().flat_map(|grains| &grains.particles.velocity);
        stay.fastest = velocities.fold(0.0, |most: f64, v| most.max(v.norm()));
        // Much faster than anything in a bed that is barely fluidised.
        if stay.fastest > 100.0 * speed {
            return Err(Error::run("the grains run away"));
        }
        stay.course.push([pushed(system), before]);
    }
    stay.upward = upward(system);
    Ok(stay)
}
