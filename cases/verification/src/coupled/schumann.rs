//! A packed bed that a hot stream warms.

use crate::models::{FluidSet, Vec2, grid, hot_grains, one_per_cell, weightless};
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::closure::{HeatTransfer, Surroundings, ThermalFluid};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, HEAT, Result, TEMPERATURE};
use voidage_dem::Material;
use voidage_fluid::conditions::{FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::transport::Scalar;

/// The case.
pub const CASE: Case = Case {
    name: "schumann",
    group: "coupled",
    title: "temperatures of stream and grains in a packed bed that a hot stream enters",
    source: "T. E. W. Schumann, J. Franklin Inst. 208, 405 (1929): theta_f = 1 - e^-tau int_0^xi e^-s I0(2 (tau \
             s)^1/2) ds, theta_s = theta_f - e^(-xi-tau) I0(2 (xi tau)^1/2)",
    run,
};

/// Fluid: density, viscosity, heat capacity. A capacity so large makes the bed long against its grains, and the grains'
/// is larger by far still, so that the stream is where it was in no time.
const DENSITY: f64 = 1.0;
const VISCOSITY: f64 = 1e-5;
const CAPACITY: f64 = 1e6;
const GRAINS_CAPACITY: f64 = 1e12;
const DIAMETER: f64 = 1e-3;
const SOLID: f64 = 0.5;
/// Superficial velocity of the stream, m/s.
const STREAM: f64 = 1.0;
/// Temperatures of bed and stream, K; length of the bed in heat-transfer units.
const COLD: f64 = 300.0;
const HOT: f64 = 400.0;
const LENGTH: f64 = 10.0;

/// Modified Bessel function I0 by its series, sum (x/2)^2k / k!^2.
fn bessel(x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..200 {
        term *= (0.5 * x / k as f64).powi(2);
        sum += term;
    }
    sum
}

/// Temperatures (T - cold) / (hot - cold) of stream and grains; the integral by Simpson's rule.
fn exact(xi: f64, tau: f64) -> [f64; 2] {
    let steps = 400;
    let f = |s: f64| (-s).exp() * bessel(2.0 * (tau * s).sqrt());
    let h = xi / steps as f64;
    let weight = |k: usize| if k == 0 || k == steps { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 };
    let integral: f64 = (0..=steps).map(|k| weight(k) * f(k as f64 * h)).sum::<f64>() * h / 3.0;
    let stream = 1.0 - (-tau).exp() * integral;
    [stream, stream - (-xi - tau).exp() * bessel(2.0 * (xi * tau).sqrt())]
}

/// A bed, and the time in which tau grows by one, s.
fn bed(cells: usize) -> Result<(Coupled<2>, f64, f64)> {
    let inflow = FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::new(STREAM, 0.0)));
    let mut set = FluidSet::new(DENSITY, VISCOSITY)
        .flow("left", inflow)
        .flow("right", FlowCondition::Open { pressure: 0.0 })
        .flow("bottom", FlowCondition::Slip)
        .flow("top", FlowCondition::Slip);
    set.conditions[0].scalars = vec![ScalarCondition::Value(Prescribed::Uniform(HOT))];
    set.conditions[1].scalars = vec![ScalarCondition::Outflow { outside: None }];
    let scalar = Scalar::new(TEMPERATURE, DENSITY * CAPACITY, 1e-6);
    set.scalars = vec![Scalar { expansion: 0.0, reference: COLD, ..scalar }];
    let thermal = ThermalFluid { conductivity: 0.026, prandtl: 0.7 };
    let mut laws = set.laws(Some(thermal));
    laws.heat = HeatTransfer::Wakao;
    let around = Surroundings {
        slip: STREAM / (1.0 - SOLID),
        voidage: 1.0 - SOLID,
        diameter: DIAMETER,
        density: DENSITY,
        viscosity: VISCOSITY,
    };
    let rate = SOLID * laws.heat.coefficient(&around, &thermal, laws.voidage_function);
    let length = LENGTH * DENSITY * CAPACITY * STREAM / rate;
    let side = length / cells as f64;
    let mesh = grid([length, side], [cells, 1])?;
    let mut start = set.rest(&mesh, COLD);
    start.velocity.fill(Vec2::new(around.slip, 0.0));
    let material = Material { heat_capacity: 1.0, ..Material::default() };
    let mut held = hot_grains(one_per_cell(&mesh), 0.5 * DIAMETER, material, weightless(), COLD)?;
    let volume = SOLID * mesh.measure(0);
    held.particles.volume.fill(volume);
    held.particles.mass.fill(f64::INFINITY);
    if let Some(heat) = &mut held.particles.heat {
        heat.capacity.fill(volume * GRAINS_CAPACITY);
    }
    let mut system = set.with_grains(set.build(mesh, start)?, held, laws, SchemeName::HenryFree)?;
    if let Some(interaction) = system.interaction_mut() {
        // The stream is there from the first step.
        interaction.at.velocity.fill(Vec2::new(around.slip, 0.0));
    }
    Ok((system, SOLID * GRAINS_CAPACITY / rate, length))
}

