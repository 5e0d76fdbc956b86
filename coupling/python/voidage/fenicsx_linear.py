"""Mesh and linear systems of :mod:`voidage.fenicsx`.

Every rank is given the whole problem and gets the whole solution; mesh, matrices and solution are
divided among them.
"""

import numpy as np
import scipy.sparse as sp

from . import interpreter

try:
    import petsc4py
except ModuleNotFoundError as error:
    interpreter.explain(error)
    raise
from mpi4py import MPI  # noqa: E402, F401 before PETSc, which in some builds takes the library of MPI that this loads

petsc4py.init(["voidage", "-no_signal_handler"])  # else PETSc turns a closed pipe into MPI_Abort

import ufl  # noqa: E402
from dolfinx import fem  # noqa: E402
from dolfinx.fem import petsc  # noqa: E402
from petsc4py import PETSc  # noqa: E402

from . import compat  # noqa: E402
from .finite_elements import NEARLY_SINGULAR, Beside  # noqa: E402
from .sides import Sides  # noqa: E402
from .solver import Floats, Integers, Problem, Report  # noqa: E402

ATTEMPTS = 3
"""Iterations from the true residual of the last one, at most."""


class Layout:
    """Where nodes and cells of the problem lie in the mesh of this rank."""

    def __init__(self, domain, problem: Problem):
        self.domain, self.problem = domain, problem
        cells = domain.topology.index_map(domain.topology.dim)
        local = cells.size_local + cells.num_ghosts
        self.space = compat.space(domain, "Lagrange", 1)
        dofs = compat.table(self.space.dofmap.list, local)
        self.geometry_node = np.asarray(domain.geometry.input_global_indices)
        self.node = np.empty(dofs.max() + 1, dtype=int)
        """Node of the problem at every dof, the owned ones first."""
        self.node[dofs] = self.geometry_node[compat.table(compat.geometry_dofs(domain.geometry), local)]
        self.cell = np.asarray(domain.topology.original_cell_index)[:local]
        """Cell of the problem at every cell, the owned ones first."""
        self.nodes = self.space.dofmap.index_map
        self.owned_node = self.node[: self.nodes.size_local]
        numbers = np.arange(*self.nodes.local_range, dtype=float)
        self.number = self.gather(numbers[:, None])[:, 0].astype(PETSc.IntType)
        """Number of every node of the problem among the dofs of all ranks."""

    def move(self, points: Floats) -> None:
        """Puts the nodes of the mesh elsewhere."""
        self.domain.geometry.x[:, : points.shape[1]] = points[self.geometry_node]

    def gather(self, owned: Floats) -> Floats:
        """All nodal values, of the values at the nodes that the ranks own."""
        everything = np.zeros((len(self.problem.points), owned.shape[1]))
        everything[self.owned_node] = owned
        return self.domain.comm.allreduce(everything)


class Coefficients:
    """Known fields of the forms of an equation, by name."""

    def __init__(self, layout: Layout):
        self.layout, self.fields = layout, {}

    def nodal(self, *names: str, components: int = 0) -> list[fem.Function]:
        """P1 fields, of vectors with some components if there are any."""
        return self._make(names, "Lagrange", 1, components, self.layout.node)

    def cellwise(self, *names: str, components: int = 0) -> list[fem.Function]:
        """Fields constant in every cell."""
        return self._make(names, "DG", 0, components, self.layout.cell)

    def _make(self, names, family: str, degree: int, components: int, place: Integers):
        space = compat.space(self.layout.domain, family, degree, components)
        made = [fem.Function(space) for _ in names]
        self.fields |= {name: (field, place) for name, field in zip(names, made, strict=True)}
        return made

    def fill(self, **values: Floats) -> None:
        """Takes the values of all nodes or cells of the problem."""
        for name, of_all in values.items():
            field, place = self.fields[name]
            field.x.array[:] = of_all[place].ravel()


class Load:
    """Nodal values of a linear form."""

    def __init__(self, layout: Layout, form: ufl.Form):
        self.layout, self.form = layout, fem.form(form)
        self.vector = petsc.assemble_vector(self.form)

    def assemble(self) -> Floats:
        """Those of all nodes of the problem, (n, c)."""
        assemble(self.vector, self.form)
        return self.layout.gather(self.vector.array.reshape(-1, self.vector.block_size))


def assemble(vector: PETSc.Vec, form) -> None:
    """Gives a vector the values of a compiled linear form."""
    with vector.localForm() as local:
        local.set(0)
    petsc.assemble_vector(vector, form)
    vector.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)


