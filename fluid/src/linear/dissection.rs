//! Nested dissection of the graph of the nodes, steered by where the nodes are.

use super::matrix::Pattern;
use super::separator::refine;

/// No parent.
pub(crate) const NONE: u32 = u32::MAX;

/// Cuts leave at least this part of the nodes on each side.
const SMALLEST_SIDE: f64 = 0.4;

/// An elimination order made of parts: leaves (connected pieces, eliminated whole) and separators,
/// which follow the parts that they separate.
#[derive(Clone, Debug, Default)]
pub(crate) struct Dissection {
    /// The nodes in the order of elimination.
    pub order: Vec<u32>,
    /// Where each part begins in `order`; one more entry than there are parts.
    pub starts: Vec<u32>,
    /// The part that separates each part from others; `NONE` for roots.
    pub parents: Vec<u32>,
}

/// Which side of a cut a node is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// Not among the nodes that are being cut.
    Outside,
    Left,
    Right,
    Separator,
}

struct Dissector<'a> {
    pattern: &'a Pattern,
    leaf: usize,
    side: Vec<Side>,
    place: Vec<u32>,
    result: Dissection,
}

/// Cuts the graph until pieces have at most `leaf` nodes. `directions` are the coordinates along
/// which straight cuts are tried, one value per node each.
pub(crate) fn dissect(pattern: &Pattern, directions: &[Vec<f64>], leaf: usize) -> Dissection {
    let nodes = pattern.nodes();
    let mut dissector = Dissector {
        pattern,
        leaf: leaf.max(1),
        side: vec![Side::Outside; nodes],
        place: vec![0; nodes],
        result: Dissection { starts: vec![0], ..Dissection::default() },
    };
    // Sorted once; the pieces inherit the order.
    let sorted = |direction: &Vec<f64>| {
        let mut order: Vec<u32> = (0..nodes as u32).collect();
        order.sort_by(|&a, &b| direction[a as usize].total_cmp(&direction[b as usize]).then(a.cmp(&b)));
        order
    };
    dissector.cut(directions.iter().map(sorted).collect());
    dissector.result
}

