"""The fluid in scikit-fem: volume-averaged Navier-Stokes with scalars, stabilised P1-P1 elements.

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

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, div, dot, grad, mul, transpose

from .finite_elements import NEARLY_SINGULAR, Beside, FiniteElements, FlowData, FlowForm, ScalarForm
from .solver import Floats, Problem, Report, Step

QUADRATURE = 4
"""Degree of the rule. All terms of cells are polynomials of this degree at most."""


class ScikitFem(FiniteElements):
    """The solver on one mesh. Unknowns are numbered (D + 1) node + component, the pressure last. Terms of a
    subclass are called whenever a system is assembled, with values at the quadrature points."""

    def _place(self, problem: Problem) -> None:
        super()._place(problem)
        plane = skfem.MeshTri, skfem.ElementTriP1()
        space = skfem.MeshTet, skfem.ElementTetP1()
        make, scalar = plane if problem.dimension == 2 else space
        vector = skfem.ElementVector(scalar)
        mesh = make(problem.points.T.copy(), problem.cells.T.copy())
        self.scalar = skfem.Basis(mesh, scalar, intorder=QUADRATURE)
        self.vector, self.mixed = map(self.scalar.with_element, (vector, vector * scalar))

    def _at(self, *nodal: Floats):
        """Nodal fields at the quadrature points of the cells."""
        for each in nodal:
            yield (self.scalar if each.ndim == 1 else self.vector).interpolate(each.ravel())

    def _scalar(
        self, k: int, step: Step, wind: Floats, xi_U: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        scalar, lumped = self.problem.scalars[k], self.problem.scalars[k].form != "consistent"
        C, K, wall = scalar.capacity, scalar.conductivity, scalar.wall_coefficient
        eps, u, old, source = self._at(
            step.voidage, wind, self.state.scalars[k], step.sources.scalars[k]
        )
        known, xi_U = C / step.dt * eps * old + wall * scalar.wall_value, xi_U.T[:, :, None]

        def form(s, S, at) -> ScalarForm:
            tested = S + dot(xi_U, grad(S))
            return ScalarForm(s, S, tested, at.x, eps, old, u, k, step.dt, self.problem)

        @skfem.BilinearForm
        def matrix(s, S, at):
            stored, carried = (C / step.dt * eps + wall) * s, C * eps * dot(u, grad(s))
            residual = stored + carried - K * dot(grad(eps), grad(s))
            galerkin = carried if lumped else stored + carried
            spread = eps * K * dot(grad(s), grad(S))
            sums = galerkin * S + spread + residual * dot(xi_U, grad(S))
            return _with(self.scalar_terms(form(s, S, at)), sums)

        @skfem.LinearForm
        def rhs(S, at):
            along = dot(xi_U, grad(S))
            sums = known * (along if lumped else S + along) + source * (S + along)
            return _with(self.scalar_loads(form(None, S, at)), sums)

        A, b = self.sides.join(matrix.assemble(self.scalar), rhs.assemble(self.scalar))
        A = A + beside.matrix
        return self._solve(_upwind(A) if scalar.form == "monotone" else A, b, beside, report)

    def _flow(
        self, step: Step, data: FlowData, about: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        problem, dt = self.problem, step.dt
        rho, eta, thin = problem.density, problem.viscosity, problem.thin_cell_drag
        eps, old, at, wind = self._at(
            step.voidage, self.state.velocity, about, about - step.motion.velocity
        )
        share, weight, solid_flux = self._at(data.share, data.weight, data.solid_flux)
        source_u, source_p = self._at(step.sources.momentum, step.sources.mass)
        xi, xi_c, xi_U = data.xi[:, None], data.xi_c[:, None], data.xi_U.T[:, :, None]

        def form(u, p, v, q, place) -> FlowForm:
            tested = v + mul(grad(v), xi_U) + xi / rho * grad(q)
            return FlowForm(u, p, v, q, tested, place.x, eps, old, at, dt, problem)

        @skfem.BilinearForm
        def matrix(u, p, v, q, place):
            rate = eps * rho * (u / dt + mul(grad(u), wind) + mul(grad(at), u)) + thin * u
            strain = grad(u) + transpose(grad(u))
            residual = rate + grad(p) - eta * mul(strain, grad(eps))
            sums = (
                dot(rate, v)
                + eps * eta * ddot(strain, grad(v))
                - p * div(v)
                - eps * dot(u, grad(q))
                + dot(residual, mul(grad(v), xi_U) + xi / rho * grad(q))
                + rho * xi_c * (eps * div(u) + dot(u, grad(eps))) * div(v)
            )
            return _with(self.terms(form(u, p, v, q, place)), sums)

        @skfem.LinearForm
        def rhs(v, q, place):
            force = eps * rho * (old / dt + mul(grad(at), at)) + share * weight + source_u
            sums = (
                dot(force, v + mul(grad(v), xi_U) + xi / rho * grad(q))
                + source_p * q
                + rho * xi_c * (source_p - div(solid_flux)) * div(v)
            )
            return _with(self.loads(form(None, None, v, q, place)), sums)

        A, b = self.sides.join(matrix.assemble(self.mixed), rhs.assemble(self.mixed))
        return self._solve(A + beside.matrix, b, beside, report)

    def _uniform(self, step: Step) -> Floats:
        problem, old, found = self.problem, self.state.velocity, np.empty_like(self.state.velocity)
        eps, at, still = self._at(step.voidage, old, np.zeros(len(old)))
        for i, direction in enumerate(np.eye(problem.dimension)):
            (u,) = self._at(np.tile(direction, (len(old), 1)))

            @skfem.LinearForm
            def held(v, q, place):
                form = FlowForm(u, still, v, q, v, place.x, eps, at, at, step.dt, problem)  # noqa: B023
                return _with(self.terms(form), 0.0)

            found[:, i] = held.assemble(self.mixed).reshape(len(old), -1)[:, i]
        return found

    def _solve(
        self, A: sp.csr_array, load: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        """Solves A x = b where the nodes are free, for every right-hand side: ``load`` and those of
        ``beside``. Returns x and A x - b, (r, n, c) each.

        The conditions take the place of the equations that fall away, scaled as the diagonal that
        they had. The residual of what was solved, reported relative to the right-hand side, is that
        of the system scaled to a unit diagonal.
        """
        free, value, b = beside.free, beside.value, beside.rhs.T.copy()
        b[:, 0] += load
        projector = sp.bsr_array((free, np.arange(len(free)), np.arange(len(free) + 1))).tocsr()
        scale = sp.diags(np.abs(A.diagonal())) @ (sp.identity(len(b)) - projector)
        held, known = projector @ A + scale, projector @ b + scale @ value.reshape(b.T.shape).T
        # Scaled to a unit diagonal the system hardly needs pivots, and fills little.
        unit = sp.diags(1 / np.sqrt(np.abs(held.diagonal())))
        held, known = sp.csc_array(unit @ held @ unit), unit @ known
        factors = splu(
            held, "MMD_AT_PLUS_A", diag_pivot_thresh=0.1, options={"SymmetricMode": True}
        )
        x = factors.solve(known)
        x += factors.solve(known - held @ x)
        missed, size = (np.linalg.norm(each, axis=0) for each in (known - held @ x, known))
        residual = float(np.max(missed / np.where(size > 0, size, 1)))
        if not residual <= max(self.problem.tolerance, NEARLY_SINGULAR):
            raise ArithmeticError(
                f"the linear system is nearly singular: its relative residual is {residual:.1e}"
            )
        report.iterations, report.residual = report.iterations + 1, residual
        x = unit @ x
        return x.T.reshape(value.shape), (A @ x - b).T.reshape(value.shape)


def _with(more, sums):
    """Integrands together; there may be no more."""
    return sums if more is None else sums + more


def _upwind(A: sp.csr_array) -> sp.csr_array:
    """A with max(a_ij, a_ji, 0) moved from the entries ij and ji to the diagonal of i and j."""
    excess = sp.csr_array(A.maximum(A.T).maximum(0))
    excess.setdiag(0)
    return A - excess + sp.diags(excess.sum(axis=1))


if __name__ == "__main__":
    import sys

    from .adapter import main

    sys.exit(main(ScikitFem))
