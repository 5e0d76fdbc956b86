//! Heat between grains through the contacts that carry force.
//!
//! One implicit step of C dT/dt = Q - A T + sum of H (T_j - T_i), with the conductances H of the present forces and
//! the transfer A to what surrounds the grain ([`crate::Load::transfer`]):
//!
//! ```text
//!     (C/h + A + sum H) T' - sum H T'_j = C/h T + Q + sum of H_w T_w
//! ```
//!
//! a symmetric positive definite system, solved by conjugate gradients with a diagonal preconditioner; it takes one or
//! two iterations where contacts are slow and stays stable where they are fast. The fluxes q = H (T'_j - T'_i) of the
//! solution are then applied with opposite signs to both grains, (C/h + A) T'' = C/h T + Q + q: energy is conserved to
//! round-off, whatever the tolerance of the solver. (The result differs from T' by the residual over C/h + A, so that
//! is what must be small.)

use crate::memory::WALL;
use crate::scene::Scene;
use crate::{Error, Heat, Material, Result, Vector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Law of the conductance H of a contact under the normal force F; q = H (T_j - T_i). A wall counts as a body of
/// infinite radius and Young's modulus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Conduction {
    /// Henry et al., B.3: H = 4 k_s (F d* / (2 pi L E*))^(1/4), L = 1 m, with the harmonic mean
    /// k_s = 2 / (1/k_i + 1/k_j) that their text names. Not consistent in dimension; plane only.
    Henry,
    /// The same with B.4 as printed: 1/k_s = 2 (1/k_i + 1/k_j).
    HenryPrinted,
    /// Line contact of cylinders: each adds the resistance (3/2 - ln(a/R)) / (pi k) per depth, with the half width
    /// a = 2 sqrt(F R* / (pi E*)) of Hertz; plane only.
    Line,
    /// Hertz contact of spheres: H = 2 k_s a, a = (3 F R* / (4 E*))^(1/3); space only.
    Hertz,
}

/// One side of a contact as conduction sees it; a wall has no curvature and no compliance.
#[derive(Clone, Copy)]
struct Side {
    radius: f64,
    /// 1 / R.
    curvature: f64,
    /// (1 - nu^2) / E.
    compliance: f64,
    /// 1 / k.
    resistivity: f64,
}

impl Side {
    fn grain(radius: f64, m: &Material) -> Self {
        let compliance = (1.0 - m.poisson * m.poisson) / m.young;
        Self { radius, curvature: 1.0 / radius, compliance, resistivity: 1.0 / m.conductivity }
    }

    fn wall(radius: f64, conductivity: Option<f64>) -> Self {
        Self { radius, curvature: 0.0, compliance: 0.0, resistivity: conductivity.map_or(0.0, |k| 1.0 / k) }
    }
}

impl Conduction {
    fn conductance(self, force: f64, a: Side, b: Side) -> f64 {
        use std::f64::consts::PI;
        let r_star = 1.0 / (a.curvature + b.curvature);
        let compliance = a.compliance + b.compliance;
        let harmonic = 2.0 / (a.resistivity + b.resistivity);
        // d* = d_i d_j / (d_i + d_j) = 2 R*.
        let henry = 4.0 * (force * 2.0 * r_star * compliance / (2.0 * PI)).powf(0.25);
        match self {
            Self::Henry => harmonic * henry,
            Self::HenryPrinted => 0.25 * harmonic * henry,
            Self::Line => {
                let width = 2.0 * (force * r_star * compliance / PI).sqrt();
                let share = |s: Side| s.resistivity * (1.5 - (width / s.radius).min(1.0).ln()) / PI;
                1.0 / (share(a) + share(b))
            }
            Self::Hertz => 2.0 * harmonic * (0.75 * force * r_star * compliance).cbrt(),
        }
    }

    pub(crate) fn validate<const D: usize>(self, materials: &[Material]) -> Result<()> {
        match (self, D) {
            (Self::Hertz, 2) => {
                return Err(Error::Scene(
                    "conduction `hertz` is for spheres: in the plane use `line` or `henry`".into(),
                ));
            }
            (Self::Henry | Self::HenryPrinted | Self::Line, 3) => {
                return Err(Error::Scene("this law of conduction is for discs: in space use `hertz`".into()));
            }
            _ => {}
        }
        for (k, m) in materials.iter().enumerate() {
            let columns =
                [("young", m.young), ("conductivity", m.conductivity), ("heat_capacity", m.heat_capacity)];
            for (name, value) in columns {
                crate::error::check(value > 0.0, value, "conduction needs it to be positive", || {
                    format!("material {k}, {name}")
                })?;
            }
        }
        Ok(())
    }
}

