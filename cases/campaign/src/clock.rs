//! Wall and processor time.

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;

/// Processor time, s, of this process with all its threads, or of the processes that it started and that have ended,
/// with theirs. Zero where the system does not say.
pub fn cpu(who: UsageWho) -> f64 {
    let micro = getrusage(who)
        .map(|usage| usage.user_time().num_microseconds() + usage.system_time().num_microseconds());
    1e-6 * micro.unwrap_or(0) as f64
}

/// Seconds of wall and processor time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Wall time, s.
    pub wall: f64,
    /// Processor time of this process on all cores, s.
    pub cpu: f64,
}

/// What a run took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Wall time before the first step, s.
    pub setup_s: f64,
    /// Wall time of the steps, s.
    pub steps_s: f64,
    /// Processor time of the steps on all cores, s; of a fluid solver in another process all its time.
    pub steps_cpu_s: f64,
    /// Wall time by phase, s.
    pub phases: BTreeMap<String, f64>,
    /// Steps.
    pub steps: u64,
    /// Solutions of the fluid, if there is one.
    pub fluid_solves: Option<u64>,
    /// Steps in which a solver stopped before its tolerance.
    pub unconverged_steps: u64,
}

/// What it takes to do something, added to what was spent before.
pub fn timed<T>(spent: &mut Spent, something: impl FnOnce() -> T) -> T {
    let (wall, before) = (Instant::now(), cpu(UsageWho::RUSAGE_SELF));
    let result = something();
    spent.wall += wall.elapsed().as_secs_f64();
    spent.cpu += cpu(UsageWho::RUSAGE_SELF) - before;
    result
}

/// The middle of some values.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let half = sorted.len() / 2;
    match sorted.len() % 2 {
        _ if sorted.is_empty() => f64::NAN,
        1 => sorted[half],
        _ => 0.5 * (sorted[half - 1] + sorted[half]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_lie_in_the_middle() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
    }

    #[test]
    fn work_takes_processor_time() {
        let mut spent = Spent::default();
        let sum = timed(&mut spent, || (0..20_000_000_u64).fold(0, |sum, k| std::hint::black_box(sum ^ k)));
        assert!(spent.cpu > 0.0 && spent.wall > 0.0, "{spent:?} {sum}");
    }
}
