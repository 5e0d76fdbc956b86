//! Invariances of the fluid alone; its exact oracles are cases of `voidage verify`.

use approx::assert_relative_eq;
use std::sync::Arc;
use voidage_coupling::{HEAT, TEMPERATURE};
use voidage_fluid::assembly::System;
use voidage_fluid::conditions::{Condition, FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::flow::State;
use voidage_fluid::linear::Pattern;
use voidage_fluid::transport::{Form, Scalar};
use voidage_verification::models::{FluidSet, Vec2, annulus, grid, steps_alone};

/// A stirred box with an obstacle of drag, solved in kg and in units a thousand times smaller: velocities are
/// the same and pressures scale. The stabilisation as printed in the paper fails this.
#[test]
fn the_solution_does_not_depend_on_the_unit_of_mass() {
    let solve = |unit: f64| {
        let lid = FlowCondition::Velocity(Prescribed::Uniform(Vec2::new(1.0, 0.0)));
        let mut set = FluidSet::new(1.3 * unit, 0.01 * unit).flow("top", lid);
        set.properties.gravity = Vec2::new(0.3, -9.81);
        set.properties.thin_cell_drag = 0.5 * unit;
        let mesh = grid([1.0, 1.0], [8, 8]).unwrap();
        let start = set.rest(&mesh, 0.0);
        let mut fluid = set.build(mesh, start).unwrap();
        steps_alone(&mut fluid, 0.1, 5).unwrap();
        fluid.accepted
    };
    let (kilogram, gram) = (solve(1.0), solve(1000.0));
    for (a, b) in kilogram.velocity.iter().zip(&gram.velocity) {
        assert_relative_eq!(a, b, epsilon = 1e-8);
    }
    for (a, b) in kilogram.pressure.iter().zip(&gram.pressure) {
        assert_relative_eq!(1000.0 * a, b, epsilon = 1e-4);
    }
}

/// Temperatures (lowest, highest) after hot fluid has entered a cold box from the left, in a stream that crosses it
/// aslant.
fn after_a_front(form: Form) -> [f64; 2] {
    let stream = Vec2::new(1.0, 0.6);
    let mesh = grid([1.0, 1.0], [16, 16]).expect("a valid rectangle");
    let uniform = || FlowCondition::Velocity(Prescribed::Uniform(stream));
    let mut set = FluidSet::new(1.0, 0.01).flow("left", uniform()).flow("bottom", uniform());
    for side in ["right", "top"] {
        set = set.flow(side, FlowCondition::Open { pressure: 0.0 });
    }
    set.scalars = vec![Scalar { form, ..Scalar::new(TEMPERATURE, 2.0, 1e-5) }];
    for (side, temperature) in [("left", 400.0), ("bottom", 300.0)] {
        let mut conditions = set.conditions.iter_mut();
        let condition = conditions.find(|condition| condition.boundary == side).expect("a side");
        condition.scalars = vec![ScalarCondition::Value(Prescribed::Uniform(temperature))];
    }
    let start = State { velocity: vec![stream; mesh.points.len()], ..set.rest(&mesh, 300.0) };
    let clear = vec![1.0; mesh.points.len()];
    let mut flow = set.equations(mesh, start).expect("a valid fluid");
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for _ in 0..20 {
        flow.solve(0.02, &clear, None, &set.conditions).expect("a step");
        flow.accept();
        let temperature = flow.state().scalar(HEAT);
        range[0] = temperature.iter().copied().fold(range[0], f64::min);
        range[1] = temperature.iter().copied().fold(range[1], f64::max);
    }
    range
}

#[test]
fn a_front_stays_within_its_bounds_where_temperatures_are_monotone() {
    let [low, high] = after_a_front(Form::Monotone);
    assert!(low > 300.0 - 1e-9 && high < 400.0 + 1e-9, "{low} to {high}");
    let [low, high] = after_a_front(Form::Lumped);
    assert!(low < 299.9 && high > 405.0, "{low} to {high}: the test would see nothing");
}

#[test]
fn upwinding_leaves_the_sums_of_rows_and_columns_and_no_positive_neighbour() {
    let pattern = Arc::new(Pattern::from_cells(4, &[0, 1, 2, 1, 3, 2], 3));
    let mut system = System::<1>::new(pattern.clone());
    let entries = [2.0, -1.0, 0.5, 0.3, 4.0, -0.2, 0.7, -0.4, 0.1, 3.0, -2.0, 0.6, -0.1, 1.0];
    system.matrix.values.iter_mut().zip(entries).for_each(|(block, entry)| block[0][0] = entry);
    let sums = |system: &System<1>| {
        let (mut rows, mut columns) = ([0.0; 4], [0.0; 4]);
        for row in 0..4 {
            for position in pattern.range(row) {
                rows[row] += system.matrix.values[position][0][0];
                columns[pattern.columns[position] as usize] += system.matrix.values[position][0][0];
            }
        }
        [rows, columns]
    };
    let before = sums(&system);
    system.upwind();
    for (before, after) in before.iter().flatten().zip(sums(&system).iter().flatten()) {
        assert!((before - after).abs() < 1e-15, "{before} {after}");
    }
    for row in 0..4 {
        for position in pattern.range(row) {
            let entry = system.matrix.values[position][0][0];
            assert!(pattern.columns[position] as usize == row || entry <= 0.0, "{entry}");
        }
    }
}

/// What leaves a box through its open top, m2/s, when 0.3 m2/s enter through the floor between two walls: by the number
/// of squares, and whether the conditions of the walls come before that of the floor.
fn outflow(squares: usize, walls_first: bool, inflow: FlowCondition<2>) -> f64 {
    let mesh = grid([1.0, 1.0], [squares, squares]).expect("a valid rectangle");
    let mut set =
        FluidSet::new(1.0, 0.01).flow("bottom", inflow).flow("top", FlowCondition::Open { pressure: 0.0 });
    set.conditions.sort_by_key(|condition| (condition.boundary == "bottom") == walls_first);
    let start = set.rest(&mesh, 0.0);
    let voidage: Vec<f64> = mesh.points.iter().map(|x| 0.9 - 0.4 * x.x * (1.0 - x.y)).collect();
    let mut flow = set.equations(mesh, start).expect("a valid fluid");
    flow.solve(0.1, &voidage, None, &set.conditions).expect("a step");
    let mut balances = vec![];
    flow.balances(&voidage, &set.conditions, &mut balances);
    let top = set.conditions.iter().position(|condition| condition.boundary == "top").expect("a top");
    balances[top].flux
}

#[test]
fn what_enters_depends_neither_on_the_mesh_nor_on_the_order_of_the_conditions() {
    let up = Prescribed::Uniform(Vec2::new(0.0, 0.3));
    for squares in [3, 6, 12] {
        for walls_first in [true, false] {
            let found = outflow(squares, walls_first, FlowCondition::SuperficialVelocity(up.clone()));
            assert_relative_eq!(found, 0.3, max_relative = 1e-7);
            // The voidage falls from 0.9 to 0.5 along the floor.
            let found = outflow(squares, walls_first, FlowCondition::Velocity(up.clone()));
            assert_relative_eq!(found, 0.3 * 0.7, max_relative = 1e-7);
        }
    }
}

/// Moments of the fluid about a point, N, on the two walls of a ring of radii 1 and 2 about it, of which the inner one
/// turns at 1/s in creeping flow of viscosity 1; the ring is far from the origin.
fn moments_in_a_ring(rings: usize) -> [f64; 2] {
    let centre = Vec2::new(3.0, -2.0);
    let mut mesh = annulus(1.0, 2.0, rings, 8 * rings);
    let turns = mesh.points.iter().map(|arm| Vec2::new(-arm.y, arm.x)).collect();
    mesh.points.iter_mut().for_each(|x| *x += centre);
    let mut set = FluidSet::new(1e-9, 1.0);
    let walls =
        [("inner", FlowCondition::Velocity(Prescribed::Nodal(turns))), ("outer", FlowCondition::NoSlip)];
    let condition =
        |(boundary, flow): (&str, _)| Condition { boundary: boundary.into(), flow, scalars: vec![] };
    set.conditions = walls.map(condition).to_vec();
    let clear = vec![1.0; mesh.points.len()];
    let start = set.rest(&mesh, 0.0);
    let mut flow = set.equations(mesh, start).expect("a valid fluid");
    flow.solve(1e6, &clear, None, &set.conditions).expect("a step");
    let mut balances = vec![];
    flow.balances(&clear, &set.conditions, &mut balances);
    let about = |k: usize| {
        let force = balances[k].force;
        balances[k].torque[0] - (centre.x * force.y - centre.y * force.x)
    };
    [about(0), about(1)]
}

/// Between concentric circles of radii a and b of which the inner one turns at the rate w, each is turned by
/// 4 pi eta w a^2 b^2/(b^2 - a^2).
#[test]
fn the_torques_on_the_walls_of_a_ring_are_those_of_couette_flow() {
    let exact = 16.0 * std::f64::consts::PI / 3.0;
    let errors = [4, 8, 16].map(|rings| {
        let [inner, outer] = moments_in_a_ring(rings);
        // The reactions are symmetric: a rigid rotation of the whole costs no power.
        assert!((inner + outer).abs() < 1e-8 * exact, "{inner} and {outer}");
        (inner + exact).abs() / exact
    });
    let order = |k: usize| (errors[k] / errors[k + 1]).log2();
    assert!(order(0) > 1.8 && order(1) > 1.9 && errors[2] < 0.01, "{errors:?}");
}
