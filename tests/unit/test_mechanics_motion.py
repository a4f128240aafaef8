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
