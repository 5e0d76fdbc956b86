//! Contacts by an interior-point method, where sweeps stall.
//!
//! A sweep moves one contact at a time by the mass of its lighter grain, so what rests on lighter grains takes as
//! many sweeps as it is heavier than they are. Newton steps on all contacts at once do not see the ratio of masses.
//! With the rows h of each contact (normal and tangents, u = h v + base), q = p_n + c and the room a = mu q - p_t, b
//! = mu q + p_t that friction has left, Signorini's and Coulomb's conditions are
//!
//! ```text
//!     M (v - free) = sum h^T p,
//!     u_n + bias = w,            q w = 0,      q, w >= 0,
//!     u_t + y - z = 0,    a y = b z = 0,       a, b, y, z >= 0,
//! ```
//!
//! y and z being the two slips. All products are held at tau > 0, and tau is led to zero. A Newton step eliminates
//! everything but the velocities: per contact dp = c - D du with
//!
//! ```text
//!     D_nn = q / w,   D_tt = 1 / E,   D_tn = (y / a - z / b) mu / E  D_nn,     E = y / a + z / b,
//!     (M + sum h^T D h) dv = h^T c - [M (v - free) - h^T p],
//! ```
//!
//! a sparse system over the grains ([`factors`]). D_tn is the bound of friction that follows the normal impulse; it
//! makes D unsymmetric and, with strong friction, indefinite, so that steps may stall at the boundary. A step cut
//! short is followed by one to the centre with half of D_tn, until steps are long again; without D_tn the system is
//! that of a convex problem. All other steps are taken twice with one factorisation (Mehrotra's predictor and
//! corrector). The best point met is kept. Ten to thirty factorisations solve beds whose masses differ by 1e6; what
//! remains unsolved after `STEPS` is reported as such. Where grains would pass into each other because Coulomb's law
//! was not met, the bounds of friction are held, and if they ask for stresses beside which nothing else counts,
//! friction is left out of the sub-step: the problem is convex then, and rest is one of the points that it allows.
//!
//! In space the disc of friction is replaced by the square in it; the sweeps that follow make up for that.

mod factors;
mod row;

use crate::contact::Contact;
use crate::solver::{Grains, Problem};
use crate::space::Vector;
use factors::Factors;
use row::{FIXED, Point, Row, Target};

/// Newton steps at most.
const STEPS: usize = 60;
/// Share of the way to the boundary that a step takes.
const SHARE: f64 = 0.99;
/// A step cut shorter than this is followed by one to the centre.
const SHORT: f64 = 0.1;
/// Products at the start, over the mass of the heaviest body times the square of the fastest approach: ones too small
/// leave the first steps at the boundary, ones too large end at self-stresses of their size where friction is strong.
const START: f64 = 10.0;
/// Share of what counts as solved at which to stop: the next step starts from there, and must not need this again.
const GOAL: f64 = 1e-2;
/// Contacts that would take this multiple of the fastest approach to close are left out until something closes them: a
/// search that was widened for one fast grain lists a hundred times as many contacts as there are.
const FAR: f64 = 10.0;
/// Rounds, each with those left out that the last one closed, the last with all.
const ROUNDS: usize = 4;
/// Impulses over the momenta that they give, in the 2-norm: a column of n grains under its own weight has about n / 3.
const BRACED: f64 = 100.0;
/// Products over those at the start at which nothing is left to gain.
const END: f64 = 1e-18;

/// What becomes of friction.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Friction {
    /// Its bound follows the normal impulse: Coulomb's law.
    Follows,
    /// Its bound is that of the impulses at the start.
    Held,
    /// There is none.
    Out,
}

/// Everything at a point.
struct Interior<const D: usize> {
    /// Unknowns per body.
    size: usize,
    rows: Vec<Row<D>>,
    points: Vec<Point<D>>,
    inertia: Vec<f64>,
    free: Vec<f64>,
    v: Vec<f64>,
    /// Share of the last step, and share in which the bounds of friction follow.
    share: f64,
    follow: f64,
}

