//! Grains in the water of a droplet.
//!
//! A grain that the surface cuts is two: for the gas a smaller grain, of the share s_g that lies in the mesh, and for
//! the water one of the share s_w. The water drags it along, heats it and presses on it:
//!
//! ```text
//! force   gamma_w (U - v) + (V_w/V) F        heat   hA_w (T_d - T)
//! ```
//!
//! with gamma_w = V_w times the drag law of the water at the voidage V_f/V of the droplet, and its pressure gradient
//! -F/V the mean over the droplet of what the gas presses on its surface with (Gauss), so that the force F on the
//! droplet is shared by water and grains by volume; [`super::Choices`] has others. Drag and heat are implicit in the
//! motion of the grains with every scheme: the water would else throw them out within a step.

use super::choices::GrainShare;
use super::surface::{Chord, Surface};
use crate::closure::{Drag, HeatTransfer, Per, Surroundings, ThermalFluid, VoidageFunction};
use crate::exchange::AtGrains;
use crate::load::GrainLoad;
use rayon::prelude::*;
use voidage_dem::{Load, Particles};
use voidage_fluid::Vector;

/// No place among the wet grains.
const DRY: u32 = u32::MAX;

/// A share above which a grain lies wholly in the water.
const WHOLE: f64 = 1.0 - 1e-12;

/// Least voidage of the water for its laws.
const LEAST_VOIDAGE: f64 = 0.05;

/// Shortest way of a droplet over which its heat is compared, in diameters of the smallest grain.
const LEAST_WAY: f64 = 1e-3;

/// The water as grains feel it.
#[derive(Clone, Copy, Debug)]
pub struct Water {
    /// Density, kg/m3.
    pub density: f64,
    /// Viscosity, Pa s.
    pub viscosity: f64,
    /// Conductivity and Prandtl number.
    pub thermal: ThermalFluid,
    /// Drag law.
    pub drag: Drag,
    /// Heat-transfer law.
    pub heat: HeatTransfer,
    /// Voidage function of both.
    pub voidage_function: VoidageFunction,
    /// What of a grain both act on.
    pub per: Per,
}

/// A grain that the water reaches.
#[derive(Clone, Debug)]
struct WetGrain<const D: usize> {
    grain: u32,
    /// m.
    radius: f64,
    /// Share of it in the water.
    share: f64,
    /// Volume that it takes of the water, m2.
    volume: f64,
    /// Solid volume per area of the disc.
    solidity: f64,
    /// The same with what else no water fills: of [`GrainShare::Disc`] one.
    filled: f64,
    chords: Vec<Chord>,
    /// gamma_w, kg/s.
    drag: f64,
    /// hA_w, W/K; zero without heat.
    transfer: f64,
    /// What it is expected to do: v* = response + mobility gamma_w (U - U_k).
    response: Vector<D>,
    mobility: f64,
    /// T*, K.
    temperature: f64,
}

/// What moves the grains in the water.
#[derive(Clone, Copy, Debug)]
pub struct Stream<const D: usize> {
    /// Velocity of the droplet U, m/s.
    pub velocity: Vector<D>,
    /// Force on a volume of grain, less the pressure gradient: of the gas on the droplet over its volume, F/V, N/m3.
    pub pressure: Vector<D>,
    /// Its temperature, K.
    pub temperature: f64,
}

/// What grains take of a droplet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Taken {
    /// Volume V_p, m2.
    pub volume: f64,
    /// How fast it grows with the radius of the surface, m.
    pub growth: f64,
    /// What of it is pores, m2.
    pub pores: f64,
}

/// The pores of the grains in the water, where no water fills them.
#[derive(Clone, Copy, Debug)]
pub struct Pores<const D: usize> {
    /// Volume, m2.
    pub volume: f64,
    /// What passes the surface with the grains: sum over chords of pores v . n, m2/s.
    pub moving: f64,
    /// Sum of pores n, m.
    pub area: Vector<D>,
    /// Sum of pores s . (-n), m.
    pub opening: f64,
}

impl<const D: usize> Default for Pores<D> {
    /// There are none.
    fn default() -> Self {
        Self { volume: 0.0, moving: 0.0, area: Vector::zeros(), opening: 0.0 }
    }
}

/// What the grains in the water do to the droplet in a step, before its velocity is known.
#[derive(Clone, Debug)]
pub struct Immersion<const D: usize> {
    /// Volume that grains take of the water V_p, m2.
    pub volume: f64,
    /// Diameter of the widest grain there, m.
    pub widest: f64,
    /// sum gamma_w (1 - M gamma_w), kg/s.
    pub inertia: f64,
    /// sum gamma_w (w - M gamma_w U_k), N.
    pub force: Vector<D>,
    /// sum hA_w (T* - T_d), W.
    pub heat: f64,
    /// Solid that passes the surface into the droplet: sum of chord v . n phi, a number for each node of each facet,
    /// m2/s.
    pub solid: Vec<f64>,
    /// Pores that the water does not fill.
    pub pores: Pores<D>,
}

