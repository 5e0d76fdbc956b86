//! Invariances of the fluid alone; its exact oracles are cases of `voidage verify`.

use approx::assert_relative_eq;
use voidage::models::{FluidSet, Vec2, grid, steps_alone};
use voidage_fluid::conditions::{FlowCondition, Prescribed};

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
        fluid.backend.fields().expect("fields")
    };
    let (kilogram, gram) = (solve(1.0), solve(1000.0));
    for (a, b) in kilogram.velocity.iter().zip(&gram.velocity) {
        assert_relative_eq!(a, b, epsilon = 1e-8);
    }
    for (a, b) in kilogram.pressure.iter().zip(&gram.pressure) {
        assert_relative_eq!(1000.0 * a, b, epsilon = 1e-4);
    }
}
