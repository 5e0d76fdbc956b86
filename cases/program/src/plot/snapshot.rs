//! Pictures of recorded moments: grains over a scalar of the fluid, over the voidage, or the speed of the fluid.

use super::boundary::{self, Part};
use super::hole::{self, Track};
use super::plane::{Entry, Plane, Scale};
use crate::results::Moment;
use colorous::Gradient;
use plotters::style::RGBColor;
use plotters::style::colors::{BLACK, WHITE};
use rayon::prelude::*;
use std::borrow::{Borrow, Cow};
use std::collections::BTreeMap;
use std::path::Path;
use voidage_coupling::Result;
use voidage_scene::Scene;
use voidage_scene::build::wall as wall_at;
use voidage_scene::recorder::{Frame, read_frame};

/// Share of the lowest and of the highest values that do not stretch the colours of a picture.
pub const EXTREME: f64 = 0.01;

/// Colours of a droplet and of its outline.
const LIQUID: [u8; 3] = [195, 226, 255];
const RIM: RGBColor = RGBColor(0, 90, 180);
/// Colour of the arrows of the fluid.
const STREAM: RGBColor = RGBColor(30, 100, 190);
/// Arrows across the longer side of a picture.
const ARROWS: f64 = 24.0;
/// The column of the forces that chains show.
const FORCE: &str = "normal_force_N_per_m";
/// Colour of the outline of held grains.
const HELD: RGBColor = RGBColor(120, 120, 120);

/// What is drawn of a moment.
pub struct Picture {
    time: f64,
    grains: Option<Frame>,
    fluid: Option<Frame>,
    /// The polygon of the droplet, m.
    droplet: Option<Vec<[f64; 2]>>,
}

impl Picture {
    /// Reads the files of a moment; the droplet is where the track says.
    pub fn read(moment: &Moment, track: Option<&Track>) -> Result<Picture> {
        let grains = moment.grains.as_deref().map(read_frame).transpose()?;
        let fluid = moment.fluid.as_deref().map(read_frame).transpose()?;
        let droplet = fluid.as_ref().zip(track);
        let droplet = droplet.and_then(|(fluid, track)| hole::around(fluid, track.centre(moment.time)));
        Ok(Picture { time: moment.time, grains, fluid, droplet })
    }

    /// Fields of the fluid that are those of no moment.
    pub fn of_fields(frame: Frame) -> Picture {
        Picture { time: 0.0, grains: None, fluid: Some(frame), droplet: None }
    }

    /// What stands above the picture.
    pub fn title(&self) -> String {
        format!("t = {:.3} s", self.time)
    }

    /// What grains are coloured by: temperature, or speed without one; nothing where all are held and would hide a
    /// scalar.
    fn grain_values(&self, scene: &Scene) -> Option<(Quantity, Cow<'_, [f64]>)> {
        let grains = self.grains.as_ref()?;
        match grains.column("temperature_K") {
            Some(temperature) => Some((Quantity::Temperature, Cow::from(temperature))),
            None if self.scalar(scene).is_some() && scene.grains.iter().all(|group| group.fixed) => None,
            None => Some((Quantity::GrainSpeed, Cow::from(speeds(grains)))),
        }
    }

    /// The first scalar that the fluid carries beside its temperature.
    fn scalar(&self, scene: &Scene) -> Option<(Quantity, Cow<'_, [f64]>)> {
        let name = &scene.fluid.as_ref()?.scalars.first()?.name;
        let values = self.fluid.as_ref()?.column(name)?;
        Some((Quantity::Scalar(name.clone()), Cow::from(values)))
    }

    /// What the fluid is coloured by: a scalar where it carries one, or the voidage, or its speed.
    fn field_values(&self, scene: &Scene) -> Option<(Quantity, Cow<'_, [f64]>)> {
        let fluid = self.fluid.as_ref()?;
        self.scalar(scene).or_else(|| {
            Some(match fluid.column("voidage") {
                Some(voidage) => (Quantity::Voidage, Cow::from(voidage)),
                None => (Quantity::FluidSpeed, Cow::from(speeds(fluid))),
            })
        })
    }

