//! Beds brought to mechanical rest by the contact solver.

use super::source::Source;
use super::{Amount, Fill, Method, Observer, Progress, Region, container, pour, solid_fraction, tell};
use crate::error::{Error, Result, Rounded, check};
use crate::{
    Contact, ContactForce, Dem, Load, Material, Motion, Particles, Partner, Settings, Side, Vector, Wall,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// How to deposit grains on the floor of a region, between its sides and on walls. Where the sides left and right are
/// periodic, grains are built up between them and settle across them; the region then is as wide as the period.
#[derive(Clone, Debug, PartialEq)]
pub struct Deposit {
    /// How the bed is built before it settles.
    pub method: Method,
    /// Coefficient of friction while settling, between grains, at walls and at the sides of the region; 0 gives the
    /// densest beds. None: that of materials and walls, and at the sides that of the grains.
    pub friction: Option<f64>,
    /// Whether grains may spin while settling. With friction and without spin they stand where others would roll.
    pub rotation: bool,
    /// Walls beside the floor and the sides of the region, as they stand at time 0.
    pub walls: Vec<Wall<2>>,
    /// How contacts are solved. Of gravity the magnitude counts: grains settle along -y.
    pub settings: Settings<2>,
    /// The bed is at rest when, in the time that a grain needs to fall its diameter twice over, grains have moved by
    /// less than this share of the mean diameter (root mean square), and their mean height by less than a fifth of that
    /// in twice this time.
    pub rest: f64,
    /// Steps at most; 0 leaves the bed as it was built.
    pub max_steps: usize,
}

impl Default for Deposit {
    fn default() -> Self {
        Self {
            method: Method::default(),
            friction: None,
            rotation: true,
            walls: vec![],
            settings: Settings { max_sweeps: 200, ..Settings::default() },
            rest: 1e-3,
            max_steps: 2_000,
        }
    }
}

/// A deposited bed and how it came to rest.
#[derive(Clone, Debug)]
pub struct Settled {
    /// The grains; their remaining velocities are set to zero, and they have no spin yet.
    pub particles: Particles<2>,
    /// The forces between them and on the walls given, by the numbers of these, in the last step; none of a bed as
    /// built.
    pub forces: Vec<ContactForce<2>>,
    /// Time simulated, s.
    pub time: f64,
    /// Steps taken.
    pub steps: usize,
    /// Root mean square of the remaining velocities, m/s.
    pub speed: f64,
    /// Whether the bed came to rest within the steps allowed.
    pub at_rest: bool,
    /// Share of the bed that discs cover, by [`solid_fraction`].
    pub solid_fraction: f64,
}

/// Time steps in which a falling grain crosses its diameter from rest: resolves the settling of rows.
const STEPS_OF_FALL: f64 = 10.0;
/// Steps over which the motion of the bed is judged.
const WINDOW: usize = 20;

/// Deposits grains on the floor of a region by gravity along -y: builds a bed grain by grain ([`pour`]) and lets the
/// contact solver bring it to rest, without restitution.
///
/// # Errors
/// Those of [`pour`] and [`Dem::new`]. A bed that does not come to rest is no error: see [`Settled::at_rest`].
pub fn deposit(
    region: &Region<2>,
    fill: &Fill<'_>,
    how: &Deposit,
    observer: &mut Observer<'_>,
) -> Result<Settled> {
    check(how.rest > 0.0, how.rest, "it must be positive", || "rest".into())?;
    let particles = pour(region, &how.walls, fill, how.method, observer)?;
    let gravity = how.settings.gravity.norm();
    let diameter = 2.0 * particles.radius.iter().sum::<f64>() / particles.len() as f64;
    let mut settled = Settled {
        particles: Particles::default(),
        forces: vec![],
        time: 0.0,
        steps: 0,
        speed: 0.0,
        // Without gravity nothing moves a bed that was built.
        at_rest: gravity == 0.0,
        solid_fraction: 0.0,
    };
    let mut dem = solver(region, particles, fill, how)?;
    if gravity > 0.0 {
        settle(&mut dem, how, diameter, &mut settled, observer)?;
    }
    settled.time = dem.time();
    settled.forces = forces(&dem, dem.walls().len() - how.walls.len());
    settled.solid_fraction = solid_fraction(&dem.particles, dem.walls(), &how.settings.period);
    settled.particles = dem.particles;
    settled.particles.velocity.fill(Vector::zeros());
    settled.particles.rotation = None;
    Ok(settled)
}

/// The forces of the last step without those on the first walls, which are sides of the region.
fn forces(dem: &Dem<2>, sides: usize) -> Vec<ContactForce<2>> {
    dem.contacts()
        .filter(|contact| contact.force != Vector::<2>::zeros())
        .filter_map(|Contact { grain, partner, force, rolling, .. }| {
            let partner = match partner {
                Partner::Grain(_) => partner,
                Partner::Wall(wall) => Partner::Wall(wall.checked_sub(sides as u32)?),
            };
            Some(ContactForce { grain, partner, force, age: 0.0, rolling })
        })
        .collect()
}

/// Steps until the bed is at rest.
fn settle(
    dem: &mut Dem<2>,
    how: &Deposit,
    diameter: f64,
    settled: &mut Settled,
    observer: &mut Observer<'_>,
) -> Result<()> {
    let gravity = how.settings.gravity.norm();
    let fall = (2.0 * gravity * diameter).sqrt();
    let dt = fall / gravity / STEPS_OF_FALL;
    let count = dem.particles.len() as f64;
    let mean_square = |vectors: &mut dyn Iterator<Item = f64>| (vectors.sum::<f64>() / count).sqrt();
    let (mut before, mut sunk_before) = (dem.particles.position.clone(), f64::INFINITY);
    while settled.steps < how.max_steps && !settled.at_rest {
        tell(observer, Progress::Settling { step: settled.steps, of: how.max_steps, speed: settled.speed })?;
        if dem.step(dt, &Load::default()).runaway.is_some() {
            break;
        }
        settled.steps += 1;
        settled.speed = mean_square(&mut dem.particles.velocity.iter().map(|v| v.norm_squared()));
        if settled.steps.is_multiple_of(WINDOW) {
            let now = &dem.particles.position;
            let moved = mean_square(&mut now.iter().zip(&before).map(|(x, y)| (x - y).norm_squared()));
            let sunk = now.iter().zip(&before).map(|(x, y)| x[1] - y[1]).sum::<f64>() / count;
            settled.at_rest =
                moved < how.rest * diameter && (sunk + sunk_before).abs() < 0.2 * how.rest * diameter;
            sunk_before = sunk;
            before.clone_from(now);
        }
    }
    Ok(())
}

/// The contact solver with the container, all walls at their places of time 0.
fn solver(region: &Region<2>, particles: Particles<2>, fill: &Fill<'_>, how: &Deposit) -> Result<Dem<2>> {
    let materials: Vec<Material> = fill
        .materials
        .iter()
        .map(|m| Material { restitution: 0.0, friction: how.friction.unwrap_or(m.friction), ..m.clone() })
        .collect();
    let Material { friction, rolling, .. } = materials[fill.material as usize];
    let periodic = |side: &Wall<2>| {
        let [x, _] = how.settings.period.sides();
        x.is_some_and(|sides| sides.iter().any(|x| side.points.iter().all(|end| end[0] == *x)))
    };
    let mut sides = container(region, &how.walls);
    sides.retain(|side| !periodic(side));
    let first = sides.len() as u32;
    let sides = sides.into_iter().map(|side| Wall { friction, rolling, ..side });
    let walls = sides.chain(how.walls.iter().map(|wall| Wall {
        points: wall.at(0.0),
        friction: how.friction.unwrap_or(wall.friction),
        restitution: 0.0,
        motion: Motion::Fixed,
        temperature: None,
        ..wall.clone()
    }));
    let walls = walls.collect();
    let particles = if how.rotation { particles.rotating() } else { particles };
    let mut settings = Settings { conduction: None, ..how.settings.clone() };
    for pair in &mut settings.pairs {
        (pair.friction, pair.restitution) = (how.friction.or(pair.friction), Some(0.0));
        if let Side::Wall(wall) = &mut pair.other {
            *wall += first;
        }
    }
    settings.gravity = Vector::<2>::new(0.0, -how.settings.gravity.norm());
    Dem::new(particles, walls, materials, settings)
}

/// Share of a lattice cell by which grains are jittered, and the lattice spacing over the largest diameter that leaves
/// room for it.
const JITTER: f64 = 0.1;

/// Grains on a loose square lattice with jitter, radii in random order, stacked above the floor of the region as high
/// as needed; with [`Amount::Fill`] they fill the region. They are at rest and touch nothing: a start for falls.
///
/// # Errors
/// Values without meaning; a region narrower than a grain.
pub fn loose(region: &Region<2>, fill: &Fill<'_>) -> Result<Particles<2>> {
    region.validate()?;
    let mut source = Source::<2>::new(fill)?;
    source.expected(region)?;
    let largest = fill.radii.bounds()?.1;
    let width = region.high[0] - region.low[0];
    let cell = 2.0 * largest * (1.0 + JITTER);
    let columns = (width / cell) as usize;
    if columns == 0 {
        return Err(Error::Scene(format!(
            "the region is {} m wide: a grain needs {} m",
            Rounded(width),
            Rounded(cell)
        )));
    }
    let cell = [width / columns as f64, cell];
    let endless = matches!(fill.amount, Amount::Fill);
    let mut rng = Pcg64::seed_from_u64(fill.seed ^ 0x6a69_7474_6572);
    let (mut position, mut radius) = (vec![], vec![]);
    loop {
        let (column, row) = (position.len() % columns, position.len() / columns);
        if endless && region.low[1] + (row + 1) as f64 * cell[1] > region.high[1] {
            break;
        }
        let Some(r) = source.next() else { break };
        let corner =
            Vector::<2>::new(region.low[0] + column as f64 * cell[0], region.low[1] + row as f64 * cell[1]);
        let room = |a: usize| cell[a] - 2.0 * r;
        position.push(corner + Vector::<2>::from_fn(|a, _| r + room(a) * rng.random::<f64>()));
        radius.push(r);
    }
    source.grains(position, radius)
}
