//! All methods against a dense oracle and against each other.

use super::sample::{Grid, oseen};
use super::*;
use crate::Vector;
use std::sync::Arc;

const METHODS: [Method; 4] = [Method::Multifrontal, Method::MultifrontalFresh, Method::Ilu, Method::Lu];

fn points<const D: usize>(grid: &Grid<D>) -> Vec<Vector<D>> {
    grid.points.iter().map(|&x| Vector::from(x)).collect()
}

fn options(method: Method, tolerance: f64) -> Options {
    Options { method, tolerance, ..Options::default() }
}

/// The solution by dense LU with partial pivoting, for small systems.
fn dense_solution<const B: usize>(matrix: &BlockMatrix<B>, rhs: &[f64]) -> Vec<f64> {
    let mut dense = nalgebra::DMatrix::zeros(matrix.unknowns(), matrix.unknowns());
    for row in 0..matrix.pattern.nodes() {
        for position in matrix.pattern.range(row) {
            let column = matrix.pattern.columns[position] as usize;
            for r in 0..B {
                for c in 0..B {
                    dense[(B * row + r, B * column + c)] = matrix.values[position][r][c];
                }
            }
        }
    }
    let solution = dense.full_piv_lu().solve(&nalgebra::DVector::from_row_slice(rhs));
    solution.expect("regular").as_slice().to_vec()
}

/// Largest difference of one component relative to its largest value.
fn difference<const B: usize>(x: &[f64], y: &[f64], component: usize) -> f64 {
    let largest = |v: &mut dyn Iterator<Item = f64>| v.fold(0.0, |a: f64, b| a.max(b.abs()));
    let of = |v: &[f64], i: usize| v[B * i + component];
    let nodes = x.len() / B;
    largest(&mut (0..nodes).map(|i| of(x, i) - of(y, i))) / largest(&mut (0..nodes).map(|i| of(y, i)))
}

/// Pseudo-random numbers in (-1, 1).
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A random matrix on a pattern, made regular by a dominant diagonal.
fn random<const B: usize>(pattern: &Arc<Pattern>, seed: u64) -> BlockMatrix<B> {
    let mut noise = noise(seed);
    let mut matrix = BlockMatrix::<B>::new(pattern.clone());
    for entry in matrix.values.as_flattened_mut().as_flattened_mut() {
        *entry = noise();
    }
    for node in 0..pattern.nodes() {
        let dominant = 0.6 * B as f64 * pattern.row(node).len() as f64;
        for c in 0..B {
            matrix.values[pattern.diagonal(node)][c][c] += dominant;
        }
    }
    matrix
}

fn random_agrees<const D: usize, const B: usize>(per_side: usize) {
    let grid = Grid::<D>::new(per_side);
    let pattern = grid.pattern();
    let matrix = random::<B>(&pattern, 3);
    let mut noise = noise(4);
    let rhs: Vec<f64> = (0..matrix.unknowns()).map(|_| noise()).collect();
    let exact = dense_solution(&matrix, &rhs);
    for method in METHODS {
        let mut solver = Solver::new(pattern.clone(), &points(&grid), options(method, 1e-11));
        let mut x = vec![0.0; rhs.len()];
        let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
        assert_eq!(report.method, method);
        for component in 0..B {
            assert!(difference::<B>(&x, &exact, component) < 1e-9, "{method:?}");
        }
    }
}

#[test]
fn random_systems_agree_with_dense() {
    random_agrees::<2, 1>(12);
    random_agrees::<2, 3>(9);
    random_agrees::<3, 1>(6);
    random_agrees::<3, 4>(5);
}

fn oseen_agrees<const D: usize, const B: usize>(per_side: usize) {
    let grid = Grid::<D>::new(per_side);
    let pattern = grid.pattern();
    let (matrix, rhs) = oseen::<D, B>(&grid, &pattern, 0.0);
    let exact = dense_solution(&matrix, &rhs);
    for method in METHODS {
        let mut solver = Solver::new(pattern.clone(), &points(&grid), options(method, 1e-10));
        let mut x = vec![0.0; rhs.len()];
        let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
        assert_eq!(report.method, method);
        for component in 0..B {
            let difference = difference::<B>(&x, &exact, component);
            assert!(difference < 1e-7, "{method:?} {component}: {difference:.1e}, {report:?}");
        }
    }
}

