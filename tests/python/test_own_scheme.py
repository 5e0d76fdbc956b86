"""Coupling schemes of one's own by name, and phases that take a length."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import voidage
from test_scheme import Henry
from test_simulation import BED, ROOT, assert_same

SCHEMES = ROOT / "coupling" / "python" / "schemes"


def forcing(system):
    load, at = system.load, system.at_grains
    force = load["drag"][:, None] * at["velocity"] - load["volume"][:, None] * at["pressure_gradient"]
    return force + load["known"], load["heat_coefficient"] * at["temperature"]


def freeze(system, carries=True):
    load, grains = system.load, system.grains
    load["mobility"] = load["heat_mobility"] = np.zeros_like(load["drag"])
    load["velocity"], load["temperature"] = grains["velocity"], grains["temperature"]
    system.separate_continuity()
    if carries:
        system.give_back_carried()


class Strang:
    """As the built-in `strang`."""

    start = None

    def half(self, system, dt):
        system.evaluate_closures(dt / 2)
        system.drive_grains(*forcing(system), dt=dt / 2)

    def solve(self, system, dt):
        system.cut_grains()
        self.start = system.time if self.start is None else self.start
        if system.time == self.start:
            # For the pressure of the first half.
            system.evaluate_closures()
            freeze(system, carries=False)
            system.solve_fluid()
        self.half(system, dt)
        system.cut_grains()
        system.evaluate_closures()
        freeze(system)
        system.solve_fluid()
        self.half(system, dt)


class SubCycled:
    """As the built-in `sub-cycled`."""

    def step(self, system, dt):
        system.cut_grains()
        system.evaluate_closures()
        freeze(system)
        system.solve_fluid()
        for _ in range(10):
            system.evaluate_closures(dt / 10)
            system.drive_grains(*forcing(system), dt=dt / 10)
        system.accept()


@pytest.mark.parametrize(("scheme", "name"), [(Strang, "strang"), (SubCycled, "sub-cycled"), (Henry, "henry")])
def test_schemes_of_phases_with_lengths_are_the_built_in_ones(scheme, name):
    mine = voidage.Simulation(BED, scheme=scheme())
    built_in = voidage.Simulation(BED, scheme=name)
    for step in range(20):
        reports = [simulation.step() for simulation in (mine, built_in)]
        for report in reports:
            assert report["momentum_exchange_defect"] < 1e-12 and report["energy_exchange_defect"] < 1e-11
        # They say alike how far grains and fluid are apart.
        one, other = (report["agreement"] for report in reports)
        assert one.pop("parts") == other.pop("parts") == 1
        # Of the shipped ones the solution for the pressure of the first half does not count.
        more = 1 if step == 0 and scheme is Strang else 0
        assert one.pop("solutions") == other.pop("solutions") + more
        assert one == other and one["disagreement"] > 0
    assert_same(mine, built_in)


def test_a_step_in_parts_is_done_with_solve():
    setting = ["coupling.cut={ travel = 0.01 }", "time.step=4e-3"]
    mine = voidage.Simulation(BED, setting, scheme=Strang())
    built_in = voidage.Simulation(BED, setting, scheme="strang")
    for _ in range(10):
        parts = [simulation.step()["agreement"]["parts"] for simulation in (mine, built_in)]
    assert parts[0] == parts[1] > 1
    assert_same(mine, built_in)
    with pytest.raises(ValueError, match="`coupling.cut` divides steps, and the scheme makes whole ones"):
        voidage.Simulation(BED, setting, scheme=SubCycled())


def test_the_fluid_takes_several_steps_in_one_of_the_grains():
    name = f"python:{SCHEMES / 'multirate.py'}"
    two = voidage.Simulation(BED, ["coupling.scheme_options.count=2"], scheme=name)
    one = voidage.Simulation(BED, ["coupling.scheme_options.count=1"], scheme=name)
    explicit = voidage.Simulation(BED, scheme="explicit")
    for _ in range(10):
        reports = [simulation.step() for simulation in (two, one, explicit)]
        for report in reports:
            assert report["momentum_exchange_defect"] < 1e-12 and report["energy_exchange_defect"] < 1e-11
    assert two.time == one.time and two.steps == 10
    assert_same(one, explicit)
    # The error of first order in the fluid is halved: they differ, by less than a fifth of the motion.
    gap = abs(two.grains["velocity"] - one.grains["velocity"]).max()
    assert 0 < gap < 0.2 * abs(one.grains["velocity"]).max()


@pytest.mark.parametrize(
    ("phases", "told"),
    [
        ([("solve_fluid", 0.5), ("move_grains", 1.0), ("accept", None)], "accepted 5e-04 s of the fluid in a step"),
        ([("solve_fluid", 1.0), ("move_grains", 0.5), ("accept", None)], "moved the grains by 5e-04 s in a step"),
        ([("solve_fluid", 2.0)], "a length of 2e-03 s in a step of 1e-03 s"),
        ([("solve_fluid", 1.0), ("move_grains", -1.0)], "a length of -1e-03 s"),
    ],
)
def test_lengths_that_do_not_make_the_step_are_told(phases, told):
    class Short(Henry):
        def step(self, system, dt):
            system.cut_grains()
            system.evaluate_closures()
            self.predict(system, dt)
            for phase, share in phases:
                getattr(system, phase)(*([] if share is None else [share * dt]))

    simulation = voidage.Simulation(BED, ["time.step=1e-3"], scheme=Short())
    with pytest.raises((RuntimeError, ValueError)) as raised:
        simulation.step()
    told = told.replace("e-0", "e-")
    assert told in str(raised.value).replace("e-0", "e-")


@pytest.fixture
def voidage_program(program, tmp_path):
    """Runs the program in a folder of the test; what it says."""

    def run(*arguments, cwd=tmp_path, code=0):
        environment = {**os.environ, "VOIDAGE_PYTHON": sys.executable}
        done = subprocess.run([program, *map(str, arguments)], cwd=cwd, env=environment, capture_output=True, text=True)
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr

    return run


def aitken(tmp_path):
    (tmp_path / "aitken.py").write_text((SCHEMES / "aitken.py").read_text())


def test_run_and_compare_take_a_scheme_of_ones_own(tmp_path, voidage_program):
    aitken(tmp_path)
    # A checkpoint would drop what the linear solver keeps.
    unbroken = ["--set", "output.checkpoint_interval=1"]
    said = voidage_program("run", BED, "--scheme", "python:aitken.py", "--quiet", *unbroken)
    assert "done" in said
    series = np.genfromtxt(tmp_path / "out" / "bed" / "series.csv", delimiter=",", names=True)
    assert series["fluid_solves"].max() > 1
    simulation = voidage.Simulation(BED, scheme=f"python:{tmp_path}/aitken.py:Aitken")
    simulation.run()
    height = np.average(simulation.grains["position"][:, 1], weights=simulation.grains["mass"])
    assert height == pytest.approx(series["mean_grain_height_m"][-1], rel=1e-12)
    said = voidage_program(
        *["compare", BED, "--fluids", "rust,scikit-fem", "--scheme", "python:aitken.py"],
        *["--at", "1,3", "--steps", "0", "--quiet"],
    )
    assert "0 differences above" in said


def test_a_scene_names_a_scheme_beside_it(tmp_path, voidage_program):
    aitken(tmp_path)
    text = BED.read_text().replace('scheme = "iterated"', 'scheme = "python:aitken.py"')
    text += "\n[coupling.scheme_options]\ntolerance = 1e-2\n"
    (tmp_path / "bed.toml").write_text(text)
    (tmp_path / "elsewhere").mkdir()
    voidage_program("run", "../bed.toml", "--quiet", cwd=tmp_path / "elsewhere")
    said = voidage_program("run", "bed.toml", "--set", "coupling.scheme_options.tolrance=1", code=2)
    assert "tolrance" in said


def test_study_stability_and_verify_take_a_scheme_of_ones_own(tmp_path, voidage_program):
    aitken(tmp_path)
    (tmp_path / "slip.toml").write_text(
        """
