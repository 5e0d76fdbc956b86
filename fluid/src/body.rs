//! Bodies in the fluid: a closed part of the boundary that moves as a rigid body, grows or shrinks, and lets vapour
//! out.
//!
//! The surface of a body moves with w = U + rdot s, where s is the place of a node beside the centre over the radius.
//! Fluid leaves the surface with the superficial velocity j, the same on all of it, so that the velocity held at a node
//! is
//!
//! ```text
//! u = U + k,    k = rdot s + (j / eps) s/|s|
//! ```
//!
//! **Mass.** What passes a facet goes into the equation of mass as it is known, not by the velocities of the nodes, so
//! that the volume of vapour is exact whatever the voidage (n points out of the fluid, into the body):
//!
//! ```text
//! <<eps w . n, q>> + sum over chords of solid v . n q - j <<1, q>>
//! ```
//!
//! The chords are where the surface cuts grains that move through it. Where the velocity of the vapour is taken for
//! an interstitial one ([`Blowing`]), u = w + j s/|s| is held, and <<eps j, q>> passes: of the vapour the share of
//! the voidage.
//!
//! **Vapour.** The body boils at the rate of the heat that it gets; j = (Q + given) / (latent P), P the perimeter.
//! Heat of the fluid is the reaction Q = -sum over its nodes of (A T - b), with the equations of these nodes before
//! the prescribed temperature took their places, or, if
//! [`HeatFlux`] says so, the integral -<<eps K grad T . n, 1>> of the gradients in the cells at the surface.
//!
//! **Motion.** The force of the fluid is the reaction F = -sum over its nodes of (K x - b) of the momentum rows. It is
//! affine in U: with x_0 the solution at U = 0 and X_i those of a unit velocity along axis i without any other data, on
//! one matrix,
//!
//! ```text
//! x = x_0 + sum U_i X_i,    F = F_0 + F_X U,    (A - F_X) U = B + F_0
//! ```
//!
//! where A U = B + F is the equation of motion of the body. So the velocity is found with the fluid, and a body as
//! light as it likes is stable. The symmetric part of -F_X is positive definite without convection: it is the work of
//! the drag.

use crate::assembly::{KeptRows, System};
use crate::balance::Balance;
use crate::boundary::{self, Facet, Through};
use crate::conditions::{Condition, Constraint, FlowCondition, facets};
use crate::geometry::Geometry;
use crate::{Error, Result, Vector};
use nalgebra::{DMatrix, DVector, SMatrix};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Voidage below which the velocity of what leaves the surface no longer grows. The volume that leaves is exact all the
/// same.
const LEAST_VOIDAGE: f64 = 0.05;

/// What a body is in a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body<const D: usize> {
    /// Centre, m.
    pub centre: Vector<D>,
    /// Radius, m: the unit of s.
    pub radius: f64,
    /// Rate of the radius rdot, m/s.
    pub expansion: f64,
    /// Who knows its velocity.
    pub motion: BodyMotion<D>,
    /// How it boils; absent for a body that does not.
    pub evaporation: Option<Evaporation>,
    /// What the velocity of its vapour is.
    pub blowing: Blowing,
    /// Solid that passes the surface into the body, as it acts in the equation of mass, sum of chord v . n q: a number
    /// for every node of every facet, in their order, m3/s (m2/s in the plane). Empty without grains.
    pub solid: Vec<f64>,
}

/// The velocity of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyMotion<const D: usize> {
    /// Found with the fluid, from `inertia` U = `force` + force of the fluid.
    Free {
        /// A, kg/s.
        inertia: SMatrix<f64, D, D>,
        /// B, N.
        force: Vector<D>,
    },
    /// Given, m/s.
    Held(Vector<D>),
}

impl<const D: usize> BodyMotion<D> {
    /// A free body whose inertia A (kg/s) is the same along all axes, with B, N.
    pub fn free(inertia: f64, force: Vector<D>) -> Self {
        Self::Free { inertia: SMatrix::from_diagonal_element(inertia), force }
    }
}

