//! What is prescribed on the boundary, by the name of its part.

use crate::body::Body;
use crate::{Error, Mesh, Result, Vector};
use serde::{Deserialize, Serialize};

/// Conditions on one named part of the boundary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Condition<const D: usize> {
    /// Name of the part in the mesh.
    pub boundary: String,
    /// What the velocity or traction is.
    pub flow: FlowCondition<D>,
    /// What the value or flux of each scalar is, in their order; those that are missing at the end are insulated.
    pub scalars: Vec<ScalarCondition>,
}

impl<const D: usize> Condition<D> {
    /// The condition of scalar `k`.
    pub fn scalar(&self, k: usize) -> &ScalarCondition {
        self.scalars.get(k).unwrap_or(&ScalarCondition::Insulated)
    }
}

/// A prescribed velocity (m/s) or value of a scalar (K for heat).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prescribed<T> {
    /// The same everywhere.
    Uniform(T),
    /// One value for every node of the mesh; only those on the boundary part are read.
    Nodal(Vec<T>),
}

impl<T: Copy + std::ops::MulAssign<f64>> Prescribed<T> {
    /// Multiplies by a factor.
    pub fn scale(&mut self, factor: f64) {
        match self {
            Self::Uniform(value) => *value *= factor,
            Self::Nodal(values) => values.iter_mut().for_each(|value| *value *= factor),
        }
    }

    /// The value at a node of the mesh.
    pub fn at(&self, node: usize) -> T {
        match self {
            Self::Uniform(value) => *value,
            Self::Nodal(values) => values[node],
        }
    }
}

/// Condition on the flow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlowCondition<const D: usize> {
    /// u given.
    Velocity(Prescribed<Vector<D>>),
    /// eps u given: u = value / eps with the nodal voidage of the step.
    SuperficialVelocity(Prescribed<Vector<D>>),
    /// u = 0, on a moving mesh u = u_mesh: the nodes of a wall move with it.
    NoSlip,
    /// u . n = 0, on a moving mesh u_mesh . n; no tangential traction.
    Slip,
    /// Traction -p n with the given pressure, Pa; where fluid enters, its momentum is taken up by the
    /// term -eps rho min(u_n . n, 0) u.
    Open {
        /// Pressure outside, Pa.
        pressure: f64,
    },
    /// A body that moves in the fluid and lets vapour out.
    Body(Body<D>),
}

/// Condition on a scalar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScalarCondition {
    /// s given, K for heat.
    Value(Prescribed<f64>),
    /// q = coefficient (outside - s) enters: Newton cooling.
    Transfer {
        /// Transfer coefficient, W/m2/K for heat.
        coefficient: f64,
        /// Value outside, K for heat.
        outside: f64,
    },
    /// No flux.
    Insulated,
    /// No diffusive flux; fluid that enters has the given value, if one is given, through the term
    /// -eps C min(u . n, 0) (s - s_out).
    Outflow {
        /// Value outside s_out, K for heat.
        outside: Option<f64>,
    },
}

/// What holds the velocity of a node.
#[derive(Clone, Debug, PartialEq)]
pub enum Constraint<const D: usize> {
    /// The whole velocity is given.
    Fixed(Vector<D>),
    /// The components along these orthonormal directions are those of the wall.
    Normal {
        /// The directions.
        normals: Vec<Vector<D>>,
        /// Velocity of the wall, m/s.
        wall: Vector<D>,
    },
}

/// Checks that every part of the boundary has exactly one condition and that every condition has a part.
pub fn check<const D: usize>(mesh: &Mesh<D>, conditions: &[Condition<D>]) -> Result<()> {
    let known = || mesh.boundaries.iter().map(|b| format!("`{}`", b.name)).collect::<Vec<_>>().join(", ");
    for (k, condition) in conditions.iter().enumerate() {
        if !mesh.boundaries.iter().any(|b| b.name == condition.boundary) {
            let text = format!("the mesh has no boundary `{}`; it has {}", condition.boundary, known());
            return Err(Error::Mesh(text));
        }
        if conditions[..k].iter().any(|other| other.boundary == condition.boundary) {
            return Err(Error::Mesh(format!("two conditions for the boundary `{}`", condition.boundary)));
        }
    }
    match mesh.boundaries.iter().find(|b| !conditions.iter().any(|c| c.boundary == b.name)) {
        Some(bare) => Err(Error::Mesh(format!("no condition for the boundary `{}` of the mesh", bare.name))),
        None => Ok(()),
    }
}

