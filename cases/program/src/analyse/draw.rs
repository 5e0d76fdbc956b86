//! Pictures of an analysis.

use super::spectrum::Spectrum;
use super::tables::{BedRow, BubbleRow, BubblesAt, ProfileRow};
use std::path::Path;
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_coupling::Result;

/// Spectra of columns, each beside red noise.
pub fn spectra(path: &Path, spectra: &[(String, Spectrum)]) -> Result<()> {
    let panel = |(column, found): &(String, Spectrum)| {
        let title = match found.dominant() {
            Some(frequency) => format!(
                "{column}: {} Hz, resolved to {} Hz",
                super::short(frequency),
                super::short(found.resolution)
            ),
            None => format!("{column}: no dominant frequency"),
        };
        let density = format!("power spectral density ({})", unit_of_density(column));
        let mut panel = Panel::log_log(title, "frequency (Hz)", density);
        let points =
            |values: &[f64]| found.frequency.iter().copied().zip(values.iter().copied()).skip(1).collect();
        panel
            .curves
            .push(Curve::measured(format!("mean of {} segments", found.segments), points(&found.density)));
        panel.curves.push(Curve::dashes("red noise", points(&found.noise)));
        panel
    };
    panels::large(path, 2, &spectra.iter().map(panel).collect::<Vec<_>>())
}

/// Unit of the spectral density of a column, by the unit at the end of its name.
fn unit_of_density(column: &str) -> String {
    const UNITS: [&str; 11] = ["N", "Pa", "K", "W", "J", "kg", "m", "m2", "s", "s2", "per"];
    let words: Vec<&str> = column.split('_').collect();
    let first = words.iter().rposition(|word| !UNITS.contains(word)).map_or(0, |last| last + 1);
    let unit =
        words[first..].join(" ").replace(" per ", "/").replace("m2", "m\u{b2}").replace("s2", "s\u{b2}");
    match unit.as_str() {
        "" => "s".into(),
        unit if unit.chars().all(char::is_alphabetic) => format!("{unit}\u{b2} s"),
        unit => format!("({unit})\u{b2} s"),
    }
}

/// A curve of the frames; none where all values are no number.
fn over_time(rows: &[BedRow], name: &str, of: impl Fn(&BedRow) -> f64) -> Option<Curve> {
    let points: Vec<(f64, f64)> =
        rows.iter().map(|row| (row.time_s, of(row))).filter(|(_, value)| value.is_finite()).collect();
    (!points.is_empty()).then(|| Curve::measured(name, points))
}

/// Height of the bed and mixing index over time; false, and no picture, where neither is known.
pub fn bed(path: &Path, rows: &[BedRow]) -> Result<bool> {
    let mut sheet = Vec::new();
    let mut height = Panel::new("height of the bed", "time (s)", "height (mm)");
    height.curves.extend(over_time(rows, "95 % of the solid is below", |row| 1e3 * row.bed_height_95_m));
    height.curves.extend(over_time(rows, "twice the mean height", |row| 1e3 * row.bed_height_from_mean_m));
    height.headroom = 0.25;
    let mut mixing = Panel::new("mixing", "time (s)", "Lacey index");
    mixing.curves.extend(over_time(rows, "", |row| row.lacey_index));
    mixing.headroom = 0.2;
    let ends = || [rows.first(), rows.last()].into_iter().flatten();
    let limit = |value: f64| ends().map(|row| (row.time_s, value)).collect::<Vec<_>>();
    if !mixing.curves.is_empty() {
        mixing.curves.push(Curve::dashes("mixed at random (1), separated (0)", limit(1.0)));
        mixing.curves.push(Curve::dashes("", limit(0.0)));
    }
    sheet.extend([height, mixing].into_iter().filter(|panel| !panel.curves.is_empty()));
    if sheet.is_empty() {
        return Ok(false);
    }
    panels::large(path, 2, &sheet).map(|()| true)
}

