"""The length of a cable: exact, but for via points that have met."""

import numpy as np
import pytest

from softcal.mechanics.cable import cables_of
from softcal.mechanics.cable_routes import build_cables
from softcal.mechanics.layout import FREE, Layout
from softcal.mechanics.segments import MET
from softcal.mechanics.system import build_system

X = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.3, 0.0]])


def term():
    via = [[(0, 1.0)], [(1, 1.0)], [(1, 0.5), (2, 0.5)]]
    return build_cables(X, {"front": via}, np.array([True]))


def nearer(part: float):
    """The first two points, at a part of the distance below which they have met."""
    x = X.copy()
    x[1] = part * MET * 0.2 * np.array([0.6, 0.64, 0.48])
    return x


def gradient(cable, x):
    return cable.segments.gradient(cable.segments.shape(x), np.ones(2), x.size)


@pytest.mark.parametrize("part", [1.0, 1.5, 40.0])
def test_a_length_is_that_of_the_polyline(part: float) -> None:
    x = nearer(part)
    middle = 0.5 * (x[1] + x[2])
    exact = np.linalg.norm(x[1] - x[0]) + np.linalg.norm(middle - x[1])
    assert term().lengths(x)[0] == pytest.approx(exact, rel=1e-15)
    assert term().rest_length[0] == pytest.approx(0.35, rel=1e-15)


@pytest.mark.parametrize("part", [0.0, 0.3, 0.99, 1.01, 3.0])
def test_its_gradient_is_the_lengths(part: float) -> None:
    cable, x, h = term(), nearer(part), 1e-9
    found = gradient(cable, x)
    for i in range(6):
        step = np.zeros(9)
        step[i] = h
        step = step.reshape(3, 3)
        slope = (cable.lengths(x + step)[0] - cable.lengths(x - step)[0]) / (2.0 * h)
        assert found[i] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("part", [0.0, 0.3, 0.99, 1.01, 3.0])
def test_its_tangent_is_the_gradients(part: float) -> None:
    """With the same tension everywhere; the tangent is given as an upper triangle."""
    x, h, T = nearer(part), 1e-8, 2.0
    system = build_system(Layout(X, np.full(3, FREE), np.zeros((0, 3)), 0, 1), (term(),))
    cable, pattern = cables_of(system), system.pattern
    data, force = np.zeros(pattern.size), np.zeros(9)
    cable.segments.pull(cable.segments.shape(x), np.full(2, T), force, data)
    np.testing.assert_allclose(force, T * gradient(cable, x), atol=1e-12)
    K = np.zeros((9, 9))
    K[pattern.rows, pattern.indices] = data[: pattern.nnz]
    K = np.triu(K) + np.triu(K, 1).T
    for i in range(9):
        step = np.zeros(9)
        step[i] = h
        step = step.reshape(3, 3)
        column = T * (gradient(cable, x + step) - gradient(cable, x - step)) / (2.0 * h)
        np.testing.assert_allclose(K[:, i], column, rtol=1e-5, atol=1e-3)


def test_what_has_met_is_named() -> None:
    assert term().at_limit(nearer(0.5)) == "via points 1 and 2 of front have met (0.1 mm apart, 200 mm at rest)"
    assert term().at_limit(nearer(2.0)) == ""
