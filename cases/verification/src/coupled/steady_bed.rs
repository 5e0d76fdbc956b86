//! The steady pressure drop of a held bed, for any step and mesh.

use crate::models::{FluidSet, Vec2, grains, grid, unstructured, weightless};
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::closure::{Drag, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Error, Laws, Result};
use voidage_dem::Material;
use voidage_fluid::Mesh;
use voidage_fluid::conditions::{FlowCondition, Prescribed};

/// The case.
pub const CASE: Case = Case {
    name: "steady-bed",
    group: "coupled",
    title: "pressure drop inside a held bed over step, mesh and Reynolds number, in gas and liquid",
    source: "exact for a bed of one voidage: Ergun, Chem. Eng. Prog. 48(2), 89 (1952)",
    run,
};

/// Discs on a square lattice: a voidage of 0.648.
const DIAMETER: f64 = 2e-3;
const SPACING: f64 = 2.5e-3;
const SOLIDITY: f64 = 0.7;
const COLUMNS: usize = 8;
const ROWS: usize = 16;
/// Clear fluid below and above the bed, m.
const CLEAR: f64 = 0.02;
/// The mean gradient is taken from so far above the lower end of the bed to as far below its upper end, m: the nodal
/// voidage smears the ends over an element, where the law gives less.
const END: f64 = 0.01;

/// Density, kg/m3, and viscosity, Pa s.
type Properties = [f64; 2];
const AIR: Properties = [1.2, 1.8e-5];
const WATER: Properties = [1000.0, 1e-3];

#[derive(Clone, Copy)]
struct Bed {
    fluid: Properties,
    /// Superficial velocity, m/s.
    inflow: f64,
    /// Width over which grains are spread, in their diameters.
    kernel: f64,
    /// Drag of the front and rear walls, kg/m3/s.
    thin_cell: f64,
}

impl Bed {
    fn voidage() -> f64 {
        1.0 - SOLIDITY * std::f64::consts::FRAC_PI_4 * (DIAMETER / SPACING).powi(2)
    }

    /// Pressure gradient by Ergun's equation and by the walls of a thin cell, Pa/m.
    fn law(&self) -> f64 {
        let ([density, viscosity], eps, w) = (self.fluid, Self::voidage(), self.inflow);
        let viscous = 150.0 * (1.0 - eps).powi(2) * viscosity * w / (eps.powi(3) * DIAMETER.powi(2));
        let inertial = 1.75 * (1.0 - eps) * density * w * w / (eps.powi(3) * DIAMETER);
        viscous + inertial + self.thin_cell * w / eps.powi(2)
    }

    /// Time in which drag stops the fluid, s.
    fn relaxation(&self) -> f64 {
        self.fluid[0] * self.inflow / (Self::voidage() * self.law())
    }

    /// Mean pressure gradient inside the bed once it is steady, Pa/m, with a step over the relaxation time.
    fn measured(&self, mesh: &Mesh<2>, step: f64) -> Result<f64> {
        let [density, viscosity] = self.fluid;
        let inflow = Prescribed::Uniform(Vec2::new(0.0, self.inflow));
        let mut set = FluidSet::new(density, viscosity)
            .flow("left", FlowCondition::Slip)
            .flow("right", FlowCondition::Slip)
            .flow("top", FlowCondition::Open { pressure: 0.0 })
            .flow("bottom", FlowCondition::SuperficialVelocity(inflow));
        set.properties.thin_cell_drag = self.thin_cell;
        let start = set.rest(mesh, 0.0);
        let place = |k: usize| [(k % COLUMNS) as f64, (k / COLUMNS) as f64].map(|n| (n + 0.5) * SPACING);
        let places = (0..COLUMNS * ROWS).map(|k| Vec2::from(place(k)) + Vec2::new(0.0, CLEAR)).collect();
        let material = Material { solidity: SOLIDITY, ..Material::default() };
        let mut held = grains(places, 0.5 * DIAMETER, material, weightless())?;
        held.particles.mass.fill(f64::INFINITY);
        let kernel = self.kernel;
        let laws =
            Laws { drag: Drag::Ergun, voidage_function: VoidageFunction::None, kernel, ..set.laws(None) };
        let mut system =
            set.with_grains(set.build(mesh.clone(), start)?, held, laws, SchemeName::Iterated)?;
        let ends = [CLEAR + END, CLEAR + ROWS as f64 * SPACING - END];
        let inside: Vec<usize> =
            (0..mesh.cell_count()).filter(|k| (ends[0]..ends[1]).contains(&mesh.centroid(*k).y)).collect();
        let area: f64 = inside.iter().map(|k| mesh.measure(*k)).sum();
        let mut last = f64::NAN;
        for _ in 0..(20.0 / step).ceil() as usize + 40 {
            system.step(step * self.relaxation())?;
            let fields = &system.fluid().ok_or_else(|| Error::run("the bed has lost its fluid"))?.accepted;
            let rise = |k: &usize| mesh.measure(*k) * mesh.gradient(*k, |node| fields.pressure[node]).y;
            let now = -inside.iter().map(rise).sum::<f64>() / area;
            if (now - last).abs() < 1e-7 * now.abs() {
                return Ok(now);
            }
            last = now;
        }
        Ok(last)
    }
}

