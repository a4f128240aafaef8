"""The triangular faces of tets, by connectivity alone."""

from __future__ import annotations

import numpy as np

from softcal.checks import Ints
from softcal.geometry.cell import cell_of


def all_faces(tets: Ints) -> Ints:
    """Four faces of each tet in order, (4 n_tets, 3 or 6)."""
    faces = cell_of(tets).faces
    return tets[:, faces].reshape(-1, len(faces[0]))


def outer_faces(tets: Ints) -> Ints:
    """Rows (k,) of `all_faces(tets)` that belong to a single tet, ascending."""
    keys = face_keys(all_faces(tets), int(tets.max(initial=-1)) + 1)
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    return np.sort(first[count == 1])


def face_keys(faces: Ints, n_points: int) -> Ints:
    """A number for each face (k,), equal for equal corners."""
    low, middle, high = np.sort(faces[:, :3], axis=1).T
    return (low * n_points + middle) * n_points + high
