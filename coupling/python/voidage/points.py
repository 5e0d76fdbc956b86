"""Sums over the points in the fluid: their terms in the equations, and the solid flux.

A point has volume V, drag gamma, mobility a and velocity b, and the shape functions phi of its cell
at its place. It exchanges with the fluid

    f_p = V grad p - gamma (u - v*),   v* = b + a (gamma u - V grad p),
    q_p = -h (s - s*),                 s* = c + a h s of each scalar s.

In the equation of mass the solid flux phi v* has a law v* of its own.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from .cells import Cells, Places, Terms
from .solver import Fields, Floats, Motion, Points, Problem, Sources, Step


def complete(problem: Problem, step: Step) -> Step:
    """The step with all that it may lack: no points, a mesh at rest, sources that are zero."""
    (count, D), scalars = problem.points.shape, len(problem.scalars)
    zero, still, none, vectors = (np.zeros(each) for each in (count, (count, D), 0, (0, D)))
    places = none.astype(int), np.zeros((0, D + 1))
    laws = none, none, none, vectors, none, vectors, (None,) * scalars
    return replace(
        step,
        points=step.points or Points(*places, *laws),
        sources=step.sources or Sources(still, zero, (zero,) * scalars),
        motion=step.motion or Motion(problem.points, still),
    )


class PointSums(Places):
    """The points of a step in the cells of a mesh; xi and xi U of the stabilisation are given cell
    by cell, (m) and (m, D)."""

    def __init__(self, mesh: Cells, points: Points):
        super().__init__(mesh.masters[points.cell], points.shape, len(mesh.nodal_volume))
        self.points, self.nodal_volume = points, mesh.nodal_volume
        self.gradient = mesh.gradient[points.cell]
        """Gradients of the shape functions at each point, (q, B, D)."""

    def _along(self, xi_U: Floats) -> Floats:
        """xi (U . grad) of the shape functions, (q, B)."""
        return np.einsum("qi,qai->qa", xi_U[self.points.cell], self.gradient)

    def flow(self, xi: Floats, xi_U: Floats, density: float, weight: Floats) -> Terms:
        """Terms of the points in momentum and mass, their stabilisation included.

        -<f_p, v + xi (U . grad) v> - <phi v*, grad q> - (xi / rho) <f_p, grad q>, and the weight of
        the fluid that the points displace, <phi w, ..> in the same tests; ``weight`` are the nodal
        values of w = rho g (1 - sum beta (s - s_R)), (n, D). The fluid's own weight is then that of
        a cell without points: with the voidage made of the points, as in V grad p, a fluid at rest
        between held points solves the discrete equations.
        """
        p, D, tested = self.points, weight.shape[1], self.shape + self._along(xi_U)
        time, left = sp.diags(xi[p.cell] / density), sp.diags(1 - p.mobility * p.drag)
        drag, volume = sp.diags(p.drag), sp.diags(p.volume)
        # -f_p = left forcing - gamma b, forcing = gamma u - V grad p.
        force = p.drag[:, None] * p.velocity - p.volume[:, None] * self.at(weight)
        flux = p.volume[:, None] * p.flux_velocity
        matrix, rhs = self.nothing(D + 1)
        for i in range(D):
            slope = self.rows(self.gradient[:, :, i], D, D + 1)
            test = self.rows(tested, i, D + 1) + time @ slope
            forcing = drag @ self.rows(self.shape, i, D + 1) - volume @ slope
            matrix += test.T @ left @ forcing
            matrix -= slope.T @ volume @ sp.diags(p.flux_mobility) @ forcing
            rhs += test.T @ force[:, i] + slope.T @ flux[:, i]
        return matrix, rhs

    def scalar(self, k: int, xi_U: Floats, lumped: bool) -> Terms:
        """-<q_p, S + xi U . grad S> of scalar k. If ``lumped``, the rows of -<q_p, S> are summed on
        the diagonal."""
        columns = self.points.scalars[k]
        if columns is None:
            return self.nothing()
        h, value, along = columns.coefficient, self.rows(self.shape), self.rows(self._along(xi_U))
        rate, given = h * (1 - columns.mobility * h), (value + along).T @ (h * columns.value)
        carried = along if lumped else value + along
        matrix = carried.T @ sp.diags(rate) @ value
        return matrix + sp.diags(value.T @ rate) if lumped else matrix, given

    def solid_flux(self, fields: Fields) -> Floats:
        """Nodal projection (A.15) of phi v, v the law of the flux at the given fields, (n, D)."""
        p = self.points
        slope = np.einsum("qa,qai->qi", fields.pressure[self.nodes], self.gradient)
        forcing = p.drag[:, None] * self.at(fields.velocity) - p.volume[:, None] * slope
        v = p.flux_velocity + p.flux_mobility[:, None] * forcing
        flux = self.rows(self.shape).T @ (p.volume[:, None] * v)
        # Zero at images, which have no volume of their own.
        return flux / np.where(self.nodal_volume > 0, self.nodal_volume, 1)[:, None]
