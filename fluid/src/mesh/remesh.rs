//! A new mesh of a domain whose nodes have moved: those of the boundary stay where they are, those inside get new
//! places.

use super::outline::{FREE, Outline, Site};
use super::shape::Shape;
use super::{Boundary, Locator, Mesh, refine};
use crate::{Error, Result, Vector};
use spade::Point2;
use std::collections::HashMap;
use std::ops::{Add, Mul};

/// A new mesh, and where its nodes lie in the old one.
pub struct Remeshed<const D: usize> {
    /// The mesh.
    pub mesh: Mesh<D>,
    /// For each node the nodes of the old cell that it lies in, and their shape functions: `D + 1` numbers each.
    nodes: Vec<u32>,
    shape: Vec<f64>,
}

impl<const D: usize> Remeshed<D> {
    /// Nodal values of the old mesh, interpolated at the nodes of the new one.
    pub fn carry<T: Copy + Mul<f64, Output = T> + Add<Output = T>>(&self, old: &[T]) -> Vec<T> {
        let places = self.nodes.chunks_exact(D + 1).zip(self.shape.chunks_exact(D + 1));
        let value = |(nodes, shape): (&[u32], &[f64])| {
            let parts = nodes.iter().zip(shape).map(|(node, share)| old[*node as usize] * *share);
            parts.reduce(|sum, part| sum + part)
        };
        places.filter_map(value).collect()
    }
}

impl Mesh<2> {
    /// Mean length of the edges at each node, m.
    pub fn spacing(&self) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.points.len()];
        for nodes in self.cells.chunks_exact(3) {
            for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|ends| ends.map(|k| nodes[k] as usize)) {
                let length = (self.points[b] - self.points[a]).norm();
                for node in [a, b] {
                    sums[node] = (sums[node].0 + length, sums[node].1 + 1.0);
                }
            }
        }
        sums.into_iter().map(|(length, count)| length / count).collect()
    }

    /// A mesh of the same domain with edges of the lengths `spacing` (m, one per node of this mesh). Nodes and facets
    /// of the boundary stay, with their names.
    ///
    /// # Errors
    /// The boundary crosses itself, or is folded so that no cells of positive measure fill it.
    pub fn remesh(&self, spacing: &[f64]) -> Result<Remeshed<2>> {
        self.fill(spacing, None)
    }

    /// The same with the hole filled that a part of the boundary is. Values in it are those of the nearest node of its
    /// boundary.
    ///
    /// # Errors
    /// Those of [`Self::remesh`].
    pub fn fill(&self, spacing: &[f64], hole: Option<&str>) -> Result<Remeshed<2>> {
        let domain = Between::new(self, spacing, hole)?;
        let (points, cells) = refine::triangulate(&domain, domain.outline())?;
        let old = domain.numbers();
        let node_at = |point: &Vector<2>| old.get(&bits(point)).copied();
        let numbers: Vec<Option<u32>> = points.iter().map(node_at).collect();
        let names: Vec<String> = domain.boundaries().map(|part| part.name.clone()).collect();
        let parts = domain.parts();
        let mesh = Mesh::with_boundaries(points, cells, &names, |nodes| {
            let [a, b] = [nodes[0], nodes[1]].map(|node| numbers[node as usize]);
            let part = a.zip(b).and_then(|(a, b)| parts.get(&[a.min(b), a.max(b)]));
            part.copied().ok_or_else(|| Error::Mesh("the boundary of the mesh crosses itself".into()))
        })?;
        let (mut nodes, mut shape) = (Vec::new(), Vec::new());
        for (point, number) in mesh.points.iter().zip(&numbers) {
            let (of, share) = match number {
                Some(node) => ([*node; 3], [1.0, 0.0, 0.0]),
                None => domain.place(point)?,
            };
            nodes.extend(of);
            shape.extend(share);
        }
        Ok(Remeshed { mesh, nodes, shape })
    }
}

/// A point as a key: the nodes of the boundary keep their places to the bit.
fn bits(point: &Vector<2>) -> [u64; 2] {
    [point[0].to_bits(), point[1].to_bits()]
}

/// What lies between the boundaries of a mesh.
struct Between<'a> {
    mesh: &'a Mesh<2>,
    spacing: &'a [f64],
    locator: Locator<2>,
    /// The part of the boundary that is no more.
    filled: Option<&'a str>,
}

