//! Pages of small plots: measured points on exact lines.

use super::canvas::{Area, Canvas, label, pixels, power_of_ten, text};
use super::legend::{beside, emptiest, names};
use plotters::chart::SeriesAnno;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::element::{Circle, Cross, DashedPathElement};
use plotters::prelude::*;
use std::path::{Path, PathBuf};
use voidage_coupling::Result;

/// Panels side by side, and rows of a page at most.
const COLUMNS: usize = 3;
const ROWS: usize = 4;
/// Size of a panel in pixels of the saved picture.
const SIZE: [u32; 2] = [560, 430];
/// The same of a panel that stands for itself.
const LARGE: [u32; 2] = [840, 600];
/// Share of the lowest and of the highest values of a faint curve that its axis need not reach.
const EXTREME: f64 = 0.005;

// Colours that colour-blind readers can tell apart (Okabe and Ito).
pub(super) const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

const GREY: RGBColor = RGBColor(130, 130, 130);

/// One small plot.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What stands above.
    pub title: String,
    /// Name and unit of the axes.
    pub labels: [String; 2],
    /// Which axes are logarithmic.
    pub log: [bool; 2],
    /// Whether the vertical axis points down: depths.
    pub down: bool,
    /// Share of the height left free above the curves, for the legend.
    pub headroom: f64,
    /// The curves; values that are not positive are left out on a logarithmic axis.
    pub curves: Vec<Curve>,
}

/// One curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Name in the legend; empty for none.
    pub name: String,
    /// Points.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub style: Style,
    /// Its place among the coloured curves, from 0, where it must look as in another panel; none: the next one.
    pub place: Option<usize>,
}

/// How a curve is drawn. Black and grey are what is known; the others take a colour each, in their order;
/// where there are more of them than colours, lines are dashed and discs are circles. One without a name looks like the
/// one before, to which it belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Black line: exact.
    Line,
    /// Black circles, of a second such curve crosses: known values, tables, marks on other curves.
    Known,
    /// Grey dashes: a slope, a bound.
    Dashes,
    /// Coloured discs: measured.
    Points,
    /// Coloured line: measured, too many points for discs.
    Measured,
    /// Coloured discs joined by a line.
    Joined,
    /// Thin pale line, whose few greatest and least values may lie beyond the axis: what was recorded, beside its mean.
    Faint,
}

impl Curve {
    fn of(name: impl Into<String>, points: Vec<(f64, f64)>, style: Style) -> Self {
        Self { name: name.into(), points, style, place: None }
    }

    /// The exact curve.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Line)
    }

    /// Known values at some points.
    pub fn known(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Known)
    }

    /// Measured values.
    pub fn points(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Points)
    }

    /// Measured values, close to each other.
    pub fn measured(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Measured)
    }

    /// Measured values that are noisy, beside their mean.
    pub fn faint(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Faint)
    }

    /// Measured values that belong together: errors against mesh size.
    pub fn joined(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Joined)
    }

    /// A slope or bound to compare with.
    pub fn dashes(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::of(name, points, Style::Dashes)
    }
}

impl Panel {
    /// A panel with linear axes and no curves.
    pub fn new(title: impl Into<String>, x: impl Into<String>, y: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            labels: [x.into(), y.into()],
            log: [false; 2],
            down: false,
            headroom: 0.0,
            curves: Vec::new(),
        }
    }

    /// The same with logarithmic axes.
    pub fn log_log(title: impl Into<String>, x: impl Into<String>, y: impl Into<String>) -> Self {
        Self { log: [true; 2], ..Self::new(title, x, y) }
    }
}

/// Draws panels on as many pages as they need, `NAME.png` or `NAME-1.png`, `NAME-2.png`, .. in a folder; their paths.
///
/// # Errors
/// A file cannot be written.
pub fn pages(folder: &Path, name: &str, panels: &[Panel]) -> Result<Vec<PathBuf>> {
    let count = panels.len().div_ceil(COLUMNS * ROWS).max(1);
    // Pages as full as each other.
    let each = panels.len().div_ceil(count).max(1).next_multiple_of(COLUMNS);
    let mut paths = Vec::new();
    for (k, part) in panels.chunks(each).enumerate() {
        let file = if count == 1 { format!("{name}.png") } else { format!("{name}-{}.png", k + 1) };
        let path = folder.join(file);
        grid(&path, COLUMNS, part)?;
        paths.push(path);
    }
    Ok(paths)
}

