//! What passes the named parts of the boundary closes the balances of volume, momentum and scalars of every step.

use std::path::Path;
use voidage_coupling::backend::{FluidBackend, FluidStep, Solution};
use voidage_coupling::error::Result;
use voidage_coupling::{Coupled, Error, HEAT};
use voidage_fluid::Mesh;
use voidage_fluid::element::{Element, weighted_load, weighted_mass};
use voidage_fluid::flow::State;
use voidage_scene::{Scene, Simulation};
use voidage_verification::models::Vec2;

/// A scene of the repository with equations that are solved to rounding.
fn simulation(path: &str, sets: &[&str]) -> (Scene, Simulation) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    let exact =
        ["fluid.solver.tolerance=1e-14", "fluid.solver.linear=\"direct\"", "coupling.scheme=\"henry\""];
    let sets: Vec<String> = sets.iter().chain(&exact).map(ToString::to_string).collect();
    let scene = Scene::read(&path, &sets).unwrap_or_else(|error| panic!("{error}"));
    let simulation = Simulation::new(&scene).unwrap_or_else(|error| panic!("{error}"));
    (scene, simulation)
}

/// What the discrete equations of a step contain beside the boundary, summed over all tests.
struct Inside {
    /// Weight less rate of momentum, drag of the walls of a thin cell and force on the grains, N/m.
    force: Vec2,
    /// Storage and convection of each scalar less what grains and a thin cell give, W/m for heat.
    scalars: Vec<f64>,
}

fn inside(scene: &Scene, system: &Coupled<2>, old: &State<2>, before: &[Vec2]) -> Inside {
    let (fluid, both) = (system.fluid().expect("fluid"), system.interaction().expect("both"));
    let (described, dt) = (scene.fluid.as_ref().expect("fluid"), scene.time.step);
    let (mesh, new) = (&fluid.mesh, &fluid.accepted);
    let mesh_velocity = |n: usize| (mesh.points[n] - before[n]) / dt;
    let cell_walls = described.thin_cell.as_ref();
    let mut force = -both.lost.0;
    let mut scalars = vec![0.0; new.scalars.len()];
    for cell in mesh.cells.chunks_exact(3) {
        let node = [0, 1, 2].map(|a| cell[a] as usize);
        let element = Element::<2, 3>::new(node.map(|n| mesh.points[n]));
        let eps = node.map(|n| both.load.voidage[n]);
        let (mass, load) = (weighted_mass(element.measure, &eps), weighted_load(element.measure, &eps));
        let (u, u_old) = (node.map(|n| new.velocity[n]), node.map(|n| old.velocity[n]));
        let wind = node.map(|n| old.velocity[n] - mesh_velocity(n));
        let sum = |v: &[Vec2; 3]| (0..3).map(|a| v[a] * load[a]).sum::<Vec2>();
        let (slope, slope_old) = (element.gradient_of_vector(&u), element.gradient_of_vector(&u_old));
        // One Newton step of the convection about the old velocity.
        let carried = slope * sum(&wind) + slope_old * (sum(&u) - sum(&u_old));
        force -= ((sum(&u) - sum(&u_old)) / dt + carried) * described.density;
        let drag = cell_walls.map_or(0.0, |walls| walls.drag);
        force -= u.iter().sum::<Vec2>() * (drag * element.measure / 3.0);
        for (k, value) in scalars.iter_mut().enumerate() {
            let (s, s_old) = (node.map(|n| new.scalars[k][n]), node.map(|n| old.scalars[k][n]));
            let heat = described.heat.as_ref().filter(|_| k == HEAT);
            let capacity = heat.map_or(1.0, |heat| described.density * heat.heat_capacity);
            let stored: f64 =
                (0..9).map(|ab| mass[ab / 3][ab % 3] * (s[ab % 3] - s_old[ab % 3])).sum::<f64>() / dt;
            *value += capacity * (stored + sum(&wind).dot(&element.gradient_of(&s)));
            if let Some(walls) = cell_walls.and_then(|walls| walls.heat.as_ref()).filter(|_| k == HEAT) {
                let mean = s.iter().sum::<f64>() / 3.0;
                *value -= walls.coefficient * element.measure * (walls.temperature - mean);
            }
        }
    }
    scalars[HEAT] += both.lost.1;
    // The weight acts on what the grains leave, piece by piece.
    let heat = described.heat.as_ref().expect("heat");
    let reference = heat.reference_temperature.unwrap_or(heat.initial_temperature);
    let light = |t: f64| 1.0 - heat.expansion * (t - reference);
    let whole: f64 = fluid.nodal_volume.iter().zip(new.scalar(HEAT)).map(|(v, t)| v * light(*t)).sum();
    let points = &both.points;
    let displaced: f64 = (0..points.len())
        .map(|q| {
            let (cell, x) = (points.cell[q], &points.coordinate[q]);
            let t = voidage_coupling::exchange::at_point(mesh, cell, x, new.scalar(HEAT));
            points.volume[q] * light(t)
        })
        .sum();
    force += scene.gravity.vector::<2>() * (described.density * (whole - displaced));
    Inside { force, scalars }
}

