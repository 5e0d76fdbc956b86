//! A disc that blows, or moves, in a bed of held grains below its free surface: Darcy's flow in a half-plane.
//!
//! With the pressure zero at the surface, a disc of radius r at the depth D, and coordinates (tau, sigma) that are
//! constant on the circles around it (bipolar, a = r sinh tau_0, D = r cosh tau_0), the pressure that obeys Laplace's
//! equation and has the flux q on the disc is
//!
//! ```text
//! p = A_0 tau + sum A_n sinh(n tau) cos(n sigma) + B_n sinh(n tau) sin(n sigma)
//! dp/dtau = kappa q h on the disc,  h = a/(cosh tau_0 - cos sigma)
//! ```
//!
//! kappa the pressure gradient over the superficial velocity; h dsigma is the length along it.

use super::body::{condition, disc_of};
use crate::models::{FluidSet, Vec2, held_points};
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_coupling::Result;
use voidage_fluid::Mesh;
use voidage_fluid::body::{Body, BodyMotion, Evaporation, HeatFlux};
use voidage_fluid::conditions::FlowCondition;
use voidage_fluid::mesh::{Hole, Rectangle, Side, Sides};

/// The case.
pub const CASE: Case = Case {
    name: "half-plane",
    group: "fluid",
    title: "lift and drag of a disc that blows, or moves, in a bed of held grains below its surface",
    source: "exact: Darcy's flow in a half-plane by bipolar coordinates; pressure zero on the surface",
    run,
};

/// Terms of the series and places on the disc.
const TERMS: usize = 400;
const PLACES: usize = 4096;

/// Forces on a disc of radius 1 at a depth, by the pressure of the bed.
struct Exact {
    /// Lift over kappa r^2 j of a disc that blows with the velocity j.
    lift: f64,
    /// Drag over pi kappa r^2 eps U of one that moves along the surface, and towards it.
    drag: [f64; 2],
    /// Mean pressure over kappa r j on the disc that blows.
    mean: f64,
}

fn exact(depth: f64) -> Exact {
    let end = depth.acosh();
    let reach = end.sinh();
    let angle = |k: usize| 2.0 * PI * (k as f64 + 0.5) / PLACES as f64;
    let width = 2.0 * PI / PLACES as f64;
    let length = |sigma: f64| reach / (end.cosh() - sigma.cos());
    // Out of the disc: along the surface, and down.
    let normal = |sigma: f64| Vec2::new(length(sigma) * sigma.sin(), length(sigma) * end.sinh() - depth);
    // The pressure on the disc for a flux out of it, over kappa.
    let pressure = |flux: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let given: Vec<f64> = (0..PLACES).map(|k| flux(angle(k)) * length(angle(k))).collect();
        let mean = given.iter().sum::<f64>() * width / (2.0 * PI);
        let mut on_disc = vec![mean * end; PLACES];
        for n in 1..TERMS {
            let n = n as f64;
            let part = |shape: fn(f64) -> f64| -> f64 {
                (0..PLACES).map(|k| given[k] * shape(n * angle(k))).sum::<f64>() * width / PI
            };
            let (even, odd) = (part(f64::cos), part(f64::sin));
            let scale = (n * end).tanh() / n;
            for (k, pressure) in on_disc.iter_mut().enumerate() {
                *pressure += scale * (even * (n * angle(k)).cos() + odd * (n * angle(k)).sin());
            }
        }
        on_disc
    };
    // The pressure pushes into the disc.
    let force = |pressure: &[f64]| -> Vec2 {
        (0..PLACES).map(|k| -normal(angle(k)) * (pressure[k] * length(angle(k)) * width)).sum()
    };
    let blown = pressure(&|_| 1.0);
    let along = force(&pressure(&|sigma| normal(sigma).x)).x;
    let across = force(&pressure(&|sigma| normal(sigma).y)).y;
    let mean = (0..PLACES).map(|k| blown[k] * length(angle(k)) * width).sum::<f64>() / (2.0 * PI);
    // Down is the second axis here.
    Exact { lift: -force(&blown).y, drag: [-along / PI, -across / PI], mean }
}

/// What a disc does in the bed.
#[derive(Clone, Copy)]
enum Does {
    Blow,
    Move(Vec2),
}

