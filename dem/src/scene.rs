//! One sub-step as it starts: free motion of the grains, and the contacts between them and with walls.

use crate::approach::{self, Meeting};
use crate::bodies::Bodies;
use crate::contact::Contact;
use crate::laws::{self, Law, Laws};
use crate::memory::WALL;
use crate::parallel;
use crate::rolling::Rolling;
use crate::space::Vector;
use crate::walls::{Placed, Wall};
use crate::{Halo, Heat, Load, Material, Particles, Settings};

/// What a sub-step starts from.
pub(crate) struct Scene<'a, const D: usize> {
    pub particles: &'a Particles<D>,
    pub materials: &'a [Material],
    pub walls: &'a [Wall<D>],
    pub placed: &'a [Placed<D>],
    pub settings: &'a Settings<D>,
    pub laws: Option<&'a Laws>,
    pub load: &'a Load<'a, D>,
    pub h: f64,
    /// Share of the velocity that forces bring and contacts take, below which what is left counts as zero.
    pub rest: f64,
}

/// A contact with a wall: which one, and how.
#[derive(Clone, Copy)]
pub(crate) struct Touch<const D: usize> {
    pub wall: u32,
    pub meeting: Meeting<D>,
}

impl<const D: usize> Scene<'_, D> {
    /// m + m_a, with the added mass.
    fn inertia(&self, i: usize) -> f64 {
        self.particles.mass[i] + self.load.added.get(i).copied().unwrap_or(0.0)
    }

    /// 1 / (m + m_a + gamma h).
    pub fn mobility(&self, i: usize) -> f64 {
        1.0 / (self.inertia(i) + self.load.drag.get(i).copied().unwrap_or(0.0) * self.h)
    }

    /// Velocity after forces, gravity and implicit drag, before contacts:
    /// ((m + m_a) v + h (F + m g)) / (m + m_a + gamma h).
    /// A held grain (infinite mass) keeps its velocity.
    pub fn free_velocity(&self, i: usize) -> Vector<D> {
        let p = &self.particles;
        if p.held(i) {
            return p.velocity[i];
        }
        let mut momentum = (p.velocity[i] + self.settings.gravity * self.h) * p.mass[i];
        if let Some(added) = self.load.added.get(i) {
            momentum += p.velocity[i] * *added;
        }
        let force = self.load.force.get(i).copied().unwrap_or_else(Vector::zeros);
        (momentum + force * self.h) * self.mobility(i)
    }

    /// Sets free velocities and the spins of now, for grains in this order.
    pub fn set_free(&self, grain_of: &[u32], bodies: &Bodies<D>) {
        for (slot, &i) in grain_of.iter().enumerate() {
            bodies.set_velocity(slot, &self.free_velocity(i as usize));
            if let Some(rotation) = &self.particles.rotation {
                bodies.set_surface(slot, rotation.spin[i as usize] * self.particles.radius[i as usize]);
            }
        }
    }

    /// Energy of the difference between the velocities of `bodies` and those without contacts, J.
    pub fn pushed(&self, grain_of: &[u32], bodies: &Bodies<D>) -> f64 {
        energy(grain_of, bodies, |i, v| (v - self.free_velocity(i)).norm_squared())
    }

    /// Energy of the changes of the velocities since the start of the sub-step, J, each grain's no larger than that of
    /// what its contacts have changed: what falls freely has no part in the errors of contacts.
    pub fn changed(&self, grain_of: &[u32], bodies: &Bodies<D>) -> f64 {
        energy(grain_of, bodies, |i, v| {
            let (before, free) = (self.particles.velocity[i], self.free_velocity(i));
            (v - before).norm_squared().min((v - free).norm_squared())
        })
    }

    /// Takes the velocities of grains that rest, but not those that are marked.
    pub fn stop_resting(&self, grain_of: &[u32], bodies: &Bodies<D>, moving: &[bool]) {
        for (slot, &i) in grain_of.iter().enumerate().filter(|(slot, _)| !moving[*slot]) {
            let surface = if bodies.spins() { bodies.surface(slot) } else { 0.0 };
            if self.rests(i as usize, &bodies.velocity(slot), surface) {
                bodies.set_velocity(slot, &Vector::zeros());
                if bodies.spins() {
                    bodies.set_surface(slot, 0.0);
                }
            }
        }
    }

    /// Whether a grain rests at this velocity and speed of its surface, m/s: contacts take all that forces bring in the
    /// sub-step but a small share. No velocity at all obeys the laws of the contacts
    /// then, with the same impulses; only that share of the forces is not balanced.
    pub fn rests(&self, i: usize, velocity: &Vector<D>, surface: f64) -> bool {
        let free = self.free_velocity(i);
        let brought = (free - self.particles.velocity[i]).norm_squared();
        let most = self.rest.powi(2) * brought.min((velocity - free).norm_squared());
        velocity.norm_squared() <= most && surface * surface <= most
    }

    /// Marks the bodies that contacts push and that do not rest. Returns the share that they have of the energy that
    /// forces bring to all; where these bring none, all of it.
    pub fn mark_moving(&self, grain_of: &[u32], bodies: &Bodies<D>, moving: &mut Vec<bool>) -> f64 {
        moving.resize(grain_of.len(), false);
        parallel::each_chunk(moving, &|first, marks| {
            for (slot, mark) in (first..).zip(marks) {
                let (i, v) = (grain_of[slot] as usize, bodies.velocity(slot));
                let surface = if bodies.spins() { bodies.surface(slot) } else { 0.0 };
                let pushed = bodies.mobility(slot) > 0.0 && v != self.free_velocity(i);
                *mark = pushed && !self.rests(i, &v, surface);
            }
        });
        if !moving.contains(&true) {
            return 0.0;
        }
        let brought = |slot: usize| {
            let (i, mobility) = (grain_of[slot] as usize, bodies.mobility(slot));
            let by_forces = self.free_velocity(i) - self.particles.velocity[i];
            if mobility > 0.0 { by_forces.norm_squared() / mobility } else { 0.0 }
        };
        let all = 0..grain_of.len();
        let brought_to_all = parallel::sum(all.clone(), &brought);
        if brought_to_all == 0.0 {
            return 1.0;
        }
        parallel::sum(all, &|slot| if moving[slot] { brought(slot) } else { 0.0 }) / brought_to_all
    }

    /// A, W/K.
    fn transfer(&self, i: usize) -> f64 {
        self.load.transfer.get(i).copied().unwrap_or(0.0)
    }

    /// C/h + A, W/K: what grain i resists a change of its temperature with.
    pub fn thermal_inertia(&self, i: usize, capacity: f64) -> f64 {
        capacity / self.h + self.transfer(i)
    }

    /// Temperature after the heat from outside and `conducted` (W): (C/h T + Q + q) / (C/h + A).
    pub fn warmed(&self, i: usize, heat: &Heat, conducted: f64) -> f64 {
        let before = heat.temperature[i];
        let given = self.load.heat.get(i).copied().unwrap_or(0.0);
        before + (given + conducted - self.transfer(i) * before) / self.thermal_inertia(i, heat.capacity[i])
    }

    pub fn has_friction(&self) -> bool {
        match self.laws {
            Some(laws) => laws.have_friction(),
            None => {
                let of_grains = self.materials.iter().any(|m| m.friction > 0.0);
                of_grains || self.walls.iter().any(|w| w.friction > 0.0)
            }
        }
    }

    pub fn has_rolling(&self) -> bool {
        match self.laws {
            Some(laws) => laws.have_rolling(),
            None => {
                let of_grains = self.materials.iter().any(|m| m.rolling > 0.0);
                of_grains || self.walls.iter().any(|w| w.rolling > 0.0)
            }
        }
    }

    /// Whether anything rebounds.
    pub fn has_restitution(&self) -> bool {
        let of_pairs = self.settings.pairs.iter().any(|pair| pair.restitution.is_some_and(|e| e > 0.0));
        let of_grains = self.materials.iter().any(|material| material.restitution > 0.0);
        of_pairs || of_grains || self.walls.iter().any(|wall| wall.restitution > 0.0)
    }

    /// Restitution between grain i and grain j, or the wall of number `j` less [`WALL`].
    pub fn restitution(&self, i: u32, j: u32) -> f64 {
        let material = |i: u32| self.particles.material[i as usize];
        match j & WALL {
            0 => self.law_between(material(i), material(j))[0],
            _ => self.law_at(j & !WALL, material(i))[0],
        }
    }

    pub fn sticky(&self, i: u32) -> bool {
        self.load.cohesive.get(i as usize).copied().unwrap_or(true)
    }

    /// Share of the adhesive force that a contact of grain i has where it touches.
    pub fn cohesion_at(&self, i: u32, contact: &Contact<D>) -> f64 {
        let (p, i) = (self.particles, i as usize);
        let of = |halo: &Halo<D>| {
            let place = p.position[i] + contact.normal * p.radius[i];
            halo.share(&self.settings.period.nearest(place - halo.centre))
        };
        self.load.halo.as_ref().map_or(1.0, of)
    }

    fn law_between(&self, a: u8, b: u8) -> Law {
        match self.laws {
            Some(laws) => laws.of_grains(a, b),
            None => laws::between(&self.materials[a as usize], &self.materials[b as usize]),
        }
    }

    fn law_at(&self, w: u32, material: u8) -> Law {
        let wall = &self.walls[w as usize];
        match self.laws {
            Some(laws) => laws.of_wall(w, material),
            None => [wall.restitution, wall.friction, wall.rolling],
        }
    }

    /// Resistance to rolling between grain i and grain j, or the wall of number `j` less [`WALL`].
    pub fn rolling(&self, slots: [u32; 2], [i, j]: [u32; 2], bodies: &Bodies<D>) -> Rolling {
        let (p, i) = (self.particles, i as usize);
        let (r, material) = (p.radius[i], p.material[i]);
        if j & WALL != 0 {
            let w = j & !WALL;
            let drift = r * self.placed[w as usize].spin();
            return Rolling::new(bodies, slots, [1.0, 0.0], drift, self.law_at(w, material)[2]);
        }
        let (other, of) = (p.radius[j as usize], p.material[j as usize]);
        let share = [other / (r + other), r / (r + other)];
        Rolling::new(bodies, slots, share, 0.0, self.law_between(material, of)[2])
    }

    pub fn between_grains(&self, slots: [u32; 2], [i, j]: [u32; 2], bodies: &Bodies<D>) -> (Contact<D>, f64) {
        let (p, i, j) = (self.particles, i as usize, j as usize);
        let arm = self.settings.period.nearest(p.position[j] - p.position[i]);
        let (r, other) = (p.radius[i], p.radius[j]);
        let relative = p.velocity[j] - p.velocity[i];
        let (normal, gap) = approach::of_discs(arm, relative * self.h, r.min(other), r + other);
        let (a, b) = (p.material[i], p.material[j]);
        let before = relative.dot(&normal);
        let law = self.law_between(a, b);
        let contact = self.contact(slots, normal, gap, before, law, bodies);
        (contact, gap)
    }

    /// The image of a point that may touch a wall.
    pub fn beside(&self, wall: u32, x: &Vector<D>) -> Vector<D> {
        self.settings.period.image(*x, &self.placed[wall as usize].point(0.5))
    }

    /// How grain i meets a wall.
    pub fn meet_wall(&self, i: usize, wall: u32) -> Meeting<D> {
        let placed = &self.placed[wall as usize];
        let centre = self.beside(wall, &self.particles.position[i]);
        let way = (self.particles.velocity[i] - placed.velocity_at(placed.nearest(&centre))) * self.h;
        let endless = self.settings.period.spans(&placed.points);
        approach::with_wall(placed, (&centre, self.particles.radius[i]), &way, endless)
    }

    /// Adds the body of a wall where a grain touches it.
    pub fn push_wall(&self, touch: &Touch<D>, bodies: &mut Bodies<D>) {
        bodies.push(&self.placed[touch.wall as usize].velocity_at(touch.meeting.share), 0.0);
        if bodies.spins() {
            bodies.push_spin(0.0, 0.0);
        }
    }

    /// The contact of grain i with a wall whose body is there, and its gap.
    pub fn with_wall(
        &self,
        slots: [u32; 2],
        i: u32,
        touch: &Touch<D>,
        bodies: &Bodies<D>,
    ) -> (Contact<D>, f64) {
        let (p, i, Meeting { normal, gap, .. }) = (self.particles, i as usize, touch.meeting);
        let before = (bodies.velocity(slots[1] as usize) - p.velocity[i]).dot(&normal);
        let law = self.law_at(touch.wall, p.material[i]);
        let contact = self.contact(slots, normal, gap, before, law, bodies);
        (contact, gap)
    }

    /// Newton's law u_n' = -e u_n holds only for an impact: the gap closes within the sub-step if the contact
    /// does nothing. Then u_n' + e u_n >= 0 takes the place of u_n' + gap/h >= 0.
    fn contact(
        &self,
        [i, j]: [u32; 2],
        normal: Vector<D>,
        gap: f64,
        before: f64,
        [restitution, friction, _]: Law,
        bodies: &Bodies<D>,
    ) -> Contact<D> {
        let (a, b) = (i as usize, j as usize);
        let mut bias = gap.max(0.0) / self.h;
        let free = (bodies.velocity(b) - bodies.velocity(a)).dot(&normal);
        if restitution > 0.0 && before < 0.0 && free + bias < 0.0 {
            bias = bias.min(restitution * before);
        }
        let w = bodies.mobility(a) + bodies.mobility(b);
        let spin = if bodies.spins() { bodies.spin_mobility(a) + bodies.spin_mobility(b) } else { 0.0 };
        Contact {
            normal,
            impulse: Vector::zeros(),
            bias,
            mass_n: 1.0 / w,
            mass_t: 1.0 / (w + spin),
            friction,
            i,
            j,
        }
    }
}

/// Energy of grains with these squares of speeds, by the number of a grain and its velocity in `bodies`, J.
fn energy<const D: usize>(
    grain_of: &[u32],
    bodies: &Bodies<D>,
    square: impl Fn(usize, Vector<D>) -> f64 + Sync,
) -> f64 {
    parallel::sum(0..grain_of.len(), &|slot| {
        let mobility = bodies.mobility(slot);
        let moves = mobility > 0.0;
        if moves { 0.5 * square(grain_of[slot] as usize, bodies.velocity(slot)) / mobility } else { 0.0 }
    })
}
