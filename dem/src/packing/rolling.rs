//! The way of one disc under gravity along -y over others and over walls, without inertia, until it rests.

use super::lying::{Lying, Segment};
use crate::Vector;

type Point = Vector<2>;

/// Gap, as a share of the radius, at which a disc counts as touching.
const TOUCH: f64 = 1e-8;
/// Components of directions below this are zero.
const FLAT: f64 = 1e-9;
/// Slopes that differ by less are the same.
const SAME: f64 = 1e-6;
/// Sine of the angle below which discs graze each other: a way that grazes overlaps by less than 1e-9 of a radius and
/// goes on.
const GRAZE: f64 = 3e-5;
/// Parts of the way at most. The way goes down throughout: only rounding could make it endless.
const MOST_PARTS: usize = 100_000;

/// Where discs roll: over those that lie, and over walls.
pub(super) struct Ground {
    pub lying: Lying,
    walls: Vec<Segment>,
    /// Height of the lowest wall, m.
    lowest: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Body {
    Disc(usize),
    Wall(usize),
}

/// What the disc touches; the normal points to its centre.
#[derive(Clone, Copy)]
struct Touch {
    body: Body,
    normal: Point,
}

/// A part of the way of the centre.
#[derive(Clone, Copy)]
enum Part {
    /// Straight on in a direction for a length; a fall, or along a wall.
    Line { start: Point, direction: Point, length: f64 },
    /// About a centre, towards +x (`sense` 1) or -x (-1), down to `end`: the tangent of half the angle turned.
    Arc { centre: Point, arm: Point, sense: f64, end: f64 },
}

impl Part {
    /// Tangent of half the angle by which the arm is turned to become `arm`; infinite for half a turn.
    fn turned(from: &Point, to: &Point, sense: f64) -> f64 {
        let cross = from[0] * to[1] - from[1] * to[0];
        let (sine, cosine) = (-sense * cross, from.dot(to));
        let length = from.norm_squared();
        if length + cosine <= 1e-12 * length { f64::INFINITY } else { sine / (length + cosine) }
    }

    /// Where it ends, and how far that is.
    fn end(&self) -> (f64, Point) {
        match *self {
            Part::Line { start, direction, length } => (length, start + direction * length),
            Part::Arc { centre, arm, sense, end } => {
                // By the half angle: 1 + cos = 2 / (1 + t^2), sin = 2 t / (1 + t^2).
                let (sine, cosine) = (2.0 * end / (1.0 + end * end), (1.0 - end * end) / (1.0 + end * end));
                let side = Point::new(sense * arm[1], -sense * arm[0]);
                (end, centre + arm * cosine + side * sine)
            }
        }
    }

    /// A box around the part.
    fn bounds(&self) -> (Point, Point) {
        let (_, end) = self.end();
        let start = match *self {
            Part::Line { start, .. } => start,
            Part::Arc { centre, arm, .. } => centre + arm,
        };
        // An arc stays within a quarter of a circle, from the top downwards: its ends span it.
        (start.inf(&end), start.sup(&end))
    }

    /// How far along the part the disc first comes within `reach` of a point, and where; only where it comes nearer.
    fn meets_point(&self, at: &Point, reach: f64) -> Option<(f64, Point)> {
        match *self {
            Part::Line { start, direction, .. } => {
                let arm = start - at;
                let closing = -arm.dot(&direction);
                let nearest = (arm + direction * closing).norm_squared();
                let half = reach * reach - nearest;
                if closing <= FLAT * reach || half <= (GRAZE * reach).powi(2) {
                    return None;
                }
                let way = closing - half.sqrt();
                Some((way, start + direction * way))
            }
            Part::Arc { centre, arm, sense, .. } => {
                let between = at - centre;
                let (apart, own) = (between.norm_squared(), arm.norm_squared());
                let along = 0.5 * (apart + own - reach * reach);
                let across = own * apart - along * along;
                if across <= GRAZE * GRAZE * own * apart {
                    return None;
                }
                let side = Point::new(-between[1], between[0]) * (sense * across.sqrt());
                let to = (between * along + side) / apart;
                Some((Self::turned(&arm, &to, sense), centre + to))
            }
        }
    }

