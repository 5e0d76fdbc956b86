"""Fluid solvers in Python, in the process of the grains."""

import dataclasses
import gc

import numpy as np
import pytest
import voidage
from test_simulation import BED, assert_same
from voidage.dummy import STREAM, Dummy

DROPLET = BED.parents[1] / "python" / "scenes" / "droplet.toml"


def test_the_dummy_blows_its_stream():
    simulation = voidage.Simulation(BED, fluid=Dummy())
    report = simulation.run(until=0.005)
    assert report["momentum_exchange_defect"] < 1e-12
    np.testing.assert_allclose(simulation.fluid["velocity"], [[0, STREAM]] * 111, atol=1e-15)
    heavy = -9.81 * 1.204 * simulation.mesh.points[:, 1]
    np.testing.assert_allclose(simulation.fluid["pressure"], heavy, atol=1e-12)


@pytest.mark.parametrize("name", ["scikit_fem:ScikitFem", "fenicsx:FEniCSx"])
def test_a_moving_mesh_reaches_a_solver_in_this_process(name):
    module, solver = name.split(":")
    module = pytest.importorskip(f"voidage.{module}", exc_type=ImportError)
    scene = BED.parents[1] / "python" / "scenes" / "moving-mesh.toml"
    tight = ["fluid.solver.tolerance=1e-13"]
    rust = voidage.Simulation(scene, tight)
    python = voidage.Simulation(scene, tight, fluid=getattr(module, solver)())
    rest = rust.mesh.points.copy()
    for simulation in (rust, python):
        simulation.run(until=0.003)
    np.testing.assert_array_equal(rust.mesh.points, python.mesh.points)
    assert abs(rust.mesh.points - rest).max() > 1e-4
    for column in rust.fluid:
        scale = abs(rust.fluid[column]).max()
        np.testing.assert_allclose(
            python.fluid[column], rust.fluid[column], rtol=0, atol=1e-8 * scale
        )


def test_a_droplet_boils_away_in_a_solver_in_this_process():
    pytest.importorskip("skfem")
    from voidage.scikit_fem import ScikitFem

    scene, tight = DROPLET.with_name("boils-away.toml"), ["fluid.solver.tolerance=1e-12"]
    rust = voidage.Simulation(scene, tight)
    python = voidage.Simulation(scene, tight, fluid=ScikitFem())
    for simulation in (rust, python):
        assert "droplet" in simulation.mesh.boundaries
        simulation.run(until=6e-4)
        assert "droplet" not in simulation.mesh.boundaries
    for name in rust.fluid:
        scale = abs(rust.fluid[name]).max()
        np.testing.assert_allclose(
            python.fluid[name], rust.fluid[name], rtol=0, atol=1e-6 * scale
        )


def test_scikit_fem_agrees_with_rust():
    pytest.importorskip("skfem")
    from voidage.scikit_fem import ScikitFem

    tight = ["fluid.solver.tolerance=1e-10"]
    rust = voidage.Simulation(BED, tight)
    python = voidage.Simulation(BED, tight, fluid=ScikitFem())
    for simulation in (rust, python):
        simulation.step()
    for columns, others in [(rust.fluid, python.fluid), (rust.grains, python.grains)]:
        for name in columns:
            scale = abs(columns[name]).max()
            np.testing.assert_allclose(others[name], columns[name], rtol=0, atol=1e-8 * scale)


class Watched(Dummy):
    """Keeps what it was given."""

    def set_mesh(self, problem):
        super().set_mesh(problem)
        self.given = [problem]

    def solve(self, step):
        self.given.append(step)
        return super().solve(step)


