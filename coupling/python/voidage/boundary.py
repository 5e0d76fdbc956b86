"""What the conditions on the boundary hold at the nodes, their terms, and what passes its parts."""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import solver as data
from .cells import Places, Terms
from .solver import Balance, Fields, Floats, Integers, Problem, Step

SAME_NORMAL = 0.866  # cos 30 degrees: normals closer than that are those of one smooth boundary
ALIKE = 1e-9
"""Walls whose normals differ by less, relative to their length, are one in the sum of forces."""

Held = tuple[Floats, Floats]
"""Projectors on what the c unknowns of every node are free to be, (n, c, c), and their values where
they are not, zero elsewhere, (n, c)."""


def area_vectors(points: Floats, facets: Integers) -> Floats:
    """Outward normal times measure of facets, (k, D)."""
    edges = points[facets[:, 1:]] - points[facets[:, :1]]
    if points.shape[1] == 2:
        return np.stack((edges[:, 0, 1], -edges[:, 0, 0]), axis=1)
    return 0.5 * np.cross(edges[:, 0], edges[:, 1])


def facet_rule(dimension: int) -> tuple[Floats, Floats]:
    """Shape functions (r, D) and shares of the measure (r) at the points of a rule of degree 4 or
    more: of Gauss and Legendre on a segment, of Dunavant on a triangle."""
    if dimension == 2:
        x = (1 - np.sqrt(0.6)) / 2
        return np.array([[1 - x, x], [0.5, 0.5], [x, 1 - x]]), np.array([5, 8, 5]) / 18
    near, far = 0.445948490915965, 0.091576213509771
    shape = [np.roll((x, x, 1 - 2 * x), k) for x in (near, far) for k in range(3)]
    return np.array(shape), np.repeat((0.223381589678011, 0.109951743655322), 3)


def moments(at: Floats, forces: Floats) -> Floats:
    """Moments of forces about the origin, (k, 1) in the plane and (k, 3) in space."""
    if at.shape[1] == 2:
        return at[:, :1] * forces[:, 1:] - at[:, 1:] * forces[:, :1]
    return np.cross(at, forces)


