//! The exchange between grains and fluid: its laws, and what both know of each other.

use crate::appearing::Appearing;
use crate::closure::{Drag, HeatTransfer, Per, ThermalFluid, VoidageFunction};
use crate::droplet::wet::Wet;
use crate::exchange::{self, AtGrains, OnMesh};
use crate::load::{GrainLoad, HeatLoad};
use crate::overlap::Overlap;
use crate::unsteady::Unsteady;
use crate::{Carried, HEAT, Result, StepReport};
use rayon::prelude::*;
use voidage_dem::Dem;
use voidage_fluid::flow::Numerics;
use voidage_fluid::points::Points;
use voidage_fluid::{Mesh, Vector};

/// Laws and properties of the exchange between grains and fluid.
#[derive(Clone, Copy, Debug, Default)]
pub struct Laws {
    /// Drag law.
    pub drag: Drag,
    /// Voidage function of drag and heat transfer.
    pub voidage_function: VoidageFunction,
    /// Heat-transfer law.
    pub heat: HeatTransfer,
    /// What of a grain drag and heat transfer act on.
    pub per: Per,
    /// Added mass and lift.
    pub unsteady: Unsteady,
    /// Width over which grains are spread in the fluid, in their diameters; 1: over themselves.
    pub kernel: f64,
    /// Density of the fluid, kg/m3.
    pub density: f64,
    /// Viscosity of the fluid, Pa s.
    pub viscosity: f64,
    /// Thermal properties; absent unless grains and fluid both have a temperature.
    pub thermal: Option<ThermalFluid>,
}

/// State of the exchange between grains and fluid.
pub struct Interaction<const D: usize> {
    /// Laws by name.
    pub laws: Laws,
    /// The law of the grains.
    pub load: GrainLoad<D>,
    /// The same as the fluid solver gets it.
    pub points: Points<D>,
    /// The fluid at the grains by the last solution.
    pub at: AtGrains<D>,
    /// Voidage at each grain: mean of the nodal voidage over its pieces.
    pub voidage: Vec<f64>,
    /// Force of the fluid on each grain, mean over the last step, N.
    pub force: Vec<Vector<D>>,
    /// What drag and added mass felt of the motion of each grain in the last implicit step, m/s; empty without added
    /// mass, when it is the mean velocity.
    pub felt: Vec<Vector<D>>,
    /// Heat from the fluid to each grain, mean over the last step, W; empty without heat.
    pub heat: Vec<f64>,
    /// Scalars of the fluid, by number, and the values below which contacts may stick; empty where nothing but the
    /// contacts themselves decides.
    pub sticks_below: Vec<(usize, f64)>,
    /// Length over which cohesion recovers round a droplet, in radii of it; none: it does not fall off.
    pub halo: Option<f64>,
    /// Whether the contacts of each grain may stick in the step in hand; empty where all may.
    pub cohesive: Vec<bool>,
    /// Relative residual to which the fluid solver solves its energy equation: temperatures are known to about this
    /// share.
    pub heat_tolerance: f64,
    /// What the fluid still has to give; absent with schemes that move the grains by the force of the law.
    pub carried: Option<Carried<D>>,
    /// Grains that have left through open boundaries since time zero.
    pub departed: u64,
    /// Their mass, kg (per metre of depth in the plane).
    pub departed_mass: f64,
    /// Solid volume that comes into the mesh and goes, of which the equation of mass is told.
    pub appearing: Appearing<D>,
    /// Force (N) and heat (W) that the fluid lost at the points in the last solution.
    pub lost: (Vector<D>, f64),
    /// Parts of the step in hand in which fluid and grains did not go equally far: what is still to be compared.
    pub(crate) open: Option<Open<D>>,
    /// The grains in the water of a droplet, and the water as they feel it; absent without a droplet.
    pub wet: Option<Wet<D>>,
    /// Cuts grains by the cells of the mesh.
    pub overlap: Overlap<D>,
}

/// What grains got less what the fluid lost over parts in which they did not go equally far, and the scale of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Open<const D: usize> {
    /// Impulse, N s, and heat, J.
    defect: (Vector<D>, f64),
    /// Sums of their amounts.
    scale: (f64, f64),
}

impl<const D: usize> Default for Interaction<D> {
    /// That of nothing with nothing.
    fn default() -> Self {
        Self {
            laws: Laws::default(),
            load: GrainLoad::default(),
            points: Points::default(),
            at: AtGrains::default(),
            voidage: vec![],
            force: vec![],
            felt: vec![],
            heat: vec![],
            sticks_below: vec![],
            halo: None,
            cohesive: vec![],
            heat_tolerance: Numerics::default().scalars.tolerance,
            carried: None,
            departed: 0,
            departed_mass: 0.0,
            appearing: Appearing::default(),
            lost: (Vector::zeros(), 0.0),
            open: None,
            wet: None,
            overlap: Overlap::default(),
        }
    }
}

