"""A neck meshed on a grid, from its outline alone: the same tets at all lengths, by which alone two necks differ."""

import numpy as np

from softcal.geometry.bellows import _triangles
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.geometry.sweep import sweep

SECTORS = 6
N = 3  # elements between two planes or cylinders
RATIO = 0.4  # length of an element over that of the next one further from a waist


def grid_neck(neck: Neck) -> TetMesh:
    """Quadratic tets, small at the waists. The columns around the core become alike towards the end of a dome."""
    core, ends = 0.5 * neck.waist_diameter, np.append(0.0, np.cumsum(RATIO ** np.arange(N)))
    towards = np.interp(np.arange(2 * N + 1) / 2, np.arange(N + 1), ends / ends[-1])
    away, even = 1.0 - towards[::-1], np.linspace(0.0, 1.0, 2 * N + 1)
    patches: list[np.ndarray] = []

    def add(r: np.ndarray, z: np.ndarray) -> None:
        patches.append(np.stack(np.broadcast_arrays(r, z[:, None]), axis=-1))

    start = 0.0
    for top in neck.waists:
        edge = top - neck.dome_height if start else neck.clamp_depth
        for low, high, rows, bend in ((start, edge, away, 0.0), (edge, top, towards, 1.0)):
            z = low + (high - low) * rows
            add(core * towards, z)
            columns = away + bend * rows[:, None] * (even - away)
            add(core + (neck.dome_radius(top - z)[:, None] - core) * columns, z)
        start = top
    add(core * towards, np.linspace(start, neck.height, 3))
    places = np.round(np.concatenate([patch.reshape(-1, 2) for patch in patches]), 10)
    # Numbered as they come, whatever the lengths; on a waist the nodes of a row are one.
    _, came, number = np.unique(places, axis=0, return_index=True, return_inverse=True)
    kept, number = np.unique(came[number.ravel()], return_inverse=True)
    firsts = np.cumsum([0, *(patch[..., 0].size for patch in patches)])
    triangles = np.concatenate([number[k + _triangles(p.shape[:2])] for k, p in zip(firsts, patches, strict=False)])
    corners = np.sort(triangles[:, :3], axis=1)
    return sweep(places[kept], triangles[(np.diff(corners, axis=1) > 0).all(axis=1)], sectors=SECTORS)
