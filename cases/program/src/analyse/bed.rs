//! The height of a bed.

/// Share of the solid below the surface of the bed.
pub const BELOW: f64 = 0.95;

/// Heights above the floor, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heights {
    /// Mean over the solid volume.
    pub mean: f64,
    /// Height below which [`BELOW`] of the solid volume lies.
    pub surface: f64,
}

/// The heights of grains at `y` with these solid volumes, above a floor; none without grains.
pub fn heights(y: &[f64], solid: &[f64], floor: f64) -> Option<Heights> {
    let all: f64 = solid.iter().sum();
    if y.is_empty() || all <= 0.0 {
        return None;
    }
    let mean = y.iter().zip(solid).map(|(y, solid)| y * solid).sum::<f64>() / all;
    let mut order: Vec<usize> = (0..y.len()).collect();
    order.sort_by(|a, b| y[*a].total_cmp(&y[*b]));
    // Half of a grain is below its centre.
    let (mut below, mut last) = (0.0, None);
    let mut surface = y[order[order.len() - 1]];
    for grain in order {
        let share = (below + 0.5 * solid[grain]) / all;
        if share >= BELOW {
            surface = match last {
                Some((before, low)) => low + (BELOW - before) / (share - before) * (y[grain] - low),
                None => y[grain],
            };
            break;
        }
        last = Some((share, y[grain]));
        below += solid[grain];
    }
    Some(Heights { mean: mean - floor, surface: surface - floor })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filled_box_is_twice_as_high_as_its_mean() {
        let y: Vec<f64> = (0..1000).map(|k| 3.0 + 0.002 * (f64::from(k) + 0.5)).rev().collect();
        let found = heights(&y, &[0.7; 1000], 3.0).unwrap();
        assert!((2.0 * found.mean - 2.0).abs() < 1e-9 && (found.surface - 1.9).abs() < 1e-9, "{found:?}");
        // What lies high counts with its volume.
        let one = heights(&[1.0, 5.0], &[99.0, 1.0], 0.0).unwrap();
        assert!((one.mean - 1.04).abs() < 1e-12 && one.surface < 4.7, "{one:?}");
        assert_eq!(heights(&[], &[], 0.0), None);
    }
}
