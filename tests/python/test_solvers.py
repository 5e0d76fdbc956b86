"""Solutions that are known, and balances that close, on every solver that is installed."""

import dataclasses

import numpy as np
import pytest
from voidage.boundary import area_vectors
from voidage.cells import Cells
from voidage.points import complete
from voidage.solver import (
    Body,
    Condition,
    Evaporation,
    Fields,
    Free,
    Held,
    Motion,
    NoSlip,
    Open,
    Outflow,
    Scalar,
    Slip,
    Step,
    SuperficialVelocity,
    Transfer,
    Value,
    Velocity,
)

from conftest import problem, scatter, with_holes

WARM = Scalar("temperature", capacity=1.5, conductivity=0.1, reference=300.0)
TRACER = Scalar("tracer", capacity=1.0, conductivity=0.02)


def with_scalars(box, scalars, values, **changes):
    fields = dataclasses.replace(box.fields, scalars=tuple(values))
    return dataclasses.replace(box, fields=fields, scalars=tuple(scalars), **changes)


def everywhere(box, flow):
    return [Condition(name, flow) for name in box.boundaries]


def close(solver):
    """Relative error of what a solver leaves."""
    return 1e-7 if getattr(solver, "linear", "direct") == "iterative" else 1e-11


def at_points(box, points, nodal):
    """Nodal values at the points, and their gradients."""
    mesh, around = Cells(box.points, box.cells), nodal[box.cells[points.cell]]
    slope = np.einsum("qa...,qai->q...i", around, mesh.gradient[points.cell])
    return np.einsum("qa,qa...->q...", points.shape, around), slope


def force_on(box, points, fields):
    """Force of the fluid on all points, N."""
    u, _ = at_points(box, points, fields.velocity)
    _, slope = at_points(box, points, fields.pressure)
    forcing = points.drag[:, None] * u - points.volume[:, None] * slope
    law = points.velocity + points.mobility[:, None] * forcing
    return (forcing - points.drag[:, None] * law).sum(axis=0)


def given_to(box, points, fields, k):
    """What the fluid gives to all points of scalar k per time."""
    s, _ = at_points(box, points, fields.scalars[k])
    columns = points.scalars[k]
    law = columns.value + columns.mobility * columns.coefficient * s
    return np.sum(columns.coefficient * (s - law))


def paired(mesh, one, other):
    """Integrals over the cells of the product of nodal fields; the second may have components."""
    a, b = one[mesh.nodes], other[mesh.nodes]
    sums = np.einsum("ca,cb...->c...", a, b) + np.einsum("ca,ca...->c...", a, b)
    count = a.shape[1]
    return np.einsum("c,c...->c...", mesh.measure, sums) / (count * (count + 1))


@pytest.mark.parametrize("dimension", [2, 3])
def test_fluid_between_held_points_stays_at_rest(solver, rng, dimension):
    gravity = np.array([0.4, -9.81, 0.7][:dimension])
    box = problem(3, dimension, gravity=gravity, tolerance=1e-12)
    points, voidage = scatter(rng, box.points, box.cells, held=True)
    solver.set_mesh(box)
    fields = solver.solve(Step(0.1, everywhere(box, NoSlip()), voidage, points)).fields
    weight = box.density * gravity
    hydrostatic = box.points @ weight
    hydrostatic -= np.average(hydrostatic, weights=Cells(box.points, box.cells).nodal_volume)
    np.testing.assert_allclose(fields.pressure, hydrostatic, atol=1e-10)
    np.testing.assert_allclose(fields.velocity, 0, atol=1e-10)
    buoyancy = -points.volume.sum() * weight
    np.testing.assert_allclose(force_on(box, points, fields), buoyancy, rtol=1e-9)


FORMS = [(2, "consistent"), (2, "lumped"), (2, "monotone"), (3, "consistent")]


