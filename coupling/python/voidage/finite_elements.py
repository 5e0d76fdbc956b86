"""What solvers by finite elements share: the order of a step, and all but the sums over cells."""

from abc import abstractmethod
from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .body import Bodies
from .boundary import Boundary
from .cells import Cells, stabilisation_time
from .points import DENSEST, PointSums, complete
from .sides import Sides
from .solver import Fields, Floats, Problem, Report, Solution, Solver, Step

NEARLY_SINGULAR = 1e-6
"""Relative residual that a direct solver leaves of no other systems, whatever the tolerance asked
for: where large terms cancel, rounding errors are large beside the right-hand side."""


class Beside(NamedTuple):
    """What a linear system has beside its sums over cells; every node has c unknowns in turn. There
    may be several right-hand sides, r; the sums over cells belong to the first."""

    matrix: sp.csr_array
    rhs: Floats
    """Terms of boundary and points, (n c, n c) and (r, n c)."""
    free: Floats
    value: Floats
    """Projectors on what the unknowns of a node are free to be, (n, c, c), and what they are where
    they are not, (r, n, c)."""


class FlowData(NamedTuple):
    """Known coefficients of the flow equations, the same for every Newton step."""

    xi: Floats
    xi_U: Floats
    xi_c: Floats
    """xi_u = xi_p, s, (m); xi times U = u_n - u_mesh at the centroid, m, (m, D); m2/s, (m)."""
    weight: Floats
    """Nodal rho g (1 - sum beta (s - s_R)), (n, D)."""
    share: Floats
    """Nodal share of the volume that the weight acts on, (n): the voidage. With points it is one,
    and what they displace is taken off point by point (:meth:`voidage.points.PointSums.flow`)."""
    solid_flux: Floats
    """Nodal projection of phi v at the accepted state, (n, D), for the least-squares
    incompressibility; zero without points."""


class FlowForm(NamedTuple):
    """What terms of one's own in the flow equations are written with: expressions of UFL in FEniCSx,
    values at the quadrature points in scikit-fem."""

    u: Any
    p: Any
    """Velocity and pressure that are solved for; None on the right-hand side."""
    v: Any
    q: Any
    """Test functions of momentum and mass."""
    w: Any
    """What the equation of momentum is tested with as a whole, v + xi (U . grad) v + (xi / rho) grad q: the
    Galerkin test and those of the stabilisation."""
    x: Any
    """Place, m."""
    eps: Any
    """Voidage."""
    old: Any
    """u_n, the accepted velocity, m/s."""
    at: Any
    """The velocity about which this Newton step linearises, m/s: u_n in the first."""
    dt: Any
    """Length of the step, s."""
    problem: Problem


class ScalarForm(NamedTuple):
    """The same for the equation of a scalar."""

    s: Any
    """The scalar that is solved for; None on the right-hand side."""
    S: Any
    """Its test function."""
    w: Any
    """What its equation is tested with as a whole, S + xi_T U . grad S."""
    x: Any
    """Place, m."""
    eps: Any
    """Voidage."""
    old: Any
    """The accepted values of the scalar."""
    wind: Any
    """u_n less the velocity of the mesh, m/s."""
    k: int
    """Number of the scalar."""
    dt: Any
    """Length of the step, s."""
    problem: Problem


