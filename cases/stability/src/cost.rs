//! What a step costs with each scheme: three systems of the map.

use super::axis::Tally;
use super::bed::{Bed, GAS, LIQUID};
use super::settle::Suspension;
use std::time::Instant;
use voidage_campaign::Effort;
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Result};

/// Steps of each.
const STEPS: usize = 30;

/// Prints solutions of the fluid, contact sweeps and time per step, scheme by scheme.
pub fn print(schemes: &[SchemeName]) -> Result<()> {
    println!("{:<44} {:<11} {:>9} {:>9} {:>9} {:>9}", "", "scheme", "solutions", "sweeps", "unsolved", "ms");
    let suspension = Suspension::fine(100.0, Effort::Full);
    let falling =
        |scheme| Ok((suspension.system(suspension.loose()?, scheme)?, 10.0 * suspension.relaxation()));
    let systems: [(&str, Box<Start<'_>>); 4] = [
        ("gas bed at rest, U/U_mf 0.6, dt/tau 1", Box::new(|scheme| lying(&GAS, 0.6, 1.0, scheme))),
        ("gas bed, U/U_mf 1.2, dt/tau 0.1", Box::new(|scheme| lying(&GAS, 1.2, 0.1, scheme))),
        ("liquid bed at rest, U/U_mf 0.6, dt/tau 10", Box::new(|scheme| lying(&LIQUID, 0.6, 10.0, scheme))),
        ("settling suspension, 100 um, dt/tau 10", Box::new(falling)),
    ];
    for (name, start) in &systems {
        for &scheme in schemes {
            let (mut system, dt) = start(scheme)?;
            let (mut tally, clock) = (Tally::default(), Instant::now());
            let mut failed = false;
            while tally.steps < STEPS && !failed {
                match system.step(dt) {
                    Ok(report) => tally.add(&report),
                    Err(_) => failed = true,
                }
            }
            let time = 1e3 * clock.elapsed().as_secs_f64() / STEPS as f64;
            let scheme = scheme.to_string();
            if failed {
                println!("{name:<44} {scheme:<11} fails after {} steps", tally.steps);
                continue;
            }
            let [solves, sweeps, unsolved] =
                [tally.solves, tally.sweeps, tally.unsolved].map(|count| tally.per_step(count));
            println!("{name:<44} {scheme:<11} {solves:>9.2} {sweeps:>9.0} {unsolved:>9.2} {time:>9.1}");
        }
    }
    Ok(())
}

/// Makes a system, and says its step, s.
type Start<'a> = dyn Fn(SchemeName) -> Result<(Coupled<2>, f64)> + 'a;

fn lying(bed: &Bed, ratio: f64, step: f64, scheme: SchemeName) -> Result<(Coupled<2>, f64)> {
    let lying = bed.lie(None)?;
    let speed = ratio * lying.fluidisation;
    let relaxation = bed.solid / bed.drag(speed, lying.voidage);
    let system = bed.system((&lying.particles, &lying.material), speed, scheme, (false, 1e-4))?;
    Ok((system, step * relaxation))
}