class Linear:
    """A linear system: its forms, the terms beside them, the held unknowns, and the solver."""

    def __init__(
        self,
        layout: Layout,
        matrix: ufl.Form,
        rhs: ufl.Form,
        iterative: bool,
        monotone: bool = False,
    ):
        self.layout, self.iterative, self.monotone = layout, iterative, monotone
        self.sides = Sides(layout.problem)
        self.matrix_form, self.rhs_form = fem.form(matrix), fem.form(rhs)
        self.of_forms = petsc.create_matrix(self.matrix_form)
        self.matrix = self.of_forms
        """The same with what is beside the forms, of masters alone where the mesh has periodic sides."""
        self.rhs = petsc.assemble_vector(self.rhs_form)  # the vector; its values come later
        self.components = c = self.rhs.block_size
        self.owned = (c * layout.owned_node[:, None] + np.arange(c)).ravel()
        """Which of the unknowns of the problem this rank owns."""

    def solve(self, beside: Beside, report: Report) -> tuple[Floats, Floats]:
        """Solves where the nodes are free, for every right-hand side: that of the forms and those
        of ``beside``. Returns x and A x - b, (r, n, c) each.

        The conditions take the place of the equations that fall away, scaled as the diagonal that
        they had. The residual of what was solved, reported relative to the right-hand side, is that
        of the system scaled to a unit diagonal.
        """
        self._assemble(beside)
        A, projector, held = self._hold(beside.free[self.layout.owned_node])
        unit = A.getDiagonal()
        unit.sqrtabs()
        unit.reciprocal()
        A.diagonalScale(unit, unit)
        ksp, known, found = self._solver(A), unit.duplicate(), []
        report.residual = 0.0
        for rhs, value in zip(beside.rhs, beside.value, strict=True):
            self.rhs.array += rhs[self.owned]
            known.array = value.ravel()[self.owned]
            b = projector * self.rhs + held * known
            b.pointwiseMult(b, unit)
            x = self._iterate(ksp, b, report)
            x.pointwiseMult(x, unit)
            left = self.matrix * x - self.rhs
            pair = (each.array.reshape(-1, self.components) for each in (x, left))
            found.append([self.layout.gather(each) for each in pair])
            self.rhs.set(0)  # the others have nothing of the forms
        PETSc.garbage_cleanup(A.comm)  # with several ranks nothing is freed before
        solution, unheld = zip(*found, strict=True)
        return np.stack(solution), np.stack(unheld)

    def _iterate(self, ksp: PETSc.KSP, b: PETSc.Vec, report: Report) -> PETSc.Vec:
        """Solves a system scaled to a unit diagonal."""
        A, x = ksp.getOperators()[0], b.duplicate()
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
        report.residual = max(report.residual, residual)
        return x

    def _assemble(self, beside: Beside) -> None:
        A, b = self.of_forms, self.rhs
        A.zeroEntries()
        petsc.assemble_matrix(A, self.matrix_form)
        A.assemble()
        assemble(b, self.rhs_form)
        self.matrix = self._join(A, b) if self.sides else A
        self._add(beside.matrix)
        self.matrix.assemble()
        if self.monotone:
            self._upwind()

    def _join(self, A: PETSc.Mat, b: PETSc.Vec) -> PETSc.Mat:
        """P^T A P with a unit diagonal at the images of nodes; ``b`` becomes P^T b."""
        P = sp.csr_array(self.sides.prolongation(self.components))[self.owned]
        node, component = np.divmod(P.indices, self.components)
        columns = (self.components * self.layout.number[node] + component).astype(PETSc.IntType)
        csr = P.indptr.astype(PETSc.IntType), columns, P.data
        prolongation = PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=A.comm)
        joined, gathered = A.ptap(prolongation), b.duplicate()
        prolongation.multTranspose(b, gathered)
        b.array[:] = gathered.array
        image = np.isin(self.layout.owned_node, self.sides.images)
        alone = self._block_diagonal(image[:, None, None] * np.eye(self.components))
        joined.axpy(1.0, alone, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return joined

    def _add(self, matrix: sp.csr_array) -> None:
        """Adds terms beside the forms in the rows that this rank owns."""
        rows = sp.csr_array(matrix)[self.owned]
        node, component = np.divmod(rows.indices, self.components)
        columns = self.components * self.layout.number[node] + component
        # PETSc takes no other integers, and those of scipy depend on its version.
        csr = rows.indptr.astype(PETSc.IntType), columns.astype(PETSc.IntType), rows.data
        self.matrix.setValuesCSR(*csr, PETSc.InsertMode.ADD_VALUES)

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

    def _hold(self, free: Floats) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Mat]:
        """P A + S (1 - P), P and S (1 - P), with P the projectors and S the diagonal of A."""
        projector = self._block_diagonal(free)
        A = projector.matMult(self.matrix)
        scale = np.abs(self.matrix.getDiagonal().array).reshape(-1, self.components, 1)
        held = self._block_diagonal(scale * (np.eye(self.components) - free))
        A.axpy(1.0, held, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return A, projector, held

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
            pc.setType(compat.multigrid())
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
            part.getPC().setType(compat.multigrid())
        return ksp
