//! Walls: straight segments, fixed or moving by a law of time.

use crate::error::{Error, Result, check};
use crate::space::Vector;
use serde::{Deserialize, Serialize};

/// How a wall moves; its end points at time t follow from those at t = 0, so a restart needs the time only.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Motion<const D: usize> {
    /// Not at all.
    #[default]
    Fixed,
    /// With a constant velocity.
    Translation {
        /// Velocity, m/s.
        velocity: Vector<D>,
    },
    /// Along a line as sin(2 pi frequency t + phase) - sin(phase).
    Oscillation {
        /// Amplitude, m.
        amplitude: Vector<D>,
        /// Frequency, Hz.
        frequency: f64,
        /// Phase at t = 0, rad.
        phase: f64,
    },
    /// About a fixed centre, counter-clockwise (plane only).
    Rotation {
        /// Centre, m.
        centre: Vector<D>,
        /// Angular velocity, rad/s.
        rate: f64,
    },
    /// By a table, linear between its rows and at rest before the first and after the last (plane only): a turn about
    /// a centre that is carried along, both measured from where the wall is given.
    Table {
        /// Centre of the turn where the wall is given, m.
        centre: Vector<D>,
        /// Rows of time (s, increasing), way along the first and the last axis (m), angle (rad, counter-clockwise).
        rows: Vec<[f64; 4]>,
    },
}

impl<const D: usize> Motion<D> {
    /// Where a point is at a time, m, that is at `x` before the motion.
    pub fn carry(&self, x: Vector<D>, time: f64) -> Vector<D> {
        match self {
            Self::Fixed => x,
            Self::Translation { velocity } => x + velocity * time,
            Self::Oscillation { amplitude, frequency, phase } => {
                let angle = std::f64::consts::TAU * frequency * time + phase;
                x + amplitude * (angle.sin() - phase.sin())
            }
            Self::Rotation { centre, rate } => turned(x, centre, rate * time),
            Self::Table { centre, rows } => {
                let (way, angle) = way(rows, time);
                turned(x, centre, angle) + way
            }
        }
    }

    /// Where a point was before the motion, m, that is at `x` at a time: the inverse of [`Self::carry`].
    pub fn uncarry(&self, x: Vector<D>, time: f64) -> Vector<D> {
        match self {
            Self::Fixed | Self::Translation { .. } | Self::Oscillation { .. } => x + x - self.carry(x, time),
            Self::Rotation { centre, rate } => turned(x, centre, -rate * time),
            Self::Table { centre, rows } => {
                let (way, angle) = way(rows, time);
                turned(x - way, centre, -angle)
            }
        }
    }
}

/// A straight wall that grains meet from either side, and at its ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall<const D: usize> {
    /// Name, for reports.
    pub name: String,
    /// End points at t = 0, m.
    pub points: [Vector<D>; 2],
    /// Coulomb's coefficient between grains and this wall.
    #[serde(default)]
    pub friction: f64,
    /// Coefficient of resistance to rolling between grains and this wall, 0 to 1: a moment of up to mu_r r p_n.
    #[serde(default)]
    pub rolling: f64,
    /// Newton's coefficient of restitution between grains and this wall.
    #[serde(default)]
    pub restitution: f64,
    /// How it moves.
    #[serde(default)]
    pub motion: Motion<D>,
    /// Time at which it vanishes, s; none: never.
    #[serde(default)]
    pub until: Option<f64>,
    /// Temperature, K; none: no heat passes.
    #[serde(default)]
    pub temperature: Option<f64>,
    /// Thermal conductivity, W/m/K; none: a perfect conductor.
    #[serde(default)]
    pub conductivity: Option<f64>,
}

impl<const D: usize> Wall<D> {
    /// A fixed wall without friction or heat.
    pub fn new(name: impl Into<String>, from: Vector<D>, to: Vector<D>) -> Self {
        Self {
            name: name.into(),
            points: [from, to],
            friction: 0.0,
            rolling: 0.0,
            restitution: 0.0,
            motion: Motion::Fixed,
            until: None,
            temperature: None,
            conductivity: None,
        }
    }

    /// Whether it is still there at a time.
    pub fn stands(&self, time: f64) -> bool {
        // Times are sums of steps.
        self.until.is_none_or(|until| time < until - 1e-9 * until.abs())
    }

    /// End points at a time, m, as if it never vanished.
    pub fn at(&self, time: f64) -> [Vector<D>; 2] {
        self.points.map(|x| self.motion.carry(x, time))
    }

    /// The point about which the wall turns, at a time; none of a wall that does not turn.
    pub fn pivot(&self, time: f64) -> Option<Vector<D>> {
        match &self.motion {
            Motion::Fixed | Motion::Translation { .. } | Motion::Oscillation { .. } => None,
            Motion::Rotation { centre, .. } => Some(*centre),
            Motion::Table { centre, rows } => Some(centre + way(rows, time).0),
        }
    }

