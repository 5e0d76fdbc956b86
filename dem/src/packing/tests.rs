use super::lying::Segment;
use super::*;
use crate::{Dem, Load, Particles, Partner, Period, Settings, ball};
use rand::{Rng, SeedableRng};

type Point = Vector<2>;

fn unit<const D: usize>() -> Region<D> {
    Region { low: Vector::zeros(), high: Vector::repeat(1.0) }
}

fn fill(materials: &[Material], radii: Radii, amount: Amount) -> Fill<'_> {
    Fill { radii, amount, material: 0, materials, seed: 3 }
}

fn wall(from: [f64; 2], to: [f64; 2]) -> Wall<2> {
    Wall::new("wall", from.into(), to.into())
}

/// Checks that nothing overlaps by more than rounding, and that every grain rests on a level wall or between two
/// supports.
fn check_bed(bed: &Particles<2>, walls: &[Wall<2>], region: &Region<2>) {
    let segments: Vec<Segment> =
        container(region, walls).iter().chain(walls).map(|wall| Segment::new(wall.at(0.0))).collect();
    for (i, (x, &r)) in bed.position.iter().zip(&bed.radius).enumerate() {
        let others = (0..bed.len()).filter(|&j| j != i);
        let discs = others.map(|j| (x - bed.position[j], r + bed.radius[j]));
        let arms = discs.chain(segments.iter().map(|wall| (wall.arm(x), r)));
        let mut supports = vec![];
        for (arm, reach) in arms {
            let gap = arm.norm() - reach;
            assert!(gap > -1e-9 * r, "grain {i} at {x:?} overlaps by {} of its radius", -gap / r);
            if gap < 1e-8 * r {
                supports.push(arm.normalize());
            }
        }
        let held = supports.iter().any(|n| n[1] > 1.0 - 1e-12)
            || supports
                .iter()
                .any(|m| supports.iter().any(|n| m[0] <= 0.0 && n[0] >= 0.0 && m[0] * n[1] <= n[0] * m[1]));
        assert!(held, "grain {i} at {x:?} would move on: {supports:?}");
        assert!(x[1] + r <= region.high[1] * (1.0 + 1e-12), "grain {i} is above the region");
    }
}

#[test]
fn lattices_fill_the_region_exactly() {
    let glass = [Material::default()];
    let tenth = fill(&glass, Radii::Constant(0.05), Amount::Fill);
    assert_eq!(lattice(&unit::<2>(), Lattice::Square, 1.0, &tenth).unwrap().len(), 100);
    assert_eq!(lattice(&unit::<3>(), Lattice::Square, 1.0, &tenth).unwrap().len(), 1000);
    // Rows of 10 and 9 in turn, 1 + floor(0.9 / (0.1 sqrt(3)/2)) = 11 of them.
    assert_eq!(lattice(&unit::<2>(), Lattice::Triangular, 1.0, &tenth).unwrap().len(), 6 * 10 + 5 * 9);
    let narrow = Region { low: Point::zeros(), high: Point::new(0.1, 1.0) };
    assert_eq!(lattice(&narrow, Lattice::Square, 1.0, &tenth).unwrap().len(), 10);
}

#[test]
fn random_grains_do_not_overlap_and_have_the_mass_asked_for() {
    let glass = [Material::default()];
    let radii = Radii::Uniform { min: 0.01, max: 0.03 };
    let some = random(&unit::<2>(), &fill(&glass, radii, Amount::Mass(1000.0)), &mut unobserved).unwrap();
    let total: f64 = some.mass.iter().sum();
    assert!((total - 1000.0).abs() < 0.5 * 2500.0 * ball::<2>(0.03), "{total}");
    for i in 0..some.len() {
        for j in 0..i {
            let d = (some.position[i] - some.position[j]).norm();
            assert!(d >= some.radius[i] + some.radius[j]);
        }
    }
}

#[test]
fn built_beds_do_not_overlap_and_every_grain_is_held() {
    let glass = [Material::default()];
    for radii in [Radii::Constant(0.02), Radii::Uniform { min: 0.002, max: 0.03 }] {
        for method in [Method::DropAndRoll, Method::Dense] {
            let bed = pour(&unit(), &[], &fill(&glass, radii.clone(), Amount::Fill), method, &mut unobserved)
                .unwrap();
            check_bed(&bed, &[], &unit());
            let fraction = solid_fraction(&bed, &container(&unit(), &[]), &Period::default());
            assert!((0.75..0.9).contains(&fraction), "{radii:?}, {method:?}: {fraction}");
        }
    }
}

