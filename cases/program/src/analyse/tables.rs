//! The rows of the tables, and what frames give of them.

use super::bubbles::Bubble;
use super::frames::Seen;
use super::statistics::{Estimate, Verdict, estimate};
use super::{bed, mixing};
use serde::Serialize;

/// A row of `spectra.csv`.
#[derive(Serialize)]
pub struct SpectrumRow {
    pub column: String,
    pub segments: usize,
    pub resolution_per_s: f64,
    pub highest_per_s: f64,
    pub above_red_noise: f64,
    pub by_chance: f64,
    pub dominant_per_s: f64,
    pub variance: f64,
    pub integral: f64,
}

/// A row of `spectrum.csv`.
#[derive(Serialize)]
pub struct Density<'a> {
    pub column: &'a str,
    pub frequency_per_s: f64,
    pub power_spectral_density: f64,
    pub red_noise: f64,
}

/// A row of `bed.csv`.
#[derive(Serialize)]
pub struct BedRow {
    pub time_s: f64,
    pub mean_height_m: f64,
    pub bed_height_from_mean_m: f64,
    pub bed_height_95_m: f64,
    pub bubbles: f64,
    pub bubble_area_m2: f64,
    pub mean_bubble_diameter_m: f64,
    pub lacey_index: f64,
    pub lacey_scatter: f64,
    pub lacey_variance: f64,
    pub lacey_variance_mixed: f64,
    pub lacey_variance_separated: f64,
    pub lacey_cells: f64,
}

/// A row of `bubbles.csv`.
#[derive(Serialize)]
pub struct BubbleRow {
    pub time_s: f64,
    pub area_m2: f64,
    pub diameter_m: f64,
    pub x_m: f64,
    pub y_m: f64,
}

/// A row of `bubbles-by-height.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct BubblesAt {
    pub height_m: f64,
    pub bubbles: usize,
    pub bubbles_per_frame: f64,
    pub bubbles_per_frame_standard_error: f64,
    pub bubbles_per_frame_verdict: &'static str,
    pub diameter_m: f64,
    pub diameter_standard_error_m: f64,
    pub diameter_verdict: &'static str,
}

/// A row of `profiles.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct ProfileRow {
    pub height_m: f64,
    pub width_m: f64,
    pub solid_fraction: f64,
    pub solid_fraction_standard_error: f64,
    pub solid_fraction_verdict: &'static str,
    pub upward_flux_m_per_s: f64,
    pub upward_flux_standard_error_m_per_s: f64,
    pub upward_flux_verdict: &'static str,
    pub downward_flux_m_per_s: f64,
    pub downward_flux_standard_error_m_per_s: f64,
    pub downward_flux_verdict: &'static str,
    pub net_flux_m_per_s: f64,
    pub net_flux_standard_error_m_per_s: f64,
    pub net_flux_verdict: &'static str,
}

/// Heights that bubbles are counted at.
const HEIGHTS: usize = 10;
/// Fewest bubbles whose mean diameter has an error.
const FEWEST_BUBBLES: usize = 10;

impl BedRow {
    pub fn new(seen: &Seen) -> BedRow {
        let heights = |of: fn(&bed::Heights) -> f64| seen.heights.as_ref().map_or(f64::NAN, of);
        let mixing = |of: fn(&mixing::Mixing) -> f64| seen.mixing.as_ref().map_or(f64::NAN, of);
        let bubbles = |of: fn(&[Bubble]) -> f64| seen.bubbles.as_deref().map_or(f64::NAN, of);
        BedRow {
            time_s: seen.time,
            mean_height_m: heights(|heights| heights.mean),
            bed_height_from_mean_m: heights(|heights| 2.0 * heights.mean),
            bed_height_95_m: heights(|heights| heights.surface),
            bubbles: bubbles(|all| all.len() as f64),
            bubble_area_m2: bubbles(|all| all.iter().map(|bubble| bubble.area).fold(0.0, |a, b| a + b)),
            // Of no bubbles nothing is known.
            mean_bubble_diameter_m: bubbles(|all| {
                all.iter().map(Bubble::diameter).sum::<f64>() / all.len() as f64
            }),
            lacey_index: mixing(mixing::Mixing::index),
            lacey_scatter: mixing(mixing::Mixing::scatter),
            lacey_variance: mixing(|mixing| mixing.variance),
            lacey_variance_mixed: mixing(|mixing| mixing.mixed),
            lacey_variance_separated: mixing(|mixing| mixing.separated),
            lacey_cells: mixing(|mixing| mixing.cells as f64),
        }
    }
}

