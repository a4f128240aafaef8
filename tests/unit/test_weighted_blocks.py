"""Blocks by weighted sums of points, as blocks by the points."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from softcal.mechanics.weighted_blocks import blocks_on_points


@pytest.mark.parametrize("seed", range(8))
def test_blocks_on_points_are_the_products_of_the_weights(seed: int):
    """Also of edges and vertices, and with points that several corners share."""
    chance = np.random.default_rng(seed)
    n, n_points, m = 30, 25, int(chance.integers(0, 60))
    W = sp.csr_matrix(chance.normal(size=(n, n_points)) * (chance.random((n, n_points)) < 0.2))
    groups = np.array([chance.permutation(n)[:4] for _ in range(m)], dtype=np.int64).reshape(-1, 4)
    blocks = chance.normal(size=(m, 12, 12))
    blocks += np.swapaxes(blocks, 1, 2)
    dense = np.zeros((3 * n, 3 * n))
    for k, missing in enumerate(chance.integers(0, 3, m)):
        groups[k, 4 - missing :] = -1
        blocks[k, 12 - 3 * missing :] = blocks[k, :, 12 - 3 * missing :] = 0.0
        place = (3 * groups[k, : 4 - missing, None] + np.arange(3)).ravel()
        dense[np.ix_(place, place)] += blocks[k, : len(place), : len(place)]
    parts = W.indptr.astype(np.int64), W.indices.astype(np.int64), np.asarray(W.data, dtype=float)
    rows, columns, out = blocks_on_points(groups, blocks, *parts, n_points)
    assert np.all(rows <= columns)
    assert np.all(np.diff(rows * n_points + columns) > 0)
    whole = np.zeros((n_points, n_points, 3, 3))
    whole[rows, columns] = out
    whole[columns, rows] = np.swapaxes(out, 1, 2)
    spread = np.kron(W.toarray(), np.eye(3))
    exact = (spread.T @ dense @ spread).reshape(n_points, 3, n_points, 3).transpose(0, 2, 1, 3)
    np.testing.assert_allclose(whole, exact, atol=1e-12)
