"""The fluid in FEniCSx: volume-averaged Navier-Stokes with scalars, stabilised P1-P1 elements.

    <eps rho Du/Dt, v> + <sigma, grad v> + <gamma_l u, v> - <f_p, v>
        - <eps rho g (1 - sum beta (s - s_R)), v>
        + sum_e xi <R_u, (U . grad) v>_e + sum_e rho xi_c <R_p, div v>_e = <<sigma n, v>>
    <div(phi v*), q> + <div(eps u), q> + sum_e (xi / rho) <R_u, grad q>_e = 0
    <eps C Ds/Dt, S> + <eps k grad s, grad S> - <q_p + q_l, S>
        + sum_e xi_T <R_s, U . grad S>_e = what the boundary gives of scalar s

Backward Euler from u_n; the convection is linearised about a velocity w, once (w = u_n) or more
often; U is u_n - u_mesh at the centroid, D/Dt = d/dt + (u - u_mesh) . grad. The scalars are solved
first, with u_n. The terms of the points come from :mod:`voidage.points`.
"""

from typing import Literal

# fenicsx_linear starts PETSc, so it comes before dolfinx.
from .fenicsx_linear import Blocks, Layout, Linear  # isort: skip
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl import div, dot, grad, inner, transpose

from . import compat
from .boundary import hold_flow, hold_scalar, passing
from .finite_elements import FiniteElements, FlowData
from .points import PointSums
from .solver import (
    Condition,
    Floats,
    Open,
    Outflow,
    Problem,
    Report,
    Step,
    Transfer,
)