/// Facets of a part of the boundary: nodes and the cell behind.
pub fn facets<'a, const D: usize>(
    mesh: &'a Mesh<D>,
    name: &str,
) -> impl Iterator<Item = &'a [u32]> + use<'a, D> {
    let part = mesh.boundaries.iter().find(|b| b.name == name);
    part.into_iter().flat_map(|part| part.facets.chunks_exact(D))
}

/// The velocity conditions of every node that is a master, in the order of the scene: a later prescribed velocity wins
/// at shared nodes, slip never frees a node that is fixed and is replaced by a later prescribed velocity.
///
/// Slip normals of facets within 30 degrees are averaged (a smooth boundary); a sharper corner holds each
/// of its directions. `moving` holds the velocities of the nodes if the mesh moves.
pub fn constraints<const D: usize>(
    mesh: &Mesh<D>,
    conditions: &[Condition<D>],
    voidage: &[f64],
    moving: Option<&[Vector<D>]>,
    constraints: &mut Vec<Option<Constraint<D>>>,
) {
    constraints.clear();
    constraints.resize(mesh.points.len(), None);
    for condition in conditions {
        for facet in facets(mesh, &condition.boundary) {
            for &node in facet {
                let node = mesh.periodic.master(node) as usize;
                let wall = || moving.map_or_else(Vector::zeros, |velocity| velocity[node]);
                let value = match &condition.flow {
                    FlowCondition::Velocity(value) => value.at(node),
                    FlowCondition::SuperficialVelocity(value) => value.at(node) / voidage[node],
                    FlowCondition::NoSlip => wall(),
                    FlowCondition::Slip => {
                        add_normal(mesh, facet, wall(), &mut constraints[node]);
                        continue;
                    }
                    // What holds the nodes of a body is known once its vapour is.
                    FlowCondition::Open { .. } | FlowCondition::Body(_) => continue,
                };
                constraints[node] = Some(Constraint::Fixed(value));
            }
        }
    }
    for constraint in constraints.iter_mut().flatten() {
        if let Constraint::Normal { normals, .. } = constraint {
            orthonormalise(normals);
        }
    }
}

fn add_normal<const D: usize>(
    mesh: &Mesh<D>,
    facet: &[u32],
    wall: Vector<D>,
    constraint: &mut Option<Constraint<D>>,
) {
    const SAME: f64 = 0.866; // cos 30 degrees
    let corner: [Vector<D>; D] = std::array::from_fn(|k| mesh.points[facet[k] as usize]);
    let (measure, normal) = crate::element::facet_normal(&corner);
    match constraint {
        Some(Constraint::Fixed(_)) => {}
        None => *constraint = Some(Constraint::Normal { normals: vec![normal * measure], wall }),
        Some(Constraint::Normal { normals, .. }) => {
            match normals.iter_mut().find(|other| other.normalize().dot(&normal).abs() > SAME) {
                Some(other) => *other += normal * measure * other.dot(&normal).signum(),
                None => normals.push(normal * measure),
            }
        }
    }
}

/// Gram-Schmidt; directions that add nothing are dropped.
fn orthonormalise<const D: usize>(normals: &mut Vec<Vector<D>>) {
    let mut kept = 0;
    for k in 0..normals.len() {
        let mut direction = normals[k].normalize();
        for other in &normals[..kept] {
            direction -= other * other.dot(&direction);
        }
        if kept < D && direction.norm() > 1e-6 {
            normals[kept] = direction.normalize();
            kept += 1;
        }
    }
    normals.truncate(kept);
}
