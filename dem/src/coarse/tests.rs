use crate::packing::{Amount, Fill, Method, Radii, Region, pour, unobserved};
use crate::{Cohesion, Dem, Load, Material, Particles, Settings, State, Vector, Wall};

type V = Vector<2>;
const STEP: f64 = 5e-4;
const WIDTH: f64 = 1e-3;

fn material() -> Material {
    Material { density: 3200.0, friction: 0.3, ..Material::default() }
}

fn wall(from: V, to: V) -> Wall<2> {
    Wall { friction: 0.3, ..Wall::new("wall", from, to) }
}

fn stack(count: usize) -> Particles<2> {
    let place = (0..count).map(|k| V::new(0.5 * WIDTH, 5e-5 * (k as f64 + 0.5))).collect();
    Particles::new(place, vec![2.5e-5; count], vec![0; count], &[material()]).unwrap().rotating()
}

/// Discs of 44 to 55 um, dropped and rolled into a box of 20 diameters.
fn bed(count: usize) -> Particles<2> {
    let materials = [material()];
    let radii = Radii::Uniform { min: 2.2e-5, max: 2.75e-5 };
    let fill = Fill { radii, amount: Amount::Count(count), material: 0, materials: &materials, seed: 2 };
    let region = Region { low: V::zeros(), high: V::new(WIDTH, 1.0) };
    pour(&region, &[], &fill, Method::DropAndRoll, &mut unobserved).unwrap().rotating()
}

/// The topmost grain 1000 times as heavy.
fn under_a_lid(mut p: Particles<2>) -> Particles<2> {
    let top = (0..p.len()).max_by(|a, b| p.position[*a].y.total_cmp(&p.position[*b].y)).unwrap();
    p.mass[top] *= 1e3;
    p
}

fn dem(p: &Particles<2>, settings: Settings<2>) -> Dem<2> {
    let top = V::new(0.0, 1.0);
    let [a, b] = [V::zeros(), V::new(WIDTH, 0.0)];
    let walls = vec![wall(a, b), wall(a, a + top), wall(b, b + top)];
    Dem::new(p.clone(), walls, vec![material()], settings).unwrap()
}

/// Estimate over true error after a number of sweeps, and the true one as a share of what contacts have to do with.
fn compared(p: &Particles<2>, from: Option<&State<2>>, max_sweeps: usize) -> (f64, f64) {
    let one = |max_sweeps: usize, tolerance: f64| {
        let mut dem = dem(p, Settings { max_sweeps, tolerance, ..Settings::default() });
        from.into_iter().for_each(|state| dem.restore(state.clone()).unwrap());
        let before = dem.particles.velocity.clone();
        let report = dem.step(STEP, &Load::default());
        (dem, report, before)
    };
    let (solved, _, _) = one(20_000, 1e-13);
    let (now, report, before) = one(max_sweeps, 1e-300);
    let (mut error, mut scale, mut changed) = (0.0, 0.0, 0.0);
    let fall = V::new(0.0, -9.81 * STEP);
    for i in 0..p.len() {
        let (v, w) = (now.particles.velocity[i], solved.particles.velocity[i]);
        let spin = |dem: &Dem<2>| dem.particles.rotation.as_ref().unwrap().spin[i];
        let inertia = now.particles.rotation.as_ref().unwrap().inertia[i];
        error += 0.5 * p.mass[i] * (v - w).norm_squared();
        error += 0.5 * inertia * (spin(&now) - spin(&solved)).powi(2);
        let (change, push) = (v - before[i], v - before[i] - fall);
        changed += 0.5 * p.mass[i] * change.norm_squared().min(push.norm_squared());
        scale += 0.25 * p.mass[i] * (fall.norm_squared() + push.norm_squared());
    }
    (report.error * changed.max(1e-2 * scale) / error, error / scale)
}

/// The estimate lies between a tenth of the true energy of the error and twenty times it, from a cold start and from
/// impulses of another weight, on stacks, random beds and beds under a heavy lid. Where a correction has just solved a
/// stack at once, it may be more: what has changed since the sweeps before is taken for what is left.
#[test]
fn the_estimate_is_the_energy_of_the_error() {
    let problems = [
        ("stack of 20", stack(20)),
        ("stack of 200", stack(200)),
        ("bed of 20 rows", bed(400)),
        ("bed of 60 rows", bed(1200)),
        ("stack under a lid", under_a_lid(stack(50))),
        ("bed under a lid", under_a_lid(bed(400))),
    ];
    let mut compared_at = 0;
    for (name, p) in &problems {
        let light = Settings {
            gravity: V::new(0.0, -7.0),
            tolerance: 1e-12,
            max_sweeps: 20_000,
            ..Settings::default()
        };
        let mut lighter = dem(p, light);
        lighter.step(STEP, &Load::default());
        let mut state = lighter.state();
        state.particles = p.clone();
        for from in [None, Some(&state)] {
            for sweeps in [24, 54, 114] {
                let (ratio, share) = compared(p, from, sweeps);
                let start = if from.is_some() { "warm" } else { "cold" };
                println!("{name}, {start}, {sweeps} sweeps: {ratio:.2e} of an error of {share:.1e}");
                // Below, the solution itself is not known well enough.
                if share > 1e-5 {
                    compared_at += 1;
                    let most = if name.starts_with("stack") { f64::INFINITY } else { 20.0 };
                    assert!(
                        (0.1..most).contains(&ratio),
                        "{name}, {start}, {sweeps} sweeps: {ratio:.2e} of {share:.1e}"
                    );
                }
            }
        }
    }
    assert!(compared_at >= 28, "{compared_at}");
}

/// Sticky grains fly apart, and nearly all contacts give way. They pull with their cohesion but for rounding; they were
/// taken for contacts that press, whose opening is an error, and no number of sweeps made an end of it.
#[test]
fn contacts_that_give_way_are_no_error() {
    let cohesion = Some(Cohesion { force: 3e-4, age: 0.0, sliding: None });
    let mut glued = dem(&bed(400), Settings { cohesion, ..Settings::default() });
    for _ in 0..2 {
        glued.step(STEP, &Load::default());
    }
    let mut state = glued.state();
    let middle = V::new(0.5 * WIDTH, 0.5 * WIDTH);
    let p = &mut state.particles;
    p.velocity.iter_mut().zip(&p.position).for_each(|(v, x)| *v = (x - middle) * 1e3);
    let settings = Settings { cohesion, max_travel: 10.0, tolerance: 1e-300, ..Settings::default() };
    let mut dem = dem(&state.particles.clone(), settings);
    dem.restore(state).unwrap();
    let report = dem.step(STEP, &Load::default());
    assert!(report.error < 1e-4, "{report:?}");
}
