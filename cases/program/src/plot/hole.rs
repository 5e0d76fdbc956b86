//! Where a droplet is in the frames of a run: a hole of the mesh.

use crate::results::table::Table;
use std::collections::BTreeMap;
use voidage_scene::recorder::Frame;

/// Where a droplet is over time and how large, from the series of a run.
pub struct Track {
    /// s.
    time: Vec<f64>,
    /// Along both axes, m.
    centre: [Vec<f64>; 2],
    /// m.
    radius: Vec<f64>,
}

impl Track {
    /// None where the series does not say where the droplet is.
    pub fn new(series: &Table) -> Option<Track> {
        let column = |name: &str| series.column(name).map(<[f64]>::to_vec);
        let centre = [column("droplet_x_m")?, column("droplet_y_m")?];
        Some(Track { time: column("time_s")?, centre, radius: column("droplet_radius_m")? })
    }

    /// The centre at a time, s.
    pub fn centre(&self, time: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.between(time, &self.centre[axis]))
    }

    /// The radius at a time, s.
    pub fn radius(&self, time: f64) -> f64 {
        self.between(time, &self.radius)
    }

    /// The value of a column at a time, on the line between two rows.
    fn between(&self, time: f64, values: &[f64]) -> f64 {
        let after = self.time.partition_point(|at| *at < time).min(self.time.len() - 1);
        let before = after.saturating_sub(1);
        let span = self.time[after] - self.time[before];
        let share = if span > 0.0 { ((time - self.time[before]) / span).clamp(0.0, 1.0) } else { 0.0 };
        values[before] + share * (values[after] - values[before])
    }
}

/// The hole of a mesh of triangles around a point, as a polygon; none where the point is in the mesh or outside of all
/// of it.
pub fn around(mesh: &Frame, point: [f64; 2]) -> Option<Vec<[f64; 2]>> {
    // Corners go round a triangle in one sense, so that a side with a neighbour is there in both directions.
    let sides = mesh.cells.as_chunks::<3>().0.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]);
    let mut all: Vec<(u32, u32)> = sides.collect();
    all.sort_unstable();
    let alone = |(a, b): &&(u32, u32)| all.binary_search(&(*b, *a)).is_err();
    let mut next: BTreeMap<u32, u32> = all.iter().filter(alone).copied().collect();
    while let Some((first, mut node)) = next.pop_first() {
        let mut ring = vec![first];
        while let Some(following) = next.remove(&node) {
            ring.push(node);
            node = following;
        }
        let ring: Vec<[f64; 2]> = ring
            .into_iter()
            .map(|node| {
                let [x, y, _] = mesh.points[node as usize];
                [x, y]
            })
            .collect();
        if turns(&ring, point) < 0.0 {
            return Some(ring);
        }
    }
    None
}

/// How often a ring goes around a point, counterclockwise: once around what is within the outer boundary, minus once
/// around a hole.
fn turns(ring: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let sides = ring.iter().zip(ring.iter().cycle().skip(1));
    let angle = sides.map(|(a, b)| {
        let [[ax, ay], [bx, by]] = [a, b].map(|corner| [corner[0] - x, corner[1] - y]);
        (ax * by - ay * bx).atan2(ax * bx + ay * by)
    });
    (angle.sum::<f64>() / std::f64::consts::TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 3 x 3 squares of two triangles each, without the middle one.
    fn mesh() -> Frame {
        let points = (0..16).map(|node| [f64::from(node % 4), f64::from(node / 4), 0.0]).collect();
        let squares = (0..9).filter(|square| *square != 4).map(|square| square % 3 + 4 * (square / 3));
        let cells = squares.flat_map(|a| [a, a + 1, a + 5, a, a + 5, a + 4]).collect();
        Frame { points, cells, columns: Vec::new() }
    }

    #[test]
    fn the_hole_around_a_point_is_found() {
        let mut ring = around(&mesh(), [1.5, 1.4]).unwrap();
        ring.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(ring, [[1.0, 1.0], [1.0, 2.0], [2.0, 1.0], [2.0, 2.0]]);
        assert!(around(&mesh(), [0.5, 0.5]).is_none() && around(&mesh(), [9.0, 0.5]).is_none());
    }

    #[test]
    fn a_track_is_joined_by_lines_and_ends_where_it_ends() {
        let centre = [vec![0.0, 1.0, 1.0], vec![2.0, 2.0, 0.0]];
        let track = Track { time: vec![0.0, 1.0, 3.0], centre, radius: vec![3.0, 3.0, 1.0] };
        let at = [-1.0, 0.5, 2.0, 4.0].map(|time| track.centre(time));
        assert_eq!(at, [[0.0, 2.0], [0.5, 2.0], [1.0, 1.0], [1.0, 0.0]]);
        assert_eq!(track.radius(2.0), 2.0);
        let single = Track { time: vec![0.0], centre: [vec![5.0], vec![6.0]], radius: vec![1.0] };
        assert_eq!(single.centre(1.0), [5.0, 6.0]);
    }
}
