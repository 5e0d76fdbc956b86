"""What solvers by finite elements share: the order of a step, the coefficients of its forms."""

from abc import abstractmethod
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from .boundary import balances, is_closed
from .cells import Cells, Stabilisation, stabilisation_time
from .points import PointSums, no_points
from .solver import Fields, Floats, Problem, Report, Solution, Solver, Step

NEARLY_SINGULAR = 1e-6
"""Relative residual that a direct solver leaves of no other systems, whatever the tolerance asked
for: where large terms cancel, rounding errors are large beside the right-hand side."""


class FlowData(NamedTuple):
    """Known coefficients of the flow equations, the same for every Newton step."""

    stabilisation: Stabilisation
    weight: Floats
    """Nodal rho g (1 - sum beta (s - s_R)), (n, D)."""
    share: Floats
    """Nodal share of the volume that the weight acts on, (n): the voidage. With points it is one,
    and what they displace is taken off point by point (:meth:`voidage.points.PointSums.flow`)."""
    solid_flux: Floats
    """Nodal projection of phi v at the accepted state, (n, D), for the least-squares
    incompressibility; zero without points."""


class FiniteElements(Solver):
    """One step: the scalars with u_n, then momentum and mass by Newton steps, first about u_n."""

    def set_mesh(self, problem: Problem) -> None:
        self.problem, self.cells = problem, Cells(problem.points, problem.cells)
        self.state = self.next = problem.fields

    def _move(self, points: Floats) -> None:
        """Puts the nodes of the mesh elsewhere."""
        self.problem = replace(self.problem, points=points)
        self.cells = Cells(points, self.problem.cells)

    def accept(self) -> None:
        self.state = self.next

    def solve(self, step: Step) -> Solution:
        report, start = Report(), perf_counter()
        if step.motion is not None:
            self._move(step.motion.points)
        problem, velocity = self.problem, self.state.velocity
        sums = PointSums(self.cells, step.points or no_points(problem))
        solved = [self._scalar(k, step, sums, report) for k in range(len(problem.scalars))]
        scalars = tuple(values for values, _ in solved)
        report.scalars_s = perf_counter() - start
        data = self._flow_data(step, sums, scalars)
        for _ in range(problem.newton):
            x, residual = self._flow(step, sums, data, velocity, report)
            velocity, pressure = x[:, :-1].copy(), x[:, -1].copy()
        if is_closed(step.conditions):
            level = self.cells.nodal_mean(pressure)
            pressure -= level
            # What the walls feel belongs to this level: -<p - level, div v>.
            residual[:, :-1] += level * self.cells.gradient_integral()
        report.flow_s = perf_counter() - start - report.scalars_s
        self.next = Fields(velocity, pressure, scalars)
        residuals = residual[:, :-1], [left for _, left in solved]
        passed = balances(problem, step, self.state, self.next, *residuals)
        return Solution(self.next, report, passed)

    @abstractmethod
    def _scalar(
        self, k: int, step: Step, sums: PointSums, report: Report
    ) -> tuple[Floats, Floats]:
        """Scalar k at the end of the step, (n), and what its equations lack there without the
        conditions that replace some of them, A x - b, (n)."""

    @abstractmethod
    def _flow(
        self, step: Step, sums: PointSums, data: FlowData, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        """Velocity and pressure, the convection linearised about a velocity, and A x - b as of a
        scalar, (n, D + 1) each."""

    def _wind(self, step: Step) -> Floats:
        """u_n - u_mesh at the nodes, (n, D)."""
        return self.state.velocity - (0 if step.motion is None else step.motion.velocity)

    def _flow_data(self, step: Step, sums: PointSums, scalars: tuple[Floats, ...]) -> FlowData:
        problem, cells = self.problem, self.cells
        lightness = np.ones(len(problem.points))
        for scalar, values in zip(problem.scalars, scalars, strict=True):
            lightness -= scalar.expansion * (values - scalar.reference)
        weight = problem.density * lightness[:, None] * problem.gravity
        reaction = np.zeros(len(problem.cells))
        if problem.drag_in_stabilisation:
            fluid = problem.density * cells.measure * cells.mean(step.voidage)
            reaction[sums.cells] = sums.total_drag / fluid[sums.cells]
        stabilisation = Stabilisation(problem, cells, self._wind(step), step.dt, reaction)
        share = step.voidage if step.points is None else np.ones_like(step.voidage)
        return FlowData(stabilisation, weight, share, sums.solid_flux(self.state))

    def _scalar_stabilisation(self, k: int, step: Step) -> tuple[Floats, Floats]:
        """U = u_n - u_mesh at the centroid of every cell, (m, D), and xi_T (A.12), (m); zero if
        monotone."""
        scalar, U = self.problem.scalars[k], self.cells.mean(self._wind(step))
        speed, still = np.linalg.norm(U, axis=1), np.zeros(len(U))
        if scalar.form == "monotone":
            return U, still
        diffusivity = scalar.conductivity / scalar.capacity
        return U, stabilisation_time(step.dt, speed, self.cells.size, diffusivity, still)
