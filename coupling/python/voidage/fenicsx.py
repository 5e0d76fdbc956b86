"""The fluid in FEniCSx: volume-averaged Navier-Stokes with heat, stabilised P1-P1 elements.

    <eps rho Du/Dt, v> + <sigma, grad v> + <gamma_l u, v> - <f_p, v>
        - <eps rho g (1 - beta (T - T_R)), v>
        + sum_e xi <R_u, (U . grad) v>_e + sum_e rho xi_c <R_p, div v>_e = <<sigma n, v>>
    <div(phi v*), q> + <div(eps u), q> + sum_e (xi / rho) <R_u, grad q>_e = 0
    <eps C DT/Dt, S> + <eps k grad T, grad S> - <q_p + q_l, S>
        + sum_e xi_T <R_T, U . grad S>_e = boundary heat

Backward Euler from u_n; the convection is linearised about a velocity w, once (w = u_n) or more
often; U is u_n - u_mesh at the centroid, D/Dt = d/dt + (u - u_mesh) . grad. The energy is solved
first, with u_n. The terms of the grains come from :mod:`voidage.pieces`.
"""

from typing import Literal

# fenicsx_linear starts PETSc, so it comes before dolfinx.
from .fenicsx_linear import Blocks, Layout, Linear  # isort: skip
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl import div, dot, grad, inner, transpose

from . import compat
from .boundary import hold_flow, hold_heat, passing
from .finite_elements import FiniteElements, FlowData
from .pieces import PieceSums
from .solver import (
    Condition,
    Floats,
    Newton,
    Open,
    OpenHeat,
    Problem,
    Report,
    Step,
    Velocity,
)

QUADRATURE = {"quadrature_degree": 4}
"""For cells and for facets, where it matters: the upwind terms are no polynomials."""
VERTICES = {"quadrature_rule": "vertex", "quadrature_degree": 1}
"""The rule that lumps storage and exchange of heat."""


