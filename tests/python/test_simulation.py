"""Simulations driven from Python: the same as the program, state that can be read and written."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import voidage
from voidage.solver import Problem, Scalar

ROOT = Path(__file__).parents[2]
BED = ROOT / "tests" / "cases" / "bed.toml"


@pytest.fixture
def bed():
    return voidage.Simulation(BED)


OF_THE_LAST_STEP = {"force", "heat", "voidage"}  # which a checkpoint does not hold


def assert_same(one, other, leave_out=frozenset()):
    """Two simulations have the same columns and fields, bit for bit; of the grains but some."""
    for columns, others, but in [
        (one.grains, other.grains, leave_out),
        (one.fluid, other.fluid, set()),
    ]:
        assert columns.keys() == others.keys()
        for name in set(columns) - but:
            assert columns[name].tobytes() == others[name].tobytes(), name


def test_a_simulation_equals_the_program(program, tmp_path):
    out = tmp_path / "out"
    subprocess.run([program, "run", BED, "--quiet", "--out", out], check=True)
    restarted = voidage.Simulation(BED, restart=out / "checkpoint.voidage")
    simulation = voidage.Simulation(BED)
    for step in range(1, restarted.steps + 1):
        simulation.step()
        if step % 10 == 0:  # the program writes a checkpoint here, and drops the kept factors
            simulation.checkpoint(tmp_path / "own.voidage")
    assert simulation.steps == restarted.steps == 40
    assert simulation.time == restarted.time == simulation.end == 0.04
    assert_same(simulation, restarted, OF_THE_LAST_STEP)


def test_keys_are_changed_by_texts_or_by_a_dictionary():
    texts = voidage.Simulation(BED, ["time.end=0.02", 'coupling.scheme="lagged"'])
    pairs = voidage.Simulation(BED, {"time.end": 0.02, "coupling.scheme": "lagged"})
    for simulation in (texts, pairs):
        simulation.run()
    assert texts.end == pairs.end == 0.02
    assert_same(texts, pairs)
    with pytest.raises(ValueError, match="time.ende"):
        voidage.Simulation(BED, {"time.ende": 0.02})


def test_a_restart_goes_on_bit_for_bit(bed, tmp_path):
    bed.run(0.005)
    bed.checkpoint(tmp_path / "five.voidage")
    restarted = voidage.Simulation(BED, restart=tmp_path / "five.voidage")
    assert restarted.steps == 5
    for simulation in (bed, restarted):
        simulation.run(until=0.01)
    assert_same(bed, restarted)


def test_the_program_goes_on_from_a_checkpoint_of_python(program, tmp_path, bed):
    bed.run(0.02)
    bed.checkpoint(tmp_path / "half.voidage")
    command = [program, "run", BED, "--quiet", "--out", tmp_path / "out"]
    subprocess.run([*command, "--restart", tmp_path / "half.voidage"], check=True)
    for step in range(21, 41):
        bed.step()
        if step % 10 == 0:
            bed.checkpoint(tmp_path / "own.voidage")
    restarted = voidage.Simulation(BED, restart=tmp_path / "out" / "checkpoint.voidage")
    assert_same(bed, restarted, OF_THE_LAST_STEP)


def test_the_report_says_how_a_step_went(bed):
    report = bed.step()
    assert report.keys() == bed.report.keys()
    assert 0 <= report["momentum_exchange_defect"] < 1e-12
    assert 0 <= report["solid_volume_defect"] < 1e-12
    assert report["grains"]["converged"] and report["fluid"]["residual"] < 1e-6
    assert set(report["phases_s"]) >= {"overlap", "closure", "flow", "contacts"}


def test_columns_are_those_of_the_scene(bed):
    assert bed.grains["position"].shape == (40, 2)
    assert set(bed.grains) >= {"position", "velocity", "radius", "mass", "temperature", "voidage"}
    assert set(bed.fluid) == {"velocity", "pressure", "temperature", "voidage"}
    no_spin = voidage.Simulation(BED, ["contacts.rotation=false"])
    assert "spin" in bed.grains and "spin" not in no_spin.grains
    points, cells = bed.mesh.points, bed.mesh.cells
    assert bed.fluid["velocity"].shape == points.shape and cells.shape[1] == 3
    assert set(bed.mesh.boundaries) == {"inflow", "nozzle", "outflow", "walls"}
    corners = points[bed.mesh.boundaries["outflow"]]
    assert np.all(corners[:, :, 1] == points[:, 1].max())


def test_what_is_written_is_what_the_next_step_starts_from(bed):
    warm = np.linspace(280.0, 400.0, 40)
    bed.grains["temperature"] = warm
    bed.grains["velocity"] = np.zeros((40, 2))
    np.testing.assert_array_equal(bed.grains["temperature"], warm)
    bed.step()
    changed = bed.grains["temperature"] - warm
    assert 0 < abs(changed).max() < 1.0
    still = voidage.Simulation(BED)
    still.step()
    assert abs(still.grains["temperature"] - warm).max() > 10


def test_arrays_outlive_the_simulation_and_are_read_only(bed):
    position = bed.grains["position"]
    copy = position.copy()
    bed.run(0.003)
    del bed
    np.testing.assert_array_equal(position, copy)
    with pytest.raises(ValueError, match="read-only"):
        position[0] = 0.0
    with pytest.raises(ValueError):
        position.flags.writeable = True


@pytest.mark.parametrize(
    ("name", "value", "error", "text"),
    [
        ("temperature", np.ones(39), ValueError, r"shape \[39\], it must have \(40,\)"),
        ("velocity", np.ones(40), ValueError, r"must have \(40, 2\)"),
        ("velocity", np.full((40, 2), np.nan), ValueError, "nan|NaN"),
        ("velocity", "fast", ValueError, "no array of numbers"),
        ("mass", np.ones(40), ValueError, "read but not written"),
        ("colour", np.ones(40), KeyError, "no column `colour` here; there are position"),
    ],
)
def test_writing_checks(bed, name, value, error, text):
    with pytest.raises(error, match=text):
        bed.grains[name] = value


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"scene": "none.toml"}, "none.toml: there is no such file.*\n.*help"),
        ({"scene": BED, "set": ["fluid.densty=1"]}, "did you mean `density`"),
        ({"scene": BED, "scheme": "implicit"}, "there is no such coupling scheme\\n.*use one of explicit, "),
        ({"scene": BED, "fluid": "openfoam"}, "no such fluid solver"),
        ({"scene": BED, "restart": BED}, "no checkpoint of voidage"),
        ({"scene": BED, "threads": 0}, "there must be a thread"),
    ],
)
def test_wrong_input_is_a_value_error_with_the_text_of_the_program(arguments, text):
    with pytest.raises(ValueError, match=text):
        voidage.Simulation(**arguments)


def test_defaults_are_those_of_a_scene(program):
    """What a solver may leave out means the same in Python as in a scene."""
    schema = json.loads(subprocess.run([program, "schema"], check=True, capture_output=True).stdout)
    tables = schema["$defs"]
    python = {
        field.name: field.default
        for table in (Problem, Scalar)
        for field in dataclasses.fields(table)
        if field.default is not dataclasses.MISSING
    }
    compared = 0
    for table in ("FluidSolver", "FluidHeat", "FluidScalar"):
        for key, described in tables[table]["properties"].items():
            if key in python and "default" in described:
                assert python[key] == described["default"], key
                compared += 1
    assert compared >= 6


def test_a_run_that_fails_is_a_runtime_error(bed):
    position = bed.grains["position"].copy()
    position[3] = 1.0, 1.0
    bed.grains["position"] = position
    with pytest.raises(RuntimeError, match="step 1, .*grain 3 .*outside"):
        bed.step()


def test_grains_or_fluid_alone():
    hopper = voidage.Simulation(ROOT / "cases" / "hopper" / "scene.toml")
    assert hopper.mesh is None and len(hopper.fluid) == 0
    hopper.step()
    cavity = voidage.Simulation(ROOT / "cases" / "cavity" / "scene.toml")
    cavity.step()
    assert len(cavity.grains) == 0 and "voidage" not in cavity.fluid


def test_one_file_serves_python_of_debian_and_of_a_virtual_environment():
    debian = "/usr/bin/python3"
    package = {**os.environ, "PYTHONPATH": str(ROOT / "coupling" / "python")}
    if subprocess.run([debian, "-c", "import numpy"], capture_output=True).returncode:
        pytest.skip("no numpy for /usr/bin/python3: apt-get install python3-numpy")
    script = (
        "import sys, voidage; s = voidage.Simulation(sys.argv[1]); s.run(0.003);"
        "print(s.grains['position'].tobytes().hex())"
    )
    printed = [
        subprocess.run(
            [python, "-c", script, BED], env=package, check=True, capture_output=True
        ).stdout
        for python in (sys.executable, debian)
    ]
    assert len(printed[0]) > 1000 and printed[0] == printed[1]


@pytest.mark.parametrize("scheme", ["explicit", "henry", "lagged", "anchored", "iterated"])
def test_the_fluid_of_a_step_in_which_a_grain_ran_away_was_kept(scheme):
    simulation = voidage.Simulation(BED, scheme=scheme)
    simulation.run(until=5e-3)
    before = {name: np.array(simulation.fluid[name]) for name in simulation.fluid.keys()}
    velocity = np.array(simulation.grains["velocity"])
    velocity[0] = [0.0, 1e8]
    simulation.grains["velocity"] = velocity
    with pytest.raises(RuntimeError, match="grain 0 would go at"):
        simulation.step()
    assert simulation.steps == 5
    for name, values in before.items():
        assert np.array_equal(simulation.fluid[name], values), name
