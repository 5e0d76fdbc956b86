//! Periodic sides of a scene.

use super::Scene;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use voidage_coupling::error::Result;
use voidage_dem::Period;
use voidage_fluid::Mesh;

/// Periodic sides. Grains that leave at one side come in at the opposite one, and grains near one side touch and warm
/// those near the other. The fluid has the same velocity, pressure and scalars at both. In a mesh these sides are
/// straight, lie at its two ends, and have their nodes at the same heights; they need no boundary conditions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Periodic {
    /// The x of the left and of the right side, m. Default: not periodic along x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x: Option<[f64; 2]>,
    /// The y of the lower and of the upper side, m. Default: not periodic along y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y: Option<[f64; 2]>,
}

/// Distance of a side from the end of the mesh, over the length of the period, that counts as none.
const ALIKE: f64 = 1e-9;

impl Periodic {
    /// The axes that are periodic, with their names and sides.
    pub(crate) fn axes(&self) -> impl Iterator<Item = (usize, &'static str, [f64; 2])> {
        let axes = [(0, "x", self.x), (1, "y", self.y)].into_iter();
        axes.filter_map(|(axis, name, sides)| Some((axis, name, sides?)))
    }

    /// A mesh whose ends are these sides, with both of each pair as one.
    pub(crate) fn join(&self, scene: &Scene, mut mesh: Mesh<2>) -> Result<Mesh<2>> {
        let (lower, upper) = mesh.bounds();
        for (axis, name, [low, high]) in self.axes() {
            let ends = [lower[axis], upper[axis]];
            let most = ALIKE * (high - low);
            if (low - ends[0]).abs() > most || (high - ends[1]).abs() > most {
                let path = format!("periodic.{name}");
                let message =
                    format!("`{path} = [{low}, {high}]`: the mesh ends at {} and {}", ends[0], ends[1]);
                return Err(scene.error(&path, message, "give the ends of the mesh"));
            }
        }
        mesh.join_sides([self.x.is_some(), self.y.is_some()]).map_err(|error| {
            let help = "give straight sides with nodes at the same heights, and names that no other part has; \
                        `fluid.mesh.rectangle.structured` makes such a mesh";
            scene.error("periodic", format!("`periodic`: {error}"), help)
        })?;
        Ok(mesh)
    }
}

impl Scene {
    /// The periodic sides as grains have them; sides that mean nothing were refused before.
    pub fn period(&self) -> Period<2> {
        let sides = self.periodic.as_ref().map_or([None, None], |periodic| [periodic.x, periodic.y]);
        Period::new(sides).unwrap_or_default()
    }
}