/// What the grains in the water have done to it in a step.
#[derive(Clone, Copy, Debug)]
pub struct Settled<const D: usize> {
    /// Force of the grains on the droplet by drag, N.
    pub force: Vector<D>,
    /// Force of the pressure of the water on the grains, N.
    pub pressed: Vector<D>,
    /// By how much that is more than the equation of the droplet had, N.
    pub missed: Vector<D>,
    /// Heat of the grains to the droplet, W.
    pub heat: f64,
    /// By how much that is more than it boiled by, W.
    pub missed_heat: f64,
}

impl<const D: usize> Default for Immersion<D> {
    /// No grain is in the water.
    fn default() -> Self {
        Self {
            volume: 0.0,
            widest: 0.0,
            inertia: 0.0,
            force: Vector::zeros(),
            heat: 0.0,
            solid: vec![],
            pores: Pores::default(),
        }
    }
}

impl<const D: usize> Default for Settled<D> {
    /// No grain is in the water.
    fn default() -> Self {
        let none = Vector::zeros();
        Self { force: none, pressed: none, missed: none, heat: 0.0, missed_heat: 0.0 }
    }
}

/// The grains in the water. It keeps its memory from step to step.
#[derive(Clone, Debug, Default)]
pub struct Wet<const D: usize> {
    grains: Vec<WetGrain<D>>,
    /// Place of each grain among them.
    slot: Vec<u32>,
    force: Vec<Vector<D>>,
    drag: Vec<f64>,
    heat: Vec<f64>,
    transfer: Vec<f64>,
}

/// What the grains within a surface take of it.
pub fn taken_within<const D: usize>(
    particles: &Particles<D>,
    surface: &Surface<D>,
    (centre, size): (&Vector<D>, f64),
    share: GrainShare,
) -> Taken {
    let parts: Vec<Taken> = (0..particles.len())
        .into_par_iter()
        .filter_map(|i| {
            let (radius, x) = (particles.radius[i], particles.position[i] - centre);
            let within = surface.cut(size, &x, radius)?;
            let solidity = particles.volume[i] / (std::f64::consts::PI * radius * radius);
            let filled = share.of(solidity);
            let shape = |c: &Chord| surface.shape(c.facet, c.at).dot(&surface.normal(c.facet));
            let rate: f64 = within.chords.iter().map(|c| -c.length * shape(c)).sum();
            Some(Taken {
                volume: within.area * filled,
                growth: rate * filled,
                pores: within.area * (filled - solidity),
            })
        })
        .collect();
    parts.iter().fold(Taken::default(), |sum, part| Taken {
        volume: sum.volume + part.volume,
        growth: sum.growth + part.growth,
        pores: sum.pores + part.pores,
    })
}

impl<const D: usize> Wet<D> {
    /// Finds the grains that the water reaches.
    pub fn cut(
        &mut self,
        particles: &Particles<D>,
        surface: &Surface<D>,
        (centre, size): (&Vector<D>, f64),
        taken: GrainShare,
    ) {
        let found = (0..particles.len()).into_par_iter().filter_map(|i| {
            let radius = particles.radius[i];
            let within = surface.cut(size, &(particles.position[i] - centre), radius)?;
            let whole = std::f64::consts::PI * radius * radius;
            let (share, solidity) = (within.area / whole, particles.volume[i] / whole);
            let filled = taken.of(solidity);
            let volume = match taken {
                GrainShare::Solid => share * particles.volume[i],
                GrainShare::Disc => within.area,
            };
            Some(WetGrain {
                grain: i as u32,
                radius,
                share,
                volume,
                solidity,
                filled,
                chords: within.chords,
                drag: 0.0,
                transfer: 0.0,
                response: particles.velocity[i],
                mobility: 0.0,
                temperature: particles.heat.as_ref().map_or(0.0, |heat| heat.temperature[i]),
            })
        });
        self.grains = found.collect();
        self.slot.clear();
        self.slot.resize(particles.len(), DRY);
        for (slot, wet) in (0..).zip(&self.grains) {
            self.slot[wet.grain as usize] = slot;
        }
    }

    fn of(&self, grain: usize) -> Option<&WetGrain<D>> {
        self.slot.get(grain).and_then(|slot| self.grains.get(*slot as usize))
    }

    /// Share of a grain in the water.
    pub fn share(&self, grain: usize) -> f64 {
        self.of(grain).map_or(0.0, |wet| wet.share)
    }

