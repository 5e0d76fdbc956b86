//! Single modes of homogeneous mixtures: their amplification per step is known in closed form.
//!
//! Speeds are so small that drag is linear, convection is below round-off and no grain moves. With beta the drag per
//! volume and slip: A = beta dt/(eps rho_f), B = beta dt/(phi rho_p) = dt over the relaxation time of a grain,
//! r = (rho_f/rho_p)(phi/eps), so that A = B phi rho_p/(eps rho_f), and K = B/eps in a closed box, where eps u + phi v
//! = 0.
//!
//! The schemes that carry an impulse from step to step have more states than a mode has speeds: theirs are linear maps,
//! with the forcing f in the units of gamma and the impulse j in those of gamma dt.

use super::axis::{Axis, Sample, Tally, Verdict, product};
use nalgebra::DMatrix;
use voidage_campaign::{Effort, largest, worse};
use voidage_coupling::closure::{HeatTransfer, Surroundings, ThermalFluid, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::scheme::anchored::RETURNED;
use voidage_coupling::scheme::sub_cycled::SubCycling;
use voidage_coupling::{Coupled, HEAT, Result, TEMPERATURE};
use voidage_dem::{Dem, Load, Material, Settings, Wall};
use voidage_fluid::Mesh;
use voidage_fluid::conditions::FlowCondition;
use voidage_fluid::transport::Scalar;
use voidage_verification::models::{
    self, FluidSet, Vec2, endless, grains, grid, hot_grains, one_per_cell, three_per_cell, weightless,
};

/// Grain over fluid density.
const DENSITY: [f64; 9] = [0.01, 0.1, 0.5, 1.0, 1.5, 2.65, 10.0, 100.0, 2500.0];
/// Step over relaxation time of the grains.
const STEP: [f64; 10] = [1e-3, 1e-2, 1e-1, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6];
/// Voidage.
const VOIDAGE: [f64; 7] = [0.9, 0.6, 0.4, 0.1, 1e-2, 1e-3, 1e-4];

const RHO_F: f64 = 3.0;
const VISCOSITY: f64 = 1e-2;
/// A power of two, so that grains lie on their floors without a gap or an overlap from rounding.
const RADIUS: f64 = 1.0 / 16384.0;
/// Deviation of a factor from theory, as a share of the mode.
const ALLOWED: f64 = 1e-3;

/// The axes of this file.
pub const AXES: &[Axis] = &[
    Axis {
        name: "closed-box",
        title: "Grains against fluid in a closed box, voidage 0.6",
        source: "closed form: roots of the closed box",
        labels: ["grain density / fluid density", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.01, 1.0, 2500.0], &[1e-2, 1.0, 1e3, 1e6]),
            Effort::Full => product(&DENSITY, &STEP),
        },
        run: |[density, step], scheme, _| closed_box(Mixture { density, solid: 0.4 }, step, scheme),
        theory: |[density, step], scheme| {
            Some(Mixture { density, solid: 0.4 }.root(scheme, step) < 1.0 + 1e-9)
        },
    },
    Axis {
        name: "closed-box-voidage",
        title: "The same at grain density / fluid density 2.65",
        source: "closed form: roots of the closed box",
        labels: ["voidage", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.9, 1e-2, 1e-4], &[1e-2, 1.0, 1e3]),
            Effort::Full => product(&VOIDAGE, &STEP),
        },
        run: |[voidage, step], scheme, _| {
            closed_box(Mixture { density: 2.65, solid: 1.0 - voidage }, step, scheme)
        },
        theory: |[voidage, step], scheme| {
            let mixture = Mixture { density: 2.65, solid: 1.0 - voidage };
            mixture.resolved(scheme, step).then(|| mixture.root(scheme, step) < 1.0 + 1e-9)
        },
    },
    Axis {
        name: "slip",
        title: "Slip without constraint, voidage 0.6",
        source: "closed form: slip in a periodic box",
        labels: ["grain density / fluid density", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.01, 1.0, 2500.0], &[1e-2, 1.0, 1e3, 1e6]),
            Effort::Full => product(&DENSITY, &STEP),
        },
        run: |[density, step], scheme, _| slip(Mixture { density, solid: 0.4 }, step, scheme, false),
        theory: |[density, step], scheme| Mixture { density, solid: 0.4 }.slip_theory(scheme, step),
    },
    Axis {
        name: "held-shear",
        title: "Shear of the fluid in a bed that rests on walls, voidage 0.6",
        source: "closed form: shear of the fluid in a held bed, by scheme",
        labels: ["grain density / fluid density", "step / relaxation time of the grain"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1, 2.65, 2500.0], &[1e-2, 1.0, 1e2, 1e4]),
            Effort::Full => product(&DENSITY, &STEP),
        },
        run: |[density, step], scheme, _| slip(Mixture { density, solid: 0.4 }, step, scheme, true),
        // Without contact forces in the prediction a closed box takes the weight, and the walls no longer hold the
        // grains.
        theory: |[density, step], scheme| match scheme {
            SchemeName::HenryFree | SchemeName::Lagged => None,
            _ => Some(Mixture { density, solid: 0.4 }.held_root(scheme, step) <= 1.0),
        },
    },
    Axis {
        name: "heat",
        title: "Temperatures of grains and fluid in an insulated box",
        source: "closed form: temperatures of a closed box",
        labels: ["capacity of grains / of fluid, per volume", "hA dt / (m c)"],
        coupled: true,
        points: |effort| match effort {
            Effort::Quick => product(&[0.1, 1000.0], &[1e-2, 1.0, 1e3, 1e6]),
            Effort::Full => product(&[0.01, 0.1, 1.0, 10.0, 1000.0], &STEP),
        },
        run: |[ratio, step], scheme, _| heat(ratio, step, scheme),
        theory: |[ratio, step], scheme| {
            let factor = match Splitting::of(scheme, step) {
                Some(splitting) => splitting.slip(step * ratio).root(),
                None => heat_factor(ratio, scheme, step),
            };
            known(factor, scheme, step, true)
        },
    },
];

