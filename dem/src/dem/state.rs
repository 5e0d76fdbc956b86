//! What a restart needs, bit for bit.

use super::{ContactForce, Dem, Partner};
use crate::energy::Energy;
use crate::error::{Error, Result};
use crate::memory::{Memory, WALL};
use crate::{Particles, Vector};
use serde::{Deserialize, Serialize};

/// Everything that a bit-exact restart needs beside walls, materials and settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State<const D: usize> {
    /// Time, s; walls are where their laws put them at this time.
    pub time: f64,
    /// The grains.
    pub particles: Particles<D>,
    memory: Memory<D>,
    contact_force: Vec<Vector<D>>,
    contact_heat: Vec<f64>,
    wall_force: Vec<Vector<D>>,
    wall_heat: Vec<f64>,
    wall_torque: Vec<f64>,
    energy: Energy,
}

impl<const D: usize> State<D> {
    /// Checks that all columns are of the same grains and walls, and that contacts and forces are finite.
    ///
    /// # Errors
    /// Names the column that is not.
    pub fn validate(&self) -> Result<()> {
        self.particles.validate_lengths()?;
        let (grains, walls) = (self.particles.len(), self.wall_force.len());
        let heat = |of: usize| move |count: usize| count == 0 || count == of;
        let finite = |column: &[f64]| column.iter().all(|x| x.is_finite());
        let vectors = |column: &[Vector<D>]| column.iter().flatten().all(|x| x.is_finite());
        let columns = [
            ("forces on grains", self.contact_force.len() == grains && vectors(&self.contact_force)),
            ("heat to grains", heat(grains)(self.contact_heat.len()) && finite(&self.contact_heat)),
            ("forces on walls", vectors(&self.wall_force)),
            ("heat to walls", heat(walls)(self.wall_heat.len()) && finite(&self.wall_heat)),
            ("torques on walls", heat(walls)(self.wall_torque.len()) && finite(&self.wall_torque)),
            ("contacts", self.memory.fits(grains, walls)),
            ("time", self.time.is_finite()),
            ("energies", self.energy.terms().iter().all(|(_, term)| term.is_finite())),
        ];
        match columns.iter().find(|(_, good)| !good) {
            Some((name, _)) => {
                Err(Error::Scene(format!("the state of {grains} grains and {walls} walls has wrong {name}")))
            }
            None => Ok(()),
        }
    }

    /// The contacts of the last sub-step that carried a force, for grains that start another run.
    pub fn forces(&self) -> impl Iterator<Item = ContactForce<D>> + '_ {
        let h = self.memory.h;
        self.memory.records().map(move |r| ContactForce {
            grain: r.i,
            partner: if r.j & WALL == 0 { Partner::Grain(r.j) } else { Partner::Wall(r.j & !WALL) },
            force: r.impulse / h,
            age: r.age,
            rolling: r.rolling / h,
        })
    }
}

impl<const D: usize> Dem<D> {
    /// All that a restart needs beside walls, materials and settings.
    pub fn state(&self) -> State<D> {
        State {
            time: self.time,
            particles: self.particles.clone(),
            memory: self.memory.clone(),
            contact_force: self.contact_force.clone(),
            contact_heat: self.contact_heat.clone(),
            wall_force: self.wall_force.clone(),
            wall_heat: self.wall_heat.clone(),
            wall_torque: self.wall_torque.clone(),
            energy: self.energy,
        }
    }

    /// Continues from a state of the same scene, bit for bit as if it had not stopped.
    ///
    /// # Errors
    /// Those of [`State::validate`], values that no grain has, forces of other walls.
    pub fn restore(&mut self, state: State<D>) -> Result<()> {
        state.validate()?;
        state.particles.validate(&self.materials)?;
        let n = state.particles.len();
        if state.contact_force.len() != n || state.wall_force.len() != self.walls.len() {
            let (grains, walls) = (state.contact_force.len(), state.wall_force.len());
            return Err(Error::Scene(format!(
                "the state holds forces of {grains} grains and {walls} walls, the scene has {n} and {}",
                self.walls.len()
            )));
        }
        if self.particles.id != state.particles.id {
            self.forget();
        }
        self.time = state.time;
        self.particles = state.particles;
        self.memory = state.memory;
        self.contact_force = state.contact_force;
        self.contact_heat = state.contact_heat;
        self.wall_force = state.wall_force;
        self.wall_heat = state.wall_heat;
        self.wall_torque = state.wall_torque;
        self.energy = state.energy;
        Ok(())
    }
}