class Boundary(Places):
    """The boundary in a step: its places are the points of a rule on the facets, part by part in
    the order of the conditions. What is integrated is given times the weight of each place.

    What passes a part that is not open is that of its condition, not of its nodes, which at the end
    of a part belong to a neighbour: so it depends neither on the mesh nor on the order of the
    conditions. Of a moving wall the solid moves on as well as the fluid.
    """

    def __init__(self, problem: Problem, step: Step, wind: Floats):
        self.problem, self.step = problem, step
        none = np.zeros((0, problem.dimension), dtype=int)
        parts = [problem.boundaries[each.boundary] for each in step.conditions]
        facets, (shape, weight) = np.concatenate((none, *parts)), facet_rule(problem.dimension)
        masters = facets if problem.masters is None else problem.masters[facets]
        nodes, shapes = masters.repeat(len(weight), axis=0), np.tile(shape, (len(facets), 1))
        super().__init__(nodes, shapes, len(problem.points))
        part = np.repeat(np.arange(len(parts)), [len(each) for each in parts])
        area = area_vectors(problem.points, facets)
        self.part, self.area = part.repeat(len(weight)), np.kron(area, weight[:, None])
        """Number of the condition, (q), and outward normal, (q, D)."""
        self.place = np.einsum("qj,qji->qi", shapes, problem.points[facets].repeat(len(weight), axis=0))
        """Where it is, m, (q, D): at a periodic side beside its own nodes, not their masters."""
        self.measure = np.linalg.norm(self.area, axis=1)
        self.voidage = self.at(step.voidage)
        self.entering = -self.voidage * np.minimum(self.through(wind), 0)
        """-eps min(wind . n, 0), ``wind`` is u_n - u_mesh at the nodes, (q)."""
        self.open, self.pressure, self.known, self.gross, self.blown = np.zeros((5, len(nodes)))
        """One where open, and the pressure there; the volume that leaves elsewhere, and would if
        all went along the normal; what of it is vapour of bodies; (q) each. Of bodies they and what
        is held come from :class:`voidage.body.Bodies`."""
        self.last, self.fixed = np.full(self.count, -1), np.zeros_like(wind)
        """Number of the last part that fixes the velocity of a node, -1 if none does, (n), and the
        velocity, m/s, (n, D)."""
        for number, condition in enumerate(step.conditions):
            self._take(condition.flow, number, self.part == number)
        self.closed = not self.open.any()
        """Nothing then sets the level of the pressure."""
        self.walls: dict[int, list[tuple[int, Floats]]] = {}
        """Of nodes that slide along walls the number of the part and normal times measure, facet by
        facet."""
        for number, around, normal in zip(part.tolist(), masters, area, strict=True):
            if isinstance(step.conditions[number].flow, data.Slip):
                for node in around[self.last[around] < 0].tolist():
                    self.walls.setdefault(node, []).append((number, normal))

    def through(self, nodal: Floats) -> Floats:
        """What passes outward with nodal velocities, (q)."""
        return np.einsum("qi,qi->q", self.at(nodal), self.area)

    def _take(self, flow: data.Flow, number: int, here: NDArray[np.bool_]) -> None:
        """Takes the condition of the velocity of a part; a later one wins at shared nodes."""
        share, still = 1.0, np.zeros_like(self.fixed)
        velocity = fixed = self.step.motion.velocity
        match flow:
            case data.Open(pressure):
                self.open[here], self.pressure[here] = 1, pressure
                return
            case data.Body():
                self.last[self.nodes[here]] = number
                return
            case data.Velocity(value):
                share, velocity = self.voidage, still + value
                fixed = velocity
            case data.SuperficialVelocity(value):
                velocity = still + value
                fixed = velocity / self.step.voidage[:, None]
        if not isinstance(flow, data.Slip):
            nodes = self.nodes[here]
            self.last[nodes], self.fixed[nodes] = number, fixed[nodes]
        self.known[here] = (share * self.through(velocity))[here]
        self.gross[here] = (share * np.linalg.norm(self.at(velocity), axis=1) * self.measure)[here]

    def _scalar(self, k: int) -> tuple[Floats, Floats, Integers, Floats]:
        """h and outside of the flux h (outside - s) into the fluid of scalar k, (q) each; number of
        the last part that prescribes it at a node, -1 if none does, and its value, (n) each."""
        (h, outside), last = np.zeros((2, len(self.part))), np.full(self.count, -1)
        value = np.zeros(self.count)
        for number, condition in enumerate(self.step.conditions):
            here = self.part == number
            match condition.scalar(k):
                case data.Value(given):
                    nodes = self.nodes[here]
                    last[nodes], value[nodes] = number, np.broadcast_to(given, self.count)[nodes]
                case data.Transfer(coefficient, beyond):
                    h[here], outside[here] = coefficient * self.measure[here], beyond
                case data.Outflow(beyond) if beyond is not None:
                    capacity = self.problem.scalars[k].capacity
                    h[here], outside[here] = capacity * self.entering[here], beyond
        return h, outside, last, value

    def _pairs(self, values: Floats, row: int = 0, column: int = 0, of: int = 1) -> sp.csr_array:
        """Sums of values, (q), times the shape functions of two of the unknowns of a node."""
        trial = self.rows(values[:, None] * self.shape, column, of)
        return self.rows(self.shape, row, of).T @ trial

    def flow_terms(self) -> Terms:
        """<<eps u . n, q>>, and where open <<p_out n, v>> - <<eps rho min(wind . n, 0) u, v>>. What
        passes elsewhere is known."""
        D = self.problem.dimension
        matrix, rhs = self.nothing(D + 1)
        rhs += self.mass(self.known)
        for i in range(D):
            matrix += self._pairs(self.open * self.voidage * self.area[:, i], D, i, D + 1)
            matrix += self._pairs(self.open * self.problem.density * self.entering, i, i, D + 1)
            rhs -= self.rows(self.shape, i, D + 1).T @ (self.pressure * self.area[:, i])
        return matrix, rhs

    def mass(self, passes: Floats) -> Floats:
        """What is known to pass, (q), on the right-hand side of the equations of mass."""
        D = self.problem.dimension
        return -(self.rows(self.shape, D, D + 1).T @ passes)

    def scalar_terms(self, k: int) -> Terms:
        """<<h (s - outside), S>> in the equation of scalar k."""
        h, outside, *_ = self._scalar(k)
        return self._pairs(h), self.rows(self.shape).T @ (h * outside)

    def hold_scalar(self, k: int) -> Held:
        """What is held of scalar k."""
        *_, last, value = self._scalar(k)
        return np.where(last < 0, 1.0, 0.0)[:, None, None], value[:, None]

    def hold_flow(self) -> Held:
        """What is held of (u, p). A prescribed velocity wins over slip, whose value is the velocity
        of the wall. Normals at a node within 30 degrees are averaged; a sharper corner holds each.
        In a closed domain one pressure is held."""
        D = self.problem.dimension
        free = np.tile(np.eye(D + 1), (self.count, 1, 1))
        value = np.column_stack((self.fixed, np.zeros(self.count)))
        free[self.last >= 0, :D] = 0
        for node, facets in self.walls.items():
            normals = _smooth([area for _, area in facets])
            free[node, :D, :D] -= np.linalg.pinv(normals, 1e-6) @ normals
            value[node, :D] = self.step.motion.velocity[node]
        free[0, D, D] = not self.closed
        return free, value

    def check_net_flux(self) -> None:
        """Raises ``ValueError`` if what the velocities prescribed all around let out, and walls
        push out, is more than round-off away from what they let in."""
        net = float(self.known.sum())
        if abs(net) > 1e-9 * self.gross.sum():
            raise ValueError(
                f"no boundary is open, but the prescribed velocities let {net:.3e} more fluid out "
                "than in; open one"
            )

    def balances(
        self, new: Fields, residual: Floats, scalar_residuals: list[Floats]
    ) -> dict[str, Balance]:
        """What passes the parts of the boundary, from the discrete equations themselves.

        ``residual`` is A x - b of momentum, (n, D), and of each scalar, (n), with all boundary
        integrals, before conditions take the place of equations: what holds a node gives it to the
        fluid. Elsewhere what passes are the integrals that were assembled. So the sums over the
        parts close to what the linear solver leaves.
        """
        flux = self.known + self.open * self.voidage * self.through(new.velocity)
        taken = self.open * self.problem.density * self.entering
        force = taken[:, None] * self.at(new.velocity) + self.pressure[:, None] * self.area
        walls = data.NoSlip | data.Slip | data.Body
        kinds = [isinstance(each.flow, walls) for each in self.step.conditions]
        # A wall carries nothing away.
        carrying = np.where(np.array(kinds)[self.part], self.blown, flux)
        fluxes, given, convected = self._sums(flux, self.part), [], []
        held_forces, held_torques = self._holding(residual)
        forces = self._sums(force, self.part) + held_forces
        torques = self._sums(moments(self.place, force), self.part) + held_torques
        for k, scalar in enumerate(self.problem.scalars):
            (h, outside, *_), s = self._scalar(k), self.at(new.scalars[k])
            held = self.given_by_values(k, scalar_residuals[k])
            given.append(held + self._sums(h * (outside - s), self.part))
            convected.append(self._sums(scalar.capacity * s * carrying, self.part))
        found = {}
        for number, condition in enumerate(self.step.conditions):
            scalars = (tuple(float(each[number]) for each in kind) for kind in (given, convected))
            found[condition.boundary] = Balance(
                float(fluxes[number]), forces[number], torques[number], *scalars
            )
        return found

    def given_by_values(self, k: int, residual: Floats) -> Floats:
        """What prescribed values of scalar k give to the fluid, in the order of the conditions."""
        *_, last, _ = self._scalar(k)
        return self._sums(residual, last)

    def _sums(self, values: Floats, part: Integers) -> Floats:
        """Sums over what belongs to each part, in the order of the conditions."""
        return np.array([values[part == k].sum(axis=0) for k in range(len(self.step.conditions))])

    def _holding(self, residual: Floats) -> tuple[Floats, Floats]:
        """Forces of the fluid on the conditions that hold nodes and their moments about the origin,
        (number of conditions, D) and (.., 1 or 3).

        The force at a node goes to the last condition that fixes it, else to the one along whose
        wall it slides; of a corner between several it is resolved into their normals, by least
        squares.
        """
        points, forces = self.problem.points, -residual
        summed = self._sums(forces, self.last), self._sums(moments(points, forces), self.last)
        for node, facets in self.walls.items():
            walls: dict[int, Floats] = {}
            for number, area in facets:
                walls[number] = walls.get(number, 0) + area
            numbers, normals, shares = list(walls), np.array(list(walls.values())), forces[[node]]
            if len(numbers) > 1:
                along = np.linalg.lstsq(normals.T, forces[node], rcond=ALIKE)[0]
                shares = along[:, None] * normals
            summed[0][numbers] += shares
            summed[1][numbers] += moments(np.tile(points[node], (len(numbers), 1)), shares)
        return summed


def _smooth(areas: list[Floats]) -> Floats:
    """Unit normals of the smooth walls that facets with these area vectors belong to, (k, D)."""
    normals: list[Floats] = []
    for area in areas:
        for k, other in enumerate(normals):
            cosine = other @ area / (np.linalg.norm(other) * np.linalg.norm(area))
            if abs(cosine) > SAME_NORMAL:
                normals[k] = other + np.sign(cosine) * area
                break
        else:
            normals.append(area)
    return np.array([normal / np.linalg.norm(normal) for normal in normals])
