//! A picture drawn larger than it is saved: every edge becomes smooth when it is made smaller.
//!
//! Axes and text are drawn by plotters; fields and discs are filled here, pixel by pixel, because discs of plotters
//! have integer radii and its triangles cannot be shaded.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::register_font;
use std::fs;
use std::path::Path;
use std::sync::Once;
use voidage_coupling::{Error, Result};

/// How many times larger a picture is drawn than saved.
pub const SCALE: u32 = 3;
/// Family under which the font is known.
const FONT: &str = "sans-serif";

/// A drawing area of a canvas.
pub type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
/// A chart with two axes of numbers.
pub type Chart<'a, 'b> = ChartContext<'a, BitMapBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A picture in the making.
pub struct Canvas {
    pixels: Vec<u8>,
    width: u32,
    height: u32,
}

/// Where a rectangle of the plane lies on a canvas.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Left, top, right and bottom pixel.
    pub pixel: [f64; 4],
    /// Left, bottom, right and top coordinate.
    pub plane: [f64; 4],
}

impl Frame {
    /// The frame of the plot area of a chart.
    pub fn of(chart: &Chart, plane: [f64; 4]) -> Frame {
        let (left, bottom) = chart.backend_coord(&(plane[0], plane[1]));
        let (right, top) = chart.backend_coord(&(plane[2], plane[3]));
        Frame { pixel: [left, top, right, bottom].map(f64::from), plane }
    }

    /// Pixels per unit of the plane.
    pub fn scale(&self) -> f64 {
        (self.pixel[2] - self.pixel[0]) / (self.plane[2] - self.plane[0])
    }

    /// The pixel of a point.
    pub fn place(self, x: f64, y: f64) -> [f64; 2] {
        let along = (x - self.plane[0]) / (self.plane[2] - self.plane[0]);
        let up = (y - self.plane[1]) / (self.plane[3] - self.plane[1]);
        let [left, top, right, bottom] = self.pixel;
        [left + along * (right - left), bottom + up * (top - bottom)]
    }
}

impl Canvas {
    /// A white canvas; sizes are those of the saved picture.
    pub fn new(width: u32, height: u32) -> Canvas {
        static FONTS: Once = Once::new();
        FONTS.call_once(|| {
            // The embedded fonts are good; without them text would be missing and drawing says so.
            let _ = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
            let _ = register_font(FONT, FontStyle::Bold, dejavu::sans::bold());
        });
        let (width, height) = (width * SCALE, height * SCALE);
        Canvas { pixels: vec![255; 3 * width as usize * height as usize], width, height }
    }

    /// Draws with plotters.
    pub fn draw<T>(
        &mut self,
        path: &Path,
        draw: impl FnOnce(&Area) -> std::result::Result<T, Box<dyn std::error::Error>>,
    ) -> Result<T> {
        let area =
            BitMapBackend::with_buffer(&mut self.pixels, (self.width, self.height)).into_drawing_area();
        let result = draw(&area).map_err(|error| failed(path, &error));
        area.present().map_err(|error| failed(path, &error))?;
        result
    }

