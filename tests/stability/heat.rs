//! Temperatures of grains that conduct strongly among themselves, in steps far above their relaxation time in the gas.

use voidage_coupling::closure::{Surroundings, ThermalFluid, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, TEMPERATURE};
use voidage_dem::packing::{Amount, Fill, Lattice, Radii, Region, lattice};
use voidage_dem::{Conduction, Dem, Material, Settings, Wall};
use voidage_fluid::conditions::{FlowCondition, Prescribed, ScalarCondition};
use voidage_fluid::transport::{Form, Scalar};
use voidage_verification::models::{FluidSet, Vec2, grid};

const DIAMETER: f64 = 1e-3;
const WIDTH: f64 = 6.0 * DIAMETER;
/// Of the grains, J/kg/K: so little that many relaxation times of a temperature go by while the bed hardly moves.
const CAPACITY: f64 = 1e-4;
/// Gas that flows in, gas in the box, cold grains, hot grains.
const TEMPERATURES: [f64; 4] = [290.0, 320.0, 300.0, 400.0];
/// The same where nothing exchanges heat; not a whole number, so that products are rounded.
const EQUAL: [f64; 4] = [293.15; 4];

fn glass(conductivity: f64) -> Material {
    let stiff =
        Material { young: 6e10, poisson: 0.22, conductivity, heat_capacity: CAPACITY, ..Material::default() };
    Material { friction: 0.3, ..stiff }
}

/// Rows of cold and hot grains on a floor.
fn grains(conductivity: f64, [cold, hot]: [f64; 2]) -> Dem<2> {
    let materials = [glass(conductivity)];
    let region = Region { low: Vec2::zeros(), high: Vec2::new(WIDTH, 5.0 * DIAMETER) };
    let radii = Radii::Constant(0.5 * DIAMETER * (1.0 - 1e-9));
    let fill = Fill { radii, amount: Amount::Fill, material: 0, materials: &materials, seed: 0 };
    let bed = lattice(&region, Lattice::Triangular, 1.0, &fill).expect("a lattice");
    let mut bed = bed.heated(cold, &materials).expect("heat");
    let heat = bed.heat.as_mut().expect("heat");
    heat.temperature.iter_mut().step_by(2).for_each(|t| *t = hot);
    let corner = |x: f64, y: f64| Vec2::new(x, y);
    let wall = |a, b| Wall::new("box", a, b);
    let walls = vec![
        wall(corner(0.0, 0.0), corner(WIDTH, 0.0)),
        wall(corner(0.0, 0.0), corner(0.0, 2.0 * WIDTH)),
        wall(corner(WIDTH, 0.0), corner(WIDTH, 2.0 * WIDTH)),
    ];
    let settings = Settings { conduction: Some(Conduction::Henry), ..Settings::default() };
    Dem::new(bed, walls, materials.to_vec(), settings).expect("grains")
}

/// The bed in a stream of gas, and the relaxation time of a grain's temperature, s.
fn bed(conductivity: f64, temperatures: [f64; 4]) -> (Coupled<2>, f64) {
    bed_with(SchemeName::Iterated, conductivity, temperatures)
}

fn bed_with(scheme: SchemeName, conductivity: f64, [inflow, gas, cold, hot]: [f64; 4]) -> (Coupled<2>, f64) {
    let (density, viscosity, capacity, conducts) = (1.2, 2e-5, 1010.0, 0.025);
    let blown = FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::new(0.0, 0.1)));
    let mut set = FluidSet::new(density, viscosity)
        .flow("left", FlowCondition::Slip)
        .flow("right", FlowCondition::Slip)
        .flow("bottom", blown)
        .flow("top", FlowCondition::Open { pressure: 0.0 });
    set.scalars = vec![Scalar { form: Form::Lumped, ..Scalar::new(TEMPERATURE, capacity, conducts) }];
    for condition in &mut set.conditions {
        condition.scalars = vec![match condition.boundary.as_str() {
            "bottom" => ScalarCondition::Value(Prescribed::Uniform(inflow)),
            "top" => ScalarCondition::Outflow { outside: Some(inflow) },
            _ => ScalarCondition::Insulated,
        }];
    }
    let mesh = grid([WIDTH, 2.0 * WIDTH], [6, 12]).expect("a mesh");
    let start = set.rest(&mesh, gas);
    let thermal = ThermalFluid { conductivity: conducts, prandtl: capacity * viscosity / conducts };
    let laws = set.laws(Some(thermal));
    let around = Surroundings { slip: 0.2, voidage: 0.5, diameter: DIAMETER, density, viscosity };
    let relaxation = 2500.0 * CAPACITY / laws.heat.coefficient(&around, &thermal, VoidageFunction::None);
    let fluid = set.build(mesh, start).expect("a fluid");
    let grains = grains(conductivity, [cold, hot]);
    let mut system = set.with_grains(fluid, grains, laws, scheme).expect("both");
    system.interaction_mut().expect("both").at.temperature.fill(gas);
    (system, relaxation)
}

