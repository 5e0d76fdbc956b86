"""Sums over the points in the fluid: their terms in the equations of the cells, the solid flux.

A point has volume V, drag gamma, mobility a and velocity b, and the shape functions phi of its cell
at its place. It exchanges with the fluid

    f_p = V grad p - gamma (u - v*),   v* = b + a (gamma u - V grad p),
    q_p = -h (s - s*),                 s* = c + a h s of each scalar s.

In the equation of mass the solid flux phi v* has a law v* of its own.
"""

import numpy as np

from .cells import Cells, Stabilisation
from .solver import Fields, Floats, Points, PointScalar, Problem


def no_points(problem: Problem) -> Points:
    """Points of a step that has none."""
    none, dimension = np.zeros(0), problem.dimension
    shape, vectors = np.zeros((0, dimension + 1)), np.zeros((0, dimension))
    scalars = (None,) * len(problem.scalars)
    return Points(none.astype(int), shape, none, none, none, vectors, none, vectors, scalars)


class PointSums:
    """The points of a step on a mesh; c counts the cells that have any, B = D + 1 their nodes."""

    def __init__(self, mesh: Cells, points: Points):
        self.mesh, self.points = mesh, points
        self.order = np.argsort(points.cell, kind="stable")
        self.cells, self.start = np.unique(points.cell[self.order], return_index=True)
        """Cells that have points, (c), and where theirs begin in the order of the cells."""
        self.total_drag = self._by_cell(points.drag)
        """sum gamma, (c)."""

    def _by_cell(self, values: Floats, *tests: Floats) -> Floats:
        """Sums over the points in each cell of values times tests, (q, B) each: (c, .., B, ..)."""
        for test in tests:
            values = np.einsum("q...,qb->q...b", values, test)
        return np.add.reduceat(values[self.order], self.start, axis=0)

    def flow(
        self, stabilisation: Stabilisation, density: float, weight: Floats
    ) -> tuple[Floats, Floats]:
        """Terms of the points in momentum and mass, their stabilisation included.

        -<f_p, v + xi (U . grad) v> - <phi v*, grad q> - (xi / rho) <f_p, grad q>, and the weight of
        the fluid that the points displace, <phi w, ..> in the same tests; ``weight`` are the nodal
        values of w = rho g (1 - sum beta (s - s_R)), (n, D). The fluid's own weight is then that of
        a cell without points: with the voidage made of the points, as in V grad p, a fluid at rest
        between held points solves the discrete equations.

        Returns matrices (c, B, D + 1, B, D + 1) and right-hand sides (c, B, D + 1).
        """
        p, phi = self.points, self.points.shape
        slip = p.mobility * p.drag - 1
        drag = self._by_cell(-slip * p.drag, phi, phi)
        pressure = self._by_cell(p.volume * slip, phi)
        carried = self._by_cell(p.volume * p.flux_mobility * p.drag, phi)
        diffusion = self._by_cell(p.volume**2 * p.flux_mobility)
        volume_flux = self._by_cell(p.volume[:, None] * p.flux_velocity)
        force = self._by_cell(p.drag, phi, p.velocity)
        force -= self._by_cell(p.volume, phi, phi) @ weight[self.mesh.nodes[self.cells]]

        gradient = self.mesh.gradient[self.cells]
        time = stabilisation.time[self.cells, None]
        along = time * np.einsum("ci,cai->ca", stabilisation.direction[self.cells], gradient)
        across = time[..., None] / density * gradient
        # Residual of the points in a cell: drag u + pressure grad p - force.
        drag_sum, pressure_sum, force_sum = (sums.sum(axis=1) for sums in (drag, pressure, force))
        drag = drag + along[:, :, None] * drag_sum[:, None, :]
        pressure = pressure + along * pressure_sum[:, None]
        force = force + along[:, :, None] * force_sum[:, None, :]

        count, B, D = gradient.shape
        matrix = np.zeros((count, B, D + 1, B, D + 1))
        for i in range(D):
            matrix[:, :, i, :, i] = drag
        matrix[:, :, :D, :, D] = np.einsum("ca,cbi->caib", pressure, gradient)
        matrix[:, :, D, :, :D] = np.einsum("cai,cb->cabi", across, drag_sum)
        matrix[:, :, D, :, :D] -= np.einsum("cai,cb->cabi", gradient, carried)
        laplace = diffusion + time[:, 0] / density * pressure_sum
        matrix[:, :, D, :, D] = np.einsum("c,cai,cbi->cab", laplace, gradient, gradient)
        rhs = np.zeros((count, B, D + 1))
        rhs[:, :, :D] = force
        rhs[:, :, D] = np.einsum("cai,ci->ca", gradient, volume_flux)
        rhs[:, :, D] += np.einsum("cai,ci->ca", across, force_sum)
        return matrix, rhs

    def scalar(
        self, k: int, direction: Floats, time: Floats, lumped: bool
    ) -> tuple[Floats, Floats]:
        """-<q_p, S + xi U . grad S> of scalar k, U (m, D) and xi (m) as ``direction`` and ``time``.

        If ``lumped``, the rows of -<q_p, S> are summed on the diagonal.

        Returns matrices (c, B, B) and right-hand sides (c, B).
        """
        none, phi = np.zeros(len(self.points.cell)), self.points.shape
        columns = self.points.scalars[k] or PointScalar(none, none, none)
        h = columns.coefficient
        exchange = self._by_cell(h * (1 - columns.mobility * h), phi, phi)
        given = self._by_cell(h * columns.value, phi)
        gradient = self.mesh.gradient[self.cells]
        along = time[self.cells, None] * np.einsum("ci,cai->ca", direction[self.cells], gradient)
        total = exchange.sum(axis=1)  # of rows as of columns
        matrix = total[:, :, None] * np.eye(total.shape[1]) if lumped else exchange
        matrix = matrix + along[:, :, None] * total[:, None, :]
        return matrix, given + along * given.sum(axis=1)[:, None]

    def solid_flux(self, fields: Fields) -> Floats:
        """Nodal projection (A.15) of phi v, v the law of the flux at the given fields, (n, D)."""
        p, nodes = self.points, self.mesh.nodes[self.points.cell]
        u = np.einsum("qa,qai->qi", p.shape, fields.velocity[nodes])
        slope = np.einsum("qa,qai->qi", fields.pressure[nodes], self.mesh.gradient[p.cell])
        forcing = p.drag[:, None] * u - p.volume[:, None] * slope
        v = p.flux_velocity + p.flux_mobility[:, None] * forcing
        parts = p.shape[:, :, None] * (p.volume[:, None] * v)[:, None, :]
        flux = np.zeros_like(fields.velocity)
        np.add.at(flux, nodes, parts)
        return flux / self.mesh.nodal_volume[:, None]
