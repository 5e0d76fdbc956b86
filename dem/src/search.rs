//! From positions to the contact problem of a sub-step: who may meet, in which order, and how.

use crate::bodies::Bodies;
use crate::contact::Contact;
use crate::memory::{Memory, Record, WALL};
use crate::neighbours::Grid;
use crate::scene::{Scene, Touch};
use crate::solver::Problem;
use crate::space::Vector;
use crate::spread::{SKIN, Spread, diagonal};

/// Overlap, as a share of the radius, from which a contact that the search left out repeats the sub-step.
const MISSED: f64 = 1e-4;

/// Buffers of the search, kept from step to step.
#[derive(Default)]
pub(crate) struct Search<const D: usize> {
    pub grid: Grid<D>,
    spread: Spread<D>,
    /// Pairs of slots, or slot and `WALL` + number, tile by tile.
    pairs: Vec<[u32; 2]>,
    /// Contacts with walls, in the order of the bodies behind the grains.
    pub touches: Vec<Touch>,
    /// Age of each contact; empty without cohesion.
    pub ages: Vec<u16>,
    /// Walls near each coarsest cell: `wall_of[wall_starts[c] .. wall_starts[c + 1]]`.
    wall_starts: Vec<u32>,
    wall_of: Vec<u32>,
    wall_cells: Vec<(u32, u32)>,
    /// Scratch: colours used by each slot; the pairs of a tile and their colours; walls near one grain.
    used: Vec<u32>,
    unsorted: Vec<[u32; 2]>,
    colour: Vec<u8>,
    near: Vec<Near>,
}

/// A wall near a grain, and whether the nearest point is one of its ends.
#[derive(Clone, Copy)]
struct Near {
    wall: u32,
    share: f64,
    distance: f64,
}

impl<const D: usize> Search<D> {
    /// Bodies and contacts of a sub-step, warm from `memory`. `after` are the final velocities of all
    /// grains in each earlier attempt, which found some outside of what it had assumed.
    pub fn prepare(
        &mut self,
        scene: &Scene<D>,
        memory: &Memory<D>,
        after: &[Vector<D>],
        problem: &mut Problem<D>,
    ) {
        let p = scene.particles;
        let free = (0..p.len()).map(|i| expected(scene, i, scene.free_velocity(i)));
        let starts = p.velocity.iter().copied().chain(free);
        let walls = scene.placed.iter().flat_map(|w| w.velocity);
        let fastest = diagonal(starts.chain(walls).chain(after.iter().copied()));
        let large = p.radius.iter().fold(0.0, |a: f64, &r| a.max(r));
        // Slow grains get cells of one size, so that nothing is allocated in a bed that only trembles.
        let reach = (fastest * scene.h).max(0.1 * large);
        self.grid.build(&p.position, &p.radius, reach + SKIN * 2.0 * large);
        self.fill_bodies(scene, &mut problem.bodies);
        self.gather_velocities(scene, after, &problem.bodies);
        self.place_walls(scene, large);
        self.find_pairs(scene, problem);
        self.fill_contacts(scene, memory, problem);
    }

    /// One body per grain, in slot order, with its free velocity.
    fn fill_bodies(&self, scene: &Scene<D>, bodies: &mut Bodies<D>) {
        let p = scene.particles;
        bodies.clear();
        bodies.reserve(p.len(), p.rotation.is_some());
        for &i in &self.grid.order {
            bodies.push(&scene.free_velocity(i as usize), scene.mobility(i as usize));
        }
        if let Some(rotation) = &p.rotation {
            for &i in &self.grid.order {
                let (r, i) = (p.radius[i as usize], i as usize);
                bodies.push_spin(rotation.spin[i] * r, r * r / rotation.inertia[i]);
            }
        }
    }

    fn gather_velocities(&mut self, scene: &Scene<D>, after: &[Vector<D>], bodies: &Bodies<D>) {
        let p = scene.particles;
        self.spread.clear(self.grid.coarse_count());
        for (slot, &i) in self.grid.order.iter().enumerate() {
            let i = i as usize;
            let cell = self.grid.coarse_of(&p.position[i]);
            self.spread.add(cell, &p.velocity[i]);
            self.spread.add(cell, &expected(scene, i, bodies.velocity(slot)));
            for v in after.iter().skip(i).step_by(p.len()) {
                self.spread.add(cell, v);
            }
        }
    }

