//! Transported scalars: one equation for the temperature, a vapour, a tracer.
//!
//! ```text
//! <eps C (s - s_n)/dt, S> + <eps C (u_n - u_mesh) . grad s, S> + <eps K grad s, grad S> - <q_p + q_l + source, S>
//!     + sum_e xi_T <R_T, U . grad S>_e = what the boundary gives
//! ```
//!
//! (Henry et al., Eq. 3, A.9 with the test function of T), C the volumetric capacity rho c, K the
//! conductivity, R_T the residual A.6, q_p = -h (s - s*) over the points with
//! s* = c + a h s, and q_l = lambda (s_w - s).

use crate::Vector;
use crate::assembly::Local;
use crate::element::{Element, weighted_load, weighted_mass};
use crate::forms::stabilisation_time;
use crate::points::{PointScalar, Points, PointsByCell};

/// A transported scalar: its name and coefficients.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Scalar {
    /// Name: `temperature`, or one of the user's.
    pub name: String,
    /// Volumetric capacity C: rho c for heat, J/m3/K; 1 for a tracer.
    pub capacity: f64,
    /// Conductivity K: k for heat, W/m/K; the diffusivity for a tracer, m2/s.
    pub conductivity: f64,
    /// Exchange with the front and rear walls of a thin cell.
    pub thin_cell: Option<ThinCell>,
    /// How the equation is discretised.
    pub form: Form,
    /// Expansion beta in the weight 1 - beta (s - s_R) of the fluid, 1/K for heat; 0 where it weighs nothing.
    pub expansion: f64,
    /// Value s_R at which gravity acts on the density rho, K for heat.
    pub reference: f64,
}

impl Scalar {
    /// A scalar that weighs nothing, in the consistent form, without walls of a thin cell.
    pub fn new(name: &str, capacity: f64, conductivity: f64) -> Self {
        Self {
            name: name.into(),
            capacity,
            conductivity,
            thin_cell: None,
            form: Form::Consistent,
            expansion: 0.0,
            reference: 0.0,
        }
    }
}

/// How the equation of a scalar is discretised.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// The consistent Galerkin terms with streamline diffusion, as in the paper. Order 2.
    #[default]
    Consistent,
    /// The terms of storage and of the exchange with grains and thin cell are lumped on the diagonal. Where the
    /// exchange is stronger than the diffusion over a cell, the consistent form can leave the range of the values of
    /// walls, grains and inflow; the lumped exchange cannot. Conservative, and of order 2, as the consistent form.
    Lumped,
    /// Lumped, and with the least symmetric diffusion between neighbouring nodes that leaves no positive entry beside
    /// the diagonal of the matrix, in place of streamline diffusion. No value then leaves the range of its neighbours
    /// and of its own last value, so that fronts do not overshoot. Of order 1 where convection outweighs diffusion
    /// along the edges, otherwise of order 2.
    Monotone,
}

/// Exchange with the front and rear walls, q_l = coefficient (s_w - s).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ThinCell {
    /// lambda, W/m3/K for heat.
    pub coefficient: f64,
    /// s_w, K for heat.
    pub value: f64,
}

/// All that the equation needs to know of one cell.
pub struct Cell<const D: usize, const B: usize> {
    /// Shape functions.
    pub element: Element<D, B>,
    /// Nodal voidage.
    pub voidage: [f64; B],
    /// Convecting velocity u_n - u_mesh, m/s.
    pub velocity: [Vector<D>; B],
    /// Values of the last accepted step.
    pub old: [f64; B],
    /// The points in the cell.
    pub exchange: Option<CellScalar<B>>,
    /// Source per volume at the nodes (manufactured solutions).
    pub source: Option<[f64; B]>,
}

/// Sums over the points in one cell, with the shape functions phi at the points.
pub struct CellScalar<const B: usize> {
    /// sum h phi_a phi_b.
    exchange: [[f64; B]; B],
    /// sum a h^2 phi_a phi_b: what the law gives back.
    returned: [[f64; B]; B],
    /// sum h c phi_a.
    given: [f64; B],
}

impl<const B: usize> CellScalar<B> {
    /// The sums of one cell; `None` if no point is there.
    pub fn gather<const D: usize>(
        points: &Points<D>,
        columns: &PointScalar,
        sorted: &PointsByCell,
        cell: usize,
    ) -> Option<Self> {
        let mut inside = sorted.of(cell).peekable();
        inside.peek()?;
        let mut sum = Self { exchange: [[0.0; B]; B], returned: [[0.0; B]; B], given: [0.0; B] };
        for q in inside {
            let phi = points.shape::<B>(q);
            let coefficient = columns.coefficient[q];
            let returned = columns.mobility[q] * coefficient * coefficient;
            for a in 0..B {
                sum.given[a] += coefficient * columns.value[q] * phi[a];
                for b in 0..B {
                    sum.exchange[a][b] += coefficient * phi[a] * phi[b];
                    sum.returned[a][b] += returned * phi[a] * phi[b];
                }
            }
        }
        Some(sum)
    }
}

