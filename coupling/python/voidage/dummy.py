"""The smallest fluid solver: a uniform stream with hydrostatic pressure, come what may.

Copy this file to begin a solver of your own: keep the class, and let ``solve`` compute the fields.
"""

import numpy as np
from voidage.solver import Fields, Problem, Solution, Solver, Step

STREAM = 0.1  # m/s against gravity


class Dummy(Solver):
    def set_mesh(self, problem: Problem) -> None:
        self.problem, self.state = problem, problem.fields

    def solve(self, step: Step) -> Solution:
        weight = self.problem.density * self.problem.gravity
        upward = -weight / (np.linalg.norm(weight) or 1.0)
        velocity = np.tile(STREAM * upward, (len(self.problem.points), 1))
        self.next = Fields(velocity, self.problem.points @ weight, self.state.scalars)
        return Solution(self.next)

    def accept(self) -> None:
        self.state = self.next