    /// The part of the plane that is worth showing: left, bottom, right, top, m.
    fn bounds(&self, scene: &Scene) -> [f64; 4] {
        let mut points: Vec<[f64; 3]> = Vec::new();
        points.extend(self.fluid.iter().flat_map(|fluid| &fluid.points));
        let mut margin = 0.0;
        if self.fluid.is_none() {
            if let Some(grains) = &self.grains {
                let radius = grains.column("radius_m").unwrap_or(&[]);
                let ends = grains.points.iter().zip(radius);
                points.extend(ends.flat_map(|([x, y, z], r)| [[x - r, y - r, *z], [x + r, y + r, *z]]));
            }
            let period = scene.period();
            let ends = scene.walls.iter().flat_map(|wall| period.place(wall_at(scene, wall).at(self.time)));
            points.extend(ends.map(|end| [end.x, end.y, 0.0]));
            margin = 0.03;
        }
        let least = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
        let most = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
        let [left, bottom, right, top] = [least(0), least(1), most(0), most(1)];
        let margin = margin * (right - left).max(top - bottom);
        let mut bounds = [left - margin, bottom - margin, right + margin, top + margin];
        if let (Some(grains), Some(_)) = (&self.grains, &self.fluid) {
            let radius = grains.column("radius_m").unwrap_or(&[]);
            let ends = |([x, y, _], r): (&[f64; 3], &f64)| [[x - r, y - r], [x + r, y + r]];
            let grains = grains.points.iter().zip(radius).flat_map(ends);
            leave_out_empty(&mut bounds, grains.chain(self.droplet.iter().flatten().copied()));
        }
        bounds
    }
}

/// What colours show.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Quantity {
    Temperature,
    GrainSpeed,
    /// By its name.
    Scalar(String),
    Voidage,
    FluidSpeed,
}

impl Quantity {
    /// The colours of values within bounds.
    fn scale(&self, [low, high]: [f64; 2]) -> Scale {
        // Where all values are zero, as the speeds of a bed at rest, any bounds do.
        let size = high.abs().max(low.abs());
        let least = if size == 0.0 { 1.0 } else { 1e-3 * size };
        let (low, high) = if high - low < least { (low - least, high + least) } else { (low, high) };
        let scale = |name: &str, gradient: Gradient, [low, high]: [f64; 2], part: [f64; 2]| Scale {
            name: name.to_owned(),
            gradient,
            low,
            high,
            part,
        };
        match self {
            Self::Temperature => scale("grain temperature (K)", colorous::INFERNO, [low, high], [0.08, 0.95]),
            Self::GrainSpeed => scale("grain speed (m/s)", colorous::VIRIDIS, [0.0, high], [0.0, 1.0]),
            Self::FluidSpeed => scale("fluid speed (m/s)", colorous::VIRIDIS, [0.0, high], [0.0, 1.0]),
            // From white (none) to dark grey (nothing else); most scalars are shares.
            Self::Scalar(name) => scale(
                name,
                colorous::GREYS,
                [low.min(0.0), if high > 0.1 { high.max(1.0) } else { high }],
                [0.0, 0.68],
            ),
            // From grey (packed) to white (fluid only).
            Self::Voidage => scale("voidage", colorous::GREYS, [0.3, 1.0], [0.65, 0.0]),
        }
    }
}

/// What of the plane is shown, and within which bounds values are coloured.
#[derive(Clone, Debug)]
pub struct View {
    bounds: [f64; 4],
    grains: Option<(Quantity, [f64; 2])>,
    field: Option<(Quantity, [f64; 2])>,
    /// Largest velocity of the fluid, m/s; 0 without a fluid, or at rest.
    stream: f64,
    /// The parts of the boundary of the fluid.
    parts: Vec<Part>,
}

impl View {
    /// That of one picture, whose colours are not stretched by this share of its values at either end.
    fn of(picture: &Picture, scene: &Scene, extreme: f64) -> Result<View> {
        let within = |(quantity, values): (Quantity, Cow<[f64]>)| (quantity, inner(&values, extreme));
        let speeds = picture.fluid.as_ref().map(speeds).unwrap_or_default();
        Ok(View {
            bounds: picture.bounds(scene),
            grains: picture.grain_values(scene).map(within),
            field: picture.field_values(scene).map(within),
            stream: speeds.into_iter().filter(|speed| speed.is_finite()).fold(0.0, f64::max),
            parts: boundary::parts(scene)?,
        })
    }

