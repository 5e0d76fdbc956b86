//! Frames survive the way, and what is no frame is an error and no panic.

use super::*;
use proptest::prelude::*;
use voidage_coupling::backend::{FluidStep, Immersed, Model, Solution};
use voidage_coupling::error::PeerError;
use voidage_fluid::balance::Balance;
use voidage_fluid::body::BodyAnswer;
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::{Report, State};
use voidage_fluid::mesh::{Mesh, Rectangle, Side, Sides};
use voidage_fluid::points::{PointScalar, Points};
use voidage_fluid::transport::Scalar;
use voidage_fluid::{MeshMotion, Result, Vector};

fn mesh() -> Result<Mesh<2>> {
    let [left, right, bottom, top] = ["left", "right", "bottom", "top"].map(Side::named);
    Mesh::rectangle(&Rectangle {
        lower: [0.0; 2],
        upper: [1.0, 2.0],
        size: Some(0.3),
        sides: Sides { left, right, bottom, top },
        holes: vec![],
        refine: vec![],
        structured: None,
    })
}

fn fields(nodes: usize) -> State<2> {
    let number = |i: usize| (i as f64 * 0.7).sin() / 3.0;
    State {
        velocity: (0..nodes).map(|i| Vector::<2>::new(number(i), number(i + 7))).collect(),
        pressure: (0..nodes).map(|i| 1e5 * number(i + 3)).collect(),
        scalars: [300.0, 0.0].map(|base| (0..nodes).map(|i| base + number(i)).collect()).to_vec(),
    }
}

fn points(count: usize) -> Points<2> {
    let column = |shift: f64| (0..count).map(|i| shift + i as f64 / 3.0).collect::<Vec<_>>();
    let vectors = |shift| column(shift).into_iter().map(|x| Vector::<2>::new(x, -x)).collect::<Vec<_>>();
    Points {
        cell: (0..count as u32).map(|i| i % 3).collect(),
        coordinate: vec![Vector::<2>::new(0.25, 0.5); count],
        volume: column(1.0),
        drag: column(2.0),
        mobility: column(3.0),
        velocity: vectors(4.0),
        flux_mobility: column(5.0),
        flux_velocity: vectors(6.0),
        scalars: vec![
            None,
            Some(PointScalar { coefficient: column(7.0), mobility: column(8.0), value: column(9.0) }),
        ],
    }
}

#[test]
fn a_mesh_comes_back_as_it_was() {
    let plain = mesh().expect("a valid rectangle");
    let mut joined = plain.clone();
    joined.join_sides([true, false]).expect("sides that fit");
    assert!(joined.periodic.images().len() > 4);
    for mesh in [plain, joined] {
        let fields = fields(mesh.points.len());
        let message = MeshMessage::new(&mesh, &fields);
        let header = message.header();
        let mut payload = vec![f64::NAN; header.length as usize];
        message.write(&mut payload);
        let read = read_mesh(&header, &payload).expect("a mesh");
        assert_eq!(read, (mesh.clone(), fields));
    }
}

#[test]
fn a_step_comes_back_as_it_was() {
    let (points, voidage, source) = (points(5), vec![0.5; 4], [0.1, 0.2, 0.3, 0.4]);
    let immersed = Some(Immersed { points: &points, voidage: &voidage, source: Some(&source) });
    let step = FluidStep { number: 3, time: 0.2, dt: 0.1, immersed, conditions: &[], motion: None };
    let message = StepMessage::new(&step, String::new());
    let header = message.header(true, 2);
    assert!(header.accepts() && header.step == 3 && header.iteration == 2);
    let mut payload = vec![f64::NAN; header.length as usize];
    message.write(&mut payload);
    let parts = read_step::<2>(&header, &payload).expect("a step");
    assert!(parts.conditions.is_none() && parts.motion.is_none());
    let (place, theirs) = parts.points.expect("points");
    assert_eq!(payload[theirs], voidage);
    assert_eq!(payload[parts.source.expect("a source")], source);
    let cut_off = Header { length: header.length - 1, ..header };
    assert!(read_step::<2>(&cut_off, &payload).is_err());
    let mut copy = Points::default();
    place.fill(header.scalars, 3, &payload, &mut copy).expect("points on a mesh of three cells");
    assert_eq!(copy, points);
    assert!(place.fill(header.scalars, 2, &payload, &mut copy).is_err());
}

