//! Pairs that are met, against all pairs, and the tiles of mixtures.

use super::*;
use rand::{Rng, SeedableRng};

fn pairs_match_brute_force<const D: usize>(radii: [f64; 2], every: usize, far: f64) -> Grid<D> {
    let reach = 0.02;
    let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
    let n = 400;
    let x: Vec<Vector<D>> = (0..n).map(|_| Vector::from_fn(|_, _| rng.random_range(0.0..10.0))).collect();
    let r: Vec<f64> = (0..n).map(|k| if k % every == 0 { radii[1] } else { radii[0] }).collect();
    let mut x = x;
    x[5] = Vector::repeat(far); // an outlier, and one beside it
    x[6] = Vector::repeat(far + radii[0]);
    let mut grid = Grid::<D>::default();
    grid.build(&x, &r, reach, &Period::default());
    let close = |i: usize, j: usize| (x[i] - x[j]).norm() < r[i] + r[j] + reach;
    let mut found = vec![];
    for t in 0..grid.tiles.len() {
        grid.each_in_tile(t, |_, a, others| {
            for b in others.into_iter().flatten() {
                let (i, j) = (grid.grain_of[a] as usize, grid.grain_of[b] as usize);
                if close(i, j) {
                    found.push((i.min(j), i.max(j)));
                }
            }
        });
    }
    found.sort_unstable();
    let all: Vec<_> =
        (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).filter(|&(i, j)| close(i, j)).collect();
    assert_eq!(found, all);
    grid
}

#[test]
fn every_pair_is_met_once() {
    pairs_match_brute_force::<2>([0.1, 0.1], 40, 1e6);
    pairs_match_brute_force::<2>([0.1, 0.1], 40, 5.0);
    pairs_match_brute_force::<2>([0.02, 2.0], 40, 5.0);
    pairs_match_brute_force::<3>([0.3, 0.3], 40, 1e6);
    pairs_match_brute_force::<3>([0.3, 2.0], 40, 5.0);
}

/// Every pair is met once, by its shortest way, in domains that are periodic along one axis or both.
#[test]
fn every_pair_is_met_once_across_periodic_sides() {
    let x_only = [Some([0.0, 10.0]), None];
    for (sides, radii, reach) in [
        (x_only, [0.1, 0.1], 0.02),
        (x_only, [0.05, 1.2], 0.02),
        (x_only, [0.1, 0.1], 7.0),
        ([Some([0.0, 10.0]); 2], [0.1, 0.1], 0.02),
        ([Some([0.0, 10.0]); 2], [0.05, 1.2], 0.5),
        ([Some([0.0, 10.0]); 2], [0.1, 0.1], 7.0),
    ] {
        let period = Period::<2>::new(sides).unwrap();
        let mut rng = rand_pcg::Pcg64::seed_from_u64(11);
        let n = 500;
        let x: Vec<Vector<2>> = (0..n).map(|_| Vector::from_fn(|_, _| rng.random_range(0.0..10.0))).collect();
        let r: Vec<f64> = (0..n).map(|k| if k % 90 == 0 { radii[1] } else { radii[0] }).collect();
        let mut grid = Grid::<2>::default();
        grid.build(&x, &r, reach, &period);
        let close = |i: usize, j: usize| period.nearest(x[i] - x[j]).norm() < r[i] + r[j] + reach;
        let mut found = vec![];
        for t in 0..grid.tiles.len() {
            grid.each_in_tile(t, |_, a, others| {
                for b in others.into_iter().flatten() {
                    let (i, j) = (grid.grain_of[a] as usize, grid.grain_of[b] as usize);
                    let across = period.crosses(&(x[i] - x[j]));
                    if across == (grid.tiles[t] == Tile::Across) && close(i, j) {
                        found.push((i.min(j), i.max(j)));
                    }
                }
            });
        }
        found.sort_unstable();
        let all: Vec<_> =
            (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).filter(|&(i, j)| close(i, j)).collect();
        assert!(found == all, "{sides:?} {radii:?} {reach}: {} of {}", found.len(), all.len());
    }
}

#[test]
fn an_endless_reach_was_an_index_out_of_bounds() {
    for reach in [f64::INFINITY, f64::NAN, 1e300] {
        let mut grid = Grid::<2>::default();
        grid.build(&[Vector::<2>::zeros(), Vector::<2>::repeat(1.0)], &[0.1, 0.2], reach, &Period::default());
        let mut met = 0;
        for tile in 0..grid.tiles.len() {
            grid.each_in_tile(tile, |_, _, others| met += others.map_or(0, |others| others.len()));
        }
        assert_eq!(met, 1, "{reach}");
    }
}

#[test]
fn one_large_grain_does_not_widen_the_tiles_of_the_others() {
    let grid = pairs_match_brute_force::<2>([0.1, 0.5], 400, 5.0);
    assert!(grid.levels > 1 && grid.base == 0, "levels {}, base {}", grid.levels, grid.base);
    assert_eq!(grid.tiles.iter().filter(|tile| **tile == Tile::Wide).count(), 1);
    let grid = pairs_match_brute_force::<2>([0.1, 0.5], 4, 5.0);
    assert!(!grid.tiles.contains(&Tile::Wide), "many large grains are swept with the others");
}