    /// One that serves all moments of a run; none without moments. Of each, this share of values at either end does not
    /// stretch the colours.
    pub fn over(
        moments: &[impl Borrow<Moment> + Sync],
        scene: &Scene,
        track: Option<&Track>,
        extreme: f64,
    ) -> Result<Option<View>> {
        let views = moments.par_iter().map(|moment| {
            let picture = Picture::read(moment.borrow(), track)?;
            View::of(&picture, scene, extreme).map(Some)
        });
        let join = |a: Option<View>, b: Option<View>| match (a, b) {
            (Some(a), Some(b)) => Some(a.join(&b)),
            (one, other) => one.or(other),
        };
        views.try_reduce(|| None, |a, b| Ok(join(a, b)))
    }

    /// One that shows what either does.
    pub fn join(&self, other: &View) -> View {
        let [left, bottom, right, top] = self.bounds;
        let bounds = [
            left.min(other.bounds[0]),
            bottom.min(other.bounds[1]),
            right.max(other.bounds[2]),
            top.max(other.bounds[3]),
        ];
        let join = |a: &Option<(Quantity, [f64; 2])>, b: &Option<(Quantity, [f64; 2])>| match (a, b) {
            (Some((quantity, [a, b])), Some((_, [c, d]))) => Some((quantity.clone(), [a.min(*c), b.max(*d)])),
            (one, other) => one.clone().or_else(|| other.clone()),
        };
        View {
            bounds,
            grains: join(&self.grains, &other.grains),
            field: join(&self.field, &other.field),
            stream: self.stream.max(other.stream),
            parts: self.parts.clone(),
        }
    }

    /// Colour bars: of the grains, and of the fluid.
    fn scales(&self) -> [Option<Scale>; 2] {
        [&self.grains, &self.field].map(|shown| Some(shown.as_ref()?.0.scale(shown.as_ref()?.1)))
    }

    /// An empty picture with a pane for each title; none where there is nothing to show.
    pub fn plane(&self, path: &Path, titles: &[String]) -> Result<Option<Plane>> {
        let scales: Vec<Scale> = self.scales().into_iter().flatten().collect();
        let shown = self.bounds.iter().all(|bound| bound.is_finite());
        shown.then(|| Plane::panes(path, self.bounds, titles, &scales, &self.legend())).transpose()
    }

    /// What lines and arrows mean.
    fn legend(&self) -> Vec<Entry> {
        let parts = self.parts.iter().map(|part| Entry { label: part.label.clone(), colour: part.colour });
        let stream = (self.stream > 0.0).then(|| Entry {
            label: format!("velocity of the fluid, up to {} m/s", short(self.stream)),
            colour: STREAM,
        });
        parts.chain(stream).collect()
    }
}

/// Draws a moment of a run into a file.
pub fn draw(path: &Path, scene: &Scene, picture: &Picture, view: &View) -> Result<()> {
    if let Some(mut plane) = view.plane(path, &[picture.title()])? {
        paint(&mut plane, scene, picture, view)?;
        plane.save()?;
    }
    Ok(())
}

/// Draws fields of the fluid under a title.
pub fn fields(path: &Path, scene: &Scene, frame: Frame, title: &str) -> Result<()> {
    let picture = Picture::of_fields(frame);
    let view = View::of(&picture, scene, EXTREME)?;
    if let Some(mut plane) = view.plane(path, &[title.to_owned()])? {
        paint(&mut plane, scene, &picture, &view)?;
        plane.save()?;
    }
    Ok(())
}

/// The largest normal force of a moment that is drawn in a colour of its own, N/m.
pub fn strongest(moment: &Moment) -> Result<f64> {
    let Some(contacts) = &moment.contacts else { return Ok(0.0) };
    Ok(inner(read_frame(contacts)?.column(FORCE).unwrap_or(&[]), EXTREME)[1])
}

