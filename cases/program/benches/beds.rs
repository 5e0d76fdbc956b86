//! What contacts cost in beds of 4 thousand to a million discs: built, from a cold start, at rest, and under an impact.
//!
//! `cargo bench -p voidage --bench beds -- [--sizes 4000,20000,90000] [--threads 1,2] [--impact 200] [--silos 1]
//! [--out DIR]` runs every bed in a process of its own and writes `beds.csv` (with the name of the machine) and
//! `beds.png`; beds that the table in DIR has of this machine and version are not run again. `--impact` is the number of
//! steps under the heavy disc. Discs of 44 to 55 um, dropped and rolled between rough walls, square beds up to 400 rows,
//! friction 0.3, steps of 0.5 ms, default settings. With several `--silos` a bed of that part of the discs settles, and
//! so many of it stand side by side with walls between them; only what that costs at rest is measured.

mod table;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use table::{Table, entry, numbers, option};
use voidage_campaign::plot::panels::{Curve, Panel, grid};
use voidage_dem::packing::{Amount, Fill, Method, Radii, Region, pour, unobserved};
use voidage_dem::{ContactForce, Cost, Dem, Load, Material, Particles, Partner, Settings, Vector, Wall};

const STEP: f64 = 5e-4;
const DIAMETER: f64 = 50e-6;
const FRICTION: f64 = 0.3;
const MOST_ROWS: f64 = 400.0;
/// Steps of the cold start, and at rest.
const COLD: usize = 1;
const REST: usize = 20;
/// The bed has settled when no grain has moved in so many steps in a row; so many steps at most.
const STILL: usize = 10;
const SETTLING: usize = 1000;
/// Progress is told every so many steps of a phase.
const TOLD: usize = 10;
/// The disc that is dropped: its diameter in those of the bed, and its speed, m/s.
const HEAVY: f64 = 50.0;
const SPEED: f64 = 0.17;

const HEADER: [&str; 15] = [
    "grains",
    "threads",
    "phase",
    "steps",
    "median_s",
    "mean_s",
    "sweeps_per_step",
    "bytes_per_grain",
    "substeps_per_step",
    "search_s",
    "sweeps_s",
    "measures_s",
    "corrections_s",
    "ns_a_relaxation",
    "asleep",
];

fn at(x: f64, y: f64) -> Vector<2> {
    Vector::<2>::new(x, y)
}

/// Memory that this process holds, bytes; 0 where the system does not tell.
fn resident() -> f64 {
    let kilobytes = entry("/proc/self/status", "VmRSS").and_then(|text| text.split(' ').next()?.parse().ok());
    1024.0 * kilobytes.unwrap_or(0.0)
}

/// The floor under so many silos of a width, and the walls at their sides from left to right.
fn walls(width: f64, silos: usize) -> Vec<Wall<2>> {
    let wall = |name: &str, from, to| Wall { friction: FRICTION, ..Wall::new(name, from, to) };
    let end = |silo: usize| width * silo as f64;
    let side = |silo: usize| wall(&format!("side {silo}"), at(end(silo), 0.0), at(end(silo), 1.0));
    std::iter::once(wall("floor", at(0.0, 0.0), at(end(silos), 0.0))).chain((0..=silos).map(side)).collect()
}

/// So many copies of a settled bed side by side, each in its silo, with the forces in it; the disc that hovers, the last
/// grain, stays behind.
fn copies(bed: &Dem<2>, width: f64, silos: usize) -> Dem<2> {
    let (from, count) = (&bed.particles, bed.particles.len() - 1);
    let of = |k: usize| (k % count, k / count);
    let place = |k: usize| from.position[of(k).0] + at(width * of(k).1 as f64, 0.0);
    let all = 0..count * silos;
    let positions = all.clone().map(place).collect();
    let radii = all.clone().map(|k| from.radius[of(k).0]).collect();
    let grains =
        Particles::new(positions, radii, vec![0; all.len()], bed.materials()).expect("columns of a length");
    let mut dem =
        Dem::new(grains.rotating(), walls(width, silos), bed.materials().to_vec(), bed.settings().clone())
            .expect("the scene is valid");
    let forces: Vec<ContactForce<2>> = bed.state().forces().collect();
    let shifted = |silo: usize| {
        let grain = move |grain: u32| grain + (silo * count) as u32;
        let partner = move |partner| match partner {
            Partner::Grain(other) => Partner::Grain(grain(other)),
            Partner::Wall(0) => Partner::Wall(0),
            Partner::Wall(side) => Partner::Wall(side + silo as u32),
        };
        forces.iter().map(move |f| ContactForce { grain: grain(f.grain), partner: partner(f.partner), ..*f })
    };
    dem.start_from(&(0..silos).flat_map(shifted).collect::<Vec<_>>());
    dem
}