/// A homogeneous mixture.
#[derive(Clone, Copy, Debug)]
struct Mixture {
    /// rho_p / rho_f.
    density: f64,
    /// phi.
    solid: f64,
}

impl Mixture {
    fn voidage(&self) -> f64 {
        1.0 - self.solid
    }

    /// A / B.
    fn ratio(&self) -> f64 {
        self.solid * self.density / self.voidage()
    }

    /// v' = p v + q v_old in the closed box: (p, q).
    fn recursion(&self, scheme: SchemeName, b: f64) -> (f64, f64) {
        let eps = self.voidage();
        let (r, k) = (self.solid / eps / self.density, b / eps);
        match scheme {
            SchemeName::Explicit => (1.0 - r - k / eps, r),
            SchemeName::Lagged => ((1.0 - r - k * self.solid / eps) / (1.0 + k), r / (1.0 + k)),
            _ => ((1.0 + r) / (1.0 + r + k / eps), 0.0),
        }
    }

    /// Whether the iterations of a scheme do not make more of the residual of the linear solver than of the mode: those of
    /// `gauss-seidel` multiply it by X + Y (`voidage_coupling::scheme::anchored`).
    fn resolved(&self, scheme: SchemeName, b: f64) -> bool {
        let (eps, phi) = (self.voidage(), self.solid);
        let amplified = (b * phi / (eps * eps) * (1.0 + eps) + phi / eps / self.density) / (1.0 + b);
        scheme != SchemeName::GaussSeidel || amplified < 1e5
    }

    /// The largest factor in the closed box, in magnitude.
    fn root(&self, scheme: SchemeName, b: f64) -> f64 {
        match self.closed_box(scheme, b) {
            Some(map) => map.root(),
            None => larger_root(self.recursion(scheme, b)),
        }
    }

