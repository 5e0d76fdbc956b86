//! The legend of a panel: where it hides least of the curves, or beside many of them.

use super::canvas::{pixels, text};
use super::panels::{Chart, Panel};
use plotters::prelude::*;

/// Named curves above which the legend stands beside the plot, pixels of it for one letter of its longest name, and for
/// the rest.
const BESIDE: usize = 6;
const LETTER: usize = 8;
const ENTRY: usize = 60;

/// Pixels of a legend beside a panel; none of one within it.
pub(super) fn beside(panel: &Panel) -> u32 {
    let lengths = || panel.curves.iter().map(|curve| curve.name.chars().count()).filter(|length| *length > 0);
    if lengths().count() > BESIDE { (ENTRY + LETTER * lengths().max().unwrap_or(0)) as u32 } else { 0 }
}

/// Draws the legend of the curves of a chart.
pub(super) fn names(
    chart: &mut Chart,
    position: SeriesLabelPosition,
) -> std::result::Result<(), Box<dyn std::error::Error>> {
    chart
        .configure_series_labels()
        .position(position)
        .margin(pixels(8))
        .legend_area_size(pixels(30))
        .label_font(text(14))
        .background_style(WHITE.mix(0.85))
        .draw()?;
    Ok(())
}

/// The place with the fewest points near it, where the legend hides least; above, if there is room for it.
pub(super) fn emptiest(
    curves: &[Vec<(f64, f64)>],
    [left, low, right, high]: [f64; 4],
    above: bool,
) -> SeriesLabelPosition {
    let near = |column: usize, upper: bool| {
        let inside = |(x, y): &&(f64, f64)| {
            let (across, up) = ((x - left) / (right - left), (y - low) / (high - low));
            let across = [across < 0.5, (0.25..0.75).contains(&across), across > 0.5][column];
            across && if upper { up > 0.6 } else { up < 0.4 }
        };
        // A curve of many points hides as much as one of few.
        let share =
            |curve: &Vec<(f64, f64)>| curve.iter().filter(inside).count() as f64 / curve.len().max(1) as f64;
        curves.iter().map(share).sum::<f64>()
    };
    let places = [
        (SeriesLabelPosition::UpperRight, 2, true),
        (SeriesLabelPosition::UpperLeft, 0, true),
        (SeriesLabelPosition::LowerRight, 2, false),
        (SeriesLabelPosition::LowerLeft, 0, false),
        (SeriesLabelPosition::UpperMiddle, 1, true),
        (SeriesLabelPosition::LowerMiddle, 1, false),
    ];
    let allowed = places.into_iter().filter(|(_, _, upper)| *upper || !above);
    let best = allowed.min_by(|a, b| near(a.1, a.2).total_cmp(&near(b.1, b.2)));
    best.map_or(SeriesLabelPosition::UpperRight, |(place, ..)| place)
}
