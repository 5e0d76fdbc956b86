//! Oblique impacts of spinning discs, and what they conserve.

use super::scene::{curve, exponent, generator, mean, normal, precise, steps, v};
use crate::models::{Vec2, alike};
use crate::{Case, Finding, Outcome};
use rand::Rng;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{largest, worse};
use voidage_coupling::Result;
use voidage_dem::{Dem, Material, Particles, Settings, Wall};

/// The case.
pub const CASE: Case = Case {
    name: "oblique-impact",
    group: "grains",
    title: "spinning discs rebound as hard discs with Coulomb friction do; momentum and angular momentum are kept",
    source: "exact: Walton 1993, Foerster et al. 1994 (Phys. Fluids 6, 1108) with beta_0 = 0; for discs \
             psi_2 = psi_1 - 3 mu (1 + e) while slipping, else 0",
    run,
};

const RESTITUTION: f64 = 0.7;
const FRICTION: f64 = 0.2;
const RADIUS: f64 = 0.5;
/// Largest psi_1 that does not slip to the end.
const STICKS: f64 = 3.0 * FRICTION * (1.0 + RESTITUTION);

fn weightless() -> Settings<2> {
    Settings { gravity: Vec2::zeros(), ..precise() }
}

fn material() -> Material {
    Material { friction: FRICTION, restitution: RESTITUTION, ..Material::default() }
}

/// psi_2 = -u_t'/u_n and e = -u_n'/u_n of a disc that meets a wall with psi_1 = -u_t/u_n, a half of u_t from its spin.
fn rebound(psi: f64) -> Result<[f64; 2]> {
    let (speed, dt) = (2.0, 1e-3);
    let wall = Wall {
        friction: FRICTION,
        restitution: RESTITUTION,
        ..Wall::new("wall", v(-10.0, 0.0), v(10.0, 0.0))
    };
    let mut grains = alike(vec![v(0.0, RADIUS + 0.3 * speed * dt)], RADIUS, &material())?.rotating();
    grains.velocity[0] = v(0.5 * psi * speed, -speed);
    if let Some(rotation) = &mut grains.rotation {
        rotation.spin[0] = 0.5 * psi * speed / RADIUS;
    }
    let mut dem = Dem::new(grains, vec![wall], vec![material()], weightless())?;
    steps(&mut dem, dt, 2)?;
    let spin = dem.particles.rotation.as_ref().map_or(f64::NAN, |r| r.spin[0]);
    let velocity = dem.particles.velocity[0];
    Ok([(velocity.x + RADIUS * spin) / speed, velocity.y / speed])
}

/// Momentum and angular momentum about the origin.
fn momenta(p: &Particles<2>) -> (Vec2, f64) {
    let linear = p.velocity.iter().zip(&p.mass).map(|(v, m)| v * *m).sum();
    let orbital: f64 = (0..p.len()).map(|i| p.mass[i] * p.position[i].perp(&p.velocity[i])).sum();
    let own: f64 =
        p.rotation.as_ref().map_or(0.0, |r| r.spin.iter().zip(&r.inertia).map(|(w, i)| w * i).sum());
    (linear, orbital + own)
}

/// Changes of momentum (over the sum of m |v|) and of angular momentum (over the sum of m r |v|) of a cloud of spinning
/// discs that collapses for one second.
fn cloud(seed: u64, dt: f64) -> Result<[f64; 2]> {
    let (side, mut rng) = (8, generator(seed));
    let at = |k: usize| v((k % side) as f64 - 3.5, (k / side) as f64 - 3.5) * 1.1;
    let mut grains = alike((0..side * side).map(at).collect(), RADIUS, &material())?.rotating();
    for i in 0..grains.len() {
        grains.velocity[i] = normal(&mut rng) * 0.3 - grains.position[i] * 0.5;
        if let Some(rotation) = &mut grains.rotation {
            rotation.spin[i] = rng.random_range(-1.0..1.0);
        }
    }
    let scale: f64 = (0..grains.len()).map(|i| grains.mass[i] * grains.velocity[i].norm()).sum();
    let before = momenta(&grains);
    let mut dem = Dem::new(grains, vec![], vec![material()], weightless())?;
    steps(&mut dem, dt, (1.0 / dt).round() as usize)?;
    let after = momenta(&dem.particles);
    Ok([(after.0 - before.0).norm() / scale, (after.1 - before.1).abs() / (scale * RADIUS)])
}

fn run(effort: Effort) -> Result<Outcome> {
    let exact = |psi: f64| psi - psi.clamp(-STICKS, STICKS);
    let mut worst = [0.0_f64; 2];
    let mut points = vec![];
    for k in 0..=effort.pick(20, 60) {
        let psi = 3.0 * k as f64 / f64::from(effort.pick(20, 60));
        let [after, e] = rebound(psi)?;
        worst = [worse(worst[0], (after - exact(psi)).abs()), worse(worst[1], (e - RESTITUTION).abs())];
        points.push((psi, after));
    }
    let seeds = effort.pick(16, 100);
    let levels = effort.pick(3, 5);
    let (mut drift, mut lost) = (vec![], 0.0_f64);
    for k in 0..levels {
        let dt = 0.02 / 2f64.powi(k);
        let changes = (0..seeds).map(|seed| cloud(seed, dt)).collect::<Result<Vec<_>>>()?;
        lost = worse(lost, largest(changes.iter().map(|change| change[0])));
        drift.push((dt, mean(&changes.iter().map(|change| change[1]).collect::<Vec<_>>()).0));
    }
    let order = exponent(&drift);
    let rebounds = Panel {
        curves: vec![Curve::line("hard disc", curve([0.0, 3.0], exact)), Curve::points("measured", points)],
        ..Panel::new(
            "Rebound of a spinning disc",
            "\u{3c8}\u{2081} before the impact",
            "\u{3c8}\u{2082} after the impact",
        )
    };
    let slope = drift.iter().map(|p| (p.0, drift[0].1 * p.0 / drift[0].0)).collect();
    let finest = drift[drift.len() - 1];
    let drifts = Panel {
        curves: vec![
            Curve::dashes("first order", slope),
            Curve::joined(format!("mean of {seeds} clouds"), drift),
        ],
        ..Panel::log_log("Angular momentum of 64 colliding discs", "step (s)", "relative change")
    };
    Ok(Outcome {
        findings: vec![
            Finding::at_most("largest error of psi_2, psi_1 from 0 to 3", "1", 1e-10, worst[0]),
            Finding::at_most("largest error of the normal restitution", "1", 1e-10, worst[1]),
            Finding::at_most("relative change of momentum, 64 discs", "1", 1e-13, lost),
            Finding::at_most(
                format!("relative change of angular momentum, step {:.1e} s", finest.0),
                "1",
                effort.pick(2e-2, 5e-3),
                finest.1,
            )
            .with_order(order),
            Finding::at_least("order of the angular momentum", "1", 0.8, order),
        ],
        panels: vec![rebounds, drifts],
    })
}
