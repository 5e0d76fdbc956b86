//! Grains as a struct of arrays, and what they are made of.

use crate::error::{Error, Result, check};
use crate::space::{Vector, ball, inertia};
use serde::{Deserialize, Serialize};

/// What grains are made of. A property that no part of the scene uses may stay at zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Density of the solid, kg/m3.
    pub density: f64,
    /// Share chi of the disc or sphere that is solid, in ]0, 1]: scales volume and mass.
    #[serde(default = "one")]
    pub solidity: f64,
    /// Coulomb's coefficient between grains; two materials meet with the smaller one.
    #[serde(default)]
    pub friction: f64,
    /// Coefficient mu_r of resistance to rolling, 0 to 1, in the plane: a contact resists a relative spin by a moment
    /// of up to mu_r R p_n, R = r1 r2 / (r1 + r2); two materials meet with the smaller one.
    #[serde(default)]
    pub rolling: f64,
    /// Newton's coefficient of restitution, 0 to 1; two materials meet with the smaller one.
    #[serde(default)]
    pub restitution: f64,
    /// Young's modulus, Pa: contact conduction only.
    #[serde(default)]
    pub young: f64,
    /// Poisson's ratio: contact conduction only.
    #[serde(default)]
    pub poisson: f64,
    /// Thermal conductivity, W/m/K: contact conduction only.
    #[serde(default)]
    pub conductivity: f64,
    /// Heat capacity, J/kg/K: heat only.
    #[serde(default)]
    pub heat_capacity: f64,
}

fn one() -> f64 {
    1.0
}

impl Default for Material {
    /// Full grains of 2500 kg/m3 without friction, restitution or heat.
    fn default() -> Self {
        Self {
            density: 2500.0,
            solidity: 1.0,
            friction: 0.0,
            rolling: 0.0,
            restitution: 0.0,
            young: 0.0,
            poisson: 0.0,
            conductivity: 0.0,
            heat_capacity: 0.0,
        }
    }
}

impl Material {
    fn validate(&self, k: usize) -> Result<()> {
        let at = |name: &str| format!("material {k}, {name}");
        check(self.density > 0.0 && self.density.is_finite(), self.density, "it must be positive", || {
            at("density")
        })?;
        check(self.solidity > 0.0 && self.solidity <= 1.0, self.solidity, "0 < solidity <= 1", || {
            at("solidity")
        })?;
        check(
            self.friction >= 0.0 && self.friction.is_finite(),
            self.friction,
            "it must be 0 or more",
            || at("friction"),
        )?;
        check((0.0..=1.0).contains(&self.rolling), self.rolling, "it must lie in 0 .. 1", || at("rolling"))?;
        check((0.0..=1.0).contains(&self.restitution), self.restitution, "it must lie in 0 .. 1", || {
            at("restitution")
        })?;
        check((-1.0..=0.5).contains(&self.poisson), self.poisson, "it must lie in -1 .. 0.5", || {
            at("poisson")
        })?;
        for (name, value) in [
            ("young", self.young),
            ("conductivity", self.conductivity),
            ("heat_capacity", self.heat_capacity),
        ] {
            check(value >= 0.0 && value.is_finite(), value, "it must be 0 or more", || at(name))?;
        }
        Ok(())
    }
}

/// Keeps the rows of a column that are marked; a column without rows stays so.
pub fn retain<T>(column: &mut Vec<T>, keep: &[bool]) {
    let mut marks = keep.iter();
    column.retain(|_| marks.next().copied().unwrap_or(true));
}

/// Spin of discs. Absent: no rotation, as if the inertia were infinite.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// Angular velocity, rad/s, counter-clockwise.
    pub spin: Vec<f64>,
    /// Angle turned since the start, rad.
    pub angle: Vec<f64>,
    /// Moment of inertia, kg m2 (per metre of depth).
    pub inertia: Vec<f64>,
}

/// Temperature of grains, uniform in each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Heat {
    /// Temperature, K (or Celsius: only differences count).
    pub temperature: Vec<f64>,
    /// Heat capacity m c_p, J/K (per metre of depth in the plane).
    pub capacity: Vec<f64>,
}

/// Grains; columns of equal length. A column that no part of the scene uses is not there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Particles<const D: usize> {
    /// Centres, m.
    pub position: Vec<Vector<D>>,
    /// Velocities of the centres, m/s.
    pub velocity: Vec<Vector<D>>,
    /// Radii, m.
    pub radius: Vec<f64>,
    /// Masses, kg (per metre of depth in the plane); infinite for a grain that is held: it keeps its velocity.
    pub mass: Vec<f64>,
    /// Solid volumes chi pi r2 (per metre of depth) or chi 4/3 pi r3, m2 or m3.
    pub volume: Vec<f64>,
    /// Index into the list of materials.
    pub material: Vec<u8>,
    /// Number of each grain for life, whoever else comes or leaves.
    pub id: Vec<u32>,
    /// Spin, if grains rotate.
    pub rotation: Option<Rotation>,
    /// Temperature, if grains carry heat.
    pub heat: Option<Heat>,
}

