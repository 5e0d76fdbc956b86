//! The weak form of momentum and mass, one function per term.
//!
//! Set I of the volume-averaged Navier-Stokes equations (Henry et al., Eqs. 1-2, A.7-A.8), unknowns (u, p) at
//! every node, tests (v, q), voidage eps known:
//!
//! ```text
//! <eps rho (u - u_n)/dt, v> + <eps rho (u . grad) u, v> + <sigma, grad v> + <gamma_l u, v>
//!     - <f_p, v> - <eps rho g (1 - beta (T - T_R)), v>
//!     + sum_e xi <R_u, (U . grad) v>_e + sum_e rho xi_c <R_p, div v>_e = <<sigma n, v>>
//! <div(phi v*), q> + <div(eps u), q> + sum_e (xi / rho) <R_u, grad q>_e = 0
//! ```
//!
//! On a moving mesh u - u_n is the change at a node that moves along, and the convecting velocity is u - u_mesh, there
//! and in R_u and U; `at` below is u, `wind` is u - u_mesh. The form is not conservative, so that a uniform flow stays
//! uniform however the nodes move. Without motion both are the same.
//!
//! with R_u, R_p the residuals of A.4-A.5 and U the velocity u_n at the centroid of the element. The print has
//! neither the 1/rho of the pressure stabilisation nor the rho of the incompressibility term; without them
//! the units do not agree and the solution would change with the unit of mass (a test changes that unit).
//!
//! Gravity carries 1 - beta (T - T_R), hot fluid being lighter (Eq. 2 prints a plus), and the residuals take their
//! signs from Eqs. 2 and 3, not from the print of A.5 and A.6.
//!
//! Local matrices are indexed `[a][b][i][j]`: row of test node a and equation i, column of node b and unknown
//! j; equation and unknown `D` are mass and pressure.

use crate::Vector;
use crate::assembly::Local;
use crate::element::{Element, weighted_load, weighted_mass};
use crate::points::{CellExchange, PointDensity};
use nalgebra::SMatrix;

/// Properties of the fluid that the momentum equation needs.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Properties<const D: usize> {
    /// Density rho, kg/m3.
    pub density: f64,
    /// Dynamic viscosity eta, Pa s.
    pub viscosity: f64,
    /// Gravity g, m/s2.
    pub gravity: Vector<D>,
    /// Further acceleration b of the fluid, m/s2: it weighs neither by temperature nor on what is immersed.
    pub body_force: Vector<D>,
    /// Drag of the front and rear walls of a thin cell, gamma_l in f_l = -gamma_l u, kg/m3/s; 0 without.
    pub thin_cell_drag: f64,
}

/// Thermal buoyancy at the nodes of a cell: 1 - beta (T - T_R).
pub type Lightness<const B: usize> = [f64; B];

/// All that the terms need to know of one cell.
pub struct Cell<'a, const D: usize, const B: usize> {
    /// Shape functions.
    pub element: Element<D, B>,
    /// Nodal voidage.
    pub voidage: [f64; B],
    /// Velocity u_n of the last accepted step, m/s.
    pub old: [Vector<D>; B],
    /// Velocity about which convection is linearised, m/s.
    pub at: [Vector<D>; B],
    /// The same less the velocity of the mesh, m/s.
    pub wind: [Vector<D>; B],
    /// u_n less the velocity of the mesh at the centroid, the U of the stabilisation, m/s.
    pub direction: Vector<D>,
    /// 1 - beta (T - T_R).
    pub lightness: Lightness<B>,
    /// Weight of the fluid at the nodes over rho g, int eps (1 - beta (T - T_R)) phi_a; see [`fluid_weight`].
    pub weight: [f64; B],
    /// The same of the body force, int eps phi_a; zero without one.
    pub pushed: [f64; B],
    /// The points in the cell.
    pub exchange: Option<&'a CellExchange<D, B>>,
    /// The points as nodal fields, also in cells without points; `None` in a fluid without any.
    pub density: Option<[PointDensity<D>; B]>,
    /// Momentum source per volume at the nodes, N/m3 (manufactured solutions), and mass source, 1/s.
    pub source: Option<([Vector<D>; B], [f64; B])>,
    /// int eps phi_a phi_b.
    pub mass: [[f64; B]; B],
    /// int eps phi_a.
    pub load: [f64; B],
}

