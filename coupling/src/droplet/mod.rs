//! A droplet that boils in hot grains (Henry et al., section 4).
//!
//! The droplet is a hole in the mesh of the gas: the polygon of its nodes, of area pi r^2 ([`surface`]). For the gas it
//! is a [`Body`](voidage_fluid::body::Body): what it boils by and how it moves are found with the gas, from the
//! reactions of the discrete equations. Grains pass its surface freely and are cut by it ([`wet`]).
//!
//! ```text
//! m dU/dt = (1 - V_p/V) F + sum gamma_w (v - U) + m g        m = rho_w V_f
//! L mdot  = Q + sum hA_w (T - T_d),     dV_f/dt = -mdot/rho_w
//! V       = V_f + V_p = pi r^2
//! ```
//!
//! with the force F and heat Q of the gas, the liquid V_f and the solid V_p of the grains in it. Vapour leaves with the
//! velocity of the droplet, so that the momentum of the droplet and its vapour is conserved.
//!
//! **Explicit geometry.** The equations of a step are solved where mesh, droplet and grains are at its start. Then all
//! three move with the new velocities, and the radius follows from the volumes. So grains that ride with the droplet
//! are not cut by a surface that is ahead of them.
//!
//! **The surface** moves with U + rdot s, and rdot is such that as much volume leaves the gas through it as vapour and
//! liquid ask for, whatever the grains do that pass it:
//!
//! ```text
//! rdot = (c_U + c_v - mdot/rho_w + eta C/dt) / E,   E = int eps s . (-n),
//! c_U = int eps U . n,   c_v = sum over chords of solid v . n
//! ```
//!
//! Where the water fills no pores of the grains ([`GrainShare::Disc`]), V_p has their discs and the gas of their
//! pores is pushed out at the surface: solid v . n is then length v . n of the whole chord, and eps is less by the
//! pores along the chords.
//!
//! What then is missing, because U and mdot were those of before, adds up in C and is given back, as what grains and
//! gas disagree in is (`scheme::anchored`); so are the impulse J and the heat E of grains that moved otherwise than
//! expected.

mod choices;
mod passed;
mod step;
pub mod surface;
pub mod wet;

pub use self::choices::{Buoyancy, Choices, GrainShare, Inside, WaterVoidage};
pub use self::passed::Passed;

use self::surface::Surface;
use self::wet::{Immersion, Settled, Water};
use crate::Result;
use serde::{Deserialize, Serialize};
use voidage_fluid::harmonic::harmonic;
use voidage_fluid::{Mesh, Vector};

/// What a droplet is made of and how it may move.
#[derive(Clone, Debug)]
pub struct Material<const D: usize> {
    /// The water as grains feel it.
    pub water: Water,
    /// Temperature T_d, K.
    pub temperature: f64,
    /// Heat of vaporisation L, J/kg.
    pub latent_heat: f64,
    /// Density of the vapour, which is that of the gas, kg/m3.
    pub vapour_density: f64,
    /// Gravity, m/s2.
    pub gravity: Vector<D>,
    /// Whether the droplet keeps its velocity.
    pub held: bool,
    /// What may be read in more than one way.
    pub choices: Choices,
}

/// Where a droplet is, and what it has still to get.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DropletState<const D: usize> {
    /// Centre x_d, m.
    pub centre: Vector<D>,
    /// Velocity U, m/s.
    pub velocity: Vector<D>,
    /// How far it moved in the last part of a step, m.
    pub way: Vector<D>,
    /// Share of the next step that its first part is to be.
    pub next: f64,
    /// Radius r, m.
    pub radius: f64,
    /// Liquid V_f, m2.
    pub liquid: f64,
    /// The same at time zero.
    pub first: f64,
    /// Volume of vapour that left it in the last step, m2/s.
    pub vapour: f64,
    /// Force of the gas on it in the last step, N/m.
    pub force: Vector<D>,
    /// Heat of the gas to it in the last step, W/m.
    pub heat: f64,
    /// Impulse J of the grains that it has not got yet, N s/m.
    pub impulse: Vector<D>,
    /// Heat E of the grains that has not boiled it yet, J/m.
    pub warmth: f64,
    /// Volume C that passed its surface beyond what it should have, m2.
    pub volume: f64,
    /// Liquid that has boiled since time zero, m2.
    pub boiled: f64,
    /// What it has got since time zero.
    pub ledger: Ledger<D>,
    /// Solid that has passed its surface.
    pub passed: Passed,
    /// Whether it has boiled away, but for what is left of the liquid: there is gas in its place.
    pub gone: bool,
}

/// What a droplet has got from others since time zero, part by part of the steps: the other side of
/// [`Droplet::momentum_defect`] and [`Droplet::heat_defect`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ledger<const D: usize> {
    /// Impulse of the gas, the grains, its weight and the walls that stop it, N s/m; with it that of the grains which
    /// it has swallowed and which the gas still owed them.
    pub impulse: Vector<D>,
    /// Momentum that its vapour took along, N s/m.
    pub vapour: Vector<D>,
    /// Heat of the gas and of the grains, J/m; with it that of grains that it has swallowed, as of the impulse.
    pub heat: f64,
}

