//! Pictures of the plane: grains over the voidage, or a field of the fluid, with colour bars.

use colorous::Gradient;
use plotters::prelude::*;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::canvas::{Canvas, Frame, label, pixels, text};
use voidage_coupling::Result;
use voidage_scene::Scene;
use voidage_scene::build::wall as wall_at;
use voidage_scene::recorder::read_frame;

/// What colours mean.
pub struct Scale {
    /// Quantity with its unit.
    pub name: &'static str,
    /// Colours.
    pub gradient: Gradient,
    /// Value of the first colour.
    pub low: f64,
    /// Value of the last colour.
    pub high: f64,
    /// Part of the gradient that is used: its ends may be too dark or too light, and it may run backwards.
    pub part: [f64; 2],
}

impl Scale {
    /// The colour of a value.
    pub fn colour(&self, value: f64) -> [u8; 3] {
        let place = if self.high > self.low { (value - self.low) / (self.high - self.low) } else { 0.5 };
        let place = if place.is_nan() { 0.5 } else { place.clamp(0.0, 1.0) };
        self.gradient.eval_continuous(self.part[0] + place * (self.part[1] - self.part[0])).as_array()
    }
}

/// A picture of a part of the plane.
pub struct Plane {
    canvas: Canvas,
    path: PathBuf,
    frame: Frame,
    /// Metres are shown in this unit: 1, or 1000 for millimetres.
    unit: f64,
}

/// From grey (packed) to white (fluid only).
const VOIDAGE: Scale =
    Scale { name: "voidage", gradient: colorous::GREYS, low: 0.3, high: 1.0, part: [0.65, 0.0] };

/// Draws a frame of a run.
pub fn draw(
    path: &Path,
    scene: &Scene,
    time: f64,
    grains: Option<&Path>,
    fluid: Option<&Path>,
) -> Result<()> {
    let grains = grains.map(read_frame).transpose()?;
    let fluid = fluid.map(read_frame).transpose()?;
    let mut points: Vec<[f64; 3]> = Vec::new();
    points.extend(fluid.iter().flat_map(|fluid| &fluid.points));
    if fluid.is_none() {
        points.extend(grains.iter().flat_map(|grains| &grains.points));
        let still = scene.walls.iter().filter(|wall| wall.motion.is_none());
        points.extend(
            still.flat_map(|wall| [&wall.from, &wall.to]).map(|end| <[f64; 3]>::from(end.vector::<3>())),
        );
    }
    let least = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
    let most = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
    let bounds = [least(0), least(1), most(0), most(1)];
    let margin =
        if fluid.is_some() { 0.0 } else { 0.03 * (bounds[2] - bounds[0]).max(bounds[3] - bounds[1]) };
    let mut bounds = [bounds[0] - margin, bounds[1] - margin, bounds[2] + margin, bounds[3] + margin];
    if let (Some(grains), Some(_)) = (&grains, &fluid) {
        leave_out_empty(&mut bounds, &grains.points);
    }
    if !bounds.iter().all(|bound| bound.is_finite()) {
        return Ok(());
    }
    let coloured = grains.as_ref().map(|grains| grain_colours(grains));
    let voidage = fluid.as_ref().and_then(|fluid| fluid.column("voidage"));
    let field = match (&fluid, voidage) {
        (Some(fluid), None) => Some(speeds(fluid)),
        _ => None,
    };
    let mut scales = Vec::new();
    if let Some((name, values)) = &coloured {
        let warm = name.contains("temperature");
        let (gradient, part) =
            if warm { (colorous::INFERNO, [0.08, 0.95]) } else { (colorous::VIRIDIS, [0.0, 1.0]) };
        scales.push(scale(name, gradient, part, values));
    }
    if voidage.is_some() {
        scales.push(VOIDAGE);
    }
    if let Some(values) = &field {
        scales.push(scale("fluid speed (m/s)", colorous::VIRIDIS, [0.0, 1.0], values));
    }
    let mut plane = Plane::new(path, bounds, &format!("t = {time:.3} s"), &scales)?;
    if let Some(fluid) = &fluid {
        let (values, scale) = match (voidage, &field) {
            (Some(voidage), _) => (voidage, scales.iter().find(|scale| scale.name == "voidage")),
            (None, Some(values)) => (values.as_slice(), scales.last()),
            (None, None) => (&[][..], None),
        };
        if let Some(scale) = scale {
            plane.field(&fluid.points, &fluid.cells, values, scale);
        }
    }
    if let (Some(grains), Some((_, values)), Some(scale)) = (&grains, &coloured, scales.first()) {
        let radius = grains.column("radius_m").unwrap_or(&[]);
        for ((point, radius), value) in grains.points.iter().zip(radius).zip(values) {
            let colour = scale.colour(*value);
            plane.canvas.disc(
                plane.frame,
                [point[0] * plane.unit, point[1] * plane.unit],
                radius * plane.unit,
                colour,
            );
        }
    }
    if fluid.is_none() {
        let walls = scene.walls.iter().map(|wall| wall_at(scene, wall).at(time).map(<[f64; 2]>::from));
        plane.lines(walls.collect())?;
    }
    plane.save()
}

