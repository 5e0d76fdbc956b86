"""What solvers by finite elements share: the order of a step, the coefficients of its forms."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from .boundary import is_closed
from .cells import Cells, Stabilisation, stabilisation_time
from .pieces import PieceSums
from .solver import AtGrains, Fields, Floats, Problem, Report, Solver, Step

NEARLY_SINGULAR = 1e-6
"""Relative residual that a direct solver leaves of no other systems, whatever the tolerance asked
for: where large terms cancel, rounding errors are large beside the right-hand side."""


@dataclass(frozen=True)
class FlowData:
    """Known coefficients of the flow equations, the same for every Newton step."""

    stabilisation: Stabilisation
    weight: Floats
    """Nodal rho g (1 - beta (T - T_R)), (n, D)."""
    share: Floats
    """Nodal share of the volume that the weight acts on, (n): the voidage. With grains it is one,
    and what they displace is taken off piece by piece (:meth:`voidage.pieces.PieceSums.flow`)."""
    solid_flux: Floats
    """Nodal projection of phi v at the accepted state, (n, D), for the least-squares
    incompressibility; zero without grains."""


class FiniteElements(Solver):
    """One step: energy with u_n, then momentum and mass by Newton steps, the first about u_n."""

    def set_mesh(self, problem: Problem) -> None:
        self.problem = problem
        self.cells = Cells(problem.points, problem.cells)
        self.state = self.next = problem.fields

    def _move(self, points: Floats) -> None:
        """Puts the nodes of the mesh elsewhere."""
        self.problem = replace(self.problem, points=points)
        self.cells = Cells(points, self.problem.cells)

    def _wind(self, step: Step) -> Floats:
        """u_n - u_mesh at the nodes, (n, D)."""
        velocity = self.state.velocity
        return velocity if step.motion is None else velocity - step.motion.velocity

    def accept(self) -> None:
        self.state = self.next

    def fields(self) -> Fields:
        return self.state

    def solve(self, step: Step) -> tuple[AtGrains, Report]:
        report, start = Report(np.zeros(self.problem.dimension)), perf_counter()
        if step.motion is not None:
            self._move(step.motion.points)
        sums = None
        if step.grains is not None and len(step.pieces.cell) > 0:
            sums = PieceSums(self.cells, step.pieces, step.grains)
            if step.grains.continuity is not None:
                sums.make_rigid(self.state, step.voidage, self.problem.density, step.dt)
        temperature = None if self.problem.heat is None else self._energy(step, sums, report)
        report.heat_s = perf_counter() - start
        data = self._flow_data(step, sums, temperature)
        velocity = self.state.velocity
        for _ in range(self.problem.newton):
            velocity, pressure = self._flow(step, sums, data, velocity, report)
        if is_closed(step.conditions):
            pressure = self.cells.centred(pressure)
        report.flow_s = perf_counter() - start - report.heat_s
        self.next = Fields(velocity, pressure, temperature)
        if sums is None:
            none = np.zeros((0, self.problem.dimension))
            return AtGrains(none, none, None if temperature is None else np.zeros(0)), report
        report.force, report.heat = sums.exchanged(self.next)
        return sums.sample(self.next), report

    @abstractmethod
    def _energy(self, step: Step, sums: PieceSums | None, report: Report) -> Floats:
        """Temperature at the nodes at the end of the step."""

    @abstractmethod
    def _flow(
        self, step: Step, sums: PieceSums | None, data: FlowData, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        """Velocity and pressure at the nodes, the convection linearised about a velocity."""

    def _flow_data(
        self, step: Step, sums: PieceSums | None, temperature: Floats | None
    ) -> FlowData:
        problem, cells = self.problem, self.cells
        lightness = np.ones(len(problem.points))
        if temperature is not None:
            lightness -= problem.heat.expansion * (temperature - problem.heat.reference)
        weight = problem.density * lightness[:, None] * problem.gravity
        reaction = np.zeros(len(problem.cells))
        if sums is None:
            share, solid_flux = step.voidage, np.zeros_like(weight)
        else:
            share, solid_flux = np.ones_like(step.voidage), sums.solid_flux(self.state)
            if problem.drag_in_stabilisation:
                fluid = problem.density * cells.measure * cells.mean(step.voidage)
                reaction[sums.cells] = sums.total_drag / fluid[sums.cells]
        stabilisation = Stabilisation(problem, cells, self._wind(step), step.dt, reaction)
        return FlowData(stabilisation, weight, share, solid_flux)

    def heat_stabilisation(self, step: Step) -> tuple[Floats, Floats]:
        """U = u_n - u_mesh at the centroid of every cell, (m, D), and xi_T (A.12), (m); zero if monotone."""
        heat, U = self.problem.heat, self.cells.mean(self._wind(step))
        speed = np.linalg.norm(U, axis=1)
        diffusivity = heat.conductivity / heat.capacity
        still = np.zeros_like(speed)
        if heat.monotone:
            return U, still
        return U, stabilisation_time(step.dt, speed, self.cells.size, diffusivity, still)
