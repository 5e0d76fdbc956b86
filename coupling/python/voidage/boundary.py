"""Conditions that replace equations, node by node."""

from collections.abc import Sequence

import numpy as np

from .cells import Cells
from .solver import (
    Condition,
    Floats,
    Integers,
    Motion,
    NoSlip,
    Open,
    Problem,
    Slip,
    Step,
    SuperficialVelocity,
    Temperature,
    Velocity,
)

SAME_NORMAL = 0.866  # cos 30 degrees: normals closer than that are those of one smooth boundary


def area_vectors(points: Floats, facets: Integers) -> Floats:
    """Outward normal times measure of facets, (k, D)."""
    edges = points[facets[:, 1:]] - points[facets[:, :1]]
    if points.shape[1] == 2:
        return np.stack((edges[:, 0, 1], -edges[:, 0, 0]), axis=1)
    return 0.5 * np.cross(edges[:, 0], edges[:, 1])


class Holds:
    """What holds the velocity of the nodes.

    A later prescribed velocity wins at shared nodes; slip never frees a node that is fixed, and
    gives way to a later prescribed velocity. At a node with slip, normals within 30 degrees are
    averaged; a sharper corner holds each.
    """

    def __init__(
        self,
        problem: Problem,
        conditions: Sequence[Condition],
        voidage: Floats,
        motion: Motion | None = None,
    ):
        count, dimension = problem.points.shape
        self.fixed = np.zeros(count, bool)
        self.value = np.zeros((count, dimension))
        """Velocity where fixed, that of the wall where there is slip, zero elsewhere, m/s."""
        wall = np.zeros((count, dimension)) if motion is None else motion.velocity
        normals: dict[int, list[Floats]] = {}
        for condition in conditions:
            facets = problem.boundaries[condition.boundary]
            nodes = np.unique(facets)
            match condition.flow:
                case Open():
                    continue
                case Slip():
                    _add_normals(normals, facets, area_vectors(problem.points, facets), self.fixed)
                    continue
                case NoSlip():
                    value = wall
                case Velocity(value):
                    value = np.broadcast_to(value, (count, dimension))
                case SuperficialVelocity(value):
                    value = np.broadcast_to(value, (count, dimension)) / voidage[:, None]
            self.fixed[nodes] = True
            self.value[nodes] = value[nodes]
        self.free = np.tile(np.eye(dimension), (count, 1, 1))
        """Projector on the velocities that a node is free to have, (n, D, D)."""
        self.free[self.fixed] = 0
        for node, directions in normals.items():
            if not self.fixed[node]:
                self.free[node] -= _projector(directions)
                self.value[node] = wall[node]


def _add_normals(
    normals: dict[int, list[Floats]], facets: Integers, areas: Floats, fixed: Floats
) -> None:
    for facet, area in zip(facets, areas, strict=True):
        for node in facet[~fixed[facet]]:
            held = normals.setdefault(int(node), [])
            for k, other in enumerate(held):
                cosine = other @ area / (np.linalg.norm(other) * np.linalg.norm(area))
                if abs(cosine) > SAME_NORMAL:
                    held[k] = other + np.sign(cosine) * area
                    break
            else:
                held.append(area)


def _projector(directions: list[Floats]) -> Floats:
    """Orthogonal projector on the span of the directions; those that add nothing are dropped."""
    unit = [direction / np.linalg.norm(direction) for direction in directions]
    left, length, _ = np.linalg.svd(np.stack(unit, axis=1), full_matrices=False)
    basis = left[:, length > 1e-6]
    return basis @ basis.T


def is_closed(conditions: Sequence[Condition]) -> bool:
    """Whether no boundary is open: nothing then sets the level of the pressure."""
    return not any(isinstance(condition.flow, Open) for condition in conditions)


def hold_flow(problem: Problem, cells: Cells, step: Step) -> tuple[Floats, Floats, float]:
    """Projectors on the free unknowns of every node, the values of the others, a source of mass.

    The unknowns are (u, p): (n, D + 1, D + 1) and (n, D + 1). In a closed domain one pressure is
    held; the caller moves the mean to zero. The equation that falls away must follow from the
    others: what sums of prescribed fluxes and sources lack to balance, round-off and the error of
    sums for integrals, is spread evenly over the domain, as by a Lagrange multiplier of the mean
    pressure. That is the source, 1/s.
    """
    count, dimension = problem.points.shape
    holds = Holds(problem, step.conditions, step.voidage, step.motion)
    free = np.tile(np.eye(dimension + 1), (count, 1, 1))
    free[:, :dimension, :dimension] = holds.free
    spread = 0.0
    if is_closed(step.conditions):
        free[0, dimension, dimension] = 0
        excess = balance(problem, step)
        if step.sources is not None:
            excess -= cells.nodal_volume @ step.sources.mass
        spread = excess / cells.volume
    return free, np.pad(holds.value, ((0, 0), (0, 1))), spread


def hold_heat(problem: Problem, conditions: Sequence[Condition]) -> tuple[Floats, Floats]:
    """The same for the temperature, (n, 1, 1) and (n, 1); the later condition wins."""
    count = len(problem.points)
    free, value = np.ones((count, 1, 1)), np.zeros((count, 1))
    for condition in conditions:
        if isinstance(condition.heat, Temperature):
            nodes = np.unique(problem.boundaries[condition.boundary])
            free[nodes] = 0
            value[nodes, 0] = np.broadcast_to(condition.heat.value, count)[nodes]
    return free, value


def passing(problem: Problem, condition: Condition, motion: Motion | None) -> tuple[Floats, bool]:
    """What the scene lets pass a part that is not open, (n, D), m/s: and whether it is a velocity of
    the fluid, which takes the voidage, or of the whole mixture.

    It is that of the condition of the part, not of its nodes, which at the end of a part belong to a
    neighbour: so the flux depends neither on the mesh nor on the order of the conditions. Of a moving
    wall the solid moves on as well as the fluid.
    """
    match condition.flow:
        case Velocity(value):
            return np.broadcast_to(value, problem.points.shape), True
        case SuperficialVelocity(value):
            return np.broadcast_to(value, problem.points.shape), False
    still = np.zeros(problem.points.shape)
    return (still if motion is None else motion.velocity), False


def balance(problem: Problem, step: Step) -> float:
    """What the velocities prescribed all around let out, and walls push out, less what they let in.

    Raises ``ValueError`` if that is more than round-off.
    """
    net = gross = 0.0
    for condition in step.conditions:
        facets = problem.boundaries[condition.boundary]
        # Facet integrals of phi_a phi_b: measure (1 + delta_ab) / (D (D + 1)).
        dimension = facets.shape[1]
        mass = (1 + np.eye(dimension)) / (dimension * (dimension + 1))
        normal = area_vectors(problem.points, facets)
        velocity, of_fluid = passing(problem, condition, step.motion)
        share = step.voidage if of_fluid else np.ones_like(step.voidage)
        flux = np.einsum("fa,ab,fbi->fbi", share[facets], mass, velocity[facets])
        net += np.einsum("fbi,fi->", flux, normal)
        gross += (np.linalg.norm(flux, axis=2).sum(axis=1) @ np.linalg.norm(normal, axis=1))
    if abs(net) > 1e-9 * gross:
        raise ValueError(
            f"no boundary is open, but the prescribed velocities let {net:.3e} more fluid out "
            "than in; open one"
        )
    return net