@pytest.mark.parametrize(("dimension", "form"), FORMS)
def test_what_passes_the_boundary_closes_the_balances(solver, rng, dimension, form):
    """Two scalars, points, a mesh that moves, and every kind of condition."""
    n, dt, drag = 4 if dimension == 2 else 2, 0.1, 0.5
    box = problem(n, dimension, gravity=np.array([0.3, -9.81, 0.5][:dimension]))
    jump = 0.05 / n * rng.standard_normal(box.points.shape)
    count = len(box.points)
    old = Fields(
        rng.standard_normal(box.points.shape),
        rng.standard_normal(count),
        tuple(300 + 5 * rng.random((2, count))),
    )
    warm = dataclasses.replace(WARM, expansion=0.003, wall_coefficient=0.7, wall_value=310.0)
    scalars = tuple(dataclasses.replace(scalar, form=form) for scalar in (warm, TRACER))
    box = dataclasses.replace(
        box, scalars=scalars, fields=old, thin_cell_drag=drag, tolerance=1e-13
    )
    points, voidage = scatter(rng, box.points + jump, box.cells, scalars=1)
    points = dataclasses.replace(points, scalars=(*points.scalars, None))
    stream = (1 + rng.random()) * np.eye(dimension)[0]
    conditions = [
        Condition("x0", SuperficialVelocity(stream), (Value(305.0), Value(1.0))),
        Condition("x1", Open(0.7), (Outflow(290.0), Outflow(None))),
        Condition("y0", Slip(), (Transfer(2.0, 280.0),)),
        Condition("y1", NoSlip(), (Value(295.0), Transfer(0.3, 2.0))),
        Condition("z0", Slip()),
        Condition("z1", Velocity(old.velocity), (Outflow(290.0), Value(old.scalars[1]))),
    ][: 2 * dimension]
    solver.set_mesh(box)
    motion = Motion(box.points + jump, jump / dt)
    solution = solver.solve(Step(dt, conditions, voidage, points, motion=motion))
    new, found = solution.fields, solution.balances
    moved = dataclasses.replace(box, points=motion.points)
    assert found.keys() == box.boundaries.keys()
    fluxes = np.array([each.flux for each in found.values()])
    assert abs(fluxes.sum()) < close(solver) * abs(fluxes).sum()

    mesh = Cells(moved.points, box.cells)
    wind, change = old.velocity - motion.velocity, new.velocity - old.velocity

    def carried(velocity, values):
        """int eps velocity . grad values."""
        slope = np.einsum("ca...,cai->c...i", values[box.cells], mesh.gradient)
        return np.einsum("ci,c...i->...", paired(mesh, voidage, velocity), slope)

    for k, scalar in enumerate(scalars):
        s, wall = new.scalars[k], scalar.wall_coefficient
        gain = s - old.scalars[k]
        lumped = mesh.nodal_volume @ (voidage * gain)
        stored = paired(mesh, voidage, gain).sum() if form == "consistent" else lumped
        parts = [
            scalar.capacity / dt * stored,
            scalar.capacity * carried(wind, s),
            wall * mesh.nodal_volume @ (s - scalar.wall_value),
            given_to(moved, points, new, k) if k == 0 else 0.0,
        ]
        given = [each.scalars[k] for each in found.values()]
        scale = np.abs(parts).sum()
        assert sum(given) == pytest.approx(sum(parts), abs=close(solver) * scale), scalar.name
        assert found["y1"].convected[k] == 0.0
        if dimension == 2 and k == 1:
            assert found["y0"].scalars[k] == found["x1"].scalars[k] == 0.0
    rho, heavy = box.density, 1 - warm.expansion * (new.scalars[0] - warm.reference)
    displaced = points.volume @ at_points(moved, points, heavy)[0]
    parts = [
        rho * (mesh.nodal_volume @ heavy - displaced) * box.gravity,
        -rho / dt * paired(mesh, voidage, change).sum(axis=0),
        -rho * (carried(wind, new.velocity) + carried(change, old.velocity)),
        -drag * mesh.nodal_volume @ new.velocity,
        -force_on(moved, points, new),
    ]
    force = np.sum([each.force for each in found.values()], axis=0)
    np.testing.assert_allclose(
        force, np.sum(parts, axis=0), rtol=0, atol=close(solver) * np.abs(parts).sum()
    )