/// Steps a scene and holds the sums over its boundary against what is inside.
fn closes(path: &str, sets: &[&str]) {
    let (scene, mut simulation) = simulation(path, sets);
    for _ in 0..4 {
        let fluid = simulation.coupled().fluid().expect("fluid");
        let (old, before) = (fluid.accepted.clone(), fluid.mesh.points.clone());
        simulation.step().expect("a step");
        let system = simulation.coupled();
        let inside = inside(&scene, system, &old, &before);
        let balances = &system.fluid().expect("fluid").solution.balances;
        let near = |what: &str, sum: f64, other: f64, terms: f64| {
            assert!((sum - other).abs() < 1e-10 * terms, "{path}: {what} {sum} {other}, terms {terms}");
            assert!(terms > 0.0, "{what}: nothing passes, the test would see nothing");
        };
        let flux: Vec<f64> = balances.iter().map(|balance| balance.flux).collect();
        near("volume", flux.iter().sum(), 0.0, flux.iter().map(|flux| flux.abs()).sum());
        for axis in 0..2 {
            let force: Vec<f64> = balances.iter().map(|balance| balance.force[axis]).collect();
            let all: f64 = balances.iter().map(|balance| balance.force.norm()).sum();
            near("momentum", force.iter().sum(), inside.force[axis], all);
        }
        for (k, inside) in inside.scalars.iter().enumerate() {
            let given: Vec<f64> = balances.iter().map(|balance| balance.scalars[k]).collect();
            let carried: f64 = balances.iter().map(|balance| balance.convected[k].abs()).sum();
            near("scalar", given.iter().sum(), *inside, carried);
        }
    }
}

/// How far the fastest grain moves in a step, in its diameters.
fn fastest(simulation: &Simulation, step: f64) -> f64 {
    let particles = &simulation.coupled().grains().expect("grains").particles;
    let moved = |(v, r): (&Vec2, &f64)| v.norm() * step / (2.0 * r);
    particles.velocity.iter().zip(&particles.radius).map(moved).fold(0.0, f64::max)
}

/// A solver that fails in its n-th solution.
struct Fails {
    inner: Box<dyn FluidBackend<2>>,
    left: u32,
}

impl FluidBackend<2> for Fails {
    fn set_mesh(&mut self, mesh: &Mesh<2>, generation: u32, fields: &State<2>) -> Result<()> {
        self.inner.set_mesh(mesh, generation, fields)
    }

    fn solve(&mut self, step: &FluidStep<'_, 2>, out: &mut Solution<2>) -> Result<()> {
        self.left -= 1;
        if self.left == 0 {
            return Err(Error::run("asked to fail"));
        }
        self.inner.solve(step, out)
    }

    fn accept(&mut self) {
        self.inner.accept()
    }
}

/// Its state was offered for a restart, which refused it.
#[test]
fn a_step_that_fails_after_its_first_part_leaves_no_state_to_go_on_from() {
    let path = "tests/python/scenes/moving-mesh.toml";
    let (scene, mut whole) = simulation(path, &["time.step=1e-3"]);
    whole.step().expect("a step");
    let cut = format!("coupling.cut={{travel={}}}", 0.6 * fastest(&whole, scene.time.step));
    for (solution, between) in [(2, true), (3, false)] {
        let (_, mut run) = simulation(path, &["time.step=1e-3", &cut]);
        run.coupled_mut()
            .fluid_mut()
            .expect("a fluid")
            .wrap_backend(|inner| Box::new(Fails { inner, left: solution }));
        assert!(run.step().is_err());
        assert_eq!(run.is_between_steps(), between, "after {solution} solutions");
        assert_eq!(run.coupled().time() == 0.0, between);
        assert!(run.coupled().time() < scene.time.step);
    }
}

