"""The way from what a run tells to what a solver gets."""

import json
import math

import numpy as np
import pytest
from voidage import adapter
from voidage import solver as data
from voidage.dummy import Dummy

from conftest import box

CONDITIONS = [
    {
        "boundary": "x0",
        "flow": {"velocity": {"uniform": [1, 2]}},
        "scalars": [{"value": {"uniform": 3}}],
    },
    {
        "boundary": "x1",
        "flow": {"open": {"pressure": 4}},
        "scalars": [{"outflow": {"outside": None}}],
    },
    {
        "boundary": "y0",
        "flow": "slip",
        "scalars": ["insulated", {"transfer": {"coefficient": 5, "outside": 6}}],
    },
    {
        "boundary": "y1",
        "flow": {"superficial_velocity": {"nodal": [[7, 8]] * 9}},
        "scalars": [{"outflow": {"outside": 9}}, {"value": {"nodal": [1] * 9}}],
    },
]
TRACER = {
    "name": "tracer",
    "capacity": 1,
    "conductivity": 0.1,
    "thin_cell": None,
    "form": "monotone",
    "expansion": 0,
    "reference": 0,
}
WARM = TRACER | {"name": "temperature", "thin_cell": {"coefficient": 2, "value": 300}}
SETUP = {
    "properties": {
        "density": 1.2,
        "viscosity": 0.1,
        "gravity": [0, -10],
        "body_force": [3, 0],
        "thin_cell_drag": 0.5,
    },
    "scalars": [WARM, TRACER],
    "numerics": {"newton": 2, "flow": {"tolerance": 1e-9}, "scalars": {}},
    "conditions": CONDITIONS,
}


class Watched(Dummy):
    """Keeps what it was given."""

    def set_mesh(self, problem):
        super().set_mesh(problem)
        self.problem = problem

    def solve(self, step):
        self.step = step
        return super().solve(step)


@pytest.fixture
def driver():
    driver = adapter.Driver(Watched(), json.dumps(SETUP))
    fields = {
        "velocity": np.zeros((9, 2)),
        "pressure": np.zeros(9),
        "scalars": [np.full(9, 300.0), np.zeros(9)],
    }
    driver.start((*box(2, 2), None), fields)
    return driver


def test_a_solver_that_does_not_know_periodic_sides_refuses_them(driver):
    masters = np.array([0, 1, 2, 3, 4, 5, 0, 1, 2])
    fields = driver.solver.problem.fields
    start = (*box(2, 2), masters), {"velocity": fields.velocity, "pressure": fields.pressure, "scalars": []}
    with pytest.raises(ValueError, match="does not know"):
        driver.start(*start)
    driver.solver.periodic_sides = True
    driver.start(*start)
    assert driver.solver.problem.masters is masters
    assert driver.solver.problem.body_force.tolist() == [3, 0]


def test_a_problem_is_what_the_setup_says(driver):
    problem = driver.solver.problem
    warm, tracer = problem.scalars
    assert warm == data.Scalar("temperature", 1, 0.1, 0, 0, 2, 300, "monotone")
    assert tracer.name == "tracer" and tracer.wall_coefficient == 0
    assert [values[0] for values in problem.fields.scalars] == [300, 0]
    assert (problem.newton, problem.tolerance, problem.thin_cell_drag) == (2, 1e-9, 0.5)
    assert problem.gravity.tolist() == [0, -10]
    assert set(problem.boundaries) == {"x0", "x1", "y0", "y1"}


