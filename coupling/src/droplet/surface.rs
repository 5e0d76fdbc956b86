//! The surface of a droplet: the polygon of the hole that it makes in the mesh, and how it cuts grains.

use voidage_fluid::mesh::Boundary;
use voidage_fluid::{Error, Mesh, Result, Vector};

/// A polygon around a centre whose shape stays: nodes at x = centre + radius s. Its area is pi radius^2.
#[derive(Clone, Debug, Default)]
pub struct Surface<const D: usize> {
    /// Nodes of the mesh on it, each once, with their s.
    nodes: Vec<(u32, Vector<D>)>,
    /// s at both ends of each facet, in the order of the mesh: clockwise around the centre.
    facets: Vec<[Vector<D>; 2]>,
    /// Smallest distance of the facets from the centre and largest of the nodes, in radii.
    reach: [f64; 2],
}

/// A piece of a facet that lies in a grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chord {
    /// The facet.
    pub facet: u32,
    /// Its length, m.
    pub length: f64,
    /// Where on the facet its middle is, from 0 at the first node to 1 at the second.
    pub at: f64,
}

/// The part of a grain within a polygon.
#[derive(Clone, Debug, Default)]
pub struct Within {
    /// Area, m2.
    pub area: f64,
    /// Where the polygon cuts it.
    pub chords: Vec<Chord>,
}

fn cross<const D: usize>(a: &Vector<D>, b: &Vector<D>) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

impl<const D: usize> Surface<D> {
    /// The surface of a part of the boundary around a centre, and its radius, m.
    ///
    /// # Errors
    /// The part does not go round the centre once.
    pub fn new(mesh: &Mesh<D>, part: &Boundary, centre: &Vector<D>) -> Result<(Self, f64)> {
        let mut ends: Vec<[Vector<D>; 2]> = Vec::new();
        let mut nodes: Vec<u32> = part.facets.clone();
        nodes.sort_unstable();
        nodes.dedup();
        for facet in part.facets.chunks_exact(D) {
            ends.push([0, 1].map(|k| mesh.points[facet[k] as usize] - centre));
        }
        let areas = || ends.iter().map(|[a, b]| cross(b, a) / 2.0);
        let around: f64 = ends.iter().map(|[a, b]| cross(b, a).atan2(b.dot(a))).sum();
        let once = (around - 2.0 * std::f64::consts::PI).abs() < 1e-6 && areas().all(|area| area > 0.0);
        if !once || nodes.len() != ends.len() {
            let (name, centre) = (&part.name, centre.as_slice());
            return Err(Error::Mesh(format!("the boundary \"{name}\" does not go round {centre:?}")));
        }
        let radius = (areas().sum::<f64>() / std::f64::consts::PI).sqrt();
        let numbers: Vec<f64> = ends
            .iter()
            .flatten()
            .map(|x| x / radius)
            .collect::<Vec<Vector<D>>>()
            .iter()
            .flat_map(|s| s.iter().copied())
            .collect();
        Ok((Self::of(part, &numbers), radius))
    }

    /// The surface of a part of the boundary with these s, as [`Self::numbers`] gives them.
    pub fn of(part: &Boundary, numbers: &[f64]) -> Self {
        let places: Vec<Vector<D>> = numbers.chunks_exact(D).map(Vector::from_column_slice).collect();
        let facets: Vec<[Vector<D>; 2]> = places.chunks_exact(2).map(|ends| [ends[0], ends[1]]).collect();
        let nearest = |[a, b]: &[Vector<D>; 2]| cross(b, a) / (b - a).norm();
        let inner = facets.iter().map(nearest).fold(f64::INFINITY, f64::min);
        let outer = places.iter().map(|s| s.norm()).fold(0.0, f64::max);
        let starts = part.facets.chunks_exact(D).zip(&facets);
        let nodes = starts.map(|(facet, ends)| (facet[0], ends[0])).collect();
        Self { nodes, facets, reach: [inner, outer] }
    }

