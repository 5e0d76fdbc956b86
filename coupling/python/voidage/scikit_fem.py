"""The fluid in scikit-fem: volume-averaged Navier-Stokes with heat, stabilised P1-P1 elements.

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

from math import factorial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from skfem import (
    Basis,
    BilinearForm,
    ElementTetP1,
    ElementTriP1,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshTet,
    MeshTri,
)
from skfem.helpers import ddot, div, dot, grad, mul, transpose

from .boundary import hold_flow, hold_heat, passing
from .finite_elements import NEARLY_SINGULAR, FiniteElements, FlowData
from .pieces import PieceSums
from .solver import Condition, Floats, Integers, Newton, Open, OpenHeat, Problem, Report, Step

Sparse = sp.csr_array | sp.csr_matrix
QUADRATURE = 4
"""Degree of the rules in cells and on facets; there it matters: upwind terms are no polynomials."""


class Facets(NamedTuple):
    """The spaces of T, u and (u, p) on a part of the boundary."""

    scalar: FacetBasis
    vector: FacetBasis
    mixed: FacetBasis

    def inflow(self, wind: Floats) -> Floats:
        """min(wind . n, 0) at the quadrature points."""
        u = self.vector.interpolate(wind.ravel())
        return np.minimum(dot(u, self.scalar.normals), 0)


class ScikitFem(FiniteElements):
    """The solver on one mesh. Unknowns are numbered (D + 1) node + component, the pressure last."""

    def set_mesh(self, problem: Problem) -> None:
        super().set_mesh(problem)
        self._make_spaces()

    def _move(self, points: Floats) -> None:
        super()._move(points)
        self._make_spaces()

    def _make_spaces(self) -> None:
        problem = self.problem
        plane = problem.dimension == 2
        make, scalar = (MeshTri, ElementTriP1()) if plane else (MeshTet, ElementTetP1())
        mesh = make(problem.points.T.copy(), problem.cells.T.copy())
        vector, mixed = ElementVector(scalar), ElementVector(scalar) * scalar
        self.scalar = Basis(mesh, scalar, intorder=QUADRATURE)
        corners = np.eye(problem.dimension, problem.dimension + 1, 1)
        weights = np.full(corners.shape[1], 1 / factorial(corners.shape[1]))
        self.vertices = Basis(mesh, scalar, quadrature=(corners, weights))
        self.vector, self.mixed = map(self.scalar.with_element, (vector, mixed))
        self.facets = {}
        for name, nodes in problem.boundaries.items():
            numbers = _facet_numbers(mesh.facets.T, nodes)
            basis = FacetBasis(mesh, scalar, facets=numbers, intorder=QUADRATURE)
            self.facets[name] = Facets(basis, *map(basis.with_element, (vector, mixed)))

    def _energy(self, step: Step, sums: PieceSums | None, report: Report) -> Floats:
        problem, heat, dt = self.problem, self.problem.heat, step.dt
        C, k = heat.capacity, heat.conductivity
        wall, wall_T = heat.wall_coefficient, heat.wall_temperature
        eps = self.scalar.interpolate(step.voidage)
        u = self.vector.interpolate(self._wind(step).ravel())
        old = self.scalar.interpolate(self.state.temperature)
        source = 0 if step.sources is None else self.scalar.interpolate(step.sources.heat)
        U, xi = self.heat_stabilisation(step)
        xi_U = (xi[:, None] * U).T[:, :, None]

        @BilinearForm
        def storage(T, S, w):
            return (w.eps * C / dt + wall) * T * S

        @LinearForm
        def stored(S, w):
            return (w.eps * C * w.old / dt + wall * wall_T) * S

        @BilinearForm
        def matrix(T, S, _):
            carried = eps * C * dot(u, grad(T))
            residual = (eps * C / dt + wall) * T + carried - k * dot(grad(eps), grad(T))
            return carried * S + eps * k * dot(grad(T), grad(S)) + residual * dot(xi_U, grad(S))

        @LinearForm
        def rhs(S, _):
            known = eps * C * old / dt + wall * wall_T
            return known * dot(xi_U, grad(S)) + source * (S + dot(xi_U, grad(S)))

        A, b = matrix.assemble(self.scalar), rhs.assemble(self.scalar)
        points = self.vertices if heat.lumped else self.scalar
        at = {
            "eps": points.interpolate(step.voidage),
            "old": points.interpolate(self.state.temperature),
        }
        A, b = A + storage.assemble(points, **at), b + stored.assemble(points, **at)
        for condition in step.conditions:
            facets = self.facets[condition.boundary]
            match condition.heat:
                case Newton(coefficient, outside):
                    transfer = coefficient
                case OpenHeat(outside) if outside is not None:
                    wet = facets.scalar.interpolate(step.voidage)
                    transfer = -C * wet * facets.inflow(self._wind(step))
                case _:
                    continue
            A = A + BilinearForm(lambda T, S, _, h=transfer: h * T * S).assemble(facets.scalar)
            b = b + LinearForm(lambda S, _, h=transfer * outside: h * S).assemble(facets.scalar)
        if sums is not None and sums.heated:
            blocks, loads = sums.energy(U, xi, heat.lumped)
            A, b = _add_blocks(A, b, self.problem.cells[sums.cells], blocks, loads)
        if heat.monotone:
            A = _upwind(A)
        T, _ = _solve(A, b, *hold_heat(problem, step.conditions), problem.tolerance)
        report.iterations += 1
        return T[:, 0]

    def _flow(
        self, step: Step, sums: PieceSums | None, data: FlowData, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        problem, dt = self.problem, step.dt
        rho, eta, thin = problem.density, problem.viscosity, problem.thin_cell_drag
        eps = self.scalar.interpolate(step.voidage)
        old = self.vector.interpolate(self.state.velocity.ravel())
        at = self.vector.interpolate(about.ravel())
        mesh_velocity = 0 if step.motion is None else step.motion.velocity
        wind = self.vector.interpolate((about - mesh_velocity).ravel())
        free, value, spread = hold_flow(problem, self.cells, step)
        weight = self.scalar.interpolate(data.share) * self.vector.interpolate(data.weight.ravel())
        solid_flux = self.vector.interpolate(data.solid_flux.ravel())
        source_u = source_p = 0
        if step.sources is not None:
            source_u = self.vector.interpolate(step.sources.momentum.ravel())
            source_p = self.scalar.interpolate(step.sources.mass)
        xi, xi_c = data.stabilisation.time[:, None], data.stabilisation.incompressibility[:, None]
        xi_U = xi * data.stabilisation.direction.T[:, :, None]

        @BilinearForm
        def matrix(u, p, v, q, _):
            rate = eps * rho * (u / dt + mul(grad(u), wind) + mul(grad(at), u)) + thin * u
            strain = grad(u) + transpose(grad(u))
            residual = rate + grad(p) - eta * mul(strain, grad(eps))
            return (
                dot(rate, v)
                + eps * eta * ddot(strain, grad(v))
                - p * div(v)
                - eps * dot(u, grad(q))
                + dot(residual, mul(grad(v), xi_U) + xi / rho * grad(q))
                + rho * xi_c * (eps * div(u) + dot(u, grad(eps))) * div(v)
            )

        @LinearForm
        def rhs(v, q, _):
            force = eps * rho * (old / dt + mul(grad(at), at)) + weight + source_u
            return (
                dot(force, v + mul(grad(v), xi_U) + xi / rho * grad(q))
                + (source_p + spread) * q
                + rho * xi_c * (source_p - div(solid_flux)) * div(v)
            )

        A, b = matrix.assemble(self.mixed), rhs.assemble(self.mixed)
        for condition in step.conditions:
            facets = self.facets[condition.boundary]
            A, b = self._add_boundary(A, b, condition, facets, step)
        if sums is not None:
            blocks, loads = sums.flow(data.stabilisation, rho, data.weight)
            A, b = _add_blocks(A, b, problem.cells[sums.cells], blocks, loads)
        x, report.residual = _solve(A, b, free, value, problem.tolerance)
        report.iterations += 1
        return x[:, :-1].copy(), x[:, -1].copy()

    def _add_boundary(
        self,
        A: Sparse,
        b: Floats,
        condition: Condition,
        facets: Facets,
        step: Step,
    ) -> tuple[Sparse, Floats]:
        """<<eps u . n, q>>, and if open <<p_out n, v>> - <<eps rho min(wind . n, 0) u, v>>.

        Where the boundary is not open, what passes is known.
        """
        eps, basis, flow = facets.scalar.interpolate(step.voidage), facets.mixed, condition.flow
        if isinstance(flow, Open):
            A = A + BilinearForm(lambda u, p, v, q, w: eps * dot(u, w.n) * q).assemble(basis)
            taken = -self.problem.density * eps * facets.inflow(self._wind(step))
            A = A + BilinearForm(lambda u, p, v, q, w: taken * dot(u, v)).assemble(basis)
            return A, b - LinearForm(lambda v, q, w: flow.pressure * dot(w.n, v)).assemble(basis)
        velocity, of_fluid = passing(self.problem, condition, step.motion)
        flux = (eps if of_fluid else 1) * facets.vector.interpolate(velocity.ravel())
        return A, b - LinearForm(lambda v, q, w: dot(flux, w.n) * q).assemble(basis)


def _facet_numbers(all_facets: Integers, wanted: Integers) -> Integers:
    number = {tuple(nodes): k for k, nodes in enumerate(np.sort(all_facets, axis=1).tolist())}
    return np.array([number[tuple(nodes)] for nodes in np.sort(wanted, axis=1).tolist()], dtype=int)


def _add_blocks(
    A: Sparse, b: Floats, cells: Integers, blocks: Floats, loads: Floats
) -> tuple[Sparse, Floats]:
    """Adds the equations of cells, whose unknowns are those of their nodes in turn."""
    components = loads.size // cells.size
    dofs = (components * cells[:, :, None] + np.arange(components)).reshape(len(cells), -1)
    size = dofs.shape[1]
    rows, columns = np.repeat(dofs, size, axis=1), np.tile(dofs, (1, size))
    more = sp.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), A.shape)
    return A + more.tocsr(), b + np.bincount(dofs.ravel(), loads.ravel(), len(b))


def _upwind(A: Sparse) -> Sparse:
    """A with max(a_ij, a_ji, 0) moved from the entries ij and ji to the diagonal of i and j."""
    excess = sp.csr_array(A.maximum(A.T).maximum(0))
    excess.setdiag(0)
    return A - excess + sp.diags_array(excess.sum(axis=1))


def _solve(
    A: Sparse, b: Floats, free: Floats, value: Floats, tolerance: float
) -> tuple[Floats, float]:
    """Solves A x = b where the nodes are ``free`` (a projector each, :mod:`voidage.boundary`).

    The rest is ``value``: the conditions take the place of the equations that fall away, scaled as
    the diagonal that they had. Returns the solution, one row per node, and the residual relative to
    the right-hand side, both scaled to a unit diagonal.
    """
    count = len(free)
    projector = sp.bsr_array((free, np.arange(count), np.arange(count + 1))).tocsr()
    held = sp.diags_array(np.abs(A.diagonal())) @ (sp.eye_array(len(b)) - projector)
    A, b = projector @ A + held, projector @ b + held @ value.ravel()
    # Scaled to a unit diagonal the system hardly needs pivots, and fills little.
    unit = 1 / np.sqrt(np.abs(A.diagonal()))
    A, b = sp.csc_array(sp.diags_array(unit) @ A @ sp.diags_array(unit)), unit * b
    factors = splu(A, "MMD_AT_PLUS_A", diag_pivot_thresh=0.1, options={"SymmetricMode": True})
    x = factors.solve(b)
    x += factors.solve(b - A @ x)
    residual = float(np.linalg.norm(b - A @ x) / (np.linalg.norm(b) or 1))
    if not residual <= max(tolerance, NEARLY_SINGULAR):
        raise ArithmeticError(
            f"the linear system is nearly singular: its relative residual is {residual:.1e}"
        )
    return (unit * x).reshape(value.shape), residual


if __name__ == "__main__":
    import sys

    from .adapter import main

    sys.exit(main(ScikitFem))