    /// Lists the walls near each cell, adds their velocities to its box, and closes the boxes.
    fn place_walls(&mut self, scene: &Scene<D>, large: f64) {
        self.wall_cells.clear();
        for (w, wall) in scene.placed.iter().enumerate() {
            // A wall matters to a grain that it may reach; twice the largest radius covers the range of a cell.
            let speed = wall.velocity[0].norm().max(wall.velocity[1].norm());
            let range = 2.0 * large * (1.0 + SKIN) + speed * scene.h;
            let (cells, spread) = (&mut self.wall_cells, &mut self.spread);
            self.grid.near_segment(&wall.points, range, |cell| {
                cells.push((cell as u32, w as u32));
                spread.add(cell, &wall.velocity[0]);
                spread.add(cell, &wall.velocity[1]);
            });
        }
        self.spread.close(&self.grid);
        // A fast grain may reach further: the list must cover the range of every cell.
        let reach = (0..self.grid.coarse_count()).fold(0.0, |a: f64, c| a.max(self.spread.speed(c)));
        let range = large * (1.0 + SKIN) + reach * scene.h;
        self.wall_cells.clear();
        for (w, wall) in scene.placed.iter().enumerate() {
            let cells = &mut self.wall_cells;
            self.grid.near_segment(&wall.points, range, |cell| cells.push((cell as u32, w as u32)));
        }
        self.wall_cells.sort_unstable();
        self.wall_starts.clear();
        self.wall_starts.resize(if scene.placed.is_empty() { 0 } else { self.grid.coarse_count() + 1 }, 0);
        self.wall_of.clear();
        for &(cell, wall) in &self.wall_cells {
            self.wall_starts[cell as usize + 1] += 1;
            self.wall_of.push(wall);
        }
        for c in 1..self.wall_starts.len() {
            self.wall_starts[c] += self.wall_starts[c - 1];
        }
    }

    /// All pairs within range, tile by tile; within a tile in an order that keeps neighbours in the list apart.
    fn find_pairs(&mut self, scene: &Scene<D>, problem: &mut Problem<D>) {
        let p = scene.particles;
        let tiles = &mut problem.tiles;
        tiles.colours.clone_from(&self.grid.colours);
        tiles.starts.clear();
        tiles.starts.push(0);
        self.used.clear();
        self.used.resize(p.len(), 0);
        let mut pairs = std::mem::take(&mut self.pairs);
        pairs.clear();
        for tile in 0..self.grid.tiles.len() {
            let first = pairs.len();
            let (grid, spread, near) = (&self.grid, &self.spread, &mut self.near);
            grid.each_in_tile(tile, |cell, a, others| {
                let i = grid.order[a] as usize;
                let range = spread.speed(cell) * scene.h;
                if others.is_none() && !self.wall_starts.is_empty() && !p.held(i) {
                    let walls = self.wall_starts[cell] as usize..self.wall_starts[cell + 1] as usize;
                    near_walls(scene, i, &self.wall_of[walls], range, near);
                    pairs.extend(near.iter().map(|n| [a as u32, WALL + n.wall]));
                }
                for b in others.into_iter().flatten() {
                    let j = grid.order[b] as usize;
                    let reach = (p.radius[i] + p.radius[j]) * (1.0 + SKIN) + range;
                    let near = (p.position[j] - p.position[i]).norm_squared() < reach * reach;
                    if near && !(p.held(i) && p.held(j)) {
                        pairs.push([a as u32, b as u32]);
                    }
                }
            });
            self.spread_out(&mut pairs[first..]);
            tiles.starts.push(pairs.len() as u32);
        }
        self.pairs = pairs;
    }

