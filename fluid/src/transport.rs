//! Transported scalars: one equation for heat (and, the same, for vapour).
//!
//! ```text
//! <eps C (T - T_n)/dt, S> + <eps C (u_n - u_mesh) . grad T, S> + <eps K grad T, grad S> - <q_p + q_l + s, S>
//!     + sum_e xi_T <R_T, U . grad S>_e = boundary heat
//! ```
//!
//! (Henry et al., Eq. 3, A.9 with the test function of T), C the volumetric capacity rho c, K the
//! conductivity, R_T the residual A.6, q_p = -hA (T - T*) over the pieces of the bodies with
//! T* = bT + aT hA T, and q_l = lambda (T_w - T).

use crate::Vector;
use crate::assembly::Local;
use crate::element::{Element, weighted_load, weighted_mass};
use crate::exchange::{HeatExchange, Pieces, PiecesByCell};
use crate::forms::stabilisation_time;

/// Coefficients of a transported scalar.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Scalar {
    /// Volumetric capacity C: rho c for heat, J/m3/K.
    pub capacity: f64,
    /// Conductivity K: k for heat, W/m/K.
    pub conductivity: f64,
    /// Exchange with the front and rear walls of a thin cell.
    pub thin_cell: Option<ThinCellHeat>,
    /// Whether storage and exchange are lumped in the Galerkin equations: storage and thin cell by the vertex rule, the
    /// bodies by the sums of the rows. Where the exchange
    /// over a cell outweighs its diffusion, the consistent terms couple neighbours with the wrong sign, and the
    /// temperature leaves the bounds that walls, grains and inflow set; the lumped ones cannot do that. Both give the
    /// grains the same heat, exchange it without loss, and are of order 2.
    pub lumped: bool,
    /// Whether no value may leave the range of those around it, before and beside: fronts then stay within their bounds, which
    /// streamline diffusion does not ensure. Instead of it the matrix gets the least symmetric diffusion between neighbours
    /// that leaves no positive entry beside the diagonal ([`crate::assembly::System::upwind`]); needs `lumped`. Nothing is lost
    /// on the way; of order 1 where convection outweighs diffusion along edges, else of order 2.
    pub monotone: bool,
}

/// Heat from the front and rear walls, q_l = coefficient (T_w - T).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ThinCellHeat {
    /// lambda, W/m3/K.
    pub coefficient: f64,
    /// T_w, K.
    pub temperature: f64,
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
    /// The bodies in the cell.
    pub exchange: Option<CellHeat<B>>,
    /// Source per volume at the nodes (manufactured solutions).
    pub source: Option<[f64; B]>,
}

/// Sums over the pieces in one cell, shape functions phi at the pieces and s the share of the body.
pub struct CellHeat<const B: usize> {
    /// sum s hA (1 - aT hA) phi_a phi_b.
    exchange: [[f64; B]; B],
    /// sum s hA bT phi_a.
    given: [f64; B],
}

impl<const B: usize> CellHeat<B> {
    /// The sums of one cell; `None` if no body is there.
    pub fn gather<const D: usize>(
        pieces: &Pieces<D>,
        load: &HeatExchange<'_>,
        sorted: &PiecesByCell,
        cell: usize,
    ) -> Option<Self> {
        let mut inside = sorted.of(cell).peekable();
        inside.peek()?;
        let mut sum = Self { exchange: [[0.0; B]; B], given: [0.0; B] };
        for (piece, body) in inside {
            let phi = pieces.shape::<B>(piece);
            let coefficient = pieces.share[piece] * load.coefficient[body];
            let slip = coefficient * (1.0 - load.mobility[body] * load.coefficient[body]);
            for a in 0..B {
                sum.given[a] += coefficient * load.temperature[body] * phi[a];
                for b in 0..B {
                    sum.exchange[a][b] += slip * phi[a] * phi[b];
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
    let on_diagonal = |entries: [f64; B], consistent: [[f64; B]; B]| match scalar.lumped {
        true => std::array::from_fn(|a| std::array::from_fn(|b| if a == b { entries[a] } else { 0.0 })),
        false => consistent,
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
        add(&on_diagonal([share; B], rows), &[share * wall.temperature; B]);
    }
    if let Some(bodies) = &cell.exchange {
        let rows = bodies.exchange.map(|row| row.iter().sum());
        add(&on_diagonal(rows, bodies.exchange), &bodies.given);
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

/// xi_T U . grad phi_a with U the velocity at the centroid (A.9, A.12); zero where the values are kept monotone.
fn upwind<const D: usize, const B: usize>(cell: &Cell<D, B>, scalar: &Scalar, dt: f64) -> [f64; B] {
    if scalar.monotone {
        return [0.0; B];
    }
    let direction = cell.velocity.iter().sum::<Vector<D>>() / B as f64;
    let diffusivity = scalar.conductivity / scalar.capacity;
    let time = stabilisation_time(dt, direction.norm(), cell.element.size(), diffusivity, 0.0);
    std::array::from_fn(|a| time * direction.dot(&cell.element.gradient[a]))
}
