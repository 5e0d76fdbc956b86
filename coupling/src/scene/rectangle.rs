//! Stand-in for `voidage_fluid::mesh::generate::Rectangle`, of the same shape, until the meshes are merged.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, de};
use std::fmt;

/// A rectangle to mesh with triangles.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// Lower left corner, m.
    pub lower: [f64; 2],
    /// Upper right corner, m.
    pub upper: [f64; 2],
    /// Length of the sides of the triangles, m. Above 0.
    pub size: f64,
    /// Names of the parts of the boundary.
    pub sides: Sides,
    /// Circular holes. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holes: Vec<Hole>,
    /// Where the triangles are smaller. Default: nowhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refine: Vec<Refine>,
    /// Whether the triangles are halves of equal rectangles (no holes, no refinement). Default false.
    #[serde(default)]
    pub structured: bool,
}

/// The four sides: one name, or parts from left to right and from bottom to top.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sides {
    /// Left side.
    pub left: Side,
    /// Right side.
    pub right: Side,
    /// Bottom side.
    pub bottom: Side,
    /// Top side.
    pub top: Side,
}

/// One side: a name, or a list of parts `{name, to}`.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Side {
    /// The whole side has this name.
    Name(String),
    /// Parts, each up to its `to`; the last reaches the corner.
    Parts(Vec<SidePart>),
}

/// Part of a side.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SidePart {
    /// Name of the part; several parts may share one.
    pub name: String,
    /// Coordinate along the side at which the part ends, m. Default: the corner; asked for except in the last part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<f64>,
}

/// A circular hole.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hole {
    /// Name of its boundary.
    pub name: String,
    /// Centre, m.
    pub center: [f64; 2],
    /// Radius, m.
    pub radius: f64,
    /// Length of the sides of the triangles at its boundary, m. Default: that of the rectangle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<f64>,
}

/// A place where the triangles are smaller.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Refine {
    /// Centre, m.
    pub center: [f64; 2],
    /// Distance within which the size holds, m.
    pub radius: f64,
    /// Length of the sides of the triangles there, m.
    pub size: f64,
}

// Written by hand: `untagged` would lose the place of an error inside the list.
impl<'de> Deserialize<'de> for Side {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = Side;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a name or a list of parts {name, to}")
            }
            fn visit_str<E: de::Error>(self, name: &str) -> Result<Side, E> {
                Ok(Side::Name(name.to_owned()))
            }
            fn visit_seq<A: de::SeqAccess<'de>>(self, mut list: A) -> Result<Side, A::Error> {
                let mut parts = Vec::new();
                while let Some(part) = list.next_element()? {
                    parts.push(part);
                }
                Ok(Side::Parts(parts))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl Rectangle {
    /// The names of all parts of the boundary, in order, each once.
    pub fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        let sides = &self.sides;
        for side in [&sides.left, &sides.right, &sides.bottom, &sides.top] {
            match side {
                Side::Name(name) => names.push(name),
                Side::Parts(parts) => names.extend(parts.iter().map(|part| part.name.as_str())),
            }
        }
        names.extend(self.holes.iter().map(|hole| hole.name.as_str()));
        let mut once = Vec::new();
        for name in names {
            if !once.contains(&name) {
                once.push(name);
            }
        }
        once
    }
}
