//! From positions to the contact problem of a sub-step: who may meet, in which order, and how.

use crate::approach::Meeting;
use crate::bodies::Bodies;
use crate::contact::Contact;
use crate::memory::{Memory, Record, WALL};
use crate::neighbours::{Grid, Tile};
use crate::parallel;
use crate::penetration::{crossed, nearest_on_way};
use crate::rolling::Rolling;
use crate::scene::{Scene, Touch};
use crate::solver::{FORK, Problem};
use crate::space::Vector;
use crate::velocity_bounds::{SKIN, VelocityBounds, diagonal};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

mod contacts;

/// Overlap, as a share of the radius, from which a contact that the search left out repeats the sub-step.
const MISSED: f64 = 1e-4;

/// Buffers of the search, kept from step to step.
#[derive(Default)]
pub(crate) struct Search<const D: usize> {
    pub grid: Grid<D>,
    bounds: VelocityBounds<D>,
    /// Pairs of slots, or slot and `WALL` + number, tile by tile.
    pairs: Vec<[u32; 2]>,
    /// Contacts with walls, in the order of the bodies behind the grains.
    pub touches: Vec<Touch<D>>,
    /// Age of each contact, s; empty without cohesion.
    pub ages: Vec<f64>,
    /// Speed of sliding at which contacts are young again, m/s.
    sliding: Option<f64>,
    /// Walls near each zone: `wall_of[wall_starts[c] .. wall_starts[c + 1]]`.
    wall_starts: Vec<u32>,
    wall_of: Vec<u32>,
    wall_cells: Vec<(u32, u32)>,
    /// Scratch: colours used by each slot (tiles of one colour share none), and what each chunk of the work finds.
    used: Vec<AtomicU32>,
    chunks: Vec<Chunk>,
}

/// What is found at once with other chunks.
#[derive(Default)]
struct Chunk {
    /// Pairs of its tiles, and the end of each tile.
    pairs: Vec<[u32; 2]>,
    ends: Vec<u32>,
    overlaps: Vec<(u32, f64)>,
    /// The pairs of a tile in the order in which they were found and their colours; walls near one grain.
    unsorted: Vec<[u32; 2]>,
    colour: Vec<u8>,
    near: Vec<Near>,
}

/// Parts that are looked for at once where there are many grains; their number does not depend on that of threads.
const CHUNKS: usize = 16;

/// A wall near a grain, and where and when they [meet](Meeting).
#[derive(Clone, Copy)]
struct Near {
    wall: u32,
    share: f64,
    when: f64,
    distance: f64,
}

