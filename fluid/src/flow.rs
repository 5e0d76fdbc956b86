//! The fluid solver: state, one step, and what it reports.

use crate::assembly::{Assembler, System};
use crate::conditions::{self, Condition, FlowCondition, Hold};
use crate::exchange::{AtBodies, CellExchange, Exchange, NodalFields, PiecesByCell};
use crate::forms::{self, Properties};
use crate::geometry::{Geometry, MeshMotion};
use crate::linear::{self, Solver};
use crate::sums::Sums;
use crate::transport::{self, CellHeat, Scalar};
use crate::{Error, Mesh, Result, Vector, boundary};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Heat in the fluid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeatProperties {
    /// rho c, k and the walls of a thin cell.
    pub scalar: Scalar,
    /// Thermal expansion beta, 1/K.
    pub expansion: f64,
    /// Temperature T_R at which gravity acts on the density rho, K.
    pub reference: f64,
}

/// How the equations are solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Numerics {
    /// Newton steps of the convection per time step, at least 1.
    pub newton: usize,
    /// Linear solver of velocity and pressure.
    pub flow: linear::Options,
    /// Linear solver of the temperature.
    pub heat: linear::Options,
}

impl Default for Numerics {
    fn default() -> Self {
        let heat = linear::Options { method: linear::Method::Ilu, tolerance: 1e-10, ..Default::default() };
        Self { newton: 1, flow: linear::Options::default(), heat }
    }
}

/// Nodal values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State<const D: usize> {
    /// Velocity u, m/s.
    pub velocity: Vec<Vector<D>>,
    /// Pressure p, Pa.
    pub pressure: Vec<f64>,
    /// Temperature T, K; absent without heat.
    pub temperature: Option<Vec<f64>>,
}

/// Sources per volume at the nodes, for manufactured solutions.
#[derive(Clone, Debug)]
pub struct Sources<const D: usize> {
    /// Momentum, N/m3.
    pub momentum: Vec<Vector<D>>,
    /// Mass over density, 1/s.
    pub mass: Vec<f64>,
    /// Heat, W/m3; empty without heat.
    pub heat: Vec<f64>,
}

/// What a step reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Iterations of the linear solver of velocity and pressure, summed over the Newton steps.
    pub flow_iterations: usize,
    /// Iterations of the linear solver of the temperature.
    pub heat_iterations: usize,
    /// Relative residual of the last flow system.
    pub residual: f64,
    /// Whether the flow matrix was factored anew.
    pub factored: bool,
    /// Wall time of the energy equation, s.
    pub heat_s: f64,
    /// Wall time of momentum and mass, s.
    pub flow_s: f64,
}

/// Energy: its coefficients, system and solver.
struct Heat {
    properties: HeatProperties,
    system: System<1>,
    solver: Solver<1>,
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
    heat: Option<Heat>,
    holds: Vec<Option<Hold<D>>>,
    sorted: PiecesByCell,
    solid_flux: Vec<Vector<D>>,
    /// Constant part of the law of continuity at the pieces; only where there is one.
    at_pieces: Vec<Vector<D>>,
    unknown: Vec<f64>,
}

