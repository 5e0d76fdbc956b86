//! Stacked bars: what a whole is made of.

use super::canvas::{Area, Canvas, pixels, text};
use super::panels::COLOURS;
use plotters::prelude::*;
use plotters::style::ShapeStyle;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::Path;
use voidage_coupling::Result;

/// One bar.
#[derive(Clone, Debug)]
pub struct Bar {
    /// What stands beside it.
    pub name: String,
    /// Names of its parts, and seconds.
    pub parts: Vec<(String, f64)>,
}

/// Share of a bar below which a part is not told apart.
const SMALL: f64 = 0.005;

impl Bar {
    /// Seconds in all.
    fn whole(&self) -> f64 {
        self.parts.iter().map(|(_, seconds)| seconds).sum::<f64>().max(1e-300)
    }

    /// Share of a part, %.
    fn share(&self, name: &str) -> f64 {
        let seconds = self.parts.iter().find(|(part, _)| part == name).map_or(0.0, |(_, seconds)| *seconds);
        1e2 * seconds / self.whole()
    }
}

/// Draws bars of the same length, parts as shares, with the seconds of each behind its name.
///
/// # Errors
/// The file cannot be written.
pub fn draw(path: &Path, title: &str, bars: &[Bar]) -> Result<()> {
    let mut names: Vec<&str> =
        bars.iter().flat_map(|bar| bar.parts.iter().map(|part| part.0.as_str())).collect();
    names.sort_unstable();
    names.dedup();
    names.retain(|name| bars.iter().any(|bar| bar.share(name) >= 1e2 * SMALL));
    let rows = bars.len().max(1);
    let height = (34 * rows).max(20 * names.len()) as u32;
    let mut canvas = Canvas::new(980, 110 + height);
    canvas.draw(path, |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(title, text(16))
            .margin(pixels(10))
            .margin_right(pixels(120))
            .x_label_area_size(pixels(42))
            .y_label_area_size(pixels(270))
            .build_cartesian_2d(0.0..100.0, 0.0..rows as f64)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc("share of the time (%)")
            .y_labels(0)
            .x_labels(6)
            .x_label_formatter(&|share| format!("{share:.0}"))
            .axis_desc_style(text(15))
            .label_style(text(13))
            .axis_style(BLACK.stroke_width(pixels(1)))
            .draw()?;
        for (row, bar) in bars.iter().rev().enumerate() {
            let (mut from, low) = (0.0, row as f64 + 0.18);
            for (k, name) in names.iter().enumerate() {
                let to = from + bar.share(name);
                chart.draw_series([Rectangle::new([(from, low), (to, low + 0.64)], fill(k))])?;
                from = to;
            }
            let (x, y) = chart.backend_coord(&(0.0, row as f64 + 0.5));
            let said = format!("{}: {}", bar.name, seconds(bar.whole()));
            write(area, said, (x - pixels(8) as i32, y), HPos::Right)?;
        }
        let (right, top) = chart.backend_coord(&(100.0, rows as f64));
        let half = pixels(6) as i32;
        for (k, name) in names.iter().enumerate() {
            let (x, y) = (right + pixels(14) as i32, top + pixels(10 + 20 * k as u32) as i32);
            area.draw(&Rectangle::new([(x, y - half), (x + 2 * half, y + half)], fill(k)))?;
            write(area, (*name).to_owned(), (x + 3 * half, y), HPos::Left)?;
        }
        Ok(())
    })?;
    canvas.save(path)
}

/// The colour of a part; pale when the colours are used up.
fn fill(part: usize) -> ShapeStyle {
    COLOURS[part % COLOURS.len()].mix(if part < COLOURS.len() { 1.0 } else { 0.45 }).filled()
}

fn write(
    area: &Area,
    said: String,
    place: (i32, i32),
    side: HPos,
) -> std::result::Result<(), Box<dyn std::error::Error>> {
    area.draw(&Text::new(said, place, text(13).pos(Pos::new(side, VPos::Center))))?;
    Ok(())
}

fn seconds(time: f64) -> String {
    match time {
        t if t >= 100.0 => format!("{t:.0} s"),
        t if t >= 1.0 => format!("{t:.2} s"),
        t if t >= 1e-3 => format!("{:.2} ms", 1e3 * t),
        t => format!("{:.1} \u{3bc}s", 1e6 * t),
    }
}