    /// The closed box with a scheme that splits: of v, u, f and j.
    fn closed_box(&self, scheme: SchemeName, b: f64) -> Option<Map> {
        let splitting = Splitting::of(scheme, b)?;
        let (eps, phi) = (self.voidage(), self.solid);
        let pushed =
            |u: f64, now: f64, expected: f64| (now - u) / self.density / b + phi / eps * (now - expected);
        // Before the first step the fluid is solved once, if the grains move before it.
        let [u, v] = [-phi / eps, 1.0];
        Some(Map::new([v, u, pushed(u, u, v) + u, 0.0], |[v, u, f, j]| {
            let [before, after] = splitting.motions();
            let met = before.end(v, f);
            let expected = met - RETURNED * j;
            let now = -phi / eps * met;
            let forcing = pushed(u, now, expected) + now;
            let lost = forcing - expected;
            let got = before.got(v, f) + after.got(met, forcing);
            // Without the pressures, of which each acts for a whole step.
            let ahead = before.time * ((f - u) - (forcing - now));
            [after.end(met, forcing), now, forcing, j + got - lost - ahead]
        }))
    }

    fn slip_factor(&self, scheme: SchemeName, b: f64) -> f64 {
        let a = b * self.ratio();
        match scheme {
            SchemeName::Explicit => (1.0 - b) / (1.0 + a),
            _ => 1.0 / (1.0 + a + b),
        }
    }

    fn slip_theory(&self, scheme: SchemeName, b: f64) -> Option<bool> {
        let factor = match Splitting::of(scheme, b) {
            Some(splitting) => splitting.slip(b * self.ratio()).root(),
            None => self.slip_factor(scheme, b),
        };
        known(factor, scheme, b, self.root(scheme, b) <= 1.0)
    }

    /// u' = p u + q u_old of the shear of the fluid between held grains: (p, q).
    ///
    /// `henry` moves the grains by the force F = gamma (u - v*) of its law, so that the contact force it predicts with
    /// is -F: (1 + B) v*' = B (u' - u + v*), and (1 + A) u' = u + A v*'. Eliminating v* gives (1 + A + B) u'' = (1 + 2
    /// B) u' - B u, stable for all A and B. (The factor (1 + B - A B)/(1 + A + B) holds where the contact force answers
    /// to gamma u instead: implicit drag with this prediction.)
    fn held_recursion(&self, scheme: SchemeName, b: f64) -> (f64, f64) {
        let a = b * self.ratio();
        match scheme {
            SchemeName::Henry => ((1.0 + 2.0 * b) / (1.0 + a + b), -b / (1.0 + a + b)),
            SchemeName::HenryFree | SchemeName::Lagged => ((1.0 + b) / (1.0 + a + b), 0.0),
            _ => (1.0 / (1.0 + a), 0.0),
        }
    }

    fn held_root(&self, scheme: SchemeName, b: f64) -> f64 {
        match self.held(scheme, b) {
            Some(map) => map.root(),
            None => larger_root(self.held_recursion(scheme, b)),
        }
    }

    /// The same with a scheme that splits: of u, f and j. The grains get f, since they keep their place.
    fn held(&self, scheme: SchemeName, b: f64) -> Option<Map> {
        let splitting = Splitting::of(scheme, b)?;
        let a = b * self.ratio();
        Some(Map::new([1.0, 1.0 / (1.0 + a), 0.0], |[u, f, j]| {
            let [before, after] = splitting.motions();
            let expected = -RETURNED * j;
            let now = (u + a * expected) / (1.0 + a);
            [now, now, j + before.time * f + after.time * now - (now - expected)]
        }))
    }

    /// Step, s, for which the grains' relaxation times B go by; and the fluid.
    fn step(&self, set: &FluidSet, b: f64) -> f64 {
        let around = Surroundings {
            slip: 0.0,
            voidage: self.voidage(),
            diameter: 2.0 * RADIUS,
            density: RHO_F,
            viscosity: VISCOSITY,
        };
        b * self.density * RHO_F / set.laws(None).drag.coefficient(&around, VoidageFunction::None)
    }

    /// Three grains per cell that together fill the share phi of a mesh of equal cells.
    fn grains(&self, mesh: &Mesh<2>, settings: Settings<2>, floors: bool) -> Result<Dem<2>> {
        let material = Material { density: self.density * RHO_F, friction: 10.0, ..Material::default() };
        let round = |x: f64| (x * 2f64.powi(30)).round() / 2f64.powi(30);
        let places: Vec<Vec2> = three_per_cell(mesh).iter().map(|place| place.map(round)).collect();
        let mut dem = grains(places.clone(), RADIUS, material.clone(), settings.clone())?;
        if floors {
            let walls = places.iter().map(floor).collect();
            dem = Dem::new(dem.particles, walls, vec![material], settings)?;
        }
        let volume = self.solid * mesh.measure(0) / 3.0;
        dem.particles.volume.fill(volume);
        dem.particles.mass.fill(self.density * RHO_F * volume);
        Ok(dem)
    }
}

