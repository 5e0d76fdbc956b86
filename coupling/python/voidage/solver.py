"""What a fluid solver is: the data it gets, the data it gives, and the three methods between them.

A solver knows neither grains nor the coupling scheme. What is immersed in the fluid comes as
points. A point lies in a cell, has a volume and a drag coefficient of its own, and follows the
affine law ``v* = velocity + mobility (drag u - volume grad p)``; for a scalar s that it exchanges
with the fluid likewise ``s* = value + mobility coefficient s``. All quantities are in SI units;
``D`` is 2 or 3, ``n`` counts nodes, ``m`` cells, ``q`` points.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Velocity:
    """Prescribed velocity u, one vector or one per node of the mesh, m/s."""

    value: Floats


@dataclass(frozen=True)
class SuperficialVelocity:
    """Prescribed eps u, with the nodal voidage eps of the step, m/s."""

    value: Floats


@dataclass(frozen=True)
class NoSlip:
    """u = 0, on a moving mesh u = u_mesh: the nodes of a wall move with it."""


@dataclass(frozen=True)
class Slip:
    """u . n = 0, on a moving mesh u_mesh . n; no tangential traction."""


@dataclass(frozen=True)
class Open:
    """Traction -pressure n; the momentum of fluid that enters is taken up."""

    pressure: float


@dataclass(frozen=True)
class Free:
    """A body whose velocity U is found with the fluid: inertia U = force + force of the fluid."""

    inertia: Floats
    """kg/s (kg/s/m in the plane), (D, D)."""
    force: Floats
    """N (N/m in the plane), (D)."""


@dataclass(frozen=True)
class Held:
    """A body whose velocity is given, m/s, (D)."""

    velocity: Floats


BodyMotion = Free | Held


@dataclass(frozen=True)
class Evaporation:
    """How a body boils: the rate of the heat that it gets over ``latent``."""

    scalar: int | None
    """Number of the scalar that is the temperature; None where the fluid brings no heat."""
    heat: float
    """Heat from elsewhere, W (W/m in the plane)."""
    latent: float
    """Heat that a volume of vapour takes, J/m3."""
    heat_flux: str = "reaction"
    """What the heat of the fluid is: the ``"reaction"`` of the discrete equations, or the integral
    of the discrete ``"gradient"`` at the surface."""


@dataclass(frozen=True)
class Body:
    """A closed part of the boundary that moves as a rigid body, grows or shrinks, and lets vapour
    out (:mod:`voidage.body`)."""

    centre: Floats
    """m, (D)."""
    radius: float
    """m."""
    expansion: float
    """Rate of the radius, m/s."""
    motion: BodyMotion
    evaporation: Evaporation | None
    """None if it does not boil."""
    solid: Floats
    """Solid that passes the surface into the body, as it acts in the equation of mass: the integral
    of solid v . n q for the q of every node of every facet, m3/s (m2/s in the plane), (k, D).
    Without rows if there is none."""
    blowing: str = "superficial"
    """What the velocity of the vapour is: ``"superficial"`` or ``"interstitial"``."""


@dataclass(frozen=True)
class Value:
    """Prescribed scalar, one number or one per node of the mesh."""

    value: Floats | float


@dataclass(frozen=True)
class Transfer:
    """Flux coefficient (outside - s) into the fluid: of heat in W/m2, coefficient in W/m2/K."""

    coefficient: float
    outside: float


@dataclass(frozen=True)
class Insulated:
    """No flux."""


@dataclass(frozen=True)
class Outflow:
    """No diffusive flux; fluid that enters has the value ``outside``, if there is one."""

    outside: float | None


Flow = Velocity | SuperficialVelocity | NoSlip | Slip | Open | Body
ScalarCondition = Value | Transfer | Insulated | Outflow


@dataclass(frozen=True)
class Condition:
    """Conditions on one named part of the boundary."""

    boundary: str
    flow: Flow
    scalars: tuple[ScalarCondition, ...] = ()
    """One per scalar; where those at the end are missing, the part is insulated."""

    def scalar(self, k: int) -> ScalarCondition:
        """The condition of scalar ``k``."""
        return self.scalars[k] if k < len(self.scalars) else Insulated()


@dataclass(frozen=True)
class Scalar:
    """A scalar s that the fluid carries: the temperature, or what a user adds. Units of heat."""

    name: str
    capacity: float
    """Volumetric capacity C: rho c, J/m3/K; 1 for a tracer."""
    conductivity: float
    """k, W/m/K; the diffusivity of a tracer, m2/s."""
    expansion: float = 0.0
    """beta in the weight rho g (1 - sum of beta (s - s_R)), 1/K."""
    reference: float = 0.0
    """s_R, K."""
    wall_coefficient: float = 0.0
    """lambda in q_l = lambda (s_w - s), from the front and rear walls of a thin cell, W/m3/K."""
    wall_value: float = 0.0
    """s_w, K."""
    form: Literal["consistent", "lumped", "monotone"] = "consistent"
    """``lumped``: storage and exchange are lumped in the Galerkin equations, storage and thin cell
    by the vertex rule, the points by the sums of the rows. Values then keep their bounds where the
    exchange over a cell outweighs its diffusion. ``monotone``: besides, no value leaves the range
    of those around it. Instead of streamline diffusion the matrix gets the least symmetric
    diffusion between neighbours that leaves no positive entry beside the diagonal."""


@dataclass(frozen=True)
class Fields:
    """Nodal values."""

    velocity: Floats
    """(n, D)."""
    pressure: Floats
    """(n)."""
    scalars: tuple[Floats, ...] = ()
    """(n) each, in the order of ``Problem.scalars``."""


@dataclass(frozen=True)
class Problem:
    """Everything that stays from step to step, and the fields to start from."""

    points: Floats
    """(n, D)."""
    cells: Integers
    """(m, D + 1), positively oriented."""
    boundaries: Mapping[str, Integers]
    """Nodes of the facets of each named part, (k, D), oriented so that the normal points
    outward."""
    density: float
    viscosity: float
    gravity: Floats
    fields: Fields
    scalars: tuple[Scalar, ...] = ()
    thin_cell_drag: float = 0.0
    """gamma_l in f_l = -gamma_l u, drag of the front and rear walls of a thin cell, kg/m3/s."""
    newton: int = 1
    """Newton steps of the convection per time step."""
    tolerance: float = 1e-8
    """Relative residual of the linear systems, for solvers that iterate."""
    body_force: Floats | None = None
    """Further acceleration of the fluid, m/s2; it weighs neither by temperature nor on the points."""
    masters: Integers | None = None
    """The node whose values every node has, (n), where the mesh has periodic sides. A solver that does
    not know them must refuse the problem."""

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.points.shape[1]


@dataclass(frozen=True)
class PointScalar:
    """What the points exchange of a scalar: s* = value + mobility coefficient s, (q) each."""

    coefficient: Floats
    """W/K for heat."""
    mobility: Floats
    """K/W for heat."""
    value: Floats
    """K for heat."""


@dataclass(frozen=True)
class Points:
    """What is immersed in the fluid, point by point."""

    cell: Integers
    """The cell that a point lies in, (q)."""
    shape: Floats
    """Shape functions of the cell at the point, (q, D + 1)."""
    volume: Floats
    """V, m3 (m2 in the plane), (q)."""
    drag: Floats
    """gamma, kg/s, (q)."""
    mobility: Floats
    """a of the law v* = b + a (gamma u - V grad p) in momentum, s/kg, (q)."""
    velocity: Floats
    """b of that law, m/s, (q, D)."""
    flux_mobility: Floats
    """a of the law in the equation of mass, s/kg, (q)."""
    flux_velocity: Floats
    """b of that law, m/s, (q, D)."""
    scalars: tuple[PointScalar | None, ...]
    """One per scalar of the problem; None for one that the points do not exchange."""


@dataclass(frozen=True)
class Motion:
    """How the mesh moves in a step."""

    points: Floats
    """Places of the nodes at the end of the step, where the equations are solved, m, (n, D)."""
    velocity: Floats
    """u_mesh, the way of the nodes over the length of the step, m/s, (n, D)."""


@dataclass(frozen=True)
class Sources:
    """Nodal sources per volume: of solid volume that comes in, and for manufactured solutions."""

    momentum: Floats
    """N/m3, (n, D)."""
    mass: Floats
    """Over the density; of grains the volume that comes in by time, 1/s, (n)."""
    scalars: tuple[Floats, ...]
    """W/m3 for heat, (n) each."""


@dataclass(frozen=True)
class Step:
    """What changes from step to step."""

    dt: float
    conditions: Sequence[Condition]
    """In the order of the scene: where prescribed values meet, the later wins."""
    voidage: Floats
    """(n)."""
    points: Points | None = None
    sources: Sources | None = None
    motion: Motion | None = None
    """Present if the mesh moves; the points then lie in the mesh where it is at the end."""


@dataclass(frozen=True)
class Balance:
    """What passes a named part of the boundary in a step; in the plane all per metre of depth."""

    flux: float
    """Volume that leaves: of fluid, where a wall or a body moves of the whole mixture, m3/s."""
    force: Floats
    """Of the fluid on the part; of an open one with the momentum that entering fluid takes up, N,
    (D)."""
    torque: Floats
    """Moment of the force about the origin, N m: in space about x, y and z, (3); in the plane (N)
    about z, anticlockwise, (1)."""
    scalars: tuple[float, ...]
    """What the part gives to the fluid of each scalar by conduction, by transfer and by the value
    of the fluid that enters, W for heat."""
    convected: tuple[float, ...]
    """What leaves of each scalar with the fluid: capacity times value times flux, W for heat."""


@dataclass(frozen=True)
class BodyAnswer:
    """What a body does in a step."""

    velocity: Floats
    """U, m/s, (D)."""
    vapour: float
    """Volume of vapour that leaves it, m3/s (m2/s in the plane)."""


@dataclass
class Report:
    """What a step cost."""

    iterations: int = 0
    """Linear iterations or refinements, summed over the systems of the step."""
    residual: float = 0.0
    """Relative residual of the last flow system, with bodies the largest of its right-hand
    sides."""
    flow_s: float = 0.0
    scalars_s: float = 0.0


@dataclass(frozen=True)
class Solution:
    """What a solver returns."""

    fields: Fields
    """At the end of the step."""
    report: Report = field(default_factory=Report)
    balances: Mapping[str, Balance] = field(default_factory=dict)
    """By part of the boundary; empty if the solver does not compute them."""
    bodies: Sequence[BodyAnswer] = ()
    """In the order of the conditions; empty if the solver does not know bodies."""


class Solver(ABC):
    """A fluid solver. ``solve`` always starts from the last accepted state: a scheme may call it
    many times."""

    periodic_sides = False
    """Whether it heeds :attr:`Problem.masters`; if not, a mesh with periodic sides is an error."""

    @abstractmethod
    def set_mesh(self, problem: Problem) -> None:
        """Takes mesh, properties and fields: at the start, at a restart, after remeshing."""

    @abstractmethod
    def solve(self, step: Step) -> Solution:
        """Solves one step."""

    @abstractmethod
    def accept(self) -> None:
        """Makes the last solution the accepted state."""
