//! Impacts give back no more energy than they had, however well they are solved.
//!
//! With the impulses p of contacts that push each other, relative velocities u_f before and u = u_f + W p after, and the
//! bias b of each contact (e times its approach for an impact), the contacts bring the energy
//!
//! ```text
//!     p . u_f + 1/2 p . W p = 1/2 p . (u_f - b n)      if  p . W p = -p . (u_f + b n),
//! ```
//!
//! which is (e - 1)/2 of p . u_f and below zero where all contacts approach. The condition says that the impulses are the
//! best of their multiples: exact impulses are, and those of a solver that stops at a tolerance are too large or too small.
//! Too large ones bring energy. Exact ones may too, where an impact pushes grains together that were separating: Newton's
//! law of several impacts at once has no bound of energies. So the impulses of each group of grains in which something
//! rebounds are scaled down to the best of their multiples, and further until all contacts together bring nothing. They
//! stay within Coulomb's law, which is a cone; what closes by that is taken back as an overlap.

use crate::contact::Contact;
use crate::energy::{at_start, relative, rolling_speed};
use crate::scene::Scene;
use crate::solver::{Problem, smaller};
use crate::velocity_bounds::SKIN;

/// Rounding of the sums of a group, as a share of them.
const ROUNDING: f64 = 1e-14;

/// Scales the impulses of the groups in which something rebounds and that would gain energy. The velocities of the
/// bodies are those that the impulses give, before and after.
pub(crate) fn limit<const D: usize>(problem: &mut Problem<D>, scene: &Scene<D>, grain_of: &[u32]) {
    if !problem.contacts.iter().any(|c| c.bias < 0.0 && c.acts()) {
        return;
    }
    let mut groups = Groups::new(grain_of.len());
    for c in problem.contacts.iter().filter(|c| c.acts()) {
        let [i, j] = [c.i, c.j].map(|slot| slot as usize);
        // Neither walls nor grains that are held hand anything on.
        if j < grain_of.len() && problem.bodies.mobility(i) > 0.0 && problem.bodies.mobility(j) > 0.0 {
            groups.join(i, j);
        }
    }
    let moving = |problem: &Problem<D>, k: usize| {
        let c = &problem.contacts[k];
        if problem.bodies.mobility(c.i as usize) > 0.0 { c.i as usize } else { c.j as usize }
    };
    let (first, last) = (at_start(scene, grain_of, &problem.bodies), problem.bodies.state());
    scene.set_free(grain_of, &problem.bodies);
    let free = problem.bodies.state();
    let mut sums = vec![Group::default(); grain_of.len()];
    for (k, c) in problem.contacts.iter().enumerate().filter(|(_, c)| c.acts()) {
        let brought = |state: &[_]| {
            let rolling =
                problem.rolling.get(k).map_or(0.0, |r| r.impulse.get() * rolling_speed(state, c, r));
            c.impulse.dot(&relative(state, c)) + rolling
        };
        let sum = &mut sums[groups.of(moving(problem, k))];
        let [first, free, last] = [&first, &free, &last].map(|state| brought(state));
        sum.free += free + c.bias * c.impulse.dot(&c.normal);
        sum.mean += 0.5 * (first + free);
        sum.square += last - free;
        sum.rebounds |= c.bias < 0.0;
    }
    for k in 0..problem.contacts.len() {
        let share = sums[groups.of(moving(problem, k))].share();
        if share < 1.0 {
            problem.contacts[k].impulse *= share;
            if let Some(rolling) = problem.rolling.get(k) {
                rolling.impulse.set(rolling.impulse.get() * share);
            }
        }
    }
    problem.apply_impulses();
}

