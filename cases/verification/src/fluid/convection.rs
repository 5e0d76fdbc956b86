//! Natural convection between a hot and a cold wall.

use crate::models::{FluidSet, Vec2, crowd_at_walls, grid, steps_alone};
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{Fluid, HEAT, Result, TEMPERATURE};
use voidage_fluid::conditions::{Prescribed, ScalarCondition};
use voidage_fluid::element::{Element, weighted_mass};
use voidage_fluid::transport::Scalar;

/// The case.
pub const CASE: Case = Case {
    name: "natural-convection",
    group: "fluid",
    title: "mean Nusselt number and largest velocities in a square cavity of air with a hot and a cold side",
    source: "G. de Vahl Davis, Int. J. Numer. Methods Fluids 3, 249 (1983), bench mark solution, Pr 0.71",
    run,
};

const PRANDTL: f64 = 0.71;

/// Ra; mean Nu; largest u on the vertical and v on the horizontal centre line, in diffusivity / side.
const BENCH_MARK: [(f64, f64, [f64; 2]); 4] = [
    (1e3, 1.118, [3.649, 3.697]),
    (1e4, 2.243, [16.178, 19.617]),
    (1e5, 4.519, [34.73, 68.59]),
    (1e6, 8.800, [64.63, 219.36]),
];

/// Mean Nu and largest velocities on n x n squares that are smaller towards the walls, in a square of side 1, of
/// density, diffusivity and heat capacity 1.
fn solve(rayleigh: f64, squares: usize) -> Result<(f64, [f64; 2])> {
    let mut mesh = grid([1.0, 1.0], [squares; 2])?;
    crowd_at_walls(&mut mesh, 0.8);
    let mut set = FluidSet::new(1.0, PRANDTL);
    set.properties.gravity = Vec2::new(0.0, -rayleigh * PRANDTL);
    let scalar = Scalar::new(TEMPERATURE, 1.0, 1.0);
    set.scalars = vec![Scalar { expansion: 1.0, reference: 0.0, ..scalar }];
    for condition in &mut set.conditions {
        match condition.boundary.as_str() {
            "left" => condition.scalars = vec![ScalarCondition::Value(Prescribed::Uniform(0.5))],
            "right" => condition.scalars = vec![ScalarCondition::Value(Prescribed::Uniform(-0.5))],
            _ => {}
        }
    }
    set.numerics.flow.tolerance = 1e-9;
    let mut start = set.rest(&mesh, 0.0);
    start.scalars = vec![mesh.points.iter().map(|x| 0.5 - x.x).collect()];
    let mut fluid = set.build(mesh, start)?;
    // Temperature and flow are solved one after the other: internal waves of frequency (Ra Pr)^1/2 are stable below 2.
    let dt = 0.7 / (rayleigh * PRANDTL).sqrt();
    let mut last = f64::NAN;
    for _ in 0..200 {
        steps_alone(&mut fluid, dt, 20)?;
        let now = nusselt(&mut fluid)?;
        if (now - last).abs() < 2e-6 * now {
            break;
        }
        last = now;
    }
    Ok((nusselt(&mut fluid)?, largest(&mut fluid)?))
}

/// Mean over the square of u T - dT/dx, which the paper calls the mean Nusselt number; dT/dx integrates to the
/// difference of the walls.
fn nusselt(fluid: &mut Fluid<2>) -> Result<f64> {
    let fields = &fluid.accepted;
    let warm = fields.scalar(HEAT);
    let carried = |cell: &[u32]| {
        let node = [0, 1, 2].map(|a| cell[a] as usize);
        let element = Element::<2, 3>::new(node.map(|n| fluid.mesh.points[n]));
        let mass = weighted_mass(element.measure, &[1.0; 3]);
        let pairs = (0..9).map(|k| mass[k / 3][k % 3] * fields.velocity[node[k / 3]].x * warm[node[k % 3]]);
        pairs.sum::<f64>()
    };
    Ok(1.0 + fluid.mesh.cells.chunks_exact(3).map(carried).sum::<f64>())
}

fn largest(fluid: &mut Fluid<2>) -> Result<[f64; 2]> {
    let fields = &fluid.accepted;
    let on = |axis: usize| {
        let nodes = fluid.mesh.points.iter().zip(&fields.velocity);
        let mut line: Vec<(f64, f64)> = nodes
            .filter(|(x, _)| (x[axis] - 0.5).abs() < 1e-9)
            .map(|(x, u)| (x[1 - axis], u[axis]))
            .collect();
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        top(&line)
    };
    Ok([on(0), on(1)])
}

/// Top of the parabola through the highest point and its neighbours.
fn top(line: &[(f64, f64)]) -> f64 {
    let inner = 1..line.len() - 1;
    let Some(k) = inner.max_by(|a, b| line[*a].1.total_cmp(&line[*b].1)) else { return f64::NAN };
    let [(x0, y0), (x1, y1), (x2, y2)] = [line[k - 1], line[k], line[k + 1]];
    let (left, right) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
    let bend = (right - left) / (x2 - x0);
    let slope = left + bend * (x1 - x0);
    y1 - slope * slope / (4.0 * bend)
}

fn run(effort: Effort) -> Result<Outcome> {
    let (cases, sizes): (usize, &[usize]) = effort.pick((2, &[32]), (4, &[32, 64, 128]));
    let mut outcome = Outcome::default();
    let mut points = Vec::new();
    for &(rayleigh, known, speeds) in &BENCH_MARK[..cases] {
        let solved = sizes.iter().map(|n| solve(rayleigh, *n)).collect::<Result<Vec<_>>>()?;
        let numbers: Vec<f64> = solved.iter().map(|(nusselt, _)| *nusselt).collect();
        let (finest, largest) = solved[solved.len() - 1];
        let mesh = format!("Ra {rayleigh:.0e}, {0} x {0} squares", sizes[sizes.len() - 1]);
        let mut mean =
            Finding::relative(format!("mean Nu, {mesh}"), "1", known, finest, effort.pick(0.01, 0.005));
        if let [a, b, c] = numbers[..] {
            // None while the finest step is not yet the smallest.
            let ratio = (a - b) / (b - c);
            mean.order = (ratio > 1.0).then(|| ratio.log2());
        }
        outcome.findings.push(mean);
        for (name, (known, value)) in ["u", "v"].into_iter().zip(speeds.into_iter().zip(largest)) {
            let what = format!("largest {name} on its centre line, {mesh}");
            outcome.findings.push(Finding::relative(what, "alpha/L", known, value, effort.pick(0.02, 0.01)));
        }
        points.push((rayleigh, finest));
    }
    let known = BENCH_MARK.iter().map(|(rayleigh, nusselt, _)| (*rayleigh, *nusselt)).collect();
    outcome.panels.push(Panel {
        curves: vec![Curve::known("de Vahl Davis", known), Curve::points("measured", points)],
        ..Panel::log_log("Natural convection in a square", "Ra", "mean Nu")
    });
    Ok(outcome)
}
