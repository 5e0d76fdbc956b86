//! Nodal fields of two runs against each other, whatever their meshes.

use super::file::FieldName;
use std::collections::HashSet;
use std::path::Path;
use voidage_coupling::{Error, Result};
use voidage_fluid::Mesh;
use voidage_fluid::mesh::{Boundary, Locator, Periodic};
use voidage_scene::recorder::{Frame, read_frame};
use voidage_verification::models::Vec2;
use voidage_verification::norms::errors;

/// A nodal field on its mesh: a number, or a vector of the plane.
struct Field {
    mesh: Mesh<2>,
    locator: Locator<2>,
    values: Vec<[f64; 2]>,
}

impl Field {
    fn read(path: &Path, name: FieldName) -> Result<Self> {
        let column = match name {
            FieldName::Velocity => "velocity_m_per_s",
            FieldName::Pressure => "pressure_Pa",
            FieldName::Temperature => "temperature_K",
            FieldName::Voidage => "voidage",
        };
        let Frame { points, cells, columns } = read_frame(path)?;
        let found = columns.into_iter().find(|found| found.name == column);
        let Some(found) = found else {
            return Err(Error::run(format!("{}: has no column {column}", path.display())));
        };
        let points = points.iter().map(|point| Vec2::new(point[0], point[1])).collect();
        let mesh = Mesh { boundaries: vec![outline(&cells)], points, cells, periodic: Periodic::default() };
        let part = |value: &[f64]| [value[0], if value.len() > 1 { value[1] } else { 0.0 }];
        let values = found.values.chunks_exact(found.components).map(part).collect();
        Ok(Self { locator: Locator::new(&mesh)?, mesh, values })
    }

    /// The value at a point; outside of the mesh there is none.
    fn at(&self, x: Vec2) -> [f64; 2] {
        let Some(cell) = self.locator.locate(&self.mesh, &x, None) else { return [f64::NAN; 2] };
        let l = self.mesh.barycentric(cell as usize, &x);
        let share = [1.0 - l.sum(), l[0], l[1]];
        let nodes = &self.mesh.cells[3 * cell as usize..];
        [0, 1].map(|k| (0..3).map(|a| share[a] * self.values[nodes[a] as usize][k]).sum())
    }
}

/// The whole boundary of a mesh, which the file does not have: edges that no second cell has the other way round.
fn outline(cells: &[u32]) -> Boundary {
    let edges = || {
        let corners = cells.chunks_exact(3).enumerate();
        corners.flat_map(|(cell, c)| (0..3).map(move |k| (cell as u32, [c[k], c[(k + 1) % 3]])))
    };
    let all: HashSet<[u32; 2]> = edges().map(|(_, edge)| edge).collect();
    let mut boundary = Boundary { name: "outline".into(), facets: Vec::new(), cells: Vec::new() };
    for (cell, [a, b]) in edges().filter(|(_, [a, b])| !all.contains(&[*b, *a])) {
        boundary.facets.extend([a, b]);
        boundary.cells.push(cell);
    }
    boundary
}

/// L2 norm of the difference of a field from that of the reference, and the norm of the latter, by a rule of degree 5
/// on the mesh of the reference, which is the finer one.
///
/// # Errors
/// A file is missing or has no such field.
pub fn distance(file: &Path, reference: &Path, name: FieldName) -> Result<(f64, f64)> {
    let (field, known) = (Field::read(file, name)?, Field::read(reference, name)?);
    let values = |a: usize| known.values[a];
    let with = |value: [f64; 2]| value.map(|value| (value, Vec2::zeros()));
    let off = errors(&known.mesh, values, |x| with(field.at(x)));
    let size = errors(&known.mesh, values, |_| with([0.0; 2]));
    Ok((off.l2, size.l2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use voidage_scene::recorder::{Column, write_mesh};
    use voidage_verification::models::grid;

    /// T = x + 2 y on one mesh and x + 2 y + 3 on another: apart by 3 over the unit square.
    #[test]
    fn fields_on_different_meshes_are_compared() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, n: usize, more: f64| {
            let mesh = grid([1.0, 1.0], [n, n]).unwrap();
            let values: Vec<f64> = mesh.points.iter().map(|x| x.x + 2.0 * x.y + more).collect();
            let path = folder.path().join(name);
            write_mesh(&path, &mesh.points, &mesh.cells, &[Column::scalars("temperature_K", &values)])
                .unwrap();
            path
        };
        let (coarse, fine) = (write("coarse.vtu", 3, 3.0), write("fine.vtu", 7, 0.0));
        let (off, size) = distance(&coarse, &fine, FieldName::Temperature).unwrap();
        // int (x + 2 y)^2 = 1/3 + 1 + 4/3.
        assert!((off - 3.0).abs() < 1e-12 && (size - (8.0f64 / 3.0).sqrt()).abs() < 1e-12, "{off} {size}");
        assert!(distance(&coarse, &fine, FieldName::Pressure).is_err());
    }
}
