"""A manufactured solution for any fluid solver in Python: errors, orders, and what they cost.

``python -m voidage.manufactured SOLVER --squares N`` solves steady flow with a temperature through
a still field of voidage on a mesh of N x N squares and prints, as JSON, the relative errors and the
time that the solver took. SOLVER is a module or a file, as for ``voidage.adapter``.
``voidage study`` runs it for the solvers that are not in Rust; sources, meshes and errors are
derived here again, so that nothing is shared with the one in Rust but the method.
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
    Problem,
    Scalar,
    Solver,
    Sources,
    Step,
    Value,
    Velocity,
)

FIELDS = {"still": (1e3, 5), "sliding": (1e3, 5), "moving": (0.1, 8)}
"""Time step and steps of each set of fields. Where the voidage is still they are long, and the last
is steady; in one that moves, flow and heat stand, and what is off is off in space. In a fourth set,
``unsteady``, they change too."""

PHASES = {"u": 1.2, "p": 1.8, "T": 1.5}
"""Of the factors 1 + sin(3 t - phase)/2 of the unsteady fields."""


def voidage(x, name: str, t: float):
    """Voidage at points, (.., 2), and its gradient, (2, ..)."""
    pi = np.pi
    if name in ("moving", "unsteady"):
        across, up = pi * x[..., 0] - 2 * t, pi * x[..., 1] + 0.5
        slope = np.cos(across) * np.cos(up), -np.sin(across) * np.sin(up)
        return 0.5 + np.sin(across) * np.cos(up) / 4, pi / 4 * np.stack(slope)
    (sx, sy), (cx, cy) = (f(pi * np.moveaxis(x, -1, 0)) for f in (np.sin, np.cos))
    slope = pi * np.stack((cx * sy, sx * cy))
    if name == "sliding":
        eps = np.exp(-sx * sy - 1)
        return eps, -eps * slope
    return 0.5 + sx * sy / 4, slope / 4


def exact(x, name: str, t: float = 0.0):
    """Velocity, pressure and temperature with their gradients at points, (.., 2): components."""
    pi = np.pi
    (sx, sy), (cx, cy) = (f(pi * np.moveaxis(x, -1, 0)) for f in (np.sin, np.cos))
    T = [(cx * cy, (-pi * sx * cy, -pi * cx * sy))]
    if name == "sliding":
        u = [
            (sx * cy, (pi * cx * cy, -pi * sx * sy)),
            (-cx * sy, (pi * sx * sy, -pi * cx * cy)),
        ]
        return u, [(sx * sy / 2 + 0.5, (pi / 2 * cx * sy, pi / 2 * sx * cy))], T
    u = [
        (-2 * sx**2 * cy * sy, (-4 * pi * sx * cx * cy * sy, -2 * pi * sx**2 * (cy**2 - sy**2))),
        (2 * cx * sx * sy**2, (2 * pi * (cx**2 - sx**2) * sy**2, 4 * pi * cx * sx * sy * cy)),
    ]
    fields = {"u": u, "p": [(sx * sy, (pi * cx * sy, pi * sx * cy))], "T": T}
    if name == "unsteady":
        for key, phase in PHASES.items():
            rate = 1 + np.sin(3 * t - phase) / 2
            fields[key] = [(rate * z, tuple(rate * part for part in dz)) for z, dz in fields[key]]
    return fields["u"], fields["p"], fields["T"]


def manufactured(points, name: str, t: float):
    """Voidage and fields (C1-2D of Lethe, unit properties, or a flow that slides along the walls)
    and the sources that keep them.

    Where div u = 0: div(eps (grad u + grad u^T)) = eps lap u + (grad u + grad u^T) grad eps.
    """
    pi = np.pi
    components, [(p, grad_p)], [(T, grad_T)] = exact(points, name, t)
    u = np.stack([value for value, _ in components])
    grad_u = np.array([slope for _, slope in components])
    eps, slope = voidage(points, name, t)
    if name == "sliding":
        laplace = -2 * pi**2 * u
    else:
        (sx, sy), (s2x, s2y), (c2x, c2y) = (
            f(k * pi * points.T) for f, k in ((np.sin, 1), (np.sin, 2), (np.cos, 2))
        )
        laplace = 2 * pi**2 * np.stack((s2y * (2 * sx**2 - c2x), s2x * (c2y - 2 * sy**2)))
    growth = dict.fromkeys(PHASES, 0.0)
    if name == "unsteady":
        laplace *= 1 + np.sin(3 * t - PHASES["u"]) / 2
        for key, phase in PHASES.items():
            growth[key] = 1.5 * np.cos(3 * t - phase) / (1 + np.sin(3 * t - phase) / 2)
    force = eps * (np.einsum("ijn,jn->in", grad_u, u) + growth["u"] * u - laplace) + grad_p
    force -= np.einsum("ijn,jn->in", grad_u + grad_u.swapaxes(0, 1), slope)
    heat = eps * (np.sum(u * grad_T, axis=0) + (growth["T"] + 2 * pi**2) * T)
    heat -= np.sum(slope * grad_T, axis=0)
    return eps, Fields(u.T, p, (T,)), Sources(force.T, np.sum(slope * u, axis=0), (heat,))


def squares(n: int, turning: bool = True):
    """n x n squares on [-1, 1]^2, cut by diagonals that rise, or rise and fall in turn, as the
    program's; its sides are x0, x1, y0 and y1, oriented so that the outside is on the right."""
    axis = np.linspace(-1.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    cells = []
    for j in range(n):
        for i in range(n):
            a = j * (n + 1) + i
            b, c, d = a + 1, a + n + 2, a + n + 1
            falls = turning and (i + j) % 2 == 1
            cells += [(a, b, d), (b, c, d)] if falls else [(a, b, c), (a, c, d)]
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


def off(points, cells, fields: Fields, fields_of: str = "still") -> dict[str, float]:
    """Errors of nodal fields by name; the pressure is moved to the mean of the exact one."""
    volume, known = Cells(points, cells).nodal_volume, exact(points, fields_of)[1][0][0]
    pressure = fields.pressure - volume @ (fields.pressure - known) / volume.sum()
    nodal = fields.velocity.T, [pressure], fields.scalars
    names = (("u", "grad u"), ("p", "grad p"), ("T", "grad T"))
    found = {}
    for k, (pair, values) in enumerate(zip(names, nodal, strict=True)):
        both = errors(points, cells, values, lambda x, k=k: exact(x, fields_of)[k])
        found |= dict(zip(pair, both.tolist(), strict=True))
    return found


def solve(
    solver: Solver,
    n: int,
    name: str = "still",
    steps: tuple[float, int] | None = None,
    turning: bool = True,
) -> tuple[Fields, dict[str, float]]:
    """The fields of the last of time steps (their length and number, or those of ``FIELDS``), each
    of two Newton steps, and seconds by phase."""
    points, cells, boundaries = squares(n, turning)
    dt, count = steps or FIELDS[name]
    eps, start, _ = manufactured(points, name, 0.0)
    # In short steps iterations end at 3e-12 of the right-hand side.
    problem = Problem(
        points,
        cells,
        boundaries,
        density=1.0,
        viscosity=1.0,
        gravity=np.zeros(2),
        fields=start,
        scalars=(Scalar("temperature", capacity=1.0, conductivity=1.0),),
        newton=2,
        tolerance=1e-11 if name == "unsteady" else 1e-12,
    )
    begun, cpu = perf_counter(), process_time()
    solver.set_mesh(problem)
    spent = {"mesh": perf_counter() - begun, "flow": 0.0, "energy": 0.0}
    for step in range(count):
        eps, known, sources = manufactured(points, name, (step + 1) * dt)
        held = Velocity(known.velocity), tuple(map(Value, known.scalars))
        conditions = [Condition(side, *held) for side in boundaries]
        solution = solver.solve(Step(dt, conditions, eps, sources=sources))
        solver.accept()
        spent["flow"] += solution.report.flow_s
        spent["energy"] += solution.report.scalars_s
    spent["all"], spent["cpu"] = perf_counter() - begun, process_time() - cpu
    return solution.fields, spent


def measured(solver: Solver, n: int) -> dict:
    """Relative errors and times, as ``voidage study`` reads them."""
    begun = perf_counter()
    # What is loaded or compiled at the first step of a process is loaded here.
    solve(solver, 2)
    setup = perf_counter() - begun
    fields, spent = solve(solver, n)
    points, cells, _ = squares(n)
    zero = np.zeros(len(points))
    sizes = off(points, cells, Fields(np.zeros_like(points), zero, (zero,)))
    found = off(points, cells, fields)
    steps = FIELDS["still"][1]
    steps_s, steps_cpu_s = spent.pop("all"), spent.pop("cpu")
    return {
        "errors": {name: found[name] / sizes[name] for name in found},
        "setup_s": setup,
        "steps_s": steps_s,
        "steps_cpu_s": steps_cpu_s,
        "phases": spent,
        "steps": steps,
        "fluid_solves": steps,
        "unconverged_steps": 0,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    from .adapter import add_or_python, find_or_go_on

    parser = argparse.ArgumentParser(description="Errors and cost of a solver on a known solution.")
    parser.add_argument("solver", metavar="MODULE[:CLASS]", help="a module, or a Python file")
    parser.add_argument("--squares", type=int, default=16, help="squares along each side")
    add_or_python(parser)
    words = list(sys.argv[1:] if arguments is None else arguments)
    given = parser.parse_args(words)
    solver = find_or_go_on(given, words, "voidage.manufactured")
    json.dump(measured(solver(), given.squares), sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