/// Draws panels in rows of so many.
///
/// # Errors
/// The file cannot be written.
pub fn grid(path: &Path, columns: usize, panels: &[Panel]) -> Result<()> {
    sheet(path, columns, SIZE, panels)
}

/// The same with large panels: figures of their own.
///
/// # Errors
/// The file cannot be written.
pub fn large(path: &Path, columns: usize, panels: &[Panel]) -> Result<()> {
    sheet(path, columns, LARGE, panels)
}

fn sheet(path: &Path, columns: usize, size: [u32; 2], panels: &[Panel]) -> Result<()> {
    let columns = panels.len().clamp(1, columns);
    let rows = panels.len().div_ceil(columns);
    let beside = panels.iter().map(beside).max().unwrap_or(0);
    let mut canvas = Canvas::new((size[0] + beside) * columns as u32, size[1] * rows as u32);
    canvas.draw(path, |area| {
        for (panel, area) in panels.iter().zip(area.split_evenly((rows, columns))) {
            draw(panel, &area)?;
        }
        Ok(())
    })?;
    canvas.save(path)
}

/// Points of a curve in the coordinates of the chart: decades on a logarithmic axis.
fn places(panel: &Panel, curve: &Curve) -> Vec<(f64, f64)> {
    let place = |value: f64, log: bool| if log { value.log10() } else { value };
    let all = curve.points.iter().map(|(x, y)| (place(*x, panel.log[0]), place(*y, panel.log[1])));
    all.filter(|(x, y)| x.is_finite() && y.is_finite()).collect()
}

/// The points of a curve that its axes must reach.
fn reached<'a>(curve: &Curve, places: &'a [(f64, f64)]) -> impl Iterator<Item = &'a (f64, f64)> {
    let mut bounds = (f64::NEG_INFINITY, f64::INFINITY);
    if curve.style == Style::Faint && !places.is_empty() {
        let mut sorted: Vec<f64> = places.iter().map(|place| place.1).collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
        bounds = (at(EXTREME), at(1.0 - EXTREME));
    }
    places.iter().filter(move |place| (bounds.0..=bounds.1).contains(&place.1))
}

/// Bounds of an axis around values, with some air; from decade to decade at least on a logarithmic axis.
fn bounds(values: impl Iterator<Item = f64>, log: bool) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let least = match high.abs().max(low.abs()) {
        size if !log && size > 0.0 => 1e-6 * size,
        _ => 1.0,
    };
    let span = (high - low).max(least);
    let middle = 0.5 * (low + high);
    (middle - 0.56 * span, middle + 0.56 * span)
}

pub(super) type Chart<'a> = ChartContext<'a, BitMapBackend<'a>, Cartesian2d<Axis, Axis>>;

fn draw(panel: &Panel, area: &Area) -> std::result::Result<(), Box<dyn std::error::Error>> {
    let curves: Vec<Vec<(f64, f64)>> = panel.curves.iter().map(|curve| places(panel, curve)).collect();
    let reached = || panel.curves.iter().zip(&curves).flat_map(|(curve, places)| reached(curve, places));
    let (left, right) = bounds(reached().map(|point| point.0), panel.log[0]);
    let (low, high) = bounds(reached().map(|point| point.1), panel.log[1]);
    let (low, high) = if panel.down { (high, low) } else { (low, high) };
    let aside = beside(panel);
    let headroom = if aside > 0 { 0.0 } else { panel.headroom };
    let high = high + headroom * (high - low);
    let width = area.dim_in_pixel().0.saturating_sub(pixels(aside));
    let (area, legend) = area.split_horizontally(width);
    let mut chart = ChartBuilder::on(&area)
        .caption(&panel.title, text(19))
        .margin(pixels(10))
        .margin_right(pixels(22))
        .x_label_area_size(pixels(48))
        .y_label_area_size(pixels(78))
        .build_cartesian_2d(
            Axis { range: (left..right).into(), ticks: places_of_ticks(panel.log[0], left, right, 6) },
            Axis { range: (low..high).into(), ticks: places_of_ticks(panel.log[1], low, high, 7) },
        )?;
    chart
        .configure_mesh()
        .x_desc(panel.labels[0].as_str())
        .y_desc(panel.labels[1].as_str())
        .x_labels(6)
        .y_labels(7)
        .x_label_formatter(&*ticks(panel.log[0], left, right))
        .y_label_formatter(&*ticks(panel.log[1], low, high))
        .axis_desc_style(text(17))
        .label_style(text(14))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.08).stroke_width(pixels(1)))
        .axis_style(BLACK.stroke_width(pixels(1)))
        .set_all_tick_mark_size(pixels(4))
        .draw()?;
    let mut strokes: Vec<_> = panel.curves.iter().zip(&curves).zip(looks(&panel.curves)).collect();
    // Discs lie on lines, and lines on faint ones.
    strokes.sort_by_key(|((curve, _), _)| match curve.style {
        Style::Faint if curve.name.is_empty() => 0,
        Style::Points | Style::Known => 2,
        _ => 1,
    });
    for ((curve, points), look) in &strokes {
        stroke(&mut chart, curve, points, *look)?;
    }
    if aside > 0 {
        let axis = || Axis { range: (0.0..1.0).into(), ticks: Vec::new() };
        let mut empty =
            ChartBuilder::on(&legend).margin_top(pixels(40)).build_cartesian_2d(axis(), axis())?;
        for (curve, look) in panel.curves.iter().zip(looks(&panel.curves)) {
            stroke(&mut empty, curve, &[], look)?;
        }
        names(&mut empty, SeriesLabelPosition::UpperLeft)?;
    } else if panel.curves.iter().any(|curve| !curve.name.is_empty()) {
        names(&mut chart, emptiest(&curves, [left, low, right, high], headroom > 0.0))?;
    }
    Ok(())
}

