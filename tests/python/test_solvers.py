"""Solutions that are known, on every solver that is installed."""

import dataclasses

import numpy as np
import pytest
from voidage.cells import Cells
from voidage.solver import (
    Condition,
    Fields,
    Grains,
    Heat,
    Motion,
    Newton,
    NoSlip,
    Open,
    OpenHeat,
    Pieces,
    Slip,
    Step,
    Velocity,
)

from conftest import problem, scatter

WARM = Heat(capacity=1.5, conductivity=0.1, expansion=0.0, reference=300.0)


def with_temperature(box, temperature, **changes):
    fields = Fields(box.fields.velocity, box.fields.pressure, temperature)
    return dataclasses.replace(box, fields=fields, heat=WARM, **changes)


def everywhere(box, flow):
    return [Condition(name, flow) for name in box.boundaries]


@pytest.mark.parametrize("dimension", [2, 3])
def test_fluid_between_held_grains_stays_at_rest(solver, rng, dimension):
    gravity = np.array([0.4, -9.81, 0.7][:dimension])
    box = problem(3, dimension, gravity=gravity, tolerance=1e-12)
    grains, pieces, voidage = scatter(rng, box.points, box.cells, held=True)
    grains = dataclasses.replace(grains, heat=None)
    solver.set_mesh(box)
    at, report = solver.solve(Step(0.1, everywhere(box, NoSlip()), voidage, grains, pieces))
    solver.accept()
    weight = box.density * gravity
    hydrostatic = Cells(box.points, box.cells).centred(box.points @ weight)
    np.testing.assert_allclose(solver.fields().pressure, hydrostatic, atol=1e-10)
    np.testing.assert_allclose(solver.fields().velocity, 0, atol=1e-10)
    buoyancy = -grains.volume.sum() * weight
    np.testing.assert_allclose(report.force, buoyancy, rtol=1e-9)
    np.testing.assert_allclose(
        at.pressure_gradient, np.tile(weight, (len(grains.volume), 1)), rtol=1e-9
    )


@pytest.mark.parametrize("lumped", [True, False])
def test_momentum_and_heat_given_are_those_received(solver, rng, lumped):
    box = problem(6, 2, gravity=np.array([0.0, -9.81]))
    box = with_temperature(box, 300 + 5 * rng.random(len(box.points)))
    box = dataclasses.replace(box, heat=dataclasses.replace(box.heat, lumped=lumped))
    grains, pieces, voidage = scatter(rng, box.points, box.cells)
    solver.set_mesh(box)
    dt = 0.1
    at, report = solver.solve(Step(dt, everywhere(box, NoSlip()), voidage, grains, pieces))
    solver.accept()
    gamma, V, a = (column[:, None] for column in (grains.drag, grains.volume, grains.mobility))
    law = grains.velocity + a * (gamma * at.velocity - V * at.pressure_gradient)
    force = gamma * (at.velocity - law) - V * at.pressure_gradient
    scale = np.linalg.norm(force, axis=1).sum()
    np.testing.assert_allclose(force.sum(axis=0), report.force, atol=1e-12 * scale)
    columns, T = grains.heat, at.temperature
    heat = columns.coefficient * (
        T - columns.temperature - columns.mobility * columns.coefficient * T
    )
    assert heat.sum() == pytest.approx(report.heat, abs=1e-12 * abs(heat).sum())
    # Nothing flows yet, the walls are adiabatic: what the grains got, the fluid lost.
    mesh = Cells(box.points, box.cells)
    change = solver.fields().temperature - box.fields.temperature
    pairs = (mesh.mean(voidage * change) + 3 * mesh.mean(voidage) * mesh.mean(change)) / 4
    stored = mesh.nodal_volume @ (voidage * change) if lumped else mesh.measure @ pairs
    gained = WARM.capacity / dt * stored
    assert gained == pytest.approx(-report.heat, rel=1e-6 if iterative(solver) else 1e-11)


def iterative(solver):
    return getattr(solver, "linear", "direct") == "iterative"


def test_a_step_starts_from_the_accepted_state(solver, rng):
    box = problem(4, 2, gravity=np.array([0.0, -9.81]))
    grains, pieces, voidage = scatter(rng, box.points, box.cells)
    grains = dataclasses.replace(grains, heat=None)
    solver.set_mesh(box)
    step = Step(0.1, everywhere(box, NoSlip()), voidage, grains, pieces)
    first, _ = solver.solve(step)
    solver.solve(dataclasses.replace(step, dt=0.3))
    again, _ = solver.solve(step)
    np.testing.assert_array_equal(first.velocity, again.velocity)
    np.testing.assert_array_equal(solver.fields().velocity, 0)
    solver.accept()
    moved, _ = solver.solve(step)
    assert np.abs(moved.velocity - first.velocity).max() > 1e-6 * np.abs(first.velocity).max()


