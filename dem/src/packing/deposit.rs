//! Beds settled by gravity: a loose fill that the contact solver itself brings to rest.

use super::{Fill, Region};
use crate::error::{Error, Result};
use crate::{Dem, Load, Material, Particles, Settings, Vector, Wall};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// How to deposit grains between the side walls of a region, on its floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Deposit {
    /// Coefficient of friction while settling, between grains and at walls; 0 gives the densest beds. None: that of the materials.
    pub friction: Option<f64>,
    /// The bed is at rest when the root mean square of the velocities is below this share of the speed that a grain gains by
    /// falling its diameter.
    pub rest: f64,
    /// Steps at most.
    pub max_steps: usize,
}

impl Default for Deposit {
    fn default() -> Self {
        Self { friction: None, rest: 0.02, max_steps: 5_000 }
    }
}

/// A deposited bed and how it came to rest.
#[derive(Clone, Debug)]
pub struct Settled {
    /// The grains, at rest (their remaining velocities are set to zero).
    pub particles: Particles<2>,
    /// Time simulated, s.
    pub time: f64,
    /// Steps taken.
    pub steps: usize,
    /// Root mean square of the remaining velocities, m/s.
    pub speed: f64,
    /// Whether the bed came to rest within the steps allowed.
    pub at_rest: bool,
}

/// Deposits grains on the floor of a region by gravity along -y.
///
/// Grains start on a loose lattice with jitter (radii in random order), stacked above the floor as high as needed;
/// with [`super::Amount::Fill`] the loose lattice fills the region.
pub fn deposit(region: &Region<2>, fill: &Fill<'_>, how: &Deposit) -> Result<Settled> {
    let particles = loose(region, fill)?;
    let largest = particles.radius.iter().fold(0.0, |a: f64, &r| a.max(r));
    let materials: Vec<Material> = fill
        .materials
        .iter()
        .map(|m| Material { restitution: 0.0, friction: how.friction.unwrap_or(m.friction), ..m.clone() })
        .collect();
    let settings = Settings::<2> { max_sweeps: 200, ..Settings::default() };
    let gravity = settings.gravity.norm();
    let friction = materials[fill.material as usize].friction;
    let walls = container(region, &particles, friction);
    let mut dem = Dem::new(particles, walls, materials, settings)?;
    // A step in which a falling grain gains a tenth of the speed sqrt(2 g d): resolves the settling of rows.
    let fall = (4.0 * gravity * largest).sqrt();
    let dt = 0.1 * fall / gravity;
    let mut settled =
        Settled { particles: Particles::default(), time: 0.0, steps: 0, speed: f64::MAX, at_rest: false };
    while settled.steps < how.max_steps && !settled.at_rest {
        dem.step(dt, &Load::default());
        settled.steps += 1;
        let sum: f64 = dem.particles.velocity.iter().map(|v| v.norm_squared()).sum();
        settled.speed = (sum / dem.particles.len().max(1) as f64).sqrt();
        settled.at_rest = settled.speed < how.rest * fall && settled.steps > 4;
    }
    settled.time = dem.time();
    settled.particles = dem.particles;
    settled.particles.velocity.fill(Vector::zeros());
    Ok(settled)
}

/// Floor and side walls, high enough for the loose fill.
fn container(region: &Region<2>, particles: &Particles<2>, friction: f64) -> Vec<Wall<2>> {
    let top =
        particles.position.iter().zip(&particles.radius).fold(region.high[1], |t, (x, r)| t.max(x[1] + r));
    let (low, high) = (region.low, region.high);
    let corner = |x: f64, y: f64| Vector::<2>::new(x, y);
    let wall = |name: &str, a, b| Wall { friction, ..Wall::new(name, a, b) };
    vec![
        wall("floor", low, corner(high[0], low[1])),
        wall("left", low, corner(low[0], top)),
        wall("right", corner(high[0], low[1]), corner(high[0], top)),
    ]
}

/// Share of a lattice cell by which grains are jittered, and the lattice spacing over the largest diameter that leaves room for it.
const JITTER: f64 = 0.1;

fn loose(region: &Region<2>, fill: &Fill<'_>) -> Result<Particles<2>> {
    region.validate()?;
    let mut source = super::Source::new(fill)?;
    let largest = fill.radii.bounds()?.1;
    let width = region.high[0] - region.low[0];
    let cell = 2.0 * largest * (1.0 + JITTER);
    let columns = (width / cell) as usize;
    if columns == 0 {
        return Err(Error::Scene(format!("the region is {width} m wide: a grain needs {cell} m")));
    }
    let cell = [width / columns as f64, cell];
    let endless = matches!(fill.amount, super::Amount::Fill);
    let mut rng = Pcg64::seed_from_u64(fill.seed ^ 0x6a69_7474_6572);
    let (mut position, mut radius) = (vec![], vec![]);
    loop {
        let (column, row) = (position.len() % columns, position.len() / columns);
        if endless && region.low[1] + (row + 1) as f64 * cell[1] > region.high[1] {
            break;
        }
        let Some(r) = source.next::<2>() else { break };
        let corner =
            Vector::<2>::new(region.low[0] + column as f64 * cell[0], region.low[1] + row as f64 * cell[1]);
        let room = |a: usize| cell[a] - 2.0 * r;
        position.push(corner + Vector::<2>::from_fn(|a, _| r + room(a) * rng.random::<f64>()));
        radius.push(r);
    }
    source.grains(position, radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packing::{Amount, Radii};

    #[test]
    fn a_deposit_rests_on_its_floor_without_overlap() {
        let glass = [Material { friction: 0.3, ..Material::default() }];
        let radii = Radii::Uniform { min: 0.4e-3, max: 0.5e-3 };
        let fill = Fill { radii, amount: Amount::Count(200), material: 0, materials: &glass, seed: 1 };
        let region = Region { low: Vector::zeros(), high: Vector::<2>::new(0.02, 0.01) };
        let bed = deposit(&region, &fill, &Deposit::default()).unwrap();
        assert!(bed.at_rest, "speed {}", bed.speed);
        let p = &bed.particles;
        let top = p.position.iter().fold(0.0, |t: f64, x| t.max(x[1]));
        assert!(top < 0.012, "{top}");
        for i in 0..p.len() {
            assert!(p.position[i][1] > p.radius[i] * 0.99);
            for j in 0..i {
                let overlap = p.radius[i] + p.radius[j] - (p.position[i] - p.position[j]).norm();
                assert!(overlap < 1e-2 * p.radius[i], "{overlap}");
            }
        }
    }
}
