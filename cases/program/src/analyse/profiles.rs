//! Profiles over the height: how much solid there is, and how much goes up and down.

use voidage_scene::recorder::Frame;

/// Layers of equal thickness.
#[derive(Clone, Debug)]
pub struct Layers {
    /// Where the lowest begins, m.
    pub lower: f64,
    /// Thickness, m.
    pub thickness: f64,
    /// Area of each, m2.
    pub area: Vec<f64>,
}

/// What a layer has at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Layer {
    /// Share that is solid.
    pub solid: f64,
    /// Volume of solid that moves up through a unit of area and time, m/s.
    pub up: f64,
    /// The same down, not negative.
    pub down: f64,
}

impl Layers {
    /// Layers of about this thickness in a box.
    pub fn of_box(lower: [f64; 2], upper: [f64; 2], thickness: f64) -> Layers {
        let count = ((upper[1] - lower[1]) / thickness).round().max(1.0);
        let thickness = (upper[1] - lower[1]) / count;
        let area = vec![(upper[0] - lower[0]) * thickness; count as usize];
        Layers { lower: lower[1], thickness, area }
    }

    /// The same, of which only the part counts that the triangles of a mesh fill.
    pub fn of_mesh(mut self, mesh: &Frame) -> Layers {
        let (lower, thickness, count) = (self.lower, self.thickness, self.area.len());
        self.area.fill(0.0);
        for cell in mesh.cells.as_chunks::<3>().0 {
            let mut corners = cell.map(|node| mesh.points[node as usize]);
            corners.sort_by(|a, b| a[1].total_cmp(&b[1]));
            let bound = |k: usize| lower + thickness * k as f64;
            let first = ((corners[0][1] - lower) / thickness).floor().max(0.0) as usize;
            let mut below = 0.0;
            for (k, area) in self.area.iter_mut().enumerate().skip(first) {
                let up_to = if k + 1 == count { f64::INFINITY } else { bound(k + 1) };
                let all = area_below(&corners, up_to);
                *area += all - below;
                below = all;
                if up_to >= corners[2][1] {
                    break;
                }
            }
        }
        self
    }

    /// Middle of a layer, m.
    pub fn middle(&self, layer: usize) -> f64 {
        self.lower + (layer as f64 + 0.5) * self.thickness
    }

    /// The layers of discs: heights of their centres, velocities along the height, radii and solid volumes. In a domain
    /// that is periodic along the height, with this `period` (m), what lies beyond a side is at the other.
    pub fn of(&self, [y, velocity, radius, solid]: [&[f64]; 4], period: Option<f64>) -> Vec<Layer> {
        let mut found = vec![Layer::default(); self.area.len()];
        let number = |place: f64| {
            ((place - self.lower) / self.thickness).clamp(0.0, self.area.len() as f64 - 1.0) as usize
        };
        let images = period.map_or(vec![0.0], |length| vec![-length, 0.0, length]);
        for grain in 0..y.len() {
            for place in images.iter().map(|image| y[grain] + image) {
                for layer in number(place - radius[grain])..=number(place + radius[grain]) {
                    let at = |k: usize| (self.lower + k as f64 * self.thickness - place) / radius[grain];
                    let share = (disc_below(at(layer + 1)) - disc_below(at(layer))) * solid[grain]
                        / self.area[layer].max(f64::MIN_POSITIVE);
                    found[layer].solid += share;
                    found[layer].up += share * velocity[grain].max(0.0);
                    found[layer].down += share * (-velocity[grain]).max(0.0);
                }
            }
        }
        found
    }
}

/// Share of a unit disc below a height.
fn disc_below(height: f64) -> f64 {
    let height = height.clamp(-1.0, 1.0);
    0.5 + (height.asin() + height * (1.0 - height * height).sqrt()) / std::f64::consts::PI
}

/// Area of a triangle below a height; its corners are in the order of their heights.
fn area_below([low, middle, high]: &[[f64; 3]; 3], height: f64) -> f64 {
    let cross = (middle[0] - low[0]) * (high[1] - low[1]) - (high[0] - low[0]) * (middle[1] - low[1]);
    let all = 0.5 * cross.abs();
    let whole = high[1] - low[1];
    if height >= high[1] {
        all
    } else if height <= low[1] {
        0.0
    } else if height <= middle[1] {
        all * (height - low[1]).powi(2) / (whole * (middle[1] - low[1]))
    } else {
        all * (1.0 - (high[1] - height).powi(2) / (whole * (high[1] - middle[1])))
    }
}

#[cfg(test)]
mod tests {
    use super::super::bubbles::tests::mesh;
    use super::*;

    #[test]
    fn layers_keep_the_volume_and_the_flux_of_grains() {
        let layers = Layers::of_box([0.0, 0.0], [2.0, 1.0], 0.1);
        assert_eq!(layers.area.len(), 10);
        // One grain across two layers, one that falls.
        let (y, velocity, radius, solid) = ([0.2, 0.55], [3.0, -1.0], [0.04, 0.02], [4e-3, 1e-3]);
        let found = layers.of([&y, &velocity, &radius, &solid], None);
        let sum = |of: fn(&Layer) -> f64| found.iter().map(of).sum::<f64>() * 0.2;
        assert!((sum(|layer| layer.solid) - 5e-3).abs() < 1e-15);
        assert!(
            (sum(|layer| layer.up) - 1.2e-2).abs() < 1e-15 && (sum(|layer| layer.down) - 1e-3).abs() < 1e-15
        );
        assert!((found[1].solid - found[2].solid).abs() < 1e-15 && found[5].down > 0.0 && found[5].up == 0.0);
    }

    /// The part beyond a periodic side was lost.
    #[test]
    fn a_grain_in_a_periodic_side_is_in_the_layers_at_both_sides() {
        let layers = Layers::of_box([0.0, 0.0], [2.0, 1.0], 0.1);
        let found = layers.of([&[0.99], &[1.0], &[0.04], &[4e-3]], Some(1.0));
        assert!((found.iter().map(|layer| layer.solid).sum::<f64>() * 0.2 - 4e-3).abs() < 1e-15);
        assert!(found[0].up > 0.0 && found[9].up > found[0].up, "{found:?}");
    }

    #[test]
    fn layers_of_a_mesh_have_the_area_of_its_triangles() {
        let frame = mesh([0.0, 0.0], [2.0, 1.0], [7, 5]);
        let whole = Layers::of_box([0.0, 0.0], [2.0, 1.0], 0.13).of_mesh(&frame);
        let each = 2.0 / whole.area.len() as f64;
        assert!(whole.area.iter().all(|area| (area - each).abs() < 1e-12), "{whole:?}");
        // A triangle: the width falls with the height.
        let mut one = frame;
        (one.points, one.cells) = (vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 1.0, 0.0]], vec![0, 1, 2]);
        let layers = Layers::of_box([0.0, 0.0], [2.0, 1.0], 0.25).of_mesh(&one);
        let exact = |k: f64| 0.25 * 2.0 * (1.0 - 0.25 * (k + 0.5));
        assert!(
            layers.area.iter().zip(0..).all(|(area, k)| (area - exact(f64::from(k))).abs() < 1e-12),
            "{layers:?}"
        );
    }
}
