//! The front of a settling suspension.

use crate::grains::scene::line;
use crate::models::{FluidSet, Vec2, alike, bisect, parallel};
use crate::{Case, Finding, Outcome};
use std::f64::consts::PI;
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::closure::{Surroundings, VoidageFunction};
use voidage_coupling::scheme::SchemeName;
use voidage_coupling::{Coupled, Error, Laws, Result};
use voidage_dem::{Dem, Material, Settings, Wall};
use voidage_fluid::conditions::FlowCondition;

/// The case.
pub const CASE: Case = Case {
    name: "settling-front",
    group: "coupled",
    title: "speed of the front between a suspension that settles from rest and the clear liquid above it",
    source: "exact for the closure: v = -eps w where (gamma/V) w = eps (rho_p - rho_f) g and eps u + phi v = 0",
    run,
};

/// Water and glass (SI).
const FLUID: f64 = 1000.0;
const SOLID: f64 = 2500.0;
const VISCOSITY: f64 = 1e-3;
const GRAVITY: f64 = 9.81;
/// Rows of grains, and rows that would fit into the clear liquid above.
const ROWS: usize = 96;
const CLEAR: usize = 24;

/// A square lattice of grains, a square of the mesh for every few.
///
/// A uniform suspension does not stay one for long. P1 velocities that change sign from row to row of nodes have no
/// divergence that a cell sees, so that only momentum holds them: solid that alternates from node to node by a share d
/// drives them with some 10 d terminal velocities (measured, for fine grains, two to eight rows to a square). Waves run
/// in from the front and from the sediment and grow; the inertia of coarse grains slows them. And a grain that passes
/// through a cell loads it by its own weight, which the pressure stabilisation answers with a flow in proportion to its
/// time: fine grains fall too fast, by 4 % (3 x 3 to a square) to 90 % (one), where a step is longer than their
/// relaxation time, by 0.3 % where it is a tenth of it. So the lattice is one that loads all nodes alike, coarse grains
/// are followed over eight rows, and fine ones over two, with short steps.
#[derive(Clone, Copy)]
struct Suspension {
    function: VoidageFunction,
    /// Share of solid.
    share: f64,
    /// m.
    diameter: f64,
    /// Rows to a square, and squares across.
    each: usize,
    across: usize,
    /// How far a grain falls in a step, in spacings of the lattice.
    travel: f64,
    /// Rows fallen between which the speed is measured, behind the start from rest.
    window: [f64; 2],
}

impl Suspension {
    /// gamma / V of a grain at a slip.
    fn drag(&self, laws: &Laws, slip: f64) -> f64 {
        let voidage = 1.0 - self.share;
        let around =
            Surroundings { slip, voidage, diameter: self.diameter, density: FLUID, viscosity: VISCOSITY };
        laws.drag.coefficient(&around, laws.voidage_function)
    }

    /// Speed of the grains, m/s: the balance of one grain, solved by bisection.
    fn speed(&self, laws: &Laws) -> f64 {
        let voidage = 1.0 - self.share;
        let weight = voidage * (SOLID - FLUID) * GRAVITY;
        voidage * bisect(1.0, 200, |speed| self.drag(laws, speed) * speed < weight)
    }

    /// Distance between grains, m.
    fn spacing(&self) -> f64 {
        (0.25 * PI / self.share).sqrt() * self.diameter
    }

    fn columns(&self) -> usize {
        self.across * self.each
    }

