//! Beds built grain by grain under gravity along -y: each disc is let go near the top of a region, falls and rolls
//! without inertia to the first place where two supports or a level wall hold it (W. M. Visscher, M. Bolsterli, Nature
//! 239, 504, 1972).

use super::lying::{Lying, Segment};
use super::rolling::Ground;
use super::source::Source;
use super::{Amount, Fill, Observer, Progress, Region, check_deposit, container, full, tell};
use crate::error::Result;
use crate::{Particles, Vector, Wall};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

type Point = Vector<2>;

/// Where each disc of a bed is let go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Anywhere between the sides at random: loose, with an uneven surface.
    #[default]
    DropAndRoll,
    /// Above the lowest place of the surface (after C. H. Bennett, J. Appl. Phys. 43, 2727, 1972), and of the next
    /// eight grains the one that comes nearest to a third support there: dense if sizes differ, with a level surface.
    Dense,
}

/// Places at random that are tried before the region is searched for one from side to side.
const TRIES: usize = 50;
/// Grains among which the dense method chooses.
const CHOICE: usize = 8;
/// Grains between two reports.
const REPORT: usize = 128;

/// Builds a bed between the sides of a region, on its floor and on walls (as they stand at time 0), up to the top of
/// the region, which is open. No two grains overlap, and each rests on a level wall or between two supports.
///
/// # Errors
/// Values without meaning; more grains asked for than the region takes; an end asked for by the observer.
pub fn pour(
    region: &Region<2>,
    walls: &[Wall<2>],
    fill: &Fill<'_>,
    method: Method,
    observer: &mut Observer<'_>,
) -> Result<Particles<2>> {
    walls.iter().try_for_each(Wall::validate)?;
    check_deposit(region, fill)?;
    let mut source = Source::<2>::new(fill)?;
    let bounds = fill.radii.bounds()?;
    let size = region.high - region.low;
    let segments = container(region, walls).iter().chain(walls).map(|w| Segment::new(w.at(0.0))).collect();
    let ground = Ground::new(Lying::new(region.low, size[0], bounds), segments);
    let surface = match method {
        Method::DropAndRoll => None,
        Method::Dense => Some(Surface::new(region, &ground, 0.5 * (bounds.0 + bounds.1))),
    };
    // Apart from that of the radii, which are the same whatever places they go to.
    let rng = Pcg64::seed_from_u64(fill.seed ^ 0x706c_6163_6573);
    let mut bed = Bed { region, ground, surface, waiting: vec![], numbers: vec![], placed: vec![], rng };
    let of = source.expected(region)?;
    loop {
        let done = bed.ground.lying.radius.len();
        if done.is_multiple_of(REPORT) {
            tell(observer, Progress::Placing { done, of })?;
        }
        match bed.add(&mut source) {
            Added::Grain => {}
            Added::Full if !matches!(fill.amount, Amount::Fill) => return Err(full(done)),
            Added::Full | Added::NoneLeft => break,
        }
    }
    source.grains_drawn(bed.ground.lying.position, bed.ground.lying.radius, &bed.placed)
}

/// A bed that grows.
struct Bed<'a> {
    region: &'a Region<2>,
    ground: Ground,
    /// With the dense method.
    surface: Option<Surface>,
    /// Radii drawn and not placed yet, in their order.
    waiting: Vec<f64>,
    /// As the how-manieth each of them was drawn, and each of those that lie.
    numbers: Vec<usize>,
    placed: Vec<usize>,
    rng: Pcg64,
}

enum Added {
    Grain,
    Full,
    NoneLeft,
}

impl Bed<'_> {
    /// Adds a grain.
    fn add(&mut self, source: &mut Source<'_, 2>) -> Added {
        let most = if self.surface.is_some() { CHOICE } else { 1 };
        while self.waiting.len() < most
            && let Some(radius) = source.next()
        {
            self.waiting.push(radius);
            self.numbers.push(self.placed.len() + self.numbers.len());
        }
        let Some(&radius) = self.waiting.first() else { return Added::NoneLeft };
        let found = match &mut self.surface {
            None => drop_anywhere(self.region, &self.ground, radius, &mut self.rng),
            Some(surface) => surface.drop_lowest(self.region, &self.ground, radius, &mut self.rng),
        };
        let Some(place) = found else { return Added::Full };
        let (which, place) = self.choose(place);
        let radius = self.waiting.remove(which);
        self.placed.push(self.numbers.remove(which));
        self.ground.lying.push(place, radius);
        if let Some(surface) = &mut self.surface {
            surface.raise(&place, radius);
        }
        Added::Grain
    }

    /// Of the waiting grains the one that comes nearest to a third body when it is let go above the place of the first,
    /// and its own place.
    fn choose(&self, first: Point) -> (usize, Point) {
        let mut best = (0, first);
        let mut least = self.ground.third_gap(&first, self.waiting[0]);
        let [low, high] = [self.region.low, self.region.high];
        for (k, &radius) in self.waiting.iter().enumerate().skip(1).filter(|(_, r)| **r != self.waiting[0]) {
            let above = first[1] + 4.0 * self.ground.lying.largest();
            let x = first[0].clamp(low[0] + radius, high[0] - radius);
            let start = Point::new(x, above.min(high[1] - radius));
            let free = start[1] >= first[1] && self.ground.is_free(&start, radius);
            let rest = if free { self.ground.rest(start, radius, true) } else { None };
            if let Some(place) = rest {
                let gap = self.ground.third_gap(&place, radius);
                if gap < least {
                    (least, best) = (gap, (k, place));
                }
            }
        }
        best
    }
}

