"""Sums over the pieces of the grains: exchange per cell, solid flux, the fluid at the grains.

Notation: grain i has volume V, drag gamma, mobility a and velocity b; a piece q of it lies in one
cell, with the share s of the grain and the shape functions phi at its centroid. The exchange is

    f_p = V grad p - gamma (u - v*),   v* = b + a (gamma u - V grad p),
    q_p = -hA (T - T*),                T* = bT + aT hA T.

The solid flux phi v* in the equation of mass may have a law v* of its own (``continuity``), which
``make_rigid`` makes that of grains instead of pieces.
"""

import numpy as np

from .cells import Cells, Stabilisation
from .solver import AtGrains, Fields, Floats, Grains, Pieces

LASTING = 100.0
"""X of `PieceSums.make_rigid` above which a piece is rather let move by itself."""

LEAST = 1e-12
"""Voidage of a cell full of grain as a weight, so that a grain all in such cells has a mean."""


class PieceSums:
    """The pieces of a step on a mesh; c counts the cells that have any, B = D + 1 their nodes."""

    def __init__(self, mesh: Cells, pieces: Pieces, grains: Grains):
        grain = np.repeat(np.arange(len(pieces.first) - 1), np.diff(pieces.first))
        self.mesh, self.pieces, self.grain = mesh, pieces, grain
        self.share, self.shape = pieces.share, pieces.shape
        self.nodes, self.gradient = mesh.nodes[pieces.cell], mesh.gradient[pieces.cell]
        self.volume, self.drag = grains.volume[grain], grains.drag[grain]
        self.mobility, self.velocity = grains.mobility[grain], grains.velocity[grain]
        law = grains.continuity or grains
        self.flux_mobility, self.flux_velocity = law.mobility[grain], law.velocity[grain]
        self.heated = grains.heat is not None
        if self.heated:
            self.coefficient = grains.heat.coefficient[grain]
            self.heat_mobility = grains.heat.mobility[grain]
            self.temperature = grains.heat.temperature[grain]
        self.order = np.argsort(pieces.cell, kind="stable")
        self.cells, self.start = np.unique(pieces.cell[self.order], return_index=True)
        """Cells that have pieces, (c), and where theirs begin in the order of the cells."""
        self.total_drag = self._by_cell(self.share * self.drag)
        """sum s gamma, (c)."""

    def _by_cell(self, values: Floats) -> Floats:
        return np.add.reduceat(values[self.order], self.start, axis=0)

    def _mean(self, values: Floats) -> Floats:
        """Mean over the pieces of each grain."""
        count = len(self.pieces.first) - 1
        columns = values.reshape(len(values), -1).T
        sums = [np.bincount(self.grain, self.share * column, count) for column in columns]
        return np.stack(sums, axis=1).reshape(count, *values.shape[1:])

    def flow(
        self, stabilisation: Stabilisation, density: float, weight: Floats
    ) -> tuple[Floats, Floats]:
        """Terms of the grains in momentum and mass, their stabilisation included.

        -<f_p, v + xi (U . grad) v> - <phi v*, grad q> - (xi / rho) <f_p, grad q>, and the weight of
        the fluid that the grains displace, <phi rho g (1 - beta (T - T_R)), ..> in the same tests.
        ``weight`` holds the nodal values of rho g (1 - beta (T - T_R)), (n, D). The fluid's own
        weight is then that of a cell without grains: with the voidage made of the pieces, as in V
        grad p, a fluid at rest between held grains solves the discrete equations.

        Returns matrices (c, B, D + 1, B, D + 1) and right-hand sides (c, B, D + 1).
        """
        phi, s, V, gamma = self.shape, self.share, self.volume, self.drag
        a, b = self.mobility, self.velocity
        pairs = phi[:, :, None] * phi[:, None, :]
        drag = self._by_cell((s * gamma * (1 - a * gamma))[:, None, None] * pairs)
        pressure = self._by_cell((s * V * (a * gamma - 1))[:, None] * phi)
        carried = self._by_cell((s * V * self.flux_mobility * gamma)[:, None] * phi)
        diffusion = self._by_cell(s * V**2 * self.flux_mobility)
        volume_flux = self._by_cell((s * V)[:, None] * self.flux_velocity)
        force = self._by_cell((s * gamma)[:, None, None] * phi[:, :, None] * b[:, None, :])
        solid = self._by_cell((s * V)[:, None, None] * pairs)
        force -= solid @ weight[self.mesh.nodes[self.cells]]

        gradient = self.mesh.gradient[self.cells]
        time = stabilisation.time[self.cells, None]
        along = time * np.einsum("ci,cai->ca", stabilisation.direction[self.cells], gradient)
        across = time[..., None] / density * gradient
        # Residual of the grains in a cell: drag u + pressure grad p - force.
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

    def energy(self, direction: Floats, time: Floats, lumped: bool) -> tuple[Floats, Floats]:
        """-<q_p, S + xi_T U . grad S>, with U (m, D) and xi_T (m) as ``direction`` and ``time``.

        If ``lumped``, the rows of -<q_p, S> are summed on the diagonal.

        Returns matrices (c, B, B) and right-hand sides (c, B).
        """
        phi, hA = self.shape, self.share * self.coefficient
        slip = hA * (1 - self.heat_mobility * self.coefficient)
        exchange = self._by_cell(slip[:, None, None] * phi[:, :, None] * phi[:, None, :])
        given = self._by_cell((hA * self.temperature)[:, None] * phi)
        gradient = self.mesh.gradient[self.cells]
        along = time[self.cells, None] * np.einsum("ci,cai->ca", direction[self.cells], gradient)
        total = exchange.sum(axis=1)  # of rows as of columns
        matrix = total[:, :, None] * np.eye(total.shape[1]) if lumped else exchange
        matrix = matrix + along[:, :, None] * total[:, None, :]
        return matrix, given + along * given.sum(axis=1)[:, None]

    def _at(self, fields: Fields) -> tuple[Floats, Floats]:
        """u and grad p at the pieces, (q, D) each."""
        u = np.einsum("qa,qai->qi", self.shape, fields.velocity[self.nodes])
        return u, np.einsum("qa,qai->qi", fields.pressure[self.nodes], self.gradient)

    def _temperature(self, fields: Fields) -> Floats:
        return np.einsum("qa,qa->q", self.shape, fields.temperature[self.nodes])

    def _push(self, u: Floats, slope: Floats) -> Floats:
        """gamma u - V grad p at the pieces, (q, D)."""
        return self.drag[:, None] * u - self.volume[:, None] * slope

    def make_rigid(self, fields: Fields, voidage: Floats, density: float, dt: float) -> None:
        """Takes from the law of the flux what it gives a piece beyond its grain in the given fields.

        Call it with the last accepted fields where the flux has a law of its own. b becomes
        b - c a (f - mean of f over the grain, weighted by c), with f = gamma u - V grad p. What a
        piece gives way by takes X = a (gamma/eps + rho V/dt) (1 - eps)/eps times the difference of
        push from it; c = 1/(1 + X/100), for in cells full of grain, X without bound, only the
        mobility at the pieces couples the pressures.
        """
        push = self._push(*self._at(fields))
        eps = np.maximum(np.einsum("qa,qa->q", self.shape, voidage[self.nodes]), LEAST)
        inertia = density * self.volume / dt
        lasting = self.flux_mobility * (self.drag + eps * inertia) * (1 - eps) / LASTING
        c = (eps**2 / (eps**2 + lasting))[:, None]
        mean = self._mean(c * push)[self.grain] / self._mean(c)[self.grain]
        self.flux_velocity = self.flux_velocity - self.flux_mobility[:, None] * c * (push - mean)

    def solid_flux(self, fields: Fields) -> Floats:
        """Nodal projection (A.15) of phi v, v the law of the flux at the given fields, (n, D)."""
        v = self.flux_velocity + self.flux_mobility[:, None] * self._push(*self._at(fields))
        moved = (self.share * self.volume)[:, None] * v
        nodes, volume = self.nodes.ravel(), self.mesh.nodal_volume
        parts = [self.shape * component[:, None] for component in moved.T]
        sums = [np.bincount(nodes, part.ravel(), len(volume)) for part in parts]
        return np.stack(sums, axis=1) / volume[:, None]

    def sample(self, fields: Fields) -> AtGrains:
        """Means of the fields over the pieces of each grain."""
        u, slope = self._at(fields)
        temperature = None
        if fields.temperature is not None:
            temperature = self._mean(self._temperature(fields))
        return AtGrains(self._mean(u), self._mean(slope), temperature)

    def exchanged(self, fields: Fields) -> tuple[Floats, float]:
        """Force (N) and heat (W) that the fluid gives to all grains, summed piece by piece."""
        push = self._push(*self._at(fields))
        law = self.velocity + self.mobility[:, None] * push
        force = push - self.drag[:, None] * law
        heat = 0.0
        if self.heated:
            T, hA = self._temperature(fields), self.coefficient
            heat = float(self.share @ (hA * (T - self.temperature - self.heat_mobility * hA * T)))
        return self.share @ force, heat
