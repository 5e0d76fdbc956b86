//! The contacts of the last sub-step and their forces, for output and for another run.

use super::Dem;
use crate::Vector;
use crate::bonds::Bonds;
use crate::heat::Conductor;
use crate::memory::{Record, WALL};
use crate::search::Search;
use crate::solver::Problem;
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

/// Number of a grain that is no longer there.
pub(super) const GONE: u32 = u32::MAX;

/// The contacts of the last sub-step, put aside when grains came or left after it.
pub(super) struct Last<const D: usize> {
    pub search: Search<D>,
    pub problem: Problem<D>,
    pub conductor: Conductor,
    /// Number that each grain of that sub-step has now, or [`GONE`].
    pub number: Vec<u32>,
}

impl<const D: usize> Dem<D> {
    /// How contacts bind each grain, by those that carried an impulse in the last sub-step.
    pub fn bonds(&self, out: &mut Bonds) {
        out.find(&self.particles, self.search.forces(&self.problem, self.memory.h));
    }

    /// Whether [`Self::contacts`] lists those of the last sub-step: not at the start and after a restart, until the
    /// next step.
    pub fn knows_contacts(&self) -> bool {
        self.known
    }

    /// Where the contacts of the last sub-step are.
    fn last(&self) -> (&Search<D>, &Problem<D>, &Conductor) {
        self.last.as_ref().map_or((&self.search, &self.problem, &self.conductor), |last| {
            (&last.search, &last.problem, &last.conductor)
        })
    }

    /// The number that a grain of the last sub-step has now, if it is still there.
    fn now(&self, grain: u32) -> Option<u32> {
        let number = self.last.as_ref().map_or(grain, |last| last.number[grain as usize]);
        (number != GONE).then_some(number)
    }

    /// Contacts of the last sub-step between those that are still there, also contacts that carry nothing; none after
    /// a restart until the next step.
    pub fn contacts(&self) -> impl Iterator<Item = Contact<D>> + '_ {
        let (search, problem, _) = self.last();
        let grain_of = &search.grid.grain_of;
        let h = self.memory.h;
        problem.contacts.iter().enumerate().filter_map(move |(k, c)| {
            let partner = match grain_of.get(c.j as usize) {
                Some(grain) => Partner::Grain(self.now(*grain)?),
                None => Partner::Wall(search.touches[c.j as usize - grain_of.len()].wall),
            };
            Some(Contact {
                grain: self.now(grain_of[c.i as usize])?,
                partner,
                normal: c.normal,
                force: c.impulse / h,
                rolling: problem.rolling.get(k).map_or(0.0, |r| r.impulse.get() / h),
                gap: c.bias * h,
            })
        })
    }

    /// Contacts that carry a force in the last sub-step, with the heat that flows from the other side to the first
    /// grain (W; zero without conduction).
    pub fn carriers(&self) -> impl Iterator<Item = (Contact<D>, f64)> + '_ {
        let wall = |wall: u32| self.walls[wall as usize].temperature.unwrap_or(0.0);
        let still = |(i, j, heat): (u32, u32, f64)| {
            let partner = if j & WALL == 0 { Partner::Grain(self.now(j)?) } else { Partner::Wall(j & !WALL) };
            Some((self.now(i)?, partner, heat))
        };
        let mut heats = self.last().2.fluxes(wall).filter_map(still).peekable();
        let acting = self.contacts().filter(|c| c.force.iter().any(|f| *f != 0.0));
        acting.map(move |contact| {
            // Not every contact conducts.
            let heat =
                heats.next_if(|(grain, partner, _)| (*grain, *partner) == (contact.grain, contact.partner));
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
