//! The symbolic side of the multifrontal solver: fronts, what they hold and where.

use super::dissection::{Dissection, NONE};
use super::matrix::Pattern;

/// A block of the matrix and its place in a front, both in nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub position: u32,
    pub row: u32,
    pub column: u32,
}

/// Nodes `first .. first + length` of the rows of a child are the nodes `target ..` of its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub first: u32,
    pub length: u32,
    pub target: u32,
}

/// A dense matrix of the elimination: the nodes it eliminates (pivots), numbered from `start` in
/// the order of elimination, and the later nodes they are coupled to (rows).
#[derive(Clone, Debug, Default)]
pub(crate) struct Front {
    pub start: usize,
    pub pivots: usize,
    pub rows: Vec<u32>,
    /// Fronts whose update matrix is added to this one, ascending.
    pub children: Vec<u32>,
    /// Places of `rows` among the nodes of the parent, pivots counted first.
    pub runs: Vec<Run>,
    pub entries: Vec<Entry>,
    /// Totals over the fronts of the subtree that ends here.
    pub subtree: Totals,
    /// Whether the children are worth tasks of their own. Depends on the pattern only, so that the
    /// memory does not depend on the number of threads.
    pub forks: bool,
}

/// Sizes of a subtree, in scalars of a matrix with the block size given to [`Symbolic::new`].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    pub fronts: usize,
    pub pivots: usize,
    pub rows: usize,
    /// Entries of the panels, pivots and what is below them.
    pub panels: usize,
    /// Entries of the rows of the pivots behind the panels.
    pub uppers: usize,
    /// Memory of the factorisation: update matrices that live at the same time.
    pub work: usize,
    pub flops: f64,
}

/// Fronts in postorder: children before their parent, the last one is the root.
#[derive(Clone, Debug)]
pub(crate) struct Symbolic {
    /// The nodes in the order of elimination.
    pub order: Vec<u32>,
    pub fronts: Vec<Front>,
}

/// A subtree may get a task of its own if it has at least this many operations ..
const FORK_FLOPS: f64 = 2e7;
/// .. and at least this part of all: tasks that run at the same time need memory of their own.
const FORK_PART: f64 = 1.0 / 32.0;

/// A child is merged into its parent only if it has at most this number of pivots, in scalars ..
const MERGE_PIVOTS: usize = 32;
/// .. and if all merges together add at most this part to the entries of the front.
const MERGE_FILL: f64 = 0.3;

impl Symbolic {
    /// Analyses a pattern in the order of a dissection, for blocks of `block` unknowns.
    pub fn new(pattern: &Pattern, dissection: &Dissection, block: usize) -> Self {
        let mut parents = dissection.parents.clone();
        let mut starts = dissection.starts.clone();
        // One root: a last part without nodes if there are several, or none.
        let roots: Vec<usize> = (0..parents.len()).filter(|&part| parents[part] == NONE).collect();
        if roots.len() != 1 {
            let root = parents.len() as u32;
            roots.iter().for_each(|&part| parents[part] = root);
            parents.push(NONE);
            starts.push(dissection.order.len() as u32);
        }
        let mut ranks = vec![0u32; dissection.order.len()];
        for (rank, &node) in dissection.order.iter().enumerate() {
            ranks[node as usize] = rank as u32;
        }
        let mut symbolic = Self { order: dissection.order.clone(), fronts: Vec::new() };
        symbolic.fronts = make_fronts(pattern, &symbolic.order, &ranks, &starts, &parents);
        symbolic.merge(block);
        symbolic.place_entries(pattern, &ranks);
        symbolic.place_rows();
        symbolic.add_totals(block);
        symbolic
    }

    /// The root, which ends the last subtree.
    pub fn root(&self) -> usize {
        self.fronts.len() - 1
    }

    /// Merges children into parents where the larger fronts cost less than the handling of two.
    ///
    /// The pivots of the last child directly precede those of its parent, so only it can be merged
    /// without a new order; that suffices for chains, which separators of two or three nodes make.
    fn merge(&mut self, block: usize) {
        let old = std::mem::take(&mut self.fronts);
        let mut numbers = vec![0u32; old.len()];
        // Blocks that the parts of each merged front have without the zeros of merging.
        let mut needed: Vec<usize> = Vec::new();
        for (number, mut front) in old.into_iter().enumerate() {
            for child in &mut front.children {
                *child = numbers[*child as usize];
            }
            let mut need = blocks(front.pivots, front.rows.len());
            while let Some(child) = self.fronts.last() {
                let last = self.fronts.len() - 1;
                let together = blocks(child.pivots + front.pivots, front.rows.len());
                let fill = together as f64 / (need + needed[last]) as f64 - 1.0;
                let is_child = front.children.last() == Some(&(last as u32));
                if !is_child || child.pivots * block > MERGE_PIVOTS || fill > MERGE_FILL {
                    break;
                }
                let child = self.fronts.pop().expect("the child is there");
                need += needed.pop().expect("as many as fronts");
                front.children.pop();
                front.children.extend(child.children);
                front.start = child.start;
                front.pivots += child.pivots;
            }
            numbers[number] = self.fronts.len() as u32;
            self.fronts.push(front);
            needed.push(need);
        }
    }

