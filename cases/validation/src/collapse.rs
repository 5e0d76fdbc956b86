//! A column of beads that collapses in a viscous liquid, loose or dense: Rondon et al. 2011.

use crate::fields::{Lines, floor_pressure, top};
use crate::measured::{Points, between, rows};
use crate::said;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use tracing::{info, warn};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::{Error, Result};
use voidage_scene::recorder::{Checkpoint, Kept, Stamp};
use voidage_scene::{Scene, Simulation, Watch};
use voidage_verification::models::scheme_setting;
use voidage_verification::{Case, Finding, Outcome};

const SOURCE: &str = "Rondon, Pouliquen and Aussillous 2011 (Physics of Fluids 23, 073301), as tabulated with SedFoam \
                      (tutorials/Py/DATA/Rondon2012)";

/// The loose column, which runs out within a second.
pub const LOOSE: Case = case(
    "collapse-loose",
    "a loose column of beads collapses in a viscous liquid: profiles, front and pore pressure",
    |effort| run(&COLUMNS[0], effort),
);

/// The dense column, which erodes from its side for half a minute.
pub const DENSE: Case = case(
    "collapse-dense",
    "a dense column of beads collapses in a viscous liquid: profiles, front and pore pressure",
    |effort| run(&COLUMNS[1], effort),
);

const fn case(name: &'static str, title: &'static str, run: fn(Effort) -> Result<Outcome>) -> Case {
    Case { name, group: "experiments", title, source: SOURCE, run }
}

const COLLAPSE: &str = include_str!("../collapse.toml");
const PROFILES: &str = include_str!("../data/collapse-profiles.csv");
const FRONTS: &str = include_str!("../data/collapse-front.csv");
const PRESSURES: &str = include_str!("../data/collapse-pressure.csv");

/// One of the two columns.
struct Column {
    name: &'static str,
    /// Scene that packs it.
    packing: &'static str,
    /// How many grains as large as the beads fill it.
    beads: f64,
    /// Size of the grains over that of the beads, in the quick and the full form.
    coarse: [f64; 2],
    /// Coefficient of resistance to rolling in the collapse.
    rolling: f64,
    /// Height before, m.
    height: f64,
    /// Times of the measured profiles that are run, s.
    profiles: &'static [f64],
    /// End of the run, s.
    end: f64,
    step: f64,
}

/// Grains f times as large as the beads are as permeable in a liquid that is f^2 times as viscous, but the viscosity of
/// the sheared suspension goes with that of the liquid. So the loose column, which runs out fast, needs grains nearly as
/// small as the beads: the viscous number eta (dv/dy)/P of its front is 1.2e-4 f^2, and its packing of 0.55 is looser
/// than that in steady shear only below 4e-3 (Boyer, Guazzelli and Pouliquen 2011, Phys. Rev. Lett. 107, 188301, with
/// 0.585 for slow shear). The dense column creeps at a tenth of this rate.
///
/// A heap of discs that resist rolling with 0.1 has an angle of 22 degrees, one of discs that do not 12 (`cases/heap`).
/// The friction of the beads of this experiment, 0.425 in the tutorial that tabulates it, is that of 23 degrees. So the
/// dense column resists rolling with 0.1. The loose one, which resistance to rolling has held open while it was packed,
/// would dilate with as much in the collapse.
const COLUMNS: [Column; 2] = [
    Column {
        name: "loose",
        packing: include_str!("../packing-loose.toml"),
        beads: 55_600.0,
        coarse: [2.0, 2.0],
        rolling: 0.0,
        height: 0.048,
        profiles: &[0.66, 1.32],
        end: 1.32,
        step: 1e-3,
    },
    Column {
        name: "dense",
        packing: include_str!("../packing-dense.toml"),
        beads: 52_480.0,
        coarse: [6.0, 4.0],
        rolling: 0.1,
        height: 0.042,
        profiles: &[3.0],
        end: 3.5,
        step: 2e-3,
    },
];

/// The front is where a profile is this high, m.
const NOSE: f64 = 2e-3;
/// The surface is where the share of solid falls through half of that of the beads in the column.
const SURFACE: f64 = 0.28;
/// Where the pore pressure was measured, and where that of the liquid alone is taken, m.
const TAP: [f64; 2] = [0.02, 0.03];
const FAR: [f64; 2] = [0.23, 0.24];
/// Widths of the box and of the column, m.
const BOX: f64 = 0.25;
const FOOT: f64 = 0.06;

#[derive(Deserialize)]
struct ProfileRow {
    column: String,
    time_s: f64,
    x_m: f64,
    height_m: f64,
}

