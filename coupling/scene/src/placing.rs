//! Grains in their first places: by the placement of their group, watched, and beds kept for the next run.

use crate as scene;
use crate::build;
use crate::{Coordinates, Placement, Scene};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use voidage_coupling::error::{Error, Result};
use voidage_dem::packing::{self, Amount, By, Fill, Kinds, Progress, Radii, Region, Settled, SizeLaw, Table};
use voidage_dem::{ContactForce, Material, Particles, Settings, Wall};

mod cache;
pub(crate) mod state;

/// Told the number of the group and how far its placement is, many times a second; may end it.
pub type Observer<'a> = dyn FnMut(usize, Progress) -> ControlFlow<()> + 'a;

/// Who watches grains being placed, and where beds are kept.
pub struct Placing<'a> {
    folder: Option<PathBuf>,
    observer: Box<Observer<'a>>,
    /// The grains of a checkpoint, all groups: then nothing is placed.
    pub(crate) given: Option<Particles<2>>,
    /// The beds poured so far.
    pub beds: Vec<Bed>,
    /// Tables of grains with columns that are not used, and which.
    pub unused: Vec<(PathBuf, Vec<String>)>,
}

/// A bed that was poured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bed {
    /// Number of the group.
    pub group: usize,
    /// Number of grains.
    pub grains: usize,
    /// Share of the bed that discs cover, away from its surface.
    pub solid_fraction: f64,
    /// Whether it came to rest; none if it was to stay as it was built.
    pub at_rest: Option<bool>,
    /// Steps of the contact solver.
    pub steps: usize,
    /// Root mean square of the velocities that were left, m/s.
    pub speed: f64,
    /// File of an earlier run that it was taken from.
    #[serde(skip)]
    pub taken_from: Option<PathBuf>,
}

impl fmt::Display for Bed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Bed { group, grains, solid_fraction, steps, speed, .. } = self;
        write!(f, "grains[{group}]: {grains} deposited, solid fraction {solid_fraction:.3}, ")?;
        match self.at_rest {
            Some(true) => write!(f, "at rest after {steps} steps")?,
            Some(false) => write!(f, "not at rest after {steps} steps: {speed:.1e} m/s are left")?,
            None => write!(f, "as built, not settled")?,
        }
        self.taken_from.as_ref().map_or(Ok(()), |file| write!(f, " (kept in {})", file.display()))
    }
}

/// The grains of a group, and the forces of the bed that they are.
pub(crate) struct Placed {
    pub grains: Particles<2>,
    pub forces: Vec<ContactForce<2>>,
    /// Numbers that grains of a state had there; empty of others.
    pub before: Vec<u32>,
}

impl<'a> Placing<'a> {
    /// Nobody watches, nothing is kept.
    pub fn alone() -> Self {
        Self::new(None, |_, _| ControlFlow::Continue(()))
    }

    /// The grains are where a checkpoint has them.
    pub(crate) fn given(particles: Particles<2>) -> Self {
        Self { given: Some(particles), ..Self::alone() }
    }

    /// Beds are kept in `folder`, and taken from there when nothing has changed that determines them.
    pub fn new(folder: Option<&Path>, observer: impl FnMut(usize, Progress) -> ControlFlow<()> + 'a) -> Self {
        Self {
            folder: folder.map(Path::to_path_buf),
            observer: Box::new(observer),
            given: None,
            beds: vec![],
            unused: vec![],
        }
    }

    /// The grains of a group, and of those that are poured with it; `materials` are those of all groups.
    pub(crate) fn place(&mut self, scene: &Scene, k: usize, materials: &[Material]) -> Result<Placed> {
        let group = &scene.grains[k];
        let fill = fill(group, k as u8, materials);
        let observer = &mut |progress: Progress| (self.observer)(k, progress);
        let placed = match &group.placement {
            Placement::Deposit(d) => {
                let fill = match mixture(scene, k) {
                    true => mixed(scene, k, d.seed, materials)?,
                    false => fill(d.seed),
                };
                return self.bed(scene, k, d, &fill);
            }
            Placement::With(_) | Placement::Source(_) => {
                return Ok(Placed { grains: Particles::default(), forces: vec![], before: vec![] });
            }
            Placement::Lattice(l) => {
                packing::lattice(&region(&l.lower, &l.upper), kind(l), l.spacing, &fill(l.seed))
            }
            Placement::Random(r) => {
                packing::random_within(&region(&r.lower, &r.upper), &fill(r.seed), &scene.period(), observer)
            }
            Placement::Csv(csv) => {
                let names = material_names(scene);
                let kinds = Kinds { own: k as u8, materials, names: &names };
                packing::read_table(&csv.file, &kinds).map(|table: Table<2>| {
                    if !table.unused.is_empty() {
                        self.unused.push((csv.file.clone(), table.unused));
                    }
                    table.grains
                })
            }
            Placement::State(file) => return state::handed_over(scene, k, file, materials),
        };
        let grains = placed.map_err(|error| wrong(scene, k, error))?;
        Ok(Placed { grains, forces: vec![], before: vec![] })
    }