    fn system(&self) -> Result<(Coupled<2>, Laws)> {
        let mut set = FluidSet::new(FLUID, VISCOSITY)
            .flow("top", FlowCondition::Open { pressure: 0.0 })
            .flow("bottom", FlowCondition::Slip)
            .flow("left", FlowCondition::Slip)
            .flow("right", FlowCondition::Slip);
        set.properties.gravity = Vec2::new(0.0, -GRAVITY);
        let apart = self.spacing();
        let [width, height] = [self.columns(), ROWS + CLEAR].map(|count| count as f64 * apart);
        let mesh = parallel([width, height], [self.across, (ROWS + CLEAR) / self.each])?;
        let laws = Laws { voidage_function: self.function, ..set.laws(None) };
        let place = |k: usize| {
            Vec2::new((k % self.columns()) as f64 + 0.5, (k / self.columns()) as f64 + 0.5) * apart
        };
        let material = Material { density: SOLID, ..Material::default() };
        let particles =
            alike((0..ROWS * self.columns()).map(place).collect(), 0.5 * self.diameter, &material)?;
        let [a, b, c, d] = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]].map(Vec2::from);
        let walls = vec![Wall::new("floor", a, b), Wall::new("left", a, c), Wall::new("right", b, d)];
        let grains = Dem::new(particles, walls, vec![material], Settings::default())?;
        let start = set.rest(&mesh, 0.0);
        let system = set.with_grains(set.build(mesh, start)?, grains, laws, SchemeName::default())?;
        Ok((system, laws))
    }

    /// Height of the front, in spacings: that of a suspension of the full share of solid which holds as many rows above
    /// a level in its middle as there are. The grains on top see the clear liquid of the cell above them, fall faster,
    /// and gather to a cap as tall as a cell or two; what it holds is counted, where it is does not matter.
    fn front(&self, system: &Coupled<2>) -> Result<f64> {
        let grains = system.grains().ok_or_else(|| Error::run("no grains"))?;
        let mut heights: Vec<f64> = grains.particles.position.iter().map(|x| x.y / self.spacing()).collect();
        heights.sort_by(f64::total_cmp);
        let rows: Vec<f64> =
            heights.chunks(self.columns()).map(|row| row.iter().sum::<f64>() / row.len() as f64).collect();
        let middle = 0.5 * ROWS as f64;
        let above = rows.partition_point(|y| *y < middle).clamp(1, ROWS - 1);
        let part = (rows[above] - middle) / (rows[above] - rows[above - 1]);
        Ok(middle + (ROWS - above) as f64 - 0.5 + part)
    }

    /// Time, in which a row falls by its distance to the next, and height of the front, in spacings, from rest to the
    /// end of the window; and the speed that the closure gives, m/s.
    fn fall(&self) -> Result<(Vec<(f64, f64)>, f64)> {
        let (mut system, laws) = self.system()?;
        let speed = self.speed(&laws);
        let dt = self.travel * self.spacing() / speed;
        let mut path = vec![(0.0, self.front(&system)?)];
        for step in 1..=(self.window[1] / self.travel).round() as usize {
            system.step(dt)?;
            path.push((step as f64 * self.travel, self.front(&system)?));
        }
        Ok((path, speed))
    }
}

/// What falls: coarse grains in a box as wide as effort allows, and fine grains in single file.
fn suspensions(effort: Effort) -> Vec<Suspension> {
    let across = effort.pick(1, 6);
    let coarse = |function, share| Suspension {
        function,
        share,
        diameter: 1e-3,
        each: 2,
        across,
        travel: 0.1,
        window: [4.0, 12.0],
    };
    let mut all = vec![
        coarse(VoidageFunction::Henry, 0.3),
        coarse(VoidageFunction::Henry, 0.1),
        coarse(VoidageFunction::None, 0.15),
    ];
    if effort == Effort::Full {
        let fine = Suspension {
            diameter: 1e-4,
            each: 1,
            across: 1,
            // A tenth of the relaxation time.
            travel: 1.5e-3,
            window: [1.0, 3.0],
            ..coarse(VoidageFunction::Henry, 0.1)
        };
        all.push(fine);
    }
    all
}

fn run(effort: Effort) -> Result<Outcome> {
    let mut outcome = Outcome::default();
    let mut panel = Panel::new("Front of a settling suspension", "t v / spacing", "fall / spacing");
    for suspension in suspensions(effort) {
        let Suspension { function, share, diameter, window: [from, to], .. } = suspension;
        let (path, speed) = suspension.fall()?;
        let inside: Vec<(f64, f64)> = path.iter().copied().filter(|p| p.0 >= from && p.0 <= to).collect();
        let measured = -line(&inside).1 * speed;
        let name = if function == VoidageFunction::None { "none" } else { "henry" };
        let what = format!("{} mm, \u{3c6} {share}, {name}", 1e3 * diameter);
        outcome.findings.push(Finding::relative(
            format!("speed of the front, {what}"),
            "m/s",
            speed,
            measured,
            0.005,
        ));
        let every = (inside.len() / (2.0 * (to - from)) as usize).max(1);
        let fallen = inside.iter().step_by(every).map(|(t, y)| (t - inside[0].0, inside[0].1 - y)).collect();
        panel.curves.push(Curve::points(what, fallen));
    }
    panel.curves.push(Curve::line("closure", vec![(0.0, 0.0), (8.0, 8.0)]));
    outcome.panels.push(panel);
    Ok(outcome)
}
