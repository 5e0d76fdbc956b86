"""Grains in a finite element fluid.

``Simulation`` runs a scene; a fluid solver or a coupling scheme written in Python can be plugged
into it. A solver is one class with the four methods of :class:`Solver`; ``python -m voidage.adapter
MODULE:CLASS --connect ADDRESS`` makes it a process that ``voidage run`` exchanges with. All
quantities are in SI units, in the plane per metre of depth.
"""

try:
    from ._voidage import (
        Answer,
        Columns,
        Frame,
        GrainState,
        Mesh,
        Overlap,
        Peer,
        Simulation,
        System,
        __version__,
    )
except ImportError as error:
    help = "help: tests/python-setup builds and installs the package"
    raise ImportError(f"{error}\n  {help}") from error
from .solver import AtGrains, Fields, Motion, Pieces, Problem, Report, Solver, Step

__all__ = [
    "Answer",
    "AtGrains",
    "Columns",
    "Fields",
    "Frame",
    "GrainState",
    "Mesh",
    "Motion",
    "Overlap",
    "Peer",
    "Pieces",
    "Problem",
    "Report",
    "Simulation",
    "Solver",
    "Step",
    "System",
    "__version__",
]