class FiniteElements(Solver):
    """One step: the scalars with u_n, then momentum and mass by Newton steps, first about u_n. The
    steps that the equations get lack nothing (:func:`voidage.points.complete`).

    A subclass adds terms of its own by :meth:`terms`, :meth:`loads`, :meth:`scalar_terms` and
    :meth:`scalar_loads`. Each returns an integrand, which is integrated over the cells, or None.
    """

    periodic_sides = True

    def terms(self, flow: FlowForm) -> Any:
        """Further terms on the left-hand side of the flow equations, linear in u and p and in the tests,
        such as ``drag * dot(flow.u, flow.w)`` of a force -drag u per volume. They are part of the matrix
        of every Newton step, so implicit in time. Tested with ``flow.w`` a force is in the residual of the
        stabilisation too, as it must be where the pressure balances it; tested with ``flow.v`` it is not.
        The stabilisation time knows how strongly they hold a uniform flow back."""

    def loads(self, flow: FlowForm) -> Any:
        """Further terms on the right-hand side of the flow equations, linear in the tests."""

    def scalar_terms(self, scalar: ScalarForm) -> Any:
        """Further terms on the left-hand side of the equation of a scalar, linear in s and in the tests."""

    def scalar_loads(self, scalar: ScalarForm) -> Any:
        """Further terms on the right-hand side of the equation of a scalar, linear in the tests."""

    def set_mesh(self, problem: Problem) -> None:
        self.state = self.next = problem.fields
        self.sides = Sides(problem)
        self._place(problem)

    def _place(self, problem: Problem) -> None:
        """Takes a problem, or the same with the nodes of the mesh elsewhere."""
        self.problem = problem
        self.cells = Cells(problem.points, problem.cells, problem.masters)

    def accept(self) -> None:
        self.state = self.next

    def solve(self, step: Step) -> Solution:
        report, start = Report(), perf_counter()
        if step.motion is not None:
            self._place(replace(self.problem, points=step.motion.points))
        share = step.voidage if step.points is None else np.ones_like(step.voidage)
        problem, step, velocity = self.problem, complete(self.problem, step), self.state.velocity
        wind = velocity - step.motion.velocity
        boundary, points = Boundary(problem, step, wind), PointSums(self.cells, step.points)
        scalars, left = [], []
        for k in range(len(problem.scalars)):
            xi_U = self._scalar_stabilisation(k, step, wind, points)
            beside = self._beside_scalar(k, step, boundary, points, xi_U)
            s, residual = self._scalar(k, step, wind, xi_U, beside, report)
            scalars.append(self.sides.mirror(s[0, :, 0]))
            left.append(residual[0, :, 0])
        report.scalars_s = perf_counter() - start
        data = self._flow_data(step, wind, share, points, scalars)
        bodies = Bodies(boundary, self.cells, scalars, left)
        beside = self._beside_flow(step, boundary, points, bodies, data)
        for _ in range(problem.newton):
            x, residual = bodies.release(*self._flow(step, data, velocity, beside, report))
            x = self.sides.mirror(x)
            velocity, pressure = x[:, :-1].copy(), x[:, -1].copy()
        if boundary.closed:
            cells = self.cells
            level = np.average(pressure, weights=cells.nodal_volume)
            pressure -= level
            # What the walls feel belongs to this level: -<p - level, div v>.
            felt = level * cells.measure[:, None, None] * cells.gradient
            np.add.at(residual[:, :-1], cells.masters, felt)
        report.flow_s = perf_counter() - start - report.scalars_s
        self.next, answers = Fields(velocity, pressure, tuple(scalars)), bodies.settle()
        balances = boundary.balances(self.next, residual[:, :-1], left)
        return Solution(self.next, report, balances, answers)

    @abstractmethod
    def _scalar(
        self, k: int, step: Step, wind: Floats, xi_U: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        """Scalar k at the end of the step, and what its equations lack there without the conditions
        that replace some of them, A x - b, (1, n, 1) each. ``wind`` is u_n - u_mesh, (n, D), and
        ``xi_U`` is xi_T U, (m, D)."""

    @abstractmethod
    def _flow(
        self, step: Step, data: FlowData, about: Floats, beside: Beside, report: Report
    ) -> tuple[Floats, Floats]:
        """Velocity and pressure, the convection linearised about a velocity, and A x - b as of a
        scalar, for all right-hand sides, (r, n, D + 1) each."""

    @abstractmethod
    def _uniform(self, step: Step) -> Floats:
        """The integrals of :meth:`terms` about u_n, tested with v alone, for u = e_i and p = 0: component
        i at every node, (n, D)."""

    def _rate_of_terms(self, step: Step) -> Floats:
        """What :meth:`terms` add to 1/xi, 1/s, (m): as the drag of points does
        (:meth:`voidage.points.PointSums.drag_rate`)."""
        cells, volume = self.cells, self.cells.nodal_volume
        held = self.sides.gather(self._uniform(step)).max(axis=1) / np.where(volume > 0, volume, 1)
        largest = np.maximum(held[cells.masters].max(axis=1), 0)
        voidage = np.maximum(cells.mean(step.voidage), DENSEST)
        return 4 * largest / (self.problem.density * voidage)

    def _scalar_stabilisation(
        self, k: int, step: Step, wind: Floats, points: PointSums
    ) -> Floats:
        """xi_T U (A.12), (m, D); with the exchange of the points in xi_T if lumped, zero if monotone."""
        scalar, U = self.problem.scalars[k], self.cells.mean(wind)
        if scalar.form == "monotone":
            return np.zeros_like(U)
        diffusivity, exchange = scalar.conductivity / scalar.capacity, 0.0
        if scalar.form == "lumped":
            exchange = points.exchange_rate(k, scalar.capacity, step.voidage)
        return stabilisation_time(self.cells, U, step.dt, diffusivity, exchange)[:, None] * U

    def _beside_scalar(
        self, k: int, step: Step, boundary: Boundary, points: PointSums, xi_U: Floats
    ) -> Beside:
        """Boundary and points, and what is lumped of the storage and the walls of a thin cell."""
        scalar, volume = self.problem.scalars[k], self.cells.nodal_volume
        matrix, rhs = boundary.scalar_terms(k)
        lumped = scalar.form != "consistent"
        more, load = points.scalar(k, xi_U, lumped)
        matrix, rhs = matrix + more, rhs + load
        if lumped:
            rate, wall = scalar.capacity / step.dt * step.voidage, scalar.wall_coefficient
            matrix += sp.diags(volume * (rate + wall))
            rhs += volume * (rate * self.state.scalars[k] + wall * scalar.wall_value)
        free, value = boundary.hold_scalar(k)
        free[self.sides.images] = 0
        return Beside(matrix, rhs[None], free, value[None])

    def _beside_flow(
        self, step: Step, boundary: Boundary, points: PointSums, bodies: Bodies, data: FlowData
    ) -> Beside:
        """Boundary, points, and the right-hand sides that find how free bodies move. In a closed
        domain the equation that is replaced must follow from the others: what sums of prescribed
        fluxes and sources lack to balance, round-off and the error of sums for integrals, is spread
        evenly, as by a Lagrange multiplier of the mean pressure."""
        volume, D = self.cells.nodal_volume, self.problem.dimension
        matrix, rhs = boundary.flow_terms()
        more, load = points.flow(data.xi, data.xi_U, self.problem.density, data.weight, self.state)
        (free, value), (loads, values) = boundary.hold_flow(), bodies.responses()
        free[self.sides.images] = 0
        rhs = np.stack((rhs + load, *loads))
        if boundary.closed:
            boundary.check_net_flux()
            excess = rhs[:, D :: D + 1].sum(axis=1)
            excess[0] += volume @ step.sources.mass
            rhs[:, D :: D + 1] -= np.outer(excess / volume.sum(), volume)
        return Beside(matrix + more, rhs, free, np.stack((value, *values)))

    def _flow_data(
        self, step: Step, wind: Floats, share: Floats, points: PointSums, scalars: list[Floats]
    ) -> FlowData:
        problem, cells, lightness = self.problem, self.cells, np.ones(len(wind))
        for scalar, values in zip(problem.scalars, scalars, strict=True):
            lightness -= scalar.expansion * (values - scalar.reference)
        body_force = 0.0 if problem.body_force is None else problem.body_force
        weight = problem.density * (lightness[:, None] * problem.gravity + body_force)
        U, nu = cells.mean(wind), problem.viscosity / problem.density
        drag = points.drag_rate(problem.density, problem.thin_cell_drag, step.voidage)
        if type(self).terms is not FiniteElements.terms:
            drag = drag + self._rate_of_terms(step)
        xi = stabilisation_time(cells, U, step.dt, nu, drag)
        reach = cells.size * np.linalg.norm(U, axis=1)
        xi_c = reach * np.minimum(reach / (6 * nu), 0.5)
        return FlowData(xi, xi[:, None] * U, xi_c, weight, share, self.sides.mirror(points.solid_flux(self.state)))