/// What the velocity j of the vapour of a body is, relative to the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blowing {
    /// Superficial, eps u: all of the vapour arrives in the fluid.
    #[default]
    Superficial,
    /// Interstitial, u: of the vapour the share of the voidage at the surface arrives in the fluid, and the rest is
    /// lost.
    Interstitial,
}

/// What the heat of the fluid to a body is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeatFlux {
    /// The reaction of the discrete equations: what the fluid loses. Order 2 in the mesh.
    #[default]
    Reaction,
    /// The integral of the discrete gradient at the surface. Order 1 in the mesh; the fluid loses more than the body
    /// gets where the mesh does not resolve its thermal layer.
    Gradient,
}

/// How a body boils.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaporation {
    /// Number of the scalar that is the temperature; absent where the fluid brings no heat.
    pub scalar: Option<usize>,
    /// What the heat of the fluid is.
    pub heat_flux: HeatFlux,
    /// Heat from elsewhere, W (W/m in the plane).
    pub heat: f64,
    /// Heat that a volume of vapour takes, J/m3.
    pub latent: f64,
}

/// What a step says of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyAnswer<const D: usize> {
    /// Its velocity U, m/s.
    pub velocity: Vector<D>,
    /// Volume of vapour that leaves it, m3/s (m2/s in the plane).
    pub vapour: f64,
}

/// The number of bodies among conditions.
pub fn count<const D: usize>(conditions: &[Condition<D>]) -> usize {
    conditions.iter().filter(|condition| matches!(condition.flow, FlowCondition::Body(_))).count()
}

/// A body in the step in hand.
struct Surface<const D: usize> {
    /// Number of its condition.
    condition: usize,
    /// Superficial velocity of the vapour j, m/s.
    blowing: f64,
    answer: BodyAnswer<D>,
}

/// The bodies of a flow.
#[derive(Default)]
pub(crate) struct Bodies<const D: usize> {
    surfaces: Vec<Surface<D>>,
    /// X of each free body and axis, and U along it, of the last solution: where iterations start.
    responses: Vec<Vec<f64>>,
    moves: Vec<f64>,
    rhs: Vec<f64>,
}

