"""Periodic sides: nodes that are one.

Both sides of a period keep their nodes, so that every cell has its true place. Of the nodes that are
one the first is the master; the others, its images, have its values and no unknowns. With P, which
gives every node the value of its master, the equations of the masters are P^T A P and P^T b.
"""

import numpy as np
import scipy.sparse as sp

from .solver import Floats, Problem


class Sides:
    """Masters and images of a mesh; without periodic sides every node is its own master."""

    def __init__(self, problem: Problem):
        count = len(problem.points)
        own = np.arange(count)
        self.master = own if problem.masters is None else np.asarray(problem.masters)
        """(n)."""
        self.images = np.flatnonzero(self.master != own)

    def __bool__(self) -> bool:
        return len(self.images) > 0

    def mirror(self, nodal: Floats) -> Floats:
        """Gives the images the values of their masters, (n, ..)."""
        return nodal[self.master] if self else nodal

    def gather(self, nodal: Floats) -> Floats:
        """Adds what belongs to images to their masters, and leaves nothing at the images, (n, ..)."""
        gathered = np.zeros_like(nodal)
        np.add.at(gathered, self.master, nodal)
        return gathered

    def prolongation(self, of: int) -> sp.csr_array:
        """P, for ``of`` unknowns of every node, (n of, n of)."""
        size = of * len(self.master)
        columns = of * np.repeat(self.master, of) + np.tile(np.arange(of), len(self.master))
        return sp.csr_array((np.ones(size), columns, np.arange(size + 1)), (size, size))

    def join(self, A: sp.csr_array, b: Floats) -> tuple[sp.csr_array, Floats]:
        """P^T A P with a unit diagonal at the images, and P^T b."""
        if not self:
            return A, b
        of = len(b) // len(self.master)
        P, alone = self.prolongation(of), np.zeros((len(self.master), of))
        alone[self.images] = 1
        return sp.csr_array(P.T @ A @ P + sp.diags(alone.ravel())), P.T @ b
