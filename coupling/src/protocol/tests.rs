//! Frames survive the way, and what is no frame is an error and no panic.

use super::*;
use crate::backend::{FluidReport, FluidStep, GrainLoad, HeatLoad, Immersed, Law};
use crate::error::PeerError;
use proptest::prelude::*;
use voidage_fluid::conditions::{Condition, FlowCondition, HeatCondition, Prescribed};
use voidage_fluid::exchange::{AtBodies, Pieces};
use voidage_fluid::flow::{Report, State};
use voidage_fluid::mesh::{Mesh, Rectangle, Side, Sides};
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
        temperature: Some((0..nodes).map(|i| 300.0 + number(i)).collect()),
    }
}

fn load(grains: usize) -> GrainLoad<2> {
    let column = |shift: f64| (0..grains).map(|i| shift + i as f64 / 3.0).collect::<Vec<_>>();
    GrainLoad {
        volume: column(1.0),
        drag: column(2.0),
        mobility: column(3.0),
        velocity: column(4.0).into_iter().map(|x| Vector::<2>::new(x, -x)).collect(),
        heat: Some(HeatLoad { coefficient: column(5.0), mobility: column(6.0), temperature: column(7.0) }),
        pieces: Pieces {
            first: (0..=grains as u32).collect(),
            cell: (0..grains as u32).map(|i| i % 3).collect(),
            coordinate: vec![Vector::<2>::new(0.25, 0.5); grains],
            share: vec![1.0; grains],
        },
        voidage: vec![0.5; 4],
        continuity: Some(Law {
            mobility: column(8.0),
            velocity: column(9.0).into_iter().map(|x| Vector::<2>::new(-x, x)).collect(),
        }),
    }
}

#[test]
fn a_mesh_comes_back_as_it_was() {
    let mesh = mesh().expect("a valid rectangle");
    let fields = fields(mesh.points.len());
    let message = MeshMessage::new(&mesh, &fields);
    let header = message.header();
    let mut payload = vec![f64::NAN; header.length as usize];
    message.write(&mut payload);
    assert_eq!(read_mesh(&header, &payload).expect("a mesh"), (mesh, fields));
}

#[test]
fn a_step_comes_back_as_it_was() {
    let (load, conditions) = (load(5), vec![]);
    let position: Vec<_> = (0..5).map(|i| Vector::<2>::new(0.1 * i as f64, 0.3)).collect();
    let radius = vec![0.1, 0.2, 0.3, 0.4, 0.5];
    let grains = Some(Immersed { position: &position, radius: &radius, load: &load });
    let step = FluidStep { number: 3, time: 0.2, dt: 0.1, grains, conditions: &conditions, motion: None };
    let message = StepMessage::new(&step, String::new());
    let header = message.header(true, 2);
    assert!(header.accepts() && header.step == 3 && header.iteration == 2);
    let mut payload = vec![f64::NAN; header.length as usize];
    message.write(&mut payload);
    let StepParts { layout, pieces, motion, conditions } = read_step::<2>(&header, &payload).expect("a step");
    assert!(conditions.is_none() && motion.is_none());
    let places = pieces.expect("pieces");
    assert_eq!(places.read::<2>(&payload, 3).expect("pieces on a mesh of three cells"), load.pieces);
    assert!(places.read::<2>(&payload, 2).is_err());
    assert_eq!(payload[places.voidage], load.voidage);
    let (mut copy, mut places, mut radii) = (GrainLoad::default(), vec![], vec![]);
    copy.copy_columns(&layout, &payload, &mut places, &mut radii);
    assert_eq!((places, radii), (position, radius));
    assert_eq!((copy.volume, copy.drag, copy.mobility), (load.volume, load.drag, load.mobility));
    assert_eq!(copy.velocity, load.velocity);
    let (theirs, ours) = (copy.heat.expect("heat"), load.heat.expect("heat"));
    assert_eq!(theirs.coefficient, ours.coefficient);
    assert_eq!((theirs.mobility, theirs.temperature), (ours.mobility, ours.temperature));
    assert_eq!(copy.continuity, load.continuity);
}

#[test]
fn a_step_without_grains_and_heat_carries_nothing_of_them() {
    let step = FluidStep::<2> { number: 1, time: 0.0, dt: 0.1, grains: None, conditions: &[], motion: None };
    assert_eq!(StepMessage::new(&step, String::new()).header(false, 0).length, 0);
    let mut load = load(16);
    (load.heat, load.continuity) = (None, None);
    let (position, radius) = (vec![Vector::zeros(); 16], vec![0.1; 16]);
    let grains = Some(Immersed { position: &position, radius: &radius, load: &load });
    let step = FluidStep { grains, ..step };
    // Position and velocity have two numbers each; 16 pieces of 4 numbers, where each grain's begin, 4 nodes.
    let still = 8 * 16 + 4 * 16 + 17 + 4;
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
    let points: Vec<_> = (0..4).map(|i| Vector::<2>::new(i as f64, 0.1)).collect();
    let velocity: Vec<_> = points.iter().map(|x| x * 3.0).collect();
    let motion = Some(MeshMotion { points: &points, velocity: &velocity });
    let load = load(5);
    let (position, radius) = (vec![Vector::zeros(); 5], vec![0.1; 5]);
    for grains in [None, Some(Immersed { position: &position, radius: &radius, load: &load })] {
        let step = FluidStep { number: 1, time: 0.0, dt: 0.1, grains, conditions: &[], motion };
        let message = StepMessage::new(&step, "[]".into());
        let header = message.header(false, 0);
        let mut payload = vec![f64::NAN; header.length as usize];
        message.write(&mut payload);
        let parts = read_step::<2>(&header, &payload).expect("a step");
        assert_eq!(parts.pieces.is_some(), grains.is_some());
        let places = parts.motion.expect("a motion");
        assert_eq!(places.read::<2>(&payload), [points.clone(), velocity.clone()]);
        assert!(payload.iter().all(|number| !number.is_nan()) || grains.is_some(), "padding only");
    }
}