/// What a droplet did in the step in hand.
#[derive(Clone, Copy, Debug)]
struct Answer<const D: usize> {
    velocity: Vector<D>,
    force: Vector<D>,
    heat: f64,
    vapour: f64,
    /// Volume that left the gas through the surface, m2/s.
    through: f64,
}

/// What a droplet exchanges with gas and grains, in the mean of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exchanged<const D: usize> {
    /// Force of the gas on it, N.
    pub gas_force: Vector<D>,
    /// Force of the grains on it by drag, N.
    pub grain_force: Vector<D>,
    /// Force of the pressure of the water on the grains, N.
    pub pressed: Vector<D>,
    /// Heat of the gas to it, W.
    pub gas_heat: f64,
    /// Heat of the grains to it, W.
    pub grain_heat: f64,
    /// Rate of vaporisation, kg/s/m.
    pub vaporisation: f64,
}

impl<const D: usize> Exchanged<D> {
    /// Nothing.
    pub(crate) fn nothing() -> Self {
        let none = Vector::zeros();
        let [gas_heat, grain_heat, vaporisation] = [0.0; 3];
        Self { gas_force: none, grain_force: none, pressed: none, gas_heat, grain_heat, vaporisation }
    }

    /// Adds a part that is a `share` of the step.
    pub(crate) fn add(&mut self, part: &Self, share: f64) {
        self.gas_force += part.gas_force * share;
        self.grain_force += part.grain_force * share;
        self.pressed += part.pressed * share;
        self.gas_heat += part.gas_heat * share;
        self.grain_heat += part.grain_heat * share;
        self.vaporisation += part.vaporisation * share;
    }
}

/// A droplet.
#[derive(Clone, Debug)]
pub struct Droplet<const D: usize> {
    /// The part of the boundary that it is.
    pub boundary: String,
    /// What it is made of.
    pub material: Material<D>,
    /// Velocity at time zero, m/s.
    pub launched: Vector<D>,
    /// Where it is.
    pub state: DropletState<D>,
    /// What the grains in it did in the last part of a step; zero without grains.
    pub settled: Settled<D>,
    /// What it exchanged in the last step.
    pub exchanged: Exchanged<D>,
    /// Rate at which heat that it takes in with grains brakes it, 1/s, as [`crate::scheme::cut::Cutting::absorption`]
    /// has it: times a step it is the absorption number.
    pub absorption: f64,
    /// Heat of the grains that it took in per way, in the last part of a step, J/m2.
    pub(crate) taken_in: f64,
    surface: Surface<D>,
    /// How far each node of the mesh follows it, from 0 to 1.
    weight: Vec<f64>,
    /// How fast edges become longer with the distance from it, no unit.
    growth: f64,
    weigh: fn(&Mesh<D>, &str) -> Result<Vec<f64>>,
    /// Velocity of the nodes in the step in hand, m/s.
    moving: Vec<Vector<D>>,
    /// What the grains in it do in the step in hand.
    immersion: Immersion<D>,
    answer: Answer<D>,
    /// Liquid that boiled in the last step, m2.
    boils: f64,
    /// Share of the vapour of the step in hand that arrives in the gas.
    arrives: f64,
    /// Heat of the grains that boils it in the step in hand, W.
    given: f64,
    /// Whether the gas has a temperature.
    hot: bool,
    /// Share of a step that the part in hand is: what is carried is given back in the time of whole steps.
    pub(crate) part: f64,
    /// Directions in which the boundary stops it in the step in hand, with the fastest that it may be there, m/s.
    stops: Vec<(Vector<D>, f64)>,
    /// Force by which each stops it, over what it is faster, kg/s/m.
    stiffness: f64,
    /// Velocity that the grains in it were expected to meet, m/s.
    before: Vector<D>,
}

/// How far the nodes follow a part of the boundary: 1 on it, 0 on the others, harmonic between.
fn follow(mesh: &Mesh<2>, name: &str) -> Result<Vec<f64>> {
    let mut held = vec![None; mesh.points.len()];
    for part in &mesh.boundaries {
        let weight = if part.name == name { 1.0 } else { 0.0 };
        part.facets.iter().for_each(|&node| held[node as usize] = Some(weight));
    }
    Ok(harmonic::<2, 3>(mesh, 0.0, |node| held[node])?)
}