/// A value at a time: the table of fronts, and that of pore pressures.
#[derive(Deserialize)]
struct TimeRow {
    column: String,
    time_s: f64,
    #[serde(alias = "front_m", alias = "pressure_Pa")]
    value: f64,
}

impl Column {
    fn profile(&self, time: f64) -> Points {
        let rows: Vec<ProfileRow> = rows(PROFILES);
        let mine = rows.iter().filter(|row| row.column == self.name && row.time_s == time);
        mine.map(|row| (row.x_m, row.height_m)).collect()
    }

    fn over_time(&self, table: &str) -> Points {
        let rows: Vec<TimeRow> = rows(table);
        rows.iter().filter(|row| row.column == self.name).map(|row| (row.time_s, row.value)).collect()
    }

    /// Changes of the scenes of packing and collapse for grains `coarse` times as large as the beads.
    fn changes(&self, coarse: f64) -> [Vec<String>; 2] {
        let area = coarse * coarse;
        let packing = vec![
            format!("grains[0].radius={{uniform=[{:e},{:e}]}}", 0.95e-4 * coarse, 1.3e-4 * coarse),
            format!("grains[0].amount.count={}", (self.beads / area).round()),
        ];
        let [x, y] = [500.0, 160.0].map(|count| (count / coarse).round());
        let collapse = vec![
            format!("fluid.viscosity={:e}", 0.01212 * area),
            format!("fluid.mesh.rectangle.structured.squares=[{x},{y}]"),
            format!("time.step={}", self.step),
            format!("materials.glass.rolling={}", self.rolling),
        ];
        [packing, collapse]
    }

    /// Packs the column and leaves it in a file; with its height, m, which is twice that of its centre.
    fn pack(&self, changes: &[String], folder: &Path) -> Result<(PathBuf, f64)> {
        let place = PathBuf::from(format!("cases/validation/packing-{}.toml", self.name));
        let scene = Scene::parse(&place, self.packing, changes)?;
        let mut simulation = Simulation::new(&scene)?;
        let mut watch = Watch::new(scene.stop.as_ref(), None);
        while simulation.time() < scene.time.end {
            simulation.step()?;
            if watch.after_step(simulation.time(), || simulation.fastest(), 0.0).is_some() {
                break;
            }
        }
        let file = folder.join("packing.voidage");
        let stamp = Stamp { scene_hash: scene.hash()?, step: simulation.steps(), time: simulation.time() };
        let kept = Kept::of(&scene)?;
        Checkpoint::write(&file, &stamp, &simulation.state()?, &kept)?;
        let grains = simulation.view().grains;
        let height = grains.map_or(f64::NAN, |grains| 2.0 * grains.mean(|i| grains.position[i].y));
        info!("{} column: {:.1} mm high", self.name, 1e3 * height);
        Ok((file, height))
    }
}

/// Height of the grains over x, m.
fn surface(columns: &Lines, simulation: &mut Simulation) -> Result<Points> {
    let columns = columns.shares(simulation)?;
    Ok(columns.iter().map(|(x, column)| (*x, top(column, SURFACE))).collect())
}

/// The furthest place at which a profile is as high as the nose of the front.
fn front(profile: &[(f64, f64)]) -> f64 {
    top(profile, NOSE)
}

/// Mean distance of two profiles up to the further one of their ends, over a height.
fn apart(computed: &[(f64, f64)], measured: &[(f64, f64)], height: f64) -> f64 {
    let end = front(computed).max(measured.last().map_or(0.0, |point| point.0));
    let places = (0..200).map(|k| (k as f64 + 0.5) / 200.0 * end);
    places.map(|x| (between(computed, x, 0.0) - between(measured, x, 0.0)).abs()).sum::<f64>()
        / 200.0
        / height
}