fn solution() -> (AtBodies<2>, FluidReport<2>) {
    let vectors: Vec<_> = (0..4).map(|i| Vector::<2>::new(i as f64, 0.1)).collect();
    let at = AtBodies { velocity: vectors.clone(), pressure_gradient: vectors, temperature: vec![300.0; 4] };
    let solver =
        Report { flow_iterations: 7, residual: 1e-9, factored: true, flow_s: 0.2, ..Report::default() };
    (at, FluidReport { solver, force: Some(Vector::<2>::new(1.0, 2.0)), heat: 3.0, transport_s: 0.0 })
}

#[test]
fn a_solution_comes_back_as_it_was_unless_it_is_not_finite() {
    let (at, report) = solution();
    let message = SolutionMessage::new(&at, &report);
    let header = message.header();
    let mut payload = vec![f64::NAN; header.length as usize];
    message.write(&mut payload);
    let unsummed = FluidReport { force: None, ..report };
    let mut other = vec![f64::NAN; header.length as usize];
    SolutionMessage::new(&at, &unsummed).write(&mut other);
    let theirs =
        read_solution(&header, &other, (4, true), &mut AtBodies::<2>::default()).expect("a solution");
    assert_eq!(theirs.force, None);
    let mut copy = AtBodies::<2>::default();
    let theirs = read_solution(&header, &payload, (4, true), &mut copy).expect("a solution");
    assert_eq!((copy, theirs.force, theirs.heat), (at, report.force, report.heat));
    assert_eq!((theirs.solver.flow_iterations, theirs.solver.factored), (7, true));
    let mut copy = AtBodies::<2>::default();
    assert!(read_solution(&header, &payload, (5, true), &mut copy).is_err());
    payload[2] = f64::NAN;
    let error = read_solution(&header, &payload, (4, true), &mut copy).expect_err("not finite");
    assert!(error.to_string().contains("velocity = NaN at grain 1"), "{error}");
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
        heat: HeatCondition::Open { temperature: None },
    }];
    let properties = voidage_fluid::forms::Properties {
        density: 1.1f64.sqrt(),
        viscosity: 1e-5 / 3.0,
        gravity: Vector::<2>::new(0.0, -9.81),
        thin_cell_drag: 0.0,
        drag_in_stabilisation: true,
    };
    let setup = Setup::new(properties, None, Default::default(), conditions);
    let text = serde_json::to_string(&setup).expect("JSON");
    assert_eq!(dimension(&text).expect("a dimension"), 2);
    assert_eq!(Setup::<2>::parse(&text).expect("a setup"), setup);
}

#[test]
fn what_is_no_frame_says_why() {
    let said = |header: Header| header.kind().expect_err("no frame").to_string();
    assert!(said(Header { magic: 5, ..Header::new(Kind::Step) }).contains("starts with"));
    assert!(said(Header { version: 9, ..Header::new(Kind::Step) }).contains("protocol version 9"));
    assert!(said(Header::default()).contains("unknown kind 0"));
}

proptest! {
    /// Whatever a header says, reading its payload ends with a result.
    #[test]
    fn nonsense_is_an_error_and_no_panic(
        counts in prop::array::uniform6(prop_oneof![0u64..40, any::<u64>()]),
        mask in any::<u32>(),
        payload in prop::collection::vec(prop_oneof![Just(0.0), Just(1.0), any::<f64>()], 0..60),
    ) {
        let [rows, stride, cells, facets, text, pieces] = counts;
        let length = payload.len() as u64;
        let counts = Header { rows, stride, cells, facets, pieces, nodes: cells, text, ..Header::new(Kind::Step) };
        let header = Header { mask, length, ..counts };
        let is_protocol = |error: &PeerError| matches!(error, PeerError::Protocol(_));
        let mut at = AtBodies::<2>::default();
        let outcomes = [
            read_step::<2>(&header, &payload)
                .and_then(|step| step.pieces.map_or(Ok(()), |places| places.read::<2>(&payload, 9).map(drop)))
                .err(),
            read_mesh::<2>(&header, &payload).err(),
            read_fields::<2>(&header, &payload, 4).err(),
            read_solution::<2>(&header, &payload, (3, true), &mut at).err(),
        ];
        prop_assert!(outcomes.iter().flatten().all(is_protocol));
    }
}