    /// A bed, kept or new.
    fn bed(&mut self, scene: &Scene, k: usize, d: &scene::Deposit, fill: &Fill<'_>) -> Result<Placed> {
        let file = self.folder.as_ref().map(|folder| folder.join(format!("packing-{k}.csv")));
        let hash = cache::hash(scene, k)?;
        if let Some((bed, placed)) = file.as_ref().and_then(|file| cache::take(file, &hash, fill)) {
            self.beds.push(Bed { group: k, taken_from: file, ..bed });
            return Ok(placed);
        }
        let observer = &mut |progress: Progress| (self.observer)(k, progress);
        let how = deposit(scene, d);
        let settled = packing::deposit(&region(&d.lower, &d.upper), fill, &how, observer)
            .map_err(|error| wrong(scene, k, error))?;
        let Settled { particles, forces, steps, speed, at_rest, solid_fraction, .. } = settled;
        let at_rest = d.settle.then_some(at_rest);
        let grains = particles.len();
        let bed = Bed { group: k, grains, solid_fraction, at_rest, steps, speed, taken_from: None };
        let placed = Placed { grains: particles, forces, before: vec![] };
        if let Some(file) = &file {
            cache::keep(file, hash, &bed, &placed)?;
        }
        self.beds.push(bed);
        Ok(placed)
    }
}

/// The names of the materials of all groups, by their numbers.
pub(crate) fn material_names(scene: &Scene) -> Vec<&str> {
    scene.grains.iter().map(|group| group.material.as_str()).collect()
}

/// How a bed of the scene is deposited.
fn deposit(scene: &Scene, d: &scene::Deposit) -> packing::Deposit {
    let default = packing::Deposit::default();
    let contacts = scene.contacts.clone().unwrap_or_default();
    let settings = build::settings(scene, &contacts);
    packing::Deposit {
        method: match d.method {
            scene::Method::DropAndRoll => packing::Method::DropAndRoll,
            scene::Method::Dense => packing::Method::Dense,
        },
        friction: d.friction,
        rotation: contacts.rotation,
        // Settling takes a time of its own, in which no gate vanishes.
        walls: scene.walls.iter().map(|wall| Wall { until: None, ..build::wall(scene, wall) }).collect(),
        // Grains that settle need no accurate forces on the way.
        settings: Settings {
            max_sweeps: settings.max_sweeps.min(default.settings.max_sweeps),
            energy: false,
            ..settings
        },
        max_steps: if d.settle { default.max_steps } else { 0 },
        ..default
    }
}

/// An error if the grains of a group surely do not fit in their box, or are fewer than one; nothing is placed.
pub(crate) fn check(scene: &Scene, k: usize) -> Result<()> {
    let group = &scene.grains[k];
    let material = |group: &scene::Grains| build::material(&scene.materials[&group.material], group.solidity);
    let materials: Vec<Material> = scene.grains.iter().map(material).collect();
    let fill = fill(group, k as u8, &materials);
    let checked = match &group.placement {
        Placement::Deposit(d) if mixture(scene, k) => {
            let mixed = mixed(scene, k, d.seed, &materials)?;
            packing::check_deposit(&region(&d.lower, &d.upper), &mixed)
        }
        Placement::Deposit(d) => packing::check_deposit(&region(&d.lower, &d.upper), &fill(d.seed)),
        Placement::With(_) | Placement::Source(_) => Ok(()),
        Placement::Lattice(l) => {
            packing::check_lattice(&region(&l.lower, &l.upper), kind(l), l.spacing, &fill(l.seed))
        }
        Placement::Random(r) => packing::check_random(&region(&r.lower, &r.upper), &fill(r.seed)),
        Placement::Csv(_) | Placement::State(_) => Ok(()),
    };
    checked.map_err(|error| wrong(scene, k, error))
}

