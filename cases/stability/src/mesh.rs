//! A mesh that oscillates through a bed at rest under an inflow, and one whose domain is remeshed on the way: whatever
//! the nodes do, what flows in flows out.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use super::bed::LIQUID;
use voidage_campaign::worse;
use voidage_coupling::motion::Oscillation;
use voidage_coupling::remesh::{Remesh, Remesher};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Result};
use voidage_verification::models::Vec2;

/// Amplitude of the oscillation in elements, and steps.
const AMPLITUDE: f64 = 2.0;
const STEPS: usize = 60;
/// Share of the inflow that may be lost.
const DRIFT: f64 = 1e-9;
/// Inflow over the fluidisation velocity.
const INFLOW: f64 = 0.5;

/// Steps over the relaxation time of a grain where the domain is remeshed.
const STEP: f64 = 1.0;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "mesh-motion",
        title: "Volume that an oscillating mesh loses per step, over the inflow: a bed of 100 um grains in water",
        source: "incompressible: what flows in flows out",
        labels: ["motion of a node per step / element size", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| {
            effort.pick(
                product(&[0.01, 1.0], &[1.0]),
                product(&[0.01, 0.03, 0.1, 0.3, 1.0], &[0.1, 1.0, 10.0, 100.0]),
            )
        },
        run: |[motion, step], scheme, _| oscillation(motion, step, None, scheme),
        theory: |_, _| None,
    },
    Axis {
        name: "remesh",
        title: "Volume that an oscillating mesh with remeshing loses per step, over the inflow: a bed of 100 um grains \
                in water",
        source: "incompressible: what flows in flows out",
        labels: ["motion of a node per step / element size", "steps between two meshes"],
        coupled: true,
        points: |effort| {
            effort.pick(product(&[0.1], &[5.0]), product(&[0.01, 0.03, 0.1, 0.3, 1.0], &[1.0, 5.0, 25.0]))
        },
        run: |[motion, steps], scheme, _| oscillation(motion, STEP, Some(steps as u64), scheme),
        theory: |_, _| None,
    },
];

/// With remeshing after so many steps, or never.
fn oscillation(motion: f64, step: f64, remesh: Option<u64>, scheme: SchemeName) -> Result<Sample> {
    let lying = LIQUID.lie(None)?;
    let speed = INFLOW * lying.fluidisation;
    let dt = step * LIQUID.solid / LIQUID.drag(speed, lying.voidage);
    let mut system = LIQUID.system((&lying.particles, &lying.material), speed, scheme, (false, 1e-6))?;
    let element = LIQUID.diameter;
    if let Some(fluid) = system.fluid_mut() {
        // The largest motion of a step is 2 A sin(pi f dt).
        let frequency = (0.5 * motion / AMPLITUDE).asin() / (std::f64::consts::PI * dt);
        let amplitude = Vec2::new(0.6, 0.8) * (AMPLITUDE * element);
        fluid.motion = Some(Box::new(Oscillation::new(&fluid.mesh, amplitude, frequency, None)?));
    }
    let mut remesher = match (system.fluid(), remesh) {
        (Some(fluid), Some(every)) => Some(Remesher::new(&fluid.mesh, Remesh { every, ..Remesh::default() })),
        _ => None,
    };
    let (mut tally, mut drift) = (Tally::default(), 0.0f64);
    let width = LIQUID.width();
    for _ in 0..STEPS {
        let Ok(mut report) = system.step(dt) else {
            return Ok(Sample::new(Verdict::Unstable, f64::NAN, 0.0, tally));
        };
        tally.add(&report);
        let through = ["bottom", "top", "left", "right"].map(|side| outflow(&system, side));
        let sum: f64 = through.iter().sum();
        drift = worse(drift, (sum / (speed * width)).abs());
        // The fluxes are those of the mesh that the step was solved on; then a new one.
        swap_remesher(&mut system, &mut remesher);
        if system.remesh(&mut report).is_err() {
            return Ok(Sample::new(Verdict::Failed, drift, 0.0, tally));
        }
        swap_remesher(&mut system, &mut remesher);
        let fastest = system.grains().into_iter().flat_map(|grains| &grains.particles.velocity);
        if fastest.fold(0.0, |most: f64, v| most.max(v.norm())) > 100.0 * speed {
            return Ok(Sample::new(Verdict::Unstable, drift, 0.0, tally));
        }
    }
    Ok(Sample::judge(drift.is_finite(), drift, 0.0, DRIFT, tally))
}

fn swap_remesher(system: &mut Coupled<2>, remesher: &mut Option<Remesher<2>>) {
    if let Some(fluid) = system.fluid_mut() {
        std::mem::swap(&mut fluid.remesher, remesher);
    }
}

/// Volume per time and depth that leaves through a boundary in the last step, m2/s.
pub(super) fn outflow(system: &Coupled<2>, boundary: &str) -> f64 {
    let Some(fluid) = system.fluid() else { return f64::NAN };
    let part = fluid.conditions.iter().position(|condition| condition.boundary == boundary);
    part.and_then(|part| fluid.solution.balances.get(part)).map_or(f64::NAN, |balance| balance.flux)
}