/// Lowest and highest temperature of the grains.
fn range(system: &Coupled<2>) -> (f64, f64) {
    let heat = system.grains().and_then(|grains| grains.particles.heat.as_ref()).expect("heat");
    heat.temperature.iter().fold((f64::MAX, f64::MIN), |(low, high), t| (low.min(*t), high.max(*t)))
}

/// Whatever the step and however well grains conduct, no grain gets colder than the coldest or hotter than the hottest
/// of what there was and what flows in.
#[test]
fn grains_that_conduct_stay_within_bounds() {
    let (low, high) = (TEMPERATURES[0], TEMPERATURES[3]);
    for conductivity in [1.4, 1e4] {
        for step in [0.1, 10.0, 1e3] {
            let (mut system, relaxation) = bed(conductivity, TEMPERATURES);
            let (mut coldest, mut hottest) = range(&system);
            for _ in 0..6 {
                let report = system.step(step * relaxation).expect("a step");
                let (least, most) = range(&system);
                (coldest, hottest) = (coldest.min(least), hottest.max(most));
                assert!(report.energy_exchange_defect.expect("heat") < 1e-12);
            }
            println!("{conductivity} {step}: {coldest} .. {hottest}");
            assert!(coldest >= low && hottest <= high, "{conductivity} {step}: {coldest} .. {hottest}");
            let grains = system.grains().expect("grains");
            let through: f64 = grains.conductance().sum();
            let transfer = &system.interaction().expect("both").load.heat.as_ref().expect("heat").coefficient;
            let outside: f64 = transfer.iter().sum();
            assert!(through > outside || conductivity < 1e4, "contacts conduct little: {through} {outside}");
        }
    }
}

/// Of schemes that solve the fluid once only the motion was compared, and steps in which temperatures swing passed.
#[test]
fn temperatures_that_leave_their_law_disagree() {
    let step = |scheme: SchemeName, step: f64| {
        let (mut system, relaxation) = bed_with(scheme, 1.4, TEMPERATURES);
        system.step(step * relaxation).expect("a step").agreement.expect("both")
    };
    let [long, short] = [1.0, 1e-3].map(|length| step(SchemeName::Explicit, length));
    assert!(long.heat_disagreement > 0.1 && !long.converged, "{long:?}");
    assert!(short.heat_disagreement < 1e-2 * long.heat_disagreement && short.converged, "{short:?}");
}

/// The range of temperatures of such a bed is one of rounding errors, against which others of them disagree.
#[test]
fn a_bed_at_one_temperature_takes_one_solution_of_the_fluid() {
    let (mut system, _) = bed(1.4, EQUAL);
    for step in 0..60 {
        let report = system.step(1e-3).expect("a step");
        let agreement = report.agreement.expect("both");
        assert!(agreement.converged && agreement.solves == 1, "step {step}: {agreement:?}");
    }
}

/// A range of a millikelvin is not taken for rounding errors: the disagreement is that of the same bed with a large
/// one, less the accuracy of the temperatures.
#[test]
fn a_small_difference_of_temperatures_is_compared_with_its_range() {
    let disagreement = |warmer: f64| {
        let (mut system, relaxation) = bed(1.4, [EQUAL[0], EQUAL[0], EQUAL[0], EQUAL[0] + warmer]);
        let report = system.step(3.0 * relaxation).expect("a step");
        report.agreement.expect("both").heat_disagreement
    };
    let (small, large) = (disagreement(1e-3), disagreement(10.0));
    assert!(large > 1e-3 && small > 0.9 * large && small <= large, "{small} {large}");
}
