//! How a run is interrupted: between two steps, or, where that takes too long, by a watcher that saves the last state
//! that it has.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing::warn;
use voidage_coupling::{Error, Result};
use voidage_dem::Rounded;
use voidage_scene::recorder::{CHECKPOINT, Checkpoint, Kept, Stamp, Summary};
use voidage_scene::simulation::State;

/// How long a run may take to come to the end of its step after an interrupt.
const PATIENCE: Duration = Duration::from_millis(1200);
/// Most of the time of a run that may be spent on states that are kept for an interrupt, as a share.
const SHARE: f64 = 0.02;

/// A state to go on from, and all that a checkpoint and a summary need beside it.
pub struct Saved {
    /// Which step.
    pub stamp: Stamp,
    /// The state.
    pub state: State,
    /// What the recorder has.
    pub kept: Kept,
    /// The summary as if the run ended here.
    pub summary: Summary,
    /// The folder of the run.
    pub folder: PathBuf,
    /// The command line that goes on from the checkpoint there.
    pub again: String,
}

/// Who ends the run: whoever claims it first.
#[derive(Clone)]
pub struct Ending {
    interrupted: Arc<AtomicBool>,
    claimed: Arc<AtomicBool>,
    saved: Arc<Mutex<Option<Saved>>>,
    started: Instant,
    /// Time spent on states, and on the last of them, s.
    spent: (f64, f64),
    /// Whether the checkpoint is of a later step than the state that is kept.
    outdated: bool,
}

impl Ending {
    /// Starts to watch the flag that an interrupt sets.
    pub fn watched(interrupted: Arc<AtomicBool>) -> Ending {
        let ending = Ending {
            interrupted,
            claimed: Arc::default(),
            saved: Arc::default(),
            started: Instant::now(),
            spent: (0.0, 0.0),
            outdated: false,
        };
        let watcher = ending.clone();
        std::thread::spawn(move || watcher.watch());
        ending
    }

    /// Whether the run is to end.
    pub fn is_asked(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// The flag itself.
    pub fn flag(&self) -> &AtomicBool {
        &self.interrupted
    }

    /// From here on the calling thread ends the run. Where the watcher does already, this does not return.
    pub fn claim(&self) {
        if self.claimed.swap(true, Ordering::SeqCst) {
            loop {
                std::thread::park();
            }
        }
    }

    /// A checkpoint has been written, and the state that is kept must not take its place.
    pub fn outdate(&mut self) {
        self.outdated = true;
    }

    /// Keeps a state for an interrupt, if there is none yet, or the last is outdated, or time enough has passed since.
    pub fn keep(&mut self, state: impl FnOnce() -> Saved) {
        let (all, last) = self.spent;
        if !self.outdated && all > 0.0 && all + last > SHARE * self.started.elapsed().as_secs_f64() {
            return;
        }
        let start = Instant::now();
        let state = state();
        *self.saved.lock().unwrap_or_else(PoisonError::into_inner) = Some(state);
        let now = start.elapsed().as_secs_f64().max(1e-9);
        self.spent = (all + now, now);
        self.outdated = false;
    }

    /// Waits for an interrupt, and for the run to answer it; then ends the process itself.
    fn watch(&self) {
        while !self.is_asked() {
            std::thread::sleep(Duration::from_millis(20));
        }
        let asked = Instant::now();
        while asked.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(20));
        }
        if self.claimed.swap(true, Ordering::SeqCst) {
            return;
        }
        // The lock is free before anything is written: a run whose step ends meanwhile keeps its next state.
        let saved = self.saved.lock().unwrap_or_else(PoisonError::into_inner).take();
        match saved {
            None => warn!("interrupted before the first step: nothing has been computed that could be saved"),
            Some(saved) => {
                if let Err(error) = saved.write() {
                    warn!("{}", error.notice());
                }
            }
        }
        std::process::exit(1);
    }
}

impl Saved {
    /// Writes checkpoint and summary, then draws the pictures of what was recorded.
    fn write(mut self) -> Result<()> {
        let path = self.folder.join(CHECKPOINT);
        Checkpoint::write(&path, &self.stamp, &self.state, &self.kept)?;
        warn!(
            "interrupted within a step; the state at t = {} s is saved, to go on:\n  {}",
            Rounded(self.stamp.time),
            self.again
        );
        self.summary.outcome = "interrupted".to_owned();
        self.summary.write(&self.folder.join("summary.json"))?;
        // In a thread of its own: those of the run are busy with its step, or wait for this process to end.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|error| Error::run(format!("cannot start threads: {error}")))?;
        pool.install(|| crate::plot::draw(&self.folder)).map(drop)
    }
}
