"""What a fluid solver is: the data it gets, the data it gives, and the four methods between them.

A solver never knows the coupling scheme. Grain ``i`` comes with its drag coefficient ``gamma`` and
the affine law of the velocity that it will have, ``v* = velocity + mobility (gamma u - volume grad
p)``; with heat likewise ``T* = temperature + mobility (coefficient T)``. All quantities are in SI
units; ``D`` is 2 or 3, ``n`` counts nodes, ``m`` cells, ``g`` grains, ``q`` pieces of grains.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
class Temperature:
    """Prescribed temperature, one number or one per node of the mesh, K."""

    value: Floats


@dataclass(frozen=True)
class Newton:
    """Newton cooling, q = coefficient (temperature - T); W/m2/K and K."""

    coefficient: float
    temperature: float


@dataclass(frozen=True)
class Adiabatic:
    """No heat flux."""


@dataclass(frozen=True)
class OpenHeat:
    """No diffusive flux; fluid that enters has the given temperature, K, if there is one."""

    temperature: float | None


Flow = Velocity | SuperficialVelocity | NoSlip | Slip | Open
HeatFlow = Temperature | Newton | Adiabatic | OpenHeat


@dataclass(frozen=True)
class Condition:
    """Conditions on one named part of the boundary."""

    boundary: str
    flow: Flow
    heat: HeatFlow = Adiabatic()


@dataclass(frozen=True)
class Heat:
    """Thermal properties of the fluid."""

    capacity: float
    """Volumetric capacity rho c, J/m3/K."""
    conductivity: float
    """k, W/m/K."""
    expansion: float
    """beta, 1/K."""
    reference: float
    """Temperature T_R at which gravity acts on the density rho, K."""
    wall_coefficient: float = 0.0
    """lambda in q_l = lambda (T_w - T), heat from the front and rear walls of a thin cell,
    W/m3/K."""
    wall_temperature: float = 0.0
    """T_w, K."""
    lumped: bool = False
    """Whether storage and exchange are lumped in the Galerkin equations: storage and thin cell by the
    vertex rule, the grains by the sums of the rows. Temperatures then keep their bounds where the
    exchange over a cell outweighs its diffusion."""
    monotone: bool = False
    """Whether no temperature leaves the range of those around it: instead of streamline diffusion the
    matrix gets the least symmetric diffusion between neighbours that leaves no positive entry beside
    the diagonal. Comes with ``lumped``."""


@dataclass(frozen=True)
class Fields:
    """Nodal values: velocity (n, D), pressure (n), and temperature (n) with heat."""

    velocity: Floats
    pressure: Floats
    temperature: Floats | None = None


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
    heat: Heat | None = None
    thin_cell_drag: float = 0.0
    """gamma_l in f_l = -gamma_l u, drag of the front and rear walls of a thin cell, kg/m3/s."""
    newton: int = 1
    """Newton steps of the convection per time step."""
    tolerance: float = 1e-8
    """Relative residual of the linear systems, for solvers that iterate."""
    drag_in_stabilisation: bool = False
    """Whether the drag of the grains enters the stabilisation time."""

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.points.shape[1]


@dataclass(frozen=True)
class GrainHeat:
    """Heat columns of the grains, (g) each."""

    coefficient: Floats
    """hA, W/K."""
    mobility: Floats
    """aT, K/W."""
    temperature: Floats
    """bT, K."""


@dataclass(frozen=True)
class VelocityLaw:
    """A law v* = velocity + mobility (gamma u - volume grad p), (g) each."""

    mobility: Floats
    """s/kg."""
    velocity: Floats
    """m/s, (g, D)."""


@dataclass(frozen=True)
class Grains:
    """Columns of the grains, (g) each."""

    volume: Floats
    """V, m3 (m2 in the plane)."""
    drag: Floats
    """gamma, kg/s."""
    mobility: Floats
    """a, s/kg."""
    velocity: Floats
    """b, m/s, (g, D)."""
    heat: GrainHeat | None = None
    continuity: VelocityLaw | None = None
    """The law of the solid flux in the equation of mass, where it is not that of momentum."""


@dataclass(frozen=True)
class Pieces:
    """The grains cut by the mesh: grain i owns pieces ``first[i]`` to ``first[i + 1]``."""

    first: Integers
    """(g + 1)."""
    cell: Integers
    """(q)."""
    shape: Floats
    """Shape functions of the cell at the centroid of the piece, (q, D + 1)."""
    share: Floats
    """Share of the grain's volume, (q); sums to one per grain."""


@dataclass(frozen=True)
class Motion:
    """How the mesh moves in a step."""

    points: Floats
    """Places of the nodes at the end of the step, where the equations are solved, m, (n, D)."""
    velocity: Floats
    """u_mesh, the way of the nodes over the length of the step, m/s, (n, D)."""


@dataclass(frozen=True)
class Sources:
    """Nodal sources per volume, for manufactured solutions: momentum (n, D), mass over density,
    heat."""

    momentum: Floats
    mass: Floats
    heat: Floats


@dataclass(frozen=True)
class Step:
    """What changes from step to step."""

    dt: float
    conditions: Sequence[Condition]
    """In the order of the scene: where prescribed values meet, the later wins."""
    voidage: Floats
    """(n)."""
    grains: Grains | None = None
    pieces: Pieces | None = None
    """Present with grains."""
    sources: Sources | None = None
    motion: Motion | None = None
    """Present if the mesh moves; the grains are then cut by the mesh where it is at the end."""


@dataclass(frozen=True)
class AtGrains:
    """The fluid at each grain, means over its pieces: (g, D), (g, D), (g)."""

    velocity: Floats
    pressure_gradient: Floats
    temperature: Floats | None = None


@dataclass
class Report:
    """What a step cost, and what the fluid lost to the grains."""

    force: Floats
    """Force on all grains, summed over the pieces by the fluid, N, (D); zero without grains, empty
    if the solver does not sum it: the defects of the exchange are then not known."""
    iterations: int = 0
    """Linear iterations or refinements, summed over the systems of the step."""
    residual: float = 0.0
    """Relative residual of the last flow system."""
    flow_s: float = 0.0
    heat_s: float = 0.0
    heat: float = 0.0
    """Heat to all grains, summed over the pieces by the fluid, W."""


class Solver(ABC):
    """A fluid solver. ``solve`` always starts from the last accepted state: a scheme may call it
    many times."""

    @abstractmethod
    def set_mesh(self, problem: Problem) -> None:
        """Takes mesh, properties and fields: at the start, at a restart, after remeshing."""

    @abstractmethod
    def solve(self, step: Step) -> tuple[AtGrains, Report]:
        """Solves one step and returns the fluid at the grains."""

    @abstractmethod
    def accept(self) -> None:
        """Makes the last solution the accepted state."""

    @abstractmethod
    def fields(self) -> Fields:
        """The accepted state."""
