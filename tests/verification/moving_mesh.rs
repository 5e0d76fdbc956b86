//! Moving meshes and closed domains: what must not depend on how the nodes move or are numbered.

use std::f64::consts::PI;
use std::path::Path;
use voidage_coupling::backend::{FluidBackend, FluidStep, Immersed, Model, RustFluid, Solution};
use voidage_coupling::exchange::{OnMesh, Rigid};
use voidage_coupling::load::GrainLoad;
use voidage_coupling::motion::{MeshMover, Oscillation};
use voidage_coupling::overlap::{self, Overlap};
use voidage_coupling::remesh::{Remesh, Remesher};
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Coupled, HEAT, System, TEMPERATURE};
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::State;
use voidage_fluid::mesh::Remeshed;
use voidage_fluid::mesh::{Hole, Rectangle, Side, Sides};
use voidage_fluid::points::Points;
use voidage_fluid::transport::Scalar;
use voidage_fluid::{Mesh, MeshMotion};
use voidage_scene::{Scene, Simulation};
use voidage_verification::models::{self, FluidSet, Vec2, three_per_cell};

fn grid(size: [f64; 2], squares: [usize; 2]) -> Mesh<2> {
    models::grid(size, squares).expect("a valid rectangle")
}

fn uniform(velocity: Vec2) -> FlowCondition<2> {
    FlowCondition::Velocity(Prescribed::Uniform(velocity))
}

fn moved(from: &[Vec2], to: &[Vec2], dt: f64) -> Vec<Vec2> {
    to.iter().zip(from).map(|(to, from)| (to - from) / dt).collect()
}

/// Velocity (m/s) and temperature (K) of a uniform stream through a channel.
const STREAM: Vec2 = Vec2::new(2.0, 0.0);
const WARM: f64 = 310.0;

/// A channel on a mesh of a box, with the stream in it; colder fluid waits behind the outflow.
fn in_a_stream(mesh: &Mesh<2>) -> (FluidSet, State<2>) {
    let mut set = FluidSet::new(1.3, 0.01)
        .flow("left", uniform(STREAM))
        .flow("right", FlowCondition::Open { pressure: 0.0 })
        .flow("top", FlowCondition::Slip)
        .flow("bottom", FlowCondition::Slip);
    set.scalars = vec![Scalar::new(TEMPERATURE, 1.5, 0.02)];
    set.conditions[1].scalars = vec![ScalarCondition::Outflow { outside: Some(300.0) }];
    let start = State { velocity: vec![STREAM; mesh.points.len()], ..set.rest(mesh, WARM) };
    (set, start)
}

fn assert_in_the_stream(state: &State<2>) {
    assert!(state.velocity.iter().all(|u| (u - STREAM).norm() < 1e-11), "{:?}", state.velocity);
    assert!(state.pressure.iter().all(|p| p.abs() < 1e-10), "{:?}", state.pressure);
    let temperature = state.scalar(HEAT);
    assert!(temperature.iter().all(|t| (t - WARM).abs() < 1e-9), "{temperature:?}");
}

/// Nodes inside go anywhere, those of walls along them, outflow and inflow back and forth.
#[test]
fn a_uniform_stream_stays_uniform_however_the_nodes_move() {
    let dt = 0.05;
    let mesh = grid([1.0, 0.5], [10, 5]);
    let rest = mesh.points.clone();
    let (set, start) = in_a_stream(&mesh);
    let mut flow = set.equations(mesh, start).expect("a valid fluid");
    let clear = vec![1.0; rest.len()];
    let mut points = rest.clone();
    let mut count = 0.0_f64;
    // Between 0 and 1, all over the place.
    let mut random = || {
        count += 1.0;
        (count * 0.618_033_988_749_895).fract()
    };
    for _ in 0..6 {
        let sides = [0.05, -0.05].map(|most: f64| most * random());
        let next: Vec<Vec2> = rest
            .iter()
            .map(|x| {
                let mut jump = Vec2::from_fn(|_, _| 0.03 * (random() - 0.5));
                if x[0] == 0.0 || x[0] == 1.0 {
                    jump[0] = sides[x[0] as usize];
                }
                if x[1] == 0.0 || x[1] == 0.5 {
                    jump[1] = 0.0;
                }
                x + jump
            })
            .collect();
        let velocity = moved(&points, &next, dt);
        points = next;
        flow.follow(Some(&MeshMotion { points: &points, velocity: &velocity })).expect("good cells");
        flow.solve(dt, &clear, None, &set.conditions).expect("a step");
        flow.accept();
        assert_in_the_stream(flow.state());
    }
}