#[test]
fn beds_are_built_in_hoppers_and_around_obstacles() {
    let glass = [Material::default()];
    let walls = [
        wall([0.0, 0.6], [0.4, 0.1]),
        wall([0.6, 0.1], [1.0, 0.6]),
        wall([0.4, 0.1], [0.6, 0.1]),
        // A roof, a level shelf and a peg.
        wall([0.4, 0.5], [0.5, 0.6]),
        wall([0.5, 0.6], [0.6, 0.5]),
        wall([0.0, 0.75], [0.2, 0.75]),
        wall([0.7, 0.7], [0.7, 0.701]),
    ];
    let radii = Radii::Uniform { min: 0.008, max: 0.015 };
    for method in [Method::DropAndRoll, Method::Dense] {
        let bed = pour(&unit(), &walls, &fill(&glass, radii.clone(), Amount::Fill), method, &mut unobserved)
            .unwrap();
        check_bed(&bed, &walls, &unit());
        assert!(bed.len() > 700, "{method:?}: {}", bed.len());
        let outside = |x: &&Point| x[1] < 0.6 - 1.25 * x[0] || x[1] < 0.6 - 1.25 * (1.0 - x[0]);
        assert_eq!(bed.position.iter().find(outside), None, "{method:?}: through the hopper");
        let sheltered = |x: &&Point| (x[0] - 0.5).abs() < 0.05 && (0.45..0.5).contains(&x[1]);
        assert_eq!(bed.position.iter().find(sheltered), None, "{method:?}: under the roof");
    }
}

#[test]
fn beds_are_built_among_any_walls() {
    let glass = [Material::default()];
    let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
    let mut corner = || [rng.random::<f64>(), 0.8 * rng.random::<f64>()];
    for round in 0..40 {
        let mut walls: Vec<Wall<2>> = (0..5).map(|_| wall(corner(), corner())).collect();
        // Walls that go on where others end, as in a bent plate.
        walls.extend([0, 1].map(|k| Wall::new("bend", walls[k].points[1], corner().into())));
        let (method, min) = ([Method::DropAndRoll, Method::Dense][round % 2], [0.02, 0.004][round / 2 % 2]);
        let fill = fill(&glass, Radii::Uniform { min, max: 0.03 }, Amount::Fill);
        let bed = pour(&unit(), &walls, &fill, method, &mut unobserved).unwrap();
        check_bed(&bed, &walls, &unit());
    }
}

#[test]
fn a_column_one_grain_wide_is_a_stack() {
    let glass = [Material::default()];
    let region = Region { low: Point::zeros(), high: Point::new(0.1, 1.0) };
    let tenth = fill(&glass, Radii::Constant(0.05), Amount::Fill);
    let bed = pour(&region, &[], &tenth, Method::DropAndRoll, &mut unobserved).unwrap();
    assert_eq!(bed.len(), 10);
    for (k, x) in bed.position.iter().enumerate() {
        approx::assert_relative_eq!(*x, Point::new(0.05, 0.05 + 0.1 * k as f64), epsilon = 1e-9);
    }
}

#[test]
fn the_same_seed_builds_the_same_bed() {
    let glass = [Material::default()];
    for method in [Method::DropAndRoll, Method::Dense] {
        let radii = Radii::Uniform { min: 0.01, max: 0.02 };
        let build = |seed| {
            let fill = Fill { seed, ..fill(&glass, radii.clone(), Amount::Count(300)) };
            pour(&unit(), &[], &fill, method, &mut unobserved).unwrap()
        };
        assert_eq!(build(1), build(1));
        assert_ne!(build(1), build(2));
    }
}

#[test]
fn a_settled_bed_moves_no_further() {
    let glass = [Material { friction: 0.3, ..Material::default() }];
    let radii = Radii::Uniform { min: 0.4e-3, max: 0.5e-3 };
    let region = Region { low: Point::zeros(), high: Point::new(0.02, 0.02) };
    for friction in [Some(0.0), None] {
        let how = Deposit { friction, ..Deposit::default() };
        let fill = fill(&glass, radii.clone(), Amount::Count(300));
        let bed = deposit(&region, &fill, &how, &mut unobserved).unwrap();
        assert!(bed.at_rest, "speed {}", bed.speed);
        let mean = |p: &Particles<2>| p.position.iter().map(|x| x[1]).sum::<f64>() / p.len() as f64;
        let before = mean(&bed.particles);
        let made_of = [Material { friction: friction.unwrap_or(0.3), ..glass[0].clone() }];
        let sides = container(&region, &[]).into_iter().map(|w| Wall { friction: made_of[0].friction, ..w });
        let mut dem =
            Dem::new(bed.particles.rotating(), sides.collect(), made_of.to_vec(), Settings::default())
                .unwrap();
        (0..400).for_each(|_| {
            dem.step(1e-3, &Load::default());
        });
        let sunk = before - mean(&dem.particles);
        assert!(sunk.abs() < 0.1 * 0.9e-3, "friction {friction:?}: {sunk} m of {before} m");
    }
}

