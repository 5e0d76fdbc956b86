//! Probes: fields at a point, means along a line and in a box, as columns of the series.
//!
//! Nodal fields are linear in each cell, so their means are exact: a line is cut at the sides of the cells that it
//! crosses, a box cuts each cell into a polygon. Grains count with the part of their disc that lies in a box.

use crate::recorder::{FluidView, GrainView, Reading, View, column_name, with_unit};
use crate::{Probe, Scene};
use std::collections::BTreeSet;
use voidage_coupling::error::Result;
use voidage_coupling::overlap::disc_in_triangle;
use voidage_dem::Period;
use voidage_fluid::{Mesh, Vector};

type Point = Vector<2>;

/// Pieces of a probe: the cell, its share of the whole up to a common factor, and the point whose value counts there.
type Pieces = Vec<(usize, f64, Point)>;

/// Rounding of barycentric coordinates.
const SLACK: f64 = 1e-12;

/// Checks that each probe of the fluid meets the mesh, and that no two make the same column.
///
/// # Errors
/// One does not, or two do.
pub fn check_probes(scene: &Scene, view: &View<2>) -> Result<()> {
    let mut columns = BTreeSet::new();
    for (i, probe) in scene.output.probes.iter().enumerate() {
        let (path, name) = (format!("output.probes[{i}]"), &probe.name);
        if view.fluid.is_some_and(|fluid| pieces(fluid.mesh, probe).is_empty()) {
            let message = format!("the probe \"{name}\" lies outside of the mesh of the fluid");
            return Err(scene.error(&path, message, "give a place where fluid is"));
        }
        for (column, _) in readings(std::slice::from_ref(probe), view) {
            if let Some(column) = columns.replace(column) {
                let message =
                    format!("the probe \"{name}\" makes the column {column}, which another probe makes");
                return Err(scene.error(
                    &format!("{path}.name"),
                    message,
                    "give each probe a name of its own",
                ));
            }
        }
    }
    Ok(())
}

/// The columns of the probes.
pub(crate) fn readings(probes: &[Probe], view: &View<2>) -> Vec<Reading> {
    let mut readings = Vec::new();
    for probe in probes {
        let name = column_name(&probe.name);
        let mut add = |what: &str, value: f64| readings.push((format!("probe_{name}_{what}").into(), value));
        if let Some(fluid) = &view.fluid {
            of_fluid(fluid, probe, &mut add);
        }
        if let (Some(within), Some(grains)) = (&probe.within, &view.grains) {
            of_grains(grains, [within.lower.vector(), within.upper.vector()], &mut add);
        }
    }
    readings
}

/// Means of the nodal fields; no numbers where the probe does not meet the mesh, as in a hole that came its way.
fn of_fluid(fluid: &FluidView<2>, probe: &Probe, add: &mut impl FnMut(&str, f64)) {
    let weights = weights(fluid.mesh, probe);
    let whole: f64 = weights.iter().map(|(_, weight)| weight).sum();
    let mean = |value: &dyn Fn(usize) -> f64| {
        weights.iter().map(|(node, weight)| weight * value(*node)).sum::<f64>() / whole
    };
    add("pressure_Pa", mean(&|node| fluid.fields.pressure[node]));
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        add(&format!("velocity_{name}_m_per_s"), mean(&|node| fluid.fields.velocity[node][axis]));
    }
    for (scalar, values) in fluid.scalars.iter().zip(&fluid.fields.scalars) {
        add(&format!("fluid_{}", with_unit(scalar)), mean(&|node| values[node]));
    }
    if let Some(voidage) = fluid.voidage {
        add("voidage", mean(&|node| voidage[node]));
    }
}

/// Number of the grains with their centre in a box, solid share of the box, and means over the solid in it.
fn of_grains(grains: &GrainView<2>, [lower, upper]: [Point; 2], add: &mut impl FnMut(&str, f64)) {
    // What lies beyond a periodic side is at the other.
    let images = images(&grains.period);
    let within = |x: &Point| {
        images.iter().any(|image| (0..2).all(|k| lower[k] <= x[k] + image[k] && x[k] + image[k] < upper[k]))
    };
    let area = |centre: Point, radius: f64| {
        let corner = |x: f64, y: f64| [x - centre[0], y - centre[1]];
        let [a, b, c, d] = [
            corner(lower[0], lower[1]),
            corner(upper[0], lower[1]),
            corner(upper[0], upper[1]),
            corner(lower[0], upper[1]),
        ];
        let near = (0..2).all(|k| lower[k] - radius < centre[k] && centre[k] < upper[k] + radius);
        if near { disc_in_triangle([a, b, c], radius) + disc_in_triangle([a, c, d], radius) } else { 0.0 }
    };
    let solid = |i: usize| {
        let (centre, radius) = (grains.position[i], grains.radius[i]);
        let area: f64 = images.iter().map(|image| area(centre + image, radius)).sum();
        grains.volume[i] * area / (std::f64::consts::PI * radius * radius)
    };
    let parts: Vec<(usize, f64)> =
        (0..grains.position.len()).map(|i| (i, solid(i))).filter(|(_, part)| *part > 0.0).collect();
    let whole: f64 = parts.iter().map(|(_, part)| part).sum();
    let mean =
        |value: &dyn Fn(usize) -> f64| parts.iter().map(|(i, part)| part * value(*i)).sum::<f64>() / whole;
    let velocity = Point::from_fn(|k, _| mean(&|i| grains.velocity[i][k]));
    add("grains", grains.position.iter().filter(|x| within(x)).count() as f64);
    add("packing_fraction", whole / (upper - lower).product());
    add("grain_velocity_x_m_per_s", velocity[0]);
    add("grain_velocity_y_m_per_s", velocity[1]);
    add("granular_temperature_m2_per_s2", mean(&|i| 0.5 * (grains.velocity[i] - velocity).norm_squared()));
    if let Some(temperature) = grains.temperature {
        add("grain_temperature_K", mean(&|i| temperature[i]));
    }
}

