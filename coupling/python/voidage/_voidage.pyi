"""The compiled part of the package. Quantities in SI units; D is 2, n counts nodes, m cells, g
grains, q points in the fluid."""

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .solver import Solution, Solver

__all__ = [
    "Columns",
    "Frame",
    "GrainState",
    "Mesh",
    "Overlap",
    "Peer",
    "Simulation",
    "System",
    "__version__",
    "environment",
    "main",
]
__version__: str

_Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]

class _Scheme(Protocol):
    """A coupling scheme."""

    def step(self, system: System, dt: float) -> object:
        """Advances the system by ``dt`` seconds; ends with ``system.accept()``."""

@final
class Simulation:
    """A scene in motion."""

    def __new__(
        cls,
        scene: str | PathLike[str],
        set: Sequence[str] | Mapping[str, object] | None = ...,
        *,
        fluid: str | Solver | None = None,
        scheme: str | _Scheme | None = None,
        restart: str | PathLike[str] | None = None,
        threads: int | None = None,
        log: str | PathLike[str] | None = None,
    ) -> Simulation:
        """Loads a scene file.

        Parameters
        ----------
        scene
            Path of the file.
        set
            Changes to its keys, as in ``["fluid.solver.newton=2"]``.
        fluid
            Name of a solver as ``voidage run --fluid`` has it, or a solver in this process; without
            it the scene says which.
        scheme
            Name of a coupling scheme, or an object with a method ``step(system, dt)``.
        restart
            A checkpoint of the same scene to go on from.
        threads
            Threads of this process, chosen once; results do not depend on it.
        log
            The file that gets the output of a solver in a process of its own; default
            ``solver.log``.

        Raises
        ------
        ValueError
            Wrong input; the text is that of the program.
        RuntimeError
            The fluid solver does not start.

        """

    def step(self) -> dict[str, Any]:
        """One step. Returns its report: wall time of the phases in s, contacts, residuals, defects
        of the exchange relative to what was exchanged. Raises RuntimeError if the step fails; what
        a solver or scheme in Python raised is then the cause."""

    def run(self, until: float | None = None) -> dict[str, Any]:
        """Steps to the end of the scene or to time ``until``, s. Returns the report of the last
        step."""

    def checkpoint(self, path: str | PathLike[str]) -> None:
        """Writes a checkpoint. ``Simulation(.., restart=path)`` and ``voidage run --restart`` go on
        from it bit for bit."""

    @property
    def time(self) -> float:
        """Time, s."""
    @property
    def steps(self) -> int:
        """Steps done since time zero."""
    @property
    def dt(self) -> float:
        """Length of a step, s."""
    @property
    def end(self) -> float:
        """Time at which the scene ends, s."""
    @property
    def title(self) -> str:
        """The title of the scene."""
    @property
    def report(self) -> dict[str, Any]:
        """Report of the last step."""
    @property
    def grains(self) -> Columns:
        """Columns of the grains, those that the scene has: position m, velocity m/s, force N (of
        the fluid) and contact_force N, (g, D); radius m, mass kg, volume m3, spin rad/s,
        temperature K, heat_capacity J/K, heat W (from the fluid) and contact_heat W, voidage, (g).
        In the plane per metre of depth. Position, velocity, spin and temperature can be written."""
    @property
    def fluid(self) -> Columns:
        """Accepted nodal fields: velocity m/s, (n, D); pressure Pa, every scalar by its name (K for
        ``temperature``) and voidage, (n)."""
    @property
    def mesh(self) -> Mesh | None:
        """The mesh of the fluid."""

@final
class Columns:
    """Columns by name. Reading copies a column to a read-only array; assigning writes the whole
    column, after a check of shape and values (ValueError). A name that is not there is a
    KeyError."""

    def keys(self) -> list[str]:
        """Names of the columns that the scene has."""
    def __getitem__(self, name: str, /) -> _Floats: ...
    def __setitem__(self, name: str, value: ArrayLike, /) -> None: ...
    def __contains__(self, name: str, /) -> bool: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[str]: ...

@final
class Mesh:
    """A mesh of triangles."""

    points: _Floats
    """(n, D), m."""
    cells: _Integers
    """Node numbers, (m, D + 1), positively oriented."""
    boundaries: Mapping[str, _Integers]
    """Nodes of the facets of each named part, (k, D)."""
    masters: _Integers | None
    """The node whose values each has, (n); none without periodic sides."""

@final
class GrainState:
    """All that makes the grains what they are at one moment."""

