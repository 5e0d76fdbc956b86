//! Grains that come in and go while a run goes on.

use crate::dem::Dem;
use crate::error::Result;
use crate::packing::{Amount, Radii, Region};
use crate::space::ball;
use crate::{Particles, Vector};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Random places that are tried for a grain in a step before it waits for the next one.
const TRIES: u64 = 64;

/// How much a source lets in by time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Grains per second.
    Grains(f64),
    /// Mass per second, kg/s (per metre of depth in the plane).
    Mass(f64),
}

/// Lets grains in at random places of a box, where they overlap neither grains nor walls.
#[derive(Clone, Debug, PartialEq)]
pub struct Source<const D: usize> {
    /// Name, for reports.
    pub name: String,
    /// Holds the whole grains.
    pub region: Region<D>,
    /// Law of the radii; a list is not allowed.
    pub radii: Radii,
    /// Index of the material.
    pub material: u8,
    /// How much comes in by time.
    pub rate: Rate,
    /// How much comes in at most.
    pub amount: Amount,
    /// Velocity of a grain that comes in, m/s.
    pub velocity: Vector<D>,
    /// Temperature of a grain that comes in, K; where grains carry heat.
    pub temperature: f64,
    /// Times at which it begins and ends, s.
    pub during: [f64; 2],
    /// Seed of sizes and places.
    pub seed: u64,
}

/// How much has come in, or gone, since time zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Passed {
    /// Number of grains.
    pub grains: u64,
    /// Their mass, kg (per metre of depth in the plane).
    pub mass: f64,
    /// The mass that passed in the last step, kg (per metre of depth in the plane).
    pub last: f64,
}

impl Passed {
    fn add(&mut self, mass: f64) {
        self.grains += 1;
        self.mass += mass;
        self.last += mass;
    }
}

/// What a source has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fed {
    /// What came in.
    pub passed: Passed,
    /// What is due since time zero: grains, or kg (per metre of depth in the plane).
    due: f64,
    /// Whether that is kg.
    by_mass: bool,
    /// Time up to which it is due, s: a step that failed and is done again lets nothing in twice.
    until: f64,
    /// Grains that are due and found no place yet; of a rate by mass as many as the next one's mass goes into what is
    /// due.
    pub waiting: u64,
    /// Places drawn since time zero.
    drawn: u64,
}

/// Share by which a rounding error may make what is due too small.
const ROUNDING: f64 = 1e-9;