impl<const D: usize> Particles<D> {
    /// Grains at rest; mass and volume follow from the materials.
    pub fn new(
        position: Vec<Vector<D>>,
        radius: Vec<f64>,
        material: Vec<u8>,
        materials: &[Material],
    ) -> Result<Self> {
        if position.len() != radius.len() || position.len() != material.len() {
            let (x, r, m) = (position.len(), radius.len(), material.len());
            return Err(Error::Scene(format!(
                "{x} positions, {r} radii and {m} materials: they must be as many"
            )));
        }
        let mut volume = Vec::with_capacity(radius.len());
        let mut mass = Vec::with_capacity(radius.len());
        for (&r, &m) in radius.iter().zip(&material) {
            let made_of = materials.get(m as usize).ok_or_else(|| unknown_material(m, materials.len()))?;
            volume.push(made_of.solidity * ball::<D>(r));
            mass.push(made_of.density * made_of.solidity * ball::<D>(r));
        }
        let velocity = vec![Vector::zeros(); position.len()];
        let id = (0..position.len() as u32).collect();
        Ok(Self { position, velocity, radius, mass, volume, material, id, rotation: None, heat: None })
    }

    /// The same grains, free to spin, with the inertia of full discs.
    pub fn rotating(mut self) -> Self {
        let inertia = self.mass.iter().zip(&self.radius).map(|(&m, &r)| inertia::<D>(m, r)).collect();
        self.rotation = Some(Rotation { spin: vec![0.0; self.len()], angle: vec![0.0; self.len()], inertia });
        self
    }

    /// The same grains, all at one temperature (K), with the heat capacity of their materials.
    pub fn heated(mut self, temperature: f64, materials: &[Material]) -> Result<Self> {
        let mut capacity = Vec::with_capacity(self.len());
        for (&mass, &m) in self.mass.iter().zip(&self.material) {
            let made_of = materials.get(m as usize).ok_or_else(|| unknown_material(m, materials.len()))?;
            capacity.push(mass * made_of.heat_capacity);
        }
        self.heat = Some(Heat { temperature: vec![temperature; self.len()], capacity });
        Ok(self)
    }

    /// Keeps the grains that are marked.
    ///
    /// # Panics
    /// If there are not as many marks as grains.
    pub fn retain(&mut self, keep: &[bool]) {
        assert_eq!(keep.len(), self.len(), "a mark for every grain");
        retain(&mut self.position, keep);
        retain(&mut self.velocity, keep);
        retain(&mut self.radius, keep);
        retain(&mut self.mass, keep);
        retain(&mut self.volume, keep);
        retain(&mut self.material, keep);
        retain(&mut self.id, keep);
        if let Some(rotation) = &mut self.rotation {
            [&mut rotation.spin, &mut rotation.angle, &mut rotation.inertia]
                .into_iter()
                .for_each(|column| retain(column, keep));
        }
        if let Some(heat) = &mut self.heat {
            [&mut heat.temperature, &mut heat.capacity].into_iter().for_each(|column| retain(column, keep));
        }
    }

    /// Adds other grains after these, with numbers that follow. Spin and heat stay only if both have them.
    pub fn append(&mut self, more: Self) {
        if self.is_empty() {
            *self = more;
            return;
        }
        self.position.extend(more.position);
        self.velocity.extend(more.velocity);
        self.radius.extend(more.radius);
        self.mass.extend(more.mass);
        self.volume.extend(more.volume);
        self.material.extend(more.material);
        let next = self.id.iter().max().map_or(0, |last| last + 1);
        self.id.extend(more.id.iter().map(|id| next + id));
        self.rotation = self.rotation.take().zip(more.rotation).map(|(mut all, more)| {
            all.spin.extend(more.spin);
            all.angle.extend(more.angle);
            all.inertia.extend(more.inertia);
            all
        });
        self.heat = self.heat.take().zip(more.heat).map(|(mut all, more)| {
            all.temperature.extend(more.temperature);
            all.capacity.extend(more.capacity);
            all
        });
    }

    /// Whether a grain is held: its mass is infinite.
    pub fn held(&self, i: usize) -> bool {
        self.mass[i] == f64::INFINITY
    }