impl<const D: usize, const B: usize> Cell<'_, D, B> {
    /// The integrals that several terms share.
    pub fn integrals(element: &Element<D, B>, voidage: &[f64; B]) -> ([[f64; B]; B], [f64; B]) {
        (weighted_mass(element.measure, voidage), weighted_load(element.measure, voidage))
    }

    fn voidage_integral(&self) -> f64 {
        self.load.iter().sum()
    }
}

/// Integral over the cell of the strong momentum residual R_u, affine in the unknowns: `matrix[i][b][j]`.
struct Residual<const D: usize, const B: usize> {
    matrix: [[[f64; B]; B]; D],
    rhs: Vector<D>,
}

/// Stabilisation times and lengths of one cell (A.10-A.12), from U = u_n - u_mesh at the centroid.
pub struct Stabilisation<const D: usize> {
    /// U, m/s.
    pub direction: Vector<D>,
    /// xi_u = xi_p, s.
    pub time: f64,
    /// xi_c, m2/s.
    pub incompressibility: f64,
}

/// 1/xi^2 = (2/dt)^2 + (|U|/h)^2 + (4 nu/h^2)^2 + reaction^2 (A.11, A.12), nu the diffusivity of the equation, m2/s, and
/// `reaction` the rate at which points exchange with the fluid, 1/s.
pub fn stabilisation_time(dt: f64, speed: f64, size: f64, diffusivity: f64, reaction: f64) -> f64 {
    let rates = [2.0 / dt, speed / size, 4.0 * diffusivity / (size * size), reaction];
    1.0 / rates.iter().map(|r| r * r).sum::<f64>().sqrt()
}

/// Voidage of the densest packing of equal spheres, 1 - pi/sqrt(18). Where it is less, an element lies inside a grain.
const DENSEST: f64 = 0.259_519_5;

/// Rate of the drag in a cell as it enters the stabilisation time, 1/s: four times the largest nodal drag, with that of a
/// thin cell, over density and mean voidage.
///
/// The largest, because where strong drag begins the time of a cell with points on one side must be as short as inside.
/// With a factor of 1 the pressure at the ends of a bed would depend more on the step, and with a much larger one the
/// pressures of neighbours would be coupled less. For the same reason the voidage counts as that of the densest packing at
/// least: inside a grain the pressures would else part, and grains that touch would shake.
fn drag_rate<const D: usize, const B: usize>(cell: &Cell<'_, D, B>, fluid: &Properties<D>) -> f64 {
    let Some(nodes) = &cell.density else { return 0.0 };
    let largest = nodes.iter().fold(0.0, |largest: f64, node| largest.max(node.drag));
    let voidage = cell.voidage.iter().sum::<f64>() / B as f64;
    4.0 * (largest + fluid.thin_cell_drag) / (fluid.density * voidage.max(DENSEST))
}

impl<const D: usize> Stabilisation<D> {
    /// The parameters of one cell.
    pub fn new<const B: usize>(cell: &Cell<'_, D, B>, fluid: &Properties<D>, dt: f64) -> Self {
        let direction = cell.direction;
        let speed = direction.norm();
        let h = cell.element.size();
        let nu = fluid.viscosity / fluid.density;
        let drag = drag_rate(cell, fluid);
        Self {
            direction,
            time: stabilisation_time(dt, speed, h, nu, drag),
            incompressibility: h * speed * (h * speed / (6.0 * nu)).min(0.5),
        }
    }
}