#[test]
fn flow_with_drag_agrees_with_dense() {
    oseen_agrees::<2, 3>(14);
    oseen_agrees::<3, 4>(6);
}

#[test]
fn kept_factors_serve_while_the_matrix_changes() {
    let grid = Grid::<2>::new(30);
    let pattern = grid.pattern();
    let mut solver = Solver::new(pattern.clone(), &points(&grid), options(Method::Multifrontal, 1e-8));
    let mut oracle = Solver::new(pattern.clone(), &points(&grid), options(Method::Lu, 1e-10));
    let mut x = vec![0.0; 3 * pattern.nodes()];
    let (mut y, mut factored) = (x.clone(), 0);
    for step in 0..10 {
        let (matrix, rhs) = oseen::<2, 3>(&grid, &pattern, 0.002 * step as f64);
        let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
        assert_eq!(report.method, Method::Multifrontal);
        factored += report.factored as usize;
        oracle.solve(&matrix, &rhs, &mut y).unwrap();
        for component in 0..3 {
            let difference = difference::<3>(&x, &y, component);
            assert!(difference < 1e-5, "step {step}, component {component}: {difference:.1e}");
        }
    }
    assert!(factored < 10, "factors were made {factored} times");
}

#[test]
fn singular_and_broken_systems_are_errors() {
    let grid = Grid::<2>::new(8);
    let pattern = grid.pattern();
    let regular = random::<3>(&pattern, 1);
    let rhs = vec![1.0; regular.unknowns()];
    let mut empty_row = regular.clone();
    empty_row.set_identity_row(5, 1, 0.0);
    // Twice the same equation with different right-hand sides.
    let mut dependent = regular.clone();
    for position in pattern.range(9) {
        dependent.values[position][2] = dependent.values[position][0];
    }
    let mut other_rhs = rhs.clone();
    other_rhs[3 * 9 + 2] = 2.0;
    let mut not_finite = regular.clone();
    not_finite.values[7][1][1] = f64::NAN;
    let mut infinite_rhs = rhs.clone();
    infinite_rhs[3] = f64::INFINITY;
    for method in METHODS {
        let mut solver = Solver::new(pattern.clone(), &points(&grid), options(method, 1e-8));
        for (matrix, rhs) in
            [(&empty_row, &rhs), (&dependent, &other_rhs), (&not_finite, &rhs), (&regular, &infinite_rhs)]
        {
            let mut x = vec![0.0; rhs.len()];
            assert!(solver.solve(matrix, rhs, &mut x).is_err(), "{method:?}");
            assert!(x.iter().all(|x| x.is_finite()), "{method:?}");
        }
        let mut x = vec![0.0; rhs.len()];
        solver.solve(&regular, &rhs, &mut x).unwrap();
    }
}

#[test]
fn empty_tiny_and_unconnected_systems() {
    for method in METHODS {
        let empty = Arc::new(Pattern::from_cells(0, &[], 3));
        let mut solver = Solver::<3>::new::<2>(empty.clone(), &[], options(method, 1e-8));
        solver.solve(&BlockMatrix::new(empty), &[], &mut []).unwrap();

        // One node, and three nodes of which none knows the others, all at one place.
        for nodes in [1, 3] {
            let pattern = Arc::new(Pattern::from_cells(nodes, &[], 3));
            let mut matrix = BlockMatrix::<1>::new(pattern.clone());
            matrix.values.fill([[4.0]]);
            let mut solver = Solver::new(pattern, &vec![Vector::<2>::zeros(); nodes], options(method, 1e-8));
            let mut x = vec![0.0; nodes];
            solver.solve(&matrix, &vec![8.0; nodes], &mut x).unwrap();
            assert_eq!(x, vec![2.0; nodes]);
        }
    }
}