impl<'a> Between<'a> {
    fn new(mesh: &'a Mesh<2>, spacing: &'a [f64], filled: Option<&'a str>) -> Result<Self> {
        Ok(Self { mesh, spacing, locator: Locator::new(mesh)?, filled })
    }

    /// Parts of the boundary that stay.
    fn boundaries(&self) -> impl Iterator<Item = &'a Boundary> {
        self.mesh.boundaries.iter().filter(|part| Some(part.name.as_str()) != self.filled)
    }

    /// Facets of the boundary with the number of their part.
    fn facets(&self) -> impl Iterator<Item = ([u32; 2], usize)> {
        let parts = self.boundaries().enumerate();
        parts.flat_map(|(k, part)| part.facets.as_chunks::<2>().0.iter().map(move |facet| (*facet, k)))
    }

    fn outline(&self) -> Outline {
        let mut place = HashMap::new();
        let mut outline = Outline { sites: Vec::new(), edges: Vec::new() };
        for (facet, _) in self.facets() {
            let edge = facet.map(|node| {
                *place.entry(node).or_insert_with(|| {
                    let point = self.mesh.points[node as usize];
                    outline.sites.push(Site { at: Point2::new(point[0], point[1]), hole: 0 });
                    outline.sites.len() - 1
                })
            });
            outline.edges.push(edge);
        }
        outline
    }

    /// The nodes of the boundary by their place.
    fn numbers(&self) -> HashMap<[u64; 2], u32> {
        let nodes = self.facets().flat_map(|(facet, _)| facet);
        nodes.map(|node| (bits(&self.mesh.points[node as usize]), node)).collect()
    }

    /// The part of the boundary by the nodes of a facet, in ascending order.
    fn parts(&self) -> HashMap<[u32; 2], usize> {
        self.facets().map(|([a, b], part)| ([a.min(b), a.max(b)], part)).collect()
    }

    /// The nodes of the cell that a point lies in, and their shape functions.
    fn place(&self, point: &Vector<2>) -> Result<([u32; 3], [f64; 3])> {
        let Some(cell) = self.locator.locate(self.mesh, point, None) else {
            let rim = self.mesh.boundaries.iter().filter(|part| Some(part.name.as_str()) == self.filled);
            let distance = |node: &u32| (self.mesh.points[*node as usize] - point).norm_squared();
            let nearest =
                rim.flat_map(|part| &part.facets).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let text = || format!("a new node at ({}, {}) lies outside of the mesh", point[0], point[1]);
            return nearest.map(|node| ([*node; 3], [1.0, 0.0, 0.0])).ok_or_else(|| Error::Mesh(text()));
        };
        let cell = cell as usize;
        let shape = self.mesh.barycentric(cell, point);
        let nodes = self.mesh.cell(cell);
        Ok(([nodes[0], nodes[1], nodes[2]], [1.0 - shape.sum(), shape[0], shape[1]]))
    }
}

impl Shape for Between<'_> {
    const DIVISIBLE: bool = false;

    fn size_at(&self, p: [f64; 2]) -> f64 {
        let place = self.place(&Vector::<2>::from(p));
        place.map_or(f64::INFINITY, |(nodes, shape)| {
            (0..3).map(|k| self.spacing[nodes[k] as usize] * shape[k]).sum()
        })
    }

    fn smallest_size(&self) -> f64 {
        self.spacing.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Boundaries are edges of triangles, so one with a node inside belongs to the domain; of the others those whose
    /// middle a ray from outside reaches through an odd number of facets.
    fn contains(&self, corners: [&Site; 3]) -> bool {
        if corners.iter().any(|site| site.hole == FREE) {
            return true;
        }
        let [x, y] = [|site: &Site| site.at.x, |site: &Site| site.at.y]
            .map(|of| corners.iter().map(|site| of(site)).sum::<f64>() / 3.0);
        let crosses = |([a, b], _): &([u32; 2], usize)| {
            let [a, b] = [a, b].map(|node| self.mesh.points[*node as usize]);
            (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        };
        self.facets().filter(crosses).count() % 2 == 1
    }

    fn on_side(&self, _: Point2<f64>) -> bool {
        false
    }

    fn onto_hole(&self, _: u32, middle: Point2<f64>) -> Point2<f64> {
        middle
    }
}
