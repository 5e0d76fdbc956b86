//! The step of a droplet: what the fluid solver gets, what it answers, and how droplet and mesh move then.

use super::surface::Surface;
use super::wet::{Immersion, Settled, Stream, Taken};
use super::{Answer, Buoyancy, Droplet, DropletState, Exchanged, Material};
use crate::motion::{LEAST_MEASURE, crushed};
use crate::scheme::anchored::RETURNED;
use crate::{Error, Notice, Result};
use voidage_fluid::balance::Balance;
use voidage_fluid::body::{Blowing, Body, BodyAnswer, BodyMotion, Evaporation, HeatFlux};
use voidage_fluid::{Mesh, Vector};

/// Share of the first liquid below which a droplet vanishes.
const VANISHES: f64 = 1e-3;

/// Diameters of the widest grain in its water below which the radius makes a droplet vanish: it is no longer a body of
/// liquid with grains in it.
const SMALLEST: f64 = 2.0;

/// Least gap between droplet and boundary, in first radii: the mesh between them needs room.
const LEAST_GAP: f64 = 0.02;

/// Share of the gap that it may close in a step, so that the cells in it can follow.
const CLOSES: f64 = 0.75;

/// Stiffness of what stops a droplet, in its inertia.
const STOP: f64 = 1e8;

/// Share of the surface that is open to the gas at least, where its rate is found: discs may leave less.
const LEAST_OPENING: f64 = 0.05;

/// Where a droplet is at the end of a step.
struct End<const D: usize> {
    /// Rate of vaporisation, kg/s/m.
    rate: f64,
    /// Liquid that boils in the step, m2.
    boils: f64,
    /// Centre and radius, m; absent where it vanishes.
    place: Option<(Vector<D>, f64)>,
}

impl<const D: usize> Droplet<D> {
    /// What moves the grains in it, by the last solution of the gas.
    pub(crate) fn stream(&self) -> Stream<D> {
        let Answer { velocity, force, .. } = self.answer;
        let pressure = match self.material.choices.buoyancy {
            Buoyancy::Surface => force / self.volume(),
            Buoyancy::Hydrostatic => -self.material.gravity * self.material.water.density,
            Buoyancy::None => Vector::zeros(),
        };
        Stream { velocity, pressure, temperature: self.material.temperature }
    }

    /// Forgets the step in hand.
    pub(crate) fn begin(&mut self) {
        let DropletState { velocity, force, heat, vapour, .. } = self.state;
        self.answer = Answer { velocity, force, heat, vapour, through: 0.0 };
        self.before = velocity;
        self.go_free();
    }

    /// Forgets what stopped it in an earlier solution.
    pub(crate) fn go_free(&mut self) {
        self.stops.clear();
    }

    /// What the state of a restart has of what it exchanged.
    pub(crate) fn recall(&mut self) {
        let DropletState { force, heat, vapour, .. } = self.state;
        let vaporisation = vapour * self.material.vapour_density;
        self.exchanged = Exchanged { gas_force: force, gas_heat: heat, vaporisation, ..Exchanged::nothing() };
    }

    /// Takes what the grains in it do in the step in hand, as they meet the velocity that it now has.
    pub(crate) fn immerse(&mut self, immersion: Immersion<D>) {
        self.before = self.answer.velocity;
        self.immersion = immersion;
    }

    /// Velocity of the nodes in the step in hand, m/s.
    pub(crate) fn mesh_velocity(&self) -> &[Vector<D>] {
        &self.moving
    }

