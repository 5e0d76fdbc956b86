//! Fields that are as smooth as what is held at some nodes allows: how far the nodes of a mesh follow its boundary.

use crate::assembly::{Assembler, System};
use crate::geometry::Geometry;
use crate::linear::{Options, Solver};
use crate::{Mesh, Result};

/// The solution of -lap b = `source` (1/m2) with b = `held(node)` where there is such a value and no flux through the
/// rest of the boundary; `B` is `D + 1`.
///
/// # Errors
/// Flat cells, nothing that is held.
pub fn harmonic<const D: usize, const B: usize>(
    mesh: &Mesh<D>,
    source: f64,
    held: impl Fn(usize) -> Option<f64>,
) -> Result<Vec<f64>> {
    let geometry = Geometry::<D, B>::new(mesh.clone())?;
    let assembler = Assembler::new::<B>(mesh.points.len(), &mesh.cells);
    let mut system = System::<1>::new(assembler.pattern.clone());
    assembler.assemble::<B, 1>(&mut system, |cell, out| {
        let element = &geometry.elements[cell];
        for a in 0..B {
            out.rhs[a][0] = source * element.measure / B as f64;
            for b in 0..B {
                out.matrix[a][b][0][0] = element.measure * element.gradient[a].dot(&element.gradient[b]);
            }
        }
    });
    for node in 0..mesh.points.len() {
        if let Some(value) = held(node) {
            system.prescribe(node, 0, value);
        }
    }
    let mut field = vec![0.0; mesh.points.len()];
    let options = Options { tolerance: 1e-12, ..Options::default() };
    let mut solver = Solver::<1>::new(assembler.pattern.clone(), &mesh.points, options);
    solver.solve(&system.matrix, &system.rhs, &mut field)?;
    // What is held is held exactly: walls that stand must not creep by the residual.
    for (node, value) in field.iter_mut().enumerate() {
        *value = held(node).unwrap_or(*value);
    }
    Ok(field)
}