/// L2 errors of velocity and pressure of decaying vortices in a box with slip, the nodes inside oscillating.
fn vortex_errors(squares: usize) -> [f64; 2] {
    const VISCOSITY: f64 = 0.05;
    const END: f64 = 0.25;
    let mesh = grid([1.0, 1.0], [squares, squares]);
    let rest = mesh.points.clone();
    let decay = |t: f64| (-2.0 * VISCOSITY * PI * PI * t).exp();
    let velocity = |x: &Vec2, t: f64| {
        let (sx, cx, sy, cy) = ((PI * x.x).sin(), (PI * x.x).cos(), (PI * x.y).sin(), (PI * x.y).cos());
        Vec2::new(sx * cy, -cx * sy) * decay(t)
    };
    let pressure =
        |x: &Vec2, t: f64| 0.25 * ((2.0 * PI * x.x).cos() + (2.0 * PI * x.y).cos()) * decay(t) * decay(t);
    let places = |t: f64| -> Vec<Vec2> {
        let oscillation = Vec2::new(0.04, -0.03) * (4.0 * PI * t).sin();
        rest.iter().map(|x| x + oscillation * ((PI * x.x).sin() * (PI * x.y).sin())).collect()
    };
    let mut set = FluidSet::new(1.0, VISCOSITY);
    set.conditions.iter_mut().for_each(|condition| condition.flow = FlowCondition::Slip);
    let start = State {
        velocity: rest.iter().map(|x| velocity(x, 0.0)).collect(),
        pressure: rest.iter().map(|x| pressure(x, 0.0)).collect(),
        scalars: vec![],
    };
    let mut flow = set.equations(mesh, start).expect("a valid fluid");
    // Of first order in time, of second in space.
    let steps = squares * squares / 8;
    let dt = END / steps as f64;
    let (clear, mut from) = (vec![1.0; rest.len()], rest.clone());
    for step in 1..=steps {
        let points = places(dt * step as f64);
        let velocity = moved(&from, &points, dt);
        flow.follow(Some(&MeshMotion { points: &points, velocity: &velocity })).expect("good cells");
        flow.solve(dt, &clear, None, &set.conditions).expect("a step");
        flow.accept();
        from = points;
    }
    let (state, volume) = (flow.state(), flow.mesh().nodal_volume());
    let norm = |error: &dyn Fn(usize) -> f64| {
        (0..from.len()).map(|a| volume[a] * error(a) * error(a)).sum::<f64>().sqrt()
    };
    [
        norm(&|a| (state.velocity[a] - velocity(&from[a], END)).norm()),
        norm(&|a| state.pressure[a] - pressure(&from[a], END)),
    ]
}

#[test]
fn decaying_vortices_keep_their_orders_on_a_mesh_that_swings() {
    let (coarse, fine) = (vortex_errors(16), vortex_errors(32));
    println!("{coarse:?} {fine:?}");
    for (k, least) in [1.9, 1.4].into_iter().enumerate() {
        let order = (coarse[k] / fine[k]).log2();
        assert!(order > least, "field {k}: order {order}, errors {coarse:?} {fine:?}");
    }
}

