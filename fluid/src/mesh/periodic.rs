//! Periodic sides: two opposite straight sides of a mesh that are one.
//!
//! Both keep their nodes, so that every cell has its true place; of the nodes that are one the first is the master, and
//! the others, its images, have its values. The unknowns belong to masters; the images have none.

use super::Mesh;
use crate::{Error, Result, Vector};
use serde::{Deserialize, Serialize};

/// Which nodes of a mesh are one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Periodic<const D: usize> {
    /// Length of the period along each axis, m; 0 where the mesh is not periodic.
    period: Vector<D>,
    /// Images with their masters, in the order of the images.
    images: Vec<[u32; 2]>,
    /// The master of every node; empty without periodic sides.
    master: Vec<u32>,
}

impl<const D: usize> Default for Periodic<D> {
    /// No periodic sides.
    fn default() -> Self {
        Self { period: Vector::zeros(), images: vec![], master: vec![] }
    }
}

impl<const D: usize> Periodic<D> {
    /// Periodic sides with these lengths of the period along each axis (m; 0 for none), and the master of every node.
    ///
    /// # Errors
    /// Lengths that are negative or not finite, a master that is not the first of its images.
    pub fn new(period: Vector<D>, master: Vec<u32>) -> Result<Self> {
        let good = period.iter().all(|length| length.is_finite() && *length >= 0.0);
        let first = |(node, master_of): (usize, &u32)| {
            *master_of as usize <= node && master[*master_of as usize] == *master_of
        };
        if !good || !master.iter().enumerate().all(first) {
            return Err(Error::Mesh(format!(
                "nodes that are one over the periods {:?} have no first",
                period.as_slice()
            )));
        }
        let images =
            (0..).zip(&master).filter(|(node, of)| node != *of).map(|(node, of)| [node, *of]).collect();
        Ok(Self { period, images, master })
    }

    /// Whether there are none.
    pub fn is_none(&self) -> bool {
        self.images.is_empty()
    }

    /// Length of the period along each axis, m; 0 where the mesh is not periodic.
    pub fn period(&self) -> &Vector<D> {
        &self.period
    }

    /// Images with their masters.
    pub fn images(&self) -> &[[u32; 2]] {
        &self.images
    }

    /// The node whose values a node has.
    #[inline]
    pub fn master(&self, node: u32) -> u32 {
        self.master.get(node as usize).copied().unwrap_or(node)
    }

    /// Adds what belongs to images to their masters, and leaves nothing at the images.
    pub fn gather(&self, values: &mut [f64]) {
        for [image, master] in &self.images {
            values[*master as usize] += std::mem::take(&mut values[*image as usize]);
        }
    }

    /// Gives the images the values of their masters.
    pub fn mirror<T: Copy>(&self, values: &mut [T]) {
        for [image, master] in &self.images {
            values[*image as usize] = values[*master as usize];
        }
    }

    /// How far a place is to be moved, by whole periods, to be nearest to another one, which is `away` from it.
    #[inline]
    pub fn shift(&self, away: &Vector<D>) -> Vector<D> {
        if self.is_none() {
            return Vector::zeros();
        }
        Vector::from_fn(|axis, _| {
            let length = self.period[axis];
            if length > 0.0 { length * (away[axis] / length).round() } else { 0.0 }
        })
    }
}

/// Largest distance of nodes that count as one, over the length of the period.
const ALIKE: f64 = 1e-7;
/// A cell is shorter than this share of the period.
const LONGEST_CELL: f64 = 0.45;

impl<const D: usize> Mesh<D> {
    /// Makes the lower and the upper side along some axes one. What boundary there was is gone. Nodes of the upper side
    /// are moved to where the images of those of the lower one are, by less than round-off of a file.
    ///
    /// # Errors
    /// A side that is not one straight line, or nodes that have no image; a part of the boundary that is on a side and
    /// elsewhere; cells that are too long for the period.
    pub fn join_sides(&mut self, axes: [bool; D]) -> Result<()> {
        if D != 2 {
            return Err(Error::Mesh("a mesh can be periodic in the plane only".into()));
        }
        let mut master: Vec<u32> = (0..self.points.len() as u32).collect();
        let mut period = Vector::zeros();
        let (lower, upper) = self.bounds();
        for axis in (0..D).filter(|axis| axes[*axis]) {
            period[axis] = upper[axis] - lower[axis];
            self.join_along(axis, [lower[axis], upper[axis]], &mut master)?;
        }
        // Masters come first, so that each finds the end of its chain there.
        (0..master.len()).for_each(|node| master[node] = master[master[node] as usize]);
        self.boundaries.retain(|part| !part.cells.is_empty());
        self.periodic = Periodic::new(period, master)?;
        self.check()
    }

