//! The contacts of pairs, warm from the last sub-step or cold from rest.

use super::{Chunk, Search};
use crate::bodies::Bodies;
use crate::contact::Contact;
use crate::memory::{Memory, WALL};
use crate::repair::LEFT;
use crate::scene::{Scene, Touch};
use crate::solver::Problem;
use crate::space::Vector;
use crate::velocity_bounds::SKIN;

impl<const D: usize> Search<D> {
    /// The contacts of all pairs, warm-started.
    pub(super) fn fill_contacts(&mut self, scene: &Scene<D>, memory: &Memory<D>, problem: &mut Problem<D>) {
        self.touch_walls(scene, &mut problem.bodies);
        let count = self.pairs.len();
        let from_rest = memory.h == 0.0 && scene.particles.velocity.iter().all(|v| v.norm() == 0.0);
        problem.friction = scene.has_friction();
        crate::reserve(&mut problem.contacts, count);
        problem.contacts.resize_with(count, Contact::default);
        let glued = if scene.settings.cohesion.is_some() { count } else { 0 };
        problem.cohesion.resize(glued, 0.0);
        self.ages.resize(glued, 0.0);
        self.sliding = scene.settings.cohesion.and_then(|cohesion| cohesion.sliding);
        let (grain_of, touches) = (&self.grid.grain_of, &self.touches);
        let filler = Filler { scene, memory, bodies: &problem.bodies, grain_of, touches, from_rest };
        let slices = (&mut problem.contacts[..], &mut problem.cohesion[..], &mut self.ages[..]);
        filler.fill(&mut self.chunks, 0, &self.pairs, slices);
        self.fill_rolling(scene, memory, problem);
        problem.overlaps.clear();
        self.chunks.iter().for_each(|chunk| problem.overlaps.extend_from_slice(&chunk.overlaps));
    }

    /// One immobile body for each contact with a wall; its pair then has the number of the touch.
    fn touch_walls(&mut self, scene: &Scene<D>, bodies: &mut Bodies<D>) {
        let walls = self.pairs.iter().filter(|p| p[1] & WALL != 0).count();
        bodies.reserve(self.grid.grain_of.len() + walls, bodies.spins());
        self.touches.clear();
        for [a, b] in self.pairs.iter_mut().filter(|pair| pair[1] & WALL != 0) {
            let (wall, i) = (*b & !WALL, self.grid.grain_of[*a as usize] as usize);
            let touch = Touch { wall, meeting: scene.meet_wall(i, wall) };
            scene.push_wall(&touch, bodies);
            *b = WALL + self.touches.len() as u32;
            self.touches.push(touch);
        }
    }

    /// Resistance to rolling at the contacts, warm-started; none if no contact has it or nothing spins.
    fn fill_rolling(&self, scene: &Scene<D>, memory: &Memory<D>, problem: &mut Problem<D>) {
        problem.rolling.clear();
        if !scene.has_rolling() || !problem.bodies.spins() {
            return;
        }
        crate::reserve(&mut problem.rolling, problem.contacts.len());
        let ratio = if memory.h > 0.0 { scene.h / memory.h } else { 0.0 };
        for c in &problem.contacts {
            let (i, j) = (self.grid.grain_of[c.i as usize], self.partner(c));
            let rolling = scene.rolling([c.i, c.j], [i, j], &problem.bodies);
            rolling.impulse.set(memory.find(i, j).2 * ratio);
            problem.rolling.push(rolling);
        }
    }
}

/// What contacts are made from.
struct Filler<'a, const D: usize> {
    scene: &'a Scene<'a, D>,
    memory: &'a Memory<D>,
    bodies: &'a Bodies<D>,
    grain_of: &'a [u32],
    touches: &'a [Touch<D>],
    /// Whether this is the first sub-step of grains at rest.
    from_rest: bool,
}

/// Contacts, their cohesion and their ages; the last two are empty without cohesion.
type Slices<'a, const D: usize> = (&'a mut [Contact<D>], &'a mut [f64], &'a mut [f64]);

