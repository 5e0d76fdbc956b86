//! What a study shows: a table, a CSV file, plots, and one sentence per quantity.

use super::file::{Clock, Quantity, Reference, Study};
use super::plan::{Plan, plain, shown};
use super::results::{Line, Point, cheapest};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::bars::{self, Bar};
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_campaign::progress::duration;
use voidage_coupling::{Error, Result};
use voidage_scene::recorder::write_whole;

/// Writes `results.csv` and draws `NAME.png` and `NAME-phases.png`; their paths.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, name: &str, study: &Study, plan: &Plan, lines: &[Line]) -> Result<Vec<PathBuf>> {
    let table = folder.join("results.csv");
    let text = csv(study, plan, lines)?;
    write_whole(&table, |file| file.write_all(&text))?;
    let mut written = vec![table];
    // One quantity: both panels side by side; more: two rows.
    let (columns, panels) = match study.reference {
        Reference::None => (study.quantities.len().min(2), drawn_values(study, lines)),
        _ => (study.quantities.len().max(2), drawn(study, lines)),
    };
    if !panels.is_empty() {
        written.push(folder.join(format!("{name}.png")));
        panels::grid(&written[1], columns, &panels)?;
    }
    let phases = folder.join(format!("{name}-phases.png"));
    bars::draw(&phases, &format!("{}: wall time of the finest run by phase", study.title), &bars_of(lines))?;
    written.push(phases);
    Ok(written)
}

/// Names of the values of a quantity, one per time.
fn value_names(quantity: &Quantity) -> Vec<String> {
    let name = quantity.name.replace(' ', "_");
    match quantity.at.as_slice() {
        [] | [_] => vec![name],
        times => times.iter().map(|time| format!("{name}_at_{time}_s")).collect(),
    }
}

/// Keys that differ between runs.
fn varied(plan: &Plan) -> Vec<String> {
    let keys: BTreeSet<&String> = plan.runs.iter().flat_map(|run| run.settings.keys()).collect();
    let first = plan.runs.first();
    let differs = |key: &&&String| {
        plan.runs.iter().any(|run| run.settings.get(**key) != first.and_then(|f| f.settings.get(**key)))
    };
    keys.iter().filter(differs).map(|key| (*key).clone()).collect()
}

/// One row per point of a curve.
fn csv(study: &Study, plan: &Plan, lines: &[Line]) -> Result<Vec<u8>> {
    let keys = varied(plan);
    let all = || lines.iter().flat_map(|line| line.points.iter().map(move |point| (line, point)));
    let phases: BTreeSet<String> = all().flat_map(|(_, point)| point.row.phases().into_keys()).collect();
    let mut header: Vec<String> = vec!["curve".into(), "run".into()];
    header.extend(keys.iter().cloned());
    let values = matches!(study.reference, Reference::None);
    match values {
        true => header.extend(study.quantities.iter().flat_map(value_names)),
        false => {
            let of = |quantity: &Quantity| format!("error_of_{}", quantity.name.replace(' ', "_"));
            header.extend(study.quantities.iter().map(of));
            header.push("is_reference".into());
        }
    }
    header.extend(["wall_s", "steps_s", "steps_cpu_s", "cpu_s", "spread", "repeats"].map(String::from));
    header.extend(["steps", "fluid_solves", "unconverged_steps"].map(String::from));
    header.extend(phases.iter().map(|phase| format!("{phase}_s")));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let failed = |error: csv::Error| Error::run(format!("cannot write the table: {error}"));
    writer.write_record(&header).map_err(failed)?;
    for (line, point) in all() {
        let row = &point.row;
        let mut record = vec![line.name.clone(), row.run.clone()];
        let settings = &plan.runs[point.run].settings;
        record.extend(keys.iter().map(|key| settings.get(key).map_or(String::new(), shown)));
        match values {
            true => {
                let all = (0..study.quantities.len()).flat_map(|k| row.values_of(k));
                record.extend(all.map(|value| value.to_string()));
            }
            false => {
                record.extend(point.errors.iter().map(f64::to_string));
                record.push(point.is_reference.to_string());
            }
        }
        record.extend(
            [row.wall_s, row.steps_s, row.steps_cpu_s, row.cpu_s, row.spread]
                .map(|number| number.to_string()),
        );
        record.extend([row.repeats.to_string(), row.steps.to_string()]);
        record.push(row.fluid_solves.map_or(String::new(), |count| count.to_string()));
        record.push(row.unconverged_steps.to_string());
        let spent = row.phases();
        record.extend(phases.iter().map(|phase| spent.get(phase).map_or(String::new(), f64::to_string)));
        writer.write_record(&record).map_err(failed)?;
    }
    writer.into_inner().map_err(|error| Error::run(format!("cannot write the table: {error}")))
}

/// What the axis of time says.
fn clock(study: &Study) -> &'static str {
    match study.time {
        Clock::Wall => "wall time (s)",
        Clock::Steps => "wall time of the steps (s)",
        Clock::Cpu => "processor time of the steps (s)",
    }
}

/// Largest power of the time that is shown.
const STEEPEST: f64 = 8.0;