/// A motion of a grain in a step of a scheme that splits: for a share of the step, in some steps of its own.
#[derive(Clone, Copy)]
struct Motion {
    /// Share of the step.
    time: f64,
    /// What is left of the velocity that the grain had.
    left: f64,
    /// Mean of what is left, over the motion.
    mean: f64,
}

impl Motion {
    /// A motion of relaxation times `b` in `steps` steps.
    fn new(time: f64, b: f64, steps: usize, implicit: bool) -> Self {
        let each = b / steps as f64;
        let left = if implicit { 1.0 / (1.0 + each) } else { 1.0 - each };
        let left = left.powi(steps as i32);
        Self { time, left, mean: (1.0 - left) / b }
    }

    /// The velocity at its end, under a forcing.
    fn end(&self, v: f64, forcing: f64) -> f64 {
        forcing + (v - forcing) * self.left
    }

    /// What the grain gets in it, in units of gamma dt.
    fn got(&self, v: f64, forcing: f64) -> f64 {
        -self.time * (v - forcing) * self.mean
    }
}

/// The motions of the grains before and after the fluid is solved.
#[derive(Clone, Copy)]
struct Splitting([Motion; 2]);

impl Splitting {
    /// That of a scheme in a step of `b` relaxation times; none if it does not split.
    fn of(scheme: SchemeName, b: f64) -> Option<Self> {
        let steps = SubCycling::default().steps;
        let nothing = Motion { time: 0.0, left: 1.0, mean: 1.0 };
        let half = Motion::new(0.5, 0.5 * b, 1, true);
        match scheme {
            SchemeName::SubCycled => Some(Self([nothing, Motion::new(1.0, b, steps, true)])),
            SchemeName::SubCycledExplicit => Some(Self([nothing, Motion::new(1.0, b, steps, false)])),
            SchemeName::Strang => Some(Self([half, half])),
            _ => None,
        }
    }

    fn motions(&self) -> [Motion; 2] {
        self.0
    }

    /// Slip without constraint: of v - u, f and j, with u as the origin. `a` is A, or that of the temperatures.
    fn slip(&self, a: f64) -> Map {
        Map::new([1.0, a / (1.0 + a), 0.0], |[slip, f, j]| {
            let [before, after] = self.motions();
            let met = before.end(slip, f);
            let expected = met - RETURNED * j;
            let now = a * expected / (1.0 + a);
            let got = before.got(slip, f) + after.got(met, now);
            [after.end(met, now) - now, 0.0, j + got - (now - expected)]
        })
    }
}

/// A linear map of the states of a mode, of which the first is seen.
struct Map {
    matrix: DMatrix<f64>,
    start: Vec<f64>,
}

impl Map {
    fn new<const N: usize>(start: [f64; N], step: impl Fn([f64; N]) -> [f64; N]) -> Self {
        let column = |k: usize| step(std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 }));
        let columns: Vec<[f64; N]> = (0..N).map(column).collect();
        Self { matrix: DMatrix::from_fn(N, N, |i, k| columns[k][i]), start: start.to_vec() }
    }

    /// The largest eigenvalue, in magnitude.
    fn root(&self) -> f64 {
        largest(self.matrix.complex_eigenvalues().iter().map(|value| value.norm()))
    }

    /// What is seen after each step, from the start on.
    fn course(&self) -> Vec<f64> {
        let mut state = nalgebra::DVector::from_column_slice(&self.start);
        let mut seen = vec![state[0]];
        for _ in 0..STEPS {
            state = &self.matrix * state;
            seen.push(state[0]);
        }
        seen
    }
}

/// The larger root of z^2 = p z + q, in magnitude.
fn larger_root((p, q): (f64, f64)) -> f64 {
    let square = 0.25 * p * p + q;
    match square >= 0.0 {
        true => 0.5 * p.abs() + square.sqrt(),
        false => (-q).sqrt(),
    }
}

