//! What a mesh is made of: the description of a domain, as a scene file holds it.

use crate::{Error, Result};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::{Deserializer, SeqAccess, Visitor, value::SeqAccessDeserializer};
use serde::ser::Serializer;
use serde::{Deserialize, Serialize};

/// A rectangle of the plane with round holes, and how finely it is divided.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// Lower left corner, m.
    pub lower: [f64; 2],
    /// Upper right corner, m.
    pub upper: [f64; 2],
    /// Mean length of the edges of the cells, m, where no hole or refinement asks for less.
    /// Needed unless `structured` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<f64>,
    /// The names of the four sides.
    pub sides: Sides,
    /// Round holes cut out of the rectangle.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holes: Vec<Hole>,
    /// Places where cells are smaller.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refine: Vec<Refinement>,
    /// A regular grid of right triangles instead of an unstructured mesh; not with holes or refinements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub structured: Option<Structured>,
}

/// The names of the four sides of a rectangle.
///
/// A side is one name, `left = "walls"`, or parts in the direction of growing coordinate,
/// `bottom = [{ name = "inflow", to = 0.034 }, { name = "nozzle", to = 0.046 }, { name = "inflow" }]`.
/// Parts of the same name, also of several sides, make one boundary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sides {
    /// The side of smallest x; its parts go upwards.
    pub left: Side,
    /// The side of greatest x; its parts go upwards.
    pub right: Side,
    /// The side of smallest y; its parts go from left to right.
    pub bottom: Side,
    /// The side of greatest y; its parts go from left to right.
    pub top: Side,
}

impl Sides {
    /// The same name on all four sides.
    pub fn all(name: &str) -> Self {
        let side = || Side::named(name);
        Self { left: side(), right: side(), bottom: side(), top: side() }
    }
}

/// The parts of one side: written as a single name or as an array of parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Side(pub Vec<Part>);

/// A part of a side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// The name that boundary conditions refer to.
    pub name: String,
    /// The coordinate (x along bottom and top, y along left and right) where the part ends, m.
    /// The last part has none: it ends at the corner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<f64>,
}

impl Side {
    /// A side of one name.
    pub fn named(name: &str) -> Self {
        Self(vec![Part { name: name.into(), to: None }])
    }

    fn only_name(&self) -> Option<&str> {
        match self.0.as_slice() {
            [Part { name, to: None }] => Some(name),
            _ => None,
        }
    }
}

/// A round hole: a droplet, a cylinder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hole {
    /// The name that boundary conditions refer to.
    pub name: String,
    /// Centre, m.
    pub centre: [f64; 2],
    /// Radius, m. Nodes lie on the circle, the boundary is the polygon through them.
    pub radius: f64,
    /// Length of edges on the circle, m.
    pub size: f64,
    /// How fast sizes grow with distance from the circle (no unit, 0 to 1). Default 0.2.
    #[serde(default = "default_growth")]
    pub growth: f64,
}

/// A place where cells are smaller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Refinement {
    /// The place.
    pub around: Place,
    /// Length of edges there, m.
    pub size: f64,
    /// The size holds within this distance of the place, m. Default 0.
    #[serde(default)]
    pub within: f64,
    /// How fast sizes grow with distance beyond (no unit, 0 to 1). Default 0.2.
    #[serde(default = "default_growth")]
    pub growth: f64,
}

/// A place of the plane: `{ point = [x, y] }`, `{ segment = { from = [x, y], to = [x, y] } }`
/// or `{ box = { lower = [x, y], upper = [x, y] } }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Place {
    /// A point, m.
    Point([f64; 2]),
    /// A straight segment.
    Segment {
        /// One end, m.
        from: [f64; 2],
        /// The other end, m.
        to: [f64; 2],
    },
    /// A box with sides along the axes.
    Box {
        /// Lower left corner, m.
        lower: [f64; 2],
        /// Upper right corner, m.
        upper: [f64; 2],
    },
}

/// A regular grid of right triangles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Structured {
    /// Number of squares along x and y; each is cut into two triangles.
    pub squares: [usize; 2],
    /// Which diagonal cuts a square. Default `"rising"`.
    #[serde(default)]
    pub diagonals: Diagonals,
}