/// Integrals of eps l phi_a for the P1 field l = 1 - beta (T - T_R).
///
/// With bodies, eps is one less their pieces, exactly as in the pressure force V grad p on them: then a fluid
/// at rest between bodies held fast, grad p = rho g, solves the discrete equations. The nodal voidage here
/// would leave forces of the order of rho g times its variation, and currents in liquids.
pub fn fluid_weight<const D: usize, const B: usize>(
    measure: f64,
    lightness: &Lightness<B>,
    bodies: Option<&CellExchange<D, B>>,
) -> [f64; B] {
    let mut weight = weighted_load(measure, lightness);
    if let Some(bodies) = bodies {
        for a in 0..B {
            weight[a] -= (0..B).map(|b| bodies.solid[a][b] * lightness[b]).sum::<f64>();
        }
    }
    weight
}

/// Matrix and right-hand side of the cell.
pub fn assemble<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    dt: f64,
    out: &mut Local<B, B>,
) {
    *out = Local::default();
    let stabilisation = Stabilisation::new(cell, fluid, dt);
    inertia_and_convection(cell, fluid, dt, out);
    stress(cell, fluid, out);
    body_forces(cell, fluid, out);
    mass_conservation(cell, out);
    if let Some(bodies) = cell.exchange {
        immersed_bodies(cell, bodies, out);
    }
    stabilise_momentum(cell, fluid, dt, &stabilisation, out);
    least_squares_incompressibility(cell, fluid, &stabilisation, out);
}

/// <eps rho (u - u_n)/dt, v> + <eps rho (((w - u_mesh) . grad) u + (u . grad) w - (w . grad) w), v>: backward Euler
/// and one Newton linearisation of the convection ((u - u_mesh) . grad) u about w.
fn inertia_and_convection<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    dt: f64,
    out: &mut Local<B, B>,
) {
    let rho = fluid.density;
    let slope = cell.element.gradient_of_vector(&cell.at);
    for a in 0..B {
        let mut carried = Vector::<D>::zeros();
        let mut wind = Vector::<D>::zeros();
        let mut old = Vector::<D>::zeros();
        for b in 0..B {
            carried += cell.at[b] * cell.mass[a][b];
            wind += cell.wind[b] * cell.mass[a][b];
            old += cell.old[b] * cell.mass[a][b];
        }
        let known = (old / dt + slope * carried) * rho;
        for i in 0..D {
            out.rhs[a][i] += known[i];
        }
        for b in 0..B {
            let diagonal = rho * (cell.mass[a][b] / dt + wind.dot(&cell.element.gradient[b]));
            let block = &mut out.matrix[a][b];
            for i in 0..D {
                block[i][i] += diagonal;
                for j in 0..D {
                    block[i][j] += rho * cell.mass[a][b] * slope[(i, j)];
                }
            }
        }
    }
}

/// <sigma, grad v> with sigma = -p I + eps eta (grad u + grad u^T); the traction on open boundaries is in
/// [`crate::boundary`].
fn stress<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    out: &mut Local<B, B>,
) {
    let viscous = fluid.viscosity * cell.voidage_integral();
    let share = cell.element.measure / B as f64;
    let gradient = &cell.element.gradient;
    for a in 0..B {
        for b in 0..B {
            let block = &mut out.matrix[a][b];
            let product = viscous * gradient[a].dot(&gradient[b]);
            for i in 0..D {
                block[i][i] += product;
                block[i][D] -= share * gradient[a][i];
                for j in 0..D {
                    block[i][j] += viscous * gradient[a][j] * gradient[b][i];
                }
            }
        }
    }
}