impl Near {
    /// Whether a grain meets this wall before another one: earlier, or at the same time and nearer.
    fn before(&self, other: &Self) -> bool {
        self.when < other.when || self.when == other.when && self.distance < other.distance * (1.0 - 1e-12)
    }
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
        let (small, large) = p.radius.iter().fold((f64::MAX, 0f64), |(lo, hi), &r| (lo.min(r), hi.max(r)));
        // Slow grains get cells of one size, so that nothing is allocated in a bed that only trembles.
        let reach = (fastest * scene.h).max(0.1 * large.min(2.0 * small));
        self.grid.build(&p.position, &p.radius, reach, &scene.settings.period);
        self.fill_bodies(scene, &mut problem.bodies);
        self.fill_positions(scene, problem);
        self.gather_velocities(scene, after, &problem.bodies);
        self.place_walls(scene);
        self.find_pairs(scene, problem);
        self.fill_contacts(scene, memory, problem);
    }

    /// One body per grain, in slot order, with its free velocity.
    fn fill_bodies(&self, scene: &Scene<D>, bodies: &mut Bodies<D>) {
        let p = scene.particles;
        bodies.clear();
        bodies.reserve(p.len(), p.rotation.is_some());
        for &i in &self.grid.grain_of {
            bodies.push(&scene.free_velocity(i as usize), scene.mobility(i as usize));
        }
        if let Some(rotation) = &p.rotation {
            for &i in &self.grid.grain_of {
                let (r, i) = (p.radius[i as usize], i as usize);
                bodies.push_spin(rotation.spin[i] * r, r * r / rotation.inertia[i]);
            }
        }
    }

    /// Where the grains are, in the order of the bodies.
    fn fill_positions(&self, scene: &Scene<D>, problem: &mut Problem<D>) {
        let p = scene.particles;
        let grain_of = || self.grid.grain_of.iter().map(|&i| i as usize);
        problem.position.clear();
        problem.position.extend(grain_of().map(|i| p.position[i]));
        problem.radius.clear();
        problem.radius.extend(grain_of().map(|i| p.radius[i]));
    }

    fn gather_velocities(&mut self, scene: &Scene<D>, after: &[Vector<D>], bodies: &Bodies<D>) {
        let p = scene.particles;
        self.bounds.clear(self.grid.zones());
        for (slot, &i) in self.grid.grain_of.iter().enumerate() {
            let i = i as usize;
            let zone = self.grid.zone_of(slot, &p.position[i]);
            self.bounds.add(zone, &p.velocity[i]);
            self.bounds.add(zone, &expected(scene, i, bodies.velocity(slot)));
            for v in after.iter().skip(i).step_by(p.len()) {
                self.bounds.add(zone, v);
            }
        }
    }

    /// Lists the walls near each zone, adds their velocities to its box, and closes the boxes.
    fn place_walls(&mut self, scene: &Scene<D>) {
        for wall in scene.placed.iter().filter(|wall| !wall.gone) {
            // A wall matters to a grain that it may reach; a second radius covers the range of a grain.
            let range = wall.velocity[0].norm().max(wall.velocity[1].norm()) * scene.h;
            let bounds = &mut self.bounds;
            self.grid.near_segment(&wall.points, 2.0 * (1.0 + SKIN), range, |zone| {
                bounds.add(zone, &wall.velocity[0]);
                bounds.add(zone, &wall.velocity[1]);
            });
        }
        self.bounds.close(&self.grid);
        // A fast grain may reach further: the list must cover the range of every zone.
        let range = (0..self.grid.zones()).fold(0.0, |a: f64, c| a.max(self.bounds.speed(c))) * scene.h;
        self.wall_cells.clear();
        for (w, wall) in scene.placed.iter().enumerate().filter(|(_, wall)| !wall.gone) {
            let cells = &mut self.wall_cells;
            self.grid
                .near_segment(&wall.points, 1.0 + SKIN, range, |zone| cells.push((zone as u32, w as u32)));
        }
        self.wall_cells.sort_unstable();
        self.wall_cells.dedup();
        self.wall_starts.clear();
        self.wall_starts.resize(if scene.placed.is_empty() { 0 } else { self.grid.zones() + 1 }, 0);
        self.wall_of.clear();
        for &(zone, wall) in &self.wall_cells {
            self.wall_starts[zone as usize + 1] += 1;
            self.wall_of.push(wall);
        }
        for c in 1..self.wall_starts.len() {
            self.wall_starts[c] += self.wall_starts[c - 1];
        }
    }

    /// All pairs within range, tile by tile; within a tile in an order that keeps neighbours in the list apart.
    fn find_pairs(&mut self, scene: &Scene<D>, problem: &mut Problem<D>) {
        let grains = scene.particles.len();
        let Problem { tiles, position, radius, .. } = problem;
        let places = (&position[..], &radius[..]);
        tiles.colours.clone_from(&self.grid.colours);
        tiles.starts.clear();
        tiles.starts.push(0);
        self.used.resize_with(grains, Default::default);
        self.pairs.clear();
        let mut chunks = std::mem::take(&mut self.chunks);
        chunks.resize_with(if grains > FORK { CHUNKS } else { 1 }, Chunk::default);
        let count = chunks.len();
        for colour in self.grid.colours.windows(2) {
            let tiles_of = |k: usize| {
                let cut = |k: usize| colour[0] + (colour[1] - colour[0]) * k / count;
                cut(k)..cut(k + 1)
            };
            let find = |k: usize, chunk: &mut Chunk| {
                chunk.pairs.clear();
                chunk.ends.clear();
                tiles_of(k).for_each(|tile| self.find_in_tile(scene, places, tile, chunk));
            };
            parallel::each(&mut chunks, 0, &find);
            for chunk in &chunks {
                let first = self.pairs.len() as u32;
                crate::reserve(&mut self.pairs, first as usize + chunk.pairs.len());
                self.pairs.extend_from_slice(&chunk.pairs);
                tiles.starts.extend(chunk.ends.iter().map(|end| first + end));
            }
        }
        self.chunks = chunks;
        let across = self.grid.tiles.iter().position(|tile| *tile == Tile::Across);
        problem.first_across = across.map_or(self.pairs.len(), |tile| problem.tiles.starts[tile] as usize);
    }

    /// Pairs of a tile; positions and radii are those of the slots.
    fn find_in_tile(
        &self,
        scene: &Scene<D>,
        (position, radius): (&[Vector<D>], &[f64]),
        tile: usize,
        chunk: &mut Chunk,
    ) {
        let (p, grid, period) = (scene.particles, &self.grid, &scene.settings.period);
        let across = grid.tiles[tile] == Tile::Across;
        let first = chunk.pairs.len();
        grid.each_in_tile(tile, |zone, a, others| {
            let i = grid.grain_of[a] as usize;
            let range = self.bounds.speed(zone) * scene.h;
            if others.is_none() && !self.wall_starts.is_empty() && !p.held(i) {
                let walls = self.wall_starts[zone] as usize..self.wall_starts[zone + 1] as usize;
                near_walls(scene, i, &self.wall_of[walls], range, &mut chunk.near);
                chunk.pairs.extend(chunk.near.iter().map(|n| [a as u32, WALL + n.wall]));
            }
            for b in others.into_iter().flatten() {
                let reach = (radius[a] + radius[b]) * (1.0 + SKIN) + range;
                let way = position[b] - position[a];
                let near =
                    period.nearest(way).norm_squared() < reach * reach && period.crosses(&way) == across;
                if near && !(p.held(i) && p.held(grid.grain_of[b] as usize)) {
                    chunk.pairs.push([a as u32, b as u32]);
                }
            }
        });
        self.spread_out(first, chunk);
        chunk.ends.push(chunk.pairs.len() as u32);
    }

    /// Orders the pairs of a tile by greedy colours, so that successive contacts rarely share a grain: the
    /// processor then works on several at once instead of waiting for the last one's velocities.
    fn spread_out(&self, first: usize, chunk: &mut Chunk) {
        let mut places = [0usize; 33];
        let pairs = &mut chunk.pairs[first..];
        chunk.colour.clear();
        chunk.unsorted.clear();
        chunk.unsorted.extend_from_slice(pairs);
        let slots =
            |pair: [u32; 2]| pair.into_iter().filter(|s| s & WALL == 0).map(|s| &self.used[s as usize]);
        for pair in pairs.iter() {
            let taken = slots(*pair).fold(0, |taken, used| taken | used.load(Relaxed));
            let colour = (!taken).trailing_zeros().min(31);
            slots(*pair).for_each(|used| used.store(used.load(Relaxed) | 1 << colour, Relaxed));
            places[colour as usize + 1] += 1;
            chunk.colour.push(colour as u8);
        }
        for k in 1..places.len() {
            places[k] += places[k - 1];
        }
        for (pair, colour) in chunk.unsorted.iter().zip(&chunk.colour) {
            pairs[places[*colour as usize]] = *pair;
            places[*colour as usize] += 1;
            slots(*pair).for_each(|used| used.store(0, Relaxed));
        }
    }

    /// Whether no contact was missed: all final velocities keep within what the search assumed, or those
    /// grains that do not meet nobody on their way.
    pub fn holds(&self, scene: &Scene<D>, problem: &Problem<D>) -> bool {
        let p = scene.particles;
        self.grid.grain_of.iter().enumerate().all(|(slot, &i)| {
            let i = i as usize;
            let zone = self.grid.zone_of(slot, &p.position[i]);
            let v = problem.bodies.velocity(slot);
            self.bounds.allows(zone, &v, p.radius[i], scene.h)
                || !self.grid.is_wide(slot) && self.runs_free(scene, problem, i, &v)
        })
    }

    /// Whether grain i, no wide one, at a velocity that the search did not expect, ends the sub-step without overlap
    /// with anything that was beyond the skin at its start. (What was nearer has a contact.)
    fn runs_free(&self, scene: &Scene<D>, problem: &Problem<D>, i: usize, v: &Vector<D>) -> bool {
        let p = scene.particles;
        let (x, r) = (p.position[i], p.radius[i]);
        if v.norm() * scene.h > 0.25 * self.grid.width() {
            return false;
        }
        let (end, period) = (x + v * scene.h, &scene.settings.period);
        let mut free = true;
        // Two cells far: it goes a quarter of one, another such grain as much, and all others less than one.
        self.grid.around(&x, 2, |slot| {
            let j = self.grid.grain_of[slot] as usize;
            let reach = r + p.radius[j];
            let arm = period.nearest(p.position[j] - x);
            let overlap = reach - nearest_on_way(&arm, &((problem.bodies.velocity(slot) - v) * scene.h));
            let was_far = arm.norm() > reach * (1.0 + SKIN);
            free &= !(was_far && overlap > MISSED * r.min(p.radius[j]));
        });
        free && scene.placed.iter().zip(0..).filter(|(wall, _)| !wall.gone).all(|(wall, number)| {
            let beside = scene.beside(number, &x);
            let (x, end) = (beside, end + (beside - x));
            let moved = wall.after(scene.h);
            let was_near = (wall.point(wall.nearest(&x)) - x).norm() <= r * (1.0 + SKIN);
            let clear = r * (1.0 - MISSED);
            let passes_ends = || {
                let mut ends = wall.points.iter().zip(&moved.points);
                ends.any(|(from, to)| nearest_on_way(&(from - x), &((to - end) - (from - x))) <= clear)
            };
            was_near
                || (moved.point(moved.nearest(&end)) - end).norm() > clear
                    && !crossed((wall, &x), (&moved, &end), period.spans(&wall.points))
                    && !passes_ends()
        })
    }

    /// Number of the second side of a contact: a grain, or `WALL` + number.
    fn partner(&self, c: &Contact<D>) -> u32 {
        let n = self.grid.grain_of.len();
        let j = c.j as usize;
        if j < n { self.grid.grain_of[j] } else { WALL + self.touches[j - n].wall }
    }

    /// Both sides of a contact by number: a grain, and a grain or `WALL` + number.
    pub fn between(&self, problem: &Problem<D>, contact: usize) -> [u32; 2] {
        let c = &problem.contacts[contact];
        [self.grid.grain_of[c.i as usize], self.partner(c)]
    }

    /// Grain, partner, normal and force on the partner of the contacts that carry one.
    pub fn forces<'a>(
        &'a self,
        problem: &'a Problem<D>,
        h: f64,
    ) -> impl Iterator<Item = (u32, u32, Vector<D>, Vector<D>)> + 'a {
        let acting = problem.contacts.iter().filter(|c| c.acts());
        acting.map(move |c| (self.grid.grain_of[c.i as usize], self.partner(c), c.normal, c.impulse / h))
    }

    /// The contacts of the problem by identity; those that touch are `older` (s) than at the start of the sub-step.
    pub fn records<'a>(
        &'a self,
        problem: &'a Problem<D>,
        older: f64,
    ) -> impl Iterator<Item = Record<D>> + 'a {
        problem.contacts.iter().enumerate().filter_map(move |(k, c)| {
            let (i, j) = (self.grid.grain_of[c.i as usize], self.partner(c));
            let young = older > 0.0 && self.sliding.is_some_and(|bound| slides(problem, c) > bound);
            let age = if young { 0.0 } else { self.ages.get(k).map_or(0.0, |a| a + older) };
            let rolling = problem.rolling.get(k).map_or(0.0, |r: &Rolling| r.impulse.get());
            (c.acts() || age > 0.0).then_some(Record { i, j, impulse: c.impulse, age, rolling })
        })
    }
}

