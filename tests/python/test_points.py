"""The matrices of the points against the exchange written out point by point and cell by cell."""

import dataclasses

import numpy as np
import pytest
from voidage.cells import Cells
from voidage.points import PointSums, complete
from voidage.solver import Fields, Scalar, Step

from conftest import problem, scatter


@pytest.fixture(params=[2, 3])
def case(request, rng):
    """Mesh, points with one scalar, sums, and random fields."""
    box = problem(3, request.param)
    mesh = Cells(box.points, box.cells)
    points, _ = scatter(rng, box.points, box.cells, scalars=1)
    count = len(box.points)
    fields = Fields(
        rng.standard_normal(box.points.shape),
        rng.standard_normal(count),
        (300 + rng.standard_normal(count),),
    )
    return box, mesh, points, PointSums(mesh, points), fields


def each_point(mesh, points, fields):
    """Number, shape functions, cell, nodes, gradients, u, grad p and s of every point."""
    for q, (cell, phi) in enumerate(zip(points.cell, points.shape, strict=True)):
        nodes, gradient = mesh.nodes[cell], mesh.gradient[cell]
        u, s = phi @ fields.velocity[nodes], phi @ fields.scalars[0][nodes]
        yield q, phi, cell, nodes, gradient, u, fields.pressure[nodes] @ gradient, s


def weighting(box, mesh, fields, rng):
    """xi and xi U of a stabilisation."""
    xi = rng.random(len(box.cells))
    return xi, xi[:, None] * mesh.mean(fields.velocity)


def test_flow_matrices_are_the_exchange_tested(case, rng):
    box, mesh, points, sums, fields = case
    xi, xi_U = weighting(box, mesh, fields, rng)
    weight, v, q = (
        rng.standard_normal(box.points.shape),
        rng.standard_normal(box.points.shape),
        rng.standard_normal(len(box.points)),
    )
    old = dataclasses.replace(fields, velocity=rng.standard_normal(box.points.shape))
    matrix, rhs = sums.flow(xi, xi_U, box.density, weight, old)
    unknown = np.column_stack((fields.velocity, fields.pressure)).ravel()
    tested = np.column_stack((v, q)).ravel() @ (matrix @ unknown - rhs)

    apart = within_cells(mesh, points, old)
    expected, forces = 0.0, nodal_forces(mesh, points, apart)
    for i, phi, _, around, gradient, _, slope, _ in each_point(mesh, points, fields):
        gamma, V = points.drag[i], points.volume[i]
        u = phi @ fields.velocity[around]
        of_flux = points.flux_velocity[i] + points.flux_mobility[i] * (gamma * u - V * slope)
        # Drag with the velocities of the nodes less the shared shear, all else at the point, the law too.
        drag = gamma * (phi @ ((fields.velocity[around] - apart[i]) * v[around]).sum(axis=1))
        law = points.velocity[i] + points.mobility[i] * (gamma * u - V * slope)
        force = V * slope + gamma * law - V * (phi @ weight[around])
        expected += drag - force @ (phi @ v[around]) - V * of_flux @ (q[around] @ gradient)
    for cell, around in enumerate(mesh.nodes):
        gradient, (solid, left_solid, drag, force) = mesh.gradient[cell], forces
        slope = fields.pressure[around] @ gradient
        weighed = v[around].T @ gradient @ xi_U[cell] + q[around] @ gradient * xi[cell] / box.density
        residual = drag[around, None] * fields.velocity[around] - left_solid[around, None] * slope
        residual += solid[around, None] * weight[around] - force[around]
        expected += mesh.measure[cell] * residual.mean(axis=0) @ weighed
    assert tested == pytest.approx(expected, rel=1e-12)


def within_cells(mesh, points, last):
    """H (x_a - x_q) at the nodes of the cell of each point, H the shear that the points share there."""
    u, v = np.zeros((2, *points.velocity.shape))
    for i, phi, _, around, _, velocity, slope, _ in each_point(mesh, points, last):
        forcing = points.drag[i] * velocity - points.volume[i] * slope
        u[i], v[i] = velocity, points.flux_velocity[i] + points.flux_mobility[i] * forcing
    x = np.array([phi @ mesh.places[cell] for cell, phi in zip(points.cell, points.shape, strict=True)])
    # K_u : K_u and K_v : K_u of all points in the cells around each node.
    sums = np.zeros((len(last.velocity), 3))
    for node in range(len(sums)):
        inside = np.isin(points.cell, np.flatnonzero((mesh.nodes == node).any(axis=1)))
        w = points.drag[inside]
        if w.sum() > 0:
            U, V, X = (f[inside] - w @ f[inside] / w.sum() for f in (u, v, x))
            K_u, K_v = (U.T * w) @ X, (V.T * w) @ X
            sums[node] = (K_u * K_u).sum() / w.sum(), (K_v * K_u).sum() / w.sum(), w.sum()
    apart = []
    for i, cell in enumerate(points.cell):
        own, shared, weight = sums[mesh.nodes[cell]].sum(axis=0)
        gradient = last.velocity[mesh.nodes[cell]].T @ mesh.gradient[cell]
        # Points in one place tell nothing of a gradient.
        own += weight * (0.01 * mesh.size[cell] ** 2 * np.linalg.norm(gradient)) ** 2
        s = min(max(shared / own, 0), 1)
        H = s * (2 - s) * gradient
        apart.append([H @ (place - x[i]) for place in mesh.places[cell]])
    return np.array(apart)