/// Which diagonal cuts the squares of a regular grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Diagonals {
    /// From lower left to upper right everywhere.
    #[default]
    Rising,
    /// From upper left to lower right everywhere.
    Falling,
    /// Rising and falling in turn like the colours of a chess board: no preferred direction.
    Alternating,
}

fn default_growth() -> f64 {
    0.2
}

impl Hole {
    /// The growth of sizes around a hole that says none.
    pub fn default_growth() -> f64 {
        default_growth()
    }
}

impl Place {
    /// Distance from a point to the place; zero inside a box.
    pub fn distance(&self, p: [f64; 2]) -> f64 {
        match self {
            Self::Point(q) => (p[0] - q[0]).hypot(p[1] - q[1]),
            Self::Segment { from, to } => {
                let d = [to[0] - from[0], to[1] - from[1]];
                let length2 = d[0] * d[0] + d[1] * d[1];
                let along = (p[0] - from[0]) * d[0] + (p[1] - from[1]) * d[1];
                let t = if length2 > 0.0 { (along / length2).clamp(0.0, 1.0) } else { 0.0 };
                (p[0] - from[0] - t * d[0]).hypot(p[1] - from[1] - t * d[1])
            }
            Self::Box { lower, upper } => {
                let gap = |k: usize| (lower[k] - p[k]).max(p[k] - upper[k]).max(0.0);
                gap(0).hypot(gap(1))
            }
        }
    }

    fn finite(&self) -> bool {
        match self {
            Self::Point(p) => finite(*p),
            Self::Segment { from, to } => finite(*from) && finite(*to),
            Self::Box { lower, upper } => finite(*lower) && finite(*upper),
        }
    }
}

fn finite(p: [f64; 2]) -> bool {
    p.iter().all(|x| x.is_finite())
}

fn positive(x: f64) -> bool {
    x.is_finite() && x > 0.0
}

fn ensure(holds: bool, text: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::Mesh(text())) }
}

impl Rectangle {
    /// The wanted length of edges at a point, m.
    pub fn size_at(&self, p: [f64; 2]) -> f64 {
        let mut size = self.size.unwrap_or(f64::INFINITY);
        for hole in &self.holes {
            let distance = (p[0] - hole.centre[0]).hypot(p[1] - hole.centre[1]) - hole.radius;
            size = size.min(hole.size + hole.growth * distance.max(0.0));
        }
        for place in &self.refine {
            let distance = place.around.distance(p) - place.within;
            size = size.min(place.size + place.growth * distance.max(0.0));
        }
        size
    }

    /// The smallest wanted length of edges, m.
    pub fn smallest_size(&self) -> f64 {
        let holes = self.holes.iter().map(|hole| hole.size);
        let places = self.refine.iter().map(|place| place.size);
        holes.chain(places).fold(self.size.unwrap_or(f64::INFINITY), f64::min)
    }

    /// Whether the description makes sense; the error names the field, its value and what is allowed.
    pub fn validate(&self) -> Result<()> {
        let (lower, upper) = (self.lower, self.upper);
        ensure(finite(lower) && finite(upper) && lower[0] < upper[0] && lower[1] < upper[1], || {
            format!("upper = {upper:?} must be right of and above lower = {lower:?}, all finite")
        })?;
        match (&self.structured, self.size) {
            (None, None) => {
                return Err(Error::Mesh("size is missing: give size (m) or structured".into()));
            }
            (None, Some(size)) => {
                ensure(positive(size), || format!("size = {size} must be positive and finite"))?
            }
            (Some(_), Some(_)) => {
                return Err(Error::Mesh("give either size or structured, not both".into()));
            }
            (Some(grid), None) => {
                let [nx, ny] = grid.squares;
                ensure(nx > 0 && ny > 0 && nx.saturating_mul(ny) <= 100_000_000, || {
                    format!("structured.squares = [{nx}, {ny}] must be positive, their product at most 1e8")
                })?;
                ensure(self.holes.is_empty() && self.refine.is_empty(), || {
                    "structured excludes holes and refine: give size instead".into()
                })?;
            }
        }
        for (name, side, axis) in self.named_sides() {
            validate_side(name, side, lower[axis], upper[axis])?;
        }
        self.validate_holes()?;
        for (i, place) in self.refine.iter().enumerate() {
            let Refinement { around, size, within, growth } = place;
            ensure(around.finite(), || format!("refine[{i}].around must be finite"))?;
            ensure(positive(*size), || format!("refine[{i}].size = {size} must be positive and finite"))?;
            ensure(within.is_finite() && *within >= 0.0, || {
                format!("refine[{i}].within = {within} must not be negative")
            })?;
            validate_growth(&format!("refine[{i}]"), *growth)?;
        }
        Ok(())
    }

