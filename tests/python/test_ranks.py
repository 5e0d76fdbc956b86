"""FEniCSx under mpirun: the solution does not depend on the number of ranks."""

import dataclasses
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import voidage
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

from conftest import ROOT, problem, scatter, with_holes

BED = ROOT / "tests" / "cases" / "bed.toml"

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


def wrapped(folder) -> Path:
    """This interpreter in a folder that has no mpirun."""
    folder.mkdir()
    python = folder / "python3"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    return python


def start(program, folder, *options: str, **changes) -> subprocess.Popen:
    """A run of a bed with FEniCSx of this interpreter."""
    package = str(Path(voidage.__file__).parents[1])
    env = os.environ | {"VOIDAGE_PYTHON": sys.executable, "VOIDAGE_PYTHONPATH": package} | changes
    command = [program, "run", BED, "--quiet", "--fluid", "fenicsx", *options]
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, env=env, **pipes)


def family(process: int) -> set[int]:
    """A process and all that it has started."""
    found = {process}
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        found.update(*map(family, map(int, task.read_text().split())))
    return found


def are_running(processes: set[int]) -> bool:
    states = (Path(f"/proc/{process}/stat") for process in processes)
    return any(each.exists() and each.read_text().rsplit(")", 1)[1].split()[0] not in "ZX" for each in states)


def test_a_run_starts_its_ranks(program, tmp_path):
    """They divide the mesh, and the run is the same."""
    pytest.importorskip("dolfinx")
    short = ["--set", "time.end=0.003"]
    rows = []
    for ranks in ("1", "2"):
        run = start(program, tmp_path, "--ranks", ranks, "--out", ranks, *short)
        _, said = run.communicate(timeout=300)
        assert run.returncode == 0, said
        lines = (tmp_path / ranks / "series.csv").read_text().splitlines()
        rows.append(np.array([line.split(",") for line in lines[1:]], dtype=float))
    assert "ranks = 2" in (tmp_path / "2" / "scene.toml").read_text()
    assert len(rows[0]) > 2
    names = lines[0].split(",")
    physical = [k for k, name in enumerate(names) if "iterations" not in name and "defect" not in name]
    one, two = (each[:, physical] for each in rows)
    apart, size = np.abs(two - one).max(axis=0), np.abs(one).max(axis=0)
    assert (apart <= 1e-9 * np.maximum(size, 1e-3)).all(), apart / np.maximum(size, 1e-3)
    assert (two != one).any(), "the second run had one rank"


def test_no_rank_outlives_its_run(program, tmp_path):
    pytest.importorskip("dolfinx")
    run = start(program, tmp_path, "--ranks", "2", "--set", "time.end=100.0", "--out", "out")
    series, begun = tmp_path / "out" / "series.csv", time.monotonic()
    while not (series.exists() and series.read_text().count("\n") > 2):
        assert run.poll() is None, run.communicate()[1]
        assert time.monotonic() < begun + 120
        time.sleep(0.1)
    processes = family(run.pid)
    assert len(processes) >= 4, "run, mpirun and two ranks"
    run.kill()
    run.communicate()
    killed = time.monotonic()
    while are_running(processes):
        assert time.monotonic() < killed + 10, processes
        time.sleep(0.1)


def test_ranks_without_mpirun_are_an_error(program, tmp_path):
    pytest.importorskip("dolfinx")
    python = wrapped(tmp_path / "bin")
    run = start(program, tmp_path, "--ranks", "2", VOIDAGE_PYTHON=str(python), PATH=str(tmp_path))
    _, said = run.communicate(timeout=60)
    assert run.returncode == 2, said
    assert "2 ranks of fenicsx: there is no mpirun" in said and str(python) in said
    assert not (tmp_path / "out").exists()


def test_the_mpirun_of_another_mpi_is_named(tmp_path):
    """It starts processes of which each believes to be alone."""
    pytest.importorskip("mpi4py")
    command = [sys.executable, "-m", "voidage.adapter", "voidage.dummy", "--connect", "tcp:127.0.0.1:1"]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [*command, "--ranks", "2"], env=env, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert "2 ranks were asked for, and MPI knows of 1" in done.stderr


if __name__ == "__main__":
    from mpi4py import MPI

    np.savez(f"{sys.argv[1]}/{MPI.COMM_WORLD.rank}.npz", *solve())
