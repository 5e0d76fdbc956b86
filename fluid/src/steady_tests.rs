//! Many points in a flow: held in a steady one, in the plane and in space, and carried along by one.

use crate::Vector;
use crate::boundary::Facet;
use crate::conditions::{Condition, FlowCondition, Prescribed};
use crate::flow::{Flow, Numerics, State};
use crate::forms::Properties;
use crate::linear::sample::Grid;
use crate::mesh::{Boundary, Mesh};
use crate::points::Points;

const VOIDAGE: f64 = 0.6;
/// Superficial velocity, m/s, and drag per volume over velocity, kg/m3/s.
const SPEED: f64 = 0.1;
const DRAG: f64 = 1e4;

/// The unit square or cube: the flow goes from its floor to its top along the last axis.
fn unit_box<const D: usize>(per_side: usize) -> Mesh<D> {
    let grid = Grid::<D>::new(per_side);
    let points: Vec<Vector<D>> = grid.points.iter().map(|x| Vector::from(*x)).collect();
    let mut mesh = Mesh { points, cells: grid.cells, boundaries: Vec::new(), periodic: Default::default() };
    for cell in 0..mesh.cell_count() {
        if mesh.measure(cell) < 0.0 {
            mesh.cells.swap(cell * (D + 1), cell * (D + 1) + 1);
        }
    }
    let mut parts =
        ["floor", "top", "sides"].map(|name| Boundary { name: name.into(), facets: vec![], cells: vec![] });
    for cell in 0..mesh.cell_count() {
        for left_out in 0..=D {
            let mut facet: Vec<u32> = mesh.cell(cell).to_vec();
            facet.remove(left_out);
            let on =
                |axis: usize, side: f64| facet.iter().all(|node| mesh.points[*node as usize][axis] == side);
            let part = match (on(D - 1, 0.0), on(D - 1, 1.0)) {
                (true, _) => 0,
                (_, true) => 1,
                _ if (0..D - 1).any(|axis| on(axis, 0.0) || on(axis, 1.0)) => 2,
                _ => continue,
            };
            let outwards = mesh.points[facet[0] as usize] - mesh.centroid(cell);
            if Facet::new(&mesh, &facet).normal.dot(&outwards) < 0.0 {
                facet.swap(0, 1);
            }
            parts[part].facets.extend(facet);
            parts[part].cells.push(cell as u32);
        }
    }
    mesh.boundaries = parts.into();
    mesh
}

/// Held points anywhere in a mesh whose cells are alike, with drags that differ by a factor of three.
fn held<const D: usize>(mesh: &Mesh<D>, count: usize) -> Points<D> {
    let mut state = 1_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let each = mesh.volume() / count as f64;
    let mut points = Points::default();
    for _ in 0..count {
        let shares: [f64; 4] = std::array::from_fn(|a| if a <= D { -random().ln() } else { 0.0 });
        let sum: f64 = shares.iter().sum();
        points.cell.push((random() * mesh.cell_count() as f64) as u32);
        points.coordinate.push(Vector::from_fn(|a, _| shares[a + 1] / sum));
        points.volume.push((1.0 - VOIDAGE) * each);
        points.drag.push(DRAG * each * (0.5 + random()));
    }
    let none = || vec![0.0; count];
    (points.mobility, points.flux_mobility) = (none(), none());
    points.velocity = vec![Vector::zeros(); count];
    points.flux_velocity = vec![Vector::zeros(); count];
    points
}

/// A held point in the middle of each cell of the middle half of the box, all with the same drag per volume.
fn block<const D: usize>(mesh: &Mesh<D>, drag: f64) -> Points<D> {
    let mut points = Points::default();
    let within = |cell: &usize| (0.25..0.75).contains(&mesh.centroid(*cell)[D - 1]);
    for cell in (0..mesh.cell_count()).filter(within) {
        points.cell.push(cell as u32);
        points.coordinate.push(Vector::repeat(1.0 / (D + 1) as f64));
        points.volume.push((1.0 - VOIDAGE) * mesh.measure(cell));
        points.drag.push(drag * mesh.measure(cell));
    }
    let (none, still) = (vec![0.0; points.drag.len()], vec![Vector::zeros(); points.drag.len()]);
    (points.mobility, points.flux_mobility) = (none.clone(), none);
    (points.velocity, points.flux_velocity) = (still.clone(), still);
    points
}