#[test]
fn zero_right_hand_side_gives_zero() {
    let grid = Grid::<2>::new(5);
    let pattern = grid.pattern();
    let matrix = random::<3>(&pattern, 1);
    let mut solver = Solver::new(pattern, &points(&grid), Options::default());
    let mut x = vec![1.0; matrix.unknowns()];
    solver.solve(&matrix, &vec![0.0; matrix.unknowns()], &mut x).unwrap();
    assert!(x.iter().all(|&x| x == 0.0));
}

/// Bits of the solution after three steps with a number of threads.
fn bits<const D: usize, const B: usize>(grid: &Grid<D>, method: Method, threads: usize) -> Vec<u64> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let pattern = grid.pattern();
        let mut solver = Solver::<B>::new(pattern.clone(), &points(grid), options(method, 1e-8));
        let mut x = vec![0.0; B * pattern.nodes()];
        for step in 0..3 {
            let (matrix, rhs) = oseen::<D, B>(grid, &pattern, 0.002 * step as f64);
            solver.solve(&matrix, &rhs, &mut x).unwrap();
        }
        x.iter().map(|x| x.to_bits()).collect()
    })
}

#[test]
fn result_does_not_depend_on_the_number_of_threads() {
    let plane = Grid::<2>::new(70);
    for method in METHODS {
        let one = bits::<2, 3>(&plane, method, 1);
        for threads in [1, 2, 4] {
            assert!(one == bits::<2, 3>(&plane, method, threads), "{method:?}, {threads} threads");
        }
    }
    // Large enough for products that are cut into tiles.
    let space = Grid::<3>::new(14);
    for method in [Method::Multifrontal, Method::MultifrontalFresh] {
        let one = bits::<3, 4>(&space, method, 1);
        for threads in [1, 2, 4] {
            assert!(one == bits::<3, 4>(&space, method, threads), "{method:?}, {threads} threads, 3D");
        }
    }
}

/// A mesh whose nodes are crowded in one corner and numbered at random costs about as much.
#[test]
fn graded_mesh_with_random_numbers() {
    let mut grid = Grid::<2>::new(24);
    let nodes = grid.points.len();
    let mut noise = noise(5);
    let keys: Vec<f64> = (0..nodes).map(|_| noise()).collect();
    let mut old: Vec<usize> = (0..nodes).collect();
    old.sort_by(|&a, &b| keys[a].total_cmp(&keys[b]));
    let mut new = vec![0; nodes];
    for (number, &node) in old.iter().enumerate() {
        new[node] = number as u32;
    }
    grid.points = old.iter().map(|&node| grid.points[node].map(|x| x.powf(1.7))).collect();
    grid.cells.iter_mut().for_each(|node| *node = new[*node as usize]);
    let pattern = grid.pattern();
    let (matrix, rhs) = oseen::<2, 3>(&grid, &pattern, 0.0);
    let exact = dense_solution(&matrix, &rhs);
    for method in METHODS {
        let mut solver = Solver::new(pattern.clone(), &points(&grid), options(method, 1e-10));
        let mut x = vec![0.0; rhs.len()];
        assert_eq!(solver.solve(&matrix, &rhs, &mut x).unwrap().method, method);
        for component in 0..3 {
            let difference = difference::<3>(&x, &exact, component);
            assert!(difference < 1e-7, "{method:?} {component}: {difference:.1e}");
        }
    }
}

#[test]
fn forgetting_makes_runs_equal() {
    let grid = Grid::<2>::new(20);
    let pattern = grid.pattern();
    let (first, first_rhs) = oseen::<2, 3>(&grid, &pattern, 0.0);
    let (second, second_rhs) = oseen::<2, 3>(&grid, &pattern, 0.002);
    let mut straight = Solver::new(pattern.clone(), &points(&grid), Options::default());
    let mut x = vec![0.0; 3 * pattern.nodes()];
    straight.solve(&first, &first_rhs, &mut x).unwrap();
    let mut y = x.clone();
    straight.forget();
    straight.solve(&second, &second_rhs, &mut x).unwrap();
    let mut restarted = Solver::new(pattern.clone(), &points(&grid), Options::default());
    restarted.solve(&second, &second_rhs, &mut y).unwrap();
    assert_eq!(x, y);
}