class FEniCSx(FiniteElements):
    """The solver on one mesh. Unknowns of a node are a block of D + 1, the pressure last.

    Parameters
    ----------
    linear
        ``direct``: MUMPS with one step of iterative refinement. ``iterative``: GMRES, for the flow
        with a Schur complement of the velocity, multigrid (hypre) in every block.
    """

    def __init__(self, linear: Literal["direct", "iterative"] = "direct"):
        self.comm, self.linear = MPI.COMM_WORLD, linear

    def set_mesh(self, problem: Problem) -> None:
        super().set_mesh(problem)
        domain = compat.create_mesh(self.comm, problem.cells, problem.points)
        self.layout = layout = Layout(domain, problem)
        self.dx = ufl.dx(domain=domain, metadata=QUADRATURE)
        self.normal = ufl.FacetNormal(domain)
        self.part = {name: k for k, name in enumerate(problem.boundaries)}
        tags = layout.facet_tags(problem)
        self.ds = ufl.ds(domain=domain, subdomain_data=tags, metadata=QUADRATURE)
        self.time_step = fem.Constant(domain, 1.0)
        self.eps, self.old = layout.nodal(), layout.nodal(problem.dimension)
        self.mesh_velocity = layout.nodal(problem.dimension)
        self.systems: dict[tuple, FlowSystem | HeatSystem] = {}

    def _move(self, points: Floats) -> None:
        super()._move(points)
        self.layout.move(points)

    def _energy(self, step: Step, sums: PieceSums | None, report: Report) -> Floats:
        kinds = tuple((c.boundary, _transfers_heat(c)) for c in step.conditions)
        system = self._system(HeatSystem, kinds, step)
        U, xi = self.heat_stabilisation(step)
        system.fill(step, self.state.temperature, xi[:, None] * U)
        blocks = None
        if sums is not None and sums.heated:
            blocks = Blocks(sums.cells, *sums.energy(U, xi, self.problem.heat.lumped))
        T, _ = system.linear.solve(blocks, *hold_heat(self.problem, step.conditions), report)
        return T[:, 0]

    def _flow(
        self, step: Step, sums: PieceSums | None, data: FlowData, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        kinds = tuple(
            (c.boundary, isinstance(c.flow, Open), isinstance(c.flow, Velocity))
            for c in step.conditions
        )
        system = self._system(FlowSystem, kinds, step)
        free, value, spread = hold_flow(self.problem, self.cells, step)
        system.fill(step, data, about, spread)
        blocks = None
        if sums is not None:
            grains = sums.flow(data.stabilisation, self.problem.density, data.weight)
            blocks = Blocks(sums.cells, *grains)
        x, report.residual = system.linear.solve(blocks, free, value, report)
        return x[:, :-1].copy(), x[:, -1].copy()

    def _system(self, make, kinds: tuple, step: Step):
        """The forms for these kinds of conditions, made once; fills in what all have in common."""
        parts = kinds, step.sources is not None, step.motion is not None
        key = make, *parts
        if key not in self.systems:
            self.systems[key] = make(self, *parts)
        self.time_step.value = step.dt
        if step.motion is not None:
            self.layout.fill(self.mesh_velocity, step.motion.velocity)
        self.layout.fill(self.eps, step.voidage)
        self.layout.fill(self.old, self.state.velocity)
        return self.systems[key]


class FlowSystem:
    """Forms of momentum and mass for one set of open boundaries and walls."""

    def __init__(
        self,
        solver: FEniCSx,
        kinds: tuple[tuple[str, bool, bool], ...],
        sources: bool,
        moving: bool,
    ):
        problem, layout, dx, ds, n = (
            solver.problem,
            solver.layout,
            solver.dx,
            solver.ds,
            solver.normal,
        )
        D, self.layout = problem.dimension, layout
        mixed = compat.space(layout.domain, "Lagrange", 1, D + 1)
        trial, test = ufl.TrialFunction(mixed), ufl.TestFunction(mixed)
        u, p = ufl.as_vector([trial[i] for i in range(D)]), trial[D]
        v, q = ufl.as_vector([test[i] for i in range(D)]), test[D]
        dt, eps, old = solver.time_step, solver.eps, solver.old
        rho, eta, thin = (
            fem.Constant(layout.domain, value)
            for value in (problem.density, problem.viscosity, problem.thin_cell_drag)
        )
        self.problem = problem
        self.at, self.weight, self.solid_flux = (layout.nodal(D) for _ in range(3))
        self.passing = {name: layout.nodal(D) for name, is_open, _ in kinds if not is_open}
        self.share, self.xi, self.xi_c = layout.nodal(), layout.cellwise(), layout.cellwise()
        self.xi_U, self.source_u, self.source_p = (
            layout.cellwise(D),
            layout.nodal(D),
            layout.nodal(),
        )
        self.pressure = {
            name: fem.Constant(layout.domain, 0.0) for name, is_open, _ in kinds if is_open
        }
        self.spread = fem.Constant(layout.domain, 0.0)
        at, xi, xi_c, xi_U = self.at, self.xi, self.xi_c, self.xi_U
        wind, inflow = at, old
        if moving:
            wind, inflow = at - solver.mesh_velocity, old - solver.mesh_velocity

        rate = eps * rho * (u / dt + dot(grad(u), wind) + dot(grad(at), u)) + thin * u
        strain = grad(u) + transpose(grad(u))
        residual = rate + grad(p) - eta * dot(strain, grad(eps))
        weighed = dot(grad(v), xi_U) + xi / rho * grad(q)
        matrix = (
            dot(rate, v)
            + eps * eta * inner(strain, grad(v))
            - p * div(v)
            - eps * dot(u, grad(q))
            + dot(residual, weighed)
            + rho * xi_c * div(eps * u) * div(v)
        ) * dx
        force = eps * rho * (old / dt + dot(grad(at), at)) + self.share * self.weight
        rhs = (dot(force, v + weighed) + self.spread * q) * dx
        rhs -= rho * xi_c * div(self.solid_flux) * div(v) * dx
        if sources:
            rhs += (
                dot(self.source_u, v + weighed) * dx
                + self.source_p * (q + rho * xi_c * div(v)) * dx
            )
        for name, is_open, of_fluid in kinds:
            part = ds(solver.part[name])
            if is_open:
                matrix += eps * dot(u, n) * q * part
                matrix -= rho * eps * ufl.min_value(dot(inflow, n), 0) * dot(u, v) * part
                rhs -= self.pressure[name] * dot(n, v) * part
                continue
            rhs -= (eps if of_fluid else 1) * dot(self.passing[name], n) * q * part
        self.linear = Linear(layout, matrix, rhs, solver.linear == "iterative")

    def fill(self, step: Step, data: FlowData, about: Floats, spread: float) -> None:
        """Takes the coefficients of a Newton step."""
        self.spread.value = spread
        nodal = [
            (self.at, about),
            (self.weight, data.weight),
            (self.share, data.share),
            (self.solid_flux, data.solid_flux),
        ]
        if step.sources is not None:
            nodal += [(self.source_u, step.sources.momentum), (self.source_p, step.sources.mass)]
        for field, values in nodal:
            self.layout.fill(field, values)
        tau = data.stabilisation
        self.layout.fill_cells(self.xi, tau.time)
        self.layout.fill_cells(self.xi_c, tau.incompressibility)
        self.layout.fill_cells(self.xi_U, tau.time[:, None] * tau.direction)
        for condition in step.conditions:
            if isinstance(condition.flow, Open):
                self.pressure[condition.boundary].value = condition.flow.pressure
            else:
                velocity, _ = passing(self.problem, condition, step.motion)
                self.layout.fill(self.passing[condition.boundary], velocity)


class HeatSystem:
    """Forms of the energy equation for one set of boundaries that exchange heat."""

    def __init__(
        self,
        solver: FEniCSx,
        kinds: tuple[tuple[str, type | None], ...],
        sources: bool,
        moving: bool,
    ):
        layout, dx, ds, n, heat = (
            solver.layout,
            solver.dx,
            solver.ds,
            solver.normal,
            solver.problem.heat,
        )
        self.layout = layout
        T, S = ufl.TrialFunction(layout.space), ufl.TestFunction(layout.space)
        dt, eps, u = solver.time_step, solver.eps, solver.old
        if moving:
            u = u - solver.mesh_velocity
        C, k, wall, wall_T = (
            fem.Constant(layout.domain, value)
            for value in (
                heat.capacity,
                heat.conductivity,
                heat.wall_coefficient,
                heat.wall_temperature,
            )
        )
        self.old, self.source = layout.nodal(), layout.nodal()
        self.xi_U = layout.cellwise(solver.problem.dimension)
        self.wall = {
            name: [fem.Constant(layout.domain, 0.0) for _ in range(2)]
            for name, kind in kinds
            if kind is not None
        }

        along = dot(self.xi_U, grad(S))
        stored, carried = (eps * C / dt + wall) * T, eps * C * dot(u, grad(T))
        residual = stored + carried - k * dot(grad(eps), grad(T))
        points = dx(metadata=VERTICES) if heat.lumped else dx
        matrix = stored * S * points + residual * along * dx
        matrix += (carried * S + eps * k * dot(grad(T), grad(S))) * dx
        known = eps * C * self.old / dt + wall * wall_T
        rhs = known * S * points + known * along * dx
        if sources:
            rhs += self.source * (S + along) * dx
        for name, kind in kinds:
            if kind is not None:
                coefficient, outside = self.wall[name]
                if kind is OpenHeat:
                    coefficient = -C * eps * ufl.min_value(dot(u, n), 0)
                matrix += coefficient * T * S * ds(solver.part[name])
                rhs += coefficient * outside * S * ds(solver.part[name])
        self.linear = Linear(layout, matrix, rhs, solver.linear == "iterative", heat.monotone)

    def fill(self, step: Step, old: Floats, xi_U: Floats) -> None:
        """Takes the coefficients of a step."""
        self.layout.fill(self.old, old)
        self.layout.fill_cells(self.xi_U, xi_U)
        if step.sources is not None:
            self.layout.fill(self.source, step.sources.heat)
        for condition in step.conditions:
            if condition.boundary in self.wall:
                coefficient, outside = self.wall[condition.boundary]
                outside.value = condition.heat.temperature
                if isinstance(condition.heat, Newton):
                    coefficient.value = condition.heat.coefficient


def _transfers_heat(condition: Condition) -> type | None:
    """The kind of a condition that adds a term to the energy equation."""
    match condition.heat:
        case Newton():
            return Newton
        case OpenHeat(temperature) if temperature is not None:
            return OpenHeat
    return None


if __name__ == "__main__":
    import sys

    from .adapter import main

    sys.exit(main(FEniCSx))
