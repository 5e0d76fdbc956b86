"""Mesh and linear systems of :mod:`voidage.fenicsx`.

Every rank is given the whole problem and gets the whole solution; mesh, matrices and solution are
divided among them.
"""

from typing import NamedTuple

import numpy as np
import petsc4py

petsc4py.init(["voidage", "-no_signal_handler"])  # else PETSc turns a closed pipe into MPI_Abort

import ufl  # noqa: E402
from dolfinx import fem, mesh  # noqa: E402
from dolfinx.fem import petsc  # noqa: E402
from petsc4py import PETSc  # noqa: E402

from . import compat  # noqa: E402
from .finite_elements import NEARLY_SINGULAR  # noqa: E402
from .solver import Floats, Integers, Problem, Report  # noqa: E402

ATTEMPTS = 3
"""Iterations from the true residual of the last one, at most."""


class Blocks(NamedTuple):
    """Matrices and right-hand sides of cells."""

    cells: Integers
    matrix: Floats
    rhs: Floats


class Layout:
    """Where nodes, cells and boundaries of the problem lie in the mesh of this rank."""

    def __init__(self, domain, problem: Problem):
        self.domain, self.problem = domain, problem
        cells = domain.topology.index_map(domain.topology.dim)
        local = cells.size_local + cells.num_ghosts
        self.space = compat.space(domain, "Lagrange", 1)
        dofs = compat.table(self.space.dofmap.list, local)
        self.geometry_node = np.asarray(domain.geometry.input_global_indices)
        self.node = np.empty(dofs.max() + 1, dtype=int)
        """Node of the problem at every dof, the owned ones first."""
        self.node[dofs] = self.geometry_node[compat.table(domain.geometry.dofmap, local)]
        self.dof = np.full(len(problem.points), -1, dtype=PETSc.IntType)
        self.dof[self.node] = np.arange(len(self.node))
        self.cell = np.asarray(domain.topology.original_cell_index)[:local]
        """Cell of the problem at every cell, the owned ones first."""
        self.owned_cell = np.zeros(len(problem.cells), dtype=bool)
        self.owned_cell[self.cell[: cells.size_local]] = True
        self.nodes = self.space.dofmap.index_map
        self.owned_node = self.node[: self.nodes.size_local]

    def move(self, points: Floats) -> None:
        """Puts the nodes of the mesh elsewhere."""
        self.domain.geometry.x[:, : points.shape[1]] = points[self.geometry_node]

    def nodal(self, components: int = 0) -> fem.Function:
        """A P1 field, of vectors with some components if there are any."""
        space = compat.space(self.domain, "Lagrange", 1, components) if components else self.space
        return fem.Function(space)

    def cellwise(self, components: int = 0) -> fem.Function:
        """A field constant in every cell."""
        return fem.Function(compat.space(self.domain, "DG", 0, components))

    def fill(self, field: fem.Function, values: Floats) -> None:
        """Takes the values of all nodes of the problem."""
        field.x.array[:] = values[self.node].ravel()

    def fill_cells(self, field: fem.Function, values: Floats) -> None:
        """Takes the values of all cells of the problem."""
        field.x.array[:] = values[self.cell].ravel()

    def facet_tags(self, problem: Problem):
        """The facets of every named part, by its number."""
        number = {
            tuple(facet): k
            for k, facets in enumerate(problem.boundaries.values())
            for facet in np.sort(facets, axis=1).tolist()
        }
        facets, nodes = compat.boundary_facets(self.domain)
        nodes = np.sort(self.geometry_node[nodes.reshape(len(facets), problem.dimension)], axis=1)
        values = np.array([number[tuple(facet)] for facet in nodes.tolist()], dtype=np.int32)
        order = np.argsort(facets)
        return mesh.meshtags(self.domain, problem.dimension - 1, facets[order], values[order])

    def gather(self, owned: Floats) -> Floats:
        """All nodal values, of the values at the nodes that the ranks own."""
        everything = np.zeros((len(self.problem.points), owned.shape[1]))
        everything[self.owned_node] = owned
        return self.domain.comm.allreduce(everything)