impl Droplet<2> {
    /// A droplet without grains in it, in the hole of this name around a centre, of this radius (m): the hole is made
    /// as large by moving the nodes of the mesh. `velocity` is that at the start (m/s), `growth` how fast edges become
    /// longer with the distance when the domain is remeshed.
    ///
    /// # Errors
    /// The boundary does not go round the centre.
    pub fn new(
        mesh: &mut Mesh<2>,
        boundary: &str,
        (centre, radius): (Vector<2>, f64),
        (velocity, growth): (Vector<2>, f64),
        material: Material<2>,
    ) -> Result<Self> {
        let (surface, found) = Surface::new(mesh, mesh.boundary(boundary)?, &centre)?;
        let answer = Answer { velocity, force: Vector::zeros(), heat: 0.0, vapour: 0.0, through: 0.0 };
        let state = DropletState {
            centre,
            velocity,
            way: Vector::zeros(),
            next: 1.0,
            radius: found,
            liquid: std::f64::consts::PI * radius * radius,
            first: std::f64::consts::PI * radius * radius,
            vapour: 0.0,
            force: Vector::zeros(),
            heat: 0.0,
            impulse: Vector::zeros(),
            warmth: 0.0,
            volume: 0.0,
            boiled: 0.0,
            ledger: Ledger { impulse: Vector::zeros(), vapour: Vector::zeros(), heat: 0.0 },
            passed: Passed::default(),
            gone: false,
        };
        let mut droplet = Self {
            boundary: boundary.into(),
            launched: velocity,
            material,
            state,
            settled: Settled::default(),
            exchanged: Exchanged::nothing(),
            absorption: 0.0,
            taken_in: 0.0,
            surface,
            weight: follow(mesh, boundary)?,
            growth,
            weigh: follow,
            moving: Vec::new(),
            immersion: Immersion::default(),
            answer,
            boils: 0.0,
            arrives: 1.0,
            given: 0.0,
            hot: false,
            part: 1.0,
            stops: Vec::new(),
            stiffness: 0.0,
            before: velocity,
        };
        droplet.put(&centre, radius, &mut mesh.points);
        droplet.begin();
        Ok(droplet)
    }
}

impl<const D: usize> Droplet<D> {
    /// The polygon that it is.
    pub fn surface(&self) -> &Surface<D> {
        &self.surface
    }

    /// Volume of the droplet V, m2.
    pub fn volume(&self) -> f64 {
        std::f64::consts::PI * self.state.radius.powi(2)
    }

    /// Mass of the liquid, kg/m.
    pub fn mass(&self) -> f64 {
        self.material.water.density * self.state.liquid
    }

    /// Rate of vaporisation, kg/s/m.
    pub fn vaporisation(&self) -> f64 {
        self.state.vapour * self.material.vapour_density
    }

    /// Its momentum, that of its vapour and what grains still owe it, less what it had at time zero and has got since:
    /// rounding, N s/m. Of a droplet that is held nothing is known of who holds it: zero.
    pub fn momentum_defect(&self) -> Vector<D> {
        if self.material.held {
            return Vector::zeros();
        }
        let DropletState { velocity, impulse, ledger, .. } = &self.state;
        let started = self.launched * (self.material.water.density * self.state.first);
        velocity * self.mass() + ledger.vapour + impulse - started - ledger.impulse
    }

    /// Heat that its water boiled by and that grains still owe it, less what it has got since time zero: rounding, J/m.
    pub fn heat_defect(&self) -> f64 {
        let Material { water, latent_heat, .. } = &self.material;
        let DropletState { boiled, warmth, ledger, .. } = &self.state;
        latent_heat * water.density * boiled + warmth - ledger.heat
    }

    /// Length that edges should have at a point, m.
    pub(crate) fn spacing(&self, x: &Vector<D>) -> f64 {
        let facet = 2.0 * std::f64::consts::PI * self.state.radius / self.surface.facets() as f64;
        facet + self.growth * ((x - self.state.centre).norm() - self.state.radius).max(0.0)
    }

    /// What [`Self::restore`] needs: how far the nodes follow, and the shape.
    pub(crate) fn motion(&self) -> Vec<f64> {
        self.weight.iter().copied().chain(self.surface.numbers()).collect()
    }

    /// Takes back a [`Self::motion`] for a mesh.
    ///
    /// # Errors
    /// The droplet is not in the mesh.
    pub(crate) fn restore(&mut self, mesh: &Mesh<D>, motion: &[f64]) -> Result<()> {
        let (weight, shape) = motion.split_at(mesh.points.len().min(motion.len()));
        self.weight = weight.to_vec();
        self.surface = Surface::of(mesh.boundary(&self.boundary)?, shape);
        self.begin();
        Ok(())
    }

    /// Goes on with another mesh, on which its surface has the same facets.
    ///
    /// # Errors
    /// The surface is not there.
    pub(crate) fn remeshed(&mut self, mesh: &Mesh<D>) -> Result<()> {
        let (surface, _) = Surface::new(mesh, mesh.boundary(&self.boundary)?, &self.state.centre)?;
        self.surface = surface;
        self.weight = (self.weigh)(mesh, &self.boundary)?;
        Ok(())
    }
}