/// What passes the boundary in a step that is done in two parts was that of the second part.
#[test]
fn a_step_in_parts_reports_what_passes_in_all_of_them() {
    let (path, exact) =
        ("tests/python/scenes/moving-mesh.toml", "contacts={tolerance=1e-18,max_sweeps=100000}");
    let (scene, mut halves) = simulation(path, &["time.step=5e-4", exact]);
    let (_, mut cut) = simulation(path, &["time.step=1e-3", exact]);
    let balances =
        |simulation: &Simulation| simulation.coupled().fluid().expect("fluid").solution.balances.clone();
    halves.step().expect("a step");
    let first = balances(&halves);
    halves.step().expect("a step");
    let (second, travel) = (balances(&halves), 1.2 * fastest(&halves, scene.time.step));
    let cutting = Some(voidage_coupling::scheme::cut::Cutting { travel, ..Default::default() });
    let scheme = voidage_coupling::scheme::SchemeName::Henry;
    cut.coupled_mut().set_scheme(
        scheme.build(&voidage_coupling::scheme::Options { cut: cutting, ..Default::default() }).unwrap(),
    );
    let report = cut.step().expect("a step");
    assert_eq!(report.agreement.expect("both").parts, 2);
    let mut differs = 0.0f64;
    for ((sum, a), b) in balances(&cut).iter().zip(&first).zip(&second) {
        let near = |sum: f64, a: f64, b: f64| {
            assert!((sum - 0.5 * (a + b)).abs() <= 1e-8 * (a.abs() + b.abs()), "{sum} {a} {b}");
        };
        near(sum.flux, a.flux, b.flux);
        let (off, size) = (sum.force - (a.force + b.force) * 0.5, a.force.norm() + b.force.norm());
        assert!(off.norm() <= 1e-8 * size, "{} {} {}", sum.force, a.force, b.force);
        near(sum.torque[0], a.torque[0], b.torque[0]);
        for k in 0..sum.scalars.len() {
            near(sum.convected[k], a.convected[k], b.convected[k]);
            near(sum.scalars[k], a.scalars[k], b.scalars[k]);
        }
        differs = differs.max((a.force - b.force).norm());
    }
    assert!(differs > 1.0, "both parts are alike: the test would see nothing");
}

const TRACER: [&str; 2] = [
    "fluid.scalars=[{name=\"tracer\",diffusivity=1e-4,initial=0.2}]",
    "fluid.boundaries.inflow.scalars.tracer.value=1.0",
];

#[test]
fn balances_close_on_a_mesh_that_stands() {
    let sets = ["grains[0].amount.mass=0.2", "fluid.mesh.rectangle.size=4e-3"];
    closes("cases/bubbling-bed/scene-quick.toml", &[&sets[..], &TRACER].concat());
}

#[test]
fn balances_close_on_a_mesh_that_moves() {
    closes("tests/python/scenes/moving-mesh.toml", &TRACER);
}

/// Grains that a scheme pushes otherwise than the fluid was told make the defect what it is: the share that nobody
/// lost.
#[test]
fn a_force_that_the_fluid_did_not_lose_is_a_momentum_exchange_defect() {
    use voidage_coupling::scheme::Scheme;
    use voidage_coupling::{Mixture, Result, StepReport};
    struct Cheat(f64);
    impl Scheme<2> for Cheat {
        fn step(&mut self, mixture: &mut Mixture<2>, dt: f64) -> Result<StepReport> {
            let mut report = StepReport::default();
            mixture.cut_grains(&mut report)?;
            mixture.evaluate_closures(dt, &mut report)?;
            mixture.solve_fluid(dt, &mut report)?;
            mixture.interaction.force.iter_mut().for_each(|force| *force *= self.0);
            mixture.interaction.heat.iter_mut().for_each(|heat| *heat *= self.0);
            mixture.move_grains(dt, &mut report);
            mixture.accept(dt, &mut report)?;
            Ok(report)
        }
    }
    for factor in [1.0, 1.25] {
        let (_, mut simulation) = simulation("tests/python/scenes/moving-mesh.toml", &[]);
        simulation.coupled_mut().set_scheme(Box::new(Cheat(factor)));
        let report = simulation.step().expect("a step");
        let found = [report.momentum_exchange_defect, report.energy_exchange_defect];
        for defect in found.map(|defect| defect.expect("both")) {
            let share = (factor - 1.0) / factor;
            assert!(defect < share * 1.01 + 1e-12 && defect > 0.5 * share, "{defect}, {factor}");
        }
    }
}

/// A grain half outside of the mesh is half a grain for the fluid.
#[test]
fn a_grain_that_the_boundary_cuts_is_a_solid_volume_defect() {
    let (scene, mut simulation) = simulation("tests/python/scenes/moving-mesh.toml", &[]);
    let top = 0.08;
    let grains = simulation.coupled_mut().grains_mut().expect("grains");
    let count = grains.particles.len() as f64;
    grains.particles.position[0].y = top;
    grains.particles.velocity[0].y = 0.0;
    let report = simulation.step().expect("a step");
    let defect = report.solid_volume_defect.expect("both");
    assert!((defect - 0.5 / count).abs() < 1e-12, "{defect}, half of one in {count}");
    let both = simulation.coupled().interaction().expect("both");
    let whole = both.load.volume[1];
    assert!((both.load.volume[0] / whole - 0.5).abs() < 1e-12);
    drop(scene);
}