/// Speed at which the sides of a contact slide on each other, m/s.
fn slides<const D: usize>(problem: &Problem<D>, c: &Contact<D>) -> f64 {
    let (bodies, [i, j]) = (&problem.bodies, [c.i, c.j].map(|side| side as usize));
    let u = match bodies.spins() {
        true => bodies.relative::<true>(i, j, &c.normal),
        false => bodies.relative::<false>(i, j, &c.normal),
    };
    (u - c.normal * u.dot(&c.normal)).norm()
}

/// The free velocity of grain i, no faster than sub-steps want it. Where there were not enough of them, everyone
/// would have a contact with everyone else on its way; in a bed at rest nobody goes it, and who does is found out
/// afterwards.
fn expected<const D: usize>(scene: &Scene<D>, i: usize, free: Vector<D>) -> Vector<D> {
    free.cap_magnitude(scene.settings.max_travel * scene.particles.radius[i] / scene.h)
}

/// Walls whose gap to grain i is within range, each corner once.
///
/// A grain that meets the end of one wall while another wall passes through that end would meet the same
/// point twice, or stumble over the joint of two collinear walls: an end counts only if no other wall is met before (or
/// at the same time, with a smaller number).
fn near_walls<const D: usize>(scene: &Scene<D>, i: usize, walls: &[u32], range: f64, near: &mut Vec<Near>) {
    let (x, r) = (&scene.particles.position[i], scene.particles.radius[i]);
    near.clear();
    for &wall in walls {
        let placed = &scene.placed[wall as usize];
        let x = scene.beside(wall, x);
        let share = placed.nearest(&x);
        let distance = (placed.point(share) - x).norm();
        if distance < r * (1.0 + SKIN) + range {
            near.push(Near { wall, share, when: 0.0, distance });
        }
    }
    if near.len() < 2 {
        return;
    }
    for n in near.iter_mut() {
        let Meeting { share, when, distance, .. } = scene.meet_wall(i, n.wall);
        *n = Near { share, when, distance, ..*n };
    }
    let all = std::mem::take(near);
    let hidden = |k: usize| {
        let n = all[k];
        let [from, to] = scene.placed[n.wall as usize].points;
        // Above the end but for rounding is above the end: at the joint itself both walls would carry the grain.
        let slack = 1e-9 * r / (to - from).norm();
        if n.share > slack && n.share < 1.0 - slack {
            return false;
        }
        let end = scene.placed[n.wall as usize].point(n.share);
        all.iter().enumerate().any(|(l, other)| {
            let through = &scene.placed[other.wall as usize];
            let end = scene.beside(other.wall, &end);
            let passes = (through.point(through.nearest(&end)) - end).norm() < 1e-6 * r;
            l != k && passes && (other.before(&n) || !n.before(other) && l < k)
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