impl<const D: usize> Bodies<D> {
    /// Drops what earlier steps left.
    pub fn forget(&mut self) {
        self.responses.clear();
        self.moves.clear();
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// What the step says of each, in the order of the conditions.
    pub fn answers(&self) -> impl Iterator<Item = BodyAnswer<D>> {
        self.surfaces.iter().map(|surface| surface.answer)
    }

    /// Takes the bodies of a step and what they boil; `heat` is what the fluid gives a condition of a scalar, W.
    pub fn boil<const B: usize>(
        &mut self,
        geometry: &Geometry<D, B>,
        conditions: &[Condition<D>],
        heat: impl Fn(usize, usize, HeatFlux) -> f64,
    ) {
        self.surfaces.clear();
        for (number, body) in bodies(conditions) {
            let vapour = body.evaporation.as_ref().map_or(0.0, |boils| {
                let fluid = boils.scalar.map_or(0.0, |scalar| heat(number, scalar, boils.heat_flux));
                (fluid + boils.heat) / boils.latent
            });
            let facets = facets(&geometry.mesh, &conditions[number].boundary);
            let perimeter: f64 = facets.map(|nodes| Facet::new(&geometry.mesh, nodes).measure).sum();
            let answer = BodyAnswer { velocity: Vector::zeros(), vapour };
            self.surfaces.push(Surface { condition: number, blowing: vapour / perimeter, answer });
        }
    }

    /// Holds the nodes of the surfaces, those of free bodies at U = 0.
    pub fn constrain<const B: usize>(
        &self,
        geometry: &Geometry<D, B>,
        conditions: &[Condition<D>],
        voidage: &[f64],
        constraints: &mut [Option<Constraint<D>>],
    ) {
        for (surface, body) in self.with(conditions) {
            let moves = match body.motion {
                BodyMotion::Held(velocity) => velocity,
                BodyMotion::Free { .. } => Vector::zeros(),
            };
            for &node in facets(&geometry.mesh, &conditions[surface.condition].boundary).flatten() {
                let node = node as usize;
                let place = body.place(&geometry.mesh.points[node]);
                let blown = match body.blowing {
                    Blowing::Superficial => surface.blowing / voidage[node].max(LEAST_VOIDAGE),
                    Blowing::Interstitial => surface.blowing,
                };
                let own = place * body.expansion + place.normalize() * blown;
                constraints[node] = Some(Constraint::Fixed(moves + own));
            }
        }
    }

    /// Adds what passes the surfaces to the equations of mass, with U = 0 of free bodies.
    pub fn add_mass<const B: usize>(
        &self,
        geometry: &Geometry<D, B>,
        conditions: &[Condition<D>],
        voidage: &[f64],
        (system, through): (&mut System<B>, &mut Through),
    ) {
        for (surface, body) in self.with(conditions) {
            let moves = match body.motion {
                BodyMotion::Held(velocity) => velocity,
                BodyMotion::Free { .. } => Vector::zeros(),
            };
            surface.pass(body, moves, geometry, conditions, voidage, |node, volume| {
                system.rhs[B * node + D] -= volume;
                through.net += volume;
                through.gross += volume.abs();
            });
            // What a moving body pushes ahead of it and draws in behind leaves rounding errors in the net, at U = 0
            // too.
            for nodes in facets(&geometry.mesh, &conditions[surface.condition].boundary) {
                let speed = geometry.velocity_of(nodes[0] as usize).norm();
                through.gross += Facet::new(&geometry.mesh, nodes).measure * speed;
            }
        }
    }

    /// Takes from `x` what free bodies did in the last solution: where the iterations of x_0 start.
    pub fn at_rest(&self, x: &mut [f64]) {
        for (response, along) in self.responses.iter().zip(&self.moves) {
            x.iter_mut().zip(response).for_each(|(x, response)| *x -= along * response);
        }
    }

    /// Finds the velocities of the free bodies and adds their part to `x`, which holds x_0. `solve(rhs, X)` solves on
    /// the matrix of the step; `held` is the condition that fixes each node, `kept` has the equations of the nodes
    /// before they were fixed; in a `closed` domain the pressure of the first node is held.
    pub fn release<const B: usize>(
        &mut self,
        (geometry, conditions, voidage): (&Geometry<D, B>, &[Condition<D>], &[f64]),
        (held, kept, closed): (&[u32], &KeptRows<B>, bool),
        system: &System<B>,
        x: &mut [f64],
        mut solve: impl FnMut(&System<B>, &[f64], &mut [f64]) -> Result<()>,
    ) -> Result<()> {
        for surface in &mut self.surfaces {
            if let FlowCondition::Body(Body { motion: BodyMotion::Held(velocity), .. }) =
                &conditions[surface.condition].flow
            {
                surface.answer.velocity = *velocity;
            }
        }
        let free: Vec<usize> = (0..self.surfaces.len())
            .filter(|k| body_of(conditions, self.surfaces[*k].condition).is_some_and(Body::is_free))
            .collect();
        let unknowns = D * free.len();
        self.responses.resize(unknowns, Vec::new());
        if unknowns == 0 {
            return Ok(());
        }
        let pattern = &system.matrix.pattern;
        // The forces at a solution; without the right-hand sides, how they grow with it.
        let forces = |x: &[f64], growth: bool| {
            let mut sum = vec![Vector::<D>::zeros(); self.surfaces.len()];
            let add = |node: usize, row: [f64; B]| {
                let owner = self.surfaces.iter().position(|s| s.condition as u32 == held[node]);
                if let Some(owner) = owner {
                    sum[owner] -= Vector::from_fn(|i, _| row[i]);
                }
            };
            match growth {
                true => kept.products(pattern, x, add),
                false => kept.reactions(pattern, x, add),
            }
            DVector::from_fn(unknowns, |k, _| sum[free[k / D]][k % D])
        };
        let still = forces(x, false);
        let (mut matrix, mut right) = (DMatrix::zeros(unknowns, unknowns), still);
        for (k, &surface) in free.iter().enumerate() {
            let Some(Body { motion: BodyMotion::Free { inertia, force }, .. }) =
                body_of(conditions, self.surfaces[surface].condition)
            else {
                continue;
            };
            matrix.view_mut((D * k, D * k), (D, D)).copy_from(inertia);
            (0..D).for_each(|i| right[D * k + i] += force[i]);
        }
        let mut responses = std::mem::take(&mut self.responses);
        for (k, response) in responses.iter_mut().enumerate() {
            let surface = &self.surfaces[free[k / D]];
            let axis = Vector::<D>::from_fn(|i, _| f64::from(u8::from(i == k % D)));
            self.rhs.clear();
            self.rhs.resize(x.len(), 0.0);
            response.resize(x.len(), 0.0);
            for &node in facets(&geometry.mesh, &conditions[surface.condition].boundary).flatten() {
                let node = node as usize;
                let diagonal = &system.matrix.values[pattern.diagonal(node)];
                self.rhs[B * node + k % D] = diagonal[k % D][k % D];
            }
            for nodes in facets(&geometry.mesh, &conditions[surface.condition].boundary) {
                let facet = Facet::new(&geometry.mesh, nodes);
                facet.load(
                    |phi| facet.at(phi, |node| voidage[node]) * axis.dot(&facet.normal),
                    |node, volume| self.rhs[B * node as usize + D] -= volume,
                );
            }
            if closed {
                boundary::spread(geometry, &mut self.rhs);
            }
            solve(system, &self.rhs, response)?;
            let slope = forces(response, true);
            matrix.column_mut(k).axpy(-1.0, &slope, 1.0);
        }
        let velocity = matrix.lu().solve(&right).filter(|u| u.iter().all(|u| u.is_finite()));
        let velocity =
            velocity.ok_or_else(|| Error::Linear("the motion of a body has no solution".into()))?;
        for (along, response) in velocity.iter().zip(&responses) {
            x.iter_mut().zip(response).for_each(|(x, response)| *x += along * response);
        }
        self.responses = responses;
        self.moves = velocity.iter().copied().collect();
        for (k, &surface) in free.iter().enumerate() {
            self.surfaces[surface].answer.velocity = Vector::from_fn(|i, _| velocity[D * k + i]);
        }
        Ok(())
    }

    /// Puts what passed the surfaces into the balances of their parts; `value(k, node)` is the capacity of scalar `k`
    /// times its value.
    pub fn balance<const B: usize>(
        &self,
        geometry: &Geometry<D, B>,
        conditions: &[Condition<D>],
        voidage: &[f64],
        value: impl Fn(usize, usize) -> f64,
        out: &mut [Balance<D>],
    ) {
        for (surface, body) in self.with(conditions) {
            let balance = &mut out[surface.condition];
            surface.pass(body, surface.answer.velocity, geometry, conditions, voidage, |_, volume| {
                balance.flux += volume;
            });
            for nodes in facets(&geometry.mesh, &conditions[surface.condition].boundary) {
                let facet = Facet::new(&geometry.mesh, nodes);
                for (k, convected) in balance.convected.iter_mut().enumerate() {
                    let blown = |phi: &[f64; 3]| {
                        let passes = surface.blowing * body.passed(facet.at(phi, |node| voidage[node]));
                        -passes * facet.at(phi, |node| value(k, node))
                    };
                    facet.load(blown, |_, part| *convected += part);
                }
            }
        }
    }

    /// The surfaces with their bodies.
    fn with<'a>(
        &'a self,
        conditions: &'a [Condition<D>],
    ) -> impl Iterator<Item = (&'a Surface<D>, &'a Body<D>)> {
        self.surfaces.iter().filter_map(|surface| Some((surface, body_of(conditions, surface.condition)?)))
    }
}