def nodal_forces(mesh, points, apart):
    """Sums over the points with phi_a over int phi_a: of V, of V and gamma that the law leaves, of
    gamma (b + H (x_a - x_q))."""
    count = len(mesh.nodal_volume)
    scalars, force = np.zeros((3, count)), np.zeros((count, points.velocity.shape[1]))
    for i, (cell, phi) in enumerate(zip(points.cell, points.shape, strict=True)):
        gamma, V = points.drag[i], points.volume[i]
        left = 1 - points.mobility[i] * gamma
        for node, share, moving in zip(mesh.nodes[cell], phi, apart[i], strict=True):
            share = share / mesh.nodal_volume[node]
            scalars[:, node] += share * V, share * V * left, share * gamma * left
            force[node] += share * gamma * (points.velocity[i] + moving)
    return *scalars, force


def test_matrices_of_a_scalar_are_the_exchange_tested(case, rng):
    box, mesh, points, sums, fields = case
    (_, xi_U), S = weighting(box, mesh, fields, rng), rng.standard_normal(len(box.points))
    matrix, rhs = sums.scalar(0, xi_U, lumped=False)
    tested = S @ (matrix @ fields.scalars[0] - rhs)
    expected, columns = 0.0, points.scalars[0]
    for i, phi, cell, around, gradient, _, _, s in each_point(mesh, points, fields):
        h = columns.coefficient[i]
        law = columns.value[i] + columns.mobility[i] * h * s
        expected += h * (s - law) * (phi @ S[around] + S[around] @ gradient @ xi_U[cell])
    assert tested == pytest.approx(expected, rel=1e-12)


def test_a_lumped_scalar_exchanges_at_the_nodes(case, rng):
    box, mesh, points, sums, fields = case
    (_, xi_U), S = weighting(box, mesh, fields, rng), rng.standard_normal(len(box.points))
    matrix, rhs = sums.scalar(0, xi_U, lumped=True)
    tested = S @ (matrix @ fields.scalars[0] - rhs)
    expected, columns = 0.0, points.scalars[0]
    for i, phi, cell, around, gradient, _, _, s in each_point(mesh, points, fields):
        h, nodal = columns.coefficient[i], fields.scalars[0][around]
        law = columns.value[i] + columns.mobility[i] * h * s
        expected += h * (phi * (nodal - law)) @ S[around]
        expected += h * (s - law) * (S[around] @ gradient @ xi_U[cell])
    assert tested == pytest.approx(expected, rel=1e-12)


def test_lumping_moves_nothing_between_points_and_fluid(case):
    _, mesh, _, sums, _ = case
    still = np.zeros((len(mesh.nodes), mesh.gradient.shape[2]))
    (lumped, given), (matrix, rhs) = (sums.scalar(0, still, kind) for kind in (True, False))
    np.testing.assert_allclose(lumped.sum(axis=1), matrix.sum(axis=1), rtol=1e-13)
    np.testing.assert_array_equal(given, rhs)
    # No value beside the diagonal pushes its neighbour away.
    assert (lumped.toarray() * (1 - np.eye(len(rhs))) <= 0).all()


def test_what_the_fluid_loses_the_points_gain(case):
    box, mesh, points, sums, fields = case
    # Tests that are one everywhere leave the sum over all points.
    still = np.zeros(len(box.cells)), np.zeros((len(box.cells), box.dimension))
    matrix, rhs = sums.flow(*still, box.density, np.zeros_like(box.points), fields)
    unknown = np.column_stack((fields.velocity, fields.pressure))
    lost = (matrix @ unknown.ravel() - rhs).reshape(unknown.shape)[:, :-1].sum(axis=0)
    gained = []
    for i, _, _, _, _, u, slope, _ in each_point(mesh, points, fields):
        forcing = points.drag[i] * u - points.volume[i] * slope
        gained.append(forcing - points.drag[i] * (points.velocity[i] + points.mobility[i] * forcing))
    scale = np.linalg.norm(gained, axis=1).sum()
    np.testing.assert_allclose(lost, np.sum(gained, axis=0), atol=1e-13 * scale)


def test_a_scalar_that_is_not_exchanged_and_no_points(case, rng):
    box, mesh, points, _, fields = case
    xi, xi_U = weighting(box, mesh, fields, rng)
    sums = PointSums(mesh, dataclasses.replace(points, scalars=(None,)))
    matrix, rhs = sums.scalar(0, xi_U, lumped=False)
    assert matrix.nnz == 0 and not rhs.any()
    box = dataclasses.replace(box, scalars=(Scalar("tracer", 1.0, 0.1),))
    none = PointSums(mesh, complete(box, Step(0.1, (), np.ones(len(box.points)))).points)
    flow = none.flow(xi, xi_U, box.density, fields.velocity, fields)
    for matrix, rhs in (flow, none.scalar(0, xi_U, lumped=True)):
        assert matrix.shape == 2 * rhs.shape and matrix.nnz == 0 and not rhs.any()
    np.testing.assert_array_equal(none.solid_flux(fields), np.zeros_like(box.points))


def test_the_solid_flux_keeps_its_integral(case):
    box, mesh, points, sums, _ = case
    rest = Fields(np.zeros_like(box.points), np.ones(len(box.points)))
    flux = mesh.nodal_volume @ sums.solid_flux(rest)
    np.testing.assert_allclose(flux, points.volume @ points.flux_velocity, rtol=1e-12)
