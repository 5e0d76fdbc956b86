//! Refinement of vertex separators (Fiduccia and Mattheyses, on nodes).

use super::dissection::Side;
use super::matrix::Pattern;

/// Passes without progress end the refinement, and so does this number.
const PASSES: usize = 4;

/// Moves beyond the best state that a pass tries before it gives up.
const PATIENCE: usize = 24;

/// The smaller side keeps at least this part of all nodes.
const SMALLEST_SIDE: f64 = 0.35;

/// Shrinks the separator marked in `side` among `nodes`.
///
/// A move takes a node out of the separator to one side, and the neighbours that it has on the
/// other side into the separator: it gains one minus their number. Each pass makes the best moves,
/// also those that lose, each node once, and goes back to the best state it met.
pub(crate) fn refine(pattern: &Pattern, nodes: &[u32], side: &mut [Side]) {
    let mut separator: Vec<u32> =
        nodes.iter().copied().filter(|&node| side[node as usize] == Side::Separator).collect();
    let count =
        |wanted: Side, side: &[Side]| nodes.iter().filter(|&&node| side[node as usize] == wanted).count();
    let mut sizes = [count(Side::Left, side), count(Side::Right, side)];
    let least = (SMALLEST_SIDE * nodes.len() as f64) as usize;
    let mut moved: Vec<u32> = Vec::new();
    for _ in 0..PASSES {
        let before = separator.len();
        // Changes of this pass in order: node and the side it left.
        let mut journal: Vec<(u32, Side)> = Vec::new();
        let mut best = (score(separator.len(), sizes), 0);
        let mut tries = 0;
        moved.clear();
        while tries < PATIENCE {
            let Some((place, to)) = best_move(pattern, &separator, side, sizes, least, &moved) else { break };
            let node = separator.swap_remove(place);
            let (from, gains, loses) = match to {
                Side::Left => (Side::Right, 0, 1),
                _ => (Side::Left, 1, 0),
            };
            journal.push((node, Side::Separator));
            moved.push(node);
            side[node as usize] = to;
            sizes[gains] += 1;
            for &other in pattern.row(node as usize) {
                if side[other as usize] == from {
                    journal.push((other, from));
                    side[other as usize] = Side::Separator;
                    separator.push(other);
                    sizes[loses] -= 1;
                }
            }
            tries += 1;
            let now = score(separator.len(), sizes);
            if now < best.0 {
                best = (now, journal.len());
                tries = 0;
            }
        }
        for &(node, old) in journal[best.1..].iter().rev() {
            side[node as usize] = old;
        }
        separator = nodes.iter().copied().filter(|&node| side[node as usize] == Side::Separator).collect();
        sizes = [count(Side::Left, side), count(Side::Right, side)];
        if separator.len() >= before {
            return;
        }
    }
}

/// What is made small: first the separator, then the imbalance.
fn score(separator: usize, sizes: [usize; 2]) -> (usize, usize) {
    (separator, sizes[0].abs_diff(sizes[1]))
}

/// The move with the largest gain, of those the one towards the smaller side: place in the
/// separator and the side to go to.
fn best_move(
    pattern: &Pattern,
    separator: &[u32],
    side: &[Side],
    sizes: [usize; 2],
    least: usize,
    moved: &[u32],
) -> Option<(usize, Side)> {
    let mut best: Option<((usize, usize), usize, Side)> = None;
    for (place, &node) in separator.iter().enumerate() {
        if moved.contains(&node) {
            continue;
        }
        let touching = |wanted: Side| {
            pattern.row(node as usize).iter().filter(|&&other| side[other as usize] == wanted).count()
        };
        let (left, right) = (touching(Side::Left), touching(Side::Right));
        for (to, entering, grown, shrunk) in [
            (Side::Left, right, sizes[0] + 1, sizes[1] - right),
            (Side::Right, left, sizes[1] + 1, sizes[0] - left),
        ] {
            if entering > 0 && shrunk < least {
                continue;
            }
            let price = (entering, grown.abs_diff(shrunk));
            if best.is_none_or(|(price_before, ..)| price < price_before) {
                best = Some((price, place, to));
            }
        }
    }
    best.map(|(_, place, to)| (place, to))
}
