"""Solids of revolution swept from a half section."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.geometry.quality import check_quality, require_sound
from softcal.geometry.surface import boundary_faces
from softcal.geometry.sweep import sweep


def rectangle(inner: float, outer: float, height: float, columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """A grid of quadratic triangles in (r, z)."""
    r, z = np.meshgrid(np.linspace(inner, outer, 2 * columns + 1), np.linspace(0, height, 2 * rows + 1), indexing="ij")
    number = np.arange(r.size).reshape(r.shape)
    triangles = []
    for i in range(0, 2 * columns, 2):
        for j in range(0, 2 * rows, 2):
            n = number[i : i + 3, j : j + 3]
            triangles.append([n[0, 0], n[2, 0], n[2, 2], n[1, 0], n[2, 1], n[1, 1]])
            triangles.append([n[0, 0], n[2, 2], n[0, 2], n[1, 1], n[1, 2], n[0, 1]])
    return np.stack([r.ravel(), z.ravel()], axis=1), np.array(triangles)


@settings(max_examples=20, deadline=None)
@given(
    st.sampled_from([0.0, 0.4]),
    st.integers(1, 3),
    st.integers(1, 3),
    st.sampled_from([4, 6, 8, 12]),
    st.floats(0.5, 2.0),
)
def test_swept_rectangles_are_sound_tubes_and_cylinders(inner, columns, rows, sectors, height):
    mesh = sweep(*rectangle(inner, 1.0, height, columns, rows), sectors=sectors)
    report = require_sound(mesh)
    assert report.n_duplicate_nodes == 0
    on_axis = 0 if inner else rows
    assert mesh.n_tets == sectors * (6 * columns * rows - 3 * on_axis)
    faces = boundary_faces(mesh)
    a, b, c = (mesh.points[faces[:, i]] for i in range(3))
    assert np.cross(b - a, c - a).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    volume = math.pi * (1.0 - inner**2) * height
    assert report.volume == pytest.approx(volume, rel={4: 2e-2, 6: 4e-3, 8: 2e-3, 12: 3e-4}[sectors])


def test_the_curved_surface_is_met_by_every_node():
    mesh = sweep(*rectangle(0.0, 1.0, 1.0, 2, 2), sectors=6)
    r = np.linalg.norm(mesh.points[:, :2], axis=1)
    assert np.round(r, 12).tolist() == pytest.approx(np.round(4 * r).astype(int) / 4)
    surface = mesh.points[np.unique(boundary_faces(mesh))]
    inside = (surface[:, 2] > 1e-9) & (surface[:, 2] < 1 - 1e-9)
    assert np.linalg.norm(surface[inside, :2], axis=1) == pytest.approx(1.0)


def test_the_error_of_the_volume_falls_with_the_fourth_power_of_the_sectors():
    errors = [
        1.0 - check_quality(sweep(*rectangle(0.0, 1.0, 1.0, 1, 1), sectors=sectors)).volume / math.pi
        for sectors in (8, 16)
    ]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
