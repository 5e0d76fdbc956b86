//! The fluidisation plateau: once a bed bubbles, the pressure drop carries its weight.

use crate::models::scheme_setting;
use crate::{Case, Finding, Outcome};
use std::path::Path;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{Effort, largest};
use voidage_coupling::{Error, Result};
use voidage_scene::{Scene, Simulation};

/// The case.
pub const CASE: Case = Case {
    name: "plateau",
    group: "coupled",
    title: "pressure drop of a bubbling bed against its weight less buoyancy",
    source: "exact: balance of momentum of the grains",
    run,
};

const SCENE: &str = include_str!("../../../bubbling-bed/scene-quick.toml");

/// The walls at the sides are smooth for the grains, so that they carry nothing of the weight. The whole floor blows:
/// over a closed nozzle grains would rest on it. The walls slip: a node that a wall holds takes the drag of the grains
/// within an element of it, which is 1.6 % of the weight on this mesh.
const CHANGES: [&str; 8] = [
    "walls[1].friction=0",
    "walls[2].friction=0",
    "fluid.boundaries.walls.flow=\"slip\"",
    "fluid.mesh.rectangle.size=3e-3",
    "grains[0].amount={mass=2.5}",
    "fluid.boundaries.nozzle.flow={superficial_velocity=[0,0.85]}",
    "grains[0].placement={lattice={lower=[0.0,0.0],upper=[0.04,0.12],spacing=1.02}}",
    "fluid.boundaries.inflow.flow={superficial_velocity=[0,0.85]}",
];

/// Vertical momentum of the grains, kg/s (per metre of depth).
fn momentum(simulation: &Simulation) -> f64 {
    let grains = simulation.view().grains;
    grains.map_or(f64::NAN, |grains| grains.mass.iter().zip(grains.velocity).map(|(m, v)| m * v.y).sum())
}

/// Weight of the gas over the area of the box, Pa, and the width of the box, m.
fn gas(simulation: &Simulation) -> Option<(f64, f64)> {
    let coupled = simulation.coupled();
    let (grains, laws) = (coupled.grains()?, &coupled.interaction()?.laws);
    let (low, high) = coupled.fluid()?.mesh.bounds();
    Some((laws.density * grains.settings().gravity.norm() * (high - low).y, (high - low).x))
}

/// A mean over a time differs from the weight by that of the gas, by the momentum that the grains gained and by what
/// floor and walls carry, one per cent; all are known and close the balance. What is left, 0.1 %, is that nodes on the
/// floor share the lowest row of grains, so that the pressure there is not quite the force on it: above a clear layer
/// of two elements, the grains on a sieve, 0.02 % are left.
fn run(effort: Effort) -> Result<Outcome> {
    let mut changes = CHANGES.map(String::from).to_vec();
    changes.extend(scheme_setting());
    let scene = Scene::parse(Path::new("cases/bubbling-bed/scene-quick.toml"), SCENE, &changes)?;
    let mut simulation = Simulation::new(&scene)?;
    let lost = || Error::run("the bed has no grains or no fluid");
    let weight = simulation.bed_weight_per_area().ok_or_else(lost)?;
    let (gas, width) = gas(&simulation).ok_or_else(lost)?;
    let dt = scene.time.step;
    let mut curve = Vec::new();
    let (before_steps, steps) = effort.pick((100, 400), (500, 4000));
    for _ in 0..before_steps {
        simulation.step()?;
    }
    let before = momentum(&simulation);
    let (mut sum, mut floor) = (0.0, 0.0);
    for _ in 0..steps {
        simulation.step()?;
        simulation.refresh()?;
        let fluid = simulation.view().fluid.ok_or_else(lost)?;
        let at = |name| fluid.mean_pressure(name).ok_or_else(lost);
        let drop = at("inflow")? - at("outflow")? - gas;
        sum += drop;
        let grains = simulation.coupled().grains().ok_or_else(lost)?;
        floor -= grains.wall_force().iter().map(|force| force.y).sum::<f64>() / width;
        curve.push((simulation.time(), drop / weight));
    }
    let heave = (momentum(&simulation) - before) / (steps as f64 * dt * width);
    let (drop, floor) = (sum / steps as f64, floor / steps as f64);
    let totals = simulation.totals();
    let defects = [totals.momentum_exchange_defect, totals.energy_exchange_defect];
    let worst = largest(defects.into_iter().map(|defect| defect.unwrap_or(f64::NAN)));
    let level = vec![curve[0], curve[curve.len() - 1]].into_iter().map(|(t, _)| (t, 1.0)).collect();
    let panel = Panel {
        curves: vec![Curve::measured("bubbling bed", curve), Curve::line("weight", level)],
        ..Panel::new("Fluidisation plateau", "t (s)", "pressure drop / weight")
    };
    Ok(Outcome {
        findings: vec![
            Finding::relative("mean pressure drop less gained momentum", "Pa", weight, drop - heave, 0.03),
            Finding::relative(
                "the same with what the walls carry",
                "Pa",
                weight,
                drop + floor - heave,
                0.003,
            ),
            Finding::at_most("largest defect of momentum and energy exchanged", "1", 1e-12, worst),
            Finding::at_most(
                "largest share of the solid that is in walls, outside of the mesh",
                "1",
                1e-5,
                totals.solid_volume_defect.unwrap_or(f64::NAN),
            ),
        ],
        panels: vec![panel],
    })
}
