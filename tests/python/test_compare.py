"""The same states through Rust, FEniCSx and scikit-fem, each in a process of its own."""

import csv
import os
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
        (SCENES / "moving-mesh.toml", "1,30"),
        (SCENES / "moving-box.toml", "1,30"),
        (CASES / "tracer" / "scene.toml", "1,20"),
        (SCENES / "droplet.toml", "1,2,12"),
        (SCENES / "boils-away.toml", "1,20,40"),
        (SCENES / "periodic.toml", "1,10,20"),
        (SCENES / "periodic-box.toml", "1,10"),
    ],
    ids=[
        "bubbling bed",
        "packed bed",
        "settling grain",
        "cavity",
        "convection",
        "full cells",
        "moving mesh",
        "moving rod in a closed box",
        "tracer",
        "droplet",
        "droplet that boils away",
        "periodic sides",
        "periodic along both axes",
    ],
)
def test_solvers_agree_to_round_off(program, tmp_path, scene, at):
    done, rows = compare(program, scene, tmp_path / "out", "--at", at, "--steps", "0")
    assert done.returncode == 0, done.stdout + done.stderr
    assert {row["fluid"] for row in rows} == {"fenicsx", "scikit-fem"}
    assert {row["step"] for row in rows} == set(at.split(","))
    assert max(float(row["relative_max_difference"]) for row in rows) < 1e-9


@pytest.mark.parametrize(
    "change",
    [
        "fluid.heat.form=lumped",
        "fluid.heat.form=monotone",
    ],
)
def test_other_forms_of_the_equations_are_the_same_in_all_solvers(program, tmp_path, change):
    bed = ROOT / "tests" / "cases" / "bed.toml"
    options = ("--set", change, "--at", "1,20", "--steps", "0")
    done, _ = compare(program, bed, tmp_path / "out", *options)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_droplet_that_the_gas_throws_about_is_the_same_in_all_solvers(program, tmp_path):
    """As light as this, it moves as the forces of the gas do."""
    light = ("--set", "droplet.liquid.density=2.0", "--set", "time.step=1e-5")
    options = (*light, "--at", "1,2,8", "--steps", "0")
    done, rows = compare(program, SCENES / "droplet.toml", tmp_path / "out", *options)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {"body velocity", "vapour of bodies"} < {row["quantity"] for row in rows}


@pytest.mark.parametrize(
    "choice",
    [
        "droplet.heat_flux=gradient",
        "droplet.blowing=interstitial",
        "droplet.grain_share=disc",
        "droplet.buoyancy=hydrostatic",
    ],
)
def test_choices_of_a_droplet_are_the_same_in_all_solvers(program, tmp_path, choice):
    options = ("--set", choice, "--at", "1,2,12", "--steps", "0")
    done, rows = compare(program, SCENES / "droplet.toml", tmp_path / "out", *options)
    assert done.returncode == 0, done.stdout + done.stderr
    assert max(float(row["relative_max_difference"]) for row in rows) < 1e-9


def test_a_mesh_made_anew_reaches_all_solvers(program, tmp_path):
    anew = ("--set", "fluid.mesh_motion.remesh.every=5", "--at", "1,6,12", "--steps", "0")
    done, rows = compare(program, SCENES / "moving-mesh.toml", tmp_path / "out", *anew)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {row["step"] for row in rows} == {"1", "6", "12"}


def test_a_study_finds_the_python_that_a_file_needs(program, tmp_path):
    """A solver of one's own in FEniCSx ran by ``--fluid python:FILE`` and not in a study."""
    mine = tmp_path / "mine.py"
    mine.write_text("from voidage.fenicsx import FEniCSx\n\n\nclass Mine(FEniCSx):\n    pass\n")
    study = tmp_path / "study.toml"
    study.write_text(
        'title = "Mine"\ncase = { problem = "manufactured" }\nreference = "manufactured"\n'
        '[[quantities]]\nname = "velocity"\nof = { error = "u" }\n'
        "[[sweeps]]\nrefine = 'squares'\nvary = { squares = [4, 8], "
        f"solver = ['fenicsx', {{ python = '{mine}' }}] }}\n"
    )
    done = subprocess.run(
        [program, "study", study, "--quiet", "--out", tmp_path / "out"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with open(tmp_path / "out" / "results.csv") as file:
        rows = list(csv.DictReader(file))
    errors = [float(row["error_of_velocity"]) for row in rows]
    assert len(errors) == 4
    assert sorted(errors)[0] == pytest.approx(sorted(errors)[1], rel=1e-9)


def test_fenicsx_on_two_ranks_over_tcp(program, tmp_path):
    address = f"tcp:127.0.0.1:{20000 + os.getpid() % 20000}"
    ranks = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "2"]
    solver = [*ranks, "/usr/bin/python3", "-m", "voidage.fenicsx", "--connect", address]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "coupling" / "python")}
    log = tmp_path / "solver.log"
    with open(log, "w") as file:
        process = subprocess.Popen(solver, env=environment, stdout=file, stderr=file)
    fluids = ("--fluids", f"rust,attach:{address}", "--at", "1,3", "--steps", "0")
    bed = ROOT / "tests" / "cases" / "bed.toml"
    try:
        done, rows = compare(program, bed, tmp_path / "out", *fluids)
        assert process.wait(20) == 0, log.read_text()
    finally:
        process.kill()
    assert done.returncode == 0, done.stdout + done.stderr
    assert max(float(row["relative_max_difference"]) for row in rows) < 1e-9


def test_a_solver_that_solves_something_else_is_found(program, tmp_path):
    bed = ROOT / "tests" / "cases" / "bed.toml"
    fluids = ("--fluids", "rust,python:voidage.dummy", "--at", "1", "--steps", "2")
    done, rows = compare(program, bed, tmp_path / "out", *fluids)
    assert done.returncode == 1
    assert max(float(row["relative_max_difference"]) for row in rows) > 1e-3
    assert (tmp_path / "out" / "free-runs-python-voidage.dummy.png").exists()