impl<const D: usize> Interior<D> {
    /// The problem without its impulses, at a point in the interior; none if nothing approaches. Contacts that what
    /// approaches may close are added to the `taken` ones, and make up the problem with them.
    fn new(problem: &Problem<D>, friction: Friction, taken: &mut [bool]) -> Option<Self> {
        let bodies = &problem.bodies;
        let size = D + usize::from(bodies.spins());
        let (mut unknown, mut free, mut inertia) = (vec![FIXED; bodies.len()], vec![], vec![]);
        for i in (0..bodies.len()).filter(|&i| bodies.mobility(i) > 0.0) {
            unknown[i] = free.len();
            let v = bodies.velocity(i);
            free.extend(v.iter());
            inertia.extend([1.0 / bodies.mobility(i); D]);
            if bodies.spins() {
                free.push(bodies.surface(i));
                inertia.push(1.0 / bodies.spin_mobility(i));
            }
        }
        let cohesion = |k: usize| problem.cohesion.get(k).copied().unwrap_or(0.0);
        let mut rows: Vec<Row<D>> = (problem.contacts.iter().enumerate())
            .map(|(k, c)| Row::new(bodies, c, cohesion(k), &unknown, friction))
            .collect();
        // p_n = q - c: the pull of cohesion is one of the forces.
        let mut pull = vec![0.0; free.len()];
        let mut impulse = [0.0; D];
        for row in rows.iter().filter(|row| row.cohesion > 0.0) {
            impulse[0] = -row.cohesion;
            row.push(&impulse, &mut pull, size);
        }
        free.iter_mut().zip(&pull).zip(&inertia).for_each(|((v, p), m)| *v += p / m);
        let mut u: Vec<[f64; D]> = rows.iter().map(|row| row.relative(&free, size)).collect();
        u.iter_mut().zip(&rows).for_each(|(u, row)| (0..D).for_each(|k| u[k] += row.base[k]));
        let approach = u.iter().fold(0.0, |most: f64, u| most.max(-u[0]));
        if approach <= 0.0 {
            return None;
        }
        taken.iter_mut().zip(&rows).for_each(|(taken, row)| *taken |= row.base[0] < FAR * approach);
        let mut each = taken.iter();
        rows.retain(|_| each.next() == Some(&true));
        let mut each = taken.iter();
        u.retain(|_| each.next() == Some(&true));
        let tau = START * inertia.iter().fold(0.0, |most: f64, m| most.max(*m)) * approach * approach;
        let start = |(row, u): (&Row<D>, &[f64; D])| {
            let w = u[0].max(approach);
            let mut x = Point { p: [0.0; D], w, room: [[0.0; 2]; D], slip: [[0.0; 2]; D] };
            x.p[0] = tau / w;
            if row.rubs() {
                x.room[1..].fill([row.reach(x.p[0]); 2]);
                x.slip[1..].fill([tau / row.reach(x.p[0]); 2]);
            }
            x
        };
        let points = rows.iter().zip(&u).map(start).collect();
        Some(Self { size, points, inertia, v: free.clone(), free, rows, share: 1.0, follow: 1.0 })
    }

    fn relative(&self, k: usize) -> [f64; D] {
        let (row, mut u) = (&self.rows[k], self.rows[k].relative(&self.v, self.size));
        (0..D).for_each(|a| u[a] += row.base[a]);
        u
    }

    /// Mean of the products after a share of a step.
    fn mean(&self, steps: Option<&[Point<D>]>, share: f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (k, (x, row)) in self.points.iter().zip(&self.rows).enumerate() {
            let step = steps.map_or(x, |steps| &steps[k]);
            let share = if steps.is_some() { share } else { 0.0 };
            x.pairs(step, row.rubs(), |x, d| {
                sum += (x[0] + share * d[0]) * (x[1] + share * d[1]);
                count += 1.0;
            });
        }
        sum / count
    }

    /// The largest share of a step, up to 1, that stays inside.
    fn room(&self, steps: &[Point<D>]) -> f64 {
        let mut share = 1.0f64;
        for ((x, step), row) in self.points.iter().zip(steps).zip(&self.rows) {
            x.pairs(step, row.rubs(), |x, d| {
                for s in 0..2 {
                    if d[s] < 0.0 {
                        share = share.min(-x[s] / d[s]);
                    }
                }
            });
        }
        share
    }

    /// The Newton step towards the targets.
    fn step(&self, factors: &dyn Factors, target: impl Fn(usize) -> Target<D>) -> (Vec<f64>, Vec<Point<D>>) {
        let mut dv: Vec<f64> =
            (0..self.v.len()).map(|i| self.inertia[i] * (self.free[i] - self.v[i])).collect();
        let mut constants = Vec::with_capacity(self.rows.len());
        for (k, (row, x)) in self.rows.iter().zip(&self.points).enumerate() {
            let c = row.constants(x, &self.relative(k), &target(k));
            let slopes = row.slopes(x, self.follow);
            let push = |a: usize| x.p[a] + c.p[a] + if a > 0 { slopes.tangent[a][1] * c.p[0] } else { 0.0 };
            row.push(&std::array::from_fn(push), &mut dv, self.size);
            constants.push(c);
        }
        factors.solve(&mut dv);
        let each = |((row, x), c): ((&Row<D>, &Point<D>), &Point<D>)| {
            row.step(x, c, &row.relative(&dv, self.size), self.follow)
        };
        let steps = self.rows.iter().zip(&self.points).zip(&constants).map(each).collect();
        (dv, steps)
    }

