//! The tables of grains, walls and contacts.

use super::Coordinates;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use voidage_dem::{Cohesion, Conduction, Settings};

/// A material of grains or walls.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Density of the solid, kg/m3. Above 0.
    pub density: f64,
    /// Coulomb friction coefficient between grains; two materials meet with the smaller one. Default 0.
    #[serde(default)]
    pub friction: f64,
    /// Coefficient of resistance to rolling between grains, 0 to 1: a contact resists the relative spin of its two
    /// grains by a moment of up to this times R p, p being the normal force and R = r1 r2 / (r1 + r2), at a wall r.
    /// Two materials meet with the smaller one. Grains must spin. Default 0.
    #[serde(default)]
    pub rolling: f64,
    /// Coefficient of normal restitution, 0 to 1; two materials meet with the smaller one. Default 0.
    #[serde(default)]
    pub restitution: f64,
    /// Young's modulus, Pa; asked for by every law of contact conduction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub young: Option<f64>,
    /// Poisson's ratio, -1 to 0.5; asked for by every law of contact conduction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poisson: Option<f64>,
    /// Thermal conductivity, W/(m K); asked for by every law of contact conduction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductivity: Option<f64>,
    /// Heat capacity, J/(kg K); asked for when the grains have a temperature.
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
    /// mass: `{log-normal = {..}}`, `{rosin-rammler = {..}}`, `{sieve = {..}}`. Not with a CSV file or a state, which
    /// have their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<Radius>,
    /// Share of the disc that is solid, above 0 up to 1: in a fluid 0.8165 makes the densest bed of discs as dense as
    /// one of spheres. Default 1.
    #[serde(default = "one")]
    pub solidity: f64,
    /// How many: `{count = n}`, `{mass = m}` (kg; kg per m of depth in the plane) or `"fill"`; of a source how many in
    /// all.
    /// Default `"fill"`, of a source without end.
    #[serde(default)]
    pub amount: Amount,
    /// Where they start.
    pub placement: Placement,
    /// Velocity at the start, or of grains that a source lets in, m/s. Default: at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<Coordinates>,
    /// Temperature at the start, or of grains that a source lets in, K. Default: grains have no temperature; all groups
    /// have one or none has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Held in place: the grains never move. Default false.
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
    /// Radii uniformly distributed between these two, m: so is their number, whatever their mass.
    Uniform([f64; 2]),
    /// The logarithm of the radius is normally distributed.
    LogNormal(LogNormal),
    /// The law of Rosin and Rammler for what was ground.
    RosinRammler(RosinRammler),
    /// What sieves let pass.
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
    /// Radius that half are below, m.
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
    /// Radius that 63.2 % are below, m.
    pub scale: f64,
    /// Exponent: the larger, the narrower. Above 0.
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
    /// As many as come nearest to this mass, kg (kg per m of depth in the plane); at least half of that of one grain.
    Mass(f64),
    /// This many.
    Count(usize),
    /// As many as the place holds: a box up to its top, all points of a lattice, all rows of a file.
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
    /// Poured together with the grains of an earlier group, mixed at random: the number of that group, counted from
    /// 0. Both say by count or mass how many they are.
    With(usize),
    /// As another run left them: places, radii, velocities, spins, temperatures and contacts.
    State(StateFile),
    /// Let in while the run goes on, at random places of a box where they overlap neither grains nor walls. A grain
    /// that finds no place waits, and the run says so.
    Source(GrainSource),
}

/// The grains of a checkpoint of another run, as the start of this one.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StateFile {
    /// Checkpoint of any run with grains, such as `out/NAME/checkpoint.voidage`, path relative to the scene. Contacts
    /// with walls are taken over where a wall has the same name in both.
    pub file: PathBuf,
    /// Number of the group of that run, counted from 0. Default: all its grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<u8>,
    /// Whether the grains begin at rest. Default false: with the velocities and spins that they had.
    #[serde(default)]
    pub still: bool,
}

/// A box in which grains appear while the run goes on. A fluid in it is told of the volume that they take.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GrainSource {
    /// Name, for messages and for the columns of series.csv.
    pub name: String,
    /// Lower corner of the box that holds the whole grains, m.
    pub lower: Coordinates,
    /// Upper corner of the box that holds the whole grains, m.
    pub upper: Coordinates,
    /// How much comes in by time: `{grains = n}` (1/s) or `{mass = m}` (kg/s; kg/s per m of depth in the plane).
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

/// Takes grains out of the run: those whose centres cross a line, or are in a box at the end of a step. A fluid there
/// is told of the volume that it gets back.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sink {
    /// Name, for messages and for the columns of series.csv.
    pub name: String,
    /// First end of the line, m. With `to`, or `lower` and `upper` instead of both.
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

/// A box into which grains are poured from above, on its floor, between its sides and on the walls in it (as they stand
/// at time 0).
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Deposit {
    /// Lower corner of the box, m.
    pub lower: Coordinates,
    /// Upper corner of the box, m. Grains are let go below its top.
    pub upper: Coordinates,
    /// Seed of the random numbers. Default 1.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// How the bed is built: `"drop-and-roll"`, each grain let go at a random place, falling and rolling to where it is
    /// held; or `"dense"`, above the lowest place, and of eight grains the one that fits there best. Default
    /// `"drop-and-roll"`.
    #[serde(default)]
    pub method: Method,
    /// Coulomb friction coefficient while the bed settles, between grains and at walls: 0 gives the densest bed.
    /// Default: that of the materials and walls.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Whether contacts bring the bed to rest before time 0; else it starts as it was built, and may settle then.
    /// Default true.
    #[serde(default = "yes")]
    pub settle: bool,
}

