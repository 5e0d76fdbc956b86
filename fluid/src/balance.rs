//! What passes each named part of the boundary in a step, from the discrete equations themselves.
//!
//! Where a condition takes the place of an equation, what the boundary does to the fluid is the reaction A x - b of the
//! equation that it replaced; elsewhere it is the boundary integral that was assembled. So the sums over the parts
//! close the balances of the step to the residual of the linear solver, whatever the mesh:
//!
//! ```text
//! sum of flux = 0                                                  (less sources of mass)
//! sum of force + rate of momentum, drag of points and thin cell = weight
//! sum of scalars = storage + convection - exchange with points and thin cell
//! ```

use crate::Vector;
use crate::boundary::Facet;
use crate::conditions::{Condition, FlowCondition, ScalarCondition, facets};
use crate::flow::State;
use crate::geometry::Geometry;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// What passes one part of the boundary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Balance<const D: usize> {
    /// Volume that leaves through the part, m3/s (m2/s in the plane): of fluid where it is open or a velocity is
    /// prescribed, of the whole mixture where a wall moves.
    pub flux: f64,
    /// Force of the fluid on the part, N (N/m in the plane); of an open part with the momentum that entering fluid
    /// takes up.
    pub force: Vector<D>,
    /// Moment of this force about the origin, N m: in space about x, y and z, in the plane (N) about z, anticlockwise.
    pub torque: Vec<f64>,
    /// What the part gives to the fluid of each scalar by conduction, transfer and the value of entering fluid, W for
    /// heat (W/m in the plane).
    pub scalars: Vec<f64>,
    /// What the fluid carries out through the part of each scalar, capacity times value times flux, W for heat (W/m in
    /// the plane).
    pub convected: Vec<f64>,
}

impl<const D: usize> Balance<D> {
    /// Nothing passes, of so many scalars.
    pub fn none(scalars: usize) -> Self {
        let [torque, scalars] = [moments(D), scalars].map(|count| vec![0.0; count]);
        Self { flux: 0.0, force: Vector::zeros(), torque, convected: scalars.clone(), scalars }
    }

    /// Adds a force that acts somewhere.
    fn act(&mut self, at: &Vector<D>, force: &Vector<D>) {
        self.force += force;
        for (axis, moment) in self.torque.iter_mut().enumerate() {
            let (i, j) = if D == 2 { (0, 1) } else { ((axis + 1) % 3, (axis + 2) % 3) };
            *moment += at[i] * force[j] - at[j] * force[i];
        }
    }
}

/// Numbers of a moment: one in the plane, three in space.
pub const fn moments(dimension: usize) -> usize {
    dimension * (dimension - 1) / 2
}

/// A solved step.
pub(crate) struct Solved<'a, const D: usize, const B: usize> {
    pub geometry: &'a Geometry<D, B>,
    pub conditions: &'a [Condition<D>],
    pub voidage: &'a [f64],
    pub density: f64,
    /// Capacities of the scalars.
    pub capacity: &'a [f64],
    /// The state that it started from.
    pub old: &'a State<D>,
    /// Its solution.
    pub new: &'a State<D>,
}

impl<const D: usize, const B: usize> Solved<'_, D, B> {
    /// The balances without reactions, by condition.
    pub fn integrals(&self, out: &mut Vec<Balance<D>>) {
        out.resize_with(self.conditions.len(), || Balance::none(0));
        for (condition, balance) in self.conditions.iter().zip(out) {
            (balance.flux, balance.force) = (0.0, Vector::zeros());
            let scalars = self.capacity.len();
            let columns = [&mut balance.torque, &mut balance.scalars, &mut balance.convected];
            for (column, count) in columns.into_iter().zip([moments(D), scalars, scalars]) {
                column.clear();
                column.resize(count, 0.0);
            }
            for nodes in facets(&self.geometry.mesh, &condition.boundary) {
                self.pass(condition, &Facet::new(&self.geometry.mesh, nodes), balance);
            }
        }
    }

    fn pass(&self, condition: &Condition<D>, facet: &Facet<'_, D>, out: &mut Balance<D>) {
        let voidage = |phi: &[f64; 3]| facet.at(phi, |node| self.voidage[node]);
        let along = |phi: &[f64; 3], value: &dyn Fn(usize) -> Vector<D>| {
            facet.at(phi, |node| value(node).dot(&facet.normal))
        };
        let wind = |node: usize| self.old.velocity[node] - self.geometry.velocity_of(node);
        for (phi, share) in crate::element::facet_rule::<D>() {
            let weight = facet.measure * share;
            let (flux, carries) = match &condition.flow {
                FlowCondition::Open { pressure } => {
                    let taken = -self.density * facet.inflow(phi, wind) * voidage(phi);
                    let velocity: Vector<D> =
                        (0..D).map(|a| self.new.velocity[facet.nodes[a] as usize] * phi[a]).sum();
                    let at: Vector<D> =
                        (0..D).map(|a| self.geometry.mesh.points[facet.nodes[a] as usize] * phi[a]).sum();
                    out.act(&at, &((facet.normal * *pressure + velocity * taken) * weight));
                    (voidage(phi) * velocity.dot(&facet.normal), true)
                }
                FlowCondition::Velocity(value) => (voidage(phi) * along(phi, &|node| value.at(node)), true),
                FlowCondition::SuperficialVelocity(value) => (along(phi, &|node| value.at(node)), true),
                FlowCondition::NoSlip | FlowCondition::Slip => {
                    (along(phi, &|node| self.geometry.velocity_of(node)), false)
                }
                // [`crate::body`] knows what passes bodies.
                FlowCondition::Body(_) => (0.0, false),
            };
            out.flux += weight * flux;
            for (k, capacity) in self.capacity.iter().enumerate() {
                let value = facet.at(phi, |node| self.new.scalars[k][node]);
                if carries {
                    out.convected[k] += weight * flux * capacity * value;
                }
                out.scalars[k] += weight
                    * match condition.scalar(k) {
                        ScalarCondition::Transfer { coefficient, outside } => coefficient * (outside - value),
                        ScalarCondition::Outflow { outside: Some(outside) } => {
                            -capacity * facet.inflow(phi, wind) * voidage(phi) * (outside - value)
                        }
                        _ => 0.0,
                    };
            }
        }
    }
}