/// Times of steps, and what they took.
#[derive(Default)]
struct Phase {
    seconds: Vec<f64>,
    cost: Cost,
}

impl Phase {
    /// So many steps of a bed, or fewer if nothing has moved in `STILL` of them in a row and it shall only `settle`; the
    /// disc, its last grain, hovers if `parked`.
    fn of(dem: &mut Dem<2>, steps: usize, settle: bool, parked: bool) -> Self {
        let mut phase = Self::default();
        let disc = dem.particles.len() - 1;
        let place = dem.particles.position[disc];
        let (begun, mut still) = (Instant::now(), 0);
        while phase.seconds.len() < steps && !(settle && still == STILL) {
            let start = Instant::now();
            phase.cost.add(&dem.step(STEP, &Load::default()).cost);
            phase.seconds.push(start.elapsed().as_secs_f64());
            let rests = dem.particles.velocity[..disc].iter().all(|v| *v == at(0.0, 0.0));
            still = if rests { still + 1 } else { 0 };
            if phase.seconds.len() % TOLD == 0 {
                eprintln!(
                    "{disc} discs: {} steps, {:.0} s",
                    phase.seconds.len(),
                    begun.elapsed().as_secs_f64()
                );
            }
            if parked {
                (dem.particles.position[disc], dem.particles.velocity[disc]) = (place, at(0.0, 0.0));
            }
        }
        phase
    }

    /// Prints a row of the table, without machine and version.
    fn print(mut self, name: &str, grains: usize, bytes: f64) {
        let steps = self.seconds.len() as f64;
        let mean = self.seconds.iter().sum::<f64>() / steps;
        self.seconds.sort_by(f64::total_cmp);
        let median = self.seconds[self.seconds.len() / 2];
        let cost = &self.cost;
        let share = |part: f64, of: f64| if of > 0.0 { part / of } else { 0.0 };
        let relaxed = cost.relaxations as f64;
        let parts = [cost.search_s, cost.sweeps_s, cost.measures_s, cost.corrections_s];
        println!(
            "{grains},{},{name},{steps},{median:.3e},{mean:.3e},{:.1},{bytes:.0},{:.1},{},{:.2},{:.2}",
            rayon::current_num_threads(),
            cost.sweeps as f64 / steps,
            cost.substeps as f64 / steps,
            parts.map(|part| format!("{:.2e}", part / steps)).join(","),
            share(1e9 * cost.sweeps_s, relaxed),
            share(cost.asleep as f64, relaxed + cost.asleep as f64),
        );
    }
}

