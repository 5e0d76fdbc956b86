//! Boundary integrals of the weak forms and the conditions that replace equations.

use crate::assembly::System;
use crate::conditions::{Condition, FlowCondition, HeatCondition, Hold, facets};
use crate::element::{facet_normal, facet_rule};
use crate::{Error, Mesh, Result, Vector};

/// Geometry and rule of one facet.
struct Facet<'a, const D: usize> {
    nodes: &'a [u32],
    measure: f64,
    normal: Vector<D>,
}

impl<'a, const D: usize> Facet<'a, D> {
    fn new(mesh: &Mesh<D>, nodes: &'a [u32]) -> Self {
        let corner: [Vector<D>; D] = std::array::from_fn(|k| mesh.points[nodes[k] as usize]);
        let (measure, normal) = facet_normal(&corner);
        Self { nodes, measure, normal }
    }

    /// Calls `f(a, b, integral of w phi_a phi_b)` for all pairs of nodes, w given at the quadrature points
    /// by the shape functions there.
    fn mass(&self, weight: impl Fn(&[f64; 3]) -> f64, mut f: impl FnMut(u32, u32, f64)) {
        for a in 0..D {
            for b in 0..D {
                let sum: f64 =
                    facet_rule::<D>().iter().map(|(phi, share)| share * phi[a] * phi[b] * weight(phi)).sum();
                f(self.nodes[a], self.nodes[b], self.measure * sum);
            }
        }
    }

    /// Value at a quadrature point of a nodal quantity.
    fn at(&self, phi: &[f64; 3], value: impl Fn(usize) -> f64) -> f64 {
        (0..D).map(|a| phi[a] * value(self.nodes[a] as usize)).sum()
    }
}

/// Adds to the flow equations, on every facet, <<eps u . n, q>>, and on open ones
/// <<p_out n, v>> - <<eps rho min(u_n . n, 0) u, v>>.
pub fn add_flow<const D: usize, const B: usize>(
    mesh: &Mesh<D>,
    conditions: &[Condition<D>],
    density: f64,
    voidage: &[f64],
    velocity: &[Vector<D>],
    system: &mut System<B>,
) {
    for condition in conditions {
        for nodes in facets(mesh, &condition.boundary) {
            let facet = Facet::new(mesh, nodes);
            facet.mass(
                |phi| facet.at(phi, |node| voidage[node]),
                |row, column, integral| {
                    if let Some(block) = system.block(row, column) {
                        for j in 0..D {
                            block[D][j] += integral * facet.normal[j];
                        }
                    }
                },
            );
            if let FlowCondition::Open { pressure } = condition.flow {
                add_open(&facet, pressure, density, voidage, velocity, system);
            }
        }
    }
}

fn add_open<const D: usize, const B: usize>(
    facet: &Facet<'_, D>,
    pressure: f64,
    density: f64,
    voidage: &[f64],
    velocity: &[Vector<D>],
    system: &mut System<B>,
) {
    for &node in facet.nodes {
        for i in 0..D {
            system.rhs[B * node as usize + i] -= pressure * facet.normal[i] * facet.measure / D as f64;
        }
    }
    let inflow = |phi: &[f64; 3]| {
        let through = facet.at(phi, |node| velocity[node].dot(&facet.normal));
        -density * through.min(0.0) * facet.at(phi, |node| voidage[node])
    };
    facet.mass(inflow, |row, column, integral| {
        if let Some(block) = system.block(row, column) {
            for (i, line) in block.iter_mut().enumerate().take(D) {
                line[i] += integral;
            }
        }
    });
}

/// Puts the velocity conditions into the momentum equations: rows of fixed nodes become u = value; where only
/// normals n are held, the rows are projected on the tangents and n n^T u = 0 is added.
pub fn apply_holds<const D: usize, const B: usize>(holds: &[Option<Hold<D>>], system: &mut System<B>) {
    for (node, hold) in holds.iter().enumerate() {
        match hold {
            None => {}
            Some(Hold::Fixed(value)) => (0..D).for_each(|i| system.prescribe(node, i, value[i])),
            Some(Hold::Normal(normals)) => hold_normals(normals, node, system),
        }
    }
}

