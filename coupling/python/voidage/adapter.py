"""The loop that the process of a fluid solver sits in, and the way from a run's data to a solver's.

    python -m voidage.adapter MODULE[:CLASS] --connect ADDRESS [--option KEY=VALUE ..]

makes a process for ``voidage run`` of a class with the methods of :class:`voidage.solver.Solver`.
MODULE is the name of a module or the path of a file; CLASS may be left out where the module defines
one solver. Options are arguments of the class. Under ``mpirun`` the first rank talks with the run,
and the methods are called on every rank with the same data.
"""

import argparse
import ast
import importlib
import importlib.util
import json
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import interpreter
from . import solver as data
from ._voidage import Peer
from .solver import (
    Condition,
    Fields,
    Floats,
    Motion,
    Points,
    PointScalar,
    Problem,
    Scalar,
    Solution,
    Solver,
    Sources,
    Step,
)

LAST_FRAMES = 3
"""Places of a traceback that the user of the run sees; all of them are in the log."""

Arrays = tuple[Floats, data.Integers, Mapping[str, data.Integers], data.Integers | None]
"""Points, cells, boundaries and masters of a mesh."""


# ---- from a run to a solver


def arrays(mesh) -> Arrays:
    """Those of a mesh of a run."""
    return mesh.points, mesh.cells, mesh.boundaries, mesh.masters


def conditions(described: Sequence[Mapping[str, Any]]) -> tuple[Condition, ...]:
    """Conditions as a run describes them.

    Each is ``{"boundary": .., "flow": "slip" | {"open": {..}} | .., "scalars": [..]}``.
    """
    return tuple(
        Condition(each["boundary"], _flow(each["flow"]), tuple(map(_scalar, each["scalars"])))
        for each in described
    )


def _variant(described: str | Mapping[str, Any]) -> tuple[str, Any]:
    return (described, None) if isinstance(described, str) else next(iter(described.items()))


def _flow(described: str | Mapping[str, Any]):
    kind, value = _variant(described)
    match kind:
        case "velocity" | "superficial_velocity":
            _, prescribed = _variant(value)
            make = data.Velocity if kind == "velocity" else data.SuperficialVelocity
            return make(np.array(prescribed, dtype=float))
        case "open":
            return data.Open(value["pressure"])
        case "no_slip":
            return data.NoSlip()
        case "slip":
            return data.Slip()
        case "body":
            return _body(value)
    raise ValueError(f"the flow condition `{kind}` is unknown to this version of voidage")


def _body(described: Mapping[str, Any]) -> data.Body:
    centre = np.array(described["centre"], dtype=float)
    kind, value = _variant(described["motion"])
    boils = described["evaporation"]
    motion: data.BodyMotion
    match kind:
        case "free":
            # Column by column, without brackets between the columns.
            inertia = np.reshape(value["inertia"], (len(centre), len(centre)), order="F")
            motion = data.Free(inertia.astype(float), np.array(value["force"], dtype=float))
        case "held":
            motion = data.Held(np.array(value, dtype=float))
        case _:
            raise ValueError(f"the motion `{kind}` of a body is unknown to this version of voidage")
    return data.Body(
        centre,
        described["radius"],
        described["expansion"],
        motion,
        None if boils is None else data.Evaporation(**boils),
        np.reshape(np.array(described["solid"], dtype=float), (-1, len(centre))),
        described["blowing"],
    )


def _scalar(described: str | Mapping[str, Any]):
    kind, value = _variant(described)
    match kind:
        case "value":
            _, prescribed = _variant(value)
            return data.Value(np.array(prescribed, dtype=float))
        case "transfer":
            return data.Transfer(value["coefficient"], value["outside"])
        case "insulated":
            return data.Insulated()
        case "outflow":
            return data.Outflow(value["outside"])
    raise ValueError(f"the condition `{kind}` of a scalar is unknown to this version of voidage")