    /// Orders the pairs of a tile by greedy colours, so that successive contacts rarely share a grain: the
    /// processor then works on several at once instead of waiting for the last one's velocities.
    fn spread_out(&mut self, pairs: &mut [[u32; 2]]) {
        let mut places = [0usize; 33];
        self.colour.clear();
        self.unsorted.clear();
        self.unsorted.extend_from_slice(pairs);
        for pair in pairs.iter() {
            let slots = || pair.iter().filter(|s| **s & WALL == 0);
            let taken = slots().fold(0, |t, s| t | self.used[*s as usize]);
            let colour = (!taken).trailing_zeros().min(31);
            slots().for_each(|s| self.used[*s as usize] |= 1 << colour);
            places[colour as usize + 1] += 1;
            self.colour.push(colour as u8);
        }
        for k in 1..places.len() {
            places[k] += places[k - 1];
        }
        for (pair, colour) in self.unsorted.iter().zip(&self.colour) {
            pairs[places[*colour as usize]] = *pair;
            places[*colour as usize] += 1;
            pair.iter().filter(|s| **s & WALL == 0).for_each(|s| self.used[*s as usize] = 0);
        }
    }

    /// The contacts of all pairs, warm-started, with one immobile body for each contact with a wall.
    fn fill_contacts(&mut self, scene: &Scene<D>, memory: &Memory<D>, problem: &mut Problem<D>) {
        let ratio = if memory.h > 0.0 { scene.h / memory.h } else { 0.0 };
        self.touches.clear();
        self.ages.clear();
        problem.contacts.clear();
        problem.cohesion.clear();
        problem.friction = scene.has_friction();
        crate::reserve(&mut problem.contacts, self.pairs.len());
        let walls = self.pairs.iter().filter(|p| p[1] & WALL != 0).count();
        problem.bodies.reserve(self.grid.order.len() + walls, scene.particles.rotation.is_some());
        for &[a, b] in &self.pairs {
            let i = self.grid.order[a as usize];
            let (contact, j, gap) = if b & WALL == 0 {
                let j = self.grid.order[b as usize];
                let (contact, gap) = scene.between_grains([a, b], [i, j], &problem.bodies);
                (contact, j, gap)
            } else {
                let (contact, touch, gap) = scene.with_wall([a, b], i, &mut problem.bodies);
                self.touches.push(touch);
                (contact, b, gap)
            };
            let (impulse, age) = memory.find(i, j);
            let mut contact = contact;
            contact.impulse = impulse * ratio;
            if let Some(law) = &scene.settings.cohesion {
                let age = if gap <= SKIN * 0.1 * scene.particles.radius[i as usize] { age } else { 0 };
                let glued = j & WALL == 0 && age >= law.steps && scene.sticky(i) && scene.sticky(j);
                self.ages.push(age);
                problem.cohesion.push(if glued { law.force * scene.h } else { 0.0 });
            }
            problem.contacts.push(contact);
        }
    }

    /// Whether no contact was missed: all final velocities keep within what the search assumed, or those
    /// grains that do not meet nobody on their way.
    pub fn holds(&self, scene: &Scene<D>, problem: &Problem<D>) -> bool {
        let p = scene.particles;
        self.grid.order.iter().enumerate().all(|(slot, &i)| {
            let i = i as usize;
            let cell = self.grid.coarse_of(&p.position[i]);
            let v = problem.bodies.velocity(slot);
            self.spread.allows(cell, &v, p.radius[i], scene.h) || self.runs_free(scene, problem, i, &v)
        })
    }

    /// Whether grain i, at a velocity that the search did not expect, ends the sub-step without overlap with anything
    /// that was beyond the skin at its start. (What was nearer has a contact.)
    fn runs_free(&self, scene: &Scene<D>, problem: &Problem<D>, i: usize, v: &Vector<D>) -> bool {
        let p = scene.particles;
        let (x, r) = (p.position[i], p.radius[i]);
        if v.norm() * scene.h > 0.25 * self.grid.width() {
            return false;
        }
        let end = x + v * scene.h;
        let mut free = true;
        self.grid.around(&x, |slot| {
            let j = self.grid.order[slot] as usize;
            let reach = r + p.radius[j];
            let there = p.position[j] + problem.bodies.velocity(slot) * scene.h;
            let overlap = reach - (there - end).norm();
            let was_far = (p.position[j] - x).norm() > reach * (1.0 + SKIN);
            free &= !(was_far && overlap > MISSED * r.min(p.radius[j]));
        });
        free && scene.placed.iter().all(|wall| {
            let moved = wall.after(scene.h);
            let was_far = (wall.point(wall.nearest(&x)) - x).norm() > r * (1.0 + SKIN);
            !was_far || (moved.point(moved.nearest(&end)) - end).norm() > r * (1.0 - MISSED)
        })
    }

