//! The contacts of the last sub-step and their forces, for output and for another run.

use super::Dem;
use crate::Vector;
use crate::bonds::Bonds;
use crate::memory::{Record, WALL};
use serde::{Deserialize, Serialize};

/// What a grain touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Partner {
    /// Another grain, by number.
    Grain(u32),
    /// A wall, by number.
    Wall(u32),
}

/// A contact of the last sub-step, for output.
#[derive(Clone, Copy, Debug)]
pub struct Contact<const D: usize> {
    /// Number of the first grain.
    pub grain: u32,
    /// The other side.
    pub partner: Partner,
    /// Unit vector from the grain to the other side.
    pub normal: Vector<D>,
    /// Mean force on the other side over the last sub-step, N (per metre of depth).
    pub force: Vector<D>,
    /// Moment that resists rolling, on the other side, over the effective radius, N (per metre of depth).
    pub rolling: f64,
    /// What the contact allowed the gap to close by in the last sub-step, m: the gap at its start (zero for grains
    /// that overlap), or less after an impact with restitution.
    pub gap: f64,
}

/// The force at a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactForce<const D: usize> {
    /// Number of the first grain.
    pub grain: u32,
    /// The other side.
    pub partner: Partner,
    /// Force on the other side, N (per metre of depth).
    pub force: Vector<D>,
    /// Time that the contact has lasted, s; of cohesion only.
    pub age: f64,
    /// Moment that resists rolling, on the other side, over the effective radius, N (per metre of depth).
    pub rolling: f64,
}

impl<const D: usize> Dem<D> {
    /// How contacts bind each grain, by those that carried an impulse in the last sub-step.
    pub fn bonds(&self, out: &mut Bonds) {
        out.find(&self.particles, self.search.forces(&self.problem, self.memory.h));
    }

    /// Whether [`Self::contacts`] lists those of the last sub-step: not at the start, after a restart, and in a step
    /// in which grains left, until the next one.
    pub fn knows_contacts(&self) -> bool {
        self.known
    }

    /// Contacts of the last sub-step, also those that carry nothing; none after a restart until the next step.
    pub fn contacts(&self) -> impl Iterator<Item = Contact<D>> + '_ {
        let n = self.search.grid.grain_of.len();
        let h = self.memory.h;
        self.problem.contacts.iter().enumerate().map(move |(k, c)| Contact {
            grain: self.search.grid.grain_of[c.i as usize],
            partner: if (c.j as usize) < n {
                Partner::Grain(self.search.grid.grain_of[c.j as usize])
            } else {
                Partner::Wall(self.search.touches[c.j as usize - n].wall)
            },
            normal: c.normal,
            force: c.impulse / h,
            rolling: self.problem.rolling.get(k).map_or(0.0, |r| r.impulse.get() / h),
            gap: c.bias * h,
        })
    }

    /// Contacts that carry a force in the last sub-step, with the heat that flows from the other side to the first
    /// grain (W; zero without conduction).
    pub fn carriers(&self) -> impl Iterator<Item = (Contact<D>, f64)> + '_ {
        let wall = |wall: u32| self.walls[wall as usize].temperature.unwrap_or(0.0);
        let mut heats = self.conductor.fluxes(wall).peekable();
        let acting = self.contacts().filter(|c| c.force.iter().any(|f| *f != 0.0));
        acting.map(move |contact| {
            let other = match contact.partner {
                Partner::Grain(j) => j,
                Partner::Wall(wall) => WALL | wall,
            };
            // Not every contact conducts.
            let heat = heats.next_if(|(i, j, _)| (*i, *j) == (contact.grain, other));
            (contact, heat.map_or(0.0, |(.., heat)| heat))
        })
    }

    /// Lets the next step start from these forces: those of a bed that has settled before. Without them the forces of a
    /// bed that is at rest are sought from nothing, and it gives way a little meanwhile.
    pub fn start_from(&mut self, forces: &[ContactForce<D>]) {
        // Impulses of a step of one second; the next one takes its part.
        let records = || {
            forces.iter().map(|f| Record {
                i: f.grain,
                j: match f.partner {
                    Partner::Grain(j) => j,
                    Partner::Wall(wall) => WALL + wall,
                },
                impulse: f.force,
                age: f.age,
                rolling: f.rolling,
            })
        };
        self.memory.store(self.particles.len(), 1.0, self.beside(), records);
    }
}