def problem(setup: Mapping[str, Any], mesh: Arrays, fields: Mapping[str, Any]) -> Problem:
    """A problem from what a run tells once, its mesh and its accepted fields."""
    properties, numerics = setup["properties"], setup["numerics"]
    points, cells, boundaries, masters = mesh
    return Problem(
        points=points,
        cells=cells,
        boundaries=boundaries,
        density=properties["density"],
        viscosity=properties["viscosity"],
        gravity=np.array(properties["gravity"], dtype=float),
        fields=Fields(fields["velocity"], fields["pressure"], tuple(fields["scalars"])),
        scalars=tuple(map(_transported, setup["scalars"])),
        thin_cell_drag=properties["thin_cell_drag"],
        newton=numerics["newton"],
        tolerance=numerics["flow"]["tolerance"],
        body_force=np.array(properties["body_force"], dtype=float),
        masters=masters,
    )


def _transported(described: Mapping[str, Any]) -> Scalar:
    same = ("name", "capacity", "conductivity", "expansion", "reference", "form")
    wall = described["thin_cell"] or {"coefficient": 0.0, "value": 0.0}
    return Scalar(
        **{key: described[key] for key in same},
        wall_coefficient=wall["coefficient"],
        wall_value=wall["value"],
    )


def immersed(columns: Mapping[str, Any]) -> Points:
    """The points of a step from their columns."""
    scalars = (each and PointScalar(*each) for each in columns["scalars"])
    return Points(**{**columns, "scalars": tuple(scalars)})


class Driver:
    """Calls a solver with the data of a run."""

    def __init__(self, solver: Solver, setup: str):
        self.solver, self.setup = solver, json.loads(setup)
        self.conditions = conditions(self.setup["conditions"])
        self.mesh: Arrays | None = None

    def start(self, mesh, fields: Mapping[str, Any]) -> None:
        """Takes a mesh (or a tuple of its arrays) and the accepted fields."""
        self.mesh = mesh if isinstance(mesh, tuple) else arrays(mesh)
        if self.mesh[3] is not None and not getattr(self.solver, "periodic_sides", False):
            raise ValueError(
                f"the mesh has periodic sides, which the solver {type(self.solver).__name__} does not "
                "know: it would need to say `periodic_sides = True` and heed Problem.masters"
            )
        self.solver.set_mesh(problem(self.setup, self.mesh, fields))

    def restart(self, fields: Mapping[str, Any]) -> None:
        """Takes other accepted fields on the mesh there is."""
        self.start(self.mesh, fields)

    def solve(
        self,
        dt: float,
        described: str,
        points: Mapping[str, Any] | None,
        voidage: Floats | None,
        motion: tuple[Floats, Floats] | None,
        source: Floats | None = None,
    ) -> Solution:
        """Solves a step; ``described`` are its conditions as JSON, empty if they are the old;
        ``source`` is that of the equation of mass."""
        if described:
            self.conditions = conditions(json.loads(described))
        step = Step(
            dt,
            self.conditions,
            np.ones(len(self.mesh[0])) if voidage is None else voidage,
            None if points is None else immersed(points),
            motion=None if motion is None else Motion(*motion),
            sources=None if source is None else self._sources(source),
        )
        solution = self.solver.solve(step)
        if not isinstance(solution, Solution):
            raise TypeError(
                f"`solve` returned {type(solution).__name__}, it must return a Solution"
            )
        return solution

    def _sources(self, mass: Floats) -> Sources:
        nodes, scalars = len(mass), len(self.setup["scalars"])
        dimension = np.shape(self.mesh[0])[1]
        nothing = np.zeros(nodes)
        return Sources(np.zeros((nodes, dimension)), np.asarray(mass), (nothing,) * scalars)

    def accept(self) -> None:
        """Accepts the last solution."""
        self.solver.accept()


# ---- the loop of a process


