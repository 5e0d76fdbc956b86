//! `voidage stability`: the map of what is stable, for every coupling scheme, against theory where there is one.
//!
//! An axis is one file: a system, two parameters, what is measured and what it should be. A point passes when nothing
//! grows and what is measured is what theory says. The default scheme must pass every point but those of steps that are
//! too long for all schemes; the others may fail where theory says so.

mod absorption;
mod axis;
mod bed;
mod contacts;
mod cost;
mod droplet;
mod fluidisation;
mod mesh;
mod modes;
mod pictures;
mod record;
mod settle;
mod vapour;
mod wet;

pub use axis::{Axis, Sample, Tally, Verdict};

use clap::Args;
use record::{Record, Row};
use tracing::warn;
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_campaign::points::{self, Concurrency, Points, Scale};
use voidage_campaign::process::start_threads;
use voidage_campaign::{Effort, Suite};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::recorder::create_folder;

/// Options of `voidage stability`.
#[derive(Args)]
pub struct Options {
    /// What commands with many runs share.
    #[command(flatten)]
    pub suite: Suite,
    /// Only the axis of this name (may be repeated).
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Only this scheme, or one of your own, python:FILE[:CLASS] (may be repeated).
    #[arg(long, value_name = "SCHEME", value_parser = voidage_campaign::scheme)]
    scheme: Vec<SchemeName>,
    /// Print what a step costs with each scheme, and stop.
    #[arg(long)]
    costs: bool,
}

/// All axes, in the order in which they run.
pub fn axes() -> Vec<Axis> {
    [
        modes::AXES,
        contacts::AXES,
        settle::AXES,
        mesh::AXES,
        vapour::AXES,
        droplet::AXES,
        wet::AXES,
        absorption::AXES,
        fluidisation::AXES,
        bed::AXES,
    ]
    .concat()
}

/// Runs the map; exit code 1 if the default scheme fails anywhere, but where theory says that every scheme must, or
/// passes there.
///
/// # Errors
/// Unknown names, files that cannot be written.
pub fn stability(options: &Options) -> Result<u8> {
    let (chosen, suite) = (choose(&options.only)?, &options.suite);
    if suite.list {
        for axis in &chosen {
            println!("{}: {} ({} over {})", axis.name, axis.title, axis.labels[1], axis.labels[0]);
        }
        return Ok(0);
    }
    options.scheme.iter().try_for_each(|scheme| scheme.require())?;
    start_threads(suite.threads)?;
    let folder = suite.folder("out/stability");
    create_folder(&folder)?;
    let effort = suite.effort();
    let schemes = if options.scheme.is_empty() { SchemeName::ALL.to_vec() } else { options.scheme.clone() };
    if options.costs {
        cost::print(&schemes)?;
        return Ok(0);
    }
    let mut record = Record::open(&folder, effort)?;
    let of = |axis: &Axis| match axis.coupled {
        true => schemes.iter().copied().filter(|scheme| axis.takes(*scheme)).collect(),
        false => vec![SchemeName::default()],
    };
    let mut points = Vec::new();
    for axis in &chosen {
        for point in (axis.points)(effort) {
            points.extend(of(axis).into_iter().map(|scheme| (axis, point, scheme)));
        }
    }
    map(&points, &mut record, effort, suite.quiet)?;
    record.arrange(&axes())?;
    let rows = || record.rows().iter().filter(|row| chosen.iter().any(|axis| axis.name == row.axis));
    for axis in &chosen {
        let drawn: Vec<Panel> =
            of(axis).into_iter().map(|scheme| panel(axis, scheme, record.rows())).collect();
        for page in panels::pages(&folder, axis.name, &drawn)? {
            println!("{}", page.display());
        }
    }
    for page in pictures::draw(&folder, &record)? {
        println!("{}", page.display());
    }
    for &scheme in &schemes {
        summarise(scheme, rows().filter(|row| row.scheme == scheme));
    }
    let mut default = rows().filter(|row| row.scheme == SchemeName::default());
    let as_it_must = |row: &Row| (row.verdict == Verdict::Passes) == row.theory_passes.unwrap_or(true);
    Ok(u8::from(!default.all(as_it_must)))
}

/// A point of the map.
type Point<'a> = (&'a Axis, [f64; 2], SchemeName);