impl<const D: usize> Interaction<D> {
    /// The exchange of `grains` with a fluid on `mesh`, solved to the default tolerance; `at` is the fluid at the
    /// grains in the beginning.
    ///
    /// # Errors
    /// A mesh that cannot be searched.
    pub fn new(laws: Laws, mesh: &Mesh<D>, grains: &Dem<D>, at: AtGrains<D>) -> Result<Self> {
        let count = grains.particles.position.len();
        let mut load = GrainLoad {
            volume: grains.particles.volume.clone(),
            drag: vec![0.0; count],
            mobility: vec![0.0; count],
            velocity: vec![Vector::zeros(); count],
            ..GrainLoad::default()
        };
        let mut heat = Vec::new();
        if laws.thermal.is_some() {
            let column = || vec![0.0; count];
            load.heat = Some(HeatLoad { coefficient: column(), mobility: column(), temperature: column() });
            heat = column();
        }
        let force = vec![Vector::zeros(); count];
        let overlap = Overlap::new(mesh)?;
        Ok(Self { laws, load, at, voidage: vec![1.0; count], force, heat, overlap, ..Self::default() })
    }
}

impl<const D: usize> Interaction<D> {
    /// Takes a solution of the fluid: the fluid at the grains, force and heat on them by the affine law, and what the
    /// fluid lost.
    pub(crate) fn receive(&mut self, fluid: &OnMesh<'_, D>) {
        self.at.sample(&self.load.pieces, fluid, self.load.heat.as_ref().map(|_| HEAT));
        let (load, at) = (&self.load, &self.at);
        let forces = self.force.par_iter_mut().enumerate().with_min_len(256);
        forces.for_each(|(i, force)| *force = load.force(at, i));
        if let Some(columns) = &load.heat {
            let heats = self.heat.par_iter_mut().enumerate().with_min_len(256);
            heats.for_each(|(i, heat)| *heat = columns.heat(at, i));
        }
        self.lost = exchange::lost(&self.points, fluid, HEAT);
    }

    /// Compares what the grains got in their motions with what the fluid lost in a solution over `dt` and what is carried
    /// on. Grains that went on for another time than the fluid, `moved`, are compared when the step [ends](Self::close).
    pub(crate) fn balance(&mut self, (dt, moved): (f64, f64), report: &mut StepReport) {
        let (mut force, mut heat) = (self.lost.0, self.lost.1);
        if let Some(carried) = &mut self.carried {
            let (impulse, warmth) = carried.change();
            (force, heat) = (force + impulse / dt, heat + warmth / dt);
        }
        let got: Vector<D> = self.force.iter().sum();
        let scale: f64 = self.force.iter().map(|f| f.norm()).sum();
        // Grains as fast as the fluid exchange the round-off of gamma u and gamma v, the more the heavier the fluid that
        // they carry.
        let speeds = self.at.velocity.iter().zip(&self.load.velocity).map(|(u, b)| u.norm() + b.norm());
        let through: f64 = self.load.drag.iter().zip(speeds).map(|(drag, speed)| drag * speed).sum();
        let scale = scale.max(1e-3 * through);
        let mut warm = (0.0, 0.0);
        if let Some(columns) = &self.load.heat {
            let scale: f64 = self.heat.iter().map(|q| q.abs()).sum();
            // Grains as warm as the fluid exchange the round-off of hA T.
            let warmth = columns.coefficient.iter().zip(&self.at.temperature);
            let through: f64 = warmth.map(|(h, t)| (h * t).abs()).sum();
            warm = (self.heat.iter().sum(), scale.max(1e-3 * through));
        }
        if moved == dt && self.open.is_none() {
            let defect = ((got - force).norm(), (warm.0 - heat).abs());
            return self.report(defect, (scale, warm.1), report);
        }
        let nothing = Open { defect: (Vector::zeros(), 0.0), scale: (0.0, 0.0) };
        let open = self.open.get_or_insert(nothing);
        open.defect.0 += got * moved - force * dt;
        open.defect.1 += warm.0 * moved - heat * dt;
        open.scale.0 += scale * moved.max(dt);
        open.scale.1 += warm.1 * moved.max(dt);
    }

    /// Compares what is still open at the end of a step.
    pub(crate) fn close(&mut self, report: &mut StepReport) {
        if let Some(Open { defect, scale }) = self.open.take() {
            self.report((defect.0.norm(), defect.1.abs()), scale, report);
        }
    }

    fn report(&self, defect: (f64, f64), scale: (f64, f64), report: &mut StepReport) {
        let worse = |worst: &mut Option<f64>, defect: f64| {
            // What is no number must not get lost in a maximum.
            *worst = Some(
                worst.map_or(defect, |worst| if worst > defect || worst.is_nan() { worst } else { defect }),
            );
        };
        worse(&mut report.momentum_exchange_defect, relative(defect.0, scale.0));
        if self.load.heat.is_some() {
            worse(&mut report.energy_exchange_defect, relative(defect.1, scale.1));
        }
    }
}

/// A defect over what it is a part of; itself where that is nothing.
pub(crate) fn relative(defect: f64, scale: f64) -> f64 {
    if scale > 0.0 { defect / scale } else { defect }
}
