//! This process: its threads, its interrupts, and the processes that it starts.

use signal_hook::consts::signal::*;
use signal_hook::iterator::Signals;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use voidage_coupling::{Error, Notice, Result};
use voidage_remote::launch::Host;

/// Where fluid solvers are started from: this program, with their output in a log.
pub fn host(log: PathBuf) -> Host {
    Host { log, ..Host::default() }
}

/// Most threads that may be asked for. No machine has as many cores, and some tens of thousands take all that a system
/// has before the first step.
const MOST_THREADS: usize = 1024;

/// Starts the worker threads, one per core unless a number is asked for; how many there are.
pub fn start_threads(asked: Option<usize>) -> Result<usize> {
    if let Some(threads) = asked.filter(|threads| !(1..=MOST_THREADS).contains(threads)) {
        let what = format!("--threads {threads}: there must be 1 to {MOST_THREADS}");
        return Err(Error::input(Notice::new(what, "give the number of cores, or none")));
    }
    // With the calling thread as one of them: else it hands every parallel loop over to another thread and sleeps.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(asked.unwrap_or(0)).use_current_thread();
    pool.build_global().map_err(|error| Error::run(format!("cannot start threads: {error}")))?;
    Ok(rayon::current_num_threads())
}

/// Signals that end a run after its step, with all that it has: Ctrl-C, the end of a session, and what batch systems
/// send some time before they kill a job. At a limit of the size of files (XFSZ) what is being written fails too.
const ENDING: [(i32, &str); 10] = [
    (SIGINT, "SIGINT"),
    (SIGTERM, "SIGTERM"),
    (SIGHUP, "SIGHUP"),
    (SIGUSR1, "SIGUSR1"),
    (SIGUSR2, "SIGUSR2"),
    (SIGXCPU, "SIGXCPU"),
    (SIGXFSZ, "SIGXFSZ"),
    (SIGALRM, "SIGALRM"),
    (SIGVTALRM, "SIGVTALRM"),
    (SIGPROF, "SIGPROF"),
];

/// A flag that a signal to end sets, which says so. Ctrl-C, SIGTERM or SIGHUP after that end the program at once; the
/// others may come again and again until a limit is reached.
pub fn catch_interrupts() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let set = flag.clone();
    let mut signals = Signals::new(ENDING.map(|(signal, _)| signal))
        .map_err(|error| Error::run(format!("cannot catch signals: {error}")))?;
    std::thread::spawn(move || {
        for signal in signals.forever() {
            let again = set.swap(true, Ordering::Relaxed);
            if !again {
                let name = ENDING.iter().find(|(number, _)| *number == signal).map_or("a signal", |it| it.1);
                tracing::warn!(
                    "interrupted by {name}: ending; Ctrl-C again ends at once, and loses what is not written yet"
                );
            } else if [SIGINT, SIGTERM, SIGHUP].contains(&signal) {
                std::process::exit(130);
            }
        }
    });
    Ok(flag)
}