/// Energy that bodies had which another one threw against a third within the sub-step, and that a rebound would have
/// left them, J: they stop there instead, because Newton's law is for what approaches where the sub-step starts.
/// `partner` is the number of the second side of a contact, as in [`Scene::restitution`].
pub(crate) fn missed<const D: usize>(
    problem: &Problem<D>,
    scene: &Scene<D>,
    partner: impl Fn(usize) -> [u32; 2],
) -> f64 {
    if !scene.has_restitution() {
        return 0.0;
    }
    let apart = |c: &Contact<D>| c.bias * scene.h > SKIN * smaller(&problem.radius, c);
    let all = problem.contacts.iter().enumerate().filter(|(_, c)| c.acts() && apart(c));
    all.map(|(k, c)| {
        let [i, j] = partner(k);
        let normal = c.impulse.dot(&c.normal);
        let after = -c.bias;
        let before = after - normal / c.mass_n;
        let rebound = scene.restitution(i, j) * before;
        0.5 * c.mass_n * (rebound * rebound - after * after).max(0.0)
    })
    .sum()
}

/// Sums over the contacts of a group.
#[derive(Clone, Copy, Default)]
struct Group {
    /// p . (u_f + b n), J.
    free: f64,
    /// p . (u_0 + u_f)/2, u_0 where the sub-step starts, J.
    mean: f64,
    /// p . W p, J.
    square: f64,
    rebounds: bool,
}

impl Group {
    /// The multiple of the impulses that brings no energy, 1 at most.
    fn share(&self) -> f64 {
        let most = 1.0 - ROUNDING;
        if !self.rebounds || self.square <= 0.0 {
            return 1.0;
        }
        let best = -self.free / self.square;
        // With the multiple s the contacts bring s (mean + s/2 square). Where forces press grains together that separate,
        // no multiple helps.
        let nothing = if self.mean < 0.0 { -2.0 * self.mean / self.square } else { 1.0 };
        let share = best.min(nothing);
        if share < most { share.max(0.0) } else { 1.0 }
    }
}

/// Which slots belong together.
struct Groups {
    parent: Vec<u32>,
}

impl Groups {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect() }
    }

    /// The first slot of a group stands for it.
    fn of(&mut self, mut slot: usize) -> usize {
        while self.parent[slot] as usize != slot {
            self.parent[slot] = self.parent[self.parent[slot] as usize];
            slot = self.parent[slot] as usize;
        }
        slot
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.parent[a.max(b)] = a.min(b) as u32;
    }
}

#[cfg(test)]
mod tests {
    use crate::{Dem, Load, Material, Particles, Settings, Vector, Wall};

    type Plane = Vector<2>;

    const RADIUS: f64 = 1e-3;

    fn energy(dem: &Dem<2>) -> f64 {
        let p = &dem.particles;
        let moved: f64 = p.mass.iter().zip(&p.velocity).map(|(m, v)| 0.5 * m * v.norm_squared()).sum();
        let turned = p.rotation.as_ref().map_or(0.0, |rotation| {
            rotation.inertia.iter().zip(&rotation.spin).map(|(i, w)| 0.5 * i * w * w).sum()
        });
        moved + turned
    }

    /// Discs, the first of which flies, with restitution 1; the highest and the last energy over the first.
    fn collide(
        places: &[[f64; 2]],
        velocity: [f64; 2],
        (friction, tolerance, step): (f64, f64, f64),
        walls: Vec<Wall<2>>,
    ) -> (f64, f64, Vec<Plane>) {
        let materials = [Material { restitution: 1.0, friction, ..Material::default() }];
        let at = places.iter().map(|[x, y]| Plane::new(*x, *y) * RADIUS).collect();
        let count = places.len();
        let mut grains =
            Particles::new(at, vec![RADIUS; count], vec![0; count], &materials).unwrap().rotating();
        grains.velocity[0] = Plane::from(velocity);
        let settings = Settings { gravity: Plane::zeros(), tolerance, ..Settings::default() };
        let mut dem = Dem::new(grains, walls, materials.to_vec(), settings).unwrap();
        let first = energy(&dem);
        let mut highest = 0.0_f64;
        for _ in 0..(0.05 / step).round() as usize {
            dem.step(step, &Load::default());
            highest = highest.max(energy(&dem) / first);
        }
        (highest, energy(&dem) / first, dem.particles.velocity)
    }

