//! Stefan vaporisation: a still disc of boiling liquid, the vapour that its heat makes, and the temperature and the
//! vapour around.

use crate::models::{FluidSet, Vec2, annulus};
use crate::norms::errors;
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::closure::{Drag, HeatTransfer, Per, ThermalFluid, VoidageFunction};
use voidage_coupling::droplet::wet::Water;
use voidage_coupling::droplet::{Choices, Droplet, Material};
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Coupled, HEAT, Result, System, TEMPERATURE};
use voidage_fluid::Flow;
use voidage_fluid::body::{Blowing, Body, BodyMotion, Evaporation, HeatFlux};
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::transport::Scalar;

/// The case.
pub const CASE: Case = Case {
    name: "stefan",
    group: "fluid",
    title: "mass rate and temperature of a still boiling disc whose vapour blows off against the heat",
    source: "exact: mdot = (2 pi k/c) ln(1 + B)/ln(R/r_d), B = c (T_w - T_d)/L; \
             T - T_d = (L/c) ((r/r_d)^(mdot c/(2 pi k)) - 1); \
             quasi-steady, as it shrinks: t = rho_w c/(4 k ln(1 + B)) [r_0^2 (1 + 2 ln R/r_0) - r^2 (1 + 2 ln R/r)]",
    run,
};

/// Gas of Table 2 of Henry et al.: density, viscosity, heat capacity, conductivity; latent heat of water (SI).
const DENSITY: f64 = 1.204;
const VISCOSITY: f64 = 2e-5;
const CAPACITY: f64 = 1040.0;
const CONDUCTIVITY: f64 = 0.026;
const LATENT: f64 = 2.257e6;
/// Density of the liquid, kg/m3.
const LIQUID: f64 = 958.4;
/// Diffusivity of vapour, m2/s.
const DIFFUSIVITY: f64 = 2e-5;
/// Radii of the disc and of the wall, m, and temperature of the disc, C.
const DISC: f64 = 1.25e-3;
const WALL: f64 = 5e-3;
const BOILING: f64 = 100.0;

/// Mass rate per metre of depth for a wall temperature, kg/m/s.
fn exact_rate(wall: f64) -> f64 {
    let number = CAPACITY * (wall - BOILING) / LATENT;
    2.0 * PI * CONDUCTIVITY / CAPACITY * (1.0 + number).ln() / (WALL / DISC).ln()
}

/// Temperature and its gradient, C.
fn exact_temperature(x: Vec2, wall: f64) -> (f64, Vec2) {
    let power = exact_rate(wall) * CAPACITY / (2.0 * PI * CONDUCTIVITY);
    let r = x.norm();
    let rise = LATENT / CAPACITY * (r / DISC).powf(power);
    (BOILING + rise - LATENT / CAPACITY, x * (rise * power / (r * r)))
}

/// Vapour, 1 at the disc and 0 at the wall: 1 - ((r/r_d)^p - 1)/((R/r_d)^p - 1), p = mdot/(2 pi rho D_v).
fn exact_vapour(x: Vec2, wall: f64) -> f64 {
    let power = exact_rate(wall) / (2.0 * PI * DENSITY * DIFFUSIVITY);
    let grown = |r: f64| (r / DISC).powf(power) - 1.0;
    1.0 - grown(x.norm()) / grown(WALL)
}

/// Time in which a disc of liquid shrinks from its first radius to a share of it while heat and vapour are always as
/// in the steady state of its radius, s: the integral of rho_w 2 pi r dr / mdot(r).
fn exact_time(wall: f64, share: f64) -> f64 {
    let number = CAPACITY * (wall - BOILING) / LATENT;
    let term = |r: f64| r * r * (1.0 + 2.0 * (WALL / r).ln());
    LIQUID * CAPACITY / (4.0 * CONDUCTIVITY * (1.0 + number).ln()) * (term(DISC) - term(share * DISC))
}

