"""Orthographic views of shapes: view directions, and a body's visible outline and faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.ring import across

_ALONG = 0.999  # cosine from which a direction counts as that of an axis


@dataclass(frozen=True)
class View:
    """A view along the third of three directions: right and up in the picture, with their names."""

    right: Floats
    up: Floats
    right_name: str
    up_name: str

    def flat(self, points: Floats) -> Floats:
        """Points (n, 3) [m] in the picture (n, 2) [mm]."""
        return 1e3 * points @ np.stack([self.right, self.up], axis=1)


def two_views(points: Floats, up: Floats) -> tuple[View, View]:
    """Two views of points (n, 3): the widest one, and the one turned by 90 degrees about `up`."""
    vertical, name = _named(up, "up")
    others: list[Floats] = [axis for axis in np.eye(3) if abs(axis @ vertical) < 1.0 - _ALONG]
    if len(others) < 2:
        first = across(vertical)
        second = np.cross(vertical, first)
        others = [first, np.asarray(second / np.linalg.norm(second), dtype=np.float64)]
    wide, narrow = sorted(others, key=lambda axis: -float(np.ptp(points @ axis)))
    return (
        View(*_pair(wide, vertical, "across", name)),
        View(*_pair(narrow, vertical, "across, turned by 90 deg", name)),
    )


def outline(flat: Floats, triangles: Ints) -> Ints:
    """Silhouette edges (k, 2) of a closed surface in a picture of its points `flat` (n, 2)."""
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    facing = area > 0.0
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    sides = np.tile(facing, 3)
    unique, place = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    fronts = np.bincount(place.ravel(), weights=sides, minlength=len(unique))
    return np.asarray(unique[fronts == 1], dtype=np.int64)


def _named(direction: Floats, fallback: str) -> tuple[Floats, str]:
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        if abs(axis @ direction) > _ALONG:
            return axis * np.sign(axis @ direction), name
    return direction, fallback


def _pair(right: Floats, up: Floats, fallback: str, up_name: str) -> tuple[Floats, Floats, str, str]:
    right, name = _named(right, fallback)
    return right, up, name, up_name