/// Lift (blowing) or drag in the units of [`Exact`], and mean pressure, of a disc at a depth.
fn measure(depth: f64, does: Does, edge: f64) -> Result<(f64, f64)> {
    // Sides so far away that the half-plane lacks less than a hundredth of what it should be.
    let (voidage, drag, speed, far) = (0.6, 50.0, 1e-3, 25.0 * depth);
    let mesh = Mesh::rectangle(&Rectangle {
        lower: [-far, -far],
        upper: [far, 0.0],
        size: Some(far / 12.0),
        sides: Sides {
            left: Side::named("sides"),
            right: Side::named("sides"),
            bottom: Side::named("sides"),
            top: Side::named("top"),
        },
        holes: vec![Hole {
            name: "disc".into(),
            centre: [0.0, -depth],
            radius: 1.0,
            size: edge,
            growth: 0.15,
        }],
        refine: vec![],
        structured: None,
    })?;
    let part = mesh.boundary("disc")?;
    let (perimeter, ring) = (part.measure(&mesh), part.facets.clone());
    // As thin a gas as it takes for the drag to outweigh all else.
    let mut set = FluidSet::new(1e-6, 1e-6);
    let (motion, heat) = match does {
        Does::Blow => (Vec2::zeros(), speed * perimeter),
        Does::Move(along) => (along * speed, 0.0),
    };
    let evaporation = Evaporation { scalar: None, heat_flux: HeatFlux::default(), heat, latent: 1.0 };
    let body = disc_of(BodyMotion::Held(motion));
    let body = Body { centre: Vec2::new(0.0, -depth), evaporation: Some(evaporation), ..body };
    set.conditions = vec![
        condition("disc", FlowCondition::Body(body)),
        condition("sides", FlowCondition::Slip),
        condition("top", FlowCondition::Open { pressure: 0.0 }),
    ];
    let points = held_points(&mesh, voidage, drag);
    let (start, nodes) = (set.rest(&mesh, 0.0), mesh.points.len());
    let mut flow = set.equations(mesh, start)?;
    let voidages = vec![voidage; nodes];
    flow.solve(1e3, &voidages, Some(&points), &set.conditions)?;
    let mut balances = vec![];
    flow.balances(&voidages, &set.conditions, &mut balances);
    let resistance = drag / (voidage * voidage);
    let pressure = &flow.solution().pressure;
    let mean = ring.iter().map(|node| pressure[*node as usize]).sum::<f64>() / ring.len() as f64;
    let force = balances[0].force;
    let measured = match does {
        Does::Blow => force.y / (resistance * speed),
        Does::Move(along) => -force.dot(&along) / (PI * resistance * voidage * speed),
    };
    Ok((measured, mean / (resistance * speed)))
}

fn run(effort: Effort) -> Result<Outcome> {
    let mut outcome = Outcome::default();
    let (edge, allowed) = effort.pick((0.04, 6e-2), (0.02, 3e-2));
    let depths: &[f64] = effort.pick(&[2.0], &[1.25, 1.5, 2.0, 3.0, 5.0, 10.0]);
    for &depth in depths {
        let exact = exact(depth);
        let at = format!("{depth} r below the surface");
        let (lift, mean) = measure(depth, Does::Blow, edge)?;
        let mut add = |what: String, unit, exact, measured| {
            outcome.findings.push(Finding::relative(what, unit, exact, measured, allowed));
        };
        add(format!("lift of a disc that blows, {at}"), "kappa r^2 j", exact.lift, lift);
        add(format!("mean pressure there, {at}"), "kappa r j", exact.mean, mean);
        for (axis, way, drag) in [
            (Vec2::new(1.0, 0.0), "along the surface", exact.drag[0]),
            (Vec2::new(0.0, 1.0), "up", exact.drag[1]),
        ] {
            let (measured, _) = measure(depth, Does::Move(axis), edge)?;
            add(format!("drag of a disc that moves {way}, {at}"), "pi kappa r^2 eps U", drag, measured);
        }
    }
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::exact;

    /// Against the multipoles with images of the specification of the droplet.
    #[test]
    fn the_series_is_that_of_multipoles_with_images() {
        for (depth, lift, drag) in [
            (1.25, 2.1250, 0.7384),
            (1.5, 1.8652, 0.8051),
            (2.0, 1.4731, 0.8833),
            (3.0, 1.0181, 0.9460),
            (5.0, 0.6220, 0.9802),
            (10.0, 0.3134, 0.9950),
        ] {
            let found = exact(depth);
            assert!((found.lift - lift).abs() < 1e-4, "{depth}: lift {}", found.lift);
            for other in found.drag {
                assert!((other - drag).abs() < 1e-4, "{depth}: drag {other}");
            }
        }
        assert!((exact(2.0).mean - 1.4467).abs() < 1e-4);
    }
}
