"""The fluid in scikit-fem: volume-averaged Navier-Stokes with heat, P1-P1, stabilised by PSPG, SUPG and LSIC.

    <eps rho Du/Dt, v> + <sigma, grad v> + <gamma_l u, v> - <f_p, v> - <eps rho g (1 - beta (T - T_R)), v>
        + sum_e xi <R_u, (U . grad) v>_e + sum_e rho xi_c <R_p, div v>_e = <<sigma n, v>>
    <div(phi v*), q> + <div(eps u), q> + sum_e (xi / rho) <R_u, grad q>_e = 0
    <eps C DT/Dt, S> + <eps k grad T, grad S> - <q_p + q_l, S> + sum_e xi_T <R_T, U . grad S>_e = boundary heat

Backward Euler from u_n; the convection is linearised about a velocity w, once (w = u_n) or more often; U is u_n at
the centroid. The energy is solved first, with u_n. The terms of the grains come from :mod:`voidage.pieces`.
"""

from time import perf_counter

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTetP1, ElementTriP1, ElementVector, FacetBasis, LinearForm
from skfem import MeshTet, MeshTri
from skfem.helpers import ddot, div, dot, grad, mul, transpose

from .boundary import Holds, check_balance, is_closed, prescribed_temperatures
from .cells import Cells, Stabilisation, heat_stabilisation_time
from .pieces import PieceSums
from .solver import AtGrains, Fields, Floats, Integers, Newton, Open, OpenHeat, Problem, Report, Solver, Step

QUADRATURE = 4  # degree of the rules in cells and, the upwind terms not being polynomials, on facets