#[test]
fn a_step_without_grains_and_heat_carries_nothing_of_them() {
    let step =
        FluidStep::<2> { number: 1, time: 0.0, dt: 0.1, immersed: None, conditions: &[], motion: None };
    assert_eq!(StepMessage::new(&step, String::new()).header(false, 0).length, 0);
    let (points, voidage) = (Points { scalars: vec![None], ..points(16) }, vec![0.5; 4]);
    let step =
        FluidStep { immersed: Some(Immersed { points: &points, voidage: &voidage, source: None }), ..step };
    // Three vectors and five numbers for each point, and four nodes.
    let still = 11 * 16 + 4;
    let header = StepMessage::new(&step, String::new()).header(false, 0);
    assert_eq!((header.length, header.moves()), (still, false));
    // Places and velocities of four nodes, only when they move.
    let nodes = [Vector::<2>::zeros(); 4];
    let step = FluidStep { motion: Some(MeshMotion { points: &nodes, velocity: &nodes }), ..step };
    let header = StepMessage::new(&step, String::new()).header(false, 0);
    assert_eq!((header.length, header.moves()), (still + 2 * 2 * 4, true));
}

#[test]
fn the_motion_of_a_mesh_comes_back_as_it_was_with_grains_and_without() {
    let places: Vec<_> = (0..4).map(|i| Vector::<2>::new(i as f64, 0.1)).collect();
    let velocity: Vec<_> = places.iter().map(|x| x * 3.0).collect();
    let motion = Some(MeshMotion { points: &places, velocity: &velocity });
    let (points, voidage) = (points(5), vec![0.5; 4]);
    for immersed in [None, Some(Immersed { points: &points, voidage: &voidage, source: None })] {
        let step = FluidStep { number: 1, time: 0.0, dt: 0.1, immersed, conditions: &[], motion };
        let message = StepMessage::new(&step, "[]".into());
        let header = message.header(false, 0);
        let mut payload = vec![f64::NAN; header.length as usize];
        message.write(&mut payload);
        let parts = read_step::<2>(&header, &payload).expect("a step");
        assert_eq!(parts.points.is_some(), immersed.is_some());
        let moved = parts.motion.expect("a motion");
        assert_eq!(moved.read::<2>(&payload), [places.clone(), velocity.clone()]);
        assert!(payload.iter().all(|number| !number.is_nan()) || immersed.is_some(), "padding only");
    }
}

#[test]
fn a_solution_comes_back_as_it_was() {
    let balance = |k: f64| Balance {
        flux: k,
        force: Vector::<2>::new(k + 0.1, k + 0.2),
        torque: vec![k + 0.25],
        scalars: vec![k + 0.3, k + 0.4],
        convected: vec![k + 0.5, k + 0.6],
    };
    let report =
        Report { flow_iterations: 7, residual: 1e-9, factored: true, flow_s: 0.2, ..Report::default() };
    let bodies = vec![BodyAnswer { velocity: Vector::<2>::new(0.7, 0.8), vapour: 0.9 }];
    let parts = vec![balance(1.0), balance(2.0), balance(3.0)];
    for (balances, bodies) in [(vec![], vec![]), (parts.clone(), vec![]), (parts, bodies)] {
        let solution = Solution { fields: fields(4), balances, bodies, report, transport_s: 0.0 };
        let message = SolutionMessage::new(&solution);
        let header = message.header();
        let mut payload = vec![f64::NAN; header.length as usize];
        message.write(&mut payload);
        let mut copy = Solution::default();
        read_solution(&header, &payload, (4, 2, 3), &mut copy).expect("a solution");
        assert_eq!((&copy.fields, &copy.balances), (&solution.fields, &solution.balances));
        assert_eq!(copy.bodies, solution.bodies);
        assert_eq!((copy.report.flow_iterations, copy.report.factored), (7, true));
        assert!(read_solution(&header, &payload, (5, 2, 3), &mut copy).is_err());
        assert!(read_solution(&header, &payload, (4, 1, 3), &mut copy).is_err());
        let other_parts = read_solution(&header, &payload, (4, 2, 2), &mut copy);
        assert_eq!(other_parts.is_err(), !solution.balances.is_empty());
    }
}