/// The same by a droplet whose surface moves as it boils, in steps of `dt`, s.
fn shrink(wall: f64, rings: usize, share: f64, dt: f64) -> Result<f64> {
    let (mut mesh, set) = (annulus(DISC, WALL, rings, 4 * rings), ring_of_gas(wall, HeatFlux::Reaction));
    let material = Material {
        water: Water {
            density: LIQUID,
            viscosity: 1.0,
            thermal: ThermalFluid { conductivity: 1.0, prandtl: 1.0 },
            drag: Drag::default(),
            heat: HeatTransfer::default(),
            voidage_function: VoidageFunction::None,
            per: Per::Solid,
        },
        temperature: BOILING,
        latent_heat: LATENT,
        vapour_density: DENSITY,
        gravity: Vec2::zeros(),
        held: true,
        choices: Choices::default(),
    };
    let place = (Vec2::zeros(), DISC);
    let droplet = Droplet::new(&mut mesh, "inner", place, (Vec2::zeros(), 0.2), material)?;
    let mut start = set.rest(&mesh, BOILING);
    // The steady state of the first radius.
    let blows = exact_rate(wall) / (2.0 * PI * DENSITY);
    for (node, x) in mesh.points.iter().enumerate() {
        start.velocity[node] = x * (blows / x.norm_squared());
        start.scalars[HEAT][node] = exact_temperature(*x, wall).0;
        start.scalars[1][node] = exact_vapour(*x, wall);
    }
    let mut fluid = set.build(mesh, start)?;
    fluid.droplet = Some(Box::new(droplet));
    let scheme = SchemeName::default().build(&Options::default())?;
    let mut system = Coupled::new(System::Fluid(Box::new(fluid)), scheme);
    let (mut before, least) = (DISC * DISC, (share * DISC).powi(2));
    loop {
        system.step(dt)?;
        let radius = system.fluid_mut().and_then(|fluid| fluid.live_droplet()).map(|d| d.state.radius);
        let now = radius.map_or(0.0, |r| r * r);
        if now <= least {
            return Ok(system.time() - dt * (least - now) / (before - now));
        }
        before = now;
    }
}

/// The gas between the disc and the wall.
fn ring_of_gas(wall: f64, heat_flux: HeatFlux) -> FluidSet {
    let mut set = FluidSet::new(DENSITY, VISCOSITY);
    let heat = Scalar::new(TEMPERATURE, DENSITY * CAPACITY, CONDUCTIVITY);
    set.scalars = vec![Scalar { reference: BOILING, ..heat }, Scalar::new("vapour", 1.0, DIFFUSIVITY)];
    let disc = Body {
        centre: Vec2::zeros(),
        radius: DISC,
        expansion: 0.0,
        motion: BodyMotion::Held(Vec2::zeros()),
        evaporation: Some(Evaporation { scalar: Some(HEAT), heat_flux, heat: 0.0, latent: LATENT * DENSITY }),
        blowing: Blowing::default(),
        solid: vec![],
    };
    let held = |value: f64| ScalarCondition::Value(Prescribed::Uniform(value));
    set.conditions = vec![
        Condition {
            boundary: "inner".into(),
            flow: FlowCondition::Body(disc),
            scalars: vec![held(BOILING), held(1.0)],
        },
        Condition {
            boundary: "outer".into(),
            flow: FlowCondition::Open { pressure: 0.0 },
            scalars: vec![held(wall), held(0.0)],
        },
    ];
    set
}

/// The steady state in a ring of n circles: mass rate and solver.
fn solve(wall: f64, rings: usize, heat_flux: HeatFlux) -> Result<(f64, Flow<2, 3>)> {
    let (mesh, set) = (annulus(DISC, WALL, rings, 4 * rings), ring_of_gas(wall, heat_flux));
    let mut start = set.rest(&mesh, BOILING);
    start.scalars[1].fill(0.0);
    let clear = vec![1.0; mesh.points.len()];
    let mut flow = set.equations(mesh, start)?;
    let mut rate = 0.0;
    for _ in 0..60 {
        flow.solve(1e4, &clear, None, &set.conditions)?;
        let next = flow.bodies().map(|body| body.vapour * DENSITY).sum::<f64>();
        flow.accept();
        if (next - rate).abs() < 1e-10 * next {
            break;
        }
        rate = next;
    }
    Ok((rate, flow))
}