/// How a bed is built before it settles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Each grain is let go at a random place.
    #[default]
    DropAndRoll,
    /// Each grain is let go above the lowest place, and of eight grains the one that fits there best.
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
    /// CSV file with a header, path relative to the scene: columns `x,y` and `r` (m), and optionally `vx,vy` (m/s) and
    /// `T` (K), which go before the values of the group.
    pub file: PathBuf,
}

/// A straight wall: a segment in the plane.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Name, for messages and records.
    pub name: String,
    /// First end, m. With `to`, or `along` instead of both.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub from: Coordinates,
    /// Second end, m.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub to: Coordinates,
    /// Name of a part of the boundary of the mesh that the wall follows, where the mesh is at the start, as straight
    /// walls. Default: none, `from` and `to` say where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along: Option<String>,
    /// Name of one of the materials: friction, rolling, restitution and conductivity. Default: none, a perfect
    /// conductor of heat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Coulomb friction coefficient between the wall and grains. Default: that of the material, or 0 without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of resistance to rolling between the wall and grains, 0 to 1. Default: that of the material, or 0
    /// without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rolling: Option<f64>,
    /// Coefficient of normal restitution between the wall and grains. Default: that of the material, or 0 without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
    /// Temperature, K. Default: none, no heat passes between the wall and grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Time at which it vanishes, s: a gate that is gone at once. Default: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<f64>,
    /// How it moves. Default: not at all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
}

/// How a wall moves.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// Constant velocity, m/s.
    Velocity(Coordinates),
    /// To and fro along a line.
    Oscillate(Oscillation),
    /// Round a point.
    Rotate(Rotation),
    /// By a table, linear between its rows; at rest before the first and after the last.
    Table(MotionTable),
}

/// A motion by a table: a turn about a centre that is carried along.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionTable {
    /// Rows `[t, x, y, angle]`: time, s, which increases; the way of the centre from where it is given, m; the angle,
    /// rad, anticlockwise. With a file, the rows are read from it.
    #[serde(default)]
    pub rows: Vec<[f64; 4]>,
    /// CSV file with a header and the columns `t,x,y,angle`, path relative to the scene, instead of `rows`. Default:
    /// none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Centre of the turn where the wall is given, m; about it the torque in series.csv is. Default: the middle of
    /// the wall.
    #[serde(default, skip_serializing_if = "Coordinates::is_empty")]
    pub centre: Coordinates,
}

/// A displacement `amplitude sin(2 pi frequency t + phase)`, less its value at t = 0.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Oscillation {
    /// Amplitude, m.
    pub amplitude: Coordinates,
    /// Frequency, Hz.
    pub frequency: f64,
    /// Phase, rad. Default 0.
    #[serde(default)]
    pub phase: f64,
}

/// A rotation round a point.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    /// The point that stays, m.
    pub centre: Coordinates,
    /// Angular velocity, rad/s, positive anticlockwise.
    pub rate: f64,
}

/// How contacts are solved.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contacts {
    /// Energy that the error of the velocities may have, as a share of the energy of what a sub-step changes of them.
    /// At rest, where little changes, it is a share of 0.5 % of the energy that the forces of a step bring. A grain
    /// whose contacts take all that forces bring but a hundredth of that energy rests: it stays where it is. Above 0,
    /// at most 0.1: with more, unsolved contacts would count as solved. Default 0.02, with which a grain rests at 1e-3
    /// of the speed that forces give in a step.
    pub tolerance: f64,
    /// Most sweeps of a step; a step that reaches it is counted as not converged. Default 1000.
    pub max_sweeps: usize,
    /// Whether contacts that these sweeps leave closing go to an interior-point method: for grains whose masses lie far apart and
    /// for friction above one, up to 10,000 grains. Not with resistance to rolling. Default false.
    pub interior: bool,
    /// Share of its radius that a grain may cross in one sub-step. Default 0.5.
    pub max_travel: f64,
    /// Most sub-steps of a step: what is left then is gone in the last. Who flies far in it may pass into others, so
    /// that the step counts as not converged. Default 1000.
    pub max_substeps: usize,
    /// Overlap of two grains, or of a grain and a wall, that ends the run, as a share of the radius of the smaller
    /// grain. From 0.05 to 1, where the centre of a grain is on the wall. A run says at which step the overlap first
    /// exceeds 0.05. Default 0.5.
    pub max_penetration: f64,
    /// Whether grains spin. Default true.
    pub rotation: bool,
    /// Law of heat conduction through contacts: `"henry"`, `"henry-printed"`, `"line"` (plane) or `"hertz"` (space).
    /// Default: contacts conduct no heat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conduction: Option<Conduction>,
    /// Cohesion of grains that touch. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cohesion: Option<Cohesion>,
    /// Coefficients of pairs of materials, in place of the smaller ones of both. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<Pair>,
}

/// Coefficients between two materials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Names of the two materials, of grains or walls; the same twice for grains of one material among themselves.
    /// What a wall says itself of its friction, rolling or restitution goes before.
    pub materials: [String; 2],
    /// Coulomb friction coefficient. Default: the smaller one of the two, and at a wall that of the wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of resistance to rolling, 0 to 1. Default: the smaller one of the two, and at a wall that of the
    /// wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rolling: Option<f64>,
    /// Coefficient of normal restitution, 0 to 1. Default: the smaller one of the two, and at a wall that of the wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

impl Default for Contacts {
    fn default() -> Self {
        Contacts {
            tolerance: Settings::<2>::default().tolerance,
            max_sweeps: 1000,
            interior: false,
            max_travel: 0.5,
            max_substeps: 1000,
            max_penetration: 0.5,
            rotation: true,
            conduction: None,
            cohesion: None,
            pairs: vec![],
        }
    }
}
