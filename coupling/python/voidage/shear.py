"""The shear that grains share with the fluid, cell by cell; why it is this one says fluid/src/shear.rs."""

import numpy as np
import scipy.sparse as sp

from .cells import Cells
from .solver import Floats, Points

SPREAD = 0.01
"""Square of the spread of places, over that of the size of a cell, that tells hardly anything of a gradient."""


def shared_shear(
    mesh: Cells, points: Points, place: Floats, velocities: tuple[Floats, Floats], nodal: Floats
) -> Floats:
    """H = s (2 - s) grad u in the cells, (m, D, D), 1/s; zero in those without points.

    ``velocities`` are those of fluid and points at the places of these, (q, D), and ``nodal`` those of
    the fluid, (n, D). The share s is the slope of the regression of the velocities of the points on those
    of the fluid, by covariances with the places in the cells around the nodes.
    """
    cells, D = len(mesh.nodes), nodal.shape[1]
    centroid, q = mesh.places.mean(axis=1), np.arange(len(points.cell))
    in_cell = sp.csr_array((points.drag, (points.cell, q)), (cells, len(q)))
    corners = [sp.csr_array((np.ones(cells), (of, np.arange(cells))), (len(nodal), cells)) for of in mesh.masters.T]

    def around(sums: Floats, *shifted: Floats) -> Floats:
        """Sums over the cells around each node, (n, ..). Of products with places, which are seen from the
        node, ``shifted`` are the sums without them."""
        total = np.zeros((len(nodal), sums[0].size))
        for a, corner in enumerate(corners):
            origin = centroid - mesh.places[:, a]
            moved = sum((np.einsum("m...,mj->m...j", each, origin) for each in shifted), sums)
            total += corner @ moved.reshape(cells, -1)
        return total.reshape(len(nodal), *sums.shape[1:])

    drag, away = in_cell.sum(axis=1), place - centroid[points.cell]
    weight = np.maximum(around(drag), np.finfo(float).tiny)
    mean_place = around(in_cell @ away, drag) / weight[:, None]
    K = []
    for velocity in velocities:
        sums = in_cell @ velocity
        products = in_cell @ np.einsum("qi,qj->qij", velocity, away).reshape(len(q), -1)
        products = around(products.reshape(cells, D, D), sums)
        K.append(products - np.einsum("ni,nj->nij", around(sums), mean_place))
    fluid, shared = (((k * K[0]).sum(axis=(1, 2)) / weight)[mesh.masters].sum(axis=1) for k in K)
    gradient = np.einsum("mai,maj->mij", nodal[mesh.masters], mesh.gradient)
    least = (SPREAD * mesh.size**2) ** 2 * (gradient**2).sum(axis=(1, 2))
    fluid += weight[mesh.masters].sum(axis=1) * least
    share = np.clip(np.divide(shared, fluid, out=np.zeros(cells), where=fluid > 0), 0, 1)
    return gradient * (share * (2 - share) * (drag > 0))[:, None, None]