    /// Whether a grain lies wholly in the water.
    pub fn swallows(&self, grain: usize) -> bool {
        self.share(grain) > WHOLE
    }

    /// gamma_w of a grain, kg/s.
    pub fn drag(&self, grain: usize) -> f64 {
        self.of(grain).map_or(0.0, |wet| wet.drag)
    }

    /// hA_w of a grain, W/K.
    pub fn transfer(&self, grain: usize) -> f64 {
        self.of(grain).map_or(0.0, |wet| wet.transfer)
    }

    /// Force of the water on a grain at rest, N.
    pub fn push(&self, grain: usize, stream: &Stream<D>) -> Vector<D> {
        self.of(grain).map_or_else(Vector::zeros, |wet| wet.push(stream))
    }

    /// Volume that the grains take of the water, m2.
    pub fn volume(&self) -> f64 {
        self.grains.iter().map(|wet| wet.volume).sum()
    }

    /// Solid volume of the grains in the water, m2.
    pub fn solid(&self) -> f64 {
        let area = |wet: &WetGrain<D>| std::f64::consts::PI * wet.radius * wet.radius;
        self.grains.iter().map(|wet| wet.share * wet.solidity * area(wet)).sum()
    }

    /// Number of grains that the water reaches.
    pub fn len(&self) -> usize {
        self.grains.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.grains.is_empty()
    }

    /// Drag and heat-transfer coefficients of the water, of which the droplet is `voidage` full, at a velocity of the
    /// droplet.
    pub fn evaluate_closures(
        &mut self,
        particles: &Particles<D>,
        (water, voidage): (&Water, f64),
        velocity: &Vector<D>,
    ) {
        for wet in &mut self.grains {
            let i = wet.grain as usize;
            let around = Surroundings {
                slip: (velocity - particles.velocity[i]).norm(),
                voidage: voidage.max(LEAST_VOIDAGE),
                diameter: 2.0 * particles.radius[i],
                density: water.density,
                viscosity: water.viscosity,
            };
            let Water { drag, heat, thermal, voidage_function, per, .. } = water;
            let inside = (wet.volume, wet.share);
            wet.drag = per.in_drag(inside, around.diameter) * drag.coefficient(&around, *voidage_function);
            if particles.heat.is_some() {
                let law = heat.coefficient(&around, thermal, *voidage_function);
                wet.transfer = per.in_heat(inside, around.diameter) * law;
            }
        }
    }

    /// Takes what the grains are expected to do: response w (m/s), momentum mobility M (s/kg) and temperature T* (K) of
    /// each, by its number, gamma_w (kg/s) and hA_w (W/K).
    pub fn set_law(&mut self, law: impl Fn(usize, f64, f64) -> (Vector<D>, f64, f64)) {
        for wet in &mut self.grains {
            (wet.response, wet.mobility, wet.temperature) = law(wet.grain as usize, wet.drag, wet.transfer);
        }
    }

    /// What the grains do to a droplet in a stream, by what is expected of them.
    pub fn immersion(
        &self,
        surface: &Surface<D>,
        stream: &Stream<D>,
        (load, at): (&GrainLoad<D>, &AtGrains<D>),
    ) -> Immersion<D> {
        let mut sum = Immersion { solid: vec![0.0; D * surface.facets()], ..Immersion::default() };
        for wet in &self.grains {
            let slip = wet.mobility * wet.drag;
            sum.volume += wet.volume;
            sum.pores.volume +=
                wet.share * (wet.filled - wet.solidity) * std::f64::consts::PI * wet.radius.powi(2);
            sum.widest = sum.widest.max(2.0 * wet.radius);
            sum.inertia += wet.drag * (1.0 - slip);
            sum.force += (wet.response - stream.velocity * slip) * wet.drag;
            sum.heat += wet.transfer * (wet.temperature - stream.temperature);
            if wet.chords.is_empty() {
                continue;
            }
            let velocity = load.expected_in_flux(at, wet.grain as usize);
            for chord in &wet.chords {
                let passes = wet.solidity * chord.length * velocity.dot(&surface.normal(chord.facet));
                let place = D * chord.facet as usize;
                sum.solid[place] += passes * (1.0 - chord.at);
                sum.solid[place + 1] += passes * chord.at;
            }
            if wet.filled > wet.solidity {
                sum.pores.pass(wet, surface, &velocity);
            }
        }
        sum
    }