    /// The sides with their names and the axis along which they go.
    pub(crate) fn named_sides(&self) -> [(&'static str, &Side, usize); 4] {
        let Sides { left, right, bottom, top } = &self.sides;
        [("left", left, 1), ("right", right, 1), ("bottom", bottom, 0), ("top", top, 0)]
    }

    fn validate_holes(&self) -> Result<()> {
        for (i, hole) in self.holes.iter().enumerate() {
            let Hole { name, centre: c, radius: r, size, growth } = hole;
            ensure(!name.trim().is_empty(), || format!("holes[{i}].name must not be empty"))?;
            ensure(positive(*r), || format!("holes[{i}].radius = {r} must be positive and finite"))?;
            ensure(positive(*size), || format!("holes[{i}].size = {size} must be positive and finite"))?;
            validate_growth(&format!("holes[{i}]"), *growth)?;
            let inside = (0..2).all(|k| c[k] - r > self.lower[k] && c[k] + r < self.upper[k]);
            ensure(finite(*c) && inside, || {
                format!(
                    "holes[{i}] (\"{name}\", centre {c:?}, radius {r}) must lie inside the rectangle {:?} to {:?}",
                    self.lower, self.upper
                )
            })?;
            for (j, other) in self.holes[..i].iter().enumerate() {
                let distance = (c[0] - other.centre[0]).hypot(c[1] - other.centre[1]);
                ensure(distance > r + other.radius, || {
                    format!("holes[{i}] (\"{name}\") overlaps holes[{j}] (\"{}\")", other.name)
                })?;
            }
        }
        Ok(())
    }
}

fn validate_growth(place: &str, growth: f64) -> Result<()> {
    ensure(growth.is_finite() && (0.0..=1.0).contains(&growth), || {
        format!("{place}.growth = {growth} must be from 0 to 1")
    })
}

fn validate_side(side: &str, Side(parts): &Side, lower: f64, upper: f64) -> Result<()> {
    ensure(!parts.is_empty(), || format!("sides.{side} must have at least one part"))?;
    let mut last = lower;
    for (i, part) in parts.iter().enumerate() {
        ensure(!part.name.trim().is_empty(), || format!("sides.{side}[{i}].name must not be empty"))?;
        if i + 1 == parts.len() {
            ensure(part.to.is_none() || part.to == Some(upper), || {
                format!("sides.{side}[{i}].to: the last part ends at the corner, {upper}; leave `to` out")
            })?;
        } else {
            let to = part.to.ok_or_else(|| {
                Error::Mesh(format!("sides.{side}[{i}].to is missing: only the last part may leave it out"))
            })?;
            ensure(to.is_finite() && to > last && to < upper, || {
                format!("sides.{side}[{i}].to = {to} must lie between {last} and {upper}")
            })?;
            last = to;
        }
    }
    Ok(())
}

impl Serialize for Side {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self.only_name() {
            Some(name) if serializer.is_human_readable() => serializer.serialize_str(name),
            _ => self.0.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Side {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> std::result::Result<Self, T::Error> {
        // A visitor and not an untagged enum: errors keep their place and say what was wrong.
        if deserializer.is_human_readable() {
            deserializer.deserialize_any(SideVisitor)
        } else {
            Vec::deserialize(deserializer).map(Side)
        }
    }
}

struct SideVisitor;

impl<'de> Visitor<'de> for SideVisitor {
    type Value = Side;

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("a name or an array of parts like { name = \"inflow\", to = 0.034 }")
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> std::result::Result<Side, E> {
        Ok(Side::named(name))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> std::result::Result<Side, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(seq)).map(Side)
    }
}

impl JsonSchema for Side {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Side".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let parts = generator.subschema_for::<Vec<Part>>();
        let text = "One name, or parts in the direction of growing coordinate.";
        schemars::json_schema!({ "description": text, "anyOf": [{ "type": "string" }, parts] })
    }
}
