//! The program `voidage`: runs scenes, checks them, and draws what a run left.
//!
//! Exit codes: 0 done; 1 the run failed (solver, disk) or was interrupted; 2 the input is wrong.

mod again;
mod analyse;
mod check;
mod closures;
mod compare;
mod doctor;
mod ending;
mod in_python;
mod keys;
mod new;
mod placing;
mod plot;
mod processor;
mod report;
mod results;
mod run;
mod sizes;

pub use voidage_campaign::shipped;

use clap::{CommandFactory, Parser, Subcommand};
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;
use voidage_campaign::progress;
use voidage_coupling::{Error, Result};
use voidage_remote::token::{TOKEN_VARIABLE, Token};
use voidage_remote::transport::Address;
use voidage_scene::{Scene, json_schema};
use voidage_studies::Study;

/// Discrete grains in a finite element fluid.
#[derive(Parser)]
#[command(
    name = "voidage",
    version,
    after_help = "Exit codes: 0 done; 1 the run failed or was interrupted; 2 the input is wrong."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write a commented scene to begin with, or a copy of a shipped case; never over an existing file.
    New(new::Options),
    /// Run a scene; Ctrl-C writes a checkpoint and ends cleanly (exit code 1).
    Run(run::Options),
    /// Show the same states to several fluid solvers, then run them side by side; exit code 1 if a step from the same
    /// state differs by more than the tolerance.
    Compare(compare::Options),
    /// Solve cases with known answers; exit code 1 if one is missed by more than is allowed.
    Verify(voidage_verification::Options),
    /// Run experiments that were measured; exit code 1 if one is missed by more than is allowed.
    Validate(voidage_verification::Options),
    /// Map what is stable: every coupling scheme over density, step, voidage and so on, against theory.
    Stability(voidage_stability::Options),
    /// Measure error against run time over mesh, step, tolerance, scheme, solver; goes on where it stopped. Exit code 1
    /// if a run failed.
    Study(voidage_studies::Options),
    /// One run of a study, for `study` itself.
    #[command(hide = true)]
    Measure,
    /// Do all of a run but its steps: read a scene, place its grains, make its mesh; say which parts are on, the sizes
    /// that tell a mistake, and what is out of its usual range.
    Check {
        /// Scene file (TOML), or the name of a shipped case.
        scene: PathBuf,
        /// Change a key of the scene: `grains[0].radius.constant=5e-4` (may be repeated).
        #[arg(long = "set", value_name = "KEY=VALUE")]
        sets: Vec<String>,
    },
    /// Draw the pictures of a run again from the files in its folder; with more folders, or --out, those that compare
    /// the droplets of runs.
    Plot {
        /// Also draw every frame into film/ with the same axes and colours, and join them to film.mp4 where there is an
        /// ffmpeg.
        #[arg(long)]
        film: bool,
        /// Folders of runs.
        #[arg(required = true, value_name = "FOLDER")]
        folders: Vec<PathBuf>,
        /// Folder of the pictures that compare runs. Default: the current one.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Analyse a run from the files in its folder: means with standard errors, spectra, height of the bed, bubbles,
    /// mixing, profiles, mean fields; what cannot be known is said.
    Analyse(analyse::Options),
    /// Draw all drag laws over voidage and Reynolds number, with the values as a table.
    Closures(closures::Options),
    /// Print all keys of a scene with their meaning, units and defaults: as JSON schema, or as a page.
    Schema {
        /// Those of a study.
        #[arg(long)]
        study: bool,
        /// As a page to read (Markdown), in the order of the file.
        #[arg(long)]
        markdown: bool,
    },
    /// Print `voidage.h`, with which a fluid solver in C or C++ talks with a run of this version.
    Header,
    /// Solve the fluid of a run in another process, with the Rust solver.
    Serve {
        /// Where the run is: `shm:NAME` or `tcp:HOST:PORT`.
        #[arg(long, value_name = "ADDRESS")]
        connect: Address,
        /// How long the run may take to be there, s.
        #[arg(long, value_name = "S", default_value_t = 60.0)]
        wait: f64,
        /// What the run asks for, where it has a --token; other processes of this machine see arguments, but not the
        /// variable.
        #[arg(long, env = TOKEN_VARIABLE, hide_env_values = true, value_name = "WORD")]
        token: Option<String>,
    },
    /// Say whether this machine has what the program needs.
    Doctor,
    /// Print what a shell needs to complete commands and options: `source <(voidage completions bash)`.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Exit code of programs that the shell ends for writing to nobody.
const NOBODY_READS: i32 = 141;

/// Ends the program where nothing more can be printed, instead of with a panic's message: quietly, as others end, where
/// a reader that has read enough, as `head`, closes the pipe, and with an error on a disk that is full.
fn end_where_nothing_can_be_printed() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let text = panic.payload().downcast_ref::<String>().map_or("", String::as_str);
        match text.strip_prefix("failed printing to std").and_then(|rest| rest.split_once(": ")) {
            Some((_, why)) if why.contains("Broken pipe") => std::process::exit(NOBODY_READS),
            Some((_, why)) => {
                // Not by a macro that panics in turn where errors go to the same disk.
                let _ = writeln!(std::io::stderr(), "error: cannot write the output: {why}");
                std::process::exit(1);
            }
            None => report(panic),
        }
    }));
}

