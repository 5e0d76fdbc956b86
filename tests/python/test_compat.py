"""The layer between the FEniCSx solver and the versions of dolfinx, with stand-ins for their calls."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import voidage

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
CELLS = np.array([[0, 1, 2]])
VERSIONS = ["0.5", "0.7", "0.10", "0.11"]


def module(name: str, **content) -> ModuleType:
    made = ModuleType(name)
    vars(made).update(content)
    return made


def create_mesh_of(version: str):
    """With the parameters of a version; it returns them by name."""
    if version in ("0.5", "0.7"):

        def create_mesh(comm, cells, x, domain, partitioner=None):
            return SimpleNamespace(comm=comm, cells=cells, points=x, element=domain)
    else:

        def create_mesh(comm, cells, e, x, partitioner=None, max_facet_to_cell_links=2):
            return SimpleNamespace(comm=comm, cells=cells, points=x, element=e)

    return create_mesh


def modules_of(version: str, packages: set[str]) -> dict[str, ModuleType]:
    """Stand-ins for what a version has, and not for what it has no longer or not yet."""
    ufl = module("ufl", Mesh=lambda element: ("mesh", element))
    fem = module("dolfinx.fem", Function=object)
    found = {"ufl": ufl, "dolfinx.fem": fem}
    if version == "0.5":
        ufl.Cell = lambda shape, dimension: (shape, dimension)
        ufl.VectorElement = lambda family, cell, degree: (family, *cell, degree)
        fem.FunctionSpace = lambda domain, element: (domain, *element)
        fem.VectorFunctionSpace = lambda domain, element, dim: (domain, *element, (dim,))
    else:
        fem.functionspace = lambda domain, element: (domain, *element)
        of = lambda family, cell, degree, shape: (family, cell, *shape, degree)  # noqa: E731
        found["basix.ufl"] = module("basix.ufl", element=of)
        found["basix"] = module("basix", ufl=found["basix.ufl"])
    found["dolfinx.mesh"] = module("dolfinx.mesh", create_mesh=create_mesh_of(version))
    found["dolfinx"] = module("dolfinx", fem=fem, mesh=found["dolfinx.mesh"])
    system = SimpleNamespace(hasExternalPackage=lambda name: name in packages)
    found["petsc4py.PETSc"] = module("petsc4py.PETSc", Sys=system)
    found["petsc4py"] = module("petsc4py", PETSc=found["petsc4py.PETSc"])
    return found


@pytest.fixture
def compat(monkeypatch):
    """Makes the layer anew upon the stand-ins of a version."""

    def make(version: str, packages: set[str] = frozenset()):
        for name, stand_in in modules_of(version, packages).items():
            monkeypatch.setitem(sys.modules, name, stand_in)
        file = Path(voidage.__file__).with_name("compat.py")
        spec = importlib.util.spec_from_file_location("voidage.compat_of_a_test", file)
        made = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(made)
        return made

    return make


@pytest.mark.parametrize("version", VERSIONS)
def test_a_mesh_gets_each_argument_in_its_place(compat, version):
    comm = SimpleNamespace(rank=0)
    made = compat(version).create_mesh(comm, CELLS, POINTS)
    assert made.comm is comm and made.cells is CELLS and made.points is POINTS
    assert made.element == ("mesh", ("Lagrange", "triangle", 2, 1))


@pytest.mark.parametrize("version", VERSIONS)
def test_only_the_first_rank_gives_a_mesh(compat, version):
    made = compat(version).create_mesh(SimpleNamespace(rank=1), CELLS, np.zeros((4, 3)))
    assert made.cells.shape == (0, 3) and made.points.shape == (0, 3)
    assert made.element == ("mesh", ("Lagrange", "tetrahedron", 3, 1))


@pytest.mark.parametrize("version", VERSIONS)
def test_spaces_are_of_numbers_or_of_vectors(compat, version):
    layer = compat(version)
    assert layer.space("domain", "DG", 0) == ("domain", "DG", 0)
    assert layer.space("domain", "Lagrange", 1, 3) == ("domain", "Lagrange", 1, (3,))


class Geometry:
    """Of 0.11, where ``dofmap`` warns."""

    dofmaps = [CELLS]

    @property
    def dofmap(self):
        raise DeprecationWarning("dofmap is deprecated. Use dofmaps[0] instead.")


@pytest.mark.parametrize(
    ("version", "geometry"),
    [
        ("0.5", SimpleNamespace(dofmap=SimpleNamespace(array=CELLS.ravel()))),
        ("0.7", SimpleNamespace(dofmap=CELLS)),
        ("0.10", SimpleNamespace(dofmap=CELLS, dofmaps=lambda i: [CELLS][i])),
        ("0.11", Geometry()),
    ],
)
def test_the_geometry_tells_the_nodes_of_cells(compat, version, geometry):
    layer = compat(version)
    np.testing.assert_array_equal(layer.table(layer.geometry_dofs(geometry), 1), CELLS)


@pytest.mark.parametrize(("packages", "name"), [({"hypre", "mumps"}, "hypre"), ({"mumps"}, "gamg")])
def test_multigrid_is_what_petsc_has(compat, packages, name):
    assert compat("0.11", packages).multigrid() == name


def test_the_version_that_is_installed_is_one_of_these():
    """The real calls: one cell."""
    pytest.importorskip("dolfinx")
    from mpi4py import MPI
    from voidage import compat

    mesh = compat.create_mesh(MPI.COMM_SELF, CELLS, POINTS)
    nodes = compat.table(compat.geometry_dofs(mesh.geometry), 1)
    np.testing.assert_allclose(mesh.geometry.x[nodes[0], :2].sum(axis=0), POINTS.sum(axis=0))
    assert compat.space(mesh, "Lagrange", 1, 3).dofmap.index_map_bs == 3
    assert compat.multigrid() in ("hypre", "gamg")
