//! What contacts cost: a settled bed of discs, and a hopper.
//!
//! `cargo bench -p voidage-dem`: ns per contact and sweep follow from the printed counts and the times.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use voidage_dem::packing::{Amount, Deposit, Fill, Radii, Region, deposit, unobserved};
use voidage_dem::{Acceleration, Dem, Load, Material, Particles, Settings, StepReport, Vector, Wall};

fn at(x: f64, y: f64) -> Vector<2> {
    Vector::<2>::new(x, y)
}

fn glass() -> Vec<Material> {
    vec![Material { friction: 0.3, ..Material::default() }]
}

/// About 3,800 discs of 0.8 to 1 mm, settled in a box 8 cm wide: the bed of the paper.
fn bed() -> Particles<2> {
    let materials = glass();
    let radii = Radii::Uniform { min: 0.4e-3, max: 0.5e-3 };
    let fill = Fill { radii, amount: Amount::Count(3800), material: 0, materials: &materials, seed: 1 };
    let region = Region { low: at(0.0, 0.0), high: at(0.08, 0.1) };
    deposit(&region, &fill, &Deposit::default(), &mut unobserved)
        .expect("the region is large enough")
        .particles
}

fn dem(particles: Particles<2>, walls: Vec<Wall<2>>, settings: Settings<2>) -> Dem<2> {
    Dem::new(particles, walls, glass(), settings).expect("a deposit is a valid scene")
}

fn wall(name: &str, a: Vector<2>, b: Vector<2>) -> Wall<2> {
    Wall { friction: 0.5, ..Wall::new(name, a, b) }
}

fn sides() -> Vec<Wall<2>> {
    vec![wall("left", at(0.0, 0.0), at(0.0, 0.2)), wall("right", at(0.08, 0.0), at(0.08, 0.2))]
}

fn show(name: &str, report: &StepReport) {
    println!(
        "{name}: {} candidates, {} contacts, {} sub-steps, {} sweeps, residual {:.1e}",
        report.candidates, report.contacts, report.substeps, report.sweeps, report.residual
    );
}

/// The same step with 100 and with 200 sweeps: their difference is 100 sweeps alone (with a look at the residual every
/// 8).
fn sweeps(c: &mut Criterion, particles: &Particles<2>) {
    let mut walls = sides();
    walls.push(wall("floor", at(0.0, 0.0), at(0.08, 0.0)));
    for acceleration in [Acceleration::None, Acceleration::Momentum] {
        for max_sweeps in [100, 200] {
            let settings = Settings { tolerance: 1e-300, max_sweeps, acceleration, ..Settings::default() };
            let mut dem = dem(particles.clone(), walls.clone(), settings);
            let mut report = StepReport::default();
            (0..20).for_each(|_| report = dem.step(1e-3, &Load::default()));
            let name = format!("bed, {acceleration:?}, {max_sweeps} sweeps");
            show(&name, &report);
            again(c, &name, &mut dem);
        }
    }
}

/// Times one step of 1 ms from the present state.
fn again(c: &mut Criterion, name: &str, dem: &mut Dem<2>) {
    let state = dem.state();
    c.bench_function(name, |b| {
        b.iter_batched(
            || state.clone(),
            |state| {
                dem.restore(state).expect("a state of the same scene");
                dem.step(1e-3, &Load::default())
            },
            BatchSize::LargeInput,
        )
    });
}

/// A whole step of the bed at rest, and of the bed after its floor was taken away but for two ledges.
fn steps(c: &mut Criterion, particles: &Particles<2>) {
    let mut walls = sides();
    walls.push(wall("floor", at(0.0, 0.0), at(0.08, 0.0)));
    let mut rest = dem(particles.clone(), walls, Settings::default());
    let mut report = StepReport::default();
    (0..50).for_each(|_| report = rest.step(1e-3, &Load::default()));
    c.bench_function("bed at rest, step of 1 ms", |b| b.iter(|| report = rest.step(1e-3, &Load::default())));
    show("bed at rest", &report);

    let mut walls = sides();
    walls.push(wall("left ledge", at(0.0, 0.0), at(0.032, 0.0)));
    walls.push(wall("right ledge", at(0.048, 0.0), at(0.08, 0.0)));
    let mut hopper = dem(particles.clone(), walls, Settings::default());
    (0..100).for_each(|_| report = hopper.step(1e-3, &Load::default()));
    show("hopper", &report);
    again(c, "hopper, step of 1 ms", &mut hopper);
}

fn contacts(c: &mut Criterion) {
    let particles = bed();
    sweeps(c, &particles);
    steps(c, &particles);
}

criterion_group!(benches, contacts);
criterion_main!(benches);
