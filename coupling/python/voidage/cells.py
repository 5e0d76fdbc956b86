"""Cells of the mesh: shape functions of the P1 simplex and the stabilisation times A.10 to A.12."""

import math

import numpy as np

from .solver import Floats, Integers, Problem


class Cells:
    """Geometry of all cells of a mesh; m counts cells, B = D + 1 their nodes."""

    def __init__(self, points: Floats, cells: Integers):
        dimension = points.shape[1]
        edges = points[cells[:, 1:]] - points[cells[:, :1]]
        inverse = np.linalg.inv(edges).transpose(0, 2, 1)
        self.nodes = cells
        """(m, B)."""
        self.content = np.linalg.det(edges)
        """D! times the measure, (m)."""
        self.measure = self.content / math.factorial(dimension)
        """Area or volume, (m)."""
        self.gradient = np.concatenate((-inverse.sum(axis=1, keepdims=True), inverse), axis=1)
        """Gradients of the shape functions, (m, B, D)."""
        self.size = self.content ** (1 / dimension)
        """Leg of the right simplex of equal measure, the length h of the stabilisation, (m)."""
        share = np.repeat(self.measure / (dimension + 1), dimension + 1)
        self.nodal_volume = np.bincount(cells.ravel(), share, len(points))
        """Integral of the shape function of every node, (n)."""
        self.volume = self.measure.sum()
        """Area or volume of the mesh."""

    def mean(self, nodal: Floats) -> Floats:
        """Value at the centroid of every cell."""
        return nodal[self.nodes].mean(axis=1)

    def nodal_mean(self, nodal: Floats) -> float:
        """Mean of a nodal field over the mesh."""
        return float(self.nodal_volume @ nodal / self.volume)

    def gradient_integral(self) -> Floats:
        """Integral of the gradient of every shape function, (n, D)."""
        integral = np.zeros((len(self.nodal_volume), self.gradient.shape[2]))
        np.add.at(integral, self.nodes, self.measure[:, None, None] * self.gradient)
        return integral


def stabilisation_time(
    dt: float, speed: Floats, size: Floats, nu: float, reaction: Floats
) -> Floats:
    """1/xi^2 = (2/dt)^2 + (|U|/h)^2 + (4 nu/h^2)^2 + reaction^2 (A.11, A.12)."""
    return ((2 / dt) ** 2 + (speed / size) ** 2 + (4 * nu / size**2) ** 2 + reaction**2) ** -0.5


class Stabilisation:
    """Stabilisation of momentum and mass in every cell, from U = u_n - u_mesh at the centroid,
    ``wind`` at the nodes."""

    def __init__(
        self, problem: Problem, cells: Cells, wind: Floats, dt: float, reaction: Floats
    ):
        nu = problem.viscosity / problem.density
        self.direction = cells.mean(wind)
        """U, (m, D)."""
        speed = np.linalg.norm(self.direction, axis=1)
        self.time = stabilisation_time(dt, speed, cells.size, nu, reaction)
        """xi_u = xi_p, (m)."""
        peclet = cells.size * speed / (6 * nu)
        self.incompressibility = cells.size * speed * np.minimum(peclet, 0.5)
        """xi_c, m2/s, (m)."""