impl<const D: usize, const B: usize> Flow<D, B> {
    /// A solver on a mesh, starting from the given state (its temperature present exactly when `heat` is).
    ///
    /// # Errors
    /// Conditions that do not fit the mesh, flat or inverted cells.
    pub fn new(
        mesh: Mesh<D>,
        properties: Properties<D>,
        heat: Option<HeatProperties>,
        conditions: &[Condition<D>],
        state: State<D>,
        numerics: &Numerics,
    ) -> Result<Self> {
        conditions::check(&mesh, conditions)?;
        let nodes = mesh.points.len();
        let assembler = Assembler::new::<B>(nodes, &mesh.cells);
        let pattern = &assembler.pattern;
        let heat = heat.map(|properties| Heat {
            properties,
            system: System::new(pattern.clone()),
            solver: Solver::new(pattern.clone(), &mesh.points, numerics.heat),
        });
        Ok(Self {
            system: System::new(pattern.clone()),
            solver: Solver::new(pattern.clone(), &mesh.points, numerics.flow),
            solid_flux: Vec::new(),
            at_pieces: Vec::new(),
            unknown: vec![0.0; nodes * B],
            next: state.clone(),
            newton: numerics.newton.max(1),
            sources: None,
            holds: Vec::new(),
            sorted: PiecesByCell::default(),
            geometry: Geometry::new(mesh)?,
            properties,
            state,
            assembler,
            heat,
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

    /// Last accepted values.
    pub fn state(&self) -> &State<D> {
        &self.state
    }

    /// Sets the sources of the coming steps.
    pub fn set_sources(&mut self, sources: Option<Sources<D>>) {
        self.sources = sources;
    }

    /// Replaces the accepted values (a restart, an initial condition).
    pub fn set_state(&mut self, state: State<D>) {
        self.next = state.clone();
        self.state = state;
    }

    /// Drops all that the linear solvers keep between steps, so that what follows depends on the state only.
    pub fn forget(&mut self) {
        self.solver.forget();
        if let Some(heat) = &mut self.heat {
            heat.solver.forget();
        }
    }

    /// Makes the step in hand the last accepted one.
    pub fn accept(&mut self) {
        std::mem::swap(&mut self.state, &mut self.next);
    }

    /// Solves one step of `dt` from the last accepted state: energy, then momentum and mass.
    ///
    /// `voidage` is nodal; `exchange` describes the immersed bodies, none without them.
    ///
    /// # Errors
    /// A linear system without a solution, or prescribed fluxes that do not balance in a closed domain.
    pub fn solve(
        &mut self,
        dt: f64,
        voidage: &[f64],
        exchange: Option<&Exchange<'_, D>>,
        conditions: &[Condition<D>],
    ) -> Result<Report> {
        match exchange {
            Some(load) => self.sorted.sort(load.pieces, self.geometry.elements.len()),
            None => self.sorted.clear(),
        }
        let mut report = Report::default();
        if self.heat.is_some() {
            let start = Instant::now();
            self.solve_heat(dt, voidage, exchange, conditions, &mut report)?;
            report.heat_s = start.elapsed().as_secs_f64();
        }
        let start = Instant::now();
        self.project_solid_flux(dt, voidage, exchange);
        for iteration in 0..self.newton {
            self.newton_step(iteration, dt, voidage, exchange, conditions, &mut report)?;
        }
        report.flow_s = start.elapsed().as_secs_f64();
        Ok(report)
    }

    /// Means of the step in hand at the bodies.
    pub fn sample(&self, pieces: &crate::exchange::Pieces<D>, at: &mut AtBodies<D>) {
        let fields = NodalFields {
            velocity: &self.next.velocity,
            pressure: &self.next.pressure,
            temperature: self.next.temperature.as_deref(),
            gradient: &self.geometry.gradient,
        };
        at.sample::<B>(&self.geometry.mesh, pieces, &fields);
    }

    /// Force (N) and heat (W) that the fluid gives to the bodies in the step in hand, summed piece by piece:
    /// the counterpart, by another path, of what the affine law gives each body.
    pub fn exchanged(&self, load: &Exchange<'_, D>) -> (Vector<D>, f64) {
        Sums { geometry: &self.geometry, state: &self.next, load }.exchanged()
    }

    fn solve_heat(
        &mut self,
        dt: f64,
        voidage: &[f64],
        exchange: Option<&Exchange<'_, D>>,
        conditions: &[Condition<D>],
        report: &mut Report,
    ) -> Result<()> {
        let Some(heat) = &mut self.heat else { return Ok(()) };
        let (Some(old), Some(next)) = (&self.state.temperature, &mut self.next.temperature) else {
            return Err(Error::Mesh("heat without an initial temperature".into()));
        };
        let (geometry, sorted, state) = (&self.geometry, &self.sorted, &self.state);
        let wind = |node: usize| state.velocity[node] - geometry.velocity_of(node);
        let sources = self.sources.as_ref();
        let scalar = &heat.properties.scalar;
        let bodies = exchange.and_then(|load| load.heat.map(|columns| (load.pieces, columns)));
        self.assembler.assemble(&mut heat.system, |cell, out| {
            let node = geometry.nodes(cell);
            let cell = transport::Cell {
                element: geometry.elements[cell],
                voidage: node.map(|n| voidage[n]),
                velocity: node.map(wind),
                old: node.map(|n| old[n]),
                exchange: bodies
                    .and_then(|(pieces, columns)| CellHeat::gather(pieces, &columns, sorted, cell)),
                source: sources.map(|s| node.map(|n| s.heat[n])),
            };
            transport::assemble(&cell, scalar, dt, out);
        });
        let mesh = &geometry.mesh;
        boundary::add_heat(mesh, conditions, scalar.capacity, voidage, wind, &mut heat.system);
        if scalar.monotone {
            heat.system.upwind();
        }
        boundary::apply_temperatures(mesh, conditions, &mut heat.system);
        next.copy_from_slice(old);
        let solved = heat.solver.solve(&heat.system.matrix, &heat.system.rhs, next)?;
        report.heat_iterations = solved.iterations;
        Ok(())
    }

    /// Nodal projection (A.15) of the solid flux phi v, with v the law of the bodies in the equation of mass at the
    /// last accepted fluid state.
    fn project_solid_flux(&mut self, dt: f64, voidage: &[f64], exchange: Option<&Exchange<'_, D>>) {
        self.solid_flux.clear();
        if let Some(load) = exchange {
            let sums = Sums { geometry: &self.geometry, state: &self.state, load };
            if let Some(law) = &load.continuity {
                sums.rigid(law, (voidage, self.properties.density, dt), &mut self.at_pieces);
            }
            let at_pieces = load.continuity.map(|_| self.at_pieces.as_slice());
            self.solid_flux.resize(self.state.velocity.len(), Vector::zeros());
            sums.solid_flux(at_pieces, &mut self.solid_flux);
        }
    }

    fn newton_step(
        &mut self,
        iteration: usize,
        dt: f64,
        voidage: &[f64],
        exchange: Option<&Exchange<'_, D>>,
        conditions: &[Condition<D>],
        report: &mut Report,
    ) -> Result<()> {
        self.assemble_flow(iteration, dt, voidage, exchange);
        let geometry = &self.geometry;
        conditions::holds(&geometry.mesh, conditions, voidage, geometry.motion(), &mut self.holds);
        let around = boundary::Around { geometry, conditions, voidage };
        let through = around.add_flow(self.properties.density, &self.state.velocity, &mut self.system);
        boundary::apply_holds(&self.holds, &mut self.system);
        let closed = !conditions.iter().any(|c| matches!(c.flow, FlowCondition::Open { .. }));
        if closed {
            let mass = self.sources.as_ref().map_or(0.0, |sources| {
                geometry.nodal_volume.iter().zip(&sources.mass).map(|(volume, mass)| volume * mass).sum()
            });
            boundary::close(&through, mass, geometry, &mut self.system)?;
        }
        let start = if iteration == 0 { &self.state } else { &self.next };
        for (node, block) in self.unknown.chunks_exact_mut(B).enumerate() {
            block[..D].copy_from_slice(start.velocity[node].as_slice());
            block[D] = start.pressure[node];
        }
        let solved = self.solver.solve(&self.system.matrix, &self.system.rhs, &mut self.unknown)?;
        report.flow_iterations += solved.iterations;
        report.residual = solved.residual;
        report.factored |= solved.factored;
        for (node, block) in self.unknown.chunks_exact(B).enumerate() {
            self.next.velocity[node].copy_from_slice(&block[..D]);
            self.next.pressure[node] = block[D];
        }
        if closed {
            self.centre_pressure();
        }
        Ok(())
    }

    fn assemble_flow(
        &mut self,
        iteration: usize,
        dt: f64,
        voidage: &[f64],
        exchange: Option<&Exchange<'_, D>>,
    ) {
        let (geometry, sorted, fluid) = (&self.geometry, &self.sorted, &self.properties);
        let old = &self.state.velocity;
        let at = if iteration == 0 { old } else { &self.next.velocity };
        let buoyancy = self.heat.as_ref().zip(self.next.temperature.as_ref());
        let (sources, flux, at_pieces) = (self.sources.as_ref(), &self.solid_flux, &self.at_pieces);
        self.assembler.assemble(&mut self.system, |k, out| {
            let node = geometry.nodes(k);
            let element = geometry.elements[k];
            let moving = node.map(|n| geometry.velocity_of(n));
            let over_mesh = |u: &[Vector<D>]| std::array::from_fn(|a| u[node[a]] - moving[a]);
            let voidage = node.map(|n| voidage[n]);
            let (mass, load) = forms::Cell::integrals(&element, &voidage);
            let bodies = exchange.and_then(|load| {
                let at_pieces = load.continuity.map(|_| at_pieces.as_slice());
                CellExchange::gather(load, sorted, at_pieces, k)
            });
            let solid_divergence = match flux.is_empty() {
                true => 0.0,
                false => (0..B).map(|a| flux[node[a]].dot(&element.gradient[a])).sum(),
            };
            let lightness = buoyancy.map_or([1.0; B], |(heat, temperature)| {
                node.map(|n| 1.0 - heat.properties.expansion * (temperature[n] - heat.properties.reference))
            });
            let weight = match exchange {
                Some(_) => forms::fluid_weight(element.measure, &lightness, bodies.as_ref()),
                None => std::array::from_fn(|a| (0..B).map(|b| mass[a][b] * lightness[b]).sum()),
            };
            let cell = forms::Cell {
                element,
                voidage,
                old: node.map(|n| old[n]),
                at: node.map(|n| at[n]),
                wind: over_mesh(at),
                direction: over_mesh(old).iter().sum::<Vector<D>>() / B as f64,
                weight,
                solid_divergence,
                exchange: bodies.as_ref(),
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
    }
}
