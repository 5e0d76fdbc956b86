//! The matrix and the right-hand side of the factors, summed over grains and contacts.

use super::Coarse;
use super::nodes::{COUPLED, NEAR, offsets};
use crate::contact::{Contact, Law};
use crate::parallel;
use crate::solver::{FORK, Problem};
use crate::space::{Vector, turned};

/// What a part of the grains and contacts adds to the matrix and the right-hand side.
#[derive(Default)]
pub(super) struct Chunk {
    /// Blocks with a row and a column for each column in use, node by node, for the node itself and the half of those
    /// around it with higher numbers.
    matrix: Vec<f64>,
    known: Vec<f64>,
}

/// Parts of large problems that are assembled at once; their number does not depend on that of threads, so that the
/// sums do not.
const CHUNKS: usize = 4;

/// What the impulses of a grain's contacts, weighed by one hat function, give it: momentum, and moment over radius.
type Push<const D: usize> = (Vector<D>, f64);

impl<const D: usize> Coarse<D> {
    /// Contacts that press, by grain.
    pub(super) fn list_contacts(&mut self, problem: &Problem<D>) {
        let grains = problem.position.len();
        self.starts.clear();
        self.starts.resize(grains + 1, 0);
        let pressing = || {
            let contacts = problem.contacts.iter().enumerate();
            contacts.filter(|(k, c)| problem.is_corrected(*k, c))
        };
        let sides = |c: &Contact<D>| [c.i, c.j].into_iter().filter(move |i| (*i as usize) < grains);
        for (_, c) in pressing() {
            sides(c).for_each(|i| self.starts[i as usize] += 1);
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.of.clear();
        self.of.resize(sum as usize, 0);
        for (k, c) in pressing() {
            for i in sides(c) {
                self.starts[i as usize] -= 1;
                self.of[self.starts[i as usize] as usize] = k as u32;
            }
        }
    }

    /// Sums the matrix and the right-hand side of the columns in use, with room for F of them.
    pub(super) fn sum<L: Law, const F: usize>(&mut self, problem: &Problem<D>) {
        let (nodes, blocks) = (self.nodes.count(), offsets(D) * F * F);
        let mut chunks = std::mem::take(&mut self.chunks);
        let count = if problem.contacts.len() > 2 * FORK { CHUNKS } else { 1 };
        chunks.resize_with(count, Chunk::default);
        for chunk in &mut chunks {
            chunk.matrix.clear();
            chunk.matrix.resize(nodes * blocks, 0.0);
            chunk.known.clear();
            chunk.known.resize(nodes * F, 0.0);
        }
        let assemble = |k: usize, chunk: &mut Chunk| {
            let range = |all: usize| all * k / count..all * (k + 1) / count;
            range(problem.contacts.len()).for_each(|k| self.know::<L, F>(problem, k, &mut chunk.known));
            let mut pushes = [[(Vector::zeros(), 0.0); F]; NEAR.pow(3)];
            let pushes = &mut pushes[..NEAR.pow(D as u32)];
            for slot in range(problem.position.len()) {
                if problem.bodies.mobility(slot) > 0.0 && self.starts[slot] < self.starts[slot + 1] {
                    let base = self.gather::<L, F>(problem, slot, pushes);
                    self.add(problem, slot, &base, pushes, &mut chunk.matrix);
                }
            }
        };
        parallel::each(&mut chunks, 0, &assemble);
        let (first, others) = chunks.split_at_mut(1);
        for chunk in others {
            first[0].matrix.iter_mut().zip(&chunk.matrix).for_each(|(a, b)| *a += b);
            first[0].known.iter_mut().zip(&chunk.known).for_each(|(a, b)| *a += b);
        }
        self.chunks = chunks;
    }

    /// The right-hand side that a contact gives.
    fn know<L: Law, const F: usize>(&self, problem: &Problem<D>, k: usize, known: &mut [f64]) {
        let (columns, c) = (self.filled, &problem.contacts[k]);
        if !problem.is_corrected(k, c) {
            return;
        }
        let mut u = problem.relative_at::<L>(c) + c.normal * c.bias;
        if problem.slides::<L>(k, c) {
            // What friction takes away is not an error.
            u = c.normal * u.dot(&c.normal);
        }
        let mut work: [f64; F] =
            std::array::from_fn(|f| if f < columns { u.dot(&self.value(c, f, k)) } else { 0.0 });
        if L::ROLLING && !problem.gives_way(k, c) {
            let r = &problem.rolling[k];
            let speed = r.speed(&problem.bodies, c.i, c.j);
            (0..columns).for_each(|f| work[f] += speed * self.rolling_value(r, f, k));
        }
        self.nodes.around(&problem.point(c), |node, weight| {
            let first = self.nodes.number(&node) * F;
            (0..columns).for_each(|f| known[first + f] -= weight * work[f]);
        });
    }

    /// What the contacts of a grain give it, by node and column. Returns the first of its nodes.
    fn gather<L: Law, const F: usize>(
        &self,
        problem: &Problem<D>,
        slot: usize,
        pushes: &mut [[Push<D>; F]],
    ) -> [usize; D] {
        let columns = self.filled;
        let base = self.nodes.cell(&problem.position[slot].add_scalar(-2.0 * problem.radius[slot]));
        pushes.fill([(Vector::zeros(), 0.0); F]);
        for &k in &self.of[self.starts[slot] as usize..self.starts[slot + 1] as usize] {
            let c = &problem.contacts[k as usize];
            let sign = if c.i as usize == slot { -1.0 } else { 1.0 };
            let along = turned(&c.normal);
            let values: [Vector<D>; F] =
                std::array::from_fn(
                    |f| {
                        if f < columns { self.value(c, f, k as usize) } else { Vector::zeros() }
                    },
                );
            let mut moments: [f64; F] = std::array::from_fn(|f| -along.dot(&values[f]));
            if L::ROLLING {
                let r = &problem.rolling[k as usize];
                let arm = sign * r.share[if c.i as usize == slot { 0 } else { 1 }];
                (0..columns).for_each(|f| moments[f] += arm * self.rolling_value(r, f, k as usize));
            }
            self.nodes.around(&problem.point(c), |node, weight| {
                let near = (0..D)
                    .rev()
                    .fold(0, |index, a| index * NEAR + node[a].saturating_sub(base[a]).min(NEAR - 1));
                for f in 0..columns {
                    pushes[near][f].0 += values[f] * (sign * weight);
                    pushes[near][f].1 += moments[f] * weight;
                }
            });
        }
        base
    }

    /// Adds the energies of pairs of pushes of one grain.
    fn add<const F: usize>(
        &self,
        problem: &Problem<D>,
        slot: usize,
        base: &[usize; D],
        pushes: &[[Push<D>; F]],
        matrix: &mut [f64],
    ) {
        let (columns, bodies) = (self.filled, &problem.bodies);
        let (mobility, spin) =
            (bodies.mobility(slot), if bodies.spins() { bodies.spin_mobility(slot) } else { 0.0 });
        let zero = |node: &[Push<D>; F]| node.iter().all(|(p, m)| *m == 0.0 && p.iter().all(|x| *x == 0.0));
        // Nodes that something is pushed at: where in `pushes`, their numbers, and their places in a cube of coupled
        // nodes.
        let mut live = [(0, 0, 0); NEAR.pow(3)];
        let mut count = 0;
        for (near, _) in pushes.iter().enumerate().filter(|(_, push)| !zero(push)) {
            let digits: [usize; D] = std::array::from_fn(|a| near / NEAR.pow(a as u32) % NEAR);
            let node = self.nodes.number(&std::array::from_fn(|a| base[a] + digits[a]));
            let place = (0..D).rev().fold(0, |index, a| index * COUPLED + digits[a]);
            live[count] = (near, node, place);
            count += 1;
        }
        for (k, &(a, node, from)) in live[..count].iter().enumerate() {
            for &(b, _, to) in &live[k..count] {
                let block = &mut matrix[(node * offsets(D) + to - from) * F * F..][..F * F];
                for f in 0..columns {
                    for g in 0..columns {
                        let (p, q) = (&pushes[a][f], &pushes[b][g]);
                        block[f * F + g] += mobility * p.0.dot(&q.0) + spin * p.1 * q.1;
                    }
                }
            }
        }
    }

    /// Entry of the matrix: column f of a node with column g of that at an offset.
    #[inline(always)]
    pub(super) fn entry(&self, node: usize, offset: usize, f: usize, g: usize) -> f64 {
        let room = self.room;
        self.chunks[0].matrix[((node * offsets(D) + offset) * room + f) * room + g]
    }

    /// Right-hand side of an unknown, where so many columns have one at each node.
    pub(super) fn known(&self, k: usize, columns: usize) -> f64 {
        self.chunks[0].known[k / columns * self.room + k % columns]
    }
}
