"""Grains in a finite element fluid.

``Simulation`` runs a scene; a fluid solver or a coupling scheme written in Python can be plugged into it. A solver is
one class with the four methods of :class:`voidage.solver.Solver`; ``python -m voidage.adapter MODULE:CLASS --connect
ADDRESS`` makes it a process that ``voidage run`` exchanges with. All quantities are in SI units, in the plane per metre
of depth.
"""

from ._voidage import Columns, GrainState, Mesh, Overlap, Simulation, System, __version__

__all__ = ["Columns", "GrainState", "Mesh", "Overlap", "Simulation", "System", "__version__"]