/// The ways from a grain to itself and to its images beyond the sides of a periodic domain, m.
fn images(period: &Period<2>) -> Vec<Point> {
    let ways = [0, 1].map(|axis| period.length(axis).map_or(vec![0.0], |length| vec![-length, 0.0, length]));
    ways[0].iter().flat_map(|x| ways[1].iter().map(|y| Point::new(*x, *y))).collect()
}

/// Weights of nodes whose mean is that of a field over a probe, up to a common factor.
fn weights(mesh: &Mesh<2>, probe: &Probe) -> Vec<(usize, f64)> {
    let mut weights = Vec::new();
    for (cell, weight, point) in pieces(mesh, probe) {
        let shares = coordinates(mesh, cell, &point);
        weights
            .extend(mesh.cell(cell).iter().zip(shares).map(|(node, share)| (*node as usize, weight * share)));
    }
    weights
}

/// Where a probe meets the cells of a mesh.
fn pieces(mesh: &Mesh<2>, probe: &Probe) -> Pieces {
    if let Some(line) = &probe.line {
        return along(mesh, line.from.vector(), line.to.vector());
    }
    if let Some(within) = &probe.within {
        return inside(mesh, [within.lower.vector(), within.upper.vector()]);
    }
    let Some(at) = probe.at.as_ref().map(|at| at.vector()) else { return vec![] };
    let holds = |cell: &usize| coordinates(mesh, *cell, &at).into_iter().all(|share| share >= -SLACK);
    (0..mesh.cell_count()).find(holds).map(|cell| (cell, 1.0, at)).into_iter().collect()
}

/// Shares of the corners of a cell at a point: its barycentric coordinates.
fn coordinates(mesh: &Mesh<2>, cell: usize, x: &Point) -> [f64; 3] {
    let others = mesh.barycentric(cell, x);
    [1.0 - others.sum(), others[0], others[1]]
}

/// The pieces of a line between the sides of cells. A piece on a side belongs to two cells and counts once.
fn along(mesh: &Mesh<2>, from: Point, to: Point) -> Pieces {
    let mut pieces: Vec<(f64, f64, usize)> = Vec::new();
    for cell in 0..mesh.cell_count() {
        let [start, end] = [from, to].map(|x| coordinates(mesh, cell, &x));
        // Each coordinate is linear along the line, and not negative in the cell.
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for (a, b) in start.into_iter().zip(end) {
            let zero = a / (a - b);
            match (a >= -SLACK, b >= -SLACK) {
                (true, true) => {}
                (true, false) => last = last.min(zero),
                (false, true) => first = first.max(zero),
                (false, false) => last = -1.0,
            }
        }
        if first < last {
            pieces.push((first, last, cell));
        }
    }
    pieces.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let mut found = Pieces::new();
    let mut covered = 0.0;
    for (first, last, cell) in pieces {
        let first: f64 = first.max(covered);
        if last > first {
            found.push((cell, last - first, from.lerp(&to, 0.5 * (first + last))));
            covered = last;
        }
    }
    found
}

/// The parts of the cells in a box, each with its area and centroid.
fn inside(mesh: &Mesh<2>, [lower, upper]: [Point; 2]) -> Pieces {
    let mut found = Pieces::new();
    for cell in 0..mesh.cell_count() {
        let mut polygon: Vec<Point> =
            mesh.cell(cell).iter().map(|node| mesh.points[*node as usize]).collect();
        let beyond = |axis: usize| {
            polygon.iter().all(|x| x[axis] <= lower[axis]) || polygon.iter().all(|x| x[axis] >= upper[axis])
        };
        if (0..2).any(beyond) {
            continue;
        }
        for axis in 0..2 {
            polygon = cut(&polygon, |x| x[axis] - lower[axis]);
            polygon = cut(&polygon, |x| upper[axis] - x[axis]);
        }
        let Some((&first, rest)) = polygon.split_first() else { continue };
        for pair in rest.windows(2) {
            let area = 0.5 * (pair[0] - first).perp(&(pair[1] - first)).abs();
            if area > 0.0 {
                found.push((cell, area, (first + pair[0] + pair[1]) / 3.0));
            }
        }
    }
    found
}

