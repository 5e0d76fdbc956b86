//! Time of one linear solve in a run of time steps, for every method.
//!
//! One thread, so that wall time is processor time. Each measured solve is the next system of a sequence in which
//! velocity and drag change, from the last solution: kept factors age and are made anew as in a run.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::time::Duration;
use voidage_fluid::Vector;
use voidage_fluid::linear::{BlockMatrix, Method, Options, Pattern, Solver};

#[path = "../src/linear/sample.rs"]
mod sample;

use sample::{Grid, oseen};

/// Time of the sample between two systems, s: the drag changes by up to 2 %.
const STEP: f64 = 0.002;

fn solve<const D: usize, const B: usize>(criterion: &mut Criterion, per_side: usize, methods: &[Method]) {
    let grid = Grid::<D>::new(per_side);
    let pattern = grid.pattern();
    let points: Vec<Vector<D>> = grid.points.iter().map(|&x| Vector::from(x)).collect();
    // There and back again, so that the sequence has no jump.
    let there: Vec<_> = (0..5).map(|step| oseen::<D, B>(&grid, &pattern, STEP * step as f64)).collect();
    let systems: Vec<_> = there.iter().chain(there[1..4].iter().rev()).collect();
    let mut group = criterion.benchmark_group(format!("solve {D}D"));
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    for &method in methods {
        let options = Options { method, ..Options::default() };
        let mut solver = Solver::<B>::new(pattern.clone(), &points, options);
        let mut x = vec![0.0; B * points.len()];
        let mut step = 0;
        group.bench_function(BenchmarkId::new(format!("{method:?}"), points.len()), |bencher| {
            bencher.iter(|| {
                let (matrix, rhs) = systems[step % systems.len()];
                step += 1;
                solver.solve(matrix, rhs, &mut x).expect("the system is regular")
            });
        });
    }
    group.finish();
}

fn prepare<const D: usize, const B: usize>(criterion: &mut Criterion, per_side: usize) {
    let grid = Grid::<D>::new(per_side);
    let pattern = grid.pattern();
    let points: Vec<Vector<D>> = grid.points.iter().map(|&x| Vector::from(x)).collect();
    let (matrix, rhs) = oseen::<D, B>(&grid, &pattern, 0.0);
    let mut group = criterion.benchmark_group(format!("first solve {D}D"));
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    group.bench_function(BenchmarkId::new("Multifrontal", points.len()), |bencher| {
        bencher.iter(|| {
            let mut solver = Solver::<B>::new(pattern.clone(), &points, Options::default());
            solver.solve(&matrix, &rhs, &mut vec![0.0; rhs.len()]).expect("the system is regular")
        });
    });
    group.finish();
}

fn all(criterion: &mut Criterion) {
    use Method::{Ilu, Lu, Multifrontal, MultifrontalFresh};
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build_global()
        .expect("the first pool");
    solve::<2, 3>(criterion, 95, &[Multifrontal, MultifrontalFresh, Ilu, Lu]);
    solve::<2, 3>(criterion, 187, &[Multifrontal, MultifrontalFresh, Lu]);
    solve::<3, 4>(criterion, 20, &[Multifrontal, Ilu]);
    prepare::<2, 3>(criterion, 95);
}

criterion_group!(benches, all);
criterion_main!(benches);
