//! Walls that follow a named part of the boundary of the mesh, so that a scene states its geometry once.

use super::{Coordinates, MeshSource, Scene, SceneError, Wall};
use std::collections::BTreeMap;
use voidage_fluid::{Mesh, Vector};

/// Facets whose directions differ by less, as a sine, are one wall.
const STRAIGHT: f64 = 1e-9;

impl Scene {
    /// Puts straight walls in the place of those that follow a part of the boundary. The first of several is called as
    /// the wall that was asked for, with `-1`, the next with `-2` and so on.
    pub(super) fn lay_walls(&mut self) -> Result<(), Box<SceneError>> {
        if self.walls.iter().all(|wall| wall.along.is_none()) {
            return Ok(());
        }
        let mesh = self.mesh_of_walls()?;
        let mut laid = Vec::new();
        for (i, wall) in self.walls.iter().enumerate() {
            let Some(name) = &wall.along else {
                laid.push(wall.clone());
                continue;
            };
            let part = mesh.boundary(name).map_err(|error| {
                let path = format!("walls[{i}].along");
                self.origin.error(
                    &path,
                    format!("`{path}`: {error}"),
                    "name a part of the boundary of the mesh",
                )
            })?;
            let lines = straight(&mesh, &part.facets);
            let count = lines.len();
            laid.extend(lines.into_iter().enumerate().map(|(k, [from, to])| Wall {
                name: if count == 1 { wall.name.clone() } else { format!("{}-{}", wall.name, k + 1) },
                from: Coordinates(from.as_slice().to_vec()),
                to: Coordinates(to.as_slice().to_vec()),
                along: None,
                ..wall.clone()
            }));
        }
        self.walls = laid;
        Ok(())
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

/// The straight lines along facets, in the order of the chains that these form.
fn straight(mesh: &Mesh<2>, facets: &[u32]) -> Vec<[Vector<2>; 2]> {
    let mut after: BTreeMap<u32, u32> = facets.chunks_exact(2).map(|facet| (facet[0], facet[1])).collect();
    let mut lines: Vec<[Vector<2>; 2]> = Vec::new();
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