/// Matrix and right-hand side of the cell.
pub fn assemble<const D: usize, const B: usize>(
    cell: &Cell<D, B>,
    scalar: &Scalar,
    dt: f64,
    out: &mut Local<B, 1>,
) {
    *out = Local::default();
    let measure = cell.element.measure;
    let gradient = &cell.element.gradient;
    let mass = weighted_mass(measure, &cell.voidage);
    let load = weighted_load(measure, &cell.voidage);
    let plain = weighted_mass(measure, &[1.0; B]);
    let on_diagonal = |entries: [f64; B], consistent: [[f64; B]; B]| match scalar.form {
        Form::Consistent => consistent,
        Form::Lumped | Form::Monotone => {
            std::array::from_fn(|a| std::array::from_fn(|b| if a == b { entries[a] } else { 0.0 }))
        }
    };
    let storage = on_diagonal(cell.voidage.map(|eps| measure / B as f64 * eps), mass);
    let diffusion = scalar.conductivity * load.iter().sum::<f64>();
    let voidage_slope = cell.element.gradient_of(&cell.voidage);
    let along = upwind(cell, scalar, dt);

    // Galerkin rows for the test functions, and the integral of the strong residual R_T, which the
    // streamline test U . grad phi_a (constant in the cell) weighs.
    let mut residual = [0.0; B];
    let mut residual_rhs = 0.0;
    for a in 0..B {
        let mut carried = Vector::<D>::zeros();
        for c in 0..B {
            carried += cell.velocity[c] * mass[a][c];
            out.rhs[a][0] += scalar.capacity / dt * storage[a][c] * cell.old[c];
        }
        for b in 0..B {
            out.matrix[a][b][0][0] += scalar.capacity * (storage[a][b] / dt + carried.dot(&gradient[b]))
                + diffusion * gradient[a].dot(&gradient[b]);
        }
        residual_rhs += scalar.capacity / dt * load[a] * cell.old[a];
    }
    let carried: Vector<D> = (0..B).map(|c| cell.velocity[c] * load[c]).sum();
    for b in 0..B {
        residual[b] += scalar.capacity * (load[b] / dt + carried.dot(&gradient[b]))
            - scalar.conductivity * measure * voidage_slope.dot(&gradient[b]);
    }
    let mut add = |rows: &[[f64; B]; B], rhs: &[f64; B]| {
        for a in 0..B {
            out.rhs[a][0] += rhs[a];
            residual_rhs += rhs[a];
            for b in 0..B {
                out.matrix[a][b][0][0] += rows[a][b];
                residual[b] += rows[a][b];
            }
        }
    };
    if let Some(wall) = scalar.thin_cell {
        let rows = plain.map(|row| row.map(|entry| wall.coefficient * entry));
        let share = wall.coefficient * measure / B as f64;
        add(&on_diagonal([share; B], rows), &[share * wall.value; B]);
    }
    if let Some(points) = &cell.exchange {
        let sums = points.exchange.map(|row| row.iter().sum());
        let mut rows = on_diagonal(sums, points.exchange);
        for (row, returned) in rows.iter_mut().zip(&points.returned) {
            row.iter_mut().zip(returned).for_each(|(entry, returned)| *entry -= returned);
        }
        add(&rows, &points.given);
    }
    if let Some(source) = &cell.source {
        let rhs = std::array::from_fn(|a| (0..B).map(|b| plain[a][b] * source[b]).sum());
        add(&[[0.0; B]; B], &rhs);
    }
    for a in 0..B {
        out.rhs[a][0] += along[a] * residual_rhs;
        for b in 0..B {
            out.matrix[a][b][0][0] += along[a] * residual[b];
        }
    }
}

/// xi_T U . grad phi_a with U the velocity at the centroid (A.9, A.12); zero where the values are kept monotone. In the
/// lumped form the exchange of the cell with its points is in xi_T: with a longer time values would swing where the
/// exchange is strong. Only that of the cell, in its residual too: a share of that of its neighbours would take the upwind
/// from the cell before the first hot grains, and values would swing there.
fn upwind<const D: usize, const B: usize>(cell: &Cell<D, B>, scalar: &Scalar, dt: f64) -> [f64; B] {
    if scalar.form == Form::Monotone {
        return [0.0; B];
    }
    let direction = cell.velocity.iter().sum::<Vector<D>>() / B as f64;
    let diffusivity = scalar.conductivity / scalar.capacity;
    let exchange = match (&cell.exchange, scalar.form) {
        (Some(points), Form::Lumped) => {
            let fluid = weighted_load(cell.element.measure, &cell.voidage).iter().sum::<f64>();
            points.exchange.as_flattened().iter().sum::<f64>() / (scalar.capacity * fluid)
        }
        _ => 0.0,
    };
    let time = stabilisation_time(dt, direction.norm(), cell.element.size(), diffusivity, exchange);
    std::array::from_fn(|a| time * direction.dot(&cell.element.gradient[a]))
}
