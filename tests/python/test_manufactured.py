"""One manufactured solution on every solver that is installed: the same errors as the Rust solver.

The sources are worked out by hand here and by automatic differentiation in the Rust program, the
errors are computed twice, and the meshes are made twice: nothing is shared but the method.
"""

import csv
import subprocess

import numpy as np
import pytest
from conftest import sides
from voidage.cells import Cells
from voidage.solver import (
    Condition,
    Fields,
    Heat,
    Problem,
    Sources,
    Step,
    Temperature,
    Velocity,
)


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
    """Velocity, pressure and temperature with their gradients at points, (.., 2): lists of components."""
    pi = np.pi
    (sx, sy), (cx, cy) = (f(pi * np.moveaxis(x, -1, 0)) for f in (np.sin, np.cos))
    u = [
        (-2 * sx**2 * cy * sy, (-4 * pi * sx * cx * cy * sy, -2 * pi * sx**2 * (cy**2 - sy**2))),
        (2 * cx * sx * sy**2, (2 * pi * (cx**2 - sx**2) * sy**2, 4 * pi * cx * sx * sy * cy)),
    ]
    p = [(sx * sy, (pi * cx * sy, pi * sx * cy))]
    T = [(cx * cy, (-pi * sx * cy, -pi * cx * sy))]
    return u, p, T


def squares(n):
    """n x n squares on [-1, 1]^2, cut by diagonals that rise and fall in turn, as the program's."""
    axis = np.linspace(-1.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    cells = []
    for j in range(n):
        for i in range(n):
            a = j * (n + 1) + i
            b, c, d = a + 1, a + n + 2, a + n + 1
            cells += [(a, b, c), (a, c, d)] if (i + j) % 2 == 0 else [(a, b, d), (b, c, d)]
    cells = np.array(cells)
    return points, cells, sides(points, cells, -1.0, 1.0)


def errors(points, cells, nodal, known):
    """L2 and H1 errors by the rule of seven points (degree 5)."""
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


@pytest.fixture(scope="module")
def of_the_program(program, tmp_path_factory):
    """Errors of the Rust solver by their name and the number of squares."""
    out = tmp_path_factory.mktemp("verification")
    options = ["verify", "--quick", "--quiet", "--only", "manufactured-space", "--out", out]
    subprocess.run([program, *options], check=True, capture_output=True)
    with open(out / "curves.csv", newline="") as file:
        rows = [row for row in csv.DictReader(file) if "still" in row["panel"]]
    return {(row["curve"], round(2 / float(row["x"]))): float(row["y"]) for row in rows}


def solve(solver, n):
    """Errors by name after five long steps of two Newton steps each: steady."""
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
    solver.set_mesh(problem)
    for _ in range(5):
        solver.solve(Step(1e3, conditions, eps, sources=sources))
        solver.accept()
    found = solver.fields()
    fields = found.velocity.T, [found.pressure], [found.temperature]
    names = (("u in L2", "u in H1"), ("p in L2", None), ("T in L2", "T in H1"))
    result = {}
    for k, (pair, nodal) in enumerate(zip(names, fields, strict=True)):
        both = errors(points, cells, nodal, lambda x, k=k: exact(x)[k])
        result |= {name: off for name, off in zip(pair, both, strict=True) if name}
    return result


def test_errors_equal_those_of_the_rust_solver_and_fall_at_their_orders(solver, of_the_program):
    found = {n: solve(solver, n) for n in (16, 32, 64)}
    for n, by_name in found.items():
        for name, off in by_name.items():
            assert off == pytest.approx(of_the_program[name, n], rel=1e-9), (name, n)
    orders = {name: np.log2(found[32][name] / found[64][name]) for name in found[64]}
    # The pressure tends to 1.5 from below: at the walls its stabilisation lacks second derivatives.
    least = {"u in L2": 1.9, "u in H1": 0.95, "p in L2": 1.3, "T in L2": 1.9, "T in H1": 0.95}
    assert all(orders[name] > least[name] for name in least), orders
