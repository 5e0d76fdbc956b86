"""Manufactured solutions in three voidage fields, one moving, on every solver that is installed: their
errors are those of the Rust solver.

The sources are worked out by hand here and by automatic differentiation in the Rust program, the
errors are computed twice, and the meshes are made twice: nothing is shared but the method.
"""

import csv
import json
import subprocess

import numpy as np
import pytest
from voidage.manufactured import FIELDS, main, off, solve, squares


@pytest.fixture(scope="module")
def of_the_program(program, tmp_path_factory):
    """Errors of the Rust solver by fields, their name and the squares, or steps, in two units."""
    out = tmp_path_factory.mktemp("verification")
    cases = [f"manufactured-{name}" for name in ("space", "meshes", "time")]
    cases = [word for case in cases for word in ("--only", case)]
    options = ["verify", "--quick", "--quiet", *cases, "--out", out]
    subprocess.run([program, *options], check=True, capture_output=True)
    with open(out / "curves.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    found = {}
    for row in rows:
        name = row["panel"].removeprefix("Manufactured, ").removesuffix(" voidage")
        found[name, row["curve"], round(2 / float(row["x"]))] = float(row["y"])
    return found


@pytest.mark.parametrize("fields", FIELDS)
def test_errors_equal_those_of_the_rust_solver_and_fall_at_their_orders(
    solver, of_the_program, fields
):
    found = {n: off(*squares(n)[:2], solve(solver, n, fields)[0], fields) for n in (16, 32, 64)}
    names = {"u": "u in L2", "grad u": "u in H1", "p": "p in L2"}
    names |= {"T": "T in L2", "grad T": "T in H1"}
    for n, by_name in found.items():
        for name, of_rust in names.items():
            known = of_the_program[fields, of_rust, n]
            assert by_name[name] == pytest.approx(known, rel=1e-9), (name, n)
    orders = {name: np.log2(found[32][name] / found[64][name]) for name in found[64]}
    # The pressure tends to 1.5 from below: at the walls its stabilisation lacks second derivatives,
    # which are those of nothing where the flow slides.
    least = {"u": 1.9, "grad u": 0.95, "p": 1.3, "T": 1.9, "grad T": 0.95}
    if fields == "sliding":
        least["p"] = 1.9
    assert all(orders[name] > least[name] for name in least), orders


@pytest.mark.parametrize("fields", FIELDS)
def test_pressures_on_parallel_diagonals_equal_those_of_the_rust_solver(
    solver, of_the_program, fields
):
    for n in (16, 32):
        points, cells, _ = squares(n, turning=False)
        found = off(points, cells, solve(solver, n, fields, turning=False)[0], fields)
        known = of_the_program["Pressure, parallel diagonals", fields, n]
        assert found["p"] == pytest.approx(known, rel=1e-9), n


def test_a_shorter_time_step_changes_fields_as_in_the_rust_solver(solver, of_the_program):
    """Steps of half the length again, and the order, are those of the Rust solver alone: this is the dearest test."""
    ends = [solve(solver, 64, "unsteady", (1 / count, count))[0] for count in (20, 40)]
    fields = [(end.velocity, end.pressure[:, None], end.scalars[0][:, None]) for end in ends]
    for name, long, short in zip("upT", *fields, strict=True):
        apart = np.sqrt(np.mean(np.sum((long - short) ** 2, axis=1)))
        known = of_the_program["unsteady, one mesh", name, 40]
        assert apart == pytest.approx(known, rel=1e-8), name


def test_the_command_line_gives_relative_errors_and_times(capsys):
    pytest.importorskip("skfem")
    assert main(["voidage.scikit_fem", "--squares", "16"]) == 0
    found = json.loads(capsys.readouterr().out)
    # The norms of the exact fields: sqrt(3/2), 1 and 1 in L2.
    points, cells, _ = squares(16)
    from voidage.scikit_fem import ScikitFem

    own = off(points, cells, solve(ScikitFem(), 16)[0])
    for name, size in {"u": np.sqrt(1.5), "p": 1.0, "T": 1.0}.items():
        assert found["errors"][name] == pytest.approx(own[name] / size, rel=1e-4), name
    assert found["steps"] == 5
    assert 0 < sum(found["phases"].values()) <= found["steps_s"]