/// What a factor says of a point: unstable above one. Below one the mode is stable, but with the explicit scheme
/// rounding may grow in others: in grains whose mean the fluid does not see (by 1 - B), in the constraint (`quiet`).
fn known(factor: f64, scheme: SchemeName, b: f64, quiet: bool) -> Option<bool> {
    let steps = match scheme {
        SchemeName::Explicit => 1.0,
        SchemeName::SubCycledExplicit => SubCycling::default().steps as f64,
        _ => f64::INFINITY,
    };
    let late =
        matches!(scheme, SchemeName::Explicit | SchemeName::Lagged) || Splitting::of(scheme, b).is_some();
    match factor.abs() <= 1.0 + 1e-9 {
        true if (late && !quiet) || b > 2.0 * steps => None,
        stable => Some(stable),
    }
}

/// The fluid of all mixtures.
fn fluid() -> FluidSet {
    FluidSet::new(RHO_F, VISCOSITY)
}

/// A short wall that a grain rests on.
fn floor(place: &Vec2) -> Wall<2> {
    let end = |side: f64| place + Vec2::new(side * RADIUS, -RADIUS);
    Wall { friction: 10.0, ..Wall::new("floor", end(-1.0), end(1.0)) }
}

/// Steps of a mode at most, and the size, as a share of the first, below which it is not followed any longer.
const STEPS: usize = 12;
const VANISHED: f64 = 1e-6;
/// Size, as a multiple of the first, from which it has grown without bound.
const GROWN: f64 = 1e6;

fn ended(share: f64) -> bool {
    !(VANISHED..GROWN).contains(&share.abs())
}

/// A mode over the steps: its size, what each step misses of the recursion (as a share of the mode), what it took.
struct Course {
    sizes: Vec<f64>,
    missed: Vec<f64>,
    tally: Tally,
}

/// Elements of the closed box along the mode.
const ELEMENTS: usize = 96;
/// Voidage below which linear elements do not resolve the mode: their error is of the order of (k h)^2 / eps.
const RESOLVED: f64 = 0.39;

/// Half a wave of grains against fluid between two ends, v = sin(pi x/L), u = -(phi/eps) v, on two meshes: what is left
/// when the error of second order is extrapolated away is compared with theory.
fn closed_box(mixture: Mixture, b: f64, scheme: SchemeName) -> Result<Sample> {
    let [coarse, fine] =
        [half_wave(mixture, b, scheme, ELEMENTS)?, half_wave(mixture, b, scheme, 2 * ELEMENTS)?];
    let extrapolated = coarse.missed.iter().zip(&fine.missed).map(|(c, f)| (4.0 * f - c).abs() / 3.0);
    let mut deviation = largest(extrapolated);
    let steps = fine.missed.len();
    let growth = (fine.sizes[steps] / fine.sizes[1]).abs().powf(1.0 / (steps as f64 - 1.0).max(1.0));
    let root = mixture.root(scheme, b);
    if mixture.voidage() < RESOLVED && (growth <= 1.0) == (root <= 1.0) {
        deviation = 0.0;
    }
    Ok(judge(deviation, growth, root, fine.tally))
}

