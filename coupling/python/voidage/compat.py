"""The only place that knows which dolfinx is there.

The tests run with 0.5.2 (Debian 12) and 0.11.0. What differs among the versions from 0.5.2 to 0.11 in the
calls of this package:

- 0.7: ``fem.functionspace`` makes all spaces, ``VectorFunctionSpace`` is gone; elements of meshes come from
  ``basix.ufl``; tables of dofs are arrays, no adjacency lists.
- 0.10: ``mesh.create_mesh`` takes the element before the points.
- 0.11: the geometry has a list ``dofmaps``, and warns of ``dofmap``; until 0.10 ``dofmaps`` is a method, or is
  not there.
- Builds of PETSc: indices of 32 or of 64 bits (``PETSc.IntType``), with or without hypre.
"""

import inspect

import numpy as np
import ufl
from dolfinx import fem, mesh
from petsc4py import PETSc

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


def geometry_dofs(geometry):
    """Nodes of every local cell in the numbers of the geometry."""
    dofmaps = getattr(geometry, "dofmaps", None)
    return geometry.dofmap if dofmaps is None or callable(dofmaps) else dofmaps[0]


def multigrid() -> str:
    """PETSc's name of an algebraic multigrid that this build has."""
    return "hypre" if PETSc.Sys.hasExternalPackage("hypre") else "gamg"


def table(adjacency, cells: int) -> Integers:
    """Dofs or nodes of every local cell: an adjacency list until 0.6, an array later."""
    return np.asarray(getattr(adjacency, "array", adjacency)).reshape(cells, -1)
