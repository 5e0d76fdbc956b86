"""The solver that users copy."""

import dataclasses

import numpy as np
from voidage.dummy import STREAM, Dummy
from voidage.solver import Step

from conftest import problem, scatter


def test_the_dummy_gives_its_stream_to_the_grains(rng):
    box = problem(3, 2, gravity=np.array([0.0, -9.81]))
    grains, pieces, voidage = scatter(rng, box.points, box.cells)
    grains = dataclasses.replace(grains, heat=None)
    solver = Dummy()
    solver.set_mesh(box)
    at, report = solver.solve(Step(0.1, [], voidage, grains, pieces))
    np.testing.assert_allclose(at.velocity, np.tile([0, STREAM], (len(grains.volume), 1)))
    weight = box.density * box.gravity
    np.testing.assert_allclose(at.pressure_gradient[:, 1], weight[1])
    law = grains.velocity + grains.mobility[:, None] * (
        grains.drag[:, None] * at.velocity - np.outer(grains.volume, weight)
    )
    force = grains.drag @ (at.velocity - law) - grains.volume.sum() * weight
    np.testing.assert_allclose(report.force, force)
    solver.accept()
    np.testing.assert_allclose(solver.fields().pressure, box.points @ weight)
