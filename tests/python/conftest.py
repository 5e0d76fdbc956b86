"""Meshes, random points, and the solvers that this interpreter can run."""

import contextlib
import dataclasses
import importlib
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "coupling" / "python"))

# Wheels of dolfinx find the MPI that mpi4py has loaded.
with contextlib.suppress(ImportError):
    import mpi4py.MPI  # noqa: F401

from voidage.boundary import area_vectors
from voidage.cells import Cells
from voidage.solver import Fields, Points, PointScalar, Problem


def box(n: int, dimension: int, lower: float = 0.0, upper: float = 1.0):
    """A cube of n cells a side, each cut into D! simplices; its sides are x0, x1, y0, .."""
    axis = np.linspace(lower, upper, n + 1)
    points = np.stack(np.meshgrid(*[axis] * dimension, indexing="ij"), axis=-1).reshape(
        -1, dimension
    )
    stride = (n + 1) ** np.arange(dimension - 1, -1, -1)
    corners = np.stack(np.meshgrid(*[np.arange(n)] * dimension, indexing="ij"), axis=-1)
    corners = corners.reshape(-1, dimension) @ stride
    cells = []
    for order in itertools.permutations(range(dimension)):
        offset = np.concatenate(([0], np.cumsum(stride[list(order)])))
        if np.linalg.det(np.eye(dimension)[list(order)]) < 0:
            offset[-2:] = offset[-1], offset[-2]
        cells.append(corners[:, None] + offset)
    cells = np.concatenate(cells)
    return points, cells, sides(points, cells, lower, upper)


def sides(points, cells, lower: float, upper: float):
    """Facets of the sides x0, x1, y0, .. of a cube."""
    return {
        f"{'xyz'[k]}{side}": _facets(points, cells, k, value, outward)
        for k in range(points.shape[1])
        for side, value, outward in ((0, lower, -1.0), (1, upper, 1.0))
    }


def _facets(points, cells, axis, value, outward):
    found = []
    for skip in range(cells.shape[1]):
        facets = np.delete(cells, skip, axis=1)
        found.append(facets[(points[facets, axis] == value).all(axis=1)])
    facets = np.concatenate(found)
    edges = points[facets[:, 1:]] - points[facets[:, :1]]
    if points.shape[1] == 2:
        turned = np.stack((edges[:, 0, 1], -edges[:, 0, 0]), axis=1)
    else:
        turned = np.cross(edges[:, 0], edges[:, 1])
    wrong = turned[:, axis] * outward < 0
    facets[wrong, :2] = facets[wrong, 1::-1]
    return facets


def with_holes(problem: Problem, width: float, **centres) -> Problem:
    """The problem without the cells of cubes of a width; their sides are parts of these names."""
    inside = {
        name: (abs(problem.points[problem.cells].mean(axis=1) - x) < width / 2).all(axis=1)
        for name, x in centres.items()
    }
    kept = problem.cells[~np.any(list(inside.values()), axis=0)]
    nodes, cells = np.unique(kept, return_inverse=True)
    number = np.zeros(len(problem.points), dtype=int)
    number[nodes] = np.arange(len(nodes))
    parts = {name: number[facets] for name, facets in problem.boundaries.items()}
    parts |= {name: number[_surface(problem, problem.cells[of])] for name, of in inside.items()}
    fields = Fields(problem.fields.velocity[nodes], problem.fields.pressure[nodes])
    return dataclasses.replace(
        problem,
        points=problem.points[nodes],
        cells=cells.reshape(kept.shape),
        boundaries=parts,
        fields=fields,
    )


def _surface(problem, cells):
    """Facets around cells, with normals into them."""
    facets = np.concatenate([np.delete(cells, skip, axis=1) for skip in range(cells.shape[1])])
    within = np.tile(problem.points[cells].mean(axis=1), (cells.shape[1], 1))
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    facets, within = facets[first[count == 1]], within[first[count == 1]]
    inward = within - problem.points[facets].mean(axis=1)
    wrong = np.einsum("ki,ki->k", area_vectors(problem.points, facets), inward) < 0
    facets[wrong, :2] = facets[wrong, 1::-1]
    return facets


def scatter(rng, points, cells, held=False, within: int | None = None, scalars: int = 0):
    """Random points, in the first cells, that exchange all of so many scalars, and the voidage they
    make."""
    count, dimension, mesh = 60, points.shape[1], Cells(points, cells)
    still = 0.0 if held else 1.0

    def law():
        """Coefficient and mobility."""
        coefficient = rng.random(count)
        return coefficient, still * 0.9 * rng.random(count) / coefficient

    cell = rng.integers(0, within or len(cells), count)
    shape = rng.dirichlet(np.ones(dimension + 1), count)
    volume = 0.2 * mesh.measure[:within].sum() / count * rng.random(count)
    drag, mobility = law()
    immersed = Points(
        cell,
        shape,
        volume,
        drag,
        mobility,
        still * rng.standard_normal((count, dimension)),
        mobility * rng.random(count),
        still * rng.standard_normal((count, dimension)),
        tuple(PointScalar(*law(), 300 + 20 * rng.random(count)) for _ in range(scalars)),
    )
    solid = np.zeros(len(points))
    np.add.at(solid, cells[cell], volume[:, None] * shape)
    return immersed, np.maximum(1 - solid / mesh.nodal_volume, 1e-8)


def problem(n: int, dimension: int, lower: float = 0.0, upper: float = 1.0, **changes) -> Problem:
    """A box of fluid at rest."""
    points, cells, boundaries = box(n, dimension, lower, upper)
    rest = Fields(np.zeros_like(points), np.zeros(len(points)))
    common = dict(density=1.3, viscosity=0.02, gravity=np.zeros(dimension), fields=rest)
    return Problem(points, cells, boundaries, **common | changes)


SOLVERS = {
    "scikit-fem": ("voidage.scikit_fem", "ScikitFem", {}),
    "fenicsx": ("voidage.fenicsx", "FEniCSx", {}),
    "fenicsx-iterative": ("voidage.fenicsx", "FEniCSx", {"linear": "iterative"}),
}


@pytest.fixture(params=SOLVERS)
def solver(request):
    """A new solver of every kind that is installed for this interpreter."""
    module, name, options = SOLVERS[request.param]
    pytest.importorskip("skfem" if "scikit" in module else "dolfinx")
    return getattr(importlib.import_module(module), name)(**options)


@pytest.fixture(scope="session")
def program():
    """The program voidage: that of VOIDAGE_PROGRAM, or built here."""
    if "VOIDAGE_PROGRAM" in os.environ:
        return os.environ["VOIDAGE_PROGRAM"]
    command = ["cargo", "build", "-q", "--release", "--locked", "-p", "voidage"]
    subprocess.run(command, cwd=ROOT, check=True)
    return ROOT / "target" / "release" / "voidage"


@pytest.fixture
def rng():
    return np.random.default_rng(3)