/// <gamma_l u, v> - <eps rho (g (1 - beta (T - T_R)) + b), v> - <s, v>.
fn body_forces<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    out: &mut Local<B, B>,
) {
    let plain = weighted_mass(cell.element.measure, &[1.0; B]);
    for a in 0..B {
        for i in 0..D {
            out.rhs[a][i] += fluid.density * fluid.gravity[i] * cell.weight[a];
            out.rhs[a][i] += fluid.density * fluid.body_force[i] * cell.pushed[a];
        }
        if let Some((momentum, mass)) = &cell.source {
            for b in 0..B {
                for i in 0..D {
                    out.rhs[a][i] += plain[a][b] * momentum[b][i];
                }
                out.rhs[a][D] += plain[a][b] * mass[b];
            }
        }
        if fluid.thin_cell_drag != 0.0 {
            for b in 0..B {
                for i in 0..D {
                    out.matrix[a][b][i][i] += fluid.thin_cell_drag * plain[a][b];
                }
            }
        }
    }
}

/// -<eps u, grad q>: the boundary part <<eps u . n, q>> is in [`crate::boundary`].
fn mass_conservation<const D: usize, const B: usize>(cell: &Cell<'_, D, B>, out: &mut Local<B, B>) {
    for a in 0..B {
        for b in 0..B {
            for j in 0..D {
                out.matrix[a][b][D][j] -= cell.load[b] * cell.element.gradient[a][j];
            }
        }
    }
}

/// -<f_p, v> - <phi v*, grad q>, sums over the pieces of the bodies in the cell, with
/// f_p = V grad p - gamma (u - v*) and v* = b + a (gamma u - V grad p). The drag gamma u of a piece acts on its nodes with
/// their own velocities less a shear that grains share, sum_a phi_a(x) (u_a - H (x_a - x)) . v_a, in place of u(x) . v(x).
/// Both exchange the same force, because sum_a phi_a(x) u_a = u(x) and sum_a phi_a(x) x_a = x; but a piece in the middle of a cell would leave
/// velocities without drag that alternate from node to node, and the flow would go round it. In v* the piece has u(x), as
/// the grain.
fn immersed_bodies<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    bodies: &CellExchange<D, B>,
    out: &mut Local<B, B>,
) {
    let gradient = &cell.element.gradient;
    for a in 0..B {
        for i in 0..D {
            out.rhs[a][i] += bodies.force[a][i];
        }
        out.rhs[a][D] += bodies.volume_flux.dot(&gradient[a]);
        for b in 0..B {
            let block = &mut out.matrix[a][b];
            for i in 0..D {
                block[i][i] += bodies.drag[a][b];
                block[i][D] += bodies.pressure[a] * gradient[b][i];
                block[D][i] -= bodies.carried[b] * gradient[a][i];
            }
            block[D][D] += bodies.diffusion * gradient[a].dot(&gradient[b]);
        }
    }
}

