//! The named parts of the boundary of the fluid in a picture.

use plotters::style::RGBColor;
use std::f64::consts::TAU;
use voidage_coupling::Result;
use voidage_dem::Period;
use voidage_fluid::Mesh;
use voidage_fluid::mesh::{Rectangle, Side};
use voidage_scene::recorder::Frame;
use voidage_scene::{Flow, MeshSource, Scene};

/// Colours of parts that nothing slips along, and of the others (Okabe and Ito).
const WALLS: [RGBColor; 3] = [RGBColor(50, 50, 50), RGBColor(120, 120, 120), RGBColor(170, 170, 170)];
const OTHERS: [RGBColor; 5] = [
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(0, 114, 178),
];

type Line = [[f64; 2]; 2];

/// A part of the boundary.
#[derive(Clone, Debug)]
pub struct Part {
    /// What the legend says: name and condition.
    pub label: String,
    /// Its colour.
    pub colour: RGBColor,
    /// Where it lies at time zero, m.
    lines: Vec<Line>,
}

/// The parts of a scene, in the order of `fluid.boundaries`; the surface of a droplet is none of them.
pub fn parts(scene: &Scene) -> Result<Vec<Part>> {
    let Some(fluid) = &scene.fluid else { return Ok(Vec::new()) };
    let lines = match &fluid.mesh {
        MeshSource::Rectangle(rectangle) => of_rectangle(rectangle),
        MeshSource::File(file) => of_mesh(&Mesh::read_msh(file)?),
    };
    let (mut walls, mut others) = (WALLS.iter().cycle(), OTHERS.iter().cycle());
    let mut parts = Vec::new();
    for boundary in &fluid.boundaries {
        let (word, colours) = match boundary.flow {
            Flow::NoSlip => ("no-slip", &mut walls as &mut dyn Iterator<Item = &RGBColor>),
            Flow::Slip => ("slip", &mut others as _),
            Flow::Open { .. } => ("open", &mut others as _),
            Flow::Velocity(_) | Flow::SuperficialVelocity(_) => ("velocity given", &mut others as _),
        };
        let own = lines.iter().filter(|(name, _)| *name == boundary.name).map(|(_, line)| *line);
        let colour = colours.next().copied().unwrap_or(WALLS[0]);
        parts.push(Part { label: format!("{} ({word})", boundary.name), colour, lines: own.collect() });
    }
    Ok(parts)
}

fn of_rectangle(rectangle: &Rectangle) -> Vec<(String, Line)> {
    let ([left, bottom], [right, top]) = (rectangle.lower, rectangle.upper);
    let mut lines = Vec::new();
    let mut along = |Side(parts): &Side, from: [f64; 2], to: [f64; 2], axis: usize| {
        let mut start = from;
        for part in parts {
            let mut end = to;
            if let Some(place) = part.to {
                end[axis] = place;
            }
            lines.push((part.name.clone(), [start, end]));
            start = end;
        }
    };
    along(&rectangle.sides.left, [left, bottom], [left, top], 1);
    along(&rectangle.sides.right, [right, bottom], [right, top], 1);
    along(&rectangle.sides.bottom, [left, bottom], [right, bottom], 0);
    along(&rectangle.sides.top, [left, top], [right, top], 0);
    for hole in &rectangle.holes {
        let at = |k: u32| {
            let (sin, cos) = (TAU * f64::from(k) / 24.0).sin_cos();
            [hole.centre[0] + hole.radius * cos, hole.centre[1] + hole.radius * sin]
        };
        lines.extend((0..24).map(|k| (hole.name.clone(), [at(k), at(k + 1)])));
    }
    lines
}

fn of_mesh(mesh: &Mesh<2>) -> Vec<(String, Line)> {
    let at = |node: u32| <[f64; 2]>::from(mesh.points[node as usize]);
    let of = |part: &voidage_fluid::mesh::Boundary| {
        let facets = part.facets.as_chunks::<2>().0;
        facets.iter().map(|[a, b]| (part.name.clone(), [at(*a), at(*b)])).collect::<Vec<_>>()
    };
    mesh.boundaries.iter().flat_map(of).collect()
}

/// The sides of triangles of a frame that have no neighbour, each with the number of the part that it lies nearest to;
/// but for those of a ring, the surface of a droplet, and those on periodic sides.
pub fn sides(
    parts: &[Part],
    frame: &Frame,
    ring: Option<&[[f64; 2]]>,
    period: &Period<2>,
) -> Vec<(usize, Line)> {
    let sides = frame.cells.as_chunks::<3>().0.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]);
    let mut all: Vec<(u32, u32)> = sides.collect();
    all.sort_unstable();
    let alone = all.iter().filter(|(a, b)| all.binary_search(&(*b, *a)).is_err());
    let at = |node: u32| [frame.points[node as usize][0], frame.points[node as usize][1]];
    let lines = alone.map(|(a, b)| [at(*a), at(*b)]);
    let of_ring = |line: &Line| ring.is_some_and(|ring| line.iter().all(|end| ring.contains(end)));
    let joined = |line: &Line| {
        let on = |axis: usize, side: f64, length: f64| {
            line.iter().all(|end| (end[axis] - side).abs() <= 1e-9 * length)
        };
        period.sides().iter().enumerate().any(|(axis, sides)| {
            sides.is_some_and(|[low, high]| on(axis, low, high - low) || on(axis, high, high - low))
        })
    };
    let near = |line: Line| {
        let middle = [0, 1].map(|axis| 0.5 * (line[0][axis] + line[1][axis]));
        let distance =
            |part: &Part| part.lines.iter().map(|line| distance(line, middle)).fold(f64::INFINITY, f64::min);
        let nearest = (0..parts.len()).min_by(|a, b| distance(&parts[*a]).total_cmp(&distance(&parts[*b])));
        nearest.map(|part| (part, line))
    };
    lines.filter(|line| !of_ring(line) && !joined(line)).filter_map(near).collect()
}

/// From a line to a point.
fn distance([from, to]: &Line, point: [f64; 2]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let off = [point[0] - from[0], point[1] - from[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let share = ((off[0] * along[0] + off[1] * along[1]) / length.max(1e-300)).clamp(0.0, 1.0);
    (off[0] - share * along[0]).hypot(off[1] - share * along[1])
}