/// Does what the arguments ask for, the first of which is the name of the program; the number is the exit code. To be
/// called once in a process: it sets the handlers of signals and panics. Help, and arguments that are wrong, end the
/// process.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    end_where_nothing_can_be_printed();
    let arguments = Arguments::parse_from(arguments);
    let quiet = match &arguments.command {
        Command::Run(options) => options.quiet,
        Command::Compare(options) => options.quiet,
        Command::Verify(options) | Command::Validate(options) => options.suite.quiet,
        Command::Stability(options) => options.suite.quiet,
        Command::Study(options) => options.quiet(),
        Command::Measure => true,
        _ => false,
    };
    progress::start_logging(quiet);
    voidage_coupling::scheme::own::start_where_schemes_are_made(in_python::start);
    // Where an interpreter is the process, nobody else writes what is left in the buffer.
    let written =
        || std::io::stdout().flush().map_err(|error| Error::run(format!("cannot write the output: {error}")));
    match perform(arguments.command).and_then(|code| written().map(|()| code)) {
        Ok(code) => code,
        Err(error) => {
            report::print(&error);
            if error.is_input() { 2 } else { 1 }
        }
    }
}

/// Does what was asked; the number is the exit code.
fn perform(command: Command) -> Result<u8> {
    match command {
        Command::New(options) => new::new(&options),
        Command::Run(options) => run::run(&options),
        Command::Compare(options) => compare::compare(&options),
        Command::Verify(options) => voidage_verification::verify(&options),
        Command::Validate(options) => voidage_validation::validate(&options),
        Command::Stability(options) => voidage_stability::stability(&options),
        Command::Study(options) => voidage_studies::study(&options),
        Command::Measure => voidage_studies::measure(),
        Command::Check { scene, sets } => check::check(&scene, &sets),
        Command::Plot { film, folders, out } => {
            let pictures = plot::plot(&folders, out.as_deref(), film)?;
            pictures.iter().for_each(|picture| println!("{}", picture.display()));
            Ok(0)
        }
        Command::Analyse(options) => analyse::analyse(&options),
        Command::Closures(options) => closures::closures(&options),
        Command::Schema { study, markdown } => {
            match (study, markdown) {
                (false, false) => println!("{:#}", json_schema::<Scene>()),
                (true, false) => println!("{:#}", json_schema::<Study>()),
                (false, true) => print!("{}", keys::page::<Scene>()),
                (true, true) => print!("{}", keys::page::<Study>()),
            }
            Ok(0)
        }
        Command::Header => {
            print!("{}", voidage_remote::c::header());
            Ok(0)
        }
        Command::Serve { connect, wait, token } => {
            let wait = Duration::try_from_secs_f64(wait)
                .map_err(|error| Error::input(format!("--wait {wait}: {error}")))?;
            voidage_remote::serve::serve(&connect, &Token::new(token), wait)?;
            Ok(0)
        }
        Command::Doctor => doctor::doctor(),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "voidage", &mut script);
            print!("{}", String::from_utf8_lossy(&script));
            Ok(0)
        }
    }
}
