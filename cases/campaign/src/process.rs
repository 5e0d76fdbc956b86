//! This process: its threads, its interrupts, and the processes that it starts.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use voidage_coupling::{Error, Notice, Result};
use voidage_remote::launch::Host;

/// Where fluid solvers are started from: this program, with their output in a log.
pub fn host(log: PathBuf) -> Host {
    Host { log, ..Host::default() }
}

/// Starts the worker threads, one per core unless a number is asked for; how many there are.
pub fn start_threads(asked: Option<usize>) -> Result<usize> {
    if asked == Some(0) {
        return Err(Error::input(Notice::new("--threads 0: there must be a thread", "give 1 or more")));
    }
    // With the calling thread as one of them: else it hands every parallel loop over to another thread and sleeps.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(asked.unwrap_or(0)).use_current_thread();
    pool.build_global().map_err(|error| Error::run(format!("cannot start threads: {error}")))?;
    Ok(rayon::current_num_threads())
}

/// A flag that Ctrl-C sets, which says so; a second one ends the program at once.
pub fn catch_interrupts() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let set = flag.clone();
    let handler = move || {
        if set.swap(true, Ordering::Relaxed) {
            std::process::exit(130); // asked twice: at once
        }
        tracing::warn!("interrupted: ending; Ctrl-C again ends at once, and loses what is not written yet");
    };
    ctrlc::set_handler(handler).map_err(|error| Error::run(format!("cannot catch Ctrl-C: {error}")))?;
    Ok(flag)
}