/// A conducting contact: two grains, or a grain and `WALL` + number of a wall.
#[derive(Clone, Copy)]
struct Link {
    i: u32,
    j: u32,
    conductance: f64,
}

/// Buffers of the implicit step, all by grain.
#[derive(Default)]
pub(crate) struct Conductor {
    links: Vec<Link>,
    solution: Vec<f64>,
    residual: Vec<f64>,
    direction: Vec<f64>,
    image: Vec<f64>,
    /// C/h + A.
    inertia: Vec<f64>,
    diagonal: Vec<f64>,
    /// Net heat into each grain and out of each wall, W.
    pub into_grain: Vec<f64>,
    pub out_of_wall: Vec<f64>,
}

/// How the implicit step ended.
pub(crate) struct HeatOutcome {
    pub iterations: usize,
    pub converged: bool,
}

/// Change of temperature, as a share of the range of temperatures, below which the solution counts as exact.
const TOLERANCE: f64 = 1e-10;
const MAX_ITERATIONS: usize = 1000;

/// Impulse over the momentum of the larger of two grains up to which it is what rounding leaves between two that fly
/// side by side. Some laws of conduction fall with the force so slowly that it would conduct.
const ROUNDING: f64 = 1e-12;

impl Conductor {
    /// Lists the conducting contacts: grain, partner and force on the partner with its normal.
    pub fn link<const D: usize>(
        &mut self,
        law: Conduction,
        scene: &Scene<D>,
        contacts: impl Iterator<Item = (u32, u32, Vector<D>, Vector<D>)>,
    ) {
        self.links.clear();
        let p = scene.particles;
        let side =
            |i: u32| Side::grain(p.radius[i as usize], &scene.materials[p.material[i as usize] as usize]);
        let momentum = |i: u32| {
            let i = i as usize;
            let speed = p.velocity[i].norm() + scene.free_velocity(i).norm();
            if p.held(i) { 0.0 } else { p.mass[i] * speed }
        };
        for (i, j, normal, force) in contacts {
            let pressing = force.dot(&normal);
            let wall = (j & WALL != 0).then(|| &scene.walls[(j & !WALL) as usize]);
            let most = momentum(i).max(if wall.is_some() { 0.0 } else { momentum(j) });
            if pressing <= ROUNDING * most / scene.h || wall.is_some_and(|w| w.temperature.is_none()) {
                continue;
            }
            let other = wall.map_or_else(|| side(j), |w| Side::wall(p.radius[i as usize], w.conductivity));
            self.links.push(Link { i, j, conductance: law.conductance(pressing, side(i), other) });
        }
    }

    /// Both sides of each conducting contact of the last step, in the order of the contacts, and the heat from the
    /// second to the first, W; `wall` gives the temperature of a wall.
    pub fn fluxes(&self, wall: impl Fn(u32) -> f64) -> impl Iterator<Item = (u32, u32, f64)> {
        self.links.iter().map(move |l| {
            let here = self.solution[l.i as usize];
            let there = if l.j & WALL == 0 { self.solution[l.j as usize] } else { wall(l.j & !WALL) };
            (l.i, l.j, l.conductance * (there - here))
        })
    }

