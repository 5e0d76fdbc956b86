//! `voidage study`: error against run time.
//!
//! A study names a case, what its results are compared with, and what is varied (`file`). Its runs are written out,
//! checked and put in the order of cost (`plan`), each done in a process of its own (`child`, `measure`) and recorded
//! when it is done (`record`); errors, orders and plots follow from the record (`results`, `report`).

mod child;
mod cost;
mod fields;
mod file;
mod measure;
mod plan;
mod problems;
mod record;
mod report;
mod results;

pub use file::Study;
pub use measure::measure;

use child::Ended;
use clap::Args;
use measure::Task;
use plan::{Changes, Plan, Run};
use record::{Record, Row};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use tracing::warn;
use voidage_campaign::points::{self, Concurrency, Points, Scale};
use voidage_campaign::process::catch_interrupts;
use voidage_campaign::suite::Suite;
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::recorder::create_folder;

/// Options of `voidage study`. Threads are those of each run, 1 unless the study says otherwise.
#[derive(Args)]
pub struct Options {
    /// Study file (TOML).
    study: PathBuf,
    #[command(flatten)]
    suite: Suite,
    /// Which part of the runs to do, from 0, of --count; a later call without it puts the parts together.
    #[arg(long, value_name = "I", requires = "count")]
    index: Option<usize>,
    /// How many parts there are.
    #[arg(long, value_name = "N", requires = "index")]
    count: Option<usize>,
}

impl Options {
    /// Whether lines are few.
    pub fn quiet(&self) -> bool {
        self.suite.quiet
    }
}

/// Runs a study; exit code 1 if a run failed or it was interrupted.
///
/// # Errors
/// A wrong study, files that cannot be written.
pub fn study(options: &Options) -> Result<u8> {
    let mut study = Study::read(&options.study)?;
    let quick = options.suite.quick;
    if quick {
        study.shorten();
    }
    let plan = Plan::new(&study, Changes { quick, threads: options.suite.threads })?;
    let name = options.study.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (mine, file) = part(options, &plan)?;
    if options.suite.list {
        list(&plan, &mine);
        return Ok(0);
    }
    let folder = options.suite.folder(&format!("out/study-{name}"));
    create_folder(&folder)?;
    let mut record = Record::open(&folder, &file)?;
    let interrupted = catch_interrupts()?;
    let work = Work { study: &study, folder: &folder, interrupted: &interrupted };
    let failed = work.through(&mine, &mut record, options.suite.quiet)?;
    let stopped = interrupted.load(Ordering::Relaxed);
    if options.index.is_some() {
        println!("{}", folder.join(file).display());
        return Ok(u8::from(stopped || failed > 0));
    }
    let lines = results::lines(&study, &plan, &record, &folder)?;
    report::print(&study, &plan, &lines);
    for path in report::write(&folder, &name, &study, &plan, &lines)? {
        println!("{}", path.display());
    }
    if stopped {
        warn!("interrupted; the same command goes on where it stopped");
    }
    Ok(u8::from(stopped || failed > 0))
}

/// The runs of this process, and the name of its file.
fn part<'a>(options: &Options, plan: &'a Plan) -> Result<(Vec<&'a Run>, String)> {
    let (Some(index), Some(count)) = (options.index, options.count) else {
        return Ok((plan.runs.iter().collect(), "measured.csv".into()));
    };
    if index >= count {
        let help = "parts are numbered from 0 to --count less 1";
        let what = format!("--index {index} --count {count}: there is no such part");
        return Err(Error::input(Notice::new(what, help)));
    }
    // Every part gets cheap and dear runs.
    Ok((plan.runs.iter().skip(index).step_by(count).collect(), format!("measured-{index}-of-{count}.csv")))
}

fn list(plan: &Plan, mine: &[&Run]) {
    for run in mine {
        let is_reference = plan.reference.is_some_and(|k| plan.runs[k].id == run.id);
        let note = if is_reference { "  (reference)" } else { "" };
        println!("{}  {:>9.2e}  {}{note}", run.id, run.cost, plan::short(&run.settings));
    }
    println!(
        "{} runs of {}",
        mine.len(),
        plan.runs.first().map_or("nothing".into(), |run| plan::name_of(&run.case))
    );
}

/// What all runs of a study share.
struct Work<'a> {
    study: &'a Study,
    folder: &'a Path,
    interrupted: &'a AtomicBool,
}

impl Work<'_> {
    /// Does the runs that are not there yet; how many failed.
    fn through(&self, runs: &[&Run], record: &mut Record, quiet: bool) -> Result<usize> {
        let is_there = |record: &Record, run: &Run| {
            let files = !self.needs_fields() || results::fields_of(self.folder, &run.id).is_file();
            record.row(run).is_some_and(Row::is_done) && files
        };
        let left: Vec<&Run> = runs.iter().copied().filter(|run| !is_there(record, run)).collect();
        let before = runs.len() - left.len();
        let points = Points {
            left: &left,
            scale: Scale::Cost(|run: &&Run| run.cost),
            name: &|k, run| {
                format!("run {} of {}: {}", before + k + 1, runs.len(), plan::short(&run.settings))
            },
            quiet,
        };
        let mut failed = 0;
        // One after the other: they are timed.
        points::run(
            &points,
            Concurrency::OneByOne,
            |run| self.one(run),
            |_, row| {
                failed += usize::from(!row.is_done());
                record.add(row)
            },
        )?;
        Ok(failed)
    }

    fn needs_fields(&self) -> bool {
        self.study.quantities.iter().any(|quantity| matches!(quantity.of, file::Of::Field(_)))
    }

    /// One run; none if it was interrupted.
    fn one(&self, run: &Run) -> Result<Option<Row>> {
        let fields = results::fields_of(self.folder, &run.id);
        let task = Task { run: run.clone(), fields, log: self.folder.join(format!("solver-{}.log", run.id)) };
        match child::run(&task, self.study.repeats, self.study.time, self.interrupted)? {
            Ended::Interrupted => Ok(None),
            Ended::Done(timed) => Ok(Some(Row::done(run, &timed))),
            Ended::Failed(why) => {
                let row = Row::failed(run, &why);
                warn!("{}: {why}", row.settings);
                Ok(Some(row))
            }
            Ended::Wrong(quantity, message, help) => {
                Err(self.study.error(&format!("quantities[{quantity}].of"), message, help))
            }
        }
    }
}
