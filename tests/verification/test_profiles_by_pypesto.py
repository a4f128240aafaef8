"""Profile likelihoods against pyPESTO's, on the same problem with the same noise."""

from __future__ import annotations

import numpy as np
import pytest
from interval_cases import curved, values

from softcal.calibration.interval_studies.profile import profile

pytest.importorskip("pypesto", reason="pyPESTO, a peer of the benchmarks, is not installed")
RISE = 1.959964**2


def test_the_ends_are_those_of_pypesto():
    import pypesto
    import pypesto.optimize
    import pypesto.profile

    problem = curved()
    theta = values(problem)
    space = problem.space

    def half(z: np.ndarray) -> float:
        return float(problem.evaluate(space.to_model(np.clip(z, 0, 1))).loss) / 2

    def gradient(z: np.ndarray) -> np.ndarray:
        z = np.clip(z, 0, 1)
        found = problem.evaluate(space.to_model(z), jacobian=True)
        return np.asarray(found.gradient) * space.jacobian(z) / 2

    theirs = pypesto.Problem(
        objective=pypesto.Objective(fun=half, grad=gradient),
        lb=np.zeros(space.size),
        ub=np.ones(space.size),
        x_guesses=[space.to_search(theta)],
    )
    optimizer = pypesto.optimize.ScipyOptimizer(method="L-BFGS-B", options={"ftol": 1e-14, "gtol": 1e-9})
    result = pypesto.optimize.minimize(theirs, optimizer=optimizer, n_starts=1, progress_bar=False)
    result = pypesto.profile.parameter_profile(
        theirs,
        result,
        optimizer,
        profile_index=np.array([0]),
        profile_options={"default_step_size": 0.01, "ratio_min": 0.1},
        progress_bar=False,
    )
    curve = result.profile_result.list[0][0]
    places, rises = curve.x_path[0], -2 * np.log(np.maximum(curve.ratio_path, 1e-300))
    least = int(np.argmin(rises))
    # The profile is close to a parabola, so that its root is close to a straight line.
    roots = np.sqrt(np.maximum(rises, 0.0))
    low = np.interp(-np.sqrt(RISE), -roots[: least + 1], places[: least + 1])
    high = np.interp(np.sqrt(RISE), roots[least:], places[least:])

    ours = profile(problem, theta)
    label = space.labels[0]
    ends = ours.intervals[label].found
    assert ends is not None
    found = [space.to_search({**theta, label: end})[0] for end in ends]
    assert found == pytest.approx([low, high], abs=0.005 * (high - low))
    assert len(places) > 10
