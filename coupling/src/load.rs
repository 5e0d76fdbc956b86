//! What the fluid is to know of the grains: the columns that every scheme fills.

use crate::exchange::{AtGrains, Pieces};
use voidage_fluid::Vector;

/// The grains in the fluid: where they are, their drag and the affine law of the velocity
/// that they will have, v* = velocity + mobility (drag u - volume grad p + known).
#[derive(Clone, Debug, Default)]
pub struct GrainLoad<const D: usize> {
    /// The grains cut by the mesh.
    pub pieces: Pieces<D>,
    /// Nodal voidage.
    pub voidage: Vec<f64>,
    /// Solid volume V inside the mesh, m3 (m2 in the plane).
    pub volume: Vec<f64>,
    /// Drag coefficient gamma, kg/s, that of the added mass included.
    pub drag: Vec<f64>,
    /// Added mass m_a, kg, whose part of the drag coefficient is m_a/dt; empty where grains have none.
    pub added: Vec<f64>,
    /// The part k of the forcing that the solution of the fluid does not change, N; empty where there is none.
    pub known: Vec<Vector<D>>,
    /// Mobility a, s/kg.
    pub mobility: Vec<f64>,
    /// Constant part b of the velocity law, m/s.
    pub velocity: Vec<Vector<D>>,
    /// The law of the solid flux in the equation of mass; absent where it is the same.
    pub continuity: Option<Law<D>>,
    /// The same for heat; absent unless grains and fluid both have a temperature.
    pub heat: Option<HeatLoad>,
}

/// A law of velocity, v* = velocity + mobility (drag u - volume grad p + known).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Law<const D: usize> {
    /// Mobility a, s/kg.
    pub mobility: Vec<f64>,
    /// Constant part b, m/s.
    pub velocity: Vec<Vector<D>>,
}

/// Heat columns of the load: T* = temperature + mobility (coefficient T).
#[derive(Clone, Debug, Default)]
pub struct HeatLoad {
    /// hA, W/K.
    pub coefficient: Vec<f64>,
    /// aT, K/W.
    pub mobility: Vec<f64>,
    /// bT, K.
    pub temperature: Vec<f64>,
}

impl HeatLoad {
    /// The temperature T* of grain `i` by the affine law, K.
    pub fn expected<const D: usize>(&self, at: &AtGrains<D>, i: usize) -> f64 {
        self.temperature[i] + self.mobility[i] * self.coefficient[i] * at.temperature[i]
    }

    /// What T* must be lower by for the fluid to give the heat `carried` (J) within `dt`, K.
    pub fn temperature_offset(&self, carried: f64, dt: f64, i: usize) -> f64 {
        if self.coefficient[i] > 0.0 { carried / (self.coefficient[i] * dt) } else { 0.0 }
    }

    /// hA (T* - T) of grain `i` at a mean temperature: the heat that it gets and the fluid does not lose, W.
    pub(crate) fn missed<const D: usize>(&self, at: &AtGrains<D>, temperature: f64, i: usize) -> f64 {
        self.coefficient[i] * (self.expected(at, i) - temperature)
    }

    /// Heat from the fluid to grain `i`, W: hA (T - T*) with the affine law T*.
    pub fn heat<const D: usize>(&self, at: &AtGrains<D>, i: usize) -> f64 {
        self.coefficient[i] * (at.temperature[i] - self.expected(at, i))
    }
}

impl<const D: usize> GrainLoad<D> {
    /// The known part k of the forcing on grain `i`, N.
    pub(crate) fn known(&self, i: usize) -> Vector<D> {
        self.known.get(i).copied().unwrap_or_else(Vector::zeros)
    }

    /// The forcing of the fluid on grain `i`, N: f = gamma u - V grad p + k, its force on the grain at rest.
    pub fn forcing(&self, at: &AtGrains<D>, i: usize) -> Vector<D> {
        at.velocity[i] * self.drag[i] - at.pressure_gradient[i] * self.volume[i] + self.known(i)
    }

    /// Forces (N) and drag coefficients (kg/s) of a forcing without those of the added mass, for grains that have it as
    /// inertia and that start a step of `dt` at these velocities; absent without added mass.
    pub(crate) fn without_added(
        &self,
        forcing: &[Vector<D>],
        velocity: &[Vector<D>],
        dt: f64,
    ) -> Option<(Vec<Vector<D>>, Vec<f64>)> {
        let all = 0..self.added.len();
        let force = |i: usize| forcing[i] - velocity[i] * (self.added[i] / dt);
        let drag = |i: usize| (self.drag[i] - self.added[i] / dt).max(0.0);
        (!self.added.is_empty()).then(|| (all.clone().map(force).collect(), all.map(drag).collect()))
    }

    /// The velocity v* of grain `i` by the affine law of momentum, m/s.
    pub fn expected(&self, at: &AtGrains<D>, i: usize) -> Vector<D> {
        self.velocity[i] + self.forcing(at, i) * self.mobility[i]
    }

    /// The velocity of grain `i` by the law of the solid flux, m/s.
    pub fn expected_in_flux(&self, at: &AtGrains<D>, i: usize) -> Vector<D> {
        match &self.continuity {
            Some(law) => law.velocity[i] + self.forcing(at, i) * law.mobility[i],
            None => self.expected(at, i),
        }
    }

    /// Force of the fluid on grain `i`, N: -V grad p + gamma (u - v*) + k with the affine law v*.
    pub fn force(&self, at: &AtGrains<D>, i: usize) -> Vector<D> {
        let slip = at.velocity[i] - self.expected(at, i);
        slip * self.drag[i] - at.pressure_gradient[i] * self.volume[i] + self.known(i)
    }
}
