//! Walls of several straight pieces: along a named part of the boundary of the mesh, so that a scene states its geometry
//! once, and rings.

use super::{Coordinates, MeshSource, Ring, Scene, SceneError, Wall};
use std::collections::BTreeMap;
use std::ops::Range;
use voidage_fluid::{Mesh, Vector};

/// Both ends of straight walls.
type Lines = Vec<[Vector<2>; 2]>;

/// Facets whose directions differ by less, as a sine, are one wall.
const STRAIGHT: f64 = 1e-9;

impl Scene {
    /// Puts straight walls in the place of rings and of walls that follow a part of the boundary. The first of several
    /// is called as the wall that was asked for, with `-1`, the next with `-2` and so on.
    pub(super) fn lay_walls(&mut self) -> Result<(), Box<SceneError>> {
        let follow = self.walls.iter().any(|wall| wall.along.is_some());
        let mesh = if follow { Some(self.mesh_of_walls()?) } else { None };
        let (mut laid, mut pieces) = (Vec::new(), Vec::new());
        for (i, wall) in self.walls.iter().enumerate() {
            let (lines, body) = match (&wall.along, &mesh, &wall.ring) {
                (Some(name), Some(mesh), _) => (self.lines_along(mesh, name, i)?, wall.body.clone()),
                // A ring is one body, whose parts are of no interest one by one.
                (_, _, Some(ring)) => (corners(ring), Some(wall.body().to_owned())),
                _ => {
                    pieces.push((wall.name.clone(), laid.len()..laid.len() + 1));
                    laid.push(wall.clone());
                    continue;
                }
            };
            let count = lines.len();
            pieces.push((wall.name.clone(), laid.len()..laid.len() + count));
            laid.extend(lines.into_iter().enumerate().map(|(k, [from, to])| Wall {
                name: if count == 1 { wall.name.clone() } else { format!("{}-{}", wall.name, k + 1) },
                from: Coordinates(from.as_slice().to_vec()),
                to: Coordinates(to.as_slice().to_vec()),
                along: None,
                ring: None,
                body: body.clone(),
                ..wall.clone()
            }));
        }
        self.walls = laid;
        for event in &mut self.events {
            event.set = event.set.iter().flat_map(|set| for_pieces(set, &pieces)).collect();
        }
        Ok(())
    }

    fn lines_along(&self, mesh: &Mesh<2>, name: &str, wall: usize) -> Result<Lines, Box<SceneError>> {
        let part = mesh.boundary(name).map_err(|error| {
            let path = format!("walls[{wall}].along");
            let help = "name a part of the boundary of the mesh";
            self.origin.error(&path, format!("`{path}`: {error}"), help)
        })?;
        Ok(straight(mesh, &part.facets))
    }

    fn mesh_of_walls(&self) -> Result<Mesh<2>, Box<SceneError>> {
        let Some(fluid) = &self.fluid else {
            let message = "a wall is `along` a part of a mesh, but the scene has no fluid";
            return Err(self.origin.error("walls", message, "give `from` and `to`, or add `[fluid]`"));
        };
        let made = match &fluid.mesh {
            MeshSource::Rectangle(rectangle) => Mesh::rectangle(rectangle),
            MeshSource::File(file) => Mesh::read_msh(file),
        };
        made.map_err(|error| {
            let message = format!("`fluid.mesh`: {error}");
            self.origin.error("fluid.mesh", message, "give a mesh of triangles with named boundaries")
        })
    }
}

/// A change of a wall as it was asked for, as changes of its pieces; `pieces` has their numbers by wall.
fn for_pieces(set: &str, pieces: &[(String, Range<usize>)]) -> Vec<String> {
    let of_wall = |rest: &str| -> Option<Vec<String>> {
        let (which, rest) = match rest.strip_prefix('[') {
            Some(rest) => rest.split_once(']').map(|(which, rest)| (which, rest.to_owned()))?,
            None => {
                rest.strip_prefix('.')?.split_once('.').map(|(which, rest)| (which, format!(".{rest}")))?
            }
        };
        let named = || pieces.iter().find(|(name, _)| name == which);
        let (_, numbers) = which.parse().map_or_else(|_| named(), |number: usize| pieces.get(number))?;
        Some(numbers.clone().map(|number| format!("walls[{number}]{rest}")).collect())
    };
    set.strip_prefix("walls").and_then(of_wall).unwrap_or_else(|| vec![set.to_owned()])
}

/// The sides of a ring, anticlockwise from the right.
fn corners(ring: &Ring) -> Lines {
    let corner = |k: usize| {
        let angle = std::f64::consts::TAU * (k % ring.pieces) as f64 / ring.pieces as f64;
        ring.centre.vector() + Vector::<2>::new(angle.cos(), angle.sin()) * ring.radius
    };
    (0..ring.pieces).map(|k| [corner(k), corner(k + 1)]).collect()
}

/// The straight lines along facets, in the order of the chains that these form.
fn straight(mesh: &Mesh<2>, facets: &[u32]) -> Lines {
    let mut after: BTreeMap<u32, u32> = facets.chunks_exact(2).map(|facet| (facet[0], facet[1])).collect();
    let mut lines = Lines::new();
    while !after.is_empty() {
        // A chain begins where no facet ends; what is left then are rings, which begin anywhere.
        let begins = after.keys().find(|node| !after.values().any(|end| end == *node));
        let Some(mut node) = begins.or_else(|| after.keys().next()).copied() else { break };
        let first = lines.len();
        while let Some(next) = after.remove(&node) {
            let [from, to] = [node, next].map(|node| mesh.points[node as usize]);
            match lines[first..].last_mut() {
                Some([start, end]) if sine(&(*end - *start), &(to - from)) < STRAIGHT => *end = to,
                _ => lines.push([from, to]),
            }
            node = next;
        }
    }
    lines
}

