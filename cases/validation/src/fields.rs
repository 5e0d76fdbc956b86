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

/// The nodes of a regular mesh, line by line.
pub struct Lines(Vec<(f64, Vec<(f64, usize)>)>);

impl Lines {
    /// The lines of nodes that have the coordinate `across` in common: that coordinate, and the other one with the number
    /// of each node, both growing.
    ///
    /// # Errors
    /// The scene has no fluid.
    pub fn new(simulation: &mut Simulation, across: usize) -> Result<Self> {
        let mesh = fluid(simulation)?.mesh;
        let (low, high) = mesh.bounds();
        // Coordinates of a line differ by round-off.
        let same = 1e-9 * (high - low).norm();
        let mut nodes: Vec<(f64, (f64, usize))> =
            mesh.points.iter().enumerate().map(|(node, x)| (x[across], (x[1 - across], node))).collect();
        nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let lines = nodes.chunk_by(|a, b| b.0 - a.0 <= same);
        let sorted = |line: &[(f64, (f64, usize))]| {
            let mut along: Vec<(f64, usize)> = line.iter().map(|node| node.1).collect();
            along.sort_by(|a, b| a.0.total_cmp(&b.0));
            (line[0].0, along)
        };
        Ok(Self(lines.map(sorted).collect()))
    }

    /// The share of solid at the nodes of each line, over the coordinate along it.
    ///
    /// # Errors
    /// The scene has no grains.
    pub fn shares(&self, simulation: &mut Simulation) -> Result<Vec<(f64, Points)>> {
        let voidage = fluid(simulation)?.voidage.ok_or_else(|| Error::run("the scene has no grains"))?;
        let share = |(along, node): &(f64, usize)| (*along, 1.0 - voidage[*node]);
        Ok(self.0.iter().map(|(across, line)| (*across, line.iter().map(share).collect())).collect())
    }
}

/// The highest place at which a profile falls through `level`, linear between nodes; the lowest node where it is below
/// everywhere.
pub fn top(profile: &[(f64, f64)], level: f64) -> f64 {
    let crossing = profile.windows(2).rev().find(|pair| pair[0].1 >= level && pair[1].1 < level);
    crossing.map_or(profile.first().map_or(f64::NAN, |node| node.0), |pair| through(pair, level))
}

/// The height up to which a suspension reaches, from the share of solid at rows of nodes that are equally far apart: a
/// sharp surface there leaves as much solid above as the profile has. Each share is a mean with the hat function of its
/// row, so that the place where the profile itself falls through a level runs unevenly from row to row, up to 1.7 times
/// as fast as the surface does.
///
/// The surface is looked for where the profile falls through `level`; the lowest row if that is nowhere.
pub fn interface(profile: &[(f64, f64)], level: f64) -> f64 {
    let crossing = profile.windows(2).rposition(|pair| pair[0].1 >= level && pair[1].1 < level);
    let Some(last) = crossing else { return profile.first().map_or(f64::NAN, |row| row.0) };
    // The hats of the rows below the last one lie in the suspension, which is as dense there as the mean of three.
    let from = last.saturating_sub(1);
    let below = &profile[from.saturating_sub(2)..=from];
    let share = below.iter().map(|row| row.1).sum::<f64>() / below.len() as f64;
    let (y, distance) = (profile[from].0, profile[last + 1].0 - profile[last].0);
    let above: f64 = profile[from..].iter().map(|row| row.1).sum();
    y + distance * (above / share - 0.5)
}

/// The lowest place at which a profile falls through `level`; the highest node where it is above everywhere, and zero,
/// the floor, where it is below.
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
    fn a_sharp_interface_is_found_wherever_it_lies_between_two_rows() {
        for share in [0.3, 0.49] {
            for surface in [4.0, 4.1, 4.37, 4.5, 4.8, 4.99] {
                // Means with the hat of each row: what of it lies below the surface.
                let below = |y: f64| {
                    let reach: f64 = (surface - y).clamp(-1.0, 1.0);
                    0.5 + reach - 0.5 * reach * reach.abs()
                };
                let profile: Vec<(f64, f64)> = (1..9).map(f64::from).map(|y| (y, share * below(y))).collect();
                assert!(
                    (interface(&profile, 0.25 * share / 0.49) - surface).abs() < 1e-12,
                    "{share} {surface}"
                );
            }
        }
    }

    #[test]
    fn fronts_lie_where_a_profile_falls_through_a_level() {
        let profile = [(0.0, 0.6), (1.0, 0.4), (2.0, 0.45), (3.0, 0.05), (4.0, 0.0)];
        assert!((bottom(&profile, 0.5) - 0.5).abs() < 1e-15);
        assert!((top(&profile, 0.25) - 2.5).abs() < 1e-15);
        assert_eq!([top(&profile, 0.7), bottom(&profile, 0.7)], [0.0, 0.0]);
        assert_eq!(bottom(&[(0.0, 0.6), (1.0, 0.55)], 0.5), 1.0);
    }
}