/// A closed box full of grains and fluid, all of which moves with it: nothing happens inside. What leaves through a
/// wall on its way is replaced by grains and fluid together.
#[test]
fn a_box_that_moves_with_all_that_is_in_it_is_at_rest_in_itself() {
    let (drift, dt) = (Vec2::new(0.3, -0.2), 0.1);
    let set = FluidSet::new(1.2, 0.02);
    let mut mesh = grid([1.0, 1.0], [4, 4]);
    let start = State { velocity: vec![drift; mesh.points.len()], ..set.rest(&mesh, 0.0) };
    let mut backend = RustFluid::<2, 3>::new(Model {
        properties: set.properties,
        scalars: vec![],
        numerics: set.numerics.clone(),
        conditions: set.conditions.clone(),
    });
    backend.set_mesh(&mesh, 1, &start).expect("a valid fluid");
    let velocity = vec![drift; mesh.points.len()];
    mesh.points.iter_mut().for_each(|x| *x += drift * dt);
    let position = three_per_cell(&mesh);
    let count = position.len();
    let (radius, volume) = (vec![1e-3; count], vec![mesh.measure(0) / 3.0 * 0.4; count]);
    let mut load = GrainLoad {
        volume,
        drag: vec![0.7; count],
        mobility: vec![0.0; count],
        velocity: vec![drift; count],
        ..GrainLoad::default()
    };
    let mut cutter = Overlap::new(&mesh).expect("a valid mesh");
    cutter.cut(&mesh, &position, &radius, &mut load.pieces, &mut vec![]).expect("grains inside");
    overlap::voidage(&mesh, &load.pieces, &load.volume, &mesh.nodal_volume(), &mut load.voidage);
    assert!(load.voidage.iter().all(|eps| (eps - 0.6).abs() < 1e-12), "{:?}", load.voidage);
    let rigid = Rigid { fluid: OnMesh { mesh: &mesh, fields: &start }, density: 1.2, dt };
    let mut points = Points::default();
    load.fill_points(&rigid, (HEAT, 0), &mut points);
    let step = FluidStep {
        number: 1,
        time: 0.0,
        dt,
        immersed: Some(Immersed { points: &points, voidage: &load.voidage, source: None }),
        conditions: &set.conditions,
        motion: Some(MeshMotion { points: &mesh.points, velocity: &velocity }),
    };
    let mut solution = Solution::default();
    backend.solve(&step, &mut solution).expect("a step");
    let state = &solution.fields;
    assert!(state.velocity.iter().all(|u| (u - drift).norm() < 1e-11), "{:?}", state.velocity);
    assert!(state.pressure.iter().all(|p| p.abs() < 1e-10), "{:?}", state.pressure);
}

/// The same mesh with its nodes counted from another one on.
fn renumbered(mesh: &Mesh<2>, by: usize) -> Mesh<2> {
    let nodes = mesh.points.len();
    let number = |node: &u32| ((*node as usize + by) % nodes) as u32;
    let mut other = mesh.clone();
    other.points = (0..nodes).map(|k| mesh.points[(k + nodes - by) % nodes]).collect();
    other.cells = mesh.cells.iter().map(number).collect();
    for part in &mut other.boundaries {
        part.facets = part.facets.iter().map(number).collect();
    }
    other
}

