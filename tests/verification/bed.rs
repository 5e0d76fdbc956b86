//! The fluidisation plateau: once a bed bubbles, the pressure drop carries its weight.

use approx::assert_relative_eq;
use std::path::Path;
use voidage_coupling::{Scene, Simulation};

/// Vertical momentum of the grains, kg/s (per metre of depth).
fn momentum(simulation: &Simulation) -> f64 {
    let grains = simulation.view().grains.expect("grains");
    grains.mass.iter().zip(grains.velocity).map(|(m, v)| m * v.y).sum()
}

/// Pressure drop = weight of the bed less buoyancy, per area. A short mean differs from it by the momentum that the
/// grains gained and by what the floor carries, the lowest row or so of grains; both are known and close the balance.
#[test]
fn the_pressure_drop_of_a_bubbling_bed_is_its_weight() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/bubbling-bed/scene-quick.toml");
    let sets = [
        "fluid.mesh.rectangle.size=3e-3",
        "grains[0].amount={mass=2.5}",
        // The whole floor blows: over a closed nozzle grains would rest on it.
        "fluid.boundaries.nozzle.flow={superficial_velocity=[0,0.85]}",
        "grains[0].placement={lattice={lower=[0.0,0.0],upper=[0.04,0.12],spacing=1.02}}",
        "fluid.boundaries.inflow.flow={superficial_velocity=[0,0.85]}",
    ];
    let scene = Scene::read(&path, &sets.map(String::from)).unwrap_or_else(|error| panic!("{error}"));
    let mut simulation = Simulation::new(&scene).expect("a valid scene");
    let weight = simulation.bed_weight_per_area().expect("grains and fluid");
    let (dt, width) = (scene.time.step, 0.04);
    for _ in 0..100 {
        simulation.step().expect("a step");
    }
    let before = momentum(&simulation);
    let (mut sum, mut floor, steps) = (0.0, 0.0, 400);
    for _ in 0..steps {
        simulation.step().expect("a step");
        simulation.refresh().expect("fields");
        let fluid = simulation.view().fluid.expect("fluid");
        let at = |name| fluid.mean_pressure(name).expect("a boundary");
        sum += at("inflow") - at("outflow");
        let grains = simulation.coupled().grains.as_ref().expect("grains");
        floor -= grains.wall_force().iter().map(|force| force.y).sum::<f64>() / width;
    }
    let heave = (momentum(&simulation) - before) / (steps as f64 * dt * width);
    let (drop, floor) = (sum / steps as f64, floor / steps as f64);

    assert_relative_eq!(drop - heave, weight, max_relative = 0.05);
    // What the walls carry closes the balance.
    assert_relative_eq!(drop + floor - heave, weight, max_relative = 0.02);
    assert!(simulation.totals().momentum_exchange_defect < Some(1e-12));
    assert!(simulation.totals().energy_exchange_defect < Some(1e-12));
    assert!(simulation.totals().solid_volume_defect < Some(1e-12));
}
