//! The Hele-Shaw channel: walls in front and behind drag, those at the sides hold.

use crate::models::{FluidSet, Vec2, grid, steps_alone};
use crate::{Case, Finding, Outcome};
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{Effort, worse};
use voidage_coupling::Result;
use voidage_fluid::conditions::{FlowCondition, Prescribed};

/// The case.
pub const CASE: Case = Case {
    name: "hele-shaw",
    group: "fluid",
    title: "flow in a thin cell between side walls has its profile",
    source: "exact: eta u'' - gamma_l u + G = 0, u = (G/gamma_l) (1 - cosh(k y)/cosh(k H)), k^2 = gamma_l/eta",
    run,
};

/// Half width (m), viscosity (Pa s), drag of the cell (kg/m3/s), pressure gradient (Pa/m).
const HALF: f64 = 0.5;
const VISCOSITY: f64 = 0.3;
const DRAG: f64 = 12.0;
const PUSH: f64 = 2.0;

/// Velocity at the distance y from the middle, m/s.
fn exact(y: f64) -> f64 {
    let k = f64::sqrt(DRAG / VISCOSITY);
    (PUSH / DRAG) * (1.0 - (k * y).cosh() / (k * HALF).cosh())
}

/// Velocity across the middle of a channel of 3n x n squares, as `(y, u)`, and the largest error at the nodes of the
/// middle third over G/gamma_l: at the ends, where the velocity is prescribed, the pressure stabilisation without
/// second derivatives is of lower order.
fn solve(squares: usize) -> Result<(Vec<(f64, f64)>, f64)> {
    let mesh = grid([3.0, 2.0 * HALF], [3 * squares, squares])?;
    let profile: Vec<Vec2> = mesh.points.iter().map(|x| Vec2::new(exact(x.y - HALF), 0.0)).collect();
    let ends = FlowCondition::Velocity(Prescribed::Nodal(profile.clone()));
    let mut set = FluidSet::new(1e-3, VISCOSITY).flow("left", ends.clone()).flow("right", ends);
    set.properties.thin_cell_drag = DRAG;
    let start = set.rest(&mesh, 0.0);
    let mut fluid = set.build(mesh, start)?;
    steps_alone(&mut fluid, 1e6, 3)?;
    let fields = &fluid.accepted;
    let (mut worst, mut across) = (0.0_f64, Vec::new());
    for ((x, u), profile) in fluid.mesh.points.iter().zip(&fields.velocity).zip(&profile) {
        if (x.x - 1.5).abs() < 0.5 {
            worst = worse(worst, (u - profile).norm() / (PUSH / DRAG));
        }
        if (x.x - 1.5).abs() < 1e-9 {
            across.push((x.y - HALF, u.x));
        }
    }
    across.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok((across, worst))
}

fn run(effort: Effort) -> Result<Outcome> {
    let sizes: &[usize] = effort.pick(&[8, 16, 32], &[8, 16, 32, 64, 128]);
    let solved = sizes.iter().map(|squares| solve(*squares)).collect::<Result<Vec<_>>>()?;
    let errors: Vec<f64> = solved.iter().map(|(_, error)| *error).collect();
    let finest = errors[errors.len() - 1];
    let bound = effort.pick(5e-3, 4e-4);
    let squares = sizes[sizes.len() - 1];
    let line = (0..=200).map(|k| HALF * (k as f64 / 100.0 - 1.0)).map(|y| (y, exact(y))).collect();
    let panel = Panel {
        curves: vec![Curve::line("exact", line), Curve::points("8 squares across", solved[0].0.clone())],
        ..Panel::new("Hele-Shaw channel", "y (m)", "u (m/s)")
    };
    Ok(Outcome {
        findings: vec![
            Finding::at_most(
                format!("largest error / (G/gamma_l), {squares} squares across"),
                "1",
                bound,
                finest,
            ),
            Finding::order("order of the largest error", 1.9, &errors, 2.0),
        ],
        panels: vec![panel],
    })
}