    /// Whether the end points depend on time.
    pub fn moves(&self) -> bool {
        self.motion != Motion::Fixed
    }

    pub(crate) fn validate(&self) -> Result<()> {
        let at = |name: &str| format!("wall {:?}, {name}", self.name);
        for x in self.points.iter().flat_map(|p| p.iter()) {
            check(x.is_finite(), *x, "it must be finite", || at("end point"))?;
        }
        if self.points[0] == self.points[1] {
            return Err(Error::Scene(format!("wall {:?}: its two end points coincide", self.name)));
        }
        check(
            self.friction >= 0.0 && self.friction.is_finite(),
            self.friction,
            "it must be 0 or more",
            || at("friction"),
        )?;
        check((0.0..=1.0).contains(&self.rolling), self.rolling, "it must lie in 0 .. 1", || at("rolling"))?;
        check((0.0..=1.0).contains(&self.restitution), self.restitution, "it must lie in 0 .. 1", || {
            at("restitution")
        })?;
        let until = self.until.unwrap_or(0.0);
        check(until.is_finite(), until, "it must be finite", || at("time at which it vanishes"))?;
        let temperature = self.temperature.unwrap_or(0.0);
        check(temperature.is_finite(), temperature, "it must be finite", || at("temperature"))?;
        let conductivity = self.conductivity.unwrap_or(1.0);
        check(conductivity > 0.0, conductivity, "it must be positive", || at("conductivity"))?;
        let law = match &self.motion {
            Motion::Fixed => vec![],
            Motion::Translation { velocity } => velocity.iter().copied().collect(),
            Motion::Oscillation { amplitude, frequency, phase } => {
                amplitude.iter().copied().chain([*frequency, *phase]).collect()
            }
            Motion::Rotation { centre, rate } => centre.iter().copied().chain([*rate]).collect(),
            Motion::Table { centre, rows } => {
                let increasing = rows.windows(2).all(|pair| pair[0][0] < pair[1][0]);
                if rows.is_empty() || !increasing {
                    let name = &self.name;
                    return Err(Error::Scene(format!(
                        "wall {name:?}: its times must increase, and one is needed"
                    )));
                }
                centre.iter().copied().chain(rows.iter().flatten().copied()).collect()
            }
        };
        law.iter().try_for_each(|&x| check(x.is_finite(), x, "it must be finite", || at("motion")))
    }
}

/// Way, m, and angle, rad, of a table at a time.
fn way<const D: usize>(rows: &[[f64; 4]], time: f64) -> (Vector<D>, f64) {
    let after = rows.partition_point(|row| row[0] <= time);
    let (low, high) = (rows[after.saturating_sub(1)], rows[after.min(rows.len() - 1)]);
    let share = if high[0] > low[0] { ((time - low[0]) / (high[0] - low[0])).clamp(0.0, 1.0) } else { 0.0 };
    let [x, y, angle]: [f64; 3] = std::array::from_fn(|k| low[k + 1] + (high[k + 1] - low[k + 1]) * share);
    let mut way = Vector::zeros();
    (way[0], way[D - 1]) = (x, y);
    (way, angle)
}

/// A point turned about a centre, counter-clockwise in the plane of the first two axes.
fn turned<const D: usize>(x: Vector<D>, centre: &Vector<D>, angle: f64) -> Vector<D> {
    let (sin, cos) = angle.sin_cos();
    let (arm, mut turned) = (x - centre, x);
    turned[0] = centre[0] + cos * arm[0] - sin * arm[1];
    turned[1] = centre[1] + sin * arm[0] + cos * arm[1];
    turned
}

/// A wall over one sub-step: where it is at the start, and the velocity that carries its end points exactly
/// to where they are at the end (the secant, so that predicted gaps are those of the next start).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed<const D: usize> {
    pub points: [Vector<D>; 2],
    pub velocity: [Vector<D>; 2],
    /// Whether it has vanished: no grain meets it.
    pub gone: bool,
}

impl<const D: usize> Placed<D> {
    pub fn new(wall: &Wall<D>, time: f64, h: f64) -> Self {
        let (points, gone) = (wall.at(time), !wall.stands(time));
        if gone || !wall.moves() {
            return Self { points, velocity: [Vector::zeros(); 2], gone };
        }
        let next = wall.at(time + h);
        Self { points, velocity: [(next[0] - points[0]) / h, (next[1] - points[1]) / h], gone }
    }

