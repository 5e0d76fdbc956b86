//! The tables of materials, grains and sinks.

use super::Coordinates;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A material of grains or walls.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Density of the solid, kg/m3. Above 0.
    pub density: f64,
    /// Coulomb friction coefficient between grains. A contact of two materials has the smaller of the two. Default 0.
    #[serde(default)]
    pub friction: f64,
    /// Coefficient of resistance to rolling between grains, 0 to 1: a contact resists the relative rotation of its two
    /// grains by a moment of at most this coefficient times R p, where p is the normal force and R = r1 r2 / (r1 + r2);
    /// at a wall R is the radius of the grain. A contact of two materials has the smaller of the two. Needs
    /// `contacts.rotation = true`. Default 0.
    #[serde(default)]
    pub rolling: f64,
    /// Coefficient of normal restitution, 0 to 1. A contact of two materials has the smaller of the two. Default 0.
    #[serde(default)]
    pub restitution: f64,
    /// Young's modulus, Pa. Needed with `contacts.conduction`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub young: Option<f64>,
    /// Poisson's ratio, -1 to 0.5. Needed with `contacts.conduction`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poisson: Option<f64>,
    /// Thermal conductivity, W/(m K). Needed with `contacts.conduction`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductivity: Option<f64>,
    /// Heat capacity, J/(kg K). Needed where the grains have a temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heat_capacity: Option<f64>,
}

/// A group of grains.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Grains {
    /// Name of one of the materials.
    pub material: String,
    /// Radius, m: `{constant = r}`, in short `r`, `{uniform = [smallest, largest]}`, or a law of sizes by number or by
    /// mass: `{log-normal = {..}}`, `{rosin-rammler = {..}}`, `{sieve = {..}}`. Not allowed with a CSV file or a state,
    /// which contain the radii.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<Radius>,
    /// Share of the disc that is solid, above 0 and at most 1. With 0.8165 the densest packing of discs has the solid
    /// fraction of the densest packing of spheres. Default 1.
    #[serde(default = "one")]
    pub solidity: f64,
    /// How many grains: `{count = n}`, `{mass = m}` (kg; kg per m of depth in the plane) or `"fill"`. For a source, how
    /// many it lets in altogether. Default `"fill"`; for a source, no limit.
    #[serde(default)]
    pub amount: Amount,
    /// Where the grains start.
    pub placement: Placement,
    /// Velocity at the start, m/s; for a source, that of the grains which it lets in. Default: at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<Coordinates>,
    /// Temperature at the start, K; for a source, that of the grains which it lets in. Either all groups have a
    /// temperature or none. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Whether the grains are held in place and never move. Default false.
    #[serde(default)]
    pub fixed: bool,
}

fn one() -> f64 {
    1.0
}

/// Radii of a group of grains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Radius {
    /// All grains have this radius, m.
    Constant(f64),
    /// Radii between these two, m, uniformly distributed by number.
    Uniform([f64; 2]),
    /// The logarithm of the radius is normally distributed.
    LogNormal(LogNormal),
    /// The law of Rosin and Rammler, for ground material.
    RosinRammler(RosinRammler),
    /// A sieve analysis: which share of the grains passes each sieve.
    Sieve(Sieve),
}

/// What a law of sizes gives the shares of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum By {
    /// The number of grains.
    Number,
    /// Their mass; in the plane that of discs, which grows with the square of the radius.
    Mass,
}

/// Radii whose logarithm is normally distributed, between a smallest and a largest one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogNormal {
    /// Median radius, m: half of the grains, by number or by mass, are smaller.
    pub median: f64,
    /// Standard deviation of ln(radius). Above 0.
    pub deviation: f64,
    /// Radius below which there are none, m. Above 0.
    pub smallest: f64,
    /// Radius above which there are none, m; at most 100 times the smallest.
    pub largest: f64,
    /// Whether the law is that of the number of grains or of their mass: `"number"` or `"mass"`.
    pub by: By,
}