impl Dissector<'_> {
    /// Orders the nodes of one piece, given sorted along every direction. Returns its parts that
    /// have no parent yet.
    fn cut(&mut self, sorted: Vec<Vec<u32>>) -> Vec<u32> {
        let nodes = sorted[0].len();
        if nodes <= self.leaf {
            return if nodes == 0 { Vec::new() } else { vec![self.add(&sorted[0], &[])] };
        }
        let best = (0..sorted.len())
            .map(|direction| (self.sweep(&sorted[direction]), direction))
            .min_by(|(a, _), (b, _)| a.1.total_cmp(&b.1))
            .map(|((cut, _), direction)| (cut, direction));
        let (cut, direction) = best.expect("there is a direction");
        self.separate(&sorted[direction], cut);
        refine(self.pattern, &sorted[direction], &mut self.side);

        let pick = |nodes: &[u32], side: Side| -> Vec<u32> {
            nodes.iter().copied().filter(|&node| self.side[node as usize] == side).collect()
        };
        let left: Vec<_> = sorted.iter().map(|nodes| pick(nodes, Side::Left)).collect();
        let right: Vec<_> = sorted.iter().map(|nodes| pick(nodes, Side::Right)).collect();
        // Along the separator: the direction in which it is longest is one that was not chosen, or
        // as good as any.
        let along = (direction + sorted.len() / 2) % sorted.len();
        let separator = pick(&sorted[along], Side::Separator);
        for &node in &sorted[0] {
            self.side[node as usize] = Side::Outside;
        }
        let largest = left[0].len().max(right[0].len());
        if largest == 0 || largest == nodes {
            return vec![self.add(&sorted[0], &[])];
        }
        drop(sorted);
        let mut open = self.cut(left);
        open.extend(self.cut(right));
        if separator.is_empty() { open } else { vec![self.add(&separator, &open)] }
    }

    /// Appends a part that separates others.
    fn add(&mut self, nodes: &[u32], separated: &[u32]) -> u32 {
        let part = self.result.parents.len() as u32;
        self.result.order.extend_from_slice(nodes);
        self.result.starts.push(self.result.order.len() as u32);
        self.result.parents.push(NONE);
        for &child in separated {
            self.result.parents[child as usize] = part;
        }
        part
    }

    /// The best cut of a sorted piece: how many nodes go to the left, and the price.
    ///
    /// If the nodes before a cut go to the left, those of them with a neighbour behind it separate
    /// the rest. Node k with its furthest neighbour at f counts for the cuts k+1 ..= f, so the
    /// widths of all cuts follow from one pass of differences.
    fn sweep(&mut self, sorted: &[u32]) -> (usize, f64) {
        let nodes = sorted.len();
        for (place, &node) in sorted.iter().enumerate() {
            self.place[node as usize] = place as u32;
            self.side[node as usize] = Side::Left;
        }
        let mut change = vec![0i32; nodes + 2];
        for (place, &node) in sorted.iter().enumerate() {
            let neighbours = self.pattern.row(node as usize).iter().map(|&other| other as usize);
            let inside = neighbours.filter(|&other| self.side[other] != Side::Outside);
            let furthest = inside.map(|other| self.place[other] as usize).max().unwrap_or(place);
            change[place + 1] += 1;
            change[furthest.max(place) + 1] -= 1;
        }
        for &node in sorted {
            self.side[node as usize] = Side::Outside;
        }
        let first = ((SMALLEST_SIDE * nodes as f64) as usize).max(1);
        let last = nodes - first;
        let mut best = (nodes / 2, f64::INFINITY);
        let mut width = 0;
        for (cut, change) in change.iter().enumerate().take(last + 1) {
            width += change;
            let imbalance = (cut as f64 / nodes as f64 - 0.5).abs();
            let price = width as f64 * (1.0 + imbalance);
            if cut >= first && price < best.1 {
                best = (cut, price);
            }
        }
        best
    }

    /// Marks the sides of a cut; the separator is on the left of it.
    fn separate(&mut self, sorted: &[u32], cut: usize) {
        for &node in &sorted[..cut] {
            self.side[node as usize] = Side::Left;
        }
        for &node in &sorted[cut..] {
            self.side[node as usize] = Side::Right;
        }
        for &node in &sorted[..cut] {
            let touches = |&other: &u32| self.side[other as usize] == Side::Right;
            if self.pattern.row(node as usize).iter().any(touches) {
                self.side[node as usize] = Side::Separator;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample::Grid;
    use super::*;

    /// Every node is in the order once, every edge joins a part to itself or to one above it, and
    /// the separators of a square are no longer than its side.
    #[test]
    fn parts_are_separated() {
        let grid = Grid::<2>::new(40);
        let pattern = grid.pattern();
        let directions: Vec<Vec<f64>> = (0..2).map(|d| grid.points.iter().map(|x| x[d]).collect()).collect();
        let dissection = dissect(&pattern, &directions, 8);
        let mut part_of = vec![NONE; pattern.nodes()];
        for part in 0..dissection.parents.len() {
            for &node in
                &dissection.order[dissection.starts[part] as usize..dissection.starts[part + 1] as usize]
            {
                assert_eq!(part_of[node as usize], NONE);
                part_of[node as usize] = part as u32;
            }
        }
        assert!(part_of.iter().all(|&part| part != NONE));
        for node in 0..pattern.nodes() {
            for &other in pattern.row(node) {
                let (low, high) =
                    (part_of[node].min(part_of[other as usize]), part_of[node].max(part_of[other as usize]));
                let mut above = low;
                while above != high {
                    above = dissection.parents[above as usize];
                    assert_ne!(above, NONE, "an edge joins two parts that are not separated");
                }
            }
        }
        let root = dissection.parents.len() - 1;
        assert!(dissection.starts[root + 1] - dissection.starts[root] <= 40);
    }
}