    /// Places of the blocks of the matrix, in the order in which [`Self::values`] has them.
    fn places(&self) -> Vec<[usize; 2]> {
        let mut places: Vec<[usize; 2]> = (0..self.v.len() / self.size).map(|i| [i, i]).collect();
        for row in &self.rows {
            let pairs = row.sides().flat_map(|a| row.sides().map(move |b| (a, b)));
            places.extend(pairs.map(|((_, i), (_, j))| [i / self.size, j / self.size]));
        }
        places
    }

    fn values(&self, values: &mut Vec<f64>) {
        values.clear();
        let size = self.size;
        for masses in self.inertia.chunks(size) {
            values
                .extend((0..size * size).map(|k| if k / size == k % size { masses[k / size] } else { 0.0 }));
        }
        for (row, x) in self.rows.iter().zip(&self.points) {
            let slopes = row.slopes(x, self.follow);
            // D h for one body.
            let turned = |side: usize, b: usize| -> [f64; D] {
                let normal = slopes.normal * row.coefficient(side, 0, b);
                std::array::from_fn(|k| {
                    let [stick, drag] = slopes.tangent[k];
                    if k == 0 { normal } else { stick * row.coefficient(side, k, b) + drag * normal }
                })
            };
            for ((i, _), (j, _)) in row.sides().flat_map(|a| row.sides().map(move |b| (a, b))) {
                for k in 0..size * size {
                    let (a, column) = (k / size, turned(j, k % size));
                    values.push((0..D).map(|k| row.coefficient(i, k, a) * column[k]).sum());
                }
            }
        }
    }
}

/// Leads the problem to a solution from impulses that lack something. `judge` tells what impulses and velocities lack
/// (solved up to 1); those of the best point stay, and what they lack is returned. With any `friction` but Coulomb's the problem is convex and
/// has a solution, in which no grain passes through another.
pub(crate) fn solve<const D: usize>(
    problem: &mut Problem<D>,
    free: &Free<D>,
    friction: Friction,
    lacks: f64,
    judge: &mut dyn FnMut(&mut Problem<D>) -> f64,
) -> f64 {
    let warm: Vec<Vector<D>> = problem.contacts.iter().map(|c| c.impulse).collect();
    let mut best = (free.judge(problem, judge).max(lacks), warm);
    let mut taken = vec![false; problem.contacts.len()];
    for round in 1..=ROUNDS {
        if round == ROUNDS {
            taken.fill(true);
        }
        problem.bodies.set_state(&free.state);
        if let Some(at) = Interior::new(problem, friction, &mut taken) {
            lead(at, problem, &taken, free, judge, &mut best);
        }
        problem.bodies.set_state(&free.state);
        problem.contacts.iter_mut().zip(&best.1).for_each(|(c, p)| c.impulse = *p);
        problem.apply_impulses();
        let mut more = false;
        for ((taken, c), u) in taken.iter_mut().zip(&problem.contacts).zip(relative(problem)) {
            let left_out = !*taken && u.dot(&c.normal) + c.bias < 0.0;
            *taken |= left_out;
            more |= left_out;
        }
        if !more {
            break;
        }
    }
    best.0
}

/// Velocities without contacts: of bodies, and between those of each contact.
pub(crate) struct Free<const D: usize> {
    state: Vec<(Vector<D>, f64)>,
    relative: Vec<Vector<D>>,
}

impl<const D: usize> Free<D> {
    /// Leaves the problem as it is.
    pub fn new(problem: &Problem<D>, grains: &Grains<D>) -> Self {
        let now = problem.bodies.state();
        (grains.free)(&problem.bodies);
        let free = Self { state: problem.bodies.state(), relative: relative(problem) };
        problem.bodies.set_state(&now);
        free
    }

    /// What the problem lacks; all, where its impulses are no solution whatever the error of each.
    pub fn judge(&self, problem: &mut Problem<D>, judge: &mut dyn FnMut(&mut Problem<D>) -> f64) -> f64 {
        let lacks = judge(problem);
        let solves = lacks.is_finite() && !self.braced(problem) && !self.gains(problem);
        if solves { lacks } else { f64::MAX }
    }

    /// Whether grains press against each other far more than what acts on them asks for. With strong friction there are
    /// such stresses, of any size, and beside them any error looks small.
    fn braced(&self, problem: &Problem<D>) -> bool {
        let bodies = &problem.bodies;
        let changes = self.state.iter().enumerate().filter(|(i, _)| bodies.mobility(*i) > 0.0);
        let gained: f64 =
            changes.map(|(i, (v, _))| ((bodies.velocity(i) - v) / bodies.mobility(i)).norm_squared()).sum();
        let pressed: f64 = problem.contacts.iter().map(|c| c.impulse.norm_squared()).sum();
        pressed > BRACED * BRACED * gained
    }