/// Radii r of which the share `1 - exp(-(r/scale)^spread)` is smaller, between a smallest and a largest one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RosinRammler {
    /// Radius, m, below which 63.2 % of the grains are, by number or by mass.
    pub scale: f64,
    /// Exponent; the larger it is, the narrower is the distribution. Above 0.
    pub spread: f64,
    /// Radius below which there are none, m. Above 0.
    pub smallest: f64,
    /// Radius above which there are none, m; at most 100 times the smallest.
    pub largest: f64,
    /// Whether the law is that of the number of grains or of their mass: `"number"` or `"mass"`.
    pub by: By,
}

/// A sieve analysis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sieve {
    /// Rows `[opening, share]`: opening of a sieve, m (a diameter, not a radius), and the share that passes it. Both
    /// increase, the share from 0 to 1; between two sieves it grows linearly with the diameter.
    pub passing: Vec<[f64; 2]>,
    /// Whether shares are of the number of grains or of their mass: `"number"` or `"mass"`.
    pub by: By,
}

impl Radius {
    /// Smallest radius, m.
    pub fn smallest(&self) -> f64 {
        match self {
            Radius::Constant(r) | Radius::Uniform([r, _]) => *r,
            Radius::LogNormal(LogNormal { smallest, .. })
            | Radius::RosinRammler(RosinRammler { smallest, .. }) => *smallest,
            Radius::Sieve(sieve) => sieve.passing.first().map_or(0.0, |row| 0.5 * row[0]),
        }
    }

    /// Largest radius, m.
    pub fn largest(&self) -> f64 {
        match self {
            Radius::Constant(r) | Radius::Uniform([_, r]) => *r,
            Radius::LogNormal(LogNormal { largest, .. })
            | Radius::RosinRammler(RosinRammler { largest, .. }) => *largest,
            Radius::Sieve(sieve) => sieve.passing.last().map_or(0.0, |row| 0.5 * row[0]),
        }
    }
}

/// How many grains a group has.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Amount {
    /// As many grains as come nearest to this mass, kg (kg per m of depth in the plane). At least half the mass of one
    /// grain.
    Mass(f64),
    /// This number of grains.
    Count(usize),
    /// As many as there is room for: up to the top of a box, all points of a lattice, all rows of a file.
    #[default]
    Fill,
}

/// Where a group of grains starts.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Placement {
    /// Poured into a box and settled by gravity along -y before time 0.
    Deposit(Deposit),
    /// On a regular lattice, row by row from the bottom.
    Lattice(Lattice),
    /// At random, without overlap.
    Random(RandomBox),
    /// Read from a file.
    Csv(GrainsFile),
    /// Poured together with an earlier group and mixed with it at random: the number of that group, counted from 0.
    /// Both groups need an `amount` by count or by mass.
    With(usize),
    /// As another run left them, with their places, radii, velocities, spins, temperatures and contacts.
    State(StateFile),
    /// Added during the run, at random places of a box where they overlap neither grains nor walls. A grain for which
    /// there is no free place waits, and the run reports it.
    Source(GrainSource),
}

/// Grains that start as they are in the checkpoint of another run.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StateFile {
    /// Checkpoint of any run with grains, such as `out/NAME/checkpoint.voidage`, path relative to the scene. Contacts
    /// with walls are taken over where a wall has the same name in both.
    pub file: PathBuf,
    /// Number of the group of that run, counted from 0. Default: all its grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<u8>,
    /// Whether the grains start at rest. Default false: they keep their velocities and spins.
    #[serde(default)]
    pub still: bool,
}

/// A box in which grains are added during the run. Where there is a fluid, its equation of mass contains the volume
/// that they take up.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GrainSource {
    /// Name, for messages and for the columns of series.csv.
    pub name: String,
    /// Lower corner of the box that holds the whole grains, m.
    pub lower: Coordinates,
    /// Upper corner of the box that holds the whole grains, m.
    pub upper: Coordinates,
    /// Rate at which grains are added: `{grains = n}` (1/s) or `{mass = m}` (kg/s; kg/s per m of depth in the plane).
    pub rate: Rate,
    /// Time at which it begins, s. Default 0.
    #[serde(default)]
    pub start: f64,
    /// Time at which it ends, s. Default: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
    /// Seed of sizes and places. Default 1.
    #[serde(default = "first_seed")]
    pub seed: u64,
}

