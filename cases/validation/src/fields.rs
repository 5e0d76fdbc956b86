//! Where grains are and what the fluid bears, from the nodes of regular meshes.

use crate::measured::Points;
use voidage_coupling::{Error, Result};
use voidage_scene::Simulation;
use voidage_scene::recorder::FluidView;

/// The fluid of a run, with the fields of its last step.
fn fluid(simulation: &mut Simulation) -> Result<FluidView<'_, 2>> {
    simulation.refresh()?;
    simulation.view().fluid.ok_or_else(|| Error::run("the scene has no fluid"))
}

/// The share of solid at the nodes along each line of nodes with one coordinate `across` in common: `(coordinate across,
/// [(coordinate along, share)])`, both growing.
pub fn shares(simulation: &mut Simulation, across: usize) -> Result<Vec<(f64, Points)>> {
    let fluid = fluid(simulation)?;
    let voidage = fluid.voidage.ok_or_else(|| Error::run("the scene has no grains"))?;
    let points = &fluid.mesh.points;
    let mut order: Vec<usize> = (0..points.len()).collect();
    let (low, high) = fluid.mesh.bounds();
    // Coordinates of a line differ by round-off.
    let same = 1e-9 * (high - low).norm();
    let key = |node: usize| ((points[node][across] / same).round(), points[node][1 - across]);
    order.sort_by(|a, b| key(*a).0.total_cmp(&key(*b).0).then(key(*a).1.total_cmp(&key(*b).1)));
    let lines = order.chunk_by(|a, b| (points[*a][across] - points[*b][across]).abs() <= 2.0 * same);
    let along = |node: &usize| (points[*node][1 - across], 1.0 - voidage[*node]);
    Ok(lines.map(|line| (points[line[0]][across], line.iter().map(along).collect())).collect())
}

/// The highest place at which a profile falls through `level`, linear between nodes; the lowest node where it is below
/// everywhere.
pub fn top(profile: &[(f64, f64)], level: f64) -> f64 {
    let crossing = profile.windows(2).rev().find(|pair| pair[0].1 >= level && pair[1].1 < level);
    crossing.map_or(profile.first().map_or(f64::NAN, |node| node.0), |pair| through(pair, level))
}

/// The lowest place at which a profile falls through `level`; the highest node where it is above everywhere.
pub fn bottom(profile: &[(f64, f64)], level: f64) -> f64 {
    let crossing = profile.windows(2).find(|pair| pair[0].1 >= level && pair[1].1 < level);
    let all = profile.first().is_some_and(|node| node.1 >= level);
    let last = profile.last().map_or(f64::NAN, |node| node.0);
    crossing.map_or(if all { last } else { 0.0 }, |pair| through(pair, level))
}

fn through(pair: &[(f64, f64)], level: f64) -> f64 {
    let (below, above) = (pair[0], pair[1]);
    below.0 + (above.0 - below.0) * (below.1 - level) / (below.1 - above.1)
}

/// Mean pressure at the nodes of the lowest row between two x, Pa.
pub fn floor_pressure(simulation: &mut Simulation, between: [f64; 2]) -> Result<f64> {
    let fluid = fluid(simulation)?;
    let floor = fluid.mesh.bounds().0.y;
    let inside = |x: f64| between[0] <= x && x <= between[1];
    let nodes = fluid.mesh.points.iter().zip(&fluid.fields.pressure);
    let values: Vec<f64> =
        nodes.filter(|(x, _)| x.y == floor && inside(x.x)).map(|(_, pressure)| *pressure).collect();
    Ok(values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fronts_lie_where_a_profile_falls_through_a_level() {
        let profile = [(0.0, 0.6), (1.0, 0.4), (2.0, 0.45), (3.0, 0.05), (4.0, 0.0)];
        assert!((bottom(&profile, 0.5) - 0.5).abs() < 1e-15);
        assert!((top(&profile, 0.25) - 2.5).abs() < 1e-15);
        assert_eq!([top(&profile, 0.7), bottom(&profile, 0.7)], [0.0, 0.0]);
        assert_eq!(bottom(&[(0.0, 0.6), (1.0, 0.55)], 0.5), 1.0);
    }
}
