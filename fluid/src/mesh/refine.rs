//! Unstructured meshes: Delaunay refinement to a wanted size and shape, then smoothing.
//!
//! J. Ruppert, "A Delaunay refinement algorithm for quality 2-dimensional mesh generation", J. Algorithms 18 (1995):
//! a triangle that is too large or too thin gets its circumcentre as a new point; where that point would lie inside
//! the circle over a boundary edge (or beyond the edge), the edge is halved instead. New points of holes are put on
//! the circle. Worst triangles go first, which spreads points evenly. The triangulation itself is spade's.

use super::outline::{FREE, Outline, Site};
use super::shape::Shape;
use super::{Mesh, quality, smooth};
use crate::{Error, Result, Vector};
use spade::handles::{FixedDirectedEdgeHandle, FixedFaceHandle, FixedVertexHandle, InnerTag};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};
use std::collections::BinaryHeap;

type Face = FixedFaceHandle<InnerTag>;
type Points = Vec<Vector<2>>;

/// Angles below this are refined away, degrees. Ruppert's method ends for sure below 20.7 and in practice to 33.
const WANTED_ANGLE: f64 = 29.0;
/// Largest circumradius over wanted edge length. An equilateral triangle has 1/sqrt(3) = 0.577; insertion leaves
/// triangles of circumradius between half of the largest and the largest, and with this factor the mean edge is the
/// wanted one within 2 % (test `mean_edge_is_the_wanted_size`).
const CIRCUMRADIUS: f64 = 0.75;
/// Rounds of smoothing and new connection.
const ROUNDS: usize = 6;
/// More nodes than this are taken for a mistake in the sizes.
const MOST_NODES: usize = 20_000_000;

/// Points and anticlockwise triangles of a domain within its boundary.
pub(super) fn triangulate<S: Shape>(domain: &S, boundary: Outline) -> Result<(Points, Vec<u32>)> {
    let mut refiner = Refiner::new(domain, boundary)?;
    refiner.run()?;
    for _ in 0..ROUNDS {
        let mut outline = refiner.outline();
        let cells = refiner.cells();
        smooth::smooth(domain, &mut outline.sites, &cells);
        refiner = Refiner::new(domain, outline)?;
    }
    // Smoothing may leave a triangle a little too large or thin: mend it.
    refiner.run()?;
    let points = refiner.outline().sites.iter().map(|site| Vector::<2>::new(site.at.x, site.at.y)).collect();
    Ok(super::renumber::along_curve(points, refiner.cells()))
}

/// An error where a mesh has angles below [`Mesh::SMALLEST_ANGLE`].
pub(super) fn check_angles(points: &[Vector<2>], cells: &[u32]) -> Result<()> {
    let smallest = quality::smallest_angle(points, cells);
    if smallest >= Mesh::<2>::SMALLEST_ANGLE {
        return Ok(());
    }
    Err(Error::Mesh(format!(
        "the mesh has an angle of {smallest:.1} degrees, at least {} is wanted: sizes change too fast or gaps \
         between holes and sides are too narrow for the sizes given",
        Mesh::<2>::SMALLEST_ANGLE
    )))
}

struct Refiner<'a, S> {
    domain: &'a S,
    cdt: ConstrainedDelaunayTriangulation<Site>,
    bad: BinaryHeap<Bad>,
    /// Boundary edges that wait to be halved.
    edges: Vec<[FixedVertexHandle; 2]>,
}

/// A triangle to be refined; it may be gone when its turn comes.
#[derive(PartialEq)]
struct Bad {
    badness: f64,
    face: Face,
    nodes: [usize; 3],
}

impl Eq for Bad {}

impl Ord for Bad {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.badness.total_cmp(&other.badness).then_with(|| self.nodes.cmp(&other.nodes))
    }
}