    /// The droplet as the fluid solver gets it for a step of `dt`, with the temperature among the scalars if `hot`.
    pub(crate) fn body(&mut self, mesh: &Mesh<D>, voidage: &[f64], dt: f64, hot: bool) -> Result<Body<D>> {
        self.hot = hot;
        let Self { material, state, answer, immersion, .. } = self;
        let pores = &immersion.pores;
        let (mut opening, mut perimeter, mut within) = (-pores.opening, 0.0, 0.0);
        let mut swept = immersion.solid.iter().sum::<f64>() + pores.moving - pores.area.dot(&answer.velocity);
        for (facet, nodes) in (0..).zip(mesh.boundary(&self.boundary)?.facets.chunks_exact(D)) {
            let [a, b] = [0, 1].map(|k| voidage[nodes[k] as usize]);
            let length = (mesh.points[nodes[1] as usize] - mesh.points[nodes[0] as usize]).norm();
            let normal = self.surface.normal(facet);
            // s . n is the same all along a facet.
            let along = self.surface.shape(facet, 0.5).dot(&normal);
            let mean = length * (a + b) / 2.0;
            opening -= mean * along;
            swept += mean * answer.velocity.dot(&normal);
            perimeter += length;
            within += mean;
        }
        let opening = opening.max(LEAST_OPENING * perimeter);
        self.arrives = match material.choices.blowing {
            Blowing::Superficial => 1.0,
            Blowing::Interstitial => within / perimeter,
        };
        let returned = RETURNED * self.part;
        let shrinks = answer.vapour * material.vapour_density / material.water.density;
        let expansion = (swept - shrinks + returned * state.volume / dt) / opening;
        self.moving.clear();
        self.moving.extend(
            mesh.points
                .iter()
                .zip(&self.weight)
                .map(|(x, weight)| (answer.velocity + (x - state.centre).normalize() * expansion) * *weight),
        );
        for (node, s) in self.surface.nodes() {
            self.moving[*node as usize] = answer.velocity + s * expansion;
        }
        let mass = material.water.density * state.liquid;
        // The share of the force of the gas that the liquid gets, and what it gets of the grains beside their drag.
        let (share, pressed) = match material.choices.buoyancy {
            Buoyancy::Surface => {
                (1.0 - immersion.volume / (std::f64::consts::PI * state.radius.powi(2)), Vector::zeros())
            }
            Buoyancy::Hydrostatic => (1.0, material.gravity * (immersion.volume * material.water.density)),
            Buoyancy::None => (1.0, Vector::zeros()),
        };
        let motion = if material.held {
            BodyMotion::Held(state.velocity)
        } else {
            let inertia = (mass / dt + immersion.inertia) / share;
            let force = (state.velocity * mass + state.impulse * returned) / dt + material.gravity * mass;
            let mut motion = BodyMotion::free(inertia, (force + immersion.force + pressed) / share);
            if let BodyMotion::Free { inertia: matrix, force } = &mut motion {
                self.stiffness = STOP * inertia * share;
                for (normal, fastest) in &self.stops {
                    *matrix += normal * normal.transpose() * (STOP * inertia);
                    *force += normal * (STOP * inertia * fastest);
                }
            }
            motion
        };
        self.given = immersion.heat + returned * state.warmth / dt;
        let evaporation = Evaporation {
            scalar: hot.then_some(crate::HEAT),
            heat_flux: material.choices.heat_flux,
            heat: self.given,
            latent: material.latent_heat * material.vapour_density,
        };
        Ok(Body {
            centre: state.centre,
            radius: state.radius,
            expansion,
            motion,
            // One that has boiled within a step stays until its end.
            evaporation: (state.liquid > 0.0).then_some(evaporation),
            blowing: material.choices.blowing,
            solid: immersion.solid.clone(),
        })
    }

