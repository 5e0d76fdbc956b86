//! What decides when the sweeps have solved the contacts, and how they proceed, in two tables. (Corrections over long
//! distances, the repair of overlaps and the interior-point method have their own constants, beside their methods.)
//!
//! | constants | measured on |
//! |---|---|
//! | `unseen` | energy of the true error over that which factors find: 1 in stacks, 2 to 10 in random beds |
//! | `rest`, `few_rest`, `settled`, `grows` | beds of 400 rows of 50 um in steps of 0.5 ms |
//! | `runs` | cold, settling and hit beds of 4,000 to 20,000 discs: longer runs are no faster |
//! | `strong`, `lagging`, `follow` | beds with friction 10: the steps that stay unsolved are a quarter of those with a bound that follows at once. Weak friction converges without |
//! | `look`, `measure` | time of a look and of a measure over that of a relaxation, in a bed of 8,000 discs |
//! | all others | chosen by the reasons beside them, and not measured one by one |

/// When contacts count as solved, settled, or at rest.
pub(crate) struct Solved {
    /// Energy of smooth errors over what corrections over long distances would take away of it.
    pub unseen: f64,
    /// The energy of the error is at most the sum of |violation| |p - p*| over the contacts. Impulses from a cold
    /// start are too small for |p - p*| < |p|; this times |p| bounds it from early on.
    pub bound: f64,
    /// Share of the energy that the contacts have to do with below which changes of the velocities count as rest: what
    /// forces give to grains at rest is taken back by contacts nearly in whole.
    pub rest: f64,
    /// The same up to which the solver, once it has solved a problem, goes on for the grains that rest, and the share
    /// of what may be left that it then tries to reach. At rest an error of the velocities turns the contacts, and the
    /// forces on them are the larger the deeper they lie: it comes back in the next sub-step P h^2 / (m d) times as
    /// large under the load P, which is 20 times under 400 rows of 50 um in 0.5 ms. Errors that are only small beside
    /// the forces let such a bed slip again and again; in one that has settled to rounding there is nothing to
    /// magnify.
    pub few_rest: f64,
    pub settled: f64,
    /// Growth of the energy of an error in the next sub-step up to which its first sweeps take back what comes: where
    /// grains fly, so that a step has many short sub-steps.
    pub grows: f64,
    /// Share of the energy of all that grains may have which move where the others rest.
    pub few_move: f64,
    /// Share of the error that may be left up to which all sleeping tiles together have it.
    pub quiet: f64,
    /// Share of the speed of closing that no contact may exceed, up to which a tile sleeps: light grains among heavy
    /// ones have little part in the energy, and would pass into each other over many steps.
    pub closes: f64,
}

pub(crate) const SOLVED: Solved = Solved {
    unseen: 4.0,
    bound: 10.0,
    rest: 5e-3,
    few_rest: 0.1,
    settled: 1e-7,
    grows: 4.0,
    few_move: 0.02,
    quiet: 0.01,
    closes: 0.05,
};

/// How a solve proceeds.
pub(crate) struct Schedule {
    /// Sweeps of the first runs, and of all later ones: a warm start may need none. A measure with its correction costs
    /// as much as some fifty.
    pub runs: [usize; 4],
    /// Runs before impulses are corrected over long distances.
    pub short_runs: usize,
    /// Sweeps that a sub-step spends on solved contacts of grains at rest.
    pub settling_sweeps: usize,
    /// Share of its error that a solved problem has left after the sweeps for settling if it is smooth: a correction
    /// follows.
    pub smooth: f64,
    /// Growth of the error after a correction, beyond all that the contacts have to do with, after which none is made.
    pub diverged: f64,
    /// Share of the error that is left after a correction and its run of sweeps, above which the next one waits twice
    /// as long, and the longest pause in runs: what is left then are errors that corrections do not see, and they would
    /// interrupt the momentum of the sweeps that do.
    pub helped: f64,
    pub longest_pause: usize,
    /// Share of an error that is smooth above which no correction waits, and error from which none does: the measure
    /// still grows with the impulses.
    pub seen: f64,
    pub growing: f64,
    /// Error above which the changes of the impulses belong to the corrections.
    pub near: f64,
    /// Coefficient above which friction lags behind the normal impulse, sweeps after which it does, and the share of
    /// the difference that a sweep makes up. A sweep is no contraction when friction is strong: normal impulse and the
    /// bound mu p_n of the tangential one chase each other round a cycle. With the bound held, the problem is convex
    /// and sweeps converge; so the bound follows slowly.
    pub strong: f64,
    pub lagging: usize,
    pub follow: f32,
    /// Awake contacts above which several threads sweep, and contacts of a colour above which its tiles go to several
    /// threads in other passes, which take some thirty nanoseconds for each.
    pub shared: usize,
    pub passes: usize,
    /// Contacts that are relaxed in the time of one look at a contact, and of its part in a measure of smooth errors.
    pub look: usize,
    pub measure: usize,
}

pub(crate) const SCHEDULE: Schedule = Schedule {
    runs: [0, 8, 16, 30],
    short_runs: 3,
    settling_sweeps: 32,
    smooth: 0.5,
    diverged: 30.0,
    helped: 0.9,
    longest_pause: 64,
    seen: 0.5,
    growing: 1e-2,
    near: 1e-6,
    strong: 1.0,
    lagging: 200,
    follow: 0.05,
    shared: 1_500,
    passes: 5_000,
    look: 6,
    measure: 20,
};
