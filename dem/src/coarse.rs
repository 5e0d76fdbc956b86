//! Corrections of the impulses that act far beyond a grain.
//!
//! Sweeps find quickly how a grain hands on what presses on it, and slowly how much presses: in a bed of H rows the
//! latter takes O(H) of them, accelerated. But a network of impulses in which each grain is nearly in balance stays
//! so when all impulses of a region are multiplied by a factor that varies slowly in space. So the factors are the
//! unknowns of a small problem: with theta linear between the nodes k of a grid many grains wide (hat functions
//! phi_k),
//!
//! ```text
//!     p <- p + sum over k, f of theta_kf phi_k q_f,
//!     q_0 = p,  q_1, q_2, ..  the changes of p in the last runs of sweeps,
//! ```
//!
//! and theta minimises the energy 1/2 |M^-1/2 (H^T p + ..)|^2 + bias p that the impulses of the contacts minimise
//! without friction (Galerkin). A factor above -1 on p keeps every impulse in the cone of Coulomb's law; what the
//! other columns add is projected on it. Columns q_1, .. are what sweeps found to be in balance but not yet of the
//! right size. Corrections of this kind are known from Markov chains (iterative aggregation and disaggregation);
//! momentum is conserved, because what changes is the impulse of a contact.

use crate::bodies::Bodies;
use crate::contact::{Contact, Law};
use crate::rolling::Rolling;
use crate::solver::{FORK, Impulses, Problem};
use crate::space::{Vector, cut};
use assembly::Chunk;
use nodes::{Nodes, offsets};
use rayon::prelude::*;

mod assembly;
mod nodes;

/// Columns: the impulses, and their changes in the last runs of sweeps.
const COLUMNS: usize = 3;
/// Largest factor of a column, either way; and the smallest on p.
const LARGEST: f64 = 30.0;
const SMALLEST: f64 = -0.8;
/// Share of its diagonal added to the matrix: columns may be nearly parallel.
const DAMPING: f64 = 1e-7;

/// The nodes, their matrix and the columns; buffers are kept.
#[derive(Default)]
pub(crate) struct Coarse<const D: usize> {
    nodes: Nodes<D>,
    /// Changes of all impulses in the last runs, the newest first.
    changes: [Vec<Kept<D>>; COLUMNS - 1],
    /// The same of resistance to rolling; empty without.
    rolled: [Vec<f32>; COLUMNS - 1],
    /// How many of them there are, and whether the newest still holds the impulses from which it will be measured.
    known: usize,
    marked: bool,
    /// Problems since the last one that was corrected.
    idle: usize,
    /// Columns for which the matrix has room, and those that it has, of the present impulses; none without a matrix.
    room: usize,
    filled: usize,
    /// Columns that have factors, of the present impulses; none without any.
    columns: usize,
    /// First contact of each grain, and the contacts.
    starts: Vec<u32>,
    of: Vec<u32>,
    /// The first holds the sum in the end.
    chunks: Vec<Chunk>,
    band: Vec<f64>,
    /// Factors, node by node, and what each is scaled by while they are sought.
    theta: Vec<f64>,
    scales: Vec<f64>,
}

/// A change of an impulse in few bytes: columns need not be exact.
type Kept<const D: usize> = [f32; D];

/// Brings impulses from N s to the middle of the range of single precision: those of grains of a micrometre and of a
/// metre fit.
const RANGE: f64 = 1e12;

fn keep<const D: usize>(p: &Vector<D>) -> Kept<D> {
    std::array::from_fn(|a| (p[a] * RANGE) as f32)
}

#[inline(always)]
fn kept<const D: usize>(p: &Kept<D>) -> Vector<D> {
    Vector::from_fn(|a, _| f64::from(p[a]) / RANGE)
}

/// Problems without corrections after which their room is given back.
const IDLE: usize = 100;

impl<const D: usize> Coarse<D> {
    /// Lays the nodes of another problem, whose contacts lie between two corners, and forgets the changes. The room for
    /// them, and for the impulses before a correction, is given back when many problems in a row have done without.
    pub fn restart(&mut self, contacts: [Vector<D>; 2], radius: &[f64], uncorrected: &mut Impulses<D>) {
        self.idle += 1;
        if self.idle == IDLE {
            (self.changes, self.rolled) = Default::default();
            *uncorrected = Impulses::default();
        }
        self.forget();
        self.leave();
        self.nodes.lay(contacts, radius);
    }

    /// Forgets the changes: they are known no more.
    pub fn forget(&mut self) {
        (self.known, self.marked) = (0, false);
    }