def test_fluid_at_rest_weighs_on_its_walls(solver):
    """The fluid presses outward on every wall; those to slide along know whose force it is."""
    box = problem(4, 2, gravity=np.array([0.0, -9.81]), tolerance=1e-13)
    conditions = everywhere(box, Slip())
    conditions[3] = Condition("y1", Open(2.0))
    solver.set_mesh(box)
    found = solver.solve(Step(0.1, conditions, np.ones(25))).balances
    weight = box.density * 9.81
    sideways = 2 + weight / 2
    forces = {"x0": (-sideways, 0), "x1": (sideways, 0), "y0": (0, -2 - weight), "y1": (0, 2)}
    for name, force in forces.items():
        np.testing.assert_allclose(found[name].force, force, atol=1e-9 * weight)


def test_a_second_scalar_is_solved_like_the_first(solver, rng):
    box = problem(4, 2)
    points, voidage = scatter(rng, box.points, box.cells, scalars=2)
    same = dataclasses.replace(points, scalars=(points.scalars[0],) * 2)
    warm, cold = 300 + 5 * rng.random((2, len(box.points)))
    stream = Fields(rng.standard_normal(box.points.shape), box.fields.pressure)
    box = dataclasses.replace(box, fields=stream)
    alike = dataclasses.replace(WARM, name="alike")
    conditions = [
        Condition("x0", Open(0.0), (Outflow(290.0), Outflow(290.0))),
        Condition("x1", NoSlip(), (Value(305.0), Value(305.0))),
        Condition("y0", NoSlip(), (Transfer(2.0, 280.0), Transfer(2.0, 280.0))),
        Condition("y1", NoSlip()),
    ]
    solver.set_mesh(with_scalars(box, (WARM, alike), (warm, warm)))
    first, second = solver.solve(Step(0.1, conditions, voidage, same)).fields.scalars
    np.testing.assert_array_equal(first, second)
    # Neither knows of the other.
    solver.set_mesh(with_scalars(box, (TRACER, WARM), (cold, warm)))
    swapped = dataclasses.replace(points, scalars=points.scalars[::-1])
    alone = solver.solve(Step(0.1, conditions, voidage, swapped)).fields.scalars
    np.testing.assert_allclose(alone[1], first, rtol=1e-12)
    assert abs(alone[0] - first).max() > 0.1


def test_scalars_make_the_fluid_lighter_together(solver, rng):
    box = problem(4, 2, gravity=np.array([0.0, -9.81]), tolerance=1e-12)
    values, clear = 300 + 5 * rng.random(len(box.points)), np.ones(len(box.points))
    found = []
    for expansions in ((0.003,), (0.001, 0.002)):
        scalars = [dataclasses.replace(WARM, expansion=beta) for beta in expansions]
        solver.set_mesh(with_scalars(box, scalars, [values] * len(scalars)))
        found.append(solver.solve(Step(0.1, everywhere(box, NoSlip()), clear)).fields.velocity)
    assert abs(found[0]).max() > 1e-6
    np.testing.assert_allclose(*found, atol=1e-9 * abs(found[0]).max())


def test_a_step_starts_from_the_accepted_state(solver, rng):
    box = problem(4, 2, gravity=np.array([0.0, -9.81]))
    points, voidage = scatter(rng, box.points, box.cells)
    solver.set_mesh(box)
    step = Step(0.1, everywhere(box, NoSlip()), voidage, points)
    first = solver.solve(step).fields.velocity
    solver.solve(dataclasses.replace(step, dt=0.3))
    again = solver.solve(step).fields.velocity
    np.testing.assert_array_equal(first, again)
    solver.accept()
    moved = solver.solve(step).fields.velocity
    assert np.abs(moved - first).max() > 1e-6 * np.abs(first).max()


def test_no_points_are_as_none(solver):
    box = problem(3, 2, gravity=np.array([0.0, -9.81]))
    clear = np.ones(len(box.points))
    solver.set_mesh(box)
    states = []
    step = Step(0.1, everywhere(box, NoSlip()), clear)
    for each in (complete(box, step), step):
        states.append(solver.solve(each).fields.pressure)
    np.testing.assert_array_equal(*states)


