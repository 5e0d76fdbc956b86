"""FEniCSx under mpirun: the solution does not depend on the number of ranks."""

import dataclasses
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from voidage.solver import (
    Body,
    Condition,
    Evaporation,
    Fields,
    Free,
    NoSlip,
    Open,
    Scalar,
    Step,
    Value,
    Velocity,
)

from conftest import problem, scatter, with_holes

OPEN_MPI = (
    "OMPI_ALLOW_RUN_AS_ROOT",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM",
    "OMPI_MCA_rmaps_base_oversubscribe",
)
"""Of Open MPI: as root, and with more ranks than there are cores. Others do not know them."""


def solve() -> tuple[np.ndarray, np.ndarray]:
    """Fields after one step and what passes the boundary, all points in a corner of a box with a
    body in it."""
    from voidage.fenicsx import FEniCSx

    box, rng = problem(6, 2, gravity=np.array([0.0, -9.81])), np.random.default_rng(3)
    middle = np.array([0.75, 0.75])
    box = with_holes(box, 1 / 6, body=middle)
    warm = Fields(box.fields.velocity, box.fields.pressure, (np.full(len(box.points), 300.0),))
    scalar = Scalar("temperature", 1.5, 0.1, 0.003, 295.0)
    box = dataclasses.replace(box, fields=warm, scalars=(scalar,))
    points, voidage = scatter(rng, box.points, box.cells, within=10, scalars=1)
    conditions = [Condition(name, NoSlip(), (Value(310.0),)) for name in box.boundaries]
    conditions[0] = Condition("x0", Velocity(np.array([0.1, 0.0])))
    conditions[3] = Condition("y1", Open(0.0))
    free, boils = Free(0.3 * np.eye(2), np.array([0.02, 0.05])), Evaporation(0, 0.1, 40.0)
    body = Body(middle, 0.1, 0.05, free, boils, np.zeros((0, 2)))
    conditions[-1] = Condition("body", body, (Value(320.0),))
    solver = FEniCSx()
    solver.set_mesh(box)
    solution = solver.solve(Step(0.1, conditions, voidage, points))
    fields = solution.fields
    passing = [(*each.force, each.flux, *each.scalars) for each in solution.balances.values()]
    nodal = np.column_stack((fields.velocity, fields.pressure, fields.scalars[0] - 300))
    return nodal, np.array(passing)


def on_two_ranks(*arguments: object, **options) -> subprocess.CompletedProcess:
    """Runs Python with these arguments on two ranks, with the MPI of this interpreter."""
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    mpirun = shutil.which("mpirun", path=path)
    if mpirun is None:
        pytest.skip("there is no mpirun")
    command = [mpirun, "-n", "2", sys.executable, *arguments]
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_"))}
    env |= {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    env |= dict.fromkeys(OPEN_MPI, "1")
    return subprocess.run(command, timeout=120, env=env, **options)


def test_all_ranks_end_where_there_is_no_run():
    pytest.importorskip("mpi4py")
    arguments = ["-m", "voidage.adapter", "voidage.dummy:Dummy", "--connect", "tcp:127.0.0.1:1"]
    ended = on_two_ranks(*arguments, "--wait", "0.5", capture_output=True, text=True)
    assert ended.returncode != 0
    assert "voidage.adapter: " in ended.stderr


def test_two_ranks_find_what_one_finds(tmp_path):
    pytest.importorskip("dolfinx")
    on_two_ranks(__file__, tmp_path, check=True)
    one = solve()
    for rank in range(2):
        two = np.load(tmp_path / f"{rank}.npz")
        for name, known in zip(two.files, one, strict=True):
            apart, size = (np.abs(each).max(axis=0) for each in (two[name] - known, known))
            assert (apart < 1e-9 * size).all(), name


if __name__ == "__main__":
    from mpi4py import MPI

    np.savez(f"{sys.argv[1]}/{MPI.COMM_WORLD.rank}.npz", *solve())