/// No condition.
pub(crate) const NOBODY: u32 = u32::MAX;

/// Who holds the velocities of the nodes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Owners<const D: usize> {
    /// The last condition that fixes each node.
    pub fixed: Vec<u32>,
    /// Nodes that slide along walls: node, condition, and the sum of normals times measure of its facets there; in the
    /// order of nodes.
    sliding: Vec<(u32, u32, Vector<D>)>,
}

/// Normals that differ by less, relative to their length, are the same.
const ALIKE: f64 = 1e-9;

impl<const D: usize> Owners<D> {
    /// Takes the conditions of a step.
    pub fn fill<const B: usize>(&mut self, geometry: &Geometry<D, B>, conditions: &[Condition<D>]) {
        let mesh = &geometry.mesh;
        let fixes =
            |flow: &FlowCondition<D>| !matches!(flow, FlowCondition::Open { .. } | FlowCondition::Slip);
        last(&mut self.fixed, geometry, conditions, |condition| fixes(&condition.flow));
        self.sliding.clear();
        for (number, condition) in (0..).zip(conditions) {
            if condition.flow != FlowCondition::Slip {
                continue;
            }
            for nodes in facets(mesh, &condition.boundary) {
                let facet = Facet::new(mesh, nodes);
                let area = facet.normal * facet.measure;
                let masters = nodes.iter().map(|node| mesh.periodic.master(*node));
                let free = masters.filter(|node| self.fixed[*node as usize] == NOBODY);
                self.sliding.extend(free.map(|node| (node, number, area)));
            }
        }
        self.sliding.sort_by_key(|(node, number, _)| (*node, *number));
        self.sliding.dedup_by(|next, first| {
            let same = (next.0, next.1) == (first.0, first.1);
            if same {
                first.2 += next.2;
            }
            same
        });
    }

    /// Adds the force of a node at a place, N, to the balances of those that hold it: that of a corner between walls to
    /// slide along is resolved into their normals, by least squares where these are alike.
    pub fn share_force(&self, node: usize, at: &Vector<D>, force: Vector<D>, out: &mut [Balance<D>]) {
        if self.fixed[node] != NOBODY {
            out[self.fixed[node] as usize].act(at, &force);
            return;
        }
        let start = self.sliding.partition_point(|(other, ..)| (*other as usize) < node);
        let walls = &self.sliding[start..];
        let walls = &walls[..walls.partition_point(|(other, ..)| *other as usize == node)];
        if let [(_, number, _)] = walls {
            out[*number as usize].act(at, &force);
            return;
        }
        let normals = DMatrix::from_fn(D, walls.len(), |i, k| walls[k].2[i]);
        let svd = normals.svd(true, true);
        let least = ALIKE * svd.singular_values.max();
        let Ok(shares) = svd.solve(&DVector::from_fn(D, |i, _| force[i]), least) else { return };
        for ((_, number, area), share) in walls.iter().zip(shares.iter()) {
            out[*number as usize].act(at, &(area * *share));
        }
    }
}

/// The last of some conditions at each node.
pub(crate) fn last<const D: usize, const B: usize>(
    out: &mut Vec<u32>,
    geometry: &Geometry<D, B>,
    conditions: &[Condition<D>],
    counts: impl Fn(&Condition<D>) -> bool,
) {
    out.clear();
    out.resize(geometry.mesh.points.len(), NOBODY);
    for (number, condition) in (0..).zip(conditions).filter(|(_, condition)| counts(condition)) {
        for node in facets(&geometry.mesh, &condition.boundary).flatten() {
            out[geometry.mesh.periodic.master(*node) as usize] = number;
        }
    }
}