case = { problem = "slip-box" }
reference = "exact"
quantities = [{ name = "slip", of = { error = "slip" } }]
sweeps = [{ name = "schemes", refine = "dt", vary = { scheme = ["iterated", "python:aitken.py"], dt = [0.5, 0.1] } }]
"""
    )
    said = voidage_program("study", "slip.toml", "--quiet")
    table = next((tmp_path / "out").glob("study-slip*/*.csv")).read_text()
    assert table.count("aitken.py") >= 2, said
    said = voidage_program(
        *["stability", "--quick", "--quiet", "--only", "slip", "--only", "heat", "--scheme", "python:aitken.py"],
    )
    assert "aitken.py" in said and "passes" in said
    said = voidage_program(
        "verify", "--quick", "--quiet", "--only", "minimum-fluidisation", "--scheme", "python:aitken.py"
    )
    assert "0 of" in said


@pytest.mark.parametrize(
    ("text", "name", "told"),
    [
        (None, "python:mine.py", "there is no file"),
        ("import nothing_of_the_kind\n", "python:mine.py", "nothing_of_the_kind"),
        ("x = 1\n", "python:mine.py", "has these schemes: none"),
        ("class A:\n def step(self, s, dt): 0\nclass B(A): 0\n", "python:mine.py", "name one: python:FILE:CLASS"),
        ("class A:\n def step(self, s, dt): 0\n", "python:mine.py:C", "has no scheme C: it has A"),
        ("class A:\n def step(self, s, dt):\n  raise LookupError('lost')\n", "python:mine.py", "mine.py, line 3: "),
        ("class A:\n def __init__(self, n): 0\n def step(self, s, dt): 0\n", "python:mine.py", "'n'"),
        (None, "python:", "there is no such coupling scheme"),
        (None, "pyhton:mine.py", "there is no such coupling scheme"),
    ],
)
def test_what_is_wrong_with_a_scheme_of_ones_own_is_told(tmp_path, voidage_program, text, name, told):
    if text is not None:
        (tmp_path / "mine.py").write_text(text)
    runs = "line 3" in told
    said = voidage_program("run", BED, "--scheme", name, "--quiet", code=1 if runs else 2)
    assert told in said


def test_an_interrupt_ends_a_run_with_a_scheme_in_python_with_a_checkpoint(program, tmp_path):
    aitken(tmp_path)
    arguments = ["run", "bubbling-bed-quick", "--scheme", "python:aitken.py", "--out", "out"]
    environment = {**os.environ, "VOIDAGE_PYTHON": sys.executable}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    run = subprocess.Popen([program, *arguments], cwd=tmp_path, env=environment, **pipes)
    for _ in range(600):
        if (tmp_path / "out" / "series.csv").is_file():
            break
        time.sleep(0.1)
    time.sleep(1.0)
    run.send_signal(signal.SIGINT)
    said, _ = run.communicate(timeout=60)
    assert run.returncode == 1 and "interrupted at t = " in said, said
    assert (tmp_path / "out" / "checkpoint.voidage").is_file()
