"""Cells of the mesh and places in it: shape functions of the P1 simplex, sums over places."""

import math

import numpy as np
import scipy.sparse as sp

from .solver import Floats, Integers

Terms = tuple[sp.csr_array, Floats]
"""Matrix and right-hand side of an equation; the unknowns of a node follow one another."""


class Cells:
    """Geometry of all cells of a mesh; m counts cells, B = D + 1 their nodes."""

    def __init__(self, points: Floats, cells: Integers, masters: Integers | None = None):
        dimension = points.shape[1]
        edges = points[cells[:, 1:]] - points[cells[:, :1]]
        inverse = np.linalg.inv(edges).transpose(0, 2, 1)
        content = np.linalg.det(edges)
        self.nodes = cells
        """(m, B)."""
        self.places = points[cells]
        """Those of the nodes, (m, B, D)."""
        self.measure = content / math.factorial(dimension)
        """Area or volume, (m)."""
        self.gradient = np.concatenate((-inverse.sum(axis=1, keepdims=True), inverse), axis=1)
        """Gradients of the shape functions, (m, B, D)."""
        self.size = content ** (1 / dimension)
        """Leg of the right simplex of equal measure, the length h of the stabilisation, (m)."""
        share = np.repeat(self.measure / (dimension + 1), dimension + 1)
        self.masters = cells if masters is None else masters[cells]
        """Those of which the nodes have the values, (m, B)."""
        self.nodal_volume = np.bincount(self.masters.ravel(), share, len(points))
        """Integral of the shape function of every node, (n); zero at images of others."""

    def mean(self, nodal: Floats) -> Floats:
        """Value at the centroid of every cell."""
        return nodal[self.nodes].mean(axis=1)


class Places:
    """Places in a mesh of n nodes; q counts them, B the nodes around each."""

    def __init__(self, nodes: Integers, shape: Floats, count: int):
        self.nodes, self.shape, self.count = nodes, shape, count
        """Nodes around each place and their shape functions, (q, B), and n."""

    def at(self, nodal: Floats) -> Floats:
        """Nodal values at the places, (q, ..)."""
        return np.einsum("qa,qa...->q...", self.shape, nodal[self.nodes])

    def rows(self, weights: Floats, component: int = 0, of: int = 1) -> sp.csr_array:
        """Sums with ``weights``, (q, B), of a component of the unknowns around each place, as a
        matrix (q, n of) for unknowns of which every node has ``of``."""
        first = np.arange(0, self.nodes.size + 1, self.nodes.shape[1])
        entries = weights.ravel(), (of * self.nodes + component).ravel(), first
        return sp.csr_array(entries, (len(self.nodes), of * self.count))

    def nothing(self, of: int = 1) -> Terms:
        """Terms that are zero."""
        size = of * self.count
        return sp.csr_array((size, size)), np.zeros(size)


def stabilisation_time(
    cells: Cells, U: Floats, dt: float, diffusivity: float, reaction: Floats | float = 0.0
) -> Floats:
    """xi of 1/xi^2 = (2/dt)^2 + (|U|/h)^2 + (4 nu/h^2)^2 + reaction^2 (A.11, A.12), (m); U is that
    at the centroids, (m, D)."""
    convection, diffusion = np.linalg.norm(U, axis=1) / cells.size, 4 * diffusivity / cells.size**2
    return ((2 / dt) ** 2 + convection**2 + diffusion**2 + reaction**2) ** -0.5
