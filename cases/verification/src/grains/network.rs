//! Lattices and a random bed as networks of thermal resistors.

use super::chain::{conductance, metal};
use super::scene::{precise, step, v};
use crate::models::{Vec2, alike};
use crate::{Case, Finding, Outcome};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::largest;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{Error, Result};
use voidage_dem::packing::{Amount, Deposit, Fill, Radii, Region, deposit, unobserved};
use voidage_dem::{Conduction, Dem, Load, Material, Partner, Settings, Wall};

/// The case.
pub const CASE: Case = Case {
    name: "heat-network",
    group: "grains",
    title: "lattices of discs conduct as H and sqrt(3) H, a random bed as the resistors that its forces make of it",
    source: "exact: k = H for the square lattice, sqrt(3) H for the triangular one; a dense solution of the same \
             network",
    run,
};

/// Force of every contact of the lattices, N/m.
const FORCE: f64 = 50.0;
const HOT: f64 = 400.0;
const COLD: f64 = 300.0;

/// A lattice about to conduct: places, the force on each disc, which ones are kept cold (and held) and hot.
struct Lattice {
    places: Vec<Vec2>,
    push: Vec<Vec2>,
    cold: Vec<bool>,
    hot: Vec<bool>,
    /// Length along the flux over the width across.
    shape: f64,
}

/// Conductivity k = flux length/(width dT) over H.
fn conductivity(lattice: Lattice) -> Result<f64> {
    let n = lattice.places.len();
    let mut grains = alike(lattice.places, 0.5, &metal())?.heated(COLD, &[metal()])?;
    for i in (0..n).filter(|i| lattice.cold[*i]) {
        grains.mass[i] = f64::INFINITY;
    }
    if let Some(heat) = &mut grains.heat {
        heat.capacity =
            (0..n).map(|i| if lattice.cold[i] || lattice.hot[i] { 1e15 } else { 1e-12 }).collect();
        (0..n).filter(|i| lattice.hot[*i]).for_each(|i| heat.temperature[i] = HOT);
    }
    let settings = Settings { gravity: Vec2::zeros(), conduction: Some(Conduction::Henry), ..precise() };
    let mut dem = Dem::new(grains, vec![], vec![metal()], settings)?;
    step(&mut dem, 1e-3, &Load { force: &lattice.push, ..Load::default() })?;
    let flux: f64 = (0..n).filter(|i| lattice.cold[*i]).map(|i| dem.contact_heat()[i]).sum();
    Ok(flux * lattice.shape / ((HOT - COLD) * conductance(FORCE, 1.0)))
}

/// Rows pressed along their length; beside each other they touch without force.
fn square(rows: usize, columns: usize) -> Lattice {
    let all = || (0..rows * columns).map(|k| (k / columns, k % columns));
    let last = columns - 1;
    Lattice {
        places: all().map(|(row, column)| v(column as f64, row as f64)).collect(),
        push: all().map(|(_, column)| v(if column == last { -FORCE } else { 0.0 }, 0.0)).collect(),
        cold: all().map(|(_, column)| column == 0).collect(),
        hot: all().map(|(_, column)| column == last).collect(),
        shape: last as f64 / rows as f64,
    }
}

/// Rows of n and n - 1 discs in turn, from a held row of n up to a hot row of n - 1. All that touch are diagonal
/// neighbours under the same force: the discs of a row are 1e-6 apart, which leaves no doubt about the forces (six
/// contacts each would) and changes nothing for a flux across the rows. The discs at the ends of a row push outwards:
/// they are held by forces from outside.
fn triangular(n: usize, rows: usize) -> Lattice {
    let spacing = 1.0_f64 + 1e-6;
    let height = f64::sqrt(1.0 - 0.25 * spacing * spacing);
    let (mut places, mut push, mut rank) = (vec![], vec![], vec![]);
    for row in 0..2 * rows {
        let (count, shift) = if row % 2 == 0 { (n, 0.0) } else { (n - 1, 0.5) };
        for k in 0..count {
            places.push(v((k as f64 + shift) * spacing, row as f64 * height));
            let outwards = match (row % 2, k) {
                (0, 0) => -1.0,
                (0, k) if k == n - 1 => 1.0,
                _ => 0.0,
            };
            let down = if row == 2 * rows - 1 { -2.0 * height * FORCE } else { 0.0 };
            push.push(v(-outwards * spacing * FORCE, down));
            rank.push(row);
        }
    }
    let last = 2 * rows - 1;
    Lattice {
        places,
        push,
        cold: rank.iter().map(|row| *row == 0).collect(),
        hot: rank.iter().map(|row| *row == last).collect(),
        shape: last as f64 * height / ((n - 1) as f64 * spacing),
    }
}