    /// One implicit step: fluxes for the temperatures that the links lead to within `h`.
    pub fn solve<const D: usize>(&mut self, scene: &Scene<D>, heat: &Heat) -> HeatOutcome {
        let n = heat.temperature.len();
        let wall = |j: u32| scene.walls[(j & !WALL) as usize].temperature.unwrap_or(0.0);
        self.inertia.clear();
        self.inertia.extend((0..n).map(|i| scene.thermal_inertia(i, heat.capacity[i])));
        self.diagonal.clone_from(&self.inertia);
        self.solution.clear();
        self.solution.extend((0..n).map(|i| scene.warmed(i, heat, 0.0)));
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for t in self.solution.iter().copied().chain(scene.walls.iter().filter_map(|w| w.temperature)) {
            (low, high) = (low.min(t), high.max(t));
        }
        for l in &self.links {
            self.diagonal[l.i as usize] += l.conductance;
            if l.j & WALL == 0 {
                self.diagonal[l.j as usize] += l.conductance;
            }
        }
        // The start, without contacts, leaves the net flux as residual.
        self.exchange(&wall);
        self.residual.clone_from(&self.into_grain);
        // Less than rounding leaves of a temperature is nothing, where all of them are equal.
        let small = (TOLERANCE * (high - low)).max(f64::EPSILON * high.abs().max(low.abs()));
        let outcome = self.conjugate_gradients(small);
        self.exchange(&wall);
        self.out_of_wall.clear();
        self.out_of_wall.resize(scene.walls.len(), 0.0);
        for l in self.links.iter().filter(|l| l.j & WALL != 0) {
            self.out_of_wall[(l.j & !WALL) as usize] +=
                l.conductance * (wall(l.j) - self.solution[l.i as usize]);
        }
        outcome
    }