#[test]
fn a_solution_that_is_not_finite_names_the_field_and_the_node() {
    let scalars = ["temperature", "tracer"].map(|name| Scalar::new(name, 1.0, 1.0));
    let mut solution = Solution { fields: fields(4), ..Solution::default() };
    assert_eq!(solution.not_finite(&scalars), None);
    solution.fields.scalars[1][2] = f64::NAN;
    assert_eq!(solution.not_finite(&scalars), Some("tracer at node 2".into()));
    solution.fields.velocity[3][1] = f64::INFINITY;
    assert_eq!(solution.not_finite(&scalars), Some("velocity at node 3".into()));
}

#[test]
fn texts_and_setups_come_back_bit_for_bit() {
    for text in ["", "a", "eight by", "nine byte", "Übergröße"] {
        let mut payload = vec![0.0; 3 + numbers_for_text(text)];
        write_text(text, &mut payload);
        let header = Header { text: text.len() as u64, ..Header::new(Kind::Hello) };
        assert_eq!(read_text(&header, &payload).expect("a text"), text);
    }
    let conditions = vec![Condition {
        boundary: "inflow".into(),
        flow: FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vector::<2>::new(0.1 + 0.2, 1.0 / 3.0))),
        scalars: vec![ScalarCondition::Outflow { outside: None }, ScalarCondition::Insulated],
    }];
    let properties = voidage_fluid::forms::Properties {
        density: 1.1f64.sqrt(),
        viscosity: 1e-5 / 3.0,
        gravity: Vector::<2>::new(0.0, -9.81),
        body_force: Vector::<2>::new(0.3, 0.0),
        thin_cell_drag: 0.0,
    };
    let model = Model { properties, scalars: vec![], numerics: Default::default(), conditions };
    let setup = Setup::new(model);
    let text = serde_json::to_string(&setup).expect("JSON");
    assert_eq!(dimension(&text).expect("a dimension"), 2);
    assert_eq!(Setup::<2>::parse(&text).expect("a setup"), setup);
}

#[test]
fn what_is_no_frame_says_why() {
    let said = |header: Header| header.kind().expect_err("no frame").to_string();
    assert!(said(Header { magic: 5, ..Header::new(Kind::Step) }).contains("starts with"));
    assert!(said(Header { version: 2, ..Header::new(Kind::Step) }).contains("protocol version 2"));
    assert!(said(Header::default()).contains("unknown kind 0"));
}

proptest! {
    /// Whatever a header says, reading its payload ends with a result.
    #[test]
    fn nonsense_is_an_error_and_no_panic(
        counts in prop::array::uniform6(prop_oneof![0u64..40, any::<u64>()]),
        scalars in any::<u32>(),
        flags in 0u32..8,
        payload in prop::collection::vec(prop_oneof![Just(0.0), Just(1.0), any::<f64>()], 0..60),
    ) {
        let [rows, stride, cells, facets, text, parts] = counts;
        let length = payload.len() as u64;
        let counts = Header { rows, stride, cells, facets, parts, nodes: cells, text, ..Header::new(Kind::Step) };
        let header = Header { scalars, flags, length, ..counts };
        let is_protocol = |error: &PeerError| matches!(error, PeerError::Protocol(_));
        let (mut points, mut solution) = (Points::<2>::default(), Solution::<2>::default());
        let outcomes = [
            read_step::<2>(&header, &payload)
                .and_then(|step| step.points.map_or(Ok(()), |(place, _)| {
                    place.fill(scalars, 9, &payload, &mut points)
                }))
                .err(),
            read_mesh::<2>(&header, &payload).err(),
            read_state::<2>(&header, &payload, 4).err(),
            read_solution::<2>(&header, &payload, (3, 1, 2), &mut solution).err(),
        ];
        prop_assert!(outcomes.iter().flatten().all(is_protocol));
    }
}