/// Draws the force chains of a moment: each contact as a bar as wide and as dark as its normal force, the darkest with
/// the force `high`; nothing where no contact presses.
pub fn chains(path: &Path, scene: &Scene, moment: &Moment, view: &View, high: f64) -> Result<bool> {
    let picture = Picture::read(moment, None)?;
    let (Some(grains), Some(contacts)) = (&picture.grains, &moment.contacts) else { return Ok(false) };
    let contacts = read_frame(contacts)?;
    let force = contacts.column(FORCE).unwrap_or(&[]);
    if high <= 0.0 || inner(force, EXTREME)[1] <= 0.0 {
        return Ok(false);
    }
    let name = "normal force at contacts (N/m)".to_owned();
    let scale = Scale { name, gradient: colorous::YELLOW_ORANGE_RED, low: 0.0, high, part: [0.15, 1.0] };
    let mut plane = Plane::new(path, view.bounds, &picture.title(), std::slice::from_ref(&scale))?;
    let radius = grains.column("radius_m").unwrap_or(&[]);
    let discs = || grains.points.iter().zip(radius);
    plane.discs(discs().map(|([x, y, _], r)| ([*x, *y], *r, [232, 232, 232])));
    let widest = 0.5 * radius.iter().sum::<f64>() / radius.len().max(1) as f64;
    // The strongest lie on top.
    let mut bars: Vec<(&[[f64; 3]], f64)> =
        contacts.points.chunks_exact(2).zip(force.iter().copied().step_by(2)).collect();
    bars.sort_by(|a, b| a.1.total_cmp(&b.1));
    for (ends, force) in bars {
        let [[x0, y0, _], [x1, y1, _]] = [ends[0], ends[1]];
        let length = (x1 - x0).hypot(y1 - y0);
        if force <= 0.0 || length == 0.0 {
            continue;
        }
        let half = widest * (force / high).min(1.0);
        let (u, v) = (-(y1 - y0) / length * half, (x1 - x0) / length * half);
        let corners = [[x0 + u, y0 + v], [x1 + u, y1 + v], [x1 - u, y1 - v], [x0 - u, y0 - v]];
        plane.polygon(&corners, scale.colour(force));
    }
    if picture.fluid.is_none() {
        plane.lines(standing(scene, picture.time))?;
    }
    plane.save()?;
    Ok(true)
}

/// The walls that are there at a time.
fn standing(scene: &Scene, time: f64) -> Vec<[[f64; 2]; 2]> {
    let walls = scene.walls.iter().map(|wall| wall_at(scene, wall)).filter(|wall| wall.stands(time));
    let period = scene.period();
    walls.map(|wall| period.place(wall.at(time)).map(<[f64; 2]>::from)).collect()
}

/// Draws a moment into the pane of a plane.
pub fn paint(plane: &mut Plane, scene: &Scene, picture: &Picture, view: &View) -> Result<()> {
    let [grain_scale, field_scale] = view.scales();
    if let (Some(fluid), Some((_, values)), Some(scale)) =
        (&picture.fluid, picture.field_values(scene), field_scale)
    {
        plane.field(&fluid.points, &fluid.cells, &values, &scale);
        plane.arrows(stream(fluid, plane.bounds(), view.stream), STREAM, WHITE)?;
    }
    // Grains in the droplet are seen through it.
    if let Some(droplet) = &picture.droplet {
        plane.polygon(droplet, LIQUID);
    }
    if let Some(grains) = &picture.grains {
        let discs = grains.points.iter().zip(grains.column("radius_m").unwrap_or(&[]));
        match (picture.grain_values(scene), grain_scale) {
            (Some((_, values)), Some(scale)) => plane.discs(
                discs
                    .zip(&*values)
                    .map(|(([x, y, _], radius), value)| ([*x, *y], *radius, scale.colour(*value))),
            ),
            _ => {
                discs.into_iter().try_for_each(|([x, y, _], r)| plane.outline(&circle([*x, *y], *r), HELD))?
            }
        }
    }
    if let Some(fluid) = &picture.fluid {
        let sides = boundary::sides(&view.parts, fluid, picture.droplet.as_deref(), &scene.period());
        for (k, part) in view.parts.iter().enumerate() {
            let own = sides.iter().filter(|(number, _)| *number == k).map(|(_, line)| *line);
            plane.strokes(own.collect(), part.colour, 6)?;
        }
    }
    if let Some(droplet) = &picture.droplet {
        plane.outline(droplet, RIM)?;
    }
    // On a boundary of the fluid its colour is seen on both sides of a wall.
    plane.strokes(standing(scene, picture.time), BLACK, if picture.fluid.is_some() { 2 } else { 3 })
}

