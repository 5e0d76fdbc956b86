//! The quick map: the default scheme passes where steps are not too long for all schemes, the others fail where theory
//! says; and what all schemes keep.

use rayon::prelude::*;
use std::path::Path;
use voidage_campaign::Effort;
use voidage_coupling::Coupled;
use voidage_coupling::scheme::cut::Cutting;
use voidage_coupling::scheme::iterated::Iteration;
use voidage_coupling::scheme::{Options, SchemeName, relaxation::Relaxation};
use voidage_fluid::Vector;
use voidage_scene::{Scene, Simulation};
use voidage_stability::{Axis, Verdict, axes, sample};

fn misses(axis: &Axis, scheme: SchemeName) -> Vec<String> {
    let mut misses = Vec::new();
    for point in (axis.points)(Effort::Quick) {
        let known = (axis.theory)(point, scheme);
        let Some(wanted) = known.or((scheme == SchemeName::default()).then_some(true)) else { continue };
        let sample = sample(axis, point, scheme, Effort::Quick);
        if wanted != (sample.verdict == Verdict::Passes) {
            misses.push(format!("{} at {point:?} with {scheme}: {sample:?}", axis.name));
        }
    }
    misses
}

#[test]
fn the_default_scheme_passes_every_point_that_theory_does_not_exclude() {
    let misses: Vec<String> = axes().iter().flat_map(|axis| misses(axis, SchemeName::default())).collect();
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

/// Single modes, where theory is exact.
#[test]
fn the_other_schemes_fail_where_theory_says() {
    let modes = axes().into_iter().filter(|axis| !axis.name.starts_with("bed"));
    let others = SchemeName::ALL.into_iter().filter(|scheme| *scheme != SchemeName::default());
    let pairs = modes.flat_map(|axis| others.clone().map(move |scheme| (axis, scheme)));
    let pairs: Vec<(Axis, SchemeName)> = pairs.filter(|(axis, scheme)| axis.takes(*scheme)).collect();
    let misses: Vec<String> =
        pairs.par_iter().flat_map_iter(|(axis, scheme)| misses(axis, *scheme)).collect();
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

/// The absorption number was that of grains which the water had cooled in the step: near zero where they give off their
/// heat at once, so that steps were not divided in which heat that is taken in throws the droplet up.
#[test]
fn the_absorption_number_counts_grains_before_the_water_cools_them() {
    let all = axes();
    let axis = all.iter().find(|axis| axis.name == "droplet-absorption").expect("an axis");
    let of = |point| sample(axis, point, SchemeName::Henry, Effort::Quick);
    let whole = of([1.0, 100.0]);
    let (_, _, share) = whole.curves[0];
    assert!((0.7..1.1).contains(&share), "{whole:?}");
    let (thrown, divided) = (of([3.0, 100.0]), of([3.0, 1.0]));
    let verdicts = (thrown.verdict, divided.verdict);
    assert_eq!(verdicts, (Verdict::Unstable, Verdict::Passes), "{thrown:?} {divided:?}");
    assert!(divided.tally.solves >= 4 * divided.tally.steps, "{divided:?}");
}

/// A bed in water counted as held by its floor until it had left it, and bounced higher from step to step instead of
/// rising.
#[test]
fn anchored_lifts_a_bed_in_water() {
    let all = axes();
    let axis = all.iter().find(|axis| axis.name == "fluidisation-liquid").expect("an axis");
    let [density, _] = (axis.points)(Effort::Quick)[0];
    for step in [1.0, 10.0] {
        let sample = sample(axis, [density, step], SchemeName::Anchored, Effort::Quick);
        assert_eq!(sample.verdict, Verdict::Passes, "step {step}: {sample:?}");
        let above = |name: &str| {
            let mut found = sample.curves.iter().filter(|(curve, inflow, _)| *curve == name && *inflow > 1.0);
            found.next_back().expect("an inflow above fluidisation").2
        };
        let (drop, balance) = (above("up"), above("min(drag law, weight)"));
        assert!((drop / balance - 1.0).abs() < 0.1, "step {step}: {drop} of {balance}");
    }
}

/// A small bed that falls a little and is blown through.
fn bed() -> Simulation {
    bed_with(&[])
}

/// The same with other entries of the scene.
fn bed_with(changes: &[&str]) -> Simulation {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/bed.toml");
    let changes: Vec<String> = changes.iter().map(|change| change.to_string()).collect();
    Simulation::new(&Scene::read(&path, &changes).expect("a scene")).expect("a bed")
}

/// A scheme that follows another one starts from its own laws.
#[test]
fn henry_after_lagged_is_henry() {
    let places = |first: SchemeName| {
        let mut simulation = bed();
        let coupled = simulation.coupled_mut();
        let start = coupled.grains().expect("grains").state();
        let fields = coupled.fluid().expect("fluid").accepted.clone();
        let at = coupled.interaction().expect("both").at.clone();
        coupled.set_scheme(first.build(&Options::default()).unwrap());
        coupled.step(1e-3).expect("a step");
        // Back to the start, with the other scheme.
        coupled.set_time(0.0, 0);
        coupled.grains_mut().expect("grains").restore(start).expect("the same grains");
        let fluid = coupled.fluid_mut().expect("fluid");
        fluid.accepted = fields;
        fluid.start().expect("the same mesh");
        coupled.interaction_mut().expect("both").at = at;
        coupled.set_scheme(SchemeName::Henry.build(&Options::default()).unwrap());
        for _ in 0..3 {
            coupled.step(1e-3).expect("a step");
        }
        coupled.grains().expect("grains").particles.position.clone()
    };
    assert_eq!(places(SchemeName::Lagged), places(SchemeName::Henry));
}

/// A step too hard for the iterations allowed is done in parts, and ends at the same time.
#[test]
fn a_step_that_does_not_converge_is_halved() {
    let solved = |cutting: Option<Cutting>, tolerance: f64| {
        let mut simulation = bed();
        let coupled = simulation.coupled_mut();
        let iteration = Iteration { tolerance, most: 2, ..Iteration::default() };
        coupled.set_scheme(
            SchemeName::Iterated.build(&Options { iteration, cut: cutting, ..Options::default() }).unwrap(),
        );
        let report = coupled.step(4e-3).expect("a step");
        assert!(coupled.steps() == 1 && (coupled.time() - 4e-3).abs() < 1e-16);
        report.agreement.expect("both")
    };
    let (whole, parts) = (solved(None, 1e-7), solved(Some(Cutting::default()), 1e-7));
    let complaint = whole.complaint().expect("no agreement");
    let [Some((first, _)), Some((second, _)), Some((third, _))] = whole.worst else { panic!("{complaint}") };
    assert!(first != second && second != third && third != first, "{complaint}");
    for help in [format!("grain {first} (by"), "set coupling.cut = {}".into()] {
        assert!(complaint.to_string().contains(&help), "{complaint}");
    }
    assert!(parts.solves > 4 && parts.disagreement < whole.disagreement, "{parts:?} {whole:?}");
    let complaint = solved(Some(Cutting::default()), 1e-300).complaint().expect("never so near");
    assert!(complaint.help.contains("cut as far as") && !complaint.help.contains("= {}"), "{complaint}");
}

/// Schemes that solve the fluid once said nothing of steps in which grains and fluid disagreed, and ended in pressures
/// a hundred times the weight of a bed without a word.
#[test]
fn a_scheme_that_solves_once_says_that_grains_and_fluid_disagree() {
    let solved = |scheme: SchemeName, cutting: Option<Cutting>| {
        let slow = "fluid.boundaries.inflow.flow.superficial_velocity=[0.0,0.002]";
        let mut simulation = bed_with(&["fluid.density=1000.0", "fluid.viscosity=1e-3", slow]);
        let coupled = simulation.coupled_mut();
        coupled.set_scheme(scheme.build(&Options { cut: cutting, ..Options::default() }).unwrap());
        (0..20).map(|_| coupled.step(2e-3).expect("a step").agreement.expect("both")).last().expect("steps")
    };
    for cutting in [None, Some(Cutting { travel: 1e3, absorption: 1e3 })] {
        let off = solved(SchemeName::HenryFree, cutting);
        assert!(!off.converged && off.parts == 1 && off.disagreement > 0.1, "{off:?}");
        assert!(off.complaint().expect("a complaint").help.contains("iterated"), "{off:?}");
    }
    let near = solved(SchemeName::Iterated, None);
    assert!(near.converged && near.complaint().is_none(), "{near:?}");
}

/// Half of what earlier steps carry counted against a step whatever its iterations did: after one that was far off, a
/// step went through all the solutions allowed and never agreed.
#[test]
fn a_step_after_one_that_did_not_agree_agrees() {
    let mut simulation = bed();
    let coupled = simulation.coupled_mut();
    let step = |coupled: &mut Coupled<2>, iteration: Iteration| {
        coupled.set_scheme(SchemeName::Iterated.build(&Options { iteration, ..Options::default() }).unwrap());
        coupled.step(4e-3).expect("a step").agreement.expect("both")
    };
    let once = || Iteration { tolerance: 1e-300, most: 1, ..Iteration::default() };
    let far = (0..3).map(|_| step(coupled, once())).last().expect("steps");
    let tolerance = far.disagreement / 8.0;
    assert!(tolerance > 1e-8, "{far:?} tests nothing");
    let next = step(coupled, Iteration { tolerance, ..Iteration::default() });
    assert!(next.converged && next.solves > 1, "{next:?} after {far:?}");
}

/// A grain that flies far in a step is pushed all the way as where it was. In parts it ends nearer to where short steps
/// take it, and the force of the step, the mean over them, is what moved it.
#[test]
fn a_step_in_which_grains_fly_is_cut() {
    let time = 2e-2;
    let flown = |scheme: SchemeName, cutting: Option<Cutting>, count: u32| {
        let inflow = "fluid.boundaries.inflow.flow.superficial_velocity=[0.0,2.7]";
        let mut simulation = bed_with(&["gravity=[0.0,0.0]", inflow]);
        let coupled = simulation.coupled_mut();
        coupled.set_scheme(scheme.build(&Options { cut: cutting, ..Options::default() }).unwrap());
        let mut last = None;
        for _ in 0..count {
            last = coupled.step(time / f64::from(count)).expect("a step").agreement;
        }
        let particles = &coupled.grains().expect("grains").particles;
        let both = coupled.interaction().expect("both");
        let given = both.force.iter().sum::<Vector<2>>().y * time;
        let gained: f64 = particles.mass.iter().zip(&particles.velocity).map(|(mass, v)| mass * v.y).sum();
        let taken = coupled.grains().expect("grains").wall_force().iter().sum::<Vector<2>>().y * time;
        (particles.position.clone(), last.expect("both"), (given - taken) / gained)
    };
    for scheme in [SchemeName::Iterated, SchemeName::Henry, SchemeName::Lagged] {
        let (exact, _, _) = flown(scheme, None, 256);
        let off = |places: &[Vector<2>]| {
            let between = places.iter().zip(&exact).map(|(x, y)| (x - y).norm());
            between.sum::<f64>() / exact.len() as f64
        };
        let (far, once, _) = flown(scheme, None, 1);
        assert!(once.parts == 1 && once.travel > 0.5, "{scheme}: {once:?} tests nothing");
        let mut errors = vec![off(&far)];
        for travel in [0.5, 0.125] {
            let (places, cut, given) = flown(scheme, Some(Cutting { travel, ..Cutting::default() }), 1);
            assert!(cut.converged && cut.parts > 1 && cut.travel <= travel, "{scheme}: {cut:?}");
            assert!((given - 1.0).abs() < 1e-9, "{scheme}: {given}");
            errors.push(off(&places));
        }
        assert!(errors.windows(2).all(|pair| pair[1] < 0.8 * pair[0]), "{scheme}: {errors:?}");
    }
}

fn step(coupled: &mut Coupled<2>, dt: f64) -> Vector<2> {
    coupled.step(dt).expect("a step");
    let interaction = coupled.interaction().expect("both");
    let lost = (0..interaction.force.len()).map(|i| interaction.load.force(&interaction.at, i));
    lost.sum::<Vector<2>>() * dt
}

/// What the fluid has lost is what the grains got and what is carried: over all steps, not only in each.
#[test]
fn no_momentum_is_lost_over_time() {
    let mut simulation = bed();
    let coupled = simulation.coupled_mut();
    coupled.set_scheme(SchemeName::Anchored.build(&Options::default()).unwrap());
    let (dt, mut lost, mut got, mut scale) = (2e-3, Vector::<2>::zeros(), Vector::<2>::zeros(), 0.0);
    let mut most = 0.0f64;
    for _ in 0..60 {
        lost += step(coupled, dt);
        let interaction = coupled.interaction().expect("both");
        got += interaction.force.iter().sum::<Vector<2>>() * dt;
        scale += interaction.force.iter().map(|force| force.norm()).sum::<f64>() * dt;
        let carried: Vector<2> = interaction.carried.as_ref().expect("carried").impulse.iter().sum();
        assert!((lost - got + carried).norm() < 1e-12 * scale, "{lost} {got} {carried}");
        most = most.max(carried.norm() / scale);
    }
    assert!(most > 1e-9, "nothing was carried: the test tests nothing");
}

/// What the equation of mass had the grains move by in excess added up, to a radius in a bed in water, and a bed that
/// hovered carried 1 to 2 % less than its drag law.
#[test]
fn the_solid_is_where_the_equation_of_mass_had_it() {
    let mut simulation = bed_with(&[
        "fluid.density=1000.0",
        "fluid.viscosity=1e-3",
        "fluid.boundaries.inflow.flow.superficial_velocity=[0.0,0.02]",
    ]);
    let coupled = simulation.coupled_mut();
    coupled.set_scheme(SchemeName::Anchored.build(&Options::default()).unwrap());
    let (dt, count) = (2e-2, coupled.grains().expect("grains").particles.len());
    let (mut ahead, mut path, mut late) = (vec![Vector::<2>::zeros(); count], 0.0, 0.0);
    for step in 0..200 {
        coupled.step(dt).expect("a step");
        let (grains, interaction) = (coupled.grains().expect("grains"), coupled.interaction().expect("both"));
        let carried = interaction.carried.as_ref().expect("carried");
        for (i, moved) in grains.mean_velocity().iter().enumerate() {
            let by = (interaction.load.expected_in_flux(&interaction.at, i) - moved) * dt;
            ahead[i] += by;
            path += moved.norm() * dt;
            late += if step < 100 { 0.0 } else { by.norm() / 100.0 };
            assert!((ahead[i] - carried.displacement[i]).norm() < 1e-12 * path, "grain {i}");
        }
    }
    let ahead: f64 = ahead.iter().map(|by| by.norm()).sum();
    assert!(late > 1e-9 * path, "nothing was carried: the test tests nothing");
    assert!(ahead < 5.0 * late, "{ahead} m ahead, {late} m in a step");
}

/// Whatever the slopes of the laws and the relaxation, a step solved to the last digits is the same step.
#[test]
fn all_slopes_and_relaxations_lead_to_the_same_step() {
    let solved = |scheme: SchemeName, relaxation: Relaxation| {
        let mut simulation = bed();
        let coupled = simulation.coupled_mut();
        let iteration =
            Iteration { tolerance: 1e-9, heat_tolerance: 1e-9, most: 100, relaxation: Some(relaxation) };
        coupled.set_scheme(scheme.build(&Options { iteration, ..Options::default() }).unwrap());
        let mut solves = 0;
        for _ in 0..5 {
            let agreement = coupled.step(1e-3).expect("a step").agreement.expect("both");
            assert!(agreement.converged, "{scheme}, {relaxation:?}: {agreement:?}");
            solves += agreement.solves;
        }
        assert!(solves > 5, "{scheme}, {relaxation:?} had nothing to do");
        coupled.grains().expect("grains").particles.position.clone()
    };
    let reference = solved(SchemeName::Iterated, Relaxation::IqnIls);
    for (scheme, relaxation, bound) in [
        (SchemeName::Iterated, Relaxation::Aitken, 1e-8),
        (SchemeName::Iterated, Relaxation::Constant(1.0), 1e-8),
        (SchemeName::Iterated, Relaxation::Constant(0.7), 1e-8),
        // The stabilisation takes the law at the last state of the fluid, where laws with other slopes differ.
        (SchemeName::GaussSeidel, Relaxation::Aitken, 5e-8),
        (SchemeName::GaussSeidel, Relaxation::IqnIls, 5e-8),
    ] {
        for (x, y) in solved(scheme, relaxation).iter().zip(&reference) {
            assert!((x - y).norm() < bound, "{scheme}, {relaxation:?}: {x} against {y}");
        }
    }
}