class Ranks:
    """Calls a driver on every rank of an MPI communicator; without one, on this process."""

    def __init__(self, driver: Driver, communicator):
        self.driver, self.communicator = driver, communicator

    def call(self, name: str, *arguments):
        """Calls a method on every rank, from the first rank."""
        if self.communicator is None:
            return getattr(self.driver, name)(*arguments)
        self.communicator.bcast((name, arguments))
        return self._call(name, arguments)

    def _call(self, name: str, arguments: tuple):
        result, error = None, None
        try:
            result = getattr(self.driver, name)(*arguments)
        except Exception as raised:  # every rank must hear of it, or the others wait for ever
            error = raised
        failed = [text for text in self.communicator.allgather(error and repr(error)) if text]
        if error is not None:
            raise error
        if failed:
            raise RuntimeError(f"on another rank: {failed[0]}")
        return result

    def follow(self) -> None:
        """What the other ranks do: the calls of the first, until it says goodbye."""
        while True:
            name, arguments = self.communicator.bcast(None)
            if name == "bye":
                return
            try:
                self._call(name, arguments)
            except Exception:  # the first rank reports it
                traceback.print_exc()

    def dismiss(self) -> None:
        """Lets the other ranks go."""
        if self.communicator is not None:
            self.communicator.bcast(("bye", ()))


class Server:
    """Answers the requests of a run."""

    def __init__(self, peer: Peer, ranks: Ranks):
        self.peer, self.ranks = peer, ranks

    def run(self) -> None:
        """Answers until the run says goodbye. What the solver raises is told to the run."""
        while True:
            frame = self.peer.receive(1.0)
            if frame is None:
                continue
            if frame.kind == "bye":
                return
            try:
                if frame.accepts:
                    self.ranks.call("accept")
                solution = getattr(self, "_" + frame.kind)(frame)
                if solution is None:
                    self.peer.done()
                else:
                    self.peer.send(solution)
            except Exception as error:
                traceback.print_exc()
                self.peer.fail(_last_words(error))

    def _mesh(self, frame) -> None:
        self.ranks.call("start", arrays(frame.mesh()), frame.fields())

    def _state(self, frame) -> None:
        self.ranks.call("restart", frame.fields())

    def _step(self, frame) -> Solution:
        step = (frame.dt, frame.text, frame.points(), frame.voidage(), frame.motion(), frame.source())
        return self.ranks.call("solve", *step)


def _last_words(error: Exception) -> str:
    """What was raised, and the last places of the solver that it came through."""
    places = [
        f"    {frame.filename}:{frame.lineno} in {frame.name}: {frame.line}"
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename != __file__
    ]
    what = "".join(traceback.format_exception_only(error)).strip()
    return "\n".join([what, *places[-LAST_FRAMES:]])


