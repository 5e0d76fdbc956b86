//! Stacks and random beds of any height come to rest and stay there, with default settings.

use super::scene::{G, rubbing, v};
use crate::models::alike;
use crate::{Case, Finding, Outcome};
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_campaign::{Effort, largest, worse};
use voidage_coupling::Result;
use voidage_dem::packing::{Amount, Fill, Method, Radii, Region, pour, unobserved};
use voidage_dem::{Dem, Load, Material, Particles, Settings, Wall};

/// The case.
pub const CASE: Case = Case {
    name: "rest",
    group: "grains",
    title: "stacks of discs and random beds that were built at rest, of tens to hundreds of rows, stay at rest",
    source: "exact: at rest nothing moves; in a random bed single grains first find their holes",
    run,
};

/// Time step, s.
const STEP: f64 = 5e-4;
/// Mean diameter of the random beds, m, and their width in it.
const DIAMETER: f64 = 50e-6;
const WIDTH: f64 = 50.0;

/// Time after which a stack must rest, s; and a random bed, in the time of a free fall over its height: grain by grain
/// it was built, and the last of them find their holes when what lies below them has settled.
const STACK_RESTS: f64 = 0.02;
const FALLS: f64 = 3.0;

/// What is seen of a bed.
struct Seen {
    name: String,
    /// Largest and root mean square speed after the time of settling, over g dt.
    speed: [f64; 2],
    /// Largest departure of the mean height from that at the time of settling, and rise above and depth below the start
    /// at any time, in diameters.
    moved: f64,
    rose: f64,
    sank: f64,
    /// Steps after that time whose contacts were not solved.
    unsolved: usize,
    /// Mean height above the start in diameters, over time.
    heights: Vec<(f64, f64)>,
}

/// Steps of a bed, judged from `settled` seconds on.
fn watch(name: String, mut dem: Dem<2>, diameter: f64, settled: f64, steps: usize) -> Seen {
    let count = dem.particles.len() as f64;
    let height = |dem: &Dem<2>| dem.particles.position.iter().map(|x| x.y).sum::<f64>() / count / diameter;
    let start = height(&dem);
    let mut seen = Seen {
        name,
        speed: [0.0; 2],
        moved: 0.0,
        rose: 0.0,
        sank: 0.0,
        unsolved: 0,
        heights: vec![(0.0, 0.0)],
    };
    let mut rest = 0.0;
    for k in 1..=steps {
        let report = dem.step(STEP, &Load::default());
        let (time, now) = (k as f64 * STEP, height(&dem) - start);
        seen.heights.push((time, now));
        (seen.rose, seen.sank) = (worse(seen.rose, now), worse(seen.sank, -now));
        if time <= settled * (1.0 + 1e-9) {
            rest = now;
            continue;
        }
        seen.unsolved += usize::from(!report.converged);
        let squares = || dem.particles.velocity.iter().map(|v| v.norm_squared());
        let fastest = largest(squares());
        let mean = squares().sum::<f64>() / count;
        for (most, square) in seen.speed.iter_mut().zip([fastest, mean]) {
            *most = worse(*most, square.sqrt() / (G * STEP));
        }
        seen.moved = worse(seen.moved, (now - rest).abs());
    }
    seen
}

/// A stack of discs of 1 mm on a floor, from a cold start.
fn stack(count: usize, steps: usize) -> Result<Seen> {
    let material = Material { density: 2500.0, ..Material::default() };
    let (radius, floor) = (0.5e-3, Wall::new("floor", v(-1.0, 0.0), v(1.0, 0.0)));
    let places = (0..count).map(|k| v(0.0, radius * (1 + 2 * k) as f64)).collect();
    let grains = alike(places, radius, &material)?;
    let dem = Dem::new(grains, vec![floor], vec![material], Settings::default())?;
    Ok(watch(format!("stack of {count}"), dem, 2.0 * radius, STACK_RESTS, steps))
}

