"""The smallest fluid solver: a uniform stream with hydrostatic pressure, come what may.

Copy this file to begin a solver of your own: keep the class, and let ``solve`` compute the fields.
"""

from time import perf_counter

import numpy as np
from voidage.cells import Cells
from voidage.pieces import PieceSums
from voidage.solver import AtGrains, Fields, Problem, Report, Solver, Step

STREAM = 0.1  # m/s against gravity


class Dummy(Solver):
    """A stream that is the same everywhere, at the temperature at which it started."""

    def set_mesh(self, problem: Problem) -> None:
        self.problem, self.cells = problem, Cells(problem.points, problem.cells)
        self.state = self.next = problem.fields

    def solve(self, step: Step) -> tuple[AtGrains, Report]:
        start = perf_counter()
        weight = self.problem.density * self.problem.gravity
        upward = -weight / (np.linalg.norm(weight) or 1.0)
        velocity = np.tile(STREAM * upward, (len(self.problem.points), 1))
        self.next = Fields(velocity, self.problem.points @ weight, self.state.temperature)
        report = Report(np.zeros_like(weight), flow_s=perf_counter() - start)
        if step.grains is None:
            none = np.zeros((0, self.problem.dimension))
            return AtGrains(none, none), report
        sums = PieceSums(self.cells, step.pieces, step.grains)
        report.force, report.heat = sums.exchanged(self.next)
        return sums.sample(self.next), report

    def accept(self) -> None:
        self.state = self.next

    def fields(self) -> Fields:
        return self.state
