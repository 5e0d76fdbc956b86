"""Grains cut by a mesh."""

import numpy as np
import pytest
import voidage

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
CELLS = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_disc_on_the_diagonal_is_cut_in_halves():
    overlap = voidage.Overlap(SQUARE, CELLS)
    first, cell, shape, share = overlap.cut([[0.5, 0.5], [0.8, 0.2]], [0.1, 0.05])
    assert first.tolist() == [0, 2, 3] and cell.tolist() == [0, 1, 0]
    np.testing.assert_allclose(share, [0.5, 0.5, 1.0], rtol=1e-12)
    # The centroid of a half disc lies 4 r / (3 pi) from its diameter.
    distance = 4 * 0.1 / (3 * np.pi) / np.sqrt(2)
    centroid = np.einsum("qa,qai->qi", shape, SQUARE[CELLS[cell]])
    expected = [[0.5 + distance, 0.5 - distance], [0.5 - distance, 0.5 + distance], [0.8, 0.2]]
    np.testing.assert_allclose(centroid, expected, rtol=1e-12)
    volume = np.pi * np.array([0.1, 0.05]) ** 2
    nodal = np.array([1 / 3, 1 / 6, 1 / 3, 1 / 6])
    voidage_ = overlap.voidage(volume)
    np.testing.assert_allclose(((1 - voidage_) * nodal).sum(), volume.sum(), rtol=1e-12)


def test_no_grains():
    first, cell, shape, share = voidage.Overlap(SQUARE, CELLS).cut(np.zeros((0, 2)), [])
    assert first.tolist() == [0] and len(cell) == len(share) == 0 and shape.shape == (0, 3)


@pytest.mark.parametrize(
    ("points", "cells", "text"),
    [
        (SQUARE, CELLS + 1, "names node 4, there are 4 points"),
        (SQUARE, CELLS[:, ::-1], "negatively oriented"),
        (SQUARE, CELLS[:, :2], r"must have \(m, 3\)"),
        (SQUARE[:, :1], CELLS, r"must have \(n, 2\)"),
        (np.vstack([SQUARE, [[2.0, 2.0]]]), CELLS, "node 4 belongs to no cell"),
    ],
)
def test_wrong_meshes(points, cells, text):
    with pytest.raises(ValueError, match=text):
        voidage.Overlap(points, cells)


def test_wrong_grains():
    overlap = voidage.Overlap(SQUARE, CELLS)
    with pytest.raises(ValueError, match="`radius` has shape"):
        overlap.cut([[0.5, 0.5]], [0.1, 0.1])
    with pytest.raises(RuntimeError, match="outside"):
        overlap.cut([[1.5, 0.5]], [0.1])
    overlap.cut([[0.5, 0.5]], [0.1])
    with pytest.raises(ValueError, match="2 volumes, 1 grains"):
        overlap.voidage([0.1, 0.1])