/// A bed of discs of several sizes between a hot and a cold wall after one long step, and the solution of
/// C/h (T' - T) = sum of H (T'_j - T'_i) by elimination, with H from the reported forces: temperatures of both.
fn bed(count: usize) -> Result<Vec<(f64, f64)>> {
    let material = Material { friction: 0.3, ..metal() };
    let materials = [material.clone()];
    let width = 1.1 * (count as f64).sqrt();
    let region = Region { low: Vec2::zeros(), high: v(width, width) };
    let radii = Radii::Uniform { min: 0.4, max: 0.6 };
    let fill = Fill { radii, amount: Amount::Count(count), material: 0, materials: &materials, seed: 1 };
    let settled = deposit(&region, &fill, &Deposit::default(), &mut unobserved)?;
    let wall =
        |name: &str, from, to, temperature| Wall { friction: 0.3, temperature, ..Wall::new(name, from, to) };
    let walls = vec![
        wall("floor", v(0.0, 0.0), v(width, 0.0), Some(COLD)),
        wall("left", v(0.0, 0.0), v(0.0, 3.0 * width), None),
        wall("right", v(width, 0.0), v(width, 3.0 * width), Some(HOT)),
    ];
    let grains = settled.particles.rotating().heated(350.0, &materials)?;
    let start = grains.clone();
    // The network is made of the forces as they come out, whatever their error.
    let settings = Settings { conduction: Some(Conduction::Henry), ..Settings::default() };
    let mut dem = Dem::new(grains, walls, materials.to_vec(), settings)?;
    // C/h beside conductances of some 0.1 W/K: nearly steady, and grains without contacts keep their temperature.
    let (dt, capacity) = (1e-3, 1e-6);
    if let Some(heat) = &mut dem.particles.heat {
        heat.capacity = vec![capacity; count];
    }
    if step(&mut dem, dt, &Load::default())?.substeps != 1 {
        return Err(Error::run("the bed is not at rest"));
    }
    let mut matrix = DMatrix::from_diagonal_element(count, count, capacity / dt);
    let mut right = DVector::from_element(count, capacity / dt * 350.0);
    let stiffness = material.young / (1.0 - material.poisson * material.poisson);
    for contact in dem.contacts() {
        let (i, force) = (contact.grain as usize, contact.force.dot(&contact.normal));
        if force <= 0.0 {
            continue;
        }
        let d = 2.0 * start.radius[i];
        match contact.partner {
            Partner::Grain(j) => {
                let (j, other) = (j as usize, 2.0 * start.radius[j as usize]);
                let reduced = d * other / (d + other);
                let h = 4.0 * material.conductivity * (force * reduced / (PI * stiffness)).powf(0.25);
                matrix[(i, i)] += h;
                matrix[(j, j)] += h;
                matrix[(i, j)] -= h;
                matrix[(j, i)] -= h;
            }
            Partner::Wall(w) => {
                let Some(temperature) = dem.walls()[w as usize].temperature else { continue };
                let h = 8.0 * material.conductivity * (force * d / (2.0 * PI * stiffness)).powf(0.25);
                matrix[(i, i)] += h;
                right[i] += h * temperature;
            }
        }
    }
    let solved = matrix.lu().solve(&right).ok_or_else(|| Error::run("the network is singular"))?;
    let found = dem.particles.heat.as_ref().map_or(vec![], |heat| heat.temperature.clone());
    Ok(solved.iter().copied().zip(found).collect())
}

fn run(effort: Effort) -> Result<Outcome> {
    let (rows, columns) = effort.pick((6, 8), (20, 30));
    let squares = conductivity(square(rows, columns))?;
    let triangles = conductivity(triangular(columns, rows / 2))?;
    let temperatures = bed(effort.pick(100, 600))?;
    let worst = largest(temperatures.iter().map(|(a, b)| a - b));
    let panel = Panel {
        curves: vec![
            Curve::line("equal", vec![(COLD, COLD), (HOT, HOT)]),
            Curve::points("one disc each", temperatures),
        ],
        ..Panel::new(
            "Random bed as a network of resistors",
            "dense solution (K)",
            "contact heat conduction (K)",
        )
    };
    Ok(Outcome {
        findings: vec![
            Finding::relative("conductivity of the square lattice / H", "1", 1.0, squares, 1e-6),
            Finding::relative(
                "conductivity of the triangular lattice / H",
                "1",
                f64::sqrt(3.0),
                triangles,
                1e-5,
            ),
            Finding::at_most("largest difference of a temperature in the bed", "K", 1e-6, worst),
        ],
        panels: vec![panel],
    })
}