/// Cuts off the quarters of each axis beyond which no grain is, so that pictures of a run share few sizes.
fn leave_out_empty(bounds: &mut [f64; 4], grains: &[[f64; 3]]) {
    for axis in 0..2 {
        let (lower, upper) = (bounds[axis], bounds[axis + 2]);
        let quarter = |point: &[f64; 3]| (4.0 * (point[axis] - lower) / (upper - lower)).clamp(0.0, 4.0);
        let first = grains.iter().map(quarter).fold(4.0, f64::min).floor();
        let last = grains.iter().map(quarter).fold(0.0, f64::max).ceil();
        if first < last {
            let at = |quarter: f64| lower + 0.25 * quarter * (upper - lower);
            (bounds[axis], bounds[axis + 2]) = (at(first), at(last));
        }
    }
}

/// What grains are coloured by: temperature, or speed without one.
fn grain_colours(grains: &voidage_scene::recorder::Frame) -> (&'static str, Vec<f64>) {
    match grains.column("temperature_K") {
        Some(temperature) => ("grain temperature (K)", temperature.to_vec()),
        None => ("grain speed (m/s)", speeds(grains)),
    }
}

fn speeds(frame: &voidage_scene::recorder::Frame) -> Vec<f64> {
    let velocity = frame.column("velocity_m_per_s").unwrap_or(&[]);
    velocity.as_chunks::<3>().0.iter().map(|[u, v, w]| (u * u + v * v + w * w).sqrt()).collect()
}

/// Bounds that a few extreme values do not stretch.
fn scale(name: &'static str, gradient: Gradient, part: [f64; 2], values: &[f64]) -> Scale {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at =
        |share: f64| sorted.get((share * sorted.len().saturating_sub(1) as f64).round() as usize).copied();
    let (low, high) = (at(0.01).unwrap_or(0.0), at(0.99).unwrap_or(1.0));
    let least = 1e-3 * high.abs().max(1e-9);
    let (low, high) = if high - low < least { (low - least, high + least) } else { (low, high) };
    Scale { name, gradient, low: if name.contains("speed") { 0.0 } else { low }, high, part }
}

impl Plane {
    /// An empty picture of a part of the plane, m, with axes, a title and colour bars.
    pub fn new(path: &Path, bounds: [f64; 4], title: &str, scales: &[Scale]) -> Result<Plane> {
        let [width, height] = [bounds[2] - bounds[0], bounds[3] - bounds[1]];
        let (unit, name) = if width.max(height) < 0.9 { (1e3, "mm") } else { (1.0, "m") };
        let bounds = bounds.map(|bound| bound * unit);
        // The longer side gets 1000 pixels, the other what keeps circles round.
        let factor = (1000.0 / height).min(900.0 / width);
        let inner = [(width * factor).round().max(160.0) as u32, (height * factor).round().max(160.0) as u32];
        let (left, right, top, bottom, bar) = (112, 24, if title.is_empty() { 24 } else { 56 }, 76, 136);
        let outer = [left + inner[0] + right + bar * scales.len() as u32, top + inner[1] + bottom];
        let mut canvas = Canvas::new(outer[0], outer[1]);
        let (frame, bars) = canvas.draw(path, |area| {
            let (main, side) = area.split_horizontally(pixels(left + inner[0] + right));
            let mut chart = ChartBuilder::on(&main)
                .margin_top(pixels(top))
                .margin_right(pixels(right))
                .x_label_area_size(pixels(bottom))
                .margin_left(pixels(12))
                .y_label_area_size(pixels(left - 12))
                .build_cartesian_2d(bounds[0]..bounds[2], bounds[1]..bounds[3])?;
            chart
                .configure_mesh()
                .disable_mesh()
                .x_desc(format!("x ({name})"))
                .y_desc(format!("y ({name})"))
                .x_labels((inner[0] / 90).clamp(3, 9) as usize)
                .y_labels((inner[1] / 90).clamp(3, 11) as usize)
                .x_label_formatter(&label(bounds[0], bounds[2]))
                .y_label_formatter(&label(bounds[1], bounds[3]))
                .axis_desc_style(text(24))
                .label_style(text(20))
                .axis_style(BLACK.stroke_width(pixels(1)))
                .set_all_tick_mark_size(pixels(5))
                .draw()?;
            if !title.is_empty() {
                let place = (pixels(left) as i32, pixels(16) as i32);
                main.draw(&Text::new(title.to_owned(), place, text(24)))?;
            }
            let frame = Frame::of(&chart, bounds);
            let mut bars = Vec::new();
            for (scale, area) in scales.iter().zip(side.split_evenly((1, scales.len().max(1)))) {
                bars.push(colour_bar(&area, scale, (top, bottom))?);
            }
            Ok((frame, bars))
        })?;
        for (frame, scale) in bars.iter().zip(scales) {
            let steps = 256;
            for k in 0..steps {
                let at = |k: usize| scale.low + (scale.high - scale.low) * k as f64 / steps as f64;
                canvas.rectangle(*frame, [0.0, at(k)], [1.0, at(k + 1)], scale.colour(at(k)));
            }
        }
        Ok(Plane { canvas, path: path.to_path_buf(), frame, unit })
    }