/// Error against time for every quantity, then against what is refined.
fn drawn(study: &Study, lines: &[Line]) -> Vec<Panel> {
    let mut labels: Vec<&str> = lines.iter().map(|line| line.label.as_str()).collect();
    labels.dedup();
    let quantities = 0..study.quantities.len();
    let timed = quantities.clone().map(|k| {
        // Where the error changes and the time hardly does, there is no power.
        let power = |line: &Line| line.power(k).filter(|power| power.abs() <= STEEPEST);
        let name = |line: &Line| named(line, power(line).map(|power| format!("time^{}", minus(power))));
        let curve = |(place, line): (usize, &Line)| Curve {
            place: Some(place),
            ..Curve::joined(name(line), places(line, k, |point| point.time))
        };
        panel(study, k, clock(study), lines.iter().enumerate().map(curve).collect())
    });
    let refined = quantities.map(|k| {
        let order = |line: &Line| line.order(k).map(|order| format!("order {}", minus(order)));
        // Curves that lie on each other are drawn as one.
        let mut groups: Vec<(&Line, Curve)> = Vec::new();
        for (place, line) in lines.iter().enumerate() {
            let points = places(line, k, |point| point.x);
            match groups.iter_mut().find(|(_, curve)| coincide(&curve.points, &points)) {
                Some((_, curve)) => curve.name.push_str(&format!(", {}", line.name)),
                None => {
                    let curve = Curve::joined(named(line, None), points);
                    groups.push((line, Curve { place: Some(place), ..curve }));
                }
            }
        }
        let with_order = |(line, mut curve): (&Line, Curve)| {
            curve.name.push_str(&order(line).map_or(String::new(), |order| format!(": {order}")));
            curve
        };
        panel(study, k, &labels.join(", "), groups.into_iter().map(with_order).collect())
    });
    timed.chain(refined).collect()
}

/// Values against what is refined, where something is.
fn drawn_values(study: &Study, lines: &[Line]) -> Vec<Panel> {
    let lines: Vec<&Line> = lines.iter().filter(|line| line.refine.is_some()).collect();
    let Some(first) = lines.first() else { return vec![] };
    let panel = |(k, quantity): (usize, &Quantity)| {
        let curves = lines.iter().flat_map(|line| {
            let times = quantity.at.len().max(1);
            (0..times).map(move |i| {
                let time = quantity.at.get(i).filter(|_| times > 1).map(|time| format!("at {time} s"));
                let names = [Some(line.name.clone()).filter(|name| !name.is_empty()), time];
                let name = names.into_iter().flatten().collect::<Vec<_>>().join(", ");
                let of = |point: &Point| Some((point.x, *point.row.values_of(k).get(i)?));
                let mut points: Vec<_> = line.points.iter().filter_map(of).collect();
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                Curve::joined(if name.is_empty() { "runs".into() } else { name }, points)
            })
        });
        let mut panel = Panel::new(study.title.as_str(), first.label.as_str(), quantity.name.as_str());
        panel.curves = curves.collect();
        panel
    };
    study.quantities.iter().enumerate().map(panel).collect()
}

/// The name of a curve, with what is said about it.
fn named(line: &Line, what: Option<String>) -> String {
    let name = if line.name.is_empty() { "runs" } else { &line.name };
    what.map_or(name.to_owned(), |what| format!("{name}: {what}"))
}

/// The points of a curve of a quantity.
fn places(line: &Line, quantity: usize, x: fn(&Point) -> f64) -> Vec<(f64, f64)> {
    let points = line.points.iter().filter(|point| !point.is_reference);
    points.map(|point| (x(point), point.errors[quantity])).collect()
}

/// Whether two curves cannot be told apart in a plot.
fn coincide(a: &[(f64, f64)], b: &[(f64, f64)]) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 0.01 * a.abs().max(b.abs());
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| near(a.0, b.0) && near(a.1, b.1))
}

/// Curves with the line of the error that is looked for.
fn panel(study: &Study, quantity: usize, label: &str, curves: Vec<Curve>) -> Panel {
    let name = &study.quantities[quantity].name;
    let title = if study.quantities.len() == 1 { format!("{}: {name}", study.title) } else { name.clone() };
    let mut panel = Panel::log_log(title, label, "relative error");
    panel.curves = curves.into_iter().filter(|curve| !curve.points.is_empty()).collect();
    let all = panel.curves.iter().flat_map(|curve| &curve.points).filter(|point| point.1 > 0.0);
    let (low, high) = all.fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), p| (l.min(p.0), h.max(p.0)));
    if low < high {
        let line = vec![(low, study.target), (high, study.target)];
        panel.curves.push(Curve::dashes(percent(study.target), line));
    }
    panel.headroom = 0.1 + 0.07 * panel.curves.len() as f64;
    panel
}

fn minus(number: f64) -> String {
    format!("{number:.2}").replace('-', "\u{2212}")
}

fn percent(share: f64) -> String {
    format!("{} %", 1e2 * share)
}