def _communicator():
    """That of mpirun, if there is more than one rank."""
    ranks = [os.environ.get(name) for name in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")]
    if all(count in (None, "1") for count in ranks):
        return None
    from mpi4py import MPI

    return MPI.COMM_WORLD


def serve(
    make: Callable[[], Solver],
    address: str,
    wait: float = 60.0,
    alone: bool = False,
    token: str | None = None,
    ranks: int | None = None,
) -> None:
    """Serves the run at an address with a solver, until the run says goodbye.

    ``make`` makes the solver; ``wait`` is how long the run may take to be there, s; ``token`` is
    what the run asks for (without one that of the environment, VOIDAGE_TOKEN). Raises RuntimeError
    if the run is gone. If this process is there for the solver ``alone``, it ends when the run is
    gone in the middle of a step. ``ranks`` is how many processes share the solver, if that is known.
    """
    solver, communicator = make(), _communicator()
    size = 1 if communicator is None else communicator.size
    if ranks not in (None, size):
        raise RuntimeError(
            f"{ranks} ranks were asked for, and MPI knows of {size}: the mpirun that started them is of another "
            f"MPI than the mpi4py of {sys.executable}\n  help: put the mpirun of that MPI beside this Python, or first on PATH"
        )
    first = communicator is None or communicator.rank == 0
    peer = setup = None
    try:
        if first:
            peer = Peer(address, type(solver).__name__, wait=wait, token=token)
            setup = peer.setup
    finally:
        # Other ranks wait for this, also where there is no run and the first rank says so.
        if communicator is not None:
            setup = communicator.bcast(setup)
    if setup is None:
        return
    if peer is not None and alone:
        peer.end_with_run()
    ranks = Ranks(Driver(solver, setup), communicator)
    if not first:
        ranks.follow()
        return
    try:
        Server(peer, ranks).run()
    finally:
        ranks.dismiss()


# ---- the command line


def find(name: str) -> type:
    """The class ``MODULE[:CLASS]`` or ``FILE.py[:CLASS]``; without CLASS the only one there."""
    place, _, wanted = name.partition(":")
    if place.endswith(".py"):
        spec = importlib.util.spec_from_file_location(Path(place).stem, place)
        module = importlib.util.module_from_spec(spec)
        sys.modules[module.__name__] = module
        spec.loader.exec_module(module)
    else:
        module = importlib.import_module(place)
    if wanted:
        return getattr(module, wanted)
    found = [
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and value.__module__ == module.__name__
        and callable(getattr(value, "solve", None))
    ]
    if len(found) != 1:
        names = ", ".join(each.__name__ for each in found) or "none"
        raise ValueError(
            f"{place} must define one class with a method `solve`; there are {names}\n"
            f"  help: give {place}:CLASS"
        )
    return found[0]


def add_or_python(parser: argparse.ArgumentParser) -> None:
    """Adds the option that :func:`find_or_go_on` reads."""
    parser.add_argument(
        "--or-python",
        metavar="PYTHON",
        help="the interpreter that goes on where this one lacks FEniCSx and MODULE needs it",
    )


def find_or_go_on(given: argparse.Namespace, words: list[str], module: str) -> type:
    """The class of the command line; where FEniCSx is missing here and the class needs it, the other
    interpreter runs ``module`` with the same words instead."""
    try:
        return find(given.solver)
    except ModuleNotFoundError as error:
        if interpreter.lacks_fenicsx(error) and given.or_python and interpreter.has_fenicsx(given.or_python):
            # It has none to go on to in its turn.
            interpreter.take_over(given.or_python, module, [*words, "--or-python", ""])
        interpreter.explain(error)
        raise


def _option(text: str) -> tuple[str, Any]:
    key, sign, value = text.partition("=")
    if not (sign and key.isidentifier()):
        raise argparse.ArgumentTypeError(f"`{text}` is no KEY=VALUE")
    try:
        return key, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return key, value


def main(solver: type | None = None, arguments: Sequence[str] | None = None) -> int:
    """The command line of a solver process: of the given class, or of one that it names."""
    parser = argparse.ArgumentParser(
        description="Serve a run of voidage with a fluid solver in Python."
    )
    if solver is None:
        parser.add_argument(
            "solver", metavar="MODULE[:CLASS]", help="a module, or the path of a Python file"
        )
    parser.add_argument(
        "--connect", required=True, metavar="ADDRESS", help="shm:NAME or tcp:HOST:PORT"
    )
    parser.add_argument(
        "--wait",
        type=float,
        default=60.0,
        metavar="S",
        help="how long the run may take to be there",
    )
    parser.add_argument(
        "--token",
        metavar="WORD",
        help="what the run asks for, where it has a --token; default: VOIDAGE_TOKEN",
    )
    parser.add_argument(
        "--option",
        type=_option,
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="an argument of the class",
    )
    parser.add_argument(
        "--ranks",
        type=int,
        metavar="N",
        help="how many processes mpirun was to start; it is an error if MPI knows of another number",
    )
    if solver is None:
        add_or_python(parser)
    words = list(sys.argv[1:] if arguments is None else arguments)
    given = parser.parse_args(words)
    try:
        made = solver or find_or_go_on(given, words, "voidage.adapter")
        serve(
            lambda: made(**dict(given.option)),
            given.connect,
            given.wait,
            alone=True,
            token=given.token,
            ranks=given.ranks,
        )
    except RuntimeError as error:
        print(f"voidage.adapter: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