fn half_wave(mixture: Mixture, b: f64, scheme: SchemeName, count: usize) -> Result<Course> {
    // So slow that grains stay where they are in a step that multiplies their velocities by 1e50, as ten explicit steps of
    // the grains do in a fluid a million times heavier.
    let creep = 1e-70;
    let set = fluid().flow("bottom", FlowCondition::Slip).flow("top", FlowCondition::Slip);
    let mesh = grid([1.0, 1.0 / count as f64], [count, 1])?;
    let shape = |x: &Vec2| (std::f64::consts::PI * x.x).sin();
    let back = -mixture.solid / mixture.voidage() * creep;
    let mut start = set.rest(&mesh, 0.0);
    for (u, x) in start.velocity.iter_mut().zip(&mesh.points) {
        u.x = back * shape(x);
    }
    let mut dem = mixture.grains(&mesh, weightless(), false)?;
    let weight: Vec<f64> = dem.particles.position.iter().map(shape).collect();
    for (v, shape) in dem.particles.velocity.iter_mut().zip(&weight) {
        v.x = creep * shape;
    }
    let mut system = set.with_grains(set.build(mesh, start)?, dem, set.laws(None), scheme)?;
    if let Some(interaction) = system.interaction_mut() {
        interaction.at.velocity = weight.iter().map(|shape| Vec2::new(back * shape, 0.0)).collect();
    }
    system.set_scheme(scheme.build(&models::exact_options(scheme))?);
    let mode = |system: &Coupled<2>| {
        let velocity = system.grains().into_iter().flat_map(|grains| &grains.particles.velocity);
        velocity.zip(&weight).map(|(v, s)| v.x * s).sum::<f64>()
    };
    let (dt, (p, q)) = (mixture.step(&set, b), mixture.recursion(scheme, b));
    let first = mode(&system);
    let foreseen = mixture.closed_box(scheme, b).map(|map| map.course());
    let mut course = Course { sizes: vec![1.0], missed: vec![], tally: Tally::default() };
    let mut old: f64 = 1.0;
    for step in 0..STEPS {
        let report = system.step(dt)?;
        course.tally.add(&report);
        let (now, last) = (mode(&system) / first, course.sizes[step]);
        let size = now.abs().max(last.abs()).max(old.abs());
        let expected = foreseen.as_ref().map_or(p * last + q * old, |course| course[step + 1]);
        course.missed.push((now - expected) / size);
        course.sizes.push(now);
        old = last;
        if ended(now) {
            break;
        }
    }
    Ok(course)
}

/// A mode that follows its theory is as stable as theory says; else its growth decides.
fn judge(deviation: f64, growth: f64, root: f64, tally: Tally) -> Sample {
    let verdict = match deviation <= ALLOWED {
        true if root <= 1.0 + 1e-9 => Verdict::Passes,
        true => Verdict::Unstable,
        false if growth <= 1.0 => Verdict::Wrong,
        false => Verdict::Unstable,
    };
    Sample::new(verdict, growth, root, tally)
}

/// The fluid moves as one against the grains in a mixture without an end: no strain, no divergence, nothing but drag
/// acts. The grains are free, or each rests on a wall with friction under its weight.
fn slip(mixture: Mixture, b: f64, scheme: SchemeName, held: bool) -> Result<Sample> {
    let mut set = fluid();
    set.conditions.clear();
    let mesh = endless(4)?;
    let dt = mixture.step(&set, b);
    // Held grains: weight enough for the walls to hold them by friction, and drag linear at a Reynolds number of 1e-8.
    // The contacts are solved to the last digit, since those that push by less than the tolerance are left alone.
    let (creep, settings) = match held {
        true => {
            let creep = 1e-8 * VISCOSITY / (RHO_F * 2.0 * RADIUS);
            let gravity = Vec2::new(0.0, -1e2 * creep * b / dt);
            (creep, Settings { gravity, tolerance: 1e-26, ..Settings::default() })
        }
        false => (1e-16, weightless()),
    };
    let moving = Vec2::new(creep, 0.0);
    let mut start = set.rest(&mesh, 0.0);
    let mut dem = mixture.grains(&mesh, settings, held)?;
    if held {
        // The contacts know the weight before the fluid moves.
        dem.step(dt, &Load::default());
        start.velocity.fill(moving);
    } else {
        dem.particles.velocity.fill(moving);
    }
    let at = if held { moving } else { Vec2::zeros() };
    let mut system = set.with_grains(set.build(mesh, start)?, dem, set.laws(None), scheme)?;
    if let Some(interaction) = system.interaction_mut() {
        interaction.at.velocity.fill(at);
    }
    system.set_scheme(scheme.build(&models::exact_options(scheme))?);
    let (p, q) = match held {
        true => mixture.held_recursion(scheme, b),
        false => (mixture.slip_factor(scheme, b), 0.0),
    };
    let map = match held {
        true => mixture.held(scheme, b),
        false => Splitting::of(scheme, b).map(|splitting| splitting.slip(b * mixture.ratio())),
    };
    let foreseen = map.as_ref().map(Map::course);
    let mut last = models::slip(&system, held);
    // A recursion of two steps is compared from the second step on.
    let (first, mut worst, mut tally, mut old) = (last, 0.0f64, Tally::default(), None);
    while tally.steps < STEPS {
        let report = system.step(dt)?;
        tally.add(&report);
        let now = models::slip(&system, held);
        if let Some(old) = old.or((q == 0.0).then_some(0.0)) {
            let size = now.abs().max(last.abs()).max(f64::abs(old));
            let expected = match &foreseen {
                Some(course) => first * course[tally.steps],
                None => p * last + q * old,
            };
            worst = worse(worst, (now - expected).abs() / size);
        }
        old = Some(last);
        last = now;
        if ended(now / first) {
            break;
        }
    }
    let growth = (last / first).abs().powf(1.0 / tally.steps as f64);
    Ok(judge(worst, growth, map.map_or_else(|| larger_root((p, q)), |map| map.root()), tally))
}