    /// All s, facet by facet.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        self.facets.iter().flatten().flat_map(|s| s.iter().copied())
    }

    /// Nodes of the mesh on the surface, each once, with their s.
    pub fn nodes(&self) -> &[(u32, Vector<D>)] {
        &self.nodes
    }

    /// Largest distance of a node from the centre, in radii.
    pub fn reach(&self) -> f64 {
        self.reach[1]
    }

    /// Number of facets.
    pub fn facets(&self) -> usize {
        self.facets.len()
    }

    /// s at a place of a facet, from 0 at the first node to 1 at the second.
    pub fn shape(&self, facet: u32, at: f64) -> Vector<D> {
        let [a, b] = self.facets[facet as usize];
        a * (1.0 - at) + b * at
    }

    /// Unit normal of a facet into the droplet.
    pub fn normal(&self, facet: u32) -> Vector<D> {
        let [a, b] = self.facets[facet as usize];
        let along = (b - a).normalize();
        let mut normal = Vector::zeros();
        (normal[0], normal[1]) = (along[1], -along[0]);
        normal
    }

    /// The part of a disc of this radius (m) within the polygon of `size` (its radius, m), with the centre of the disc
    /// at `x` from that of the polygon; `None` where there is none.
    ///
    /// By Green's theorem the area is the sum over the facets of cross(p, q)/2 where they run inside the circle and
    /// R^2/2 times the angle where they run outside, both seen from the centre of the disc.
    pub fn cut(&self, size: f64, x: &Vector<D>, radius: f64) -> Option<Within> {
        let (distance, whole) = (x.norm(), std::f64::consts::PI * radius * radius);
        let [inner, outer] = self.reach.map(|reach| reach * size);
        if distance >= outer + radius {
            return None;
        }
        if distance + radius <= inner {
            return Some(Within { area: whole, chords: vec![] });
        }
        let mut within = Within::default();
        let outside = |p: &Vector<D>, q: &Vector<D>| radius * radius * cross(p, q).atan2(p.dot(q)) / 2.0;
        for (facet, ends) in (0..).zip(&self.facets) {
            // Anticlockwise around the centre of the polygon, against the order of the mesh.
            let [q, p] = ends.map(|s| s * size - x);
            let along = q - p;
            let (square, half) = (along.norm_squared(), p.dot(&along));
            let crossing = half * half - square * (p.norm_squared() - radius * radius);
            let root = crossing.max(0.0).sqrt();
            let (from, to) = (((-half - root) / square).max(0.0), ((-half + root) / square).min(1.0));
            if crossing <= 0.0 || from >= to {
                within.area += outside(&p, &q);
                continue;
            }
            let (enters, leaves) = (p + along * from, p + along * to);
            if from > 0.0 {
                within.area += outside(&p, &enters);
            }
            within.area += cross(&enters, &leaves) / 2.0;
            if to < 1.0 {
                within.area += outside(&leaves, &q);
            }
            let length = (to - from) * square.sqrt();
            within.chords.push(Chord { facet, length, at: 1.0 - (from + to) / 2.0 });
        }
        within.area = within.area.clamp(0.0, whole);
        (within.area > 0.0).then_some(within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use voidage_fluid::mesh::{Hole, Rectangle, Sides};

    fn surface() -> (Surface<2>, f64) {
        let hole = Hole { name: "droplet".into(), centre: [0.5, 0.4], radius: 0.2, size: 0.05, growth: 0.2 };
        let mesh = Mesh::rectangle(&Rectangle {
            lower: [0.0; 2],
            upper: [1.0; 2],
            size: Some(0.1),
            sides: Sides::all("wall"),
            holes: vec![hole],
            refine: vec![],
            structured: None,
        })
        .expect("a mesh");
        let part = mesh.boundary("droplet").expect("a hole");
        Surface::new(&mesh, part, &Vector::<2>::new(0.5, 0.4)).expect("a surface")
    }

    /// Against the area of the disc by strips, and the rate of the area by the chords against differences.
    #[test]
    fn discs_are_cut_as_by_strips_and_chords_are_the_rates_of_the_area() {
        let (surface, size) = surface();
        assert!((size - 0.2).abs() < 5e-3 && size < 0.2, "{size}");
        let inside = |p: Vector<2>| {
            (0..surface.facets() as u32)
                .all(|k| (p - surface.shape(k, 0.5) * size).dot(&surface.normal(k)) >= 0.0)
        };
        for (x, radius) in
            [([0.2, 0.0], 0.03), ([0.13, -0.14], 0.02), ([-0.05, 0.17], 0.1), ([0.0, 0.0], 0.3)]
        {
            let x = Vector::<2>::from(x);
            let area = |size: f64, x: Vector<2>| surface.cut(size, &x, radius).map_or(0.0, |w| w.area);
            let strips = 800;
            let count = (0..strips * strips).filter(|k| {
                let place = |k: usize| ((k as f64 + 0.5) / strips as f64 * 2.0 - 1.0) * radius;
                let p = Vector::<2>::new(place(k % strips), place(k / strips));
                p.norm() < radius && inside(x + p)
            });
            let sum = count.count() as f64 * (2.0 * radius / strips as f64).powi(2);
            assert!((area(size, x) / sum - 1.0).abs() < 1e-3, "{} and {sum}", area(size, x));

            let within = surface.cut(size, &x, radius).expect("a part");
            let rate = |of: &dyn Fn(&Chord) -> Vector<2>| -> f64 {
                within.chords.iter().map(|c| -c.length * of(c).dot(&surface.normal(c.facet))).sum()
            };
            let step = 1e-6;
            let grows = (area(size + step, x) - area(size - step, x)) / (2.0 * step);
            assert!((grows - rate(&|c| surface.shape(c.facet, c.at))).abs() < 1e-7, "{x} grows by {grows}");
            let aside = Vector::<2>::new(0.6, 0.8);
            let moves = (area(size, x - aside * step) - area(size, x + aside * step)) / (2.0 * step);
            assert!((moves - rate(&|_| aside)).abs() < 1e-7, "{x} moves by {moves}");
        }
        assert!(surface.cut(size, &Vector::<2>::new(0.3, 0.0), 0.05).is_none());
        let whole = surface.cut(size, &Vector::<2>::new(0.1, 0.0), 0.05).expect("wholly inside");
        assert_eq!((whole.area, whole.chords.len()), (std::f64::consts::PI * 0.05 * 0.05, 0));
    }
}
