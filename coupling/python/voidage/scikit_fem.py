"""The fluid in scikit-fem: volume-averaged Navier-Stokes with scalars, stabilised P1-P1 elements.

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

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from skfem import (
    Basis,
    BilinearForm,
    ElementTetP1,
    ElementTriP1,
    ElementVector,
    LinearForm,
    MeshTet,
    MeshTri,
)
from skfem.helpers import ddot, div, dot, grad, mul, transpose

from .boundary import flow_terms, hold_flow, hold_scalar, scalar_terms
from .finite_elements import NEARLY_SINGULAR, FiniteElements, FlowData
from .points import PointSums
from .solver import Floats, Integers, Problem, Report, Step

Sparse = sp.csr_array | sp.csr_matrix
QUADRATURE = 4
"""Degree of the rule. All terms of cells are polynomials of this degree at most."""


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
        mixed = ElementVector(scalar) * scalar
        self.scalar = Basis(mesh, scalar, intorder=QUADRATURE)
        self.vector, self.mixed = map(self.scalar.with_element, (ElementVector(scalar), mixed))

    def _at(self, nodal: Floats):
        """A nodal field at the quadrature points of the cells."""
        return (self.vector if nodal.ndim == 2 else self.scalar).interpolate(nodal.ravel())

    def _scalar(
        self, k: int, step: Step, sums: PointSums, report: Report
    ) -> tuple[Floats, Floats]:
        problem, scalar = self.problem, self.problem.scalars[k]
        C, K, wall = scalar.capacity, scalar.conductivity, scalar.wall_coefficient
        lumped, old = scalar.form != "consistent", self.state.scalars[k]
        U, xi = self._scalar_stabilisation(k, step)
        xi_U = (xi[:, None] * U).T[:, :, None]
        eps, u = self._at(step.voidage), self._at(self._wind(step))
        source = 0 if step.sources is None else self._at(step.sources.scalars[k])
        known = C / step.dt * eps * self._at(old) + wall * scalar.wall_value

        @BilinearForm
        def matrix(s, S, _):
            stored, carried = (C / step.dt * eps + wall) * s, C * eps * dot(u, grad(s))
            residual = stored + carried - K * dot(grad(eps), grad(s))
            galerkin = carried if lumped else stored + carried
            spread = eps * K * dot(grad(s), grad(S))
            return galerkin * S + spread + residual * dot(xi_U, grad(S))

        @LinearForm
        def rhs(S, _):
            along = dot(xi_U, grad(S))
            return known * (along if lumped else S + along) + source * (S + along)

        A, b = matrix.assemble(self.scalar), rhs.assemble(self.scalar)
        if lumped:
            volume, rate = self.cells.nodal_volume, C / step.dt * step.voidage
            A = A + sp.diags_array(volume * (rate + wall))
            b = b + volume * (rate * old + wall * scalar.wall_value)
        for condition in step.conditions:
            A, b = _add(A, b, *scalar_terms(problem, condition, step, self._wind(step), k))
        A, b = _add(A, b, problem.cells[sums.cells], *sums.scalar(k, U, xi, lumped))
        if scalar.form == "monotone":
            A = _upwind(A)
        s, left, _ = self._solve(A, b, *hold_scalar(problem, step.conditions, k), report)
        return s[:, 0], left[:, 0]

    def _flow(
        self, step: Step, sums: PointSums, data: FlowData, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        problem, dt = self.problem, step.dt
        rho, eta, thin = problem.density, problem.viscosity, problem.thin_cell_drag
        mesh_velocity = 0 if step.motion is None else step.motion.velocity
        eps, old, at = map(self._at, (step.voidage, self.state.velocity, about))
        wind, solid_flux = self._at(about - mesh_velocity), self._at(data.solid_flux)
        weight = self._at(data.share) * self._at(data.weight)
        free, value, spread = hold_flow(problem, self.cells, step)
        source_u = source_p = 0
        if step.sources is not None:
            source_u, source_p = self._at(step.sources.momentum), self._at(step.sources.mass)
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
            A, b = _add(A, b, *flow_terms(problem, condition, step, self._wind(step)))
        points = sums.flow(data.stabilisation, rho, data.weight)
        A, b = _add(A, b, problem.cells[sums.cells], *points)
        x, left, report.residual = self._solve(A, b, free, value, report)
        return x, left

    def _solve(
        self, A: Sparse, b: Floats, free: Floats, value: Floats, report: Report
    ) -> tuple[Floats, Floats, float]:
        """Solves A x = b where the nodes are ``free`` (a projector each, :mod:`voidage.boundary`).

        The rest is ``value``: the conditions take the place of the equations that fall away, scaled
        as the diagonal that they had. Returns x and A x - b, one row per node, and the residual of
        what was solved relative to the right-hand side, both scaled to a unit diagonal.
        """
        count = len(free)
        projector = sp.bsr_array((free, np.arange(count), np.arange(count + 1))).tocsr()
        scale = sp.diags_array(np.abs(A.diagonal())) @ (sp.eye_array(len(b)) - projector)
        held, known = projector @ A + scale, projector @ b + scale @ value.ravel()
        # Scaled to a unit diagonal the system hardly needs pivots, and fills little.
        unit = 1 / np.sqrt(np.abs(held.diagonal()))
        held = sp.csc_array(sp.diags_array(unit) @ held @ sp.diags_array(unit))
        known = unit * known
        factors = splu(
            held, "MMD_AT_PLUS_A", diag_pivot_thresh=0.1, options={"SymmetricMode": True}
        )
        x = factors.solve(known)
        x += factors.solve(known - held @ x)
        residual = float(np.linalg.norm(known - held @ x) / (np.linalg.norm(known) or 1))
        if not residual <= max(self.problem.tolerance, NEARLY_SINGULAR):
            raise ArithmeticError(
                f"the linear system is nearly singular: its relative residual is {residual:.1e}"
            )
        report.iterations += 1
        x *= unit
        return x.reshape(value.shape), (A @ x - b).reshape(value.shape), residual


def _add(
    A: Sparse, b: Floats, nodes: Integers, blocks: Floats, loads: Floats
) -> tuple[Sparse, Floats]:
    """Adds the terms of cells or facets, whose unknowns are those of their nodes in turn."""
    components = np.prod(loads.shape[2:], dtype=int)
    dofs = components * nodes[:, :, None] + np.arange(components)
    size = components * nodes.shape[1]
    dofs = dofs.reshape(len(nodes), size)
    rows, columns = np.repeat(dofs, size, axis=1), np.tile(dofs, (1, size))
    more = sp.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), A.shape)
    return A + more.tocsr(), b + np.bincount(dofs.ravel(), loads.ravel(), len(b))


def _upwind(A: Sparse) -> Sparse:
    """A with max(a_ij, a_ji, 0) moved from the entries ij and ji to the diagonal of i and j."""
    excess = sp.csr_array(A.maximum(A.T).maximum(0))
    excess.setdiag(0)
    return A - excess + sp.diags_array(excess.sum(axis=1))


if __name__ == "__main__":
    import sys

    from .adapter import main

    sys.exit(main(ScikitFem))
