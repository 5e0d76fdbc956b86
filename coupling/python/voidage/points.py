"""Sums over the points in the fluid: their terms in the equations, and the solid flux.

A point has volume V, drag gamma, mobility a and velocity b, and the shape functions phi of its cell
at its place. It exchanges with the fluid

    f_p = V grad p - gamma (u - v*),   v* = b + a (gamma u - V grad p),
    q_p = -h (s - s*),                 s* = c + a h s of each scalar s.

In the equation of mass the solid flux phi v* has a law v* of its own. The Galerkin terms are sums over
the points; the residual of momentum inside the stabilisation takes them as nodal fields.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from .cells import Cells, Places, Terms
from .shear import shared_shear
from .solver import Fields, Floats, Motion, Points, Problem, Sources, Step

DENSEST = 0.2595195
"""Voidage of the densest packing of equal spheres, 1 - pi/sqrt(18), as in the Rust solver. Where it is less, an
element lies inside a grain: a shorter stabilisation time would let the pressures there part."""


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
        self.points, self.mesh = points, mesh
        self.gradient = mesh.gradient[points.cell]
        """Gradients of the shape functions at each point, (q, B, D)."""

    def _density(self, values: Floats) -> Floats:
        """Lumped projection of values at the points to the nodes, (n, ..): the sum of the values with
        phi_a over int phi_a. Zero at images, which have no volume of their own."""
        volume = np.where(self.mesh.nodal_volume > 0, self.mesh.nodal_volume, 1)
        total = self.rows(self.shape).T @ values
        return (total.T / volume).T

    def _cells(self, xi_U: Floats) -> tuple[Places, Floats]:
        """The cells as places, their centroids, and xi (U . grad) of the shape functions, (m, B)."""
        nodes = self.mesh.masters
        centroid = np.full(nodes.shape, 1 / nodes.shape[1])
        along = np.einsum("mi,mai->ma", xi_U, self.mesh.gradient)
        return Places(nodes, centroid, self.count), along

    def drag_rate(self, density: float, thin_cell_drag: float, voidage: Floats) -> Floats:
        """What the drag adds to 1/xi, 1/s, (m): four times the largest nodal drag of a cell, with
        that of a thin cell, over density and mean voidage, that of the densest packing at least."""
        largest = self._density(self.points.drag)[self.mesh.masters].max(axis=1)
        voidage = np.maximum(self.mesh.mean(voidage), DENSEST)
        return 4 * (largest + thin_cell_drag) / (density * voidage)

    def exchange_rate(self, k: int, capacity: float, voidage: Floats) -> Floats | float:
        """What the exchange of scalar k adds to 1/xi_T, 1/s, (m): that of the points in a cell over
        the capacity of its fluid."""
        columns, mesh = self.points.scalars[k], self.mesh
        if columns is None:
            return 0.0
        exchange = np.bincount(self.points.cell, columns.coefficient, len(mesh.measure))
        return exchange / (capacity * mesh.measure * mesh.mean(voidage))

    def _law(self, fields: Fields) -> Floats:
        """Velocities of the points by the law of the equation of mass at the given fields, (q, D)."""
        p = self.points
        slope = np.einsum("qa,qai->qi", fields.pressure[self.nodes], self.gradient)
        forcing = p.drag[:, None] * self.at(fields.velocity) - p.volume[:, None] * slope
        return p.flux_velocity + p.flux_mobility[:, None] * forcing

    def _apart(self, fields: Fields) -> Floats:
        """Drag by which the nodes of cells in whose shear the points share would be pulled together, (n, D):
        the sum of gamma phi_a H (x_a - x_q), H the shared shear at the given fields."""
        p, mesh = self.points, self.mesh
        around = mesh.places[p.cell]
        place = (self.shape[:, :, None] * around).sum(axis=1)
        velocities = self.at(fields.velocity), self._law(fields)
        H = shared_shear(mesh, p, place, velocities, fields.velocity)[p.cell]
        force = np.einsum("qij,qaj->qai", H, around - place[:, None])
        force *= p.drag[:, None, None] * self.shape[:, :, None]
        sums = [np.bincount(self.nodes.ravel(), each.ravel(), self.count) for each in np.moveaxis(force, 2, 0)]
        return np.stack(sums, axis=1)

    def flow(self, xi: Floats, xi_U: Floats, density: float, weight: Floats, last: Fields) -> Terms:
        """Terms of the points in momentum and mass, their stabilisation included.

        -<f_p, v> - <phi v*, grad q>, and the weight of the fluid that the points displace, <phi w, v>;
        ``weight`` are the nodal values of w = rho g (1 - sum beta (s - s_R)), (n, D). The drag
        gamma u is summed on the diagonal, less what this does to the shear that the points share with the
        fluid in the ``last`` accepted fields; v* has u at the points. The tests
        xi (U . grad) v + (xi / rho) grad q weigh the same forces as nodal fields. The fluid's own
        weight is then that of a cell without points: with the voidage made of the points, as in
        V grad p, a fluid at rest between held points solves the discrete equations.
        """
        p, D = self.points, weight.shape[1]
        matrix, rhs = self.nothing(D + 1)
        if not len(p.cell):
            return matrix, rhs
        left = 1 - p.mobility * p.drag
        drag, volume = sp.diags(p.drag), sp.diags(p.volume)
        # -f_p = left (gamma u - V grad p) - gamma b.
        given = p.drag[:, None] * p.velocity
        force = given - p.volume[:, None] * self.at(weight)
        flux = p.volume[:, None] * p.flux_velocity
        for i in range(D):
            slope = self.rows(self.gradient[:, :, i], D, D + 1)
            test = self.rows(self.shape, i, D + 1)
            matrix += sp.diags(test.T @ p.drag) - test.T @ sp.diags(p.mobility * p.drag**2) @ test
            matrix -= test.T @ sp.diags(left) @ volume @ slope
            matrix -= slope.T @ volume @ sp.diags(p.flux_mobility) @ (drag @ test - volume @ slope)
            rhs += test.T @ force[:, i] + slope.T @ flux[:, i]
        apart = self._apart(last)
        rhs.reshape(-1, D + 1)[:, :D] += apart
        # The forces as fields: K u - M grad p on the left, F - Phi w on the right.
        nodal = (self._density(values) for values in (left * p.drag, left * p.volume, p.volume, given))
        left_drag, left_volume, solid, force = nodal
        volume = np.where(self.mesh.nodal_volume > 0, self.mesh.nodal_volume, 1)
        force += apart / volume[:, None] - solid[:, None] * weight
        mesh, nodes, share = self.mesh, self.mesh.masters, self.mesh.measure / (D + 1)
        cells, along = self._cells(xi_U)
        for i in range(D):
            across = (xi / density)[:, None] * mesh.gradient[:, :, i]
            test = cells.rows(along, i, D + 1) + cells.rows(across, D, D + 1)
            pushed = share[:, None] * left_drag[nodes]
            pressed = (share * left_volume[nodes].sum(axis=1))[:, None] * mesh.gradient[:, :, i]
            matrix += test.T @ (cells.rows(pushed, i, D + 1) - cells.rows(pressed, D, D + 1))
            rhs += test.T @ (share * force[nodes, i].sum(axis=1))
        return matrix, rhs

    def scalar(self, k: int, xi_U: Floats, lumped: bool) -> Terms:
        """-<q_p, S + xi U . grad S> of scalar k. If ``lumped``, h s in -<q_p, S> is summed on the
        diagonal; s* has s at the point."""
        columns = self.points.scalars[k]
        if columns is None:
            return self.nothing()
        h, value = columns.coefficient, self.rows(self.shape)
        along = np.einsum("qi,qai->qa", xi_U[self.points.cell], self.gradient)
        test = self.rows(self.shape + along)
        matrix = test.T @ sp.diags(h * (1 - columns.mobility * h)) @ value
        if lumped:
            matrix += sp.diags(value.T @ h) - value.T @ sp.diags(h) @ value
        return matrix, test.T @ (h * columns.value)

    def solid_flux(self, fields: Fields) -> Floats:
        """Nodal projection (A.15) of phi v, v the law of the flux at the given fields, (n, D)."""
        return self._density(self.points.volume[:, None] * self._law(fields))
