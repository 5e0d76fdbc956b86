//! Runs of sweeps, the measure of what they leave, and corrections over long distances in between.
//!
//! **The measure.** With the impulses p the velocities are v = v_free + M^-1 H^T p and the closing speeds s = H v +
//! bias. Where the contacts that act are known and hold, the error of the velocities has the energy
//!
//! ```text
//!     E = 1/2 |v - v*|_M^2 = 1/2 s^T W^-1 s = max over q of (-s^T q - 1/2 q^T W q),        W = H M^-1 H^T.
//! ```
//!
//! s alone says little of E: a bed of N rows that falls as a whole has closing speeds of 1/N of its speed, and W^-1
//! magnifies them by N. But every q that leaves the impulses within Coulomb's law gives a lower bound.
//! [`Coarse`](crate::coarse::Coarse) maximises over the q that are the impulses times factors that vary slowly in
//! space: they find all of E on a stack. What varies from grain to grain, which they do not see, is the natural map r:
//! sum of r^2 / (2 rho). In random beds the shape of the impulses must change too, and neither sees that; how sweeps
//! still change the velocities does ([`Trend`](super::trend::Trend)). The sum of the three is the estimate.
//!
//! A contact that resists rolling has the rolling speed as one more row of H, and a natural map of its own
//! ([`Rolling`](crate::rolling::Rolling)): what it says counts to the sum of r^2 / (2 rho) and to the columns of the
//! corrections.
//!
//! **Rest.** Where contacts take all that forces bring to the grains but a small share, no velocity at all obeys the
//! laws of the contacts with the same impulses: only that share of the forces is not balanced. Such grains stop, and
//! the problem of the next step is the same: its impulses solve it without a sweep. What is left of the velocities is
//! taken only where hardly anything moves; where much does, it is what tells the next step how the impulses must
//! change.
//!
//! Corrections also take what sweeps have changed of the impulses times such factors. As a measure these would claim
//! errors that are none: where friction or cohesion are at their limits they lead out of the law.

use super::constants::{SCHEDULE, SOLVED};
use super::residual::Look;
use super::{Grains, Outcome, Problem, Stopping};
use crate::contact::Law;
use crate::momentum::Momentum;
use crate::parallel;
use std::time::Instant;

/// When what is smooth of an error is measured.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Measure {
    Always,
    /// The same, and a correction is to follow.
    BeforeCorrection,
    /// If the rest of the error is small enough for the problem to be solved, or to be settled.
    IfSolved,
    IfSettled,
}

/// Where a solve stands.
#[derive(Clone, Copy, PartialEq)]
enum Phase {
    /// More is wrong than may be.
    Solving,
    /// Solved, first after so many sweeps with this error: sweeps go on towards velocities that settle. `corrected` is
    /// how it ended before it was corrected over long distances, once.
    Settling { sweeps: usize, error: f64, corrected: Option<Outcome> },
}

/// When impulses are corrected over long distances.
struct Corrections {
    allowed: bool,
    diverged: bool,
    /// The run after which the next one is due, and the runs between two.
    next: usize,
    pause: usize,
    /// Error before the last one; infinite before the first and after one that was taken back.
    before: f64,
    /// Whether the last run began with one.
    made: bool,
}

impl Corrections {
    fn due(&self, run: usize) -> bool {
        self.allowed && run >= self.next
    }

    /// Sets the pause by what the last one has done.
    fn learn(&mut self, run: usize, outcome: &Outcome) {
        let error = outcome.error;
        if std::mem::take(&mut self.made) {
            let seen = outcome.smooth > SCHEDULE.seen * outcome.energy;
            if seen || error > SCHEDULE.growing || error <= SCHEDULE.helped * self.before {
                self.pause = self.pause.div_ceil(2);
                self.next = run + self.pause - 1;
            } else {
                self.wait(run);
            }
        }
    }

    /// The next one waits for twice as long.
    fn wait(&mut self, run: usize) {
        self.pause = (2 * self.pause).min(SCHEDULE.longest_pause);
        self.next = run + self.pause - 1;
    }
}

