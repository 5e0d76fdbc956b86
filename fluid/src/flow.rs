//! The fluid solver: state, one step, and what it reports.

use crate::assembly::{Assembler, KeptRows, System};
use crate::balance::{self, Balance, NOBODY, Owners, Solved};
use crate::body::{self, Bodies, BodyAnswer, HeatFlux};
use crate::conditions::{self, Condition, Constraint, FlowCondition, ScalarCondition};
use crate::forms::{self, Properties};
use crate::geometry::{Geometry, MeshMotion};
use crate::linear::{self, Solver};
use crate::mesh::Periodic;
use crate::points::{CellExchange, PointDensity, Points, PointsByCell};
use crate::shear::Shear;
use crate::transport::{self, CellScalar, Form, Scalar};
use crate::{Error, Mesh, Result, Vector, boundary};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// How the equations are solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Numerics {
    /// Newton steps of the convection per time step, at least 1.
    pub newton: usize,
    /// Linear solver of velocity and pressure.
    pub flow: linear::Options,
    /// Linear solver of the scalars.
    pub scalars: linear::Options,
}

impl Default for Numerics {
    fn default() -> Self {
        let scalars = linear::Options { method: linear::Method::Ilu, tolerance: 1e-10, ..Default::default() };
        Self { newton: 1, flow: linear::Options::default(), scalars }
    }
}

/// Nodal values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State<const D: usize> {
    /// Velocity u, m/s.
    pub velocity: Vec<Vector<D>>,
    /// Pressure p, Pa.
    pub pressure: Vec<f64>,
    /// Each scalar, in their order; K for heat.
    pub scalars: Vec<Vec<f64>>,
}

impl<const D: usize> State<D> {
    /// The values of scalar `k`; none if there is no such scalar.
    pub fn scalar(&self, k: usize) -> &[f64] {
        self.scalars.get(k).map_or(&[], Vec::as_slice)
    }

    /// Gives the images of nodes the values of their masters.
    pub fn join(&mut self, periodic: &Periodic<D>) {
        periodic.mirror(&mut self.velocity);
        periodic.mirror(&mut self.pressure);
        self.scalars.iter_mut().for_each(|values| periodic.mirror(values));
    }

    /// Takes the values of another state, in the memory that there is.
    pub fn copy_from(&mut self, other: &Self) {
        self.velocity.clone_from(&other.velocity);
        self.pressure.clone_from(&other.pressure);
        self.scalars.clone_from(&other.scalars);
    }
}

/// Sources per volume at the nodes: of solid volume that comes in, and for manufactured solutions.
#[derive(Clone, Debug)]
pub struct Sources<const D: usize> {
    /// Momentum, N/m3.
    pub momentum: Vec<Vector<D>>,
    /// Mass over density, 1/s.
    pub mass: Vec<f64>,
    /// Of each scalar, W/m3 for heat.
    pub scalars: Vec<Vec<f64>>,
}

/// What a step reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Iterations of the linear solver of velocity and pressure, summed over the Newton steps.
    pub flow_iterations: usize,
    /// Iterations of the linear solvers of the scalars.
    pub scalar_iterations: usize,
    /// Largest relative residual of the flow systems.
    pub residual: f64,
    /// Whether the flow matrix was factored anew.
    pub factored: bool,
    /// Wall time of the scalars, s.
    pub scalars_s: f64,
    /// Wall time of momentum and mass, s.
    pub flow_s: f64,
}

/// The equation of a scalar: its coefficients, system and solver.
struct Equation {
    scalar: Scalar,
    system: System<1>,
    solver: Solver<1>,
    /// The condition that prescribes the value of each node.
    holder: Vec<u32>,
    kept: KeptRows<1>,
}

