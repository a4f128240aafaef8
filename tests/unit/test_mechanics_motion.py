"""The points' and frames' motion by the unknowns."""

import numpy as np
from mechanics_cases import column_robot, twin_and_theta

from softcal.mechanics.state import moved, rest_state


def test_rates_of_a_state_are_those_of_differences():
    """Of free points, points on the plate, the plate's pose, pressures and efforts."""
    twin, _ = twin_and_theta(column_robot("P2P1", divisions=(1, 1, 2)))
    layout, rng = twin.system.layout, np.random.default_rng(2)
    state = moved(layout, rest_state(layout), 0.2 * rng.uniform(-1.0, 1.0, layout.n_unknowns))
    dz, h = rng.uniform(-1.0, 1.0, layout.n_unknowns), 1e-5
    motion = twin.system.motion
    found, ends = motion.rates(state, dz, motion.matrix(state)), [moved(layout, state, s * h * dz) for s in (1, -1)]
    for name in ("x", "position", "rotation", "pressure", "effort"):
        one, other, rate = (getattr(at, name) for at in (*ends, found))
        assert np.abs(rate).max() > 0.01, name
        np.testing.assert_allclose(rate, (one - other) / (2.0 * h), rtol=0.0, atol=1e-8, err_msg=name)


def test_blocks_of_points_on_the_unknowns_are_the_products_with_the_motion():
    """Of free and fixed points, and of points on the plate."""
    twin, _ = twin_and_theta(column_robot("P2P1", divisions=(1, 1, 2)))
    layout, motion, rng = twin.system.layout, twin.system.motion, np.random.default_rng(5)
    state = moved(layout, rest_state(layout), 0.2 * rng.uniform(-1.0, 1.0, layout.n_unknowns))
    n, size = layout.n_points, layout.first_effort_unknown
    rows, columns = (np.sort(rng.integers(0, n, (2, 200)), axis=0)).reshape(2, -1)
    blocks = rng.normal(size=(200, 3, 3))
    own = rows == columns
    assert np.any(own)
    assert np.any(np.isin(rows, layout.links.followers) & ~own)
    blocks[own] += np.swapaxes(blocks[own], 1, 2)
    K = np.zeros((n, 3, n, 3))
    np.add.at(K.transpose(0, 2, 1, 3), (rows, columns), blocks)
    np.add.at(K.transpose(2, 0, 3, 1), (rows[~own], columns[~own]), blocks[~own])
    P = motion.matrix(state).toarray()[: 3 * n]
    values, (u, v) = motion.reduce_blocks(state, blocks, rows, columns)
    upper = np.zeros((size, size))
    np.add.at(upper, (u, v), values)
    np.testing.assert_allclose(upper, np.triu(P.T @ K.reshape(3 * n, 3 * n) @ P), atol=1e-12)