@final
class System:
    """Grains and fluid as a scheme sees them, during one call of its ``step`` or ``solve``. A length
    ``dt`` of a phase, s, is at most that of the step; without one it is that of the part in hand.
    Either side may make several steps in one of the other: the motions of the grains, and the
    solutions that are accepted, have the length of the step together."""

    def begin(self, dt: float) -> None:
        """Begins a part of the step, of ``dt``: the mesh goes to where it is at its end, and the
        phases take this length where none is given. Without, the step is one part."""
    def cut_grains(self) -> None:
        """Cuts the grains by the mesh, and computes the nodal voidage."""
    def evaluate_closures(self, dt: float | None = None) -> None:
        """Fills ``load["drag"]``, ``load["known"]`` and ``load["heat_coefficient"]`` by the laws of
        the scene, with the fluid of ``at_grains`` and the present velocities of the grains, and the
        voidage at the grains. ``known`` (g, D) is the part of the forcing drag u - volume grad p +
        known that the fluid does not change, of added mass and lift; zero without them."""
    def solve_fluid(self, dt: float | None = None) -> None:
        """Solves the fluid over ``dt`` from its last accepted state with the load as it is. Fills
        ``at_grains``, ``grains["force"]`` and ``grains["heat"]``. May be called many times."""
    def move_grains(
        self, dt: float | None = None, force: ArrayLike | None = None, heat: ArrayLike | None = None
    ) -> None:
        """Moves the grains by ``dt`` under ``force`` (g, D), N, and ``heat`` (g), W, contacts
        included; without, under those of the last solution, ``grains["force"]`` and
        ``grains["heat"]``. Further motions go on from there; at ``accept`` the force and heat on
        the grains become the means over all of them."""
    def drive_grains(
        self, force: ArrayLike, heat: ArrayLike | None = None, dt: float | None = None
    ) -> tuple[_Floats, _Floats | None]:
        """Moves the grains by ``dt`` under ``force`` (g, D), N, and ``heat`` (g), W (exactly if the
        scene has heat), from which the drag and the heat transfer of the grains themselves go off,
        ``load["drag"]`` v and ``load["heat_coefficient"]`` T, implicitly; contacts included.
        Returns the mean velocity in the motion, (g, D), with added mass what drag and added mass
        felt of it, and the mean temperature, (g), if there is heat; ``grains["force"]`` and
        ``grains["heat"]`` are then what is left of the forcing."""
    def give_back_carried(self, share: float = 0.5) -> None:
        """Lowers the laws of ``load["velocity"]`` and ``load["temperature"]``, once they are filled,
        so that the fluid gets ``share`` of the impulse and heat that are carried of earlier steps.
        From then on what grains get beyond what the fluid loses is carried, so that momentum and
        heat are kept over the steps."""
    def separate_continuity(self) -> None:
        """Gives the solid flux in the equation of mass a law of its own,
        ``load["continuity_mobility"]`` and ``load["continuity_velocity"]``, at first that of the
        momentum."""
    def accept(self) -> None:
        """Accepts the last solution of the fluid and moves the clock by its length: the end of a
        step, or of a part of it. Not in ``solve``, after which the step is accepted."""
    def grain_state(self) -> GrainState:
        """The grains as they are now, to come back to."""
    def restore_grains(self, state: GrainState) -> None:
        """Puts the grains back to a state taken before in this step. RuntimeError if grains have
        come or gone since."""
    @property
    def grains(self) -> Columns:
        """Columns of the grains, as those of a simulation."""
    @property
    def load(self) -> Columns:
        """What the fluid solver gets: volume m3, drag gamma kg/s, heat_coefficient hA W/K, (g), and
        the laws v* = velocity + mobility (drag u - volume grad p), T* = temperature + heat_mobility
        heat_coefficient T with mobility s/kg, velocity m/s (g, D), heat_mobility K/W, temperature
        K. All but volume can be written."""
    @property
    def at_grains(self) -> Columns:
        """The fluid at the grains by the last solution: velocity m/s and pressure_gradient Pa/m,
        (g, D); temperature K, (g)."""
    @property
    def gravity(self) -> _Floats:
        """Gravity, m/s2, (D)."""
    @property
    def time(self) -> float:
        """Time of the fluid, s: that at the start of the step, and of the last part that was
        accepted."""
    @property
    def steps(self) -> int:
        """Steps done before this one."""