    /// Marks the impulses before a run of sweeps.
    pub fn mark(&mut self, contacts: &[Contact<D>], rolling: &[Rolling]) {
        if !self.marked {
            self.changes.rotate_right(1);
            self.rolled.rotate_right(1);
            self.known = (self.known + 1).min(COLUMNS - 1);
        }
        self.marked = true;
        self.idle = 0;
        let newest = &mut self.changes[0];
        newest.clear();
        crate::reserve(newest, contacts.len());
        newest.extend(contacts.iter().map(|c| keep(&c.impulse)));
        let newest = &mut self.rolled[0];
        newest.clear();
        crate::reserve(newest, rolling.len());
        newest.extend(rolling.iter().map(|r| (r.impulse.get() * RANGE) as f32));
    }

    /// Takes what has changed since the mark as the newest column.
    pub fn keep(&mut self, contacts: &[Contact<D>], rolling: &[Rolling]) {
        self.marked = false;
        self.changes[0]
            .iter_mut()
            .zip(contacts)
            .for_each(|(before, c)| *before = keep(&(c.impulse - kept(before))));
        let rolled = self.rolled[0].iter_mut().zip(rolling);
        rolled.for_each(|(before, r)| *before = (r.impulse.get() * RANGE - f64::from(*before)) as f32);
    }

    /// Whether grains reach beyond one cell: within it, sweeps need no help.
    pub fn reach_far(&self) -> bool {
        self.nodes.reach_far()
    }

    /// Energy that factors of the impulses would take away: a lower bound of the energy of the velocity error, J. Those
    /// of changes count only in corrections: near the solution they lead out of Coulomb's law and claim what is no
    /// error. Where a correction is to follow, the matrix gets its columns at once.
    pub fn measure<L: Law>(&mut self, problem: &Problem<D>, before_correction: bool) -> f64 {
        self.leave();
        self.assemble::<L>(problem, before_correction && self.changes_known() > 0);
        self.find(1);
        0.5 * self.gain()
    }

    /// Has the matrix of the impulses, and of their changes if `wide`, made where it is not there.
    fn assemble<L: Law>(&mut self, problem: &Problem<D>, wide: bool) {
        if self.nodes.count() == 0 || self.room >= if wide { COLUMNS } else { 1 } {
            return;
        }
        self.list_contacts(problem);
        if wide {
            (self.room, self.filled) = (COLUMNS, 1 + self.changes_known());
            self.sum::<L, COLUMNS>(problem);
        } else {
            (self.room, self.filled) = (1, 1);
            self.sum::<L, 1>(problem);
        }
    }

    /// Finds the factors of the first columns of the matrix, if there are any.
    fn find(&mut self, columns: usize) {
        self.columns = if self.nodes.count() > 0 && self.solve(columns) { columns } else { 0 };
    }

    /// Forgets matrix and factors: the impulses change.
    pub fn leave(&mut self) {
        (self.room, self.filled, self.columns) = (0, 0, 0);
    }

    /// Corrects the impulses and the velocities, if there are factors; `free` sets those without contacts. Factors are
    /// those of the impulses and of their changes, if these are known and `wide`.
    pub fn correct<L: Law>(
        &mut self,
        problem: &mut Problem<D>,
        free: &dyn Fn(&Bodies<D>),
        wide: bool,
    ) -> bool {
        self.idle = 0;
        if wide && self.changes_known() == 0 {
            return false;
        }
        self.assemble::<L>(problem, wide);
        let columns = if wide { self.filled } else { 1 };
        if self.columns != columns {
            self.find(columns);
        }
        let corrects = self.bound();
        if corrects {
            self.apply::<L>(problem);
            self.leave();
            free(&problem.bodies);
            problem.apply_impulses();
        }
        self.columns = 0;
        corrects
    }

    /// Changes that are known.
    fn changes_known(&self) -> usize {
        self.known - usize::from(self.marked)
    }

    /// Entry of a column at contact `k`.
    #[inline(always)]
    fn value(&self, c: &Contact<D>, f: usize, k: usize) -> Vector<D> {
        if f == 0 { c.impulse } else { kept(&self.changes[f - 1 + usize::from(self.marked)][k]) }
    }

    /// The same of the resistance to rolling.
    #[inline(always)]
    fn rolling_value(&self, r: &Rolling, f: usize, k: usize) -> f64 {
        match f {
            0 => r.impulse.get(),
            _ => f64::from(self.rolled[f - 1 + usize::from(self.marked)][k]) / RANGE,
        }
    }

