"""The fluid in FEniCSx: volume-averaged Navier-Stokes with scalars, stabilised P1-P1 elements.

    <eps rho Du/Dt, v> + <sigma, grad v> + <gamma_l u, v> - <f_p, v>
        - <eps rho g (1 - sum beta (s - s_R)), v>
        + sum_e xi <R_u, (U . grad) v>_e + sum_e rho xi_c <R_p, div v>_e = <<sigma n, v>>
    <div(phi v*), q> + <div(eps u), q> + sum_e (xi / rho) <R_u, grad q>_e = 0
    <eps C Ds/Dt, S> + <eps k grad s, grad S> - <q_p + q_l, S>
        + sum_e xi_T <R_s, U . grad S>_e = what the boundary gives of scalar s

Backward Euler from u_n; the convection is linearised about a velocity w, once (w = u_n) or more
often; U is u_n - u_mesh at the centroid, D/Dt = d/dt + (u - u_mesh) . grad. The scalars are solved
first, with u_n. The terms of the points come from :mod:`voidage.points`, those of the boundary from
:mod:`voidage.boundary`.
"""

from typing import Literal

# fenicsx_linear starts PETSc, so it comes before dolfinx.
from .fenicsx_linear import Coefficients, Layout, Linear, Load  # isort: skip
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl import div, dot, grad, inner, transpose

from . import compat
from .finite_elements import Beside, FiniteElements, FlowData, FlowForm, ScalarForm
from .solver import Floats, Problem, Report, Step

QUADRATURE = {"quadrature_degree": 4}
"""All terms of cells are polynomials of this degree at most."""