    /// The point nearest to `x`, as its share of the way from the first to the second end.
    #[inline]
    pub fn nearest(&self, x: &Vector<D>) -> f64 {
        let along = self.points[1] - self.points[0];
        ((x - self.points[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
    }

    #[inline]
    pub fn point(&self, share: f64) -> Vector<D> {
        self.points[0] + (self.points[1] - self.points[0]) * share
    }

    #[inline]
    pub fn velocity_at(&self, share: f64) -> Vector<D> {
        self.velocity[0] + (self.velocity[1] - self.velocity[0]) * share
    }

    /// Angular velocity, rad/s, counter-clockwise.
    pub fn spin(&self) -> f64 {
        let along = self.points[1] - self.points[0];
        crate::space::turned(&along).dot(&(self.velocity[1] - self.velocity[0])) / along.norm_squared()
    }

    /// The wall at the end of a sub-step of length `h`.
    pub fn after(&self, h: f64) -> Self {
        let points = [self.points[0] + self.velocity[0] * h, self.points[1] + self.velocity[1] * h];
        Self { points, ..*self }
    }

    /// A unit vector orthogonal to the wall, for a grain whose centre lies on it.
    pub fn side(&self) -> Vector<D> {
        crate::space::turned(&(self.points[1] - self.points[0]).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_follow_their_laws() {
        let mut wall = Wall::<2>::new("lid", Vector::<2>::new(1.0, 0.0), Vector::<2>::new(2.0, 0.0));
        wall.motion = Motion::Rotation { centre: Vector::zeros(), rate: std::f64::consts::FRAC_PI_2 };
        let [a, b] = wall.at(1.0);
        approx::assert_relative_eq!(a, Vector::<2>::new(0.0, 1.0), epsilon = 1e-15);
        approx::assert_relative_eq!(b, Vector::<2>::new(0.0, 2.0), epsilon = 1e-15);
        wall.motion =
            Motion::Oscillation { amplitude: Vector::<2>::new(0.0, 0.1), frequency: 0.5, phase: 0.0 };
        approx::assert_relative_eq!(wall.at(0.5)[0], Vector::<2>::new(1.0, 0.1));
        let placed = Placed::new(&wall, 0.0, 0.5);
        approx::assert_relative_eq!(placed.velocity_at(0.3), Vector::<2>::new(0.0, 0.2));
    }

    #[test]
    fn walls_vanish_and_are_not_met_then() {
        let (a, b) = (Vector::<2>::new(1.0, 0.0), Vector::<2>::new(2.0, 0.0));
        let wall =
            Wall { until: Some(0.3), motion: Motion::Translation { velocity: b }, ..Wall::new("gate", a, b) };
        assert!(
            wall.stands(0.0) && wall.stands(0.299) && !wall.stands(0.1 + 0.2 - 1e-12) && !wall.stands(9.0)
        );
        approx::assert_relative_eq!(Placed::new(&wall, 0.2, 0.1).velocity_at(0.5), b, max_relative = 1e-14);
        let gone = Placed::new(&wall, 0.3, 0.1);
        assert!(gone.gone && gone.velocity_at(0.5).norm() == 0.0);
    }

    #[test]
    fn walls_follow_tables() {
        let mut wall = Wall::<2>::new("bar", Vector::<2>::new(1.0, 0.0), Vector::<2>::new(2.0, 0.0));
        let quarter = std::f64::consts::FRAC_PI_2;
        let rows = vec![[1.0, 0.0, 0.0, 0.0], [2.0, 0.4, 0.2, quarter], [4.0, 0.0, 0.2, quarter]];
        wall.motion = Motion::Table { centre: Vector::<2>::new(1.0, 0.0), rows };
        assert_eq!(wall.at(0.5), wall.points);
        approx::assert_relative_eq!(wall.at(2.0)[0], Vector::<2>::new(1.4, 0.2), epsilon = 1e-15);
        approx::assert_relative_eq!(wall.at(2.0)[1], Vector::<2>::new(1.4, 1.2), epsilon = 1e-15);
        approx::assert_relative_eq!(wall.at(3.0)[1], Vector::<2>::new(1.2, 1.2), epsilon = 1e-15);
        approx::assert_relative_eq!(wall.at(9.0)[1], Vector::<2>::new(1.0, 1.2), epsilon = 1e-15);
        approx::assert_relative_eq!(wall.pivot(1.5).unwrap(), Vector::<2>::new(1.2, 0.1), epsilon = 1e-15);
        wall.motion = Motion::Table { centre: Vector::zeros(), rows: vec![[1.0; 4], [1.0; 4]] };
        assert!(wall.validate().is_err());
    }

    #[test]
    fn the_nearest_point_stays_on_the_segment() {
        let wall = Wall::<2>::new("floor", Vector::zeros(), Vector::<2>::new(2.0, 0.0));
        let placed = Placed::new(&wall, 0.0, 1.0);
        assert_eq!(placed.nearest(&Vector::<2>::new(0.5, 1.0)), 0.25);
        assert_eq!(placed.nearest(&Vector::<2>::new(-3.0, 1.0)), 0.0);
    }
}
