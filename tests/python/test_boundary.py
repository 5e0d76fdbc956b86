"""What is held at the nodes of the boundary."""

import numpy as np
import pytest
from voidage.boundary import Holds, area_vectors, balance, hold_heat
from voidage.solver import (
    Condition,
    NoSlip,
    Open,
    Slip,
    Step,
    SuperficialVelocity,
    Temperature,
    Velocity,
)

from conftest import problem


def node(box, *x):
    return int(np.argmin(np.linalg.norm(box.points - x, axis=1)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_area_vectors_point_outward_and_close(dimension):
    box = problem(3, dimension)
    areas = {
        name: area_vectors(box.points, facets).sum(axis=0)
        for name, facets in box.boundaries.items()
    }
    for k in range(dimension):
        np.testing.assert_allclose(areas[f"{'xyz'[k]}1"], np.eye(dimension)[k], atol=1e-14)
        np.testing.assert_allclose(areas[f"{'xyz'[k]}0"], -np.eye(dimension)[k], atol=1e-14)


def test_the_later_velocity_wins_and_slip_frees_no_node():
    box, voidage = problem(2, 2), np.full(9, 0.5)
    stream = np.array([0.0, 1.0])
    conditions = [
        Condition("x0", NoSlip()),
        Condition("y0", SuperficialVelocity(stream)),
        Condition("x1", Slip()),
        Condition("y1", Open(0.0)),
    ]
    holds = Holds(box, conditions, voidage)
    np.testing.assert_array_equal(holds.value[node(box, 0, 0)], [0, 2])
    np.testing.assert_array_equal(holds.value[node(box, 1, 0)], [0, 2])
    assert holds.fixed[node(box, 1, 0)] and not holds.fixed[node(box, 1, 0.5)]
    np.testing.assert_allclose(holds.free[node(box, 1, 0.5)], [[0, 0], [0, 1]], atol=1e-15)
    np.testing.assert_array_equal(holds.free[node(box, 0.5, 1)], np.eye(2))
    turned = Holds(box, conditions[::-1], voidage)
    np.testing.assert_array_equal(turned.value[node(box, 0, 0)], [0, 0])


def test_slip_holds_every_direction_of_an_edge():
    box = problem(2, 3)
    holds = Holds(box, [Condition(name, Slip()) for name in ("x0", "z0")], np.ones(27))
    np.testing.assert_allclose(holds.free[node(box, 0, 0.5, 0)], np.diag([0, 1, 0]), atol=1e-15)
    np.testing.assert_allclose(holds.free[node(box, 0.5, 0.5, 0)], np.diag([1, 1, 0]), atol=1e-15)


def test_slip_averages_the_normals_of_a_smooth_wall():
    box = problem(2, 2)
    bent = box.points + np.outer(0.2 * box.points[:, 0] * (1 - box.points[:, 0]), [0, 1])
    bent = problem(2, 2).__class__(**{**vars(box), "points": bent})
    middle = node(bent, 0.5, 0.05)
    free = Holds(bent, [Condition("y0", Slip())], np.ones(9)).free[middle]
    np.testing.assert_allclose(free, np.diag([1, 0]), atol=1e-15)


def test_a_closed_box_with_a_net_flux_is_refused():
    box = problem(3, 2)
    conditions = [Condition(name, NoSlip()) for name in box.boundaries]
    conditions[0] = Condition("x0", Velocity(np.array([1.0, 0.0])))
    voidage = np.ones(16)
    with pytest.raises(ValueError, match="no boundary is open"):
        balance(box, Step(0.1, conditions, voidage))
    conditions[1] = Condition("x1", Velocity(np.array([1.0, 0.0])))
    net = balance(box, Step(0.1, conditions, voidage))
    assert abs(net) < 1e-15


def test_the_later_temperature_wins():
    box = problem(2, 2)
    conditions = [
        Condition("x0", NoSlip(), Temperature(300.0)),
        Condition("y0", NoSlip(), Temperature(310.0)),
    ]
    free, value = hold_heat(box, conditions)
    assert value[node(box, 0, 0), 0] == 310 and value[node(box, 0, 1), 0] == 300
    assert free[node(box, 1, 1), 0, 0] == 1 and free[node(box, 0, 0), 0, 0] == 0