def test_a_step_is_what_its_columns_say(driver):
    one, vectors = np.ones(4), np.ones((4, 2))
    columns = dict.fromkeys(("volume", "drag", "mobility", "flux_mobility"), one)
    columns |= {"velocity": vectors, "flux_velocity": 2 * vectors, "cell": np.arange(4)}
    columns |= {"shape": np.full((4, 3), 1 / 3), "scalars": [(one, 2 * one, 3 * one), None]}
    motion = np.zeros((9, 2)), np.ones((9, 2))
    solution = driver.solve(0.1, "", columns, np.full(9, 0.5), motion)
    assert isinstance(solution, data.Solution)
    step = driver.solver.step
    heat, nothing = step.points.scalars
    assert nothing is None and (heat.coefficient[0], heat.mobility[0], heat.value[0]) == (1, 2, 3)
    assert step.points.flux_velocity[0, 0] == 2 and step.points.cell.tolist() == [0, 1, 2, 3]
    assert step.motion.velocity[0, 0] == 1 and step.voidage[0] == 0.5 and step.sources is None

    x0, x1, y0, y1 = step.conditions
    assert x0.flow.value.tolist() == [1, 2] and x0.scalar(0).value == 3
    assert x0.scalar(1) == data.Insulated()
    assert x1.flow == data.Open(4) and x1.scalar(0) == data.Outflow(None)
    assert y0.flow == data.Slip()
    assert y0.scalars == (data.Insulated(), data.Transfer(5, 6))
    assert y1.flow.value.shape == (9, 2) and isinstance(y1.flow, data.SuperficialVelocity)
    assert y1.scalar(0) == data.Outflow(9) and y1.scalar(1).value.shape == (9,)

    fewer = json.dumps(CONDITIONS[1:2])
    driver.solve(0.1, fewer, None, None, None)
    step = driver.solver.step
    assert [each.boundary for each in step.conditions] == ["x1"]
    assert step.points is None and step.motion is None and step.voidage.tolist() == [1.0] * 9
    driver.solve(0.2, "", None, None, None)
    assert len(driver.solver.step.conditions) == 1


def test_a_body_is_what_its_condition_says():
    described = {
        "centre": [1, 2],
        "radius": 3,
        "expansion": -4,
        "motion": {"free": {"inertia": [5, 6, 7, 8], "force": [9, 10]}},
        "evaporation": {"scalar": 0, "heat_flux": "gradient", "heat": 11, "latent": 12},
        "blowing": "interstitial",
        "solid": [13, 14, 15, 16, 17, 18],
    }
    condition = {"boundary": "drop", "flow": {"body": described}, "scalars": []}
    (found,) = adapter.conditions([condition])
    body = found.flow
    assert isinstance(body, data.Body) and isinstance(body.motion, data.Free)
    assert body.centre.tolist() == [1, 2] and (body.radius, body.expansion) == (3, -4)
    assert body.motion.inertia.tolist() == [[5, 7], [6, 8]]
    assert body.motion.force.tolist() == [9, 10]
    assert body.evaporation == data.Evaporation(0, 11, 12, "gradient")
    assert body.blowing == "interstitial"
    assert body.solid.tolist() == [[13, 14], [15, 16], [17, 18]]

    described |= {"motion": {"held": [1, 2]}, "evaporation": None, "solid": []}
    (found,) = adapter.conditions([condition])
    assert isinstance(found.flow.motion, data.Held)
    assert found.flow.motion.velocity.tolist() == [1, 2] and found.flow.evaporation is None
    assert found.flow.solid.shape == (0, 2)
    described["motion"] = {"tied": None}
    with pytest.raises(ValueError, match="the motion `tied` of a body"):
        adapter.conditions([condition])


def test_what_is_no_solution_is_told(driver):
    driver.solver.solve = lambda step: math.pi
    with pytest.raises(TypeError, match="returned float, it must return a Solution"):
        driver.solve(0.1, "", None, None, None)


@pytest.mark.parametrize("key", ["flow", "scalars"])
def test_a_condition_of_another_version_is_told(key):
    condition = {"boundary": "x0", "flow": "slip", "scalars": []}
    condition[key] = "sticky" if key == "flow" else ["sticky"]
    with pytest.raises(ValueError, match="`sticky`"):
        adapter.conditions([condition])