/// Temperatures of stream and grains along the bed, as (xi, theta).
fn along(system: &mut Coupled<2>, length: f64) -> Result<[Vec<(f64, f64)>; 2]> {
    let none = || voidage_coupling::Error::run("the bed has lost its heat");
    let scaled = |x: f64, kelvin: f64| (LENGTH * x / length, (kelvin - COLD) / (HOT - COLD));
    let fluid = system.fluid().ok_or_else(none)?;
    let mut stream: Vec<(f64, f64)> = fluid
        .mesh
        .points
        .iter()
        .zip(fluid.accepted.scalar(HEAT))
        .filter(|(x, _)| x.y < 1e-9 * length)
        .map(|(x, kelvin)| scaled(x.x, *kelvin))
        .collect();
    let particles = &system.grains().ok_or_else(none)?.particles;
    let heat = particles.heat.as_ref().ok_or_else(none)?;
    let mut grains: Vec<(f64, f64)> =
        particles.position.iter().zip(&heat.temperature).map(|(x, kelvin)| scaled(x.x, *kelvin)).collect();
    stream.sort_by(|a, b| a.0.total_cmp(&b.0));
    grains.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok([stream, grains])
}

/// Linear interpolation; beyond the ends the last slope goes on.
fn at(line: &[(f64, f64)], place: f64) -> f64 {
    let above = line.partition_point(|(x, _)| *x < place).clamp(1, line.len() - 1);
    let ((x0, y0), (x1, y1)) = (line[above - 1], line[above]);
    y0 + (y1 - y0) * (place - x0) / (x1 - x0)
}

fn run(effort: Effort) -> Result<Outcome> {
    let (cells, per_unit) = effort.pick((100, 50), (400, 400));
    let (mut system, unit, length) = bed(cells)?;
    let mut outcome = Outcome::default();
    let mut panel = Panel::new(
        "Packed bed in a hot stream (Schumann)",
        "\u{3be}",
        "(T \u{2212} cold) / (hot \u{2212} cold)",
    );
    let mut measured: [Vec<Curve>; 2] = Default::default();
    for tau in [1usize, 2, 5, 10] {
        while system.steps() < (tau * per_unit) as u64 {
            system.step(unit / per_unit as f64)?;
        }
        let lines = along(&mut system, length)?;
        let place = tau as f64;
        for (k, name) in ["stream", "grains"].into_iter().enumerate() {
            let what = format!("theta of the {name} at xi = tau = {tau}, {cells} squares, dtau 1/{per_unit}");
            let allowed = effort.pick(5e-3, 1e-3);
            outcome.findings.push(Finding::absolute(
                what,
                "1",
                exact(place, place)[k],
                at(&lines[k], place),
                allowed,
            ));
            let label = |text: &str| if tau == 1 { format!("{text}, {name}") } else { String::new() };
            let thin = lines[k].iter().copied().step_by((cells * (k + 1)) / 20).collect();
            measured[k].push(Curve::points(label("measured"), thin));
            let curve = (0..=100).map(|n| LENGTH * n as f64 / 100.0).map(|xi| (xi, exact(xi, place)[k]));
            panel.curves.push(Curve::line(if k == 0 && tau == 1 { "exact" } else { "" }, curve.collect()));
        }
    }
    panel.curves.extend(measured.into_iter().flatten());
    outcome.panels.push(panel);
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values tabulated to seven digits.
    #[test]
    fn the_exact_solution_is_that_of_the_tables() {
        let table = [(1.0, 0.6542542), (2.0, 0.6035010), (5.0, 0.5639167), (10.0, 0.5448902)];
        for (place, stream) in table {
            let [f, s] = exact(place, place);
            assert!((f - stream).abs() < 1e-7 && (s - (1.0 - stream)).abs() < 1e-7, "{place}: {f} {s}");
        }
    }
}