def test_a_stream_through_open_boundaries(solver):
    """A plug between slip walls.

    The pressure falls by gamma_l U per length, and by rho U^2 where fluid enters.
    """
    U, drag, wall, dt = np.array([0.7, 0.0]), 3.0, 2.0, 0.1
    box = problem(5, 2, thin_cell_drag=drag)
    start = np.full(len(box.points), 300.0)
    pressure = 0.4 + drag * U[0] * (1 - box.points[:, 0])
    stream = Fields(np.tile(U, (len(pressure), 1)), np.zeros_like(pressure))
    warm = dataclasses.replace(WARM, wall_coefficient=wall, wall_value=310.0)
    box = dataclasses.replace(box, fields=stream, tolerance=1e-12)
    solver.set_mesh(with_scalars(box, [warm], [start]))
    # Between walls at 310 K all fluid warms alike, C (T - 300) / dt = lambda (310 - T), if what
    # enters is as warm.
    rate = WARM.capacity / dt
    T = (300 * rate + 310 * wall) / (rate + wall)
    conditions = [
        Condition("y0", Slip()),
        Condition("y1", Slip(), (Transfer(0.5, T),)),
        Condition("x0", Open(0.4 + drag * U[0] + box.density * U[0] ** 2), (Outflow(T),)),
        Condition("x1", Open(0.4), (Outflow(None),)),
    ]
    solution = solver.solve(Step(dt, conditions, np.ones(len(pressure))))
    np.testing.assert_allclose(solution.fields.velocity, stream.velocity, atol=1e-10)
    np.testing.assert_allclose(solution.fields.pressure, pressure, rtol=1e-10)
    np.testing.assert_allclose(solution.fields.scalars[0], T, rtol=1e-12)
    entering, leaving = (solution.balances[name] for name in ("x0", "x1"))
    assert leaving.flux == pytest.approx(U[0]) and entering.flux == pytest.approx(-U[0])
    assert leaving.convected[0] == pytest.approx(WARM.capacity * U[0] * T)
    # The fluid that enters takes up the momentum rho U^2, which the pressure there gives it.
    np.testing.assert_allclose(leaving.force, [0.4, 0], atol=1e-9)
    np.testing.assert_allclose(entering.force, [-0.4 - drag * U[0], 0], atol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_uniform_stream_on_a_moving_mesh(solver, rng, dimension):
    """However the nodes move, uniform flow and temperature stay so: inflow, outflow, walls with slip."""
    U, dt = np.eye(dimension)[0] * 2, 0.05
    box = problem(4, dimension, tolerance=1e-12)
    stream = np.tile(U, (len(box.points), 1))
    box = dataclasses.replace(box, fields=Fields(stream, box.fields.pressure))
    solver.set_mesh(with_scalars(box, [WARM], [np.full(len(box.points), 310.0)]))
    conditions = [Condition(name, Slip()) for name in box.boundaries]
    conditions[0] = Condition("x0", Velocity(U))
    conditions[1] = Condition("x1", Open(0.0), (Outflow(300.0),))
    clear, points = np.ones(len(box.points)), box.points
    for _ in range(3):
        jump = 0.08 * (rng.random(points.shape) - 0.5)
        for k in range(dimension):
            for at in (0.0, 1.0):
                # Walls and ends stay plane; the outflow moves back and forth.
                jump[box.points[:, k] == at, k] = (k == 0) * at * 0.05 * rng.random()
        velocity = (box.points + jump - points) / dt
        points = box.points + jump
        found = solver.solve(Step(dt, conditions, clear, motion=Motion(points, velocity))).fields
        solver.accept()
        np.testing.assert_allclose(found.velocity, stream, atol=1e-9)
        np.testing.assert_allclose(found.pressure, 0, atol=1e-9)
        np.testing.assert_allclose(found.scalars[0], 310.0, atol=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_body_that_grows_pushes_the_fluid_out(solver, dimension):
    """Of a body as large as a disc of its radius, 2 pi r rdot."""
    width, rdot, middle = 1 / 3, 0.7, np.full(dimension, 0.5)
    box = with_holes(problem(6, dimension, tolerance=1e-13), width, body=middle)
    radius = width / np.sqrt(np.pi)
    motion = Held(np.zeros(dimension))
    body = Body(middle, radius, rdot, motion, None, np.zeros((0, dimension)))
    conditions = [Condition(name, NoSlip()) for name in box.boundaries]
    conditions[1], conditions[-1] = Condition("x1", Open(0.0)), Condition("body", body)
    solver.set_mesh(box)
    solution = solver.solve(Step(0.1, conditions, np.ones(len(box.points))))
    found, grows = solution.balances, dimension * width**dimension / radius * rdot
    if dimension == 2:
        assert grows == pytest.approx(2 * np.pi * radius * rdot, rel=1e-15)
    assert found["body"].flux == pytest.approx(-grows, rel=1e-12)
    assert found["x1"].flux == pytest.approx(grows, rel=close(solver))
    surface = np.unique(box.boundaries["body"])
    pushed = rdot / radius * (box.points[surface] - middle)
    np.testing.assert_allclose(solution.fields.velocity[surface], pushed, atol=close(solver))
    (answer,) = solution.bodies
    assert answer.vapour == 0 and not answer.velocity.any()


def conducted(points, cells, facets, voidage, values):
    """-int eps grad s . n over facets, cell by cell."""
    total = 0.0
    for facet, area in zip(facets, area_vectors(points, facets), strict=True):
        (cell,) = [each for each in cells if set(facet) <= set(each)]
        edges, jumps = points[cell[1:]] - points[cell[0]], values[cell[1:]] - values[cell[0]]
        total -= voidage[facet].mean() * (np.linalg.solve(edges, jumps) @ area)
    return total


@pytest.mark.parametrize("dimension", [2, 3])
def test_bodies_move_and_boil_by_what_the_fluid_gives_them(solver, rng, dimension):
    """Two that are free and one that is held, in a stream with points, on a mesh that moves."""
    n, dt = 7, 0.1
    width, axis = 1 / n, np.eye(dimension)[0]
    middle = np.full(dimension, 0.5)
    centres = {"left": middle - 2 * width * axis, "right": middle, "held": middle}
    centres["held"] = middle + 2 * width * axis
    gravity = np.array([0.3, -9.81, 0.5][:dimension])
    box = with_holes(problem(n, dimension, gravity=gravity), width, **centres)
    count, zero = len(box.points), np.zeros(dimension)
    jump = 0.05 / n * rng.standard_normal(box.points.shape)
    old = Fields(
        rng.standard_normal(box.points.shape),
        rng.standard_normal(count),
        tuple(300 + 5 * rng.random((2, count))),
    )
    scalars = dataclasses.replace(WARM, form="monotone", expansion=0.003), TRACER
    box = dataclasses.replace(box, scalars=scalars, fields=old, newton=2, tolerance=1e-13)
    points, voidage = scatter(rng, box.points + jump, box.cells, scalars=1)
    points = dataclasses.replace(points, scalars=(*points.scalars, None))
    voidage[box.boundaries["left"][0]] = 0.01

    # The iterative solver does not solve what these make of the velocities in space.
    chosen = dimension == 2 or close(solver) < 1e-8
    flux = "gradient" if chosen else "reaction"

    def body(name, motion, boils):
        solid = 0.001 * rng.standard_normal(box.boundaries[name].shape)
        blowing = "interstitial" if chosen and name == "right" else "superficial"
        return Body(centres[name], 0.4 * width, 0.1 * rng.random(), motion, boils, solid, blowing)

    def free():
        inertia = rng.standard_normal((dimension, dimension)) + 3 * np.eye(dimension)
        return Free(inertia, 0.1 * rng.standard_normal(dimension))

    bodies = {
        "left": body("left", free(), Evaporation(0, 2.0, 900.0, flux)),
        "right": body("right", free(), Evaporation(None, 2.0, 900.0)),
        "held": body("held", Held(0.1 * rng.random(dimension)), Evaporation(1, 0.0, 90.0)),
    }
    conditions = [Condition(name, Slip()) for name in box.boundaries if name not in bodies]
    conditions[0] = Condition("x0", SuperficialVelocity(axis), (Value(305.0), Value(1.0)))
    conditions[1] = Condition("x1", Open(0.7), (Outflow(290.0), Outflow(None)))
    at_surface = Value(350.0), Value(2.0)
    conditions += [Condition(name, each, at_surface) for name, each in bodies.items()]
    solver.set_mesh(box)
    motion = Motion(box.points + jump, jump / dt)
    solution = solver.solve(Step(dt, conditions, voidage, points, motion=motion))
    new, found = solution.fields, solution.balances
    fluxes = np.array([each.flux for each in found.values()])
    assert abs(fluxes.sum()) < close(solver) * abs(fluxes).sum()

    for (name, body), answer in zip(bodies.items(), solution.bodies, strict=True):
        facets, balance, boils = box.boundaries[name], found[name], body.evaporation
        if isinstance(body.motion, Free):
            given = body.motion.force + balance.force
            scale = abs(body.motion.force).max() + abs(balance.force).max()
            np.testing.assert_allclose(
                body.motion.inertia @ answer.velocity, given, atol=close(solver) * scale
            )
        else:
            np.testing.assert_array_equal(answer.velocity, body.motion.velocity)
        heat = 0.0 if boils.scalar is None else -balance.scalars[boils.scalar]
        if boils.heat_flux == "gradient":
            heat = conducted(motion.points, box.cells, facets, voidage, new.scalars[0])
            heat *= WARM.conductivity
        assert answer.vapour == pytest.approx((heat + boils.heat) / boils.latent, rel=1e-12)
        assert answer.vapour != 0

        area = area_vectors(motion.points, facets)
        measure = np.linalg.norm(area, axis=1)
        s, blowing = (motion.points - body.centre) / body.radius, answer.vapour / measure.sum()
        moves = answer.velocity + body.expansion * s
        outward = s / np.linalg.norm(s, axis=1, keepdims=True)
        interstitial = body.blowing == "interstitial"
        faster = np.ones(count) if interstitial else 1 / np.maximum(voidage, 0.05)
        blown = blowing * faster[:, None] * outward
        held, scale = np.unique(facets), abs(new.velocity).max()
        np.testing.assert_allclose(
            new.velocity[held], (moves + blown)[held], rtol=0, atol=close(solver) * scale
        )

        eps, w = voidage[facets], np.einsum("kai,ki->ka", moves[facets], area)
        pairs = eps.sum(axis=1) * w.sum(axis=1) + (eps * w).sum(axis=1)
        arrives = blowing * (measure @ eps.mean(axis=1)) if interstitial else answer.vapour
        passes = pairs.sum() / (dimension * (dimension + 1)) + body.solid.sum() - arrives
        assert balance.flux == pytest.approx(passes, abs=1e-12 * abs(fluxes).sum())
        for k, scalar in enumerate(scalars if not interstitial else ()):
            carried = -scalar.capacity * blowing * (measure @ new.scalars[k][facets].mean(axis=1))
            assert balance.convected[k] == pytest.approx(carried, rel=1e-12)


def test_a_body_as_heavy_as_the_fluid_rests_in_it(solver):
    """In a closed box, where nothing but the body knows how fast it may move."""
    gravity, width, middle = np.array([0.4, -9.81]), 1 / 3, np.full(2, 0.5)
    box = with_holes(problem(6, 2, gravity=gravity, tolerance=1e-13), width, body=middle)
    weight = box.density * width**2 * gravity
    motion = Free(box.density * width**2 / 0.1 * np.eye(2), weight)
    body = Body(middle, 0.2, 0.0, motion, None, np.zeros((0, 2)))
    conditions = [Condition(name, NoSlip()) for name in box.boundaries]
    conditions[-1] = Condition("body", body)
    solver.set_mesh(box)
    solution = solver.solve(Step(0.1, conditions, np.ones(len(box.points))))
    np.testing.assert_allclose(solution.balances["body"].force, -weight, rtol=1e-7)
    np.testing.assert_allclose(solution.fields.velocity, 0, atol=1e-7)
    np.testing.assert_allclose(solution.bodies[0].velocity, 0, atol=1e-7)