def test_a_solver_gets_all_of_the_scene_and_may_keep_it():
    solver = Watched()
    simulation = voidage.Simulation(BED, fluid=solver)
    volume = simulation.grains["volume"]
    simulation.run(until=0.003)
    del simulation
    gc.collect()
    problem, *steps = solver.given
    assert problem.points.shape == (111, 2) and problem.cells.shape == (180, 3)
    assert problem.density == 1.204 and problem.gravity.tolist() == [0.0, -9.81]
    [scalar] = problem.scalars
    assert scalar.name == "temperature" and scalar.capacity == 1.204 * 1010
    assert scalar.reference == 290.0
    assert [values.tolist() for values in problem.fields.scalars] == [[290.0] * 111]
    kinds = {
        c.boundary: (type(c.flow).__name__, type(c.scalar(0)).__name__)
        for c in steps[0].conditions
    }
    assert kinds == {
        "outflow": ("Open", "Outflow"),
        "inflow": ("SuperficialVelocity", "Value"),
        "nozzle": ("NoSlip", "Insulated"),
        "walls": ("Slip", "Transfer"),
    }
    solid = volume.sum()
    for step in steps:
        points, [heat] = step.points, step.points.scalars
        count = len(points.cell)
        assert step.dt == 1e-3 and count >= 40 and heat.coefficient.shape == (count,)
        assert points.volume.sum() == pytest.approx(solid, rel=1e-12)
        np.testing.assert_allclose(points.shape.sum(axis=1), 1.0, rtol=1e-12)
        with pytest.raises(ValueError, match="read-only"):
            points.drag[0] = 0.0


def test_conditions_follow_the_ramp():
    solver = Watched()
    simulation = voidage.Simulation(BED, ["fluid.ramp=0.004"], fluid=solver)
    simulation.run(until=0.005)
    inflow = [step.conditions[1].flow.value[1] for step in solver.given[1:]]
    np.testing.assert_allclose(inflow, [0.2, 0.4, 0.6, 0.8, 0.8])


def test_a_restart_goes_on_bit_for_bit(tmp_path):
    first = voidage.Simulation(BED, fluid=Dummy())
    first.run(until=0.003)
    first.checkpoint(tmp_path / "three.voidage")
    second = voidage.Simulation(BED, fluid=Dummy(), restart=tmp_path / "three.voidage")
    for simulation in (first, second):
        simulation.run(until=0.006)
    assert_same(first, second)


def change(**methods):
    """A dummy with other methods."""
    return type("Changed", (Dummy,), methods)()


def diverged(self, step):
    solution = Dummy.solve(self, step)
    solution.fields.velocity[7] = np.inf
    return solution


def fail(self, *_):
    raise ArithmeticError("the matrix is singular")


@pytest.mark.parametrize(
    ("methods", "text"),
    [
        ({"solve": fail}, "step 1, .*the matrix is singular"),
        ({"solve": diverged}, "`velocity` is inf in row 7"),
        ({"solve": lambda self, step: None}, "returned NoneType"),
        ({"accept": fail}, "the matrix is singular"),
    ],
)
def test_what_a_solver_does_wrong_ends_the_step(methods, text):
    simulation = voidage.Simulation(BED, fluid=change(**methods))
    with pytest.raises(RuntimeError, match=text) as raised:
        simulation.step()
    assert raised.value.__cause__ is not None


@pytest.mark.parametrize(
    ("bodies", "text"),
    [
        ([voidage.BodyAnswer(np.zeros(3), 0.0)], r"`velocity of a body` has shape \[3\]"),
        ([voidage.BodyAnswer([0.0, np.inf], 0.0)], "`velocity of a body` is inf in row 1"),
        ([voidage.BodyAnswer(np.zeros(2), np.nan)], "`vapour` of a body is NaN"),
        ([voidage.BodyAnswer(np.zeros(2), None)], "vapour=None"),
        ([voidage.BodyAnswer(np.zeros(2), 0.0)] * 2, "answers for 2 bodies, there are 1"),
        ((), "does not say what the droplet does"),
    ],
)
def test_what_a_solver_says_of_bodies_is_checked(bodies, text):
    def solve(self, step):
        return dataclasses.replace(Dummy.solve(self, step), bodies=bodies)

    simulation = voidage.Simulation(DROPLET, fluid=change(solve=solve))
    with pytest.raises(RuntimeError, match=text):
        simulation.step()


def test_a_solver_that_does_not_take_the_mesh():
    with pytest.raises(RuntimeError, match="singular"):
        voidage.Simulation(BED, fluid=change(set_mesh=fail))


def test_a_solver_has_three_methods():
    with pytest.raises(TypeError, match="without a method `set_mesh`"):
        voidage.Simulation(BED, fluid=object())


def test_a_scene_without_fluid_takes_no_solver():
    hopper = BED.parents[2] / "cases" / "hopper" / "scene.toml"
    with pytest.raises(ValueError, match="no fluid"):
        voidage.Simulation(hopper, fluid=Dummy())