    /// A row that is hit had 1.8 % more energy than the disc that hit it, with the default tolerance.
    #[test]
    fn elastic_impacts_bring_no_energy() {
        let row: Vec<[f64; 2]> =
            (0..6).map(|i| [if i == 0 { -3.0 } else { 2.0 * f64::from(i) - 2.0 }, 0.0]).collect();
        let block: Vec<[f64; 2]> = std::iter::once([-3.0, 2.3])
            .chain((0..25).map(|k| [2.0 * f64::from(k % 5), 2.0 * f64::from(k / 5)]))
            .collect();
        for tolerance in [1.0, 2e-2, 1e-4, 1e-8] {
            for step in [1e-3, 3e-4] {
                for friction in [0.0, 0.5] {
                    for places in [&row, &block] {
                        let how = (friction, tolerance, step);
                        let (highest, ..) = collide(places, [1.0, 0.0], how, vec![]);
                        assert!(highest <= 1.0 + 1e-13, "{how:?}: {highest}");
                    }
                    let floor = Wall { restitution: 1.0, ..wall() };
                    let stack: Vec<[f64; 2]> = std::iter::once([0.3, 9.0])
                        .chain((0..4).map(|k| [0.0, 2.0 * f64::from(k) + 1.0]))
                        .collect();
                    let (highest, ..) =
                        collide(&stack, [0.0, -1.0], (friction, tolerance, step), vec![floor]);
                    assert!(highest <= 1.0 + 1e-13, "{friction} {tolerance} {step}: {highest}");
                }
            }
        }
        // Newton's law in every contact: -2/3 and five times 1/3 m/s.
        let (highest, last, velocity) = collide(&row, [1.0, 0.0], (0.0, 1e-8, 1e-3), vec![]);
        assert!((highest - 1.0).abs() < 1e-13 && (last - 1.0).abs() < 1e-6, "{highest} {last}");
        approx::assert_relative_eq!(velocity[0][0], -2.0 / 3.0, epsilon = 1e-3);
        velocity[1..].iter().for_each(|v| approx::assert_relative_eq!(v[0], 1.0 / 3.0, epsilon = 1e-3));
    }

    /// A row of discs with gaps, with restitution 1, lost its energy within one step and said nothing.
    #[test]
    fn rebounds_that_a_step_misses_are_counted() {
        let row: Vec<[f64; 2]> = (0..4).map(|i| [2.2 * f64::from(i), 0.0]).collect();
        let materials = [Material { restitution: 1.0, ..Material::default() }];
        for (step, misses) in [(1e-3_f64, true), (1e-5, false)] {
            let at = row.iter().map(|[x, y]| Plane::new(*x, *y) * RADIUS).collect();
            let mut grains = Particles::new(at, vec![RADIUS; 4], vec![0; 4], &materials).unwrap();
            grains.velocity[0] = Plane::new(1.0, 0.0);
            let settings = Settings { gravity: Plane::zeros(), max_travel: 10.0, ..Settings::default() };
            let mut dem = Dem::new(grains, vec![], materials.to_vec(), settings).unwrap();
            let (before, mut missed) = (energy(&dem), 0.0);
            for _ in 0..(2e-3 / step).round() as usize {
                missed += dem.step(step, &Load::default()).missed_rebounds;
            }
            let lost = before - energy(&dem);
            assert_eq!(
                missed > 0.05 * before,
                misses,
                "{step}: {missed} J counted, {lost} of {before} J lost"
            );
            assert_eq!(lost > 0.05 * before, misses, "{step}: {lost} of {before} J");
        }
    }

    fn wall() -> Wall<2> {
        Wall::new("floor", Plane::new(-1.0, 0.0), Plane::new(1.0, 0.0))
    }
}