/// int_e R_u with R_u = eps rho Du/Dt - div sigma - f_p + gamma_l u - eps rho (g (1 - beta (T - T_R)) + b) - s.
/// For P1 fields div(eps eta (grad u + grad u^T)) = eta (grad u + grad u^T) grad eps inside the element. The forces of
/// points are those of the nodal fields, with the mean of the nodal values; eps is then one less their volume in the weight
/// too, so that grad p = rho g among held points has no residual.
fn momentum_residual<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    dt: f64,
) -> Residual<D, B> {
    let rho = fluid.density;
    let measure = cell.element.measure;
    let gradient = &cell.element.gradient;
    let slope: SMatrix<f64, D, D> = cell.element.gradient_of_vector(&cell.at);
    let voidage_slope = cell.element.gradient_of(&cell.voidage);
    let mut carried = Vector::<D>::zeros();
    let mut wind = Vector::<D>::zeros();
    let mut old = Vector::<D>::zeros();
    for a in 0..B {
        carried += cell.at[a] * cell.load[a];
        wind += cell.wind[a] * cell.load[a];
        old += cell.old[a] * cell.load[a];
    }
    let share = measure / B as f64;
    let (mut weight, mut pushed) = (cell.weight.iter().sum::<f64>(), cell.pushed.iter().sum::<f64>());
    let mut pressed = measure;
    let mut given = Vector::<D>::zeros();
    let mut drag = [0.0; B];
    if let Some(density) = &cell.density {
        (weight, pushed) = (0.0, 0.0);
        for (a, node) in density.iter().enumerate() {
            weight += share * (1.0 - node.volume) * cell.lightness[a];
            pushed += share * (1.0 - node.volume);
            pressed -= share * node.left_volume;
            given += node.force * share;
            drag[a] = share * node.left_drag;
        }
    }
    let mut rhs =
        (old / dt + slope * carried + fluid.gravity * weight + fluid.body_force * pushed) * rho + given;
    if let Some((momentum, _)) = &cell.source {
        rhs += momentum.iter().sum::<Vector<D>>() * share;
    }
    let mut matrix = [[[0.0; B]; B]; D];
    for b in 0..B {
        let diagonal = rho * (cell.load[b] / dt + wind.dot(&gradient[b]))
            + fluid.thin_cell_drag * measure / B as f64
            + drag[b]
            - fluid.viscosity * measure * gradient[b].dot(&voidage_slope);
        for i in 0..D {
            matrix[i][b][i] += diagonal;
            matrix[i][b][D] += pressed * gradient[b][i];
            for j in 0..D {
                matrix[i][b][j] += rho * cell.load[b] * slope[(i, j)]
                    - fluid.viscosity * measure * gradient[b][i] * voidage_slope[j];
            }
        }
    }
    Residual { matrix, rhs }
}

/// SUPG, xi <R_u, (U . grad) v>, and PSPG, (xi / rho) <R_u, grad q>: for P1 tests both weigh the integral of
/// R_u over the element with constants.
fn stabilise_momentum<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    dt: f64,
    stabilisation: &Stabilisation<D>,
    out: &mut Local<B, B>,
) {
    let residual = momentum_residual(cell, fluid, dt);
    for a in 0..B {
        let along = stabilisation.time * stabilisation.direction.dot(&cell.element.gradient[a]);
        let across = cell.element.gradient[a] * (stabilisation.time / fluid.density);
        for i in 0..D {
            out.rhs[a][i] += along * residual.rhs[i];
            out.rhs[a][D] += across[i] * residual.rhs[i];
            for b in 0..B {
                let row = residual.matrix[i][b];
                let block = &mut out.matrix[a][b];
                for j in 0..B {
                    block[i][j] += along * row[j];
                    block[D][j] += across[i] * row[j];
                }
            }
        }
    }
}

/// LSIC, rho xi_c <R_p, div v> with R_p = div(phi v) + div(eps u) - s_m; phi v is the nodal projection (A.15)
/// of the solid flux at the last accepted state, so that the term stays inside the element.
fn least_squares_incompressibility<const D: usize, const B: usize>(
    cell: &Cell<'_, D, B>,
    fluid: &Properties<D>,
    stabilisation: &Stabilisation<D>,
    out: &mut Local<B, B>,
) {
    let scale = fluid.density * stabilisation.incompressibility;
    if scale == 0.0 {
        return;
    }
    let measure = cell.element.measure;
    let voidage = cell.voidage_integral();
    let voidage_slope = cell.element.gradient_of(&cell.voidage);
    let source = cell.source.as_ref().map_or(0.0, |(_, mass)| mass.iter().sum::<f64>() / B as f64);
    let solid = cell
        .density
        .map_or(0.0, |density| (0..B).map(|a| density[a].flux.dot(&cell.element.gradient[a])).sum::<f64>());
    let known = measure * (source - solid);
    for a in 0..B {
        let test = cell.element.gradient[a] * scale;
        for i in 0..D {
            out.rhs[a][i] += test[i] * known;
        }
        for b in 0..B {
            let divergence = cell.element.gradient[b] * voidage + voidage_slope * (measure / B as f64);
            for i in 0..D {
                for j in 0..D {
                    out.matrix[a][b][i][j] += test[i] * divergence[j];
                }
            }
        }
    }
}
