//! Meshes of a described domain.

use super::domain::{Diagonals, Rectangle, Structured};
use super::{Mesh, outline, refine};
use crate::{Error, Result, Vector};

impl Mesh<2> {
    /// A mesh of a rectangle with holes. The same description gives the same mesh, bit by bit.
    ///
    /// Unstructured meshes are Delaunay with no angle below [`Mesh::SMALLEST_ANGLE`]; corners, ends of parts and
    /// hole circles carry nodes.
    pub fn rectangle(domain: &Rectangle) -> Result<Self> {
        domain.validate()?;
        let (points, cells) = match &domain.structured {
            Some(grid) => structured(domain, grid),
            None => {
                let (points, cells) = refine::triangulate(domain, outline::divide(domain)?)?;
                refine::check_angles(&points, &cells)?;
                (points, cells)
            }
        };
        let mut names: Vec<String> = Vec::new();
        let sides = domain.named_sides();
        let side_names = sides.iter().flat_map(|(_, side, _)| side.0.iter().map(|part| &part.name));
        for name in side_names.chain(domain.holes.iter().map(|hole| &hole.name)) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        let positions = points.clone();
        Mesh::with_boundaries(points, cells, &names, |nodes| {
            let name = name_of(domain, positions[nodes[0] as usize], positions[nodes[1] as usize]);
            names.iter().position(|other| other == name).ok_or_else(|| Error::Mesh("nameless edge".into()))
        })
    }
}

/// The name of the boundary edge between two points: of the side on which both lie (coordinates on sides are exact),
/// otherwise of the hole whose circle is nearest.
fn name_of(domain: &Rectangle, a: Vector<2>, b: Vector<2>) -> &str {
    let at = [domain.lower[0], domain.upper[0], domain.lower[1], domain.upper[1]];
    for (i, (_, side, along)) in domain.named_sides().into_iter().enumerate() {
        let across = 1 - along;
        if a[across] == at[i] && b[across] == at[i] {
            let middle = 0.5 * (a[along] + b[along]);
            let parts = &side.0;
            let part = parts.iter().find(|part| part.to.is_some_and(|to| middle < to)).or(parts.last());
            return part.map_or("", |part| &part.name);
        }
    }
    let gap = |i: usize| {
        let hole = &domain.holes[i];
        ((a[0] - hole.centre[0]).hypot(a[1] - hole.centre[1]) - hole.radius).abs()
    };
    let nearest = (0..domain.holes.len()).min_by(|&i, &j| gap(i).total_cmp(&gap(j)));
    nearest.map_or("", |i| &domain.holes[i].name)
}

/// A grid of squares, each cut by a diagonal. Ends of parts that fall between grid lines take the nearest edge.
fn structured(domain: &Rectangle, grid: &Structured) -> (Vec<Vector<2>>, Vec<u32>) {
    let [nx, ny] = grid.squares;
    let coordinate = |axis: usize, i: usize, n: usize| {
        let (a, b) = (domain.lower[axis], domain.upper[axis]);
        // The last line is exactly the side: names of edges are found by comparing coordinates.
        if i == n { b } else { a + (b - a) * (i as f64 / n as f64) }
    };
    let mut points = Vec::with_capacity((nx + 1) * (ny + 1));
    for j in 0..=ny {
        points.extend((0..=nx).map(|i| Vector::<2>::new(coordinate(0, i, nx), coordinate(1, j, ny))));
    }
    let mut cells = Vec::with_capacity(6 * nx * ny);
    for j in 0..ny {
        for i in 0..nx {
            let a = (j * (nx + 1) + i) as u32;
            let (b, d) = (a + 1, a + nx as u32 + 1);
            let c = d + 1;
            let rising = match grid.diagonals {
                Diagonals::Rising => true,
                Diagonals::Falling => false,
                Diagonals::Alternating => (i + j) % 2 == 0,
            };
            cells.extend(if rising { [a, b, c, a, c, d] } else { [a, b, d, b, c, d] });
        }
    }
    (points, cells)
}