    /// Solves for the factors of all nodes in some columns. Returns whether there are any.
    fn solve(&mut self, columns: usize) -> bool {
        let nodes = self.nodes.count();
        let (size, width) = (nodes * columns, (self.nodes.reach() + 1) * columns - 1);
        let mut scales = std::mem::take(&mut self.scales);
        let scale = |k: usize| {
            let diagonal = self.entry(k / columns, 0, k % columns, k % columns);
            diagonal.max(f64::MIN_POSITIVE).sqrt().recip()
        };
        scales.clear();
        scales.extend((0..size).map(scale));
        let scale = &scales;
        let (mut band, mut theta) = (std::mem::take(&mut self.band), std::mem::take(&mut self.theta));
        band.clear();
        band.resize(size * (width + 1), 0.0);
        for node in 0..nodes {
            for offset in 0..offsets(D) {
                let other = self.nodes.other(node, offset);
                for (f, g) in (0..columns * columns).map(|k| (k / columns, k % columns)) {
                    let value = self.entry(node, offset, f, g);
                    let (row, column) = (other.wrapping_mul(columns) + g, node * columns + f);
                    if value != 0.0 && row >= column {
                        band[row * (width + 1) + column + width - row] = value * scale[row] * scale[column];
                    }
                }
            }
        }
        for row in 0..size {
            let diagonal = &mut band[row * (width + 1) + width];
            *diagonal = if *diagonal > 0.0 { 1.0 + DAMPING } else { 1.0 };
        }
        theta.clear();
        theta.extend((0..size).map(|k| self.known(k, columns) * scale[k]));
        let solved = crate::band::solve(&mut band, width, &mut theta);
        theta.iter_mut().zip(scale).for_each(|(theta, scale)| *theta *= scale);
        (self.band, self.theta, self.scales) = (band, theta, scales);
        solved
    }

    /// Work of the present velocities on the change of the impulses, J.
    fn gain(&self) -> f64 {
        let columns = self.columns;
        if columns == 0 {
            return 0.0;
        }
        self.theta.iter().enumerate().map(|(k, theta)| theta * self.known(k, columns)).sum()
    }

    /// Keeps the factors within bounds, and takes the best share of what they leave of the step. Returns whether
    /// anything is gained.
    fn bound(&mut self) -> bool {
        let columns = self.columns;
        if columns == 0 {
            return false;
        }
        for (k, theta) in self.theta.iter_mut().enumerate() {
            *theta = theta.clamp(if k % columns == 0 { SMALLEST } else { -LARGEST }, LARGEST);
        }
        let (gain, mut cost) = (self.gain(), 0.0);
        for node in 0..self.nodes.count() {
            for offset in 0..offsets(D) {
                let twice = if offset == 0 { 1.0 } else { 2.0 };
                for (f, g) in (0..columns * columns).map(|k| (k / columns, k % columns)) {
                    let value = self.entry(node, offset, f, g);
                    if value != 0.0 {
                        let other = self.theta[self.nodes.other(node, offset) * columns + g];
                        cost += twice * value * self.theta[node * columns + f] * other;
                    }
                }
            }
        }
        if !(gain > 0.0 && cost > 0.0) {
            return false;
        }
        let share = (gain / cost).min(1.0);
        self.theta.iter_mut().for_each(|theta| *theta *= share);
        true
    }

    fn apply<L: Law>(&self, problem: &mut Problem<D>) {
        let (columns, theta) = (self.columns, &self.theta);
        let mut contacts = std::mem::take(&mut problem.contacts);
        let correct = |(k, c): (usize, &mut Contact<D>)| {
            if !problem.is_corrected(k, c) {
                return;
            }
            let mut factors = [0.0; COLUMNS];
            self.nodes.around(&problem.point(c), |node, weight| {
                let first = self.nodes.number(&node) * columns;
                (0..columns).for_each(|f| factors[f] += weight * theta[first + f]);
            });
            let change: Vector<D> = (0..columns).map(|f| self.value(c, f, k) * factors[f]).sum();
            let cohesion = if L::COHESION { problem.cohesion[k] } else { 0.0 };
            let p = c.impulse + change;
            let normal = p.dot(&c.normal).max(-cohesion);
            let tangential = p - c.normal * p.dot(&c.normal);
            c.impulse = c.normal * normal;
            if L::FRICTION {
                c.impulse += cut(&c.normal, tangential, c.friction * (normal + cohesion));
            }
            if L::ROLLING {
                let r = &problem.rolling[k];
                let change: f64 = (0..columns).map(|f| self.rolling_value(r, f, k) * factors[f]).sum();
                let most = r.most(normal + cohesion);
                r.impulse.set((r.impulse.get() + change).max(-most).min(most));
            }
        };
        // Handing work to other threads allocates now and then.
        if contacts.len() > FORK {
            contacts.par_iter_mut().with_min_len(FORK).enumerate().for_each(correct);
        } else {
            contacts.iter_mut().enumerate().for_each(correct);
        }
        problem.contacts = contacts;
    }
}

#[cfg(test)]
mod tests;