def test_no_grains_are_as_none(solver):
    box = problem(3, 2, gravity=np.array([0.0, -9.81]))
    empty, clear = np.zeros(0), np.ones(len(box.points))
    grains = Grains(empty, empty, empty, np.zeros((0, 2)))
    pieces = Pieces(np.zeros(1, int), np.zeros(0, int), np.zeros((0, 3)), empty)
    solver.set_mesh(box)
    states = []
    for extra in ((grains, pieces), ()):
        at, _ = solver.solve(Step(0.1, everywhere(box, NoSlip()), clear, *extra))
        assert at.velocity.shape == (0, 2)
        states.append(solver.next.pressure)
    np.testing.assert_array_equal(*states)


def test_a_stream_through_open_boundaries(solver):
    """A plug between slip walls.

    The pressure falls by gamma_l U per length, and by rho U^2 where fluid enters.
    """
    U, drag, wall, dt = np.array([0.7, 0.0]), 3.0, 2.0, 0.1
    box = problem(5, 2, thin_cell_drag=drag)
    box = with_temperature(box, np.full(len(box.points), 300.0), tolerance=1e-12)
    pressure = 0.4 + drag * U[0] * (1 - box.points[:, 0])
    fields = Fields(np.tile(U, (len(pressure), 1)), np.zeros_like(pressure), box.fields.temperature)
    heat = dataclasses.replace(WARM, wall_coefficient=wall, wall_temperature=310.0)
    solver.set_mesh(dataclasses.replace(box, fields=fields, heat=heat))
    # Between walls at 310 K all fluid warms alike, C (T - 300) / dt = lambda (310 - T), if what
    # enters is as warm.
    rate = WARM.capacity / dt
    T = (300 * rate + 310 * wall) / (rate + wall)
    conditions = [
        Condition("y0", Slip()),
        Condition("y1", Slip(), Newton(0.5, T)),
        Condition("x0", Open(0.4 + drag * U[0] + box.density * U[0] ** 2), OpenHeat(T)),
        Condition("x1", Open(0.4), OpenHeat(None)),
    ]
    solver.solve(Step(dt, conditions, np.ones(len(pressure))))
    solver.accept()
    np.testing.assert_allclose(solver.fields().velocity, fields.velocity, atol=1e-10)
    np.testing.assert_allclose(solver.fields().pressure, pressure, rtol=1e-10)
    np.testing.assert_allclose(solver.fields().temperature, T, rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_uniform_stream_on_a_moving_mesh(solver, rng, dimension):
    """However the nodes move, uniform flow and temperature stay so: inflow, outflow, walls with slip."""
    U, dt = np.eye(dimension)[0] * 2, 0.05
    box = problem(4, dimension, tolerance=1e-12)
    box = with_temperature(box, np.full(len(box.points), 310.0))
    stream = np.tile(U, (len(box.points), 1))
    solver.set_mesh(dataclasses.replace(box, fields=Fields(stream, box.fields.pressure, 310.0 + 0 * box.points[:, 0])))
    conditions = [Condition(name, Slip()) for name in box.boundaries]
    conditions[0] = Condition("x0", Velocity(U))
    conditions[1] = Condition("x1", Open(0.0), OpenHeat(300.0))
    clear, points = np.ones(len(box.points)), box.points
    for _ in range(3):
        jump = 0.08 * (rng.random(points.shape) - 0.5)
        for k in range(dimension):
            for at in (0.0, 1.0):
                # Walls and ends stay plane; the outflow moves back and forth.
                jump[box.points[:, k] == at, k] = (k == 0) * at * 0.05 * rng.random()
        velocity = (box.points + jump - points) / dt
        points = box.points + jump
        solver.solve(Step(dt, conditions, clear, motion=Motion(points, velocity)))
        solver.accept()
        found = solver.fields()
        np.testing.assert_allclose(found.velocity, stream, atol=1e-9)
        np.testing.assert_allclose(found.pressure, 0, atol=1e-9)
        np.testing.assert_allclose(found.temperature, 310.0, atol=1e-8)
