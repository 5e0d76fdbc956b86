//! Points in the fluid: what holds for any step, any place of the points in their cells, and any strength of drag.

use approx::assert_relative_eq;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use voidage_coupling::Laws;
use voidage_coupling::closure::VoidageFunction;
use voidage_coupling::scheme::SchemeName;
use voidage_dem::{Material, Settings};
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::State;
use voidage_fluid::points::{PointScalar, Points};
use voidage_fluid::transport::{Form, Scalar};
use voidage_fluid::{Flow, Mesh};
use voidage_scene::{Scene, Simulation};
use voidage_verification::models::{FluidSet, Vec2, grains, unstructured};

const OPEN: FlowCondition<2> = FlowCondition::Open { pressure: 0.0 };

/// Points that are held, up to three in a cell that `inside` has, at random places, each with a random share of a mean
/// drag and of a mean solid per volume.
fn scattered(mesh: &Mesh<2>, inside: impl Fn(Vec2) -> bool, drag: f64, solid: f64) -> Points<2> {
    let mut random = Pcg64::seed_from_u64(3);
    let mut points = Points::default();
    for cell in 0..mesh.cell_count() {
        for _ in 0..random.random_range(0..4) {
            let mut l = [0.0; 3].map(|_: f64| random.random::<f64>());
            let (sum, size) = (l.iter().sum::<f64>(), mesh.measure(cell) * random.random::<f64>());
            l.iter_mut().for_each(|l| *l /= sum);
            if inside(mesh.centroid(cell)) {
                points.cell.push(cell as u32);
                points.coordinate.push(Vec2::new(l[1], l[2]));
                points.volume.push(solid * size);
                points.drag.push(drag * size);
            }
        }
    }
    let count = points.len();
    points.mobility = vec![0.0; count];
    points.velocity = vec![Vec2::zeros(); count];
    points.flux_mobility = vec![0.0; count];
    points.flux_velocity = vec![Vec2::zeros(); count];
    points
}

/// A stream from the bottom to the open top between slipping sides.
fn stream(density: f64, viscosity: f64, inflow: f64) -> FluidSet {
    FluidSet::new(density, viscosity)
        .flow("left", FlowCondition::Slip)
        .flow("right", FlowCondition::Slip)
        .flow("top", OPEN)
        .flow("bottom", FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::new(0.0, inflow))))
}

fn steps(
    flow: &mut Flow<2, 3>,
    (dt, count): (f64, usize),
    voidage: &[f64],
    points: &Points<2>,
    conditions: &[Condition<2>],
) {
    for _ in 0..count {
        flow.solve(dt, voidage, Some(points), conditions).expect("a step");
        flow.accept();
    }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).fold(0.0, f64::max)
}

/// Pressures and velocities of a bed of scattered points after many steps.
fn steady(dt: f64) -> State<2> {
    let set = stream(1.0, 1e-3, 1.0);
    let mesh = unstructured([0.5, 1.0], 0.08).expect("a mesh");
    let points = scattered(&mesh, |x| (0.3..0.7).contains(&x.y), 1e3, 0.0);
    let voidage = vec![1.0; mesh.points.len()];
    let start = set.rest(&mesh, 0.0);
    let mut flow = set.equations(mesh, start).expect("equations");
    let count = if dt < 0.1 { 600 } else { 60 };
    steps(&mut flow, (dt, count), &voidage, &points, &set.conditions);
    flow.state().clone()
}

/// The residual of momentum in a cell does not vanish where drag differs from cell to cell, and drove a flow in the
/// equation of mass that grew with the step.
#[test]
fn the_steady_pressure_of_an_uneven_bed_does_not_depend_on_the_step() {
    let known = steady(1.0);
    let scale = largest(known.pressure.iter().copied());
    for dt in [1e-2, 1e3, 1e6] {
        let other = steady(dt);
        let apart = largest(known.pressure.iter().zip(&other.pressure).map(|(a, b)| a - b)) / scale;
        assert!(apart < 1e-2, "dt {dt}: {apart}");
    }
}

/// grad p = rho g is a solution whatever the points fill, also where they overlap and fill more than a cell.
#[test]
fn a_liquid_at_rest_among_held_points_stays_at_rest() {
    for (solid, dt) in [0.3, 5.0].into_iter().flat_map(|solid| [1e-4, 1.0, 1e6].map(|dt| (solid, dt))) {
        let mut set = FluidSet::new(1000.0, 1e-3).flow("top", OPEN);
        set.properties.gravity = Vec2::new(0.0, -9.81);
        let mesh = unstructured([0.1, 0.2], 0.02).expect("a mesh");
        let points = scattered(&mesh, |_| true, 1e4, solid);
        let mut voidage = vec![1.0; mesh.points.len()];
        for (q, cell) in points.cell.iter().enumerate() {
            let nodes = &mesh.cells[3 * *cell as usize..][..3];
            for (phi, node) in points.shape::<3>(q).iter().zip(nodes) {
                voidage[*node as usize] -= points.volume[q] * phi / mesh.nodal_volume()[*node as usize];
            }
        }
        voidage.iter_mut().for_each(|eps| *eps = eps.max(1e-8));
        let mut start = set.rest(&mesh, 0.0);
        let depth = mesh.points.iter().map(|x| 1000.0 * 9.81 * (0.2 - x.y));
        start.pressure = depth.collect();
        let mut flow = set.equations(mesh, start).expect("equations");
        steps(&mut flow, (dt, 3), &voidage, &points, &set.conditions);
        let fastest = largest(flow.state().velocity.iter().map(|u| u.norm()));
        assert!(fastest < 1e-12, "solid {solid}, dt {dt}: {fastest} m/s");
    }
}