/// What marks the points of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Mark {
    Disc,
    Circle,
    Cross,
}

/// What tells a curve from the others of its panel.
#[derive(Clone, Copy)]
struct Look {
    colour: RGBColor,
    mark: Option<Mark>,
    dashed: bool,
}

/// The look of every curve.
fn looks(curves: &[Curve]) -> Vec<Look> {
    let (mut coloured, mut known) = (0_usize, 0_usize);
    let of = |curve: &Curve| {
        let named = !curve.name.is_empty();
        let plain = |colour| Look { colour, mark: None, dashed: false };
        match curve.style {
            Style::Line => return plain(BLACK),
            Style::Dashes => return Look { dashed: true, ..plain(GREY) },
            Style::Faint if named => return plain(GREY),
            Style::Known => {
                known += usize::from(named);
                return Look {
                    mark: Some(if known > 1 { Mark::Cross } else { Mark::Circle }),
                    ..plain(BLACK)
                };
            }
            _ => coloured = curve.place.map_or(coloured + usize::from(named), |place| place + 1),
        }
        let place = coloured.saturating_sub(1);
        let again = place / COLOURS.len() % 2 == 1;
        let marked = matches!(curve.style, Style::Points | Style::Joined);
        Look {
            colour: COLOURS[place % COLOURS.len()],
            mark: marked.then_some(if again { Mark::Circle } else { Mark::Disc }),
            dashed: again && !marked,
        }
    };
    curves.iter().map(of).collect()
}

fn stroke(
    chart: &mut Chart,
    curve: &Curve,
    points: &[(f64, f64)],
    Look { colour, mark, dashed }: Look,
) -> std::result::Result<(), Box<dyn std::error::Error>> {
    let line = match curve.style {
        Style::Faint => colour.mix(0.6).stroke_width(pixels(1)),
        _ => colour.stroke_width(pixels(2)),
    };
    let [size, length] = [pixels(3), pixels(26)].map(|size| size as i32);
    let points = || points.iter().copied();
    if curve.style == Style::Joined {
        // Piece by piece: a thick line that turns back on itself would be drawn with a spike.
        let pieces: Vec<_> = points().zip(points().skip(1)).collect();
        chart.draw_series(pieces.into_iter().map(|(from, to)| PathElement::new([from, to], line)))?;
    }
    let name = curve.name.as_str();
    let middle = length / 2;
    match mark {
        Some(Mark::Cross) => {
            let look = colour.stroke_width(pixels(1));
            let drawn = chart.draw_series(points().map(|point| Cross::new(point, size, look)))?;
            if let Some(drawn) = named(drawn, name) {
                drawn.legend(move |(x, y)| Cross::new((x + middle, y), size, look));
            }
        }
        Some(mark) => {
            let look = ShapeStyle { filled: mark == Mark::Disc, ..colour.stroke_width(pixels(1)) };
            let drawn = chart.draw_series(points().map(|point| Circle::new(point, size, look)))?;
            if let Some(drawn) = named(drawn, name) {
                drawn.legend(move |(x, y)| Circle::new((x + middle, y), size, look));
            }
        }
        None if dashed => {
            let [dash, gap] = [pixels(7), pixels(5)];
            let drawn = chart.draw_series(DashedLineSeries::new(points(), dash, gap, line))?;
            if let Some(drawn) = named(drawn, name) {
                drawn
                    .legend(move |(x, y)| DashedPathElement::new([(x, y), (x + length, y)], dash, gap, line));
            }
        }
        None => {
            let drawn = chart.draw_series(LineSeries::new(points(), line))?;
            if let Some(drawn) = named(drawn, name) {
                drawn.legend(move |(x, y)| PathElement::new([(x, y), (x + length, y)], line));
            }
        }
    }
    Ok(())
}

