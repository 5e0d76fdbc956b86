//! Random close packing of frictionless discs of two sizes.

use super::scene::{mean, precise};
use crate::models::Vec2;
use crate::{Case, Finding, Outcome};
use rayon::prelude::*;
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{Error, Result};
use voidage_dem::packing::{Amount, Fill, Radii, Region, random, unobserved};
use voidage_dem::{Dem, Load, Material, Particles, Partner, Settings};

/// The case.
pub const CASE: Case = Case {
    name: "packing",
    group: "grains",
    title: "frictionless discs of two sizes, compressed isotropically, jam at random close packing and are isostatic",
    source: "phi 0.841 and z = 4: O'Hern et al. 2003 (Phys. Rev. E 68, 011306: 0.842 for sizes 1:1.4, half of each), \
             Desmond \
             and Weeks 2009; rigid discs: at most as many contacts as degrees of freedom, less the rotation of the \
             whole; discs that overlap: \
             z - 4 = 3.6 (phi - phi_c)^(1/2) (O'Hern et al. 2003)",
    run,
};

/// Radii: half of the discs each.
const RADII: [f64; 2] = [0.5, 0.7];
/// Area fraction of the random start.
const START: f64 = 0.4;
/// Layers (large diameters) at the surface that the density leaves out.
const SURFACE: f64 = 3.0;

/// Share of the mean force below which a contact does not count. The solver leaves overlaps of up to 2e-3 of a radius,
/// so that more discs touch than rigid ones would; what these contacts carry is below 1e-3 of the mean. Of those that
/// hold a packing hardly one in thousands carries so little (the density of small forces falls to zero).
const KNOWN: f64 = 1e-3;

/// A packing at rest.
struct Packed {
    particles: Particles<2>,
    /// Discs that belong to the network of forces, and its contacts.
    backbone: usize,
    contacts: usize,
    /// Mean overlap of these contacts, over the sum of the two radii.
    strain: f64,
}

impl Packed {
    /// Contacts beyond those of rigid discs, 2 N - 1.
    fn excess(&self) -> f64 {
        self.contacts as f64 - (2 * self.backbone - 1) as f64
    }

    /// The contacts that discs which overlap have beyond those of rigid ones: z - 4 = 3.6 (phi - phi_c)^(1/2), with the
    /// compression phi - phi_c = 2 phi strain.
    fn explained(&self) -> f64 {
        0.5 * self.backbone as f64 * 3.6 * (2.0 * 0.841 * self.strain).sqrt()
    }
}

/// Compresses a random cloud without walls and without inertia.
///
/// The discs drift with a medium that contracts isotropically, u = -x per unit of time, by a drag in proportion to
/// their mass: before they touch, the cloud shrinks without changing shape; at the end each disc is at rest under a
/// force towards the middle that its contacts carry. Density does not depend on that force: discs are rigid.
fn compress(count: usize, seed: u64) -> Result<Packed> {
    let materials = [Material::default()];
    let radii = (0..count).map(|k| RADII[k % 2]).collect();
    let area = 0.5 * count as f64 * PI * (RADII[0] * RADII[0] + RADII[1] * RADII[1]);
    let side = (area / START).sqrt();
    let region = Region { low: Vec2::repeat(-0.5 * side), high: Vec2::repeat(0.5 * side) };
    let fill = Fill {
        radii: Radii::List(radii),
        amount: Amount::Count(count),
        material: 0,
        materials: &materials,
        seed,
    };
    let grains = random(&region, &fill, &mut unobserved)?;
    let coarse = Settings { gravity: Vec2::zeros(), tolerance: 1e-8, ..precise() };
    let fine = Settings { tolerance: 1e-18, ..coarse.clone() };
    let mut dem = Dem::new(grains, vec![], materials.to_vec(), coarse)?;
    let rate = 1e4;
    let drag: Vec<f64> = dem.particles.mass.iter().map(|m| rate * m).collect();
    let mut push = vec![Vec2::zeros(); count];
    let mut kept = dem.particles.position.clone();
    for number in 0..1000 {
        for (push, (x, drag)) in push.iter_mut().zip(dem.particles.position.iter().zip(&drag)) {
            *push = -x * *drag;
        }
        if number == 100 {
            let state = dem.state();
            dem = Dem::new(dem.particles, vec![], materials.to_vec(), fine.clone())?;
            dem.restore(state)?;
        }
        // No disc moves by more than a tenth of a unit; once all rest, steps of half a unit of time.
        let dt = (0.1 / speed(&dem)).clamp(0.01, 0.5);
        let report = dem.step(dt, &Load { force: &push, drag: &drag, ..Load::default() });
        // At rest: after twenty steps each disc is where it was. Speeds do not tell: a few discs may swing by 2e-4
        // about their places for ever, in steps of 0.5 and of 0.01 alike.
        if number > 100 && number % 20 == 0 {
            let pairs = dem.particles.position.iter().zip(&kept);
            let moved = pairs.fold(0.0, |most: f64, (x, old)| most.max((x - old).norm()));
            if report.converged && moved < 1e-4 {
                return Ok(measure(&dem));
            }
            kept.clone_from(&dem.particles.position);
        }
    }
    Err(Error::run(format!("packing {seed} of {count} discs does not come to rest")))
}