    /// The same for the sides of a wall, without its ends.
    fn meets_wall(&self, wall: &Segment, radius: f64) -> Option<(f64, Point)> {
        let on_wall = |x: &Point| {
            let along = (x - wall.from).dot(&wall.along);
            along >= 0.0 && along <= wall.length
        };
        match *self {
            Part::Line { start, direction, .. } => {
                let height = (start - wall.from).dot(&wall.side());
                let normal = wall.side() * if height < 0.0 { -1.0 } else { 1.0 };
                let closing = -direction.dot(&normal);
                if closing <= FLAT {
                    return None;
                }
                let way = (height.abs() - radius) / closing;
                let x = start + direction * way;
                on_wall(&x).then_some((way, x))
            }
            Part::Arc { centre, arm, sense, .. } => {
                let own = arm.norm_squared();
                let meet = |normal: Point| {
                    let along = radius - (centre - wall.from).dot(&normal);
                    let across = own - along * along;
                    if across <= 0.0 {
                        return None;
                    }
                    let side = Point::new(-normal[1], normal[0]) * (sense * across.sqrt());
                    let to = normal * along - side;
                    let x = centre + to;
                    on_wall(&x).then(|| (Self::turned(&arm, &to, sense), x))
                };
                let both = [meet(wall.side()), meet(-wall.side())];
                both.into_iter()
                    .flatten()
                    .filter(|(way, _)| *way >= -TOUCH)
                    .min_by(|a, b| a.0.total_cmp(&b.0))
            }
        }
    }
}

/// The first body on a part of the way, as far as known.
struct First {
    back: f64,
    way: f64,
    at: Point,
}

impl First {
    fn take(&mut self, met: Option<(f64, Point)>) {
        if let Some((way, at)) = met.filter(|(way, _)| *way >= self.back && *way < self.way) {
            (self.way, self.at) = (way, at);
        }
    }
}

impl Ground {
    /// Walls must close the region below and at its sides.
    pub fn new(lying: Lying, walls: Vec<Segment>) -> Self {
        let lowest = walls.iter().fold(f64::MAX, |low, wall| low.min(wall.from[1]).min(wall.to()[1]));
        Self { lying, walls, lowest }
    }

    /// Whether a disc overlaps nothing here.
    pub fn is_free(&self, x: &Point, radius: f64) -> bool {
        let slack = TOUCH * radius;
        let mut free = self.walls.iter().all(|wall| wall.arm(x).norm() >= radius - slack);
        let reach = Point::repeat(radius);
        self.lying.near(x - reach, x + reach, |k| {
            let apart = radius + self.lying.radius[k] - slack;
            free &= (self.lying.position[k] - x).norm_squared() >= apart * apart;
        });
        free
    }

    /// Where a disc rests that is let go at `x`; none if it finds no rest. `right` says to which side it leaves a top.
    pub fn rest(&self, x: Point, radius: f64, right: bool) -> Option<Point> {
        let (mut x, mut touches) = (x, Vec::new());
        let mut still = 0;
        for _ in 0..MOST_PARTS {
            self.touching(&x, radius, &mut touches);
            let Some((part, passed)) = self.descent(&x, radius, &touches, right) else { return Some(x) };
            let to = self.follow(&part, radius, passed);
            // What rounding holds in place rests: its supports are parallel to within it.
            still = if (to - x).norm() > TOUCH * radius { 0 } else { still + 1 };
            x = to;
            if still > 8 {
                return Some(x);
            }
        }
        None
    }

    /// How far a disc in its place is from a third body, m: zero if it touches three, infinite if none is within a
    /// diameter.
    pub fn third_gap(&self, x: &Point, radius: f64) -> f64 {
        // The three smallest gaps, in order.
        let mut gaps = [f64::INFINITY; 3];
        let mut take = |gap: f64| {
            let k = gaps.iter().position(|least| gap < *least).unwrap_or(3);
            if k < 3 {
                gaps[k..].rotate_right(1);
                gaps[k] = gap;
            }
        };
        self.walls.iter().for_each(|wall| take(wall.arm(x).norm() - radius));
        let reach = Point::repeat(2.0 * radius);
        self.lying.near(x - reach, x + reach, |k| {
            take((x - self.lying.position[k]).norm() - radius - self.lying.radius[k]);
        });
        if gaps[2] <= 2.0 * radius { gaps[2].max(0.0) } else { f64::INFINITY }
    }

    /// Where a disc that falls from `x` first touches something.
    pub fn fall(&self, x: Point, radius: f64) -> Point {
        self.follow(&self.downwards(&x), radius, &[])
    }

    fn downwards(&self, x: &Point) -> Part {
        Part::Line { start: *x, direction: Point::new(0.0, -1.0), length: x[1] - self.lowest }
    }

    fn touching(&self, x: &Point, radius: f64, touches: &mut Vec<Touch>) {
        touches.clear();
        let slack = TOUCH * radius;
        for (k, wall) in self.walls.iter().enumerate() {
            let arm = wall.arm(x);
            if arm.norm() <= radius + slack {
                touches.push(Touch { body: Body::Wall(k), normal: arm.normalize() });
            }
        }
        let walls = touches.len();
        let reach = Point::repeat(radius + slack);
        self.lying.near(x - reach, x + reach, |k| {
            let arm = x - self.lying.position[k];
            let apart = radius + self.lying.radius[k] + slack;
            if arm.norm_squared() <= apart * apart {
                let normal = arm.normalize();
                // A disc that touches a wall from behind is not in the way.
                if touches[..walls].iter().all(|wall| wall.normal.dot(&normal) < 1.0 - SAME) {
                    touches.push(Touch { body: Body::Disc(k), normal });
                }
            }
        });
    }