/// The forces of points on momentum are the same whether drag acts at the points or is summed at the nodes, so that a
/// uniform stream loses sum gamma u.
#[test]
fn a_uniform_stream_loses_the_drag_of_all_points() {
    let mut set = FluidSet::new(2.0, 0.0);
    let speed = Vec2::new(0.3, -0.7);
    for side in ["left", "right", "bottom", "top"] {
        set = set.flow(side, FlowCondition::Velocity(Prescribed::Uniform(speed)));
    }
    let mesh = unstructured([1.0, 1.0], 0.2).expect("a mesh");
    let points = scattered(&mesh, |_| true, 5.0, 0.0);
    let voidage = vec![1.0; mesh.points.len()];
    let start = State { velocity: vec![speed; mesh.points.len()], ..set.rest(&mesh, 0.0) };
    let nodal = mesh.nodal_volume();
    let mut flow = set.equations(mesh, start).expect("equations");
    // In so short a step the velocity hardly changes, and what it changes by is what the drag takes.
    let dt = 1e-7;
    flow.solve(dt, &voidage, Some(&points), &set.conditions).expect("a step");
    let mut balances = Vec::new();
    flow.balances(&voidage, &set.conditions, &mut balances);
    let held: Vec2 = balances.iter().map(|part| part.force).sum();
    let change = flow.solution().velocity.iter().zip(&nodal).map(|(u, v)| (u - speed) * *v).sum::<Vec2>();
    let lost = speed * points.drag.iter().sum::<f64>();
    // The forces of the balances are those on the boundary.
    assert_relative_eq!(change * (2.0 / dt), -held - lost, epsilon = 1e-4 * lost.norm());
}

/// Temperatures (lowest, highest) in a stream of 300 K through a layer of grains of 400 K that have transfer units for an
/// element, strewn or one in the middle of each cell.
fn behind_hot_grains(form: Form, units: f64, strewn: bool, dt: f64) -> [f64; 2] {
    let (edge, capacity) = (0.05, 1000.0);
    let mut set = stream(1.0, 1e-2, 1.0);
    set.scalars = vec![Scalar { form, ..Scalar::new("temperature", capacity, 1e-3) }];
    for condition in &mut set.conditions {
        let inflow = condition.boundary == "bottom";
        condition.scalars.extend(inflow.then_some(ScalarCondition::Value(Prescribed::Uniform(300.0))));
    }
    let mesh = unstructured([0.5, 1.0], edge).expect("a mesh");
    let inside = |x: Vec2| (0.3..0.6).contains(&x.y);
    let mut points = scattered(&mesh, inside, 1.0, 0.0);
    if !strewn {
        let cells = (0..mesh.cell_count()).filter(|&cell| inside(mesh.centroid(cell)));
        points = Points::default();
        for cell in cells {
            points.cell.push(cell as u32);
            points.coordinate.push(Vec2::new(1.0, 1.0) / 3.0);
            points.drag.push(mesh.measure(cell));
        }
        let none = vec![Vec2::zeros(); points.len()];
        points.volume = vec![0.0; points.len()];
        (points.mobility, points.velocity) = (points.volume.clone(), none.clone());
        (points.flux_mobility, points.flux_velocity) = (points.volume.clone(), none);
    }
    let coefficient: Vec<f64> = points.drag.iter().map(|share| share * units * capacity / edge).collect();
    let (mobility, value) = (vec![0.0; points.len()], vec![400.0; points.len()]);
    points.scalars = vec![Some(PointScalar { coefficient, mobility, value })];
    points.drag.fill(0.0);
    let voidage = vec![1.0; mesh.points.len()];
    let velocity = vec![Vec2::new(0.0, 1.0); mesh.points.len()];
    let start = State { velocity, ..set.rest(&mesh, 300.0) };
    let mut flow = set.equations(mesh, start).expect("equations");
    steps(&mut flow, (dt, 60), &voidage, &points, &set.conditions);
    let temperature = &flow.state().scalars[0];
    let (low, high) = (f64::min, f64::max);
    [temperature.iter().copied().fold(f64::INFINITY, low), temperature.iter().copied().fold(0.0, high)]
}