pub(crate) fn region(lower: &Coordinates, upper: &Coordinates) -> Region<2> {
    Region { low: lower.vector(), high: upper.vector() }
}

fn kind(lattice: &scene::Lattice) -> packing::Lattice {
    match lattice.arrangement {
        scene::Arrangement::Square => packing::Lattice::Square,
        scene::Arrangement::Triangular => packing::Lattice::Triangular,
    }
}

/// The groups that are poured together: the first, and those that say so.
fn members(scene: &Scene, first: usize) -> impl Iterator<Item = (usize, &scene::Grains)> {
    let with =
        move |group: &scene::Grains| matches!(group.placement, Placement::With(other) if other == first);
    scene.grains.iter().enumerate().filter(move |(k, group)| *k == first || with(group))
}

/// Whether others are poured with a group.
fn mixture(scene: &Scene, first: usize) -> bool {
    members(scene, first).count() > 1
}

/// What to fill a region with, of all groups that are poured together.
fn mixed<'a>(scene: &Scene, first: usize, seed: u64, materials: &'a [Material]) -> Result<Fill<'a>> {
    let fills: Vec<Fill<'_>> = members(scene, first)
        .map(|(k, group)| fill(group, k as u8, materials)(seed.wrapping_add((k - first) as u64)))
        .collect();
    let radii = packing::mixed::<2>(&fills, seed).map_err(|error| wrong(scene, first, error))?;
    let amount = Amount::Count(if let Radii::Mixed(grains) = &radii { grains.len() } else { 0 });
    Ok(Fill { radii, amount, material: first as u8, materials, seed })
}

impl scene::Radius {
    /// Mean area of the discs, m2.
    pub fn mean_area(&self) -> f64 {
        radii(self).mean_volume::<2>()
    }
}

/// The law of the radii of a group. Laws that mean nothing were refused before: a table that cannot be made is empty,
/// which no fill takes.
pub(crate) fn radii(radius: &scene::Radius) -> Radii {
    let by = |by: scene::By| match by {
        scene::By::Number => By::Number,
        scene::By::Mass => By::Mass,
    };
    let law = match radius {
        scene::Radius::Constant(radius) => return Radii::Constant(*radius),
        scene::Radius::Uniform([min, max]) => return Radii::Uniform { min: *min, max: *max },
        scene::Radius::LogNormal(law) => {
            (SizeLaw::LogNormal { median: law.median, deviation: law.deviation }, law.by)
        }
        scene::Radius::RosinRammler(law) => {
            (SizeLaw::RosinRammler { scale: law.scale, spread: law.spread }, law.by)
        }
        scene::Radius::Sieve(sieve) => {
            let rows = sieve.passing.iter().map(|[opening, share]| (0.5 * opening, *share));
            (SizeLaw::Sieve(rows.collect()), sieve.by)
        }
    };
    let bounds = [radius.smallest(), radius.largest()];
    Radii::by_law::<2>(&law.0, by(law.1), bounds).unwrap_or(Radii::List(vec![]))
}

/// How many grains a group has.
pub(crate) fn amount(amount: &scene::Amount) -> Amount {
    match *amount {
        scene::Amount::Count(count) => Amount::Count(count),
        scene::Amount::Mass(mass) => Amount::Mass(mass),
        scene::Amount::Fill => Amount::Fill,
    }
}

/// What to fill a region with, by the seed.
fn fill<'a>(
    group: &scene::Grains,
    material: u8,
    materials: &'a [Material],
) -> impl Fn(u64) -> Fill<'a> + use<'a> {
    let radii = group.radius.as_ref().map_or(Radii::List(Vec::new()), radii);
    let amount = amount(&group.amount);
    move |seed| Fill { radii: radii.clone(), amount, material, materials, seed }
}

/// The error of a placement, with its place in the scene.
fn wrong(scene: &Scene, k: usize, error: voidage_dem::Error) -> Error {
    if matches!(error, voidage_dem::Error::Interrupted) {
        return Error::Interrupted;
    }
    let path = format!("grains[{k}].placement");
    let density = scene.materials.get(&scene.grains[k].material).map_or(1e3, |material| material.density);
    let help = match scene.grains[k].amount {
        scene::Amount::Mass(_) if density < 100.0 => {
            format!("change the box, the amount, the radius, or the density, which is {density} kg/m3")
        }
        _ => "change the box, the amount or the radius".to_owned(),
    };
    scene.error(&path, format!("`{path}`: {error}"), help)
}