impl<const D: usize> Problem<D> {
    /// Runs of sweeps until the problem is solved and has settled, or the sweeps are used up.
    pub(super) fn sweeps<L: Law>(&mut self, stopping: &Stopping, grains: &Grains<D>) -> Outcome {
        let corners = self.corners();
        self.coarse.restart(corners, &self.radius, &mut self.uncorrected);
        let strong = L::FRICTION && self.contacts.iter().any(|c| c.friction > SCHEDULE.strong);
        self.trend.start(self.position.len());
        self.start_batches();
        let mut pace = self.sleep(stopping.momentum);
        if !stopping.momentum || stopping.interior {
            self.wake_all();
        }
        let mut corrections = Corrections {
            allowed: stopping.short_runs.is_some() && self.coarse.reach_far(),
            diverged: !self.coarse.reach_far(),
            next: stopping.short_runs.unwrap_or(0),
            pause: 1,
            before: f64::INFINITY,
            made: false,
        };
        let mut outcome = Outcome::default();
        let mut phase = Phase::Solving;
        for run in 0.. {
            let count =
                SCHEDULE.runs[run.min(SCHEDULE.runs.len() - 1)].min(stopping.max_sweeps - outcome.sweeps);
            let due = corrections.due(run);
            let column = due && phase == Phase::Solving && (run == 0 || outcome.error > SCHEDULE.near);
            self.run::<L>(outcome.sweeps..outcome.sweeps + count, strong, column, &mut pace);
            let last = outcome.sweeps + count == stopping.max_sweeps;
            let measure = match due || corrections.made || last {
                true if due && !last => Measure::BeforeCorrection,
                true => Measure::Always,
                // Grains at rest are not solved by their warm start, and not far from it: eight sweeps cost less.
                false if run == 0 => Measure::IfSettled,
                false => Measure::IfSolved,
            };
            let start = Instant::now();
            let trend = self.trend.error(&self.bodies);
            let judged = self.judge::<L>(stopping, grains, measure, trend);
            self.cost.measures_s += start.elapsed().as_secs_f64();
            let work = outcome.work + count * self.awake.contacts + judged.work;
            outcome = Outcome { sweeps: outcome.sweeps + count, work, ..judged };
            corrections.learn(run, &outcome);
            let mut correct = corrections.due(run);
            phase = match (phase, outcome.solved(stopping)) {
                (Phase::Solving, true) => {
                    Phase::Settling { sweeps: outcome.sweeps, error: outcome.error, corrected: None }
                }
                // What was solved before the correction stays so.
                (Phase::Settling { corrected: Some(before), .. }, false) => {
                    self.take_back(grains);
                    outcome = Outcome { sweeps: outcome.sweeps, work: outcome.work, ..before };
                    break;
                }
                (Phase::Settling { .. }, false) => {
                    // From a cold start impulses may grow for a while before their error is seen.
                    corrections.allowed = !corrections.diverged && stopping.short_runs.is_some();
                    Phase::Solving
                }
                (phase, _) => phase,
            };
            if let Phase::Settling { sweeps, error, .. } = phase {
                let enough = outcome.sweeps >= sweeps + stopping.settling_sweeps;
                let smooth = !outcome.rest && outcome.error > SCHEDULE.smooth * error;
                if outcome.settled(stopping) || enough && !(corrections.allowed && smooth) {
                    break;
                }
                correct = enough;
            }
            if last {
                break;
            }
            let most =
                if phase != Phase::Solving { 1.0 } else { SCHEDULE.diverged / corrections.before.min(1.0) };
            if outcome.error > most * corrections.before {
                // Where walls leave no room there is no solution, and a correction only adds stress.
                (corrections.allowed, corrections.diverged) = (false, true);
                corrections.before = f64::INFINITY;
                self.take_back(grains);
                pace = self.sleep(stopping.momentum);
                self.look::<L>();
            } else if correct {
                // A solved problem is corrected once.
                corrections.allowed = phase == Phase::Solving;
                if let Phase::Settling { corrected, .. } = &mut phase {
                    *corrected = Some(outcome);
                }
                if self.correct::<L>(grains, outcome.energy) {
                    (corrections.before, corrections.made) = (outcome.error, true);
                    pace = self.sleep(stopping.momentum);
                    self.look::<L>();
                } else {
                    corrections.wait(run);
                }
            }
            if phase != Phase::Solving && outcome.rest {
                self.wake_moving();
            } else if outcome.smooth > outcome.goal && !corrections.made {
                self.wake_all();
            } else {
                self.wake(outcome.goal, stopping.closing);
            }
        }
        if outcome.sweeps > 0 {
            self.polish::<L>();
        }
        outcome
    }

    /// A run of sweeps; what it changes is a column of the next correction if `column`.
    fn run<L: Law>(
        &mut self,
        sweeps: std::ops::Range<usize>,
        strong: bool,
        column: bool,
        pace: &mut Option<Momentum>,
    ) {
        self.coarse.leave();
        if column {
            self.coarse.mark(&self.contacts, &self.rolling);
        } else {
            self.coarse.forget();
        }
        let any = !sweeps.is_empty();
        self.sweep::<L>(sweeps, strong, pace);
        if column && any {
            self.coarse.keep(&self.contacts, &self.rolling);
        }
    }

    /// Corrects the impulses over long distances, if that adds no more energy than is wrong, J. What factors of changes
    /// promise need not come true, because impulses that are changed so must be cut back to Coulomb's law; then factors
    /// of the impulses alone follow, which keep them within it.
    fn correct<L: Law>(&mut self, grains: &Grains<D>, wrong: f64) -> bool {
        let start = Instant::now();
        let corrected = self.corrected::<L>(grains, wrong);
        self.cost.corrections_s += start.elapsed().as_secs_f64();
        corrected
    }