    /// The steepest way down that nothing touched forbids, and what is touched and not in its way; none at rest.
    fn descent<'a>(
        &self,
        x: &Point,
        radius: f64,
        touches: &'a [Touch],
        right: bool,
    ) -> Option<(Part, &'a [Touch])> {
        if touches.iter().all(|touch| touch.normal[1] <= FLAT) {
            return Some((self.downwards(x), touches));
        }
        if touches.iter().any(|touch| self.is_level(touch)) {
            return None;
        }
        let mut best: Option<(f64, Part, &Touch)> = None;
        for touch in touches.iter().filter(|touch| touch.normal[1] > FLAT) {
            for sense in if right { [1.0, -1.0] } else { [-1.0, 1.0] } {
                let tangent = Point::new(touch.normal[1], -touch.normal[0]) * sense;
                let free = touches.iter().all(|o| o.body == touch.body || tangent.dot(&o.normal) >= -FLAT);
                if !free || tangent[1] > 0.0 {
                    continue;
                }
                let part = self.part(x, radius, touch, &tangent, sense);
                let better = best.as_ref().is_none_or(|(slope, other, _)| {
                    // Where a wall goes on at the end of another, the way around the end leads into it.
                    let shorter = match (&part, other) {
                        (Part::Line { .. }, Part::Arc { .. }) => true,
                        (Part::Arc { end, .. }, Part::Arc { end: other, .. }) => end < other,
                        _ => false,
                    };
                    tangent[1] < slope + if shorter { SAME } else { -SAME }
                });
                if better {
                    best = Some((tangent[1], part, touch));
                }
            }
        }
        best.map(|(_, part, touch)| (part, std::slice::from_ref(touch)))
    }

    /// Whether a disc rests on what it touches alone: a level wall below it.
    fn is_level(&self, touch: &Touch) -> bool {
        match touch.body {
            Body::Disc(_) => false,
            Body::Wall(k) => {
                touch.normal[1] > 0.0
                    && touch.normal.dot(&self.walls[k].along).abs() < FLAT
                    && self.walls[k].along[1].abs() < FLAT
            }
        }
    }

    /// The way along what is touched in the direction of a tangent.
    fn part(&self, x: &Point, radius: f64, touch: &Touch, tangent: &Point, sense: f64) -> Part {
        match touch.body {
            Body::Disc(k) => {
                let reach = radius + self.lying.radius[k];
                Self::arc(self.lying.position[k], touch.normal * reach, sense, f64::INFINITY)
            }
            Body::Wall(k) => {
                let wall = &self.walls[k];
                let at = wall.nearest(x);
                let slack = TOUCH * radius;
                let outward = if at <= slack { -wall.along } else { wall.along };
                let at_end = at <= slack || at >= wall.length - slack;
                if at_end && (tangent.dot(&outward) > FLAT || touch.normal.dot(&outward) > FLAT) {
                    // Around the end, to the other side at most.
                    let centre = if at <= slack { wall.from } else { wall.to() };
                    let other = Point::new(-outward[1], outward[0]) * (-sense * radius);
                    let end = Part::turned(&(touch.normal * radius), &other, sense);
                    return Self::arc(centre, touch.normal * radius, sense, end.max(0.0));
                }
                let left = if tangent.dot(&wall.along) > 0.0 { wall.length - at } else { at };
                Part::Line { start: *x, direction: *tangent, length: left }
            }
        }
    }

    /// An arc down to where the centre is level with that of the arc.
    fn arc(centre: Point, arm: Point, sense: f64, end: f64) -> Part {
        let level = Part::turned(&arm, &Point::new(sense * arm.norm(), 0.0), sense);
        Part::Arc { centre, arm, sense, end: level.min(end) }
    }

    /// Where a part of the way ends: at its own end or at the first body in the way, but for those it passes.
    fn follow(&self, part: &Part, radius: f64, passed: &[Touch]) -> Point {
        let passes = |body: Body| passed.iter().any(|touch| touch.body == body);
        let (way, at) = part.end();
        let back = -TOUCH * if let Part::Line { .. } = part { radius } else { 1.0 };
        let mut first = First { back, way, at };
        let reach = Point::repeat(radius * (1.0 + TOUCH));
        let (low, high) = part.bounds();
        for (k, wall) in self.walls.iter().enumerate() {
            if !passes(Body::Wall(k)) && wall.meets(&(low - reach), &(high + reach)) {
                first.take(part.meets_wall(wall, radius));
                first.take(part.meets_point(&wall.from, radius));
                first.take(part.meets_point(&wall.to(), radius));
            }
        }
        let look = |low: Point, high: Point, first: &mut First| {
            self.lying.near(low - reach, high + reach, |k| {
                if !passes(Body::Disc(k)) {
                    let apart = radius + self.lying.radius[k];
                    first.take(part.meets_point(&self.lying.position[k], apart));
                }
            });
        };
        match *part {
            Part::Arc { .. } => look(low, high, &mut first),
            // A long line is looked at piece by piece, from where discs may be on.
            Part::Line { start, direction, .. } => {
                let above = start[1] - radius - self.lying.top;
                let mut from = if above > 0.0 && direction[1] < 0.0 { -above / direction[1] } else { 0.0 };
                while from < first.way {
                    let to = (from + 4.0 * self.lying.largest()).min(first.way);
                    let (a, b) = (start + direction * from, start + direction * to);
                    look(a.inf(&b), a.sup(&b), &mut first);
                    from = to;
                }
            }
        }
        first.at
    }
}
