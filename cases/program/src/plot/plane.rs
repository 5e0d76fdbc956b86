//! A part of the plane with axes and colour bars, once or several times.

use colorous::Gradient;
use plotters::prelude::*;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::canvas::{Area, Canvas, Frame, label, pixels, text};
use voidage_coupling::Result;

/// Panes in a row at most.
const ROW: usize = 4;

/// What colours mean.
#[derive(Clone, Debug)]
pub struct Scale {
    /// Quantity with its unit.
    pub name: String,
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

/// A line of the legend below a picture.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Text.
    pub label: String,
    /// Colour of the stroke before it.
    pub colour: RGBColor,
}

/// A picture of a part of the plane in one pane, or in several beside and below each other.
pub struct Plane {
    canvas: Canvas,
    path: PathBuf,
    panes: Vec<Frame>,
    /// The pane that is drawn into.
    frame: Frame,
    /// Metres are shown in this unit: 1, or 1000 for millimetres.
    unit: f64,
}

/// Sizes in pixels of the saved picture: of a pane inside, and of what is around it.
#[derive(Clone, Copy)]
struct Layout {
    columns: usize,
    rows: usize,
    inner: [u32; 2],
    left: u32,
    right: u32,
    top: u32,
    bottom: u32,
    /// Height of the legend below.
    legend: u32,
}

/// Room above the legend, height of its rows, length of its strokes and about the width of a letter, in pixels of the
/// saved picture.
const LEGEND_GAP: u32 = 16;
const ROW_HEIGHT: u32 = 28;
const STROKE: u32 = 34;
const LETTER: f64 = 10.5;

/// Width of a colour bar with its labels, in pixels of the saved picture.
const BAR: u32 = 136;

impl Plane {
    /// An empty picture of a part of the plane, m, with axes, a title and colour bars.
    pub fn new(path: &Path, bounds: [f64; 4], title: &str, scales: &[Scale]) -> Result<Plane> {
        Plane::panes(path, bounds, &[title.to_owned()], scales, &[])
    }

    /// The same with a pane for each title, in rows of four, and a legend. The first pane is the one that is drawn
    /// into.
    pub fn panes(
        path: &Path,
        bounds: [f64; 4],
        titles: &[String],
        scales: &[Scale],
        legend: &[Entry],
    ) -> Result<Plane> {
        let [width, height] = [bounds[2] - bounds[0], bounds[3] - bounds[1]];
        let (unit, name) = if width.max(height) < 0.9 { (1e3, "mm") } else { (1.0, "m") };
        let bounds = bounds.map(|bound| bound * unit);
        let mut layout = Layout::new([width, height], titles);
        let [main, _] = layout.outer();
        let wide = main + BAR * scales.len() as u32;
        let places = places(legend, wide - layout.left.min(wide));
        layout.legend =
            places.last().map_or(0, |[_, row]| LEGEND_GAP + (row + 1) * ROW_HEIGHT + ROW_HEIGHT / 4);
        let high = layout.outer()[1];
        let mut canvas = Canvas::new(wide, high);
        let (panes, bars) = canvas.draw(path, |area| {
            let below = high - layout.legend;
            for (entry, [x, row]) in legend.iter().zip(&places) {
                let [x, y] = [layout.left + x, below + LEGEND_GAP + row * ROW_HEIGHT + ROW_HEIGHT / 2];
                let at = |x: u32, y: u32| (pixels(x) as i32, pixels(y) as i32);
                let stroke = entry.colour.stroke_width(pixels(4));
                area.draw(&PathElement::new([at(x, y), at(x + STROKE - 10, y)], stroke))?;
                area.draw(&Text::new(entry.label.clone(), at(x + STROKE, y - 11), text(20)))?;
            }
            let (area, _) = area.split_vertically(pixels(below));
            let (main, side) = area.split_horizontally(pixels(main));
            let mut panes = Vec::new();
            for (k, title) in titles.iter().enumerate() {
                panes.push(layout.pane(&main, k, titles.len(), (bounds, name), title)?);
            }
            let mut bars = Vec::new();
            for (scale, area) in scales.iter().zip(side.split_evenly((1, scales.len().max(1)))) {
                bars.push(colour_bar(&area, scale, (layout.top, layout.bottom))?);
            }
            Ok((panes, bars))
        })?;
        for (frame, scale) in bars.iter().zip(scales) {
            let steps = 256;
            for k in 0..steps {
                let at = |k: usize| scale.low + (scale.high - scale.low) * k as f64 / steps as f64;
                canvas.rectangle(*frame, [0.0, at(k)], [1.0, at(k + 1)], scale.colour(at(k)));
            }
        }
        let frame = panes[0];
        Ok(Plane { canvas, path: path.to_path_buf(), panes, frame, unit })
    }