class ScikitFem(Solver):
    """The solver on one mesh. Unknowns are numbered (D + 1) node + component, the pressure last."""

    def set_mesh(self, problem: Problem) -> None:
        plane = problem.dimension == 2
        make, scalar = (MeshTri, ElementTriP1()) if plane else (MeshTet, ElementTetP1())
        mesh = make(problem.points.T.copy(), problem.cells.T.copy())
        self.problem, self.cells = problem, Cells(problem.points, problem.cells)
        self.state = self.next = problem.fields
        self.scalar = Basis(mesh, scalar, intorder=QUADRATURE)
        self.vector = self.scalar.with_element(ElementVector(scalar))
        self.mixed = self.scalar.with_element(ElementVector(scalar) * scalar)
        self.facets = {
            name: FacetBasis(mesh, scalar, facets=_facet_numbers(mesh.facets.T, nodes), intorder=QUADRATURE)
            for name, nodes in problem.boundaries.items()
        }

    def accept(self) -> None:
        self.state = self.next

    def fields(self) -> Fields:
        return self.state

    def solve(self, step: Step) -> tuple[AtGrains, Report]:
        report, start = Report(), perf_counter()
        sums = None if step.grains is None else PieceSums(self.cells, step.pieces, step.grains)
        temperature = None if self.problem.heat is None else self._energy(step, sums, report)
        report.heat_s = perf_counter() - start
        velocity = self.state.velocity
        for _ in range(self.problem.newton):
            velocity, pressure = self._flow(step, sums, temperature, velocity, report)
        report.flow_s = perf_counter() - start - report.heat_s
        self.next = Fields(velocity, pressure, temperature)
        if sums is None:
            none = np.zeros((0, self.problem.dimension))
            return AtGrains(none, none, np.zeros(0)), report
        report.force, report.heat = sums.exchanged(self.next)
        return sums.sample(self.next), report

    def _energy(self, step: Step, sums: PieceSums | None, report: Report) -> Floats:
        problem, heat, dt = self.problem, self.problem.heat, step.dt
        C, k, wall, wall_T = heat.capacity, heat.conductivity, heat.wall_coefficient, heat.wall_temperature
        eps = self.scalar.interpolate(step.voidage)
        u = self.vector.interpolate(self.state.velocity.ravel())
        old = self.scalar.interpolate(self.state.temperature)
        source = 0 if step.sources is None else self.scalar.interpolate(step.sources.heat)
        U = self.cells.mean(self.state.velocity)
        time = heat_stabilisation_time(problem, self.cells, self.state.velocity, dt)
        xi_U = (time[:, None] * U).T[:, :, None]

        @BilinearForm
        def matrix(T, S, _):
            rate = eps * C * (T / dt + dot(u, grad(T))) + wall * T
            residual = rate - k * dot(grad(eps), grad(T))
            return rate * S + eps * k * dot(grad(T), grad(S)) + residual * dot(xi_U, grad(S))

        @LinearForm
        def rhs(S, _):
            return (eps * C * old / dt + wall * wall_T + source) * (S + dot(xi_U, grad(S)))

        A, b = matrix.assemble(self.scalar), rhs.assemble(self.scalar)
        for condition in step.conditions:
            basis = self.facets[condition.boundary]
            match condition.heat:
                case Newton(coefficient, outside):
                    transfer = coefficient
                case OpenHeat(outside) if outside is not None:
                    transfer = -C * basis.interpolate(step.voidage) * np.minimum(self._through(basis), 0)
                case _:
                    continue
            A = A + BilinearForm(lambda T, S, _, h=transfer: h * T * S).assemble(basis)
            b = b + LinearForm(lambda S, _, h=transfer, T=outside: h * T * S).assemble(basis)
        if sums is not None and sums.heated:
            blocks, loads = sums.energy(U, time)
            A, b = _add_blocks(A, b, self.problem.cells[sums.cells], blocks, loads)
        free, value = np.ones(len(b)), np.zeros(len(b))
        held = prescribed_temperatures(problem, step.conditions)
        free[list(held)], value[list(held)] = 0, list(held.values())
        T, _ = _solve(A, b, sp.diags_array(free), value, 1, problem.tolerance)
        report.iterations += 1
        return T

    def _flow(
        self, step: Step, sums: PieceSums | None, temperature: Floats | None, about: Floats, report: Report
    ) -> tuple[Floats, Floats]:
        problem, dt = self.problem, step.dt
        rho, eta, thin = problem.density, problem.viscosity, problem.thin_cell_drag
        eps = self.scalar.interpolate(step.voidage)
        old = self.vector.interpolate(self.state.velocity.ravel())
        at = self.vector.interpolate(about.ravel())
        reaction = np.zeros(len(problem.cells))
        flux_divergence = source_v = source_q = 0
        if sums is not None:
            flux_divergence = div(self.vector.interpolate(sums.solid_flux(self.state).ravel()))
            if problem.drag_in_stabilisation:
                volume = self.cells.measure * self.cells.mean(step.voidage)
                reaction[sums.cells] = sums.total_drag / (rho * volume[sums.cells])
        if step.sources is not None:
            source_v = self.vector.interpolate(step.sources.momentum.ravel())
            source_q = self.scalar.interpolate(step.sources.mass)
        lightness = np.ones(len(problem.points))
        if temperature is not None:
            lightness -= problem.heat.expansion * (temperature - problem.heat.reference)
        nodal_weight = rho * lightness[:, None] * problem.gravity
        # With grains, their pieces take the weight of what they displace (PieceSums.flow).
        weight = (eps if sums is None else 1) * self.vector.interpolate(nodal_weight.ravel())
        tau = Stabilisation(problem, self.cells, self.state.velocity, dt, reaction)
        xi, xi_c = tau.time[:, None], tau.incompressibility[:, None]
        xi_U = xi * tau.direction.T[:, :, None]

        @BilinearForm
        def matrix(u, p, v, q, _):
            rate = eps * rho * (u / dt + mul(grad(u), at) + mul(grad(at), u)) + thin * u
            strain = grad(u) + transpose(grad(u))
            residual = rate + grad(p) - eta * mul(strain, grad(eps))
            return (
                dot(rate, v)
                + eps * eta * ddot(strain, grad(v))
                - p * div(v)
                - eps * dot(u, grad(q))
                + dot(residual, mul(grad(v), xi_U) + xi / rho * grad(q))
                + rho * xi_c * (eps * div(u) + dot(u, grad(eps))) * div(v)
            )

        @LinearForm
        def rhs(v, q, _):
            force = eps * rho * (old / dt + mul(grad(at), at)) + weight + source_v
            return (
                dot(force, v + mul(grad(v), xi_U) + xi / rho * grad(q))
                + source_q * q
                + rho * xi_c * (source_q - flux_divergence) * div(v)
            )

        A, b = matrix.assemble(self.mixed), rhs.assemble(self.mixed)
        for condition in step.conditions:
            A, b = self._add_boundary(A, b, condition.flow, self.facets[condition.boundary], step.voidage)
        if sums is not None:
            blocks, loads = sums.flow(tau, rho, nodal_weight)
            A, b = _add_blocks(A, b, problem.cells[sums.cells], blocks, loads)
        return self._solve_flow(step, A, b, report)

    def _add_boundary(self, A, b, flow, facets: FacetBasis, voidage: Floats):
        """<<eps u . n, q>>, and where it is open <<p_out n, v>> - <<eps rho min(u_n . n, 0) u, v>>."""
        basis = facets.with_element(self.mixed.elem)
        eps, rho = facets.interpolate(voidage), self.problem.density
        A = A + BilinearForm(lambda u, p, v, q, w: eps * dot(u, w.n) * q).assemble(basis)
        if isinstance(flow, Open):
            inflow = -rho * eps * np.minimum(self._through(facets), 0)
            A = A + BilinearForm(lambda u, p, v, q, w: inflow * dot(u, v)).assemble(basis)
            b = b - LinearForm(lambda v, q, w: flow.pressure * dot(w.n, v)).assemble(basis)
        return A, b

    def _through(self, facets: FacetBasis) -> Floats:
        """u_n . n at the quadrature points of facets."""
        basis = facets.with_element(self.vector.elem)
        return dot(basis.interpolate(self.state.velocity.ravel()), facets.normals)

    def _solve_flow(self, step: Step, A, b: Floats, report: Report) -> tuple[Floats, Floats]:
        count, D = self.problem.points.shape
        holds, closed = Holds(self.problem, step.conditions, step.voidage), is_closed(step.conditions)
        free, value = np.tile(np.eye(D + 1), (count, 1, 1)), np.zeros((count, D + 1))
        free[:, :D, :D], value[:, :D] = holds.free, holds.value
        if closed:
            check_balance(self.problem, holds, step.voidage)
            free[0, D, D] = 0  # the level of the pressure; the mean is moved to zero below
        projector = sp.bsr_array((free, np.arange(count), np.arange(count + 1)))
        x, report.residual = _solve(A, b, projector, value.ravel(), D + 1, self.problem.tolerance)
        report.iterations += 1
        x = x.reshape(count, D + 1)
        return x[:, :D].copy(), self.cells.centred(x[:, D]) if closed else x[:, D].copy()