    /// What acts on the grains in gas and water together: force (N) and heat (W) of the gas, with its implicit drag
    /// (kg/s) and transfer (W/K), which may be none.
    pub fn add<'a>(
        &'a mut self,
        (force, heat): (&Vec<Vector<D>>, &Vec<f64>),
        (drag, transfer): (&[f64], &[f64]),
        stream: &Stream<D>,
    ) -> Load<'a, D> {
        self.force.clone_from(force);
        self.heat.clone_from(heat);
        for (to, from, grains) in
            [(&mut self.drag, drag, force.len()), (&mut self.transfer, transfer, heat.len())]
        {
            to.clear();
            to.extend_from_slice(from);
            to.resize(grains, 0.0);
        }
        for wet in &self.grains {
            let i = wet.grain as usize;
            self.force[i] += wet.push(stream);
            self.drag[i] += wet.drag;
            if let (Some(heat), Some(transfer)) = (self.heat.get_mut(i), self.transfer.get_mut(i)) {
                *heat += wet.transfer * stream.temperature;
                *transfer += wet.transfer;
            }
        }
        let Self { force, drag, heat, transfer, .. } = self;
        Load { force, drag, heat, transfer, ..Load::default() }
    }

    /// Heat that the grains in the water give to it within the next `dt` (s) because the droplet has come by a way (m),
    /// per way, J/m2: dt [Q(x) - Q(x - way)]/|way|, with the temperatures that they now have and Q the sum over them of
    /// hA_w/(1 + hA_w dt/(m c)) (T - T_d).
    pub fn taken_in(
        &self,
        particles: &Particles<D>,
        surface: &Surface<D>,
        (centre, size): (&Vector<D>, f64),
        (way, temperature, dt): (&Vector<D>, f64, f64),
    ) -> f64 {
        let length = way.norm();
        let (Some(heat), true) = (&particles.heat, length > 0.0) else { return 0.0 };
        // So far that the difference stands out from rounding.
        let far = length.max(LEAST_WAY * self.smallest());
        let back = way * (far / length);
        let more = |wet: &WetGrain<D>| {
            let i = wet.grain as usize;
            let whole = std::f64::consts::PI * wet.radius * wet.radius;
            let within = surface.cut(size, &(particles.position[i] - centre + back), wet.radius);
            let before = within.map_or(0.0, |within| within.area / whole) / wet.share;
            let given = |transfer: f64| transfer / (1.0 + transfer * dt / heat.capacity[i]);
            (given(wet.transfer) - given(wet.transfer * before)) * (heat.temperature[i] - temperature)
        };
        // Collected, so that the sum is the same for any number of threads.
        let all: Vec<f64> = self.grains.par_iter().map(more).collect();
        all.iter().sum::<f64>().max(0.0) * dt / far
    }

    /// Diameter of the smallest grain in the water, m; infinite without one.
    pub fn smallest(&self) -> f64 {
        self.grains.iter().map(|wet| 2.0 * wet.radius).fold(f64::INFINITY, f64::min)
    }

    /// What the grains, which have moved with these mean velocities (m/s) and temperatures (K; none without heat), did
    /// to a droplet whose velocity was expected to be `before`.
    pub fn settle(
        &self,
        (velocity, temperature): (&[Vector<D>], &[f64]),
        stream: &Stream<D>,
        before: &Vector<D>,
    ) -> Settled<D> {
        let mut sum = Settled::default();
        for wet in &self.grains {
            let i = wet.grain as usize;
            let expected = wet.response + (stream.velocity - before) * (wet.mobility * wet.drag);
            sum.force += (velocity[i] - stream.velocity) * wet.drag;
            sum.pressed += stream.pressure * wet.volume;
            sum.missed += (velocity[i] - expected) * wet.drag;
            if let Some(temperature) = temperature.get(i) {
                sum.heat += wet.transfer * (temperature - stream.temperature);
                sum.missed_heat += wet.transfer * (temperature - wet.temperature);
            }
        }
        sum
    }
}

impl<const D: usize> Pores<D> {
    /// Adds where the surface cuts a grain that moves with a velocity.
    fn pass(&mut self, wet: &WetGrain<D>, surface: &Surface<D>, velocity: &Vector<D>) {
        for chord in &wet.chords {
            let area = surface.normal(chord.facet) * (chord.length * (wet.filled - wet.solidity));
            self.moving += area.dot(velocity);
            self.area += area;
            self.opening -= area.dot(&surface.shape(chord.facet, chord.at));
        }
    }
}

impl GrainShare {
    /// Volume that a grain of this solidity takes, per area of its disc.
    fn of(self, solidity: f64) -> f64 {
        match self {
            Self::Solid => solidity,
            Self::Disc => 1.0,
        }
    }
}

impl<const D: usize> WetGrain<D> {
    fn push(&self, stream: &Stream<D>) -> Vector<D> {
        stream.velocity * self.drag + stream.pressure * self.volume
    }
}