@final
class Overlap:
    """Cuts grains by the cells of a mesh: ``points`` (n, 2), m; ``cells`` (m, 3), positively
    oriented."""

    def __new__(cls, points: ArrayLike, cells: ArrayLike) -> Overlap: ...
    def cut(
        self, position: ArrayLike, radius: ArrayLike
    ) -> tuple[_Integers, _Integers, _Floats, _Floats]:
        """Cuts grains at ``position`` (g, 2), m, of ``radius`` (g), m.

        Returns first (g + 1), cell (q), shape (q, 3), share (q): grain i owns pieces first[i] to
        first[i + 1], ``shape`` are the shape functions at the centroid of a piece, ``share`` its
        share of the grain's volume.
        """
    def voidage(self, volume: ArrayLike) -> _Floats:
        """Voidage at the nodes, (n), of the grains cut last, with their solid volumes (g), m3."""

@final
class Peer:
    """The connection of a fluid solver to its run. The run asks, the solver answers each request
    once; while it works on one, signs of life go out by themselves."""

    def __new__(
        cls, address: str, solver: str, *, wait: float = 60.0, token: str | None = None
    ) -> Peer:
        """Connects to the run at ``shm:NAME`` or ``tcp:HOST:PORT``, waiting at most ``wait``
        seconds.

        ``solver`` is the name to present oneself with, ``token`` what the run asks for; without one
        it is that of the environment, VOIDAGE_TOKEN. Raises RuntimeError if there is no such run,
        ValueError if the address is none.
        """
    @property
    def setup(self) -> str:
        """What the run tells once: properties, numerics and boundary conditions, as JSON."""
    def end_with_run(self) -> None:
        """From now on this process ends, with exit code 1, when the run is gone while a request is
        being answered."""
    def receive(self, timeout: float) -> Frame | None:
        """Waits for a request, at most ``timeout`` seconds. Other threads go on meanwhile, and
        signals are seen. Raises RuntimeError if the run is gone."""
    def send(self, solution: Solution) -> None:
        """Answers a step with a copy of its solution, or of an object with the same attributes.
        Raises ValueError if shapes or values are wrong; nothing is sent then."""
    def done(self) -> None:
        """Answers that a mesh or a state has been taken."""
    def fail(self, text: str) -> None:
        """Answers that the request cannot be fulfilled; the user will read the text."""

@final
class Frame:
    """A request as it was received. Columns of points are read-only views of where they lie in
    shared memory; a view keeps the memory. Not more than three frames can be kept at a time."""

    @property
    def kind(self) -> str:
        """``mesh``, ``state``, ``step`` or ``bye``."""
    @property
    def accepts(self) -> bool:
        """Whether the last solution is accepted, before anything else is done."""
    @property
    def step(self) -> int:
        """Number of the step; the first is 1."""
    @property
    def iteration(self) -> int:
        """How many solutions of this step went before."""
    @property
    def time(self) -> float:
        """Time of the fluid, s: that at the start of the step, and of the last part that was
        accepted."""
    @property
    def dt(self) -> float:
        """Length of the step, s."""
    @property
    def text(self) -> str:
        """Conditions of a step as JSON; empty if they are those of the last."""
    def mesh(self) -> Mesh:
        """The mesh of a request of the kind ``mesh``."""
    def fields(self) -> dict[str, Any]:
        """Copies of the accepted fields of a request of the kind ``mesh`` or ``state``: velocity
        (n, D), pressure (n) and scalars, a list of arrays (n)."""
    def points(self) -> dict[str, Any] | None:
        """The points of a step, None if the scene has none: cell, volume, drag, mobility and
        flux_mobility (q), shape (q, D + 1), velocity and flux_velocity (q, D), and scalars, a list
        of None or (coefficient, mobility, value), (q) each. Numbers of cells are copied."""
    def voidage(self) -> _Floats | None:
        """A copy of the nodal voidage of a step (n,); None without points."""
    def source(self) -> _Floats | None:
        """A copy of the nodal source of the equation of mass of a step, 1/s, (n); None where no
        solid volume comes in."""
    def motion(self) -> tuple[_Floats, _Floats] | None:
        """Copies of the places of the nodes at the end of a step and of their velocities, (n, 2)
        each; None if the mesh stands still."""

def environment(python: PathLike[str] | str, packages: PathLike[str] | str) -> None:
    """Says which interpreter this is, and in which folder it has this package: processes that are
    started from here use both."""

def main(arguments: Sequence[str]) -> int:
    """The program ``voidage`` with its arguments, the first of which is its name. Returns the exit
    code."""
