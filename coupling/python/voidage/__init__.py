"""Grains in a finite element fluid.

``Simulation`` runs a scene; a fluid solver or a coupling scheme written in Python can be plugged
into it. A solver is one class with the three methods of :class:`Solver`;
``python -m voidage.adapter MODULE:CLASS --connect ADDRESS`` makes it a process that ``voidage run``
exchanges with. All quantities are in SI units, in the plane per metre of depth.
"""

import sys
from pathlib import Path

try:
    from ._voidage import (
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
    from ._voidage import environment as _environment
except ImportError as error:
    help = "help: `pip install ./coupling/python` or tests/python-setup builds and installs the package"
    raise ImportError(f"{error}\n  {help}") from error
from .solver import (
    Balance,
    BodyAnswer,
    Fields,
    Motion,
    Points,
    PointScalar,
    Problem,
    Report,
    Scalar,
    Solution,
    Solver,
    Step,
)

if sys.executable:
    _environment(sys.executable, str(Path(__file__).parents[1]))

__all__ = [
    "Balance",
    "BodyAnswer",
    "Columns",
    "Fields",
    "Frame",
    "GrainState",
    "Mesh",
    "Motion",
    "Overlap",
    "Peer",
    "PointScalar",
    "Points",
    "Problem",
    "Report",
    "Scalar",
    "Simulation",
    "Solution",
    "Solver",
    "Step",
    "System",
    "__version__",
]
