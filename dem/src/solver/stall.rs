//! Whether sweeps still do something.
//!
//! Where friction is strong and holds more contacts than it takes to hold the grains, many velocities obey the laws of
//! the contacts about equally well, and sweeps wander between them for ever. In a mass of grains that slides in a viscous
//! liquid they do so by some percent of the velocities, after a hundred sweeps as after half a million. Twice as many
//! sweeps, and again twice as many, then bring no lower error, and none of it is smooth. The problem stays unsolved, and
//! is said to be, but more sweeps would not solve it.
//!
//! Without friction the impulses minimise an energy, and the velocities that do are the only ones: sweeps come to them,
//! however slowly. Nor does a problem of grains that nearly rest stall, because their velocities are known to be zero.

use super::Outcome;
use super::runs::{REST, SEEN};

/// Sweeps before the first octave.
const OCTAVES: usize = 24;
/// Ratio of the lowest error of an octave to the lowest before it above which the octave has brought nothing, and how
/// many such octaves make a stall.
const GAINED: f64 = 0.7;
const IDLE: usize = 2;
/// Error above which nothing is a stall: from a cold start it grows and falls while the weight travels through the bed.
const WANDERS: f64 = 0.1;

/// What the octaves of sweeps have brought so far.
pub(super) struct Stall {
    /// Sweeps at which the last octave ended, and the lowest energy of the error until then and since, J.
    from: usize,
    before: f64,
    lowest: f64,
    /// Largest error since then, over what the contacts have to do with.
    worst: f64,
    /// Octaves in a row that brought nothing.
    idle: usize,
}

impl Default for Stall {
    fn default() -> Self {
        Self { from: OCTAVES, before: f64::INFINITY, lowest: f64::INFINITY, worst: 0.0, idle: 0 }
    }
}

impl Stall {
    /// Whether what is smooth of the error must be measured to tell.
    pub fn suspected(&self) -> bool {
        self.idle >= IDLE
    }

    /// Takes the outcome of a run.
    pub fn found(&mut self, outcome: &Outcome) -> bool {
        if outcome.sweeps > OCTAVES {
            (self.lowest, self.worst) = (self.lowest.min(outcome.energy), self.worst.max(outcome.error));
        }
        if self.suspected() && self.worst <= WANDERS && outcome.smooth <= SEEN * outcome.energy {
            return true;
        }
        if outcome.sweeps >= 2 * self.from {
            let moves = outcome.changed > REST;
            let idle = moves && self.lowest > GAINED * self.before && self.worst <= WANDERS;
            self.idle = if idle { self.idle + 1 } else { 0 };
            self.before = self.before.min(self.lowest);
            (self.from, self.lowest, self.worst) = (outcome.sweeps, f64::INFINITY, 0.0);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sweeps after which errors that go by a law of the number of sweeps are a stall, within a thousand; a share of
    /// them is smooth, and grains have changed their velocities.
    fn stalls_after(error: impl Fn(usize) -> f64, smooth: f64, changed: f64) -> Option<usize> {
        let mut stall = Stall::default();
        (54..1000).step_by(30).find(|&sweeps| {
            let error = error(sweeps);
            stall.found(&Outcome {
                sweeps,
                error,
                energy: error,
                smooth: smooth * error,
                changed,
                ..Default::default()
            })
        })
    }

    #[test]
    fn sweeps_that_wander_end_after_two_octaves() {
        let wanders = |k: usize| 1e-2 * (2.0 + (k as f64).sin());
        assert!(stalls_after(wanders, 0.1, 0.1).is_some_and(|sweeps| (200..400).contains(&sweeps)));
    }

    #[test]
    fn sweeps_go_on_where_they_help_or_the_error_is_large_or_smooth_or_all_rests() {
        assert_eq!(stalls_after(|k| 1.0 / k as f64, 0.1, 0.1), None);
        assert_eq!(stalls_after(|k| 0.5 + 0.4 * (k as f64).sin(), 0.1, 0.1), None);
        assert_eq!(stalls_after(|_| 1e-2, 0.9, 0.1), None);
        assert_eq!(stalls_after(|_| 1e-2, 0.1, 1e-3), None);
    }
}
