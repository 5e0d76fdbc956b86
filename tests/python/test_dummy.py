"""The solver that users copy."""

import numpy as np
from voidage.dummy import STREAM, Dummy
from voidage.solver import Fields, Step

from conftest import problem, scatter


def test_the_dummy_is_a_stream_with_hydrostatic_pressure(rng):
    box = problem(3, 2, gravity=np.array([0.0, -9.81]))
    points, voidage = scatter(rng, box.points, box.cells)
    solver = Dummy()
    solver.set_mesh(box)
    solution = solver.solve(Step(0.1, [], voidage, points))
    assert isinstance(solution.fields, Fields) and solution.balances == {}
    np.testing.assert_allclose(solution.fields.velocity, np.tile([0, STREAM], (16, 1)))
    np.testing.assert_allclose(solution.fields.pressure, box.points @ (box.density * box.gravity))
    solver.accept()
    assert solver.state is solution.fields