/// The finest run of each curve.
fn bars_of(lines: &[Line]) -> Vec<Bar> {
    let finest = lines.iter().filter_map(|line| Some((line, line.points.last()?)));
    let bar = |(line, point): (&Line, &Point)| {
        let mut parts: Vec<(String, f64)> = point.row.phases().into_iter().collect();
        let known: f64 = parts.iter().map(|(_, seconds)| seconds).sum();
        parts.push(("set-up".into(), (point.row.wall_s - point.row.steps_s).max(0.0)));
        parts.push(("other".into(), (point.row.steps_s - known).max(0.0)));
        let last = line.refine.as_ref().map(|key| key.rsplit('.').next().unwrap_or(key));
        let place = last.map(|key| format!("{key} {}", plain(point.x)));
        let names = [Some(line.name.clone()).filter(|name| !name.is_empty()), place];
        Bar { name: names.into_iter().flatten().collect::<Vec<_>>().join(", "), parts }
    };
    finest.map(bar).collect()
}

/// Prints the table, and per quantity the settings that reach the target in the least time.
pub fn print(study: &Study, plan: &Plan, lines: &[Line]) {
    if matches!(study.reference, Reference::None) {
        return print_values(study, plan, lines);
    }
    lines.iter().for_each(|line| print_line(study, line));
    let keys = varied(plan);
    for (k, quantity) in study.quantities.iter().enumerate() {
        let target = percent(study.target);
        match cheapest(lines, k, study.target) {
            Some((_, point)) => {
                let settings = &plan.runs[point.run].settings;
                let chosen =
                    keys.iter().filter_map(|key| Some(format!("{key} = {}", shown(settings.get(key)?))));
                println!(
                    "{}: {target} for the least time: {}: {:.2} % in {}",
                    quantity.name,
                    chosen.collect::<Vec<_>>().join(", "),
                    1e2 * point.errors[k],
                    duration(point.time)
                );
            }
            None => println!("{}: no run is within {target}", quantity.name),
        }
    }
    let spreads = lines.iter().flat_map(|line| line.points.iter().map(|point| point.row.spread));
    let mut spreads: Vec<f64> = spreads.collect();
    spreads.sort_by(f64::total_cmp);
    if let (Some(worst), true) = (spreads.last(), study.repeats > 1) {
        let usual = 1e2 * spreads[spreads.len() / 2];
        println!("repetitions differ by {usual:.0} % in the {}, {:.0} % at worst", clock(study), 1e2 * worst);
    }
}

/// The values of all runs, beside what is varied.
fn print_values(study: &Study, plan: &Plan, lines: &[Line]) {
    let keys = varied(plan);
    let names = study.quantities.iter().flat_map(value_names);
    let header = keys.iter().cloned().chain(names).chain(["wall".into(), "unconv.".into()]);
    let mut table: Vec<Vec<String>> = vec![header.collect()];
    for point in lines.iter().flat_map(|line| &line.points) {
        let settings = &plan.runs[point.run].settings;
        let chosen = keys.iter().map(|key| settings.get(key).map_or(String::new(), shown));
        let values = (0..study.quantities.len()).flat_map(|k| point.row.values_of(k));
        let cost = [duration(point.row.wall_s), point.row.unconverged_steps.to_string()];
        table.push(chosen.chain(values.map(|value| format!("{value:.5e}"))).chain(cost).collect());
    }
    let columns = table[0].len();
    let width = |k: usize| table.iter().map(|row| row.get(k).map_or(0, |cell| cell.chars().count())).max();
    let widths: Vec<usize> = (0..columns).map(|k| width(k).unwrap_or(0)).collect();
    for row in &table {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}"));
        println!("{}", cells.collect::<Vec<_>>().join("  "));
    }
}

/// The table of a curve.
fn print_line(study: &Study, line: &Line) {
    let refine = line.refine.as_deref().unwrap_or_default();
    let last = refine.rsplit('.').next().unwrap_or(refine);
    println!("{}", if line.name.is_empty() { &study.title } else { &line.name });
    let width = |k: usize| study.quantities[k].name.len().max(9) + 2;
    let quantities = || 0..study.quantities.len();
    let names: String =
        quantities().map(|k| format!("{:>w$}  order", study.quantities[k].name, w = width(k))).collect();
    println!("  {last:>12}{names}{:>11}{:>11}{:>7}{:>8}{:>8}", "time", "wall", "+-", "solves", "unconv.");
    for (n, point) in line.points.iter().enumerate() {
        let upto = Line { points: line.points[..=n].to_vec(), ..line.clone() };
        let error = |k: usize| {
            if point.is_reference {
                return format!("{:>w$}       ", "reference", w = width(k));
            }
            let order = upto.order(k).map_or(String::new(), |order| format!("{order:.2}"));
            format!("{:>w$.3e}{order:>7}", point.errors[k], w = width(k))
        };
        let solves = point.row.fluid_solves.map_or(String::new(), |count| count.to_string());
        println!(
            "  {:>12}{}{:>11}{:>11}{:>5.0} %{solves:>8}{:>8}",
            plain(point.x),
            quantities().map(error).collect::<String>(),
            duration(point.time),
            duration(point.row.wall_s),
            1e2 * point.row.spread,
            point.row.unconverged_steps
        );
    }
}