    /// Fills a triangle with a colour that varies linearly, inside the frame.
    pub fn triangle(
        &mut self,
        frame: Frame,
        corners: [[f64; 2]; 3],
        values: [f64; 3],
        colour: impl Fn(f64) -> [u8; 3],
    ) {
        let [a, b, c] = corners.map(|corner| frame.place(corner[0], corner[1]));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area == 0.0 {
            return;
        }
        let (low, high) = bounds(frame, &[a, b, c]);
        for y in low[1]..high[1] {
            for x in low[0]..high[0] {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let u = ((px - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (py - a[1])) / area;
                let v = ((b[0] - a[0]) * (py - a[1]) - (px - a[0]) * (b[1] - a[1])) / area;
                // A little beyond the edges, so that neighbours leave no gap.
                if u >= -1e-6 && v >= -1e-6 && u + v <= 1.0 + 1e-6 {
                    self.set(
                        x,
                        y,
                        colour(values[0] + u * (values[1] - values[0]) + v * (values[2] - values[0])),
                    );
                }
            }
        }
    }

    /// Fills a rectangle inside the frame.
    pub fn rectangle(&mut self, frame: Frame, lower: [f64; 2], upper: [f64; 2], colour: [u8; 3]) {
        let corners = [frame.place(lower[0], lower[1]), frame.place(upper[0], upper[1])];
        let [left, right] = [corners[0][0].round() as i64, corners[1][0].round() as i64];
        let [top, bottom] = [corners[1][1].round() as i64, corners[0][1].round() as i64];
        let (low, high) = bounds(frame, &corners);
        for y in low[1].max(top)..high[1].min(bottom) {
            for x in low[0].max(left)..high[0].min(right) {
                self.set(x, y, colour);
            }
        }
    }

    /// Fills a disc inside the frame, with a thin dark rim; one that is less than two pixels of the saved picture wide
    /// is a dot without a rim, which covers a pixel at least.
    pub fn disc(&mut self, frame: Frame, centre: [f64; 2], radius: f64, colour: [u8; 3]) {
        let [cx, cy] = frame.place(centre[0], centre[1]);
        let pixel = f64::from(SCALE);
        let radius = (radius * frame.scale()).max(0.5 * pixel);
        let rim = if radius < pixel { 0.0 } else { (0.12 * radius).clamp(0.4, 2.0) };
        let (low, high) = bounds(frame, &[[cx - radius, cy - radius], [cx + radius, cy + radius]]);
        for y in low[1]..high[1] {
            for x in low[0]..high[0] {
                let distance = (x as f64 + 0.5 - cx).hypot(y as f64 + 0.5 - cy);
                if distance <= radius - rim {
                    self.set(x, y, colour);
                } else if distance <= radius {
                    self.set(x, y, colour.map(|channel| (channel as f64 * 0.55) as u8));
                }
            }
        }
    }

    /// Fills a polygon inside the frame.
    pub fn polygon(&mut self, frame: Frame, corners: &[[f64; 2]], colour: [u8; 3]) {
        let corners: Vec<[f64; 2]> = corners.iter().map(|corner| frame.place(corner[0], corner[1])).collect();
        let (low, high) = bounds(frame, &corners);
        for y in low[1]..high[1] {
            let row = y as f64 + 0.5;
            let sides = corners.iter().zip(corners.iter().cycle().skip(1));
            let crossing = sides.filter(|(a, b)| (a[1] <= row) != (b[1] <= row));
            let mut ends: Vec<f64> =
                crossing.map(|(a, b)| a[0] + (row - a[1]) / (b[1] - a[1]) * (b[0] - a[0])).collect();
            ends.sort_by(f64::total_cmp);
            for [from, to] in ends.as_chunks::<2>().0 {
                for x in (from.round() as i64).max(low[0])..(to.round() as i64).min(high[0]) {
                    self.set(x, y, colour);
                }
            }
        }
    }

    fn set(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        let start = 3 * (y as usize * self.width as usize + x as usize);
        if let Some(pixel) = self.pixels.get_mut(start..start + 3) {
            pixel.copy_from_slice(&colour);
        }
    }

    /// Makes the picture smaller by means over squares of pixels, and writes it.
    pub fn save(self, path: &Path) -> Result<()> {
        let (width, height, scale) =
            ((self.width / SCALE) as usize, (self.height / SCALE) as usize, SCALE as usize);
        let mut small = vec![0_u8; 3 * width * height];
        for y in 0..height {
            for x in 0..width {
                for channel in 0..3 {
                    let mut sum = 0_u32;
                    for row in y * scale..(y + 1) * scale {
                        for column in x * scale..(x + 1) * scale {
                            sum += u32::from(self.pixels[3 * (row * self.width as usize + column) + channel]);
                        }
                    }
                    small[3 * (y * width + x) + channel] =
                        ((sum + SCALE * SCALE / 2) / (SCALE * SCALE)) as u8;
                }
            }
        }
        // Beside its place, then renamed: what is there is always a whole picture.
        let beside = path.with_extension("part.png");
        let size = (width as u32, height as u32);
        let mut backend = BitMapBackend::new(&beside, size);
        let drawn = backend.blit_bitmap((0, 0), size, &small).and_then(|()| backend.present());
        drop(backend);
        if let Err(error) = drawn {
            // Half a picture is of no use; if it cannot be removed either, the error says enough.
            let _ = fs::remove_file(&beside);
            return Err(failed(path, &error));
        }
        fs::rename(&beside, path).map_err(|error| Error::file(path, "write", error))
    }
}

/// Pixels that may be inside a shape and are inside the frame.
fn bounds(frame: Frame, points: &[[f64; 2]]) -> ([i64; 2], [i64; 2]) {
    let least = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
    let most = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
    let [left, top, right, bottom] = frame.pixel;
    let low = [least(0).floor().max(left) as i64, least(1).floor().max(top) as i64];
    let high =
        [(most(0).ceil() + 1.0).min(right + 1.0) as i64, (most(1).ceil() + 1.0).min(bottom + 1.0) as i64];
    (low, high)
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> Error {
    Error::run(format!("{}: cannot draw: {error}", path.display()))
}

/// Text of a size in points of the saved picture.
pub fn text(size: u32) -> TextStyle<'static> {
    (FONT, size * SCALE).into_font().color(&BLACK)
}

/// Pixels of the canvas for pixels of the saved picture.
pub const fn pixels(size: u32) -> u32 {
    size * SCALE
}

/// A power of ten as it is printed.
pub fn power_of_ten(exponent: i32) -> String {
    let raised = |digit: char| match digit {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    };
    format!("10{}", exponent.to_string().chars().map(raised).collect::<String>())
}

/// A number with so many digits behind the point, without zeros at its end.
fn plain(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    text.replace('-', "\u{2212}")
}

/// Labels of an axis: as many digits as its steps need, and a power of ten where numbers are very small or large.
pub fn label(low: f64, high: f64) -> impl Fn(&f64) -> String {
    let (span, largest) = ((high - low).abs(), low.abs().max(high.abs()));
    let needed = |span: f64| (1.0 - (span / 3.0).log10().floor()).clamp(0.0, 8.0) as usize;
    // Four digits behind the point are read at a glance, and so are five before it.
    let exponent = (span > 0.0 && !(1e-3..1e5).contains(&largest)).then(|| largest.log10().floor() as i32);
    move |value| {
        let value = if value.abs() < 1e-9 * span { 0.0 } else { *value };
        match exponent {
            Some(exponent) if value != 0.0 => {
                let unit = 10f64.powi(exponent);
                format!("{}\u{b7}{}", plain(value / unit, needed(span / unit)), power_of_ten(exponent))
            }
            _ => plain(value, if span > 0.0 { needed(span) } else { 2 }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_read_at_a_glance_whatever_the_size() {
        let said =
            |low: f64, high: f64, values: &[f64]| values.iter().map(label(low, high)).collect::<Vec<_>>();
        assert_eq!(said(0.0, 1.5, &[0.0, 0.5, 1.5]), ["0", "0.5", "1.5"]);
        assert_eq!(said(290.0, 363.0, &[300.0, 350.0]), ["300", "350"]);
        // They were "0", "0", "0".
        assert_eq!(
            said(0.0, 4e-12, &[0.0, 2e-12, 4e-12]),
            ["0", "2\u{b7}10\u{207b}\u{b9}\u{b2}", "4\u{b7}10\u{207b}\u{b9}\u{b2}"]
        );
        assert_eq!(said(-3e7, 3e7, &[-2e7]), ["\u{2212}2\u{b7}10\u{2077}"]);
        assert_eq!(power_of_ten(-10), "10\u{207b}\u{b9}\u{2070}");
    }
}