/// The solver on one mesh; `B` is `D + 1`.
pub struct Flow<const D: usize, const B: usize> {
    geometry: Geometry<D, B>,
    properties: Properties<D>,
    newton: usize,
    /// Last accepted values.
    state: State<D>,
    /// Values of the step in hand.
    next: State<D>,
    sources: Option<Sources<D>>,
    assembler: Assembler,
    system: System<B>,
    solver: Solver<B>,
    scalars: Vec<Equation>,
    constraints: Vec<Option<Constraint<D>>>,
    owners: Owners<D>,
    kept: KeptRows<B>,
    sorted: PointsByCell,
    /// The points of the step in hand as nodal fields; empty without points.
    density: Vec<PointDensity<D>>,
    /// The shear that they share with the fluid.
    shear: Shear<D, B>,
    bodies: Bodies<D>,
    unknown: Vec<f64>,
}

impl<const D: usize, const B: usize> Flow<D, B> {
    /// A solver on a mesh, starting from the given state.
    ///
    /// # Errors
    /// Conditions that do not fit the mesh, a state without the values of each scalar, flat or inverted cells.
    pub fn new(
        mesh: Mesh<D>,
        properties: Properties<D>,
        scalars: &[Scalar],
        conditions: &[Condition<D>],
        mut state: State<D>,
        numerics: &Numerics,
    ) -> Result<Self> {
        conditions::check(&mesh, conditions)?;
        let nodes = mesh.points.len();
        check_state(&state, nodes, scalars.len())?;
        state.join(&mesh.periodic);
        let masters: Vec<u32> = mesh.cells.iter().map(|node| mesh.periodic.master(*node)).collect();
        let assembler = Assembler::new::<B>(nodes, &masters);
        let pattern = &assembler.pattern;
        let equation = |scalar: &Scalar| Equation {
            scalar: scalar.clone(),
            system: System::new(pattern.clone()),
            solver: Solver::new(pattern.clone(), &mesh.points, numerics.scalars),
            holder: Vec::new(),
            kept: KeptRows::default(),
        };
        Ok(Self {
            system: System::new(pattern.clone()),
            solver: Solver::new(pattern.clone(), &mesh.points, numerics.flow),
            scalars: scalars.iter().map(equation).collect(),
            density: Vec::new(),
            shear: Shear::default(),
            bodies: Bodies::default(),
            kept: KeptRows::default(),
            owners: Owners::default(),
            unknown: vec![0.0; nodes * B],
            next: state.clone(),
            newton: numerics.newton.max(1),
            sources: None,
            constraints: Vec::new(),
            sorted: PointsByCell::default(),
            geometry: Geometry::new(mesh)?,
            properties,
            state,
            assembler,
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh<D> {
        &self.geometry.mesh
    }

    /// Takes the motion of the mesh in the coming step; without one it stands still where it is.
    ///
    /// # Errors
    /// Those of [`Geometry::follow`].
    pub fn follow(&mut self, motion: Option<&MeshMotion<'_, D>>) -> Result<()> {
        self.geometry.follow(motion)
    }

    /// Values of the step in hand.
    pub fn solution(&self) -> &State<D> {
        &self.next
    }

    /// What the step in hand says of the bodies, in the order of the conditions.
    pub fn bodies(&self) -> impl Iterator<Item = BodyAnswer<D>> {
        self.bodies.answers()
    }

    /// Last accepted values.
    pub fn state(&self) -> &State<D> {
        &self.state
    }

    /// Sets the sources of the coming steps.
    pub fn set_sources(&mut self, sources: Option<Sources<D>>) {
        self.sources = sources;
    }

    /// Replaces the accepted values (a restart, an initial condition).
    ///
    /// # Errors
    /// Values of another number of nodes or scalars.
    pub fn set_state(&mut self, state: &State<D>) -> Result<()> {
        check_state(state, self.geometry.mesh.points.len(), self.scalars.len())?;
        self.next.copy_from(state);
        self.next.join(&self.geometry.mesh.periodic);
        self.state.copy_from(&self.next);
        Ok(())
    }

    /// Drops all that the linear solvers keep between steps, so that what follows depends on the state only.
    pub fn forget(&mut self) {
        self.solver.forget();
        self.bodies.forget();
        self.scalars.iter_mut().for_each(|equation| equation.solver.forget());
    }

    /// Makes the step in hand the last accepted one.
    pub fn accept(&mut self) {
        std::mem::swap(&mut self.state, &mut self.next);
    }

    /// Solves one step of `dt` from the last accepted state: the scalars one after the other, then momentum and mass.
    ///
    /// `voidage` is nodal; `points` act on the fluid, none without them.
    ///
    /// # Errors
    /// A linear system without a solution, or prescribed fluxes that do not balance in a closed domain.
    pub fn solve(
        &mut self,
        dt: f64,
        voidage: &[f64],
        points: Option<&Points<D>>,
        conditions: &[Condition<D>],
    ) -> Result<Report> {
        match points {
            Some(points) => self.sorted.sort(&points.cell, self.geometry.elements.len()),
            None => self.sorted.clear(),
        }
        let mut report = Report::default();
        let start = Instant::now();
        for k in 0..self.scalars.len() {
            self.solve_scalar(k, dt, voidage, points, conditions, &mut report)?;
        }
        if !self.scalars.is_empty() {
            report.scalars_s = start.elapsed().as_secs_f64();
        }
        let start = Instant::now();
        let (equations, pattern, next) = (&self.scalars, &self.assembler.pattern, &self.next.scalars);
        let geometry = &self.geometry;
        self.bodies.boil(geometry, conditions, |number, k, flux| {
            let Equation { kept, holder, scalar, .. } = &equations[k];
            if flux == HeatFlux::Gradient {
                let part = &conditions[number].boundary;
                return body::conducted(geometry, part, scalar.conductivity, voidage, &next[k]);
            }
            let mut given = 0.0;
            kept.reactions(pattern, &next[k], |node, [reaction]| {
                given -= if holder[node] as usize == number { reaction } else { 0.0 };
            });
            given
        });
        match points {
            Some(points) => {
                let (density, shear) = (&mut self.density, &mut self.shear);
                PointDensity::fill(density, shear, points, &self.geometry, &self.state)
            }
            None => self.density.clear(),
        }
        for iteration in 0..self.newton {
            self.newton_step(iteration, dt, voidage, points, conditions, &mut report)?;
        }
        report.flow_s = start.elapsed().as_secs_f64();
        Ok(report)
    }

    /// What passes the boundary in the step in hand, by condition; `voidage` and `conditions` are those of the step.
    pub fn balances(&self, voidage: &[f64], conditions: &[Condition<D>], out: &mut Vec<Balance<D>>) {
        let capacity: Vec<f64> = self.scalars.iter().map(|equation| equation.scalar.capacity).collect();
        let solved = Solved {
            geometry: &self.geometry,
            conditions,
            voidage,
            density: self.properties.density,
            capacity: &capacity,
            old: &self.state,
            new: &self.next,
        };
        solved.integrals(out);
        let value = |k: usize, node: usize| capacity[k] * self.next.scalars[k][node];
        self.bodies.balance(&self.geometry, conditions, voidage, value, out);
        let pattern = &self.assembler.pattern;
        self.kept.reactions(pattern, &self.unknown, |node, reaction| {
            let force = Vector::from_fn(|i, _| -reaction[i]);
            self.owners.share_force(node, &self.geometry.mesh.points[node], force, out);
        });
        for (k, equation) in self.scalars.iter().enumerate() {
            equation.kept.reactions(pattern, &self.next.scalars[k], |node, [given]| {
                out[equation.holder[node] as usize].scalars[k] += given;
            });
        }
    }

    fn solve_scalar(
        &mut self,
        k: usize,
        dt: f64,
        voidage: &[f64],
        points: Option<&Points<D>>,
        conditions: &[Condition<D>],
        report: &mut Report,
    ) -> Result<()> {
        let Equation { scalar, system, solver, holder, kept } = &mut self.scalars[k];
        let (old, next) = (&self.state.scalars[k], &mut self.next.scalars[k]);
        let (geometry, sorted, state) = (&self.geometry, &self.sorted, &self.state);
        let wind = |node: usize| state.velocity[node] - geometry.velocity_of(node);
        let sources = self.sources.as_ref();
        let columns = points.and_then(|points| Some((points, points.scalars.get(k)?.as_ref()?)));
        self.assembler.assemble(system, |cell, out| {
            let node = geometry.nodes(cell);
            let cell = transport::Cell {
                element: geometry.elements[cell],
                voidage: node.map(|n| voidage[n]),
                velocity: node.map(wind),
                old: node.map(|n| old[n]),
                exchange: columns
                    .and_then(|(points, columns)| CellScalar::gather(points, columns, sorted, cell)),
                source: sources.map(|s| node.map(|n| s.scalars[k][n])),
            };
            transport::assemble(&cell, scalar, dt, out);
        });
        let mesh = &geometry.mesh;
        boundary::add_scalar(mesh, conditions, (k, scalar.capacity), voidage, wind, system);
        if scalar.form == Form::Monotone {
            system.upwind();
        }
        balance::last(holder, geometry, conditions, |condition| {
            matches!(condition.scalar(k), ScalarCondition::Value(_))
        });
        let held = holder.iter().enumerate().filter(|(_, holder)| **holder != NOBODY);
        kept.keep(system, held.map(|(node, _)| node));
        boundary::apply_values(mesh, conditions, k, system);
        boundary::hold_images(mesh, system);
        next.copy_from_slice(old);
        report.scalar_iterations += solver.solve(&system.matrix, &system.rhs, next)?.iterations;
        mesh.periodic.mirror(next);
        Ok(())
    }

    fn newton_step(
        &mut self,
        iteration: usize,
        dt: f64,
        voidage: &[f64],
        points: Option<&Points<D>>,
        conditions: &[Condition<D>],
        report: &mut Report,
    ) -> Result<()> {
        self.assemble_flow(iteration, dt, voidage, points);
        let geometry = &self.geometry;
        conditions::constraints(
            &geometry.mesh,
            conditions,
            voidage,
            geometry.motion(),
            &mut self.constraints,
        );
        self.bodies.constrain(geometry, conditions, voidage, &mut self.constraints);
        let terms = boundary::BoundaryTerms { geometry, conditions, voidage };
        let mut through = terms.add_flow(self.properties.density, &self.state.velocity, &mut self.system);
        self.bodies.add_mass(geometry, conditions, voidage, (&mut self.system, &mut through));
        self.owners.fill(geometry, conditions);
        let held = self.constraints.iter().enumerate().filter(|(_, constraint)| constraint.is_some());
        self.kept.keep(&self.system, held.map(|(node, _)| node));
        boundary::apply_constraints(&self.constraints, &mut self.system);
        boundary::hold_images(&geometry.mesh, &mut self.system);
        let closed = !conditions.iter().any(|c| matches!(c.flow, FlowCondition::Open { .. }));
        if closed {
            boundary::close(&through, geometry, &mut self.system)?;
        }
        let start = if iteration == 0 { &self.state } else { &self.next };
        for (node, block) in self.unknown.chunks_exact_mut(B).enumerate() {
            block[..D].copy_from_slice(start.velocity[node].as_slice());
            block[D] = start.pressure[node];
        }
        self.bodies.at_rest(&mut self.unknown);
        let mut solve = |system: &System<B>, rhs: &[f64], x: &mut [f64]| {
            let solved = self.solver.solve(&system.matrix, rhs, x)?;
            report.flow_iterations += solved.iterations;
            report.residual = report.residual.max(solved.residual);
            report.factored |= solved.factored;
            Ok(())
        };
        solve(&self.system, &self.system.rhs, &mut self.unknown)?;
        if !self.bodies.is_empty() {
            self.bodies.release(
                (geometry, conditions, voidage),
                (&self.owners.fixed, &self.kept, closed),
                &self.system,
                &mut self.unknown,
                solve,
            )?;
        }
        self.geometry.mesh.periodic.mirror(self.unknown.as_chunks_mut::<B>().0);
        for (node, block) in self.unknown.chunks_exact(B).enumerate() {
            self.next.velocity[node].copy_from_slice(&block[..D]);
            self.next.pressure[node] = block[D];
        }
        if closed {
            self.centre_pressure();
        }
        Ok(())
    }

    fn assemble_flow(&mut self, iteration: usize, dt: f64, voidage: &[f64], points: Option<&Points<D>>) {
        let (geometry, sorted, fluid) = (&self.geometry, &self.sorted, &self.properties);
        let old = &self.state.velocity;
        let at = if iteration == 0 { old } else { &self.next.velocity };
        let (scalars, values) = (&self.scalars, &self.next.scalars);
        let (sources, density, shear) = (self.sources.as_ref(), &self.density, &self.shear);
        self.assembler.assemble(&mut self.system, |k, out| {
            let node = geometry.nodes(k);
            let element = geometry.elements[k];
            let moving = node.map(|n| geometry.velocity_of(n));
            let over_mesh = |u: &[Vector<D>]| std::array::from_fn(|a| u[node[a]] - moving[a]);
            let voidage = node.map(|n| voidage[n]);
            let (mass, load) = forms::Cell::integrals(&element, &voidage);
            let density = points.map(|_| node.map(|n| density[n]));
            let immersed = points.and_then(|points| CellExchange::gather(points, sorted, k, shear));
            let mut lightness = [1.0; B];
            for (Equation { scalar, .. }, value) in scalars.iter().zip(values) {
                for (light, n) in lightness.iter_mut().zip(node) {
                    *light -= scalar.expansion * (value[n] - scalar.reference);
                }
            }
            let weigh = |lightness: &[f64; B]| match points {
                Some(_) => forms::fluid_weight(element.measure, lightness, immersed.as_ref()),
                None => std::array::from_fn(|a| (0..B).map(|b| mass[a][b] * lightness[b]).sum()),
            };
            let pushed = if fluid.body_force == Vector::<D>::zeros() { [0.0; B] } else { weigh(&[1.0; B]) };
            let cell = forms::Cell {
                element,
                voidage,
                old: node.map(|n| old[n]),
                at: node.map(|n| at[n]),
                wind: over_mesh(at),
                direction: over_mesh(old).iter().sum::<Vector<D>>() / B as f64,
                lightness,
                weight: weigh(&lightness),
                pushed,
                exchange: immersed.as_ref(),
                density,
                source: sources.map(|s| (node.map(|n| s.momentum[n]), node.map(|n| s.mass[n]))),
                mass,
                load,
            };
            forms::assemble(&cell, fluid, dt, out);
        });
    }

    /// Moves the pressure of a closed domain to a mean of zero.
    fn centre_pressure(&mut self) {
        let nodal_volume = &self.geometry.nodal_volume;
        let volume: f64 = nodal_volume.iter().sum();
        let total: f64 = self.next.pressure.iter().zip(nodal_volume).map(|(p, v)| p * v).sum();
        self.next.pressure.iter_mut().for_each(|p| *p -= total / volume);
        // What the walls feel belongs to this level too.
        self.unknown.chunks_exact_mut(B).for_each(|block| block[D] -= total / volume);
    }
}

fn check_state<const D: usize>(state: &State<D>, nodes: usize, scalars: usize) -> Result<()> {
    let fits = state.velocity.len() == nodes
        && state.pressure.len() == nodes
        && state.scalars.len() == scalars
        && state.scalars.iter().all(|values| values.len() == nodes);
    match fits {
        true => Ok(()),
        false => Err(Error::Mesh(format!(
            "a state of {} velocities, {} pressures and {} scalars for {nodes} nodes and {scalars} scalars",
            state.velocity.len(),
            state.pressure.len(),
            state.scalars.len()
        ))),
    }
}