/// With a voidage that varies, nodal velocities along a curved wall let a little fluid through each of its facets. None
/// of it may collect at the node whose equation sets the level of the pressure.
#[test]
fn in_a_closed_box_no_node_is_special() {
    let [left, right, bottom, top] = ["wall", "wall", "wall", "lid"].map(Side::named);
    let mesh = Mesh::rectangle(&Rectangle {
        lower: [0.0; 2],
        upper: [1.0, 1.0],
        size: Some(0.08),
        sides: Sides { left, right, bottom, top },
        holes: vec![Hole { name: "rim".into(), centre: [0.45, 0.55], radius: 0.2, size: 0.06, growth: 0.3 }],
        refine: vec![],
        structured: None,
    })
    .expect("a valid rectangle");
    let of = |boundary: &str, flow| Condition { boundary: boundary.into(), flow, scalars: vec![] };
    // The lid stands still at its ends, where it would push fluid through the walls.
    let lid = |x: &Vec2| Vec2::new((PI * x.x).sin(), 0.0);
    let solve = |mesh: Mesh<2>| {
        let mut set = FluidSet::new(1.0, 0.05);
        let eps: Vec<f64> = mesh.points.iter().map(|x| 0.6 + 0.3 * (5.0 * x.x).sin() * x.y).collect();
        let pushed = Prescribed::Nodal(mesh.points.iter().map(lid).collect());
        set.conditions = vec![
            of("wall", FlowCondition::Slip),
            of("rim", FlowCondition::Slip),
            of("lid", FlowCondition::Velocity(pushed)),
        ];
        let start = set.rest(&mesh, 0.0);
        let mut flow = set.equations(mesh, start).expect("a fluid");
        for _ in 0..3 {
            flow.solve(0.1, &eps, None, &set.conditions).expect("a step");
            flow.accept();
        }
        (flow.state().clone(), flow.mesh().clone(), eps)
    };
    let (first, mesh, eps) = solve(mesh);
    let rim = mesh.boundary("rim").expect("a rim");
    let leak: f64 = rim
        .facets
        .chunks_exact(2)
        .map(|facet| {
            let [a, b] = [facet[0] as usize, facet[1] as usize];
            let (ends, along) = ([a, b], mesh.points[b] - mesh.points[a]);
            let normal = Vec2::new(along[1], -along[0]);
            let flux = |k: usize, l: usize| {
                eps[ends[k]] * first.velocity[ends[l]].dot(&normal) / if k == l { 3.0 } else { 6.0 }
            };
            flux(0, 0) + flux(0, 1) + flux(1, 0) + flux(1, 1)
        })
        .sum();
    assert!(leak.abs() > 1e-6, "{leak}: the test would see nothing");
    let volume = mesh.nodal_volume();
    let mean: f64 = first.pressure.iter().zip(&volume).map(|(p, v)| p * v).sum();
    let largest = first.pressure.iter().fold(0.0, |most: f64, p| most.max(p.abs()));
    assert!(mean.abs() < 1e-12 * largest, "{mean}");
    let nodes = mesh.points.len();
    for by in [1, nodes / 3, rim.facets[0] as usize] {
        let (other, ..) = solve(renumbered(&mesh, by));
        for node in 0..nodes {
            let there = (node + by) % nodes;
            assert!((other.velocity[there] - first.velocity[node]).norm() < 1e-9);
            assert!((other.pressure[there] - first.pressure[node]).abs() < 1e-9 * largest);
        }
    }
}

/// The bed over an oscillating rod, with some keys set.
fn swinging_bed(sets: &[&str]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/scenes/moving-mesh.toml");
    let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
    Scene::read(&path, &sets).unwrap_or_else(|error| panic!("{error}"))
}

/// Grains over an oscillating rod, end to end: the mesh is where the law puts it, all of the grains is on it, forces
/// balance.
#[test]
fn a_scene_swings_its_mesh() {
    let scene = swinging_bed(&[]);
    let mut bed = Simulation::new(&scene).expect("a valid scene");
    let rest = bed.coupled().fluid().expect("a fluid").mesh.points.clone();
    for _ in 0..7 {
        bed.step().expect("a step");
    }
    let mesh = &bed.coupled().fluid().expect("a fluid").mesh;
    let motion = scene.fluid.as_ref().and_then(|fluid| fluid.mesh_motion.as_ref()).expect("a motion");
    let frequency = motion.frequency.expect("an oscillation");
    let sine = (2.0 * PI * frequency * bed.time()).sin();
    let rod = mesh.boundary("rod").expect("a rod").clone();
    for &node in &rod.facets {
        let oscillation = mesh.points[node as usize] - rest[node as usize];
        assert!((oscillation - motion.amplitude.vector::<2>() * sine).norm() < 1e-15);
    }
    bed.refresh().expect("fields");
    let fluid = bed.view().fluid.expect("a fluid");
    let expected = motion.amplitude.vector::<2>()
        * ((sine - (2.0 * PI * frequency * (bed.time() - scene.time.step)).sin()) / scene.time.step);
    let on_rod = fluid.fields.velocity[rod.facets[0] as usize];
    assert!((on_rod - expected).norm() < 1e-9 * expected.norm(), "{on_rod} {expected}");
    let totals = bed.totals();
    assert!(totals.momentum_exchange_defect.expect("both") < 1e-12);
    assert!(totals.solid_volume_defect.expect("both") < 1e-12);
}

