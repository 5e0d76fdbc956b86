"""Bodies in the fluid: closed parts of the boundary that move as rigid bodies, grow or shrink, and
let vapour out.

The surface of a body moves with w = U + rdot s, where s is the place beside the centre over the
radius, and vapour leaves it with the superficial velocity j = vapour / perimeter. Held at its
nodes, and known in the equation of mass (n points into the body), are

    u = w + (j / eps) s/|s|    and    <<eps w . n, q>> + solid - j <<1, q>>,

with an interstitial j instead w + j s/|s| and <<eps j, q>>.

Vapour is the heat that the body gets over that which a volume of it takes; that of the fluid is the
reaction -sum (A T - b) of its nodes, or the integral of -eps K grad T . n. The force of the fluid
is the reaction F = -sum (K x - b) of the rows of momentum. With x_0 the solution at U = 0 and X_i
those of a unit velocity along axis i without any other data, on one matrix,

    x = x_0 + sum U_i X_i,    F = F_0 + F_X U,    (A - F_X) U = B + F_0.
"""

import numpy as np
from scipy.linalg import block_diag

from .boundary import Boundary, facet_rule
from .cells import Cells
from .solver import Body, BodyAnswer, Floats, Free, Held

LEAST_VOIDAGE = 0.05
"""Voidage below which the velocity of what leaves a surface no longer grows. The volume that leaves
is exact all the same."""


class Bodies:
    """The bodies of a step, once its scalars are known. The boundary gets what they hold and what
    passes them, until :meth:`settle` with U = 0 of those that are free."""

    def __init__(
        self, boundary: Boundary, cells: Cells, scalars: list[Floats], left: list[Floats]
    ):
        """``left`` is A x - b of each scalar, as :meth:`Boundary.balances` has it."""
        self.boundary, self.dimension = boundary, boundary.problem.dimension
        self.answers: dict[int, BodyAnswer] = {}
        self.free: dict[int, Free] = {}
        """By the number of the condition."""
        for number, condition in enumerate(boundary.step.conditions):
            if isinstance(condition.flow, Body):
                heats = [-boundary.given_by_values(k, each)[number] for k, each in enumerate(left)]
                boils = condition.flow.evaporation
                if boils is not None and boils.scalar is not None and boils.heat_flux == "gradient":
                    heats[boils.scalar] = self._conducted(number, boils.scalar, cells, scalars)
                self._take(number, condition.flow, heats)

    def _conducted(self, number: int, k: int, cells: Cells, scalars: list[Floats]) -> float:
        """What scalar k gives to a part by its gradients there, -<<eps K grad s . n, 1>>."""
        edge, D = self.boundary, self.dimension
        part = np.sort(edge.problem.boundaries[edge.step.conditions[number].boundary], axis=1)
        base = len(edge.problem.points) ** np.arange(D)
        slopes = {}
        for left_out in range(D + 1):
            faces = np.sort(np.delete(cells.nodes, left_out, axis=1), axis=1) @ base
            for cell in np.flatnonzero(np.isin(faces, part @ base)):
                nodes = cells.nodes[cell]
                slopes[faces[cell]] = scalars[k][nodes] @ cells.gradient[cell]
        here = edge.part == number
        slope = np.array([slopes[face] for face in part @ base])
        slope = slope.repeat(here.sum() // len(part), axis=0)
        through = np.einsum("qi,qi->q", slope, edge.area[here])
        return -edge.problem.scalars[k].conductivity * (edge.voidage[here] @ through)

    def _take(self, number: int, body: Body, heats: list[float]) -> None:
        edge, here, motion = self.boundary, self.boundary.part == number, body.motion
        vapour, velocity = 0.0, np.zeros(self.dimension)
        if (boils := body.evaporation) is not None:
            heat = boils.heat
            if (k := boils.scalar) is not None:
                heat += heats[k]
            vapour = heat / boils.latent
        match motion:
            case Free():
                self.free[number] = motion
            case Held():
                velocity = motion.velocity
        self.answers[number] = BodyAnswer(velocity, vapour)
        blowing, nodes = vapour / edge.measure[here].sum(), np.unique(edge.nodes[here])
        s = (edge.problem.points[nodes] - body.centre) / body.radius
        surface = np.zeros_like(edge.fixed)
        surface[nodes] = velocity + body.expansion * s
        interstitial = body.blowing == "interstitial"
        blown = np.full(len(nodes), blowing)
        if not interstitial:
            blown /= np.maximum(edge.step.voidage[nodes], LEAST_VOIDAGE)
        outward = s / np.linalg.norm(s, axis=1, keepdims=True)
        edge.fixed[nodes] = surface[nodes] + blown[:, None] * outward
        passed = edge.voidage[here] if interstitial else 1.0
        edge.blown[here] = -blowing * passed * edge.measure[here]
        edge.known[here] = (edge.voidage * edge.through(surface) + edge.blown)[here]
        if len(body.solid):
            # At the places of a facet what has the given sums with the shape functions.
            shape, _ = facet_rule(self.dimension)
            edge.known[here] += (body.solid @ np.linalg.pinv(shape)).ravel()
        # What a moving body pushes ahead and draws in behind is round-off in the net, at U = 0 too.
        speed = np.linalg.norm(edge.at(edge.step.motion.velocity), axis=1)
        edge.gross[here] = (abs(edge.known) + speed * edge.measure)[here]

    def responses(self) -> tuple[list[Floats], list[Floats]]:
        """Right-hand sides, (n (D + 1)) each, and what is held, (n, D + 1) each, of the X, those of
        one free body after the other."""
        edge, D, rhs, values = self.boundary, self.dimension, [], []
        for number in self.free:
            here = edge.part == number
            for i in range(D):
                unit = np.zeros((edge.count, D + 1))
                unit[edge.nodes[here], i] = 1
                values.append(unit)
                rhs.append(edge.mass(here * edge.voidage * edge.area[:, i]))
        return rhs, values

    def release(self, x: Floats, left: Floats) -> tuple[Floats, Floats]:
        """Finds the velocities of the free bodies. Returns the solution and its A x - b, of those
        of x_0 and all X in turn."""
        if not self.free:
            return x[0], left[0]
        edge, D, motions = self.boundary, self.dimension, self.free.values()
        ours = [edge.last == number for number in self.free]
        still, *slopes = np.hstack([-left[:, nodes, :D].sum(axis=1) for nodes in ours])
        inertia, force = block_diag(*(m.inertia for m in motions)), [m.force for m in motions]
        U = np.linalg.solve(inertia - np.transpose(slopes), np.concatenate(force) + still)
        for number, velocity in zip(self.free, U.reshape(-1, D), strict=True):
            self.answers[number] = BodyAnswer(velocity, self.answers[number].vapour)
        weights = np.array([1, *U])
        return np.tensordot(weights, x, 1), np.tensordot(weights, left, 1)

    def settle(self) -> list[BodyAnswer]:
        """What the bodies do. What passes free ones is from now on that with their velocities."""
        edge = self.boundary
        for number in self.free:
            through = edge.voidage * (edge.area @ self.answers[number].velocity)
            edge.known += (edge.part == number) * through
        return list(self.answers.values())