QUADRATURE = {"quadrature_degree": 4}
"""For cells and for facets, where it matters: the upwind terms are no polynomials."""
VERTICES = {"quadrature_rule": "vertex", "quadrature_degree": 1}
"""The rule that lumps storage and exchange of a scalar."""


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
        self.systems: dict[tuple, FlowSystem | ScalarSystem] = {}

    def _move(self, points: Floats) -> None:
        super()._move(points)
        self.layout.move(points)

    def _scalar(
        self, k: int, step: Step, sums: PointSums, report: Report
    ) -> tuple[Floats, Floats]:
        kinds = tuple((c.boundary, _transfers(c, k)) for c in step.conditions)
        system = self._system(ScalarSystem, k, kinds, step)
        U, xi = self._scalar_stabilisation(k, step)
        system.fill(step, self.state.scalars[k], xi[:, None] * U)
        lumped = self.problem.scalars[k].form != "consistent"
        blocks = Blocks(sums.cells, *sums.scalar(k, U, xi, lumped))
        held = hold_scalar(self.problem, step.conditions, k)
        s, left, _ = system.linear.solve(blocks, *held, report)
        return s[:, 0], left[:, 0]

    def _flow(
        self, step: Step, sums: PointSums, data: FlowData, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        kinds = tuple((c.boundary, isinstance(c.flow, Open)) for c in step.conditions)
        system = self._system(FlowSystem, None, kinds, step)
        free, value, spread = hold_flow(self.problem, self.cells, step)
        system.fill(step, data, about, spread)
        points = sums.flow(data.stabilisation, self.problem.density, data.weight)
        blocks = Blocks(sums.cells, *points)
        x, left, report.residual = system.linear.solve(blocks, free, value, report)
        return x, left

    def _system(self, make, k: int | None, kinds: tuple, step: Step):
        """The forms for these kinds of conditions, of scalar k or of the flow, made once; fills in
        what all have in common."""
        parts = k, kinds, step.sources is not None, step.motion is not None
        if parts not in self.systems:
            self.systems[parts] = make(self, *parts)
        self.time_step.value = step.dt
        if step.motion is not None:
            self.layout.fill(self.mesh_velocity, step.motion.velocity)
        self.layout.fill(self.eps, step.voidage)
        self.layout.fill(self.old, self.state.velocity)
        return self.systems[parts]


class FlowSystem:
    """Forms of momentum and mass for one set of open boundaries."""

    def __init__(
        self,
        solver: FEniCSx,
        _: None,
        kinds: tuple[tuple[str, bool], ...],
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
        self.passing = {
            name: (layout.nodal(), layout.nodal(D)) for name, is_open in kinds if not is_open
        }
        self.share, self.xi, self.xi_c = layout.nodal(), layout.cellwise(), layout.cellwise()
        self.xi_U, self.source_u, self.source_p = (
            layout.cellwise(D),
            layout.nodal(D),
            layout.nodal(),
        )
        self.pressure = {
            name: fem.Constant(layout.domain, 0.0) for name, is_open in kinds if is_open
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
        for name, is_open in kinds:
            part = ds(solver.part[name])
            if is_open:
                matrix += eps * dot(u, n) * q * part
                matrix -= rho * eps * ufl.min_value(dot(inflow, n), 0) * dot(u, v) * part
                rhs -= self.pressure[name] * dot(n, v) * part
            else:
                share, velocity = self.passing[name]
                rhs -= share * dot(velocity, n) * q * part
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
                known = passing(self.problem, condition, step)
                for field, values in zip(self.passing[condition.boundary], known, strict=True):
                    self.layout.fill(field, values)


class ScalarSystem:
    """Forms of the equation of a scalar for one set of boundaries that exchange it."""

    def __init__(
        self,
        solver: FEniCSx,
        k: int,
        kinds: tuple[tuple[str, type | None], ...],
        sources: bool,
        moving: bool,
    ):
        layout, dx, ds, n = solver.layout, solver.dx, solver.ds, solver.normal
        scalar, self.layout, self.k = solver.problem.scalars[k], layout, k
        s, S = ufl.TrialFunction(layout.space), ufl.TestFunction(layout.space)
        dt, eps, u = solver.time_step, solver.eps, solver.old
        if moving:
            u = u - solver.mesh_velocity
        C, K, wall, wall_value = (
            fem.Constant(layout.domain, value)
            for value in (
                scalar.capacity,
                scalar.conductivity,
                scalar.wall_coefficient,
                scalar.wall_value,
            )
        )
        self.old, self.source = layout.nodal(), layout.nodal()
        self.xi_U = layout.cellwise(solver.problem.dimension)
        self.outside = {
            name: [fem.Constant(layout.domain, 0.0) for _ in range(2)]
            for name, kind in kinds
            if kind is not None
        }

        along = dot(self.xi_U, grad(S))
        stored, carried = (eps * C / dt + wall) * s, eps * C * dot(u, grad(s))
        residual = stored + carried - K * dot(grad(eps), grad(s))
        points = dx if scalar.form == "consistent" else dx(metadata=VERTICES)
        matrix = stored * S * points + residual * along * dx
        matrix += (carried * S + eps * K * dot(grad(s), grad(S))) * dx
        known = eps * C * self.old / dt + wall * wall_value
        rhs = known * S * points + known * along * dx
        if sources:
            rhs += self.source * (S + along) * dx
        for name, kind in kinds:
            if kind is not None:
                coefficient, outside = self.outside[name]
                if kind is Outflow:
                    coefficient = -C * eps * ufl.min_value(dot(u, n), 0)
                matrix += coefficient * s * S * ds(solver.part[name])
                rhs += coefficient * outside * S * ds(solver.part[name])
        monotone = scalar.form == "monotone"
        self.linear = Linear(layout, matrix, rhs, solver.linear == "iterative", monotone)

    def fill(self, step: Step, old: Floats, xi_U: Floats) -> None:
        """Takes the coefficients of a step."""
        self.layout.fill(self.old, old)
        self.layout.fill_cells(self.xi_U, xi_U)
        if step.sources is not None:
            self.layout.fill(self.source, step.sources.scalars[self.k])
        for condition in step.conditions:
            if condition.boundary in self.outside:
                coefficient, outside = self.outside[condition.boundary]
                given = condition.scalar(self.k)
                outside.value = given.outside
                if isinstance(given, Transfer):
                    coefficient.value = given.coefficient


def _transfers(condition: Condition, k: int) -> type | None:
    """The kind of a condition that adds a term to the equation of scalar k."""
    match condition.scalar(k):
        case Transfer():
            return Transfer
        case Outflow(outside) if outside is not None:
            return Outflow
    return None


if __name__ == "__main__":
    import sys

    from .adapter import main

    sys.exit(main(FEniCSx))