impl<const D: usize> Filler<'_, D> {
    /// The contacts of these pairs, the first of which has a number, chunk by chunk.
    fn fill(&self, chunks: &mut [Chunk], first: usize, pairs: &[[u32; 2]], slices: Slices<D>) {
        let (contacts, cohesion, ages) = slices;
        if let [chunk] = chunks {
            chunk.overlaps.clear();
            for (k, pair) in pairs.iter().enumerate() {
                let glue = cohesion.get_mut(k).zip(ages.get_mut(k));
                let overlap = self.contact(*pair, &mut contacts[k], glue);
                chunk.overlaps.extend(overlap.map(|gap| ((first + k) as u32, gap)));
            }
            return;
        }
        let half = chunks.len() / 2;
        let cut = pairs.len() * half / chunks.len();
        let (left, right) = chunks.split_at_mut(half);
        let (a, b) = pairs.split_at(cut);
        let (contacts_a, contacts_b) = contacts.split_at_mut(cut);
        let (cohesion_a, cohesion_b) = cohesion.split_at_mut(cut.min(cohesion.len()));
        let (ages_a, ages_b) = ages.split_at_mut(cut.min(ages.len()));
        rayon::join(
            || self.fill(left, first, a, (contacts_a, cohesion_a, ages_a)),
            || self.fill(right, first + cut, b, (contacts_b, cohesion_b, ages_b)),
        );
    }

    /// One contact. Returns its gap over the smaller radius if its grains overlap by more than may stay.
    fn contact(
        &self,
        [a, b]: [u32; 2],
        contact: &mut Contact<D>,
        glue: Option<(&mut f64, &mut f64)>,
    ) -> Option<f64> {
        let (scene, radius) = (self.scene, &self.scene.particles.radius);
        let i = self.grain_of[a as usize];
        let (j, gap, smaller);
        if b & WALL == 0 {
            j = self.grain_of[b as usize];
            (*contact, gap) = scene.between_grains([a, b], [i, j], self.bodies);
            smaller = radius[i as usize].min(radius[j as usize]);
        } else {
            let touch = &self.touches[(b & !WALL) as usize];
            j = WALL + touch.wall;
            let slot = self.grain_of.len() as u32 + (b & !WALL);
            (*contact, gap) = scene.with_wall([a, slot], i, touch, self.bodies);
            smaller = radius[i as usize];
        }
        let (impulse, age, _) = self.memory.find(i, j);
        let ratio = if self.memory.h > 0.0 { scene.h / self.memory.h } else { 0.0 };
        contact.impulse = if self.from_rest { cold_start(scene, i, j, contact) } else { impulse * ratio };
        if let (Some((cohesion, kept)), Some(law)) = (glue, &scene.settings.cohesion) {
            let age = if gap <= SKIN * 0.1 * smaller { age } else { 0.0 };
            let glued = j & WALL == 0 && age > 0.0 && age >= law.age && scene.sticky(i) && scene.sticky(j);
            let force = || law.force * scene.cohesion_at(i, contact);
            (*cohesion, *kept) = (if glued { force() * scene.h } else { 0.0 }, age);
        }
        (gap < -LEFT * smaller).then_some(gap / smaller)
    }
}

/// Impulse of a contact in the first sub-step of grains that start from rest: it stops what forces would let close it
/// in the sub-step, if either side did not move. In a bed that starts from rest it is far too small deep down, but
/// where it acts it is right; sizes are found soon.
fn cold_start<const D: usize>(scene: &Scene<D>, i: u32, j: u32, contact: &Contact<D>) -> Vector<D> {
    let given = |i: u32| {
        let p = scene.particles;
        let grain = i & WALL == 0 && !p.held(i as usize);
        if grain {
            (scene.free_velocity(i as usize) - p.velocity[i as usize]).dot(&contact.normal).abs()
        } else {
            0.0
        }
    };
    let closing = 0.5 * (given(i) + given(j));
    if contact.bias < closing { contact.normal * (closing * contact.mass_n) } else { Vector::zeros() }
}
