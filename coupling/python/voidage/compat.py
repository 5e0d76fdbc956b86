"""The only place that knows which dolfinx is there.

Run with 0.5.2 (Debian 12); the names of later versions stand beside.
"""

import inspect

import numpy as np
import ufl
from dolfinx import fem, mesh

from .solver import Floats, Integers


def create_mesh(comm, cells: Integers, points: Floats):
    """A mesh of simplices; only the arrays of the first rank count."""
    shape = {2: "triangle", 3: "tetrahedron"}[points.shape[1]]
    if comm.rank != 0:
        cells, points = cells[:0], points[:0]
    if not hasattr(fem, "functionspace"):  # until 0.7
        element = ufl.VectorElement("Lagrange", ufl.Cell(shape, points.shape[1]), 1)
        return mesh.create_mesh(comm, cells, points, ufl.Mesh(element))
    import basix.ufl

    domain = ufl.Mesh(basix.ufl.element("Lagrange", shape, 1, shape=(points.shape[1],)))
    if list(inspect.signature(mesh.create_mesh).parameters)[2] == "x":  # until 0.9
        return mesh.create_mesh(comm, cells, points, domain)
    return mesh.create_mesh(comm, cells, domain, points)


def space(domain, family: str, degree: int, components: int = 0):
    """A space of scalars or, blocked, of vectors with some components."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(
            domain, (family, degree, (components,)) if components else (family, degree)
        )
    if components:
        return fem.VectorFunctionSpace(domain, (family, degree), dim=components)
    return fem.FunctionSpace(domain, (family, degree))


def table(adjacency, cells: int) -> Integers:
    """Dofs or nodes of every local cell: an adjacency list until 0.6, an array later."""
    return np.asarray(getattr(adjacency, "array", adjacency)).reshape(cells, -1)