/// The place of a disc that is let go at random between the sides; none if it finds no way in.
fn drop_anywhere(region: &Region<2>, ground: &Ground, radius: f64, rng: &mut Pcg64) -> Option<Point> {
    let (low, room) = (region.low[0] + radius, region.high[0] - region.low[0] - 2.0 * radius);
    let right: bool = rng.random();
    let drop = |share: f64| {
        let start = Point::new(low + room * share, region.high[1] - radius);
        if ground.is_free(&start, radius) { ground.rest(start, radius, right) } else { None }
    };
    let steps = (4.0 * room / radius).ceil().max(1.0) as usize;
    let found = (0..TRIES).find_map(|_| drop(rng.random()));
    found.or_else(|| (0..=steps).find_map(|k| drop(k as f64 / steps as f64)))
}

/// How far down discs of one radius come at each place between the sides, before they roll.
struct Surface {
    probe: f64,
    low: f64,
    step: f64,
    columns: usize,
    /// A tree of minima over the columns: entry k is the lower one of entries 2 k and 2 k + 1.
    lowest: Vec<f64>,
}

impl Surface {
    /// The surface of walls alone, as discs of radius `probe` meet it.
    fn new(region: &Region<2>, ground: &Ground, probe: f64) -> Self {
        let room = (region.high[0] - region.low[0] - 2.0 * probe).max(0.0);
        let columns = (2.0 * room / probe).ceil().max(1.0) as usize;
        let (low, step) = (region.low[0] + probe, room / columns as f64);
        let leaves = columns.next_power_of_two();
        let mut surface = Self { probe, low, step, columns, lowest: vec![f64::INFINITY; 2 * leaves] };
        for column in 0..columns {
            let start = Point::new(surface.middle(column), region.high[1] - probe);
            if ground.is_free(&start, probe) {
                surface.lowest[leaves + column] = ground.fall(start, probe)[1];
            }
        }
        for k in (1..leaves).rev() {
            surface.lowest[k] = surface.lowest[2 * k].min(surface.lowest[2 * k + 1]);
        }
        surface
    }

    fn middle(&self, column: usize) -> f64 {
        self.low + (column as f64 + 0.5) * self.step
    }

    fn set(&mut self, column: usize, height: f64) {
        let mut k = self.lowest.len() / 2 + column;
        self.lowest[k] = height;
        while k > 1 {
            k /= 2;
            self.lowest[k] = self.lowest[2 * k].min(self.lowest[2 * k + 1]);
        }
    }

    /// One of the lowest columns, at random.
    fn find(&self, rng: &mut Pcg64) -> usize {
        let leaves = self.lowest.len() / 2;
        let mut k = 1;
        while k < leaves {
            let [left, right] = [self.lowest[2 * k], self.lowest[2 * k + 1]];
            k = 2 * k + usize::from(if left == right { rng.random() } else { right < left });
        }
        k - leaves
    }

    /// The place of a disc that is let go above the lowest place of the surface; none if the region is full.
    fn drop_lowest(
        &mut self,
        region: &Region<2>,
        ground: &Ground,
        radius: f64,
        rng: &mut Pcg64,
    ) -> Option<Point> {
        let right: bool = rng.random();
        let top = region.high[1] - radius;
        loop {
            let column = self.find(rng);
            if column >= self.columns || self.lowest[1] > top {
                return None;
            }
            let x = self.middle(column) + self.step * (rng.random::<f64>() - 0.5);
            let x = x.clamp(region.low[0] + radius, region.high[0] - radius);
            let start = Point::new(x, top);
            let found = if ground.is_free(&start, radius) { ground.rest(start, radius, right) } else { None };
            if found.is_some() {
                return found;
            }
            self.set(column, f64::INFINITY);
        }
    }

    /// Raises the surface over a new disc.
    fn raise(&mut self, place: &Point, radius: f64) {
        let reach = radius + self.probe;
        let column =
            |x: f64| ((x - self.low) / self.step.max(f64::MIN_POSITIVE)).clamp(0.0, self.columns as f64);
        let (first, last) = (column(place[0] - reach) as usize, column(place[0] + reach) as usize);
        for k in first..=last.min(self.columns - 1) {
            let aside = self.middle(k) - place[0];
            let above = reach * reach - aside * aside;
            let height = place[1] + above.max(0.0).sqrt();
            if above > 0.0 && height > self.lowest[self.lowest.len() / 2 + k] {
                self.set(k, height);
            }
        }
    }
}
