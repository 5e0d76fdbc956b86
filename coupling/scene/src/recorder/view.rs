//! What the recorder sees of a simulation: slices, and what follows from them.

use super::Reading;
use crate::network::Network;
use nalgebra::SVector;
use voidage_coupling::TEMPERATURE;
use voidage_dem::Period;
use voidage_fluid::Mesh;
use voidage_fluid::flow::State;

/// A simulation as the recorder sees it.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, const D: usize> {
    /// The grains, if there are any.
    pub grains: Option<GrainView<'a, D>>,
    /// The fluid, if there is one.
    pub fluid: Option<FluidView<'a, D>>,
    /// Contacts and stresses, if they are recorded.
    pub network: Option<&'a Network>,
}

/// Columns of the grains.
#[derive(Clone, Copy, Debug)]
pub struct GrainView<'a, const D: usize> {
    /// Numbers of the grains, for life.
    pub id: &'a [u32],
    /// Group of each grain, as the scene numbers them; where there are several.
    pub group: Option<&'a [u8]>,
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
    /// The periodic sides between which the centres lie.
    pub period: Period<D>,
}

/// Nodal fields of the fluid.
#[derive(Clone, Copy, Debug)]
pub struct FluidView<'a, const D: usize> {
    /// The mesh.
    pub mesh: &'a Mesh<D>,
    /// Velocity (m/s), pressure (Pa), scalars.
    pub fields: &'a State<D>,
    /// Voidage, if there are grains.
    pub voidage: Option<&'a [f64]>,
    /// Names of the scalars.
    pub scalars: &'a [String],
}

impl<'a, const D: usize> FluidView<'a, D> {
    /// The scalar of a name.
    pub fn scalar(&self, name: &str) -> Option<&'a [f64]> {
        let number = self.scalars.iter().position(|scalar| scalar == name)?;
        self.fields.scalars.get(number).map(Vec::as_slice)
    }
}

/// A name with its unit, where that is known: `temperature_K`; for tables.
pub fn with_unit(scalar: &str) -> String {
    if scalar == TEMPERATURE { format!("{scalar}_K") } else { scalar.to_owned() }
}

/// A name of the user's as a part of the name of a column.
pub fn column_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

impl<const D: usize> GrainView<'_, D> {
    /// Mean over the solid volume of the grains.
    pub fn mean(&self, value: impl Fn(usize) -> f64) -> f64 {
        let volume: f64 = self.volume.iter().sum();
        self.volume.iter().enumerate().map(|(i, volume)| volume * value(i)).sum::<f64>() / volume
    }

    /// Named quantities for the time series.
    pub(super) fn readings(&self) -> Vec<Reading> {
        let speed = self.velocity.iter().map(|velocity| velocity.norm()).fold(0.0, f64::max);
        let energy = |(mass, velocity): (&f64, &SVector<f64, D>)| 0.5 * mass * velocity.norm_squared();
        let free = self.mass.iter().zip(self.velocity).filter(|(mass, _)| mass.is_finite());
        let unit = if D == 2 { "grain_kinetic_energy_J_per_m" } else { "grain_kinetic_energy_J" };
        let mut readings = vec![
            ("mean_grain_height_m".into(), self.mean(|i| self.position[i][D - 1])),
            ("max_grain_speed_m_per_s".into(), speed),
            // Held grains have an infinite mass and no energy. (An empty `sum` would be -0.)
            (unit.into(), free.map(energy).fold(0.0, |sum, energy| sum + energy)),
        ];
        if let Some(temperature) = self.temperature {
            readings.push(("mean_grain_temperature_K".into(), self.mean(|i| temperature[i])));
            // Of no grains nothing is known.
            let extreme =
                |pick: fn(f64, f64) -> f64| temperature.iter().copied().reduce(pick).unwrap_or(f64::NAN);
            readings.push(("min_grain_temperature_K".into(), extreme(f64::min)));
            readings.push(("max_grain_temperature_K".into(), extreme(f64::max)));
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
            sum +=
                size * facet.iter().map(|node| self.fields.pressure[*node as usize]).sum::<f64>() / D as f64;
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
    pub(super) fn readings(&self) -> Vec<Reading> {
        let speed = self.fields.velocity.iter().map(|velocity| velocity.norm()).fold(0.0, f64::max);
        let mut readings = vec![("max_fluid_speed_m_per_s".into(), speed)];
        for (name, values) in self.scalars.iter().zip(&self.fields.scalars) {
            let name = with_unit(name);
            let extreme = |start: f64, f: fn(f64, f64) -> f64| values.iter().copied().fold(start, f);
            readings.push((format!("min_fluid_{name}").into(), extreme(f64::INFINITY, f64::min)));
            readings.push((format!("max_fluid_{name}").into(), extreme(f64::NEG_INFINITY, f64::max)));
        }
        readings
    }
}