impl<const D: usize> Surface<D> {
    /// Calls `f(node, int of what passes phi_node)` for all nodes of all facets.
    fn pass<const B: usize>(
        &self,
        body: &Body<D>,
        moves: Vector<D>,
        geometry: &Geometry<D, B>,
        conditions: &[Condition<D>],
        voidage: &[f64],
        mut f: impl FnMut(usize, f64),
    ) {
        let mut solid = body.solid.chunks_exact(D);
        for nodes in facets(&geometry.mesh, &conditions[self.condition].boundary) {
            let facet = Facet::new(&geometry.mesh, nodes);
            let along = |node: usize| {
                let surface = moves + body.place(&geometry.mesh.points[node]) * body.expansion;
                surface.dot(&facet.normal)
            };
            let passes = |phi: &[f64; 3]| {
                let voidage = facet.at(phi, |node| voidage[node]);
                voidage * facet.at(phi, along) - self.blowing * body.passed(voidage)
            };
            facet.load(passes, |node, volume| f(node as usize, volume));
            for (&node, volume) in nodes.iter().zip(solid.next().into_iter().flatten()) {
                f(node as usize, *volume);
            }
        }
    }
}

impl<const D: usize> Body<D> {
    /// s of a point, no unit.
    fn place(&self, point: &Vector<D>) -> Vector<D> {
        (point - self.centre) / self.radius
    }