    /// Finds the front and the place of every block of the matrix: the front that eliminates the
    /// first of its two nodes.
    fn place_entries(&mut self, pattern: &Pattern, ranks: &[u32]) {
        let mut local = vec![0u32; ranks.len()];
        let transposed = pattern.transposed_positions();
        for front in &mut self.fronts {
            for (place, &rank) in front.rows.iter().enumerate() {
                local[rank as usize] = (front.pivots + place) as u32;
            }
            for pivot in 0..front.pivots {
                local[front.start + pivot] = pivot as u32;
            }
            for pivot in 0..front.pivots {
                let node = self.order[front.start + pivot] as usize;
                for position in pattern.range(node) {
                    let rank = ranks[pattern.columns[position] as usize] as usize;
                    if rank < front.start {
                        continue;
                    }
                    let (row, column) = (pivot as u32, local[rank]);
                    front.entries.push(Entry { position: position as u32, row, column });
                    if column as usize >= front.pivots {
                        let mirror = transposed[position];
                        front.entries.push(Entry { position: mirror, row: column, column: row });
                    }
                }
            }
        }
    }

    /// Finds the place of each child's rows in its parent.
    fn place_rows(&mut self) {
        for parent in 0..self.fronts.len() {
            for child in self.fronts[parent].children.clone() {
                let front = &self.fronts[parent];
                let places = self.fronts[child as usize].rows.iter().map(|&rank| {
                    if (rank as usize) < front.start + front.pivots {
                        rank as usize - front.start
                    } else {
                        front.pivots
                            + front.rows.binary_search(&rank).expect("rows of a child are in its parent")
                    }
                });
                let mut runs: Vec<Run> = Vec::new();
                for (first, target) in places.enumerate() {
                    match runs.last_mut() {
                        // Runs do not cross from the pivots of the parent to its rows.
                        Some(run)
                            if (run.target + run.length) as usize == target && target != front.pivots =>
                        {
                            run.length += 1;
                        }
                        _ => runs.push(Run { first: first as u32, length: 1, target: target as u32 }),
                    }
                }
                self.fronts[child as usize].runs = runs;
            }
        }
    }

    fn add_totals(&mut self, block: usize) {
        let all: f64 =
            self.fronts.iter().map(|front| flops(block * front.pivots, block * front.rows.len())).sum();
        let fork_above = FORK_FLOPS.max(FORK_PART * all);
        for number in 0..self.fronts.len() {
            let front = &self.fronts[number];
            let (pivots, rows) = (block * front.pivots, block * front.rows.len());
            let mut totals = Totals {
                fronts: 1,
                pivots,
                rows,
                panels: pivots * (pivots + rows),
                uppers: pivots * rows,
                work: 0,
                flops: flops(pivots, rows),
            };
            let own = rows * rows;
            let of_children: Vec<Totals> =
                front.children.iter().map(|&child| self.fronts[child as usize].subtree).collect();
            let forks = of_children.iter().filter(|child| child.flops > fork_above).count() > 1;
            // The update matrices of the children wait at the beginning of their memory.
            let mut waiting = 0;
            for (child, &number) in of_children.iter().zip(&front.children) {
                totals.fronts += child.fronts;
                totals.pivots += child.pivots;
                totals.rows += child.rows;
                totals.panels += child.panels;
                totals.uppers += child.uppers;
                totals.flops += child.flops;
                totals.work = totals.work.max(waiting + child.work);
                let rows = block * self.fronts[number as usize].rows.len();
                waiting += if forks { child.work } else { rows * rows };
            }
            totals.work += own;
            self.fronts[number].subtree = totals;
            self.fronts[number].forks = forks;
        }
    }
}

/// Operations of a front.
fn flops(pivots: usize, rows: usize) -> f64 {
    let (s, r) = (pivots as f64, rows as f64);
    s * s * s * (2.0 / 3.0) + 2.0 * s * s * r + 2.0 * s * r * r
}

/// Number of blocks in a front without its update matrix.
fn blocks(pivots: usize, rows: usize) -> usize {
    pivots * (pivots + 2 * rows)
}

/// The fronts of the parts: what the pivots are coupled to by the matrix or by what their children
/// leave.
fn make_fronts(
    pattern: &Pattern,
    order: &[u32],
    ranks: &[u32],
    starts: &[u32],
    parents: &[u32],
) -> Vec<Front> {
    let mut fronts: Vec<Front> = Vec::with_capacity(parents.len());
    let mut children = vec![Vec::new(); parents.len()];
    let mut seen = vec![NONE; order.len()];
    for (part, &parent) in parents.iter().enumerate() {
        let (start, end) = (starts[part] as usize, starts[part + 1] as usize);
        let mut front = Front { start, pivots: end - start, ..Front::default() };
        front.children = std::mem::take(&mut children[part]);
        let mut add = |rank: u32| {
            if rank as usize >= end && seen[rank as usize] != part as u32 {
                seen[rank as usize] = part as u32;
                front.rows.push(rank);
            }
        };
        for &node in &order[start..end] {
            pattern.row(node as usize).iter().for_each(|&other| add(ranks[other as usize]));
        }
        for &child in &front.children {
            let child: &Front = &fronts[child as usize];
            child.rows.iter().for_each(|&rank| add(rank));
        }
        front.rows.sort_unstable();
        if parent != NONE {
            children[parent as usize].push(part as u32);
        }
        fronts.push(front);
    }
    fronts
}