/// All phases of one bed, or of several side by side.
fn bed(count: usize, silos: usize, impact: usize) {
    assert!(silos > 0 && count.is_multiple_of(silos), "--silos {silos} must divide {count} discs");
    let (all, count) = (count, count / silos);
    let materials = vec![Material { density: 3200.0, friction: FRICTION, ..Material::default() }];
    let rows = (count as f64).sqrt().min(MOST_ROWS);
    let width = DIAMETER * (count as f64 / rows).round();
    let fill = Fill {
        radii: Radii::Uniform { min: 0.44 * DIAMETER, max: 0.55 * DIAMETER },
        amount: Amount::Count(count),
        material: 0,
        materials: &materials,
        seed: 1,
    };
    let start = Instant::now();
    let region = Region { low: at(0.0, 0.0), high: at(width, 1.0) };
    let mut grains =
        pour(&region, &[], &fill, Method::DropAndRoll, &mut unobserved).expect("the region is high enough");
    let built = Phase { seconds: vec![start.elapsed().as_secs_f64()], cost: Cost::default() };
    if silos == 1 {
        built.print("built", count, 0.0);
    }
    let before = resident();
    let radius = 0.5 * HEAVY.min(0.25 * width / DIAMETER) * DIAMETER;
    let above = at(0.5 * width, highest(&grains) + 3.0 * radius);
    grains.append(Particles::new(vec![above], vec![radius], vec![0], &materials).expect("a disc"));
    let mut dem = Dem::new(grains.rotating(), walls(width, 1), materials, Settings::default())
        .expect("the scene is valid");
    if silos > 1 {
        Phase::of(&mut dem, SETTLING, true, true);
        let before = resident();
        let mut dem = copies(&dem, width, silos);
        let rest = Phase::of(&mut dem, REST, false, false);
        let moves = dem.particles.velocity.iter().filter(|v| **v != at(0.0, 0.0)).count();
        assert!(moves == 0, "{moves} of {all} discs are not at rest");
        rest.print(&format!("at rest in {silos} silos"), all, (resident() - before) / all as f64);
        return;
    }
    Phase::of(&mut dem, COLD, false, true).print("cold start", count, 0.0);
    Phase::of(&mut dem, SETTLING, true, true).print("settling", count, 0.0);
    let rest = Phase::of(&mut dem, REST, false, true);
    rest.print("at rest", count, (resident() - before) / count as f64);
    let disc = dem.particles.position.pop().expect("the disc is the last");
    let top = highest(&dem.particles);
    dem.particles.position.push(at(disc.x, top + radius + DIAMETER));
    dem.particles.velocity[count] = at(0.0, -SPEED);
    Phase::of(&mut dem, impact, false, false).print("impact", count, 0.0);
}

/// Height of the highest centre, m.
fn highest(grains: &Particles<2>) -> f64 {
    grains.position.iter().fold(0.0, |top, x| x.y.max(top))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (impact, silos) = (numbers("--impact", "200")[0], numbers("--silos", "1")[0]);
    if let [count] = numbers("--bed", "0")[..]
        && count > 0
    {
        bed(count, silos, impact);
        return Ok(());
    }
    let out = PathBuf::from(option("--out", "../../target/beds").remove(0));
    std::fs::create_dir_all(&out)?;
    let mut table = Table::open(out.join("beds.csv"), &HEADER)?;
    for size in numbers("--sizes", "4000,20000,90000") {
        for threads in numbers("--threads", "1,2") {
            let [size, threads] = [size, threads].map(|number| number.to_string());
            if table.has(&[&size, &threads]) {
                continue;
            }
            let mut run = Command::new(std::env::current_exe()?);
            run.args(["--bed", &size, "--impact", &impact.to_string(), "--silos", &silos.to_string()])
                .env("RAYON_NUM_THREADS", threads);
            let told = run.stderr(Stdio::inherit()).output()?;
            if !told.status.success() {
                return Err(format!("{size} grains: {}", told.status).into());
            }
            for line in String::from_utf8(told.stdout)?.lines() {
                let row: Vec<String> = line.split(',').map(String::from).collect();
                table.add(&row, |row| vec![row[0].parse().unwrap_or(0), row[1].parse().unwrap_or(0)])?;
            }
        }
    }
    draw(&out.join("beds.png"), &table.rows)?;
    Ok(())
}

/// Time of a step over the number of grains, a panel for each phase.
fn draw(path: &Path, rows: &[Vec<String>]) -> Result<(), Box<dyn std::error::Error>> {
    let mut panels = vec![];
    for (phase, title) in [
        ("cold start", "First step from a cold start"),
        ("at rest", "Step at rest"),
        ("impact", "Step under a heavy disc"),
    ] {
        let mut curves: Vec<Curve> = vec![];
        for row in rows.iter().filter(|row| row[4].starts_with(phase)) {
            let name = format!("{} thread{}", row[3], if row[3] == "1" { "" } else { "s" });
            let point = (row[2].parse()?, row[7].parse()?);
            match curves.iter_mut().find(|curve| curve.name == name) {
                Some(curve) => curve.points.push(point),
                None => curves.push(Curve::joined(name, vec![point])),
            }
        }
        panels.push(Panel { curves, ..Panel::log_log(title, "discs", "mean time of a step (s)") });
    }
    Ok(grid(path, panels.len(), &panels)?)
}