class FEniCSx(FiniteElements):
    """The solver on one mesh. Unknowns of a node are a block of D + 1, the pressure last. Terms of a
    subclass are called once for every mesh, with expressions of UFL: what changes from step to step is a
    ``fem.Constant`` or a ``fem.Function`` of the subclass, given its values at the start of ``solve``.

    Parameters
    ----------
    linear
        ``direct``: MUMPS with one step of iterative refinement. ``iterative``: GMRES, for the flow
        with a Schur complement of the velocity, multigrid (hypre, or PETSc's own) in every block.
    """

    def __init__(self, linear: Literal["direct", "iterative"] = "direct"):
        self.comm, self.linear = MPI.COMM_WORLD, linear

    def set_mesh(self, problem: Problem) -> None:
        self.layout = Layout(compat.create_mesh(self.comm, problem.cells, problem.points), problem)
        super().set_mesh(problem)
        iterative = self.linear == "iterative"
        self.flow = FlowSystem(self.layout, problem, iterative, self)
        count = len(problem.scalars)
        self.scalars = [ScalarSystem(self.layout, problem, k, iterative, self) for k in range(count)]

    def _place(self, problem: Problem) -> None:
        super()._place(problem)
        self.layout.move(problem.points)

    def _scalar(
        self, k: int, step: Step, wind: Floats, xi_U: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        system, old, source = self.scalars[k], self.state.scalars[k], step.sources.scalars[k]
        system.time_step.value = step.dt
        system.known.fill(eps=step.voidage, wind=wind, old=old, source=source, xi_U=xi_U)
        return system.linear.solve(beside, report)

    def _flow(
        self, step: Step, data: FlowData, about: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        self.flow.time_step.value = step.dt
        self.flow.known.fill(
            eps=step.voidage,
            old=self.state.velocity,
            at=about,
            wind=about - step.motion.velocity,
            source_u=step.sources.momentum,
            source_p=step.sources.mass,
            **data._asdict(),
        )
        return self.flow.linear.solve(beside, report)


    def _uniform(self, step: Step) -> Floats:
        old, flow = self.state.velocity, self.flow
        flow.time_step.value = step.dt
        cells, found = len(self.cells.measure), np.empty_like(old)
        # Without the stabilisation, w is v.
        flow.known.fill(eps=step.voidage, old=old, at=old, xi=np.zeros(cells), xi_U=np.zeros((cells, old.shape[1])))
        for i, direction in enumerate(np.eye(1 + old.shape[1])[:-1]):
            flow.known.fill(uniform=np.tile(direction, (len(old), 1)))
            found[:, i] = flow.of_uniform.assemble()[:, i]
        return found


class FlowSystem:
    """Forms of momentum and mass, with the terms of a solver."""

    def __init__(self, layout: Layout, problem: Problem, iterative: bool, solver: FiniteElements):
        D, domain = problem.dimension, layout.domain
        mixed = compat.space(domain, "Lagrange", 1, D + 1)
        trial, test = ufl.TrialFunction(mixed), ufl.TestFunction(mixed)
        u, p = ufl.as_vector([trial[i] for i in range(D)]), trial[D]
        v, q = ufl.as_vector([test[i] for i in range(D)]), test[D]
        self.time_step = dt = fem.Constant(domain, 1.0)
        constants = problem.density, problem.viscosity, problem.thin_cell_drag
        rho, eta, thin = (fem.Constant(domain, value) for value in constants)
        self.known = known = Coefficients(layout)
        eps, share, source_p = known.nodal("eps", "share", "source_p")
        old, at, wind = known.nodal("old", "at", "wind", components=D)
        weight, solid_flux, source_u = known.nodal("weight", "solid_flux", "source_u", components=D)
        xi, xi_c = known.cellwise("xi", "xi_c")
        (xi_U,) = known.cellwise("xi_U", components=D)

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
        )
        force = eps * rho * (old / dt + dot(grad(at), at)) + share * weight + source_u
        rhs = (
            dot(force, v + weighed)
            + source_p * q
            + rho * xi_c * (source_p - div(solid_flux)) * div(v)
        )
        x, dx = ufl.SpatialCoordinate(domain), ufl.dx(domain=domain, metadata=QUADRATURE)
        form = FlowForm(u, p, v, q, v + weighed, x, eps, old, at, dt, problem)
        terms, loads = solver.terms(form), solver.loads(form._replace(u=None, p=None))
        matrix = matrix if terms is None else matrix + terms
        rhs = rhs if loads is None else rhs + loads
        self.linear = Linear(layout, matrix * dx, rhs * dx, iterative)
        if terms is not None:
            (uniform,) = known.nodal("uniform", components=D + 1)
            self.of_uniform = Load(layout, ufl.replace(terms * dx, {trial: uniform}))


class ScalarSystem:
    """Forms of the equation of a scalar, with the terms of a solver."""

    def __init__(
        self, layout: Layout, problem: Problem, k: int, iterative: bool, solver: FiniteElements
    ):
        domain, scalar = layout.domain, problem.scalars[k]
        s, S = ufl.TrialFunction(layout.space), ufl.TestFunction(layout.space)
        self.time_step = dt = fem.Constant(domain, 1.0)
        constants = scalar.capacity, scalar.conductivity, scalar.wall_coefficient, scalar.wall_value
        C, K, wall, wall_value = (fem.Constant(domain, value) for value in constants)
        self.known = known = Coefficients(layout)
        eps, old, source = known.nodal("eps", "old", "source")
        (wind,) = known.nodal("wind", components=problem.dimension)
        (xi_U,) = known.cellwise("xi_U", components=problem.dimension)

        along = dot(xi_U, grad(S))
        stored, carried = (eps * C / dt + wall) * s, eps * C * dot(wind, grad(s))
        residual = stored + carried - K * dot(grad(eps), grad(s))
        held = eps * C * old / dt + wall * wall_value
        matrix = carried * S + eps * K * dot(grad(s), grad(S)) + residual * along
        rhs = held * along + source * (S + along)
        if scalar.form == "consistent":
            matrix, rhs = matrix + stored * S, rhs + held * S
        form = ScalarForm(s, S, S + along, ufl.SpatialCoordinate(domain), eps, old, wind, k, dt, problem)
        terms, loads = solver.scalar_terms(form), solver.scalar_loads(form._replace(s=None))
        matrix = matrix if terms is None else matrix + terms
        rhs = rhs if loads is None else rhs + loads
        dx, monotone = ufl.dx(domain=domain, metadata=QUADRATURE), scalar.form == "monotone"
        self.linear = Linear(layout, matrix * dx, rhs * dx, iterative, monotone)


if __name__ == "__main__":
    import sys

    from .adapter import main

    sys.exit(main(FEniCSx))