fn speed(dem: &Dem<2>) -> f64 {
    dem.particles.velocity.iter().fold(0.0, |most: f64, v| most.max(v.norm()))
}

/// The network of forces.
///
/// More contacts than degrees of freedom would need discs that fit by chance; fewer leave something free to move. Only
/// near the middle, where the force is weak, its own curvature can hold discs that contacts do not: a few contacts may
/// be missing there. A disc in a hole about the middle, where no force acts, rests on one contact or none: it
/// belongs to no network.
fn measure(dem: &Dem<2>) -> Packed {
    let particles = dem.particles.clone();
    let forces: Vec<f64> = dem.contacts().map(|contact| contact.force.norm()).collect();
    let least = KNOWN * forces.iter().sum::<f64>() / forces.len().max(1) as f64;
    let pairs = dem.contacts().filter(|c| c.force.norm() > least).filter_map(|c| match c.partner {
        Partner::Grain(j) => Some([c.grain as usize, j as usize]),
        Partner::Wall(_) => None,
    });
    let mut pairs: Vec<[usize; 2]> = pairs.collect();
    loop {
        let mut touched = vec![0; particles.len()];
        pairs.iter().flatten().for_each(|i| touched[*i] += 1);
        let before = pairs.len();
        pairs.retain(|pair| pair.iter().all(|i| touched[*i] > 1));
        if pairs.len() == before {
            let backbone = touched.iter().filter(|count| **count > 0).count();
            let strain = |[i, j]: &[usize; 2]| {
                let reach = particles.radius[*i] + particles.radius[*j];
                1.0 - (particles.position[*j] - particles.position[*i]).norm() / reach
            };
            let strain = pairs.iter().map(strain).sum::<f64>().max(0.0) / before.max(1) as f64;
            return Packed { backbone, contacts: before, strain, particles };
        }
    }
}

/// Radius of the largest window whose discs are [`SURFACE`] layers away from the surface.
fn window(p: &Particles<2>) -> f64 {
    let solid: f64 = p.volume.iter().sum();
    (solid / (0.84 * PI)).sqrt() - SURFACE * 2.0 * RADII[1]
}

/// Share of a round window of a radius about the middle that discs cover.
fn density(p: &Particles<2>, window: f64) -> f64 {
    let covered: f64 = p.position.iter().zip(&p.radius).map(|(x, r)| lens(x.norm(), *r, window)).sum();
    covered / (PI * window * window)
}

/// Area common to two discs of radii a and b at a distance.
fn lens(distance: f64, a: f64, b: f64) -> f64 {
    if distance >= a + b {
        return 0.0;
    }
    if distance <= (a - b).abs() {
        return PI * a.min(b).powi(2);
    }
    let sector = |r: f64, other: f64| {
        let x = (distance * distance + r * r - other * other) / (2.0 * distance);
        r * r * (x / r).clamp(-1.0, 1.0).acos() - x * (r * r - x * x).max(0.0).sqrt()
    };
    sector(a, b) + sector(b, a)
}

fn run(effort: Effort) -> Result<Outcome> {
    let (count, seeds) = effort.pick((200, 2), (800, 5));
    let packings =
        (0..seeds).into_par_iter().map(|seed| compress(count, seed)).collect::<Result<Vec<_>>>()?;
    let of = |f: &dyn Fn(&Packed) -> f64| packings.iter().map(f).collect::<Vec<f64>>();
    let densities = of(&|p| density(&p.particles, window(&p.particles)));
    let (phi, scatter) = mean(&densities);
    let beyond = |p: &Packed| p.excess() - p.explained();
    let worst = packings.iter().max_by(|a, b| beyond(a).total_cmp(&beyond(b))).expect("there are packings");
    let (z, _) = mean(&of(&|p| (2 * p.contacts) as f64 / p.backbone as f64));
    let mut curves = vec![];
    for (seed, p) in packings.iter().enumerate() {
        let end = window(&p.particles);
        let points = (1..=30).map(|k| end * (0.25 + 0.75 * k as f64 / 30.0));
        let points = points.map(|r| (r, density(&p.particles, r))).collect();
        curves.push(Curve::measured(format!("packing {}", seed + 1), points));
    }
    let end = window(&packings[0].particles);
    curves.insert(0, Curve::line("0.841", vec![(0.25 * end, 0.841), (end, 0.841)]));
    let panel = Panel {
        curves,
        ..Panel::new(
            format!("Packings of {count} discs"),
            "radius of the window (small diameters)",
            "area fraction",
        )
    };
    Ok(Outcome {
        findings: vec![
            Finding::absolute(
                format!("area fraction, {seeds} packings of {count} discs, scatter {scatter:.4}"),
                "1",
                0.841,
                phi,
                effort.pick(0.012, 0.008),
            ),
            Finding::absolute(
                format!("contacts per disc, 4 - 2/{count}"),
                "1",
                4.0 - 2.0 / count as f64,
                z,
                6.0 / count as f64,
            ),
            Finding::at_most(
                format!("contacts beyond 2 N - 1, discs that overlap by {:.1e}", worst.strain),
                "1",
                worst.explained(),
                worst.excess(),
            ),
        ],
        panels: vec![panel],
    })
}
