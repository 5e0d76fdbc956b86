//! The Rayleigh number at which a fluid layer heated from below starts to move.

use crate::models::{FluidSet, Vec2, grid, steps_alone};
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{Fluid, HEAT, Result, TEMPERATURE};
use voidage_fluid::conditions::{FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::transport::Scalar;

/// The case.
pub const CASE: Case = Case {
    name: "critical-rayleigh",
    group: "fluid",
    title: "the growth rate of convection rolls between rigid plates is zero at the critical Rayleigh number",
    source: "S. Chandrasekhar, Hydrodynamic and Hydromagnetic Stability (1961): Ra 1707.762 at wave number 3.117",
    run,
};

const CRITICAL: f64 = 1707.762;
const WAVE_NUMBER: f64 = 3.117;

/// Growth rate (over diffusivity / height^2) of half a roll, 1 high, between slipping sides, on n squares of height.
fn growth(rayleigh: f64, squares: usize) -> Result<f64> {
    let mesh = grid([PI / WAVE_NUMBER, 1.0], [squares; 2])?;
    let mut set =
        FluidSet::new(1.0, 1.0).flow("left", FlowCondition::Slip).flow("right", FlowCondition::Slip);
    set.properties.gravity = Vec2::new(0.0, -rayleigh);
    let scalar = Scalar::new(TEMPERATURE, 1.0, 1.0);
    set.scalars = vec![Scalar { expansion: 1.0, reference: 0.5, ..scalar }];
    for condition in &mut set.conditions {
        match condition.boundary.as_str() {
            "bottom" => condition.scalars = vec![ScalarCondition::Value(Prescribed::Uniform(1.0))],
            "top" => condition.scalars = vec![ScalarCondition::Value(Prescribed::Uniform(0.0))],
            _ => {}
        }
    }
    let mut start = set.rest(&mesh, 0.0);
    let roll = |x: &Vec2| (WAVE_NUMBER * x.x).cos() * (PI * x.y).sin();
    start.scalars = vec![mesh.points.iter().map(|x| 1.0 - x.y + 1e-3 * roll(x)).collect()];
    let rolls: Vec<f64> = mesh.points.iter().map(roll).collect();
    let mut fluid = set.build(mesh, start)?;
    // Currents of the mesh at rest are even about the middle; rolls are odd.
    let amplitude = |fluid: &mut Fluid<2>| -> Result<f64> {
        let warm = fluid.accepted.scalar(HEAT);
        Ok((0..warm.len()).map(|a| fluid.nodal_volume[a] * rolls[a] * warm[a]).sum())
    };
    let dt = 0.01;
    steps_alone(&mut fluid, dt, 60)?;
    let before = amplitude(&mut fluid)?;
    steps_alone(&mut fluid, dt, 20)?;
    Ok((amplitude(&mut fluid)? / before).ln() / (20.0 * dt))
}

/// Rates at two Ra on either side, and where the line through them is zero: the time step does not matter there.
fn run(effort: Effort) -> Result<Outcome> {
    let sizes: &[usize] = effort.pick(&[16, 32], &[16, 32, 64]);
    let ends = [0.98 * CRITICAL, 1.02 * CRITICAL];
    let (mut found, mut rates) = (Vec::new(), [0.0; 2]);
    for &squares in sizes {
        rates = [growth(ends[0], squares)?, growth(ends[1], squares)?];
        found.push(ends[0] - rates[0] * (ends[1] - ends[0]) / (rates[1] - rates[0]));
    }
    let misses: Vec<f64> = found.iter().map(|ra| (ra - CRITICAL).abs()).collect();
    let order = Finding::order("order of the critical Ra", effort.pick(1.5, 1.9), &misses, 2.0);
    let finest = sizes[sizes.len() - 1];
    let what = format!("critical Ra, {finest} x {finest} squares");
    let value =
        Finding::relative(what, "1", CRITICAL, found[found.len() - 1], 0.01).with_order(order.measured);
    let panel = Panel {
        curves: vec![
            Curve::dashes("Chandrasekhar", vec![(CRITICAL, rates[0]), (CRITICAL, rates[1])]),
            Curve::joined(format!("{finest} squares"), ends.into_iter().zip(rates).collect()),
        ],
        ..Panel::new("Rolls between rigid plates", "Ra", "growth rate (alpha/H\u{b2})")
    };
    Ok(Outcome { findings: vec![value, order], panels: vec![panel] })
}