/// How much a source lets in by time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Rate {
    /// Grains per second. Above 0.
    Grains(f64),
    /// Mass per second, kg/s (kg/s per m of depth in the plane). Above 0.
    Mass(f64),
}

/// A line or a box that removes grains from the run: those whose centres cross the line, or lie in the box at the end
/// of a step. Where there is a fluid, its equation of mass contains the volume that becomes free.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sink {
    /// Name, for messages and for the columns of series.csv.
    pub name: String,
    /// First end of the line, m. A sink has either `from` and `to`, or `lower` and `upper`.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub from: Coordinates,
    /// Second end of the line, m.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub to: Coordinates,
    /// Lower corner of the box, m.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub lower: Coordinates,
    /// Upper corner of the box, m.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub upper: Coordinates,
    /// Time at which it begins, s. Default 0.
    #[serde(default)]
    pub start: f64,
    /// Time at which it ends, s. Default: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
}

/// A box into which grains are poured from above. Its floor and sides hold them, and so do the walls inside it, at
/// their places at time 0. Between periodic sides, from the one to the other, it has no sides, and grains settle across
/// them.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Deposit {
    /// Lower corner of the box, m.
    pub lower: Coordinates,
    /// Upper corner of the box, m. Grains are released below its top.
    pub upper: Coordinates,
    /// Seed of the random numbers. Default 1.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// How the bed is built, grain by grain: `"drop-and-roll"` or `"dense"`. Default `"drop-and-roll"`.
    #[serde(default)]
    pub method: Method,
    /// Coulomb friction coefficient between grains and at walls while the bed settles; 0 gives the densest bed.
    /// Default: the coefficients of the materials and walls.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Whether the bed comes to rest by its contacts before time 0. If not, it starts as it was built and may still
    /// settle during the run. Default true.
    #[serde(default = "yes")]
    pub settle: bool,
}

/// How a bed is built before it settles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Each grain is released at a random place, falls, and rolls until it is held.
    #[default]
    DropAndRoll,
    /// The lowest free place is filled next, with the one of eight grains that fits there best.
    Dense,
}

fn yes() -> bool {
    true
}

fn first_seed() -> u64 {
    1
}

/// A regular lattice of grains.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lattice {
    /// Lower corner of the box that holds the whole grains, m.
    pub lower: Coordinates,
    /// Upper corner of the box that holds the whole grains, m.
    pub upper: Coordinates,
    /// `"square"`, or `"triangular"` with every second row shifted by half a spacing. Default `"square"`.
    #[serde(default)]
    pub arrangement: Arrangement,
    /// Distance between neighbours over the largest diameter, at least 1. Default 1.
    #[serde(default = "one")]
    pub spacing: f64,
    /// Seed of the random radii. Default 1.
    #[serde(default = "first_seed")]
    pub seed: u64,
}

/// Regular arrangements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Arrangement {
    /// Rows above each other.
    #[default]
    Square,
    /// Rows shifted by half a spacing.
    Triangular,
}

/// A box in which grains are placed at random, without overlap.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RandomBox {
    /// Lower corner of the box that holds the whole grains, m.
    pub lower: Coordinates,
    /// Upper corner of the box that holds the whole grains, m.
    pub upper: Coordinates,
    /// Seed of the random numbers. Default 1.
    #[serde(default = "first_seed")]
    pub seed: u64,
}

/// Grains read from a file.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GrainsFile {
    /// CSV file with a header, path relative to the scene: columns `x,y` and `r` (m), and optionally `vx,vy` (m/s), `T`
    /// (K), `spin` (rad/s), `density` (kg/m3) and `material`, the name of that of one of the groups. They are used
    /// instead of the values of the group. Other columns are not used, and lines that begin with # are skipped.
    pub file: PathBuf,
}