/// A mesh of the bed with edges of so many diameters.
fn mesh(edge: f64, squares: bool) -> Result<Mesh<2>> {
    let size = [COLUMNS as f64 * SPACING, ROWS as f64 * SPACING + 2.0 * CLEAR];
    match squares {
        true => grid(size, size.map(|length| (length / (edge * DIAMETER)).round() as usize)),
        false => unstructured(size, edge * DIAMETER),
    }
}

fn run(effort: Effort) -> Result<Outcome> {
    let creeping = Bed { fluid: AIR, inflow: 0.01, kernel: 1.0, thin_cell: 0.0 };
    // Between front and rear walls: 12 eta / gap^2.
    let thin = |gap: f64| Bed { thin_cell: 12.0 * AIR[1] / (gap * DIAMETER).powi(2), ..creeping };
    let mut outcome = Outcome::default();
    let mut drawn = Vec::new();
    // Over four decades of the step, on each mesh and in both fluids.
    let steps: &[f64] = effort.pick(&[0.3, 8.0, 1e4], &[0.3, 1.0, 3.0, 10.0, 100.0, 1e4]);
    let over_the_step: &[(&str, f64, bool, Bed)] = &[
        ("gas, elements of 1 d", 1.0, false, creeping),
        ("gas, elements of 2 d", 2.0, false, creeping),
        ("gas, squares of 1 d", 1.0, true, creeping),
        ("liquid, elements of 1 d", 1.0, false, Bed { fluid: WATER, inflow: 1e-3, ..creeping }),
        ("gas between walls 2 d apart, elements of 1 d", 1.0, false, thin(2.0)),
        ("gas between walls 0.4 d apart, elements of 1 d", 1.0, false, thin(0.4)),
    ];
    for (name, edge, squares, bed) in over_the_step {
        let mesh = mesh(*edge, *squares)?;
        let shares = steps
            .iter()
            .map(|step| Ok((*step, bed.measured(&mesh, *step)? / bed.law())))
            .collect::<Result<Vec<_>>>()?;
        let of = |pick: fn(f64, f64) -> f64| shares.iter().map(|(_, share)| *share).reduce(pick);
        let (low, high) = (of(f64::min).unwrap_or(f64::NAN), of(f64::max).unwrap_or(f64::NAN));
        outcome.findings.push(Finding::relative(
            format!("share of the law, least, {name}"),
            "1",
            1.0,
            low,
            0.015,
        ));
        outcome.findings.push(Finding::relative(
            format!("share of the law, most, {name}"),
            "1",
            1.0,
            high,
            0.015,
        ));
        let what = format!("spread over four decades of the step, {name}");
        outcome.findings.push(Finding::at_most(what, "1", 8e-3, high - low));
        drawn.push(Curve::joined(*name, shares));
    }
    let mesh = mesh(1.0, false)?;
    for inflow in [1e-3, 0.1, 1.0] {
        let bed = Bed { inflow, ..creeping };
        let reynolds = bed.fluid[0] * inflow * DIAMETER / bed.fluid[1];
        let share = bed.measured(&mesh, 8.0)? / bed.law();
        let what = format!("share of the law at Re = {reynolds:.2}");
        outcome.findings.push(Finding::relative(what, "1", 1.0, share, 0.015));
    }
    // Elements smaller than a grain see it apart from its gap, unless it is spread.
    let fine = self::mesh(0.5, false)?;
    for (what, kernel, share, allowed) in
        [("the grains themselves", 1.0, 1.36, 0.05), ("grains spread over two diameters", 2.0, 1.0, 0.05)]
    {
        let found = Bed { kernel, ..creeping }.measured(&fine, 8.0)? / creeping.law();
        let what = format!("share of the law, elements of half a diameter, {what}");
        outcome.findings.push(Finding::relative(what, "1", share, found, allowed));
    }
    outcome.panels.push(Panel {
        curves: drawn,
        log: [true, false],
        ..Panel::new(
            "Pressure drop inside a held bed",
            "step / relaxation time of the fluid",
            "share of Ergun's law",
        )
    });
    Ok(outcome)
}
