//! Threads that stay together over many short phases of work.
//!
//! A sweep has a handful of phases of some microseconds each, and a solve hundreds of sweeps: handing every phase to a
//! pool of threads would take longer than the phase. Members of a team wait for the next phase by looking, and take its
//! tasks one by one. Nobody waits for a member that has not come: what is not taken by others the leader does itself.

use std::hint::spin_loop;
use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize};

/// A team and its work.
pub(crate) struct Team<'a, F> {
    /// Tasks of each kind of phase.
    counts: &'a [usize],
    /// Does a task, which is told by its kind and its number.
    task: F,
    /// Number and kind of the phase, and the task that is next.
    word: AtomicU64,
    done: AtomicUsize,
    over: AtomicBool,
}

/// Places of the kind of a phase and of its number in a word, behind that of the task.
const KIND: u32 = 32;
const NUMBER: u32 = 40;

/// Looks in a row before a waiting thread lets others have the processor.
const LOOKS: usize = 10_000;

impl<'a, F: Fn(usize, usize) + Sync> Team<'a, F> {
    /// Calls `lead` with a team of up to so many threads, this one included, for phases with so many tasks each. Tasks of
    /// a phase may run at once and in any order.
    ///
    /// `lead` must not hand work to the pool of threads: while it waits for that, it could become a member of its own team,
    /// which works until `lead` returns.
    pub fn run<R: Send>(
        members: usize,
        counts: &'a [usize],
        task: F,
        lead: impl FnOnce(&Self) -> R + Send,
    ) -> R
    where
        F: Send,
    {
        assert!(counts.len() < 1 << (NUMBER - KIND), "{} kinds of phases", counts.len());
        // Before the first phase there is nothing to take.
        let word = AtomicU64::new(u64::from(u32::MAX >> 1));
        let team = Self { counts, task, word, done: AtomicUsize::new(0), over: AtomicBool::new(false) };
        if members <= 1 {
            return lead(&team);
        }
        rayon::scope(|scope| {
            (1..members).for_each(|_| scope.spawn(|_| team.help()));
            let _over = Over(&team.over);
            lead(&team)
        })
    }

    /// Does all tasks of a phase.
    pub fn phase(&self, kind: usize) {
        self.done.store(0, Relaxed);
        let number = (self.word.load(Relaxed) >> NUMBER) + 1;
        self.word.store(number << NUMBER | (kind as u64) << KIND, Release);
        while self.take() {}
        let mut looks = 0;
        while self.done.load(Acquire) < self.counts[kind] {
            wait(&mut looks);
        }
    }

    /// Does a task, if one is left.
    fn take(&self) -> bool {
        let split = |word: u64| {
            let kind = word >> KIND & ((1 << (NUMBER - KIND)) - 1);
            (kind as usize, (word & u64::from(u32::MAX)) as usize)
        };
        let (kind, next) = split(self.word.load(Acquire));
        if next >= self.counts[kind] {
            return false;
        }
        // By now it may be another phase, but what is taken belongs to it.
        let (kind, next) = split(self.word.fetch_add(1, AcqRel));
        if next < self.counts[kind] {
            let _done = Done(&self.done);
            (self.task)(kind, next);
        }
        true
    }

    fn help(&self) {
        let mut looks = 0;
        while !self.over.load(Relaxed) {
            match self.take() {
                true => looks = 0,
                false => wait(&mut looks),
            }
        }
    }
}

/// Counts a task, also one that panics: nobody waits for it then, and the panic goes on where the team ends.
struct Done<'a>(&'a AtomicUsize);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.fetch_add(1, Release);
    }
}

/// Ends the work of a team, also where its leader panics.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

fn wait(looks: &mut usize) {
    *looks += 1;
    match *looks > LOOKS {
        true => std::thread::yield_now(),
        false => spin_loop(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_of_every_phase_is_done_once() {
        let counts = [3, 0, 40];
        for members in [1, 2, 5] {
            let done: Vec<Vec<AtomicUsize>> =
                counts.iter().map(|n| (0..*n).map(|_| AtomicUsize::new(0)).collect()).collect();
            let task = |kind: usize, k: usize| _ = done[kind][k].fetch_add(1, Relaxed);
            Team::run(members, &counts, task, |team| {
                for round in 1..200 {
                    for kind in 0..counts.len() {
                        team.phase(kind);
                        assert!(done[kind].iter().all(|times| times.load(Relaxed) == round));
                    }
                }
            });
        }
    }
    #[test]
    fn a_task_that_panics_ends_the_team_and_is_not_lost() {
        for members in [1, 3] {
            let task = |_: usize, k: usize| assert!(k != 7, "task 7");
            let run = || Team::run(members, &[40], task, |team| (0..50).for_each(|_| team.phase(0)));
            assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
        }
    }
}