    /// Whether the droplet would come too near to another part of the boundary within `dt` (s) by the last solution,
    /// and is stopped in a direction in which it was not: then the fluid is to be solved again. Nothing but the gas
    /// between them keeps a droplet from a wall, and where that film is thinner than the mesh can show, this does.
    pub(crate) fn stop(&mut self, mesh: &Mesh<D>, dt: f64) -> bool {
        let state = &self.state;
        let radius = self.surface.reach() * state.radius;
        let reach = radius + LEAST_GAP * (self.state.first / std::f64::consts::PI).sqrt();
        let others = mesh.boundaries.iter().filter(|part| part.name != self.boundary);
        let mut worst = (0.0, Vector::zeros(), 0.0);
        for facet in others.flat_map(|part| part.facets.chunks_exact(D)) {
            let [a, b] = [0, 1].map(|k| mesh.points[facet[k] as usize] - state.centre);
            let along = b - a;
            let share = (-a.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let to = a + along * share;
            let (distance, normal) = (to.norm(), to.normalize());
            let fastest = (distance - reach).min(CLOSES * (distance - radius)) / dt;
            let beyond = self.answer.velocity.dot(&normal) - fastest;
            let held = |(other, _): &(Vector<D>, f64)| other.dot(&normal) > 0.99;
            if beyond > worst.0 && !self.stops.iter().any(held) {
                worst = (beyond, normal, fastest);
            }
        }
        let (beyond, normal, fastest) = worst;
        let stops = beyond > 0.0 && !self.material.held && self.stops.len() < D;
        if stops {
            self.stops.push((normal, fastest.max(0.0)));
        }
        stops
    }

    /// Whether so little is left that it vanishes: a thousandth of the liquid, what boils within two steps, or a radius
    /// of two grains.
    pub(crate) fn vanishes(&self) -> bool {
        !self.state.gone && self.is_little(self.state.liquid, self.boils)
    }

    /// The same with so much liquid left, and so much that boils in a step, m2.
    fn is_little(&self, liquid: f64, boils: f64) -> bool {
        let little = liquid < (VANISHES * self.state.first).max(2.0 * boils);
        little || self.state.radius < SMALLEST * self.immersion.widest
    }

    /// Ends it. What is left of the liquid stays in its books.
    pub(crate) fn vanish(&mut self) {
        let mass = self.mass();
        let state = &mut self.state;
        // What is left of the liquid takes its momentum along.
        state.ledger.vapour += state.velocity * mass;
        (state.velocity, state.force) = (Vector::zeros(), Vector::zeros());
        (state.heat, state.vapour, state.gone) = (0.0, 0.0, true);
        (self.settled, self.absorption, self.taken_in) = (Settled::default(), 0.0, 0.0);
        self.exchanged = Exchanged::nothing();
    }

    /// Rate at which heat that it takes in brakes it, 1/s: E (-F . s)/(L mdot m) with the heat E that it has taken in per
    /// way, the direction s of the way, the force F of the gas, which the vapour mdot makes, and its mass m. Times a step
    /// it is the absorption number x: a deviation of the velocity is 1 - x times as large after the step.
    pub(crate) fn absorption_rate(&self) -> f64 {
        let Self { answer, material, state, taken_in, .. } = self;
        let boils = answer.vapour * material.vapour_density * material.latent_heat;
        if material.held || *taken_in <= 0.0 || boils <= 0.0 || state.liquid <= 0.0 {
            return 0.0;
        }
        let brakes = -answer.force.dot(&state.way.normalize());
        brakes.max(0.0) * taken_in / (boils * self.mass())
    }

    /// How far it moves in a step of `dt` (s) by the last solution, m.
    pub(crate) fn travel(&self, dt: f64) -> f64 {
        self.answer.velocity.norm() * dt
    }

    /// Takes a solution of the fluid.
    pub(crate) fn receive(
        &mut self,
        body: Option<&BodyAnswer<D>>,
        balance: Option<&Balance<D>>,
    ) -> Result<()> {
        let (Some(body), Some(balance)) = (body, balance) else {
            return Err(Error::run(Notice::new(
                "the fluid solver does not say what the droplet does",
                "a droplet needs a solver that knows bodies and the balances of the boundary",
            )));
        };
        let BodyAnswer { velocity, vapour } = *body;
        let Material { vapour_density, latent_heat, choices, .. } = &self.material;
        let heat = match choices.heat_flux {
            HeatFlux::Reaction if !self.hot => 0.0,
            HeatFlux::Reaction => balance.scalars.get(crate::HEAT).map_or(0.0, |given| -given),
            // What boiled it beside the grains.
            HeatFlux::Gradient if self.state.liquid <= 0.0 => 0.0,
            HeatFlux::Gradient => vapour * vapour_density * latent_heat - self.given,
        };
        self.answer = Answer { velocity, force: balance.force, heat, vapour, through: balance.flux };
        Ok(())
    }

    /// Takes what the grains in it did in a step of `dt`.
    pub(crate) fn settle(&mut self, dt: f64, settle: impl FnOnce(&Stream<D>, &Vector<D>) -> Settled<D>) {
        self.settled = settle(&self.stream(), &self.before);
        let kept = 1.0 - RETURNED * self.part;
        self.state.impulse = self.state.impulse * kept + self.settled.missed * dt;
        self.state.warmth = self.state.warmth * kept + self.settled.missed_heat * dt;
    }

    /// Takes what the gas still had to give to a grain that the water has swallowed: impulse (N s) and heat (J) that
    /// the gas did not lose.
    pub(crate) fn inherit(&mut self, impulse: &Vector<D>, heat: f64) {
        let DropletState { impulse: owed, warmth, ledger, .. } = &mut self.state;
        *owed -= impulse;
        ledger.impulse -= impulse;
        *warmth -= heat;
        ledger.heat -= heat;
    }

    /// Where the step in hand, which was over `dt`, ends.
    fn end(&self, dt: f64, grains: impl Fn(&Surface<D>, &Vector<D>, f64) -> Taken) -> Result<End<D>> {
        let (state, surface) = (&self.state, &self.surface);
        let rate = self.answer.vapour * self.material.vapour_density;
        // The last step of its life may ask for more than there is.
        let boils = (dt * rate / self.material.water.density).min(state.liquid);
        let liquid = state.liquid - boils;
        if self.is_little(liquid, boils) {
            // From where it is: a surface that small has no room for its facets.
            return Ok(End { rate, boils, place: None });
        }
        let centre = state.centre + self.answer.velocity * dt;
        let radius = radius(liquid, state.radius, |radius| grains(surface, &centre, radius))?;
        Ok(End { rate, boils, place: Some((centre, radius)) })
    }

    /// A place where a cell of the mesh would turn over, or nearly, if the step in hand, which was over `dt`, were
    /// accepted; none if all cells keep enough of themselves. `grains` says what the grains take of a droplet.
    ///
    /// # Errors
    /// No radius fits the volumes.
    pub(crate) fn turns_over(
        &self,
        dt: f64,
        mesh: &mut Mesh<D>,
        grains: impl Fn(&Surface<D>, &Vector<D>, f64) -> Taken,
    ) -> Result<Option<Vector<D>>> {
        let End { place: Some((centre, radius)), .. } = self.end(dt, grains)? else { return Ok(None) };
        let before = mesh.points.clone();
        let measures = mesh.measures();
        self.drag_along(&centre, radius, &mut mesh.points);
        let crushed = crushed(mesh, &measures, LEAST_MEASURE);
        mesh.points = before;
        Ok(crushed.map(|cell| mesh.centroid(cell)))
    }

    /// Moves by the step in hand, which was over `dt`: liquid, centre, radius and the nodes of the mesh. `grains`
    /// says what the grains take of such a droplet.
    ///
    /// # Errors
    /// No radius fits the volumes.
    pub(crate) fn accept(
        &mut self,
        dt: f64,
        mesh: &mut Mesh<D>,
        grains: impl Fn(&Surface<D>, &Vector<D>, f64) -> Taken,
    ) -> Result<()> {
        let End { rate, boils, place } = self.end(dt, &grains)?;
        let (answer, Material { water, gravity, .. }, settled) = (self.answer, &self.material, &self.settled);
        let (density, mass) = (water.density, self.mass());
        let stop = |(normal, fastest): &(Vector<D>, f64)| {
            normal * (self.stiffness * (fastest - answer.velocity.dot(normal)))
        };
        let stopping = self.stops.iter().map(stop).sum::<Vector<D>>();
        let state = &mut self.state;
        state.ledger.impulse +=
            (answer.force + settled.force - settled.pressed + gravity * mass + stopping) * dt;
        state.ledger.vapour += answer.velocity * (density * boils);
        state.ledger.heat += (answer.heat + settled.heat) * dt;
        state.volume += dt * (answer.through + answer.vapour * self.arrives - rate / density);
        state.boiled += boils;
        state.liquid -= boils;
        state.way = answer.velocity * dt;
        self.boils = boils;
        (state.velocity, state.force, state.heat, state.vapour) =
            (answer.velocity, answer.force, answer.heat, answer.vapour);
        self.exchanged = Exchanged {
            gas_force: answer.force,
            grain_force: settled.force,
            pressed: settled.pressed,
            gas_heat: answer.heat,
            grain_heat: settled.heat,
            vaporisation: rate,
        };
        if let Some((centre, radius)) = place {
            let pores = grains(&self.surface, &centre, radius).pores;
            self.state.volume += pores - self.immersion.pores.volume;
            self.put(&centre, radius, &mut mesh.points);
        }
        Ok(())
    }

    /// Moves surface and nodes to a centre and radius.
    pub(super) fn put(&mut self, centre: &Vector<D>, radius: f64, points: &mut [Vector<D>]) {
        self.drag_along(centre, radius, points);
        (self.state.centre, self.state.radius) = (*centre, radius);
    }

    /// Moves the nodes as the droplet moves to a centre and radius.
    fn drag_along(&self, centre: &Vector<D>, radius: f64, points: &mut [Vector<D>]) {
        let (moved, grown) = (centre - self.state.centre, radius - self.state.radius);
        for (x, weight) in points.iter_mut().zip(&self.weight) {
            *x += (moved + (*x - self.state.centre).normalize() * grown) * *weight;
        }
        for (node, s) in self.surface.nodes() {
            points[*node as usize] = centre + s * radius;
        }
    }

    /// Makes room for grains that are in it at time zero, of a volume, m2: its radius stays, and there is less liquid.
    pub(crate) fn hold(&mut self, volume: f64) {
        self.state.liquid -= volume;
        self.state.first -= volume;
    }
}

/// The radius r with pi r^2 = liquid + volume(r) of grains, from a guess: by Newton's method, kept between the radius
/// of the liquid alone and twice the guess.
fn radius(liquid: f64, guess: f64, grains: impl Fn(f64) -> Taken) -> Result<f64> {
    const STEPS: usize = 100;
    let pi = std::f64::consts::PI;
    let (mut low, mut high, mut radius) = ((liquid / pi).sqrt(), 2.0 * guess, guess);
    for _ in 0..STEPS {
        let Taken { volume, growth, .. } = grains(radius);
        let excess = pi * radius * radius - liquid - volume;
        if excess.abs() <= 1e-14 * liquid {
            return Ok(radius);
        }
        if excess > 0.0 {
            high = high.min(radius)
        } else {
            low = low.max(radius)
        }
        let next = radius - excess / (2.0 * pi * radius - growth);
        // Grains that fill the surface leave Newton's step nothing to go by.
        let next = if next > low && next < high { next } else { (low + high) / 2.0 };
        if (next - radius).abs() <= 1e-15 * radius {
            return Ok(next);
        }
        radius = next;
    }
    // Rounding errors of many cut grains may keep the steps from coming to rest; what they leave must be small.
    let whole = pi * radius * radius;
    match (whole - liquid - grains(radius).volume).abs() <= 1e-12 * whole {
        true => Ok(radius),
        false => Err(Error::run(format!("no radius holds {liquid:e} m2 of liquid and the grains in it"))),
    }
}