/// The part of a convex polygon where a linear function is not negative.
fn cut(polygon: &[Point], value: impl Fn(&Point) -> f64) -> Vec<Point> {
    let mut part = Vec::with_capacity(polygon.len() + 1);
    for (k, from) in polygon.iter().enumerate() {
        let to = &polygon[(k + 1) % polygon.len()];
        let (a, b) = (value(from), value(to));
        if a >= 0.0 {
            part.push(*from);
        }
        if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
            part.push(from.lerp(to, a / (a - b)));
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Coordinates, ProbeBox, ProbeLine};
    use voidage_fluid::flow::State;
    use voidage_fluid::mesh::Rectangle;

    fn mesh() -> Mesh<2> {
        let rectangle: Rectangle = toml::from_str(
            "lower = [0.0, 0.0]\nupper = [2.0, 1.0]\nstructured = { squares = [7, 5], diagonals = \"alternating\" }\n\
             sides = { left = \"w\", right = \"w\", bottom = \"w\", top = \"w\" }",
        )
        .unwrap();
        Mesh::rectangle(&rectangle).unwrap()
    }

    fn point(x: f64, y: f64) -> Coordinates {
        Coordinates(vec![x, y])
    }

    fn named() -> Probe {
        Probe { name: "a b".into(), ..Probe::default() }
    }

    fn line(from: Coordinates, to: Coordinates) -> Probe {
        Probe { line: Some(ProbeLine { from, to }), ..named() }
    }

    fn within(lower: Coordinates, upper: Coordinates) -> Probe {
        Probe { within: Some(ProbeBox { lower, upper }), ..named() }
    }

    /// p = 1 + 3 x - 2 y has known means: at the point, at the middle of a line, at the middle of a box.
    #[test]
    fn means_of_a_linear_field_are_exact() {
        let mesh = mesh();
        let fields = State {
            pressure: mesh.points.iter().map(|x| 1.0 + 3.0 * x[0] - 2.0 * x[1]).collect(),
            velocity: mesh.points.iter().map(|x| Point::new(x[1], -x[0])).collect(),
            ..State::default()
        };
        let scalars = [];
        let fluid = FluidView { mesh: &mesh, fields: &fields, voidage: None, scalars: &scalars };
        let view = View { grains: None, fluid: Some(fluid), network: None };
        let places = [
            (Probe { at: Some(point(0.37, 0.81)), ..named() }, [0.37, 0.81]),
            (line(point(0.1, 0.9), point(1.5, 0.2)), [0.8, 0.55]),
            // Along the sides of cells, and beyond the mesh on one side.
            (line(point(1.0, 0.6), point(3.0, 0.6)), [1.5, 0.6]),
            (within(point(0.33, 0.11), point(1.27, 0.57)), [0.8, 0.34]),
            (within(point(-1.0, -1.0), point(0.5, 2.0)), [0.25, 0.5]),
        ];
        for (probe, [x, y]) in places {
            let found = readings(std::slice::from_ref(&probe), &view);
            let names: Vec<&str> = found.iter().map(|(name, _)| name.as_ref()).collect();
            let wanted =
                ["probe_a_b_pressure_Pa", "probe_a_b_velocity_x_m_per_s", "probe_a_b_velocity_y_m_per_s"];
            assert_eq!(names, wanted);
            for ((name, value), exact) in found.iter().zip([1.0 + 3.0 * x - 2.0 * y, y, -x]) {
                assert!((value - exact).abs() < 1e-12, "{probe:?}, {name}: {value}, {exact}");
            }
        }
    }

    /// Half of a disc that lies across the side of a box counts with its area; its centre counts once.
    #[test]
    fn grains_count_with_their_part_in_a_box() {
        let position = [Point::new(1.0, 0.5), Point::new(0.5, 0.5), Point::new(3.0, 0.5)];
        let velocity = [Point::new(2.0, 0.0), Point::new(-1.0, 3.0), Point::new(9.0, 9.0)];
        let (radius, volume) = ([0.1, 0.2, 0.1], [0.8, 1.6, 0.8]);
        let temperature = [300.0, 400.0, 900.0];
        let grains = GrainView {
            id: &[0, 1, 2],
            group: None,
            position: &position,
            velocity: &velocity,
            radius: &radius,
            mass: &volume,
            volume: &volume,
            spin: None,
            temperature: Some(&temperature),
            period: voidage_dem::Period::default(),
        };
        let view = View { grains: Some(grains), fluid: None, network: None };
        let found = readings(&[within(point(0.0, 0.0), point(1.0, 1.0))], &view);
        let parts = [0.4, 1.6];
        let mean = |a: f64, b: f64| (parts[0] * a + parts[1] * b) / 2.0;
        let (u, v) = (mean(2.0, -1.0), mean(0.0, 3.0));
        let fluctuation = 0.5 * (mean(4.0, 10.0) - u * u - v * v);
        let exact = [1.0, 2.0, u, v, fluctuation, mean(300.0, 400.0)];
        for ((name, value), exact) in found.iter().zip(exact) {
            assert!((value - exact).abs() < 1e-12 * exact.abs().max(1.0), "{name}: {value}, {exact}");
        }
        assert_eq!(found.len(), exact.len());
    }
}
