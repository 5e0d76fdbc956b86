"""The matrices of the grains against the exchange written out piece by piece."""

import numpy as np
import pytest
from voidage.cells import Cells, Stabilisation
from voidage.pieces import PieceSums
from voidage.solver import Fields

from conftest import problem, scatter


@pytest.fixture(params=[2, 3])
def case(request, rng):
    """Mesh, grains, sums, and random fields."""
    box = problem(3, request.param)
    mesh = Cells(box.points, box.cells)
    grains, pieces, _ = scatter(rng, box.points, box.cells)
    count = len(box.points)
    fields = Fields(
        rng.standard_normal(box.points.shape),
        rng.standard_normal(count),
        300 + rng.standard_normal(count),
    )
    return box, mesh, grains, pieces, PieceSums(mesh, pieces, grains), fields


def each_piece(mesh, pieces, fields):
    """Grain, share of it, shape functions, cell, gradients, u, grad p and T of every piece."""
    for grain in range(len(pieces.first) - 1):
        for q in range(pieces.first[grain], pieces.first[grain + 1]):
            cell, phi = pieces.cell[q], pieces.shape[q]
            nodes, gradient = mesh.nodes[cell], mesh.gradient[cell]
            u, T = phi @ fields.velocity[nodes], phi @ fields.temperature[nodes]
            yield (
                grain,
                pieces.share[q],
                phi,
                cell,
                gradient,
                u,
                fields.pressure[nodes] @ gradient,
                T,
            )


def test_flow_matrices_are_the_exchange_tested(case, rng):
    box, mesh, grains, pieces, sums, fields = case
    tau = Stabilisation(box, mesh, fields.velocity, 0.1, np.zeros(len(box.cells)))
    weight, v, q = (
        rng.standard_normal(box.points.shape),
        rng.standard_normal(box.points.shape),
        rng.standard_normal(len(box.points)),
    )
    matrix, rhs = sums.flow(tau, box.density, weight)
    nodes = box.cells[sums.cells]
    unknown = np.column_stack((fields.velocity, fields.pressure))[nodes]
    test = np.column_stack((v, q))[nodes]
    tested = np.einsum("cai,caibj,cbj->", test, matrix, unknown) - np.einsum("cai,cai->", test, rhs)

    expected = 0.0
    for i, s, phi, cell, gradient, u, slope, _ in each_piece(mesh, pieces, fields):
        gamma, V = grains.drag[i], grains.volume[i]
        law = grains.velocity[i] + grains.mobility[i] * (gamma * u - V * slope)
        force = V * slope - gamma * (u - law)
        around = box.cells[cell]
        slope_v, slope_q = v[around].T @ gradient, q[around] @ gradient
        weighed = (
            slope_v @ tau.direction[cell] * tau.time[cell] + slope_q * tau.time[cell] / box.density
        )
        expected -= s * force @ (phi @ v[around] + weighed) + s * V * law @ slope_q
        displaced = s * V * (phi @ weight[around])
        expected += displaced @ (phi @ v[around] + weighed)
    assert tested == pytest.approx(expected, rel=1e-12)


def test_energy_matrices_are_the_exchange_tested(case, rng):
    box, mesh, grains, pieces, sums, fields = case
    U, xi, S = (
        mesh.mean(fields.velocity),
        rng.random(len(box.cells)),
        rng.standard_normal(len(box.points)),
    )
    matrix, rhs = sums.energy(U, xi)
    nodes = box.cells[sums.cells]
    tested = np.einsum("ca,cab,cb->", S[nodes], matrix, fields.temperature[nodes]) - np.sum(
        S[nodes] * rhs
    )
    expected = 0.0
    for i, s, phi, cell, gradient, _, _, T in each_piece(mesh, pieces, fields):
        hA, around = grains.heat.coefficient[i], box.cells[cell]
        law = grains.heat.temperature[i] + grains.heat.mobility[i] * hA * T
        expected += (
            s * hA * (T - law) * (phi @ S[around] + xi[cell] * (S[around] @ gradient @ U[cell]))
        )
    assert tested == pytest.approx(expected, rel=1e-12)


def test_what_the_fluid_loses_the_grains_gain(case):
    box, mesh, grains, _, sums, fields = case
    # Tests that are one everywhere leave the sum over all grains.
    still = Stabilisation(box, mesh, np.zeros_like(box.points), 0.1, np.zeros(len(box.cells)))
    matrix, rhs = sums.flow(still, box.density, np.zeros_like(box.points))
    unknown = np.column_stack((fields.velocity, fields.pressure))[box.cells[sums.cells]]
    lost = (np.einsum("caibj,cbj->cai", matrix, unknown) - rhs)[..., :-1].sum(axis=(0, 1))
    force, heat = sums.exchanged(fields)
    at = sums.sample(fields)
    gamma, V, a = (column[:, None] for column in (grains.drag, grains.volume, grains.mobility))
    law = grains.velocity + a * (gamma * at.velocity - V * at.pressure_gradient)
    gained = gamma * (at.velocity - law) - V * at.pressure_gradient
    scale = np.linalg.norm(gained, axis=1).sum()
    np.testing.assert_allclose(gained.sum(axis=0), force, atol=1e-13 * scale)
    np.testing.assert_allclose(lost, force, atol=1e-13 * scale)
    columns = grains.heat
    warmed = columns.coefficient * (
        at.temperature
        - columns.temperature
        - columns.mobility * columns.coefficient * at.temperature
    )
    assert heat == pytest.approx(warmed.sum(), abs=1e-13 * abs(warmed).sum())


def test_linear_fields_are_sampled_at_the_centroid(case, rng):
    box, _, _, pieces, sums, _ = case
    slope = rng.standard_normal(box.dimension)
    linear = box.points @ slope
    at = sums.sample(Fields(np.outer(linear, np.ones(box.dimension)), linear, linear))
    piece = np.einsum("qa,qai->qi", pieces.shape, box.points[box.cells[pieces.cell]])
    centroid = np.add.reduceat(pieces.share[:, None] * piece, pieces.first[:-1])
    np.testing.assert_allclose(at.temperature, centroid @ slope, rtol=1e-12)
    np.testing.assert_allclose(at.velocity[:, 0], centroid @ slope, rtol=1e-12)
    np.testing.assert_allclose(at.pressure_gradient, np.tile(slope, (len(centroid), 1)), rtol=1e-11)


def test_the_solid_flux_keeps_its_integral(case):
    box, mesh, grains, _, sums, _ = case
    rest = Fields(np.zeros_like(box.points), np.ones(len(box.points)))
    flux = mesh.nodal_volume @ sums.solid_flux(rest)
    np.testing.assert_allclose(flux, grains.volume @ grains.velocity, rtol=1e-12)
