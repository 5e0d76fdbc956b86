//! Curves against time.

use super::fit::Exponential;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use std::path::Path;
use voidage_campaign::plot::canvas::{Canvas, label, pixels, text};
use voidage_coupling::Result;

// Colours that colour-blind readers can tell apart (Okabe and Ito).
const BLUE_LINE: RGBColor = RGBColor(0, 114, 178);
const ORANGE_LINE: RGBColor = RGBColor(213, 94, 0);
const GREEN_LINE: RGBColor = RGBColor(0, 158, 115);
const SKY_LINE: RGBColor = RGBColor(120, 180, 225);

/// A curve with its name in the legend.
struct Curve<'a> {
    name: String,
    points: Vec<(f64, f64)>,
    style: Style<'a>,
}

enum Style<'a> {
    Solid(&'a RGBColor, u32),
    Dashed(&'a RGBColor),
}

/// Mean grain temperature, and the exponential that fits it.
pub fn temperature(path: &Path, time: &[f64], mean: &[f64], fit: Option<&Exponential>) -> Result<()> {
    let end = time.last().copied().unwrap_or(1.0);
    let mut curves = vec![Curve {
        name: "mean of the grains".to_owned(),
        points: time.iter().copied().zip(mean.iter().copied()).collect(),
        style: Style::Solid(&BLUE_LINE, 3),
    }];
    if let Some(fit) = fit {
        let curve = (0..=200).map(|k| end * k as f64 / 200.0).map(|t| (t, fit.at(t))).collect();
        let name = format!(
            "{:.1} K + {:.1} K exp(\u{2212}t / {:.2} s)",
            fit.limit, fit.amplitude, fit.time_constant
        );
        curves.push(Curve { name, points: curve, style: Style::Dashed(&ORANGE_LINE) });
    }
    chart(path, "mean grain temperature (K)", &curves, None)
}

/// Pressure drop with its mean over a window, and the weight of the bed.
pub fn pressure(
    path: &Path,
    time: &[f64],
    drop: &[f64],
    window: (f64, f64),
    weight: Option<f64>,
) -> Result<()> {
    let end = time.last().copied().unwrap_or(1.0);
    let inside: Vec<f64> = time
        .iter()
        .zip(drop)
        .filter(|(t, p)| **t >= window.0 && **t <= window.1 && p.is_finite())
        .map(|(_, p)| *p)
        .collect();
    let mut curves = vec![Curve {
        name: "pressure drop".to_owned(),
        points: time.iter().copied().zip(drop.iter().copied()).filter(|(_, p)| p.is_finite()).collect(),
        style: Style::Solid(&SKY_LINE, 2),
    }];
    if !inside.is_empty() {
        let mean = inside.iter().sum::<f64>() / inside.len() as f64;
        let name = format!("mean from {:.3} s to {:.3} s: {mean:.1} Pa", window.0, window.1);
        curves.push(Curve {
            name,
            points: vec![(window.0, mean), (window.1, mean)],
            style: Style::Solid(&BLUE_LINE, 3),
        });
    }
    if let Some(weight) = weight {
        let name = format!("weight of the bed per area: {weight:.1} Pa");
        curves.push(Curve {
            name,
            points: vec![(0.0, weight), (end, weight)],
            style: Style::Dashed(&GREEN_LINE),
        });
    }
    // From zero: the drop is judged by its size.
    chart(path, "pressure drop (Pa)", &curves, Some(0.0))
}

const COLOURS: [RGBColor; 6] =
    [BLUE_LINE, ORANGE_LINE, GREEN_LINE, SKY_LINE, RGBColor(230, 159, 0), RGBColor(204, 121, 167)];

/// Share of the largest energy below which a term has no curve.
const SMALL: f64 = 2e-3;

/// Energies with their names; the last value of each stands beside its name.
pub fn energy(path: &Path, time: &[f64], columns: &[(&str, &[f64])]) -> Result<()> {
    let largest = |column: &[f64]| column.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let most = columns.iter().fold(0.0_f64, |most, (_, column)| most.max(largest(column)));
    let shown = columns.iter().filter(|(_, column)| largest(column) > SMALL * most);
    let curves: Vec<Curve> = shown
        .zip(COLOURS.iter().cycle())
        .enumerate()
        .map(|(k, ((name, column), colour))| Curve {
            name: format!("{name}: {:.3} J/m", column.last().copied().unwrap_or(0.0)),
            points: time.iter().copied().zip(column.iter().copied()).collect(),
            style: if k < COLOURS.len() { Style::Solid(colour, 3) } else { Style::Dashed(colour) },
        })
        .collect();
    chart(path, "energy since the start (J/m)", &curves, Some(0.0))
}

/// Differences of runs against time, decades up: one curve per name.
pub fn differences(path: &Path, curves: Vec<(String, Vec<(f64, f64)>)>) -> Result<()> {
    let curves: Vec<Curve> = curves
        .into_iter()
        .zip(COLOURS.iter().cycle())
        .map(|((name, points), colour)| Curve {
            name,
            points: points.into_iter().filter(|(_, y)| *y > 0.0).map(|(x, y)| (x, y.log10())).collect(),
            style: Style::Solid(colour, 3),
        })
        .collect();
    chart(path, "log10 of the relative difference", &curves, None)
}

/// A chart whose axes show all points that are numbers, and this value too; none without a point.
fn chart(path: &Path, label_y: &str, curves: &[Curve], with: Option<f64>) -> Result<()> {
    let are_numbers = |(x, y): &&(f64, f64)| x.is_finite() && y.is_finite();
    let points = || curves.iter().flat_map(|curve| &curve.points).filter(are_numbers);
    if points().next().is_none() {
        return Ok(());
    }
    let end = points().map(|point| point.0).fold(0.0, f64::max);
    let end = if end > 0.0 { end } else { 1.0 };
    let heights = || points().map(|point| point.1).chain(with);
    let low = heights().fold(f64::INFINITY, f64::min);
    let high = heights().fold(f64::NEG_INFINITY, f64::max);
    // Room above for the legend.
    let span = (high - low).max(1e-6 * high.abs()).max(1e-12);
    let (low, high) = (low - 0.05 * span, high + 0.12 * span * curves.len() as f64);
    let mut canvas = Canvas::new(1200, 800);
    canvas.draw(path, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(pixels(24))
            .margin_right(pixels(44))
            .x_label_area_size(pixels(72))
            .y_label_area_size(pixels(112))
            .build_cartesian_2d(0.0..end, low..high)?;
        chart
            .configure_mesh()
            .x_desc("time (s)")
            .y_desc(label_y)
            .axis_desc_style(text(26))
            .label_style(text(22))
            .x_labels(8)
            .y_labels(8)
            .x_label_formatter(&label(0.0, end))
            .y_label_formatter(&label(low, high))
            .axis_style(BLACK.stroke_width(pixels(1)))
            .bold_line_style(RGBColor(225, 225, 225).stroke_width(pixels(1)))
            .light_line_style(TRANSPARENT)
            .set_all_tick_mark_size(pixels(6))
            .draw()?;
        let pixel = pixels(1);
        for curve in curves {
            let points = curve.points.iter().filter(are_numbers).copied();
            let name = curve.name.as_str();
            match curve.style {
                Style::Solid(colour, width) => {
                    let stroke = colour.stroke_width(width * pixel);
                    chart
                        .draw_series(LineSeries::new(points, stroke))?
                        .label(name)
                        .legend(move |(x, y)| PathElement::new([(x, y), (x + pixels(44) as i32, y)], stroke));
                }
                Style::Dashed(colour) => {
                    let stroke = colour.stroke_width(3 * pixel);
                    let dashes = DashedLineSeries::new(points, pixels(12), pixels(7), stroke);
                    chart.draw_series(dashes)?.label(name).legend(move |(x, y)| {
                        DashedPathElement::new(
                            [(x, y), (x + pixels(44) as i32, y)],
                            pixels(12),
                            pixels(7),
                            stroke,
                        )
                    });
                }
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .margin(pixels(14))
            .legend_area_size(pixels(56))
            .label_font(text(22))
            .background_style(WHITE.mix(0.85))
            .draw()?;
        Ok(())
    })?;
    canvas.save(path)
}

#[cfg(test)]
mod tests {
    /// A run whose grains had not come yet ended with a panic.
    #[test]
    fn a_temperature_that_is_never_known_has_no_picture() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("temperature.png");
        super::temperature(&path, &[0.0, 1.0], &[f64::NAN; 2], None).unwrap();
        assert!(!path.exists());
        super::temperature(&path, &[0.0, 1.0, 2.0], &[f64::NAN, 300.0, 301.0], None).unwrap();
        assert!(path.exists());
    }
}