    /// Sum of the conductances of each grain, W/K.
    pub fn conductance(&self) -> impl Iterator<Item = f64> + '_ {
        self.diagonal.iter().zip(&self.inertia).map(|(all, inertia)| all - inertia)
    }

    /// Net heat into each grain at the temperatures of the solution.
    fn exchange(&mut self, wall: &impl Fn(u32) -> f64) {
        self.into_grain.clear();
        self.into_grain.resize(self.solution.len(), 0.0);
        for l in &self.links {
            let here = self.solution[l.i as usize];
            if l.j & WALL == 0 {
                let q = l.conductance * (self.solution[l.j as usize] - here);
                self.into_grain[l.i as usize] += q;
                self.into_grain[l.j as usize] -= q;
            } else {
                self.into_grain[l.i as usize] += l.conductance * (wall(l.j) - here);
            }
        }
    }

    fn conjugate_gradients(&mut self, small: f64) -> HeatOutcome {
        let n = self.solution.len();
        self.direction.clear();
        self.direction.resize(n, 0.0);
        let mut last = 1.0;
        for iterations in 0..MAX_ITERATIONS {
            // A value that is no number is not small.
            if (0..n).all(|i| self.residual[i].abs() / self.inertia[i] <= small) {
                return HeatOutcome { iterations, converged: true };
            }
            let energy: f64 = (0..n).map(|i| self.residual[i] * self.residual[i] / self.diagonal[i]).sum();
            let beta = if iterations == 0 { 0.0 } else { energy / last };
            last = energy;
            for i in 0..n {
                self.direction[i] = self.residual[i] / self.diagonal[i] + beta * self.direction[i];
            }
            self.multiply();
            let curvature: f64 = self.direction.iter().zip(&self.image).map(|(d, q)| d * q).sum();
            let alpha = energy / curvature;
            for i in 0..n {
                self.solution[i] += alpha * self.direction[i];
                self.residual[i] -= alpha * self.image[i];
            }
        }
        HeatOutcome { iterations: MAX_ITERATIONS, converged: false }
    }

    /// image = matrix times direction.
    fn multiply(&mut self) {
        self.image.clear();
        self.image.extend(self.diagonal.iter().zip(&self.direction).map(|(a, d)| a * d));
        for l in self.links.iter().filter(|l| l.j & WALL == 0) {
            let (i, j) = (l.i as usize, l.j as usize);
            self.image[i] -= l.conductance * self.direction[j];
            self.image[j] -= l.conductance * self.direction[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use std::f64::consts::PI;

    #[test]
    fn laws_follow_their_sources() {
        let m = Material { young: 6e10, poisson: 0.22, conductivity: 1.4, ..Material::default() };
        let s = Side::grain(0.45e-3, &m);
        let e_star = 6e10 / (1.0 - 0.22f64.powi(2)) / 2.0;
        let henry = 4.0 * 1.4 * (10.0 * 0.45e-3 / (2.0 * PI * e_star)).powf(0.25);
        assert_relative_eq!(Conduction::Henry.conductance(10.0, s, s), henry, max_relative = 1e-12);
        assert_relative_eq!(
            Conduction::HenryPrinted.conductance(10.0, s, s),
            henry / 4.0,
            max_relative = 1e-12
        );
        let a = 2.0 * (10.0 * 0.225e-3 / (PI * e_star)).sqrt();
        let line = PI * 1.4 / (2.0 * (1.5 - (a / 0.45e-3).ln()));
        assert_relative_eq!(Conduction::Line.conductance(10.0, s, s), line, max_relative = 1e-12);
        let a = (3.0 * 1e-3 * 0.225e-3 / (4.0 * e_star)).cbrt();
        assert_relative_eq!(Conduction::Hertz.conductance(1e-3, s, s), 2.0 * 1.4 * a, max_relative = 1e-12);
    }

    #[test]
    fn a_wall_is_flat_stiff_and_conducts_as_told() {
        let m = Material { young: 1e10, poisson: 0.0, conductivity: 2.0, ..Material::default() };
        let s = Side::grain(1e-3, &m);
        // E* = E, d* = d, k_s = 2 k for a perfect conductor.
        let h = 4.0 * 4.0 * (5.0 * 2e-3 / (2.0 * PI * 1e10)).powf(0.25);
        assert_relative_eq!(
            Conduction::Henry.conductance(5.0, s, Side::wall(1e-3, None)),
            h,
            max_relative = 1e-12
        );
        let h = 0.5 * h;
        assert_relative_eq!(
            Conduction::Henry.conductance(5.0, s, Side::wall(1e-3, Some(2.0))),
            h,
            max_relative = 1e-12
        );
    }

    /// Flux through R rows of a lattice of unit spacing and unit conductance H along the rows under a unit gradient.
    ///
    /// Square: H per row, so k = H per unit height. Triangular: H per row and, between two rows, one of the two
    /// diagonals over half a spacing, H / 2; with rows sqrt(3)/2 apart k = (1 + 1/2) H / (sqrt(3)/2) = sqrt(3) H.
    fn lattice_flux(rows: usize, triangular: bool) -> f64 {
        let columns = 12;
        let at = |row: usize, column: usize| row * columns + column;
        let x =
            |k: usize| (k % columns) as f64 + if triangular && (k / columns) % 2 == 1 { 0.5 } else { 0.0 };
        let n = rows * columns;
        let mut conductor = Conductor::default();
        let mut join = |i: usize, j: usize| {
            conductor.links.push(Link { i: i as u32, j: j as u32, conductance: 1.0 });
        };
        for row in 0..rows {
            for column in 0..columns {
                if column + 1 < columns {
                    join(at(row, column), at(row, column + 1));
                }
                if row + 1 < rows && triangular {
                    let side = if row % 2 == 1 { column + 1 } else { column.wrapping_sub(1) };
                    join(at(row, column), at(row + 1, column));
                    if side < columns {
                        join(at(row, column), at(row + 1, side));
                    }
                }
            }
        }
        // Two columns at either end are held by their capacity, the rest is steady at once.
        let held = |k: usize| k % columns < 2 || k % columns >= columns - 2;
        let temperature: Vec<f64> = (0..n).map(|k| if held(k) { x(k) } else { 5.0 }).collect();
        let capacity: Vec<f64> = (0..n).map(|k| if held(k) { 1e15 } else { 1e-9 }).collect();
        let heat = Heat { temperature, capacity };
        let grains = crate::Particles::<2>::default();
        let (settings, load) = (crate::Settings::default(), crate::Load::default());
        let scene = Scene {
            particles: &grains,
            materials: &[],
            walls: &[],
            placed: &[],
            settings: &settings,
            laws: None,
            load: &load,
            h: 1.0,
            rest: 0.0,
        };
        assert!(conductor.solve(&scene, &heat).converged);
        // What the left end loses.
        -(0..n).filter(|k| k % columns < 2).map(|k| conductor.into_grain[k]).sum::<f64>()
    }

    #[test]
    fn lattices_conduct_as_theory_says() {
        let rows = 40;
        let height = 0.75f64.sqrt();
        assert_relative_eq!(lattice_flux(rows, false).abs(), rows as f64, max_relative = 1e-8);
        // The outer two rows lack one side: (R - 1) gaps for R rows. The difference of two heights is exact.
        let k =
            (lattice_flux(rows, true) - lattice_flux(rows / 2, true)).abs() / (rows as f64 / 2.0 * height);
        assert_relative_eq!(k, 3f64.sqrt(), max_relative = 1e-8);
    }
}
