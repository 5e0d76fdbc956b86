"""The same states through Rust, FEniCSx and scikit-fem, each in a process of its own."""

import csv
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CASES, SCENES = ROOT / "cases", Path(__file__).parent / "scenes"


def compare(program, scene, out, *options):
    """Runs ``voidage compare`` in the root; returns its exit code and the rows of same-state.csv."""
    command = [program, "compare", scene, "--quiet", "--out", out, *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    table = out / "same-state.csv"
    assert table.exists(), done.stderr
    with open(table) as file:
        return done, list(csv.DictReader(file))


@pytest.mark.parametrize(
    "scene, at",
    [
        (CASES / "bubbling-bed" / "scene-quick.toml", "1,120"),
        (CASES / "packed-bed" / "scene.toml", "1,20"),
        (CASES / "settling-grain" / "scene.toml", "1,50"),
        (CASES / "cavity" / "scene.toml", "1,20"),
        (SCENES / "convection.toml", "1,20"),
        (SCENES / "full-cells.toml", "1,5"),
    ],
    ids=["bubbling bed", "packed bed", "settling grain", "cavity", "convection", "full cells"],
)
def test_solvers_agree_to_round_off(program, tmp_path, scene, at):
    done, rows = compare(program, scene, tmp_path / "out", "--at", at, "--steps", "0")
    assert done.returncode == 0, done.stdout + done.stderr
    assert {row["fluid"] for row in rows} == {"fenicsx", "scikit-fem"}
    assert {row["step"] for row in rows} == set(at.split(","))
    assert max(float(row["relative_max_difference"]) for row in rows) < 1e-9


def test_a_solver_that_solves_something_else_is_found(program, tmp_path):
    bed = ROOT / "tests" / "cases" / "bed.toml"
    fluids = ("--fluids", "rust,python:voidage.dummy", "--at", "1", "--steps", "2")
    done, rows = compare(program, bed, tmp_path / "out", *fluids)
    assert done.returncode == 1
    assert max(float(row["relative_max_difference"]) for row in rows) > 1e-3
    assert (tmp_path / "out" / "free-runs-python-voidage.dummy.png").exists()
