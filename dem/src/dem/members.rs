//! Grains that come and go, and laws that change, while a run goes on.

use super::Dem;
use super::forces::{GONE, Last};
use crate::error::{Error, Result};
use crate::heat::Conductor;
use crate::particles::retain;
use crate::saved::Saved;
use crate::{Heat, Material, Particles, Rotation, Settings, Vector, Wall};
use std::mem::take;

impl<const D: usize> Dem<D> {
    /// Takes grains out of the run: those that are not marked. Contacts of the others stay.
    ///
    /// # Panics
    /// If there are not as many marks as grains.
    pub fn retain(&mut self, keep: &[bool]) {
        if self.settings.energy {
            let gone = (0..keep.len()).filter(|i| !keep[*i]);
            self.energy.passed -= gone.map(|i| self.particles.kinetic_energy_of(i)).sum::<f64>();
        }
        self.particles.retain(keep);
        self.memory.retain(keep);
        retain(&mut self.contact_force, keep);
        retain(&mut self.contact_heat, keep);
        retain(&mut self.mean_velocity, keep);
        retain(&mut self.mean_temperature, keep);
        let mut kept = 0..;
        let number: Vec<u32> =
            keep.iter().map(|keep| if *keep { kept.next().unwrap_or(GONE) } else { GONE }).collect();
        self.renumber();
        if let Some(last) = &mut self.last {
            last.number.iter_mut().filter(|k| **k != GONE).for_each(|k| *k = number[*k as usize]);
        }
    }

    /// Adds grains after those that are there, with the numbers for life that they have. Contacts of the others stay.
    ///
    /// # Errors
    /// Values that no grain may have; heat or spin that only the one or the other have.
    pub fn add(&mut self, more: Particles<D>) -> Result<()> {
        more.validate(&self.materials)?;
        self.settings.period.check(super::largest(&more), &self.walls)?;
        let alike = |a: bool, b: bool| a == b || self.particles.is_empty();
        let heat = alike(more.heat.is_some(), self.particles.heat.is_some());
        if !heat || !alike(more.rotation.is_some(), self.particles.rotation.is_some()) {
            return Err(Error::Scene("grains that are added carry heat and spin as the others do".into()));
        }
        if self.settings.energy {
            self.energy.passed += more.kinetic_energy();
        }
        let id = more.id.clone();
        let before = self.particles.len();
        self.particles.append(more);
        self.particles.id[before..].copy_from_slice(&id);
        let n = self.particles.len();
        self.memory.extend(n);
        self.contact_force.resize(n, Vector::zeros());
        self.contact_heat.resize(if self.particles.heat.is_some() { n } else { 0 }, 0.0);
        self.mean_velocity.resize(if self.mean_velocity.is_empty() { 0 } else { n }, Vector::zeros());
        self.mean_temperature.resize(if self.mean_temperature.is_empty() { 0 } else { n }, 0.0);
        self.renumber();
        self.wrap();
        Ok(())
    }

    /// Puts what holds grains by their old numbers aside; it is made again.
    fn renumber(&mut self) {
        let (search, problem, conductor) =
            (take(&mut self.search), take(&mut self.problem), take(&mut self.conductor));
        if self.known && self.last.is_none() {
            let number = (0..search.grid.grain_of.len() as u32).collect();
            self.last = Some(Last { search, problem, conductor, number });
        }
        (self.saved, self.after) = (Saved::default(), vec![]);
    }

    /// Forgets the contacts of the last sub-step.
    pub(super) fn forget(&mut self) {
        self.renumber();
        (self.known, self.last) = (false, None);
    }

    /// Other coefficients of walls and materials, and other settings, from now on; as many walls and materials as
    /// before.
    ///
    /// # Errors
    /// Values that are not allowed, or that grains of this kind cannot have.
    pub fn change(
        &mut self,
        walls: Vec<Wall<D>>,
        materials: Vec<Material>,
        settings: Settings<D>,
    ) -> Result<()> {
        if (walls.len(), materials.len()) != (self.walls.len(), self.materials.len()) {
            return Err(Error::Scene("walls and materials must stay as many as they are".into()));
        }
        let alike = Particles {
            heat: self.particles.heat.as_ref().map(|_| Heat::default()),
            rotation: self.particles.rotation.as_ref().map(|_| Rotation::default()),
            ..Particles::default()
        };
        settings.period.check(super::largest(&self.particles), &walls)?;
        let changed = Self::new(alike, walls, materials, settings)?;
        (self.walls, self.materials) = (changed.walls, changed.materials);
        (self.settings, self.laws) = (changed.settings, changed.laws);
        if self.settings.conduction.is_none() {
            self.conductor = Conductor::default();
            if let Some(last) = &mut self.last {
                last.conductor = Conductor::default();
            }
        }
        Ok(())
    }
}