fn hold_normals<const D: usize, const B: usize>(normals: &[Vector<D>], node: usize, system: &mut System<B>) {
    let (row, diagonal) = system.row(node);
    let Some(diagonal) = diagonal else { return };
    let scale = (0..D).map(|i| row[diagonal][i][i].abs()).fold(f64::MIN_POSITIVE, f64::max);
    for normal in normals {
        for block in row.iter_mut() {
            for j in 0..B {
                let along: f64 = (0..D).map(|i| normal[i] * block[i][j]).sum();
                (0..D).for_each(|i| block[i][j] -= normal[i] * along);
            }
        }
    }
    for normal in normals {
        for i in 0..D {
            for j in 0..D {
                row[diagonal][i][j] += scale * normal[i] * normal[j];
            }
        }
    }
    let rhs = &mut system.rhs[B * node..B * node + D];
    for normal in normals {
        let along: f64 = (0..D).map(|i| normal[i] * rhs[i]).sum();
        (0..D).for_each(|i| rhs[i] -= normal[i] * along);
    }
}

/// In a closed domain nothing sets the level of the pressure and the fluxes prescribed must balance: holds the
/// pressure of the first node (the caller moves the mean to zero) or tells that they do not.
pub fn close<const D: usize, const B: usize>(
    mesh: &Mesh<D>,
    holds: &[Option<Hold<D>>],
    voidage: &[f64],
    system: &mut System<B>,
) -> Result<()> {
    let (mut net, mut gross) = (0.0, 0.0);
    for part in &mesh.boundaries {
        for nodes in part.facets.chunks_exact(D) {
            let facet = Facet::new(mesh, nodes);
            let through = |node: usize| match &holds[node] {
                Some(Hold::Fixed(u)) => u.dot(&facet.normal),
                _ => 0.0,
            };
            facet.mass(
                |phi| facet.at(phi, |node| voidage[node]),
                |_, column, integral| {
                    net += integral * through(column as usize);
                    gross += (integral * through(column as usize)).abs();
                },
            );
        }
    }
    if net.abs() > 1e-9 * gross.max(f64::MIN_POSITIVE) {
        return Err(Error::Mesh(format!(
            "no boundary is open, but the prescribed velocities let {net:.3e} more fluid out than in; open one"
        )));
    }
    system.prescribe(0, D, 0.0);
    Ok(())
}

/// Adds to the energy equation Newton cooling, <<h_w T, v>> = <<h_w T_w, v>>, and the inflow term of open
/// boundaries, -<<eps rho c min(u . n, 0) (T - T_out), v>>.
pub fn add_heat<const D: usize>(
    mesh: &Mesh<D>,
    conditions: &[Condition<D>],
    capacity: f64,
    voidage: &[f64],
    velocity: &[Vector<D>],
    system: &mut System<1>,
) {
    for condition in conditions {
        for nodes in facets(mesh, &condition.boundary) {
            let facet = Facet::new(mesh, nodes);
            let mut add = |outside: f64, weight: &dyn Fn(&[f64; 3]) -> f64| {
                facet.mass(weight, |row, column, integral| {
                    system.rhs[row as usize] += integral * outside;
                    if let Some(block) = system.block(row, column) {
                        block[0][0] += integral;
                    }
                });
            };
            match condition.heat {
                HeatCondition::Newton { coefficient, temperature } => add(temperature, &|_| coefficient),
                HeatCondition::Open { temperature: Some(outside) } => add(outside, &|phi| {
                    let through = facet.at(phi, |node| velocity[node].dot(&facet.normal));
                    -capacity * through.min(0.0) * facet.at(phi, |node| voidage[node])
                }),
                _ => {}
            }
        }
    }
}

/// Puts prescribed temperatures into the energy equation, in the order of the scene.
pub fn apply_temperatures<const D: usize>(
    mesh: &Mesh<D>,
    conditions: &[Condition<D>],
    system: &mut System<1>,
) {
    for condition in conditions {
        if let HeatCondition::Temperature(value) = &condition.heat {
            for nodes in facets(mesh, &condition.boundary) {
                nodes.iter().for_each(|&node| system.prescribe(node as usize, 0, value.at(node as usize)));
            }
        }
    }
}
