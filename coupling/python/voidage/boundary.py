"""What the conditions on the boundary hold, node by node, and what passes its parts."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from .cells import Cells
from .solver import (
    Balance,
    Condition,
    Fields,
    Floats,
    Integers,
    NoSlip,
    Open,
    Outflow,
    Problem,
    Slip,
    Step,
    SuperficialVelocity,
    Transfer,
    Value,
    Velocity,
)

SAME_NORMAL = 0.866  # cos 30 degrees: normals closer than that are those of one smooth boundary
ALIKE = 1e-9
"""Walls whose normals differ by less, relative to their length, are one in the sum of forces."""


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


class Part:
    """Integrals over a part of the boundary: f counts its facets, r the points of the rule."""

    def __init__(self, problem: Problem, name: str):
        self.facets = problem.boundaries[name]
        self.area = area_vectors(problem.points, self.facets)
        self.shape, self.share = facet_rule(problem.dimension)
        self.measure = np.outer(np.linalg.norm(self.area, axis=1), np.ones(len(self.share)))
        """Of the facet, at every point of the rule, (f, r)."""

    def at(self, nodal: Floats) -> Floats:
        """Nodal values at the points, (f, r, ..)."""
        return np.einsum("ra,fa...->fr...", self.shape, nodal[self.facets])

    def through(self, nodal: Floats) -> Floats:
        """What passes outward with nodal velocities, times the measure of the facet, (f, r)."""
        return np.einsum("fri,fi->fr", self.at(nodal), self.area)

    def entering(self, step: Step, wind: Floats) -> Floats:
        """-eps min(wind . n, 0) times the measure of the facet, of nodal u_n - u_mesh, (f, r)."""
        return -self.at(step.voidage) * np.minimum(self.through(wind), 0)

    def total(self, values: Floats) -> float:
        """Integral of values times the measure of the facet, (f, r)."""
        return float(np.einsum("r,fr->", self.share, values))

    def loads(self, values: Floats) -> Floats:
        """The same times each shape function, facet by facet, (f, D)."""
        return np.einsum("r,fr,ra->fa", self.share, values, self.shape)

    def pairs(self, values: Floats) -> Floats:
        """The same times each pair of shape functions, (f, D, D)."""
        return np.einsum("r,fr,ra,rb->fab", self.share, values, self.shape, self.shape)


def is_closed(conditions: Sequence[Condition]) -> bool:
    """Whether no boundary is open: nothing then sets the level of the pressure."""
    return not any(isinstance(condition.flow, Open) for condition in conditions)


def passing(problem: Problem, condition: Condition, step: Step) -> tuple[Floats, Floats]:
    """What the scene lets pass a part that is not open: a share, (n), of a velocity, (n, D), m/s.

    The share is the voidage for a velocity of the fluid, one for that of the whole mixture. The
    velocity is that of the condition of the part, not of its nodes, which at the end of a part
    belong to a neighbour: so the flux depends neither on the mesh nor on the order of the
    conditions. Of a moving wall the solid moves on as well as the fluid.
    """
    everything, shape = np.ones_like(step.voidage), problem.points.shape
    match condition.flow:
        case Velocity(value):
            return step.voidage, np.broadcast_to(value, shape)
        case SuperficialVelocity(value):
            return everything, np.broadcast_to(value, shape)
    return everything, np.zeros(shape) if step.motion is None else step.motion.velocity


def _last(
    problem: Problem, conditions: Sequence[Condition], holds: Callable[[Condition], bool]
) -> Integers:
    """Number of the last condition at every node that ``holds``, -1 if there is none, (n)."""
    last = np.full(len(problem.points), -1)
    for k, condition in enumerate(conditions):
        if holds(condition):
            last[problem.boundaries[condition.boundary]] = k
    return last


def _fixes(condition: Condition) -> bool:
    return isinstance(condition.flow, Velocity | SuperficialVelocity | NoSlip)


def _prescribes(k: int) -> Callable[[Condition], bool]:
    return lambda condition: isinstance(condition.scalar(k), Value)


def hold_velocity(problem: Problem, step: Step) -> tuple[Floats, Floats]:
    """Projectors on the velocities that the nodes are free to have, (n, D, D), and the velocity
    where it is fixed, that of the wall where there is slip, zero elsewhere, m/s, (n, D).

    A later prescribed velocity wins at shared nodes, and any over slip. At a node with slip,
    normals within 30 degrees are averaged; a sharper corner holds each.
    """
    count, dimension = problem.points.shape
    free, value = np.tile(np.eye(dimension), (count, 1, 1)), np.zeros((count, dimension))
    free[_last(problem, step.conditions, _fixes) >= 0] = 0
    normals: dict[int, list[Floats]] = {}
    for condition in filter(_fixes, step.conditions):
        nodes = problem.boundaries[condition.boundary]
        _, velocity = passing(problem, condition, step)
        if isinstance(condition.flow, SuperficialVelocity):
            velocity = velocity / step.voidage[:, None]
        value[nodes] = velocity[nodes]
    for node, _, area in _sliding(problem, step):
        _add_normal(normals.setdefault(node, []), area)
    for node, directions in normals.items():
        unit = np.array([direction / np.linalg.norm(direction) for direction in directions])
        free[node] -= np.linalg.pinv(unit, 1e-6) @ unit
        if step.motion is not None:
            value[node] = step.motion.velocity[node]
    return free, value


def _sliding(problem: Problem, step: Step) -> Iterator[tuple[int, int, Floats]]:
    """Nodes that slide along walls, with the number of the condition and the normal times measure,
    facet by facet."""
    fixed = _last(problem, step.conditions, _fixes) >= 0
    for number, condition in enumerate(step.conditions):
        if isinstance(condition.flow, Slip):
            facets = problem.boundaries[condition.boundary]
            for nodes, area in zip(facets, area_vectors(problem.points, facets), strict=True):
                for node in nodes[~fixed[nodes]].tolist():
                    yield node, number, area


def _add_normal(normals: list[Floats], area: Floats) -> None:
    for k, other in enumerate(normals):
        cosine = other @ area / (np.linalg.norm(other) * np.linalg.norm(area))
        if abs(cosine) > SAME_NORMAL:
            normals[k] = other + np.sign(cosine) * area
            return
    normals.append(area)


def hold_flow(problem: Problem, cells: Cells, step: Step) -> tuple[Floats, Floats, float]:
    """Projectors on the free unknowns of every node, the values of the others, a source of mass.

    The unknowns are (u, p): (n, D + 1, D + 1) and (n, D + 1). In a closed domain one pressure is
    held; the caller moves the mean to zero. The equation that falls away must follow from the
    others: what sums of prescribed fluxes and sources lack to balance, round-off and the error of
    sums for integrals, is spread evenly over the domain, as by a Lagrange multiplier of the mean
    pressure. That is the source, 1/s.
    """
    count, dimension = problem.points.shape
    free, spread = np.tile(np.eye(dimension + 1), (count, 1, 1)), 0.0
    free[:, :dimension, :dimension], value = hold_velocity(problem, step)
    if is_closed(step.conditions):
        free[0, dimension, dimension] = 0
        given = 0.0 if step.sources is None else cells.nodal_volume @ step.sources.mass
        spread = (net_flux(problem, step) - given) / cells.volume
    return free, np.pad(value, ((0, 0), (0, 1))), spread


def hold_scalar(
    problem: Problem, conditions: Sequence[Condition], k: int
) -> tuple[Floats, Floats]:
    """The same for scalar k, (n, 1, 1) and (n, 1); the later condition wins."""
    count = len(problem.points)
    free, value = np.ones((count, 1, 1)), np.zeros((count, 1))
    for condition in conditions:
        match condition.scalar(k):
            case Value(given):
                nodes = problem.boundaries[condition.boundary]
                free[nodes] = 0
                value[nodes, 0] = np.broadcast_to(given, count)[nodes]
    return free, value


def net_flux(problem: Problem, step: Step) -> float:
    """What the velocities prescribed all around let out, and walls push out, less what they let in.

    Raises ``ValueError`` if that is more than round-off.
    """
    net = gross = 0.0
    for condition in step.conditions:
        part = Part(problem, condition.boundary)
        share, velocity = passing(problem, condition, step)
        net += part.total(part.at(share) * part.through(velocity))
        speed = np.linalg.norm(part.at(velocity), axis=2)
        gross += part.total(part.measure * part.at(share) * speed)
    if abs(net) > 1e-9 * gross:
        raise ValueError(
            f"no boundary is open, but the prescribed velocities let {net:.3e} more fluid out "
            "than in; open one"
        )
    return net


def flow_terms(
    problem: Problem, condition: Condition, step: Step, wind: Floats
) -> tuple[Integers, Floats, Floats]:
    """Terms of a part in momentum and mass: its facets, matrices (f, D, D + 1, D, D + 1) and
    right-hand sides (f, D, D + 1).

    <<eps u . n, q>>, and if open <<p_out n, v>> - <<eps rho min(wind . n, 0) u, v>>, where ``wind``
    is u_n - u_mesh. What passes a part that is not open is known.
    """
    part, D = Part(problem, condition.boundary), problem.dimension
    rhs = np.zeros((len(part.facets), D, D + 1))
    matrix = np.zeros((*rhs.shape, D, D + 1))
    if isinstance(condition.flow, Open):
        passes = part.pairs(part.at(step.voidage))
        matrix[:, :, D, :, :D] = np.einsum("fab,fi->fabi", passes, part.area)
        taken = part.pairs(problem.density * part.entering(step, wind))
        for i in range(D):
            matrix[:, :, i, :, i] = taken
        rhs[:, :, :D] = -condition.flow.pressure / D * part.area[:, None]
    else:
        share, velocity = passing(problem, condition, step)
        rhs[:, :, D] = -part.loads(part.at(share) * part.through(velocity))
    return part.facets, matrix, rhs


def scalar_terms(
    problem: Problem, condition: Condition, step: Step, wind: Floats, k: int
) -> tuple[Integers, Floats, Floats]:
    """Terms <<h (s - outside), S>> of a part in the equation of scalar k: its facets, matrices
    (f, D, D) and right-hand sides (f, D)."""
    part = Part(problem, condition.boundary)
    match condition.scalar(k):
        case Transfer(coefficient, outside):
            h = coefficient * part.measure
        case Outflow(outside) if outside is not None:
            h = problem.scalars[k].capacity * part.entering(step, wind)
        case _:
            h, outside = 0 * part.measure, 0.0
    return part.facets, part.pairs(h), outside * part.loads(h)


def balances(
    problem: Problem,
    step: Step,
    old: Fields,
    new: Fields,
    residual: Floats,
    scalar_residuals: Sequence[Floats],
) -> dict[str, Balance]:
    """What passes the parts of the boundary, from the discrete equations themselves.

    ``residual`` is A x - b of momentum, (n, D), and of each scalar, (n), with all boundary
    integrals, before conditions take the place of equations: what holds a node gives it to the
    fluid. Elsewhere what passes are the integrals that were assembled. So the sums over the parts
    close to what the linear solver leaves.
    """
    forces = _holding_forces(problem, step, residual)
    last = [_last(problem, step.conditions, _prescribes(k)) for k in range(len(problem.scalars))]
    wind = old.velocity - (0 if step.motion is None else step.motion.velocity)
    unknown, found = np.column_stack((new.velocity, new.pressure)), {}
    for number, condition in enumerate(step.conditions):
        part = Part(problem, condition.boundary)
        facets, matrix, rhs = flow_terms(problem, condition, step, wind)
        passed = np.einsum("faibj,fbj->i", matrix, unknown[facets]) - rhs.sum(axis=(0, 1))
        share, velocity = passing(problem, condition, step)
        if isinstance(condition.flow, Open):
            share, velocity = step.voidage, new.velocity
        elif isinstance(condition.flow, NoSlip | Slip):
            share = np.zeros_like(share)  # a wall carries nothing away
        flux, given, convected = part.at(share) * part.through(velocity), [], []
        for k, (scalar, s) in enumerate(zip(problem.scalars, new.scalars, strict=True)):
            _, matrix, rhs = scalar_terms(problem, condition, step, wind, k)
            held = scalar_residuals[k][last[k] == number].sum()
            given.append(float(held + rhs.sum() - np.einsum("fab,fb->", matrix, s[facets])))
            convected.append(part.total(scalar.capacity * part.at(s) * flux))
        force = forces[number] + passed[:-1]
        total = float(passed[-1])
        found[condition.boundary] = Balance(total, force, tuple(given), tuple(convected))
    return found


def _holding_forces(problem: Problem, step: Step, residual: Floats) -> Floats:
    """Forces of the fluid on the conditions that hold nodes, (number of them, D).

    That of a node goes to the last condition that fixes it, else to the one along whose wall it
    slides; of a corner between several it is resolved into their normals, by least squares.
    """
    fixed = _last(problem, step.conditions, _fixes)
    forces = np.zeros((len(step.conditions), problem.dimension))
    np.subtract.at(forces, fixed[fixed >= 0], residual[fixed >= 0])
    walls: dict[int, dict[int, Floats]] = {}
    for node, number, area in _sliding(problem, step):
        areas = walls.setdefault(node, {})
        areas[number] = areas.get(number, 0) + area
    for node, areas in walls.items():
        numbers, normals = list(areas), np.array(list(areas.values())).T
        if len(numbers) == 1:
            forces[numbers] -= residual[node]
            continue
        along = np.linalg.lstsq(normals, residual[node], rcond=ALIKE)[0]
        forces[numbers] -= (along * normals).T
    return forces
