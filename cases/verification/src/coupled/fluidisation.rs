//! The inflow that lifts a bed.

use crate::models::{FluidSet, Vec2, column, pile};
use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Error, Laws, Result};
use voidage_dem::{Material, Settings};
use voidage_fluid::conditions::{FlowCondition, Prescribed};

/// The case.
pub const CASE: Case = Case {
    name: "minimum-fluidisation",
    group: "coupled",
    title: "pressure drop of a bed that rests on its floor, and the inflow at which the floor carries nothing",
    source: "exact for the closure: sum of V (gamma/V) w / eps over the grains, w = U/eps, is the pressure drop times \
             the area, and the weight at U_mf",
    run,
};

/// Air and glass (SI); the solidity of the discs gives the bed the share of a packed bed of spheres, 0.55.
const FLUID: f64 = 1.2;
const VISCOSITY: f64 = 2e-5;
const SOLID: f64 = 2500.0;
const DIAMETER: f64 = 1e-3;
const SOLIDITY: f64 = 0.7;
const GRAVITY: f64 = 9.81;

struct Bed {
    system: Coupled<2>,
    laws: Laws,
    width: f64,
}

fn lost() -> Error {
    Error::run("the bed has lost its grains or its fluid")
}

/// Grains in single file on a floor: a bed that has one voidage all over, which a packing does not have at its walls.
fn bed(rows: usize) -> Result<Bed> {
    let width = 1.001 * DIAMETER;
    let squares = rows / 4 + 4;
    let mut set = FluidSet::new(FLUID, VISCOSITY)
        .flow("left", FlowCondition::Slip)
        .flow("right", FlowCondition::Slip)
        .flow("top", FlowCondition::Open { pressure: 0.0 })
        .flow("bottom", FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::zeros())));
    set.properties.gravity = Vec2::new(0.0, -GRAVITY);
    let mesh = column([width, 4.0 * DIAMETER * squares as f64], squares)?;
    let start = set.rest(&mesh, 0.0);
    let heights: Vec<f64> = (0..rows).map(|k| (k as f64 + 0.5) * DIAMETER).collect();
    let material = Material { density: SOLID, solidity: SOLIDITY, ..Material::default() };
    let settings = Settings { tolerance: 1e-7, max_sweeps: 20_000, ..Settings::default() };
    let grains = pile(&heights, 0.5 * DIAMETER, width, material, settings)?;
    let laws = Laws { voidage_function: VoidageFunction::Henry, ..set.laws(None) };
    let system = set.with_grains(set.build(mesh, start)?, grains, laws, SchemeName::Henry)?;
    Ok(Bed { system, laws, width })
}

impl Bed {
    /// Steps at a superficial velocity; the force that floor and bed put on each other and the pressure below over that
    /// above, both over the width, Pa.
    fn steps(&mut self, inflow: f64, count: usize) -> Result<[f64; 2]> {
        let fluid = self.system.fluid_mut().ok_or_else(lost)?;
        for condition in fluid.conditions.iter_mut().filter(|condition| condition.boundary == "bottom") {
            condition.flow = FlowCondition::SuperficialVelocity(Prescribed::Uniform(Vec2::new(0.0, inflow)));
        }
        for _ in 0..count {
            self.system.step(1e-3)?;
        }
        let fluid = self.system.fluid().ok_or_else(lost)?;
        let fields = &fluid.accepted;
        let low = (0..fields.pressure.len()).filter(|a| fluid.mesh.points[*a].y < 1e-9);
        let pressures: Vec<f64> = low.map(|a| fields.pressure[a]).collect();
        let (_, upper) = fluid.mesh.bounds();
        let hydrostatic = FLUID * GRAVITY * upper.y;
        let drop = pressures.iter().sum::<f64>() / pressures.len() as f64 - hydrostatic;
        let grains = self.system.grains().ok_or_else(lost)?;
        Ok([-grains.wall_force()[0].y / self.width, drop])
    }

    /// Weight of the grains less buoyancy over the width, Pa.
    fn weight(&self) -> Result<f64> {
        let particles = &self.system.grains().ok_or_else(lost)?.particles;
        let mass: f64 = particles.mass.iter().zip(&particles.volume).map(|(m, v)| m - FLUID * v).sum();
        Ok(mass * GRAVITY / self.width)
    }

    /// The pressure drop that the closure gives at the voidages of the grains, Pa.
    fn closure(&self, inflow: f64) -> Result<f64> {
        let interaction = self.system.interaction().ok_or_else(lost)?;
        let volumes = &interaction.load.volume;
        let each = interaction.voidage.iter().zip(volumes).map(|(voidage, volume)| {
            let slip = inflow / voidage;
            let around = Surroundings {
                slip,
                voidage: *voidage,
                diameter: DIAMETER,
                density: FLUID,
                viscosity: VISCOSITY,
            };
            volume * self.laws.drag.coefficient(&around, self.laws.voidage_function) * slip / voidage
        });
        Ok(each.sum::<f64>() / self.width)
    }

    /// The inflow at which that is the weight, m/s.
    fn exact(&self) -> Result<f64> {
        let (weight, mut low, mut high) = (self.weight()?, 0.0, 10.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if self.closure(middle)? < weight { low = middle } else { high = middle }
        }
        Ok(low)
    }
}

fn run(effort: Effort) -> Result<Outcome> {
    let (rows, steps) = effort.pick((40, 30), (120, 100));
    let mut bed = bed(rows)?;
    bed.steps(0.0, steps)?;
    let (exact, weight) = (bed.exact()?, bed.weight()?);
    let mut outcome = Outcome::default();
    let (mut drops, mut floors, mut law) = (Vec::new(), Vec::new(), Vec::new());
    for share in [0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95] {
        let [floor, drop] = bed.steps(share * exact, steps)?;
        let known = bed.closure(share * exact)?;
        if share == 0.4 || share == 0.8 {
            let what = format!("pressure drop of the resting bed at {share} U_mf");
            outcome.findings.push(Finding::relative(what, "Pa", known, drop, 0.01));
        }
        drops.push((share, drop / weight));
        floors.push((share, floor / weight));
        law.push((share, known / weight));
    }
    // The floor's share is smooth in U: the parabola through its last three values gives where it is zero.
    let zero = parabola_zero([floors[4], floors[5], floors[6]]);
    outcome.findings.push(Finding::relative(
        "inflow at which the floor carries nothing",
        "m/s",
        exact,
        zero * exact,
        0.01,
    ));
    outcome.panels.push(Panel {
        curves: vec![
            Curve::points("pressure drop", drops),
            Curve::points("carried by the floor", floors),
            Curve::line("closure", law),
        ],
        ..Panel::new("Bed under an inflow", "U / U_mf", "share of the weight")
    });
    Ok(outcome)
}

/// Zero, beyond the last point, of the parabola through three points.
fn parabola_zero([(x0, y0), (x1, y1), (x2, y2)]: [(f64, f64); 3]) -> f64 {
    let (first, second) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
    let bend = (second - first) / (x2 - x0);
    // y2 + s (x - x2) + bend (x - x2)^2 with the slope s at the last point; Newton from there.
    let slope = second + bend * (x2 - x1);
    let mut step = -y2 / slope;
    for _ in 0..50 {
        step -= (y2 + slope * step + bend * step * step) / (slope + 2.0 * bend * step);
    }
    x2 + step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_zero_of_a_parabola_is_found() {
        let y = |x: f64| (x - 1.25) * (x + 3.0);
        let zero = parabola_zero([0.8, 0.9, 0.95].map(|x| (x, y(x))));
        assert!((zero - 1.25).abs() < 1e-12);
    }
}