/// A rod that oscillates further than one mesh can follow: remeshing can, and nothing is lost of the grains or the
/// forces.
#[test]
fn remeshing_follows_what_one_mesh_cannot() {
    let wide = "fluid.mesh_motion.amplitude=[1.5e-2, 0.0]";
    let error = Simulation::new(&swinging_bed(&[wide])).err().expect("cells turn over").to_string();
    assert!(error.contains("turns over on the way") && error.contains("remesh"), "{error}");
    let scene = swinging_bed(&[wide, "fluid.mesh_motion.remesh.angle=20.0"]);
    let mut bed = Simulation::new(&scene).expect("a valid scene");
    let rod = |bed: &Simulation| {
        let mesh = &bed.coupled().fluid().expect("a fluid").mesh;
        let nodes = &mesh.boundary("rod").expect("a rod").facets;
        nodes.iter().map(|node| mesh.points[*node as usize]).sum::<Vec2>() / nodes.len() as f64
    };
    let rest = rod(&bed);
    for _ in 0..25 {
        bed.step().expect("a step");
        let sine = (2.0 * PI * 20.0 * bed.time()).sin();
        assert!((rod(&bed) - rest - Vec2::new(1.5e-2 * sine, 0.0)).norm() < 1e-14);
    }
    let mesh = &bed.coupled().fluid().expect("a fluid").mesh;
    assert!(mesh.quality().smallest_angle > 20.0, "{:?}", mesh.quality());
    let totals = bed.totals();
    assert!(totals.remeshings > 2, "{}", totals.remeshings);
    assert!(totals.momentum_exchange_defect.expect("both") < 1e-12);
    assert!(totals.energy_exchange_defect.expect("both") < 1e-12);
    assert!(totals.solid_volume_defect.expect("both") < 1e-12);
}

/// A rod that oscillates so fast that only a mesh made anew within the step can follow.
#[test]
fn the_domain_is_remeshed_before_a_step_turns_a_cell_over() {
    // Nothing else remeshes.
    let never =
        ["fluid.mesh_motion.amplitude=[1.5e-2, 0.0]", "fluid.mesh_motion.remesh={every=1000000,angle=0.0}"];
    let mut bed = Simulation::new(&swinging_bed(&never)).expect("a valid scene");
    let mut made = 0;
    for _ in 0..25 {
        made += u32::from(bed.step().expect("a step").remeshed);
        let mesh = &bed.coupled().fluid().expect("a fluid").mesh;
        assert!(mesh.measures().iter().all(|area| *area > 0.0), "a cell has turned over");
        let whole = 0.06 * 0.08 - 0.5 * 16.0 * (2.0 * PI / 16.0).sin() * 0.008_f64.powi(2);
        assert!((mesh.volume() / whole - 1.0).abs() < 0.01, "{}", mesh.volume());
    }
    assert!((1..20).contains(&made), "{made} new meshes");
    // In a step of a quarter of its period no mesh can.
    let far = [&never[..], &["time.step=1.25e-2"]].concat();
    let mut bed = Simulation::new(&swinging_bed(&far)).expect("a valid scene");
    let middle = |bed: &Simulation| {
        let mesh = &bed.coupled().fluid().expect("a fluid").mesh;
        let nodes = &mesh.boundary("rod").expect("a rod").facets;
        nodes.iter().map(|node| mesh.points[*node as usize]).sum::<Vec2>() / nodes.len() as f64
    };
    let rest = middle(&bed);
    let error = bed.step().expect_err("too far").to_string();
    for says in ["step 1, from t = 0", "in 1.250e-2 s", "cell at (", "turn over", "smaller time.step"] {
        assert!(error.contains(says), "`{says}` is not in: {error}");
    }
    // The rod is where it was.
    assert!((middle(&bed) - rest).norm() < 1e-15 && bed.time() == 0.0);
}