impl<const D: usize> Source<D> {
    /// The generator of the radius of a grain, or of a place.
    fn random(&self, purpose: u64, number: u64) -> Pcg64 {
        let seed = self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ purpose;
        Pcg64::seed_from_u64(seed.wrapping_add(number.wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// Radius of the grain of this number, m.
    fn radius(&self, number: u64) -> f64 {
        self.radii.draw(&mut self.random(1, number)).unwrap_or(0.0)
    }

    /// Whether a grain of this mass is still wanted, of all that may come.
    fn wanted(&self, passed: &Passed, mass: f64) -> bool {
        match self.amount {
            Amount::Count(count) => passed.grains < count as u64,
            Amount::Mass(most) => passed.mass + 0.5 * mass <= most,
            Amount::Fill => true,
        }
    }

    /// Draws the grains that are due in a step of `dt` from now and have a place, and counts those that have none.
    fn draw(&self, fed: &mut Fed, grains: &Dem<D>, dt: f64) -> Result<Particles<D>> {
        let time = grains.time();
        let [start, end] = self.during;
        let rate = match self.rate {
            Rate::Grains(rate) | Rate::Mass(rate) => rate,
        };
        let by_mass = matches!(self.rate, Rate::Mass(_));
        if fed.by_mass != by_mass {
            // The rate has changed its unit: what waited for a place is forgotten.
            fed.due = if by_mass { fed.passed.mass } else { fed.passed.grains as f64 };
            fed.by_mass = by_mass;
        }
        fed.due += rate * (end.min(time + dt) - start.max(time).max(fed.until)).max(0.0);
        fed.until = time + dt;
        (fed.waiting, fed.passed.last) = (0, 0.0);
        let made_of = &grains.materials()[self.material as usize];
        let mass_of = |radius: f64| made_of.density * made_of.solidity * ball::<D>(radius);
        let (mut position, mut radii) = (vec![], vec![]);
        let mut near = None;
        loop {
            let radius = self.radius(fed.passed.grains);
            let mass = mass_of(radius);
            let open = match self.rate {
                Rate::Grains(_) => fed.due * (1.0 + ROUNDING) - fed.passed.grains as f64,
                Rate::Mass(_) => (fed.due * (1.0 + ROUNDING) - fed.passed.mass) / mass,
            };
            if open < 1.0 || !self.wanted(&fed.passed, mass) {
                break;
            }
            let near = near.get_or_insert_with(|| self.near(grains));
            let Some(place) = self.place(fed, grains, (near, radius)) else {
                let most = match self.amount {
                    Amount::Count(count) => count as f64 - fed.passed.grains as f64,
                    Amount::Mass(most) => ((most - fed.passed.mass) / mass).max(1.0),
                    Amount::Fill => f64::INFINITY,
                };
                fed.waiting = open.min(most) as u64;
                break;
            };
            near.push((place, radius));
            position.push(place);
            radii.push(radius);
            fed.passed.add(mass);
        }
        let material = vec![self.material; radii.len()];
        let mut drawn = Particles::new(position, radii, material, grains.materials())?;
        drawn.velocity.fill(self.velocity);
        if grains.particles.heat.is_some() {
            drawn = drawn.heated(self.temperature, grains.materials())?;
        }
        if grains.particles.rotation.is_some() {
            drawn = drawn.rotating();
        }
        Ok(drawn)
    }

    /// Grains that reach into the box.
    fn near(&self, grains: &Dem<D>) -> Vec<(Vector<D>, f64)> {
        let Region { low, high } = &self.region;
        let (period, middle) = (grains.settings().period, (low + high) * 0.5);
        let all =
            grains.particles.position.iter().map(|x| period.image(*x, &middle)).zip(&grains.particles.radius);
        let reaches = |x: &Vector<D>, r: f64| (0..D).all(|a| x[a] + r > low[a] && x[a] - r < high[a]);
        all.filter(|(x, r)| reaches(x, **r)).map(|(x, r)| (x, *r)).collect()
    }

    /// A free place for a grain, if one was found.
    fn place(
        &self,
        fed: &mut Fed,
        grains: &Dem<D>,
        (near, radius): (&[(Vector<D>, f64)], f64),
    ) -> Option<Vector<D>> {
        let Region { low, high } = &self.region;
        let standing = grains.walls().iter().filter(|wall| wall.stands(grains.time()));
        let walls: Vec<[Vector<D>; 2]> = standing.map(|wall| wall.at(grains.time())).collect();
        let period = &grains.settings().period;
        for _ in 0..TRIES {
            let mut random = self.random(2, fed.drawn);
            fed.drawn += 1;
            let room = |a: usize| (high[a] - low[a] - 2.0 * radius).max(0.0);
            let place = Vector::from_fn(|a, _| low[a] + radius + room(a) * random.random::<f64>());
            let free =
                near.iter().all(|(x, r)| period.nearest(x - place).norm_squared() >= (r + radius).powi(2));
            let off = walls.iter().all(|ends| {
                let image = period.image(place, &(0.5 * (ends[0] + ends[1])));
                distance(ends, &image) >= radius
            });
            if free && off {
                return Some(place);
            }
        }
        None
    }
}

/// Distance of a point from a segment, m.
fn distance<const D: usize>([a, b]: &[Vector<D>; 2], x: &Vector<D>) -> f64 {
    let along = b - a;
    let share = ((x - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (a + along * share - x).norm()
}

/// Where a sink takes grains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mouth<const D: usize> {
    /// Grains whose centres cross this segment in a step, from either side (plane only).
    Line([Vector<D>; 2]),
    /// Grains whose centres are in this box at the end of a step.
    Region(Region<D>),
}

/// Takes grains out of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Sink<const D: usize> {
    /// Name, for reports.
    pub name: String,
    /// Where it takes them.
    pub mouth: Mouth<D>,
    /// Times at which it begins and ends, s.
    pub during: [f64; 2],
}

impl<const D: usize> Sink<D> {
    /// Whether it takes a grain that went from `before` to `now` in a step of `dt` that ended at a time (s).
    fn takes(&self, before: Option<&Vector<D>>, now: &Vector<D>, [time, dt]: [f64; 2]) -> bool {
        let [start, end] = self.during;
        // Times are sums of steps. A line takes what crosses it in a step that begins when the sink does, or later.
        let slack = 1e-9 * dt;
        let first = if matches!(self.mouth, Mouth::Line(_)) { time - dt } else { time };
        if first < start - slack || time > end + slack {
            return false;
        }
        match &self.mouth {
            Mouth::Region(Region { low, high }) => (0..D).all(|a| low[a] <= now[a] && now[a] <= high[a]),
            Mouth::Line([a, b]) => before.is_some_and(|before| {
                let side = |x: &Vector<D>| (b[0] - a[0]) * (x[1] - a[1]) - (b[1] - a[1]) * (x[0] - a[0]);
                let across = (side(before), side(now));
                // On the line counts as behind it, so that a grain that stops there is taken once.
                if (across.0 > 0.0) == (across.1 > 0.0) {
                    return false;
                }
                let share = across.0 / (across.0 - across.1);
                let crossing = before + (now - before) * share;
                let along = b - a;
                (0.0..=along.norm_squared()).contains(&(crossing - a).dot(&along))
            }),
        }
    }
}

/// The sources and sinks of a run, and what passed them.
#[derive(Clone, Debug, Default)]
pub struct Passage<const D: usize> {
    /// Where grains come in.
    pub sources: Vec<Source<D>>,
    /// Where they go.
    pub sinks: Vec<Sink<D>>,
    state: PassageState,
    /// Places at the start of the step; empty without sinks that are lines.
    before: Vec<Vector<D>>,
}

/// What passed sources and sinks: all that a restart needs of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PassageState {
    /// By source.
    pub fed: Vec<Fed>,
    /// By sink.
    pub taken: Vec<Passed>,
    /// Number of the next grain: one that has gone leaves its number to nobody.
    next: u32,
}

impl<const D: usize> Passage<D> {
    /// Sources and sinks of a run that begins with these grains.
    pub fn new(sources: Vec<Source<D>>, sinks: Vec<Sink<D>>, grains: &Particles<D>) -> Self {
        let next = grains.id.iter().max().map_or(0, |last| last + 1);
        let state = PassageState {
            fed: vec![Fed::default(); sources.len()],
            taken: vec![Passed::default(); sinks.len()],
            next,
        };
        Self { sources, sinks, state, before: vec![] }
    }

    /// Whether there is nothing to pass.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty() && self.sinks.is_empty()
    }

    /// What passed since time zero.
    pub fn state(&self) -> &PassageState {
        &self.state
    }

    /// Goes on from what had passed; sources and sinks that were not there then have passed nothing.
    pub fn restore(&mut self, mut state: PassageState) {
        state.fed.resize(self.sources.len(), Fed::default());
        state.taken.resize(self.sinks.len(), Passed::default());
        self.state = state;
    }

    /// The grains of a source, by number, that come in at the start of a step of `dt`: to be added by [`Dem::add`].
    ///
    /// # Errors
    /// A material or values that no grain may have.
    pub fn draw(&mut self, source: usize, grains: &Dem<D>, dt: f64) -> Result<Particles<D>> {
        let mut drawn = self.sources[source].draw(&mut self.state.fed[source], grains, dt)?;
        drawn.id.iter_mut().for_each(|id| *id += self.state.next);
        self.state.next += drawn.len() as u32;
        Ok(drawn)
    }

    /// Remembers where grains are at the start of a step, if a sink asks for it.
    pub fn begin(&mut self, grains: &Particles<D>) {
        if self.sinks.iter().any(|sink| matches!(sink.mouth, Mouth::Line(_))) {
            self.before.clone_from(&grains.position);
        }
    }

    /// Which grains the sinks take at the end of a step of `dt`; `gone` are out of the run already. Empty if none.
    pub fn take(&mut self, grains: &Dem<D>, dt: f64, gone: impl Fn(usize) -> bool) -> Vec<bool> {
        self.state.taken.iter_mut().for_each(|taken| taken.last = 0.0);
        if self.sinks.is_empty() {
            return vec![];
        }
        let (particles, time) = (&grains.particles, grains.time());
        let by = |i: usize| {
            let now = &particles.position[i];
            // Where the grain came from, beside where it is: it may have come in at the other side.
            let before = self.before.get(i).map(|before| grains.settings().period.image(*before, now));
            self.sinks.iter().position(|sink| sink.takes(before.as_ref(), now, [time, dt]))
        };
        let mut marks = vec![];
        // Grains that are held have no mass to count, and stay.
        for i in (0..particles.len()).filter(|i| !gone(*i) && !particles.held(*i)) {
            let Some(sink) = by(i) else { continue };
            self.state.taken[sink].add(particles.mass[i]);
            marks.resize(particles.len(), false);
            marks[i] = true;
        }
        marks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type V = Vector<2>;

    /// Times are sums of steps: the last step of a sink was left out, and a line took what had crossed it before.
    #[test]
    fn a_sink_takes_grains_in_the_steps_between_its_times() {
        let [low, high] = [V::new(-1.0, -1.0), V::new(1.0, 1.0)];
        let place = V::new(0.5, -0.5);
        let taken = |mouth: Mouth<2>| {
            let sink = Sink { name: "drain".into(), mouth, during: [0.1 + 0.1 + 0.1, 0.6] };
            let mut time = 0.0;
            let mut steps = vec![];
            for step in 1..10 {
                time += 0.1;
                let takes = sink.takes(Some(&V::new(0.5, 0.5)), &place, [time, 0.1]);
                steps.extend(takes.then_some(step));
            }
            steps
        };
        assert_eq!(taken(Mouth::Region(Region { low, high })), [3, 4, 5, 6]);
        assert_eq!(taken(Mouth::Line([V::zeros(), V::new(1.0, 0.0)])), [4, 5, 6]);
    }
}