    fn corrected<L: Law>(&mut self, grains: &Grains<D>, wrong: f64) -> bool {
        let mut kept = std::mem::take(&mut self.uncorrected);
        self.keep_impulses(&mut kept);
        self.uncorrected = kept;
        let before = self.energy();
        for wide in [true, false] {
            let mut coarse = std::mem::take(&mut self.coarse);
            let corrected = coarse.correct::<L>(self, grains.free, wide);
            self.coarse = coarse;
            if corrected && self.energy() < before + wrong {
                return true;
            }
            if corrected {
                self.take_back(grains);
            }
        }
        false
    }

    /// 1/2 |v|^2 + bias p, which the impulses of the contacts minimise without friction, J.
    fn energy(&self) -> f64 {
        let bodies = &self.bodies;
        let kinetic = parallel::sum(0..self.position.len(), &|i| {
            let (mobility, v) = (bodies.mobility(i), bodies.velocity(i));
            let turning = if bodies.spins() { bodies.spin_mobility(i) } else { 0.0 };
            let turns = if turning > 0.0 { 0.5 * bodies.surface(i).powi(2) / turning } else { 0.0 };
            turns + if mobility > 0.0 { 0.5 * v.norm_squared() / mobility } else { 0.0 }
        });
        let contact =
            |k: usize| self.contacts[k].bias * self.contacts[k].impulse.dot(&self.contacts[k].normal);
        let turning = |k: usize| self.rolling[k].drift * self.rolling[k].impulse.get();
        kinetic
            + parallel::sum(0..self.contacts.len(), &contact)
            + parallel::sum(0..self.rolling.len(), &turning)
    }

    /// Back to the impulses before the last correction.
    fn take_back(&mut self, grains: &Grains<D>) {
        let kept = std::mem::take(&mut self.uncorrected);
        self.put_impulses(&kept);
        self.uncorrected = kept;
        (grains.free)(&self.bodies);
        self.apply_impulses();
    }

    /// How far the problem is from its solution; what is smooth of the error belongs to it only where it is measured.
    /// `trend` is the energy of the error by how sweeps still change the velocities, J.
    pub(super) fn judge<L: Law>(
        &mut self,
        stopping: &Stopping,
        grains: &Grains<D>,
        measure: Measure,
        trend: f64,
    ) -> Outcome {
        let scale = (0.5 * (stopping.forced + (grains.pushed)(&self.bodies))).max(stopping.floor);
        let look: Look = self.look::<L>();
        let changed = (grains.changed)(&self.bodies) / scale;
        let reach = |rest: f64| stopping.tolerance * scale * rest;
        let (enough, most) = (reach(changed.max(SOLVED.rest)), look.rough + SOLVED.bound * look.bound);
        let grows = stopping.whole || look.comes_back * stopping.step * stopping.step > SOLVED.grows;
        let settled = if changed <= SOLVED.few_rest && grows { SOLVED.settled * enough } else { enough };
        let (seen, mut smooth, mut work) = (look.rough + trend, 0.0, SCHEDULE.look * self.contacts.len());
        let at_rest = stopping.rest.powi(2) * scale;
        // Who closes on others and has not been pushed yet does not rest.
        let near =
            look.rough <= enough.min(at_rest) && look.closing <= stopping.closing && stopping.rest > 0.0;
        let moving = if near { self.mark_moving(grains.moving) } else { 1.0 };
        let rest = moving <= SOLVED.few_move;
        let measured = match measure {
            _ if rest => false,
            Measure::Always | Measure::BeforeCorrection => true,
            Measure::IfSolved => seen <= enough && most > settled,
            Measure::IfSettled => look.rough <= settled && most > settled,
        };
        if measured {
            let mut coarse = std::mem::take(&mut self.coarse);
            smooth = SOLVED.unseen * coarse.measure::<L>(self, measure == Measure::BeforeCorrection);
            self.coarse = coarse;
            work += SCHEDULE.measure * self.contacts.len();
        }
        let energy = match rest {
            true => seen + at_rest,
            false if measured || seen > enough => seen + smooth,
            false => seen.max(most),
        };
        // What moves is settled when nothing varies from grain to grain there.
        let quiet = rest && trend + if moving > 0.0 { self.rough_of_moving::<L>() } else { 0.0 } <= settled;
        let settled = if quiet { energy } else { settled };
        let error = match !energy.is_nan() && (look.rough + look.bound + scale).is_finite() {
            true if energy <= stopping.negligible.max(look.rounding) => 0.0,
            true => energy / scale,
            // Impulses have left the range of numbers.
            false => f64::INFINITY,
        };
        let closing = look.closing / stopping.closing;
        let goal = if energy > enough { enough } else { settled };
        let residual = look.residual;
        Outcome {
            error,
            energy,
            changed,
            smooth,
            goal,
            settles: settled,
            residual,
            closing,
            work,
            rest,
            sweeps: 0,
        }
    }
}

impl Outcome {
    /// Energy of the velocity error over that of the changes of the velocities, which count as no less than rest.
    pub fn share(&self) -> f64 {
        self.error / self.changed.max(SOLVED.rest)
    }

    /// Whether nothing is left to do for grains at rest.
    fn settled(&self, stopping: &Stopping) -> bool {
        self.solved(stopping) && (self.energy <= self.settles || self.error == 0.0)
    }
}
