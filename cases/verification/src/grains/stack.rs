//! A stack of discs: its forces, and the sweeps that they take.

use super::scene::{G, curve, exponent, floor, precise, v};
use crate::models::alike;
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::largest;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_dem::{Acceleration, Dem, Load, Material, Partner, Settings};

/// The case.
pub const CASE: Case = Case {
    name: "stack",
    group: "grains",
    title: "contact k of a stack of N carries (N - k + 1) m g; plain sweeps contract as the theory of Gauss-Seidel \
            says",
    source: "exact; rate cos^2(pi/(2 N)): Jacobi's iteration is a random walk turned back at the floor and absorbed at \
             the \
             top, Gauss-Seidel has its square (Young 1971, consistently ordered matrices)",
    run,
};

/// A stack of `n` discs on a floor, just touching.
pub fn stack(n: usize, settings: Settings<2>) -> Result<Dem<2>> {
    let material = Material::default();
    let places = (0..n).map(|k| v(0.0, 0.5 + k as f64)).collect();
    Ok(Dem::new(alike(places, 0.5, &material)?, vec![floor(0.0)], vec![material], settings)?)
}

/// Forces of the contacts over m g, from the floor up.
fn forces(dem: &Dem<2>) -> Vec<f64> {
    let mut forces = vec![0.0; dem.particles.len()];
    for c in dem.contacts() {
        let upper = match c.partner {
            Partner::Wall(_) => 0,
            Partner::Grain(j) => c.grain.max(j) as usize,
        };
        forces[upper] = c.force.norm() / (dem.particles.mass[0] * G);
    }
    forces
}

/// Relative error (2-norm) of the forces after a number of sweeps from rest.
fn error(n: usize, sweeps: usize, acceleration: Acceleration) -> Result<f64> {
    let settings = Settings { tolerance: 1e-300, max_sweeps: sweeps, acceleration, ..precise() };
    let mut dem = stack(n, settings)?;
    dem.step(1e-3, &Load::default());
    Ok(error_of(&dem))
}

/// Relative error (2-norm) of the forces of a stack.
pub fn error_of(dem: &Dem<2>) -> f64 {
    let forces = forces(dem);
    let exact = |k: usize| (forces.len() - k) as f64;
    let (wrong, all) = forces
        .iter()
        .enumerate()
        .fold((0.0, 0.0), |(wrong, all), (k, f)| (wrong + (f - exact(k)).powi(2), all + exact(k).powi(2)));
    f64::sqrt(wrong / all)
}

/// Sweeps until the error is below 1e-4: doubled until enough, then halved in between.
fn sweeps(n: usize, acceleration: Acceleration) -> Result<usize> {
    let enough = |sweeps: usize| Ok::<_, voidage_coupling::Error>(error(n, sweeps, acceleration)? <= 1e-4);
    let mut high = 1;
    while !enough(high)? {
        high *= 2;
    }
    let mut low = high / 2;
    while high - low > 1 {
        let middle = (low + high) / 2;
        if enough(middle)? { high = middle } else { low = middle }
    }
    Ok(high)
}

/// Contraction of the error per plain sweep.
///
/// The Delassus matrix is tridiag(-1, 2, -1)/m but for the floor contact, whose diagonal is 1/m (the floor does not
/// move). Jacobi's iteration is then a random walk on 0 .. N - 1, absorbed above and turned back at 0 with certainty:
/// its eigenvectors cos(k pi/(2 N)) vanish at k = N, the eigenvalue is cos(pi/(2 N)). The matrix is consistently
/// ordered, so Gauss-Seidel has its square in any order of the contacts. (With 2/m on the whole diagonal it would be
/// cos^2(pi/(2 N + 1)); N = 2 by hand: 1/2.)
fn rate(n: usize) -> f64 {
    (PI / (2 * n) as f64).cos().powi(2)
}

fn run(effort: Effort) -> Result<Outcome> {
    let n = effort.pick(20, 100);
    let mut dem = stack(n, precise())?;
    super::scene::step(&mut dem, 1e-3, &Load::default())?;
    let carried = forces(&dem);
    let worst = largest(carried.iter().enumerate().map(|(k, f)| f - (n - k) as f64));
    let floor = -dem.wall_force()[0].y / (dem.particles.mass[0] * G);
    let mut findings = vec![
        Finding::at_most(format!("largest error of a force / (N m g), N = {n}"), "1", 1e-8, worst / n as f64),
        Finding::relative(format!("force on the floor / (m g), N = {n}"), "1", n as f64, floor, 1e-8),
    ];
    let (mut plain, mut fast) = (vec![], vec![]);
    for &n in effort.pick::<&[usize]>(&[5, 10, 20], &[5, 10, 20, 40, 80]) {
        let settled = sweeps(n, Acceleration::None)?;
        let found = error(n, settled + 1, Acceleration::None)? / error(n, settled, Acceleration::None)?;
        findings.push(Finding::absolute(
            format!("contraction of a plain sweep, N = {n}"),
            "1",
            rate(n),
            found,
            1e-3 * (1.0 - rate(n)),
        ));
        // Within 15 %: the theory of the rate does not say how much of the first error is of the slowest kind.
        let known = 1e-4f64.ln() / rate(n).ln();
        findings.push(Finding::relative(
            format!("plain sweeps to 1e-4, N = {n}"),
            "1",
            known,
            settled as f64,
            0.15,
        ));
        plain.push((n as f64, settled as f64));
        fast.push((n as f64, sweeps(n, Acceleration::Momentum)? as f64));
    }
    let last = plain.len() - 2;
    findings.push(Finding::absolute(
        "plain sweeps grow as N to the",
        "1",
        2.0,
        exponent(&plain[last..]),
        0.1,
    ));
    findings.push(Finding::at_most("sweeps with momentum grow as N to the", "1", 1.3, exponent(&fast)));
    let theory =
        curve([5.0, plain[plain.len() - 1].0], |n| 1e-4f64.ln() / (PI / (2.0 * n)).cos().powi(2).ln());
    let linear = fast.iter().map(|p| (p.0, fast[0].1 * p.0 / fast[0].0)).collect();
    let counts = Panel {
        curves: vec![
            Curve::line("theory, plain", theory),
            Curve::dashes("as N", linear),
            Curve::points("plain", plain),
            Curve::points("with momentum", fast),
        ],
        ..Panel::log_log("Sweeps to 1e-4 on a stack", "discs N", "sweeps")
    };
    let carry = carried.iter().enumerate().map(|(k, f)| (k as f64 + 1.0, *f)).collect();
    let line = vec![(1.0, n as f64), (n as f64, 1.0)];
    let load = Panel {
        curves: vec![Curve::line("exact", line), Curve::points("measured", carry)],
        ..Panel::new(format!("Forces in a stack of {n}"), "contact, from the floor", "force / (m g)")
    };
    Ok(Outcome { findings, panels: vec![load, counts] })
}