impl PartialOrd for Bad {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// Twice the signed area of a triangle.
fn turn(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

fn distance2(a: Point2<f64>, b: Point2<f64>) -> f64 {
    (a.x - b.x).powi(2) + (a.y - b.y).powi(2)
}

/// Whether a point sees the edge under more than a right angle: it lies inside the circle over the edge.
fn encroaches(p: Point2<f64>, a: Point2<f64>, b: Point2<f64>) -> bool {
    (a.x - p.x) * (b.x - p.x) + (a.y - p.y) * (b.y - p.y) < 0.0
}

/// Centre of the circle through three points, and its radius squared.
fn circumcircle([a, b, c]: [Point2<f64>; 3]) -> (Point2<f64>, f64) {
    let (u, v) = ([b.x - a.x, b.y - a.y], [c.x - a.x, c.y - a.y]);
    let (u2, v2) = (u[0] * u[0] + u[1] * u[1], v[0] * v[0] + v[1] * v[1]);
    let d = 2.0 * (u[0] * v[1] - u[1] * v[0]);
    let (x, y) = ((u2 * v[1] - v2 * u[1]) / d, (v2 * u[0] - u2 * v[0]) / d);
    (Point2::new(a.x + x, a.y + y), x * x + y * y)
}

/// What stands in the way of a new point.
enum Place {
    Free(Face),
    Edges(Vec<[FixedVertexHandle; 2]>),
    Lost,
}

impl<'a, S: Shape> Refiner<'a, S> {
    fn new(domain: &'a S, outline: Outline) -> Result<Self> {
        let cdt = ConstrainedDelaunayTriangulation::bulk_load_cdt(outline.sites, outline.edges)
            .map_err(|error| Error::Mesh(format!("the domain cannot be triangulated: {error}")))?;
        Ok(Self { domain, cdt, bad: BinaryHeap::new(), edges: Vec::new() })
    }

    fn outline(&self) -> Outline {
        let sites = self.cdt.vertices().map(|v| v.data().clone()).collect();
        let constraints = self.cdt.undirected_edges().filter(|edge| edge.is_constraint_edge());
        Outline { sites, edges: constraints.map(|edge| edge.vertices().map(|v| v.index())).collect() }
    }

    fn cells(&self) -> Vec<u32> {
        let inside = self.cdt.inner_faces().filter(|face| self.in_domain(face.fix()));
        inside.flat_map(|face| face.vertices().map(|v| v.index() as u32)).collect()
    }

    fn in_domain(&self, face: Face) -> bool {
        self.domain.contains(self.cdt.face(face).vertices().each_ref().map(|node| node.data()))
    }

    fn run(&mut self) -> Result<()> {
        let all: Vec<Face> = self.cdt.fixed_inner_faces().collect();
        all.into_iter().for_each(|face| self.judge(face));
        loop {
            while let Some([a, b]) = self.edges.pop() {
                self.halve(a, b)?;
            }
            let Some(Bad { face, nodes, .. }) = self.bad.pop() else { return Ok(()) };
            if self.cdt.face(face).vertices().map(|v| v.index()) == nodes {
                self.refine(face)?;
            }
            if self.cdt.num_vertices() > MOST_NODES {
                return Err(Error::Mesh(format!("the sizes ask for more than {MOST_NODES} nodes")));
            }
        }
    }

    /// Queues a triangle that is too large or too thin, and its boundary edges that see a node too close.
    fn judge(&mut self, face: Face) {
        if !self.in_domain(face) {
            return;
        }
        let handle = self.cdt.face(face);
        let corners = handle.positions();
        for edge in handle.adjacent_edges() {
            let [a, b] = [edge.from(), edge.to()];
            let apex = edge.next().to().position();
            if S::DIVISIBLE
                && edge.as_undirected().is_constraint_edge()
                && encroaches(apex, a.position(), b.position())
            {
                self.edges.push([a.fix(), b.fix()]);
            }
        }
        let (_, radius2) = circumcircle(corners);
        let [a, b, c] = corners;
        let middle = [(a.x + b.x + c.x) / 3.0, (a.y + b.y + c.y) / 3.0];
        let large = radius2.sqrt() / (CIRCUMRADIUS * self.domain.size_at(middle));
        // Smallest angle theta: shortest edge = 2 R sin(theta).
        let shortest2 = distance2(a, b).min(distance2(b, c)).min(distance2(c, a));
        let thin = 2.0 * WANTED_ANGLE.to_radians().sin() * (radius2 / shortest2).sqrt();
        if large > 1.0 || thin > 1.0 {
            // Sizes first: most thin triangles go with them. Quotients of sizes stay far below 1e9.
            let badness = if large > 1.0 { 1e9 + large } else { thin };
            let nodes = handle.vertices().map(|v| v.index());
            self.bad.push(Bad { badness, face, nodes });
        }
    }

    fn refine(&mut self, face: Face) -> Result<()> {
        let (centre, _) = circumcircle(self.cdt.face(face).positions());
        match self.place(face, centre) {
            Place::Free(near) => {
                let hint = self.cdt.face(near).vertices()[0].fix();
                self.insert(Site { at: centre, hole: FREE }, hint).map(|_| ())
            }
            // Where the boundary stays as it is, so does the triangle.
            Place::Edges(_) if !S::DIVISIBLE => Ok(()),
            Place::Edges(edges) => {
                for [a, b] in edges {
                    self.halve(a, b)?;
                }
                // The triangle may still stand.
                self.judge(face);
                Ok(())
            }
            Place::Lost => Ok(()),
        }
    }

    /// Walks straight from a triangle to a point; there collects the boundary edges that the point would encroach.
    /// They bound the cavity: the connected triangles whose circumcircles contain the point.
    fn place(&self, start: Face, p: Point2<f64>) -> Place {
        let [a, b, c] = self.cdt.face(start).positions();
        let from = Point2::new((a.x + b.x + c.x) / 3.0, (a.y + b.y + c.y) / 3.0);
        let mut face = start;
        let mut entered: Option<FixedDirectedEdgeHandle> = None;
        loop {
            let exit = self.cdt.face(face).adjacent_edges().into_iter().find(|edge| {
                let (u, v) = (edge.from().position(), edge.to().position());
                Some(edge.fix()) != entered
                    && turn(u, v, p) < 0.0
                    && turn(from, p, u) <= 0.0
                    && turn(from, p, v) > 0.0
            });
            let Some(edge) = exit else { break };
            if edge.as_undirected().is_constraint_edge() {
                return Place::Edges(vec![[edge.from().fix(), edge.to().fix()]]);
            }
            let Some(next) = edge.rev().face().as_inner() else { return Place::Lost };
            entered = Some(edge.rev().fix());
            face = next.fix();
        }
        let mut cavity = vec![face];
        let mut edges = Vec::new();
        let mut i = 0;
        while i < cavity.len() {
            for edge in self.cdt.face(cavity[i]).adjacent_edges() {
                if edge.as_undirected().is_constraint_edge() {
                    if encroaches(p, edge.from().position(), edge.to().position()) {
                        edges.push([edge.from().fix(), edge.to().fix()]);
                    }
                } else if let Some(next) = edge.rev().face().as_inner() {
                    let (centre, radius2) = circumcircle(next.positions());
                    if distance2(centre, p) < radius2 && !cavity.contains(&next.fix()) {
                        cavity.push(next.fix());
                    }
                }
            }
            i += 1;
        }
        if edges.is_empty() { Place::Free(face) } else { Place::Edges(edges) }
    }

    /// Puts a node in the middle of a boundary edge, on the circle if the edge belongs to a hole.
    fn halve(&mut self, a: FixedVertexHandle, b: FixedVertexHandle) -> Result<()> {
        let Some(edge) = self.cdt.get_edge_from_neighbors(a, b) else { return Ok(()) };
        if !edge.as_undirected().is_constraint_edge() {
            return Ok(());
        }
        let edge = edge.as_undirected().fix();
        let (p, q) = (self.cdt.vertex(a).data().clone(), self.cdt.vertex(b).data().clone());
        let middle = Point2::new(0.5 * (p.at.x + q.at.x), 0.5 * (p.at.y + q.at.y));
        if distance2(p.at, q.at).sqrt() < 1e-6 * self.domain.smallest_size() {
            return Err(Error::Mesh(format!(
                "no mesh near ({}, {}): a gap is too narrow for the sizes given",
                middle.x, middle.y
            )));
        }
        if p.hole == FREE {
            return self.insert(Site { at: middle, hole: FREE }, a).map(|_| ());
        }
        let at = self.domain.onto_hole(p.hole, middle);
        self.cdt.remove_constraint_edge(edge);
        let new = self.insert(Site { at, hole: p.hole }, a)?;
        for end in [a, b] {
            if !self.cdt.can_add_constraint(end, new) {
                return Err(Error::Mesh(
                    "a hole lies too close to another boundary for the sizes given".into(),
                ));
            }
            self.cdt.add_constraint(end, new);
        }
        self.judge_around(new);
        Ok(())
    }

    fn insert(&mut self, site: Site, hint: FixedVertexHandle) -> Result<FixedVertexHandle> {
        let at = site.at;
        let new = self.cdt.insert_with_hint(site, hint).map_err(|error| {
            Error::Mesh(format!("no node can be placed at ({}, {}): {error}", at.x, at.y))
        })?;
        self.judge_around(new);
        Ok(new)
    }

    fn judge_around(&mut self, node: FixedVertexHandle) {
        let around = self.cdt.vertex(node).out_edges().filter_map(|edge| edge.face().as_inner());
        let faces: Vec<Face> = around.map(|face| face.fix()).collect();
        faces.into_iter().for_each(|face| self.judge(face));
    }
}