    fn join_along(&mut self, axis: usize, sides: [f64; 2], master: &mut [u32]) -> Result<()> {
        let (other, length) = (1 - axis, sides[1] - sides[0]);
        let wrong =
            |text: String| Err(Error::Mesh(format!("the sides at {} and {} m: {text}", sides[0], sides[1])));
        let on = |points: &[Vector<D>], node: u32, side: usize| {
            (points[node as usize][axis] - sides[side]).abs() <= ALIKE * length
        };
        for cell in 0..self.cell_count() {
            let places = self.cell(cell).iter().map(|node| self.points[*node as usize][axis]);
            let [low, high] = places.fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(x), high.max(x)]);
            if high - low > LONGEST_CELL * length {
                return wrong(format!(
                    "cell {cell} is {} m long: three cells at least must lie between them",
                    high - low
                ));
            }
        }
        let nodes = [0, 1].map(|side| {
            let mut nodes: Vec<u32> =
                (0..self.points.len() as u32).filter(|node| on(&self.points, *node, side)).collect();
            let height = |node: &u32| self.points[*node as usize][other];
            nodes.sort_by(|a, b| height(a).total_cmp(&height(b)));
            nodes
        });
        let [count, images] = [0, 1].map(|side| nodes[side].len());
        if count != images {
            return wrong(format!("one has {count} nodes and the other {images}: each node needs an image"));
        }
        let mut facets = [0; 2];
        for part in &mut self.boundaries {
            let side_of =
                |facet: &[u32]| (0..2).find(|side| facet.iter().all(|node| on(&self.points, *node, *side)));
            let sides: Vec<usize> = part.facets.chunks_exact(D).filter_map(side_of).collect();
            if sides.is_empty() {
                continue;
            }
            if sides.len() < part.cells.len() {
                return wrong(format!(
                    "the boundary \"{}\" lies there and elsewhere; give the periodic sides names of their own",
                    part.name
                ));
            }
            sides.iter().for_each(|side| facets[*side] += 1);
            (part.facets, part.cells) = (vec![], vec![]);
        }
        if facets != [count - 1; 2] {
            return wrong("each must be one straight line, from one end of the mesh to the other".into());
        }
        for (&first, &second) in nodes[0].iter().zip(&nodes[1]) {
            let mut image = self.points[first as usize];
            image[axis] = sides[1];
            let apart = (image - self.points[second as usize]).norm();
            if apart > ALIKE * length {
                let place = self.points[first as usize];
                return wrong(format!(
                    "the node at {:?} has no image: the nearest is {apart:.3e} m away",
                    place.as_slice()
                ));
            }
            self.points[first as usize][axis] = sides[0];
            self.points[second as usize] = image;
            // Corners may be one with others already.
            let [a, b] = [first, second].map(|node| root(master, node));
            master[a.max(b) as usize] = a.min(b);
        }
        Ok(())
    }
}

/// The first of the nodes that a node is one with so far.
fn root(master: &[u32], mut node: u32) -> u32 {
    while master[node as usize] != node {
        node = master[node as usize];
    }
    node
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Diagonals, Rectangle, Side, Sides, Structured};

    fn sided(squares: [usize; 2]) -> Rectangle {
        let side = Side::named;
        Rectangle {
            lower: [1.0, 0.0],
            upper: [3.0, 1.0],
            size: None,
            structured: Some(Structured { squares, diagonals: Diagonals::default() }),
            sides: Sides {
                left: side("left"),
                right: side("right"),
                bottom: side("bottom"),
                top: side("top"),
            },
            holes: vec![],
            refine: vec![],
        }
    }

    #[test]
    fn both_sides_are_one_and_no_boundary() {
        let mut mesh = Mesh::rectangle(&sided([6, 3])).unwrap();
        mesh.join_sides([true, false]).unwrap();
        let names: Vec<_> = mesh.boundaries.iter().map(|part| part.name.as_str()).collect();
        assert_eq!(names, ["bottom", "top"]);
        assert_eq!(mesh.periodic.images().len(), 4);
        for [image, master] in mesh.periodic.images() {
            let way = mesh.points[*image as usize] - mesh.points[*master as usize];
            assert!((way.x.abs() - 2.0).abs() < 1e-15 && way.y == 0.0 && image > master, "{way:?}");
        }
        let volume = mesh.nodal_volume();
        assert!((volume.iter().sum::<f64>() - 2.0).abs() < 1e-14);
        // Every facet at the sides has a cell across.
        let outside = mesh.neighbours().unwrap().across.iter().filter(|cell| **cell == u32::MAX).count();
        assert_eq!(outside, 12);
    }

    #[test]
    fn corners_of_a_mesh_that_is_periodic_along_both_axes_are_one_node() {
        let mut mesh = Mesh::rectangle(&sided([6, 3])).unwrap();
        mesh.join_sides([true, true]).unwrap();
        assert!(mesh.boundaries.is_empty());
        assert_eq!(mesh.points.len() - mesh.periodic.images().len(), 18);
        assert!(mesh.neighbours().unwrap().across.iter().all(|cell| *cell != u32::MAX));
    }

    #[test]
    fn sides_that_do_not_fit_are_refused() {
        let said = |rectangle: &Rectangle| {
            let joined = Mesh::<2>::rectangle(rectangle).and_then(|mut mesh| mesh.join_sides([true, false]));
            joined.unwrap_err().to_string()
        };
        assert!(said(&sided([2, 3])).contains("three cells"), "{}", said(&sided([2, 3])));
        let mut walls = sided([6, 3]);
        (walls.sides.left, walls.sides.top) = (walls.sides.right.clone(), walls.sides.right.clone());
        assert!(said(&walls).contains("names of their own"), "{}", said(&walls));
        let mut mesh = Mesh::rectangle(&sided([6, 3])).unwrap();
        let (_, upper) = mesh.bounds();
        let node = mesh.points.iter().position(|x| x.x == upper.x && x.y > 0.0 && x.y < 1.0).unwrap();
        mesh.points[node].y += 1e-3;
        let said = mesh.join_sides([true, false]).unwrap_err().to_string();
        assert!(said.contains("no image"), "{said}");
    }
}