class Linear:
    """A linear system: its forms, the matrices of the points, the held unknowns, and the solver."""

    def __init__(
        self,
        layout: Layout,
        matrix: ufl.Form,
        rhs: ufl.Form,
        iterative: bool,
        monotone: bool = False,
    ):
        self.layout, self.iterative, self.monotone = layout, iterative, monotone
        self.matrix_form, self.rhs_form = fem.form(matrix), fem.form(rhs)
        self.matrix = petsc.create_matrix(self.matrix_form)
        self.rhs = petsc.assemble_vector(self.rhs_form)  # the vector; its values come later
        self.components = self.rhs.block_size

    def solve(
        self, blocks: Blocks, free: Floats, value: Floats, report: Report
    ) -> tuple[Floats, Floats, float]:
        """Solves where the nodes are ``free`` (a projector each, :mod:`voidage.boundary`).

        The rest is ``value``: the conditions take the place of the equations that fall away, scaled
        as the diagonal that they had. Returns x and A x - b without them, one row per node, and the
        residual of what was solved relative to the right-hand side, both scaled to a unit diagonal.
        """
        self._assemble(blocks)
        A, b = self._hold(free[self.layout.owned_node], value[self.layout.owned_node])
        unit = A.getDiagonal()
        unit.sqrtabs()
        unit.reciprocal()
        A.diagonalScale(unit, unit)
        b.pointwiseMult(b, unit)
        ksp = self._solver(A)
        x = A.createVecRight()
        tolerance = self.layout.problem.tolerance
        for attempt in range(ATTEMPTS if self.iterative else 1):
            # From where the last one ended: what an iteration believes to be left is not what is.
            ksp.setInitialGuessNonzero(attempt > 0)
            ksp.solve(b, x)
            report.iterations += ksp.getIterationNumber()
            residual = (b - A * x).norm() / (b.norm() or 1.0)
            if residual <= tolerance:
                break
        if not residual <= (tolerance if self.iterative else max(tolerance, NEARLY_SINGULAR)):
            text = f"the linear system was not solved: its relative residual is {residual:.1e}"
            raise ArithmeticError(text)
        x.pointwiseMult(x, unit)
        left = self.matrix * x - self.rhs
        found = (self.layout.gather(each.array.reshape(-1, self.components)) for each in (x, left))
        solution, unheld = found
        PETSc.garbage_cleanup(A.comm)  # with several ranks nothing is freed before
        return solution, unheld, residual

    def _assemble(self, blocks: Blocks) -> None:
        A, b = self.matrix, self.rhs
        A.zeroEntries()
        petsc.assemble_matrix(A, self.matrix_form)
        A.assemble()
        with b.localForm() as local:
            local.set(0)
        petsc.assemble_vector(b, self.rhs_form)
        self._add(blocks)
        A.assemble()
        if self.monotone:
            self._upwind()
        b.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)

    def _add(self, blocks: Blocks) -> None:
        mine = self.layout.owned_cell[blocks.cells]
        if not mine.any():  # petsc4py divides by their number
            return
        dofs = self.layout.dof[self.layout.problem.cells[blocks.cells[mine]]]
        dense = blocks.matrix[mine].reshape(len(dofs), -1)
        self.matrix.setValuesBlockedLocalRCV(dofs, dofs, dense, PETSc.InsertMode.ADD_VALUES)
        unknowns = (self.components * dofs[:, :, None] + np.arange(self.components)).ravel()
        with self.rhs.localForm() as local:
            local.array += np.bincount(unknowns, blocks.rhs[mine].ravel(), local.size)

    def _upwind(self) -> None:
        """Moves max(a_ij, a_ji, 0) from the entries ij and ji to the diagonal of i and j."""
        A = self.matrix
        first, columns, entries = A.getValuesCSR()
        # Two nodes couple in both directions, so the transpose has its entries in the same places.
        excess = np.maximum(np.maximum(entries, A.transpose(PETSc.Mat()).getValuesCSR()[2]), 0)
        rows = np.repeat(np.arange(len(first) - 1), np.diff(first))
        diagonal = columns == rows + A.getOwnershipRange()[0]
        excess[diagonal] = 0
        excess[diagonal] = -np.bincount(rows, excess, len(first) - 1)
        csr = first, columns, -excess
        change = PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=A.comm)
        A.axpy(1.0, change, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)

    def _hold(self, free: Floats, value: Floats) -> tuple[PETSc.Mat, PETSc.Vec]:
        """P A + S (1 - P) and P b + S (1 - P) g, with P the projectors and S the diagonal of A."""
        projector = self._block_diagonal(free)
        A = projector.matMult(self.matrix)
        scale = np.abs(self.matrix.getDiagonal().array).reshape(-1, self.components, 1)
        held = self._block_diagonal(scale * (np.eye(self.components) - free))
        A.axpy(1.0, held, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        known = held.createVecRight()
        known.array = value.ravel()
        return A, projector * self.rhs + held * known

    def _block_diagonal(self, blocks: Floats) -> PETSc.Mat:
        count, size = len(blocks), self.components
        first = size * (self.layout.nodes.local_range[0] + np.arange(count))
        columns = np.broadcast_to(first[:, None, None] + np.arange(size), blocks.shape)
        rows = np.arange(count * size + 1, dtype=PETSc.IntType) * size
        csr = rows, columns.ravel().astype(PETSc.IntType), blocks.ravel()
        return PETSc.Mat().createAIJ(
            [[count * size, None]] * 2, csr=csr, comm=self.layout.domain.comm
        )

    def _solver(self, A: PETSc.Mat) -> PETSc.KSP:
        ksp = PETSc.KSP().create(A.comm)
        ksp.setOperators(A)
        pc = ksp.getPC()
        if not self.iterative:  # two Richardson steps: a solution and its refinement
            ksp.setType("richardson")
            ksp.setTolerances(rtol=0, atol=0, max_it=2)
            pc.setType("lu")
            pc.setFactorSolverType("mumps")
            return ksp
        ksp.setType("fgmres")
        ksp.setTolerances(rtol=0.5 * self.layout.problem.tolerance, max_it=500)
        ksp.setGMRESRestart(100)
        if self.components == 1:
            pc.setType("hypre")
            return ksp
        pc.setType("fieldsplit")
        start, stop = A.getOwnershipRange()
        dofs = np.arange(start, stop, dtype=PETSc.IntType).reshape(-1, self.components)
        velocity, pressure = (
            PETSc.IS().createGeneral(part.ravel(), A.comm) for part in (dofs[:, :-1], dofs[:, -1:])
        )
        velocity.setBlockSize(self.components - 1)
        pc.setFieldSplitIS(("u", velocity), ("p", pressure))
        pc.setFieldSplitType(PETSc.PC.CompositeType.SCHUR)
        pc.setFieldSplitSchurFactType(PETSc.PC.SchurFactType.UPPER)
        # Stabilisation and mobility of the points make the pressure block a fair Schur complement.
        # The other choice, SELFP, saves a third of the iterations in most flows, but does not
        # converge in a packed bed.
        pc.setFieldSplitSchurPreType(PETSc.PC.SchurPreType.A11)
        pc.setUp()
        for part in pc.getFieldSplitSubKSP():
            part.setType("preonly")
            part.getPC().setType("hypre")
        return ksp