fn heat_factor(ratio: f64, scheme: SchemeName, b: f64) -> f64 {
    match scheme {
        SchemeName::Explicit => (1.0 - b) / (1.0 + b * ratio),
        _ => 1.0 / (1.0 + b * ratio + b),
    }
}

/// Grains at 70, fluid at 20 degrees in an insulated box. `ratio` is that of the capacities per volume of mixture.
fn heat(ratio: f64, b: f64, scheme: SchemeName) -> Result<Sample> {
    let (capacity, conductivity, radius) = (3000.0, 0.5, 0.2);
    let mut set = fluid();
    let scalar = Scalar::new(TEMPERATURE, capacity, conductivity);
    set.scalars = vec![Scalar { expansion: 0.0, reference: 0.0, ..scalar }];
    let mesh = grid([4.0, 4.0], [4, 4])?;
    let start = set.rest(&mesh, 20.0);
    let phi = std::f64::consts::PI * radius * radius / mesh.measure(0);
    let own = ratio * (1.0 - phi) * capacity / phi / 7.0;
    let material = Material { density: 7.0, heat_capacity: own, ..Material::default() };
    let dem = hot_grains(one_per_cell(&mesh), radius, material, weightless(), 70.0)?;
    let thermal = ThermalFluid { conductivity, prandtl: 1000.0 * VISCOSITY / conductivity };
    let around = Surroundings {
        slip: 0.0,
        voidage: 1.0 - phi,
        diameter: 2.0 * radius,
        density: RHO_F,
        viscosity: VISCOSITY,
    };
    let transfer = HeatTransfer::RanzMarshall.coefficient(&around, &thermal, VoidageFunction::None);
    let dt = b * 7.0 * own / transfer;
    let laws = set.laws(Some(thermal));
    let mut system = set.with_grains(set.build(mesh, start)?, dem, laws, scheme)?;
    if let Some(interaction) = system.interaction_mut() {
        interaction.at.temperature.fill(20.0);
    }
    system.set_scheme(scheme.build(&models::exact_options(scheme))?);
    let factor = heat_factor(ratio, scheme, b);
    let map = Splitting::of(scheme, b).map(|splitting| splitting.slip(b * ratio));
    let foreseen = map.as_ref().map(Map::course);
    let (mut last, mut worst, mut tally) = (-50.0, 0.0f64, Tally::default());
    while tally.steps < STEPS {
        tally.add(&system.step(dt)?);
        let now = temperature_difference(&mut system)?;
        let expected = foreseen.as_ref().map_or(factor * last, |course| -50.0 * course[tally.steps]);
        worst = worse(worst, (now - expected).abs() / f64::max(now.abs(), f64::abs(last)));
        last = now;
        if ended(now / 50.0) {
            break;
        }
    }
    let growth = (last / 50.0).abs().powf(1.0 / tally.steps as f64);
    Ok(judge(worst, growth, map.map_or(factor.abs(), |map| map.root()), tally))
}

/// Of fluid and grains, K.
fn temperature_difference(system: &mut Coupled<2>) -> Result<f64> {
    let Some(fluid) = system.fluid() else { return Ok(f64::NAN) };
    let gas = fluid.accepted.scalar(HEAT).get(5).copied().unwrap_or(f64::NAN);
    let heat = system.grains().and_then(|grains| grains.particles.heat.as_ref());
    Ok(gas - heat.map_or(f64::NAN, |heat| heat.temperature[3]))
}
