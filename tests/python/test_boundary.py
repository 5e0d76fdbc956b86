"""What is held at the nodes of the boundary, and what passes its parts."""

import dataclasses

import numpy as np
import pytest
from voidage.boundary import Boundary, area_vectors, facet_rule
from voidage.points import complete
from voidage.solver import (
    Condition,
    Fields,
    Motion,
    NoSlip,
    Open,
    Scalar,
    Slip,
    Step,
    SuperficialVelocity,
    Value,
    Velocity,
)

from conftest import problem


def node(box, *x):
    return int(np.argmin(np.linalg.norm(box.points - x, axis=1)))


def boundary(box, conditions, voidage=None, motion=None):
    """The boundary where the fluid was at rest."""
    voidage = np.ones(len(box.points)) if voidage is None else voidage
    step = complete(box, Step(0.1, conditions, voidage, motion=motion))
    return Boundary(box, step, -step.motion.velocity)


def hold_velocity(*arguments):
    """What is held of the velocity."""
    free, value = boundary(*arguments).hold_flow()
    return free[:, :-1, :-1], value[:, :-1]


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
    free, value = hold_velocity(box, conditions, voidage)
    np.testing.assert_array_equal(value[node(box, 0, 0)], [0, 2])
    np.testing.assert_array_equal(value[node(box, 1, 0)], [0, 2])
    assert not free[node(box, 1, 0)].any()
    np.testing.assert_allclose(free[node(box, 1, 0.5)], [[0, 0], [0, 1]], atol=1e-15)
    np.testing.assert_array_equal(free[node(box, 0.5, 1)], np.eye(2))
    _, value = hold_velocity(box, conditions[::-1], voidage)
    np.testing.assert_array_equal(value[node(box, 0, 0)], [0, 0])


def test_slip_holds_every_direction_of_an_edge():
    box = problem(2, 3)
    conditions = [Condition(name, Slip()) for name in ("x0", "z0")]
    free, _ = hold_velocity(box, conditions)
    np.testing.assert_allclose(free[node(box, 0, 0.5, 0)], np.diag([0, 1, 0]), atol=1e-15)
    np.testing.assert_allclose(free[node(box, 0.5, 0.5, 0)], np.diag([1, 1, 0]), atol=1e-15)


def test_slip_averages_the_normals_of_a_smooth_wall():
    box = problem(2, 2)
    bent = box.points + np.outer(0.2 * box.points[:, 0] * (1 - box.points[:, 0]), [0, 1])
    bent = dataclasses.replace(box, points=bent)
    free, _ = hold_velocity(bent, [Condition("y0", Slip())])
    np.testing.assert_allclose(free[node(bent, 0.5, 0.05)], np.diag([1, 0]), atol=1e-15)


def test_a_closed_box_with_a_net_flux_is_refused():
    box = problem(3, 2)
    conditions = [Condition(name, NoSlip()) for name in box.boundaries]
    conditions[0] = Condition("x0", Velocity(np.array([1.0, 0.0])))
    with pytest.raises(ValueError, match="no boundary is open"):
        boundary(box, conditions).check_net_flux()
    conditions[1] = Condition("x1", Velocity(np.array([1.0, 0.0])))
    boundary(box, conditions).check_net_flux()


def test_the_later_value_wins():
    box = problem(2, 2)
    conditions = [
        Condition("x0", NoSlip(), (Value(300.0),)),
        Condition("y0", NoSlip(), (Value(310.0),)),
        Condition("x1", NoSlip()),
    ]
    free, value = boundary(box, conditions).hold_scalar(0)
    assert value[node(box, 0, 0), 0] == 310 and value[node(box, 0, 1), 0] == 300
    assert free[node(box, 1, 1), 0, 0] == 1 and free[node(box, 0, 0), 0, 0] == 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_facet_integrals_are_exact_to_degree_four(dimension):
    shape, share = facet_rule(dimension)
    # int phi^4 over a segment is 1/5, over a triangle 4! 2! / 6! of its measure.
    np.testing.assert_allclose(share @ shape**4, 1 / 5 if dimension == 2 else 1 / 15, rtol=1e-13)
    np.testing.assert_allclose(shape.sum(axis=1), 1, rtol=1e-14)
    box = problem(2, dimension)
    part = boundary(box, [Condition("y1", NoSlip())])
    # int x^2 y over the side y = 1 of a unit cube.
    x, y = part.at(box.points[:, 0]), part.at(box.points)[:, 1]
    assert np.sum(part.measure * x**2 * y) == pytest.approx(1 / 3, rel=1e-13)
    assert part.through(box.points).sum() == pytest.approx(1, rel=1e-13)


def test_a_force_belongs_to_the_last_that_fixes_a_node_or_to_the_walls_it_slides_along():
    box, count = problem(2, 2), 9
    conditions = [
        Condition("x0", NoSlip()),
        Condition("y0", Velocity(np.zeros(2))),
        Condition("x1", Slip()),
        Condition("y1", Slip()),
    ]
    rest, residual = Fields(np.zeros((count, 2)), np.zeros(count)), np.zeros((count, 2))

    def forces(x, y):
        residual[:] = 0
        residual[node(box, x, y)] = -2.0, -3.0
        found = boundary(box, conditions).balances(rest, residual, [])
        return {name: each.force.tolist() for name, each in found.items() if each.force.any()}

    assert forces(0, 0) == {"y0": [2, 3]} and forces(0, 1) == {"x0": [2, 3]}
    assert forces(1, 0) == {"y0": [2, 3]} and forces(1, 0.5) == {"x1": [2, 3]}
    corner = forces(1, 1)
    np.testing.assert_allclose(corner["x1"], [2, 0], atol=1e-14)
    np.testing.assert_allclose(corner["y1"], [0, 3], atol=1e-14)
    assert forces(0.5, 0.5) == {}


def test_a_moving_wall_passes_the_mixture_but_carries_nothing():
    box, count = problem(2, 2, scalars=(Scalar("tracer", 1.5, 0.1),)), 9
    state = Fields(np.zeros((count, 2)), np.zeros(count), (np.full(count, 2.0),))
    conditions = [Condition("x1", NoSlip()), Condition("x0", Open(7.0))]
    motion = Motion(box.points, np.tile([0.3, 0.0], (count, 1)))
    new = Fields(np.tile([-0.2, 0.0], (count, 1)), state.pressure, state.scalars)
    ends = boundary(box, conditions, np.full(count, 0.5), motion)
    found = ends.balances(new, np.zeros((count, 2)), [np.zeros(count)])
    assert found["x1"].flux == pytest.approx(0.3) and found["x1"].convected == (0.0,)
    assert found["x0"].flux == pytest.approx(0.5 * 0.2)
    assert found["x0"].convected[0] == pytest.approx(1.5 * 2.0 * 0.5 * 0.2)
    # The mesh leaves the fluid at rest behind: that is no inflow at x = 0, where w . n = 0.3 > 0.
    np.testing.assert_allclose(found["x0"].force, [-7.0, 0.0])