#[test]
fn a_bed_that_is_not_at_rest_is_said_to_be_so() {
    let glass = [Material::default()];
    let fill = fill(&glass, Radii::Uniform { min: 0.01, max: 0.02 }, Amount::Count(200));
    let bed =
        deposit(&unit(), &fill, &Deposit { max_steps: 3, ..Deposit::default() }, &mut unobserved).unwrap();
    assert!(!bed.at_rest && bed.steps == 3);
    let how = Deposit { max_steps: 0, method: Method::Dense, ..Deposit::default() };
    let bed = deposit(&unit(), &fill, &how, &mut unobserved).unwrap();
    assert_eq!(bed.particles, pour(&unit(), &[], &fill, Method::Dense, &mut unobserved).unwrap());
}

#[test]
fn too_much_is_an_error_that_says_so() {
    let glass = [Material::default()];
    let many = fill(&glass, Radii::Constant(0.05), Amount::Count(101));
    let message = lattice(&unit::<2>(), Lattice::Square, 1.0, &many).unwrap_err().to_string();
    assert!(message.contains("full after 100 grains"), "{message}");
    let message = check_lattice(&unit::<2>(), Lattice::Square, 1.0, &many).unwrap_err().to_string();
    assert!(message.contains("full after 100 grains"), "{message}");
    let bad = fill(&glass, Radii::List(vec![0.1, f64::NAN]), Amount::Fill);
    assert!(random(&unit::<2>(), &bad, &mut unobserved).is_err());
    // What surely does not fit is refused before the first grain, what may fit is tried.
    let mut seen = 0;
    let mut count = |_: Progress| {
        seen += 1;
        ControlFlow::Continue(())
    };
    let many = fill(&glass, Radii::Constant(0.005), Amount::Count(1_000_000));
    let message = pour(&unit(), &[], &many, Method::DropAndRoll, &mut count).unwrap_err().to_string();
    assert!(message.contains("takes about 10441 grains, and 1000000 are asked for"), "{message}");
    assert!(random(&unit::<2>(), &many, &mut count).unwrap_err().to_string().contains("about 6366 grains"));
    assert_eq!(seen, 0);
    let many = fill(&glass, Radii::Constant(0.05), Amount::Count(112));
    let message = pour(&unit(), &[], &many, Method::DropAndRoll, &mut unobserved).unwrap_err().to_string();
    assert!(message.contains("full after"), "{message}");
}

#[test]
fn what_fits_is_not_refused() {
    let glass = [Material::default()];
    for size in [0.05, 0.1, 0.25, 0.5] {
        let most = lattice(
            &unit::<2>(),
            Lattice::Triangular,
            1.0,
            &fill(&glass, Radii::Constant(size), Amount::Fill),
        );
        let count = Amount::Count(most.unwrap().len());
        check_deposit(&unit(), &fill(&glass, Radii::Constant(size), count)).unwrap();
    }
    check_random(&unit::<2>(), &fill(&glass, Radii::Constant(0.5), Amount::Count(1))).unwrap();
}

#[test]
fn less_than_a_grain_is_an_error_with_the_mass_of_one() {
    let glass = [Material::default()];
    let message = |mass: f64| {
        let little = fill(&glass, Radii::Constant(0.1), Amount::Mass(mass));
        deposit(&unit(), &little, &Deposit::default(), &mut unobserved).err().map(|error| error.to_string())
    };
    let said = message(30.0).unwrap();
    assert!(said.contains("less than half of one grain") && said.contains("7.8540e1 kg/m"), "{said}");
    assert_eq!(message(40.0), None);
    let wide = fill(&glass, Radii::Constant(0.6), Amount::Fill);
    assert!(pour(&unit(), &[], &wide, Method::Dense, &mut unobserved).is_err());
    assert!(random(&unit::<2>(), &wide, &mut unobserved).is_err());
}