    /// Number of grains.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is no grain at all.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Checks lengths and values, and that every material exists.
    pub fn validate(&self, materials: &[Material]) -> Result<()> {
        if materials.len() > 256 {
            return Err(Error::Scene(format!("{} materials: at most 256", materials.len())));
        }
        materials.iter().enumerate().try_for_each(|(k, m)| m.validate(k))?;
        self.validate_lengths()?;
        for i in 0..self.len() {
            let at = |name: &str| format!("grain {i}, {name}");
            let good = |v: f64| v.is_finite() && v > 0.0;
            for (name, vector) in [("position", &self.position[i]), ("velocity", &self.velocity[i])] {
                vector.iter().try_for_each(|&x| check(x.is_finite(), x, "it must be finite", || at(name)))?;
            }
            for (name, value) in [("radius", self.radius[i]), ("volume", self.volume[i])] {
                check(good(value), value, "it must be positive", || at(name))?;
            }
            check(self.mass[i] > 0.0, self.mass[i], "it must be positive", || at("mass"))?;
            let m = self.material[i];
            materials.get(m as usize).ok_or_else(|| unknown_material(m, materials.len()))?;
            if let Some(rotation) = &self.rotation {
                check(rotation.inertia[i] > 0.0, rotation.inertia[i], "it must be positive", || {
                    at("inertia")
                })?;
                check(rotation.spin[i].is_finite(), rotation.spin[i], "it must be finite", || at("spin"))?;
            }
            if let Some(heat) = &self.heat {
                check(good(heat.capacity[i]), heat.capacity[i], "it must be positive", || {
                    at("heat capacity")
                })?;
                let temperature = heat.temperature[i];
                let good = temperature.is_finite() && temperature >= 0.0;
                check(good, temperature, "it must be 0 K or more", || at("temperature"))?;
            }
        }
        Ok(())
    }

    pub(crate) fn validate_lengths(&self) -> Result<()> {
        let n = self.len();
        let mut columns = vec![
            ("id", self.id.len()),
            ("velocity", self.velocity.len()),
            ("radius", self.radius.len()),
            ("mass", self.mass.len()),
            ("volume", self.volume.len()),
            ("material", self.material.len()),
        ];
        if let Some(r) = &self.rotation {
            columns.extend([("spin", r.spin.len()), ("angle", r.angle.len()), ("inertia", r.inertia.len())]);
        }
        if let Some(h) = &self.heat {
            columns.extend([("temperature", h.temperature.len()), ("heat capacity", h.capacity.len())]);
        }
        match columns.iter().find(|c| c.1 != n) {
            Some((name, len)) => Err(Error::Scene(format!("{n} positions but {len} values of {name}"))),
            None if n >= 1 << 30 => Err(Error::Scene(format!("{n} grains: at most 2^30"))),
            None => Ok(()),
        }
    }
}

fn unknown_material(m: u8, count: usize) -> Error {
    Error::Scene(format!("material {m} does not exist: the scene has {count}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_disc(radius: f64) -> (Particles<2>, Vec<Material>) {
        let glass =
            vec![Material { density: 2000.0, solidity: 0.8, heat_capacity: 10.0, ..Material::default() }];
        let grains = Particles::new(vec![Vector::zeros()], vec![radius], vec![0], &glass).unwrap();
        (grains.rotating().heated(300.0, &glass).unwrap(), glass)
    }

    #[test]
    fn solidity_scales_volume_mass_inertia_and_capacity() {
        let (grains, _) = one_disc(0.5);
        let area = std::f64::consts::PI * 0.25;
        approx::assert_relative_eq!(grains.volume[0], 0.8 * area);
        approx::assert_relative_eq!(grains.mass[0], 1600.0 * area);
        approx::assert_relative_eq!(grains.rotation.unwrap().inertia[0], 200.0 * area);
        approx::assert_relative_eq!(grains.heat.unwrap().capacity[0], 16000.0 * area);
    }

    #[test]
    fn wrong_values_are_named() {
        let (mut grains, glass) = one_disc(0.5);
        assert!(grains.validate(&glass).is_ok());
        grains.position[0][1] = f64::NAN;
        assert_eq!(
            grains.validate(&glass).unwrap_err().to_string(),
            "grain 0, position: NaN is not allowed, it must be finite"
        );
        let (mut grains, glass) = one_disc(0.5);
        grains.material[0] = 3;
        assert_eq!(
            grains.validate(&glass).unwrap_err().to_string(),
            "material 3 does not exist: the scene has 1"
        );
        let (mut grains, glass) = one_disc(0.5);
        grains.radius.pop();
        assert!(grains.validate(&glass).unwrap_err().to_string().contains("0 values of radius"));
    }
}