/// Interpolation keeps what is linear, so a uniform stream does not notice new meshes.
#[test]
fn a_uniform_stream_stays_uniform_when_the_domain_is_remeshed() {
    let mesh = grid([1.0, 0.5], [10, 5]);
    let (set, start) = in_a_stream(&mesh);
    let mut fluid = set.build(mesh, start).expect("a valid fluid");
    let oscillation = Oscillation::new(&fluid.mesh, Vec2::new(0.1, 0.05), 1.0, None).expect("an oscillation");
    fluid.remesher = Some(Remesher::new(&fluid.mesh, Remesh { every: 2, angle: 0.0 }));
    fluid.motion = Some(Box::new(oscillation));
    let first = fluid.mesh.clone();
    let scheme = SchemeName::Henry.build(&Options::default()).unwrap();
    let mut flow = Coupled::new(System::Fluid(Box::new(fluid)), scheme);
    for step in 1..=6 {
        let report = flow.step(0.05).expect("a step");
        assert_eq!(report.remeshed, step % 2 == 0);
    }
    let fluid = flow.fluid_mut().expect("a fluid");
    assert_ne!(first.cells, fluid.mesh.cells);
    assert_in_the_stream(&fluid.accepted);
}

/// A mover of one's own: nodes inside turn about the middle of the box, those of the boundary stand.
struct Whirl {
    rest: Vec<Vec2>,
    velocity: Vec<Vec2>,
}

impl MeshMover<2> for Whirl {
    fn place(&self, time: f64, points: &mut [Vec2]) {
        for (point, rest) in points.iter_mut().zip(&self.rest) {
            let bubble = 16.0 * rest.x * (1.0 - rest.x) * rest.y * (0.5 - rest.y) / 0.25;
            let (arm, (sin, cos)) = (rest - Vec2::new(0.5, 0.25), (0.3 * time * bubble).sin_cos());
            *point = rest + Vec2::new((cos - 1.0) * arm.x - sin * arm.y, (cos - 1.0) * arm.y + sin * arm.x);
        }
    }

    fn advance(&mut self, time: f64, dt: f64, points: &mut [Vec2]) {
        let before = points.to_vec();
        self.place(time + dt, points);
        self.velocity = points.iter().zip(&before).map(|(now, then)| (now - then) / dt).collect();
    }

    fn velocity(&self) -> &[Vec2] {
        &self.velocity
    }

    fn remeshed(&mut self, _: &Remeshed<2>, _: f64) {}

    fn state(&self) -> Vec<f64> {
        vec![]
    }

    fn restore(&mut self, _: &[f64]) {}
}

#[test]
fn a_uniform_stream_stays_uniform_on_a_mesh_moved_by_any_mover() {
    let mesh = grid([1.0, 0.5], [10, 5]);
    let (set, start) = in_a_stream(&mesh);
    let mut fluid = set.build(mesh, start).expect("a valid fluid");
    let rest = fluid.mesh.points.clone();
    fluid.motion = Some(Box::new(Whirl { rest: rest.clone(), velocity: vec![] }));
    let scheme = SchemeName::Henry.build(&Options::default()).unwrap();
    let mut flow = Coupled::new(System::Fluid(Box::new(fluid)), scheme);
    for _ in 0..4 {
        flow.step(0.1).expect("a step");
    }
    let fluid = flow.fluid_mut().expect("a fluid");
    let moved = fluid.mesh.points.iter().zip(&rest).map(|(now, then)| (now - then).norm());
    assert!(moved.fold(0.0, f64::max) > 1e-2);
    assert_in_the_stream(&fluid.accepted);
}

/// A run goes on from a state as if it had never stopped, with the mesh where it was, also one that was made on the
/// way.
#[test]
fn a_moving_mesh_is_where_it_was_after_a_restart() {
    is_where_it_was_after_a_restart(&swinging_bed(&[]));
    is_where_it_was_after_a_restart(&swinging_bed(&["fluid.mesh_motion.remesh.every=2"]));
    is_where_it_was_after(&swinging_bed(&["fluid.mesh_motion.remesh.every=1"]), 1);
}

/// A checkpoint of the step that has remeshed, and one of the step after it.
fn is_where_it_was_after_a_restart(scene: &Scene) {
    (2..4).for_each(|steps| is_where_it_was_after(scene, steps));
}