/// The quick form takes a twentieth of a second, the dense column with larger grains: whether the liquid carries the
/// loose column and is sucked into the dense one.
fn run(column: &Column, effort: Effort) -> Result<Outcome> {
    let folder =
        tempfile::tempdir().map_err(|error| Error::file(&std::env::temp_dir(), "make a folder in", error))?;
    let quick = effort == Effort::Quick;
    let [packing, mut collapse] = column.changes(effort.pick(column.coarse[0], column.coarse[1]));
    let (profiles, end) = if quick { (&[][..], 0.05) } else { (column.profiles, column.end) };
    let (file, height) = column.pack(&packing, folder.path())?;
    collapse.push(format!("grains[0].placement.state.file={:?}", file.display().to_string()));
    collapse.extend(scheme_setting());
    let scene = Scene::parse(Path::new("cases/validation/collapse.toml"), COLLAPSE, &collapse)?;
    let mut simulation = Simulation::new(&scene)?;
    let lines = Lines::new(&mut simulation, 0)?;
    let (mut fronts, mut pressures) = (Points::new(), Points::new());
    let mut findings =
        vec![Finding::relative("height of the column before", "m", column.height, height, 0.03)];
    let mut panels = Vec::new();
    let every = (0.01 / scene.time.step).round() as u64;
    let mut wanted = profiles.iter().copied().peekable();
    while simulation.time() < end - 0.5 * scene.time.step {
        simulation.step()?;
        let time = simulation.time();
        said(column.name, simulation.steps(), (end / scene.time.step).round() as u64, time);
        if simulation.steps().is_multiple_of(every) {
            fronts.push((time, front(&surface(&lines, &mut simulation)?)));
            let far = floor_pressure(&mut simulation, FAR)?;
            pressures.push((time, floor_pressure(&mut simulation, TAP)? - far));
        }
        let Some(at) = wanted.next_if(|at| time > at - 0.5 * scene.time.step) else { continue };
        let (computed, measured) = (surface(&lines, &mut simulation)?, column.profile(at));
        let distance = apart(&computed, &measured, column.height);
        let what = format!("profile at {at} s, mean distance over the height before");
        findings.push(Finding::at_most(what, "1", 0.1, distance));
        let [expected, found] = [&measured, &computed].map(|profile| front(profile));
        findings.push(Finding::relative(format!("front at {at} s"), "m", expected, found, 0.15));
        panels.push(Panel {
            curves: vec![
                Curve::known("measured", scaled(measured, [1e2, 1e2])),
                Curve::measured("computed", scaled(computed, [1e2, 1e2])),
            ],
            ..Panel::new(format!("{} column at {at} s", column.name), "x (cm)", "height (cm)")
        });
    }
    simulation.shortcomings().iter().for_each(|line| warn!("{line}"));
    let measured = column.over_time(PRESSURES);
    if quick {
        // The submerged weight of the solid over the floor that it stands on, Pa.
        let weight = simulation.bed_weight_per_area().unwrap_or(f64::NAN) * BOX / FOOT;
        let share = pressures.iter().map(|point| point.1).sum::<f64>() / pressures.len() as f64 / weight;
        let what = "mean pore pressure over the weight of the solid";
        findings.push(match measured[0].1 > 0.0 {
            true => Finding::at_least(what, "1", 0.2, share),
            false => Finding::at_most(what, "1", -0.2, share),
        });
    }
    for (time, pressure) in measured.iter().filter(|(time, _)| *time <= end) {
        let computed = between(&pressures, *time, f64::NAN);
        let what = format!("pore pressure at {time} s");
        findings.push(Finding::absolute(what, "Pa", *pressure, computed, 35.0));
    }
    let until =
        |points: Points| points.into_iter().filter(|(time, _)| *time <= 1.2 * end).collect::<Points>();
    let seen = profiles.iter().map(|at| (*at, front(&column.profile(*at)))).collect();
    panels.push(Panel {
        headroom: 0.2,
        curves: vec![
            Curve::known("from the measured profiles", scaled(seen, [1.0, 1e2])),
            Curve::dashes("stated", scaled(until(column.over_time(FRONTS)), [1.0, 1e2])),
            Curve::measured("computed", scaled(fronts, [1.0, 1e2])),
        ],
        ..Panel::new(format!("{} column: front", column.name), "t (s)", "x (cm)")
    });
    panels.push(Panel {
        headroom: 0.2,
        curves: vec![Curve::known("measured", until(measured)), Curve::measured("computed", pressures)],
        ..Panel::new(format!("{} column: pore pressure", column.name), "t (s)", "pressure (Pa)")
    });
    Ok(Outcome { findings, panels })
}

/// A curve in other units.
fn scaled(points: Points, factors: [f64; 2]) -> Points {
    points.into_iter().map(|(x, y)| (factors[0] * x, factors[1] * y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_have_what_is_compared() {
        for column in &COLUMNS {
            for at in column.profiles {
                let profile = column.profile(*at);
                assert!(profile.len() > 10 && front(&profile) > FOOT, "{} at {at} s", column.name);
            }
            let loose = column.name == "loose";
            let pressures = column.over_time(PRESSURES);
            assert!((pressures[0].1 > 0.0) == loose && pressures[0].0 < column.end, "{}", column.name);
            assert!(column.over_time(FRONTS).len() >= 10);
        }
    }

    #[test]
    fn profiles_are_as_far_apart_as_their_mean_distance() {
        let step = [(0.0, 0.04), (0.06, 0.04), (0.0601, 0.0)];
        let lower = [(0.0, 0.03), (0.06, 0.03), (0.0601, 0.0)];
        assert!((apart(&lower, &step, 0.04) - 0.25).abs() < 1e-2);
        assert!(apart(&step, &step, 0.04) == 0.0);
    }
}
