//! Walls: how fast they turn, whether the fluid sees them, and whether they hold the grains in the mesh.

use super::{Short, Sizes};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use voidage_fluid::mesh::Locator;
use voidage_fluid::{Mesh, Vector};
use voidage_scene::{Boundary, Flow, Motion, Scene};

impl Sizes {
    /// How fast walls turn.
    pub(super) fn walls(&mut self, scene: &Scene) {
        let gravity = scene.gravity.vector::<2>().norm();
        let mut bodies: BTreeMap<&str, (usize, f64, f64)> = BTreeMap::new();
        for (i, wall) in scene.walls.iter().enumerate() {
            let Some(Motion::Rotate(turn)) = &wall.motion else { continue };
            let ends: [Vector<2>; 2] = [wall.from.vector(), wall.to.vector()];
            let reach = ends.map(|end| (end - turn.centre.vector::<2>()).norm());
            let body = bodies.entry(wall.body()).or_insert((i, turn.rate, 0.0));
            body.2 = reach.into_iter().fold(body.2, f64::max);
        }
        for (name, (i, rate, reach)) in bodies {
            let (rpm, speed) = (rate * 60.0 / TAU, rate.abs() * reach);
            let text = format!(
                "{name}: {} rad/s, {} turns a minute, {} m/s at its rim",
                Short(rate),
                Short(rpm),
                Short(speed)
            );
            self.line("rotation", text);
            if gravity > 0.0 && rate * rate * reach > gravity {
                let what = format!(
                    "{} rad/s are {} turns a minute: at {} m from the centre grains feel {} times gravity",
                    Short(rate),
                    Short(rpm),
                    Short(reach),
                    Short(rate * rate * reach / gravity)
                );
                self.odd(&format!("walls[{i}].motion.rotate.rate"), what);
            }
        }
    }

    /// Walls of the grains inside the mesh, through which the fluid flows.
    pub(super) fn walls_inside(&mut self, scene: &Scene, mesh: &Mesh<2>, edge: f64) {
        let Ok(locator) = Locator::new(mesh) else { return };
        let facets = mesh.boundaries.iter().flat_map(|part| part.facets.chunks_exact(2));
        let facets: Vec<[Vector<2>; 2]> =
            facets.map(|facet| [0, 1].map(|k| mesh.points[facet[k] as usize])).collect();
        let beside = |at: &Vector<2>| facets.iter().any(|facet| distance(facet, at) < edge);
        let mut inside: BTreeMap<&str, usize> = BTreeMap::new();
        for (i, wall) in scene.walls.iter().enumerate() {
            let (from, to): (Vector<2>, Vector<2>) = (wall.from.vector(), wall.to.vector());
            let seen = |share: f64| {
                let at = from + (to - from) * share;
                locator.locate(mesh, &at, None).is_none() || beside(&at)
            };
            if !inside.contains_key(wall.body()) && ![0.25, 0.5, 0.75].into_iter().all(seen) {
                inside.insert(wall.body(), i);
            }
        }
        for (name, i) in inside {
            let what = format!(
                "\"{name}\" is inside the mesh, where it stops grains alone: the fluid flows through it; give the mesh a \
                 boundary there, and the wall `along` it"
            );
            self.odd(&format!("walls[{i}]"), what);
        }
    }
}

/// Distance of a point from a segment, m.
fn distance([from, to]: &[Vector<2>; 2], at: &Vector<2>) -> f64 {
    let along = to - from;
    let share = ((at - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (from + along * share - at).norm()
}

/// Share of a boundary that grains cannot leave by and that no wall of theirs stands along, within a diameter.
pub(super) fn unguarded(scene: &Scene, mesh: &Mesh<2>, boundary: &Boundary, diameter: f64) -> Option<f64> {
    if matches!(boundary.flow, Flow::Open { .. }) {
        return None;
    }
    let part = mesh.boundary(&boundary.name).ok()?;
    let middles = part
        .facets
        .chunks_exact(2)
        .map(|facet| 0.5 * (mesh.points[facet[0] as usize] + mesh.points[facet[1] as usize]));
    let near = |at: &Vector<2>| {
        scene.walls.iter().any(|wall| {
            let (from, to): (Vector<2>, Vector<2>) = (wall.from.vector(), wall.to.vector());
            distance(&[from, to], at) <= diameter
        })
    };
    let all: Vec<bool> = middles.map(|at| near(&at)).collect();
    Some(all.iter().filter(|guarded| !**guarded).count() as f64 / all.len().max(1) as f64)
}
