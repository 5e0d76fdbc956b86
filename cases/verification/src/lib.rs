//! `voidage verify`: problems with known answers, solved and compared.
//!
//! A case is one file: what is solved, where the answer comes from, and the findings. The quick forms are part of the
//! tests; the full forms are what the page of this folder claims.

mod case;
pub mod coupled;
pub mod fluid;
pub mod grains;
mod jet;
pub mod models;
pub mod norms;
mod record;

pub use case::{Case, Finding, Outcome};
pub use grains::scene::line;

use clap::Args;
use record::Record;
use std::collections::BTreeMap;
use std::time::Instant;
use tracing::warn;
use voidage_campaign::plot::panels::{self, Panel};
use voidage_campaign::points::{self, Concurrency, Points, Scale};
use voidage_campaign::process::start_threads;
use voidage_campaign::progress::duration;
use voidage_campaign::{Effort, Suite};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::recorder::create_folder;

/// Options of `voidage verify`.
#[derive(Args)]
pub struct Options {
    /// What commands with many runs share.
    #[command(flatten)]
    pub suite: Suite,
    /// Only the case or group of this name (may be repeated).
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Coupling scheme, instead of those of the problems: one that is shipped, or python:FILE[:CLASS]. Their bounds stay.
    #[arg(long, value_parser = voidage_campaign::scheme)]
    scheme: Option<SchemeName>,
}

/// All cases, in the order in which they run.
pub fn cases() -> Vec<Case> {
    [fluid::CASES, coupled::CASES, grains::CASES].concat()
}

/// Solves the cases; exit code 1 if a finding is outside of what is allowed.
///
/// # Errors
/// Unknown names, files that cannot be written.
pub fn verify(options: &Options) -> Result<u8> {
    solve_all("verification", &cases(), options)
}

/// Solves those of `all` that are chosen, into tables and pictures of the name of the collection; exit code 1 if a
/// finding is outside of what is allowed.
///
/// # Errors
/// Unknown names, files that cannot be written.
pub fn solve_all(collection: &str, all: &[Case], options: &Options) -> Result<u8> {
    let (chosen, suite) = (choose(all, &options.only)?, &options.suite);
    if suite.list {
        list(&chosen);
        return Ok(0);
    }
    if let Some(scheme) = options.scheme {
        scheme.require()?;
        models::take_scheme(scheme);
    }
    start_threads(suite.threads)?;
    let folder = suite.folder(&format!("out/{collection}"));
    create_folder(&folder)?;
    let table = folder.join(format!("{collection}.csv"));
    let mut record = Record::create(&table)?;
    let mut drawn: BTreeMap<&str, Vec<Panel>> = BTreeMap::new();
    let (mut missed, mut count) = (0, 0);
    let points = Points {
        left: &chosen,
        scale: Scale::Count(0, "case"),
        name: &|_, case: &Case| case.name.into(),
        quiet: suite.quiet,
    };
    let timed = |case: &Case| {
        let start = Instant::now();
        Ok(Some((solve(case, suite.effort()), start.elapsed().as_secs_f64())))
    };
    points::run(&points, Concurrency::OneByOne, timed, |case, (outcome, wall)| {
        record.add(case, &outcome, wall)?;
        print(case, &outcome.findings, wall);
        missed += outcome.findings.iter().filter(|finding| !finding.passes()).count();
        count += outcome.findings.len();
        drawn.entry(case.group).or_default().extend(outcome.panels);
        Ok(())
    })?;
    for (group, panels) in drawn {
        for page in panels::pages(&folder, &format!("{collection}-{group}"), &panels)? {
            println!("{}", page.display());
        }
    }
    println!("{}", table.display());
    println!("{} of {count} findings are outside of what is allowed", missed);
    Ok(u8::from(missed > 0))
}

/// Solves a case. One that cannot be solved is a finding without a number, so that the others still run.
pub fn solve(case: &Case, effort: Effort) -> Outcome {
    (case.run)(effort).unwrap_or_else(|error| {
        warn!("{}: {error}", case.name);
        let failed = Finding::absolute("solved", "1", 1.0, f64::NAN, 0.0);
        Outcome { findings: vec![failed], ..Outcome::default() }
    })
}

/// The cases of the given names and groups, all without.
fn choose(all: &[Case], names: &[String]) -> Result<Vec<Case>> {
    let named = |case: &Case, name: &String| case.name == name || case.group == name;
    if let Some(name) = names.iter().find(|name| !all.iter().any(|case| named(case, name))) {
        let mut known: Vec<&str> = all.iter().map(|case| case.group).collect();
        known.dedup();
        known.extend(all.iter().map(|case| case.name));
        let help = format!("use one of {}", known.join(", "));
        return Err(Error::input(Notice::new(format!("--only {name}: there is no such case"), help)));
    }
    let chosen = |case: &&Case| names.is_empty() || names.iter().any(|name| named(case, name));
    Ok(all.iter().filter(chosen).copied().collect())
}

fn list(cases: &[Case]) {
    let width = cases.iter().map(|case| case.name.len()).max().unwrap_or(0);
    for Case { name, group, title, source, .. } in cases {
        println!("{group:<8} {name:<width$}  {title}\n{:<width$}           {source}", "");
    }
}

/// The table of one case, when it is done.
fn print(case: &Case, findings: &[Finding], wall: f64) {
    println!("{}: {} ({})", case.name, case.title, duration(wall));
    for finding in findings {
        let [low, high] = finding.allowed;
        let allowed = match (low.is_finite(), high.is_finite()) {
            (true, true) => {
                format!("{} +- {:.1e}", number(finding.expected), (0.5 * (high - low)))
            }
            (true, false) => format!(">= {}", number(low)),
            _ => format!("<= {}", number(high)),
        };
        let verdict = if finding.passes() { "ok" } else { "MISSED" };
        let order = finding.order.map_or(String::new(), |order| format!("  order {order:.2}"));
        println!(
            "    {:<58} {:>13} {:<9} {allowed:<26} {verdict}{order}",
            finding.quantity,
            number(finding.measured),
            finding.unit
        );
    }
}

/// A number for reading: plain where it is of a handy size.
fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e5).contains(&size) => {
            let digits = (4 - size.log10().floor() as i32).clamp(0, 7) as usize;
            format!("{value:.digits$}")
        }
        _ => format!("{value:.4e}"),
    }
}