#[test]
fn whoever_watches_may_end_it() {
    let glass = [Material::default()];
    let some = fill(&glass, Radii::Constant(0.005), Amount::Count(2000));
    for settling in [false, true] {
        let mut seen = vec![];
        let mut stop = |progress: Progress| {
            seen.push(progress);
            let ends = match progress {
                Progress::Placing { done, .. } => !settling && done > 1000,
                Progress::Settling { step, .. } => step == 2,
            };
            if ends { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let ended = deposit(&unit(), &some, &Deposit::default(), &mut stop).unwrap_err();
        assert!(matches!(ended, Error::Interrupted), "{ended}");
        assert_eq!(seen[0], Progress::Placing { done: 0, of: 2000 });
        assert!(seen.len() < 30);
    }
    let mut stop = |_: Progress| ControlFlow::Break(());
    assert!(matches!(random(&unit::<2>(), &some, &mut stop), Err(Error::Interrupted)));
}

/// A bed that has settled goes on from its forces as if it had not been stopped; without them it is solved anew.
#[test]
fn a_settled_bed_starts_warm() {
    let materials = [Material { density: 2500.0, friction: 0.3, ..Material::default() }];
    let region = Region { low: Point::zeros(), high: Point::new(0.02, 0.1) };
    let radii = Radii::Uniform { min: 4e-4, max: 5e-4 };
    let walls = vec![Wall { friction: 0.3, ..wall([0.0, 0.0], [0.02, 0.0]) }];
    let how = Deposit { walls: walls.clone(), ..Deposit::default() };
    let settled =
        deposit(&region, &fill(&materials, radii, Amount::Count(500)), &how, &mut unobserved).unwrap();
    // The sides of the region come before the walls given and are none of them: the first of these is the floor.
    let on_walls = || settled.forces.iter().filter(|f| !matches!(f.partner, Partner::Grain(_)));
    assert!(on_walls().all(|f| f.partner == Partner::Wall(0)));
    let carried = -on_walls().map(|f| f.force.y).sum::<f64>();
    let weight = 9.81 * settled.particles.mass.iter().sum::<f64>();
    assert!(carried > 0.5 * weight && carried < 1.01 * weight, "{carried} of {weight}");
    let sweeps = |warm: bool| {
        let sides = container(&region, &walls).into_iter().map(|side| Wall { friction: 0.3, ..side });
        let walls = walls.iter().cloned().chain(sides).collect();
        let grains = settled.particles.clone().rotating();
        let mut dem = Dem::new(grains, walls, materials.to_vec(), Settings::default()).unwrap();
        if warm {
            dem.start_from(&settled.forces);
        }
        let report = dem.step(5e-4, &Load::default());
        assert!(report.converged);
        report.sweeps
    };
    let (warm, cold) = (sweeps(true), sweeps(false));
    assert!(2 * warm < cold, "{warm} sweeps, {cold} from nothing");
}

#[test]
fn a_bed_between_periodic_sides_settles_across_them() {
    let glass = [Material { friction: 0.3, ..Material::default() }];
    let fill = fill(&glass, Radii::Uniform { min: 0.02, max: 0.03 }, Amount::Count(200));
    let period = Period::new([Some([0.0, 1.0]), None]).unwrap();
    let settings = Settings { period, ..Deposit::default().settings };
    let how = Deposit { settings: settings.clone(), ..Deposit::default() };
    let region = Region { low: Point::zeros(), high: Point::new(1.0, 2.0) };
    let bed = deposit(&region, &fill, &how, &mut unobserved).unwrap();
    assert!(bed.at_rest, "{} m/s after {} steps", bed.speed, bed.steps);
    assert!((0.75..0.9).contains(&bed.solid_fraction), "{}", bed.solid_fraction);
    let grains = &bed.particles;
    // As much weight rests on contacts across the seam as on others.
    let across = |force: &&crate::ContactForce<2>| match force.partner {
        Partner::Grain(other) => {
            (grains.position[force.grain as usize] - grains.position[other as usize]).x.abs() > 0.5
        }
        Partner::Wall(_) => false,
    };
    assert!(bed.forces.iter().filter(across).count() >= 4, "nothing leans across the sides");
    // In a domain with this floor alone nothing moves any more.
    let floor = Wall { friction: 0.3, ..wall([0.0, 0.0], [1.0, 0.0]) };
    let mut dem = Dem::new(grains.clone().rotating(), vec![floor], glass.to_vec(), settings).unwrap();
    for _ in 0..50 {
        dem.step(5e-3, &Load::default());
    }
    let moved = grains.position.iter().zip(&dem.particles.position).map(|(x, y)| (x.y - y.y).abs());
    assert!(moved.fold(0.0, f64::max) < 0.01);
}