fn is_where_it_was_after(scene: &Scene, steps: usize) {
    use voidage_scene::recorder::{Averages, Checkpoint, Stamp};
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let mut straight = Simulation::new(scene).expect("a valid scene");
    for _ in 0..steps {
        straight.step().expect("a step");
    }
    let hash = scene.hash().expect("a hash");
    let stamp = Stamp { scene_hash: hash.clone(), step: straight.steps(), time: straight.time() };
    let state = straight.state().expect("a state");
    Checkpoint::write(&path, &stamp, &state, &None::<Averages>).expect("a file");
    let checkpoint = Checkpoint::read(&path, &hash).expect("a checkpoint");
    let mut again = Simulation::new(scene).expect("a valid scene").restart(&checkpoint).expect("a restart");
    for run in [&mut straight, &mut again] {
        for _ in 0..3 {
            run.step().expect("a step");
        }
        run.refresh().expect("fields");
    }
    let (a, b) = (straight.view().fluid.expect("a fluid"), again.view().fluid.expect("a fluid"));
    assert_eq!(a.mesh, b.mesh);
    assert_eq!(a.fields, b.fields);
}

fn case(name: &str, sets: &[&str]) -> Scene {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(name).join("scene.toml");
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scene::read(&file, &sets).expect("a shipped scene")
}

/// What the piston sweeps goes through the bed and out, and the sieve carries the weight and the drag.
#[test]
fn a_piston_presses_out_what_it_sweeps() {
    let mut run = Simulation::new(&case("piston", &[])).expect("a valid scene");
    let reading = |run: &Simulation, name: &str| {
        run.readings().iter().find(|(column, _)| column == name).expect("a column").1
    };
    let mut floors = Vec::new();
    // At rest, while it presses, at rest, while it pulls.
    for (end, velocity) in [(0.5, 0.0), (1.4, 5e-3), (1.9, 0.0), (2.9, -5e-3)] {
        while run.time() < end - 1e-9 {
            run.step().expect("a step");
        }
        let out = reading(&run, "flux_outlet_m2_per_s");
        assert!((out - 0.02 * velocity).abs() < 1e-9 * 1e-4, "{out} m2/s at {end} s");
        assert_eq!(reading(&run, "flux_sides_m2_per_s"), 0.0);
        floors.push(-reading(&run, "wall_force_sieve_y_N_per_m"));
    }
    let mesh = &run.coupled().fluid().expect("a fluid").mesh;
    let piston = mesh.boundary("piston").expect("a piston");
    let height = 0.04 - 5e-3 * 0.1;
    assert!(piston.facets.iter().all(|node| (mesh.points[*node as usize].y - height).abs() < 1e-12));
    let [rest, pressed, still, pulled] = floors[..] else { panic!("four") };
    assert!((still / rest - 1.0).abs() < 1e-3, "{floors:?}");
    assert!(((pressed - rest) / (rest - pulled) - 1.0).abs() < 0.03 && pressed > 1.3 * rest, "{floors:?}");
    // Grains lie in the sides by what contacts leave.
    let outside = run.totals().solid_volume_defect.expect("both");
    assert!(outside < 1e-5, "{outside}");
}

/// A part of a step that was not accepted left the mesh at its end. The next part began there, and the water went against
/// the piston.
#[test]
fn a_piston_presses_as_much_in_steps_that_are_done_in_parts() {
    let rows = "table.rows=[[0.0,0.0,0.0,0.0],[1.0,0.0,-5e-3,0.0]]";
    let motions = ["walls[3].motion", "fluid.mesh_motion"].map(|key| format!("{key}.{rows}"));
    // No part agrees, so that all are halved.
    let never = ["coupling.cut={}", "coupling.iteration.tolerance=1e-9", "coupling.iteration.most=2"];
    let sets: Vec<&str> = motions.iter().map(String::as_str).chain(never).collect();
    let mut run = Simulation::new(&case("piston", &sets)).expect("a valid scene");
    for _ in 0..2 {
        run.step().expect("a step");
        let readings = run.readings();
        let reading = |name: &str| readings.iter().find(|(column, _)| column == name).expect("a column").1;
        assert!(reading("step_parts") > 1.0);
        let out = reading("flux_outlet_m2_per_s");
        assert!((out - 0.02 * 5e-3).abs() < 1e-6 * 1e-4, "{out} m2/s");
    }
}