/// Steady pressure at the floor, Pa, and the fastest fluid over that at the inflow, with steps of `dt` in a fluid of this
/// density (kg/m3) and viscosity (Pa s).
fn steady<const D: usize, const B: usize>(
    mesh: &Mesh<D>,
    points: &Points<D>,
    (density, viscosity): (f64, f64),
    dt: f64,
) -> [f64; 2] {
    let up = |speed: f64| Vector::from_fn(|axis, _| if axis == D - 1 { speed } else { 0.0 });
    let condition = |name: &str, flow| Condition { boundary: name.into(), flow, scalars: vec![] };
    let conditions = [
        condition("floor", FlowCondition::SuperficialVelocity(Prescribed::Uniform(up(SPEED)))),
        condition("top", FlowCondition::Open { pressure: 0.0 }),
        condition("sides", FlowCondition::Slip),
    ];
    let properties = Properties {
        density,
        viscosity,
        gravity: Vector::zeros(),
        body_force: Vector::zeros(),
        thin_cell_drag: 0.0,
    };
    let nodes = mesh.points.len();
    let state =
        State { velocity: vec![up(SPEED / VOIDAGE); nodes], pressure: vec![0.0; nodes], scalars: vec![] };
    let mut flow =
        Flow::<D, B>::new(mesh.clone(), properties, &[], &conditions, state, &Numerics::default()).unwrap();
    let voidage = vec![VOIDAGE; nodes];
    for _ in 0..12 {
        flow.solve(dt, &voidage, Some(points), &conditions).unwrap();
        flow.accept();
    }
    let floor: Vec<f64> =
        (0..nodes).filter(|i| mesh.points[*i][D - 1] == 0.0).map(|i| flow.state().pressure[i]).collect();
    let fastest = flow.state().velocity.iter().map(|u| u.norm()).fold(0.0, f64::max);
    [floor.iter().sum::<f64>() / floor.len() as f64, fastest * VOIDAGE / SPEED]
}

/// Steady pressure drop over that of the law, with steps of `dt`.
fn drop<const D: usize, const B: usize>(mesh: &Mesh<D>, points: &Points<D>, dt: f64) -> f64 {
    steady::<D, B>(mesh, points, (1.2, 2e-5), dt)[0] / (DRAG * SPEED / VOIDAGE / VOIDAGE)
}

fn does_not_depend_on_the_step<const D: usize, const B: usize>(per_side: usize) {
    let mesh = unit_box::<D>(per_side);
    let points = held(&mesh, 12 * mesh.points.len());
    // Drag stops the fluid in 0.07 ms.
    let drops = [1e-4, 1e-3, 1e-2, 1.0, 100.0].map(|dt| drop::<D, B>(&mesh, &points, dt));
    let [least, most] = [drops.into_iter().fold(1.0, f64::min), drops.into_iter().fold(0.0, f64::max)];
    assert!(most - least < 1e-3, "{drops:?}");
    // Where drag is unequal the fluid goes where it is least.
    assert!(0.95 < least && most < 1.0, "{drops:?}");
}

#[test]
fn the_pressure_drop_of_a_bed_does_not_depend_on_the_step() {
    does_not_depend_on_the_step::<2, 3>(24);
    does_not_depend_on_the_step::<3, 4>(8);
}

fn passes_a_block<const D: usize, const B: usize>(per_side: usize, share: std::ops::Range<f64>, most: f64) {
    let mesh = unit_box::<D>(per_side);
    for drag in [1e4, 1e6, 1e8] {
        let points = block(&mesh, drag);
        let law = 0.5 * drag * SPEED / VOIDAGE / VOIDAGE;
        for dt in [1e-3, 1.0, 1e6] {
            let [pressure, fastest] = steady::<D, B>(&mesh, &points, (1e3, 1e-3), dt);
            assert!(share.contains(&(pressure / law)), "{drag:e}, {dt} s: {} of Darcy's law", pressure / law);
            assert!(fastest < most, "{drag:e}, {dt} s: {fastest} times as fast as it comes in");
        }
    }
}