/// Sine of the angle between two directions; 1 where they are opposite.
fn sine(a: &Vector<2>, b: &Vector<2>) -> f64 {
    let cross = (a.x * b.y - a.y * b.x).abs() / (a.norm() * b.norm());
    if a.dot(b) > 0.0 { cross } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const SCENE: &str = r#"
gravity = [0.0, -9.81]
[time]
step = 1e-3
end = 1e-2
[materials.glass]
density = 2500.0
[[grains]]
material = "glass"
radius = 5e-4
placement = { lattice = { lower = [0.0, 0.0], upper = [0.01, 0.01] } }
[[walls]]
name = "box"
along = "walls"
friction = 0.4
[[walls]]
name = "shelf"
from = [0.0, 0.015]
to = [0.002, 0.015]
[fluid]
density = 1.2
viscosity = 2e-5
[fluid.mesh.rectangle]
lower = [0.0, 0.0]
upper = [0.01, 0.02]
size = 2e-3
sides = { left = "walls", right = "walls", bottom = "walls", top = "top" }
[[fluid.boundaries]]
name = "walls"
flow = "no-slip"
[[fluid.boundaries]]
name = "top"
flow = "open"
"#;

    #[test]
    fn a_wall_along_three_sides_is_three_straight_walls() {
        let scene =
            Scene::parse(Path::new("scene.toml"), SCENE, &[]).unwrap_or_else(|error| panic!("{error}"));
        let names: Vec<&str> = scene.walls.iter().map(|wall| wall.name.as_str()).collect();
        assert_eq!(names, ["box-1", "box-2", "box-3", "shelf"]);
        let ends =
            |k: usize| [scene.walls[k].from.0.clone(), scene.walls[k].to.0.clone()].map(|x| [x[0], x[1]]);
        let all: Vec<_> = (0..3).map(ends).collect();
        assert_eq!(
            all,
            [[[0.0, 0.02], [0.0, 0.0]], [[0.0, 0.0], [0.01, 0.0]], [[0.01, 0.0], [0.01, 0.02]]],
            "from the top on the left down, along the floor, and up"
        );
        assert!(scene.walls[..3].iter().all(|wall| wall.friction == Some(0.4)));
        // The scene as resolved has straight walls only, and reads back.
        let resolved = scene.to_toml().expect("TOML");
        let again = Scene::parse(Path::new("scene.toml"), &resolved, &[]).expect("the same scene");
        assert_eq!(again.walls.len(), 4);
    }

    #[test]
    fn a_ring_is_a_closed_polygon_and_one_body() {
        let ring = "ring = { centre = [0.01, 0.02], radius = 0.05, pieces = 4 }\nbody = \"drum\"";
        let text = SCENE.replacen("along = \"walls\"", ring, 1);
        let scene =
            Scene::parse(Path::new("scene.toml"), &text, &[]).unwrap_or_else(|error| panic!("{error}"));
        let ends = |k: usize| [scene.walls[k].from.vector::<2>(), scene.walls[k].to.vector::<2>()];
        for k in 0..4 {
            assert_eq!(ends(k)[1], ends((k + 1) % 4)[0], "closed");
            assert!((ends(k)[0] - Vector::<2>::new(0.01, 0.02)).norm() - 0.05 < 1e-15);
            assert_eq!((scene.walls[k].body(), scene.walls[k].friction), ("drum", Some(0.4)));
        }
        assert!((ends(1)[0] - Vector::<2>::new(0.01, 0.07)).norm() < 1e-15, "anticlockwise from the right");
        assert_eq!(scene.walls[4].body(), "shelf");
    }

    #[test]
    fn parts_of_a_body_that_move_apart_are_refused() {
        let said = |more: &str| {
            let text = SCENE.replacen("along = \"walls\"", more, 1);
            Scene::parse(Path::new("scene.toml"), &text, &[]).expect_err("a mistake").to_string()
        };
        let ring = "ring = { centre = [0.0, 0.0], radius = 0.1";
        let moving = said(&format!("{ring} }}\nbody = \"shelf\"\nmotion.velocity = [0.1, 0.0]"));
        assert!(moving.contains("walls[1].body") && moving.contains("do not move as one"), "{moving}");
        // Each part would have its torque about its own middle.
        let table = said(&format!("{ring} }}\nmotion.table.rows = [[0.0, 0.0, 0.0, 0.0]]"));
        assert!(table.contains("walls[0].motion.table") && table.contains("no `centre`"), "{table}");
        assert!(said(&format!("{ring}, pieces = 2 }}")).contains("walls[0].ring.pieces = 2"));
        assert!(said(&format!("{ring} }}\nalong = \"walls\"")).contains("walls[0].ring"));
    }

    #[test]
    fn a_wall_along_nothing_or_along_and_between_is_named() {
        let said = |change: [&str; 2]| {
            let text = SCENE.replacen(change[0], change[1], 1);
            Scene::parse(Path::new("scene.toml"), &text, &[]).expect_err("a mistake").to_string()
        };
        assert!(said(["along = \"walls\"", "along = \"wals\""]).contains("no boundary \"wals\""));
        let both = said(["along = \"walls\"", "along = \"walls\"\nfrom = [0.0, 0.0]"]);
        assert!(both.contains("walls[0]") && both.contains("`along`"), "{both}");
        let neither = said(["along = \"walls\"", ""]);
        assert!(neither.contains("walls[0].from") || neither.contains("`from`"), "{neither}");
    }
}
