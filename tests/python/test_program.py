"""The program `voidage` as the Python package has it."""

import os
import subprocess
import sys

import pytest
import voidage
from test_simulation import BED

from conftest import ROOT


def program(folder, *arguments: str) -> subprocess.CompletedProcess:
    env = os.environ | {"PYTHONPATH": str(ROOT / "coupling" / "python")}
    command = [sys.executable, "-m", "voidage", *arguments]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)


def test_the_package_has_the_program(tmp_path):
    done = program(tmp_path, "--version")
    assert (done.returncode, done.stdout) == (0, f"voidage {voidage.__version__}\n")
    done = program(tmp_path, "run", "nothing")
    assert done.returncode == 2
    assert "no shipped case of this name" in done.stderr


def test_a_case_runs_by_name_and_starts_solvers(tmp_path):
    short = ["--quiet", "--threads", "1", "--set", "time.end=0.003"]
    for solver in ["rust", "serve", "scikit-fem"]:
        done = program(tmp_path, "run", "settling-grain", *short, "--fluid", solver, "--out", solver)
        assert done.returncode == 0, done.stderr
    series = [(tmp_path / solver / "series.csv").read_bytes() for solver in ["rust", "serve"]]
    assert series[0] == series[1]
    assert (tmp_path / "scikit-fem" / "solver.log").exists()


def test_a_study_runs_in_processes_of_the_package(tmp_path):
    study = ROOT / "cases" / "studies" / "stack.toml"
    done = program(tmp_path, "study", str(study), "--quick", "--quiet", "--threads", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert len(rows) > 2, done.stderr


def test_a_simulation_takes_the_name_of_a_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = voidage.Simulation("settling-grain")
    run.step()
    assert run.grains["velocity"][0, 1] < 0.0


def test_grains_could_be_colder_than_anything():
    bed = voidage.Simulation(BED)
    cold = bed.grains["temperature"].copy()
    cold[3] = -1.0
    with pytest.raises(ValueError, match="-1 in row 3, it must be 0 K or more"):
        bed.grains["temperature"] = cold


def test_grains_thrown_out_of_all_proportion_end_the_run():
    bed = voidage.Simulation("column-collapse")
    fast = bed.grains["velocity"].copy()
    fast[5] = [0.0, 1e200]
    bed.grains["velocity"] = fast
    with pytest.raises(RuntimeError, match="out of all proportion"):
        bed.step()