/// The entry of a curve in the legend, if it has a name.
fn named<'c, 'a, B: DrawingBackend>(
    drawn: &'c mut SeriesAnno<'a, B>,
    name: &str,
) -> Option<&'c mut SeriesAnno<'a, B>> {
    (!name.is_empty()).then(|| drawn.label(name))
}

/// An axis with ticks at places of its own.
#[derive(Clone)]
pub(super) struct Axis {
    range: RangedCoordf64,
    ticks: Vec<f64>,
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.range.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.range()
    }
}

/// Places of the ticks of an axis: on a logarithmic one, in decades, whole decades, or 1, 2 and 5 of each where these
/// are few.
fn places_of_ticks(log: bool, low: f64, high: f64, most: usize) -> Vec<f64> {
    if !log {
        return RangedCoordf64::from(low..high).key_points(most);
    }
    let (low, high) = (low.min(high), low.max(high));
    let decades = low.ceil() as i32..=high.floor() as i32;
    if high - low >= 2.5 {
        let every = decades.clone().count().div_ceil(most).max(1);
        return decades.step_by(every).map(f64::from).collect();
    }
    let parts = |decade: i32| [1.0_f64, 2.0, 5.0].map(|part| f64::from(decade) + part.log10());
    let all = (low.floor() as i32..=high.floor() as i32).flat_map(parts);
    all.filter(|place| (low..=high).contains(place)).collect()
}

/// Labels of an axis; powers of ten on a logarithmic one, plain numbers where it spans little.
fn ticks(log: bool, low: f64, high: f64) -> Box<dyn Fn(&f64) -> String> {
    if !log {
        return Box::new(label(low, high));
    }
    let few = (high - low).abs() < 2.5;
    Box::new(move |decades| {
        let value = 10f64.powf(*decades);
        match few {
            true => label(value, 1.1 * value)(&value),
            false => power_of_ten(decades.round() as i32),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_of_a_logarithmic_axis_are_round() {
        let said = |low: f64, high: f64| {
            let ticks = ticks(true, low, high);
            places_of_ticks(true, low, high, 6).iter().map(ticks).collect::<Vec<_>>()
        };
        // They were 0.00032, 0.0010, 0.0032.
        assert_eq!(said(-2.2, -0.9), ["0.01", "0.02", "0.05", "0.1"]);
        assert_eq!(said(-10.5, 0.4).len(), 6);
        assert_eq!(said(-0.4, 3.2), ["10\u{2070}", "10\u{b9}", "10\u{b2}", "10\u{b3}"]);
    }

    #[test]
    fn curves_of_a_panel_look_different() {
        for style in [Style::Measured, Style::Joined, Style::Points] {
            let of = |k| Curve { style, ..Curve::measured(format!("{k}"), vec![]) };
            let mut curves: Vec<Curve> = (0..9).map(of).collect();
            curves.insert(1, Curve::faint("", vec![]));
            curves.extend(["a", "b"].map(|name| Curve::known(name, vec![])));
            let looks = looks(&curves);
            assert_eq!(looks[0].colour, looks[1].colour, "a faint curve belongs to the one before");
            let named = curves.iter().zip(&looks).filter(|(curve, _)| !curve.name.is_empty());
            let mut seen: Vec<_> =
                named.map(|(_, Look { colour, mark, dashed })| (colour.rgb(), *mark, *dashed)).collect();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), 11);
        }
    }

    /// Curves that lie on each other are one in one panel of a study and two in the other: all that followed changed
    /// their colours.
    #[test]
    fn a_curve_looks_the_same_in_panels_with_other_curves() {
        let of = |places: &[usize]| {
            let curve = |k: &usize| Curve { place: Some(*k), ..Curve::joined(format!("{k}"), vec![]) };
            looks(&places.iter().map(curve).collect::<Vec<_>>())
        };
        let (all, some) = (of(&[0, 1, 2, 3, 7]), of(&[0, 3, 7]));
        for (a, b) in [(0, 0), (3, 1), (4, 2)] {
            assert_eq!((all[a].colour, all[a].mark), (some[b].colour, some[b].mark));
        }
    }
}