    /// Draws into this pane from now on.
    pub fn turn_to(&mut self, pane: usize) {
        self.frame = self.panes[pane];
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

    /// Draws discs, m.
    pub fn discs(&mut self, discs: impl Iterator<Item = ([f64; 2], f64, [u8; 3])>) {
        for (centre, radius, colour) in discs {
            let centre = centre.map(|x| x * self.unit);
            self.canvas.disc(self.frame, centre, radius * self.unit, colour);
        }
    }

    /// Fills a polygon, m.
    pub fn polygon(&mut self, corners: &[[f64; 2]], colour: [u8; 3]) {
        let corners: Vec<[f64; 2]> = corners.iter().map(|corner| corner.map(|x| x * self.unit)).collect();
        self.canvas.polygon(self.frame, &corners, colour);
    }

    /// Draws the sides of a polygon, m.
    pub fn outline(&mut self, corners: &[[f64; 2]], colour: RGBColor) -> Result<()> {
        let sides = corners.iter().zip(corners.iter().cycle().skip(1)).map(|(from, to)| [*from, *to]);
        self.strokes(sides.collect(), colour, 2)
    }

    /// Fills a rectangle, m.
    pub fn rectangle(&mut self, lower: [f64; 2], upper: [f64; 2], colour: [u8; 3]) {
        let [lower, upper] = [lower, upper].map(|corner| corner.map(|x| x * self.unit));
        self.canvas.rectangle(self.frame, lower, upper, colour);
    }

    /// The bounds of the plane that are shown, m: left, bottom, right, top.
    pub fn bounds(&self) -> [f64; 4] {
        self.frame.plane.map(|bound| bound / self.unit)
    }

    /// Draws arrows from point to point, m, in a colour with a rim of another one, so that they are seen on any field.
    pub fn arrows(
        &mut self,
        arrows: Vec<([f64; 2], [f64; 2])>,
        colour: RGBColor,
        rim: RGBColor,
    ) -> Result<()> {
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
        self.strokes(lines.clone(), rim, 5)?;
        self.strokes(lines, colour, 2)
    }

    /// Draws straight lines, m: walls.
    pub fn lines(&mut self, lines: Vec<[[f64; 2]; 2]>) -> Result<()> {
        self.strokes(lines, BLACK, 3)
    }

    /// Draws straight lines, m, in a colour and of a width in pixels of the saved picture.
    pub fn strokes(&mut self, lines: Vec<[[f64; 2]; 2]>, colour: RGBColor, width: u32) -> Result<()> {
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

impl Layout {
    fn new([width, height]: [f64; 2], titles: &[String]) -> Layout {
        // The longer side is as long as it may be, the other what keeps circles round.
        let [widest, highest] = if titles.len() == 1 { [900.0, 1000.0] } else { [320.0, 480.0] };
        let factor = (highest / height).min(widest / width);
        let least = if titles.len() == 1 { 160.0 } else { 80.0 };
        let columns = titles.len().clamp(1, ROW);
        Layout {
            columns,
            rows: titles.len().div_ceil(columns),
            inner: [width, height].map(|side| (side * factor).round().max(least) as u32),
            left: 112,
            right: 24,
            top: if titles.iter().all(String::is_empty) { 24 } else { 56 },
            bottom: 76,
            legend: 0,
        }
    }

    /// Size of all panes together.
    fn outer(&self) -> [u32; 2] {
        let [width, height] = [self.inner[0] + self.right, self.top + self.inner[1]];
        [self.left + self.columns as u32 * width, self.rows as u32 * height + self.bottom + self.legend]
    }

    /// Draws the axes of a pane: labels stand at those on the left and at the lowest of each column.
    fn pane(
        &self,
        main: &Area,
        pane: usize,
        count: usize,
        (bounds, unit): ([f64; 4], &str),
        title: &str,
    ) -> std::result::Result<Frame, Box<dyn std::error::Error>> {
        let Layout { inner, right, top, .. } = *self;
        let [column, row] = [(pane % self.columns) as u32, (pane / self.columns) as u32];
        let left = if column == 0 { self.left } else { 0 };
        let bottom = if pane + self.columns >= count { self.bottom } else { 0 };
        let corner = [self.left - left + column * (inner[0] + right), row * (top + inner[1])];
        let size = [left + inner[0] + right, top + inner[1] + bottom];
        let area = main.clone().shrink((pixels(corner[0]), pixels(corner[1])), size.map(pixels).into());
        let mut chart = ChartBuilder::on(&area)
            .margin_top(pixels(top))
            .margin_right(pixels(right))
            .x_label_area_size(pixels(bottom))
            .margin_left(pixels(left.min(12)))
            .y_label_area_size(pixels(left.saturating_sub(12)))
            .build_cartesian_2d(bounds[0]..bounds[2], bounds[1]..bounds[3])?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc(format!("x ({unit})"))
            .y_desc(format!("y ({unit})"))
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
            // Over a narrow pane a long title is small, so that it does not touch the next one.
            let fits = 24.0 * f64::from(inner[0] + right) / (LETTER * title.chars().count() as f64);
            area.draw(&Text::new(title.to_owned(), place, text(fits.min(24.0) as u32)))?;
        }
        let frame = Frame::of(&chart, bounds);
        if count > 1 {
            let [x0, y0, x1, y1] = frame.pixel.map(|at| at as i32);
            let outline = Rectangle::new([(x0, y0), (x1, y1)], BLACK.stroke_width(pixels(1)));
            main.draw(&outline)?;
        }
        Ok(frame)
    }
}

/// Where the lines of a legend stand: distance from the left and row, beside each other as far as there is room.
fn places(legend: &[Entry], room: u32) -> Vec<[u32; 2]> {
    let (mut x, mut row) = (0, 0);
    let mut places = Vec::new();
    for entry in legend {
        let width = STROKE + (LETTER * entry.label.chars().count() as f64) as u32 + 16;
        if x > 0 && x + width > room {
            (x, row) = (0, row + 1);
        }
        places.push([x, row]);
        x += width;
    }
    places
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
    area: &Area,
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
        .y_desc(scale.name.as_str())
        .y_labels(7)
        .y_label_formatter(&label(low, high))
        .axis_desc_style(text(22))
        .label_style(text(18))
        .axis_style(BLACK.stroke_width(pixels(1)))
        .set_all_tick_mark_size(pixels(4))
        .draw()?;
    Ok(Frame::of(&chart, [0.0, low, 1.0, high]))
}