/// The bubbles of a frame.
pub fn bubble_rows(seen: &Seen) -> impl Iterator<Item = BubbleRow> {
    seen.bubbles.iter().flatten().map(|bubble| BubbleRow {
        time_s: seen.time,
        area_m2: bubble.area,
        diameter_m: bubble.diameter(),
        x_m: bubble.centre[0],
        y_m: bubble.centre[1],
    })
}

/// The mean equivalent diameter of some of the bubbles of frames.
pub fn diameter(seen: &[Seen], of_interest: impl Fn(&Bubble) -> bool) -> Estimate {
    let of = |one: &Seen| -> Vec<f64> {
        one.bubbles.iter().flatten().filter(|bubble| of_interest(bubble)).map(Bubble::diameter).collect()
    };
    let frames: Vec<Vec<f64>> = seen.iter().map(of).collect();
    let all: Vec<f64> = frames.iter().flatten().copied().collect();
    let number = all.len() as f64;
    let mean = all.iter().sum::<f64>() / number;
    // To first order the error of the ratio of two means is that of the mean of these differences.
    let rest: Vec<f64> =
        frames.iter().map(|frame| frame.iter().map(|diameter| diameter - mean).sum()).collect();
    let mut found = estimate(&rest);
    let per_frame = number / frames.len() as f64;
    if all.len() < FEWEST_BUBBLES {
        let verdict = if all.is_empty() { Verdict::NoNumber } else { Verdict::TooFewRows };
        found = Estimate { error: f64::NAN, batch_error: f64::NAN, verdict, ..found };
    }
    Estimate {
        mean,
        deviation: (all.iter().map(|one| (one - mean).powi(2)).sum::<f64>() / (number - 1.0)).sqrt(),
        error: found.error / per_frame,
        batch_error: found.batch_error / per_frame,
        ..found
    }
}

/// Number and diameter of bubbles in parts of the height of the bed above its floor.
pub fn bubbles_by_height(seen: &[Seen], floor: f64) -> Vec<BubblesAt> {
    let surface =
        seen.iter().filter_map(|one| one.heights).map(|heights| heights.surface).fold(0.0, f64::max);
    let part = surface / HEIGHTS as f64;
    let is_in = |k: usize| {
        move |bubble: &Bubble| {
            let place = ((bubble.centre[1] - floor) / part).floor();
            place.clamp(0.0, HEIGHTS as f64 - 1.0) as usize == k
        }
    };
    (0..HEIGHTS)
        .map(|k| {
            let of = |one: &Seen| one.bubbles.iter().flatten().filter(|bubble| is_in(k)(bubble)).count();
            let numbers: Vec<f64> = seen.iter().map(|one| of(one) as f64).collect();
            let (number, diameter) = (estimate(&numbers), diameter(seen, is_in(k)));
            BubblesAt {
                height_m: (k as f64 + 0.5) * part,
                bubbles: numbers.iter().sum::<f64>() as usize,
                bubbles_per_frame: number.mean,
                bubbles_per_frame_standard_error: number.error,
                bubbles_per_frame_verdict: number.verdict.name(),
                diameter_m: diameter.mean,
                diameter_standard_error_m: diameter.error,
                diameter_verdict: diameter.verdict.name(),
            }
        })
        .collect()
}
