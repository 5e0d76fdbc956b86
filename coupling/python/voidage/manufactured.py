"""A manufactured solution for any fluid solver in Python: errors, orders, and what they cost.

``python -m voidage.manufactured SOLVER --squares N`` solves steady flow with heat through a still
field of voidage on a mesh of N x N squares and prints, as JSON, the relative errors and the time
that the solver took. SOLVER is a module or a file, as for ``voidage.adapter``. ``voidage study``
runs it for the solvers that are not in Rust; sources, meshes and errors are derived here again, so
that nothing is shared with the one in Rust but the method.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from time import perf_counter, process_time

import numpy as np

from .cells import Cells
from .solver import (
    Condition,
    Fields,
    Heat,
    Problem,
    Report,
    Solver,
    Sources,
    Step,
    Temperature,
    Velocity,
)

STEPS = 5
"""Long ones: the last is steady."""


def manufactured(points):
    """Voidage and fields (C1-2D of Lethe, unit properties), and the sources that keep them.

    Where div u = 0: div(eps (grad u + grad u^T)) = eps lap u + (grad u + grad u^T) grad eps.
    """
    pi = np.pi
    x, y = pi * points.T
    sx, cx, sy, cy, s2x, c2x, s2y, c2y = (
        f(k * z) for k in (1, 2) for z in (x, y) for f in (np.sin, np.cos)
    )
    eps, slope = 0.5 + sx * sy / 4, pi / 4 * np.stack((cx * sy, sx * cy))
    u = np.stack((-(sx**2) * s2y, s2x * sy**2))
    grad_u = pi * np.array([[-s2x * s2y, -2 * sx**2 * c2y], [2 * c2x * sy**2, s2x * s2y]])
    laplace = 2 * pi**2 * np.stack((s2y * (2 * sx**2 - c2x), s2x * (c2y - 2 * sy**2)))
    strain = grad_u + grad_u.swapaxes(0, 1)
    grad_p = pi * np.stack((cx * sy, sx * cy))
    force = eps * np.einsum("ijn,jn->in", grad_u, u) + grad_p - eps * laplace
    force -= np.einsum("ijn,jn->in", strain, slope)
    T, grad_T = cx * cy, -pi * np.stack((sx * cy, cx * sy))
    heat = eps * np.sum(u * grad_T, axis=0) - np.sum(slope * grad_T, axis=0) + 2 * pi**2 * eps * T
    return eps, Fields(u.T, sx * sy, T), Sources(force.T, np.sum(slope * u, axis=0), heat)


def exact(x):
    """Velocity, pressure and temperature with their gradients at points, (.., 2): components."""
    pi = np.pi
    (sx, sy), (cx, cy) = (f(pi * np.moveaxis(x, -1, 0)) for f in (np.sin, np.cos))
    u = [
        (-2 * sx**2 * cy * sy, (-4 * pi * sx * cx * cy * sy, -2 * pi * sx**2 * (cy**2 - sy**2))),
        (2 * cx * sx * sy**2, (2 * pi * (cx**2 - sx**2) * sy**2, 4 * pi * cx * sx * sy * cy)),
    ]
    p = [(sx * sy, (pi * cx * sy, pi * sx * cy))]
    T = [(cx * cy, (-pi * sx * cy, -pi * cx * sy))]
    return u, p, T


def squares(n: int):
    """n x n squares on [-1, 1]^2, cut by diagonals that rise and fall in turn, as the program's;
    its sides are x0, x1, y0 and y1, oriented so that the outside is on the right."""
    axis = np.linspace(-1.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    cells = []
    for j in range(n):
        for i in range(n):
            a = j * (n + 1) + i
            b, c, d = a + 1, a + n + 2, a + n + 1
            cells += [(a, b, c), (a, c, d)] if (i + j) % 2 == 0 else [(a, b, d), (b, c, d)]
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    lines = {"x0": node[::-1, 0], "x1": node[:, -1], "y0": node[0], "y1": node[-1, ::-1]}
    sides = {name: np.stack((line[:-1], line[1:]), axis=1) for name, line in lines.items()}
    return points, np.array(cells), sides


def errors(points, cells, nodal, known):
    """L2 and H1 errors of components by the rule of seven points (degree 5)."""
    root = np.sqrt(15)
    near, far = (6 - root) / 21, (6 + root) / 21
    rule = [((1 / 3,) * 3, 9 / 40)]
    for a, weight in ((near, (155 - root) / 1200), (far, (155 + root) / 1200)):
        rule += [(tuple(np.roll((1 - 2 * a, a, a), k)), weight) for k in range(3)]
    mesh, square = Cells(points, cells), np.zeros(2)
    for shape, weight in rule:
        x = np.tensordot(points[cells], shape, axes=(1, 0))
        for values, (value, slope) in zip(nodal, known(x), strict=True):
            off = values[cells] @ shape - value
            tilt = np.einsum("ea,eai->ei", values[cells], mesh.gradient) - np.stack(slope, axis=1)
            square += weight * np.array([mesh.measure @ off**2, mesh.measure @ (tilt**2).sum(1)])
    return np.sqrt(square)


def off(points, cells, fields: Fields) -> dict[str, float]:
    """Errors of nodal fields by name."""
    nodal = fields.velocity.T, [fields.pressure], [fields.temperature]
    names = (("u", "grad u"), ("p", "grad p"), ("T", "grad T"))
    found = {}
    for k, (pair, values) in enumerate(zip(names, nodal, strict=True)):
        both = errors(points, cells, values, lambda x, k=k: exact(x)[k])
        found |= dict(zip(pair, both.tolist(), strict=True))
    return found


def solve(solver: Solver, n: int) -> tuple[Fields, dict[str, float]]:
    """The fields of five long steps of two Newton steps each, and seconds by phase."""
    points, cells, boundaries = squares(n)
    eps, start, sources = manufactured(points)
    problem = Problem(
        points,
        cells,
        boundaries,
        density=1.0,
        viscosity=1.0,
        gravity=np.zeros(2),
        fields=start,
        heat=Heat(1.0, 1.0, 0.0, 0.0, lumped=False),
        newton=2,
        tolerance=1e-12,
    )
    conditions = [
        Condition(name, Velocity(start.velocity), Temperature(start.temperature))
        for name in boundaries
    ]
    begun, cpu = perf_counter(), process_time()
    solver.set_mesh(problem)
    spent = {"mesh": perf_counter() - begun, "flow": 0.0, "energy": 0.0}
    for _ in range(STEPS):
        report: Report = solver.solve(Step(1e3, conditions, eps, sources=sources))[1]
        solver.accept()
        spent["flow"] += report.flow_s
        spent["energy"] += report.heat_s
    spent["all"], spent["cpu"] = perf_counter() - begun, process_time() - cpu
    return solver.fields(), spent


def measured(solver: Solver, n: int) -> dict:
    """Relative errors and times, as ``voidage study`` reads them."""
    begun = perf_counter()
    # What is loaded or compiled at the first step of a process is loaded here.
    solve(solver, 2)
    setup = perf_counter() - begun
    fields, spent = solve(solver, n)
    points, cells, _ = squares(n)
    zero = np.zeros(len(points))
    sizes = off(points, cells, Fields(np.zeros_like(points), zero, zero))
    found = off(points, cells, fields)
    steps_s, steps_cpu_s = spent.pop("all"), spent.pop("cpu")
    return {
        "errors": {name: found[name] / sizes[name] for name in found},
        "setup_s": setup,
        "steps_s": steps_s,
        "steps_cpu_s": steps_cpu_s,
        "phases": spent,
        "steps": STEPS,
        "fluid_solves": STEPS,
        "unconverged_steps": 0,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    from .adapter import find

    parser = argparse.ArgumentParser(description="Errors and cost of a solver on a known solution.")
    parser.add_argument("solver", metavar="MODULE[:CLASS]", help="a module, or a Python file")
    parser.add_argument("--squares", type=int, default=16, help="squares along each side")
    given = parser.parse_args(arguments)
    json.dump(measured(find(given.solver)(), given.squares), sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