/// A rod that goes through beads in a closed box meets them, and the fluid sees all of them but for what the rod passes
/// over in a step: at 0.03 m/s an eighth of a radius of the few beads that it touches.
#[test]
fn a_rod_in_a_fluid_stirs_beads() {
    let mut run = Simulation::new(&case("stirrer", &[])).expect("a valid scene");
    let mut most = 0.0f64;
    for _ in 0..450 {
        run.step().expect("a step");
        let grains = run.coupled().grains().expect("grains");
        let of_rod =
            |(wall, force): (&voidage_dem::Wall<2>, &Vec2)| wall.name.starts_with("rod").then_some(*force);
        let rod: Vec2 = grains.walls().iter().zip(grains.wall_force()).filter_map(of_rod).sum();
        let column =
            run.readings().iter().find(|(name, _)| name == "wall_force_rod_x_N_per_m").expect("a rod").1;
        assert!((rod.x - column).abs() <= 1e-12 * rod.norm(), "{rod:?} and {column}");
        most = most.max(rod.norm());
    }
    let weight = 9.81 * run.coupled().grains().expect("grains").particles.mass.iter().sum::<f64>();
    assert!(most > 0.05 * weight, "the rod meets beads: {most} N/m, and they weigh {weight}");
    let totals = run.totals();
    assert!(totals.solid_volume_defect.expect("both") < 1e-3, "{:?}", totals.solid_volume_defect);
    assert!(totals.momentum_exchange_defect.expect("both") < 1e-12);
    is_where_it_was_after_a_restart(&case(
        "stirrer",
        &["fluid.mesh_motion.remesh.every=2", "time.step=0.05"],
    ));
}

/// The torque on a rod that turns is about its centre, wherever the motion has brought it: in creeping flow, far from
/// walls, it is 4 pi eta w a^2 whether the rod moves on or not.
#[test]
fn the_torque_on_a_rod_is_about_its_centre() {
    let text = r#"
        gravity = [0.0, 0.0]
        time = { step = 0.05, end = 1.0 }
        [fluid]
        density = 1e-3
        viscosity = 1.0
        boundaries = [
            { name = "box", flow = "no-slip" },
            { name = "top", flow = { open = { pressure = 0.0 } } },
            { name = "rod", flow = "no-slip" },
        ]
        [fluid.mesh.rectangle]
        lower = [0.0, 0.0]
        upper = [40.0, 40.0]
        size = 4.0
        sides = { left = "box", right = "box", bottom = "box", top = "top" }
        holes = [{ name = "rod", centre = [19.0, 20.0], radius = 1.0, size = 0.15, growth = 0.2 }]
        [fluid.mesh_motion]
        boundary = "rod"
        remesh = {}
        table = { centre = [19.0, 20.0], rows = [[0.0, 0.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.5]] }
    "#;
    let torque = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        let scene =
            Scene::parse(Path::new("rod.toml"), text, &sets).unwrap_or_else(|error| panic!("{error}"));
        let mut run = Simulation::new(&scene).expect("a valid scene");
        for _ in 0..20 {
            run.step().expect("a step");
        }
        let readings = run.readings();
        let reading = |name: &str| readings.iter().find(|(column, _)| column == name).expect("a column").1;
        (reading("torque_rod_N"), reading("force_rod_x_N_per_m"))
    };
    let expected = -4.0 * PI * 0.5;
    let (on_its_way, drag) = torque(&[]);
    // The middle of the box is half way, so that walls turn it as little as they can.
    assert!(drag < expected, "without the shift by the centre the drag of {drag} N/m would be seen");
    assert!((on_its_way / expected - 1.0).abs() < 0.05, "{on_its_way} N, {expected} expected");
    let still = "fluid.mesh_motion.table.rows=[[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.5]]";
    let (in_place, _) = torque(&[still]);
    assert!((in_place / expected - 1.0).abs() < 0.05, "{in_place} N, {expected} expected");
}