/// Values over the height, each as a point and a bar of its error.
fn bar(curves: &mut Vec<Curve>, name: &str, points: &[(f64, f64, f64)]) {
    let known = points.iter().filter(|(x, y, _)| x.is_finite() && y.is_finite());
    curves.push(Curve::joined(name, known.clone().map(|(x, y, _)| (*x, *y)).collect()));
    for (x, y, error) in known.filter(|(_, _, error)| error.is_finite()) {
        curves.push(Curve::measured("", vec![(x - error, *y), (x + error, *y)]));
    }
}

/// Bubbles: their number over time, all of them by height, and the means by height.
pub fn bubbles(
    path: &Path,
    rows: &[BedRow],
    all: &[&BubbleRow],
    by_height: &[BubblesAt],
    floor: f64,
) -> Result<()> {
    let mut number = Panel::new("bubbles over time", "time (s)", "number in a frame");
    number.curves.extend(over_time(rows, "", |row| row.bubbles));
    let mut each = Panel::new("each bubble", "equivalent diameter (mm)", "height (mm)");
    let points = all.iter().map(|one| (1e3 * one.diameter_m, 1e3 * (one.y_m - floor))).collect();
    each.curves.push(Curve::known("", points));
    let mut diameter =
        Panel::new("mean size, with standard errors", "equivalent diameter (mm)", "height (mm)");
    let means: Vec<_> = by_height
        .iter()
        .map(|at| (1e3 * at.diameter_m, 1e3 * at.height_m, 1e3 * at.diameter_standard_error_m))
        .collect();
    bar(&mut diameter.curves, "", &means);
    let mut frequency = Panel::new("mean number, with standard errors", "bubbles in a frame", "height (mm)");
    let means: Vec<_> = by_height
        .iter()
        .map(|at| (at.bubbles_per_frame, 1e3 * at.height_m, at.bubbles_per_frame_standard_error))
        .collect();
    bar(&mut frequency.curves, "", &means);
    panels::grid(path, 2, &[number, each, frequency, diameter])
}

/// Profiles of solid fraction and flux over the height.
pub fn profiles(path: &Path, rows: &[ProfileRow], frames: usize) -> Result<()> {
    // What lies above all grains is empty.
    let top = rows.iter().rposition(|row| row.solid_fraction > 0.0).map_or(rows.len(), |last| last + 1);
    let rows = &rows[..top];
    let points = |of: fn(&ProfileRow) -> (f64, f64)| -> Vec<(f64, f64, f64)> {
        rows.iter().map(|row| (of(row).0, 1e3 * row.height_m, of(row).1)).collect()
    };
    let title = format!("mean of {frames} frames, with standard errors");
    let mut solid = Panel::new(title.clone(), "solid fraction", "height (mm)");
    bar(&mut solid.curves, "", &points(|row| (row.solid_fraction, row.solid_fraction_standard_error)));
    let mut flux = Panel::new(title, "flux of solid (mm/s)", "height (mm)");
    let up = |row: &ProfileRow| (1e3 * row.upward_flux_m_per_s, 1e3 * row.upward_flux_standard_error_m_per_s);
    let down =
        |row: &ProfileRow| (1e3 * row.downward_flux_m_per_s, 1e3 * row.downward_flux_standard_error_m_per_s);
    let net = |row: &ProfileRow| (1e3 * row.net_flux_m_per_s, 1e3 * row.net_flux_standard_error_m_per_s);
    bar(&mut flux.curves, "up", &points(up));
    bar(&mut flux.curves, "down", &points(down));
    bar(&mut flux.curves, "up less down", &points(net));
    panels::large(path, 2, &[solid, flux])
}

#[cfg(test)]
mod tests {
    use super::unit_of_density;

    #[test]
    fn a_spectrum_has_the_unit_of_its_column() {
        assert_eq!(unit_of_density("pressure_drop_Pa"), "Pa\u{b2} s");
        assert_eq!(unit_of_density("max_grain_speed_m_per_s"), "(m/s)\u{b2} s");
        assert_eq!(unit_of_density("flux_top_m2_per_s"), "(m\u{b2}/s)\u{b2} s");
        assert_eq!(unit_of_density("contacts"), "s");
    }
}