    /// Whether contacts give energy, p (u + u_free) / 2 in sum, beyond that of all grains at the fastest speed that
    /// takes an overlap back: far from a solution they may.
    fn gains(&self, problem: &Problem<D>) -> bool {
        let bodies = &problem.bodies;
        let work =
            |((c, after), before): ((&Contact<D>, Vector<D>), &Vector<D>)| c.impulse.dot(&(after + before));
        let worked: f64 = problem.contacts.iter().zip(relative(problem)).zip(&self.relative).map(work).sum();
        let fastest = problem.contacts.iter().fold(0.0, |most: f64, c| most.max(-c.bias));
        let moving = (0..bodies.len()).map(|i| bodies.mobility(i)).filter(|mobility| *mobility > 0.0);
        worked > fastest * fastest * moving.map(|mobility| 1.0 / mobility).sum::<f64>()
    }
}

fn relative<const D: usize>(problem: &Problem<D>) -> Vec<Vector<D>> {
    let bodies = &problem.bodies;
    let each = |c: &Contact<D>| {
        let (i, j) = (c.i as usize, c.j as usize);
        if bodies.spins() {
            bodies.relative::<true>(i, j, &c.normal)
        } else {
            bodies.relative::<false>(i, j, &c.normal)
        }
    };
    problem.contacts.iter().map(each).collect()
}

/// From one point towards the solution of the contacts taken; `best` keeps what was judged best, and its impulses.
fn lead<const D: usize>(
    mut at: Interior<D>,
    problem: &mut Problem<D>,
    taken: &[bool],
    free: &Free<D>,
    judge: &mut dyn FnMut(&mut Problem<D>) -> f64,
    best: &mut (f64, Vec<Vector<D>>),
) {
    let (mut values, start) = (vec![], at.mean(None, 0.0));
    let mut factors = factors::factors(at.size, at.v.len() / at.size, &at.places());
    for _ in 0..STEPS {
        at.values(&mut values);
        if !factors.factor(&values) {
            break;
        }
        newton(&mut at, factors.as_ref());
        let mut inside = at.rows.iter().zip(&at.points);
        for (c, taken) in problem.contacts.iter_mut().zip(taken) {
            let point = if *taken { inside.next() } else { None };
            c.impulse = point.map_or(Vector::zeros(), |(row, x)| row.impulse(x));
        }
        problem.bodies.set_state(&free.state);
        problem.apply_impulses();
        let judged = free.judge(problem, judge);
        let better = judged < best.0;
        if better {
            best.0 = judged;
            best.1.iter_mut().zip(&problem.contacts).for_each(|(p, c)| *p = c.impulse);
        }
        // A solved point stands as soon as a step does not better it.
        let done = judged <= GOAL || (best.0 <= 1.0 && !better);
        if done || at.mean(None, 0.0) < END * start {
            break;
        }
    }
}

/// One step; to the centre, or with predictor and corrector.
fn newton<const D: usize>(at: &mut Interior<D>, factors: &dyn Factors) {
    let mean = at.mean(None, 0.0);
    let all = |value: f64| Target { normal: value, tangent: [[value; 2]; D] };
    let (dv, steps) = if at.share < SHORT {
        at.step(factors, |_| all(mean))
    } else {
        let (_, guess) = at.step(factors, |_| all(0.0));
        let share = at.room(&guess);
        let aim = mean * (at.mean(Some(&guess), share) / mean).powi(3).clamp(1e-4, 1.0);
        // What the products of the changes will add, bounded: far from the boundary they say nothing.
        let added = |a: f64, b: f64| aim - share * (a * b).clamp(-10.0 * mean, 10.0 * mean);
        at.step(factors, |k| {
            let d = &guess[k];
            let tangent = std::array::from_fn(|a| std::array::from_fn(|s| added(d.room[a][s], d.slip[a][s])));
            Target { normal: added(d.p[0], d.w), tangent }
        })
    };
    let share = (SHARE * at.room(&steps)).min(1.0);
    at.points.iter_mut().zip(&steps).for_each(|(x, step)| x.add(step, share));
    at.v.iter_mut().zip(&dv).for_each(|(v, dv)| *v += share * dv);
    at.follow = match (share < SHORT, at.follow > 0.05) {
        (true, true) => 0.5 * at.follow,
        (true, false) => 0.0,
        (false, _) => (1.2 * at.follow + 0.1).min(1.0),
    };
    at.share = share;
}

#[cfg(test)]
mod tests;