    fn is_free(&self) -> bool {
        matches!(self.motion, BodyMotion::Free { .. })
    }

    /// Share of the vapour that arrives in the fluid where it has this voidage.
    fn passed(&self, voidage: f64) -> f64 {
        match self.blowing {
            Blowing::Superficial => 1.0,
            Blowing::Interstitial => voidage,
        }
    }
}

/// What a scalar of this conductivity gives to a part of the boundary by its gradients there, -<<eps K grad s . n,
/// 1>>, W for heat (W/m in the plane).
pub(crate) fn conducted<const D: usize, const B: usize>(
    geometry: &Geometry<D, B>,
    boundary: &str,
    conductivity: f64,
    voidage: &[f64],
    values: &[f64],
) -> f64 {
    let sorted = |nodes: &[u32]| {
        let mut nodes = nodes.to_vec();
        nodes.sort_unstable();
        nodes
    };
    let of_part: HashMap<Vec<u32>, &[u32]> =
        facets(&geometry.mesh, boundary).map(|nodes| (sorted(nodes), nodes)).collect();
    let mut given = 0.0;
    for cell in 0..geometry.elements.len() {
        let nodes = geometry.nodes(cell);
        for left_out in 0..B {
            let facet: Vec<u32> = (0..B).filter(|a| *a != left_out).map(|a| nodes[a] as u32).collect();
            let Some(nodes) = of_part.get(&sorted(&facet)) else { continue };
            let facet = Facet::new(&geometry.mesh, nodes);
            let element = &geometry.elements[cell];
            let slope = element.gradient_of(&geometry.nodes(cell).map(|node| values[node]));
            let open: f64 = nodes.iter().map(|node| voidage[*node as usize]).sum::<f64>() / D as f64;
            given -= conductivity * open * facet.measure * slope.dot(&facet.normal);
        }
    }
    given
}

fn body_of<const D: usize>(conditions: &[Condition<D>], number: usize) -> Option<&Body<D>> {
    match &conditions[number].flow {
        FlowCondition::Body(body) => Some(body),
        _ => None,
    }
}

fn bodies<const D: usize>(conditions: &[Condition<D>]) -> impl Iterator<Item = (usize, &Body<D>)> {
    (0..conditions.len()).filter_map(|number| Some((number, body_of(conditions, number)?)))
}