fn run(effort: Effort) -> Result<Outcome> {
    let sizes: &[usize] = effort.pick(&[8, 16], &[8, 16, 32]);
    let finest = sizes[sizes.len() - 1];
    let mut outcome = Outcome::default();
    let mut panel = Panel::new("Vapour of a still boiling disc", "r (mm)", "temperature (C)");
    for wall in [300.0, 400.0, 500.0, 600.0] {
        let exact = exact_rate(wall);
        let (mut misses, mut norms, mut vapour_norms) = (Vec::new(), Vec::new(), Vec::new());
        for &rings in sizes {
            let (rate, flow) = solve(wall, rings, HeatFlux::Reaction)?;
            misses.push((rate - exact).abs());
            let warm = flow.state().scalar(HEAT);
            norms.push(errors(flow.mesh(), |a| [warm[a]], |x| [exact_temperature(x, wall)]).l2);
            let vapour = flow.state().scalar(1);
            // The gradient is of no use here.
            let exact_vapour = |x: Vec2| [(exact_vapour(x, wall), Vec2::zeros())];
            vapour_norms.push(errors(flow.mesh(), |a| [vapour[a]], exact_vapour).l2);
            if rings == finest {
                let order = (misses[misses.len() - 2] / misses[misses.len() - 1]).log2();
                let what = format!("mass rate, wall at {wall} C, {rings} rings");
                outcome.findings.push(
                    Finding::relative(what, "kg/m/s", exact, rate, effort.pick(1e-2, 2e-3)).with_order(order),
                );
                let name = if wall == 300.0 { "measured" } else { "" };
                let points = (0..=rings).map(|k| 4 * rings * k);
                let points = points.map(|a| (1e3 * flow.mesh().points[a].norm(), warm[a])).collect();
                panel.curves.push(Curve::points(name, points));
            }
        }
        outcome.findings.push(Finding::order(
            format!("order of T in L2, wall at {wall} C"),
            1.9,
            &norms,
            2.0,
        ));
        outcome.findings.push(Finding::order(
            format!("order of the vapour in L2, wall at {wall} C"),
            1.9,
            &vapour_norms,
            2.0,
        ));
        let radii = (0..=100).map(|k| DISC + (WALL - DISC) * k as f64 / 100.0);
        let line = radii.map(|r| (1e3 * r, exact_temperature(Vec2::new(r, 0.0), wall).0)).collect();
        panel.curves.push(Curve::line(if wall == 300.0 { "exact" } else { "" }, line));
    }
    outcome.panels.push(panel);

    // The gradient at the surface is of first order.
    let exact = exact_rate(400.0);
    let rates = sizes.iter().map(|&rings| Ok(solve(400.0, rings, HeatFlux::Gradient)?.0));
    let rates = rates.collect::<Result<Vec<_>>>()?;
    let misses: Vec<f64> = rates.iter().map(|rate| (rate - exact).abs()).collect();
    let what = format!("mass rate by the gradient at the surface, wall at 400 C, {finest} rings");
    let rate = rates[rates.len() - 1];
    outcome.findings.push(Finding::relative(what, "kg/m/s", exact, rate, effort.pick(5e-2, 2.5e-2)));
    let what = "order of the mass rate by the gradient";
    let order = Finding::order(what, 0.8, &misses, 2.0);
    outcome.findings.push(Finding { allowed: [0.8, 1.2], ..order });

    // (temperature of the wall, share of the radius that is left), with the steps that it takes.
    let shares: &[(f64, f64)] =
        effort.pick(&[(400.0, 0.9)], &[(300.0, 0.9), (400.0, 0.9), (500.0, 0.9), (600.0, 0.9), (400.0, 0.5)]);
    for &(wall, share) in shares {
        let exact = exact_time(wall, share);
        let time = shrink(wall, finest, share, exact / effort.pick(60.0, 150.0))?;
        let what = format!("time to boil down to {share} of the radius, wall at {wall} C");
        outcome.findings.push(Finding::relative(what, "s", exact, time, effort.pick(6e-3, 3e-3)));
    }
    Ok(outcome)
}