/// Runs the points that are not in the record yet.
fn map(points: &[Point], record: &mut Record, effort: Effort, quiet: bool) -> Result<()> {
    let missing: Vec<Point> =
        points.iter().filter(|(axis, point, scheme)| !record.has(axis, *scheme, *point)).copied().collect();
    let points = Points {
        left: &missing,
        scale: Scale::Count(points.len() - missing.len(), "point"),
        name: &|_, (axis, ..): &Point| axis.name.into(),
        quiet,
    };
    let one = |(axis, point, scheme): &Point| Ok(Some(sample(axis, *point, *scheme, effort)));
    points::run(&points, Concurrency::Threads, one, |(axis, point, scheme), sample| {
        record.add(axis, *scheme, *point, &sample)
    })
}

/// Runs a point; one that ends with an error is a sample too.
pub fn sample(axis: &Axis, point: [f64; 2], scheme: SchemeName, effort: Effort) -> Sample {
    (axis.run)(point, scheme, effort).unwrap_or_else(|error| {
        warn!("{} at {point:?} with {scheme}: {error}", axis.name);
        Sample::new(Verdict::Failed, f64::NAN, f64::NAN, Tally::default())
    })
}

/// The axes of the given names, all without.
fn choose(names: &[String]) -> Result<Vec<Axis>> {
    let all = axes();
    if let Some(name) = names.iter().find(|name| !all.iter().any(|axis| axis.name == *name)) {
        let known: Vec<&str> = all.iter().map(|axis| axis.name).collect();
        let known = known.join(", ");
        let what = format!("--only {name}: there is no such axis");
        return Err(Error::input(Notice::new(what, format!("use one of {known}"))));
    }
    let wanted = |axis: &Axis| names.is_empty() || names.iter().any(|name| name == axis.name);
    Ok(all.into_iter().filter(wanted).collect())
}

/// One line about a scheme.
fn summarise<'a>(scheme: SchemeName, rows: impl Iterator<Item = &'a Row>) {
    let (mut all, mut passed, mut foreseen, mut known, mut solves) = (0, 0, 0, 0, 0.0);
    for row in rows {
        let passes = row.verdict == Verdict::Passes;
        all += 1;
        passed += usize::from(passes);
        known += usize::from(row.theory_passes.is_some());
        foreseen += usize::from(row.theory_passes == Some(passes));
        solves += if row.solves_per_step.is_finite() { row.solves_per_step } else { 1.0 };
    }
    let mean = solves / f64::from(all.max(1));
    println!(
        "{:<12} passes {passed:>4} of {all}; as theory says at {foreseen} of {known}; {mean:.2} solutions a step",
        scheme.to_string()
    );
}

/// The map of one scheme on an axis.
fn panel(axis: &Axis, scheme: SchemeName, rows: &[Row]) -> Panel {
    let of = |verdicts: &[Verdict]| {
        let here = rows.iter().filter(|row| row.axis == axis.name && row.scheme == scheme);
        here.filter(|row| verdicts.contains(&row.verdict)).map(|row| (row.x, row.y)).collect::<Vec<_>>()
    };
    // Named even where there are none, so that each keeps its colour.
    let points = |name: &str, verdicts: &[Verdict]| Curve::points(name, of(verdicts));
    let title = if axis.coupled { scheme.to_string() } else { axis.name.into() };
    let mut panel = Panel::log_log(title, axis.labels[0], axis.labels[1]);
    // An axis that starts at zero is linear.
    panel.log[0] = rows.iter().filter(|row| row.axis == axis.name).all(|row| row.x > 0.0);
    panel.headroom = 0.25;
    panel.curves = vec![
        points("passes", &[Verdict::Passes]),
        points("unstable", &[Verdict::Unstable, Verdict::Failed]),
        points("stable, wrong", &[Verdict::Wrong]),
    ];
    let limit = boundary(axis, scheme, rows);
    if !limit.is_empty() {
        panel.curves.push(Curve::dashes("limit by theory", limit));
    }
    panel
}

/// Where theory changes its mind along the second parameter, between the points of the axis.
fn boundary(axis: &Axis, scheme: SchemeName, rows: &[Row]) -> Vec<(f64, f64)> {
    let bounds = |value: fn(&Row) -> f64| {
        let values = rows.iter().filter(|row| row.axis == axis.name).map(value);
        values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)))
    };
    let ((left, right), (low, high)) = (bounds(|row| row.x), bounds(|row| row.y));
    let between = |(low, high): (f64, f64), share: f64| low * (high / low).powf(share);
    let mut limit = Vec::new();
    for i in 0..=200 {
        let x = between((left, right), f64::from(i) / 200.0);
        let passes = |k: i32| {
            let y = between((low, high), f64::from(k) / 400.0);
            ((axis.theory)([x, y], scheme), y)
        };
        let change = (0..400).find(|&k| passes(k).0 != passes(k + 1).0);
        limit.extend(change.map(|k| (x, passes(k).1)));
    }
    limit
}