def _facet_numbers(all_facets: Integers, wanted: Integers) -> Integers:
    number = {tuple(nodes): k for k, nodes in enumerate(np.sort(all_facets, axis=1).tolist())}
    return np.array([number[tuple(nodes)] for nodes in np.sort(wanted, axis=1).tolist()], dtype=int)


def _add_blocks(A, b: Floats, cells: Integers, blocks: Floats, loads: Floats):
    """Adds the matrices and right-hand sides of cells, whose unknowns are those of their nodes in turn."""
    components = loads.size // cells.size
    dofs = (components * cells[:, :, None] + np.arange(components)).reshape(len(cells), -1)
    size = dofs.shape[1]
    rows, columns = np.repeat(dofs, size, axis=1), np.tile(dofs, (1, size))
    more = sp.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), A.shape)
    return A + more.tocsr(), b + np.bincount(dofs.ravel(), loads.ravel(), len(b))


def _solve(A, b: Floats, free, value: Floats, components: int, tolerance: float) -> tuple[Floats, float]:
    """Solves A x = b in what is free, x = value in the rest.

    ``free`` is a projector on the equations that stay; the others become the condition, scaled as the diagonal that
    they had. Returns the solution and its relative residual.
    """
    diagonal = sp.diags_array(np.abs(A.diagonal()))
    A, b = free @ A + diagonal @ (sp.eye_array(len(b)) - free), free @ b + diagonal @ (value - free @ value)
    # With equations and unknowns scaled to a unit diagonal there is hardly need to pivot, and little fill.
    unit = 1 / np.sqrt(np.abs(A.diagonal()))
    scaled = sp.csc_array(sp.diags_array(unit) @ A @ sp.diags_array(unit))
    factors = splu(scaled, "MMD_AT_PLUS_A", diag_pivot_thresh=0.1, options={"SymmetricMode": True})
    x = unit * factors.solve(unit * b)
    x += unit * factors.solve(unit * (b - A @ x))
    residual = _residual(A, b, x, components)
    if not residual <= tolerance:
        raise ArithmeticError(f"the linear system is nearly singular: its relative residual is {residual:.1e}")
    return x, residual


def _residual(A, b: Floats, x: Floats, components: int) -> float:
    """Relative residual of the worst component, its equations in the unit of its unknown.

    As in voidage's own solver: |w r| / max(|w b|, |w |A| |w b|| / 100) with w one over the diagonal.
    """
    w = 1 / np.abs(A.diagonal())

    def norms(values: Floats) -> Floats:
        return np.linalg.norm((w * values).reshape(-1, components), axis=0)

    scale = np.maximum(norms(b), norms(abs(A) @ np.abs(w * b)) / 100)
    return float(np.max(norms(b - A @ x) / np.where(scale > 0, scale, 1)))
