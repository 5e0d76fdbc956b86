//! A suspension that settles: Pham Van Bang et al. 2008.

use crate::fields::{Lines, bottom, interface};
use crate::measured::{Points, between, rows};
use crate::said;
use std::path::Path;
use tracing::warn;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_scene::{Scene, Simulation};
use voidage_verification::models::scheme_setting;
use voidage_verification::{Case, Finding, Outcome, line};

/// The case.
pub const CASE: Case = Case {
    name: "sedimentation",
    group: "experiments",
    title: "polystyrene beads settle in silicone oil: heights of the suspension and of the deposit",
    source: "Pham Van Bang, Lefrancois, Sergent and Bertrand 2008 (La Houille Blanche), magnetic resonance imaging, as \
             tabulated with SedFoam (tutorials/Py/DATA/exp_lmsgc.py)",
    run,
};

const SCENE: &str = include_str!("../sedimentation.toml");
const INTERFACE: &str = include_str!("../data/sedimentation-interface.csv");
const DEPOSIT: &str = include_str!("../data/sedimentation-deposit.csv");

/// Time before the first picture, s, in which the suspension had settled already: SedFoam's tutorial shifts the times by
/// as much.
const BEFORE: f64 = 172.0;
/// Solid fraction at the upper interface, as measured; and half-way between the suspension, 0.49, and the deposit,
/// 0.576, which follows from the heights at the first and at the last time.
const CLEAR: f64 = 0.25;
const SETTLED: f64 = 0.533;

/// Mean share of solid of each row of nodes. The lowest is left out: it has only the half above the floor.
fn profile(rows: &Lines, simulation: &mut Simulation) -> Result<Points> {
    let rows = rows.shares(simulation)?;
    let mean = |row: &[(f64, f64)]| row.iter().map(|node| node.1).sum::<f64>() / row.len() as f64;
    Ok(rows.iter().skip(1).map(|(y, row)| (*y, mean(row))).collect())
}

/// The quick form has a column a fifth as high and takes the speed at which it sinks in its first minute, within twice
/// what the full form is allowed.
fn run(effort: Effort) -> Result<Outcome> {
    let quick = effort == Effort::Quick;
    let low = [
        "grains[0].placement.lattice.upper=[3.0732e-3,0.0107]",
        "fluid.mesh.rectangle.upper=[3.0732e-3,0.016]",
        "fluid.mesh.rectangle.structured.squares=[3,16]",
    ];
    let mut changes = if quick { low.map(String::from).to_vec() } else { vec![] };
    changes.extend(scheme_setting());
    let scene = Scene::parse(Path::new("cases/validation/sedimentation.toml"), SCENE, &changes)?;
    let mut simulation = Simulation::new(&scene)?;
    let lines = Lines::new(&mut simulation, 1)?;
    let (mut surface, mut deposit) = (Points::new(), Points::new());
    let duration = if quick { 60.0 } else { BEFORE + 1140.0 };
    let steps = 1 + (duration / scene.time.step).ceil() as u64;
    for step in 1..=steps {
        let (time, profile) = (simulation.time() - BEFORE, profile(&lines, &mut simulation)?);
        surface.push((time, interface(&profile, CLEAR)));
        deposit.push((time, bottom(&profile, SETTLED)));
        simulation.step()?;
        said("sedimentation", step, steps, simulation.time());
    }
    simulation.shortcomings().iter().for_each(|line| warn!("{line}"));
    let measured: [Points; 2] = [rows(INTERFACE), rows(DEPOSIT)];
    let [first, end] = [measured[0][0], measured[0][1]];
    let speed = (first.1 - end.1) / (end.0 - first.0);
    let sinks = |fall: &[(f64, f64)], slack: f64| {
        let what = "speed at which the suspension sinks";
        Finding::relative(what, "m/s", speed, -line(fall).1, 0.15 * slack)
    };
    let findings = if quick {
        vec![sinks(&surface, 2.0)]
    } else {
        let computed: Points =
            measured[1].iter().map(|(time, _)| (*time, between(&deposit, *time, f64::NAN))).collect();
        let off = measured[1].iter().zip(&computed).map(|(a, b)| (a.1 - b.1).powi(2)).sum::<f64>();
        let off = (off / computed.len() as f64).sqrt();
        let falling = |point: &&(f64, f64)| (0.0..=900.0).contains(&point.0);
        let fall: Points = surface.iter().filter(falling).copied().collect();
        let rises = [&measured[1], &computed].map(|points| line(points).1);
        let height = between(&surface, end.0, f64::NAN);
        vec![
            sinks(&fall, 1.0),
            Finding::relative("speed at which the deposit rises", "m/s", rises[0], rises[1], 0.25),
            Finding::at_most("height of the deposit, root mean square deviation", "m", 3e-3, off),
            Finding::relative("height at the end", "m", end.1, height, 0.03),
        ]
    };
    let millimetres = |points: &[(f64, f64)]| points.iter().map(|(t, y)| (*t, 1e3 * y)).collect::<Points>();
    let panel = Panel {
        headroom: 0.2,
        curves: vec![
            Curve::known("interface, measured", millimetres(&measured[0])),
            Curve::measured("interface", millimetres(&surface)),
            Curve::known("deposit, measured", millimetres(&measured[1])),
            Curve::measured("deposit", millimetres(&deposit)),
        ],
        ..Panel::new("A suspension settles", "t (s)", "height (mm)")
    };
    Ok(Outcome { findings, panels: vec![panel] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_there() {
        let [interface, deposit]: [Points; 2] = [rows(INTERFACE), rows(DEPOSIT)];
        assert_eq!((interface.len(), deposit.len()), (2, 20));
        assert!(deposit.windows(2).all(|pair| pair[1].0 > pair[0].0 && pair[1].1 > pair[0].1));
    }
}