    /// Number of the second side of a contact: a grain, or `WALL` + number.
    fn partner(&self, c: &Contact<D>) -> u32 {
        let n = self.grid.order.len();
        let j = c.j as usize;
        if j < n { self.grid.order[j] } else { WALL + self.touches[j - n].wall }
    }

    /// Grain, partner, normal and force on the partner of the contacts that carry one.
    pub fn forces<'a>(
        &'a self,
        problem: &'a Problem<D>,
        h: f64,
    ) -> impl Iterator<Item = (u32, u32, Vector<D>, Vector<D>)> + 'a {
        let acting = problem.contacts.iter().filter(|c| c.acts());
        acting.map(move |c| (self.grid.order[c.i as usize], self.partner(c), c.normal, c.impulse / h))
    }

    /// The contacts of the problem by identity; `aging` adds one to the age of those that touch.
    pub fn records<'a>(
        &'a self,
        problem: &'a Problem<D>,
        aging: bool,
    ) -> impl Iterator<Item = Record<D>> + 'a {
        problem.contacts.iter().enumerate().filter_map(move |(k, c)| {
            let (i, j) = (self.grid.order[c.i as usize], self.partner(c));
            let age = self.ages.get(k).map_or(0, |a| a.saturating_add(aging as u16));
            (c.acts() || age > 0).then_some(Record { i, j, impulse: c.impulse, age })
        })
    }
}

/// The free velocity of grain i, no faster than sub-steps want it. Where there were not enough of them, everyone would have a contact
/// with everyone else on its way; in a bed at rest nobody goes it, and who does is found out afterwards.
fn expected<const D: usize>(scene: &Scene<D>, i: usize, free: Vector<D>) -> Vector<D> {
    free.cap_magnitude(scene.settings.max_travel * scene.particles.radius[i] / scene.h)
}

/// Walls whose gap to grain i is within range, each corner once.
///
/// A grain that meets the end of one wall while another wall passes through that end would meet the same
/// point twice, or stumble over the joint of two collinear walls: an end counts only if no other wall is nearer (or as
/// near, with a smaller number).
fn near_walls<const D: usize>(scene: &Scene<D>, i: usize, walls: &[u32], range: f64, near: &mut Vec<Near>) {
    let (x, r) = (&scene.particles.position[i], scene.particles.radius[i]);
    near.clear();
    for &wall in walls {
        let placed = &scene.placed[wall as usize];
        let share = placed.nearest(x);
        let distance = (placed.point(share) - x).norm();
        if distance < r * (1.0 + SKIN) + range {
            near.push(Near { wall, share, distance });
        }
    }
    if near.len() < 2 {
        return;
    }
    let all = std::mem::take(near);
    let hidden = |k: usize| {
        let n = all[k];
        if n.share > 0.0 && n.share < 1.0 {
            return false;
        }
        let end = scene.placed[n.wall as usize].point(n.share);
        all.iter().enumerate().any(|(l, other)| {
            let through = &scene.placed[other.wall as usize];
            let passes = (through.point(through.nearest(&end)) - end).norm() < 1e-6 * r;
            let nearer = other.distance < n.distance * (1.0 - 1e-12)
                || (other.distance <= n.distance * (1.0 + 1e-12) && l < k);
            l != k && passes && nearer
        })
    };
    // At most a handful of walls meet a grain.
    let mut keep = [true; 16];
    (0..all.len().min(16)).for_each(|k| keep[k] = !hidden(k));
    *near = all;
    let mut k = 0;
    near.retain(|_| {
        k += 1;
        keep.get(k - 1).copied().unwrap_or(true)
    });
}
