"""Centrelines: nodes, triads and arc lengths."""

import math
from dataclasses import replace

import numpy as np
import pytest

from softcal.errors import InputError
from softcal.geometry.centreline import Centreline, helix, polyline, spaced, straight


def assert_triads_are_rotations(line: Centreline) -> None:
    assert np.swapaxes(line.triads, 1, 2) @ line.triads == pytest.approx(np.tile(np.eye(3), (len(line.nodes), 1, 1)))
    assert np.linalg.det(line.triads) == pytest.approx(np.ones(len(line.nodes)))


def test_a_straight_rod():
    line = straight((0, 0, 0), (0, 3, 4), [0.0, 0.2, 1.0], first=(1, 5, 5))
    assert line.nodes[1] == pytest.approx([0.0, 0.6, 0.8])
    assert line.lengths == pytest.approx([1.0, 4.0])
    assert line.stations == pytest.approx([0.0, 1.0, 5.0])
    assert line.triads[2, :, 2] == pytest.approx([0.0, 0.6, 0.8])
    assert line.triads[0, :, 0] @ np.array([1.0, 5.0, 5.0]) > 0.0
    assert_triads_are_rotations(line)


@pytest.mark.parametrize("left_handed", [False, True])
def test_a_helix_climbs_around_its_axis(left_handed):
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    line = helix(
        (1, 0, 0), axis, diameter=2.0, pitch=0.5, turns=2.25, at=90, towards=(0, 1, 0), left_handed=left_handed
    )
    from_axis = line.nodes - [1.0, 0.0, 0.0]
    height = from_axis @ axis
    radial = from_axis - height[:, None] * axis
    assert height == pytest.approx(np.linspace(0.0, 2.25 * 0.5, 91))
    assert np.linalg.norm(radial, axis=1) == pytest.approx(np.ones(91))
    assert radial[0] @ np.array([0.0, 1.0, 0.0]) > 0.0
    turning = np.cross(radial[:-1], radial[1:]) @ axis
    assert np.all(turning < 0.0 if left_handed else turning > 0.0)
    assert line.lengths.sum() == pytest.approx(2.25 * math.hypot(2.0 * math.pi, 0.5))
    assert line.triads[:, :, 0] == pytest.approx(-radial)
    chords = np.diff(line.nodes, axis=0)
    along = (chords * (line.triads[1:, :, 2] + line.triads[:-1, :, 2])).sum(axis=1)
    assert along == pytest.approx(2.0 * np.linalg.norm(chords, axis=1), rel=4e-3)
    assert_triads_are_rotations(line)


def test_a_polyline_on_a_circle_is_the_circle():
    angle = np.array([0.0, 0.3, 0.4, 0.9, 1.3])
    points = 2.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    line = polyline(points, first=(0, 0, 1))
    assert line.lengths == pytest.approx(2.0 * np.diff(angle))
    assert line.triads[:, :, 2] == pytest.approx(np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1))
    assert line.triads[:, :, 0] == pytest.approx(np.tile([0.0, 0.0, 1.0], (5, 1)))
    assert_triads_are_rotations(line)


def test_a_polyline_through_a_helix_does_not_twist():
    exact = helix((0, 0, 0), (0, 0, 1), diameter=2.0, pitch=1.0, turns=1.0, at=200)
    line = polyline(exact.nodes)
    assert line.lengths.sum() == pytest.approx(exact.lengths.sum(), rel=1e-5)
    assert line.triads[:, :, 2] == pytest.approx(exact.triads[:, :, 2], abs=2e-3)
    relative = np.swapaxes(line.triads[:-1], 1, 2) @ line.triads[1:]
    twist = 0.5 * (relative[:, 1, 0] - relative[:, 0, 1])
    assert np.abs(twist).max() < 1e-5  # Frenet's triad twists by 1e-2 per element
    assert polyline([(0, 0, 0), (0, 0, 2)]).lengths == pytest.approx([2.0])


def test_elements_are_spaced_through_stations():
    assert spaced([0.5], 0.25) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    fractions = spaced([0.1, 0.11, 1.0], 0.3)
    assert {0.1, 0.11} <= set(fractions)
    assert np.diff(fractions).max() <= 0.3
    assert len(spaced([], 2.0)) == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: straight((0, 0, 0), (0, 0, 0), 1), "ends coincide"),
        (lambda: straight((0, 0, 0), (0, 0, 1), 0), "too few elements of a rod"),
        (lambda: straight((0, 0, 0), (0, 0, 1), [0.0, 0.5, 0.5, 1.0]), "not in order"),
        (lambda: straight((0, 0, 0), (0, 0, 1), [0.0, 0.5]), "not in order"),
        (lambda: straight((0, 0, 0), (0, 0, 1), 1, first=(0, 0, 2)), "along the tangent"),
        (lambda: helix((0, 0, 0), (0, 0, 0), diameter=1, pitch=1, turns=1, at=9), "no direction"),
        (lambda: helix((0, 0, 0), (0, 0, 1), diameter=0, pitch=1, turns=1, at=9), "diameter must be positive"),
        (
            lambda: helix((0, 0, 0), (0, 0, 1), diameter=1, pitch=-1, turns=1, at=9),
            "pitch must not be negative",
        ),
        (
            lambda: helix((0, 0, 0), (0, 0, 1), diameter=1, pitch=1, turns=0, at=9),
            "turns must be positive",
        ),
        (lambda: polyline([(0, 0, 0), (0, 0, 0)]), "all different"),
        (lambda: polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)]), "point 1: .* 90 deg"),
        (lambda: spaced([1.5], 0.1), "not on the rod"),
        (lambda: spaced([], 0.0), "must have a length"),
        (lambda: Centreline(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), [0.0]), "coincide"),
        (lambda: replace(straight((0, 0, 0), (0, 0, 1), 2), nodes=[[0, 0, 0], [0, 0, 5], [0, 0, 10]]), "shorter than"),
        (lambda: Centreline(np.eye(3)[:2], np.ones((2, 3, 3)), [1.0]), "no rotation"),
        (lambda: Centreline(np.eye(3)[:1], np.eye(3)[None], []), "two nodes or more"),
    ],
)
def test_bad_centrelines_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