/// Arrows of the velocity of the fluid on a square grid, as long as the grid is wide where it is fastest. Lengths go
/// with the root of the speed, so that slow parts show their direction too.
fn stream(fluid: &Frame, [left, bottom, right, top]: [f64; 4], fastest: f64) -> Vec<([f64; 2], [f64; 2])> {
    let velocity = fluid.column("velocity_m_per_s").unwrap_or(&[]).as_chunks::<3>().0;
    let spacing = (right - left).max(top - bottom) / ARROWS;
    let mut arrows = BTreeMap::new();
    if velocity.len() < fluid.points.len() || fastest <= 0.0 {
        return Vec::new();
    }
    for cell in fluid.cells.as_chunks::<3>().0 {
        let corners = cell.map(|node| fluid.points[node as usize]);
        let bounds = |axis: usize, low: f64, high: f64| {
            let ends = corners.map(|corner| corner[axis]);
            let (least, most) =
                (ends.iter().copied().fold(high, f64::min), ends.iter().copied().fold(low, f64::max));
            let number = |place: f64| ((place - low) / spacing - 0.5).clamp(-1.0, ARROWS + 1.0);
            (number(least.max(low)).ceil() as i64, number(most.min(high)).floor() as i64)
        };
        let (columns, rows) = (bounds(0, left, right), bounds(1, bottom, top));
        for (i, j) in (columns.0..=columns.1).flat_map(|i| (rows.0..=rows.1).map(move |j| (i, j))) {
            let at = [left + (i as f64 + 0.5) * spacing, bottom + (j as f64 + 0.5) * spacing];
            let Some(shares) = shares(corners, at) else { continue };
            let mean =
                |axis: usize| (0..3).map(|k| shares[k] * velocity[cell[k] as usize][axis]).sum::<f64>();
            let (u, v) = (mean(0), mean(1));
            let speed = u.hypot(v);
            if speed > 1e-4 * fastest {
                let half = 0.5 * spacing * (speed / fastest).sqrt() / speed;
                let ends = ([at[0] - half * u, at[1] - half * v], [at[0] + half * u, at[1] + half * v]);
                arrows.insert((i, j), ends);
            }
        }
    }
    arrows.into_values().collect()
}

/// The shares of the corners of a triangle in a point of it; none outside.
fn shares(corners: [[f64; 3]; 3], [x, y]: [f64; 2]) -> Option<[f64; 3]> {
    let [a, b, c] = corners;
    let area =
        |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let [a, b, c] = [[a[0], a[1]], [b[0], b[1]], [c[0], c[1]]];
    let whole = area(a, b, c);
    let shares = [area([x, y], b, c) / whole, area(a, [x, y], c) / whole, area(a, b, [x, y]) / whole];
    shares.iter().all(|share| *share >= 0.0).then_some(shares)
}

/// A number with three digits.
fn short(value: f64) -> String {
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    if (1e-3..1e5).contains(&value) { format!("{value:.digits$}") } else { format!("{value:.2e}") }
}

/// Cuts off the quarters of each axis beyond which nothing is, so that pictures of a run share few sizes; not where that
/// would leave a strip more than four times as long as wide, of which a picture cannot be.
fn leave_out_empty(bounds: &mut [f64; 4], points: impl Iterator<Item = [f64; 2]> + Clone) {
    for axis in 0..2 {
        let (lower, upper) = (bounds[axis], bounds[axis + 2]);
        let quarter = |point: [f64; 2]| (4.0 * (point[axis] - lower) / (upper - lower)).clamp(0.0, 4.0);
        let first = points.clone().map(quarter).fold(4.0, f64::min).floor();
        let last = points.clone().map(quarter).fold(0.0, f64::max).ceil();
        let at = |quarter: f64| lower + 0.25 * quarter * (upper - lower);
        let other = bounds[3 - axis] - bounds[1 - axis];
        if first < last && at(last) - at(first) >= 0.25 * other {
            (bounds[axis], bounds[axis + 2]) = (at(first), at(last));
        }
    }
}

/// Corners of a polygon that looks round.
fn circle([x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let corner = |k: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 24.0).sin_cos();
        [x + radius * cos, y + radius * sin]
    };
    (0..24).map(corner).collect()
}

fn speeds(frame: &Frame) -> Vec<f64> {
    let velocity = frame.column("velocity_m_per_s").unwrap_or(&[]);
    velocity.as_chunks::<3>().0.iter().map(|[u, v, w]| (u * u + v * v + w * w).sqrt()).collect()
}

/// The least and the greatest value but for a share of them at either end; from 0 to 1 without values.
fn inner(values: &[f64], extreme: f64) -> [f64; 2] {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at =
        |share: f64| sorted.get((share * sorted.len().saturating_sub(1) as f64).round() as usize).copied();
    [at(extreme).unwrap_or(0.0), at(1.0 - extreme).unwrap_or(1.0)]
}
