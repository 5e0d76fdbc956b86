//! What the recorder sees of a simulation: slices, and what follows from them.

use nalgebra::SVector;
use voidage_fluid::Mesh;

/// A simulation as the recorder sees it.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, const D: usize> {
    /// The grains, if there are any.
    pub grains: Option<GrainView<'a, D>>,
    /// The fluid, if there is one.
    pub fluid: Option<FluidView<'a, D>>,
}

/// Columns of the grains.
#[derive(Clone, Copy, Debug)]
pub struct GrainView<'a, const D: usize> {
    /// Centres, m.
    pub position: &'a [SVector<f64, D>],
    /// Velocities, m/s.
    pub velocity: &'a [SVector<f64, D>],
    /// Radii, m.
    pub radius: &'a [f64],
    /// Masses, kg (kg per m of depth in the plane); infinite where a grain is held in place.
    pub mass: &'a [f64],
    /// Solid volumes, m3 (m2 in the plane).
    pub volume: &'a [f64],
    /// Angular velocities, rad/s, if grains spin.
    pub spin: Option<&'a [f64]>,
    /// Temperatures, K, if grains have them.
    pub temperature: Option<&'a [f64]>,
}

/// Nodal fields of the fluid.
#[derive(Clone, Copy, Debug)]
pub struct FluidView<'a, const D: usize> {
    /// The mesh.
    pub mesh: &'a Mesh<D>,
    /// Velocity, m/s.
    pub velocity: &'a [SVector<f64, D>],
    /// Pressure, Pa.
    pub pressure: &'a [f64],
    /// Voidage, if there are grains.
    pub voidage: Option<&'a [f64]>,
    /// Temperature, K, if the fluid has one.
    pub temperature: Option<&'a [f64]>,
}

impl<const D: usize> GrainView<'_, D> {
    /// Mean over the solid volume of the grains.
    pub fn mean(&self, value: impl Fn(usize) -> f64) -> f64 {
        let volume: f64 = self.volume.iter().sum();
        self.volume.iter().enumerate().map(|(i, volume)| volume * value(i)).sum::<f64>() / volume
    }

    /// Named quantities for the time series.
    pub(super) fn readings(&self) -> Vec<(&'static str, f64)> {
        let speed = self.velocity.iter().map(|velocity| velocity.norm()).fold(0.0, f64::max);
        let energy = |(mass, velocity): (&f64, &SVector<f64, D>)| 0.5 * mass * velocity.norm_squared();
        let unit = if D == 2 { "grain_kinetic_energy_J_per_m" } else { "grain_kinetic_energy_J" };
        let mut readings = vec![
            ("mean_grain_height_m", self.mean(|i| self.position[i][D - 1])),
            ("max_grain_speed_m_per_s", speed),
            (
                unit,
                self.mass.iter().zip(self.velocity).filter(|(mass, _)| mass.is_finite()).map(energy).sum(),
            ),
        ];
        if let Some(temperature) = self.temperature {
            readings.push(("mean_grain_temperature_K", self.mean(|i| temperature[i])));
            readings
                .push(("min_grain_temperature_K", temperature.iter().copied().fold(f64::INFINITY, f64::min)));
            readings.push((
                "max_grain_temperature_K",
                temperature.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ));
        }
        readings
    }
}

impl<const D: usize> FluidView<'_, D> {
    /// Mean pressure over a named boundary, Pa.
    pub fn mean_pressure(&self, name: &str) -> Option<f64> {
        let boundary = self.mesh.boundaries.iter().find(|boundary| boundary.name == name)?;
        let (mut sum, mut area) = (0.0, 0.0);
        for facet in boundary.facets.chunks_exact(D) {
            let size = self.facet_size(facet);
            sum += size * facet.iter().map(|node| self.pressure[*node as usize]).sum::<f64>() / D as f64;
            area += size;
        }
        Some(sum / area)
    }

    /// Length of an edge, or a number in proportion to the area of a triangle.
    fn facet_size(&self, facet: &[u32]) -> f64 {
        let point = |k: usize| self.mesh.points[facet[k] as usize];
        let along = point(1) - point(0);
        if D == 2 {
            return along.norm();
        }
        let across = point(2) - point(0);
        let [aa, bb, ab] = [along.norm_squared(), across.norm_squared(), along.dot(&across)];
        (aa * bb - ab * ab).max(0.0).sqrt()
    }

    /// Named quantities for the time series.
    pub(super) fn readings(&self) -> Vec<(&'static str, f64)> {
        let speed = self.velocity.iter().map(|velocity| velocity.norm()).fold(0.0, f64::max);
        let mut readings = vec![("max_fluid_speed_m_per_s", speed)];
        if let Some(temperature) = self.temperature {
            readings
                .push(("min_fluid_temperature_K", temperature.iter().copied().fold(f64::INFINITY, f64::min)));
            readings.push((
                "max_fluid_temperature_K",
                temperature.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ));
        }
        readings
    }
}