/// Monotone temperatures never leave the range. Lumped ones leave it by little where they have become steady; the exchange
/// of neighbours in the residual of a cell took the upwind from the cells before the first hot grains, and the gas was at
/// 212 K there.
#[test]
fn temperatures_stay_between_inflow_and_hot_grains() {
    for (units, strewn) in
        [0.1, 1.0, 10.0, 100.0].into_iter().flat_map(|units| [(units, false), (units, true)])
    {
        for dt in [1e-2, 1.0, 1e6] {
            let [low, high] = behind_hot_grains(Form::Monotone, units, strewn, dt);
            assert!(low > 300.0 - 1e-9 && high < 400.0 + 1e-9, "{units}, {dt} s: {low} to {high} K");
        }
        let left = if strewn { 15.0 } else { 2.0 };
        for dt in [1.0, 1e6] {
            let [low, high] = behind_hot_grains(Form::Lumped, units, strewn, dt);
            assert!(low > 300.0 - left && high < 400.5, "{units}, {dt} s: {low} to {high} K");
        }
    }
}

/// Grains of 0.2 mm that fall in a closed box of water.
const SUSPENSION: &str = r#"
gravity = [0.0, -9.81]
time = { step = 5e-4, end = 0.1 }
materials.glass = { density = 2650.0 }
walls = [{ name = "box", along = "box" }]
[[grains]]
material = "glass"
radius = 1e-4
solidity = 0.8165
amount = { count = 336 }
placement = { random = { lower = [0.0, 0.0], upper = [7e-3, 1.2e-2], seed = 3 } }
[fluid]
density = 998.0
viscosity = 1e-3
boundaries = [{ name = "box", flow = "slip" }]
[fluid.mesh.rectangle]
lower = [0.0, 0.0]
upper = [7e-3, 1.2e-2]
size = 1e-3
sides = { left = "box", right = "box", bottom = "box", top = "box" }
[coupling]
drag = "wen-yu"
"#;

/// Every grain that passed through a cell drove a flow by the stabilisation: with steps of four relaxation times the
/// suspension fell 8 and 10 % faster than with short ones.
#[test]
fn a_suspension_falls_as_fast_with_steps_beyond_the_relaxation_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("suspension.toml");
    std::fs::write(&path, SUSPENSION).expect("a file");
    let fall = |edge: f64, step: f64| {
        let sets = [format!("time.step={step}"), format!("fluid.mesh.rectangle.size={edge}")];
        let scene = Scene::read(&path, &sets).expect("a scene");
        let mut simulation = Simulation::new(&scene).expect("a simulation");
        let mut height = |until: f64| {
            while simulation.time() < until - 0.5 * step {
                simulation.step().expect("a step");
            }
            let grains = simulation.coupled().grains().expect("grains");
            let places = &grains.particles.position;
            places.iter().map(|x| x.y).sum::<f64>() / places.len() as f64
        };
        let high = height(0.05);
        high - height(0.1)
    };
    // Elements of five diameters and of two and a half; steps that are short, and of one and four relaxation times.
    for (edge, most) in [(1e-3, 1.04), (5e-4, 1.08)] {
        let short = fall(edge, 5e-4);
        for step in [5e-3, 2.5e-2] {
            let share = fall(edge, step) / short;
            assert!((0.98..most).contains(&share), "{edge} m, {step} s: {share}");
        }
    }
}

/// A disc of twenty elements, solid inside: the fluid reached 9.8e27 m/s, and the disc was thrown out of the box.
#[test]
fn a_solid_disc_of_many_elements_falls_through_water() {
    let [width, height] = [0.04, 0.08];
    let mut set = FluidSet::new(1000.0, 1e-3).flow("top", OPEN);
    set.properties.gravity = Vec2::new(0.0, -9.81);
    let mesh = unstructured([width, height], 1.5e-3).expect("a mesh");
    let start = set.rest(&mesh, 0.0);
    let material = Material { density: 2500.0, ..Material::default() };
    let disc = grains(vec![Vec2::new(0.02, 0.05)], 0.015, material, Settings::default()).expect("a disc");
    let fluid = set.build(mesh, start).expect("a fluid");
    let laws = Laws { voidage_function: VoidageFunction::Henry, ..set.laws(None) };
    let mut system = set.with_grains(fluid, disc, laws, SchemeName::Iterated).expect("a disc in a fluid");
    let mut fastest: f64 = 0.0;
    for _ in 0..50 {
        system.step(2e-3).expect("a step");
        let fields = &system.fluid().expect("a fluid").accepted;
        fastest = fastest.max(largest(fields.velocity.iter().map(|u| u.norm())));
    }
    let fall = -system.grains().expect("the disc").particles.velocity[0].y;
    assert!((0.18..0.22).contains(&fall) && fastest < 1.0, "{fall} m/s, the fluid {fastest} m/s");
}