    /// Shades triangles by nodal values.
    pub fn field(&mut self, points: &[[f64; 3]], cells: &[u32], values: &[f64], scale: &Scale) {
        for cell in cells.as_chunks::<3>().0 {
            let corners = cell.map(|node| {
                let point = points[node as usize];
                [point[0] * self.unit, point[1] * self.unit]
            });
            let values = cell.map(|node| values[node as usize]);
            self.canvas.triangle(self.frame, corners, values, |value| scale.colour(value));
        }
    }

    /// Fills a rectangle, m.
    pub fn rectangle(&mut self, lower: [f64; 2], upper: [f64; 2], colour: [u8; 3]) {
        let [lower, upper] = [lower, upper].map(|corner| corner.map(|x| x * self.unit));
        self.canvas.rectangle(self.frame, lower, upper, colour);
    }

    /// Draws arrows from point to point, m.
    pub fn arrows(&mut self, arrows: Vec<([f64; 2], [f64; 2])>) -> Result<()> {
        let mut lines = Vec::new();
        for (from, to) in arrows {
            let along = [to[0] - from[0], to[1] - from[1]];
            let head = |side: f64| {
                [
                    to[0] - 0.35 * along[0] - side * 0.2 * along[1],
                    to[1] - 0.35 * along[1] + side * 0.2 * along[0],
                ]
            };
            lines.extend([[from, to], [head(1.0), to], [head(-1.0), to]]);
        }
        self.strokes(lines, RGBColor(255, 255, 255), 2)
    }

    /// Draws straight lines, m: walls.
    pub fn lines(&mut self, lines: Vec<[[f64; 2]; 2]>) -> Result<()> {
        self.strokes(lines, BLACK, 3)
    }

    fn strokes(&mut self, lines: Vec<[[f64; 2]; 2]>, colour: RGBColor, width: u32) -> Result<()> {
        let (frame, unit) = (self.frame, self.unit);
        let bounds = frame.plane.map(|bound| bound / unit);
        let lines: Vec<_> = lines.into_iter().filter_map(|line| clip(line, bounds)).collect();
        let place = |point: [f64; 2]| {
            let [x, y] = frame.place(point[0] * unit, point[1] * unit);
            (x.round() as i32, y.round() as i32)
        };
        self.canvas.draw(&self.path, |area| {
            for line in lines {
                area.draw(&PathElement::new(line.map(place), colour.stroke_width(pixels(width))))?;
            }
            Ok(())
        })
    }

    /// Writes the picture.
    pub fn save(self) -> Result<()> {
        self.canvas.save(&self.path)
    }
}

/// The part of a line inside of bounds (left, bottom, right, top), if there is one (Liang and Barsky).
fn clip(line: [[f64; 2]; 2], bounds: [f64; 4]) -> Option<[[f64; 2]; 2]> {
    let [from, to] = line;
    let along = [to[0] - from[0], to[1] - from[1]];
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        for (bound, side) in [(bounds[axis], -1.0), (bounds[axis + 2], 1.0)] {
            let (speed, room) = (side * along[axis], side * (bound - from[axis]));
            if speed == 0.0 && room < 0.0 {
                return None;
            } else if speed < 0.0 {
                enter = enter.max(room / speed);
            } else if speed > 0.0 {
                leave = leave.min(room / speed);
            }
        }
    }
    let at = |share: f64| [from[0] + share * along[0], from[1] + share * along[1]];
    (enter < leave).then(|| [at(enter), at(leave)])
}

/// The axis of a colour bar; it is filled later.
fn colour_bar(
    area: &voidage_campaign::plot::canvas::Area,
    scale: &Scale,
    (top, bottom): (u32, u32),
) -> std::result::Result<Frame, Box<dyn std::error::Error>> {
    let (low, high) = (scale.low, scale.high);
    let mut chart = ChartBuilder::on(area)
        .margin_top(pixels(top))
        .margin_bottom(pixels(bottom))
        .margin_left(pixels(8))
        .margin_right(pixels(14))
        .set_label_area_size(LabelAreaPosition::Right, pixels(88))
        .build_cartesian_2d(0.0..1.0, low..high)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .y_desc(scale.name)
        .y_labels(7)
        .y_label_formatter(&label(low, high))
        .axis_desc_style(text(22))
        .label_style(text(18))
        .axis_style(BLACK.stroke_width(pixels(1)))
        .set_all_tick_mark_size(pixels(4))
        .draw()?;
    Ok(Frame::of(&chart, [0.0, low, 1.0, high]))
}