/// Drag that jumps at the faces of a block in water made pressures of 1e13 times Darcy's law.
#[test]
fn a_block_that_resists_much_has_the_pressure_of_darcy() {
    passes_a_block::<2, 3>(24, 0.93..0.96, 2.0);
    // A block of four cells.
    passes_a_block::<3, 4>(8, 0.8..0.95, 6.0);
}

/// Rate at which a vortex in a suspension of free grains dies out, over that of its fluid in a suspension.
fn decay<const D: usize, const B: usize>(per_side: usize, drag: f64, dt: f64) -> f64 {
    let mesh = unit_box::<D>(per_side);
    let nodes = mesh.points.len();
    let mut points = held(&mesh, 12 * nodes);
    points.drag.iter_mut().for_each(|gamma| *gamma *= drag / DRAG);
    let condition =
        |name: &str| Condition { boundary: name.into(), flow: FlowCondition::Slip, scalars: vec![] };
    let conditions = ["floor", "top", "sides"].map(condition);
    let properties = Properties {
        density: 1e3,
        viscosity: 1.0,
        gravity: Vector::zeros(),
        body_force: Vector::zeros(),
        thin_cell_drag: 0.0,
    };
    let pi = std::f64::consts::PI;
    let vortex = |x: &Vector<D>| {
        let mut u = Vector::<D>::zeros();
        u[0] = 1e-3 * (pi * x[0]).sin() * (pi * x[D - 1]).cos();
        u[D - 1] = -1e-3 * (pi * x[0]).cos() * (pi * x[D - 1]).sin();
        u
    };
    let start: Vec<Vector<D>> = mesh.points.iter().map(vortex).collect();
    let state = State { velocity: start.clone(), pressure: vec![0.0; nodes], scalars: vec![] };
    let mut flow =
        Flow::<D, B>::new(mesh.clone(), properties, &[], &conditions, state, &Numerics::default()).unwrap();
    let at = |points: &Points<D>, q: usize, u: &[Vector<D>]| {
        let (phi, cell) = (points.shape::<B>(q), mesh.cell(points.cell[q] as usize));
        cell.iter().zip(phi).map(|(node, phi)| u[*node as usize] * phi).sum::<Vector<D>>()
    };
    let mut v: Vec<Vector<D>> = (0..points.len()).map(|q| at(&points, q, &start)).collect();
    let size = |u: &[Vector<D>]| u.iter().zip(&start).map(|(u, v)| u.dot(v)).sum::<f64>();
    let mut sizes = vec![size(&start)];
    let steps = 12;
    for _ in 0..steps {
        for q in 0..points.len() {
            let inertia = 1e3 * points.volume[q] / dt;
            points.mobility[q] = 1.0 / (inertia + points.drag[q]);
            points.velocity[q] = v[q] * (points.mobility[q] * inertia);
        }
        points.flux_mobility.clone_from(&points.mobility);
        points.flux_velocity.clone_from(&points.velocity);
        flow.solve(dt, &vec![VOIDAGE; nodes], Some(&points), &conditions).unwrap();
        flow.accept();
        let state = flow.state();
        for q in 0..points.len() {
            let slope: Vector<D> = mesh.gradient(points.cell[q] as usize, |node| state.pressure[node]);
            let forcing = at(&points, q, &state.velocity) * points.drag[q] - slope * points.volume[q];
            v[q] = points.velocity[q] + forcing * points.mobility[q];
        }
        sizes.push(size(&state.velocity));
    }
    // Implicit steps: a factor 1 / (1 + rate dt) each.
    let factor = (sizes[steps] / sizes[2]).powf(1.0 / (steps - 2) as f64);
    (1.0 / factor - 1.0) / dt / (2.0 * pi * pi * VOIDAGE * 1e-3)
}

/// The drag of grains was summed on the nodes with no regard to how the fluid shears between them: a dense suspension was
/// hundreds of times as viscous as its liquid, by its drag times h^2/8.
#[test]
fn grains_that_go_with_a_fluid_do_not_make_it_more_viscous() {
    // It would be 6, 46 and 460 times as viscous.
    for (drag, dt, most) in [(1e4, 1.0, 0.05), (1e5, 0.1, 0.2), (1e6, 0.1, 0.3)] {
        let rate = decay::<2, 3>(24, drag, dt);
        assert!((rate - 1.0).abs() < most, "{drag:e}: {rate}");
    }
}