/// A bed of discs of 44 to 55 um, dropped and rolled between rough walls.
fn bed(rows: usize, steps: usize, settings: Settings<2>) -> Result<Seen> {
    let friction = 0.3;
    let materials = [Material { density: 3200.0, ..rubbing(friction) }];
    let width = WIDTH * DIAMETER;
    let fill = Fill {
        radii: Radii::Uniform { min: 0.44 * DIAMETER, max: 0.55 * DIAMETER },
        amount: Amount::Count(rows * WIDTH as usize),
        material: 0,
        materials: &materials,
        seed: 1,
    };
    let top = 2.0 * rows as f64 * DIAMETER;
    let region = Region { low: v(0.0, 0.0), high: v(width, top) };
    let grains: Particles<2> = pour(&region, &[], &fill, Method::DropAndRoll, &mut unobserved)?.rotating();
    let wall = |name: &str, from, to| Wall { friction, ..Wall::new(name, from, to) };
    let walls = vec![
        wall("floor", v(0.0, 0.0), v(width, 0.0)),
        wall("left", v(0.0, 0.0), v(0.0, top)),
        wall("right", v(width, 0.0), v(width, top)),
    ];
    let height = rows as f64 * DIAMETER;
    let dem = Dem::new(grains, walls, materials.to_vec(), settings)?;
    Ok(watch(format!("bed of {rows} rows"), dem, DIAMETER, FALLS * (2.0 * height / G).sqrt(), steps))
}

/// What a bed must keep: speeds over g dt and heights in diameters.
fn findings(seen: &Seen, speed: f64, mean: f64, height: f64) -> [Finding; 5] {
    let name = |what: &str| format!("{what}, {}", seen.name);
    [
        Finding::at_most(name("largest speed / (g dt)"), "1", speed, seen.speed[0]),
        Finding::at_most(name("root mean square speed / (g dt)"), "1", mean, seen.speed[1]),
        Finding::at_most(name("mean height moved / diameter"), "1", height, seen.moved),
        Finding::at_most(name("mean height above the start / diameter"), "1", height, seen.rose),
        Finding::at_most(name("mean height below the start / diameter"), "1", height, seen.sank),
    ]
}

/// Tolerance whose impulses count as exact, and how much deeper than with them a bed may settle, in diameters: what a
/// bed settles by is a matter of how it was built, and what is more than that is the error of its impulses.
const EXACT: f64 = 1e-4;
const OFF: f64 = 2e-3;

fn run(effort: Effort) -> Result<Outcome> {
    let steps = effort.pick(200, 1000);
    let mut outcome = Outcome::default();
    let (mut stacks, mut beds, mut unsolved) = (vec![], vec![], vec![]);
    for &count in effort.pick::<&[usize]>(&[20, 100, 400], &[20, 100, 400, 1600]) {
        let seen = stack(count, steps)?;
        outcome.findings.extend(findings(&seen, 1e-2, 1e-2, 1e-3));
        unsolved.push((seen.name.clone(), seen.unsolved));
        stacks.push(Curve::measured(seen.name, seen.heights));
    }
    for &rows in effort.pick::<&[usize]>(&[20], &[20, 100, 400]) {
        let seen = bed(rows, steps, Settings::default())?;
        outcome.findings.extend(findings(&seen, 0.3, 1e-2, 1e-2));
        if rows == 20 {
            let settings = Settings { tolerance: EXACT, max_sweeps: 20_000, ..Settings::default() };
            let depth = (seen.sank - bed(rows, steps, settings)?.sank).abs();
            let name = format!("depth besides that of exact impulses / diameter, {}", seen.name);
            outcome.findings.push(Finding::at_most(name, "1", OFF, depth));
        }
        unsolved.push((seen.name.clone(), seen.unsolved));
        beds.push(Curve::measured(seen.name, seen.heights));
    }
    for (name, count) in unsolved {
        outcome.findings.push(Finding::at_most(format!("steps not solved, {name}"), "1", 0.0, count as f64));
    }
    outcome.panels =
        [("Stacks from a cold start", 1e-6, stacks), ("Random beds from a cold start", 1e-3, beds)]
            .map(|(title, unit, mut curves)| {
                curves.iter_mut().flat_map(|curve| &mut curve.points).for_each(|(_, height)| *height /= unit);
                let label = format!("mean height moved / ({unit:e} diameters)");
                Panel { headroom: 0.25, curves, ..Panel::new(title, "time (s)", label) }
            })
            .into();
    Ok(outcome)
}
